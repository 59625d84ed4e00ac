"""What a robot does whose straight way is blocked: to which side it steps, in which order it tries, what it remembers.

Here the robot's line lies along the x axis of a frame of its own, turned and shifted against that of its observations:
*along* is ahead, *across* to the left.
"""

import math
from collections.abc import Callable, Sequence

import numpy as np
import pytest

from cosim.observation import Observation, Seen, Sighting
from cosim.units import MS, S
from protocols.reflection.straight import CALM_STEPS, DEAF_TICKS, Straight

RADIUS_M, STEP_M, TICK = 0.2, 0.1, 100 * MS
LEFT, RIGHT = 45.0, -45.0
Along = Callable[[float, float], bool]


def open_ground(along: float, across: float) -> bool:
    """See everything."""
    return True


class Bench:
    """A robot that heads straight for a place *place_m* ahead, and the ground around it."""

    def __init__(self, turn: float = 0.0, seen: Along = open_ground, bodies: Sequence[tuple[float, float]] = ()):
        self.straight = Straight(RADIUS_M, STEP_M, 10 * S, 0)
        self.cos, self.sin = math.cos(turn), math.sin(turn)
        self.seen, self.bodies = seen, bodies
        self.at = (0.0, 0.0)
        self.now = 0

    def turns(self, blocked: bool, place_m: float = 5.0) -> float:
        """Ask for one tick where to go; return by how many degrees that is off the line to the place."""
        self.now += TICK
        x, y = self.out(*self.at)
        sightings = tuple(Sighting(k, *self.out(*body)) for k, body in enumerate(self.bodies, 1))
        visible = tuple(range(1, len(self.bodies) + 1))
        observation = Observation(x, y, 0.0, 0.0, False, blocked, Seen(visible, sightings), self)
        to_x, to_y = self.straight.towards(self.out(place_m, 0.0), place_m - self.at[0], observation, self.now)
        along, across = self.into(to_x, to_y)
        line = math.atan2(-self.at[1], place_m - self.at[0])
        turn = math.degrees(math.atan2(across - self.at[1], along - self.at[0]) - line)
        return round((turn + 180.0) % 360.0 - 180.0, 6)

    def out(self, along: float, across: float) -> tuple[float, float]:
        return 3.0 + self.cos * along - self.sin * across, -2.0 + self.sin * along + self.cos * across

    def into(self, x: float, y: float) -> tuple[float, float]:
        return self.cos * (x - 3.0) + self.sin * (y + 2.0), self.cos * (y + 2.0) - self.sin * (x - 3.0)

    def sees(self, points_m: Sequence[tuple[float, float]]) -> list[bool]:
        return [self.seen(*self.into(*point)) for point in points_m]

    def ranges_m(self) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        raise AssertionError("a scan has too few beams for the end of a wall")


@pytest.mark.parametrize("turn", [0.0, 0.9, 2.5, -1.7])
@pytest.mark.parametrize(
    ("seen", "side"),
    [
        (lambda _, across: across < 0.15, RIGHT),  # a jamb on the left, 5 cm deep in the body's way
        (lambda _, across: across > -0.15, LEFT),
        (lambda along, across: not (0.25 < along < 0.35 and across < 0.0), LEFT),  # a body's width before the robot
        (lambda along, across: along < 1.1 or across > 0.0, LEFT),  # three bodies off
        (lambda along, across: along < 0.8 if across > 0.0 else along < 0.5, LEFT),  # both: the left one begins later
        (lambda along, across: along < 0.5 if across > 0.0 else along < 0.8, RIGHT),
    ],
)
def test_it_steps_to_the_side_on_which_it_sees_more_room(turn: float, seen: Along, side: float) -> None:
    assert Bench(turn, seen).turns(blocked=True) == side


@pytest.mark.parametrize(
    ("seen", "place_m"),
    [
        (open_ground, 5.0),
        (lambda along, _: along < 0.4, 5.0),  # a wall across
        (lambda _, across: across > -0.3, 5.0),  # the body passes by it
        (lambda along, across: along < 1.3 or across > 0.0, 5.0),  # still far off
        (lambda along, across: along < 0.55 or across > 0.0, 0.5),  # behind the place
    ],
)
def test_where_both_sides_look_alike_it_steps_to_the_right(seen: Along, place_m: float) -> None:
    assert Bench(0.4, seen).turns(blocked=True, place_m=place_m) == RIGHT


def closed_right(along: float, across: float) -> bool:
    return across > 0.0


def nearly_closed_left(along: float, across: float) -> bool:
    return across < 0.0 or along < 0.4


@pytest.mark.parametrize("turn", [0.0, 2.5])
@pytest.mark.parametrize(
    ("bodies", "seen", "side"),
    [
        ([(0.40, -0.12)], open_ground, LEFT),
        ([(0.63, -0.20)], open_ground, LEFT),  # 0.66 m off, centre to centre
        ([(0.70, -0.20)], open_ground, RIGHT),  # 0.73 m: not what is in the way
        ([(-0.35, -0.2)], open_ground, RIGHT),  # behind
        ([(0.40, -0.08)], open_ground, RIGHT),  # right ahead, passed on the right
        ([(0.40, 0.0)], closed_right, RIGHT),
        ([(0.40, 0.12)], closed_right, RIGHT),
        ([(0.70, 0.20)], closed_right, LEFT),
        ([(0.40, -0.12)], nearly_closed_left, LEFT),  # a body is more in the way than a wall
        ([(0.40, -0.12), (0.1, 0.45)], open_ground, RIGHT),  # one on either side
        ([(0.40, -0.12), (0.1, -0.45), (0.1, 0.45)], open_ground, LEFT),
    ],
)
def test_bodies_that_may_be_touched_take_room(
    turn: float, bodies: list[tuple[float, float]], seen: Along, side: float
) -> None:
    assert Bench(turn, seen, bodies).turns(blocked=True) == side


def tries(bench: Bench, count: int) -> list[float]:
    """Return the directions of so many steps aside of a robot that is blocked all the time."""
    directions = [[bench.turns(blocked=True) for _ in range(DEAF_TICKS)] for _ in range(count)]
    assert all(len(set(step)) == 1 for step in directions), "a step is not known to be blocked before its third tick"
    return [step[0] for step in directions]


def test_if_all_is_blocked_it_tries_one_side_then_the_other_then_half_back() -> None:
    assert tries(Bench(), 7) == [-45.0, -90.0, 45.0, 90.0, -135.0, 135.0, -45.0]
    assert tries(Bench(seen=closed_right), 3) == [45.0, 90.0, -45.0]


def step_aside(bench: Bench, blocked_tries: int) -> float:
    """Have the robot step aside after so many blocked tries, freely; return into which direction that was."""
    tries(bench, blocked_tries)
    turn = bench.turns(blocked=True)
    bench.at = bench.at[0], bench.at[1] + math.copysign(0.2, turn)
    assert bench.turns(blocked=False) == 0.0, "after a free step it tries its line again"
    assert not bench.straight.rounding
    return turn


@pytest.mark.parametrize("seen", [open_ground, closed_right])
@pytest.mark.parametrize(
    ("blocked_tries", "same"), [(0, True), (1, True), (2, False), (3, False), (4, True), (5, False)]
)
def test_it_keeps_to_the_side_to_which_it_could_step(seen: Along, blocked_tries: int, same: bool) -> None:
    bench = Bench(seen=seen)
    first = LEFT if seen is closed_right else RIGHT
    turn = step_aside(bench, blocked_tries)
    assert (turn * first > 0.0) is same
    assert bench.turns(blocked=True) == math.copysign(45.0, turn)


def test_who_has_changed_sides_may_change_back() -> None:
    bench = Bench()
    assert step_aside(bench, 2) == LEFT
    assert step_aside(bench, 2) == RIGHT
    assert bench.turns(blocked=True) == RIGHT


@pytest.mark.parametrize(("calm", "side"), [(CALM_STEPS - 1, LEFT), (CALM_STEPS, RIGHT)])
def test_it_chooses_its_side_anew_after_a_calm_while(calm: int, side: float) -> None:
    bench = Bench()
    assert step_aside(bench, 2) == LEFT
    assert {bench.turns(blocked=False) for _ in range(calm)} == {0.0}
    assert bench.turns(blocked=True) == side
