"""An exploration whose speed a filter sets, by thresholds in multiples of that filter's own median spread.

The median is that of a pilot: the same robot on the same floor with the same filter, at a constant speed, with another
seed. Who sets a threshold in metres for two filters sets two different ones.

Pose errors are told apart: while the robot drives, when it begins to wait, and when a wait is over. Only the last two
say whether waiting helps; a spread that falls says what the filter believes of itself.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from pydantic import Field

from cosim.experiment import experiment_function
from cosim.scenario import Scenario, changed
from cosim.settings import Gain, Seconds, Settings
from cosim.trace import Field as Column
from cosim.trace import Trace
from cosim.units import to_seconds
from experiments.exploration_localization import mapping

PILOT: Final = 1_000_000
"""What a pilot's seed is more than that of its run."""
_SLOW: Final = 0.5
_RESUME: Final = 0.75
"""Shares of the threshold at which a robot becomes slower, and goes on again, as in exploration_localization."""
_OWN: Final = (
    Column("median_m", "float", "m", "median spread of the pilot, which the thresholds are multiples of"),
    Column("spread_m", "float", "m", "median spread of the run"),
    Column("pose_error_driving_m", "float", "m", "mean pose error of the seconds in which the robot does not wait"),
    Column("pose_error_before_m", "float", "m", "mean pose error when waits begin; NaN without any that is over"),
    Column("pose_error_after_m", "float", "m", "mean pose error when these waits are over"),
)
COLUMNS: Final = (*mapping.COLUMNS, *_OWN)


class Parameters(Settings):
    """An exploration by one robot with a filter, and the threshold of its spread."""

    scenario: Scenario = Field(description="the run; thresholds of the speed control are set")
    stop_medians: Gain | None = Field(
        default=None, gt=0, description="median spreads from which on the robot waits; null: a constant speed"
    )
    pilot_s: Seconds = Field(default=600.0, gt=0, description="s, the longest pilot")


@experiment_function
def measure(parameters: Mapping[str, Any], seed: int) -> dict[str, float]:
    """Make a pilot and the run; return ``COLUMNS``. Raise UserError for a run that cannot be set up."""
    given = Parameters.model_validate(parameters)
    steady = _with(given.scenario, {"enabled": False})
    pilot = changed(steady, {"duration_s": min(given.pilot_s, steady.duration_s)}, "pilot_s", mapping.FOLDER)
    median_m = spread_m(mapping.made(pilot, seed + PILOT)[2])
    run = steady if given.stop_medians is None else _with(given.scenario, thresholds(given.stop_medians * median_m))
    found, watch, trace = mapping.made(run, seed)
    told = errors_by_state(watch.times_s, watch.pose_errors_m, spans(trace))
    return found | {"median_m": median_m, "spread_m": spread_m(trace)} | told


def _with(scenario: Scenario, control: Mapping[str, Any]) -> Scenario:
    changes = {f"protocol.parameters.positioning.control.{name}": value for name, value in control.items()}
    return changed(scenario, changes, "stop_medians", mapping.FOLDER)


def thresholds(stop_m: float) -> dict[str, float]:
    """Return the settings of the speed control with a threshold."""
    return {"slow_m": _SLOW * stop_m, "stop_m": stop_m, "resume_m": _RESUME * stop_m}


def spread_m(trace: Trace) -> float:
    """Return the median of the spreads that the robot reports, once a second."""
    events = trace.columns("events")
    rows = zip(events["event"], events["spread_m"], strict=True)
    return float(np.median([spread for event, spread in rows if event == "Localised"]))


def spans(trace: Trace) -> list[tuple[float, float]]:
    """Return from when to when the robot waited, s; a wait that is not over is left out."""
    events = trace.columns("events")
    found: list[tuple[float, float]] = []
    begun = 0.0
    for event, time in zip(events["event"], events["time_ns"], strict=True):
        if event == "Waiting":
            begun = to_seconds(time)
        elif event == "Resumed":
            found.append((begun, to_seconds(time)))
    return found


def errors_by_state(
    times_s: Sequence[float], errors_m: Sequence[float], waits: Sequence[tuple[float, float]]
) -> dict[str, float]:
    """Return the mean of *errors_m*, noted at *times_s*, while the robot drives, before and after it waits.

    A wait's error before is the first that is noted from its begin on, and that after the last up to its end: the robot
    stands at both. A wait in which none was noted counts for nothing; NaN for what there is none of.
    """
    times, errors = np.asarray(times_s), np.asarray(errors_m)
    driving = np.ones(len(times), np.bool_)
    before, after = [], []
    for begun, ended in waits:
        within = (times >= begun) & (times <= ended)
        driving &= ~within
        if within.any():
            before.append(errors[within][0])
            after.append(errors[within][-1])
    means = [float(np.mean(part)) if len(part) else float("nan") for part in (errors[driving], before, after)]
    return dict(zip(("pose_error_driving_m", "pose_error_before_m", "pose_error_after_m"), means, strict=True))
