"""Starts: those of a scenario are checked, random ones are free, apart and repeatable."""

from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from cosim.errors import UserError
from cosim.geometry.grids import coverage_grid
from cosim.geometry.segments import clearance
from cosim.randomness import Streams
from cosim.robots.body import BodySettings
from cosim.robots.placement import checked_starts, random_starts
from cosim.world.floorplan import FloorplanSettings, load_floorplan

FLOOR = load_floorplan(
    FloorplanSettings(
        map="walls", walls=[(0, 0, 0, 4), (3, 0, 3, 3)], bounds_m=(0, 0, 6, 4), polygons=[[(4, 0), (5, 0), (5, 1)]]
    ),
    Path(),
)
GRID = coverage_grid(FLOOR.bounds_m, 0.4, 0.2, FLOOR.walls_m, FLOOR.forbidden)


def test_starts_that_fit_are_taken_also_in_touch():
    starts = [(0.2, 0.2), (0.6, 0.2), (2.8, 1.0)]
    assert checked_starts(starts, [0.2] * 3, FLOOR).tolist() == [list(start) for start in starts]


@pytest.mark.parametrize(
    ("start", "message"),
    [
        ((7, 1), "team.starts[2]: (7, 1) is outside of the floor, expected 0..6 by 0..4 m"),
        ((4.8, 0.5), "team.starts[2]: (4.8, 0.5) is inside a wall or unknown, expected free floor"),
        ((2.9, 1), "team.starts[2]: (2.9, 1) is inside a wall: it is 0.1 m away, expected at least the radius 0.2 m"),
        ((1.3, 1), "team.starts[2]: (1.3, 1) is 0.3 m from team.starts[0], expected at least 0.4 m: two robots in"),
    ],
)
def test_a_start_that_does_not_fit_is_named(start, message):
    with pytest.raises(UserError) as error:
        checked_starts([(1, 1), (2, 2), start], [0.2] * 3, FLOOR)
    assert message in str(error.value)


def test_random_starts_fit_and_depend_on_the_stream_only():
    radii = [0.2] * 80
    starts = random_starts(GRID, radii, Streams(7)("starts"))
    assert starts.tolist() == random_starts(GRID, radii, Streams(7)("starts")).tolist()
    assert starts.tolist() != random_starts(GRID, radii, Streams(8)("starts")).tolist()
    assert checked_starts([tuple(start) for start in starts.tolist()], radii, FLOOR).shape == (80, 2)
    assert all(GRID.reachable[GRID.cell_at(*start)] for start in starts.tolist())
    assert (clearance(FLOOR.grid, starts, 1.0) >= 0.2 - 1e-9).all()


@pytest.mark.parametrize("seed", range(5))
def test_random_starts_keep_large_bodies_apart(seed):
    radii = np.array([0.2, 0.5, 0.5, 0.5, 0.2])
    starts = random_starts(GRID, radii.tolist(), Streams(seed)("starts"))
    apart = np.hypot(*(starts[:, None] - starts[None]).transpose(2, 0, 1))
    assert (apart + 9 * np.eye(5) >= radii[:, None] + radii[None] - 1e-9).all()


def test_too_many_robots_are_an_error():
    with pytest.raises(UserError, match=r"team\.size: 1000 do not fit on the floor, expected at most"):
        random_starts(GRID, [0.2] * 1000, Streams(1)("starts"))


@pytest.mark.parametrize(
    "key", ["radius_m", "speed_mps", "acceleration_mps2", "turn_radps", "turn_acceleration_radps2"]
)
def test_a_body_has_positive_measures(key):
    with pytest.raises(ValidationError, match="greater than 0"):
        BodySettings(**{key: 0.0})
