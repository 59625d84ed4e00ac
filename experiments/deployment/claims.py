"""Answers that several deployments of paper 004 are asked for."""

from typing import Final

import pandas as pd

from cosim.report.comparison import NO_DATA, Answer

IN_TIME: Final = 0.9
"""Share of the runs that must end deployed for a strategy to count as robust."""


def touches_nothing(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether no body touched another, or a wall, in any run."""
    if runs.empty or not {"collisions", "wall_contacts"} <= set(runs):
        return NO_DATA
    bodies, walls = (int(runs[name].sum()) for name in ("collisions", "wall_contacts"))
    return f"{bodies} contacts of bodies, {walls} with walls in {len(runs)} runs", bodies + walls == 0
