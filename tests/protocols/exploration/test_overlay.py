"""What a robot lays into its own map, what it leaves out, and what it takes for being in sight."""

import numpy as np

from cosim.geometry.marking import CERTAIN
from protocols.exploration.forces import attract
from protocols.exploration.overlay import Overlay
from protocols.mapping.belief import Belief, Frame
from tests.protocols.exploration.hand_map import CELL_M, ORIGIN_M, at, drawn, path_of, renew

OPEN = "#####? #....? #####?"


def over(picture: str, range_m: float = 2.5) -> tuple[Overlay, Belief]:
    belief = drawn(picture, range_m)
    return Overlay(belief, range_m / CELL_M), belief


def attracting(
    overlay: Overlay, belief: Belief, ix: float, iy: float, only_path: bool = False
) -> list[tuple[int, int]]:
    """Return what attracts a robot that stands at a cell's centre, within 5 m."""
    result = np.full_like(belief.frontier, 7)
    grids = belief.frontier, overlay.ignored, belief.vain, overlay.path
    attract(*grids, only_path, *ORIGIN_M, CELL_M, *at(ix, iy), 5.0, result)
    return path_of(result, belief)


def cells(overlay: Overlay, place: tuple[float, float], new: bool = False) -> list[int]:
    found = overlay.new_in_sight(place) if new else overlay.in_sight(place)
    return [int(cell) for cell in found]


# ---------------------------------------------------------------- the path


def test_a_path_attracts_like_frontiers_and_is_in_no_other_map() -> None:
    belief = drawn(OPEN)
    mine, other = Overlay(belief, 5.0), Overlay(belief, 5.0)
    mine.lay([6 + 1, 6 + 2])
    assert attracting(mine, belief, 1, 1) == [(1, 1), (2, 1), (5, 1)]
    assert attracting(mine, belief, 1, 1, only_path=True) == [(1, 1), (2, 1)]
    assert attracting(other, belief, 1, 1) == path_of(belief.frontier, belief) == [(5, 1)]
    assert (mine.underway, other.underway) == (True, False)
    mine.lay([6 + 3])
    assert path_of(mine.path, belief) == [(3, 1)]
    assert mine.goal == 6 + 3
    mine.clear()
    assert not mine.underway
    assert attracting(mine, belief, 1, 1) == path_of(belief.frontier, belief)
    assert mine.goal == 6 + 3
    mine.lay([])
    assert not mine.underway


def test_cells_of_a_path_are_taken_back_where_the_robot_is_near() -> None:
    overlay, belief = over("########## #........? ##########")
    assert not overlay.pass_by(at(3, 1), 9.0)
    overlay.lay([10 + ix for ix in range(1, 9)])
    assert overlay.pass_by(at(3, 1), 1.0 + 1e-9)
    assert path_of(overlay.path, belief) == [(6, 1), (7, 1), (8, 1)]
    assert not overlay.pass_by(at(3, 1), 1.4)
    assert overlay.pass_by(at(7, 1), 0.5 + 1e-9)
    assert not overlay.underway
    assert not overlay.path.any()


def test_the_end_of_a_path_to_a_lookout_is_passed_only_very_near() -> None:
    overlay, belief = over("########## #........? ##########")
    overlay.lay([10 + ix for ix in range(1, 9)], 0.2)
    assert overlay.pass_by(at(7, 1), 5.0)
    assert path_of(overlay.path, belief) == [(8, 1)]
    assert not overlay.pass_by(at(7.5, 1), 5.0)
    assert overlay.pass_by(at(7.7, 1), 5.0)
    assert not overlay.underway


# ---------------------------------------------------------------- what is left out


def test_what_is_ignored_or_vain_does_not_attract_and_is_no_frontier() -> None:
    overlay, belief = over("#####? #....? #....? #....? #####?")
    other = Overlay(belief, 5.0)
    overlay.ignored[1, 5] = 1
    belief.vain[2, 5] = 1
    assert attracting(overlay, belief, 1, 1) == path_of(overlay.frontiers(), belief) == [(5, 3)]
    assert attracting(other, belief, 1, 1) == path_of(other.frontiers(), belief) == [(5, 1), (5, 3)]
    overlay.lay([6 + 5])
    assert attracting(overlay, belief, 1, 1) == [(5, 1), (5, 3)]
    assert path_of(overlay.frontiers(), belief) == [(5, 3)]
    assert overlay.any_frontier()
    overlay.ignored[3, 5] = 1
    assert not overlay.any_frontier()
    assert other.any_frontier()
    assert (overlay.any_ignored(), other.any_ignored()) == (True, False)
    belief.evidence[:, 5] = -1
    renew(belief)
    assert not overlay.any_ignored()


# ---------------------------------------------------------------- sight


def test_a_frontier_is_seen_within_the_scanners_range_only() -> None:
    overlay, _ = over("############ #..........? ############")
    for ix, seen in ((5, []), (6, [23]), (10, [23])):
        assert cells(overlay, at(ix, 1)) == cells(overlay, at(ix, 1), new=True) == seen
    overlay.note(np.array([23], np.int32))
    assert cells(overlay, at(10, 1), new=True) == []
    assert cells(overlay, at(10, 1)) == [23]
    overlay.ignored[1, 11] = 1
    assert cells(overlay, at(10, 1)) == []


def test_no_frontier_is_seen_through_walls_or_through_the_unknown() -> None:
    overlay, belief = over("######## #..#...? ########")
    assert cells(overlay, at(2, 1)) == []
    belief.evidence[1, 3] = -1
    renew(belief)
    assert cells(overlay, at(1, 1)) == []
    assert cells(overlay, at(2, 1)) == [15]
    belief.evidence[1, 4] = 0
    renew(belief)
    assert cells(overlay, at(2, 1), new=True) == [12]
    assert cells(overlay, at(2, 1)) == [12, 15]
    belief.vain[1, 4] = 1
    assert cells(overlay, at(2, 1), new=True) == []


def test_frontiers_beside_frontiers_belong_to_what_was_looked_at() -> None:
    overlay, _ = over("#####? #....? #....? #....? #####?")
    assert cells(overlay, at(4, 2), new=True) == [17]
    assert cells(overlay, at(4, 2)) == [11, 17, 23]


def test_a_frontier_has_an_edge_in_common_with_an_empty_cell() -> None:
    """In a corner of two walls the cell behind the corner is none: nobody would ever see it."""
    belief = Belief(Frame((0.0, 0.0), 1.0, 8, 8), CERTAIN, 9.0)
    turns = np.radians(np.arange(0.0, 360.0, 2.0) + 0.5)
    beams = np.stack((np.cos(turns), np.sin(turns)), axis=1)
    with np.errstate(divide="ignore"):
        walls = np.where(beams > 0, (6.0 - 3.3) / beams, (1.0 - 3.3) / beams).min(axis=1)
    belief.mark((3.3, 3.3), walls, beams, np.empty((0, 3)))
    assert (belief.evidence[1:6, 1:6] < 0).all()
    assert not belief.frontier.any()
    belief.merge(np.array([9], np.int32), np.array([True]), np.array([True]))
    assert not belief.frontier.any()
