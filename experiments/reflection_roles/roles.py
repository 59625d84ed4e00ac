"""Roles: a run of goal reflection with given numbers of explorers and of helpers.

The work is the same whoever does it: the explorers share out as many targets. Steps are counted by the robots
themselves, as long as they have a target.
"""

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
    Column("steps", "float", "1", "motion steps a target; one that is given up counts with the steps until then"),
    Column("given_up", "float", "1", "share of the targets that were given up"),
    Column("done_s", "float", "s", "when the last explorer had done with its targets, or the run was over"),
    Column("promise_share", "float", "1", "share of the steps that were headed for a promise"),
    Column("troubles", "float", "1", "times that a robot got into trouble"),
    Column("payload_bytes", "float", "B", "bytes in the frames of all robots"),
)


class Parameters(Settings):
    """A run of goal reflection, and the roles in it."""

    scenario: Scenario = Field(description="the run; the team's size and the number of targets are set from the rest")
    explorers: Count = Field(ge=1, description="robots that have targets")
    helpers: Count = Field(ge=0, description="robots that patrol")
    targets: Count = Field(gt=0, description="targets of all explorers together; a remainder is left out")


@experiment_function
def measure(parameters: Mapping[str, Any], seed: int) -> dict[str, float]:
    """Make the run and return ``COLUMNS``. Raise UserError for a run that cannot be set up."""
    given = Parameters.model_validate(parameters)
    each = given.targets // given.explorers
    changes = {
        "team.size": given.explorers + given.helpers,
        "protocol.parameters.explorers": given.explorers,
        "protocol.parameters.target_count": each,
    }
    metrics = simulate(changed(given.scenario, changes, "roles", Path(__file__).parent), seed).metrics
    wanted = each * given.explorers
    steps = steps_with_target(metrics)
    return {
        "steps": steps / wanted,
        "given_up": metrics["targets_given_up"] / wanted,
        "done_s": metrics["simulated_s"],
        "promise_share": metrics["steps_to_promise"] / (steps or math.nan),  # all may stand at their targets
        "troubles": metrics["troubles"],
        "payload_bytes": metrics["payload_bytes"],
    }
