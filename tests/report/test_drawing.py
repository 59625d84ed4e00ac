"""Figures of sweeps: shares over time, and panels of a metric over an axis."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from cosim.report.drawing import draw_panels, draw_shares, share_over_time

NONE = pd.DataFrame()
KNOWN = {f"seen_{percent}_s": percent / 100 for percent in range(10, 100, 10)} | {"time_99_s": 0.99}
END = ("simulated_s", "coverage")
LINES = ("algorithm", {"schemas": "motor schemas", "nearest": "nearest frontier"})
PANELS = ("map", {"empty": "empty map", "corridor": "corridor with rooms", "office": "office"})
ROWS = ("robots", {1: "1 robot", 4: "4 robots", 8: "8 robots"})


def row(pace_s: float, ended_s: float, coverage: float, **axes: Any) -> dict[str, Any]:
    """Return a run that sees a hundredth of the floor in every *pace_s*, until it has seen *coverage*."""
    times = {name: 100 * share * pace_s if share <= coverage else math.nan for name, share in KNOWN.items()}
    return axes | times | {"simulated_s": ended_s, "coverage": coverage}


def test_the_curve_of_a_run_passes_through_all_that_its_row_tells():
    run = pd.Series(row(10.0, 800.0, 0.64))

    def shares_at(times_s: list[float]) -> list[float]:
        return [float(share) for share in share_over_time(run, KNOWN, END, np.array(times_s))]

    assert shares_at([0.0, 50.0, 100.0, 250.0, 600.0]) == pytest.approx([0, 0.05, 0.1, 0.25, 0.6])
    # from 60 % on nothing is told but where it ended, 200 s and four hundredths later
    assert shares_at([700.0, 800.0, 9000.0]) == pytest.approx([0.62, 0.64, 0.64])


@pytest.fixture
def runs() -> pd.DataFrame:
    paces = {"schemas": 10.0, "nearest": 8.0}
    rows = [
        row(pace * (1 + replicate / 10) / robots, 1500.0, 1.0, map=floor, algorithm=name, robots=robots)
        | {"replicate": replicate, "until_95_s": 95 * pace / robots, "covered_twice": 0.1 * robots}
        for floor in ("empty", "office")
        for name, pace in paces.items()
        for robots in (1, 4)
        for replicate in range(4)
    ]
    return pd.DataFrame(rows)


def drawn(runs: pd.DataFrame, folder: Path, monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Return the panels of the figure of the share over time."""
    kept: list[Any] = []
    monkeypatch.setattr("cosim.report.drawing.save", lambda figure, path: kept.extend(figure.axes))
    draw_shares(runs, folder / "curves.png", ("share", KNOWN, END), LINES, PANELS, ROWS)
    return kept


def test_shares_over_time_have_a_panel_for_each_value_of_two_axes_that_was_run_and_a_line_for_each_of_a_third(
    runs: pd.DataFrame, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    panels = drawn(runs, tmp_path, monkeypatch)
    titles = ["empty map, 1 robot", "office, 1 robot", "empty map, 4 robots", "office, 4 robots"]
    assert [panel.get_title() for panel in panels] == titles
    for panel in panels:
        assert [line.get_label() for line in panel.get_lines()] == list(LINES[1].values())


def test_all_points_stand_inside_the_panels_of_the_time_by_size(
    runs: pd.DataFrame, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    kept: list[Any] = []
    monkeypatch.setattr("cosim.report.drawing.save", lambda figure, path: kept.extend(figure.axes))
    runs.loc[runs["map"] == "office", "until_95_s"] *= 5.0  # the last panel has the largest
    draw_panels(runs, tmp_path / "x.png", ("until_95_s", "s"), ("robots", (1, 4)), LINES, PANELS)
    assert len(kept) == 2
    for panel in kept:
        assert panel.get_ylim()[0] == 0.0 < 5 * 950 <= panel.get_ylim()[1]


def test_its_lines_are_medians_in_the_band_of_the_middle_half(
    runs: pd.DataFrame, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    panel = drawn(runs, tmp_path, monkeypatch)[0]
    line, band = panel.get_lines()[0], panel.collections[0].get_paths()[0].vertices
    times, median = line.get_data()
    assert times[-1] == pytest.approx(99 * 13.0)  # the slowest of schemas, 13 s a hundredth
    middle = np.searchsorted(times, 400.0)
    at = times[middle]
    shares = np.sort([at / pace / 100 for pace in (10.0, 11.0, 12.0, 13.0)])
    assert median[middle] == pytest.approx(np.median(shares))
    heights = np.sort(np.unique(band[np.isclose(band[:, 0], at), 1].round(9)))
    assert heights.tolist() == pytest.approx(np.percentile(shares, [25, 75]).tolist())


def test_results_without_what_the_curves_need_have_none(runs: pd.DataFrame, tmp_path: Path):
    path, shares = tmp_path / "curves.png", ("share", KNOWN, END)
    assert draw_shares(NONE, path, shares, LINES, PANELS, ROWS) == []
    assert draw_shares(runs.drop(columns="seen_30_s"), path, shares, LINES, PANELS, ROWS) == []
    assert draw_shares(runs, path, shares, LINES, PANELS, ("robots", {8: "8 robots"})) == []
    assert not list(tmp_path.iterdir())
