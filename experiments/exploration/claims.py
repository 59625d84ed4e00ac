"""Thresholds and comparisons of the explorations of paper 001.

The metric is the time until 95 % of what can be seen has been. An exploration that does not come so far counts with the
longest run, a lower bound of what it would have taken.
"""

from collections.abc import Sequence
from typing import Final

import pandas as pd

from cosim.report.comparison import NO_DATA, Answer, Arm, Pair, by_replicate, less_censored
from cosim.report.drawing import Named

TIME: Final = "until_95_s"
TIME_LABEL: Final = (TIME, "time to 95 %, s")
MAPS: Final = {"empty": "empty map", "corridor": "corridor with rooms", "office": "office"}
"""Names of the floors in figures."""
PANELS: Final[Named] = ("map", MAPS)
MUCH: Final = 0.75
"""Share of one robot's time below which a team is much quicker."""
SLIGHT: Final = 1.1
"""Factor below which a longer exploration costs little."""
IN_TIME: Final = 0.7
"""Share of the runs that must come to 99 % for a floor to count as explored; 9 of 9 show it."""


def sooner_than(runs: pd.DataFrame, pairs: Sequence[Pair], factor: float = 1.0) -> Answer:
    """Answer whether in every one of *pairs* the first arm takes less than *factor* times as long as the second."""
    return less_censored(runs, pairs, TIME, factor)


def untouched(runs: pd.DataFrame, arms: Sequence[Arm]) -> Answer:
    """Answer whether no robot of *arms* was held up in any run: one refutes it."""
    found = [by_replicate(runs, arm, "blocked_ticks") for arm in arms]
    if not found or any(part.empty for part in found):
        return NO_DATA
    every = pd.concat(found)
    return f"held up in {every.mean():.3g} ticks a run, in {int((every > 0).sum())} of {len(every)}", not every.any()
