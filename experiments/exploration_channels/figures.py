"""Whether teams explore as paper 001 says when their map is no shared one, as one-sided tests; and what it costs."""

from functools import partial
from pathlib import Path
from typing import Final

import pandas as pd

from cosim.experiment import axis_titles
from cosim.report.comparison import Answer, Arm, less_censored, mostly
from cosim.report.drawing import Named, draw_panels

TIME: Final = "until_95_s"
"""The time until 95 % had been seen; of a run that never came so far the longest, a lower bound."""
MAPS: Final = axis_titles(Path(__file__).parent)["map"]
PANELS: Final[Named] = ("map", MAPS)
MUCH: Final = 0.75
"""Share of one robot's time below which a team is much quicker."""
SLIGHT: Final = 1.1
"""Factor below which a longer exploration costs little."""
IN_TIME: Final = 0.7
"""Share of the runs that must come to 99 % for a floor to count as explored; 9 of 9 show it."""
NETWORKS: Final = ("shared", "ideal", "near", "adhoc", "bluetooth")
MANY: Final = 4
LINES: Final = {1: "1 robot", MANY: f"{MANY} robots"}
METRICS: Final = {
    TIME: "time to 95 %, s",
    "covered_twice": "share covered twice",
    "payload_bytes": "sent by all, bytes",
}


def _arm(floor: str, network: str, robots: int = MANY) -> Arm:
    return {"map": floor, "robots": robots, "network": network}


def faster(floor: str, network: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether a team needs less than ``MUCH`` of a single robot's time."""
    return less_censored(runs, [("", _arm(floor, network), _arm(floor, network, 1))], TIME, MUCH)


def costs_little(floor: str, network: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether merging maps by messages makes the exploration less than ``SLIGHT`` times as long."""
    return less_censored(runs, [("", _arm(floor, network), _arm(floor, "shared"))], TIME, SLIGHT)


def covers(floor: str, network: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether the floor is covered."""
    return mostly(runs, [("", _arm(floor, network))], IN_TIME)


def draw(runs: pd.DataFrame, observations: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw time, double coverage and bytes by network, a line a team size."""
    over = ("network", NETWORKS)
    pictures = [
        draw_panels(runs, folder / f"{metric}_by_network.png", (metric, label), over, ("robots", LINES), PANELS)
        for metric, label in METRICS.items()
    ]
    return [path for paths in pictures for path in paths]


# ---------------------------------------------------------------- the tests that published.csv names

globals().update(
    {f"{t.__name__}_{floor}_{n}": partial(t, floor, n) for t in (faster, covers) for floor in MAPS for n in NETWORKS}
)
globals().update({f"costs_little_{f}_{n}": partial(costs_little, f, n) for f in MAPS for n in NETWORKS[1:]})
