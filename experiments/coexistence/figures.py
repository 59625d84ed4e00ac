"""Losses beside what the station's frames let expect, and the claims that no single number decides."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from cosim.report.estimates import estimates
from cosim.report.saving import save

Answer = tuple[str, bool | None]

VALUES: Final = ["narrow_loss", "expected_narrow_loss", "pair_loss", "wide_loss", "wide_mbps"]
CLASSIC: Final = ("Bluetooth, short packets", "Bluetooth, long packets")
LE: Final = ("LE, short packets", "LE, long packets")
AFH: Final = "Bluetooth, short packets, AFH"
NEAR: Final = 0.01
"""Difference of shares that counts as none."""
UNKNOWN: Final[Answer] = ("-", None)


def _points(runs: pd.DataFrame) -> pd.DataFrame:
    """Return a row for each case and load with Estimates, by both; empty if columns are missing."""
    if runs.empty or not set(runs) >= {"case", "load", *VALUES}:
        return pd.DataFrame()
    return estimates(runs, ["case", "load"], VALUES).set_index(["case", "load"])


def _means(runs: pd.DataFrame, case: str, value: str) -> pd.Series:
    """Return the means of a value of a *case* by load; empty if there are none."""
    points = _points(runs)
    if points.empty or case not in points.index.get_level_values("case"):
        return pd.Series(dtype=float)
    return points.loc[case][value].map(lambda estimate: estimate.mean)


def _renewal(runs: pd.DataFrame, cases: Sequence[str]) -> Answer:
    points = _points(runs)
    if points.empty:
        return UNKNOWN
    return as_expected(points[points.index.get_level_values("case").isin(cases)])


def as_expected(points: pd.DataFrame) -> Answer:
    """Return at how many *points* links lose what is expected there: that is so if nine of ten are near, at least.

    Each has Estimates of ``narrow_loss`` and ``expected_narrow_loss``.
    """
    if points.empty:
        return UNKNOWN
    inside = [
        abs(ours.mean - expected.mean) <= max(NEAR, ours.half)
        for ours, expected in zip(points["narrow_loss"], points["expected_narrow_loss"], strict=True)
    ]
    return f"{sum(inside)} of {len(inside)} points", bool(sum(inside) >= 0.9 * len(inside))


def renewal_classic(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return at how many points Bluetooth loses what the station's frames let expect."""
    return _renewal(runs, CLASSIC)


def renewal_le(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return at how many points Bluetooth Low Energy loses what the station's frames let expect."""
    return _renewal(runs, LE)


def contrast(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return how many times as often as packets pairs fail under a station without pauses, of both kinds."""
    ratios = []
    for case in (CLASSIC[0], LE[0]):
        pairs, packets = _means(runs, case, "pair_loss"), _means(runs, case, "narrow_loss")
        if 1.0 not in pairs.index or not packets[1.0] > 0:
            return UNKNOWN
        ratios.append(pairs[1.0] / packets[1.0])
    return f"{ratios[0]:.2f} and {ratios[1]:.2f}", bool(ratios[0] >= 1.6 and ratios[1] <= 1.15)


def short_less(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return at how many loads short packets lose less than long ones."""
    fewer = [
        bool(short < long)
        for cases in (CLASSIC, LE)
        for load, short, long in _side_by_side(runs, *cases, "narrow_loss")
        if load < 1.0
    ]
    return (f"{sum(fewer)} of {len(fewer)} loads", all(fewer)) if fewer else UNKNOWN


def adapted(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return the greatest share of what is lost without AFH that is lost with it."""
    shares = [after / before for _, before, after in _side_by_side(runs, CLASSIC[0], AFH, "narrow_loss") if before > 0]
    return (f"{max(shares):.3f} at most", bool(max(shares) <= 0.1)) if shares else UNKNOWN


def distance_rule(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return what is lost where the rule says that the link does not hold, and where it does."""
    near, far = (_means(runs, f"OFDM at {metres} m", "narrow_loss") for metres in (48, 50))
    if near.empty or far.empty:
        return UNKNOWN
    return f"{near.min():.3f} at least, {far.max():.3f} at most", bool(near.min() > 0.01 and far.max() == 0.0)


def energy_detection(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return what the station carries where it hears the link, and where it does not."""
    near, far = (_means(runs, f"station at {metres} m", "wide_mbps") for metres in (12.3, 12.4))
    if 1.0 not in near.index or 1.0 not in far.index:
        return UNKNOWN
    return f"{near[1.0]:.3f} and {far[1.0]:.3f} Mb/s", bool(near[1.0] < far[1.0])


def robust_rate(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return what is lost at 11 Mb/s at least, and at 1 Mb/s at most."""
    found = _side_by_side(runs, "hearer at 11 Mb/s", "hearer at 1 Mb/s", "wide_loss")
    if not found:
        return UNKNOWN
    fast, slow = min(row[1] for row in found), max(row[2] for row in found)
    return f"{fast:.3f} at least, {slow:.3f} at most", bool(slow <= 0.1 * fast)


def more_links(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return what five links ruin of what independent ones would."""
    found = _side_by_side(runs, "hearer at 11 Mb/s", "hearer at 11 Mb/s, 5 links", "wide_loss")
    ratios = [five / (1.0 - (1.0 - one) ** 5) for _, one, five in found if one > 0]
    if not ratios:
        return UNKNOWN
    return f"{min(ratios):.2f} to {max(ratios):.2f} times", bool(min(ratios) >= 0.8 and max(ratios) <= 1.2)


def _side_by_side(runs: pd.DataFrame, one: str, other: str, value: str) -> list[tuple[float, float, float]]:
    """Return (load, mean of a value of *one* case, and of the *other*) for each load that both have."""
    left, right = _means(runs, one, value), _means(runs, other, value)
    return [(float(load), float(left[load]), float(right[load])) for load in left.index if load in right.index]


def draw(runs: pd.DataFrame, observations: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw what links lose over the load of the station, with what its frames let expect as lines."""
    points = _points(runs)
    if points.empty:
        return []
    figure = Figure(figsize=(6.4, 4.4), layout="constrained")
    plot: Any = figure.subplots()
    for rank, case in enumerate((*CLASSIC, *LE, AFH)):
        if case not in points.index.get_level_values("case"):
            continue
        part = points.loc[case]
        values = list(part["narrow_loss"])
        halves = [0.0 if np.isnan(value.half) else value.half for value in values]
        means = [value.mean for value in values]
        plot.errorbar(part.index, means, yerr=halves, fmt="o", color=f"C{rank}", capsize=3, label=case)
        if case != AFH:
            expected = [value.mean for value in part["expected_narrow_loss"]]
            plot.plot(part.index, expected, color=f"C{rank}", linewidth=1)
    plot.set(xlabel="load of a station of 802.11b at 11 Mb/s, frames of 1.31 ms", ylabel="share of packets lost")
    plot.set_ylim(bottom=0.0)
    plot.grid(alpha=0.3)
    plot.legend(fontsize="small")
    path = folder / "coexistence.png"
    save(figure, path)
    return [path]
