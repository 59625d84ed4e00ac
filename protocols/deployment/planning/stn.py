"""Simple temporal networks: whether a plan's temporal constraints have a solution, and if not, why not.

Theory: Dechter, Meiri and Pearl (1991). *least* <= t_j - t_i <= *most* is an edge i -> j of weight *most* and an edge
j -> i of weight *-least* of a graph; there is a schedule if and only if the graph has no negative cycle. Then, with d
the lengths of shortest paths, -d(i, origin) is the earliest instant of i, and d(origin, i) its latest.

The constraints of one simple negative cycle are a minimal conflict: without any one of them, what is left of the cycle
is a path, and constraints along a path can be met one after the other.

Instants are integers (ns), so that no sum of rounded seconds makes a conflict.
"""

from collections import deque
from collections.abc import Iterable
from typing import Final, NamedTuple, TypeAlias

import networkx as nx

from cosim.units import Time

Point: TypeAlias = tuple[str, str]
"""Name of a task, and "start" or "end"."""

BEGINNING: Final[Point] = ("", "start")
"""Instant from which windows are counted."""


class Bound(NamedTuple):
    """A named constraint: *later* is from *least* to *most* (ns; None: any time) after *earlier*."""

    name: str
    earlier: Point
    later: Point
    least: Time = 0
    most: Time | None = None

    @property
    def empty(self) -> bool:
        """True if it contradicts itself."""
        own = self.earlier == self.later and (self.least > 0 or (self.most is not None and self.most < 0))
        return own or (self.most is not None and self.most < self.least)


class _Edge(NamedTuple):
    """An edge t_head - t_tail <= weight, because of *bound*."""

    tail: Point
    head: Point
    weight: Time
    bound: Bound


def _edges(bound: Bound) -> list[_Edge]:
    edges = [_Edge(bound.later, bound.earlier, -bound.least, bound)]
    if bound.most is not None:
        edges.append(_Edge(bound.earlier, bound.later, bound.most, bound))
    return edges


# ---------------------------------------------------------------- at once


def graph_of(bounds: Iterable[Bound]) -> "nx.DiGraph[Point]":
    """Return the distance graph; of several edges between two points it has the tightest, with its ``bound``."""
    graph: nx.DiGraph[Point] = nx.DiGraph()
    graph.add_node(BEGINNING)
    for edge in (edge for bound in bounds for edge in _edges(bound)):
        known = graph.get_edge_data(edge.tail, edge.head)
        if known is None or edge.weight < known["weight"]:
            graph.add_edge(edge.tail, edge.head, weight=edge.weight, bound=edge.bound)
    return graph


def _lengths(graph: "nx.DiGraph[Point]", source: Point) -> dict[Point, Time]:
    """Return the lengths of the shortest paths from *source*: whole numbers, like the weights."""
    lengths = nx.single_source_bellman_ford_path_length(graph, source, weight="weight")
    return {point: int(length) for point, length in dict(lengths).items()}


# ---------------------------------------------------------------- one after the other


class Network:
    """A network that grows: a schedule is kept and repaired with every bound, until one makes that impossible."""

    def __init__(self, bounds: Iterable[Bound] = ()) -> None:
        self.bounds: list[Bound] = []
        """All bounds that were added."""
        self.conflict: tuple[Bound, ...] = ()
        """Minimal conflict, once there is one: the bounds of a negative cycle."""
        self._times: dict[Point, Time] = {BEGINNING: 0}
        """Schedule that satisfies all bounds before the first conflict."""
        self._outgoing: dict[Point, dict[Point, _Edge]] = {}
        """Tightest edges, by tail and head."""
        self.extend(bounds)

    @property
    def consistent(self) -> bool:
        """True if there is a schedule."""
        return not self.conflict

    def extend(self, bounds: Iterable[Bound]) -> bool:
        """Add *bounds* in their order; return whether there is still a schedule."""
        for bound in bounds:
            self.add(bound)
        return self.consistent

    def add(self, bound: Bound) -> bool:
        """Add *bound*; return whether there is still a schedule. The first conflict stays."""
        self.bounds.append(bound)
        if bound.empty:
            self.conflict = self.conflict or (bound,)
            return False
        for edge in _edges(bound):
            for point in (edge.tail, edge.head):
                self._times.setdefault(point, self._times[BEGINNING])
            outgoing = self._outgoing.setdefault(edge.tail, {})
            known = outgoing.get(edge.head)
            if known is None or edge.weight < known.weight:
                outgoing[edge.head] = edge
                if self.consistent:
                    self._mend(edge)
        return self.consistent

    def _mend(self, added: _Edge) -> None:
        """Move the instants that *added* makes earlier; if its own tail is one of them, it closes a negative cycle."""
        by: dict[Point, _Edge] = {}
        queue = deque([added])
        while queue:
            edge = queue.popleft()
            time = self._times[edge.tail] + edge.weight
            if time >= self._times[edge.head]:
                continue
            by[edge.head] = edge
            if edge.head == added.tail:
                self.conflict = _closed(by, added)
                return
            self._times[edge.head] = time
            queue.extend(self._outgoing.get(edge.head, {}).values())

    def windows(self) -> dict[Point, tuple[Time | None, Time | None]]:
        """Return the earliest and the latest instant of each point, ns; None without such a limit."""
        graph = graph_of(self.bounds)
        before, after = _lengths(graph.reverse(copy=False), BEGINNING), _lengths(graph, BEGINNING)
        return {point: (-before[point] if point in before else None, after.get(point)) for point in graph}

    def least(self, earlier: Point, later: Point) -> Time | None:
        """Return the least time from *earlier* to *later* by all bounds together; None without a limit."""
        graph = graph_of(self.bounds)
        if earlier not in graph or later not in graph:
            return None
        away = _lengths(graph, later)
        return -away[earlier] if earlier in away else None

    def most(self, earlier: Point, later: Point) -> Time | None:
        """Return the greatest time from *earlier* to *later* by all bounds together; None without a limit."""
        least = self.least(later, earlier)
        return None if least is None else -least


def _closed(by: dict[Point, _Edge], added: _Edge) -> tuple[Bound, ...]:
    """Return the bounds of the cycle that *added* closes, each once, in the cycle's order."""
    edges = [by[added.tail]]
    while edges[-1] is not added:
        edges.append(by[edges[-1].tail])
    return tuple(dict.fromkeys(edge.bound for edge in reversed(edges)))
