"""Starts: robots that do not fit are named."""

from pathlib import Path

import pytest
from pydantic import ValidationError

from cosim.errors import UserError
from cosim.geometry.grids import coverage_grid
from cosim.robots.body import BodySettings
from cosim.robots.placement import checked_starts
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


@pytest.mark.parametrize(
    "key", ["radius_m", "speed_mps", "acceleration_mps2", "turn_radps", "turn_acceleration_radps2"]
)
def test_a_body_has_positive_measures(key):
    with pytest.raises(ValidationError, match="greater than 0"):
        BodySettings(**{key: 0.0})
