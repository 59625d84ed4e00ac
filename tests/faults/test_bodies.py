"""Faults of bodies and cameras: frozen robots, robots moved by hand, robots that see nothing."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cosim.errors import UserError
from cosim.geometry.segments import segment_grid
from cosim.machine import Drive, GoTo
from cosim.robots.body import BodySettings
from cosim.robots.motion import Carry, Fleet
from cosim.scenario import build
from cosim.simulation import Simulation, simulate
from cosim.trace import POSES
from cosim.units import MS, S
from tests.faults.fault_scene import RADIUS_M, TICK, executed, kill, rows, scenario

SEEING = "tests.faults.fault_scene:SEEING"
VIEWING = "tests.faults.fault_scene:VIEWING"


def frozen(robot: int, at_s: float, until_s: float | None = None) -> dict[str, Any]:
    return {"kind": "frozen", "robot": robot, "at_s": at_s, "until_s": until_s}


def camera_off(robot: int, at_s: float, until_s: float | None = None) -> dict[str, Any]:
    return {"kind": "camera_off", "robot": robot, "at_s": at_s, "until_s": until_s}


def moved(robot: int, at_s: float, *to_m: float, **more: Any) -> dict[str, Any]:
    return {"kind": "moved", "robot": robot, "at_s": at_s, "to_m": to_m or None, **more}


# ---------------------------------------------------------------- frozen


@pytest.mark.parametrize("drive", ["grid", "differential", "omni"])
def test_a_frozen_body_brakes_under_its_limit_stands_and_then_carries_out_its_order(drive: str):
    body = {"radius_m": RADIUS_M, "speed_mps": 0.5, "acceleration_mps2": 1.0, "drive": drive}
    run = executed(frozen(0, 2.05, 4.0), far_m=5.0, duration_s=20.0, team={"body": body})
    ways = np.diff(run.referee.path(0)[:, 0])
    assert ways[19:26] == pytest.approx([0.05, 0.05, 0.04, 0.03, 0.02, 0.01, 0.0], abs=1e-9)
    assert (ways[25:40] == 0).all()
    assert ways[40:46] == pytest.approx([0.01, 0.02, 0.03, 0.04, 0.05, 0.05], abs=1e-9)
    assert run.referee.path(0)[-1].tolist() == [6.0, 5.0]
    observed = dict(run.machines[0].observed)
    assert not any(observed[tick * TICK].arrived or observed[tick * TICK].blocked for tick in range(1, 41))
    assert run.outcome.metrics["distance_m"] == pytest.approx(10.0, abs=1e-9)
    assert rows(run) == [(2_050 * MS, 0, "Frozen"), (4 * S, 0, "Thawed")]


def test_an_order_that_a_frozen_robot_is_given_waits_until_it_thaws():
    run = executed(frozen(0, 0.0, 3.0), far_m=1.0, order_s=1.0, duration_s=9.0)
    x = run.referee.path(0)[:, 0]
    assert (x[:31] == 1.0).all()
    assert x[31] == pytest.approx(1.01)
    assert x[-1] == 2.0


def test_a_frozen_robot_that_turns_turns_ever_more_slowly():
    body = BodySettings(turn_radps=2.0, turn_acceleration_radps2=4.0)
    fleet = Fleet([body], [(0, 0)], segment_grid([]), TICK)
    fleet.apply([(0, Drive(0.0, 2.0))])
    for _ in range(10):
        fleet.step()
    fleet.freeze(0, True)
    headings = []
    for _ in range(9):
        fleet.step()
        headings.append(fleet.pose_at(0, fleet.time)[2])
    assert np.diff(headings) == pytest.approx([0.16, 0.12, 0.08, 0.04, 0, 0, 0, 0], abs=1e-9)


def test_a_body_that_is_to_land_when_it_freezes_has_arrived():
    body = BodySettings(speed_mps=0.5, acceleration_mps2=100.0)
    fleet = Fleet([body], [(0, 0)], segment_grid([]), TICK)
    fleet.apply([(0, GoTo(0.04, 0.0))])
    fleet.step()
    fleet.freeze(0, True)
    for _ in range(3):
        fleet.step()
        assert fleet.observations()[0].arrived
        assert fleet.positions_m.tolist() == [[0.04, 0.0]]


def test_the_dead_do_not_thaw():
    run = executed(frozen(0, 0.5, 2.0), kill(0, 1.0), far_m=5.0)
    assert [event for _, _, event in rows(run)] == ["Frozen", "Killed"]
    path = run.referee.path(0)[:, 0]
    assert (path[10:] == path[-1]).all()


# ---------------------------------------------------------------- moved by hand


@pytest.mark.parametrize("at_s", [1.91, 1.95, 2.0])
def test_a_robot_that_is_moved_stands_there_at_the_next_tick_and_drives_on_from_there(at_s: float):
    run = executed(moved(0, at_s, 3.0, 10.0), far_m=5.0, duration_s=30.0)
    path = run.referee.path(0)
    assert path[19, 1] == 5.0
    assert path[20].tolist() == [3.0, 10.0]
    assert np.hypot(*(path[21] - path[20])) == pytest.approx(0.01)  # from rest
    assert path[-1].tolist() == [6.0, 5.0]
    columns = run.trace.columns("events")
    place = columns["to_x_m"], columns["to_y_m"]
    assert (rows(run), *place) == ([(2 * S, 0, "Carried")], [3.0], [10.0])


def test_the_way_by_hand_is_not_driven_but_the_way_before_is():
    run = executed(moved(0, 2.0, 3.0, 10.0), far_m=5.0, duration_s=30.0)
    before = run.referee.path(0)[19, 0] + 0.05 - 1.0
    assert run.outcome.metrics["distance_m"] == pytest.approx(before + math.hypot(3.0, 5.0) + 5.0, abs=1e-9)


def test_the_heading_is_what_is_asked_for_or_as_before():
    for more, degrees in [({}, 0.0), ({"heading_deg": 450.0}, 90.0)]:
        run = Simulation(scenario(moved(0, 1.0, 3.0, 10.0, **more), duration_s=1.15), 1, [POSES])
        run.run()
        columns = run.trace.columns("poses")
        assert columns["heading_rad"][-2] == pytest.approx(math.radians(degrees))


def test_a_place_that_another_body_takes_or_will_take_is_not_free():
    meets = {"starts": [[2.0, 5.0], [3.0, 5.0]]}
    run = executed(moved(0, 1.0, 3.0, 5.39), duration_s=2.0, team=meets)
    assert rows(run) == [(1 * S, 0, "NotCarried")]
    assert (run.referee.path(0) == [2.0, 5.0]).all()
    assert rows(executed(moved(0, 1.0, 3.0, 5.41), duration_s=2.0, team=meets)) == [(1 * S, 0, "Carried")]
    assert rows(executed(moved(0, 1.0, 3.0, 5.4), duration_s=2.0, team=meets)) == [(1 * S, 0, "Carried")]


@pytest.mark.parametrize(
    ("away_m", "event"), [(-0.41, "Carried"), (-0.39, "NotCarried"), (0.39, "NotCarried"), (0.41, "Carried")]
)
def test_a_place_is_free_of_those_who_drive_where_they_are_at_that_tick(away_m: float, event: str):
    starts = {"starts": [[2.0, 15.0], [3.0, 5.0]]}
    there = executed(far_m=5.0, duration_s=3.0, team=starts).referee.path(1)[20, 0]  # 0.05 m further than a tick before
    run = executed(moved(0, 2.0, there + away_m, 5.0), far_m=5.0, duration_s=3.0, team=starts)
    assert rows(run) == [(2 * S, 0, event)]


def test_who_is_moved_in_the_tick_in_which_it_would_have_arrived_has_not():
    plain = executed(far_m=1.0, duration_s=6.0).machines[0].observed
    tick = next(now // TICK for now, observation in plain if now and observation.arrived)
    run = executed(moved(0, tick * 0.1, 3.0, 10.0), far_m=1.0, duration_s=20.0)
    arrived = [now // TICK for now, observation in run.machines[0].observed if now and observation.arrived]
    assert arrived[0] > tick + 50  # 5 m at 0.5 m/s
    assert run.referee.path(0)[-1].tolist() == [2.0, 5.0]


def test_who_is_moved_as_it_turns_is_put_down_with_the_heading_that_is_asked_for_and_turns_from_rest():
    body = {"radius_m": RADIUS_M, "drive": "differential", "turn_radps": 2.0, "turn_acceleration_radps2": 4.0}
    changes: dict[str, Any] = {"far_m": 1.0, "meet": True, "duration_s": 2.0, "team": {"body": body}}
    headings = [
        [observation.heading_rad for _, observation in executed(*faults, **changes).machines[1].observed]
        for faults in ([], [moved(1, 0.6, 9.0, 5.0, heading_deg=0.0)])
    ]
    assert abs(headings[0][5]) > 0.1  # its goal is behind it
    assert headings[1][5] == headings[0][5]
    assert headings[1][6] == 0.0
    assert abs(headings[1][7]) == pytest.approx(4.0 * 0.1 * 0.1)


def test_who_is_taken_away_from_a_wall_is_not_blocked_any_more():
    walls = {"map": "walls", "bounds_m": [0, 0, 20, 20], "walls": [[2, 0, 2, 20]]}
    run = executed(moved(0, 4.0, 9.0, 5.0), far_m=5.0, duration_s=4.5, floorplan=walls)
    blocked = [observation.blocked for _, observation in run.machines[0].observed]
    assert blocked[30:] == [True] * 10 + [False] * 5


@pytest.mark.parametrize("at_s", [1.4, 2.2, 3.0])
def test_who_is_put_before_a_wall_stops_at_it(at_s: float):
    walls = {"map": "walls", "bounds_m": [0, 0, 20, 20], "walls": [[8, 0, 8, 20]]}
    run = executed(moved(0, at_s, 7.75, 5.0), far_m=9.0, duration_s=6.0, floorplan=walls)
    x = run.referee.path(0)[:, 0]
    assert x[round(at_s * 10)] == 7.75
    assert x.max() <= 8.0 - RADIUS_M + 1e-7
    assert x[-1] == pytest.approx(8.0 - RADIUS_M, abs=1e-6)


def test_a_robot_does_not_stand_in_its_own_way():
    assert rows(executed(moved(0, 1.0, 1.1, 5.0), duration_s=1.5)) == [(1 * S, 0, "Carried")]


def test_two_that_are_moved_to_one_place_at_once_do_not_both_get_there():
    run = executed(moved(0, 1.0, 9.0, 9.0), moved(1, 0.95, 9.1, 9.0), duration_s=2.0)
    assert rows(run) == [(1 * S, 0, "Carried"), (1 * S, 1, "NotCarried")]


def test_bodies_stay_apart_also_where_one_is_put_before_another_that_drives():
    run = executed(moved(1, 2.0, 2.36, 5.0), far_m=5.0, duration_s=6.0, team={"starts": [[1.0, 5.0], [1.0, 9.0]]})
    assert rows(run) == [(2 * S, 1, "Carried")]
    apart = np.hypot(*(run.referee.path(0) - run.referee.path(1)).T)
    assert apart.min() >= 2 * RADIUS_M - 1e-8


def test_without_a_place_it_is_put_on_free_floor_drawn_from_the_seed():
    walls = {"map": "walls", "bounds_m": [0, 0, 20, 20], "walls": [[0, 8, 20, 8]]}
    faults = [moved(0, 1.0, rate_per_s=5.0)]
    places = []
    for seed in (1, 2):
        run = Simulation(scenario(*faults, duration_s=6.0, floorplan=walls), seed)
        run.run()
        columns = run.trace.columns("events")
        places.append(list(zip(columns["to_x_m"], columns["to_y_m"], strict=True)))
    assert len(places[0]) > 10
    assert len({*places[0], *places[1]}) == len(places[0]) + len(places[1])
    y = np.array([place[1] for place in places[0] + places[1]])
    assert ((y >= RADIUS_M) & (y <= 20 - RADIUS_M) & (abs(y - 8) >= RADIUS_M - 1e-9)).all()
    assert {*(y < 8)} == {True, False}


def test_a_floor_without_room_leaves_it_where_it_is():
    walls = {"map": "walls", "bounds_m": [0, 0, 4.4, 0.4]}
    starts = [[0.2 + 0.4 * k, 0.2] for k in range(11)]
    run = executed(moved(5, 1.0), duration_s=2.0, size=11, team={"starts": starts}, floorplan=walls)
    assert rows(run) == [(1 * S, 5, "NotCarried")]


@pytest.mark.parametrize(
    ("place", "expected"),
    [
        ((21.0, 3.0), "faults[1].to_m: (21, 3) is outside of the floor, expected 0..20 by 0..20 m"),
        ((7.9, 3.0), "faults[1].to_m: (7.9, 3) is inside a wall: it is 0.1 m away, expected at least the radius 0.2 m"),
    ],
)
def test_a_place_where_a_body_does_not_fit_is_told_before_the_run(place: tuple[float, float], expected: str):
    walls = {"map": "walls", "bounds_m": [0, 0, 20, 20], "walls": [[8, 0, 8, 20]]}
    with pytest.raises(UserError) as raised:
        Simulation(scenario(kill(0, 1.0), moved(1, 2.0, *place), floorplan=walls), 1)
    assert str(raised.value) == expected


@pytest.mark.parametrize("drift", [{}, {"odometry_slip": 0.05, "odometry_turn_rad": 0.1}])
def test_odometry_does_not_notice_and_leads_where_it_would_have_led_from_the_new_pose(drift: dict[str, float]):
    senses = {"senses": {"frames": "own", **drift}, "starts": [[8.0, 8.0]]}
    for order_s, turn_before in ((0.0, None), (1.95, 0.0)):  # on its way, or told in the tick in which it is moved
        changes: dict[str, Any] = {"use": VIEWING, "far_m": 4.0, "order_s": order_s, "own": True, "size": 1}
        fault = moved(0, 2.0, 12.0, 12.0, heading_deg=90.0)
        plain, carried = (executed(*faults, team=senses, duration_s=15.0, **changes) for faults in ([], [fault]))
        heading = plain.fleet.observed[0, 2] if turn_before is None else turn_before
        turn = math.pi / 2 - heading
        way_x, way_y = plain.referee.path(0)[-1] - plain.referee.path(0)[20]
        end = 12 + math.cos(turn) * way_x - math.sin(turn) * way_y, 12 + math.sin(turn) * way_x + math.cos(turn) * way_y
        assert carried.referee.path(0)[-1] == pytest.approx(end, abs=1e-9)
        seen = [np.array([o[:3] for _, o in run.machines[0].observed]) for run in (plain, carried)]
        if turn_before is None:  # after the stop its ways, and with them the drift, are others
            assert seen[1][:21] == pytest.approx(seen[0][:21], abs=1e-9)
            assert seen[1][-1] == pytest.approx(seen[0][-1], abs=0.2 if drift else 1e-9)
        else:
            assert seen[1] == pytest.approx(seen[0], abs=1e-9)


def test_a_robot_that_knows_the_worlds_frame_knows_where_it_has_been_put():
    run = executed(moved(0, 2.0, 12.0, 12.0, heading_deg=90.0), use=VIEWING, far_m=4.0, duration_s=25.0, size=1)
    places = np.array([observation[:2] for _, observation in run.machines[0].observed])
    assert places[20].tolist() == [12.0, 12.0]
    assert places == pytest.approx(run.referee.path(0), abs=1e-12)
    assert run.referee.path(0)[-1].tolist() == [5.0, 5.0]


def test_a_rigid_motion_brings_the_one_pose_to_the_other_and_keeps_distances():
    carry = Carry((1.0, 2.0, 0.5), (-3.0, 4.0, 2.0))
    assert carry.pose(1.0, 2.0, 0.5) == (-3.0, 4.0, 2.0)
    x, y, heading = carry.pose(1.0 + math.cos(0.5), 2.0 + math.sin(0.5), 0.0)
    assert (x, y, heading) == pytest.approx((-3.0 + math.cos(2.0), 4.0 + math.sin(2.0), 1.5))


# ---------------------------------------------------------------- cameras


def visible(run: Simulation, robot: int) -> list[int]:
    """Return the ticks at which *robot* sees anybody."""
    return [now // TICK for now, observation in run.machines[robot].observed if observation.visible]  # type: ignore[attr-defined]


@pytest.mark.parametrize("use", [SEEING, VIEWING])
def test_a_camera_that_is_off_sees_no_robot(use: str):
    run = executed(camera_off(1, 0.25, 0.6), use=use, duration_s=1.0)
    assert visible(run, 1) == [0, 1, 2, 6, 7, 8, 9]
    assert visible(run, 0) == list(range(10))
    assert rows(run) == [(250 * MS, 1, "CameraOff"), (600 * MS, 1, "CameraOn")]
    assert all(len(o.sightings) == len(o.visible) * (use == VIEWING) for _, o in run.machines[1].observed)


def test_a_camera_that_is_off_sees_no_point_but_the_scanner_goes_on():
    run = Simulation(scenario(camera_off(1, 0.05), use=VIEWING, duration_s=0.15), 1)
    run.run()
    one, other = (run.machines[robot].observed[-1][1] for robot in (0, 1))
    assert one.sees([(1.5, 5.0), (2.0, 5.0), (1.5, 5.5)]) == [True] * 3
    assert other.sees([(1.5, 5.0)]) == [False]
    assert other.sees([(1.5, 5.0), (2.0, 5.0), (1.5, 5.5)]) == [False] * 3
    assert np.isfinite(other.ranges_m).any()


def test_a_camera_that_is_on_again_sees_with_its_next_picture():
    senses = {"senses": {"camera_period_s": 0.5}}
    run = executed(camera_off(1, 0.7, 1.2), use=VIEWING, duration_s=2.0, team=senses)
    assert visible(run, 1) == [*range(7), *range(15, 20)]
    assert visible(run, 0) == list(range(20))


def test_a_camera_that_is_off_between_two_pictures_misses_none():
    run = executed(camera_off(1, 0.71, 0.74), use=VIEWING, duration_s=1.0)
    assert visible(run, 1) == list(range(10))


def test_all_cameras_off_leave_nobody_in_sight():
    run = executed(camera_off(1, 0.25, 0.6), camera_off(0, 0.25), use=VIEWING, duration_s=1.0)
    assert visible(run, 0) == [0, 1, 2]
    assert visible(run, 1) == [0, 1, 2, 6, 7, 8, 9]


def test_these_faults_survive_a_file(tmp_path: Path):
    faults = [frozen(0, 1.0, 2.0), camera_off(0, 1.0), moved(1, 1.0, 4.0, 4.0)]
    plain = {"duration_s": 2.0, "protocol": {"use": "tests.faults.fault_scene:SPEC"}, "faults": faults}
    plain |= {"floorplan": {"map": "walls", "bounds_m": [0, 0, 20, 20]}, "team": {"size": 2}}
    made = build(plain, "depot.yaml", tmp_path)
    assert simulate(made, 1).digest == simulate(build(made.model_dump(mode="json"), "x", tmp_path), 1).digest
