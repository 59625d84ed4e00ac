"""How much robots of an exploration see of each other, by true poses: beside what ``exploration_teams`` measures.

A look a second, until 95 % of what can be seen has been. Robots see each other in line of sight past the walls and
within a range, the same for all arms; bodies hide no one. A robot stands if it has hardly moved since the last look.
"""

import math
from collections.abc import Mapping
from itertools import permutations
from pathlib import Path
from typing import Any, Final

import numpy as np
from pydantic import Field

from cosim.arrays import Floats
from cosim.experiment import experiment_function
from cosim.geometry.segments import SegmentGrid, sees
from cosim.scenario import Scenario
from cosim.settings import Metres, Settings
from cosim.simulation import simulate
from cosim.trace import POSES, Trace
from cosim.trace import Field as Column
from cosim.units import S, from_seconds
from cosim.world.floorplan import load_floorplan
from experiments.exploration.exploring import ENDED, ended
from protocols.exploration.spec import METRICS

STANDS_M: Final = 0.02
"""Movement in a second below which a robot counts as standing, m."""
_OWN: Final = (
    Column("in_sight", "float", "1", "share of the robots' time in which one sees another"),
    Column("beacon_in_sight", "float", "1", "share of the time of robots that move in which one sees one that stands"),
    Column("standing", "float", "1", "share of the robots' time in which one stands"),
    Column("nearest_m", "float", "m", "distance to the nearest robot, on the mean"),
)
COLUMNS: Final = (
    *(Column(metric.name, "float", metric.unit, metric.meaning) for metric in METRICS),
    *ENDED,
    *_OWN,
)


class Parameters(Settings):
    """An exploration, and how far robots see each other."""

    scenario: Scenario = Field(description="the run")
    sight_m: Metres = Field(default=5.0, gt=0, description="m, farther robots do not count as seen")


@experiment_function
def measure(parameters: Mapping[str, Any], seed: int) -> dict[str, float]:
    """Make the run and return ``COLUMNS``. Raise UserError for a run that cannot be set up."""
    given = Parameters.model_validate(parameters)
    scenario = given.scenario.placed(Path(__file__).parent)
    outcome = simulate(scenario, seed, (POSES,))
    found = {metric.name: outcome.metrics[metric.name] for metric in METRICS}
    found |= ended(outcome.metrics, scenario.duration_s)
    walls = load_floorplan(scenario.floorplan, scenario.folder).grid
    return found | shares(places(outcome.trace, found["until_95_s"]), walls, given.sight_m)


def places(trace: Trace, until_s: float) -> Floats:
    """Return where the robots are once a second until then, shape (seconds, robots, 2), metres."""
    poses = trace.columns(POSES.name)
    times, robots = np.array(poses["time_ns"]), np.array(poses["source"])
    chosen = (times % S == 0) & (times <= from_seconds(until_s))
    at = np.stack([np.array(poses["x_m"])[chosen], np.array(poses["y_m"])[chosen]], axis=1)
    ticks, rows = np.unique(times[chosen], return_inverse=True)
    found = np.full((len(ticks), int(robots.max(initial=-1)) + 1, 2), np.nan)
    found[rows, robots[chosen]] = at
    return found


def shares(places_m: Floats, walls: SegmentGrid, sight_m: float) -> dict[str, float]:
    """Return the columns of ``_OWN`` from *places_m*, shape (seconds, robots, 2); NaN for one robot alone."""
    seconds, robots = places_m.shape[:2]
    if robots < 2 or seconds < 2:
        return {column.name: math.nan for column in _OWN}
    stands = np.hypot(*np.moveaxis(np.diff(places_m, axis=0), -1, 0)) < STANDS_M
    now = places_m[1:]
    seen, beacon = np.zeros(stands.shape, np.bool_), np.zeros(stands.shape, np.bool_)
    nearest = np.full(stands.shape, np.inf)
    for one, other in permutations(range(robots), 2):
        away = np.hypot(*(now[:, one] - now[:, other]).T)
        sight = (away <= sight_m) & sees(walls, now[:, one], now[:, other])
        seen[:, one] |= sight
        beacon[:, one] |= sight & stands[:, other]
        nearest[:, one] = np.minimum(nearest[:, one], away)
    moving = ~stands
    return {
        "in_sight": float(seen.mean()),
        "beacon_in_sight": float(beacon[moving].mean()) if moving.any() else math.nan,
        "standing": float(stands.mean()),
        "nearest_m": float(nearest.mean()),
    }
