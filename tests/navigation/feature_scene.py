"""Rooms for tests of SLAM by features, and drives among them with odometry and scans that err as the robots' do."""

import itertools
import math

import numpy as np

from cosim.geometry.segments import ray_casts, segment_grid

BEAMS, RANGE_M, NOISE_M = 360, 2.5, 0.02
SLIP, TURN_RAD = 0.03, 0.03
STEP_M = 0.03
"""The way of a tick of 0.1 s at 0.3 m/s."""

ROOMS = segment_grid(
    [
        *[(0.0, 0.0, 12.0, 0.0), (12.0, 0.0, 12.0, 8.0), (12.0, 8.0, 0.0, 8.0), (0.0, 8.0, 0.0, 0.0)],
        *[(0.0, 3.0, 1.4, 3.0), (2.6, 3.0, 5.4, 3.0), (6.6, 3.0, 9.4, 3.0), (10.6, 3.0, 12.0, 3.0)],
        *[(0.0, 5.0, 1.4, 5.0), (2.6, 5.0, 5.4, 5.0), (6.6, 5.0, 9.4, 5.0), (10.6, 5.0, 12.0, 5.0)],
        *[(4.0, 0.0, 4.0, 3.0), (8.0, 0.0, 8.0, 3.0), (4.0, 5.0, 4.0, 8.0), (8.0, 5.0, 8.0, 8.0)],
    ]
)
"""A corridor of 12 m x 2 m with three rooms of 4 m x 3 m on each side, doors of 1.2 m."""
ROUND = [
    *[(2.0, 4.0), (2.0, 1.5), (2.0, 4.0), (6.0, 4.0), (6.0, 6.5), (6.0, 4.0), (10.0, 4.0), (10.0, 1.5), (10.0, 6.5)],
    *[(10.0, 4.0), (6.0, 4.0), (6.0, 1.5), (6.0, 4.0), (2.0, 4.0), (2.0, 6.5), (2.0, 4.0), (7.5, 4.0)],
]
"""A drive of 50 m through all rooms."""


def ticks(corners, step_m=STEP_M, turn_rad=0.1):
    """Return the poses (n, 3) of a drive along a polyline at each tick: it turns in place, then goes straight on."""
    (x, y), *rest = corners
    heading = math.atan2(rest[0][1] - y, rest[0][0] - x)
    poses = [(x, y, heading)]
    for to_x, to_y in rest:
        turn = math.remainder(math.atan2(to_y - y, to_x - x) - heading, math.tau)
        count = math.ceil(abs(turn) / turn_rad)
        poses += [(x, y, heading + turn * k / count) for k in range(1, count + 1)]
        heading += turn
        count = math.ceil(math.hypot(to_x - x, to_y - y) / step_m)
        poses += [(x + (to_x - x) * k / count, y + (to_y - y) * k / count, heading) for k in range(1, count + 1)]
        x, y = to_x, to_y
    return np.array(poses)


def odometry(poses, draw, slip=SLIP, turn_rad=TURN_RAD):
    """Return what odometry makes of *poses* (n, 3): as cosim.robots.sense_kernels.locate, written once more."""
    told = [poses[0]]
    for before, now in itertools.pairwise(poses):
        way = now[:2] - before[:2]
        error = turn_rad * draw.uniform(-1.0, 1.0) * math.sqrt(math.hypot(*way))
        angle = told[-1][2] - before[2] + error
        turned = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]) @ way
        place = told[-1][:2] + (1.0 + slip * draw.uniform(-1.0, 1.0)) * turned
        told.append(np.array([*place, now[2] + angle]))
    return np.array(told)


def ring(walls, pose, told_heading, draw, beams=BEAMS, range_m=RANGE_M, noise_m=NOISE_M):
    """Return the ranges of a ring of beams in the frame of odometry, which takes the heading of *pose* for another."""
    angles = 2.0 * np.pi * np.arange(beams) / beams + pose[2] - told_heading
    ranges = ray_casts(walls, np.tile(pose[:2], (beams, 1)), angles, range_m)
    read = ranges + draw.normal(0.0, noise_m, beams)
    return np.where((ranges < range_m) & (read < range_m), read, np.inf)


def driven(slam, walls, poses, seed):
    """Drive *slam* along *poses* (n, 3); return its errors (u, 3), covariances (u, 3, 3) and the ticks of its updates.

    Each is told after an update of the filter.
    """
    draw = np.random.default_rng(seed)
    told = odometry(poses, draw)
    errors, covariances, at = [], [], []
    for tick, (pose, own) in enumerate(zip(poses, told, strict=True)):
        updates = slam.updates
        found = slam.observe(tuple(own.tolist()), ring(walls, pose, own[2], draw))
        if slam.updates > updates:
            off = np.array(found[:3]) - pose
            errors.append((*off[:2], math.remainder(off[2], math.tau)))
            covariances.append(slam.belief.covariance[:3, :3])
            at.append(tick)
    return np.array(errors), np.array(covariances), np.array(at)


def nees(errors, covariances):
    """Return the normalised squared errors (u,) of poses, 3 of them if the filter is consistent."""
    return np.array([e @ np.linalg.solve(c + 1e-12 * np.eye(3), e) for e, c in zip(errors, covariances, strict=True)])
