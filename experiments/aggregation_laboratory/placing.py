"""The laboratory's runs: the same search again and again, but for where exactly people put the robots at the start.

Searchers that know their tours and meet no chance on their ways do the same in every run. Real robots do not; the paper
does not say what differed between its runs of one target distribution. What is varied here is the place where each
robot starts, by a few centimetres along x and y. All arms of a replicate have the same starts.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from pydantic import Field

from cosim.experiment import experiment_function
from cosim.randomness import Streams
from cosim.results import metric_fields
from cosim.scenario import Scenario, changed
from cosim.settings import Count, Metres, Settings
from cosim.simulation import METRICS as EVERY_RUN
from cosim.simulation import simulate
from protocols.aggregation.metrics import METRICS

COLUMNS: Final = tuple(metric_fields((*EVERY_RUN, *METRICS)))


class Parameters(Settings):
    """A search, where its targets are, and how exactly its robots are put at ``team.starts``."""

    scenario: Scenario = Field(description="the run, with the beginning of the name of its targets' place")
    distribution: Count = Field(
        default=1, ge=1, description="the targets are where the floor's place TARGETS_NUMBER is"
    )
    placing_m: Metres = Field(
        default=0.0, ge=0, description="m, at most, that a robot is beside its place along x or y"
    )

    def placed(self, seed: int) -> Scenario:
        """Return the scenario with the targets, and with the starts of the run with *seed*, if it names any."""
        given = self.scenario.team.starts or ()
        off = Streams(seed)("placing").uniform(-self.placing_m, self.placing_m, (len(given), 2)).tolist()
        starts = [[x + dx, y + dy] for (x, y), (dx, dy) in zip(given, off, strict=True)] or None
        targets = f"{getattr(self.scenario.protocol.parameters, 'target_place', None)}_{self.distribution}"
        changes = {"team.starts": starts, "protocol.parameters.target_place": targets}
        return changed(self.scenario, changes, "placing", Path(__file__).parent)


@experiment_function
def measure(parameters: Mapping[str, Any], seed: int) -> dict[str, float]:
    """Make the run and return ``COLUMNS``. Raise UserError for a run that cannot be set up."""
    metrics = simulate(Parameters.model_validate(parameters).placed(seed), seed).metrics
    return {column.name: metrics[column.name] for column in COLUMNS}
