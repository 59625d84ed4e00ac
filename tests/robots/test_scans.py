"""What a noisy range scanner tells: the moments of its noise, the share of false returns, and what moves neither."""

import math
from typing import Any

import numpy as np
import pytest
from scipy import stats

from cosim.geometry.segments import packed_walls, segment_grid
from cosim.observation import Observation
from cosim.randomness import Streams
from cosim.robots.body import BodySettings
from cosim.robots.motion import Fleet
from cosim.robots.senses import Senses, SenseSettings
from cosim.units import MS

TICK = 100 * MS
RADIUS_M = 0.2
RANGE_M = 2.5
BEAMS = 720
SQUARE = [[-1.0, -1.0, 1.0, -1.0], [1.0, -1.0, 1.0, 1.0], [1.0, 1.0, -1.0, 1.0], [-1.0, 1.0, -1.0, -1.0]]
"""A room, all of which is in range from its middle."""
ANGLES = 2.0 * np.pi * np.arange(BEAMS) / BEAMS
TO_SQUARE = 1.0 / np.maximum(np.abs(np.cos(ANGLES)), np.abs(np.sin(ANGLES)))
MIDDLE = (0.0, 0.0)
FAR = (50.0, 0.0)
"""A place where there is nothing to hit."""


class Scanners:
    """Robots that stand at *places* and scan."""

    def __init__(self, *places: tuple[float, float], seed: int = 1, walls: Any = SQUARE, **settings: Any) -> None:
        body = BodySettings(radius_m=RADIUS_M, drive="omni", speed_mps=1.0, acceleration_mps2=1.0)
        grid = segment_grid(walls)
        count = len(places)
        self.fleet = Fleet([body] * count, list(places), grid, TICK)
        frames = [(0.0, 0.0, 0.0)] * count
        plain = SenseSettings(**{"beams": BEAMS, "beam_range_m": RANGE_M} | settings)
        self.senses = Senses(plain, packed_walls(grid), [RADIUS_M] * count, frames, 20.0, TICK, Streams(seed))

    def look(self) -> list[Observation]:
        return self.senses.observe(self.fleet)

    def scans(self, ticks: int, robot: int = 0) -> np.ndarray[Any, Any]:
        return np.array([self.look()[robot].ranges_m for _ in range(ticks)])


def test_without_errors_nothing_is_drawn() -> None:
    first, second = Scanners(MIDDLE, seed=1).scans(3), Scanners(MIDDLE, seed=2).scans(3)
    assert np.array_equal(first, second)
    assert first == pytest.approx(np.broadcast_to(TO_SQUARE, first.shape), abs=1e-12)


def test_noise_is_normal_about_the_true_range_and_has_the_deviation_that_is_asked_for() -> None:
    errors = Scanners(MIDDLE, range_noise_m=0.05).scans(20) - TO_SQUARE
    count = errors.size
    assert abs(errors.mean()) < 4 * 0.05 / math.sqrt(count)
    assert errors.std() == pytest.approx(0.05, rel=4 / math.sqrt(2 * count))
    assert stats.kstest(errors.reshape(-1) / 0.05, "norm").pvalue > 0.001


def test_the_noise_of_beams_ticks_and_robots_is_independent() -> None:
    team = Scanners(
        MIDDLE, FAR, walls=SQUARE + [[x + FAR[0], y, u + FAR[0], v] for x, y, u, v in SQUARE], range_noise_m=0.05
    )
    errors = np.array([[seen.ranges_m for seen in team.look()] for _ in range(20)]) - TO_SQUARE
    own, other = errors[:, 0], errors[:, 1]
    bound = 4.5 / math.sqrt(own.size)
    assert abs(np.corrcoef(own[:, 1:].reshape(-1), own[:, :-1].reshape(-1))[0, 1]) < bound
    assert abs(np.corrcoef(own[1:].reshape(-1), own[:-1].reshape(-1))[0, 1]) < bound
    assert abs(np.corrcoef(own.reshape(-1), other.reshape(-1))[0, 1]) < bound


def test_what_is_measured_beyond_the_range_is_not_told_and_nothing_is_below_zero() -> None:
    walls = [[RANGE_M - 0.05, -9.0, RANGE_M - 0.05, 9.0], [-0.05, -9.0, -0.05, 9.0]]
    scans = Scanners(MIDDLE, walls=walls, range_noise_m=0.05).scans(2_000)
    ahead, behind, aside = scans[:, 0], scans[:, BEAMS // 2], scans[:, BEAMS // 4]
    one_sigma = stats.norm.sf(1.0)
    assert stats.binomtest(int(np.isinf(ahead).sum()), 2_000, one_sigma).pvalue > 0.001
    assert ahead[np.isfinite(ahead)].max() <= RANGE_M
    assert stats.binomtest(int((behind == 0.0).sum()), 2_000, one_sigma).pvalue > 0.001
    assert scans.min() == 0.0
    assert np.isinf(aside).all()  # what meets nothing has no noise


@pytest.mark.parametrize("place", [MIDDLE, FAR])
def test_false_returns_are_as_frequent_as_asked_for_and_uniform_whatever_is_there(place: tuple[float, float]) -> None:
    scans = Scanners(place, false_return_rate=0.03).scans(20)
    false = np.abs(scans - TO_SQUARE) > 1e-9 if place is MIDDLE else np.isfinite(scans)
    assert stats.binomtest(int(false.sum()), scans.size, 0.03).pvalue > 0.001
    assert stats.kstest(scans[false] / RANGE_M, "uniform").pvalue > 0.001


def test_beams_that_are_not_false_have_the_noise_of_all() -> None:
    rate, noise_m = 0.3, 0.05
    scans = Scanners(MIDDLE, false_return_rate=rate, range_noise_m=noise_m).scans(20)
    below = (1 - rate) * stats.norm.cdf((scans - TO_SQUARE) / noise_m) + rate * scans / RANGE_M
    assert stats.kstest(below.reshape(-1), "uniform").pvalue > 0.001


def test_all_beams_may_be_false() -> None:
    scans = Scanners(FAR, false_return_rate=1.0).scans(3)
    assert (scans < RANGE_M).all()
    assert (scans >= 0.0).all()


def test_a_scan_depends_on_seed_tick_and_robot_alone() -> None:
    noisy: dict[str, Any] = {"range_noise_m": 0.05, "false_return_rate": 0.1}
    scans = Scanners(MIDDLE, **noisy).scans(3)
    assert np.array_equal(scans, Scanners(MIDDLE, FAR, **noisy).scans(3))
    assert not (scans[0] == scans[1]).any()
    assert not (scans == Scanners(MIDDLE, seed=2, **noisy).scans(3)).any()
    later = Scanners(MIDDLE, **noisy)
    later.look()  # nobody asks for this scan
    observation = later.look()[0]
    assert np.array_equal(observation.ranges_m, scans[1])
    assert np.array_equal(observation.ranges_m, scans[1])


def test_noise_of_scans_leaves_sightings_alone() -> None:
    places = (-0.5, 0.0), (0.5, 0.0)
    errors: dict[str, Any] = {"distance_error": 0.2, "bearing_error": 1.0}
    plain, noisy = Scanners(*places, **errors), Scanners(*places, range_noise_m=0.1, false_return_rate=0.5, **errors)
    for _ in range(3):
        for one, other in zip(plain.look(), noisy.look(), strict=True):
            assert not np.array_equal(one.ranges_m, other.ranges_m)
            assert one.sightings == other.sightings


def test_the_noise_of_a_beam_is_independent_of_the_error_of_a_sighting_with_its_number() -> None:
    places, ticks = ((-0.5, 0.0), (0.5, 0.0)), 300
    errors: dict[str, Any] = {"distance_error": 0.2, "range_noise_m": 0.05}
    true_m = Scanners(*places).scans(1)[0, 1]
    team, noise, away = Scanners(*places, **errors), [], []
    for _ in range(ticks):
        seen = team.look()[0]
        noise.append(abs(seen.ranges_m[1] - true_m))
        away.append(math.hypot(seen.sightings[0].x_m - seen.x_m, seen.sightings[0].y_m - seen.y_m))
    assert np.std(away) > 0.05
    assert abs(stats.spearmanr(noise, away).statistic) < 4.5 / math.sqrt(ticks)
