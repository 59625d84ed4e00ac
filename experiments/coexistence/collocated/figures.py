"""Pairs that fail, and the time that payloads take, over the load of a robot's own station; and the claims."""

from functools import partial
from pathlib import Path
from typing import Any, Final

import pandas as pd
from matplotlib.figure import Figure

from cosim.report.estimates import estimates
from cosim.report.saving import save
from cosim.statistics.intervals import Estimate
from experiments.coexistence.figures import UNKNOWN, Answer

VALUES: Final = ["pair_loss", "narrow_loss", "deaf_least", "deaf_most", "arrived", "delay_ms", "wide_loss", "wide_mbps"]
LINKS: Final = {"le": "Low Energy", "bluetooth": "Bluetooth"}
"""What claims call links, and what runs do."""
HEEDLESS, ARBITRATED = "heedless", "arbitrated"
FULL: Final = 1.0
"""The load of a station that makes no pauses."""
CLOSE_DB, FAR_DB = 10, 40
"""The least and the greatest isolation."""
DEAF_DB: Final = 30
"""Isolation up to which a radio is to be deaf on all channels."""


def _points(runs: pd.DataFrame, link: str, radios: str) -> pd.DataFrame:
    """Return a row of Estimates for each isolation and load, by both; empty if there are none."""
    if runs.empty or not set(runs) >= {"link", "radios", "isolation_db", "load", *VALUES}:
        return pd.DataFrame()
    chosen = runs[(runs["link"] == link) & (runs["radios"] == radios)]
    rows = estimates(chosen, ["isolation_db", "load"], VALUES)
    return rows.set_index(["isolation_db", "load"]).sort_index() if len(rows) else rows


def deaf(link: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return at how many points as many pairs fail as if a robot's station deafened its radio on all channels."""
    points = _points(runs, link, HEEDLESS)
    if points.empty:
        return UNKNOWN
    points = points[points.index.get_level_values("isolation_db") <= DEAF_DB]
    inside = [
        least.mean <= fails.mean <= most.mean
        for fails, least, most in zip(points["pair_loss"], points["deaf_least"], points["deaf_most"], strict=True)
    ]
    return (f"{sum(inside)} of {len(inside)} points", all(inside)) if inside else UNKNOWN


def isolated(link: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return at how many loads fewer pairs fail with more isolation, and how many at 40 dB beside packets."""
    points = _points(runs, link, HEEDLESS)
    if points.empty or not {CLOSE_DB, FAR_DB} <= set(points.index.get_level_values("isolation_db")):
        return UNKNOWN
    fewer, ratios = [], []
    for load in sorted(set(points.index.get_level_values("load"))):
        part = points.xs(load, level="load")
        fails = [estimate.mean for estimate in part["pair_loss"]]
        fewer.append(fails == sorted(fails, reverse=True) and fails[-1] < fails[0])
        packets = part["narrow_loss"][FAR_DB].mean
        ratios += [fails[-1] / packets] if packets > 0 else []
    held = all(fewer) and bool(ratios) and max(ratios) <= 2.0
    return f"{sum(fewer)} of {len(fewer)} loads; {max(ratios, default=0.0):.2f} times at most", held


def undisturbed(link: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return the greatest share of pairs that fail, and of frames that are lost, of radios that ask each other."""
    points = _points(runs, link, ARBITRATED)
    if points.empty:
        return UNKNOWN
    pairs, frames = (max(each.mean for each in points[value]) for value in ("pair_loss", "wide_loss"))
    return f"{pairs:.4f} and {frames:.4f} at most", bool(pairs == 0.0 and frames == 0.0)


def both_through(link: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return how long payloads take beside a station without pauses, and what it carries, without and with asking."""
    heedless, arbitrated = (_points(runs, link, radios) for radios in (HEEDLESS, ARBITRATED))
    at: Any = (CLOSE_DB, FULL)
    if heedless.empty or arbitrated.empty or at not in heedless.index or at not in arbitrated.index:
        return UNKNOWN
    before, after = heedless.loc[at], arbitrated.loc[at]
    long, short, arrived = (each.mean for each in (before["delay_ms"], after["delay_ms"], after["arrived"]))
    alone, carried = (each["wide_mbps"].mean for each in (before, after))
    held = long >= 10.0 * short and arrived >= 0.99 and carried >= 0.5 * alone
    return f"{long:.1f} and {short:.1f} ms, {alone:.2f} and {carried:.2f} Mb/s", bool(held)


_DECIDED: Final = {"deaf": deaf, "isolated": isolated, "undisturbed": undisturbed, "both_through": both_through}
globals().update(
    {f"{name}_{word}": partial(test, link) for name, test in _DECIDED.items() for word, link in LINKS.items()}
)


def draw(runs: pd.DataFrame, observations: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw which share of pairs fails, and how long payloads take, over the load of the own station, by link."""
    links = [link for link in LINKS.values() if not _points(runs, link, HEEDLESS).empty]
    if not links:
        return []
    figure = Figure(figsize=(9.2, 3.6 * len(links)), layout="constrained")
    for panels, link in zip(figure.subplots(len(links), 2, squeeze=False), links, strict=True):
        _draw_link(panels, runs, link)
    path = folder / "coexistence_collocated.png"
    save(figure, path)
    return [path]


def _draw_link(panels: Any, runs: pd.DataFrame, link: str) -> None:
    heedless, arbitrated = (_points(runs, link, radios) for radios in (HEEDLESS, ARBITRATED))
    for rank, isolation in enumerate(sorted(set(heedless.index.get_level_values("isolation_db")))):
        _line(panels, heedless.loc[isolation], f"heedless, {isolation:g} dB", f"C{rank}", "o")
    if not arbitrated.empty:
        closest = arbitrated.index.get_level_values("isolation_db").min()
        _line(panels, arbitrated.loc[closest], f"arbitrated, {closest:g} dB", "black", "s")
    for panel, label in zip(panels, ("share of packets and answers that fail", "time of a payload [ms]"), strict=True):
        panel.set(title=link, xlabel="load of the robot's own station of 802.11", ylabel=label)
        panel.grid(alpha=0.3)
        panel.legend(fontsize="small")
    panels[0].set_ylim(bottom=0.0)
    panels[1].set_yscale("log")


def _line(panels: Any, part: pd.DataFrame, label: str, color: str, style: str) -> None:
    for panel, value in zip(panels, ("pair_loss", "delay_ms"), strict=True):
        values: list[Estimate] = list(part[value])
        means, halves = [each.mean for each in values], [each.half for each in values]
        panel.errorbar(
            part.index, means, yerr=halves, fmt=f"{style}-", color=color, capsize=3, linewidth=1, label=label
        )
