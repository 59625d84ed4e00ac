"""Paper 001, section 5.2, on speed that a SLAM filter sets: its statements as one-sided tests, and errors over time."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Final

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cosim.experiment import axis_titles
from cosim.report.comparison import NO_DATA, Answer, Arm, Pair, above, by_replicate, less_censored, mostly, never
from cosim.report.drawing import legend_outside
from cosim.report.saving import save
from experiments.exploration_localization.mapping import TIMES_S

TIME: Final = "until_95_s"
"""The time until 95 % had been seen; of a run that never came so far the longest, a lower bound."""
IN_TIME: Final = 0.7
"""Share of the runs that must come to 99 % for a floor to count as explored; 9 of 9 show it."""
MAPS: Final = axis_titles(Path(__file__).parent)["map"]
TRUE: Final = "true"
ODOMETRY: Final = "odometry"
CONSTANT: Final = "constant speed"
STOPS: Final = {1: "stop at 0.1 m", 2: "stop at 0.2 m", 4: "stop at 0.4 m"}
"""Arms with speed control, by their threshold in tenths of a metre, which are cells."""
NAMES: Final = {
    TRUE: "true positions",
    ODOMETRY: "odometry alone",
    CONSTANT: "filter, constant speed",
    **{stop: f"filter, {stop}" for stop in STOPS.values()},
}
"""Names of the arms in figures."""
MOSTLY: Final = 0.5
"""Share of the waits that must end with the robot localised again for waiting to help."""


def _arm(floor: str, position: str) -> Arm:
    return {"map": floor, "position": position}


def smaller(runs: pd.DataFrame, pair: Pair, metric: str) -> Answer:
    """Answer whether the first arm of *pair* has the smaller *metric*, an error.

    Robots that see less err less: a run that ended before 95 % had been seen counts with a lower bound of its error.
    """
    return less_censored(runs, [pair], metric)


def filters(floor: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether the filter's map is truer than that of odometry, at the same speed."""
    return smaller(runs, ("", _arm(floor, CONSTANT), _arm(floor, ODOMETRY)), "map_error")


def maps(floor: str, stop: int, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether the map is truer if the filter sets the speed."""
    return smaller(runs, ("", _arm(floor, STOPS[stop]), _arm(floor, CONSTANT)), "map_error")


def places(floor: str, stop: int, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether the robot knows better where it is if the filter sets the speed."""
    return smaller(runs, ("", _arm(floor, STOPS[stop]), _arm(floor, CONSTANT)), "pose_error_m")


def costs(floor: str, stop: int, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether a constant speed explores sooner."""
    return less_censored(runs, [("", _arm(floor, CONSTANT), _arm(floor, STOPS[stop]))], TIME)


def stricter_slower(floor: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether a threshold of a cell takes longer than one of four."""
    return less_censored(runs, [("", _arm(floor, STOPS[4]), _arm(floor, STOPS[1]))], TIME)


def stricter_truer(floor: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether a threshold of a cell makes truer maps than one of four."""
    return smaller(runs, ("", _arm(floor, STOPS[1]), _arm(floor, STOPS[4])), "map_error")


def localised(floor: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether waits mostly end with the robot localised again, at each threshold at which it waits at all."""
    arms = [(f"{stop}:", _arm(floor, stop)) for stop in STOPS.values()]
    waiting = [(label, arm) for label, arm in arms if by_replicate(runs, arm, "waits_localised").notna().any()]
    return above(runs, waiting, "waits_localised", MOSTLY)


def undisrupted(floor: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether the floor is still covered with the filter's speeds, and no robot held up."""
    arms = [(f"{stop}:", _arm(floor, stop)) for stop in STOPS.values()]
    covered, all_covered = mostly(runs, arms, IN_TIME)
    touched, free = never(runs, [arm for _, arm in arms], "blocked_ticks", "held up in", "ticks")
    if free is None or covered == NO_DATA[0]:
        return NO_DATA
    holds = False if free is False or all_covered is False else all_covered
    return f"{covered}; {touched}", holds


# ---------------------------------------------------------------- figures


def draw(runs: pd.DataFrame, observations: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw map and pose errors against time, a line an arm, and what accuracy costs: a point an arm."""
    floors = [each for each in MAPS if each in set(runs.get("map", ()))]
    if not floors or not {"position", "map_error", "until_95_s"} <= set(runs):
        return []
    drawn = [
        _over_time(runs, floors, folder, name, label)
        for name, label in (("map_error", "wrong cells, share of the known"), ("pose_error", "pose error, m"))
    ]
    return [*drawn, _trade(runs, floors, folder)]


def _over_time(runs: pd.DataFrame, floors: Sequence[str], folder: Path, name: str, label: str) -> Path:
    """Draw the mean of an error over the runs against time; as long as the median run."""
    figure, plots = _panels(floors)
    for plot, floor in zip(plots, floors, strict=True):
        for position, title in NAMES.items():
            part = runs[(runs["map"] == floor) & (runs["position"] == position)]
            if part.empty:
                continue
            times = [s for s in TIMES_S if s <= max(float(part["simulated_s"].median()), TIMES_S[0])]
            plot.plot(times, [part[f"{name}_{s}_s"].mean() for s in times], marker=".", label=title)
        plot.set(title=MAPS[floor], xlabel="time, s")
        plot.set_yscale("log")
    return _saved(figure, plots, label, folder / f"{name}_over_time.png")


def _trade(runs: pd.DataFrame, floors: Sequence[str], folder: Path) -> Path:
    figure, plots = _panels(floors)
    for plot, floor in zip(plots, floors, strict=True):
        for position, title in NAMES.items():
            part = runs[(runs["map"] == floor) & (runs["position"] == position)]
            if not part.empty:
                plot.plot(part["until_95_s"], part["map_error"], "o", alpha=0.7, label=title)
        plot.set(title=MAPS[floor], xlabel="time to 95 %, s")
        plot.set_yscale("log")
    return _saved(figure, plots, "wrong cells, share of the known", folder / "error_against_time.png")


def _panels(floors: Sequence[str]) -> tuple[Figure, Sequence[Axes]]:
    figure = Figure(figsize=(4.0 * len(floors) + 1.8, 4.0), layout="constrained")
    return figure, list(figure.subplots(1, len(floors), squeeze=False, sharey=True)[0])


def _saved(figure: Figure, plots: Sequence[Axes], label: str, path: Path) -> Path:
    plots[0].set_ylabel(label)
    for plot in plots:
        plot.grid(alpha=0.3)
    legend_outside(figure, plots)
    save(figure, path)
    return path


# ---------------------------------------------------------------- the tests that published.csv names

_OF_FLOORS: Final = (filters, localised, stricter_slower, stricter_truer, undisrupted)
_OF_THRESHOLDS: Final = (maps, places, costs)
globals().update({f"{test.__name__}_{floor}": partial(test, floor) for test in _OF_FLOORS for floor in MAPS})
globals().update(
    {
        f"{test.__name__}_{floor}_{s}": partial(test, floor, s)
        for test in _OF_THRESHOLDS
        for floor in MAPS
        for s in STOPS
    }
)
