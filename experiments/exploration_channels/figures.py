"""Whether teams explore as paper 001 says when their map is no shared one, as one-sided tests; and what it costs."""

from functools import partial
from pathlib import Path
from typing import Final

import pandas as pd

from cosim.report.comparison import Answer, Arm, mostly
from cosim.report.drawing import draw_panels
from experiments.exploration.claims import IN_TIME, MUCH, PANELS, SLIGHT, TIME, sooner_than

FLOORS: Final = ("corridor", "office")
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
    return sooner_than(runs, [("", _arm(floor, network), _arm(floor, network, 1))], MUCH)


def costs_little(floor: str, network: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether merging maps by messages makes the exploration less than ``SLIGHT`` longer."""
    return sooner_than(runs, [("", _arm(floor, network), _arm(floor, "shared"))], SLIGHT)


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
    {f"{t.__name__}_{floor}_{n}": partial(t, floor, n) for t in (faster, covers) for floor in FLOORS for n in NETWORKS}
)
globals().update({f"costs_little_{f}_{n}": partial(costs_little, f, n) for f in FLOORS for n in NETWORKS[1:]})
