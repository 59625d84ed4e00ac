"""Where robots take themselves to be: what is sensed in one frame and told in the map's, and drives by a filter."""

import itertools
import math
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as st

from cosim.arrays import Floats, Int64s
from cosim.errors import UserError
from cosim.geometry.segments import clearance, segment_grid
from cosim.machine import Event
from cosim.navigation.schemas import beam_directions
from cosim.observation import Observation, Sighting
from protocols.localization.positioning import Given, KnownMaps, Positioned, shifted
from protocols.localization.scan import SAME_M, Scan, Sensor, turned_ranges, without_bodies
from protocols.motion.frames import Shift
from tests.protocols.localization.positioning_scene import (
    BEAMS,
    RADIUS_M,
    WALLS,
    Drifting,
    Scanned,
    charts,
    localised,
    scanned,
    surroundings_of,
    told,
)

ANGLES = 2.0 * np.pi * np.arange(BEAMS) / BEAMS
POSE = (12.0, 5.0, 0.4)
FRAMES = st.tuples(st.floats(-30, 30), st.floats(-30, 30), st.floats(-math.pi, math.pi))


# ---------------------------------------------------------------- frames


@settings(max_examples=40)
@given(FRAMES, FRAMES)
def test_the_shift_between_two_poses_takes_one_to_the_other(before: Any, after: Any) -> None:
    found = Shift.between(before, after).pose(before)
    assert found[:2] == pytest.approx(after[:2], abs=1e-9)
    assert math.remainder(found[2] - after[2], math.tau) == pytest.approx(0.0, abs=1e-9)


@settings(max_examples=40)
@given(FRAMES, st.floats(-30, 30), st.floats(-30, 30))
def test_a_shifted_point_comes_back(frame: Any, x_m: float, y_m: float) -> None:
    shift = Shift(*frame)
    assert shift.back(*shift.point(x_m, y_m)) == pytest.approx((x_m, y_m), abs=1e-9)


def test_who_is_seen_stays_where_it_is_seen_from_the_robot() -> None:
    seen = told((5.0, 4.0, 1.1), Sighting(2, 5.0 + 0.7 * math.cos(1.6), 4.0 + 0.7 * math.sin(1.6)))
    found = shifted(seen, Shift.between((5.0, 4.0, 1.1), POSE), None)
    assert found[:3] == pytest.approx(POSE)
    assert (found[3:6], found.visible) == (seen[3:6], seen.visible)
    ((other, x_m, y_m),) = found.sightings
    assert other == 2
    assert math.hypot(x_m - POSE[0], y_m - POSE[1]) == pytest.approx(0.7)
    assert math.atan2(y_m - POSE[1], x_m - POSE[0]) - POSE[2] == pytest.approx(0.5)


def test_points_of_the_map_are_looked_for_in_the_frame_of_odometry() -> None:
    seen = told((5.0, 4.0, 1.1))
    shift = Shift(2.0, -3.0, 0.5 * math.pi)
    assert seen.view is not None
    found = shifted(seen, shift, Scan(seen.view, Sensor(BEAMS), None))
    assert found.sees([shift.point(1.0, 7.0), shift.point(-1.0, 7.0)]) == [True, False]
    near, far = found.detects([(1.0, 2.0), (5.0, 0.0)], 3.0)  # marks are of the world, what is detected is on the map
    assert near == pytest.approx(shift.point(2.0, 2.0))
    assert far is None


# ---------------------------------------------------------------- scans


HALL = np.array([(0, 0, 7, 0), (7, 0, 9, 4), (9, 4, 3, 6), (3, 6, 0, 0)], np.float64)
"""A convex room: each beam meets one of four walls."""
INSIDE = (3.7, 2.9)


def ring(turned_rad: float) -> tuple[Floats, Int64s]:
    """Return how far the beams go in the hall, of a frame turned by an angle, and which wall each meets."""
    ways = np.stack((np.cos(ANGLES + turned_rad), np.sin(ANGLES + turned_rad)), axis=1)
    along = HALL[:, 2:] - HALL[:, :2]
    outward = np.stack((along[:, 1], -along[:, 0]), axis=1)
    off, speed = ((HALL[:, :2] - INSIDE) * outward).sum(axis=1), ways @ outward.T
    lengths = np.where(speed > 1e-9, off / np.maximum(speed, 1e-9), math.inf)
    return lengths.min(axis=1), lengths.argmin(axis=1)


@settings(max_examples=40)
@given(st.floats(-math.pi, math.pi))
@example(0.0)
@example(7.0 * math.tau / BEAMS)
def test_a_scan_of_a_known_pose_is_told_along_the_directions_of_the_map_exactly(turned_rad: float) -> None:
    """But next to corners, where beams have met two walls, and where the next beam meets a wall much farther off."""
    (scan_m, walls), (true_m, _) = ring(turned_rad), ring(0.0)
    before = np.floor((ANGLES - turned_rad) / (math.tau / BEAMS)).astype(int)
    around = [np.array([k - 1, k, k + 1, k + 2]) % BEAMS for k in before]
    flat = [len(set(walls[each])) == 1 and np.ptp(scan_m[each[1:3]]) < 0.999 * SAME_M for each in around]
    assert sum(flat) > 0.8 * BEAMS
    told_m = turned_ranges(scan_m, turned_rad, SAME_M)
    np.testing.assert_allclose(told_m[flat], true_m[flat], rtol=0, atol=1e-9)
    assert abs(told_m - true_m).max() < SAME_M


@settings(max_examples=40)
@given(st.floats(-math.pi, math.pi))
def test_where_one_beam_has_met_a_near_wall_and_the_next_a_far_one_the_nearer_beam_counts(turned_rad: float) -> None:
    near = (ANGLES > 1.0) & (ANGLES < 2.0)
    beam = (ANGLES - turned_rad) / (math.tau / BEAMS)
    back = np.round(beam).astype(int) % BEAMS
    clear = np.abs(beam - np.floor(beam) - 0.5) > 1e-6
    for far_m in (math.inf, 1.0 + 1.01 * SAME_M):
        told_m = turned_ranges(np.where(near, 1.0, far_m), turned_rad, SAME_M)
        np.testing.assert_array_equal((told_m < 1.0 + 0.5 * SAME_M)[clear], near[back][clear])


def test_a_scan_is_taken_once_a_tick_and_only_if_it_is_wanted() -> None:
    view = Scanned(scanned(POSE))
    scan = Scan(view, Sensor(BEAMS), None)
    assert view.asked == 0
    scan.along_m(0.3)
    scan.of_walls_m(POSE[:2], (), ())
    assert view.asked == 1


def test_a_filter_that_does_not_look_has_nothing_scanned() -> None:
    filter_ = localised()
    views = []
    for tick in range(10):
        seen = told((POSE[0] + 0.01 * tick, *POSE[1:]), ranges_m=scanned(POSE))
        filter_.locate(seen)
        views.append(seen.view)
    assert [view.asked for view in views] == [1] + [0] * 9  # type: ignore[union-attr]


def test_beams_that_have_met_a_robot_in_sight_are_left_out() -> None:
    ranges = np.full(BEAMS, math.inf)
    ranges[80:101] = 0.8  # a body of 0.25 m in the west, 1 m off, and what stands behind it
    ranges[10] = 1.9
    beams, here = beam_directions(BEAMS), (1.0, 1.0)
    kept = without_bodies(ranges, beams, here, (Sighting(1, 0.0, 1.0),), (0.25, 0.25))
    assert np.isnan(kept[82:99]).all()
    assert kept[10] == 1.9
    assert np.isinf(kept[[0, 70, 110]]).all()
    behind = np.where(ranges == 0.8, 1.7, ranges)
    assert not np.isnan(without_bodies(behind, beams, here, (Sighting(1, 0.0, 1.0),), (0.25, 0.25))).any()
    assert without_bodies(ranges, beams, here, (), ()) is ranges


def test_a_ring_of_sonars_has_some_of_the_beams_and_reaches_less_far() -> None:
    scan = Scan(Scanned(scanned(POSE)), Sensor(BEAMS, 8, 2.0), None)
    true_m, kept = scanned(POSE), np.arange(BEAMS) % 8 == 0
    told_m = scan.along_m(0.0)
    assert np.isinf(told_m[~kept]).all()
    np.testing.assert_array_equal(told_m[kept], np.where(true_m <= 2.0, true_m, math.inf)[kept])
    assert 3 < np.count_nonzero(np.isfinite(told_m)) < np.count_nonzero(kept)
    own = scan.of_walls_m(POSE[:2], (), ())
    assert own.shape == Sensor(BEAMS, 8).directions.shape[:1] == (23,)
    np.testing.assert_array_equal(own, told_m[kept])


def test_noise_of_a_sensor_is_its_own_and_nothing_becomes_of_a_beam_that_met_nothing() -> None:
    scan = Scan(Scanned(np.where(ANGLES < 3.0, 4.0, math.inf)), Sensor(BEAMS, 1, 5.0, 0.1), np.random.default_rng(1))
    told_m = scan.along_m(0.0)
    off = told_m[ANGLES < 3.0] - 4.0
    assert np.isinf(told_m[ANGLES >= 3.0]).all()
    assert 0.05 < off.std() < 0.15
    np.testing.assert_array_equal(scan.along_m(0.0), told_m)


def off_walls(seen: Observation) -> Floats:
    """Return how far the ends of its beams are off the walls."""
    met = np.isfinite(seen.ranges_m)
    ends = np.array(seen[:2]) + seen.ranges_m[met, None] * beam_directions(BEAMS)[met]
    return clearance(segment_grid(WALLS), ends, 2.0)


# ---------------------------------------------------------------- what is given


def test_what_is_given_is_taken_as_it_is() -> None:
    seen = told(POSE)
    assert Given(Sensor(BEAMS), (0.0, 0.0, 0.0)).locate(seen) is seen


def test_what_is_given_in_a_frame_of_its_own_is_told_in_that_of_the_map() -> None:
    frame = (1.0, 2.0, 0.5)
    seen = told((3.0, 0.0, 0.1), ranges_m=scanned(Shift(*frame).pose((3.0, 0.0, 0.1)), 0.5))
    found = Given(Sensor(BEAMS), frame).locate(seen)
    assert found[:3] == pytest.approx((1.0 + 3.0 * math.cos(0.5), 2.0 + 3.0 * math.sin(0.5), 0.6))
    assert np.median(off_walls(found)) < 1e-6


# ---------------------------------------------------------------- maps


@pytest.mark.parametrize("cell_m", [0.05, 0.1, 0.23])
def test_the_known_map_has_a_wall_in_the_cells_whose_middles_are_within_half_a_cell_of_it(cell_m: float) -> None:
    walls = np.array([(0.0, 0.0, 3.0, 0.0), (0.4, 0.3, 2.0, 1.7), (3.0, 0.0, 3.0, 2.0)])
    made = charts([tuple(wall) for wall in walls]).known(cell_m, 0.1)
    ny, nx = made.occupied.shape
    lines = shapely.MultiLineString([[wall[:2], wall[2:]] for wall in walls.tolist()])
    for iy, ix in itertools.product(range(ny), range(nx)):
        centre = made.origin_m[0] + (ix + 0.5) * cell_m, made.origin_m[1] + (iy + 0.5) * cell_m
        off = lines.distance(shapely.Point(centre))
        if abs(off - 0.5 * cell_m) > 1e-6:
            assert made.occupied[iy, ix] == (off < 0.5 * cell_m)
    for cell in made.standing.tolist():
        x_m, y_m = made.origin_m[0] + (cell % nx + 0.5) * cell_m, made.origin_m[1] + (cell // nx + 0.5) * cell_m
        assert 0.0 <= x_m <= 3.0
        assert 0.0 <= y_m <= 2.0


def test_maps_are_made_once_for_all_who_have_such_cells() -> None:
    made = charts()
    assert made.known(0.2, 0.25) is made.known(0.2, 0.25)
    assert made.known(0.1, 0.25) is not made.known(0.2, 0.25)
    with pytest.raises(UserError, match="no cell is free"):
        made.known(0.2, 30.0)


def test_a_map_needs_no_walls() -> None:
    made = KnownMaps(surroundings_of(np.empty((0, 4)), (0.0, 0.0, 2.0, 1.0))).known(0.1, 0.2)
    assert not made.occupied.any()
    assert len(made.standing) == 20 * 10


# ---------------------------------------------------------------- the filter


def followed(seed: int = 1, **own: Any) -> list[Observation]:
    """Return where a robot takes itself to be on a straight way whose odometry bends to the left."""
    filter_, found = localised(seed=seed, **own), []
    for step in range(120):
        turned = 0.003 * step
        pose = 3.0 + 0.05 * step, 5.2, 0.0
        x_m = 3.0 + sum(0.05 * math.cos(0.003 * k) for k in range(step))
        y_m = 5.2 + sum(0.05 * math.sin(0.003 * k) for k in range(step))
        found.append(filter_.locate(told((x_m, y_m, turned), ranges_m=scanned(pose, -turned))))
    return found


def test_a_filter_follows_a_robot_whose_odometry_bends() -> None:
    found = followed()
    errors = [math.dist(seen[:2], (3.0 + 0.05 * step, 5.2)) for step, seen in enumerate(found)]
    assert max(errors) < 0.15
    assert max(abs(seen.heading_rad) for seen in found) < 0.06
    assert np.median(off_walls(found[-1])) < 0.1


def stood(**own: Any) -> list[tuple[float, float]]:
    """Return where a robot that stands takes itself to be, tick by tick, after being told to be 0.3 m beside."""
    filter_, true = localised(frame=(0.0, 0.3, 0.0), start_m=0.3, **own), (12.0, 4.6, 0.0)
    return [filter_.locate(told(true, ranges_m=scanned(true)))[:2] for _ in range(40)]


def test_corrections_come_little_by_little_but_great_ones_at_once() -> None:
    """The way that is left to where the filter has a robot falls by the same share every tick."""
    found = stood(settle_s=0.3)
    assert math.dist(found[-1], (12.0, 4.6)) < 0.1
    left = [math.dist(each, stood(settle_s=0.0)[0]) for each in found[:6]]
    assert left[0] > 0.1
    assert [later / before for before, later in itertools.pairwise(left)] == pytest.approx([math.exp(-1 / 3)] * 5)
    assert stood(settle_s=0.3, jump_m=0.1)[0] == stood(settle_s=0.0)[0]


def test_the_same_stream_gives_the_same_places() -> None:
    places = [[seen[:3] for seen in followed(seed)] for seed in (1, 1, 2)]
    assert places[0] == places[1]
    assert places[0] != places[2]


def test_a_robot_that_sees_nothing_goes_on_by_odometry() -> None:
    filter_ = localised(frame=(1.0, 2.0, 0.5))
    blind = Observation(3.0, 0.0, 0.1, 0.3, True, False)
    assert filter_.locate(blind)[:3] == pytest.approx(Shift(1.0, 2.0, 0.5).pose((3.0, 0.0, 0.1)))
    assert filter_.locate(blind).view is None
    short = told((3.0, 0.0, 0.1), ranges_m=np.empty(0))
    assert math.dist(filter_.locate(short)[:2], Shift(1.0, 2.0, 0.5).point(3.0, 0.0)) < 0.1


def test_once_a_second_it_is_noted_where_the_robot_takes_itself_to_be() -> None:
    events: list[Event] = []
    filter_ = localised(events)
    for _ in range(21):
        filter_.locate(told(POSE, ranges_m=scanned(POSE)))
    assert [type(event) for event in events] == [Positioned] * 3
    assert isinstance(events[-1], Positioned)
    assert math.dist((events[-1].x_m, events[-1].y_m), POSE[:2]) < 0.1
    assert events[-1].share == pytest.approx(1.0)


# ---------------------------------------------------------------- drives

STARTS = [(2.0, 5.2), (1.0, 4.8)]
LEGS = [[(22.0, 5.2), (20.0, 3.0)], [(17.0, 8.5), (8.0, 2.0)]]


def driven(scene: Drifting) -> list[float]:
    """Return how far off each goal, in truth, robots have ended."""
    off = []
    for goals in LEGS:
        for mover, goal in zip(scene.movers, goals, strict=True):
            mover.go(goal)
        scene.run(90.0, scene.all_there)
        off += [math.dist(scene.place(me), goal) for me, goal in enumerate(goals)]
    return off


@pytest.mark.slow
@pytest.mark.parametrize(
    ("sensor", "tolerance_m"), [(Sensor(BEAMS), 0.25), (Sensor(BEAMS, 8, 5.0, 0.03), 0.3)], ids=["laser", "sonar"]
)
def test_robots_that_localise_end_where_they_are_to_be_though_their_odometry_drifts(
    sensor: Sensor, tolerance_m: float
) -> None:
    scene = Drifting(STARTS, sensor=sensor)
    assert max(driven(scene)) < tolerance_m
    assert {mover.state for mover in scene.movers} == {"arrived"}
    assert scene.worst_m < tolerance_m
    assert scene.least_gap_m > 0.0


@pytest.mark.slow
def test_without_a_filter_they_do_not() -> None:
    assert max(driven(Drifting(STARTS, filters=False))) > 1.0


@pytest.mark.slow
@pytest.mark.parametrize("cell_m", [0.05, 0.2])
def test_robots_localise_on_maps_with_cells_of_their_own(cell_m: float) -> None:
    scene = Drifting(STARTS, cell_m=cell_m)
    assert max(driven(scene)) < 0.3


def test_a_map_is_for_the_body_that_stands_on_it() -> None:
    small, large = charts().known(0.1, RADIUS_M), charts().known(0.1, 2.0 * RADIUS_M)
    assert set(large.standing.tolist()) < set(small.standing.tolist())
