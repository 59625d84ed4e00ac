"""Figures as files: what stands in the table is what was drawn, and the SVG belongs to the page around it."""

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from cosim.report.saving import MOST_POINTS, drawn, save


def lined(**labels: str) -> Figure:
    figure = Figure()
    plot = figure.subplots()
    plot.errorbar([1, 2], [10.0, 20.0], yerr=[[1, 2], [3, 4]], label=labels.get("first", "first"))
    plot.plot([1, 2], [5.0, 6.0], label="second")
    plot.set_title("above")
    return figure


def test_the_numbers_are_those_that_were_given_to_be_drawn():
    table = drawn(lined())
    first = table[table["series"] == "first"]
    assert first[["x", "y", "low", "high"]].to_numpy().tolist() == [[1, 10, 9, 13], [2, 20, 18, 24]]
    second = table[table["series"] == "second"]
    assert second[["x", "y"]].to_numpy().tolist() == [[1, 5], [2, 6]]
    assert second["low"].isna().all()
    assert set(table["panel"]) == {"above"}
    assert len(table) == 4  # no part of an interval counts as a line of its own


def test_a_point_without_a_place_or_an_interval_has_none():
    figure = Figure()
    figure.subplots().errorbar([1, 2, 3], [10.0, np.nan, 30.0], yerr=[[1, np.nan, np.nan], [2, np.nan, np.nan]])
    table = drawn(figure)
    assert table["y"].tolist()[::2] == [10, 30]
    assert table["low"].isna().tolist() == [False, True, True]


def test_bands_bars_and_marks_have_their_numbers():
    figure = Figure()
    band, bars, marks = figure.subplots(3)
    band.fill_between([1, 2, 3], [0, 1, 2], [5, 6, 7], label="between")
    band.set_title("band")
    bars.bar(["a", "b"], [3, 4], label="bars")
    bars.set_title("bars")
    marks.scatter([1, 2], [8, 9], label="marks")
    marks.set_title("marks")
    table = drawn(figure).set_index("panel")
    assert table.loc["band", ["x", "low", "high"]].to_numpy().tolist() == [[1, 0, 5], [2, 1, 6], [3, 2, 7]]
    assert table.loc["bars", ["x", "y"]].to_numpy().tolist() == [["a", 3], ["b", 4]]
    assert table.loc["marks", ["x", "y"]].to_numpy().tolist() == [[1, 8], [2, 9]]


def test_a_place_with_a_text_is_called_by_it_and_one_between_by_its_number():
    figure = Figure()
    plot = figure.subplots()
    plot.plot([0.1, 0.5, 0.9], [1, 2, 3])
    plot.set_xticks([0, 1], ["ring", "tree"])
    assert drawn(figure)["x"].tolist() == ["ring", 0.5, "tree"]


def test_of_very_many_points_the_table_has_evenly_chosen_ones():
    figure = Figure()
    figure.subplots().plot(np.arange(10 * MOST_POINTS), np.arange(10 * MOST_POINTS))
    assert np.diff(drawn(figure)["x"]).tolist() == [10] * (MOST_POINTS - 1)


def test_a_figure_becomes_three_files_the_same_each_time(tmp_path: Path):
    path = tmp_path / "cost.png"
    assert save(lined(), path) == path
    names = ("cost.svg", "cost.numbers.csv")
    first = [(tmp_path / name).read_bytes() for name in names]
    assert path.read_bytes().startswith(b"\x89PNG")
    assert pd.read_csv(tmp_path / "cost.numbers.csv").columns.tolist() == ["panel", "series", "x", "y", "low", "high"]
    save(lined(), path)
    assert [(tmp_path / name).read_bytes() for name in names] == first


def test_the_svg_has_its_text_as_text_and_the_colours_of_the_page(tmp_path: Path):
    save(lined(), tmp_path / "cost.png")
    svg = (tmp_path / "cost.svg").read_text(encoding="utf-8")
    assert svg.startswith("<svg ")
    assert ">above</text>" in svg
    assert not re.search("#000000|#ffffff(?!\\))", svg)
    assert "<style" not in svg
    assert "<metadata" not in svg


@pytest.mark.parametrize("name", ["<script>alert(1)</script>", "a & b", '"quoted"'])
def test_what_a_series_is_called_stays_text_in_the_svg(tmp_path: Path, name: str):
    figure = lined(first=name)
    figure.axes[0].legend()
    save(figure, tmp_path / "cost.png")
    svg = (tmp_path / "cost.svg").read_text(encoding="utf-8")
    assert "<script" not in svg
    assert name in [element.text for element in ET.fromstring(svg).iter() if element.text]
