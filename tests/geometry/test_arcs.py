"""The way along an arc: nothing is touched before its end, and something is at it, as small steps see it."""

import math

import numpy as np
import pytest

from cosim.geometry.arcs import way_to_contact

NO_WALLS, NO_DISCS = np.empty((0, 4)), np.empty((0, 3))
MOST = 2.5


def along(x, y, heading, curvature, ways):
    """Return the places of a disc after *ways* on an arc; about its centre, not from chords as the kernel has it."""
    if abs(curvature) < 1e-9:
        return np.stack((x + ways * math.cos(heading), y + ways * math.sin(heading)), axis=1)
    turned = heading + curvature * ways
    return np.stack(
        (
            x + (np.sin(turned) - math.sin(heading)) / curvature,
            y - (np.cos(turned) - math.cos(heading)) / curvature,
        ),
        axis=1,
    )


def room(places, walls, discs, radius):
    """Return how far the disc is from contact at each of the *places*."""
    least = np.full(len(places), math.inf)
    for x1, y1, x2, y2 in walls:
        start, way = np.array((x1, y1)), np.array((x2 - x1, y2 - y1))
        u = np.clip((places - start) @ way / max(way @ way, 1e-300), 0.0, 1.0)
        least = np.minimum(least, np.linalg.norm(places - start - u[:, None] * way, axis=1) - radius)
    for x, y, apart in discs:
        least = np.minimum(least, np.linalg.norm(places - (x, y), axis=1) - apart)
    return least


def scene(rng):
    """Return a disc that touches nothing, its arc, walls and discs; curvatures of all orders, and none."""
    curvature = float(
        rng.choice((0.0, 1e-12, 1e-7, 1e-3, 0.3, 3.0, 40.0)) * rng.choice((-1.0, 1.0)) * rng.uniform(1, 3)
    )
    while True:
        x, y = rng.uniform(-1, 1, 2).tolist()
        radius, heading = float(rng.uniform(0.05, 0.4)), float(rng.uniform(-4, 4))
        walls, places = rng.uniform(-3, 3, (int(rng.integers(8)), 4)), rng.uniform(-3, 3, (int(rng.integers(6)), 2))
        discs = np.column_stack((places, rng.uniform(0.1, 0.8, len(places))))
        if room(np.array([(x, y)]), walls, discs, radius)[0] > 0.0:
            return x, y, heading, curvature, radius, walls, discs


@pytest.mark.parametrize("part", range(4))
def test_nothing_is_touched_before_the_end_and_something_is_at_it(part):
    met = 0
    for number in range(100):
        x, y, heading, curvature, radius, walls, discs = scene(np.random.default_rng((71, part, number)))
        way = way_to_contact(x, y, heading, curvature, radius, walls, discs, MOST)
        before = along(x, y, heading, curvature, np.linspace(0.0, way, 600))
        assert room(before, walls, discs, radius).min() > -1e-7
        if way < MOST:
            met += 1
            assert room(before[-1:], walls, discs, radius)[0] == pytest.approx(0.0, abs=1e-7)
    assert 20 < met < 90


@pytest.mark.parametrize(
    ("walls", "discs", "curvature", "expected"),
    [
        ([(2.0, -1.0, 2.0, 1.0)], [], 0.0, 1.8),  # a side
        ([(2.0, 0.0, 4.0, 0.0)], [], 0.0, 1.8),  # an end
        ([(2.0, 0.0, 2.0, 0.0)], [], 0.0, 1.8),  # a wall without a length
        ([(-2.0, -1.0, -2.0, 1.0)], [], 0.0, MOST),  # behind it
        ([(0.0, 0.2, 5.0, 0.2)], [], 0.0, MOST),  # along a wall that it all but touches
        ([], [(2.0, 0.0, 0.5)], 0.0, 1.5),
        ([], [(0.0, 1.0, 0.5)], 1.0, MOST),  # round it
        ([(0.0, 2.2, 5.0, 2.2)], [], 1.0, MOST),  # past it
        ([(-5.0, 1.2, 0.0, 1.2)], [], 0.5, math.pi),  # up to it: a quarter of a circle of 2 m ...
    ],
)
def test_ways_that_are_known(walls, discs, curvature, expected):
    radius = 0.2 - 1e-9
    walls, discs = np.array(walls).reshape(-1, 4), np.array(discs).reshape(-1, 3)
    if expected == math.pi:  # ... of which it sees the wall's far end 1 m to its left
        expected = 2.0 * math.acos(0.5)
        walls = np.array([(1.0, 1.2, 2.0, 1.2)])
    assert way_to_contact(0.0, 0.0, 0.0, curvature, radius, walls, discs, MOST) == pytest.approx(expected, abs=1e-6)
