import json
import math
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pandas as pd
import pytest
from matplotlib.figure import Figure

from cosim.errors import UserError
from cosim.report import drawing, sweep_report
from cosim.report.claims import Claim, Verdict, chance, judge, published_claims
from cosim.report.drawing import draw
from cosim.report.estimates import estimates
from cosim.report.page import limits_of
from cosim.report.sweep_report import Report, report
from cosim.results import RunStore, SweepDescription
from cosim.statistics.intervals import estimate

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
        # 4, 8, 12 of the three seeds: 8 ± 9.94, -1.94 to 17.94
        ({"where": "size == 4 and radio == 'near'", "test": "within 124 %"}, "open"),
        ({"where": "size == 4 and radio == 'near'", "test": "within 125 %"}, "holds"),
        ({"where": "size == 4 and radio == 'near'", "test": "within 5 %", "published": "18.8"}, "open"),
        ({"where": "size == 4 and radio == 'near'", "test": "within 4 %", "published": "18.8"}, "fails"),
        ({"where": "seed == 1", "test": "within 1 %", "published": "3.5"}, "open"),
        ({"where": "size == 4 and radio == 'near'", "test": "equal"}, "fails"),
        ({"quantity": "constant", "published": "3", "test": "equal"}, "holds"),
        # 3.5, 6.5, 9.5: 6.5 ± 7.45, -0.95 to 13.95
        ({"published": "-1", "test": "at least"}, "holds"),
        ({"published": "6.5", "test": "at least"}, "open"),
        ({"published": "14", "test": "at least"}, "fails"),
        ({"published": "14", "test": "at most"}, "holds"),
        ({"published": "6.5", "test": "at most"}, "open"),
        ({"published": "-1", "test": "at most"}, "fails"),
        ({"test": "not comparable: theirs had wheels"}, "not comparable"),
        ({"test": "not comparable: theirs had wheels", "quantity": "", "published": ""}, "not comparable"),
        ({"test": "not comparable: theirs had wheels", "where": "size == 8"}, "no data"),
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
        ("8.5 ± 9.9", "open")
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


@pytest.mark.slow
@pytest.mark.parametrize(("replicates", "missing"), [(3, 0), (10, 28)])
def test_a_report_of_a_sweep_that_is_not_whole_says_so(tmp_path: Path, replicates: int, missing: int):
    made = report(filled(tmp_path / "r", tmp_path, replicates=replicates))
    assert made.plain()["missing"] == missing
    assert ("12 of 40 runs are there: all this is of those alone" in made.text()) == (missing > 0)


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
    verdict = Verdict("linear", "so many words " * 20, "1 s", "2 s", "fails", "it is twice that")
    lines = Report("calls", verdicts=[verdict]).text().splitlines()
    assert lines[1].startswith("fails  linear: so many words")
    assert max(map(len, lines)) <= 110
    assert lines[-2:] == ["       published 1 s; ours 2 s", "       it is twice that"]
    verdict = Verdict("linear", "it is so", "1 s", "M=2 4, " * 30, "not comparable", "so many reasons " * 20)
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


CALM = [row | {"delay_s": 2.4 + 0.05 * (row["seed"] - 2), "late": row["seed"] > 0} for row in RUNS]
"""2.35, 2.4, 2.45 of the three seeds: 2.4 ± 0.1242 (t(0.975, 2) = 4.303)."""
QUARTER = 0.25
"""What a docstring of a test names."""


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        ({"published": "2.4", "test": "within 10 %"}, "all of the interval 2.276 to 2.524 is within 10 % of 2.4"),
        (
            {"published": "2.4", "test": "within 2 %"},  # (0.1242 / 0.048)^2 * 3 = 20.1
            "the interval 2.276 to 2.524 crosses the bound 2.352 (within 2 % of 2.4); about 21 replicates would decide",
        ),
        ({"published": "2", "test": "within 2 %"}, "no part of the interval 2.276 to 2.524 is within 2 % of 2"),
        (
            {"published": "2.4", "test": "at least"},
            "the interval 2.276 to 2.524 crosses the bound 2.4 (at least 2.4); "
            "no number of replicates would decide, as the mean lies practically on it",
        ),
        ({"where": "seed == 1", "test": "within 1 %"}, "a single replicate has no interval"),
        ({"where": "seed == 1", "test": "in the interval"}, "a single replicate has no interval"),
        (
            {"published": "2.5", "test": "in the interval"},
            "2.5 lies in the interval 2.276 to 2.524, which says little if that is wide",
        ),
        ({"quantity": "constant", "published": "3"}, "each of the 12 values is 3"),
        ({"quantity": "seed", "published": "3"}, "8 of the 12 values are not 3"),
        ({"where": "size == 8"}, "no run has a value of delay_s where size == 8"),
        ({"test": "not comparable: theirs had wheels"}, "theirs had wheels"),
        ({"test": "decide"}, "decide in figures.py finds that it holds: whether it is so in all of 0.25 runs"),
        ({"test": "refuse"}, "refuse in figures.py finds that it does not hold"),
        ({"test": "leave"}, "leave in figures.py leaves it open"),
        ({"test": "seek"}, "seek in figures.py finds no runs that it is about"),
    ],
)
def test_a_verdict_tells_its_reason_in_a_sentence(fields: dict[str, str], reason: str):
    def decide(bound: str, runs: pd.DataFrame, seen: pd.DataFrame) -> tuple[str, bool]:
        """Answer whether it is so in *bound* of ``QUARTER`` *runs*.

        More about it.
        """
        return "ours", True

    figures: Any = SimpleNamespace(
        decide=partial(decide, "all"),
        refuse=lambda runs, seen: ("ours", False),
        leave=lambda runs, seen: ("ours", None),
        seek=lambda runs, seen: ("-", None),
    )
    assert judge(claim(**fields), pd.DataFrame(CALM), pd.DataFrame(), figures).reason == reason


def test_what_always_happened_is_not_taken_for_certain():
    runs = pd.DataFrame([{"seed": seed, "delay_s": 1.0} for seed in range(50)])
    late = claim(quantity="delay_s <= 2.5", published="0.95", test="in the interval")
    found = judge(late, runs, pd.DataFrame(), None)  # 50 of 50: 50 / (50 + 1.96^2) = 0.9287
    assert (found.ours, found.verdict) == ("1 (0.929 to 1)", "holds")
    assert judge(late.model_copy(update={"published": "0.92"}), runs, pd.DataFrame(), None).verdict == "fails"
    assert judge(
        late.model_copy(update={"test": "within 1 %", "published": "1"}), runs, pd.DataFrame(), None
    ).verdict == ("open")


def test_the_failures_that_chance_explains_stand_beside_the_count():
    def told(test: str, *words: str) -> list[Verdict]:
        return [Verdict("a", "it is so", "1", "2", word, "it is", test) for word in words]

    judged = told("in the interval", *["holds"] * 18, "fails", "fails", "open", "no data") + told("equal", "fails")
    found = chance(judged)
    # of 20 at 5 %: 1 - 0.95^20 - 20 * 0.05 * 0.95^19
    assert found == pytest.approx((20, 2, 1.0, 1 - 0.95**20 - 0.95**19), rel=1e-12)
    lines = Report("calls", verdicts=judged).text()
    assert (
        "2 of 20 claims in the interval fail; chance alone fails 1 of them if all are true, and 2 or more with" in lines
    )
    assert Report("calls", verdicts=judged).plain()["chance"]["expected"] == pytest.approx(1.0)
    assert chance(told("equal", "fails")) is None
    assert Report("calls", verdicts=told("equal", "fails")).plain()["chance"] is None


def test_a_metric_of_ones_and_zeros_is_a_share_in_every_arm():
    rows = pd.DataFrame(
        [{"seed": seed, "arm": arm, "there": float(arm or seed > 4)} for arm in (0, 1) for seed in range(20)]
    )
    low, high = estimates(rows, ["arm"], ["there"])["there"]
    assert (low.mean, high.mean, high.high) == (0.75, 1.0, 1.0)
    assert high.low == pytest.approx(20 / (20 + 1.959964**2), rel=1e-6)
    assert str(estimates(rows[rows["arm"] == 1], ["arm"], ["there"])["there"][0]) == "1"  # a constant is none


@pytest.mark.parametrize(
    ("ours", "told"),
    [
        ("1.42 (1.27 to 1.57)", True),
        ("193.3 against 136.3 (x 1.42, 1.27 to 1.57)", True),
        ("96.7 % of 30 (85.1 to 99.8 %)", True),
        ("corridor 1.2e-05 (-1.5e-06 to 2.5e-05); office -", True),
        ("saves 65.1 % (at least 60 %)", True),
        ("saves 2.5 % (costs at most 17.5 %)", True),
        ("ring 2.44 against 8.36 (shorter by 5.3 at least)", True),
        ("1.857 ± 1.5", False),
        ("at least 60 %", False),
        ("0.5 to 0.7", False),
        ("M=2 3.286 (ideal 1.875)", False),
    ],
)
def test_what_limits_in_brackets_are_is_told_where_there_are_any(ours: str, told: bool):
    verdicts = [Verdict("a", "it is so", "1", ours, "holds", "it is", "decide")]
    assert ("one-sided at 95 %" in Report("calls", verdicts=verdicts).text()) is told
    assert bool(limits_of(verdicts)) is told
