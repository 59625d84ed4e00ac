"""What a robot lays into its own map, where it goes when it is caught, and what it takes for being in sight."""

import numpy as np

from protocols.exploration.escaping import Escape, Way, jambs
from protocols.exploration.overlay import Overlay
from protocols.exploration.parameters import EscapeParameters
from protocols.exploration.terrain import Terrain
from protocols.mapping.belief import Belief
from tests.protocols.exploration.hand_map import at, drawn, renew

ROUND_THE_CORNER = """
    ####################
    #..................#
    #..................?
    #.########.......###
    #..?################
    ####################
"""
"""From (3, 3) a frontier is near round the corner, and one is far in sight."""


class Planner:
    """What plans the ways of one robot, on a map drawn by hand."""

    def __init__(self, picture: str, radius_m: float = 0.0, range_m: float = 2.5, **changes: object) -> None:
        self.belief: Belief = drawn(picture, range_m)
        self.overlay = Overlay(self.belief, range_m / self.belief.frame.cell_m)
        own = EscapeParameters.model_validate(changes)
        self.escape = Escape(own, Terrain(self.belief, own), radius_m, range_m)
        self.tried = np.zeros_like(self.belief.frontier)
        self.looked = np.zeros(self.belief.evidence.shape, np.bool_)

    def ignore(self, *cells: tuple[int, int]) -> None:
        for ix, iy in cells:
            self.overlay.ignored[iy, ix] = 1

    def way(self, ix: float, iy: float) -> Way | None:
        return self.escape.way(at(ix, iy), self.overlay.frontiers(), self.tried, self.looked)

    def end(self, ix: float, iy: float) -> tuple[int, int]:
        found = self.way(ix, iy)
        assert found is not None
        row, column = divmod(found.cells[-1], self.belief.frame.nx)
        return column, row


# ---------------------------------------------------------------- ways


def test_frontiers_in_sight_are_preferred_to_nearer_ones() -> None:
    planner = Planner(ROUND_THE_CORNER)
    found = planner.way(3, 3)
    assert found is not None
    assert (found.in_sight, found.lookout) == (True, False)
    assert planner.end(3, 3)[0] == 19
    planner.ignore(*((19, iy) for iy in range(6)))
    found = planner.way(3, 3)
    assert found is not None
    assert found.in_sight is False
    assert planner.end(3, 3) == (3, 1)


def test_a_way_leads_from_the_robot_over_empty_cells_to_a_frontier() -> None:
    for cost in ("octile", "printed"):
        planner = Planner(ROUND_THE_CORNER, cost=cost)
        belief = planner.belief
        planner.ignore(*((19, iy) for iy in range(6)))
        cells = (planner.way(9, 4) or Way([], False, False)).cells
        assert cells[0] == belief.frame.cell_at(at(9, 4))
        assert belief.frontier[divmod(cells[-1], 20)] == 1
        assert all(belief.evidence[divmod(cell, 20)] < 0 for cell in cells[:-1])
        steps = np.diff([divmod(cell, 20) for cell in cells], axis=0)
        assert np.abs(steps).max() == 1
        assert np.abs(steps).max(axis=1).min() == 1


def test_ways_keep_away_from_walls_as_far_as_they_cost_more() -> None:
    room = "############ #..........? #..........# #..........# #..........# #..........# #..........? ############"
    for changes, highest in (({"clearance_m": 1.5, "clearance_cost": 50.0}, 3), ({"clearance_cost": 0.0}, 1)):
        planner = Planner(room, **changes)
        planner.ignore((11, 6))
        found = planner.way(1, 1)
        assert found is not None
        assert planner.end(1, 1) == (11, 1)
        rows = [cell // 12 for cell in found.cells]
        assert max(rows) >= highest
        assert max(rows) == 1 or highest > 1


def test_no_way_leads_through_a_wall_and_none_through_the_unknown() -> None:
    for picture in ("######## #...#..? ########", "######### #...#?### #...#..## #########"):
        planner = Planner(picture)
        assert planner.overlay.any_frontier()
        assert planner.way(1, 1) is None


def test_the_most_useful_frontier_may_be_farther_than_the_nearest() -> None:
    """Below (3, 1) one cell is unknown, beyond the right end many are."""
    picture = "####################???????? #...................???????? ###?################????????"
    assert Planner(picture).end(3, 1) == (3, 0)
    assert Planner(picture, choice="utility", information=1.0).end(3, 1) == (20, 1)
    assert Planner(picture, choice="utility", information=0.0).end(3, 1) == (3, 0)


# ---------------------------------------------------------------- lookouts

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
    thin = Planner(NARROW)
    assert thin.end(2, 4) == (7, 0)
    wide = Planner(NARROW, radius_m=0.3)
    found = wide.way(2, 4)
    assert found is not None
    assert found.lookout
    ix, iy = wide.end(2, 4)
    assert iy == 4  # nearer than its body allows it does not come: 0.55 m from a wall
    assert 0.5 * np.hypot(ix - 7, iy) <= 2.5
    assert Planner(NARROW, radius_m=0.3, range_m=1.5).way(2, 4) is None


def test_a_frontier_that_was_come_to_is_looked_at_from_elsewhere_and_from_no_place_twice() -> None:
    planner = Planner(NARROW)
    planner.tried[0, 7] = 1
    seen_from = set()
    while (found := planner.way(2, 4)) is not None:
        assert found.lookout
        row, column = divmod(found.cells[-1], 15)
        assert not planner.looked[row, column]
        planner.looked[row, column] = True
        seen_from.add((column, row))
    assert {(7, 1), (7, 2), (7, 3), (7, 4)} <= seen_from
    assert max(iy for _, iy in seen_from) == 4  # 2.25 m are nine tenths of the range


def test_at_last_a_robot_looks_past_the_ends_of_walls() -> None:
    picture = "####### #.....# #.....# ###.### #?....# #######"
    planner = Planner(picture)
    assert planner.belief.frontier[1, 1] == 1
    planner.tried[1, 1] = 1
    planner.looked[:3] = True
    found = planner.way(5, 4)
    assert found is not None
    assert found.lookout
    assert planner.end(5, 4)[1] >= 3


def test_ends_and_corners_of_walls_are_cells_beside_which_empty_ones_meet_at_a_corner() -> None:
    clear = drawn("####### #.....# ###.### #.....# #..#..# #######").evidence < 0
    assert sorted((int(ix), int(iy)) for iy, ix in np.argwhere(jambs(clear))) == [(2, 3), (3, 1), (4, 3)]


# ---------------------------------------------------------------- where a robot stands


def test_a_robot_that_stands_where_its_body_does_not_fit_goes_to_where_it_does() -> None:
    """Beside a wall that was seen from both sides, so that the robot's own side of it seems occupied."""
    room = "########## #........? #........? #........? #........? ##########"
    planner = Planner(room, radius_m=0.3)
    assert planner.escape.ground().passable[2, 5]
    assert not planner.escape.ground().passable[1, 1]
    assert planner.escape.entry(at(1, 1))[0] == planner.belief.frame.cell_at(at(1, 1))
    last = planner.escape.entry(at(1, 1))[-1]
    assert planner.escape.ground().passable.flat[last]
    found = planner.way(1, 1)
    assert found is not None
    steps = np.abs(np.diff([divmod(cell, 10) for cell in found.cells], axis=0))
    assert steps.max() == steps.max(axis=1).min() == 1
    assert planner.escape.entry(at(5, 2)) == [planner.belief.frame.cell_at(at(5, 2))]


def test_the_floor_under_a_robot_is_empty_even_if_no_beam_has_passed_it() -> None:
    room = "########## #........? #........? #????....? #????....? #????....? #........? ##########"
    planner = Planner(room, radius_m=0.6)
    blind = Planner(room, radius_m=0.0)
    assert blind.escape.entry(at(3, 3)) == []
    assert planner.escape.entry(at(3, 3)) != []


def test_from_where_no_way_leads_out_there_is_none() -> None:
    planner = Planner("###### #.#..? #.#..? ######", radius_m=0.3)
    assert planner.escape.entry(at(1, 1)) == []
    assert planner.way(1, 1) is None


def test_the_ground_is_that_of_the_map_as_it_is() -> None:
    planner = Planner(NARROW)
    assert planner.escape.ground().clear[4, 3]
    planner.belief.evidence[4, 3] = 127
    renew(planner.belief)
    assert not planner.escape.ground().clear[4, 3]
    assert not planner.escape.ground().passable[4, 3]
