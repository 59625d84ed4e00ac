"""Making way, by geometry alone."""

import math

import numpy as np
import pytest

from protocols.reflection.yielding import distance_to_segment, free_way, in_the_way, step_aside, worth

OPEN = np.full(32, math.inf)
RADIUS_M, ROOM_M = 0.2, 0.5


def corridor(half_width_m: float, beams: int = 64) -> np.ndarray:
    """A scan between two long walls along x."""
    angles = [2.0 * math.pi * k / beams for k in range(beams)]
    return np.array([half_width_m / abs(math.sin(a)) if abs(math.sin(a)) > 1e-9 else math.inf for a in angles])


def test_distance_to_a_segment() -> None:
    assert distance_to_segment((0.0, 3.0), (-1.0, 0.0), (1.0, 0.0)) == 3.0
    assert distance_to_segment((4.0, 4.0), (-1.0, 0.0), (1.0, 0.0)) == 5.0
    assert distance_to_segment((3.0, 4.0), (0.0, 0.0), (0.0, 0.0)) == 5.0


@pytest.mark.parametrize(
    ("me", "answer"),
    [((0.8, 0.1), True), ((0.8, 0.6), False), ((-0.3, 0.0), False), ((3.0, 0.0), False), ((0.1, 0.4), True)],
)
def test_in_the_way_is_who_is_near_and_near_the_line(me: tuple[float, float], answer: bool) -> None:
    assert in_the_way(me, (0.0, 0.0), (5.0, 0.0), 0.5) is answer


def test_a_disc_between_walls_has_room_along_them() -> None:
    scan = corridor(0.5)
    assert free_way(scan, 0.0, RADIUS_M, 3.0) == 3.0
    assert free_way(scan, math.pi / 2.0, RADIUS_M, 3.0) == pytest.approx(0.3, abs=0.01)
    assert free_way(scan, 0.0, 0.6, 3.0) == 0.0
    assert free_way(OPEN, 1.0, RADIUS_M, 3.0) == 3.0


@pytest.mark.parametrize("seeker", [(-1.0, 0.0), (0.0, -1.0), (0.7, 0.7)])
def test_in_the_open_it_leaves_the_line(seeker: tuple[float, float]) -> None:
    place = (-3.0 * seeker[0], -3.0 * seeker[1])
    there = step_aside((0.0, 0.0), seeker, place, OPEN, RADIUS_M, ROOM_M)
    assert distance_to_segment(there, seeker, place) >= ROOM_M - 1e-9
    assert distance_to_segment(seeker, (0.0, 0.0), there) >= ROOM_M - 1e-9


def test_where_nothing_leads_off_the_line_it_goes_on_along_it() -> None:
    x, y = step_aside((0.0, 0.0), (-1.0, 0.0), (5.0, 0.0), corridor(0.22), RADIUS_M, ROOM_M)
    assert x > 0.3
    assert abs(y) < 0.03


def test_no_way_leads_through_the_seeker_or_nearer_to_it() -> None:
    me, seeker, goal = (0.0, 0.0), (-0.6, 0.0), (5.0, 0.0)
    assert worth((-3.0, 0.1), me, seeker, goal, ROOM_M) < worth(me, me, seeker, goal, ROOM_M)
    assert worth((-0.3, 0.3), me, seeker, goal, ROOM_M) < worth(me, me, seeker, goal, ROOM_M)
    assert worth((0.3, 0.5), me, seeker, goal, ROOM_M) > worth(me, me, seeker, goal, ROOM_M)


def test_in_a_dead_end_it_stays() -> None:
    """Walls all around but where the seeker comes from."""
    scan = np.array([0.21 if math.cos(2.0 * math.pi * k / 32) > -0.9 else math.inf for k in range(32)])
    assert step_aside((0.0, 0.0), (-0.45, 0.0), (5.0, 0.0), scan, RADIUS_M, ROOM_M) == pytest.approx((0, 0), abs=0.03)
