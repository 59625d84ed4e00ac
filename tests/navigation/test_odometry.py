"""The errors of a tick's odometry: particles that have them are where the senses' own errors would put the truth."""

import math

import numpy as np
import pytest

from cosim.navigation.odometry import drift_particles
from cosim.navigation.slam import SlamParameters
from cosim.randomness import Draws, Streams
from cosim.robots.sense_kernels import COLUMNS, HEADING, KEY, OWN_HEADING, OWN_X, SLIP, TURN, X, locate
from cosim.robots.sense_kernels import ERRS_AT as AT
from tests.navigation.slam_scene import BEAMS, ROOM, scan, slam_at

COUNT = 4000
SLOW_M, FAST_M = 0.01, 0.05


def arc(way_m, ticks=80):
    """Return poses (ticks + 1, 3) that turn on the spot, then drive *way_m* each tick and turn by 0.02 rad."""
    headings = np.concatenate((np.linspace(0.3, 1.0, 10), 1.0 + 0.02 * np.arange(1, ticks - 8)))
    x, y = (np.cumsum(way_m * way) for way in (np.cos(headings[10:]), np.sin(headings[10:])))
    return np.stack((np.pad(x, (10, 0)), np.pad(y, (10, 0)), headings), axis=1)


def sensed(poses, slip, turn, at):
    """Return where COUNT robots that go along *poses* take themselves to be (COUNT, 3), by the senses' kernel."""
    limits = np.zeros(13)
    limits[[SLIP, TURN, AT]] = slip, turn, at
    limits[KEY : KEY + 2] = Streams(5).draws("senses").key
    table, rows = np.zeros((COUNT, COLUMNS)), np.zeros((COUNT, 6))
    for tick, pose in enumerate(poses):
        rows[:, :3] = pose
        locate(table, limits, rows, tick, tick > 0)
    assert table[0, X : HEADING + 1] == pytest.approx(poses[-1])
    return table[:, OWN_X : OWN_HEADING + 1]


def drifted(poses, slip, turn, at):
    """Return COUNT particles that are told *poses*."""
    particles, errors = np.tile(poses[0], (COUNT, 1)), np.array([slip, turn, at])
    for tick, (before, after) in enumerate(zip(poses[:-1].tolist(), poses[1:].tolist(), strict=True)):
        drift_particles(particles, tuple(before), tuple(after), errors, tick, *Draws(6, "filter").key)
    return particles


def errors_in(frame, poses):
    """Return *poses* (n, 3) less the pose *frame*, in its axes."""
    turn = np.exp(-1j * frame[..., 2])
    off = ((poses[:, 0] - frame[..., 0]) + 1j * (poses[:, 1] - frame[..., 1])) * turn
    return np.stack((off.real, off.imag, np.remainder(poses[:, 2] - frame[..., 2] + math.pi, math.tau) - math.pi), 1)


@pytest.mark.parametrize("way_m", [SLOW_M, FAST_M])
@pytest.mark.parametrize("at", [0.0, 0.03])
def test_particles_spread_about_what_is_told_as_the_truth_does(way_m, at):
    """The truth as the told pose has it, of robots told apart from it, against particles that are told the truth."""
    poses = arc(way_m)
    told, particles = sensed(poses, 0.2, 0.03, at), drifted(poses, 0.2, 0.03, at)
    true = errors_in(told, np.tile(poses[-1], (COUNT, 1)))
    assumed = errors_in(poses[-1], particles)
    both = np.cov(true.T), np.cov(assumed.T)
    scale = np.sqrt(np.outer(np.diag(both[0]), np.diag(both[0])))
    assert both[1] / scale == pytest.approx(both[0] / scale, abs=0.08)
    more = way_m / at if at else 1.0
    # the ways of 71 ticks, each of variance (more turn)^2 way / 3
    assert both[1][2, 2] == pytest.approx((more * 0.03) ** 2 * 71 * way_m / 3, rel=0.1)
    assert abs(assumed[:, 2]).max() < 6 * math.sqrt(both[1][2, 2])


def test_a_turn_on_the_spot_errs_nothing_and_a_tick_errs_by_bounded_amounts():
    here = drifted(np.array([[1.0, 2.0, 0.3], [1.0, 2.0, 0.9]]), 0.2, 0.5, 0.0)
    assert here == pytest.approx(np.tile([1.0, 2.0, 0.9], (COUNT, 1)))
    tick = drifted(np.array([[0.0, 0.0, 0.0], [0.25, 0.0, 0.0]]), 0.2, 0.5, 0.0)
    way, heading = np.hypot(tick[:, 0], tick[:, 1]), tick[:, 2]
    assert (way.min(), way.max()) == pytest.approx((0.2, 0.3), abs=1e-3)
    assert (heading.min(), heading.max()) == pytest.approx((-0.25, 0.25), abs=1e-3)  # 0.5 sqrt(0.25)
    assert abs(np.corrcoef(way, heading)[0, 1]) < 0.05


def spread_after(way_m, **own):
    """Return the spread (m) of the particles of a filter that is told four metres where it sees nothing."""
    filter_ = slam_at((0.5, 1.0, 0.0), particles=200, update_ticks=1000, **own)
    for k in range(round(4.0 / way_m) + 1):
        filter_.observe((0.5 + k * way_m, 1.0, 0.0), np.full(BEAMS, 9.0))
    return math.sqrt(filter_.poses[:, :2].var(axis=0).sum())


def test_what_a_filter_assumes_by_the_senses_errors_does_not_depend_on_its_updates():
    """By the alphas it does: their variance is in proportion to the way between updates."""
    senses = [spread_after(0.05, odometry="senses", update_way_m=way) for way in (0.1, 0.8)]
    assert senses[0] == pytest.approx(senses[1], rel=1e-9)
    alphas = [spread_after(0.05, odometry="alphas", update_way_m=way) for way in (0.1, 0.8)]
    assert alphas[1] > 1.5 * alphas[0]


def test_the_filter_hands_its_errors_on():
    slip = spread_after(0.05, odometry="senses", odometry_slip=0.5, odometry_turn_rad=0.0)
    assert slip == pytest.approx(0.5 * math.sqrt(4.0 * 0.05 / 3.0), rel=0.15)
    grown = spread_after(0.05, odometry="senses", odometry_slip=0.25, odometry_turn_rad=0.0, odometry_way_m=0.025)
    assert grown == pytest.approx(slip, rel=0.01)
    assert SlamParameters().odometry == "alphas"


def test_a_filter_with_the_senses_errors_finds_its_place_again():
    filter_ = slam_at((0.8, 1.2, 0.0), odometry="senses")
    for k in range(41):
        true = (0.8 + 0.04 * k, 1.2, 0.0)
        told = (0.8 + 0.042 * k, 1.2 + 0.001 * k, 0.0)
        found = filter_.observe(told, scan(ROOM, true, told[2]))
    assert math.dist(found[:2], true[:2]) < 0.5 * math.dist(told[:2], true[:2])
