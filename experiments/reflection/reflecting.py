"""A run of goal reflection on one of two floors, by the whole team or by the smallest that the paper has numbers for.

What the paper leaves open may be something else on each floor (doors), or concern one algorithm only (Cr): such runs of
other algorithms are not made.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, Literal

from pydantic import Field, model_validator

from cosim.errors import UserError
from cosim.experiment import experiment_function
from cosim.scenario import Scenario, changed
from cosim.settings import Count, Settings
from cosim.simulation import simulate
from cosim.trace import Field as Column

Algorithm = Literal["avoid_past", "visbug", "potential_field"]
Floor = Literal["first", "second"]

COLUMNS: Final = (
    Column("steps", "float", "1", "motion steps a target; one that is given up counts with the steps until then"),
    Column("given_up", "float", "1", "share of the targets that were given up"),
    Column("promise_share", "float", "1", "share of the steps that were headed for a promise"),
    Column("helper_share", "float", "1", "share of the steps that were headed for another robot, in trouble"),
    Column("reflected", "float", "1", "share of the targets for which a promise was taken"),
    Column("first_useful_reflection_s", "float", "s", "from turning to such a target until its first promise, mean"),
    Column("advice", "float", "1", "promises for own goals that came in from robots in sight, useful or not"),
    Column("advice_unseen", "float", "1", "promises for own goals that came in from robots out of sight"),
    Column("stale_advice", "float", "1", "share of advice that was outdated or late on arrival; NaN if none came in"),
    Column("advice_outdated", "float", "1", "share of advice that was about a goal that the robot had no more"),
    Column("advice_late", "float", "1", "share of advice that was older than stale_s"),
    Column("troubles", "float", "1", "times that a robot got into trouble"),
    Column("robot_steps", "float", "1", "motion steps of all robots, which is what a run costs"),
)
_AS_THEY_ARE: Final = (
    "first_useful_reflection_s",
    "advice",
    "advice_unseen",
    "stale_advice",
    "advice_outdated",
    "advice_late",
    "troubles",
)


class Parameters(Settings):
    """A run of goal reflection, its floor and its team."""

    scenario: Scenario = Field(description="the run, but for floor and team")
    floors: dict[Floor, str] = Field(description="the map of each floor")
    floor: Floor = Field(default="first", description="which of them")
    smallest: dict[Algorithm, Count] = Field(
        default_factory=dict, description="robots in the smallest team, by algorithm; 1 if not given"
    )
    team: Literal["whole", "smallest"] = Field(
        default="whole", description="as many robots as the scenario says, or the smallest team"
    )
    concerns: tuple[Algorithm, ...] | None = Field(
        default=None, description="the algorithms that the arm is of interest for; all, if not given"
    )

    @model_validator(mode="after")
    def _makes_a_scenario(self) -> "Parameters":
        try:
            self.chosen()
        except UserError as error:
            raise ValueError(str(error)) from None
        return self

    @property
    def algorithm(self) -> Algorithm:
        """The local navigation algorithm A."""
        found: Algorithm = self.scenario.protocol.parameters.algorithm  # type: ignore[attr-defined]
        return found

    def chosen(self) -> Scenario:
        """Return the scenario with floor and team; raise UserError if there can be no such run."""
        changes: dict[str, Any] = {"floorplan.map": self.floors[self.floor]}
        if self.team == "smallest":
            changes["team.size"] = self.smallest.get(self.algorithm, 1)
        return changed(self.scenario, changes, "floor and team", Path(__file__).parent)


@experiment_function
def measure(parameters: Mapping[str, Any], seed: int) -> dict[str, float]:
    """Make the run and return ``COLUMNS``; all are NaN, and no run is made, if the arm does not concern it.

    Raise UserError for a run that cannot be set up.
    """
    given = Parameters.model_validate(parameters)
    if given.concerns is not None and given.algorithm not in given.concerns:
        return {column.name: math.nan for column in COLUMNS}
    scenario = given.chosen()
    metrics = simulate(scenario, seed).metrics
    targets: int = scenario.protocol.parameters.target_count  # type: ignore[attr-defined]
    steps = metrics["motion_steps"]
    share = 1 / steps if steps else math.nan  # a robot may stand at its only target
    return {
        "steps": steps / targets,
        "given_up": metrics["targets_given_up"] / targets,
        "promise_share": share * metrics["steps_to_promise"],
        "helper_share": share * metrics["steps_to_helper"],
        "reflected": metrics["targets_reflected"] / targets,
        "robot_steps": metrics["simulated_s"] / scenario.tick_s * scenario.team.size,
    } | {name: metrics[name] for name in _AS_THEY_ARE}
