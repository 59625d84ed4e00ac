"""Some robots explore a floor, return to base, and then a team is deployed by the map just made (paper 004, section 2).

The starts are drawn as in :mod:`experiments.deployment.deploying`, whose settings these are. The scenario
calls three plays, each when the one before has ended: to explore, to return, to deploy.
"""

import math
from collections.abc import Mapping
from typing import Any, Final

from cosim.experiment import experiment_function
from cosim.simulation import METRICS as EVERY_RUN
from cosim.simulation import Simulation
from cosim.trace import Field as Column
from cosim.units import to_seconds
from experiments.deployment.deploying import Parameters
from protocols.deployment.spec import METRICS

__all__ = ["COLUMNS", "Parameters", "measure"]

Row = dict[str, Any]

_KEPT: Final = (
    *("deployed", "places_held", "way_m", "plans_done", "refused", "robots_lost", "orders_failed", "letters"),
    *("frames", "frame_bytes", "collisions", "wall_contacts", "nearest_m", "distance_m"),
)
_OWN: Final = (
    Column(
        "explored_s", "float", "s", "how long exploring took, until all had heard of its end; NaN if it never ended"
    ),
    Column("returned_s", "float", "s", "how long it then took to return to base; NaN if that never ended"),
    Column("deploy_s", "float", "s", "how long the deployment took after that; the longest run if it never ended"),
    Column("map_m2", "float", "m2", "floor that explorers knew to be empty when they had explored; their mean"),
    Column("map_alike", "float", "1", "the least of these maps over the largest; NaN if nobody has explored"),
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
    rows = _rows(outcome.trace.columns("events"))
    found = {name: outcome.metrics[name] for name in _KEPT}
    lasted = _lasted_s(rows)
    deploys = [time_s for play, time_s in lasted if play.startswith("deploy")]
    cell_m = scenario.protocol.parameters.exploring.protocol.cell_m  # type: ignore[attr-defined]
    maps_m2 = [cell_m * cell_m * row["empty"] for row in rows if row["event"] == "MapLearned"]
    return found | {
        "explored_s": _first(lasted, "explore"),
        "returned_s": _first(lasted, "return"),
        "deploy_s": deploys[0] if deploys else scenario.duration_s,
        "map_m2": sum(maps_m2) / len(maps_m2) if maps_m2 else math.nan,
        "map_alike": min(maps_m2) / max(maps_m2) if maps_m2 else math.nan,
    }


def _rows(events: Mapping[str, Any]) -> list[Row]:
    """Return the events as one row each."""
    names = list(events)
    return [dict(zip(names, values, strict=True)) for values in zip(*events.values(), strict=True)]


def _lasted_s(rows: list[Row]) -> list[tuple[str, float]]:
    """Return the plays that were done, and how long each took from its host's plan to its end."""
    begun = {row["plan"]: row for row in reversed(rows) if row["event"] == "PlanTaken"}
    ended = [row for row in rows if row["event"] == "PlanEnded" and row["result"] == "done"]
    firsts = [(begun[row["plan"]], row["time_ns"]) for row in ended if row["plan"] in begun]
    return [(first["play"], to_seconds(end - first["time_ns"])) for first, end in firsts]


def _first(lasted: list[tuple[str, float]], play: str) -> float:
    return next((time_s for name, time_s in lasted if name == play), math.nan)
