"""What a trace holds of robots' beliefs is what their machines believed, and costs nothing that is not asked for."""

import copy
import math
from collections.abc import Callable, Sequence
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import shapely

from cosim.beliefs import corners_of, points_of, way_of
from cosim.documents import read_yaml
from cosim.scenario import Scenario, build
from cosim.simulation import Simulation
from cosim.trace import BELIEFS, POSES, Trace
from cosim.units import MS, S, Time, to_seconds

PINS = Path(__file__).parent / "pins"
FLOOR = {"map": "walls", "bounds_m": [0, 0, 9, 6], "walls": [[3, 0, 3, 4], [6, 2, 6, 6], [3, 4, 4, 4]]}
EXPLORING: dict[str, Any] = {
    "name": "exploring",
    "duration_s": 30,
    "floorplan": FLOOR,
    "team": {
        "size": 2,
        "starts": [[1, 1], [2, 1]],
        "senses": {"beams": 60, "beam_range_m": 2.5},
        "body": {"radius_m": 0.2, "speed_mps": 0.6, "drive": "differential"},
    },
    "channel": {"kind": "ideal"},
    "protocol": {
        "use": "exploration",
        "parameters": {"algorithm": "nearest", "map": "messages", "steering": {"speed_mps": 0.5}},
    },
    "faults": [{"kind": "crash", "robot": 1, "at_s": 12.05, "for_s": 3}],
}
DRIFT = {"odometry_slip": 0.05, "odometry_turn_rad": 0.05, "range_noise_m": 0.02}
FILTERED: dict[str, Any] = EXPLORING | {
    "duration_s": 6,
    "team": EXPLORING["team"] | {"size": 1, "starts": [[1, 1]], "senses": EXPLORING["team"]["senses"] | DRIFT},
    "protocol": {
        "use": "exploration",
        "parameters": {
            "algorithm": "schemas",
            "map": "messages",
            "evidence": "counted",
            "positioning": {"kind": "slam", "margin_m": 1.0, "filter": {"particles": 10}},
        },
    },
    "faults": [],
}
SEEKING: dict[str, Any] = {
    "name": "seeking",
    "duration_s": 12,
    "floorplan": FLOOR,
    "team": {
        "size": 2,
        "sight_range_m": 12,
        "starts": [[1, 1], [8, 5]],
        "senses": {"frames": "own", "beams": 24, "odometry_turn_rad": 0.02},
    },
    "channel": {"kind": "optical", "range_m": 12},
    "protocol": {"use": "reflection", "parameters": {"targets": [[[2, 5], [8, 1]]]}},
    "faults": [{"kind": "moved", "robot": 0, "at_s": 5, "to_m": [5, 3], "heading_deg": 90}],
}


def begun(plain: dict[str, Any], tables: Any = BELIEFS) -> Simulation:
    run = Simulation(Scenario.model_validate(plain), 1, tables)
    run.begin()
    return run


def table(trace: Trace, name: str) -> pd.DataFrame:
    return pd.DataFrame(trace.columns(name))


def grown(maps: pd.DataFrame, source: int, until: Time) -> np.ndarray[Any, Any]:
    """Return the states of the cells of a map at a time: by the table as its documentation tells."""
    own = maps[(maps.source == source) & (maps.time_ns <= until)]
    cells = np.zeros((own["rows"].iloc[0], own["columns"].iloc[0]), dtype=int)
    for row in own.itertuples():
        for runs, state in ((row.unknown, 0), (row.empty, -1), (row.occupied, 1)):
            for run in filter(None, runs.split(",")):
                first, _, last = run.partition("-")
                cells.flat[int(first) : int(last or first) + 1] = state
    return cells


@pytest.mark.parametrize("plain", [EXPLORING, SEEKING], ids=["exploring", "seeking"])
def test_a_run_is_the_same_whether_its_beliefs_are_kept_or_not(plain: dict[str, Any]):
    with_them, without = (
        Simulation(Scenario.model_validate(plain), 1, BELIEFS),
        Simulation(Scenario.model_validate(plain), 1),
    )
    kept, plainly = with_them.run(), without.run()
    assert kept.digest == plainly.digest
    assert kept.metrics == plainly.metrics
    assert kept.trace.count("ways") > 2


def test_maps_grow_as_those_of_the_machines():
    run, seen = begun(EXPLORING), {}
    for second in range(1, 30):
        now = second * S + 250 * MS  # between two ticks: as it was at the last one
        run.advance(now)
        seen[now] = [np.sign(machine.belief.evidence).astype(int) for machine in run.machines]
    maps = table(run.trace, "maps")
    for now, states in seen.items():
        for robot, expected in enumerate(states):
            assert np.array_equal(grown(maps, robot, now), expected), (robot, to_seconds(now))
    sizes = [int((states[1] != 0).sum()) for states in seen.values()]
    assert sizes[14] < sizes[10] < sizes[-1]  # its host has booted anew in between, and had forgotten all
    frame = run.machines[0].belief.frame
    first = maps.iloc[0]
    assert (first.corner_x_m, first.corner_y_m, first.cell_m) == (*frame.origin_m, frame.cell_m)


def test_a_map_in_common_is_told_once():
    shared = EXPLORING["protocol"] | {"parameters": EXPLORING["protocol"]["parameters"] | {"map": "shared"}}
    run = begun(EXPLORING | {"protocol": shared, "duration_s": 4, "faults": []})
    run.advance(4 * S)
    maps = table(run.trace, "maps")
    assert set(maps.source) == {-1}
    assert maps.time_ns.is_unique
    assert np.array_equal(grown(maps, -1, 4 * S), np.sign(run.machines[0].belief.evidence))


def test_ways_are_those_of_the_machines_until_they_crash():
    run, led = begun(EXPLORING), 0
    for second in range(1, 30):
        run.advance(second * S + MS)
        ways = table(run.trace, "ways")
        for robot, machine in enumerate(run.machines):
            own = ways[ways.source == robot]
            told = own.iloc[-1] if len(own) else None
            cells = machine.leader.way if run.nodes[robot].alive else []
            if not cells:
                assert told is None or (told.points == "" and math.isnan(told.goal_x_m))
                continue
            led += 1
            frame = machine.belief.frame
            assert (told.goal_x_m, told.goal_y_m) == frame.centre_m(cells[-1])
            points = [tuple(map(float, point.split())) for point in told.points.split(", ")]
            assert points[0] == pytest.approx(frame.centre_m(cells[0]))
            for cell in cells:  # none of them is off the way
                assert apart(frame.centre_m(cell), points) < 0.002
    assert led > 20


def apart(place: tuple[float, float], points: Sequence[tuple[float, ...]]) -> float:
    """Return how far a place is from a polyline."""
    best = math.dist(place, points[0])
    for (x1, y1), (x2, y2) in pairwise(points):
        dx, dy = x2 - x1, y2 - y1
        part = min(1.0, max(0.0, ((place[0] - x1) * dx + (place[1] - y1) * dy) / (dx * dx + dy * dy)))
        best = min(best, math.dist(place, (x1 + part * dx, y1 + part * dy)))
    return best


def test_an_explorer_may_localise_by_features():
    """Places stay nearer to the truth than those of odometry, and the covariance is that of the filter."""
    scenario = copy.deepcopy(FILTERED)
    scenario["duration_s"] = 40
    scenario["protocol"]["parameters"]["positioning"] = {
        "kind": "features",
        "margin_m": 1.0,
        "features": {"odometry_slip": 0.05, "odometry_turn_rad": 0.05},
    }
    run = begun(scenario, (*BELIEFS, POSES))
    run.advance(30 * S + MS)
    estimates, poses = table(run.trace, "estimates"), table(run.trace, "poses").set_index("time_ns")
    off = {}
    for origin in ("machine", "odometry"):
        found = estimates[estimates.origin == origin].set_index("time_ns")
        true = poses.loc[found.index]
        off[origin] = np.hypot(found.x_m - true.x_m, found.y_m - true.y_m)
    slam = run.machines[0].positioning._slam
    assert slam.updates > 30
    last = estimates[estimates.origin == "machine"].iloc[-1]
    covariance = slam.belief.covariance
    assert (last.xx_m2, last.xy_m2, last.yy_m2) == (covariance[0, 0], covariance[0, 1], covariance[1, 1])
    assert off["machine"].mean() < 0.5 * off["odometry"].mean()


def test_a_filter_s_estimate_is_told_with_its_covariance():
    run = begun(FILTERED, (*BELIEFS, POSES))
    run.advance(5 * S + MS)
    estimates, events = table(run.trace, "estimates"), table(run.trace, "events")
    found = estimates[estimates.origin == "machine"].set_index("time_ns")
    reported = events[events.event == "Localised"].set_index("time_ns")
    assert len(reported) == 6
    told = found.loc[reported.index]
    assert np.allclose(told[["x_m", "y_m", "heading_rad"]], reported[["x_m", "y_m", "heading_rad"]].astype(float))
    slam = run.machines[0].positioning._slam
    expected = np.cov(slam.poses[:, :2].T, aweights=slam.weights, ddof=0)
    last = found.iloc[-1]
    assert [last.xx_m2, last.xy_m2, last.yy_m2] == pytest.approx([expected[0, 0], expected[0, 1], expected[1, 1]])
    assert last.xx_m2 + last.yy_m2 > 0
    assert (estimates.origin == "odometry").sum() == len(found)


def test_odometry_is_where_a_robot_thinks_it_is_also_when_it_was_carried_off():
    run = begun(SEEKING, (*BELIEFS, POSES))
    run.advance(11 * S)
    estimates, poses = table(run.trace, "estimates"), table(run.trace, "poses")
    both = poses.merge(estimates, on=["time_ns", "source"], suffixes=("", "_own"))
    assert len(both) == len(poses)
    off = np.hypot(both.x_m - both.x_m_own, both.y_m - both.y_m_own)
    before, after = both.time_ns < 5 * S, both.time_ns > 5 * S
    assert off[before].max() < 0.1  # frames of their own, turned by any angle, told in the world's
    turned = both.heading_rad - both.heading_rad_own
    assert np.cos(turned[before]).min() > 0.99
    assert off[after & (both.source == 0)].min() > 1.0
    assert off[both.source == 1].max() < 0.1
    assert estimates.xx_m2.isna().all()


def test_a_robot_without_a_filter_that_knows_its_place_has_no_estimates():
    run = begun(EXPLORING | {"duration_s": 1, "faults": []})
    run.advance(S)
    assert run.trace.count("estimates") == 0


PINNED: dict[str, dict[str, Any]] = {
    "aggregation": {},
    "deployment": {"protocol.parameters.positioning": {"kind": "mcl"}, "team.senses.odometry_slip": 0.02},
    "gathering": {},
    "pseudonet": {"duration_s": 80},
}


@cache
def pinned(name: str) -> Simulation:
    """Return a run of one of the protocols, with beliefs; without, it was the same."""
    plain = read_yaml(PINS / f"{name}.yaml")["scenario"]
    for path, value in PINNED[name].items():
        *way, last = path.split(".")
        place = plain
        for key in way:
            place = place[key]
        place[last] = value
    scenario = build(plain, name, PINS)
    run = Simulation(scenario, 1, BELIEFS)
    assert run.run().digest == Simulation(scenario, 1).run().digest
    return run


@pytest.mark.parametrize("name", PINNED)
def test_ways_pass_no_wall(name: str):
    run = pinned(name)
    walls = shapely.MultiLineString([((x1, y1), (x2, y2)) for x1, y1, x2, y2 in run.floorplan.walls_m.tolist()])
    ways = [way_of(points) for points in run.trace.columns("ways")["points"] if points]
    assert ways
    for way in ways:
        assert len(way) == 1 or not shapely.LineString(way).crosses(walls), way
    assert name != "aggregation" or max(map(len, ways)) > 1


def test_goals_are_those_of_which_events_tell():
    trace = pinned("deployment").trace
    events, ways = table(trace, "events"), table(trace, "ways")
    begun = events[(events.event == "TaskStarted") & (events.act == "go")]
    assert len(begun) > 0
    for event in begun.itertuples():
        told = ways[(ways.source == event.source) & (ways.time_ns >= event.time_ns)].iloc[0]
        assert (told.goal_x_m, told.goal_y_m) == pytest.approx((event.goal_x_m, event.goal_y_m))


def test_an_estimate_on_a_known_map_is_told_with_the_spread_of_its_particles():
    trace = pinned("deployment").trace
    events, estimates = table(trace, "events"), table(trace, "estimates")
    reported = events[events.event == "Positioned"].set_index(["time_ns", "source"])
    told = estimates[estimates.origin == "machine"].set_index(["time_ns", "source"]).loc[reported.index]
    assert len(told) > 100
    assert np.allclose(told[["x_m", "y_m"]], reported[["x_m", "y_m"]].astype(float))
    spread_m = np.sqrt((told.xx_m2 + told.yy_m2).astype(float))  # of the particles that have survived
    assert (np.abs(np.log(spread_m / reported.spread_m.astype(float))) < math.log(1.5)).mean() > 0.9


def test_a_team_that_has_covered_all_knows_all():
    run = pinned("pseudonet")
    maps = table(run.trace, "maps")
    known = [grown(maps, robot, run.kernel.now) for robot in range(len(run.machines))]
    reachable = run.machines[0].application.coordination.view.setup.grid.reachable
    assert [set(np.flatnonzero(cells < 0)) for cells in known] == [set(np.flatnonzero(reachable))] * len(known)
    assert not any((cells > 0).any() for cells in known)


@pytest.mark.parametrize("text", ["", "0.500 1.250", "0.500 1.250, -2.000 0.001"])
def test_points_are_written_in_millimetres(text: str):
    assert points_of(way_of(text)) == text  # type: ignore[arg-type]


def test_a_way_is_told_by_its_corners():
    turning: Callable[[int], tuple[float, float]] = lambda at: (min(at, 4) * 0.1, max(0, at - 4) * 0.1)  # noqa: E731
    assert corners_of([turning(at) for at in range(9)]) == [turning(0), turning(4), turning(8)]
    assert corners_of([(0, 0), (1, 0), (0.5, 0)]) == [(0, 0), (1, 0), (0.5, 0)]  # there and back
