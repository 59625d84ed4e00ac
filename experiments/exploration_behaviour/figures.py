"""The statements of paper 001 on its schemas and its escape as one-sided tests: each part against its absence."""

from functools import partial
from pathlib import Path
from typing import Final

import pandas as pd

from cosim.experiment import axis_titles
from cosim.report.comparison import (
    NO_DATA,
    Answer,
    Arm,
    above,
    by_replicate,
    confidence_limits,
    less,
    less_censored,
    levels,
    more,
    never,
)
from cosim.report.drawing import Named, draw_panels, draw_shares
from experiments.exploration.exploring import COVERAGE

TIME: Final = "until_95_s"
"""The time until 95 % had been seen; of a run that never came so far the longest, a lower bound."""
MAPS: Final = axis_titles(Path(__file__).parent)["map"]
PANELS: Final[Named] = ("map", MAPS)
SLIGHT: Final = 1.1
"""Factor below which a longer exploration costs little."""
USUAL: Final = "usual"
NO_LAYER: Final = "no subsumption"
MANY: Final = 4
LED_ON: Final = 0.75
"""Share of the paths that must lead to a frontier for escapes to be effective."""
STALLED: Final = 0.95
"""Coverage below which a robot has stalled."""


def _arm(floor: str, robots: int, behaviour: str = USUAL) -> Arm:
    return {"map": floor, "robots": robots, "behaviour": behaviour}


def _stalls(floor: str, robots: int, runs: pd.DataFrame) -> Answer:
    without = _arm(floor, robots, "no escape")
    share = confidence_limits(by_replicate(runs, without, "coverage"))
    if not share.size:
        return NO_DATA
    words, less_than = more(
        runs, [("coverage with it and without:", _arm(floor, robots), "coverage", without, "coverage")]
    )
    below = None if share.size < 2 else share.upper < STALLED
    holds = None if None in (below, less_than) else bool(below and less_than)
    return f"{words}; without it {share.text()}", holds


def stalls(floor: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether one robot, without the escape, covers less than with it, and a smaller share than ``STALLED``."""
    return _stalls(floor, 1, runs)


def team_stalls(floor: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether a team, without the escape, covers less than with it, and a smaller share than ``STALLED``."""
    return _stalls(floor, MANY, runs)


def leads_on(floor: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether most paths lead on."""
    sizes = levels(runs, "robots")
    return above(runs, [(f"{n} robots:", _arm(floor, n)) for n in sizes], "paths_led_on", LED_ON)


def adequate(floor: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether the printed A* costs little time."""
    pairs = [(f"{n} robots:", _arm(floor, n, "printed A*"), _arm(floor, n)) for n in levels(runs, "robots")]
    return less_censored(runs, pairs, TIME, SLIGHT)


def distributes(floor: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether less is covered twice with avoid-robot than without."""
    return less(runs, [("", _arm(floor, MANY), _arm(floor, MANY, "no avoid-robot"))], "covered_twice")


def obstacle_range(floor: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether more is covered if obstacles repel from nearby only."""
    wide = "wide obstacles"
    sizes = levels(runs, "robots")
    return more(runs, [(f"{n} robots:", _arm(floor, n), "coverage", _arm(floor, n, wide), "coverage") for n in sizes])


def touches_nothing(floor: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether no robot is held up, without the layer of the sensors' own."""
    arms = [_arm(floor, n, NO_LAYER) for n in levels(runs, "robots")]
    return never(runs, arms, "blocked_ticks", "held up in", "ticks")


def subsumes(floor: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether the layer of the sensors' own makes robots touch less."""
    return less(runs, [("", _arm(floor, MANY), _arm(floor, MANY, NO_LAYER))], "blocked_ticks")


def clearance(floor: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether paths that cost more near obstacles make robots touch less."""
    return less(runs, [("", _arm(floor, MANY, NO_LAYER), _arm(floor, MANY, "no clearance"))], "blocked_ticks")


def draw(runs: pd.DataFrame, observations: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw coverage and the time to 95 % by behaviour, a line a team size, and coverage over time."""
    behaviours = runs["behaviour"].unique().tolist() if "behaviour" in runs else []
    over, lines = ("behaviour", behaviours), ("robots", {1: "1 robot", MANY: f"{MANY} robots"})
    named = ("behaviour", {each: each for each in behaviours})
    return [
        *draw_panels(runs, folder / "coverage_by_behaviour.png", ("coverage", "share covered"), over, lines, PANELS),
        *draw_panels(runs, folder / "time_by_behaviour.png", (TIME, "time to 95 %, s"), over, lines, PANELS),
        *draw_shares(runs, folder / "coverage_over_time.png", COVERAGE, named, PANELS, lines),
    ]


# ---------------------------------------------------------------- the tests that published.csv names

_ON_ALL: Final = (stalls, team_stalls, leads_on, adequate, distributes, obstacle_range, subsumes)
globals().update({f"{t.__name__}_{floor}": partial(t, floor) for t in _ON_ALL for floor in MAPS})
globals().update({f"untouched_{floor}": partial(touches_nothing, floor) for floor in MAPS})
globals().update({f"clearance_{floor}": partial(clearance, floor) for floor in MAPS if floor != "empty"})
