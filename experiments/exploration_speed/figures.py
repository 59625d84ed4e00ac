"""The statements of paper 001, section 5.2, on speed as one-sided tests, and the time to 95 % with both speeds."""

from functools import partial
from pathlib import Path
from typing import Final

import pandas as pd

from cosim.experiment import axis_titles
from cosim.report.comparison import (
    NO_DATA,
    Answer,
    Arm,
    confidence_limits,
    less_censored,
    levels,
    mostly,
    never,
    saving,
)
from cosim.report.drawing import Named, draw_panels, draw_shares
from experiments.exploration.exploring import COVERAGE

TIME: Final = "until_95_s"
"""The time until 95 % had been seen; of a run that never came so far the longest, a lower bound."""
MAPS: Final = axis_titles(Path(__file__).parent)["map"]
PANELS: Final[Named] = ("map", MAPS)
IN_TIME: Final = 0.7
"""Share of the runs that must come to 99 % for a floor to count as explored; 9 of 9 show it."""
CONSTANT: Final = "constant"
FASTER: Final = "by obstacles"
SIZES: Final = {1: "1 robot", 4: "4 robots"}


def _arm(floor: str, robots: int, speed: str) -> Arm:
    return {"map": floor, "robots": robots, "speed": speed}


def sooner(floor: str, robots: int, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether driving faster where no obstacle is near takes less time."""
    return less_censored(runs, [("", _arm(floor, robots, FASTER), _arm(floor, robots, CONSTANT))], TIME)


def undisrupted(floor: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether the floor is still covered, and no robot held up."""
    arms = [(f"{n} robots:", _arm(floor, n, FASTER)) for n in levels(runs, "robots")]
    covered, all_covered = mostly(runs, arms, IN_TIME)
    touched, free = never(runs, [arm for _, arm in arms], "blocked_ticks", "held up in", "ticks")
    if free is None or covered == NO_DATA[0]:
        return NO_DATA
    holds = False if free is False or all_covered is False else all_covered
    return f"{covered}; {touched}", holds


def open_gains(floor: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether a larger share of the time is saved on the empty map than on a floor with walls."""
    words, holds = [], []
    for robots in levels(runs, "robots"):
        shares = [
            saving(runs, _arm(each, robots, FASTER), _arm(each, robots, CONSTANT), TIME) for each in ("empty", floor)
        ]
        difference = confidence_limits(shares[0] - shares[1])
        if not difference.size:
            return NO_DATA
        one, other = (f"{100 * share.mean():.3g} %" for share in shares)
        words.append(f"{robots} robots: {one} against {other}, difference of the shares {difference.text()}")
        holds.append(difference.exceeds(0))
    return ("; ".join(words), None if None in holds else all(holds)) if holds else NO_DATA


def draw(runs: pd.DataFrame, observations: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw the time to 95 % against team size, and coverage over time, a line a speed."""
    sizes, lines = ("robots", levels(runs, "robots")), ("speed", {CONSTANT: CONSTANT, FASTER: "faster in the open"})
    return [
        *draw_panels(runs, folder / "time_by_speed.png", (TIME, "time to 95 %, s"), sizes, lines, PANELS),
        *draw_shares(runs, folder / "coverage_over_time.png", COVERAGE, lines, PANELS, ("robots", SIZES)),
    ]


# ---------------------------------------------------------------- the tests that published.csv names

globals().update({f"sooner_{floor}_{n}": partial(sooner, floor, n) for floor in MAPS for n in SIZES})
globals().update({f"undisrupted_{floor}": partial(undisrupted, floor) for floor in MAPS})
globals().update({f"open_gains_{floor}": partial(open_gains, floor) for floor in MAPS if floor != "empty"})
