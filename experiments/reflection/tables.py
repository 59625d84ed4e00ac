"""Tables 1 and 2 of paper 000 as printed, and the metric and the names that its experiments share.

The metric is *steps*: motion steps a target. A target that is given up counts with the steps until then, so steps are
the mean of min(steps to the target, give_up_s / tick_s): the same limit for all arms, and a lower bound of what the
paper counts where targets were given up.
"""

from pathlib import Path
from typing import Final, NamedTuple

import pandas as pd

from cosim.report.claims import published_claims
from cosim.report.comparison import Arm

STEPS: Final = "steps"
FLOORS: Final = ("first", "second")
ALGORITHMS: Final = ("avoid_past", "visbug", "potential_field")
NAMES: Final = {"avoid_past": "Avoid Past", "visbug": "VisBug", "potential_field": "potential field"}
"""Names of the algorithms in figures."""
SIZES: Final = (1, 2, 3, 4)
LEAST: Final = {"avoid_past": 1, "visbug": 1, "potential_field": 2}
"""Smallest team for which the paper prints a number."""
CELL: Final = "cell_"
"""Beginning of the ids of the printed cells."""
_EXPERIMENT: Final = Path(__file__).parent.parent / "reflection_tables"


class Cell(NamedTuple):
    """A cell of Table 1 or 2."""

    floor: str
    algorithm: str
    robots: int
    steps: float

    @property
    def arm(self) -> Arm:
        """The axes' values."""
        return {"floor": self.floor, "algorithm": self.algorithm, "robots": self.robots}


def cells() -> list[Cell]:
    """Return the printed cells, from the published.csv of reflection_tables."""
    found = []
    for row in published_claims(_EXPERIMENT):
        if row.id.startswith(CELL):
            floor, rest = row.id.removeprefix(CELL).split("_", 1)
            algorithm, robots = rest.rsplit("_", 1)
            found.append(Cell(floor, algorithm, int(robots), float(row.published)))
    return found


def with_steps(runs: pd.DataFrame) -> pd.DataFrame:
    """Return *runs* with the column ``steps``; without it if they do not have what it is made of."""
    if runs.empty or not {"motion_steps", "targets", "replicate"} <= set(runs):
        return runs
    return runs.assign(steps=runs["motion_steps"] / runs["targets"])
