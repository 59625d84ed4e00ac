"""A floor that was learned: the edges of its occupied cells are walls, and what nobody saw is no way."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from cosim.geometry.polylines import length_m
from protocols.deployment.driving.exploring import Outlook, ground_of
from protocols.deployment.driving.exploring_parameters import ExploringParameters
from protocols.deployment.driving.learned import EXPLORE, LearnedFloor, explained, floor_of, outlines
from protocols.deployment.planning.planner import Refusal
from protocols.deployment.tasks.crew import Body
from protocols.deployment.tasks.plan import Place
from protocols.motion.floor import Floor
from protocols.motion.parameters import DrivingParameters
from tests.protocols.deployment.crew_scene import RANGE_M, surroundings

BOUNDS_M = (0.0, 0.0, 4.0, 3.0)
CELL_M = 0.1
RADIUS_M = 0.25


def unit_edges(occupied: np.ndarray) -> set[tuple[tuple[int, int], tuple[int, int]]]:
    """Return the edges, from corner to corner, between an occupied cell and one that is not, one by one."""
    ny, nx = occupied.shape
    cells = {(ix, iy) for iy in range(ny) for ix in range(nx) if occupied[iy, ix]}
    edges = set()
    for ix, iy in cells:
        sides = (
            ((ix - 1, iy), (ix, iy), (ix, iy + 1)),
            ((ix + 1, iy), (ix + 1, iy), (ix + 1, iy + 1)),
            ((ix, iy - 1), (ix, iy), (ix + 1, iy)),
            ((ix, iy + 1), (ix, iy + 1), (ix + 1, iy + 1)),
        )
        edges |= {(a, b) for other, a, b in sides if other not in cells}
    return edges


@given(arrays.arrays(np.bool_, st.tuples(st.integers(1, 7), st.integers(1, 7))))
def test_outlines_are_the_edges_of_the_occupied_cells_each_once(occupied: np.ndarray) -> None:
    found = outlines(occupied, (-1.0, 2.0), 0.5)
    pieces = []
    for x1, y1, x2, y2 in (np.round((found - [-1.0, 2.0, -1.0, 2.0]) / 0.5).astype(int)).tolist():
        assert (x1 == x2) != (y1 == y2)
        steps = max(x2 - x1, y2 - y1)
        dx, dy = (x2 - x1) // steps, (y2 - y1) // steps
        pieces += [((x1 + k * dx, y1 + k * dy), (x1 + (k + 1) * dx, y1 + (k + 1) * dy)) for k in range(steps)]
    assert len(pieces) == len(set(pieces))
    assert set(pieces) == unit_edges(occupied)


def test_a_straight_wall_is_two_long_segments_and_its_ends() -> None:
    occupied = np.zeros((5, 9), np.bool_)
    occupied[2, 1:8] = True
    found = outlines(occupied, (0.0, 0.0), 1.0)
    assert sorted(map(tuple, found.tolist())) == [(1, 2, 1, 3), (1, 2, 8, 2), (1, 3, 8, 3), (8, 2, 8, 3)]


def evidence_of(unseen: bool = False) -> np.ndarray:
    """Return the map of a floor of 4 m x 3 m: a wall at x = 2 m with a door of 1 m, and nothing seen beyond."""
    evidence = np.full((32, 42), -5, np.int8)  # a cell more on all sides
    evidence[[0, -1], :] = evidence[:, [0, -1]] = 9
    evidence[1:12, 21] = evidence[21:31, 21] = 9
    if unseen:
        evidence[:, 30:] = 0
    return evidence


def floor(unseen: bool = False) -> LearnedFloor:
    learned = LearnedFloor(BOUNDS_M, DrivingParameters())
    learned.learn(evidence_of(unseen), (-CELL_M, -CELL_M), CELL_M)
    return learned


def test_nothing_is_known_of_a_floor_before_anybody_has_explored() -> None:
    blank = LearnedFloor(BOUNDS_M, DrivingParameters())
    assert not blank.free(RADIUS_M, (1.0, 1.0))
    assert blank.way(RADIUS_M, (1.0, 1.0), (3.0, 1.0)) is None
    assert blank.length_m(RADIUS_M, (1.0, 1.0), (1.0, 1.0)) is None


def test_ways_on_a_learned_floor_are_those_on_the_floor_with_walls_as_thick_as_cells() -> None:
    """The oracle is the floor as it would be given: the walls' outlines by hand."""
    walls = [(0.0, 0.0, 4.0, 0.0), (4.0, 0.0, 4.0, 3.0), (4.0, 3.0, 0.0, 3.0), (0.0, 3.0, 0.0, 0.0)]
    for low, high in ((0.0, 1.1), (2.0, 3.0)):
        walls += [(2.0, low, 2.1, low), (2.1, low, 2.1, high), (2.1, high, 2.0, high), (2.0, high, 2.0, low)]
    given_floor = Floor(walls, BOUNDS_M, lambda p: (p[:, 0] < 0) | (p[:, 0] > 4) | (p[:, 1] < 0) | (p[:, 1] > 3))
    for a, b in (((1.0, 0.5), (3.0, 0.5)), ((0.5, 2.5), (3.5, 1.0)), ((1.0, 1.0), (1.0, 2.0))):
        found, expected = floor().length_m(RADIUS_M, a, b), given_floor.length_m(RADIUS_M, a, b)
        assert found is not None
        assert found == pytest.approx(expected, abs=1e-9)


def test_what_is_scanned_within_a_walls_cell_or_on_its_edge_is_on_the_map() -> None:
    on = [(2.0, 0.5), (2.05, 0.5), (2.1, 1.05), (1.5, 0.0)]
    off = [(2.0, 1.2), (2.0, 1.9), (1.0, 0.5), (3.0, 1.5)]
    assert floor().off_walls(np.array([*on, *off])).tolist() == [list(each) for each in off]
    assert floor().off_walls(np.zeros((0, 2))).shape == (0, 2)


def test_nobody_is_sent_where_nothing_was_seen() -> None:
    known, part = floor(), floor(unseen=True)
    assert known.free(RADIUS_M, (3.4, 1.5))
    assert not part.free(RADIUS_M, (3.4, 1.5))
    assert part.free(RADIUS_M, (2.6, 1.5))
    assert part.way(RADIUS_M, (1.0, 1.5), (3.6, 1.5)) is None
    assert part.way(RADIUS_M, (1.0, 1.5), (2.6, 1.5)) is not None


def test_what_is_learned_later_counts_at_once() -> None:
    learned = floor(unseen=True)
    assert learned.length_m(RADIUS_M, (1.0, 1.5), (3.5, 1.5)) is None
    learned.learn(evidence_of(), (-CELL_M, -CELL_M), CELL_M)
    length_m = learned.length_m(RADIUS_M, (1.0, 1.5), (3.5, 1.5))
    assert length_m is not None
    assert 2.5 <= length_m < 2.6
    assert learned.field(RADIUS_M, (3.5, 1.5)).distance_m((1.0, 1.5)) < math.inf


def test_only_who_is_to_learn_the_map_knows_nothing_of_it() -> None:
    known = Floor([], BOUNDS_M, None, DrivingParameters(cell_m=0.2))
    assert floor_of(known, learned=False) is known
    learned = floor_of(known, learned=True)
    assert isinstance(learned, LearnedFloor)
    assert (learned.bounds_m, learned.parameters) == (known.bounds_m, known.parameters)


@pytest.mark.parametrize(
    ("why", "helps"),
    [
        ("no robot can get to (5, 3)", True),
        ("no way for it from (1, 1) to (2, 2)", True),
        ("3 robots are wanted, there are 2", False),
    ],
)
def test_exploring_is_offered_where_ways_are_missing(why: str, helps: bool) -> None:
    refusal = Refusal(play="deploy", conflicts=(why,), mend=("something else",))
    blank = LearnedFloor(BOUNDS_M, DrivingParameters())
    found = explained(refusal, blank)
    assert isinstance(found, Refusal)
    assert found.mend == ((EXPLORE, "something else") if helps else ("something else",))
    assert explained(refusal, Floor([], BOUNDS_M, None)) is refusal


# ---------------------------------------------------------------- how long it takes

SPEED_MPS = 0.3
"""Of explorers, by default; their bodies could go faster."""


def outlook(width_m: float, height_m: float, walls: Sequence[Sequence[float]] = (), **more: Any) -> Outlook:
    """Return what is known of a box with *walls* in it."""
    box = [[0, 0, width_m, 0], [width_m, 0, width_m, height_m], [width_m, height_m, 0, height_m], [0, height_m, 0, 0]]
    bounds_m = 0.0, 0.0, width_m, height_m
    around = surroundings(walls_m=np.array([*box, *walls], np.float64), bounds_m=bounds_m, forbidden=_nowhere)
    parameters = ExploringParameters(most_s=more.pop("most_s", 3600.0))
    floor = floor_of(Floor.of(around), more.pop("learned", False))
    return Outlook(parameters, ground_of(parameters, around), floor, more.pop("named_m", {}), 0.9)


def _nowhere(points: np.ndarray) -> np.ndarray:
    return np.zeros(len(points), np.bool_)


def least_s(known: Outlook, *places_m: Place, explorers: int = 1) -> float:
    return known.least_s({robot: Body() for robot in range(explorers)}, dict(enumerate(places_m)))


def mown_s(width_m: float, height_m: float, start_m: Place) -> float:
    """Return how long one robot takes to see an open floor in lanes that are as far apart as it sees on both sides.

    It marks what is as near to it as scans reach, walking in steps of half a metre; all must be marked in the end.
    """
    corners = [start_m]
    for lane, x in enumerate(np.arange(0.7 * RANGE_M, width_m, 1.4 * RANGE_M)):
        ends = [(float(x), 0.7 * RANGE_M), (float(x), height_m - 0.7 * RANGE_M)]
        corners += ends[:: 1 if lane % 2 == 0 else -1]
    x, y = np.meshgrid(np.arange(0.25, width_m, 0.5), np.arange(0.25, height_m, 0.5))
    unseen = np.ones(x.shape, np.bool_)
    for (ax, ay), (bx, by) in pairwise(corners):
        for share in np.linspace(0.0, 1.0, 2 + int(2 * math.dist((ax, ay), (bx, by)))):
            unseen &= np.hypot(x - ax - share * (bx - ax), y - ay - share * (by - ay)) > RANGE_M
    assert not unseen.any()
    return length_m(corners) / SPEED_MPS


def test_a_hall_takes_no_longer_than_to_be_mown_and_not_much_less() -> None:
    known, start_m = outlook(40.0, 40.0), (20.0, 20.0)
    assert 0.2 * mown_s(40.0, 40.0, start_m) < least_s(known, start_m) <= mown_s(40.0, 40.0, start_m)
    assert least_s(known, start_m, start_m, explorers=2) == pytest.approx(0.5 * least_s(known, start_m))


def test_the_end_of_a_corridor_is_come_near_to_by_whoever_is_nearest() -> None:
    known = outlook(30.0, 2.0)
    one_s, end_s = least_s(known, (1.0, 1.0)), (29.0 - RANGE_M) / SPEED_MPS
    assert 0.6 * end_s < one_s < end_s
    assert least_s(known, (1.0, 1.0), (1.0, 1.0), explorers=2) == one_s, "nobody is there sooner for company"
    assert least_s(known, (1.0, 1.0), (29.0, 1.0)) < 0.5 * one_s, "who stands by sees too"


def test_a_way_round_walls_counts_as_it_is() -> None:
    """The far end of a hairpin is 4 m from its beginning."""
    folded = outlook(60.0, 4.0, [[0.0, 2.0, 57.0, 2.0]])
    assert least_s(folded, (1.0, 1.0)) > 0.7 * (2 * 57.0 - RANGE_M) / SPEED_MPS


def test_what_explorers_cannot_get_to_takes_no_time() -> None:
    shut = outlook(80.0, 2.0, [[20.0, 0.0, 20.0, 2.0]])
    assert least_s(shut, (1.0, 1.0)) == least_s(outlook(20.0, 2.0), (1.0, 1.0))
    slit = outlook(80.0, 2.0, [[20.0, 0.0, 20.0, 0.7], [20.0, 1.3, 20.0, 2.0]])
    assert least_s(slit, (1.0, 1.0)) == least_s(shut, (1.0, 1.0))


def test_of_a_floor_that_is_to_be_learned_only_places_with_names_are_known() -> None:
    """Its extent may be empty: the floor of deployment_wean fills an eighth of its own."""
    assert least_s(outlook(80.0, 80.0, learned=True), (1.0, 1.0)) == 0.0
    far = outlook(80.0, 80.0, learned=True, named_m={"B": [(1.0, 9.0)], "C": [(1.0, 70.0), (5.0, 5.0)]})
    end_s = (69.0 - RANGE_M) / SPEED_MPS
    assert 0.8 * end_s < least_s(far, (1.0, 1.0)) < end_s


def test_nobody_explores_longer_than_the_longest_time() -> None:
    assert least_s(outlook(80.0, 2.0, most_s=50.0), (1.0, 1.0)) == 50.0
