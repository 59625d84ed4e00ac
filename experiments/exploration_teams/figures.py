"""The statements of paper 001 on teams as one-sided tests, and the time to 95 % against team size.

``faster_office_4`` in published.csv is ``faster`` for the map ``office`` and four robots; the tests by such names are
made at the end of this file.
"""

from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

from cosim.experiment import axis_titles
from cosim.report.comparison import (
    NO_DATA,
    Answer,
    Arm,
    above,
    by_replicate,
    confidence_limits,
    less_censored,
    levels,
    more,
    mostly,
    never,
    paired,
    slopes,
)
from cosim.report.drawing import Named, draw_panels, draw_shares
from experiments.exploration.exploring import COVERAGE
from experiments.exploration_teams.growing import chosen, draw_growth, draw_ways, watch

TIME: Final = "until_95_s"
"""The time until 95 % had been seen; of a run that never came so far the longest, a lower bound."""
MAPS: Final = axis_titles(Path(__file__).parent)["map"]
PANELS: Final[Named] = ("map", MAPS)
MUCH: Final = 0.75
"""Share of one robot's time below which a team is much quicker."""
IN_TIME: Final = 0.7
"""Share of the runs that must come to 99 % for a floor to count as explored; 9 of 9 show it."""
NAMES: Final = {
    "schemas": "motor schemas (the paper)",
    "nearest": "nearest frontier",
    "utility": "utility with discount",
    "assignment": "least cost in all",
}
RIVALS: Final = ("nearest", "utility", "assignment")
SIZES: Final = (1, 2, 4, 8)
TEAMS: Final = (2, 4, 8)
LARGE: Final = (4, 8)
WATCHED: Final = 4
"""Robots of the exploration that is drawn from above."""


def _arm(floor: str, robots: int, algorithm: str = "schemas") -> Arm:
    return {"map": floor, "algorithm": algorithm, "robots": robots}


def faster(floor: str, robots: int, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether a team needs less than ``MUCH`` of a single robot's time."""
    return less_censored(runs, [("", _arm(floor, robots), _arm(floor, 1))], TIME, MUCH)


def covers(floor: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether teams of every size cover the floor."""
    return mostly(runs, [(f"{n} robots:", _arm(floor, n)) for n in levels(runs, "robots")], IN_TIME)


def touches_nothing(floor: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether no robot was held up in any run, with the layer of the sensors' own."""
    return never(runs, [_arm(floor, n) for n in levels(runs, "robots")], "blocked_ticks", "held up in", "ticks")


def greedy(floor: str, rival: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether a rival needs less time than the schemas, with four and with eight robots."""
    return less_censored(runs, [(f"{n} robots:", _arm(floor, n, rival), _arm(floor, n)) for n in LARGE], TIME)


def parts(floor: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether robots part in the time from a path laid."""
    return above(runs, [(f"{n} robots, m:", _arm(floor, n)) for n in LARGE], "parted_by_escape_m")


def parts_more(floor: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether robots part more in the time from a path laid than else."""
    arms = [(f"{n} robots, m:", _arm(floor, n)) for n in LARGE]
    return more(runs, [(label, arm, "parted_by_escape_m", arm, "parted_else_m") for label, arm in arms])


def no_force_empty(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether robots alone stall for want of force on the empty map."""
    return above(runs, [("stalls:", _arm("empty", 1))], "stalls_no_force")


def no_way_office(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether robots alone stall in the office although there is a force."""
    arm = _arm("office", 1)
    stalls = by_replicate(runs, arm, "stalls") - by_replicate(runs, arm, "stalls_no_force")
    found = confidence_limits(stalls)
    return (f"stalls: {found.text()}", found.exceeds(0)) if found.size else NO_DATA


def overlap(floor: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether the share of the floor that is covered twice grows with the team."""
    sizes = [n for n in levels(runs, "robots") if n > 1]
    table = paired(runs, [_arm(floor, n) for n in sizes], "covered_twice") if len(sizes) > 1 else pd.DataFrame()
    if table.empty:
        return NO_DATA
    means = ", ".join(f"{n} robots {100 * mean:.3g} %" for n, mean in zip(sizes, table.mean(), strict=True))
    found = confidence_limits(slopes(table, np.log2(sizes).tolist()))
    return f"{means}; by each doubling {found.text()}", found.exceeds(0)


def draw(runs: pd.DataFrame, observations: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw times and what is covered twice against team size, coverage over time, and one exploration from above.

    That exploration, the first of four robots by schemas on the last floor, is run again: the results hold no ways.
    """
    sizes, lines = ("robots", levels(runs, "robots")), ("algorithm", NAMES)
    twice = ("covered_twice", "share covered twice")
    rows = ("robots", {1: "1 robot"} | {n: f"{n} robots" for n in LARGE})
    return [
        *draw_panels(runs, folder / "time_by_size.png", (TIME, "time to 95 %, s"), sizes, lines, PANELS),
        *draw_panels(runs, folder / "twice_by_size.png", twice, sizes, lines, PANELS),
        *draw_shares(runs, folder / "coverage_over_time.png", COVERAGE, lines, PANELS, rows),
        *_from_above(runs, folder),
    ]


def _from_above(runs: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw how the map grows, and the robots' ways, in the first of the runs that ``draw`` names, if it was made."""
    arm = runs[(runs["algorithm"] == "schemas") & (runs["robots"] == WATCHED)] if "seed" in runs else pd.DataFrame()
    floors = [floor for floor in MAPS if not arm.empty and floor in set(arm["map"])]
    if not floors:
        return []
    first = arm[arm["map"] == floors[-1]].sort_values("replicate").iloc[0]
    shown = watch(chosen([f"map={floors[-1]}", f"robots={WATCHED}", "algorithm=schemas"]), int(first["seed"]))
    paths = [folder / "map_growth.png", folder / "ways.png"]
    draw_growth(shown, paths[0])
    draw_ways(shown, paths[1])
    return paths


# ---------------------------------------------------------------- the tests that published.csv names

globals().update({f"faster_{floor}_{n}": partial(faster, floor, n) for floor in MAPS for n in TEAMS})
globals().update({f"greedy_{floor}_{rival}": partial(greedy, floor, rival) for floor in MAPS for rival in RIVALS})
globals().update(
    {f"{t.__name__}_{floor}": partial(t, floor) for t in (covers, parts, parts_more, overlap) for floor in MAPS}
)
globals().update({f"untouched_{floor}": partial(touches_nothing, floor) for floor in MAPS})
