"""How far a robot sees frontiers askew, and that it looks into a gap before it goes to what it does not see."""

import numpy as np

from protocols.exploration.escaping import Escape
from protocols.exploration.overlay import Overlay
from protocols.exploration.parameters import EscapeParameters
from protocols.exploration.terrain import Terrain
from tests.protocols.exploration.hand_map import at, drawn, renew

GAP_AND_ROOM = """
    ##############?????#
    ##############.....#
    ##############.....#
    ##############.....#
    #..................#
    #..................#
    #..................#
    #######.############
    #######.############
    #######?############
"""
"""From (7, 4) a frontier is in sight in a gap; that which is wide enough to drive to is round the corner."""


def test_sight_reaches_as_far_askew_as_along_a_row() -> None:
    belief = drawn(" ".join(["." * 12] * 12))
    belief.evidence[9, 9] = 0
    renew(belief)
    overlay = Overlay(belief, 5.0)
    assert overlay.in_sight(at(6, 5)).tolist() == [9 * 12 + 9]  # 3 and 4 cells off
    assert overlay.in_sight(at(5, 5)).tolist() == []  # 4 and 4: in the square, not in the circle


def test_a_frontier_in_sight_that_can_only_be_looked_at_comes_before_one_that_is_not_in_sight() -> None:
    belief = drawn(GAP_AND_ROOM)
    frontiers, tried = Overlay(belief, 5.0).frontiers(), np.zeros_like(belief.frontier)
    way = Escape(EscapeParameters(), Terrain(belief, EscapeParameters()), 0.3, 2.5).way(
        at(7, 4), frontiers, tried, np.zeros(belief.evidence.shape, np.bool_)
    )
    assert way is not None
    assert way.lookout
    assert way.in_sight
    assert way.cells[-1] % 20 == 7
    frontiers[0, 7] = 0
    other = Escape(EscapeParameters(), Terrain(belief, EscapeParameters()), 0.3, 2.5).way(
        at(7, 4), frontiers, tried, np.zeros(belief.evidence.shape, np.bool_)
    )
    assert other is not None
    assert (other.lookout, other.in_sight, other.cells[-1] // 20) == (False, False, 9)
