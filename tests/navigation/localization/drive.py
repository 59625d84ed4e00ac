"""A robot that drives about on a real map with a laser, odometry that errs, and the filter that is to know where it is.

The robot goes from one random reachable place to the next by planned ways: it turns on the spot, then drives straight.
Its odometry errs by 3 %: in each *hold* of ticks its way is multiplied by 1 + N(0, 3 %), its turn by 1 + N(0, 3 %), and
its heading drifts by N(0, 0.03 rad) for each metre, without which a straight way would have no error of heading at all.
Held for one tick, errors nearly cancel (0.7 % of a metre); held for 20, a metre at full speed, they are 3 % of it.
The laser has a beam a degree, 8 m of reach, and errors of N(0, 1 cm); it reads the walls of the map by
:mod:`cosim.geometry.segments`, not by the filter's own rays. The map has a wall at its edge, as our floors have.
"""

import math
from typing import NamedTuple

import numpy as np
import scipy.ndimage

from cosim.geometry.planning import cost_to_go, descent, occupancy_planning_grid, way_points
from cosim.geometry.segments import ray_casts, segment_grid
from cosim.navigation.localization.likelihood import known_map
from cosim.navigation.localization.localizer import Localizer
from cosim.navigation.schemas import beam_directions
from cosim.randomness import Draws
from cosim.world.maps import OccupancyMap, read_movingai_map, read_ros_map
from tests.checkout import MAPS

TICK_S, SPEED_M_S, TURN_RAD_S = 0.1, 0.5, 1.0
BLOCK_M, CELL_M = 1.0, 0.1
"""A cell of a benchmark's map, of which its doors are one wide, and the cells that it is cut into."""
RADIUS_M, BEAMS, RANGE_M, RANGE_ERROR_M, ODOMETRY_ERROR = 0.3, 360, 8.0, 0.01, 0.03


class Site(NamedTuple):
    """A map, as the filter knows it, the cells where the robot may be, and the walls that its laser sees."""

    known: object
    places: np.ndarray
    """Shape (ny, nx), with the rim: reachable from one another by a robot of RADIUS_M."""
    walls: object


def read_map(name):
    """Read one of the maps in MAPS; benchmarks say nothing of metres."""
    if name.endswith(".yaml"):
        return read_ros_map(MAPS / name)
    blocks = read_movingai_map(MAPS / name, BLOCK_M)
    occupied = np.kron(blocks.occupied, np.ones((round(BLOCK_M / CELL_M),) * 2, bool))
    return OccupancyMap(occupied, np.zeros_like(occupied), CELL_M)


def site(name):
    """Read one of the maps; what is unknown stops the robot, not the beam."""
    read = read_map(name)
    occupied = np.pad(read.occupied, 1, constant_values=True)
    origin = (read.origin[0] - read.cell_m, read.origin[1] - read.cell_m)
    grid = occupancy_planning_grid(np.pad(read.solid(True), 1, constant_values=True), read.cell_m, RADIUS_M, origin)
    part, _ = scipy.ndimage.label(grid.free)
    places = part == np.argmax(np.bincount(part.ravel())[1:]) + 1
    walls = segment_grid(read.walls_m(read.occupied))
    return Site(known_map(occupied, places, origin, read.cell_m), places, walls)


def centres(place, cells):
    """Return the centres (n, 2) of cells in metres."""
    nx = place.places.shape[1]
    return np.array(place.known.origin_m) + (np.stack((cells % nx, cells // nx), axis=1) + 0.5) * place.known.cell_m


def course(place, seconds, draw):
    """Return the true poses (n, 3), one a tick, of a robot that drives from one random place to the next."""
    wanted, cells, heading = round(seconds / TICK_S), np.flatnonzero(place.places), draw.uniform(-math.pi, math.pi)
    here, legs, ticks = draw.choice(cells), [], 0
    legs.append(np.array([[*centres(place, np.array([here]))[0], heading]]))
    while ticks < wanted:
        there = draw.choice(cells)
        path = descent(place.places, cost_to_go(place.places, there), here)
        for goal in centres(place, way_points(place.places, path)[1:]):
            x, y, heading = legs[-1][-1]
            way, aim = math.hypot(goal[0] - x, goal[1] - y), math.atan2(goal[1] - y, goal[0] - x)
            turn = math.remainder(aim - heading, math.tau)
            turns = np.linspace(heading, heading + turn, math.ceil(abs(turn) / (TURN_RAD_S * TICK_S)) + 1)[1:]
            legs.append(np.stack((np.full(len(turns), x), np.full(len(turns), y), turns), axis=1))
            part = np.linspace(0.0, 1.0, math.ceil(way / (SPEED_M_S * TICK_S)) + 1)[1:, np.newaxis]
            legs.append(np.hstack(((x, y) + part * (goal - (x, y)), np.full((len(part), 1), heading + turn))))
            ticks += len(turns) + len(part)
        here = there
    return np.concatenate(legs)[:wanted]


def odometry(poses, draw, hold=1, carried_at=None):
    """Return what odometry tells (n, 3) of true *poses*; at one tick the robot may be carried unnoticed."""
    ways = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    turns = np.remainder(np.diff(poses[:, 2]) + math.pi, math.tau) - math.pi
    if carried_at is not None:
        ways[carried_at - 1], turns[carried_at - 1] = 0.0, 0.0
    errors = np.repeat(draw.normal(0.0, ODOMETRY_ERROR, (len(ways) // hold + 1, 3)), hold, axis=0)[: len(ways)]
    headings = np.concatenate(([0.0], np.cumsum(turns * (1.0 + errors[:, 1]) + errors[:, 2] * ways)))
    ways = ways * (1.0 + errors[:, 0])
    steps = np.stack((ways * np.cos(headings[:-1]), ways * np.sin(headings[:-1])), axis=1)
    return np.column_stack((np.vstack(((0.0, 0.0), np.cumsum(steps, axis=0))), headings))


def scans(place, poses, draw, beams=BEAMS):
    """Return the ranges (n, beams) of a laser at true *poses*; what meets nothing reads the range."""
    angles = poses[:, 2:] + math.tau * np.arange(beams) / beams
    origins = np.repeat(poses[:, :2], beams, axis=0)
    ranges = ray_casts(place.walls, origins, angles.ravel(), RANGE_M).reshape(len(poses), beams)
    told = np.maximum(ranges + draw.normal(0.0, RANGE_ERROR_M, ranges.shape), 0.0)
    return np.where(ranges < RANGE_M, told, RANGE_M)


class Drive(NamedTuple):
    """A robot's drive, tick by tick: where it is (n, 3), what odometry tells (n, 3), what the laser reads."""

    poses: np.ndarray
    odometry: np.ndarray
    ranges_m: np.ndarray


def drive(place, seconds, seed, hold=1, kidnapped_after_s=None):
    """Return a drive; a kidnapped robot goes on at another random place, as if nothing had happened."""
    draw = np.random.default_rng(seed)
    parts = [seconds] if kidnapped_after_s is None else [kidnapped_after_s, seconds - kidnapped_after_s]
    courses = [course(place, part, draw) for part in parts]
    poses = np.concatenate(courses)
    carried_at = None if kidnapped_after_s is None else len(courses[0])
    return Drive(poses, odometry(poses, draw, hold, carried_at), scans(place, poses, draw))


def errors_m(place, driven, seed, parameters=None):
    """Return how far (n,) the filter's estimate is off in each tick, of a robot whose start is known."""
    localizer = Localizer(place.known, beam_directions(BEAMS), Draws(seed, "drive"), parameters, beams_in="body")
    localizer.start_at(tuple(driven.poses[0].tolist()))
    seen = zip(driven.odometry.tolist(), driven.ranges_m, strict=True)
    told = [localizer.observe(tuple(at), ranges)[:2] for at, ranges in seen]
    return np.hypot(*(np.array(told) - driven.poses[:, :2]).T)


def dead_reckoning_m(driven):
    """Return how far (n,) off odometry alone would be from the known start on."""
    turn = driven.poses[0, 2] - driven.odometry[0, 2]
    x, y = (driven.odometry[:, :2] - driven.odometry[0, :2]).T
    told = np.stack((np.cos(turn) * x - np.sin(turn) * y, np.sin(turn) * x + np.cos(turn) * y), axis=1)
    return np.hypot(*(told + driven.poses[0, :2] - driven.poses[:, :2]).T)


def recovered_after_s(errors, carried_s, near_m=0.3, stays_s=5.0):
    """Return how long after it was carried a robot's *errors* (n,) began to stay below *near_m* for a while, or inf."""
    ticks = round(stays_s / TICK_S)
    near = np.lib.stride_tricks.sliding_window_view(errors[round(carried_s / TICK_S) :] < near_m, ticks).all(axis=1)
    return float(np.argmax(near)) * TICK_S if near.any() else math.inf
