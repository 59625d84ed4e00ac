import json
import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pandas as pd
import pytest
from matplotlib.figure import Figure

from cosim.errors import UserError
from cosim.report import drawing, sweep_report
from cosim.report.claims import Claim, Verdict, judge, published_claims
from cosim.report.drawing import draw
from cosim.report.estimates import estimate, estimates
from cosim.report.sweep_report import Report, report
from cosim.results import RunStore, SweepDescription

DESCRIPTION: dict[str, Any] = {
    "experiment": "calls",
    "axes": {"size": {"path": "team.size", "values": [2, 4]}, "radio": {"path": "radio", "values": ["near", "far"]}},
    "replicates": 10,
    "report": {"metrics": [], "x": None},
    "code": "k",
    "configurations": [f"{size}{radio}" for size in (2, 4) for radio in ("near", "far")],
}
RUNS = [
    {"experiment": "calls", "replicate": seed - 1, "configuration": f"{size}{radio}", "seed": seed, "code": "k"}
    | {"status": "done", "error": None, "wall_s": 0.1, "digest": "d", "size": size, "radio": radio}
    | {"delay_s": size * seed + (radio == "far"), "constant": 3.0}
    for size in (2, 4)
    for radio in ("near", "far")
    for seed in (1, 2, 3)
]


def described(**fields: Any) -> SweepDescription:
    return SweepDescription.model_validate(DESCRIPTION | fields)


def filled(folder: Path, source: Path, **description: Any) -> Path:
    store = RunStore(folder)
    with store.writing():
        store.describe(
            SweepDescription.model_validate(DESCRIPTION | {"source": str(source / "sweep.yaml")} | description)
        )
        store.append(RUNS, [], [], {})
    return folder


def claim(**fields: str) -> Claim:
    base = {"id": "a", "paper": "003", "section": "V", "claim": "it is so", "quantity": "delay_s", "where": ""}
    return Claim.model_validate(base | {"unit": "s", "published": "8", "test": "equal"} | fields)


FIGURES = """
constant = 3
def three():
    return 3
def fails(runs, seen):
    return runs['delay']
def single(runs, seen):
    return 1
def wordy(runs, seen):
    return 1, 'yes'
"""


def test_the_interval_is_students():
    # 1, 2, 3, 4, 5: mean 3, s = sqrt(2.5), t(0.975, 4) = 2.7764 (any table of Student's t)
    found = estimate(pd.Series([1.0, 2, 3, 4, 5, math.nan]))
    assert (found.mean, found.size) == (3, 5)
    assert found.half == pytest.approx(2.7764 * math.sqrt(2.5 / 5), rel=1e-4)


@pytest.mark.parametrize(
    ("values", "text"),
    [([], "-"), ([2.5], "2.5"), ([2.0, 2.0], "2"), ([math.nan], "-"), ([1.0, 3.0], "2 ± 13")],
)
def test_an_estimate_shows_only_what_it_knows(values: list[float], text: str):
    assert str(estimate(pd.Series(values, dtype=float))) == text


def test_estimates_come_by_arm():
    table = estimates(pd.DataFrame(RUNS), ["size", "radio"], ["delay_s"])
    assert table[["size", "radio", "n"]].to_numpy().tolist() == [
        [2, "near", 3],
        [2, "far", 3],
        [4, "near", 3],
        [4, "far", 3],
    ]
    assert [value.mean for value in table["delay_s"]] == [4, 5, 8, 9]


@pytest.mark.parametrize(
    ("fields", "verdict"),
    [
        ({"where": "size == 4 and radio == 'near'", "test": "within 1 %"}, "holds"),
        ({"where": "size == 4 and radio == 'far'", "test": "within 12 %"}, "fails"),
        ({"where": "size == 4 and radio == 'far'", "test": "within 12.5 %"}, "holds"),
        ({"where": "size == 4 and radio == 'near'", "test": "equal"}, "fails"),
        ({"quantity": "constant", "published": "3", "test": "equal"}, "holds"),
        ({"published": "6.5", "test": "at least"}, "holds"),
        ({"published": "6.6", "test": "at least"}, "fails"),
        ({"published": "6.5", "test": "at most"}, "holds"),
        ({"published": "6.4", "test": "at most"}, "fails"),
        ({"where": "size == 8"}, "no data"),
        ({"quantity": "nothing"}, "no data"),
        ({"test": "decide"}, "holds"),
        ({"test": "leave_open"}, "open"),
    ],
)
def test_claims_are_held_against_our_rows(fields: dict[str, str], verdict: str):
    figures: Any = SimpleNamespace(decide=lambda runs, seen: ("ours", True), leave_open=lambda runs, seen: (1, None))
    assert judge(claim(**fields), pd.DataFrame(RUNS), pd.DataFrame(), figures).verdict == verdict


def test_a_test_that_does_not_exist_is_told():
    with pytest.raises(UserError, match=r"published\.csv: a: test: 'about' is neither equal, within N %"):
        judge(claim(test="about"), pd.DataFrame(RUNS), pd.DataFrame(), None)


@pytest.mark.parametrize(
    ("fields", "told"),
    [
        ({"published": "x"}, "published: 'x' is not a finite number, which the test 'equal' compares ours with"),
        ({"published": ""}, "published: '' is not a finite number, which the test 'equal' compares ours with"),
        ({"published": "nan"}, "published: 'nan' is not a finite number, which the test 'equal' compares ours with"),
        ({"test": "within 1.2.3 %"}, "test: 'within 1.2.3 %' is neither equal, within N %, at least, at most,"),
        ({"id": ""}, "id: '': string should have at least 1 character"),
        ({"quantity": "1"}, "a: quantity: '1': gives no value for each row"),
        ({"quantity": "delay_s.head(2)"}, "a: quantity: 'delay_s.head(2)': gives no value for each row"),
        ({"quantity": "x = 1"}, "a: quantity: 'x = 1': gives no value for each row"),
        ({"quantity": "radio"}, "a: quantity: 'radio': could not convert string to float: "),
        ({"quantity": "((("}, "a: quantity: '(((': "),
        ({"quantity": "lambda: 1"}, "a: quantity: 'lambda: 1': 'Lambda' nodes are not implemented"),
        ({"where": "size"}, "a: where: 'size': is neither true nor false of each row"),
        ({"where": "nothing == 1"}, "a: where: 'nothing == 1': name 'nothing' is not defined"),
        ({"where": "import os"}, "a: where: 'import os': 'Import' nodes are not implemented"),
        ({"where": "x" * 5000}, "a: where: 'xxx"),
        ({"test": "nothing"}, "a: test: 'nothing' is neither equal, within N %,"),
        ({"test": "constant"}, "a: test: 'constant' is neither equal, within N %,"),
        ({"test": "three"}, "figures.py: three: TypeError: three() takes 0 positional arguments but 2 were given"),
        ({"test": "fails"}, "figures.py: line 6: fails: KeyError: 'delay'"),
        ({"test": "single"}, "figures.py: single: answers 1, expected (ours, whether the claim holds or None)"),
        ({"test": "wordy"}, "figures.py: wordy: answers (1, 'yes'), expected (ours, whether the claim holds or None)"),
    ],
)
def test_what_is_wrong_with_a_claim_is_told_in_one_line(tmp_path: Path, fields: dict[str, str], told: str):
    row = {name: value for name, value in dict(claim()).items() if name != "place"} | fields
    pd.DataFrame([row]).to_csv(tmp_path / "published.csv", index=False)
    (tmp_path / "figures.py").write_text(FIGURES)
    with pytest.raises(UserError) as raised:
        report(filled(tmp_path / "r", tmp_path))
    text = str(raised.value).removeprefix(f"{tmp_path}/").removeprefix("published.csv: line 2: ")
    assert text.startswith(told)
    assert "\n" not in text
    assert len(text) <= 250


@pytest.mark.parametrize(
    ("source", "told"),
    [
        ("def tables(:\n", "line 1: SyntaxError: invalid syntax"),
        ("import nothing_such\n", "line 1: ModuleNotFoundError: No module named 'nothing_such'"),
        ("\nx = 1 / 0\n", "line 2: ZeroDivisionError: division by zero"),
        (
            "def tables(runs, seen):\n    return runs.nothing\n",
            "line 2: tables: AttributeError: 'DataFrame' object has",
        ),
        ("def tables(runs, seen):\n    return 1\n", "tables: answers 1, expected a dict of titles and tables"),
        ("tables = 1\n", "tables: TypeError: 'int' object is not callable"),
        ("def draw(runs, seen, folder):\n    return folder\n", "draw: answers "),
    ],
)
def test_what_is_wrong_with_figures_is_told_with_its_line_and_keeps_its_cause(tmp_path: Path, source: str, told: str):
    (tmp_path / "figures.py").write_text(source)
    with pytest.raises(UserError) as raised:
        report(filled(tmp_path / "r", tmp_path))
    assert str(raised.value).startswith(f"{tmp_path / 'figures.py'}: {told}")
    assert ("Error" in told) == (raised.value.__cause__ is not None)


def test_an_expression_sees_columns_and_nothing_of_this_program():
    sly = claim(quantity="@importlib.import_module('os').getpid() + delay_s")
    assert judge(sly, pd.DataFrame(RUNS), pd.DataFrame(), None).verdict == "no data"


@pytest.mark.parametrize("text", [b"\xff\xfe", b"id,paper\n1,2\n", b"id\0,paper\n\0", b'"' + b"x" * 140_000])
def test_a_file_that_is_no_table_of_claims_is_told(tmp_path: Path, text: bytes):
    (tmp_path / "published.csv").write_bytes(text)
    with pytest.raises(UserError, match=r"published\.csv: ") as raised:
        published_claims(tmp_path)
    assert "\n" not in str(raised.value)


@pytest.mark.slow
def test_a_report_has_tables_claims_and_figures(tmp_path: Path):
    source = tmp_path / "experiment"
    source.mkdir()
    header = "id,paper,section,claim,quantity,where,unit,published,test\n"
    (source / "published.csv").write_text(header + "a,003,V,it is so,delay_s,size == 4,s,8.5,within 1 %\n")
    (source / "figures.py").write_text(
        "def tables(runs, seen):\n    return {'extra': runs[['size']].drop_duplicates()}\n"
    )
    folder = filled(tmp_path / "r", source)
    made = report(folder)
    (table, extra) = made.tables.values()
    assert list(table.columns) == ["size", "radio", "n", "delay_s"]  # what does not vary is not shown
    assert table["delay_s"].tolist()[0] == "4 ± 5"  # 2, 4, 6: t(0.975, 2) * 2 / sqrt(3) = 4.97
    assert extra["size"].tolist() == [2, 4]
    assert [(verdict.ours, verdict.verdict) for verdict in made.verdicts] == [
        ("8.5 ± 9.9", "holds")
    ]  # 4.5, 8.5, 12.5 of the three seeds: t(0.975, 2) * 4 / sqrt(3) = 9.94
    assert made.figures == [folder / "delay_s.png"]
    assert made.figures[0].read_bytes().startswith(b"\x89PNG")
    assert f"figure: {folder / 'delay_s.png'}" in made.text()
    assert json.loads(json.dumps(made.plain()))["published"][0]["published"] == "8.5 s"


@pytest.mark.slow
def test_named_metrics_are_shown_even_if_they_do_not_vary(tmp_path: Path):
    folder = filled(tmp_path / "r", tmp_path, report={"metrics": ["constant"], "x": "radio"})
    (table,) = report(folder).tables.values()
    assert list(table.columns) == ["size", "radio", "n", "constant"]


def test_failed_runs_are_counted_and_left_out(tmp_path: Path):
    folder = tmp_path / "r"
    store = RunStore(folder)
    with store.writing():
        store.describe(described(source=str(tmp_path / "sweep.yaml")))
        store.append([row | {"status": "failed", "delay_s": None, "constant": None} for row in RUNS], [], [], {})
    made = report(folder)
    assert made.tables == {}
    assert "12 runs failed" in made.text()


def test_a_published_file_without_its_columns_is_told(tmp_path: Path):
    (tmp_path / "published.csv").write_text("id,paper\na,003\n")
    with pytest.raises(UserError, match=r"published\.csv: line 2: expected the columns id, paper, section"):
        report(filled(tmp_path / "r", tmp_path, report={"metrics": [], "x": None}))


def test_a_report_of_nothing_says_so(tmp_path: Path):
    with pytest.raises(UserError, match="holds no results"):
        report(tmp_path)
    assert Report("calls").text() == "calls: no runs"


def test_figures_can_be_fewer_than_the_columns_of_the_table(tmp_path: Path):
    folder = filled(tmp_path / "r", tmp_path, report={"metrics": [], "figures": ["delay_s"], "x": None})
    assert [path.name for path in report(folder).figures] == ["delay_s.png"]


def test_a_claim_is_wrapped_and_led_by_its_verdict():
    verdict = Verdict("linear", "so many words " * 20, "1 s", "2 s", "fails")
    lines = Report("calls", verdicts=[verdict]).text().splitlines()
    assert lines[1].startswith("fails  linear: so many words")
    assert max(map(len, lines)) <= 110
    assert lines[-1] == "       published 1 s; ours 2 s"
    verdict = Verdict("linear", "it is so", "1 s", "M=2 4, " * 30, "open")
    assert max(map(len, Report("calls", verdicts=[verdict]).text().splitlines())) <= 110


def test_another_sweep_in_an_experiments_folder_is_not_held_against_its_claims(tmp_path: Path):
    source = tmp_path / "source"
    source.mkdir()
    (source / "published.csv").write_text("nonsense\n1\n", encoding="utf-8")
    store = RunStore(tmp_path / "results")
    with store.writing():
        store.describe(described(source=str(source / "sensitivity.yaml")))
    assert report(tmp_path / "results").verdicts == []
    with store.writing():
        store.describe(described(source=str(source / "sweep.yaml")))
    with pytest.raises(UserError, match="line 2"):
        report(tmp_path / "results")


@pytest.fixture
def drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Return a function that draws like ``draw`` and returns the panels."""
    made: list[Figure] = []

    def remembered(*args: Any, **settings: Any) -> Figure:
        made.append(Figure(*args, **settings))
        return made[-1]

    monkeypatch.setattr(drawing, "Figure", remembered)

    def panels(rows: pd.DataFrame, axes: list[str], panel: str | None = None) -> list[Any]:
        draw(rows, axes, "delay_s", "size", tmp_path, panel)
        return made[-1].axes

    return panels


def legend(plot: Any) -> list[str]:
    return [text.get_text() for text in plot.get_legend().get_texts()]


def test_a_figure_has_ticks_where_runs_were_and_starts_at_zero(drawn: Any):
    rows = pd.DataFrame(RUNS)
    (plot,) = drawn(rows, ["size", "radio"])
    assert plot.get_xticks().tolist() == [2, 4]
    assert plot.get_ylim()[0] == 0
    (plot,) = drawn(rows.assign(delay_s=rows["delay_s"] - 6), ["size", "radio"])
    assert plot.get_ylim()[0] < -2  # the mean of the near ones is -2


def test_arms_without_a_value_are_neither_drawn_nor_named(drawn: Any):
    rows = pd.DataFrame(RUNS)
    (plot,) = drawn(rows.assign(delay_s=rows["delay_s"].where(rows["radio"] == "far")), ["size", "radio"])
    assert len(plot.containers) == 1
    both = pd.concat([rows.assign(floor="a"), rows.assign(floor="b"), rows.assign(floor="c", delay_s=math.nan)])
    assert [plot.get_title() for plot in drawn(both, ["size", "radio", "floor"])] == ["floor a", "floor b"]


def test_the_panels_are_those_of_the_axis_that_the_experiment_names(drawn: Any):
    rows = pd.concat([pd.DataFrame(RUNS).assign(floor=floor) for floor in "ab"])
    plots = drawn(rows, ["size", "floor", "radio"])
    assert [plot.get_title() for plot in plots] == ["radio near", "radio far"]
    plots = drawn(rows, ["size", "floor", "radio"], panel="floor")
    assert [plot.get_title() for plot in plots] == ["floor a", "floor b"]
    assert [plot.get_ylabel() for plot in plots] == ["delay_s", ""]
    assert legend(plots[-1]) == ["near", "far"]
    assert [plot.get_title() for plot in drawn(rows, ["size", "radio"], panel="radio")] == ["radio near", "radio far"]


def test_an_arm_has_the_same_colour_in_every_panel_and_is_named_if_it_is_in_any(drawn: Any):
    rows = pd.concat([pd.DataFrame(RUNS).assign(floor=floor) for floor in "ab"])
    rows = rows[(rows["floor"] == "a") | (rows["radio"] == "far")]
    left, right = drawn(rows, ["size", "floor", "radio"], panel="floor")
    assert right.containers[0].lines[0].get_color() == left.containers[1].lines[0].get_color()
    assert legend(right) == ["near", "far"]


def test_the_report_takes_the_panel_from_the_sweep_and_draws_nothing_where_nothing_is_known(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    told: list[Any] = []
    monkeypatch.setattr(sweep_report, "draw", lambda *given: told.append((given[2], given[-1])) or tmp_path)
    store = RunStore(tmp_path / "r")
    shown = {"metrics": ["delay_s", "constant"], "x": "size", "panel": "radio"}
    with store.writing():
        store.describe(described(source=str(tmp_path / "sweep.yaml"), report=shown))
        store.append([row | {"constant": math.nan} for row in RUNS], [], [], {})
    report(tmp_path / "r")
    assert told == [("delay_s", "radio")]


def test_functions_are_not_asked_about_runs_that_are_not_there():
    figures: Any = SimpleNamespace(decide=lambda runs, seen: (runs["delay_s"].mean(), True))
    assert judge(claim(test="decide"), pd.DataFrame(), pd.DataFrame(), figures).verdict == "no data"
    silent: Any = SimpleNamespace(decide=lambda runs, seen: ("-", None))
    assert judge(claim(test="decide"), pd.DataFrame(RUNS), pd.DataFrame(), silent).verdict == "no data"
