"""The claims of paper 000, section 6, as one-sided tests, and Tables 1 and 2 and Figs 12 and 14 beside ours.

published.csv names a test for each floor, algorithm and team size: ``fewer_first_visbug`` is ``fewer`` for the floor
``first`` and the algorithm ``visbug``; the tests by such names are made at the end of this file.
"""

import math
from functools import partial
from itertools import combinations, pairwise
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from cosim.report.comparison import (
    NO_DATA,
    Answer,
    Arm,
    by_replicate,
    confidence_limits,
    log_spread,
    mean_ratio,
    saves,
    saving,
    saving_text,
)
from cosim.report.drawing import legend_outside
from cosim.report.estimates import estimates
from cosim.report.saving import save
from cosim.statistics.intervals import estimate
from experiments.reflection.choices import of_choice as of_choice  # by_choice asks for it
from experiments.reflection.tables import ALGORITHMS, FLOORS, LEAST, NAMES, SIZES, STEPS, cells, with_steps

ALIKE: Final = 1.3
"""Algorithms are alike if their steps differ by less than this factor: the curves that the paper calls very similar
differ by up to 1.28 (Table 1, four robots: 257.2 and 201.2), and those of smaller teams by 2.1 and 1.5."""
TICKS: Final = (100, 200, 300, 500, 1000, 2000)
"""Ticks of the axis of steps a target."""


def _arm(floor: str, algorithm: str, robots: int) -> Arm:
    return {"floor": floor, "algorithm": algorithm, "robots": robots}


# ---------------------------------------------------------------- claims


def fewer(floor: str, algorithm: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether each robot that is added saves steps."""
    sizes = [size for size in _sizes(runs) if size >= LEAST[algorithm]]
    pairs = [
        (f"{few} to {many} robots", _arm(floor, algorithm, many), _arm(floor, algorithm, few))
        for few, many in pairwise(sizes)
    ]
    return saves(with_steps(runs), pairs, STEPS)


def reduction(floor: str, algorithm: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether the largest team saves steps against the smallest that the paper has a number for."""
    pair = ("", _arm(floor, algorithm, SIZES[-1]), _arm(floor, algorithm, LEAST[algorithm]))
    return saves(with_steps(runs), [pair], STEPS)


def alike(robots: int, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether any two algorithms on the first floor differ by a factor below ``ALIKE`` (two one-sided tests)."""
    frame = with_steps(runs)
    words, inside = [], []
    for one, other in combinations(ALGORITHMS, 2):
        found = mean_ratio(frame, _arm("first", one, robots), _arm("first", other, robots), STEPS)
        if not found.size:
            return NO_DATA
        words.append(f"{one} / {other} {found.mean:.3g} ({found.lower:.3g} to {found.upper:.3g})")
        inside.append(None if found.size < 2 else found.lower > 1 / ALIKE and found.upper < ALIKE)
    return "; ".join(words), None if None in inside else all(inside)


def closer(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether on the first floor the algorithms differ less with three and with four robots than with two."""
    frame = with_steps(runs)
    widths = {size: log_spread(frame, [_arm("first", name, size) for name in ALGORITHMS], STEPS) for size in SIZES[1:]}
    if any(width.empty for width in widths.values()):
        return NO_DATA
    words = ", ".join(f"{size} robots: x {math.exp(width.mean()):.3g}" for size, width in widths.items())
    gains = [confidence_limits((widths[2] - widths[size]).dropna()) for size in SIZES[2:]]
    holds = None if any(gain.size < 2 for gain in gains) else all(gain.lower > 0 for gain in gains)
    return f"most over fewest steps: {words}", holds


def differ(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether on the second floor, with four robots, the algorithms still differ by a factor above ``ALIKE``."""
    width = confidence_limits(
        log_spread(with_steps(runs), [_arm("second", name, SIZES[-1]) for name in ALGORITHMS], STEPS)
    )
    if not width.size:
        return NO_DATA
    words = f"most over fewest steps: x {math.exp(width.mean):.3g}"
    if width.size < 2:
        return words, None
    return f"{words} (at least {math.exp(width.lower):.3g})", width.lower > math.log(ALIKE)


def visbug_gains_most(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether on the first floor VisBug gains a larger share by three helpers than the others do."""
    frame = with_steps(runs)
    shares = {
        name: saving(frame, _arm("first", name, SIZES[-1]), _arm("first", name, LEAST[name]), STEPS)
        for name in ALGORITHMS
    }
    if any(share.empty for share in shares.values()):
        return NO_DATA
    words = "; ".join(f"{name} {saving_text(confidence_limits(share))}" for name, share in shares.items())
    leads = [confidence_limits((shares["visbug"] - shares[name]).dropna()) for name in ALGORITHMS if name != "visbug"]
    return words, None if any(lead.size < 2 for lead in leads) else all(lead.lower > 0 for lead in leads)


def visbug_lowest(robots: int, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether VisBug needs fewer steps on the second floor than either of the others."""
    others = [name for name in ALGORITHMS if name != "visbug"]
    pairs = [(f"against {other}", _arm("second", "visbug", robots), _arm("second", other, robots)) for other in others]
    return saves(with_steps(runs), pairs, STEPS)


def alone_fails(floor: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether the potential field, alone, gives up targets."""
    found = confidence_limits(_given_up(runs, floor, 1))
    if not found.size:
        return NO_DATA
    words = f"{100 * found.mean:.3g} % of the targets given up"
    return words, None if found.size < 2 else found.lower > 0


def finishes(floor: str, algorithm: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether all targets are come to in all teams that the paper has a number for: one given up refutes it."""
    found = {size: _given_up(runs, floor, size, algorithm) for size in _sizes(runs) if size >= LEAST[algorithm]}
    found = {size: shares for size, shares in found.items() if not shares.empty}
    if not found:
        return NO_DATA
    words = ", ".join(f"R1 to R{size} {100 * shares.mean():.3g} %" for size, shares in found.items())
    return f"targets given up: {words}", all(bool((shares == 0).all()) for shares in found.values())


def rescues(floor: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether the potential field gives up a smaller share of its targets with helpers than alone."""
    alone = _given_up(runs, floor, 1)
    with_helpers = {size: _given_up(runs, floor, size) for size in _sizes(runs) if size > 1}
    gains = {size: confidence_limits((alone - shares).dropna()) for size, shares in with_helpers.items()}
    if not gains or not all(gain.size for gain in gains.values()):
        return NO_DATA
    words = ", ".join(f"{size} robots {round(100 * gain.mean, 9) + 0:.3g} points" for size, gain in gains.items())
    holds = None if any(gain.size < 2 for gain in gains.values()) else all(gain.lower > 0 for gain in gains.values())
    return f"fewer given up than alone: {words}", holds


def _given_up(runs: pd.DataFrame, floor: str, robots: int, algorithm: str = "potential_field") -> "pd.Series[float]":
    """Return the share of the targets that are given up, by replicate."""
    if not {"targets_given_up", "targets"} <= set(runs):
        return pd.Series(dtype=float)
    frame = runs.assign(given_up=runs["targets_given_up"] / runs["targets"])
    return by_replicate(frame, _arm(floor, algorithm, robots), "given_up")


def _sizes(runs: pd.DataFrame) -> list[int]:
    return sorted(int(size) for size in runs["robots"].unique()) if "robots" in runs else []


# ---------------------------------------------------------------- tables and figures


def tables(runs: pd.DataFrame, observations: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Return Tables 1 and 2 with ours beside the printed numbers, and the relative reductions."""
    frame = with_steps(runs)
    if "steps" not in frame or not {"floor", "algorithm", "robots", "targets_given_up"} <= set(frame):
        return {}
    frame = frame.assign(given_up_percent=100 * frame["targets_given_up"] / frame["targets"])
    printed = {(each.floor, each.algorithm, each.robots): each.steps for each in cells()}
    rows = []
    for key, part in frame.groupby(["floor", "algorithm", "robots"], sort=False):
        floor, algorithm, robots = key
        published = printed.get((str(floor), str(algorithm), int(str(robots))))
        rows.append(
            {"floor": floor, "algorithm": algorithm, "robots": robots}
            | {"published": "does not finish" if published is None else published}
            | {"ours": str(estimate(part["steps"])), "given up, %": str(estimate(part["given_up_percent"]))}
        )
    made = {"Tables 1 and 2: steps a target, mean ± half of the 95 % confidence interval": pd.DataFrame(rows)}
    reductions = [_reduction_row(frame, printed, floor, algorithm) for floor in FLOORS for algorithm in ALGORITHMS]
    title = "steps that the largest team saves against R1 (potential field: R1,2), with the one-sided 95 % limit"
    return made | {title: pd.DataFrame(reductions)}


def _reduction_row(
    frame: pd.DataFrame, printed: dict[tuple[str, str, int], float], floor: str, algorithm: str
) -> dict[str, str]:
    few, many = LEAST[algorithm], SIZES[-1]
    share = 1 - printed[floor, algorithm, many] / printed[floor, algorithm, few]
    ours = confidence_limits(saving(frame, _arm(floor, algorithm, many), _arm(floor, algorithm, few), STEPS))
    return {
        "floor": floor,
        "algorithm": algorithm,
        "published": f"saves {100 * share:.3g} %",
        "ours": saving_text(ours) if ours.size else "-",
    }


def draw(runs: pd.DataFrame, observations: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw Figs 12 and 14, steps against team size, ours as lines and theirs dashed."""
    frame = with_steps(runs)
    if "steps" not in frame or not {"floor", "algorithm", "robots"} <= set(frame):
        return []
    figure = Figure(figsize=(11.0, 4.6), layout="constrained")
    plots = figure.subplots(1, len(FLOORS), squeeze=False)[0]
    for plot, floor in zip(plots, FLOORS, strict=True):
        for rank, algorithm in enumerate(ALGORITHMS):
            part = frame[(frame["floor"] == floor) & (frame["algorithm"] == algorithm)]
            if not part.empty:
                points = estimates(part, ["robots"], ["steps"])
                halves = np.nan_to_num([value.half for value in points["steps"]])
                means = [value.mean for value in points["steps"]]
                name = NAMES[algorithm]
                plot.errorbar(points["robots"], means, yerr=halves, marker="o", capsize=3, color=f"C{rank}", label=name)
            theirs = [each for each in cells() if (each.floor, each.algorithm) == (floor, algorithm)]
            places, printed = [each.robots for each in theirs], [each.steps for each in theirs]
            plot.plot(places, printed, "s--", color=f"C{rank}", alpha=0.5, label=f"{NAMES[algorithm]}, paper")
        plot.set(title=f"{floor} floor", xlabel="robots", ylabel="motion steps a target", yscale="log")
        heights = [*frame.groupby(["floor", "algorithm", "robots"])["steps"].mean(), *(each.steps for each in cells())]
        plot.set_ylim(0.6 * min(heights), 1.6 * max(heights))  # a wide interval of a first look is cut
        plot.set_xticks(SIZES)
        plot.set_yticks(TICKS, map(str, TICKS))
        plot.minorticks_off()
        plot.grid(alpha=0.3)
    legend_outside(figure, plots)
    path = folder / "steps_beside_the_paper.png"
    save(figure, path)
    return [path, *_draw_reductions(frame, folder)]


def _draw_reductions(frame: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw the relative reductions from R1 (potential field: R1,2) to the largest team, ours beside theirs."""
    printed = {(each.floor, each.algorithm, each.robots): each.steps for each in cells()}
    arms = [(floor, name) for floor in FLOORS for name in ALGORITHMS]
    ours = [confidence_limits(saving(frame, _arm(*arm, SIZES[-1]), _arm(*arm, LEAST[arm[1]]), STEPS)) for arm in arms]
    if not any(each.size for each in ours):
        return []
    figure = Figure(figsize=(9.0, 4.2), layout="constrained")
    plot = figure.subplots()
    at = np.arange(len(arms))
    theirs = [100 * (1 - printed[(*arm, SIZES[-1])] / printed[(*arm, LEAST[arm[1]])]) for arm in arms]
    plot.plot(at - 0.1, theirs, "s", markerfacecolor="none", color="C3", markersize=9, label="paper")
    means = [100 * each.mean for each in ours]
    spread = [np.nan_to_num([100 * (each.mean - each.lower), 100 * (each.upper - each.mean)]) for each in ours]
    plot.errorbar(
        at + 0.1, means, yerr=np.transpose(spread), fmt="o", capsize=4, label="ours, with the one-sided 95 % limits"
    )
    plot.axhline(0, color="0.4", linewidth=0.8)
    teams = {1: "R1", 2: "R1,2"}
    labels = [f"{floor} floor\n{NAMES[name]}, {teams[LEAST[name]]}" for floor, name in arms]
    plot.set_xticks(at, labels, fontsize="small")
    plot.set_ylabel("% of the steps saved by four robots")
    plot.set_ylim(max(-105, plot.get_ylim()[0]), 105)  # the limits of a first look may lie far below
    plot.grid(alpha=0.3)
    plot.legend(fontsize="small")
    path = folder / "reductions_beside_the_paper.png"
    save(figure, path)
    return [path]


# ---------------------------------------------------------------- the tests that published.csv names

_BY_ARM: Final = (fewer, reduction, finishes)
_BY_FLOOR: Final = (alone_fails, rescues)
_BY_SIZE: Final = (alike, visbug_lowest)

globals().update(
    {
        f"{t.__name__}_{floor}_{name}": partial(t, floor, name)
        for t in _BY_ARM
        for floor in FLOORS
        for name in ALGORITHMS
    }
)
globals().update({f"{t.__name__}_{floor}": partial(t, floor) for t in _BY_FLOOR for floor in FLOORS})
globals().update({f"{t.__name__}_{size}": partial(t, size) for t in _BY_SIZE for size in SIZES})
