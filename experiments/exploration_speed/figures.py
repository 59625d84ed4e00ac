"""The statements of paper 001, section 5.2, on speed as one-sided tests, and the time to 95 % with both speeds."""

from functools import partial
from pathlib import Path
from typing import Final

import pandas as pd

from cosim.report.comparison import NO_DATA, Answer, Arm, confidence_limits, levels, mostly, saving
from cosim.report.drawing import draw_panels
from experiments.exploration.claims import IN_TIME, MAPS, PANELS, TIME, TIME_LABEL, sooner_than, untouched
from experiments.exploration.curves import coverage_over_time

CONSTANT: Final = "constant"
FASTER: Final = "by obstacles"
SIZES: Final = (1, 4)


def _arm(floor: str, robots: int, speed: str) -> Arm:
    return {"map": floor, "robots": robots, "speed": speed}


def sooner(floor: str, robots: int, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether driving faster where no obstacle is near takes less time."""
    return sooner_than(runs, [("", _arm(floor, robots, FASTER), _arm(floor, robots, CONSTANT))])


def undisrupted(floor: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether the floor is still covered, and no robot held up."""
    arms = [(f"{n} robots:", _arm(floor, n, FASTER)) for n in levels(runs, "robots")]
    covered, all_covered = mostly(runs, arms, IN_TIME)
    touched, free = untouched(runs, [arm for _, arm in arms])
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
        *draw_panels(runs, folder / "time_by_speed.png", TIME_LABEL, sizes, lines, PANELS),
        *coverage_over_time(runs, folder, "coverage_over_time.png", SIZES, lines),
    ]


# ---------------------------------------------------------------- the tests that published.csv names

globals().update({f"sooner_{floor}_{n}": partial(sooner, floor, n) for floor in MAPS for n in SIZES})
globals().update({f"undisrupted_{floor}": partial(undisrupted, floor) for floor in MAPS})
globals().update({f"open_gains_{floor}": partial(open_gains, floor) for floor in MAPS if floor != "empty"})
