"""An exploration of paper 001, and what its trace shows beside its metrics.

An exploration that does not come to 95 % counts with the longest run: a lower bound of what it would have taken.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from pydantic import Field

from cosim.arrays import Floats
from cosim.experiment import experiment_function
from cosim.scenario import Scenario
from cosim.settings import Metres, Seconds, Settings
from cosim.simulation import METRICS as EVERY_RUN
from cosim.simulation import Simulation
from cosim.trace import POSES, Trace
from cosim.trace import Field as Column
from cosim.units import from_seconds
from protocols.exploration.spec import METRICS

TENTHS: Final = tuple(tenth / 10 for tenth in range(1, 10))
"""Shares of what can be seen whose times give the curve of coverage over time."""
_SEEN: Final = {f"seen_{round(100 * share)}_s": share for share in TENTHS}
COVERAGE: Final = (
    "share of what can be seen",
    _SEEN | {"time_95_s": 0.95, "time_99_s": 0.99},
    ("simulated_s", "coverage"),
)
"""Coverage over time, as :func:`cosim.report.drawing.draw_shares` wants it."""
ENDED: Final = (
    Column("until_95_s", "float", "s", "until 95 % had been seen; the longest run if it never was"),
    Column("reached", "float", "1", "1 if it was, else 0"),
    Column("completed", "float", "1", "1 if 99 % had been seen in time, else 0"),
)
"""Columns that tell how far a run came."""
_OWN: Final = (
    *ENDED,
    Column("stalls_no_force", "float", "1", "stalls for want of any force"),
    Column("paths", "float", "1", "paths laid out of local minima"),
    Column("paths_led_on", "float", "1", "share of them that were left since a frontier was in sight, or walked"),
    Column(
        "parted_by_escape_m", "float", "m", "growth of the distance to the nearest robot in later_s from a path laid"
    ),
    Column("parted_else_m", "float", "m", "the same from times when the robot was on no path"),
    Column("bound_s", "float", "s", "before which no team of that size can see 95 %, even if it knew the floor"),
    *(
        Column(name, "float", "s", f"until {100 * share:.0f} % of what can be seen had been; NaN if it never was")
        for name, share in _SEEN.items()
    ),
)
COLUMNS: Final = (
    *(
        Column(metric.name, "float", metric.unit, metric.meaning)
        for metric in (*METRICS, *(metric for metric in EVERY_RUN if metric.name in ("distance_m", "simulated_s")))
    ),
    *_OWN,
)


class Partings(Settings):
    """When robots are compared to see whether they part, and which ones."""

    later_s: Seconds = Field(default=30.0, gt=0, description="s from a path laid, after which distances are compared")
    near_m: Metres | None = Field(
        default=None, gt=0, description="m, only robots are asked of that had another as near as this; null: all"
    )


class Parameters(Settings):
    """An exploration, and what is asked about it."""

    scenario: Scenario = Field(description="the run")
    partings: Partings = Partings()


@experiment_function
def measure(parameters: Mapping[str, Any], seed: int) -> dict[str, float]:
    """Make the run and return ``COLUMNS``. Raise UserError for a run that cannot be set up."""
    own = Parameters.model_validate(parameters)
    scenario = own.scenario.placed(Path(__file__).parent)
    simulation = Simulation(scenario, seed, (POSES,))
    outcome = simulation.run()
    found = {column.name: outcome.metrics[column.name] for column in COLUMNS if column not in _OWN}
    referee: Any = simulation.referee
    return (
        found
        | ended(outcome.metrics, scenario.duration_s)
        | told(outcome.trace, own.partings)
        | {"bound_s": _bound_s(simulation)}
        | dict(zip(_SEEN, referee.times_s(tuple(_SEEN.values())), strict=True))
    )


def _bound_s(simulation: Simulation) -> float:
    """Return before when no team that drives as fast as this one's schemas may can have seen 95 %."""
    explorers: list[Any] = simulation.machines
    referee: Any = simulation.referee
    parameters: Any = simulation.scenario.protocol.parameters
    setup, steering = explorers[0].setup, parameters.steering
    speed_mps = min(max(setup.speeds_mps), max(steering.speed_mps, steering.fast_mps or 0.0))
    cell_m = setup.frame.cell_m
    wanted_m2 = 0.95 * referee.coverable * cell_m * cell_m
    return swept_s(wanted_m2, setup.size, setup.range_m + math.sqrt(2.0) * cell_m, speed_mps)


def swept_s(area_m2: float, robots: int, reach_m: float, speed_mps: float) -> float:
    """Return the least time in which robots can sweep an area: discs that drive straight on, and nothing seen twice.

    A disc of the radius r that drives for a time t sees at most pi r^2 + 2 r speed t, whatever way it takes. *reach_m*
    is the scanner's range and a cell's diagonal: a beam counts a cell whose corner it meets.
    """
    return max(0.0, (area_m2 / robots - math.pi * reach_m * reach_m) / (2.0 * reach_m * speed_mps))


def ended(metrics: Mapping[str, float], duration_s: float) -> dict[str, float]:
    """Return ``ENDED`` of a run that may last so long."""
    never = math.isnan(metrics["time_95_s"])
    return {
        "until_95_s": duration_s if never else metrics["time_95_s"],
        "reached": float(not never),
        "completed": float(not math.isnan(metrics["time_99_s"])),
    }


def told(trace: Trace, asked: Partings) -> dict[str, float]:
    """Return what the events and poses of a run show of its escapes."""
    events = trace.columns("events")
    rows = list(zip(events["event"], events["time_ns"], events["source"], events.get("why", ()), strict=True))
    laid = [(time, robot) for event, time, robot, _ in rows if event == "PathLaid"]
    led_on = sum(event == "PathLeft" and why != "stalled" for event, _, _, why in rows)
    escaped, elsewhere = _partings(trace, rows, asked)
    return {
        "stalls_no_force": float(sum(event == "Stalled" and why == "no force" for event, _, _, why in rows)),
        "paths": float(len(laid)),
        "paths_led_on": led_on / len(laid) if laid else math.nan,
        "parted_by_escape_m": float(np.mean(escaped)) if escaped else math.nan,
        "parted_else_m": float(np.mean(elsewhere)) if elsewhere else math.nan,
    }


def _partings(trace: Trace, rows: list[tuple[str, int, int, Any]], asked: Partings) -> tuple[list[float], list[float]]:
    """Return by how much a robot's distance to the nearest one grows in ``later_s``: from a path laid, and else.

    Else: from every full such time at which a robot is on no path, and lays none until that time is over.
    """
    times, nearest = _nearest(trace)
    if not len(times) or nearest.shape[1] < 2:
        return [], []
    later, most = from_seconds(asked.later_s), math.inf if asked.near_m is None else asked.near_m

    def growth(time: int, robot: int) -> float | None:
        if time + later > times[-1]:
            return None
        now, then = np.searchsorted(times, (time, time + later))
        return None if nearest[now, robot] > most else float(nearest[then, robot] - nearest[now, robot])

    spans: dict[int, list[list[int]]] = {robot: [] for robot in range(nearest.shape[1])}
    for event, time, robot, _ in rows:
        if event == "PathLaid":
            spans[robot].append([time, int(times[-1])])
        elif event == "PathLeft" and spans[robot]:
            spans[robot][-1][1] = time
    escaped = [growth(span[0], robot) for robot, own in spans.items() for span in own]
    elsewhere = [
        growth(time, robot)
        for robot, own in spans.items()
        for time in range(int(times[0]), int(times[-1]), later)
        if not any(begin < time + later and time < end for begin, end in own)
    ]
    return [each for each in escaped if each is not None], [each for each in elsewhere if each is not None]


def _nearest(trace: Trace) -> tuple[Floats, Floats]:
    """Return the world's ticks (t,), ns, and how far each robot's nearest team-mate is at each, shape (t, robots)."""
    poses = trace.columns(POSES.name)
    times, robots = np.array(poses["time_ns"]), np.array(poses["source"])
    ticks, rows = np.unique(times, return_inverse=True)
    places = np.full((len(ticks), int(robots.max(initial=-1)) + 1, 2), np.nan)
    places[rows, robots] = np.column_stack([poses["x_m"], poses["y_m"]])
    away = np.full(places.shape[:2], np.inf)
    for robot in range(places.shape[1]):
        apart = np.hypot(*np.moveaxis(places - places[:, robot, None], -1, 0))
        apart[:, robot] = np.inf
        away[:, robot] = apart.min(axis=1)
    return ticks, away
