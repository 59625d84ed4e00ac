"""What a robot lays into its own map, where it goes when it is caught, and what it takes for being in sight."""

import numpy as np

from protocols.exploration.escaping import Escape, Overlay
from protocols.exploration.parameters import EscapeParameters
from tests.exploration.hand_map import at, drawn, path_of, renew

ROUND_THE_CORNER = """
    ####################
    #..................#
    #..................?
    #.########.......###
    #..?################
    ####################
"""
"""From (3, 3) a frontier is near round the corner, and one is far in sight."""


def escape(picture: str, radius_m: float = 0.0, range_m: float = 2.5, **changes: object) -> tuple[Escape, Overlay]:
    belief = drawn(picture, range_m)
    return Escape(EscapeParameters.model_validate(changes), belief, radius_m, range_m), Overlay(belief)


# ---------------------------------------------------------------- the overlay


def test_a_path_attracts_like_frontiers_and_is_in_no_other_map() -> None:
    belief = drawn("#####? #....? #####?")
    mine, other = Overlay(belief), Overlay(belief)
    mine.lay([6 + 1, 6 + 2])
    assert path_of(mine.attracting(), belief) == [(1, 1), (2, 1), (5, 0), (5, 1), (5, 2)]
    assert path_of(other.attracting(), belief) == path_of(belief.frontier, belief) == [(5, 0), (5, 1), (5, 2)]
    assert (mine.underway, other.underway) == (True, False)
    mine.lay([6 + 3])
    assert path_of(mine.path, belief) == [(3, 1)]
    mine.clear()
    assert not mine.underway
    assert path_of(mine.attracting(), belief) == path_of(belief.frontier, belief)
    mine.lay([])
    assert not mine.underway


def test_cells_of_a_path_are_taken_back_where_the_robot_is_near() -> None:
    belief = drawn("########## #........? ##########")
    overlay = Overlay(belief)
    assert not overlay.pass_by(at(3, 1), 9.0)
    overlay.lay([10 + ix for ix in range(1, 9)])
    assert overlay.pass_by(at(3, 1), 1.0 + 1e-9)
    assert path_of(overlay.path, belief) == [(6, 1), (7, 1), (8, 1)]
    assert not overlay.pass_by(at(3, 1), 1.4)
    assert overlay.pass_by(at(7, 1), 0.5 + 1e-9)
    assert not overlay.underway
    assert not overlay.path.any()


def test_what_was_given_up_does_not_attract_and_is_no_frontier() -> None:
    belief = drawn("#####? #....? #####?")
    overlay = Overlay(belief)
    overlay.give_up([5, 6 + 5])
    assert path_of(overlay.attracting(), belief) == path_of(overlay.frontiers(), belief) == [(5, 2)]
    overlay.lay([6 + 5])
    assert path_of(overlay.attracting(), belief) == [(5, 1), (5, 2)]
    assert path_of(overlay.frontiers(), belief) == [(5, 2)]
    assert overlay.attracting().max() == overlay.frontiers().max() == 1
    assert overlay.frontiers().dtype == np.uint8


# ---------------------------------------------------------------- ways


def test_frontiers_in_sight_are_preferred_to_nearer_ones() -> None:
    plans, overlay = escape(ROUND_THE_CORNER)
    cells, in_sight = plans.way(at(3, 3), overlay.frontiers()) or ([], None)
    assert in_sight is True
    assert cells[-1] % 20 == 19
    overlay.give_up([iy * 20 + 19 for iy in range(6)])
    cells, in_sight = plans.way(at(3, 3), overlay.frontiers()) or ([], None)
    assert in_sight is False
    assert (cells[-1] % 20, cells[-1] // 20) == (3, 1)


def test_a_way_leads_from_the_robot_over_empty_cells_to_a_frontier() -> None:
    for cost in ("octile", "printed"):
        plans, overlay = escape(ROUND_THE_CORNER, cost=cost)
        belief = overlay._belief
        overlay.give_up([iy * 20 + 19 for iy in range(6)])
        cells, _ = plans.way(at(9, 4), overlay.frontiers()) or ([], None)
        assert cells[0] == belief.frame.cell_at(at(9, 4))
        assert belief.frontier[divmod(cells[-1], 20)] == 1
        assert all(belief.evidence[divmod(cell, 20)] < 0 for cell in cells[:-1])
        steps = np.diff([divmod(cell, 20) for cell in cells], axis=0)
        assert np.abs(steps).max() == 1
        assert np.abs(steps).max(axis=1).min() == 1


def test_ways_keep_away_from_walls_as_far_as_they_cost_more() -> None:
    room = "############ #..........? #..........# #..........# #..........# #..........# #..........? ############"
    plans, overlay = escape(room, clearance_m=1.5, clearance_cost=50.0)
    overlay.give_up([6 * 12 + 11])
    rows = [cell // 12 for cell in (plans.way(at(1, 1), overlay.frontiers()) or ([], None))[0]]
    assert max(rows) >= 3
    plans, overlay = escape(room, clearance_cost=0.0)
    overlay.give_up([6 * 12 + 11])
    assert {cell // 12 for cell in (plans.way(at(1, 1), overlay.frontiers()) or ([], None))[0]} == {1}


def test_no_way_leads_through_a_wall_and_none_through_the_unknown() -> None:
    for picture in ("######## #...#..? ########", "######### #...#?### #...#..## #########"):
        plans, overlay = escape(picture)
        assert overlay.frontiers().any()
        assert plans.way(at(1, 1), overlay.frontiers()) is None


NARROW = """
    ###############
    #.............#
    #.............#
    #.............#
    #######.#######
    #######.#######
    #######?#######
"""


def test_who_is_too_wide_for_a_frontier_goes_where_it_can_be_seen() -> None:
    thin, overlay = escape(NARROW)
    cells, _ = thin.way(at(2, 4), overlay.frontiers()) or ([], None)
    assert (cells[-1] % 15, cells[-1] // 15) == (7, 0)
    wide, overlay = escape(NARROW, radius_m=0.3)
    cells, _ = wide.way(at(2, 4), overlay.frontiers()) or ([], None)
    ix, iy = cells[-1] % 15, cells[-1] // 15
    assert iy == 4  # nearer than its body allows it does not come: 0.55 m from a wall
    assert 0.5 * np.hypot(ix - 7, iy) <= 2.5
    blind, overlay = escape(NARROW, radius_m=0.3, range_m=1.5)
    assert blind.way(at(2, 4), overlay.frontiers()) is None


# ---------------------------------------------------------------- sight


def test_a_frontier_is_seen_within_the_scanners_range_only() -> None:
    plans, overlay = escape("############ #..........? ############", range_m=2.5)
    for ix, seen in ((5, False), (6, True), (10, True)):
        assert plans.sees(at(ix, 1), overlay.frontiers()) == seen
    overlay.give_up([11, 12 + 11, 24 + 11])
    assert not plans.sees(at(10, 1), overlay.frontiers())


def test_no_frontier_is_seen_through_walls_or_through_the_unknown() -> None:
    plans, overlay = escape("######## #..#...? ########")
    assert not plans.sees(at(2, 1), overlay.frontiers())
    plans.way(at(2, 1), overlay.frontiers())
    belief = overlay._belief
    belief.evidence[1, 3] = -1
    renew(belief)
    assert not plans.sees(at(1, 1), overlay.frontiers())
    assert plans.sees(at(2, 1), overlay.frontiers())
    belief.evidence[1, 4] = 0
    renew(belief)
    overlay.give_up([8 + 4])
    assert not plans.sees(at(2, 1), overlay.frontiers())
