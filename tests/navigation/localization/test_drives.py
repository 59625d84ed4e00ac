"""Does the filter, with its defaults, hold what is asked of it on real maps: half hours of driving, and kidnappings.

All of it (SOAK_SHARE=1) takes about four minutes of one processor.
"""

from functools import cache
from itertools import product

import numpy as np
import pytest

from tests.navigation.localization.drive import (
    MAPS,
    SPEED_M_S,
    TICK_S,
    dead_reckoning_m,
    drive,
    errors_m,
    recovered_after_s,
    site,
)
from tests.tiers import soak_count

SITES = ("depot.yaml", "willow.yaml")
HOLDS = (1, 20)
"""For how many ticks odometry keeps an error: see the scene."""
NEAR_M = 0.3
DRIVES = list(product(SITES, HOLDS))
HALF_AN_HOUR, LEAST_TICKS = 18_000, 1_800
"""Ticks; in less than the least odometry alone might do."""


@cache
def read(name):
    if not (MAPS / name).is_file():
        pytest.skip("the real maps lie beside the checkout, in ../shared/maps; they are not there")
    return site(name)


@pytest.mark.soak
@pytest.mark.parametrize(("name", "hold"), DRIVES[: soak_count(len(DRIVES))])
def test_half_an_hour_of_driving_keeps_the_error_below_0_3_m(name, hold, record_property):
    place = read(name)
    ticks = max(soak_count(HALF_AN_HOUR), LEAST_TICKS)
    driven = drive(place, ticks * TICK_S, 0, hold)
    assert np.mean(dead_reckoning_m(driven) < NEAR_M) < 0.5  # odometry alone would not do
    errors = errors_m(place, driven, 0)
    assert len(errors) == ticks
    near = np.mean(errors < NEAR_M)
    print(f"{name}, errors held for {hold} ticks: {near:.4f}, p95 {np.quantile(errors, 0.95):.3f} m")
    record_property("ticks of robots that know where they are on real maps", ticks)
    assert near >= 0.95


@pytest.mark.soak
@pytest.mark.parametrize("name", SITES)
def test_kidnapped_robots_recover_within_a_minute(name, record_property):
    place, count = read(name), soak_count(50)
    after = []
    for seed in range(1000, 1000 + count):
        driven = drive(place, 95.0, seed, 20, kidnapped_after_s=30.0)
        errors = errors_m(place, driven, seed)
        assert np.mean(errors[:300] < NEAR_M) > 0.9  # it knew where it was
        after.append(recovered_after_s(errors, 30.0))
    late = int(np.sum(np.array(after) > 60.0))
    print(f"{name}: {count - late} of {count}; median {np.median(after):.1f} s, worst {np.max(after):.1f} s")
    record_property("kidnapped robots that found themselves within a minute", count - late)
    assert late <= 0.05 * count


@pytest.mark.slow
def test_the_scene_is_what_it_says():
    place = read("depot.yaml")
    driven = drive(place, 60.0, 3, 20, kidnapped_after_s=30.0)
    steps = np.hypot(*np.diff(driven.poses[:, :2], axis=0).T)
    assert (np.delete(steps, 299) <= SPEED_M_S * TICK_S + 1e-9).all()
    assert steps[299] > 1.0  # carried, and odometry does not note it
    assert not np.diff(driven.odometry, axis=0)[299].any()
    told = np.hypot(*np.diff(driven.odometry[:, :2], axis=0).T)
    moved = np.delete(steps, 299) > 0.01
    ratio = np.delete(told, 299)[moved] / np.delete(steps, 299)[moved]
    assert 0.015 < ratio.std() < 0.06
    origin, cell = np.array(place.known.origin_m), place.known.cell_m
    ix, iy = np.floor((driven.poses[:, :2] - origin) / cell).astype(int).T
    assert not place.known.occupied[iy, ix].any()
    # beams end in or beside occupied cells of the map that the filter knows
    angles = driven.poses[::50, 2:] + 2 * np.pi * np.arange(360) / 360
    ranges = driven.ranges_m[::50]
    ends = driven.poses[::50, np.newaxis, :2] + ranges[:, :, np.newaxis] * np.stack((np.cos(angles), np.sin(angles)), 2)
    ix, iy = np.floor((ends[ranges < 8.0] - origin) / cell).astype(int).T
    assert place.known.distance_m[iy, ix].max() < 0.15
