"""Temporal networks against brute force: networks that have a schedule are accepted, true conflicts are named."""

from itertools import combinations, pairwise

import networkx as nx
import numpy as np
import pytest
from hypothesis import strategies as st

from cosim.units import Time
from protocols.deployment.planning.stn import BEGINNING, Bound, Network, Point, graph_of
from tests.protocols.deployment.tiers import tiers

A, B, C, D = (("a", "start"), ("a", "end"), ("b", "start"), ("b", "end"))
POINTS: list[Point] = [BEGINNING, *((name, edge) for name in "abcd" for edge in ("start", "end"))]


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
    for point, (earliest, latest) in network.windows().items():
        assert (np.inf if latest is None else latest) == far[BEGINNING, point]
        assert (np.inf if earliest is None else -earliest) == far[point, BEGINNING]
    for i, j in combinations(sorted({point for pair in far for point in pair}), 2):
        least = network.least(i, j)
        assert (np.inf if least is None else -least) == far[j, i]


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
