"""Gains between robots: ranges as tabulated, walls, shadowing that is fixed, noise."""

import math
import tracemalloc

import numpy as np
import pytest
from pydantic import ValidationError
from scipy import optimize, stats

from cosim.channels.bluetooth.bits.errors import bit_error_rate
from cosim.channels.bluetooth.bits.powers import POWER_DBM, noise_dbm, thermal_noise_dbm
from cosim.channels.propagation import Propagation, PropagationSettings
from cosim.geometry.segments import segment_grid
from cosim.randomness import Draws
from cosim.world.offices import OfficeSettings, office_walls
from cosim.world.sight import wall_losses_db

OPEN = segment_grid([])


def air(floor=OPEN, loss_db=(), seed=1, **settings) -> Propagation:
    return Propagation(PropagationSettings(**settings), floor, loss_db, Draws(seed, "shadowing"))


def gain(propagation: Propagation, distance_m: float) -> float:
    return float(propagation.gains_db([(3.0, 4.0), (3.0 + 0.6 * distance_m, 4.0 + 0.8 * distance_m)])[0, 1])


def lost(less: Propagation, more: Propagation, positions) -> np.ndarray:
    """By how many dB *more* takes more from each pair than *less*; 0 on the diagonal."""
    gains = less.gains_db(positions), more.gains_db(positions)
    return np.subtract(*gains, out=np.zeros(gains[0].shape), where=np.isfinite(gains[0]))


# ---------------------------------------------------------------- distance


@pytest.mark.parametrize(
    ("exponent", "sensitivity_dbm", "ranges_m"),
    [
        (1.8, -70, ("584", "75", "45")),
        (2.0, -70, ("309", "49", "31")),
        (3.0, -70, ("45.7", "13.4", "9.8")),
        (3.5, -70, ("26.5", "9.2", "7.1")),
        (4.0, -70, ("17.6", "7.0", "5.6")),
        (3.0, -82, ("115", "33.6", "24.7")),
    ],
)
def test_power_classes_reach_as_far_as_tabulated(exponent, sensitivity_dbm, ranges_m):
    law = air(model="log_distance", exponent=exponent)
    for power, printed in zip((1, 2, 3), ranges_m, strict=True):
        reach = optimize.brentq(lambda d, p=power: POWER_DBM[p] + gain(law, d) - sensitivity_dbm, 1, 1000)
        assert f"{reach:.{len(printed.partition('.')[2])}f}" == printed


def test_an_office_after_itu_r_p_1238_reaches_as_far_as_tabulated():
    law = air(model="log_distance", exponent=3.0, reference_loss_db=20 * math.log10(2441) - 28)
    for power, reach in ((1, 47), (2, 13.9), (3, 10.2)):
        assert POWER_DBM[power] + gain(law, reach) == pytest.approx(-70, abs=0.1)


def test_free_space_is_friis_s_law_at_2441_mhz():
    for distance in (0.5, 1.0, 7.0, 250.0):
        friis = 20 * math.log10(299792458 / (4 * math.pi * 2441e6 * distance))
        assert gain(air(exponent=5.0), distance) == pytest.approx(friis, abs=0.005)


def test_gains_are_symmetric_and_nobody_hears_itself():
    positions = np.random.default_rng(1).uniform(0, 20, (9, 2))
    gains = air(shadowing_db=6).gains_db(positions)
    assert gains.shape == (9, 9)
    assert (gains == gains.T).all()
    assert (gains.diagonal() == -np.inf).all()
    assert np.isfinite(gains[~np.eye(9, dtype=bool)]).all()
    assert air().gains_db([]).shape == (0, 0)


def test_robots_nearer_than_a_decimetre_count_as_a_decimetre_apart():
    law = air()
    assert gain(law, 0.0) == gain(law, 0.05) == pytest.approx(-20.2)
    assert gain(law, 0.11) < gain(law, 0.0)


# ---------------------------------------------------------------- walls


def test_walls_on_the_line_are_paid_unless_they_are_switched_off():
    walls = segment_grid([(1, -1, 1, 1), (2, -1, 2, 1)])
    through, around = air(walls, [4.5, 10.0]), air(walls, [4.5, 10.0], walls=False)
    positions = [(0, 0), (1.5, 0), (3, 0)]
    cost = lost(around, through, positions)
    assert [cost[0, 1], cost[1, 2], cost[0, 2]] == pytest.approx([4.5, 10.0, 14.5])
    assert (around.gains_db(positions)[0, 1:] == air().gains_db(positions)[0, 1:]).all()


def test_all_walls_of_an_office_are_paid_by_all_pairs():
    walls = office_walls(OfficeSettings())
    losses = np.random.default_rng(2).uniform(1, 9, len(walls))
    positions = np.random.default_rng(3).uniform(0, 1, (32, 2)) * (20, 12)
    grid = segment_grid(walls)
    cost = lost(air(), air(grid, losses), positions)
    np.testing.assert_allclose(cost, wall_losses_db(grid, losses, positions), atol=1e-9)
    assert cost.max() > 9


def test_gains_that_were_asked_for_hold_no_memory():
    # a sweep's process grew by 2 MB with each minute of robots that moved in a shared air
    propagation, places = air(), np.zeros((40, 2))
    propagation.gains_db(places)
    tracemalloc.start()
    try:
        before, _ = tracemalloc.get_traced_memory()
        for _ in range(200):
            propagation.gains_db(places)
        assert tracemalloc.get_traced_memory()[0] - before < 100_000  # one array has 12,800
    finally:
        tracemalloc.stop()


def test_walls_and_losses_are_as_many():
    with pytest.raises(ValueError, match=r"1 walls have losses of shape \(2,\)"):
        air(segment_grid([(0, 0, 1, 1)]), [1.0, 2.0])


# ---------------------------------------------------------------- shadowing


def shadows(propagation: Propagation, positions) -> np.ndarray:
    """What shadowing takes from each pair, dB."""
    return lost(air(), propagation, positions)


def test_shadowing_is_fixed_by_the_pair_and_the_places_of_both():
    law = air(shadowing_db=5, shadowing_cell_m=3)
    first = shadows(law, [(1, 1), (10, 10), (-4, 7)])
    law.gains_db(np.random.default_rng(5).uniform(-9, 9, (20, 2)))
    again = shadows(air(shadowing_db=5, shadowing_cell_m=3), [(2.9, 0.1), (11.9, 9.1), (-5.9, 8.9), (0, 0)])
    upper = np.triu_indices(3, 1)
    assert again[:3, :3][upper] == pytest.approx(first[upper])
    assert len({round(value, 6) for value in first[upper]}) == 3


@pytest.mark.parametrize(
    ("positions", "moved"),
    [
        ([(1, 1), (10, 10)], [(3.1, 1), (10, 10)]),
        ([(1, 1), (10, 10)], [(1, 1), (10, 8.9)]),
        ([(1, 1), (10, 10)], [(-1, 1), (10, 10)]),
        ([(1, 1), (10, 10)], [(1, -1), (10, 10)]),
        ([(1, 4), (10, 10)], [(4, 1), (10, 10)]),
        ([(1, 1), (10, 10)], [(10, 10), (1, 1)]),
    ],
)
def test_in_another_square_it_is_another_value(positions, moved):
    law = air(shadowing_db=5, shadowing_cell_m=3)
    assert abs(shadows(law, positions)[0, 1] - shadows(law, moved)[0, 1]) > 1e-3


def test_other_pairs_in_the_same_places_and_other_seeds_are_shadowed_otherwise():
    here = [(1, 1), (1, 1), (9, 9), (9, 9)]
    both = [shadows(air(seed=seed, shadowing_db=5), here) for seed in (1, 2)]
    values = [matrix[i, j] for matrix in both for i, j in ((0, 2), (0, 3), (1, 2), (1, 3))]
    assert len({round(value, 6) for value in values}) == 8


def test_shadowing_is_drawn_from_the_stream_it_was_given():
    draws = Draws(4, "air")
    law = Propagation(PropagationSettings(shadowing_db=7, shadowing_cell_m=2), OPEN, [], draws)
    here, there = 3 << 16 | 0xFFFF, 0xFFFE << 16 | 5  # the squares (3, -1) and (-2, 5)
    words = draws.words(here | there << 32, 1 << 16 | 2)
    radius, angle = (words[0] + 0.5) / 2**32, 2 * math.pi * (words[1] + 0.5) / 2**32
    expected = 7 * math.sqrt(-2 * math.log(radius)) * math.cos(angle)
    assert shadows(law, [(0, 0), (7, -0.5), (-3.5, 11)])[1, 2] == pytest.approx(expected)


def test_shadowing_is_normal_with_the_deviation_that_was_set():
    positions = np.random.default_rng(6).uniform(-400, 400, (100, 2))
    values = shadows(air(shadowing_db=4), positions)[np.triu_indices(100, 1)]
    assert stats.kstest(values, "norm", args=(0, 4)).pvalue > 0.01
    assert stats.kstest(values, "norm", args=(0, 4.4)).pvalue < 0.01


# ---------------------------------------------------------------- noise and settings


@pytest.mark.parametrize("sensitivity_dbm", [-70.0, -90.0])
def test_at_its_sensitivity_a_receiver_has_a_bit_error_rate_of_a_thousandth(sensitivity_dbm):
    noise = noise_dbm(sensitivity_dbm)
    assert bit_error_rate(sensitivity_dbm - noise) == pytest.approx(1e-3, rel=1e-6)
    assert noise == pytest.approx(sensitivity_dbm - 12.65, abs=0.05)


def test_thermal_noise_is_that_of_290_k_in_1_mhz():
    assert thermal_noise_dbm(6.0) == pytest.approx(10 * math.log10(1.380649e-23 * 290 * 1e6 * 1e3) + 6.0, abs=0.03)


@pytest.mark.parametrize(
    "settings", [{"model": "two_ray"}, {"exponent": 0}, {"shadowing_db": -1}, {"shadowing_cell_m": 0}, {"sigma": 3}]
)
def test_settings_that_make_no_sense_are_refused(settings):
    with pytest.raises(ValidationError):
        PropagationSettings(**settings)
