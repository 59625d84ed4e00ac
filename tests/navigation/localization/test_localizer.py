"""Monte Carlo localisation as a whole: what recovery injects, what is estimated, and robots that find themselves."""

import math

import numpy as np
import pytest
from pydantic import ValidationError

from cosim.navigation.localization.localizer import Estimate, LocalizationParameters, Localizer, beam_stride
from cosim.navigation.localization.resampling import Recovery
from cosim.navigation.schemas import beam_directions
from cosim.randomness import Draws
from tests.navigation.localization.room import room_map, scan

# ---------------------------------------------------------------- recovery


@pytest.mark.parametrize("resampling", ["low_variance", "independent"])
def test_recovery_injects_with_its_probability(resampling):
    own = LocalizationParameters(
        resampling=resampling,
        least_particles=2000,
        recovery_slow=1e-9,
        recovery_fast=1e-8,
        recovery_tries=0,
        update_way_m=0.0,
    )
    localizer = Localizer(room_map(), beam_directions(60), Draws(1, "r"), own)
    localizer.start_at((0.53, 3.02, 0.0), 0.02, 0.02)
    localizer.recovery = Recovery(1e-9, 1e-8, 1.0, 0.7, noted=10**10)
    ranges = scan((0.53, 3.02, 0.0))
    localizer.observe((0.0, 0.0, 0.0), ranges)
    assert abs(localizer.injected - 600) < 5 * math.sqrt(2000 * 0.3 * 0.7)
    far = np.hypot(localizer.poses[:, 0] - 0.53, localizer.poses[:, 1] - 3.02) > 0.5
    assert 0.9 * localizer.injected < far.sum() <= localizer.injected
    assert np.count_nonzero(np.diff(np.flatnonzero(far)) > 1) > 300  # not one block


def test_recovery_forgets_if_it_is_told_to():
    for forgets in (False, True):
        own = LocalizationParameters(recovery_slow=0.01, recovery_fast=0.1, recovery_forgets=forgets)
        localizer = Localizer(room_map(), beam_directions(60), Draws(1, "r"), own)
        localizer.recovery = Recovery(1e-9, 1e-8, 1.0, 0.7, noted=10**10)
        localizer.observe((0.0, 0.0, 0.0), scan((0.53, 3.02, 0.0)))
        assert localizer.injected > 0
        assert (localizer.recovery.noted == 0) is forgets


def test_the_tries_of_an_update_are_shared_among_the_poses_that_it_injects(monkeypatch):
    own = LocalizationParameters(recovery_tries=9000)
    localizer = Localizer(room_map(), beam_directions(60), Draws(1, "r"), own)
    localizer.recovery = Recovery(1e-9, 1e-8, 1.0, 0.7, noted=10**10)
    placed = []
    monkeypatch.setattr(localizer, "_place", lambda poses, tries, ends: placed.append((len(poses), tries, len(ends))))
    localizer.observe((0.0, 0.0, 0.0), scan((0.53, 3.02, 0.0)))
    assert 1 < localizer.injected < 4500
    assert placed == [(localizer.injected, 9000 // localizer.injected, 60)]


# ---------------------------------------------------------------- the filter


@pytest.mark.parametrize("aggregation", ["cubes", "product"])
def test_a_scan_multiplies_weights_by_its_likelihood_and_its_fit_is_the_mean_of_a_beam(aggregation):
    own = LocalizationParameters(least_particles=3, most_particles=3, aggregation=aggregation, product_power=0.4)
    localizer = Localizer(room_map(), beam_directions(60), Draws(1, "w"), own)
    before = np.array([0.5, 0.3, 0.2])
    localizer.weights = before.copy()
    p = np.array([[0.2, 0.5, 0.9, 0.4], [0.6, 0.6, 0.1, 0.3], [0.05, 0.2, 0.2, 0.7]])  # of four beams, by particle
    if aggregation == "cubes":
        localizer._weigh((p**3).sum(axis=1), 4)
        likelihood, fits = 1.0 + (p**3).sum(axis=1), (p**3).mean(axis=1)
    else:
        localizer._weigh(np.log(p).sum(axis=1), 4)
        likelihood, fits = p.prod(axis=1) ** 0.4, p.prod(axis=1) ** 0.25
    assert localizer.weights == pytest.approx(before * likelihood / (before @ likelihood))
    assert localizer.recovery.fast == pytest.approx(before @ fits)  # by the weights before the scan


@pytest.mark.parametrize(("model", "noted"), [("likelihood_field", 0), ("beam", 1)])
def test_a_scan_of_beams_that_all_reach_their_range_tells_the_beam_model_alone_something(model, noted):
    localizer = Localizer(room_map(), beam_directions(60), Draws(1, "n"), LocalizationParameters(model=model))
    localizer.observe((0.0, 0.0, 0.0), np.full(60, 8.0))
    assert localizer.recovery.noted == noted


def test_the_estimate_is_the_heaviest_cluster_and_its_headings_are_on_a_circle():
    own = LocalizationParameters(least_particles=5, most_particles=5)
    localizer = Localizer(room_map(), beam_directions(60), Draws(1, "e"), own)
    localizer.poses = np.array([[1.0, 3.0, 3.1], [1.2, 3.0, -3.1], [4.0, 5.0, 0.0], [4.0, 5.0, 0.0], [4.0, 5.0, 0.0]])
    localizer.weights = np.array([0.6, 0.2, 0.1, 0.05, 0.05])
    found = localizer._estimated()
    assert found.share == pytest.approx(0.8)
    assert found[:2] == pytest.approx((1.05, 3.0))
    mean = 0.75 * np.exp(3.1j) + 0.25 * np.exp(-3.1j)
    assert found.heading_rad == pytest.approx(np.angle(mean))
    assert found.spread_m == pytest.approx(math.sqrt(0.75 * 0.05**2 + 0.25 * 0.15**2))
    assert found.spread_rad == pytest.approx(math.sqrt(-2 * math.log(abs(mean))))


def test_between_updates_the_estimate_goes_on_by_odometry():
    localizer = Localizer(room_map(), beam_directions(60), Draws(1, "o"))
    localizer.start_at((0.53, 3.02, math.pi / 2), 0.01, 0.01)
    first = localizer.observe((10.0, 10.0, 0.0), scan((0.53, 3.02, math.pi / 2)))
    poses = localizer.poses.copy()
    later = localizer.observe((10.2, 10.1, 0.15), np.full(60, np.nan))
    assert localizer.updates == 1
    assert (localizer.poses == poses).all()
    turn = first.heading_rad
    assert later.x_m == pytest.approx(first.x_m + 0.2 * math.cos(turn) - 0.1 * math.sin(turn))
    assert later.y_m == pytest.approx(first.y_m + 0.2 * math.sin(turn) + 0.1 * math.cos(turn))
    assert later.heading_rad == pytest.approx(turn + 0.15)
    localizer.observe((10.2, 10.1, 0.25), np.full(60, np.nan))
    assert localizer.updates == 2
    localizer.observe((10.2, 10.36, 0.25), np.full(60, np.nan))
    assert localizer.updates == 3


def test_a_scan_that_says_nothing_leaves_the_weights_alone():
    for model in ("likelihood_field", "beam"):
        own = LocalizationParameters(model=model, resample_interval=10)
        localizer = Localizer(room_map(), beam_directions(60), Draws(1, "n"), own)
        localizer.observe((0.0, 0.0, 0.0), np.full(60, np.nan))
        assert np.ptp(localizer.weights) == 0.0
    assert beam_stride(360, 60) == 6
    assert beam_stride(100, 60) == 1  # Nav2's formula: all of them
    with pytest.raises(ValueError, match="59 of the scan"):
        localizer.observe((1.0, 0.0, 0.0), np.zeros(59))


def drive(localizer, course, frame_turn=0.0, noise=0.03, seed=0, carried_at=None):
    """Drive along poses of the room, odometry in a turned frame and with errors; return errors in m and rad.

    At one step the robot may be carried, which odometry does not notice.
    """
    draw = np.random.default_rng(seed)
    odometry, errors = np.array([7.0, -3.0, course[0][2] + frame_turn]), []
    for k, (before, now) in enumerate(zip([course[0], *course[:-1]], course, strict=True)):
        turn = odometry[2] - before[2]
        step = np.subtract(now, before)
        step[2] = math.remainder(step[2], math.tau)
        step *= 0.0 if k == carried_at else 1 + draw.uniform(-noise, noise, 3)
        cos, sin = math.cos(turn), math.sin(turn)
        odometry += (cos * step[0] - sin * step[1], sin * step[0] + cos * step[1], step[2])
        ranges = scan(now, turned=-odometry[2])
        found = localizer.observe(tuple(odometry.tolist()), ranges)
        heading = math.remainder(found.heading_rad - now[2], math.tau)
        errors.append((math.hypot(found.x_m - now[0], found.y_m - now[1]), abs(heading)))
    return np.array(errors)


def loop(steps, x=0.43, y=3.37, radius=0.6):
    """Return poses of a circle in the western half of the room, or where one says."""
    angle = 0.3 * np.arange(steps)
    return [(x + radius * math.sin(a), y + radius * (1 - math.cos(a)), a) for a in angle]


CALM = {"alpha1": 0.02, "alpha2": 0.02, "alpha3": 0.02, "alpha4": 0.02}
SHARP = {**CALM, "aggregation": "product", "product_power": 0.3}


def test_a_robot_that_knows_nothing_finds_itself_in_a_room():
    localizer = Localizer(room_map(), beam_directions(60), Draws(2, "whole"), LocalizationParameters(**SHARP))
    assert localizer.poses[:, :2].std(axis=0).min() > 0.8
    errors = drive(localizer, loop(14), frame_turn=1.0)
    assert localizer.updates == 14
    assert errors[-4:, 0].max() < 0.1
    assert errors[-4:, 1].max() < 0.1


@pytest.mark.parametrize("changed", [{}, {"model": "beam"}, {"resampling": "independent"}, {"resample_interval": 3}])
def test_a_robot_that_nearly_knows_where_it_is_stays_there(changed):
    own = LocalizationParameters(least_particles=200, most_particles=400, aggregation="cubes", **CALM, **changed)
    localizer = Localizer(room_map(), beam_directions(60), Draws(2, "whole"), own)
    localizer.start_at((0.63, 3.27, 0.2), 0.3, 0.2)
    errors = drive(localizer, loop(14), frame_turn=1.0)
    assert errors[0, 0] > 0.05
    assert errors[-4:, 0].max() < 0.1
    assert errors[-4:, 1].max() < 0.1


def test_the_same_draws_give_the_same_estimates():
    def last(seed):
        localizer = Localizer(room_map(), beam_directions(60), Draws(seed, "same"))
        drive(localizer, loop(3))
        return localizer.observe((9.0, 9.0, 0.0), np.full(60, np.nan))

    assert isinstance(last(1), Estimate)
    assert last(1) == last(1)
    assert last(1) != last(2)


def test_starts_and_motions_of_two_robots_and_two_starts_of_one_differ():
    seen = []
    for seed in (1, 2):
        localizer = Localizer(room_map(), beam_directions(60), Draws(seed, "starts"))
        seen.append(localizer.poses)
        localizer.start_anywhere()
        seen.append(localizer.poses)
        for spread in (0.1, 0.1, 0.0):
            localizer.start_at((0.5, 3.0, 0.0), spread, spread)
            seen.append(localizer.poses.copy())
        localizer.observe((0.0, 0.0, 0.0), np.full(60, np.nan))
        localizer.observe((1.0, 0.0, 0.0), np.full(60, np.nan))
        seen.append(localizer.poses)
    first = [tuple(poses[0].tolist()) for poses in seen]
    assert first[4] == first[10] == pytest.approx((0.5, 3.0, 0.0))
    assert len(set(first)) == len(first) - 1


@pytest.mark.parametrize("tries", [0, 4000])
def test_a_kidnapped_robot_recovers_only_with_recovery(tries):
    def last(**changed):
        localizer = Localizer(
            room_map(), beam_directions(60), Draws(3, "lost"), LocalizationParameters(**SHARP, **changed)
        )
        localizer.start_at((0.43, 3.37, 0.0), 0.1, 0.1)
        errors = drive(localizer, loop(20) + loop(21, 3.43, 4.57, 0.5), carried_at=20)[:, 0]
        assert errors[19] < 0.1
        assert errors[20] > 3.0
        return errors[-3:]

    assert last(recovery_slow=0.0, recovery_fast=0.0).min() > 0.5
    assert last(recovery_slow=0.02, recovery_fast=0.2, recovery_tries=tries).max() < 0.15


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"least_particles": 3000}, "is not <= 2000, most_particles"),
        ({"recovery_fast": 0.0}, "is not > 0 and <= .*, recovery_fast, nor are both 0"),
        ({"recovery_slow": 0.0}, "is not > 0 and <= .*, recovery_fast, nor are both 0"),
        ({"recovery_slow": 0.2, "recovery_fast": 0.1}, "is not > 0 and <= .*, recovery_fast, nor are both 0"),
    ],
)
def test_parameters_that_contradict_each_other_are_refused(changed, says):
    with pytest.raises(ValidationError, match=says):
        LocalizationParameters(**changed)
