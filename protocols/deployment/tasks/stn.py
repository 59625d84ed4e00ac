"""Simple temporal networks: whether a plan's temporal constraints have a solution, what they allow, and if none, why.

Theory: Dechter, Meiri and Pearl (1991). *least* <= t_j - t_i <= *most* is two arcs of a graph: j is at least *least*
after i, and i at least -*most* after j. There is a schedule if and only if no cycle of arcs has a positive length. Then
the length of the longest path from i to j is the least time from i to j.

The constraints of one simple cycle of positive length are a minimal conflict: without any one of them, what is left of
the cycle is a path, and constraints along a path can be met one after the other.

The planner asks before a plan begins, of a :class:`Network` that grows. The executive asks while the plan is carried
out: what has happened is fixed, all else lies in the future, and constraints that are broken or void are taken away; so
:func:`earliest`, :func:`latest` and :func:`conflict` take the arcs and the fixed instants as they are now.

Instants are integers (ns), so that no sum of rounded seconds makes a conflict.
"""

from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Final, NamedTuple, TypeAlias

from cosim.units import Time, from_seconds
from protocols.deployment.tasks.constraints import sentence
from protocols.deployment.tasks.plan import ORIGIN, Between, Edge, Instant, Task

Point: TypeAlias = tuple[str, Edge]
"""Name of a task, and which of its instants."""

BEGINNING: Final[Point] = (ORIGIN, "start")
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


class Arc(NamedTuple):
    """One limit of a bound: *later* is at least *least* (ns, may be negative) after *earlier*."""

    earlier: Point
    later: Point
    least: Time
    bound: Bound


def arcs_of(bound: Bound) -> list[Arc]:
    """Return the arc of the lower limit of *bound*, and that of the upper one if there is one."""
    arcs = [Arc(bound.earlier, bound.later, bound.least, bound)]
    if bound.most is not None:
        arcs.append(Arc(bound.later, bound.earlier, -bound.most, bound))
    return arcs


# ---------------------------------------------------------------- of plans


def point_of(instant: Instant) -> Point:
    """Return an instant of a plan as a point of its network."""
    return BEGINNING if instant.task == ORIGIN else (instant.task, instant.edge)


def asked(constraint: Between) -> Bound:
    """Return a plan's constraint as a bound, whose name says who asked for it."""
    most = None if constraint.at_most_s is None else from_seconds(constraint.at_most_s)
    name = constraint.why or sentence(constraint.earlier, constraint.later, constraint.at_least_s, constraint.at_most_s)
    earlier, later = point_of(constraint.earlier), point_of(constraint.later)
    return Bound(name, earlier, later, from_seconds(constraint.at_least_s), most)


def hierarchy(task: Task, lasts: Mapping[str, Time] = MappingProxyType({})) -> Iterator[Bound]:
    """Yield what holds between the instants of *task* and of all below it; *lasts*: least durations, 0 if not there.

    Tasks start before they end, subtasks are within their task, and serial ones follow each other.
    """
    start: Point = (task.name, "start")
    end: Point = (task.name, "end")
    yield Bound(f"{task.name} ends after it starts", start, end, lasts.get(task.name, 0))
    elder: Task | None = None
    for child in task.subtasks:
        yield from hierarchy(child, lasts)
        yield Bound(f"{child.name} is part of {task.name}", start, (child.name, "start"))
        if elder is not None and task.order == "serial":
            yield Bound(f"{child.name} comes after {elder.name}", (elder.name, "end"), (child.name, "start"))
        yield Bound(f"{child.name} is part of {task.name}", (child.name, "end"), end)
        elder = child


# ---------------------------------------------------------------- with fixed instants


def earliest(arcs: Sequence[Arc], fixed: Mapping[Point, Time], floor: Time | None = None) -> dict[Point, Time]:
    """Return how early instants can be, given those that are *fixed*, and that no other is before *floor*.

    Without *floor*, those that come after no fixed one are left out. A fixed instant stays, even if an arc forbids it.
    """
    times = dict(fixed)
    # the last round only sees that nothing changes any more, unless a cycle has a positive length: then there is no end
    for _ in range(len(arcs) + 1):
        changed = False
        for earlier, later, least, _ in arcs:
            if later in fixed or (since := times.get(earlier, floor)) is None:
                continue
            at = since + least
            if floor is not None and at < floor:
                at = floor
            known = times.get(later)
            if known is None or at > known:
                times[later] = at
                changed = True
        if not changed:
            break
    return times


def latest(arcs: Sequence[Arc], fixed: Mapping[Point, Time]) -> dict[Point, Time]:
    """Return how late instants can be, given those that are *fixed*; leave out those that come before no fixed one."""
    times = dict(fixed)
    for _ in range(len(arcs) + 1):
        changed = False
        # backwards, as latest instants follow from later ones: fewer rounds
        for earlier, later, least, _ in reversed(arcs):
            if earlier in fixed or later not in times:
                continue
            at = times[later] - least
            known = times.get(earlier)
            if known is None or at < known:
                times[earlier] = at
                changed = True
        if not changed:
            break
    return times


def conflict(arcs: Sequence[Arc], fixed: Mapping[Point, Time], floor: Time) -> list[Arc]:
    """Return arcs that contradict each other if some instants are *fixed* and no other is before *floor*; or none.

    They lead to a fixed instant that is too early for them, from one that is fixed or is not before *floor*; or else
    round in a circle. The last of them comes first.
    """
    times = dict(fixed)
    by: dict[Point, Arc] = {}
    for _ in range(len(arcs) + 1):
        changed = False
        for arc in arcs:
            at = times.get(arc.earlier, floor) + arc.least
            if at <= times.get(arc.later, floor):
                continue
            if arc.later in fixed:
                return _way(arc, by)
            times[arc.later], by[arc.later] = at, arc
            changed = True
        if not changed:
            return []
    return _way(_on_circle(by), by)


def _way(arc: Arc, by: Mapping[Point, Arc]) -> list[Arc]:
    """Return *arc*, and the arcs that led to it, given by which arc each instant was moved last."""
    way, seen = [arc], set[Point]()
    while (last := by.get(way[-1].earlier)) is not None and last.later not in seen:
        seen.add(last.later)
        way.append(last)
    return way


def _on_circle(by: Mapping[Point, Arc]) -> Arc:
    """Return an arc on a circle that has no end, given by which arc each instant was moved last."""
    seen = set[Point]()
    for arc in by.values():
        way = set[Point]()
        while arc.later not in seen:
            if arc.later in way:
                return arc
            way.add(arc.later)
            if arc.earlier not in by:
                break
            arc = by[arc.earlier]
        seen |= way
    raise AssertionError("times grew without end, but on no circle")


# ---------------------------------------------------------------- one bound after the other


class Network:
    """A network that grows: a schedule is kept and repaired with every bound, until one makes that impossible."""

    def __init__(self, bounds: Iterable[Bound] = ()) -> None:
        self.bounds: list[Bound] = []
        """All bounds that were added."""
        self.conflict: tuple[Bound, ...] = ()
        """Minimal conflict, once there is one: the bounds of a cycle of positive length."""
        self._times: dict[Point, Time] = {BEGINNING: 0}
        """Schedule that satisfies all bounds before the first conflict."""
        self._into: dict[Point, dict[Point, Arc]] = {}
        """Tightest arcs, by their later and their earlier point."""
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
        for arc in arcs_of(bound):
            for point in (arc.later, arc.earlier):
                self._times.setdefault(point, self._times[BEGINNING])
            into = self._into.setdefault(arc.later, {})
            known = into.get(arc.earlier)
            if known is None or arc.least > known.least:
                into[arc.earlier] = arc
                if self.consistent:
                    self._mend(arc)
        return self.consistent

    def _mend(self, added: Arc) -> None:
        """Move the instants that *added* makes earlier; if its own later one is among them, it closes a cycle."""
        by: dict[Point, Arc] = {}
        queue = deque([added])
        while queue:
            arc = queue.popleft()
            time = self._times[arc.later] - arc.least
            if time >= self._times[arc.earlier]:
                continue
            by[arc.earlier] = arc
            if arc.earlier == added.later:
                self.conflict = _closed(by, added)
                return
            self._times[arc.earlier] = time
            queue.extend(self._into.get(arc.earlier, {}).values())

    @property
    def arcs(self) -> list[Arc]:
        """Tightest arcs between any two points."""
        return [arc for into in self._into.values() for arc in into.values()]

    def windows(self) -> dict[Point, tuple[Time | None, Time | None]]:
        """Return the earliest and the latest instant of each point, ns; None without such a limit."""
        arcs, origin = self.arcs, {BEGINNING: 0}
        soonest, last = earliest(arcs, origin), latest(arcs, origin)
        return {point: (soonest.get(point), last.get(point)) for point in self._times}

    def least(self, earlier: Point, later: Point) -> Time | None:
        """Return the least time from *earlier* to *later* by all bounds together; None without a limit."""
        return earliest(self.arcs, {earlier: 0}).get(later)

    def most(self, earlier: Point, later: Point) -> Time | None:
        """Return the greatest time from *earlier* to *later* by all bounds together; None without a limit."""
        least = self.least(later, earlier)
        return None if least is None else -least


def _closed(by: Mapping[Point, Arc], added: Arc) -> tuple[Bound, ...]:
    """Return the bounds of the cycle that *added* closes, each once, in the cycle's order."""
    arcs = [by[added.later]]
    while arcs[-1] is not added:
        arcs.append(by[arcs[-1].later])
    return tuple(dict.fromkeys(arc.bound for arc in reversed(arcs)))
