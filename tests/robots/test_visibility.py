"""What ``observation.sees`` answers against the visibility region V(R) as shapely builds it: the floor without shadows.

The shadow of a wall, seen from R, is the unbounded region behind it. V(R) is what is left of a large square when all
shadows are taken away, clipped to the radius of sight. No line of sight is asked for in building it.
"""

import math
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from cosim.arrays import Floats
from cosim.geometry.segments import packed_walls, segment_grid
from cosim.randomness import Streams
from cosim.robots.body import BodySettings
from cosim.robots.motion import Fleet
from cosim.robots.senses import Frame, Senses, SenseSettings
from cosim.units import MS

TICK = 100 * MS
FAR_M = 1000.0
EDGE_M = 1e-6
"""How near to its border the region is asked about; shapely's own corners are rounded at 1e-13 of a kilometre."""


def region(here: tuple[float, float], walls: Floats) -> Any:
    """Return V(R) of a robot at *here*, without the limit of its radius."""
    eye = np.array(here)
    floor = shapely.box(*(eye - 30.0), *(eye + 30.0))
    shadows = []
    for wall in walls.reshape(-1, 2, 2):
        ways = wall - eye
        beyond = eye + ways * (FAR_M / np.hypot(*ways.T)[:, None])
        # through the middle as well: the chord between the two far ends of a near wall may pass close to the eye
        middle = ways.mean(axis=0)
        shadows.append(
            shapely.Polygon([wall[0], beyond[0], eye + middle * (FAR_M / np.hypot(*middle)), beyond[1], wall[1]])
        )
    parts = shapely.get_parts(shapely.difference(floor, shapely.union_all(shadows)))
    return next(part for part in parts if part.contains(shapely.Point(here)))


def seen(here: tuple[float, float], walls: Floats, frame: Frame, range_m: float, points: Floats) -> list[bool]:
    """Return what a robot at *here* answers about *points* of the world, which it is asked about in its own frame."""
    body = BodySettings(radius_m=0.2, drive="omni", speed_mps=1.0, acceleration_mps2=100.0)
    grid = segment_grid(walls)
    fleet = Fleet([body], [here], grid, TICK)
    senses = Senses(SenseSettings(), packed_walls(grid), [0.2], [frame], range_m, TICK, Streams(1))
    (observation,) = senses.observe(fleet)
    turned = (points @ [1, 1j] - complex(frame[0], frame[1])) * complex(math.cos(frame[2]), -math.sin(frame[2]))
    return observation.sees([(float(z.real), float(z.imag)) for z in turned])


def asked(rng: np.random.Generator, visible: Any, here: tuple[float, float], range_m: float) -> Floats:
    """Return places anywhere, and places a micrometre to both sides of the region's border and of the radius."""
    anywhere = np.array(here) + rng.uniform(-1.2, 1.2, (120, 2)) * range_m
    angles = rng.uniform(-math.pi, math.pi, 60)
    reach = range_m + np.where(rng.random(60) < 0.5, EDGE_M, -EDGE_M)
    rim = np.array(here) + np.stack((reach * np.cos(angles), reach * np.sin(angles)), axis=1)
    ring = visible.exterior
    along = rng.uniform(0.0, ring.length, 200)
    ends = shapely.get_coordinates(shapely.line_interpolate_point(ring, [along, along + 1e-3])).reshape(2, -1, 2)
    normal = (ends[1] - ends[0])[:, ::-1] * [1, -1]
    sides = ends[0] + normal / np.hypot(*normal.T)[:, None] * EDGE_M * np.where(rng.random(200) < 0.5, 1, -1)[:, None]
    return np.concatenate((anywhere, rim, sides))


def expected(visible: Any, here: tuple[float, float], range_m: float, points: Floats) -> Any:
    return shapely.contains(visible, shapely.points(points)) & (np.hypot(*(points - here).T) <= range_m)


lengths = st.integers(0, 1000).map(lambda n: n / 100)
spots = st.tuples(lengths, lengths)


@pytest.mark.slow
@settings(max_examples=60)
@given(
    st.lists(st.tuples(spots, spots), max_size=12),
    spots,
    st.tuples(st.floats(-20, 20), st.floats(-20, 20), st.floats(-math.pi, math.pi)),
    st.floats(0.5, 12.0),
    st.integers(0, 1000),
)
def test_a_point_is_seen_exactly_if_it_lies_in_the_visibility_region(
    walls: list[tuple[tuple[float, float], tuple[float, float]]],
    here: tuple[float, float],
    frame: Frame,
    range_m: float,
    seed: int,
) -> None:
    rows = np.array(walls, dtype=float).reshape(-1, 4)
    lines = shapely.linestrings(rows.reshape(-1, 2, 2))
    assume(all(line.length > 0.05 and line.distance(shapely.Point(here)) > 0.05 for line in lines))
    # a wall that is seen from its end throws a shadow without a width
    beside = [shapely.LinearRing([here, row[:2], row[2:]]) for row in rows]
    assume(all(shapely.Polygon(ring).area > 1e-3 * math.dist(ring.coords[1], ring.coords[2]) for ring in beside))
    visible = region(here, rows)
    points = asked(np.random.default_rng(seed), visible, here, range_m)
    clear = shapely.distance(visible.boundary, shapely.points(points)) > 0.1 * EDGE_M
    answers, truth = np.array(seen(here, rows, frame, range_m, points)), expected(visible, here, range_m, points)
    wrong = points[clear & (answers != truth)]
    assert len(wrong) == 0, wrong[0]
    assert clear.mean() > 0.8


def test_the_region_of_a_single_wall_is_what_one_draws_by_hand() -> None:
    walls = np.array([[1.0, -1.0, 1.0, 1.0]])
    visible = region((0.0, 0.0), walls)
    places = np.array([(0.9, 0.0), (1.1, 0.0), (5.0, 4.9), (5.0, 5.1), (-3.0, 0.0), (0.0, 6.0), (4.5, 4.0), (4.2, 4.3)])
    for range_m, answers in (
        (6.0, [True, False, False, False, True, True, False, False]),
        (8.0, [True, False, False, True, True, True, False, True]),
    ):
        assert expected(visible, (0.0, 0.0), range_m, places).tolist() == answers
        assert seen((0.0, 0.0), walls, (0.0, 0.0, 0.0), range_m, places) == answers
