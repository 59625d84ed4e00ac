"""What each radio costs each task: claims of less than a tenth more time, the table of all cells, and its figure."""

import math
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from cosim.experiment import axis_titles
from cosim.report.comparison import Answer, Arm, by_replicate, less_censored, paired
from cosim.report.saving import save
from cosim.statistics.intervals import NOTHING, Estimate, estimate
from experiments.modern_radios.comparing import NO_CELL, RADIOS, TASKS, UNDISTURBED, Parameters, Radio, Task

TITLES: Final = axis_titles(Path(__file__).parent)
SLIGHT: Final = 1.1
"""Factor of a time that costs little."""
NEEDS_A_LINK: Final = "needs a link"
"""What a cell says over which a task cannot be done."""
LEAST: Final = 0.8
"""Lower end of the figure's axis."""
TICKS: Final = (0.8, 1.0, 1.2, 1.5, 2.0, 3.0, 4.0)
AIRS: Final = {"alone": "alone on the air", "others": "two pairs of each other technology beside it"}


def _arm(task: Task, radio: Radio, air: str = "alone") -> Arm:
    return {"task": task, "radio": radio, "air": air}


def costs_little(task: Task, radio: Radio, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return how many times as long a task takes over a radio, alone on the air, as with messages at once."""
    return less_censored(runs, [("", _arm(task, radio), _arm(task, "ideal"))], "time_s", SLIGHT, ended="done")


def undisturbed(task: Task, radio: Radio, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return how many times as long a task takes over a radio with others on the air as alone."""
    return less_censored(runs, [("", _arm(task, radio, "others"), _arm(task, radio))], "time_s", SLIGHT, ended="done")


# ---------------------------------------------------------------- the table and the figure


def times(runs: pd.DataFrame, task: Task, radio: Radio, air: str) -> Estimate:
    """Return how many times as long a cell's task takes as with messages that arrive at once: NOTHING without runs.

    It is the geometric mean of the replicates' ratios, with its 95 % confidence interval.
    """
    both = paired(runs, [_arm(task, radio, air), _arm(task, "ideal")], "time_s")
    if both.empty:
        return NOTHING
    found = estimate(np.log(both[0] / both[1]))
    return found._replace(mean=math.exp(found.mean), low=math.exp(found.low), high=math.exp(found.high))


def table(runs: pd.DataFrame) -> str:
    """Return the table of all cells in Markdown: times as long as at once, failures, energy; or why there is none."""
    lines = ["| radio | " + " | ".join(TITLES["task"].values()) + " |", "|---" * (len(TASKS) + 1) + "|"]
    omitted = []
    for radio in RADIOS:
        for air in AIRS:
            name = TITLES["radio"][radio] + ("" if air == "alone" else ", others on the air")
            if {_missing(task, radio, air) for task in TASKS} == {UNDISTURBED}:
                omitted.append(name)
                continue
            cells = [_cell(runs, task, radio, air) for task in TASKS]
            lines.append(f"| {name} | " + " | ".join(cells) + " |")
    reasons = {task: why for (task, _), why in NO_CELL.items()}
    told = "; ".join(f"{task}: {why}" for task, why in reasons.items())
    notes = f"*{NEEDS_A_LINK}*: {told}.", "", f"No rows: {'; '.join(omitted)} ({UNDISTURBED})."
    return "\n".join([*lines, "", *notes])


def _missing(task: Task, radio: Radio, air: str) -> str | None:
    return Parameters(task=task, radio=radio, air=air).missing()  # type: ignore[arg-type]


def _cell(runs: pd.DataFrame, task: Task, radio: Radio, air: str) -> str:
    if _missing(task, radio, air) is not None:
        return NEEDS_A_LINK
    ratio, arm = times(runs, task, radio, air), _arm(task, radio, air)
    done = by_replicate(runs, arm, "done")
    if not ratio.size or done.empty:
        return "no data"
    mean_s = by_replicate(runs, arm, "time_s").mean()
    text = f"{mean_s:.0f} s" if radio == "ideal" else f"x {ratio.mean:.2f} ({ratio.low:.2f} to {ratio.high:.2f})"
    failed = int((done < 1).sum())
    energy_j = by_replicate(runs, arm, "radio_energy_j").mean()
    text += f", {failed} of {len(done)} not done" if failed else ""
    return text + ("" if math.isnan(energy_j) else f", {energy_j:.0f} J")


def draw(runs: pd.DataFrame, observations: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw how many times as long each task takes over each radio, alone and with others; write the table beside it."""
    if runs.empty or not {"task", "radio", "air", "time_s"} <= set(runs):
        return []
    figure = Figure(figsize=(11.0, 4.2), layout="constrained")
    plots: Any = figure.subplots(1, len(TASKS), sharey=True)
    radios = RADIOS[1:]
    for plot, task in zip(plots, TASKS, strict=True):
        for shift, (air, label) in zip((-0.14, 0.14), AIRS.items(), strict=True):
            _draw_ratios(plot, runs, task, air, shift, label)
        for place, radio in enumerate(radios):
            if (task, radio) in NO_CELL:
                plot.annotate(
                    NEEDS_A_LINK, (place, 1.03), rotation=90, ha="center", va="bottom", fontsize=8, color="#555555"
                )
        plot.axhline(1.0, color="#888888", linewidth=1)
        plot.set(title=TITLES["task"][task], xlim=(-0.6, len(radios) - 0.4))
        plot.set_xticks(range(len(radios)), [TITLES["radio"][radio] for radio in radios], rotation=90)
        plot.grid(axis="y", alpha=0.3)
    plots[0].set_ylabel("times as long as with messages at once")
    plots[0].set_yscale("log")  # a ratio: half as long is as far from 1 as twice as long
    plots[0].set_ylim(bottom=LEAST)
    plots[0].set_yticks(TICKS, [f"{tick:g}" for tick in TICKS])
    plots[0].minorticks_off()
    figure.legend(*plots[0].get_legend_handles_labels(), loc="outside lower center", ncols=len(AIRS), fontsize="small")
    (folder / "modern_radios.md").write_text(table(runs) + "\n", encoding="utf-8")
    return [save(figure, folder / "modern_radios.png")]


def _draw_ratios(plot: Any, runs: pd.DataFrame, task: Task, air: str, shift: float, label: str) -> None:
    colour, marker = ("C0", "o") if air == "alone" else ("C3", "s")
    found = [(place, times(runs, task, radio, air)) for place, radio in enumerate(RADIOS[1:])]
    known = [(place + shift, ratio) for place, ratio in found if ratio.size]
    means = [ratio.mean for _, ratio in known]
    errors = [
        [ratio.mean - ratio.low if ratio.known else 0.0 for _, ratio in known],
        [ratio.high - ratio.mean if ratio.known else 0.0 for _, ratio in known],
    ]
    places = [place for place, _ in known]
    plot.errorbar(places, means, yerr=errors, fmt=marker, color=colour, capsize=3, markersize=4, label=label)


# ---------------------------------------------------------------- the tests that published.csv names


def _named(radio: str) -> str:
    return radio.replace(" ", "_").replace("802.11", "wifi_")


_CELLS: Final = [(task, radio) for task in TASKS for radio in RADIOS[1:] if (task, radio) not in NO_CELL]
globals().update({f"costs_little_{task}_{_named(radio)}": partial(costs_little, task, radio) for task, radio in _CELLS})
globals().update(
    {
        f"undisturbed_{task}_{_named(radio)}": partial(undisturbed, task, radio)
        for task, radio in _CELLS
        if _missing(task, radio, "others") is None
    }
)
