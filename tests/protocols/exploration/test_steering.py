"""How a desired heading becomes motion: corrections that shrink, and beams that overrule the behaviour."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.arrays import Floats
from cosim.navigation.schemas import beam_directions
from protocols.exploration.parameters import SteeringParameters
from protocols.exploration.steering import Steering, free_heading, free_m, overruled, without_lone

RADIUS, MARGIN, SPEED = 0.2, 0.05, 0.3
OPEN = np.full(36, math.inf)
angles = st.floats(-math.pi, math.pi)
scans = st.lists(st.one_of(st.just(math.inf), st.floats(0.05, 2.5)), min_size=36, max_size=36).map(np.array)


def steering(beams: int = 36, **changes: Any) -> Steering:
    return Steering(SteeringParameters(**changes), beam_directions(beams), RADIUS, 1.0)


def turned(angle: float) -> float:
    return math.remainder(angle, math.tau)


# ---------------------------------------------------------------- without obstacles


@given(angles, angles)
def test_the_speed_is_constant_and_the_turn_is_towards_the_heading_in_proportion(
    desired: float, heading: float
) -> None:
    speed, turn = steering().drive(desired, heading, OPEN)
    error = turned(desired - heading)
    assert speed == SPEED
    assert turn == pytest.approx(max(-1.5, min(1.5, 2.0 * error)), abs=1e-9)


@given(angles, angles)
def test_corrections_shrink_as_the_heading_is_approached(desired: float, heading: float) -> None:
    before = math.inf
    robot = steering()
    for _ in range(60):
        turn = robot.drive(desired, heading, OPEN).turn_radps
        assert abs(turn) <= before + 1e-9
        before, heading = abs(turn), heading + 0.1 * turn
    assert turned(desired - heading) == pytest.approx(0.0, abs=1e-3)


def test_no_body_is_driven_faster_than_it_can_be() -> None:
    slow = Steering(SteeringParameters(fast_mps=0.9), beam_directions(36), RADIUS, 0.2)
    assert slow.drive(0.0, 0.0, OPEN).speed_mps == 0.2
    assert slow.drive(0.0, 0.0, np.full(36, 1.0)).speed_mps == 0.2


def test_a_robot_is_fast_only_where_nothing_is_near() -> None:
    robot = steering(fast_mps=0.6, fast_m=1.2)
    scan = OPEN.copy()
    for range_m, speed in ((1.21, 0.6), (1.19, 0.3)):
        scan[18] = range_m
        assert robot.drive(0.0, 0.0, scan).speed_mps == speed
    assert steering().drive(0.0, 0.0, OPEN).speed_mps == SPEED


def test_a_robot_without_a_scanner_drives_on() -> None:
    assert steering().drive(0.0, 0.0, np.empty(0)) == (SPEED, 0.0)


# ---------------------------------------------------------------- the sensors overrule


@given(angles, angles, scans)
def test_a_robot_never_drives_into_what_a_beam_has_met(desired: float, heading: float, scan: Floats) -> None:
    """For the time that it and one who comes towards it need to stop: the disc is moved on, with its margin."""
    speed = steering().drive(desired, heading, scan).speed_mps
    assert speed in (0.0, SPEED)
    beams, met = beam_directions(36), np.isfinite(scan)
    points = beams[met] * scan[met, None]
    ahead = points[points @ (math.cos(heading), math.sin(heading)) > 0.0]
    for seconds in np.linspace(0.0, 0.5, 26) if speed else []:
        place = speed * seconds * np.array((math.cos(heading), math.sin(heading)))
        assert (np.hypot(*(ahead - place).T) > RADIUS + MARGIN - 1e-9).all()


@given(angles, scans)
def test_a_robot_stands_only_where_something_is_before_it(heading: float, scan: Floats) -> None:
    if steering().drive(heading, heading, scan).speed_mps == 0.0:
        beams, met = beam_directions(36), np.isfinite(scan)
        points = (
            beams[met]
            * scan[met, None]
            @ np.array([[math.cos(heading), -math.sin(heading)], [math.sin(heading), math.cos(heading)]])
        )
        near = (points[:, 0] > 0) & (points[:, 0] < 0.5 * SPEED + RADIUS + MARGIN + 1e-9)
        assert (near & (np.abs(points[:, 1]) < RADIUS + MARGIN + 1e-9)).any()


def test_room_is_what_a_disc_can_go_until_it_touches() -> None:
    beams = beam_directions(4)
    wall = np.array([1.0, math.inf, 0.1, math.inf])
    assert free_m(wall, beams, 1.0, 0.0, 0.25) == pytest.approx(0.75)
    assert free_m(wall, beams, math.cos(0.2), math.sin(0.2), 0.25) == pytest.approx(
        math.cos(0.2) - math.sqrt(0.25**2 - math.sin(0.2) ** 2)
    )
    assert free_m(wall, beams, math.sin(0.1), math.cos(0.1), 0.25) == math.inf
    assert free_m(wall, beams, -1.0, 0.0, 0.25) < 0.0


@given(angles, angles, scans, st.sampled_from((0.0, RADIUS + MARGIN)), st.sampled_from((0.6, 1.2)))
def test_what_is_too_far_off_to_matter_does_not_change_what_is_found(
    desired: float, heading: float, scan: Floats, half_m: float, fast_mps: float
) -> None:
    """Against the room along all beams."""
    beams, memory = beam_directions(36), np.full((5, 36), math.inf)
    found, speed, room = overruled(memory, 0, scan, beams, desired, heading, half_m, SPEED, fast_mps, 1.2, 1)
    assert speed == (fast_mps if scan.min() > 1.2 else SPEED)
    assert (memory[0] == scan).all()
    assert found == pytest.approx(free_heading(scan, beams, desired, half_m, speed, 1), abs=0.0, nan_ok=True)
    whole = free_m(scan, beams, math.cos(heading), math.sin(heading), half_m)
    assert room == pytest.approx(whole, abs=1e-12) or min(room, whole) > speed  # a reading may lie on the edge


def test_a_wall_ahead_is_gone_round_on_one_side_and_the_side_is_kept() -> None:
    scan = OPEN.copy()
    scan[:3] = scan[-2:] = 0.5  # 20 degrees on both sides
    robot = steering()
    first = robot.drive(0.0, 0.0, scan).turn_radps
    assert first > 0.0
    assert robot.drive(-0.03, 0.0, scan).turn_radps > 0.0
    right = steering()
    scan[3:8] = 0.5
    assert right.drive(0.0, 0.0, scan).turn_radps < 0.0
    scan[3:8] = math.inf
    assert right.drive(0.0, 0.0, scan).turn_radps < 0.0


def test_without_a_margin_the_sensors_do_not_overrule() -> None:
    near = np.full(36, 0.21)
    assert steering(margin_m=None).drive(0.5, 0.0, near) == (SPEED, 1.0)
    assert steering().drive(0.5, 0.0, near).speed_mps == 0.0


def test_who_is_walled_in_turns_on_the_spot_towards_where_it_wants() -> None:
    assert steering().drive(0.5, 0.0, np.full(36, 0.3)) == (0.0, 1.0)


@pytest.mark.parametrize("seed", range(4))
def test_a_disc_in_a_room_never_touches_a_wall_wherever_it_is_told_to_go(seed: int) -> None:
    draw = np.random.default_rng(seed)
    beams, robot = beam_directions(90), steering(90)
    place, heading, desired, way = np.array((1.0, 0.8)), 0.0, 0.0, 0.0
    room = np.array((2.0, 1.5))
    for tick in range(300):
        with np.errstate(divide="ignore", invalid="ignore"):
            scan = np.nanmin(np.where(beams > 0, (room - place) / beams, -place / beams), axis=1, initial=math.inf)
        if tick % 20 == 0:
            desired = draw.uniform(-math.pi, math.pi)
        speed, turn = robot.drive(desired, heading, scan)
        heading += 0.1 * turn
        place = place + 0.1 * speed * np.array((math.cos(heading), math.sin(heading)))
        way += 0.1 * speed
        assert (place > RADIUS).all()
        assert (place < room - RADIUS).all()
    assert way > 3.0


def test_what_one_beam_alone_has_met_is_not_there() -> None:
    assert without_lone(np.array([9.0, 1.0, 9.0, 2.0, 3.0])).tolist() == [9.0, 9.0, 9.0, 3.0, 3.0]
    assert without_lone(np.array([1.0, 9.0, 9.0, 9.0])).tolist() == [9.0] * 4
    assert without_lone(np.empty(0)).tolist() == []


def test_two_robots_that_come_towards_each_other_stop_in_time() -> None:
    """Head on, a tick late, and at 1 m/s^2: at the least limit of acceleration that bodies have."""
    beams = beam_directions(360)
    place, speed, ordered = np.array((0.0, 2.0)), np.array((SPEED, SPEED)), np.array((SPEED, SPEED))
    robots = steering(360), steering(360)
    for _ in range(60):
        orders = []
        for me, heading in ((0, 0.0), (1, math.pi)):
            to = place[1 - me] - place[me]
            along, aside = beams[:, 0] * to, beams[:, 1] * to
            half = np.sqrt(np.maximum(RADIUS**2 - aside**2, 0.0))
            scan = np.where((along > 0) & (np.abs(aside) < RADIUS), along - half, math.inf)
            orders.append(robots[me].drive(heading, heading, scan).speed_mps)
        speed = speed + np.clip(ordered - speed, -0.1, 0.1)
        place = place + 0.1 * speed * np.array((1.0, -1.0))
        ordered = np.array(orders)
        assert place[1] - place[0] > 2 * RADIUS
    assert (speed == 0.0).all()


def test_a_robot_that_is_to_turn_about_turns_to_one_side_while_the_heading_trembles() -> None:
    robot = steering()
    first = robot.drive(math.pi - 0.05, 0.0, OPEN).turn_radps
    assert first > 0.0
    assert [robot.drive(math.pi + tremble, 0.1, OPEN).turn_radps for tremble in (0.3, -0.3, 0.3)] == [first] * 3
    assert robot.drive(-math.pi / 2, 0.1, OPEN).turn_radps < 0.0


def test_who_stands_before_something_and_is_to_turn_about_stands_until_it_has_turned() -> None:
    robot, end_on = steering(), OPEN.copy()
    end_on[0] = 0.3
    assert robot.drive(math.pi, 0.0, end_on).speed_mps == 0.0
    assert [robot.drive(math.pi, 0.2, OPEN).speed_mps for _ in range(20)] == [0.0] * 20
    assert robot.drive(math.pi, math.pi / 2 - 0.01, OPEN).speed_mps == 0.0
    assert robot.drive(math.pi, math.pi / 2 + 0.01, OPEN).speed_mps == SPEED
    assert robot.drive(math.pi, 0.0, OPEN).speed_mps == SPEED


def test_the_end_of_a_thin_wall_that_only_some_scans_meet_is_in_the_way() -> None:
    robot, end_on = steering(), OPEN.copy()
    end_on[0] = 0.3
    assert [robot.drive(0.0, 0.0, OPEN if k % 5 else end_on).speed_mps for k in range(20)] == [0.0] * 20
    assert [robot.drive(0.0, 0.0, OPEN).speed_mps for _ in range(3)] == [SPEED] * 3
