"""Bodies are solid: corners, doors and helpers that stand in them."""

import math

import pytest

from protocols.reflection.events import GoalGivenUp, GoalReached, MadeWay
from tests.protocols.reflection.arena import RADIUS_M, Arena

DOOR = [(2.0, -9.0, 2.0, -0.5), (2.0, 0.5, 2.0, 9.0)]
"""A door of 1 m in a wall along x = 2: two bodies of 0.4 m do not fit side by side with room to pass."""


@pytest.mark.parametrize(
    ("seeker", "goal"),
    [
        ((0.0, 0.0), (5.0, 0.0)),  # sees the goal through the door
        ((0.0, -3.0), (5.0, -3.0)),  # sees neither the goal nor the way
        ((1.7, -3.0), (2.3, -4.0)),  # back to back with the goal
    ],
)
def test_a_helper_in_the_door_makes_way(seeker: tuple[float, float], goal: tuple[float, float]) -> None:
    arena = Arena([seeker, (2.0, 0.0)], [[goal]], walls=DOOR)
    assert arena.run(400, GoalReached) < 400
    assert [event.seeker for event in arena.told(1, MadeWay)][:1] == [0]


def test_a_body_in_the_door_that_does_not_make_way_costs_the_goal_and_no_more() -> None:
    arena = Arena([(0.0, 0.0), (2.0, 0.0)], [[(5.0, 0.0), (0.0, 3.0)]], walls=DOOR, give_up_s=20.0)
    arena.silent = {1}
    arena.run(400, GoalReached)
    assert [event.number for event in arena.told(0, GoalGivenUp)] == [1]
    assert [event.number for event in arena.told(0, GoalReached)] == [2]


def test_a_helper_on_the_goal_makes_way() -> None:
    arena = Arena([(0.0, 0.0), (4.0, 0.0)], [[(4.0, 0.0)]])
    assert arena.run(200, GoalReached) < 60


def test_a_helper_goes_back_to_its_post() -> None:
    arena = Arena([(0.0, 0.0), (2.0, 0.0)], [[(5.0, 0.0)]], [(), ((2.0, 0.0),)], DOOR)
    arena.run(400, MadeWay, 1)
    arena.tick(3)
    assert arena.machines[1].patrol is not None
    assert arena.machines[1].patrol.off_its_way
    arena.run(400, GoalReached)
    arena.tick(100)
    assert math.dist(arena.places[1], (2.0, 0.0)) <= 0.11


def test_a_patrol_goes_on_after_it_has_made_way() -> None:
    walls = [(-2.0, 1.0, 12.0, 1.0), (-2.0, -1.0, 12.0, -1.0)]
    arena = Arena([(0.0, 0.0), (8.0, 0.0)], [[(10.0, 0.0)]], [(), ((8.0, 0.0), (0.0, 0.0))], walls)
    assert arena.run(400, GoalReached) < 140
    assert arena.told(1, MadeWay)
    ends = set()
    for _ in range(400):
        arena.tick()
        ends |= {end for end in (0.0, 8.0) if math.dist(arena.places[1], (end, 0.0)) < 0.15}
    assert ends == {0.0, 8.0}


@pytest.mark.parametrize("frame", [0.0, 0.7, 2.0])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_jamb_that_a_body_touches_is_gone_round(frame: float, side: float) -> None:
    arena = Arena([(4.9, 5.0)], [[(4.9 - 1.4 * side, 2.0)]], walls=[(0, 4, 4.9 - 0.5 * side, 4)] if side > 0 else
                  [(4.9 - 0.5 * side, 4, 10, 4)], frames=[(1.0, 1.0, frame)])  # fmt: skip
    assert arena.run(100, GoalReached) < 50


def test_two_seekers_that_meet_pass_each_other() -> None:
    arena = Arena([(0.0, 0.0), (6.0, 0.0)], [[(6.0, 0.0)], [(0.0, 0.0)]])
    arena.run(200, GoalReached, 0)
    arena.run(200, GoalReached, 1)
    assert arena.told(0, GoalReached)
    assert arena.told(1, GoalReached)
    assert arena.now < 12 * 10**9


def test_bodies_stay_apart_in_this_arena() -> None:
    arena = Arena([(0.0, 0.0), (3.0, 0.0)], [[(6.0, 0.0)], [(-3.0, 0.0)]])
    for _ in range(80):
        arena.tick()
        assert math.dist(*arena.places) >= 2.0 * RADIUS_M - 1e-9
