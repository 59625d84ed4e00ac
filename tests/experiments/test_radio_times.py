"""inquiry_time and page_time: what their rows hold, and laws that the times must obey."""

import csv
import math
from pathlib import Path
from types import ModuleType

import numpy as np
import pandas as pd
import pytest
from pydantic import ValidationError

from cosim.errors import UserError
from cosim.experiment import load_experiment
from cosim.randomness import Streams
from cosim.report.sweep_report import Report, report
from cosim.sweep import run_sweep
from cosim.units import TICK, S
from experiments.inquiry_time import discovery
from experiments.inquiry_time import figures as discovery_figures
from experiments.page_time import figures as paging_figures
from experiments.page_time import paging
from tests.checkout import EXPERIMENTS


def scan(version: str = "1.2", interlaced: bool = False, interval_s: float = 1.28) -> dict[str, object]:
    return {"version": version, "interlaced": interlaced, "interval_s": interval_s}


def distance(times_s: list[float], corners: list[tuple[float, float]]) -> float:
    """Kolmogorov and Smirnov's distance of *times_s* from the distribution function through the *corners*."""
    found = np.sort(np.array(times_s))
    x, y = zip(*corners, strict=True)
    expected = np.interp(found, x, y)
    steps = np.arange(len(found) + 1) / len(found)
    return float(max((steps[1:] - expected).max(), (expected - steps[:-1]).max()))


def swept(name: str, sets: list[str], folder: Path, replicates: int = 3) -> Report:
    experiment = load_experiment(EXPERIMENTS / name / "sweep.yaml", sets, quick=True, replicates=replicates)
    assert run_sweep(experiment, folder, jobs=1).failures == ()
    return report(folder)


# ---------------------------------------------------------------- inquiry_time


@pytest.mark.slow
def test_a_row_of_inquiry_time_is_a_scanner():
    given = {"scan": scan("1.1", interval_s=2.56), "drift_ppm": 20, "scanners": 3, "inquiries": 2, "duration_s": 30.72}
    rows = discovery.observe(given, 5)
    assert [(row["inquiry"], row["scanner"]) for row in rows] == [(n, k) for n in (0, 1) for k in (1, 2, 3)]
    assert {(row["version"], row["interlaced"], row["scan_interval_s"], row["drift_ppm"]) for row in rows} == {
        ("1.1", False, 2.56, 20)
    }
    assert len({row["discovery_time_s"] for row in rows}) == 6
    assert all(0.001 < row["discovery_time_s"] < 30.73 for row in rows if not math.isnan(row["discovery_time_s"]))
    assert repr(discovery.observe(given, 5)) == repr(rows)  # NaN does not equal itself
    assert repr(discovery.observe(given, 6)) != repr(rows)


@pytest.mark.slow
def test_who_is_not_found_has_no_time():
    # a window every 2.56 s meets a tenth of a second in 4 %
    rows = discovery.observe({"scan": scan(interval_s=2.56), "duration_s": 0.1, "inquiries": 50}, 1)
    found = [row for row in rows if not math.isnan(row["discovery_time_s"])]
    assert len(found) < 10
    assert all(row["discovery_time_s"] <= 0.1 + 2 * TICK / S + 366e-6 for row in found)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("settings", "corners"),
    [
        # a window a scan interval; the right train is on at once in half of all cases, else after 2.56 s
        (scan(), [(0, 0), (1.28, 0.5), (2.56, 0.5), (3.84, 1)]),
        # two windows back to back, one of them in the right train
        (scan(interlaced=True), [(0, 0), (1.28, 1)]),
        # the window comes once a train, and in every second one of them it is the right one
        (scan(interval_s=2.56), [(0, 0), (5.12, 1)]),
    ],
    ids=["v1.2", "interlaced", "2.56 s"],
)
def test_discovery_times_of_v12_are_straight_lines(settings: dict[str, object], corners: list[tuple[float, float]]):
    """A scanner answers the first ID that it hears, in a window at a random place."""
    rows = discovery.observe({"scan": settings, "inquiries": 1200}, 2)
    times = [row["discovery_time_s"] for row in rows]
    # Kolmogorov: 1.63 / sqrt(n) at 1 %; a discovery comes up to a window and a half, 18 ms, after its place
    assert distance(times, corners) < 1.63 / math.sqrt(len(times)) + 0.018 / 1.28


@pytest.mark.slow
def test_a_back_off_before_the_answer_delays_v11_by_a_third_of_a_second_at_least_on_average():
    # the same windows, and then 0 to 1023 slots, 0.32 s on average, before the second ID
    old, new = (
        np.median([row["discovery_time_s"] for row in discovery.observe({"scan": scan(v), "inquiries": 400}, 3)])
        for v in ("1.1", "1.2")
    )
    assert old > new + 0.3


@pytest.mark.parametrize("bad", [{"scan": scan("1.1", interlaced=True)}, {"drift_ppm": 300}, {"scanners": 0}])
def test_what_an_inquiry_cannot_be_is_refused(bad: dict[str, object]):
    with pytest.raises(ValidationError):
        discovery.Parameters.model_validate(bad)


def test_an_axis_with_a_procedure_that_does_not_exist_is_told_before_anything_runs():
    with pytest.raises(UserError, match=r"interlaced: True is not known to version 1\.1"):
        load_experiment(EXPERIMENTS / "inquiry_time" / "sweep.yaml", ["scan={version: '1.1', interlaced: true}"])


@pytest.mark.slow
def test_inquiry_time_is_reported(tmp_path: Path):
    made = swept("inquiry_time", ["inquiries=30", "drift_ppm=0"], tmp_path)
    found = {verdict.id: verdict for verdict in made.verdicts}
    assert found["model_v12"].verdict == "open"  # 3 runs do not decide
    assert "replicates would decide" in found["model_v12"].reason
    assert found["v11"].verdict == "no data"  # asks for drift
    assert {path.name for path in made.figures} == {"discovery_time_s.png", "discovery_time_distribution.png"}
    (table,) = made.tables.values()
    assert table["n"].tolist() == [90] * 6  # three procedures, two intervals, 3 runs of 30


def test_late_and_locked_devices_are_counted_with_those_that_are_never_found():
    times = [1.0, 6.0, math.nan, 60.0]
    rows = pd.DataFrame({"discovery_time_s": times, "procedure": "v1.1", "version": "1.1", "interlaced": False})
    near = rows.assign(scan_interval_s=1.28, drift_ppm=0)
    far = rows.assign(scan_interval_s=2.56, drift_ppm=20)
    both = pd.concat([near, far])
    nothing = pd.DataFrame()
    assert discovery_figures.late_v11(nothing, both)[0].startswith("0.75 (0.301 to 0.954)")
    assert discovery_figures.late_v12(nothing, both) == ("-", None)
    assert discovery_figures.phase_locked(nothing, both) == ("-", None)  # none without drift
    assert discovery_figures.phase_locked(nothing, far.assign(drift_ppm=0))[1] is False
    assert discovery_figures.not_found_by_drift(nothing, both)[0].startswith("20 ppm 0.5 ± ")


# ---------------------------------------------------------------- page_time


@pytest.mark.slow
@pytest.mark.parametrize("estimate", ["exact", "random"])
def test_responses_start_a_slot_after_an_id(estimate: str):
    """IDs start at ticks 0 and 1 of every four of the pager; the response starts 625 us after the one that is heard."""
    rows = paging.observe({"mode": "R0", "estimate": estimate, "pages": 40}, 1)
    ticks = [(row["page_time_s"] * S) / TICK - 2 for row in rows]
    assert all(abs(tick - round(tick)) < 1e-3 and round(tick) % 4 in (0, 1) for tick in ticks)
    assert len({round(tick) for tick in ticks}) > 5
    waits = [row["page_time_from_command_s"] - row["page_time_s"] for row in rows]
    assert all(0 <= wait <= 4 * TICK / S for wait in waits)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mode", "estimate", "end_s"),
    [("R1", "exact", 1.28), ("R1", "random", 2.56), ("R2", "exact", 2.56), ("R2", "random", 5.12)],
)
def test_page_times_are_uniform_up_to_one_interval_or_two(mode: str, estimate: str, end_s: float):
    rows = paging.observe({"mode": mode, "estimate": estimate, "pages": 400}, 4)
    times = [row["page_time_s"] for row in rows if not math.isnan(row["page_time_s"])]
    assert len(times) >= 395
    assert distance(times, [(0, 0), (end_s, 1)]) < 1.63 / math.sqrt(len(times)) + 0.018 / end_s


@pytest.mark.slow
def test_a_page_that_is_not_answered_has_no_time():
    rows = paging.observe({"mode": "R1", "timeout_slots": 16, "pages": 30}, 1)  # 10 ms
    times = [row["page_time_s"] for row in rows]
    assert sum(math.isnan(time) for time in times) > 20
    assert paging.page_times(paging.Parameters(mode="R0"), Streams(1), 0).from_slot_s < 0.02


def test_shares_of_pages_without_an_answer_are_told_by_mode():
    rows = pd.DataFrame(
        {
            "mode": ["R0", "R0", "R2", "R2"],
            "estimate": "exact",
            "page_time_s": [0.004, 0.006, math.nan, 1.0],
            "page_time_from_command_s": [0.005, 0.006, math.nan, 1.001],
        }
    )
    nothing = pd.DataFrame()
    assert paging_figures.unanswered(nothing, rows)[0].startswith("R2 exact 0.5 ± ")
    assert paging_figures.unanswered(nothing, rows[:2])[0] == "none"


@pytest.mark.slow
def test_page_time_is_reported(tmp_path: Path):
    made = swept("page_time", ["pages=40", "mode=R1"], tmp_path)
    found = {verdict.id: verdict.verdict for verdict in made.verdicts}
    assert found["r0_exact"] == "no data"
    assert found["r1_exact"] == "open"  # 120 pages do not decide
    assert {path.name for path in made.figures} == {"page_time_s.png", "page_time_distribution.png"}


def published(name: str) -> dict[str, dict[str, str]]:
    with (EXPERIMENTS / name / "published.csv").open(encoding="utf-8", newline="") as file:
        return {row["id"]: row for row in csv.DictReader(file)}


def test_figures_mark_the_numbers_that_are_published():
    claims = published("page_time")
    for (mode, estimate), mean_s in paging_figures.PUBLISHED_S.items():
        assert float(claims[f"{mode.lower()}_{estimate}"]["published"]) == mean_s
    claims = published("inquiry_time")
    for row, procedure in (("v11", "v1.1"), ("v12", "v1.2"), ("interlaced", "v1.2 interlaced")):
        assert claims[row]["quantity"] == f"discovery_time_s <= {discovery_figures.PUBLISHED[procedure]}"


@pytest.mark.parametrize("module", [discovery_figures, paging_figures])
@pytest.mark.parametrize("rows", [pd.DataFrame(), pd.DataFrame({"mode": ["R1"], "drift_ppm": [0]})])
def test_figures_without_data_answer_that_there_is_none(module: ModuleType, rows: pd.DataFrame):
    answers = {
        getattr(module, name)(rows, rows)
        for name in dir(module)
        if name in {"late_v11", "late_v12", "late_interlaced", "phase_locked", "not_found_by_drift", "unanswered"}
    }
    assert answers == {("-", None)}
    assert module.draw(rows, rows, Path()) == []
