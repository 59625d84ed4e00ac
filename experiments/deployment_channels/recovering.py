"""What a deployment costs over a channel, and what becomes of it when a robot, or the host, is killed in mid-play.

The starts are drawn as in :mod:`experiments.deployment.deploying`, whose settings these are; all arms of a
replicate have the same ones. What is counted beside its columns is how long the team takes to notice and to act.
"""

import math
import re
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final

from cosim.experiment import experiment_function
from cosim.simulation import METRICS as EVERY_RUN
from cosim.simulation import Simulation
from cosim.trace import Field as Column
from cosim.units import S, to_seconds
from experiments.deployment.deploying import Parameters
from protocols.deployment.spec import METRICS

__all__ = ["COLUMNS", "Parameters", "measure"]

Row = dict[str, Any]

_KEPT: Final = (
    *("deployed", "places_held", "way_m", "plans_done", "orders", "orders_failed", "breaches", "robots_lost"),
    *("successions", "letters", "letter_bytes", "letters_returned", "frames", "frame_bytes", "collisions"),
    *("wall_contacts", "nearest_m", "robots_killed"),
)
_RENEWED: Final = re.compile(r".*(~\d+(?=/stage-\d+/)|/reunited(?=/))")
"""Beginning of the names of drives whose stages were planned again: for the robots left, or a reunited team."""
_OWN: Final = (
    Column("until_deployed_s", "float", "s", "deployment_s; the longest run if they never were held"),
    Column("noticed_s", "float", "s", "from the death until a host took the robot for lost; NaN if none ever did"),
    Column("succeeded_s", "float", "s", "from the host's death until another led; NaN if none ever did"),
    Column(
        "recovery_s",
        "float",
        "s",
        "from the death until, once it was noticed, a robot set off by stages made anew without it; NaN: none did",
    ),
)
COLUMNS: Final = (
    *(
        Column(metric.name, "float", metric.unit, metric.meaning)
        for metric in (*METRICS, *EVERY_RUN)
        if metric.name in _KEPT
    ),
    *_OWN,
)


@experiment_function
def measure(parameters: Mapping[str, Any], seed: int) -> dict[str, float]:
    """Make the run and return ``COLUMNS``. Raise UserError for a run that cannot be set up."""
    scenario = Parameters.model_validate(parameters).placed(seed)
    outcome = Simulation(scenario, seed).run()
    events = outcome.trace.columns("events")
    rows = [dict(zip(events, values, strict=True)) for values in zip(*events.values(), strict=True)]
    found = {name: outcome.metrics[name] for name in _KEPT}
    time_s = outcome.metrics["deployment_s"]
    found["until_deployed_s"] = scenario.duration_s if math.isnan(time_s) else time_s
    killed = [(fault.robot, round(fault.at_s * S)) for fault in scenario.faults if fault.kind == "kill"]
    return found | recovery(rows, killed, scenario.protocol.parameters.host)  # type: ignore[attr-defined]


def recovery(rows: Iterable[Row], killed: Iterable[tuple[int, int]], host: int) -> dict[str, float]:
    """Return how long after the first of the *killed*, each with the time in ns, what has happened, by *rows*."""
    dead, at = next(iter(killed), (-1, 0))
    if dead < 0:
        return {"noticed_s": math.nan, "succeeded_s": math.nan, "recovery_s": math.nan}
    living = [row for row in rows if row["source"] != dead]
    later = [row for row in living if row["time_ns"] >= at]
    lost = _first(later, at, lambda row: row["event"] == "RobotLost" and row["robot"] == dead)
    led = _first(later, at, lambda row: row["event"] == "HostChanged" and row["host"] == row["source"])
    return {
        "noticed_s": lost,
        "succeeded_s": led if dead == host else math.nan,
        "recovery_s": math.nan if math.isnan(lost) else _recovered(living, at, at + round(lost * S)),
    }


def _recovered(rows: Iterable[Row], at: int, noticed: int) -> float:
    """Return how long after *at* a robot set off by stages that no robot had been at before the loss was *noticed*.

    Whoever orders: the host, or each robot itself.
    """
    drives = [
        (row, found[0]) for row in rows if row["event"] == "TaskStarted" and (found := _RENEWED.match(row["task"]))
    ]
    former = {(row["plan"], name) for row, name in drives if row["time_ns"] < noticed}
    return _first((row for row, name in drives if (row["plan"], name) not in former), at)


def _first(rows: Iterable[Row], at: int, wanted: Callable[[Row], bool] = lambda row: True) -> float:
    """Return how many seconds after *at* the first of the wanted rows is; NaN if there is none."""
    return next((to_seconds(row["time_ns"] - at) for row in rows if wanted(row)), math.nan)
