"""What robots sense, against shapely and against the paper's equations: frames, sight, errors, beams, drift."""

import math
from typing import Any

import numpy as np
import pytest
import shapely
from scipy import stats

from cosim.geometry.segments import SegmentGrid, packed_walls, segment_grid
from cosim.machine import Drive, GoTo
from cosim.observation import Observation
from cosim.randomness import Streams
from cosim.robots.body import BodySettings
from cosim.robots.motion import Fleet
from cosim.robots.senses import Frame, Senses, SenseSettings
from cosim.units import MS

TICK = 100 * MS
NO_WALLS = segment_grid(np.empty((0, 4)))
RADIUS_M = 0.2


class Scene:
    """Robots at *places*, (x, y) or (x, y, heading), and their senses."""

    def __init__(
        self,
        places: list[tuple[float, ...]],
        walls: SegmentGrid = NO_WALLS,
        frames: list[Frame] | None = None,
        range_m: float = 20.0,
        seed: int = 1,
        **settings: Any,
    ) -> None:
        body = BodySettings(radius_m=RADIUS_M, drive="omni", speed_mps=1.0, acceleration_mps2=100.0)
        headings = [place[2] if len(place) > 2 else 0.0 for place in places]
        self.fleet = Fleet([body] * len(places), [place[:2] for place in places], walls, TICK, headings_rad=headings)
        self.frames = frames or [(0.0, 0.0, 0.0)] * len(places)
        self.senses = Senses(
            SenseSettings(**settings),
            packed_walls(walls),
            [RADIUS_M] * len(places),
            self.frames,
            range_m,
            TICK,
            Streams(seed),
        )

    def look(self) -> list[Observation]:
        return self.senses.observe(self.fleet)

    def tick(self, *commands: tuple[int, Any]) -> list[Observation]:
        self.fleet.apply((robot, self.senses.in_world(robot, command)) for robot, command in commands)
        self.fleet.step()
        return self.look()


def random_walls(seed: int, count: int = 30) -> np.ndarray[Any, Any]:
    ends = np.random.default_rng(seed).uniform(0, 10, (count, 2))
    return np.hstack((ends, ends + np.random.default_rng(seed + 1).uniform(-2, 2, (count, 2))))


# ---------------------------------------------------------------- what is seen


@pytest.mark.parametrize("seed", range(5))
def test_a_point_is_seen_where_shapely_finds_no_wall_before_it_and_it_is_in_range(seed: int) -> None:
    walls = random_walls(seed)
    frame = (3.0, -2.0, 0.7)
    scene = Scene([(5.05, 4.95)], segment_grid(walls), [frame], range_m=4.0)
    (observation,) = scene.look()
    points = np.random.default_rng(100 + seed).uniform(0, 10, (400, 2))
    lines = shapely.linestrings([[(5.05, 4.95), point] for point in points])
    blocked = shapely.intersects(lines, shapely.multilinestrings(walls.reshape(-1, 2, 2)))
    expected = (~blocked & (shapely.length(lines) <= 4.0)).tolist()
    assert observation.sees([in_frame(frame, *point) for point in points]) == expected
    assert 20 < sum(expected) < 300


def in_frame(frame: Frame, x_m: float, y_m: float) -> tuple[float, float]:
    """Return a point of the world in *frame*, by complex numbers."""
    own = (complex(x_m, y_m) - complex(frame[0], frame[1])) * complex(math.cos(frame[2]), -math.sin(frame[2]))
    return own.real, own.imag


@pytest.mark.parametrize("seed", range(5))
def test_a_mark_of_the_world_is_detected_where_shapely_finds_no_wall_before_the_body_and_it_is_in_range(
    seed: int,
) -> None:
    walls = random_walls(seed)
    frame = (3.0, -2.0, 0.7)
    scene = Scene([(5.05, 4.95)], segment_grid(walls), [frame], range_m=5.0)
    (observation,) = scene.look()
    marks = np.random.default_rng(100 + seed).uniform(0, 10, (400, 2))
    lines = shapely.linestrings([[(5.05, 4.95), mark] for mark in marks])
    blocked = shapely.intersects(lines, shapely.multilinestrings(walls.reshape(-1, 2, 2)))
    expected = (~blocked & (shapely.length(lines) <= 4.0)).tolist()
    found = observation.detects([tuple(mark) for mark in marks.tolist()], 4.0)
    assert [place is not None for place in found] == expected
    assert 20 < sum(expected) < 300
    for place, mark in zip(found, marks, strict=True):
        assert place is None or place == pytest.approx(in_frame(frame, *mark))


def test_who_is_off_by_a_metre_detects_what_its_body_sees_and_takes_it_to_be_off_as_much() -> None:
    """The robot believes to be a metre north of where it is, and to be turned by a quarter to the left of that."""
    scene = Scene([(5.0, 5.0)], segment_grid([[4.0, 5.5, 6.0, 5.5]]))
    scene.look()
    scene.senses.poses[0, 3:6] = 5.0, 6.0, math.pi / 2.0
    view = scene.senses.view_from(0, scene.senses.poses, 0)
    marks = [(5.0, 4.0), (7.0, 5.0), (5.0, 6.5)]  # the last is behind a wall, though not by belief
    south, east, hidden = view.detects(marks, 2.5)
    assert south == pytest.approx((6.0, 6.0))
    assert east == pytest.approx((5.0, 8.0))
    assert hidden is None
    assert view.detects(marks, 1.5) == [south, None, None]


def test_who_knows_its_pose_detects_marks_just_where_they_are() -> None:
    """Without rounding: with true positions nothing depends on how a mark was looked for."""
    places = np.random.default_rng(1).uniform(-30.0, 30.0, (50, 2)).tolist()
    (observation,) = Scene([(170.1, -230.7, 2.9)], range_m=500.0).look()
    marks = [(x, y) for x, y in places]
    assert observation.detects(marks, 500.0) == marks


def test_a_blind_camera_detects_nothing() -> None:
    scene = Scene([(0.0, 0.0)])
    scene.senses.blind(0, True)
    assert scene.look()[0].detects([(1.0, 0.0)], 5.0) == [None]


def test_robots_see_each_other_where_they_are_each_in_its_own_frame() -> None:
    walls = segment_grid([[2.0, -1.0, 2.0, 1.0]])
    frames = [(0.0, 0.0, math.pi / 2), (4.0, 0.0, math.pi), (1.0, 2.0, 0.0)]
    first, second, third = Scene([(0, 0), (4, 0), (1, 2)], walls, frames).look()
    assert (first.x_m, first.y_m, first.visible) == (0.0, 0.0, (2,))
    assert first.sightings[0] == pytest.approx((2, 2.0, -1.0))
    assert second.visible == (2,)
    assert second.sightings[0] == pytest.approx((2, 3.0, -2.0))
    assert [sighting.address for sighting in third.sightings] == [0, 1]
    assert third.sightings[1] == pytest.approx((1, 3.0, -2.0))
    assert third.heading_rad == 0.0
    assert first.heading_rad == pytest.approx(-math.pi / 2)


def test_the_range_of_sight_holds_for_robots_and_for_points() -> None:
    near, far = Scene([(0, 0), (3, 0)], range_m=3.0).look()[0], Scene([(0, 0), (3.001, 0)], range_m=3.0).look()[0]
    assert (near.visible, far.visible) == ((1,), ())
    assert far.sees([(0.0, 3.0), (0.0, 3.001)]) == [True, False]


def test_a_camera_sees_only_its_field_of_view_about_the_heading() -> None:
    robots = [(0.0, 0.0, math.pi / 2), (1.0, 1.05, 0.0), (1.05, 1.0, 0.0), (-1.0, 1.05, 0.0), (0.0, -1.0, 0.0)]
    ahead = Scene(robots, field_of_view_deg=90.0).look()[0]
    assert ahead.visible == (1, 3)
    assert ahead.sees([(0.0, 2.0), (2.0, 0.0), (0.0, -2.0)]) == [True, False, False]


def test_bodies_hide_what_stands_behind_them_if_that_is_asked_for() -> None:
    robots = [(0.0, 0.0), (2.0, 0.1), (4.0, 0.0), (4.0, 1.0)]
    assert Scene(robots).look()[0].visible == (1, 2, 3)
    (first, *_) = Scene(robots, bodies_occlude=True).look()
    assert first.visible == (1, 3)
    # 0.1 m off the line a body of 0.2 m covers it; the line to (3, 0.75) passes 0.39 m beside it; (4, 1) is covered
    assert first.sees([(4.0, 0.0), (1.0, 0.0), (3.0, 0.75), (4.0, 1.0)]) == [False, True, True, False]


def test_between_two_pictures_robots_are_seen_where_they_were() -> None:
    scene = Scene([(0.0, 0.0), (2.0, 0.0)], camera_period_s=0.3)
    seen = [scene.look()[0].sightings[0].x_m]
    seen += [scene.tick((1, GoTo(9.0, 0.0)))[0].sightings[0].x_m for _ in range(6)]
    # a command acts from the first step on: the body has moved at the ticks after it
    assert seen == pytest.approx([2.0, 2.0, 2.0, 2.2, 2.2, 2.2, 2.5])


# ---------------------------------------------------------------- errors


def errors(error: float, part: float, distance_m: float = 4.0) -> tuple[Any, Any]:
    """Return relative errors of the distance and errors of the direction (rad) over many looks."""
    scene = Scene([(0.0, 0.0), (distance_m, 0.0)], distance_error=error, bearing_error=part)
    places = [scene.look()[0].sightings[0] for _ in range(4000)]
    x, y = np.array([place.x_m for place in places]), np.array([place.y_m for place in places])
    return np.hypot(x, y) / distance_m - 1.0, np.arctan2(y, x)


def test_distances_are_wrong_by_a_uniform_share_and_directions_by_a_share_of_half_the_apparent_size() -> None:
    distance, direction = errors(0.3, 1.0)
    half = math.atan2(2 * RADIUS_M, 2 * 4.0)
    assert stats.kstest(distance, stats.uniform(-0.3, 0.6).cdf).pvalue > 0.001
    assert stats.kstest(direction, stats.uniform(-half, 2 * half).cdf).pvalue > 0.001
    assert abs(np.corrcoef(distance, direction)[0, 1]) < 0.06


def test_each_error_can_be_left_out() -> None:
    distance, direction = errors(0.3, 0.0)
    assert np.abs(distance).max() > 0.29
    assert np.abs(direction).max() < 1e-12
    distance, direction = errors(0.0, 0.5)
    assert np.abs(distance).max() < 1e-12
    assert 0.024 < np.abs(direction).max() <= 0.5 * math.atan2(RADIUS_M, 4.0)


def test_errors_depend_on_the_seed_and_the_pair_not_on_who_else_is_seen() -> None:
    def seen(places: list[tuple[float, ...]], seed: int = 1) -> Any:
        return Scene(places, distance_error=0.3, bearing_error=1.0, seed=seed).look()[0].sightings[0]

    assert seen([(0, 0), (4, 0)]) == seen([(0, 0), (4, 0), (0, 4)])
    assert seen([(0, 0), (4, 0)]) != seen([(0, 0), (4, 0)], seed=2)


# ---------------------------------------------------------------- beams


def test_beams_end_at_the_first_wall_or_body() -> None:
    walls = random_walls(3)
    frame = (0.0, 0.0, 0.3)
    scene = Scene([(5.05, 4.95), (5.9, 4.95)], segment_grid(walls), [frame, frame], beams=64, beam_range_m=3.0)
    ranges = scene.look()[0].ranges_m
    solid = shapely.union_all(
        [shapely.multilinestrings(walls.reshape(-1, 2, 2)), shapely.Point(5.9, 4.95).buffer(RADIUS_M, 256)]
    )
    here = shapely.Point(5.05, 4.95)
    met = 0
    for k, found in enumerate(ranges):
        angle = 0.3 + 2 * math.pi * k / 64
        beam = shapely.LineString([here, (5.05 + 3 * math.cos(angle), 4.95 + 3 * math.sin(angle))])
        hit = shapely.intersection(beam, solid)
        expected = math.inf if hit.is_empty else shapely.distance(here, hit)
        assert found == pytest.approx(expected, abs=1e-4), k
        met += not hit.is_empty
    assert 10 < met < 64


# ---------------------------------------------------------------- frames and odometry


def test_commands_are_meant_in_the_robots_own_frame() -> None:
    scene = Scene([(1.0, 1.0)], frames=[(1.0, 1.0, math.pi / 2)])
    (before,) = scene.look()
    for _ in range(40):
        (after,) = scene.tick((0, GoTo(2.0, 0.0)))
    assert (before.x_m, before.y_m) == (0.0, 0.0)
    assert (after.x_m, after.y_m) == pytest.approx((2.0, 0.0))
    assert scene.fleet.positions_m[0] == pytest.approx((1.0, 3.0))


def driven(seconds: float, **settings: Any) -> tuple[Observation, Any]:
    scene = Scene([(0.0, 0.0)], frames=[(0.0, 0.0, 0.0)], **settings)
    scene.look()
    for _ in range(int(seconds * 10) + 1):
        (observation,) = scene.tick((0, Drive(1.0, 0.0)))
    return observation, scene.fleet.positions_m[0]


def test_without_drift_a_robot_knows_where_it_is() -> None:
    observation, truth = driven(30.0)
    assert (observation.x_m, observation.y_m) == pytest.approx(tuple(truth), abs=1e-12)
    assert truth[0] == pytest.approx(30.0)


def test_slip_makes_the_way_wrong_and_turning_the_direction() -> None:
    slipped, _ = driven(30.0, odometry_slip=0.2)
    assert slipped.y_m == 0.0
    # 300 ticks of 0.1 m, each wrong by U[-0.2, 0.2]: standard deviation 0.1 * 0.2 / sqrt(3) * sqrt(300) = 0.2 m
    assert 0.001 < abs(slipped.x_m - 30.0) < 0.8
    headings = [driven(4.0, odometry_turn_rad=0.1, seed=seed)[0].heading_rad for seed in range(200)]
    # 40 ticks of 0.1 m, each by 0.1 U[-1, 1] sqrt(0.1): standard deviation 0.1 sqrt(4 / 3) = 0.1155 rad
    assert np.std(headings) == pytest.approx(0.1 * math.sqrt(4.0 / 3.0), rel=0.15)


def test_errors_of_odometry_may_grow_with_the_speed() -> None:
    """At 1 m/s a tick's way is 0.1 m: told for half of it, errors are twice as large."""
    for name in ("odometry_slip", "odometry_turn_rad"):
        grown, plain, same = (
            driven(4.0, **{name: error}, odometry_way_m=at_m)[0]
            for error, at_m in ((0.1, 0.05), (0.2, None), (0.2, 0.1))
        )
        assert (grown.x_m, grown.y_m, grown.heading_rad) == pytest.approx((plain.x_m, plain.y_m, plain.heading_rad))
        assert (same.x_m, same.y_m, same.heading_rad) == pytest.approx((plain.x_m, plain.y_m, plain.heading_rad))
        assert (plain.x_m, plain.y_m) != pytest.approx((4.1, 0.0), abs=1e-4)


def test_what_a_drifting_robot_sees_lies_relative_to_where_it_takes_itself_to_be() -> None:
    scene = Scene([(0.0, 0.0), (9.0, 3.0)], odometry_slip=0.3, odometry_turn_rad=0.3)
    scene.look()
    for _ in range(50):
        observation, _ = scene.tick((0, Drive(1.0, 0.0)))
    sighting, truth = observation.sightings[0], scene.fleet.positions_m
    far = math.dist(truth[0], truth[1])
    assert math.hypot(sighting.x_m - observation.x_m, sighting.y_m - observation.y_m) == pytest.approx(far)
    turned = math.atan2(sighting.y_m - observation.y_m, sighting.x_m - observation.x_m) - observation.heading_rad
    assert turned == pytest.approx(math.atan2(truth[1][1] - truth[0][1], truth[1][0] - truth[0][0]))
    assert math.dist((sighting.x_m, sighting.y_m), (9.0, 3.0)) > 0.05
    # and it drives to the robot that it sees, wherever it takes that to be
    for _ in range(80):
        observation, _ = scene.tick((0, GoTo(*observation.sightings[0][1:])))
    assert math.dist(*scene.fleet.positions_m) < 2 * RADIUS_M + 0.05
