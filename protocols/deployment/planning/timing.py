"""Durations of tasks, and the temporal network of a whole plan.

A drive takes at least the time of its way at full speed (with least_share: ways on a grid of cells are up to 8 % too
long), and at most a multiple of the expected time. A task contains its subtasks; in a serial one they follow each
other. A task that may be cut short (it ends with another, or its time-out is skipped) has no least duration. Every
bound has a name in words, by which conflicts are reported.

Exploring takes at least the time in which the floor can have been seen, if that is known; there is no upper bound.
Where the robots are afterwards is not known either, nor, therefore, how long their next drives take.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple, TypeAlias

import networkx as nx
from pydantic import Field

from cosim.machine import Address
from cosim.settings import Gain, Seconds, Settings
from cosim.units import from_seconds, to_seconds
from protocols.deployment.tasks.constraints import in_seconds
from protocols.deployment.tasks.crew import Body
from protocols.deployment.tasks.plan import Between, Explore, Go, Place, Standing, Task, Wait, actors
from protocols.deployment.tasks.stn import BEGINNING, Bound, Network, Point, asked, hierarchy, point_of


class TimingParameters(Settings):
    """What the planner assumes of durations."""

    least_share: float = Field(
        default=0.9, gt=0, le=1, description="least time of a drive as a share of its time at full speed"
    )
    turns_s: Seconds = Field(default=5.0, ge=0, description="s, time expected for the turns of a drive")
    slack: Gain = Field(default=4.0, ge=1, description="greatest time of a drive as a multiple of the expected time")
    photo_s: Seconds = Field(
        default=5.0, ge=0, description="s, greatest time of a picture, or of facing a place, besides the turn for it"
    )


LeastExploring: TypeAlias = Callable[[Mapping[Address, Body], Mapping[Address, Place]], float]
"""Returns the least time (s) in which robots explore, by the places of all robots then; 0 if nothing is known."""


class Span(NamedTuple):
    """The duration of a task, and its name in conflicts."""

    least_s: float
    expected_s: float
    """Infinite if it is not known."""
    most_s: float | None
    name: str


class Leg(NamedTuple):
    """A drive as the planner sees it: the robot, and the places from its start to its end."""

    task: str
    robot: Address
    places_m: tuple[Place, ...]
    from_known: bool = True
    """True if the first place is the start; after exploring it is where the robot set out to explore."""


def drive_s(length_m: float, body: Body) -> float:
    """Return the shortest time of a straight drive from rest to rest, within the limits of speed and acceleration."""
    speed, acceleration = body.speed_mps, body.acceleration_mps2
    if length_m < speed * speed / acceleration:
        return 2.0 * math.sqrt(length_m / acceleration)
    return length_m / speed + speed / acceleration


def driving(leg: Leg, length_m: float, body: Body, parameters: TimingParameters) -> Span:
    """Return the duration of a drive of *length_m*."""
    if not leg.from_known:
        return Span(0.0, math.inf, None, f"{leg.task}: robot {leg.robot} comes from wherever it has explored")
    free_s = drive_s(length_m, body)
    expected_s = free_s + parameters.turns_s
    least_s, most_s = parameters.least_share * free_s, parameters.slack * expected_s
    x_m, y_m = leg.places_m[-1]
    to = f"drives {length_m:.1f} m to ({x_m:g}, {y_m:g})"
    name = f"{leg.task}: robot {leg.robot} {to} at {body.speed_mps:g} m/s in {least_s:.1f} to {most_s:.1f} s"
    return Span(least_s, expected_s, most_s, name)


def exploring(task: Task, least_s: float) -> Span:
    """Return the duration of exploring, of which only the lower bound *least_s* is known."""
    return Span(least_s, math.inf, None, f"{task.name}: exploring takes at least {least_s:.1f} s")


def standing(task: Task, bodies: Sequence[Body], parameters: TimingParameters) -> Span | None:
    """Return the duration of a task for which robots stay where they are; None for any other task.

    A robot that faces some direction may have to make half a turn: its heading is not known before.
    """
    match task.act:
        case Wait(seconds=seconds):
            return Span(seconds, seconds, seconds, f"{task.name}: lasts {in_seconds(seconds)} s")
        case act if isinstance(act, Standing):
            most_s = parameters.photo_s + (bodies[act.robot].half_turn_s if act.turns else 0.0)
            return Span(0.0, most_s, most_s, f"{task.name}: takes at most {most_s:g} s")
        case _:
            return None


# ---------------------------------------------------------------- order


def precedence(root: Task, constraints: Sequence[Between]) -> "nx.DiGraph[Point]":
    """Return the graph of which instants are not earlier than which, by the plan's shape and its constraints."""
    graph: nx.DiGraph[Point] = nx.DiGraph()
    for bound in structure(root):
        graph.add_edge(bound.earlier, bound.later)
    for each in constraints:
        if each.at_least_s >= 0:
            graph.add_edge(*_step(each))
    return graph


def in_order(root: Task, graph: "nx.DiGraph[Point]") -> list[Task]:
    """Return the leaves in an order in which they can start; where *graph* leaves it open, in the plan's order."""
    # instants that must be simultaneous, as when two tasks start together, form a cycle: condense them into one
    number = {(task.name, "start"): at for at, task in enumerate(root.walk())}
    number |= {(name, "end"): at for (name, _), at in list(number.items())}
    moments = nx.condensation(graph)
    moment_of: dict[Point, int] = moments.graph["mapping"]
    first: dict[int, int] = {}
    for point, moment in moment_of.items():
        first[moment] = min(number.get(point, -1), first.get(moment, len(number)))
    order = nx.lexicographical_topological_sort(moments, key=lambda moment: first[moment])
    at = {moment: position for position, moment in enumerate(order)}
    leaves = [task for task in root.walk() if task.leaf]
    return sorted(leaves, key=lambda task: at[moment_of[task.name, "start"]])


def circle(root: Task, graph: "nx.DiGraph[Point]", constraints: Sequence[Between]) -> list[Between]:
    """Return the *constraints* of a circle, by which a task would have to end before it starts; or none."""
    # the temporal network allows such a task if it may take no time, but it would wait for its own end for ever
    for leaf in () if nx.is_directed_acyclic_graph(graph) else root.walk():
        if leaf.leaf and nx.has_path(graph, (leaf.name, "end"), (leaf.name, "start")):
            steps = set(pairwise(nx.shortest_path(graph, (leaf.name, "end"), (leaf.name, "start"))))
            steps -= {(bound.earlier, bound.later) for bound in structure(root)}
            return [each for each in constraints if each.at_least_s >= 0 and _step(each) in steps]
    return []


def wanted_at_once(
    leaves: Sequence[Task], graph: "nx.DiGraph[Point]", robots_of: Callable[[Task], tuple[Address, ...]]
) -> list[tuple[Address, str, str]]:
    """Return robots with two tasks of which none precedes the other; *leaves* in the order of their starts."""
    tasks: dict[Address, list[str]] = {}
    for leaf in leaves:
        for robot in robots_of(leaf):
            tasks.setdefault(robot, []).append(leaf.name)
    return [
        (robot, a, b)
        for robot, names in sorted(tasks.items())
        for a, b in pairwise(names)
        if not nx.has_path(graph, (a, "end"), (b, "start"))
    ]


def legs_of(leaves: Sequence[Task], starts_m: Mapping[Address, Place]) -> dict[str, Leg]:
    """Return the drives among *leaves*, in the order of their starts, by their tasks' names.

    A drive begins where the robot's last one ended; after exploring, where the robot set out to explore.
    """
    at, legs, strayed = dict(starts_m), dict[str, Leg](), set[Address]()
    for leaf in leaves:
        if isinstance(leaf.act, Go):
            go = leaf.act
            places_m = (at[go.robot], *go.via_m, go.place_m)
            legs[leaf.name] = Leg(leaf.name, go.robot, places_m, go.robot not in strayed)
            at[go.robot] = go.place_m
            strayed.discard(go.robot)
        elif isinstance(leaf.act, Explore):
            strayed |= set(leaf.act.robots)
    return legs


def first_exploration(
    leaves: Sequence[Task], graph: "nx.DiGraph[Point]", starts_m: Mapping[Address, Place]
) -> tuple[Task, dict[Address, Place]] | None:
    """Return the first exploration among *leaves*, in the order of their starts, and the places of all robots then.

    None if there is none, or if other robots may be under way or explore at the same time: they see the floor too.
    """
    at = dict(starts_m)
    for leaf in leaves:
        if isinstance(leaf.act, Go):
            at[leaf.act.robot] = leaf.act.place_m
        elif isinstance(leaf.act, Explore):
            others = [each for each in leaves if actors(each.act) and each != leaf]
            return (leaf, at) if all(_apart(graph, leaf, each) for each in others) else None
    return None


def _apart(graph: "nx.DiGraph[Point]", a: Task, b: Task) -> bool:
    """Return whether one of two tasks ends before the other starts."""
    return any(nx.has_path(graph, (first.name, "end"), (then.name, "start")) for first, then in ((a, b), (b, a)))


# ---------------------------------------------------------------- networks


def structure(root: Task) -> Iterator[Bound]:
    """Yield the bounds of a plan's shape: its hierarchy, which does not start before the plan begins."""
    yield Bound(f"{root.name} is the plan", BEGINNING, (root.name, "start"))
    yield from hierarchy(root)


def lasting(root: Task, spans: Mapping[str, Span]) -> Iterator[Bound]:
    """Yield the durations of leaves; those that may be cut short have no least duration."""
    short = _cut_short(root)
    for name, span in spans.items():
        least = 0 if name in short else from_seconds(span.least_s)
        most = None if span.most_s is None else max(from_seconds(span.most_s), least)
        yield Bound(span.name, (name, "start"), (name, "end"), least, most)


def expected_s(root: Task, spans: Mapping[str, Span], constraints: Sequence[Between]) -> float:
    """Return the expected end of a plan, s, if everything begins as soon as it may; infinite if unknown."""
    short = _cut_short(root)
    ended = {inner.name for task in root.walk() if task.ends_with is not None for inner in task.walk()}
    if any(math.isinf(span.expected_s) for name, span in spans.items() if name not in ended):
        return math.inf
    bounds = [*structure(root), *ending(root)]
    bounds += [
        Bound(span.name, (name, "start"), (name, "end"), from_seconds(span.expected_s))
        for name, span in spans.items()
        if name not in short
    ]
    bounds += [asked(each)._replace(most=None) for each in constraints]
    network = Network(bounds)
    if not network.consistent:
        return math.inf
    earliest, _ = network.windows()[root.name, "end"]
    return to_seconds(earliest or 0)


def ending(root: Task) -> Iterator[Bound]:
    """Yield the bounds by which tasks end no later than those that terminate them."""
    for task in root.walk():
        if task.ends_with is not None:
            yield Bound(f"{task.name} ends with {task.ends_with}", (task.name, "end"), (task.ends_with, "end"))


def timing_out(root: Task) -> Iterator[tuple[Bound, Task]]:
    """Yield the time-outs as bounds, each with its task."""
    for task in root.walk():
        if task.time_out_s is not None:
            name = f"{task.name}: times out after {in_seconds(task.time_out_s)} s"
            yield Bound(name, (task.name, "start"), (task.name, "end"), 0, from_seconds(task.time_out_s)), task


def _step(constraint: Between) -> tuple[Point, Point]:
    return point_of(constraint.earlier), point_of(constraint.later)


def _fatal(task: Task, fatal: bool = True) -> Iterator[tuple[Task, bool]]:
    """Yield each task, and whether its failure makes the whole plan fail."""
    fatal = fatal and task.on_failure != "skip"
    yield task, fatal
    for inner in task.subtasks:
        yield from _fatal(inner, fatal)


def _cut_short(root: Task) -> set[str]:
    """Return the tasks that may end before they are done without a failure of the plan."""
    cut = [
        task
        for task, fatal in _fatal(root)
        if task.ends_with is not None or (task.time_out_s is not None and not fatal)
    ]
    return {inner.name for task in cut for inner in task.walk()}
