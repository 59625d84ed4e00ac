"""The search of paper 002 on areas of several sizes, with several numbers of sub-teams.

What has to grow with the area does: how long a run may last; how long a searcher may be silent; and, by the paper's
rule of thumb for MRP (section III.B: reconvene in a quarter of the time that SRP would need), the time between
reconvenings. The last two are proportional to the area that a sub-team has to search: the scenario's hold for a third
of 150 m x 150 m, as in aggregation_search. A host waits for its searchers as long as these need for the side of the
area.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from pydantic import Field

from cosim.experiment import experiment_function
from cosim.results import metric_fields
from cosim.scenario import Scenario, changed, dump
from cosim.settings import Count, Rate, Seconds, Settings
from cosim.simulation import METRICS as EVERY_RUN
from cosim.simulation import simulate
from protocols.aggregation.metrics import METRICS

COLUMNS: Final = tuple(metric_fields((*EVERY_RUN, *METRICS)))
LEAST_S: Final = 30.0
"""Shortest period: a host has to send its plan, and searchers have to go somewhere."""
USUAL_M2: Final = 150.0**2 / 3
"""Area of a sub-team for which the scenario's periods hold."""
GROWING: Final = ("reconvene_s", "lost_s")
"""Periods of the protocol that are proportional to that area."""


class Parameters(Settings):
    """A search, how large its area is, and how many sub-teams there are."""

    scenario: Scenario = Field(description="the run, with the bodies of a host and of a searcher as its two groups")
    side_m: Count = Field(gt=0, description="m, side of the area: the floor rooms_SIDE.yaml")
    sub_teams: Count = Field(ge=1, description="hosts")
    searchers: Count = Field(default=2, ge=1, description="in each sub-team")
    cap_s: Seconds = Field(default=300.0, gt=0, description="s, longest run on no area")
    cap_s_per_m2: Rate = Field(default=0.18, ge=0, description="s, so much longer by the square metre")

    def scaled(self) -> Scenario:
        """Return the run on that area with so many sub-teams; raise UserError if there can be no such run."""
        plain = dump(self.scenario)
        groups, periods = plain["team"]["groups"], plain["protocol"]["parameters"]
        area_m2 = float(self.side_m**2)
        times = area_m2 / self.sub_teams / USUAL_M2
        own: dict[str, Any] = {
            "duration_s": self.cap_s + self.cap_s_per_m2 * area_m2,
            "floorplan.map": f"../floors/rooms_{self.side_m}.yaml",
            "team.groups": [
                {**groups[0], "size": self.sub_teams},
                {**groups[1], "size": self.sub_teams * self.searchers},
            ],
            "protocol.parameters.hosts": self.sub_teams,
            "protocol.parameters.sync_s": self.side_m / self.scenario.team.bodies[-1].speed_mps,
        }
        own |= {f"protocol.parameters.{name}": max(LEAST_S, periods[name] * times) for name in GROWING}
        return changed(self.scenario, own, "scaling", Path(__file__).parent)


@experiment_function
def measure(parameters: Mapping[str, Any], seed: int) -> dict[str, float]:
    """Make the run and return ``COLUMNS``. Raise UserError for a run that cannot be set up."""
    metrics = simulate(Parameters.model_validate(parameters).scaled(), seed).metrics
    return {column.name: metrics[column.name] for column in COLUMNS}
