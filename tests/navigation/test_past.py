"""Avoid Past against a plain model of it, and its memory: square, moving along, cleared by a new goal."""

import math

import numpy as np
import pytest

from cosim.navigation.past import avoid_past, empty_past


class PlainPast:
    """MissionLab's steps 1 to 4 as they stand in words: counts by cell of the plane, in a dictionary."""

    def __init__(self, side, scale, horizon, mark, ceiling):
        self.side, self.scale, self.horizon, self.mark, self.ceiling = side, scale, horizon, mark, ceiling
        self.counts = {}
        self.low = (-(side // 2), -(side // 2))
        self.scrolled = 0

    def push(self, x, y):
        i, j = math.floor(x * self.scale), math.floor(y * self.scale)
        reach = max(self.horizon, self.mark)
        if any(at - reach < low or at + reach >= low + self.side for at, low in zip((i, j), self.low, strict=True)):
            self.low = (i - self.side // 2, j - self.side // 2)
            self.scrolled += 1
            inside = [range(low, low + self.side) for low in self.low]
            self.counts = {(k, m): n for (k, m), n in self.counts.items() if k in inside[0] and m in inside[1]}
        near = {
            (k - i, m - j): n
            for (k, m), n in self.counts.items()
            if abs(k - i) <= self.horizon and abs(m - j) <= self.horizon
        }
        x_sum = sum(n for (k, _), n in near.items() if k < 0) - sum(n for (k, _), n in near.items() if k > 0)
        y_sum = sum(n for (_, m), n in near.items() if m < 0) - sum(n for (_, m), n in near.items() if m > 0)
        for k in range(i - self.mark, i + self.mark + 1):
            for m in range(j - self.mark, j + self.mark + 1):
                self.counts[k, m] = self.counts.get((k, m), 0) + 1
        magnitude = min(sum(near.values()) / (40 * self.horizon**2), self.ceiling)
        length = math.hypot(x_sum, y_sum)
        return (magnitude * x_sum / length, magnitude * y_sum / length) if length else (0.0, 0.0)


@pytest.mark.parametrize(
    ("side", "horizon", "mark"), [(41, 3, 2), (24, 2, 4), (15, 7, 0)], ids=["near", "mark beyond horizon", "tight"]
)
def test_every_push_of_a_random_walk_equals_the_plain_model(side, horizon, mark):
    draw = np.random.default_rng(side)
    past, plain = empty_past(side, 5.0, horizon, mark, 0.5, 1.0), PlainPast(side, 5.0, horizon, mark, 0.5)
    places = np.cumsum(draw.normal(0.0, 0.4, (250, 2)), axis=0)
    pushes = []
    for x, y in places.tolist():
        pushes.append(avoid_past(*past, x, y))
        assert pushes[-1] == pytest.approx(plain.push(x, y), abs=1e-12)
    lengths = np.hypot(*np.array(pushes).T)
    assert plain.scrolled >= 3, "the map has moved along"
    assert (lengths > 0).sum() > 50
    assert lengths.max() <= 0.5 + 1e-12


def past_of(*places, visits=1, ceiling=100.0, gain=1.0):
    past = empty_past(60, 10.0, 5, 3, ceiling, gain)
    for _ in range(visits):
        for x, y in places:
            avoid_past(*past, x, y)
    return past


@pytest.mark.parametrize("angle", np.linspace(0.1, 2 * np.pi, 9).tolist())
def test_a_robot_is_pushed_to_the_side_where_it_has_been_less_often(angle):
    been = (0.25 * math.cos(angle), 0.25 * math.sin(angle))
    x, y = avoid_past(*past_of(been), 0.0, 0.0)
    assert x * been[0] + y * been[1] < -0.8 * math.hypot(x, y) * math.hypot(*been)


def test_the_push_grows_with_the_visits_up_to_its_ceiling():
    # 7 x 7 marked cells, all in the window of horizon 5: 49 visits of 40 * 25 a time
    been = (0.25, 0.05)
    assert math.hypot(*avoid_past(*past_of(been, visits=3), 0.05, 0.05)) == pytest.approx(3 * 49 / 1000)
    assert math.hypot(*avoid_past(*past_of(been, visits=30), 0.05, 0.05)) == pytest.approx(30 * 49 / 1000)
    assert math.hypot(*avoid_past(*past_of(been, visits=30, ceiling=0.7), 0.05, 0.05)) == pytest.approx(0.7)


def test_its_gain_weighs_the_push_after_its_ceiling():
    been = (0.25, 0.05)
    assert math.hypot(*avoid_past(*past_of(been, visits=3, gain=2.0), 0.05, 0.05)) == pytest.approx(2 * 3 * 49 / 1000)
    held = past_of(been, visits=30, ceiling=0.7, gain=3.0)
    assert math.hypot(*avoid_past(*held, 0.05, 0.05)) == pytest.approx(2.1)


def test_new_ground_does_not_push_and_neither_does_a_place_alone():
    past = past_of()
    assert avoid_past(*past, 0.05, 0.05) == (0.0, 0.0)
    assert avoid_past(*past, 0.05, 0.05) == (0.0, 0.0), "its own marks lie around it alike"


def test_what_lies_beyond_the_horizon_does_not_push():
    assert avoid_past(*past_of((0.05, 0.05)), 0.95, 0.05) == (0.0, 0.0)  # 9 cells: marks reach 3 of them, the horizon 5
    assert avoid_past(*past_of((0.05, 0.05)), 0.85, 0.05)[0] > 0.0  # 8 cells


def test_the_map_moves_along_and_forgets_what_falls_off():
    past = past_of((0.0, 0.0), visits=5)
    for step in range(80):
        avoid_past(*past, 0.1 * step, 0.0)
    for step in range(10):
        avoid_past(*past, 8.0, 0.1 * step)
    assert past.visits.sum() < 95 * 49
    corner = past.corner.tolist()
    assert corner[0] <= 80 - 8 < 80 + 8 < corner[0] + 60
    fresh, there = past_of(), (0.31, 0.2)
    avoid_past(*past, 0.2, 0.2)  # back at once: nothing of the map is left
    avoid_past(*fresh, 0.2, 0.2)
    assert avoid_past(*past, *there) == avoid_past(*fresh, *there) != (0.0, 0.0)


@pytest.mark.parametrize("shift", [(0, 0), (3, -7), (-1000, 412)])
def test_pushes_do_not_depend_on_where_the_frame_begins(shift):
    # cell middles, so that rounding moves nobody into the next cell
    cells = np.cumsum(np.random.default_rng(4).integers(-1, 2, (200, 2)), axis=0)
    here, there = empty_past(100, 10.0, 5, 3, 2.0, 1.0), empty_past(100, 10.0, 5, 3, 2.0, 1.0)
    avoid_past(*there, 0.1 * shift[0] + 0.05, 0.1 * shift[1] + 0.05)
    avoid_past(*here, 0.05, 0.05)
    for x, y in ((cells + 0.5) / 10).tolist():
        assert avoid_past(*there, x + shift[0] / 10, y + shift[1] / 10) == avoid_past(*here, x, y)


def test_cells_are_as_wide_left_of_the_origin_as_right_of_it():
    past = past_of((-0.05, -0.05))
    assert past.visits[30 - 4 : 30 + 3, 30 - 4 : 30 + 3].all()
    assert past.visits.sum() == 49


@pytest.mark.parametrize("place", [(math.nan, 0.0), (0.0, math.nan), (math.inf, 0.0), (0.0, -math.inf), (0.0, 1e300)])
def test_a_place_that_is_nowhere_is_not_counted(place):
    past = past_of((0.5, -0.3))
    before = past.visits.copy()
    assert avoid_past(*past, *place) == (0.0, 0.0)
    assert (past.visits == before).all()


def test_a_map_must_hold_its_horizon_and_its_marks():
    avoid_past(*empty_past(11, 10.0, 5, 5, 1.0, 1.0), 0.0, 0.0)
    for horizon, mark in ((5, 1), (1, 5)):
        with pytest.raises(ValueError, match="10 cells is too small"):
            empty_past(10, 10.0, horizon, mark, 1.0, 1.0)
