"""Rooms for tests of SLAM: walls off the cells' edges, drives with odometry that errs, and what became of them."""

import itertools
import math

import numpy as np

from cosim.geometry.segments import ray_casts, segment_grid
from cosim.navigation.schemas import beam_directions
from cosim.navigation.slam import MapGrid, Slam, SlamParameters
from cosim.randomness import Draws

CELL_M = 0.1
RANGE_M = 2.5
BEAMS = 180
SHAPE, ORIGIN_M = (120, 140), (-2.0, -2.0)


def box(x, y, wide, high):
    """Return the four walls of a box."""
    a, b, c, d = (x, y), (x + wide, y), (x + wide, y + high), (x, y + high)
    return [(*a, *b), (*b, *c), (*c, *d), (*d, *a)]


ROOM = segment_grid([*box(0.03, 0.07, 3.6, 2.9), *box(1.43, 1.91, 0.5, 0.4), (2.6, 0.07, 2.9, 0.8)])
TWO_ROOMS = segment_grid(
    [
        *box(0.03, 0.07, 8.4, 6.1),
        *[(4.11, 0.07, 4.11, 0.93), (4.11, 1.87, 4.11, 4.03), (4.11, 5.01, 4.11, 6.17)],
        *[*box(1.7, 2.3, 0.7, 1.3), *box(5.8, 2.2, 0.9, 1.6), (0.03, 4.4, 0.6, 4.4), (7.6, 2.0, 8.43, 2.0)],
    ]
)
"""Two rooms with two doors between them, so that there is a way around through both."""
PLAIN = segment_grid([*box(0.03, 0.07, 3.1, 2.2)[:1], *box(0.03, 0.07, 3.1, 2.2)[2:], (3.6, 0.07, 3.6, 0.7)])
"""A room that is open to the east, where there is nothing."""


def scan(walls, pose, frame_heading, noise_m=0.0, draw=None, beams=BEAMS):
    """Return the ranges of a ring of beams in the frame of odometry, which takes the heading of *pose* for another."""
    angles = 2.0 * np.pi * np.arange(beams) / beams + pose[2] - frame_heading
    ranges = ray_casts(walls, np.tile(pose[:2], (beams, 1)), angles, RANGE_M)
    if draw is not None:
        ranges = np.where(ranges < RANGE_M, ranges + draw.normal(0.0, noise_m, beams), ranges)
    return ranges


def course(corners, step_m=0.25):
    """Return poses along a polyline, each looking along its leg."""
    poses = []
    for (ax, ay), (bx, by) in itertools.pairwise(corners):
        steps, heading = math.ceil(math.hypot(bx - ax, by - ay) / step_m), math.atan2(by - ay, bx - ax)
        poses += [(ax + (bx - ax) * k / steps, ay + (by - ay) * k / steps, heading) for k in range(steps)]
    return [*poses, (*corners[-1], poses[-1][2])]


def slam_at(start, seed=0, **own):
    grid = MapGrid(SHAPE, ORIGIN_M, CELL_M)
    return Slam(grid, start, beam_directions(BEAMS), Draws(seed, "slam"), SlamParameters(**own))


def drive(filter_, walls, poses, seed, noise=0.03, noise_m=0.01):
    """Drive along *poses*; return estimates (n, 5) and dead reckoning (n, 3), both in the world's frame.

    Ways and turns are told with an error in proportion, of which half is the same all the time, half is new each step,
    and headings creep by as much of each way.
    """
    draw = np.random.default_rng(seed)
    always = noise * draw.choice([-1.0, 1.0], 3)
    told, found, dead = np.array(poses[0]), [], []
    for before, now in zip([poses[0], *poses[:-1]], poses, strict=True):
        dx, dy = now[0] - before[0], now[1] - before[1]
        way, turn = math.hypot(dx, dy), math.remainder(now[2] - before[2], math.tau)
        wrong = 0.5 * (always + draw.normal(0.0, noise, 3))
        course_ = told[2] + (math.atan2(dy, dx) - before[2] if way else 0.0)
        told[0] += way * (1 + wrong[0]) * math.cos(course_)
        told[1] += way * (1 + wrong[0]) * math.sin(course_)
        told[2] = math.remainder(told[2] + turn * (1 + wrong[1]) + way * wrong[2], math.tau)
        ranges = scan(walls, now, told[2], noise_m, draw)
        found.append(filter_.observe(tuple(told.tolist()), ranges))
        dead.append(told.copy())
    return np.array(found), np.array(dead)


def off(found, poses):
    """Return by how many metres each of *found* (n, 2 or more) is off."""
    return np.hypot(*(found[:, :2] - np.array(poses)[:, :2]).T)
