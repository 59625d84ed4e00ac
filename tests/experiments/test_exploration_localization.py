"""How true maps are, and what the published.csv of exploration_localization asks: claims hold, fail and stay open."""

import csv
import math
from itertools import product
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml

from cosim.errors import UserError
from cosim.experiment import load_experiment
from cosim.protocol import Surroundings
from cosim.results import RunStore
from cosim.sweep import run_sweep
from cosim.units import MS
from experiments.exploration_localization import astray, figures
from experiments.exploration_localization.astray import Looks, rise
from experiments.exploration_localization.mapping import COLUMNS, TIMES_S, Truth, at, mean_until, measure, waits
from protocols.mapping.belief import Frame, frame_of
from tests.checkout import EXPERIMENTS

EXPERIMENT = EXPERIMENTS / "exploration_localization"
NONE = pd.DataFrame()
with (EXPERIMENT / "published.csv").open(newline="", encoding="utf-8") as file:
    TESTS = [row["test"] for row in csv.DictReader(file)]

# ---------------------------------------------------------------- the truth of maps

WALLS = np.array([(0, 0, 4, 0), (4, 0, 4, 3), (4, 3, 0, 3), (0, 3, 0, 0), (2, 0, 2, 3)], np.float64)


def two_rooms() -> tuple[Frame, Surroundings]:
    """Return two rooms without a door between them; a robot is in the western one."""
    bounds = (0.0, 0.0, 4.0, 3.0)
    surroundings = Surroundings(
        ((1.0, 1.0),),
        0.2,
        0.3,
        1.0,
        100 * MS,
        WALLS,
        bounds,
        lambda points: (points < 0).any(axis=1) | (points > (4.0, 3.0)).any(axis=1),
    )
    return frame_of(bounds, 0.1), surroundings._replace(scan_range_m=2.5, beams=90)


def map_of(frame: Frame, empty: Any, occupied: Any) -> np.ndarray:
    """Return a map with rectangles (x from, x to, y from, y to; metres) of empty and occupied cells."""
    evidence = np.zeros((frame.ny, frame.nx), np.int8)
    for rectangles, value in ((empty, -1), (occupied, 3)):
        for left, right, low, high in rectangles:
            rows, columns = (slice(round(a * 10) + 1, round(b * 10) + 1) for a, b in ((low, high), (left, right)))
            evidence[rows, columns] = value
    return evidence


def test_a_map_of_what_is_there_has_no_wrong_cell() -> None:
    frame, surroundings = two_rooms()
    truth = Truth(frame, surroundings)
    found = truth.compare(map_of(frame, [(0, 2, 0, 3)], [(-0.1, 0, 0, 3), (2, 2.1, 0, 3)]))
    assert (found.wrong, found.known) == (0.0, 1.0)
    assert found.off_m == pytest.approx(0.05)  # cells beside the walls
    inside = truth.compare(map_of(frame, [(0, 2, 0, 3)], [(0, 0.1, 0, 3), (1.9, 2.0, 0, 3)]))
    assert (inside.wrong, inside.known) == (0.0, 1.0)  # the other side of the walls


def test_walls_that_are_not_there_and_rooms_behind_walls_are_wrong() -> None:
    frame, surroundings = two_rooms()
    truth = Truth(frame, surroundings)
    doubled = truth.compare(map_of(frame, [(0, 2, 0, 3)], [(1.0, 1.1, 0.5, 1.5)]))
    assert doubled.wrong == pytest.approx(10 / 600)
    assert doubled.off_m == pytest.approx(np.mean(np.minimum(0.95, np.arange(0.55, 1.5, 0.1))))
    assert doubled.known == pytest.approx(1 - 10 / (18 * 28))
    beyond = truth.compare(map_of(frame, [(0, 2.3, 0, 1)], []))
    assert beyond.wrong == pytest.approx(2 * 9 / 230)  # but for the cells that the walls touch
    wall_beyond = truth.compare(map_of(frame, [(0, 2, 0, 1)], [(3, 3.1, 1, 2)]))
    assert wall_beyond.wrong == pytest.approx(10 / 210)


def test_an_empty_map_says_nothing() -> None:
    frame, surroundings = two_rooms()
    found = Truth(frame, surroundings).compare(map_of(frame, [], []))
    assert math.isnan(found.wrong)
    assert math.isnan(found.off_m)
    assert found.known == 0.0


def test_errors_are_told_for_times() -> None:
    times, values = [20.0, 40.0, 60.0], [1.0, 2.0, 3.0]
    assert [at(times, values, time) for time in (10.0, 20.0, 40.5, 99.0, math.inf)] == [1.0, 1.0, 3.0, 3.0, 3.0]
    seconds = np.arange(1.0, 251.0)
    assert mean_until(seconds, seconds, 200.0) == pytest.approx(150.5)
    assert mean_until(seconds, seconds, 300.0) == pytest.approx(225.5)
    assert math.isnan(mean_until(seconds, seconds, 400.0))


def test_waits_are_counted_by_how_they_end() -> None:
    def trace(*rows: tuple[str, str | None]) -> Any:
        columns = {"event": [row[0] for row in rows], "why": [row[1] for row in rows]}
        return SimpleNamespace(columns=lambda name: columns)

    ended = [("Resumed", "localised"), ("Resumed", "waited long enough"), ("Resumed", "waited long enough")]
    told = [("Waiting", None), ended[0], ("Waiting", None), ended[1], ("Waiting", None), ended[2], ("Waiting", None)]
    assert waits(trace(*told, ("PathLeft", "localised"))) == {"waits": 4.0, "waits_localised": pytest.approx(1 / 3)}
    assert math.isnan(waits(trace(("Waiting", None)))["waits_localised"])


# ---------------------------------------------------------------- a run


def parameters(position: str, duration_s: float) -> dict[str, Any]:
    particles = "scenario.protocol.parameters.positioning.filter.particles=3"
    sets = ("map=corridor", f"position='{position}'", f"scenario.duration_s={duration_s}", particles)
    (arm,) = load_experiment(EXPERIMENT / "sweep.yaml", sets).arms
    return arm.parameters


@pytest.mark.slow
@pytest.mark.parametrize("position", figures.NAMES)
def test_every_arm_tells_all_columns(position: str) -> None:
    found = measure(parameters(position, 25.0), 1)
    assert set(found) == {column.name for column in COLUMNS}
    assert found["map_error"] == found["map_error_95"] == found["map_error_1900_s"]
    assert 0.0 <= found["map_error"] < 0.1
    assert (found["pose_error_m"] == 0.0) == (position == figures.TRUE)
    assert 0.0 < found["map_known"] < 0.3
    assert found["until_95_s"] == 25.0
    assert found["way_m"] > 1.0


# ---------------------------------------------------------------- the claims


def row(sign: int, position: str) -> dict[str, float]:
    """Return metrics of an arm where the paper is right (sign 1), and where it is wrong (sign -1)."""
    rank = list(figures.NAMES).index(position)  # true, odometry, constant, then the thresholds from the strictest
    strict = {3: 3, 4: 2, 5: 1}.get(rank, 0)
    error = {0: 0.005, 1: 0.2 if sign == 1 else 0.01}.get(rank, 0.05 * 0.7 ** (sign * strict))
    return {
        "until_95_s": 1000.0 * 1.3 ** (sign * strict),
        "map_error": error,
        "pose_error_m": 4 * error,
        "waits_localised": (0.8 if sign == 1 else 0.2) if strict else math.nan,
        "completed": float(sign == 1),
        "blocked_ticks": 0.0 if sign == 1 else 2.0,
        "reached": 1.0,
        "simulated_s": 900.0,
    }


def runs_of(sign: int, replicates: int = 12) -> pd.DataFrame:
    rows = []
    for replicate, floor, position in product(range(replicates), figures.MAPS, figures.NAMES):
        noise = 1.0 + 0.01 * math.sin(7 * replicate + 3 * len(rows))
        scattered = {
            key: value * (1.0 if key in ("completed", "reached", "blocked_ticks") else noise)
            for key, value in row(sign, position).items()
        }
        over_time = {f"{name}_{s}_s": 0.1 * noise for name in ("map_error", "pose_error") for s in TIMES_S}
        rows.append({"map": floor, "position": position, "replicate": replicate} | scattered | over_time)
    return pd.DataFrame(rows)


@pytest.mark.parametrize("test", TESTS)
def test_a_claim_holds_fails_and_stays_open(test: str) -> None:
    ask = getattr(figures, test)
    assert ask(runs_of(1), NONE)[1] is True
    assert ask(runs_of(-1), NONE)[1] is False
    assert ask(NONE, NONE) == ("-", None)
    if not test.startswith("undisrupted"):
        words, holds = ask(runs_of(1, replicates=1), NONE)
        assert words != "-"
        assert holds is None


def test_a_robot_that_is_held_up_once_is_disrupted() -> None:
    runs = runs_of(1)
    runs.loc[(runs["position"] == "stop at 0.2 m") & (runs["replicate"] == 3), "blocked_ticks"] = 1.0
    assert figures.undisrupted_office(runs, NONE)[1] is False  # type: ignore[attr-defined]


def test_a_threshold_without_any_wait_says_nothing_of_how_waits_end() -> None:
    runs = runs_of(1)
    runs.loc[runs["position"] == "stop at 0.4 m", "waits_localised"] = math.nan
    assert figures.localised_office(runs, NONE)[1] is True  # type: ignore[attr-defined]
    runs.loc[runs["position"] == "stop at 0.1 m", "waits_localised"] = 0.4
    assert figures.localised_office(runs, NONE)[1] is False  # type: ignore[attr-defined]


@pytest.mark.parametrize(("sign", "cut"), [(1, "stop at 0.2 m"), (-1, "constant speed")])
def test_who_has_not_seen_all_may_have_erred_less_for_that(sign: int, cut: str) -> None:
    runs = runs_of(sign)
    assert figures.maps_corridor_2(runs, NONE)[1] is (sign == 1)  # type: ignore[attr-defined]
    runs.loc[(runs["position"] == cut) & (runs["replicate"] == 0), "reached"] = 0.0
    assert figures.maps_corridor_2(runs, NONE)[1] is None  # type: ignore[attr-defined]


@pytest.mark.slow
def test_figures_are_drawn(tmp_path: Path) -> None:
    paths = figures.draw(runs_of(1), NONE, tmp_path)
    assert len(paths) == 3
    assert all(path.stat().st_size > 0 for path in paths)
    assert figures.draw(NONE, NONE, tmp_path) == []


def test_the_sweep_has_the_arms_that_the_claims_are_about() -> None:
    sweep = yaml.safe_load((EXPERIMENT / "sweep.yaml").read_text(encoding="utf-8"))["sweep"]
    assert set(sweep["position"]["values"]) == set(figures.NAMES)
    assert set(sweep["map"]["values"]) == set(figures.MAPS)
    for tenths, name in figures.STOPS.items():
        chosen = sweep["position"]["values"][name]
        assert chosen["scenario.protocol.parameters.positioning.control.stop_m"] == pytest.approx(tenths / 10)


# ---------------------------------------------------------------- how runs go astray

CALM = [0.05, 0.1, 0.2, 0.12]
"""Pose errors before a rise from 0.12 m, at 3 s."""
RISE = [0.18, 0.17, 0.25, 0.31, 0.5]


@pytest.mark.parametrize(
    ("new_cells", "heading_rad", "kind"),
    [
        ([0, 0, 9, 9], 0.2, "walls creep"),
        ([50, 50, 50, 50], 0.03, "heading lost"),
        ([50, 50, 50, 50], 0.02, "drift"),
        ([0, 50, 0, 50], 0.02, "walls creep"),  # of the 0.20 m 0.06 grew on known ground at 4 s, and 0.08 at 6 s
        ([0, 50, 50, 50], 0.02, "drift"),
    ],
)
def test_a_rise_is_classified_by_where_it_was_and_by_the_heading(
    new_cells: list[int], heading_rad: float, kind: str
) -> None:
    known = np.cumsum([100, 50, 50, 50, *new_cells, 0]).tolist()
    found = rise(Looks([*CALM, *RISE], [0.9] * 3 + [heading_rad, -heading_rad] * 3, known))
    assert (found.from_s, found.until_s) == (3.0, 7.0)
    assert found.turned_rad == pytest.approx(heading_rad)
    assert found.kind == kind


def test_who_errs_from_the_start_rises_from_there() -> None:
    found = rise(Looks([0.2, 0.25, 0.4], [0.01] * 3, [0, 90, 180]))
    assert (found.from_s, found.until_s, found.on_known, found.kind) == (0.0, 2.0, 0.0, "drift")


@pytest.mark.slow
def test_runs_that_went_astray_are_made_again_and_classified(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Odometry is so bad that runs go astray within half a minute."""
    sheet = yaml.safe_load((EXPERIMENT / "alternatives.yaml").read_text())
    scenario = sheet["parameters"]["scenario"]
    scenario["floorplan"]["map"] = str(EXPERIMENTS / "floors" / "localize_corridor.yaml")
    scenario["team"]["senses"]["odometry_turn_rad"] = 0.5
    hit = "scenario.protocol.parameters.positioning.filter.hit"
    sheet["sweep"] = {"choice": {"values": {"mean, as in GMapping": {hit: "mean"}}}}
    sheet["replicates"] = 2
    del sheet["quick"], sheet["report"]
    source = tmp_path / "bad.yaml"
    source.write_text(yaml.safe_dump(sheet))
    given = ["scenario.duration_s=30"]  # counts when runs are made again
    run_sweep(load_experiment(source, given), tmp_path / "results", jobs=1)
    astray.main([str(tmp_path / "results")])
    found = pd.read_csv(tmp_path / "results" / "astray.csv")
    assert list(found.columns[:3]) == ["choice", "seed", "pose_error_rms_m"]
    runs = RunStore(tmp_path / "results").present()
    assert 0 < len(found) == (runs["pose_error_rms_m"] > 0.3).sum()
    assert (found["pose_error_rms_m"] > 0.3).all()
    assert set(found["kind"]) <= {"walls creep", "heading lost", "drift"}
    assert "astray.csv" in capsys.readouterr().out
    arm = load_experiment(source, given).arms[0]
    with pytest.raises(UserError, match="errs otherwise than it did: the code was changed since"):
        astray._again(arm, int(found["seed"][0]), float(found["pose_error_rms_m"][0]) + 0.001)
