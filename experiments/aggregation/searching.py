"""A search of paper 002 with some of its settings chosen otherwise: several at once, under one name.

What distinguishes two cases, or two networks, is more than one setting: an axis of the sweep gives a choice, which is a
mapping of settings' paths to their values, and :func:`measure` makes the run that it describes.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from pydantic import Field, model_validator

from cosim.errors import UserError
from cosim.experiment import experiment_function
from cosim.scenario import Scenario, changed
from cosim.settings import PlainData, Settings
from cosim.simulation import METRICS as EVERY_RUN
from cosim.simulation import simulate
from cosim.trace import Field as Column
from protocols.aggregation.metrics import METRICS

COLUMNS: Final = tuple(
    Column(metric.name, "float", metric.unit, metric.meaning)
    for metric in (*METRICS, *(metric for metric in EVERY_RUN if metric.name in ("distance_m", "simulated_s")))
)


class Parameters(Settings):
    """A search, and what is chosen in it."""

    scenario: Scenario = Field(description="the run before anything is chosen")
    case: dict[str, PlainData] = Field(
        default_factory=dict, description="settings by their paths: what befalls the team"
    )
    choice: dict[str, PlainData] = Field(default_factory=dict, description="the same: what the paper leaves open")

    @model_validator(mode="after")
    def _makes_a_scenario(self) -> "Parameters":
        try:
            self.chosen()
        except UserError as error:
            raise ValueError(str(error)) from None
        return self

    def chosen(self) -> Scenario:
        """Return the scenario with all that is chosen; raise UserError for a setting that it does not have."""
        return changed(self.scenario, self.case | self.choice, "case and choice", Path(__file__).parent)


@experiment_function
def measure(parameters: Mapping[str, Any], seed: int) -> dict[str, float]:
    """Make the run and return ``COLUMNS``. Raise UserError for a run that cannot be set up."""
    metrics = simulate(Parameters.model_validate(parameters).chosen(), seed).metrics
    return {column.name: metrics[column.name] for column in COLUMNS}
