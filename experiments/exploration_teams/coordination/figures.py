"""The rows of exploration_teams that a second reading asks for, as one-sided tests."""

from functools import partial
from typing import Final

import pandas as pd

from cosim.report.comparison import Answer, Arm, above
from experiments.exploration_teams.figures import LARGE, MAPS, greedy, parts, parts_more, touches_nothing

COORDINATED: Final = "utility"
"""The algorithm that assigns frontiers together (Burgard et al., 2005), and knows no more than the schemas do."""
THICK: Final = "thick"
"""The office whose walls have a thickness."""


def not_optimal(floor: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether robots whose frontiers are assigned together are faster than the schemas; open if they are not.

    A rival that is no faster refutes nothing: another one may be.
    """
    words, holds = greedy(floor, COORDINATED, runs, observations)
    return words, holds or None


def diverge(floor: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether robots part that are led by the schemas, and follow no path."""
    arms: list[tuple[str, Arm]] = [
        (f"{n} robots, m:", {"map": floor, "algorithm": "schemas", "robots": n}) for n in LARGE
    ]
    return above(runs, arms, "parted_else_m")


# ---------------------------------------------------------------- the tests that published.csv names

globals().update({f"not_optimal_{floor}": partial(not_optimal, floor) for floor in MAPS})
globals().update({f"diverge_near_{floor}": partial(diverge, floor) for floor in MAPS})
globals().update({f"parts_near_{floor}": partial(parts, floor) for floor in MAPS})
globals().update({f"parts_more_near_{floor}": partial(parts_more, floor) for floor in MAPS})
untouched_thick: Final = partial(touches_nothing, THICK)
