"""Metrics and strategies of the searches of paper 002, and their comparison.

A search that finds no end counts with the cap, as in the paper: a lower bound of what it would have taken.
"""

from collections.abc import Sequence
from typing import Final

import pandas as pd

from cosim.report import comparison
from cosim.report.comparison import Answer, Pair

TIME: Final = "search_time_min"
NAMES: Final = {"srp": "SRP", "mrp": "MRP", "mi": "MI", "mito": "MITO", "random": "random"}
"""Names of the strategies in figures and answers."""
OURS: Final = ("srp", "mrp", "mi")
"""The strategies that the paper compares with each other."""
UNITS: Final = {
    TIME: "min",
    "distance_m": "m",
    "distance_after_m": "m",
    "payload_bytes": "bytes",
    "frames": "frames",
    "energy_j": "J",
    "motion_j": "J",
    "rejoin_time_s": "s",
}


def less(runs: pd.DataFrame, pairs: Sequence[Pair], metric: str = TIME, factor: float = 1.0) -> Answer:
    """Answer as :func:`cosim.report.comparison.less`, with the unit of *metric*."""
    return comparison.less(runs, pairs, metric, factor, UNITS.get(metric, ""))
