"""What piconets and a station lose over their number, and the claims that no single number decides."""

from pathlib import Path
from typing import Any, Final

import pandas as pd
from matplotlib.figure import Figure

from cosim.report.estimates import estimates
from cosim.report.saving import save
from experiments.coexistence.figures import UNKNOWN, Answer, as_expected

VALUES: Final = ["narrow_loss", "expected_narrow_loss", "wide_loss"]
ALL, AFH = "all channels", "AFH"
LOADED: Final = 0.7
FEW: Final = 10
"""Number of piconets up to which those that adapt are to leave the station's channels to it."""


def _points(runs: pd.DataFrame, hops: str) -> pd.DataFrame:
    """Return a row of Estimates for each load and number of links, by both; empty if there are none."""
    if runs.empty or not set(runs) >= {"hops", "links", "load", *VALUES}:
        return pd.DataFrame()
    return estimates(runs[runs["hops"] == hops], ["load", "links"], VALUES).set_index(["load", "links"]).sort_index()


def _loaded(runs: pd.DataFrame, hops: str, value: str) -> dict[int, float]:
    """Return the means of a value beside a station that sends, by the number of links."""
    points = _points(runs, hops)
    if points.empty or LOADED not in points.index.get_level_values("load"):
        return {}
    part = points.loc[LOADED]
    return {int(links): each.mean for links, each in zip(part.index, part[value], strict=True)}


def independent(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return what several piconets ruin of what independent ones would."""
    lost = _loaded(runs, ALL, "wide_loss")
    one = lost.pop(1, 0.0)
    ratios = [loss / (1.0 - (1.0 - one) ** links) for links, loss in lost.items() if one > 0]
    if not ratios:
        return UNKNOWN
    return f"{min(ratios):.2f} to {max(ratios):.2f} times", bool(min(ratios) >= 0.8 and max(ratios) <= 1.2)


def meetings(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return at how many points links lose what is expected of them."""
    return as_expected(_points(runs, ALL))


def spares_station(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return beside how many numbers of piconets the station loses fewer frames if they adapt."""
    return _less(runs, "wide_loss")


def spares_links(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return of how many numbers of piconets fewer packets are lost if they adapt."""
    return _less(runs, "narrow_loss")


def _less(runs: pd.DataFrame, value: str) -> Answer:
    found = _side_by_side(runs, value)
    fewer = [adapted < hopping for _, hopping, adapted in found]
    return (f"{sum(fewer)} of {len(fewer)} numbers", all(fewer)) if fewer else UNKNOWN


def gone(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return the greatest share of the frames ruined by a few piconets that they still ruin when they have adapted."""
    shares = [
        adapted / hopping
        for links, hopping, adapted in _side_by_side(runs, "wide_loss")
        if links <= FEW and hopping > 0
    ]
    return (f"{max(shares):.2f} at most", bool(max(shares) <= 0.5)) if shares else UNKNOWN


def _side_by_side(runs: pd.DataFrame, value: str) -> list[tuple[int, float, float]]:
    """Return (links, mean on all channels, mean with AFH) for each number of links that both have."""
    hopping, adapted = _loaded(runs, ALL, value), _loaded(runs, AFH, value)
    return [(links, loss, adapted[links]) for links, loss in hopping.items() if links in adapted]


def draw(runs: pd.DataFrame, observations: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw what the station and the links lose over the number of links, with what is expected as lines."""
    if _points(runs, ALL).empty:
        return []
    figure = Figure(figsize=(9.2, 4.0), layout="constrained")
    panels: Any = figure.subplots(1, 2)
    for hops, color in ((ALL, "C0"), (AFH, "C1")):
        points = _points(runs, hops)
        for load, style in ((LOADED, "o"), (0.0, "s")):
            if points.empty or load not in points.index.get_level_values("load"):
                continue
            part = points.loc[load]
            for panel, value in zip(panels, ("wide_loss", "narrow_loss"), strict=True):
                if value == "wide_loss" and load == 0.0:
                    continue
                beside = "" if value == "wide_loss" else f", {'beside' if load else 'without'} the station"
                means, halves = zip(*((each.mean, each.half) for each in part[value]), strict=True)
                label = f"{hops}{beside}"
                panel.errorbar(part.index, means, yerr=halves, fmt=style, color=color, capsize=3, label=label)
    _expected(panels, runs)
    for panel, lost in zip(panels, ("the station's frames", "the links' packets"), strict=True):
        panel.set(xlabel="links, each with a master of its own", ylabel=f"share of {lost} that is lost", xscale="log")
        panel.set_xticks(sorted(runs["links"].unique()), labels=[str(each) for each in sorted(runs["links"].unique())])
        panel.set_ylim(bottom=0.0)
        panel.minorticks_off()
        panel.grid(alpha=0.3)
        panel.legend(fontsize="small")
    path = folder / "coexistence_piconets.png"
    save(figure, path)
    return [path]


def _expected(panels: Any, runs: pd.DataFrame) -> None:
    """Draw what independent piconets would ruin, and what packets on all channels are expected to lose."""
    lost = _loaded(runs, ALL, "wide_loss")
    if 1 in lost:
        panels[0].plot([*lost], [1.0 - (1.0 - lost[1]) ** links for links in lost], color="C0", linewidth=1)
    points = _points(runs, ALL)
    for load in sorted(set(points.index.get_level_values("load"))):
        part = points.loc[load]["expected_narrow_loss"]
        panels[1].plot(part.index, [each.mean for each in part], color="C0", linewidth=1)
