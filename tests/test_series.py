"""What metrics would be if the run ended now: what a run that ends then has, and batteries by their law."""

import itertools
from dataclasses import replace
from typing import Any

import pytest

from cosim.errors import LocalProtocolError
from cosim.scenario import Scenario, protocol_names, protocol_spec
from cosim.series import MetricSeries
from cosim.simulation import Outcome, simulate
from cosim.trace import METRICS, POSES, Trace

SCENARIO: dict[str, Any] = {
    "name": "series",
    "duration_s": 21,
    "floorplan": {"map": "office", "office": {"width_m": 12.0, "depth_m": 9.0, "rooms": 4}},
    "team": {"size": 3},
    "protocol": {"use": "pseudonet", "parameters": {"algorithm": "boustrophedon"}},
    "faults": [
        {"kind": "battery", "robot": 1, "capacity_j": 100, "idle_w": 2, "radio_w": 0.5, "drive_j_per_m": 3},
        {"kind": "kill", "robot": 2, "at_s": 9},
    ],
}


def ran(**changes: Any) -> Outcome:
    return simulate(Scenario.model_validate(SCENARIO | changes), 4, (METRICS, POSES))


@pytest.fixture(scope="module")
def outcome() -> Outcome:
    return ran()


def at(outcome: Outcome, metric: str, time_s: float) -> float:
    """Return what *metric* is from its last row up to a time on."""
    columns = outcome.trace.columns("metrics")
    rows = zip(columns["time_ns"], columns["metric"], columns["value"], strict=True)
    return [value for time, name, value in rows if name == metric and time <= time_s * 1e9][-1]


@pytest.mark.parametrize("end_s", [10, 14, 20])
def test_a_metric_is_what_a_run_has_that_ends_then(outcome: Outcome, end_s: int):
    ended = ran(duration_s=end_s + 0.1)  # whose last tick is at end_s
    for metric in ("coverage", "overlap_ratio"):
        assert at(outcome, metric, end_s) == ended.metrics[metric]
        assert at(ended, metric, end_s + 0.1) == ended.metrics[metric]
    assert 0 < at(outcome, "coverage", end_s) < at(outcome, "coverage", 21)


def test_rows_are_those_that_have_changed_at_most_one_a_second(outcome: Outcome):
    columns = outcome.trace.columns("metrics")
    rows = list(zip(*columns.values(), strict=True))
    for metric, least in (("coverage", 6), ("battery_j", 20)):
        mine = [(time, value) for time, _, name, value, _ in rows if name == metric]
        assert all(repr(one[1]) != repr(other[1]) for one, other in itertools.pairwise(mine))
        assert all(other[0] - one[0] >= 1e9 for one, other in itertools.pairwise(mine))
        assert len(mine) >= least
    assert set(columns["metric"]) == {"coverage", "overlap_ratio", "battery_j"}


def test_a_battery_pays_for_its_time_and_its_way(outcome: Outcome):
    poses = outcome.trace.columns("poses")
    rows = zip(poses["time_ns"], poses["source"], poses["x_m"], poses["y_m"], strict=True)
    mine = [(time, x, y) for time, robot, x, y in rows if robot == 1]
    for end_s in (3, 8, 20):
        way = [(x, y) for time, x, y in mine if time <= end_s * 1e9]
        way_m = sum(abs(a[0] - b[0]) + abs(a[1] - b[1]) for a, b in itertools.pairwise(way))  # on a grid
        assert at(outcome, "battery_j", end_s) == pytest.approx(100 - 2.5 * end_s - 3 * way_m)
    assert way_m > 1


def test_the_table_changes_no_run(outcome: Outcome):
    assert simulate(Scenario.model_validate(SCENARIO), 4).digest == outcome.digest


@pytest.mark.parametrize("name", protocol_names())
def test_a_protocol_names_metrics_of_its_own(name: str):
    spec = protocol_spec(name)
    assert set(spec.over_time) <= {metric.name for metric in spec.metrics}


def test_a_name_that_is_no_metric_is_refused():
    spec = replace(protocol_spec("pseudonet"), over_time=("coverage", "speed"))
    with pytest.raises(LocalProtocolError, match="pseudonet: over_time names 'speed'"):
        MetricSeries(Trace([METRICS]), spec, Any, dict)  # type: ignore[arg-type]
