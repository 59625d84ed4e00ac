"""What the time that messages take costs: steps, delay of the first useful reflection, and advice that comes too late.

``minimal_first_visbug_2_kbit`` in published.csv is ``minimal`` for the floor ``first``, the algorithm ``visbug`` and
the channel ``2 kbit/s``; the tests by such names are made at the end of this file.
"""

from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from cosim.report import estimate, estimates
from experiments.reflection_tables.comparison import NO_DATA, Answer, Arm, limits, saving, told, with_steps

FLOORS: Final = ("first", "second")
ALGORITHMS: Final = ("avoid_past", "visbug", "potential_field")
AT_ONCE: Final = "at once"
CHANNELS: Final = {"2_kbit": "2 kbit/s", "450_bit": "450 bit/s"}
PERIODS: Final = ("0.1 s", "1 s")
SLIGHT: Final = 0.1
"""A channel that costs less than this share of the steps costs next to nothing."""
AXES: Final = ("floor", "algorithm", "channel", "period")


def _arm(floor: str, algorithm: str, channel: str, period: str) -> Arm:
    return dict(zip(AXES, (floor, algorithm, channel, period), strict=True))


def minimal(floor: str, algorithm: str, channel: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether a slow link, at a frame a second, costs next to nothing against messages at once at every tick."""
    slow, at_once = _arm(floor, algorithm, channel, PERIODS[1]), _arm(floor, algorithm, AT_ONCE, PERIODS[0])
    found = limits(saving(with_steps(runs), slow, at_once))
    if not found.size:
        return NO_DATA
    return told(found), None if found.size < 2 else found.lower > -SLIGHT


def delay(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return the delay of the first useful reflection by channel and period."""
    return _by_channel(runs, "first_useful_reflection_s")


def stale(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return the share of advice that was stale on arrival by channel and period."""
    return _by_channel(runs, "stale_advice")


def _by_channel(runs: pd.DataFrame, metric: str) -> Answer:
    if not {metric, *AXES} <= set(runs):
        return NO_DATA
    means = runs.groupby(["channel", "period"], sort=False)[metric].mean().dropna()
    told_by = means.reset_index().itertuples(index=False)
    return ", ".join(f"{channel} every {period} {value:.3g}" for channel, period, value in told_by) or "-", None


def tables(runs: pd.DataFrame, observations: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Return what each channel costs against messages that arrive at once, sent at every tick."""
    frame = with_steps(runs)
    if "steps" not in frame or not set(AXES) <= set(frame):
        return {}
    rows = []
    for key, part in frame.groupby(list(AXES), sort=False):
        floor, algorithm, channel, period = map(str, key)
        against = limits(saving(frame, _arm(*map(str, key)), _arm(floor, algorithm, AT_ONCE, PERIODS[0])))
        row: dict[str, Any] = dict(zip(AXES, (floor, algorithm, channel, period), strict=True))
        row["steps a target"] = str(estimate(part["steps"]))
        row["against at once"] = told(against) if against.size and (channel, period) != (AT_ONCE, PERIODS[0]) else "-"
        rows.append(row)
    return {"steps a target: mean ± half of the 95 % confidence interval": pd.DataFrame(rows)}


def draw(runs: pd.DataFrame, observations: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw steps against the channel, a panel a floor, a line for each algorithm and period."""
    frame = with_steps(runs)
    if "steps" not in frame or not set(AXES) <= set(frame):
        return []
    places = {name: rank for rank, name in enumerate((AT_ONCE, *CHANNELS.values()))}
    figure = Figure(figsize=(11.0, 4.6), layout="constrained")
    plots = figure.subplots(1, len(FLOORS), squeeze=False)[0]
    for plot, floor in zip(plots, FLOORS, strict=True):
        arms = frame[frame["floor"] == floor].groupby(["algorithm", "period"], sort=False)
        for shift, ((algorithm, period), part) in enumerate(arms):
            points = estimates(part, ["channel"], ["steps"])
            at = [places[name] + 0.05 * shift for name in points["channel"]]
            means = [value.mean for value in points["steps"]]
            halves = np.nan_to_num([value.half for value in points["steps"]])
            style = "o-" if period == PERIODS[0] else "s--"
            colour = f"C{ALGORITHMS.index(str(algorithm))}"
            name = f"{str(algorithm).replace('_', ' ')}, a frame every {period}"
            plot.errorbar(at, means, yerr=halves, fmt=style, capsize=3, color=colour, label=name)
        plot.set(title=f"{floor} floor", ylabel="motion steps a target")
        plot.set_xticks(list(places.values()), list(places))
        plot.set_ylim(bottom=0)
        plot.grid(alpha=0.3)
    handles = {label: handle for plot in plots for handle, label in zip(*plot.get_legend_handles_labels(), strict=True)}
    figure.legend(list(handles.values()), list(handles), fontsize="small", loc="outside right center")
    path = folder / "steps_by_channel.png"
    figure.savefig(path, dpi=120)
    return [path]


# ---------------------------------------------------------------- the tests that published.csv names

globals().update(
    {
        f"minimal_{floor}_{algorithm}_{key}": partial(minimal, floor, algorithm, channel)
        for floor in FLOORS
        for algorithm in ALGORITHMS
        for key, channel in CHANNELS.items()
    }
)
