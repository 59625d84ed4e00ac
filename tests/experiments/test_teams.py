"""master_failure, scatternet_coverage and pseudonet_heterogeneous: what their rows hold, and their reports."""

import math
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from cosim.errors import UserError
from cosim.experiment import load_experiment
from cosim.report.sweep_report import Report, report
from cosim.sweep import run_sweep
from cosim.trace import Trace, events_table
from cosim.units import S, Time
from experiments.master_failure.failure import COLUMNS, after_death, measure, teams
from experiments.pseudonet_heterogeneous import figures
from protocols.pseudonet.events import EVENTS, RobotDropped, Stepped, TeamFormed, TeamLost
from tests.checkout import EXPERIMENTS

ROOM: dict[str, Any] = {"map": "walls", "bounds_m": [0, 0, 4, 3], "walls": [[2, 0, 2, 2]]}


def trace_of(*rows: tuple[Time, int, Any]) -> Trace:
    made = Trace((events_table(EVENTS),))
    for row in rows:
        made.event(*row)
    return made


def step(number: int) -> Stepped:
    return Stepped(number, "north", 0, number)


# ---------------------------------------------------------------- master_failure


def test_a_survivor_resumes_with_its_first_step_in_a_team_called_up_after_the_death():
    trace = trace_of(
        (1 * S, 0, TeamFormed(4)),
        *((1 * S, robot, TeamFormed(4)) for robot in (1, 2, 3)),
        (9 * S, 1, TeamLost(4)),  # an earlier loss is none of this death's
        (9 * S, 1, TeamFormed(4)),
        (10 * S + 1, 1, step(7)),  # of the old team: agreed on before the master died
        (12 * S, 1, TeamLost(4)),
        (11 * S, 4, TeamLost(4)),  # another one that dies in the end
        (13 * S, 2, TeamLost(4)),
        (14 * S, 3, RobotDropped(0)),
        (15 * S, 1, TeamFormed(2)),
        (15 * S, 2, TeamFormed(2)),
        (15 * S, 4, TeamFormed(3)),
        (16 * S, 0, step(99)),  # the dead do not count
        (16 * S, 1, step(8)),
        (17 * S, 4, step(8)),
        (17 * S, 2, TeamLost(2)),  # another loss
        (18 * S, 2, step(8)),
        (20 * S, 2, step(9)),
    )
    assert after_death(trace, {1, 2, 3}, 10 * S) == {
        "notice_s": 3.0,  # of 2, 3 and 4
        "resume_s": 7.0,  # of 6 and 8
        "last_resume_s": 8.0,
        "idle_survivors": 1.0,
    }
    assert teams(trace, {1, 2}) == 1
    assert teams(trace, {3}) == 0  # it still believes in the four, and nobody else does


def test_a_death_that_nobody_notices_has_no_times():
    told = after_death(trace_of((1 * S, 1, TeamFormed(1))), {1}, 2 * S)
    assert [math.isnan(told[name]) for name in ("notice_s", "resume_s", "last_resume_s")] == [True] * 3
    assert told["idle_survivors"] == 1.0


def test_robots_in_several_teams_are_counted_by_the_sizes_that_they_were_told():
    events = [(0, robot, TeamFormed(7)) for robot in range(7)]
    events += [(1, robot, TeamFormed(3)) for robot in (0, 1, 2)] + [(2, robot, TeamFormed(3)) for robot in (3, 4, 5)]
    events += [(3, 6, TeamFormed(1))]
    assert teams(trace_of(*events), set(range(7))) == 3


def given(size: int, at_s: float | None, channel: dict[str, Any]) -> dict[str, Any]:
    scenario = {
        "duration_s": 600,
        "floorplan": ROOM,
        "team": {"size": size},
        "channel": channel,
        "protocol": {"use": "pseudonet", "parameters": {"cell_m": 0.5}},
    }
    return {"scenario": scenario, "robot": 0, "at_s": at_s}


@pytest.mark.slow
@pytest.mark.parametrize("supervision_s", [1.0, 4.0])
def test_slaves_notice_their_masters_death_by_the_supervision_time_out(supervision_s: float):
    told = measure(given(3, 12.0, {"kind": "bluetooth", "supervision_s": supervision_s}), 1)
    # the last frame of the master is at most one poll interval (25 ms) older than its death
    assert supervision_s - 0.03 < told["notice_s"] < supervision_s + 0.03
    # they wait a second, inquire, page and call the roll before they step again: each at most 15 s
    assert supervision_s + 1 < told["resume_s"] <= told["last_resume_s"] < supervision_s + 20
    assert told["idle_survivors"] == 0
    assert told["teams"] == 1
    assert told["coverage"] == 1
    assert set(told) == {column.name for column in COLUMNS}


@pytest.mark.slow
def test_where_nobody_dies_there_are_no_times_after_a_death():
    calm, sad = (measure(given(3, at_s, {"kind": "ideal"}), 1) for at_s in (None, 6.0))
    assert set(calm) == set(sad) == {column.name for column in COLUMNS}
    assert math.isnan(calm["resume_s"])
    assert math.isnan(calm["idle_survivors"])
    assert calm["teams_lost"] == 0
    assert sad["resume_s"] == pytest.approx(1.0, abs=0.11)  # settle_s, then exchanges of microseconds, then a tick
    assert sad["end_s"] > calm["end_s"]  # two do the work of three


def test_who_dies_must_be_there():
    with pytest.raises(ValueError, match="is not one of the robots 0 to 2"):
        measure(given(3, 6.0, {"kind": "ideal"}) | {"robot": 3}, 1)


# ---------------------------------------------------------------- pseudonet_heterogeneous


def runs_of(rows: list[tuple[str, str, str, int, float]]) -> pd.DataFrame:
    """Return runs; a time to cover or to gather in the last place."""
    frame = pd.DataFrame(rows, columns=["task", "team", "air", "replicate", "time"])
    covers = frame["task"] == "coverage"
    return frame.assign(
        teams_lost=0.0, time_to_cover_s=frame["time"].where(covers), time_to_gather_s=frame["time"].where(~covers)
    ).drop(columns="time")


def test_a_mixed_team_is_compared_with_its_equals_in_the_same_world():
    runs = runs_of(
        [
            ("coverage", "alike", "walls", 0, 100.0),
            ("coverage", "alike", "walls", 1, 200.0),
            ("coverage", "speeds", "walls", 0, 150.0),
            ("coverage", "speeds", "walls", 1, 300.0),
            ("gathering", "alike", "walls", 0, 10.0),
            ("gathering", "speeds", "walls", 0, 20.0),
        ]
    )
    (table,) = figures.tables(runs, pd.DataFrame()).values()
    assert table.to_dict("records") == [
        {"task": "coverage", "team": "speeds", "air": "walls", "ratio": "1.5"},
        {"task": "gathering", "team": "speeds", "air": "walls", "ratio": "2"},
    ]
    assert figures.tables(runs[runs["team"] != "alike"], pd.DataFrame()) == {}
    assert figures.tables(pd.DataFrame(), pd.DataFrame()) == {}


# ---------------------------------------------------------------- all three


def swept(name: str, sets: list[str], folder: Path) -> Report:
    experiment = load_experiment(EXPERIMENTS / name / "sweep.yaml", sets, quick=True, replicates=1)
    assert run_sweep(experiment, folder, jobs=1).failures == ()
    return report(folder)


@pytest.mark.parametrize(
    ("name", "arms"), [("master_failure", 32), ("scatternet_coverage", 18), ("pseudonet_heterogeneous", 28)]
)
def test_every_arm_of_the_full_sweep_is_valid(name: str, arms: int):
    assert len(load_experiment(EXPERIMENTS / name / "sweep.yaml").arms) == arms


def test_a_misspelt_setting_of_master_failure_is_refused():
    with pytest.raises(UserError, match="scenario"):
        load_experiment(EXPERIMENTS / "master_failure" / "sweep.yaml", ["scenario.teem=3"])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "sets", "expected"),
    [
        ("master_failure", ["supervision=2 s", "scenario.floorplan={map: walls, bounds_m: [0, 0, 4, 4]}"], 2),
        ("scatternet_coverage", ["floorplan.office.width_m=8", "channel=bluetooth", "topology=tree"], 1),
        ("pseudonet_heterogeneous", ["floorplan.office.width_m=8"], 4),
    ],
)
def test_the_quick_sweeps_are_reported(name: str, sets: list[str], expected: int, tmp_path: Path):
    made = swept(name, sets, tmp_path)
    assert made.failures == 0
    first = next(iter(made.tables.values()))
    assert len(first) == expected
    assert set(first.filter(regex="^(coverage|gathered)$").to_numpy().ravel()) <= {"1", "-"}
    assert made.figures
    assert all(path.stat().st_size > 5_000 for path in made.figures)
