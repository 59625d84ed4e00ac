"""Temporal networks against brute force: networks that have a schedule are accepted, true conflicts are named.

Fixed instants are tested by bounds that say the same.
"""

from collections.abc import Iterable
from itertools import combinations, pairwise

import networkx as nx
import numpy as np
import pytest
from hypothesis import strategies as st

from cosim.units import Time
from protocols.deployment.tasks.plan import Task
from protocols.deployment.tasks.stn import (
    BEGINNING,
    Arc,
    Bound,
    Network,
    Point,
    arcs_of,
    conflict,
    earliest,
    hierarchy,
    latest,
)
from tests.protocols.deployment.plan_strategies import tasks
from tests.tiers import tiers

STARTS: list[Point] = [(name, "start") for name in "abcd"]
ENDS: list[Point] = [(name, "end") for name in "abcd"]
POINTS: list[Point] = [BEGINNING, *(point for both in zip(STARTS, ENDS, strict=True) for point in both)]
A, B, C, D = POINTS[1:5]


def floyd_warshall(bounds: list[Bound]) -> dict[tuple[Point, Point], float]:
    """Return all distances by three nested loops."""
    points = sorted({point for bound in bounds for point in (bound.earlier, bound.later)} | {BEGINNING})
    far = {(i, j): 0.0 if i == j else np.inf for i in points for j in points}
    for bound in bounds:
        there, back = (bound.earlier, bound.later), (bound.later, bound.earlier)
        far[there] = min(far[there], np.inf if bound.most is None else bound.most)
        far[back] = min(far[back], -bound.least)
    for k in points:
        for i in points:
            for j in points:
                far[i, j] = min(far[i, j], far[i, k] + far[k, j])
    return far


def graph_of(bounds: Iterable[Bound]) -> "nx.DiGraph[Point]":
    """Return the distance graph: by an edge of weight w from i to j, j is at most w after i."""
    graph: nx.DiGraph[Point] = nx.DiGraph()
    for bound in bounds:
        for i, j, most in ((bound.later, bound.earlier, -bound.least), (bound.earlier, bound.later, bound.most)):
            if most is not None and most < graph.get_edge_data(i, j, {"weight": np.inf})["weight"]:
                graph.add_edge(i, j, weight=most)
    return graph


def has_schedule(bounds: list[Bound]) -> bool:
    return all(length >= 0 for (i, j), length in floyd_warshall(bounds).items() if i == j)


@st.composite
def witnessed(draw: st.DrawFn) -> tuple[dict[Point, Time], list[Bound]]:
    """Draw a schedule, and bounds loosened from it."""
    times = {point: draw(st.integers(0, 30)) for point in POINTS} | {BEGINNING: 0}
    bounds = []
    for number in range(draw(st.integers(1, 14))):
        earlier, later = draw(st.lists(st.sampled_from(POINTS), min_size=2, max_size=2, unique=True))
        apart = times[later] - times[earlier]
        least = apart - draw(st.integers(0, 9))
        most = draw(st.none() | st.integers(0, 9).map(lambda slack, apart=apart: apart + slack))
        bounds.append(Bound(f"bound {number}", earlier, later, least, most))
    return times, bounds


@st.composite
def any_bounds(draw: st.DrawFn) -> list[Bound]:
    """Draw bounds that may or may not have a schedule."""
    bounds = []
    for number in range(draw(st.integers(1, 12))):
        earlier, later = draw(st.lists(st.sampled_from(POINTS[:6]), min_size=2, max_size=2, unique=True))
        least = draw(st.integers(-6, 9))
        most = draw(st.none() | st.integers(-4, 9))
        bounds.append(Bound(f"bound {number}", earlier, later, least, most))
    return bounds


def assert_true_and_minimal(found: tuple[Bound, ...], bounds: list[Bound]) -> None:
    assert found
    assert set(found) <= set(bounds)
    assert not has_schedule(list(found))
    for left_out in found:
        assert has_schedule([bound for bound in found if bound is not left_out])


# ---------------------------------------------------------------- consistency


@tiers(40, 200, witnessed())
def test_a_network_with_a_schedule_is_accepted(case: tuple[dict[Point, Time], list[Bound]]) -> None:
    _, bounds = case
    network = Network(bounds)
    assert network.consistent
    assert network.conflict == ()


@tiers(40, 200, witnessed(), st.data())
def test_a_bound_tightened_below_what_the_others_demand_is_refused_with_a_true_conflict(
    case: tuple[dict[Point, Time], list[Bound]], data: st.DataObject
) -> None:
    _, bounds = case
    far = {pair: length for pair, length in floyd_warshall(bounds).items() if np.isfinite(length)}
    pairs = sorted(pair for pair in far if pair[0] != pair[1])
    i, j = data.draw(st.sampled_from(pairs))
    tight = Bound("tightened", i, j, int(far[i, j]) + 1)  # all others together say: at most far[i, j]
    for order in ([*bounds, tight], [tight, *bounds]):
        network = Network(order)
        assert not network.consistent
        assert_true_and_minimal(network.conflict, order)
        assert tight in network.conflict
    just = tight._replace(least=int(far[i, j]))
    assert Network([*bounds, just]).consistent


@tiers(40, 200, any_bounds())
def test_adding_one_by_one_says_the_same_as_all_at_once_and_as_brute_force(bounds: list[Bound]) -> None:
    network = Network()
    for count, bound in enumerate(bounds, start=1):
        expected = has_schedule(bounds[:count])
        assert network.add(bound) == expected
        assert nx.negative_edge_cycle(graph_of(bounds[:count])) != expected
    if not network.consistent:
        assert_true_and_minimal(network.conflict, bounds)


@tiers(40, 200, any_bounds())
def test_windows_are_the_shortest_paths_from_and_to_the_beginning(bounds: list[Bound]) -> None:
    far = floyd_warshall(bounds)
    if not has_schedule(bounds):
        return
    network = Network(bounds)
    for point, (soonest, last) in network.windows().items():
        assert (np.inf if last is None else last) == far[BEGINNING, point]
        assert (np.inf if soonest is None else -soonest) == far[point, BEGINNING]
    for i, j in combinations(sorted({point for pair in far for point in pair}), 2):
        least = network.least(i, j)
        assert (np.inf if least is None else -least) == far[j, i]


# ---------------------------------------------------------------- fixed instants


def arcs_from(bounds: list[Bound]) -> list[Arc]:
    return [arc for bound in bounds for arc in arcs_of(bound)]


def saying(fixed: dict[Point, Time], floor: Time, points: Iterable[Point]) -> list[Bound]:
    """Return bounds by which instants are *fixed*, and all other *points* not before *floor*."""
    held = [Bound("has happened", BEGINNING, point, at, at) for point, at in fixed.items() if point != BEGINNING]
    return held + [Bound("is not before now", BEGINNING, point, floor) for point in points if point not in fixed]


@tiers(40, 200, witnessed(), st.data())
def test_limits_with_fixed_instants_are_those_of_the_network_that_says_so(
    case: tuple[dict[Point, Time], list[Bound]], data: st.DataObject
) -> None:
    times, bounds = case
    happened = data.draw(st.sets(st.sampled_from(POINTS[1:])))
    fixed = {BEGINNING: 0} | {point: times[point] for point in POINTS if point in happened}
    left = [point for point in POINTS if point not in fixed]
    floor = min((times[point] for point in left), default=0) - data.draw(st.integers(0, 5))
    arcs = data.draw(st.permutations(arcs_from(bounds)))
    assert conflict(arcs, fixed, floor) == []
    far = floyd_warshall(bounds + saying(fixed, floor, left))
    soonest, last = earliest(arcs, fixed, floor), latest(arcs, fixed)
    named = {point for arc in arcs for point in (arc.earlier, arc.later)}
    for point in named | set(fixed):
        assert soonest.get(point, floor) == -far[point, BEGINNING]
        assert last.get(point, np.inf) == far[BEGINNING, point]
    far = floyd_warshall(bounds + saying(fixed, floor, []))
    soonest = earliest(arcs, fixed)
    assert all(-soonest.get(point, -np.inf) == far[point, BEGINNING] for point in named | set(fixed))


@tiers(60, 400, any_bounds(), st.data())
def test_arcs_that_contradict_what_has_happened_are_found_if_and_only_if_there_are_any(
    bounds: list[Bound], data: st.DataObject
) -> None:
    happened = data.draw(st.dictionaries(st.sampled_from(POINTS[1:6]), st.integers(-4, 12), max_size=2))
    fixed, floor = {BEGINNING: 0} | happened, data.draw(st.integers(-4, 12))
    said = saying(fixed, floor, POINTS)
    found = conflict(data.draw(st.permutations(arcs_from(bounds))), fixed, floor)
    assert (found == []) == has_schedule(bounds + said)
    if found:
        alone = [Bound("arc", arc.earlier, arc.later, arc.least) for arc in found]
        assert not has_schedule(alone + said)
        assert all(former.later == arc.earlier for arc, former in pairwise(found))


def test_a_fixed_instant_stays_where_it_is_and_what_follows_it_counts_from_there() -> None:
    arcs = arcs_from([Bound("too late", A, B, 9), Bound("after it", B, C, 2, 3)])
    assert earliest(arcs, {A: 0, B: 5}, 1) == {A: 0, B: 5, C: 7}
    assert latest(arcs, {A: 0, B: 5}) == {A: 0, B: 5, C: 8}
    assert [arc.bound.name for arc in conflict(arcs, {A: 0, B: 5}, 1)] == ["too late"]


def test_a_contradiction_is_told_from_its_end_back_to_what_is_fixed_or_round_a_circle() -> None:
    chain = arcs_from(
        [Bound("last", C, D, 2), Bound("other", A, C, 1), Bound("first", A, B, 3), Bound("next", B, C, 4)]
    )
    for fixed, floor in (({A: 0, D: 8}, 0), ({D: 8}, 0)):
        assert [arc.bound.name for arc in conflict(chain, fixed, floor)] == ["last", "next", "first"]
        assert conflict(chain, fixed | {D: 9}, floor) == []
    circle = arcs_from([Bound("there", A, B, 2), Bound("back", B, A, -1), Bound("away", B, C, 5)])
    assert {arc.bound.name for arc in conflict(circle, {}, 0)} == {"there", "back"}


# ---------------------------------------------------------------- hierarchies


def lawful(task: Task, times: dict[Point, Time]) -> bool:
    """Return whether tasks end after they start, and within what they are part of, serial ones in their order."""
    start, end = times[task.name, "start"], times[task.name, "end"]
    after = start
    for child in task.subtasks:
        if times[child.name, "start"] < after or times[child.name, "end"] > end or not lawful(child, times):
            return False
        after = times[child.name, "end"] if task.order == "serial" else start
    return start <= end


def one_after_the_other(task: Task, times: dict[Point, Time]) -> dict[Point, Time]:
    """Add a schedule to *times* in which no two instants are at once, and parallel tasks go backwards."""
    times[task.name, "start"] = len(times)
    for child in task.subtasks if task.order == "serial" else reversed(task.subtasks):
        one_after_the_other(child, times)
    times[task.name, "end"] = len(times)
    return times


@tiers(60, 400, tasks("t", 2, deadlines=False), st.data())
def test_times_satisfy_the_bounds_of_a_hierarchy_if_and_only_if_the_tasks_are_in_order(
    root: Task, data: st.DataObject
) -> None:
    bounds = list(hierarchy(root))
    points = sorted({point for bound in bounds for point in (bound.earlier, bound.later)})
    assert points == sorted((task.name, edge) for task in root.walk() for edge in ("start", "end"))
    times = one_after_the_other(root, {})
    assert lawful(root, times)
    for point in data.draw(st.lists(st.sampled_from(points), max_size=3)):
        times[point] += data.draw(st.integers(-4, 4))
    assert lawful(root, times) == all(times[bound.later] - times[bound.earlier] >= bound.least for bound in bounds)


# ---------------------------------------------------------------- cases


def test_a_conflict_names_only_what_takes_part_in_it() -> None:
    bounds = [
        Bound("drives for 60 s", A, B, 60, 90),
        Bound("pauses for 5 s", C, D, 5, 5),
        Bound("ends within 50 s", BEGINNING, B, 0, 50),
        Bound("begins at once", BEGINNING, A, 0),
    ]
    found = Network(bounds).conflict
    assert {bound.name for bound in found} == {"drives for 60 s", "ends within 50 s", "begins at once"}


def test_a_conflict_far_from_the_beginning_is_found() -> None:
    """What no path from the beginning reaches is looked at all the same."""
    bounds = [Bound("one", A, B, 5), Bound("other", B, A, -4)]
    assert {bound.name for bound in Network(bounds).conflict} == {"one", "other"}


def test_the_tightest_of_several_bounds_between_two_points_counts() -> None:
    loose, tight = Bound("loose", A, B, 0, 90), Bound("tight", A, B, 0, 10)
    for order in ([loose, tight], [tight, loose]):
        found = Network([*order, Bound("least", A, B, 20)]).conflict
        assert {bound.name for bound in found} == {"tight", "least"}


@pytest.mark.parametrize("bound", [Bound("empty", A, B, 5, 4), Bound("itself", A, A, 1)])
def test_a_bound_may_contradict_itself(bound: Bound) -> None:
    assert Network([bound]).conflict == (bound,)


def test_a_chain_of_tenths_of_seconds_that_fits_exactly_fits() -> None:
    chain = [Bound(f"step {i}", (str(i), "end"), (str(i + 1), "end"), 100_000_000) for i in range(300)]
    start = Bound("start", BEGINNING, ("0", "end"), 0, 0)
    end = Bound("end", BEGINNING, ("300", "end"), 0, 30_000_000_000)
    assert Network([start, *chain, end]).consistent
    assert not Network([start, *chain, end._replace(most=29_999_999_999)]).consistent


def test_the_first_conflict_stays() -> None:
    network = Network([Bound("empty", A, B, 5, 4)])
    first = network.conflict
    assert not network.add(Bound("empty too", C, D, 5, 4))
    assert network.conflict == first


@pytest.mark.slow
def test_random_networks_of_a_hundred_tasks_are_accepted_until_one_bound_is_too_tight() -> None:
    stream = np.random.default_rng(1)
    for _ in range(5):
        points = [BEGINNING, *((f"task {number}", edge) for number in range(100) for edge in ("start", "end"))]
        times = dict(zip(points, [0, *sorted(stream.integers(0, 10_000, 200).tolist())], strict=True))
        bounds = [Bound(f"{i[0]} then {j[0]}", i, j, 0) for i, j in pairwise(points)]
        for number in range(200):
            i, j = (points[at] for at in sorted(stream.integers(0, 201, 2).tolist()))
            apart = times[j] - times[i]
            bounds.append(Bound(f"bound {number}", i, j, apart - int(stream.integers(50)), apart + 20))
        bounds.append(Bound("all", BEGINNING, points[-1], 0, times[points[-1]] + 15))
        network = Network(bounds)
        assert network.consistent
        latest = network.windows()[points[-1]][1]
        far = nx.single_source_bellman_ford_path_length(graph_of(bounds), BEGINNING)
        assert dict(far)[points[-1]] == latest
        assert latest is not None
        late = Bound("too late", BEGINNING, points[-1], latest + 1)
        assert not network.add(late)
        assert late in network.conflict
        assert not nx.negative_edge_cycle(graph_of(network.conflict[1:]))
