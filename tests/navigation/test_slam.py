"""SLAM: scans that pull particles back, a loop with odometry that drifts, and what a robot knows of its own error."""

import math

import numpy as np
import pytest
import scipy.ndimage
from pydantic import ValidationError

from cosim.geometry.segments import clearance
from cosim.navigation.schemas import beam_directions
from cosim.navigation.slam import (
    NUMBERS,
    SlamParameters,
    choose_ends,
    climb,
    field_fit,
    field_size,
    make_field,
    match_particles,
    settle_field,
    share_of_speed,
    stamp_of,
)
from tests.navigation.slam_scene import (
    BEAMS,
    CELL_M,
    ORIGIN_M,
    PLAIN,
    RANGE_M,
    ROOM,
    TWO_ROOMS,
    course,
    drive,
    off,
    scan,
    slam_at,
)

STRAY = 0.05
LOOP = [(0.9, 1.3), (4.2, 1.4), (7.2, 1.2), (7.3, 4.9), (4.1, 4.5), (1.0, 4.9), (0.9, 1.3)]
AWAY_AND_BACK = [(0.8, 1.1), (2.2, 1.2), (8.5, 1.2), (8.5, 1.9), (2.0, 1.5), (0.9, 1.1)]


def mapped_truly():
    """Return the evidence of a room marked from true poses, shape (1, ny, nx)."""
    poses = [(0.8, 1.2, 0.3), (2.9, 1.4, 2.0), (0.7, 2.3, -1.0)]
    maps = []
    for pose in poses:
        slam = slam_at(pose, particles=1)
        slam.observe(pose, scan(ROOM, pose, pose[2]))
        maps.append(slam.maps[0].astype(int))
    return np.clip(sum(maps), -40, 40).astype(np.int8)[np.newaxis]


def numbers_of(power=0.1, slack_m=0.1, slack_rad=0.1, news=0.5):
    numbers = np.array([power, slack_m, slack_rad, 0.05, 0.05, math.log(STRAY), math.log(news), 0.1])
    assert len(numbers) == NUMBERS
    return numbers


# ---------------------------------------------------------------- the field


def random_evidence(seed=1, shape=(30, 41)):
    draw = np.random.default_rng(seed)
    evidence = draw.choice(np.array([-5, 0, 7], np.int8), shape, p=[0.6, 0.3, 0.1])
    evidence[:, 25:] = 0
    evidence[14, 33] = 3
    return evidence


def test_the_field_is_the_distance_from_what_is_occupied():
    evidence, sigma_m = random_evidence(), 0.12
    stamp, field = stamp_of(sigma_m, STRAY, CELL_M), np.empty((19, 19), np.float32)
    distance = scipy.ndimage.distance_transform_edt(evidence <= 0) * CELL_M
    expected = np.maximum(-(distance**2) / (2 * sigma_m**2), math.log(STRAY))
    blocks = scipy.ndimage.maximum_filter(evidence > 0, len(stamp), mode="constant")
    expected[(evidence == 0) & ~blocks] = 1.0  # not known, and nothing known is near
    padded = np.pad(expected, 20, constant_values=np.nan)
    for u, v in ((20.3, 15.9), (36.0, 14.2), (1.5, 2.5), (40.9, 29.9)):
        left, low = make_field(evidence, u, v, stamp, math.log(STRAY), field)
        assert (left, low) == (int(u) - 9, int(v) - 9)
        cut = padded[low + 20 : low + 39, left + 20 : left + 39]
        on = ~np.isnan(cut)
        assert on.sum() > 80
        assert field[on] == pytest.approx(cut[on], abs=1e-5)
        off_map = field[~on]
        assert ((off_map == 1.0) | (off_map > math.log(STRAY) - 1e-5)).all()


def test_between_centres_the_field_is_interpolated():
    draw = np.random.default_rng(3)
    field = -draw.random((25, 25)).astype(np.float32)
    ends, pose = draw.uniform(-6, 6, (50, 2)), (12.3, 11.8, 0.7)
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    across = pose[0] + cos * ends[:, 0] - sin * ends[:, 1] - 0.5
    up = pose[1] + sin * ends[:, 0] + cos * ends[:, 1] - 0.5
    each = scipy.ndimage.map_coordinates(field.astype(float), [up, across], order=1)
    assert field_fit(field, *pose, ends, 50) == pytest.approx(each.sum(), rel=1e-6)
    assert field_fit(field, *pose, ends, 20) == pytest.approx(each[:20].sum(), rel=1e-6)
    field_fit(field, 0.0, 30.0, 0.0, ends, 50)  # beyond its rim, which takes all


def test_ends_in_the_unknown_are_left_out_and_count_as_news():
    evidence = np.zeros((1, 40, 40), np.int8)
    evidence[0, :, :22], evidence[0, :, 22] = -3, 9
    stamp, numbers = stamp_of(0.1, STRAY, CELL_M), numbers_of(power=0.2, news=0.3)
    size, frame = field_size(RANGE_M, 0.1, CELL_M), np.array([0.0, 0.0, CELL_M])
    field, scores = np.empty((size, size), np.float32), np.empty(1)
    ends = np.array([[0.25, 0.0], [0.25, 0.1], [1.2, 0.0], [1.0, 0.4], [1.2, -0.5]])
    poses = np.array([[2.0, 2.0, 0.0]])
    match_particles(evidence, None, poses, ends, frame, stamp, numbers, field, None, scores)
    assert poses[0] == pytest.approx([2.0, 2.0, 0.0])  # the two that count fit as well as can be
    assert scores[0] == pytest.approx(0.2 * 3 * math.log(0.3))
    low = make_field(evidence[0], 20.0, 20.0, stamp, math.log(STRAY), field)
    chosen = np.empty_like(ends)
    assert choose_ends(field, 20.0 - low[0], 20.0 - low[1], 0.0, ends / CELL_M, chosen) == 2
    assert chosen[:2] == pytest.approx(ends[:2] / CELL_M)
    settle_field(field, math.log(STRAY))
    assert field.max() == 0.0


# ---------------------------------------------------------------- matching


@pytest.mark.parametrize(
    ("dx", "dy", "turn"), [(0.15, -0.1, 0.0), (-0.12, 0.14, 0.1), (0.0, 0.0, -0.15), (0.1, 0.1, -0.12), (0.0, 0.0, 0.0)]
)
@pytest.mark.parametrize("pose", [(1.1, 1.3, 0.4), (2.6, 2.0, -2.9)])
def test_matching_recovers_a_known_offset(pose, dx, dy, turn):
    maps = mapped_truly()
    ranges = scan(ROOM, pose, 0.0)  # beams from the heading: in the body's frame
    hit = ranges < RANGE_M
    ends = (ranges[:, np.newaxis] * beam_directions(BEAMS))[hit][::2]
    size = field_size(RANGE_M, 1.0, CELL_M)
    poses, scores = np.array([[pose[0] + dx, pose[1] + dy, pose[2] + turn]]), np.empty(1)
    frame, field = np.array([*ORIGIN_M, CELL_M]), np.empty((size, size), np.float32)
    stamp, numbers = stamp_of(0.1, STRAY, CELL_M), numbers_of(slack_m=1.0, slack_rad=1.0)
    match_particles(maps, None, poses, ends, frame, stamp, numbers, field, None, scores)
    assert math.hypot(poses[0, 0] - pose[0], poses[0, 1] - pose[1]) < 0.05  # half a cell
    assert abs(math.remainder(poses[0, 2] - pose[2], math.tau)) < 0.03


def test_the_climb_ends_on_top_and_is_tied_to_where_it_began():
    draw = np.random.default_rng(5)
    top = (20.4, 18.9)
    up, across = np.mgrid[0:41, 0:41] + 0.5
    field = (-0.01 * ((across - top[0]) ** 2 + (up - top[1]) ** 2)).astype(np.float32)
    # ends all over a cell: their mean of what is interpolated linearly between parabolas is a parabola
    offsets = (np.arange(10) - 4.5) / 10
    ends = np.stack(np.meshgrid(offsets, offsets), axis=-1).reshape(100, 2)
    u, v, _, _ = climb(field, None, 18.0, 20.0, 0.0, ends, 100, CELL_M, numbers_of(0.1, 1e3, 1e3))
    assert (u, v) == pytest.approx(top, abs=0.03)
    # two parabolas: 0.1 d^2 in all against d^2 / 2 (slack / cell)^2
    u, v, _, _ = climb(field, None, 18.0, 20.0, 0.0, ends, 100, CELL_M, numbers_of(0.1, 0.2, 1e3))
    pull = 0.1 / (0.1 + 0.5 * (CELL_M / 0.2) ** 2)
    assert (u, v) == pytest.approx((18.0 + 2.4 * pull, 20.0 - 1.1 * pull), abs=0.03)
    ring = draw.uniform(-8, 8, (30, 2))
    start = 1.0
    bumpy = -draw.random((41, 41)).astype(np.float32)
    u, v, heading, value = climb(bumpy, None, 20.0, 20.0, start, ring, 30, CELL_M, numbers_of(1.0, 1.0, 1.0))
    tie = ((u - 20.0) ** 2 + (v - 20.0) ** 2) * CELL_M**2 / 2 + (heading - start) ** 2 / 2
    assert value == pytest.approx(field_fit(bumpy, u, v, heading, ring, 30) - tie, abs=1e-6)
    assert value > field_fit(bumpy, 20.0, 20.0, start, ring, 30)


# ---------------------------------------------------------------- the filter


@pytest.mark.parametrize("seed", range(4))
def test_on_a_loop_through_two_rooms_the_error_is_less_than_half_of_dead_reckonings(seed):
    poses = course(LOOP)
    slam = slam_at(poses[0], seed)
    found, dead = drive(slam, TWO_ROOMS, poses, seed)
    assert off(dead, poses).max() > 0.5
    assert off(found, poses).mean() < 0.5 * off(dead, poses).mean()
    assert off(found, poses)[-1] < 0.5 * off(dead, poses)[-1]
    assert off(found, poses).max() < 0.3
    evidence = slam.maps[slam.heaviest]
    iy, ix = np.nonzero(evidence > 0)
    cells = (np.stack((ix, iy), axis=1) + 0.5) * CELL_M + ORIGIN_M
    assert (clearance(TWO_ROOMS, cells, 1.0) < 0.25).mean() > 0.97
    assert len(cells) > 200


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("power", "covers"), [(0.1, False), (0.03, True)])
def test_the_spread_covers_the_error_only_where_a_beam_counts_for_little(power, covers, seed):
    poses = course(LOOP)
    found, _ = drive(slam_at(poses[0], seed, particles=30, power=power), TWO_ROOMS, poses, seed)
    error, spread = math.sqrt((off(found, poses) ** 2).mean()), math.sqrt((found[:, 3] ** 2).mean())
    assert (error < spread) == covers
    assert error < 0.12


@pytest.mark.parametrize("seed", range(3))
def test_uncertainty_grows_where_nothing_is_seen_and_falls_on_return(seed):
    poses = course(AWAY_AND_BACK)
    found, _ = drive(slam_at(poses[0], seed), PLAIN, poses, seed)
    x, spread = np.array(poses)[:, 0], found[:, 3]
    out = int(np.argmax(x))
    before, after = spread[:out][x[:out] < 2.2], spread[-3:]
    assert before.max() < 0.05
    nothing = np.flatnonzero(x > 6.2)
    assert spread[nothing[-1]] > spread[nothing[0]] + 0.05  # all the way that nothing is seen
    assert spread.max() > 0.15
    assert after.max() < 0.05
    assert off(found, poses)[-1] < 0.15


def test_the_same_draws_and_observations_give_the_same_run():
    poses = course(LOOP[:3])
    runs = [slam_at(poses[0], seed) for seed in (1, 1, 2)]
    found = [drive(slam, TWO_ROOMS, poses, seed=7)[0] for slam in runs]
    assert (found[0] == found[1]).all()
    assert (runs[0].maps == runs[1].maps).all()
    assert (runs[0].poses == runs[1].poses).all()
    assert not (found[0] == found[2]).all()


def test_between_updates_the_estimate_goes_on_by_odometry():
    slam = slam_at((1.0, 1.0, 0.0), update_ticks=4)
    nothing = np.full(BEAMS, RANGE_M)
    slam.observe((5.0, 5.0, math.pi / 2), nothing)
    found = slam.observe((4.9, 5.2, math.pi / 2 + 0.1), nothing)
    assert found[:3] == pytest.approx((1.2, 1.1, 0.1))
    assert slam.updates == 1
    slam.observe((5.0, 5.1, math.pi / 2 + 0.25), nothing)  # turned
    assert slam.updates == 2
    slam.observe((5.0, 5.4, math.pi / 2 + 0.25), nothing)  # gone far enough
    assert slam.updates == 3
    for updates in (3, 3, 3, 4):  # resting
        slam.observe((5.0, 5.4, math.pi / 2 + 0.25), nothing)
        assert slam.updates == updates


def test_beams_in_the_body_and_in_the_frame_of_odometry_mark_the_same_cells():
    start, heading = (0.8, 1.2, 0.3), 1.9
    in_frame, in_body = slam_at(start), slam_at(start)
    in_body._turns = False
    in_frame.observe((0.0, 0.0, heading), scan(ROOM, start, heading))
    in_body.observe((0.0, 0.0, heading), scan(ROOM, start, 0.0))
    iy, ix = np.nonzero(in_frame.maps[0] > 0)
    cells = (np.stack((ix, iy), axis=1) + 0.5) * CELL_M + ORIGIN_M
    assert (clearance(ROOM, cells, 1.0) < 0.08).all()  # half a diagonal, and a bit
    same = (np.sign(in_frame.maps[0]) == np.sign(in_body.maps[0]))[in_frame.maps[0] != 0]
    assert same.mean() > 0.93  # the beams are not quite the same ones


def test_resampling_copies_pose_and_map_of_the_heavy():
    slam = slam_at((1.0, 1.0, 0.0), particles=4)
    for i in range(4):
        slam.poses[i], slam.maps[i] = i, i + 1
    slam.weights[:] = 0.05, 0.55, 0.05, 0.35
    assert slam.heaviest == 1
    assert slam.effective == pytest.approx(1 / (0.3025 + 0.1225 + 0.005))
    slam._resample()
    kept = sorted(slam.poses[:, 0].tolist())
    assert kept.count(1.0) in (2, 3)
    assert kept.count(3.0) in (1, 2)
    assert (slam.maps[:, 0, 0] == slam.poses[:, 0] + 1).all()
    assert (slam.maps == slam.maps[:, :1, :1]).all()
    assert (slam.weights == 0.25).all()
    assert (slam.poses[1, 0], slam.poses[3, 0]) == (1.0, 3.0)  # survivors stay where they are
    slam.maps[1, 0, 0] = 99
    assert np.count_nonzero(slam.maps[:, 0, 0] == 99) == 1  # no map is shared


def test_particles_are_drawn_anew_only_when_few_are_effective():
    for below, resamplings in ((0.0, 0), (1.0, 1)):
        slam = slam_at((0.8, 1.2, 0.3), particles=5, resample_below=below, update_way_m=0.0)
        slam.observe((0.0, 0.0, 0.0), scan(ROOM, (0.8, 1.2, 0.3), 0.0))
        slam.poses[0, :2] += 0.6, 0.5  # one that fits worse
        slam.observe((0.0, 0.0, 0.0), scan(ROOM, (0.8, 1.2, 0.3), 0.0))
        assert slam.resamplings == resamplings
        if not below:
            assert slam.weights[0] < 0.5 * slam.weights[1:].min()
            assert slam.weights.sum() == pytest.approx(1.0)


def test_the_estimate_is_the_weighted_mean_and_its_headings_are_on_a_circle():
    slam = slam_at((1.0, 1.0, 0.0), particles=3)
    slam.poses[:] = (1.0, 2.0, 3.1), (1.4, 2.0, -3.1), (1.0, 2.3, math.pi)
    slam.weights[:] = 0.5, 0.25, 0.25
    found = slam._estimated()
    assert found[:2] == pytest.approx((1.1, 2.075))
    mean = 0.5 * np.exp(3.1j) + 0.25 * np.exp(-3.1j) - 0.25
    assert found.heading_rad == pytest.approx(np.angle(mean))
    assert found.spread_rad == pytest.approx(math.sqrt(-2 * math.log(abs(mean))))
    variance = 0.5 * 0.01 + 0.25 * 0.09 + 0.25 * 0.01 + 0.75 * 0.075**2 + 0.25 * 0.225**2
    assert found.spread_m == pytest.approx(math.sqrt(variance))


def test_without_matching_scans_only_weigh():
    slam = slam_at((0.8, 1.2, 0.3), particles=5, matching=False, update_way_m=0.0, resample_below=0.0)
    slam.observe((0.0, 0.0, 0.0), scan(ROOM, (0.8, 1.2, 0.3), 0.0))
    slam.poses[:, 0] += np.array([0.0, 0.05, 0.1, 0.15, 0.2])
    poses = slam.poses.copy()
    slam.observe((0.0, 0.0, 0.0), scan(ROOM, (0.8, 1.2, 0.3), 0.0))
    assert slam.poses == pytest.approx(poses, abs=1e-9)
    assert slam.weights[0] > 2 * slam.weights[4]


def test_readings_that_are_not_known_say_nothing():
    slam = slam_at((0.8, 1.2, 0.3))
    slam.observe((0.0, 0.0, 0.0), np.full(BEAMS, np.nan))
    slam.observe((1.0, 0.0, 0.0), np.full(BEAMS, np.nan))
    assert not slam.maps.any()
    assert np.ptp(slam.weights) == 0.0
    with pytest.raises(ValueError, match=r"shape \(59,\), but there are 180"):
        slam.observe((1.0, 0.0, 0.0), np.zeros(59))
    with pytest.raises(ValidationError):
        SlamParameters(stray=0.0)


def test_the_share_of_speed_falls_from_one_to_zero():
    assert [share_of_speed(s, 0.1, 0.3) for s in (0.0, 0.1, 0.15, 0.3, 9.0)] == pytest.approx([1, 1, 0.75, 0, 0])
    for slow, stop in ((0.3, 0.3), (-0.1, 0.3)):
        with pytest.raises(ValueError, match="is not from 0 to below"):
            share_of_speed(0.0, slow, stop)
