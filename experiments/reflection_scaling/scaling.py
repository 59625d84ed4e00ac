"""How goal reflection grows with the team: bytes of a frame and of the team, and targets in a given time."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from pydantic import Field

from cosim.experiment import experiment_function
from cosim.scenario import Scenario, changed
from cosim.settings import Count, Settings
from cosim.simulation import simulate
from cosim.trace import Field as Column
from protocols.reflection.spec import steps_with_target

COLUMNS: Final = (
    Column("bytes_a_frame", "float", "B", "mean size of what a robot tells at once, the payload of a frame"),
    Column("bytes_a_period", "float", "B", "what all robots tell in one period, together"),
    Column("targets_an_hour", "float", "1/h", "targets that an explorer has come to, by its own count, in an hour"),
    Column("steps_a_target", "float", "1", "motion steps of explorers over targets that they have come to"),
    Column("targets_given_up", "float", "1", "targets that explorers did without"),
    Column("promise_share", "float", "1", "share of explorers' steps that were headed for a promise"),
)


class Task(Settings):
    """What a team does, and where."""

    everybody: bool = Field(description="all have targets; else the first has, and the others patrol")
    map: str = Field(description="the floor")
    times: Count = Field(default=1, ge=1, description="so many times the scenario's duration")


class Parameters(Settings):
    """A run of goal reflection, how many robots are in it, and what they do."""

    scenario: Scenario = Field(description="the run")
    robots: Count = Field(ge=1, description="robots in the team")
    task: Task = Field(description="what they do")


@experiment_function
def measure(parameters: Mapping[str, Any], seed: int) -> dict[str, float]:
    """Make the run and return ``COLUMNS``. Raise UserError for a run that cannot be set up."""
    given = Parameters.model_validate(parameters)
    explorers = given.robots if given.task.everybody else 1
    changes = {
        "floorplan.map": given.task.map,
        "duration_s": given.scenario.duration_s * given.task.times,
        "team.size": given.robots,
        "protocol.parameters.explorers": explorers,
    }
    scenario = changed(given.scenario, changes, "task", Path(__file__).parent)
    metrics = simulate(scenario, seed).metrics
    steps, reached = steps_with_target(metrics), metrics["targets_reached"]
    period_s = getattr(scenario.protocol.parameters, "period_s", None) or scenario.tick_s
    return {
        "bytes_a_frame": metrics["payload_bytes"] / metrics["frames"] if metrics["frames"] else float("nan"),
        "bytes_a_period": metrics["payload_bytes"] * period_s / metrics["simulated_s"],
        "targets_an_hour": reached / explorers * 3600 / metrics["simulated_s"],
        "steps_a_target": steps / reached if reached else float("nan"),
        "targets_given_up": metrics["targets_given_up"],
        "promise_share": metrics["steps_to_promise"] / (steps or math.nan),  # all may stand at their targets
    }
