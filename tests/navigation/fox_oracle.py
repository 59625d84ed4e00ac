"""The objective of Fox, Burgard and Thrun (1997) told plainly, in metres and seconds: arcs are walked in steps."""

import math
from typing import NamedTuple

import numpy as np
import shapely

STEPS = 250
"""Number of steps in which an arc is walked."""


class Robot(NamedTuple):
    """A body, its tick, what is kept free, and how the three terms count."""

    radius_m: float
    speed_mps: float
    acceleration_mps2: float
    turn_radps: float
    turn_acceleration_radps2: float
    tick_s: float = 0.1
    margin_m: float = 0.02
    stray_m: float = 0.04
    clear_m: float = 0.3
    alpha: float = 2.0
    beta: float = 0.2
    gamma: float = 0.2
    arc_m: float = 1.0


class Choice(NamedTuple):
    """Commands (v, w) of the window, what each is worth, and whether it is admissible: surely, and perhaps."""

    commands: np.ndarray
    worth: np.ndarray
    surely: np.ndarray
    perhaps: np.ndarray


def commands(robot, v, w, most_mps, error_rad):
    """Return the window that is reached within a tick, as a grid of 5 by 9, with no turn and the one that lands."""
    dv, dw = robot.acceleration_mps2 * robot.tick_s, robot.turn_acceleration_radps2 * robot.tick_s
    low = max(v - dv, 0.0)
    high = max(min(v + dv, robot.speed_mps, most_mps), low)
    left, right = max(w - dw, -robot.turn_radps), min(w + dw, robot.turn_radps)
    lands = math.copysign(min(_lands(abs(error_rad), robot), robot.turn_radps), error_rad)
    turns = [*np.linspace(left, right, 9), *np.clip((0.0, lands), left, right)]
    return np.array([(speed, turn) for turn in turns for speed in np.linspace(low, high, 5)])


def _lands(error_rad, robot):
    """Bisect for the fastest turn that, in one tick and then braking, does not turn too far."""

    def turned(w):
        total = 0.0
        while w > 0.0:
            total, w = total + w * robot.tick_s, w - robot.turn_acceleration_radps2 * robot.tick_s
        return total

    low, high = 0.0, 50.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if turned(middle) <= error_rad else (low, middle)
    return low


def stop(robot, pose, v, w):
    """Return the places of a robot that obeys for a tick and then brakes as hard as it can, and its last heading."""
    x, y, heading = pose
    places, tick = [(x, y)], robot.tick_s
    while v != 0.0 or w != 0.0:
        length = v * tick * (np.sinc(w * tick / (2.0 * math.pi)))
        middle = heading + 0.5 * w * tick
        x, y, heading = x + length * math.cos(middle), y + length * math.sin(middle), heading + w * tick
        places.append((x, y))
        v = 0.0 if v <= robot.acceleration_mps2 * tick * (1 + 1e-9) else v - robot.acceleration_mps2 * tick
        slower = abs(w) - robot.turn_acceleration_radps2 * tick
        w = math.copysign(slower, w) if slower > 1e-9 * robot.turn_acceleration_radps2 * tick else 0.0
    return places, heading


def dist(robot, pose, v, w, things, radius_m):
    """Return the way along the arc, in small steps, until something is within the radius."""
    if v == 0.0:
        return robot.arc_m
    ways = np.linspace(0.0, robot.arc_m, STEPS, endpoint=False)
    x, y, heading = pose
    turned = heading + w / v * ways
    if abs(w / v) < 1e-9:
        places = np.stack((x + ways * math.cos(heading), y + ways * math.sin(heading)), axis=1)
    else:
        radius = v / w
        places = np.stack(
            (x + radius * (np.sin(turned) - math.sin(heading)), y - radius * (np.cos(turned) - math.cos(heading))),
            axis=1,
        )
    touching = np.flatnonzero(shapely.dwithin(things, shapely.points(places), radius_m))
    return ways[touching[0]] if len(touching) else robot.arc_m


def judge(robot, now, things, aim, most_mps):
    """Return the window of a robot at *now* (x, y, heading, v, w), whose command acts a tick later, among *things*."""
    shapely.prepare(things)
    x, y, heading, v, w = now
    at_once = robot._replace(acceleration_mps2=1e9, turn_acceleration_radps2=1e9)
    (start, *_, end), last = stop(at_once, (x, y, heading), v, w) if v or w else ([(x, y), (x, y)], heading)
    gone, pose = (start, end), (*end, last)
    error = math.remainder(math.atan2(aim[1] - pose[1], aim[0] - pose[0]) - pose[2], math.tau)
    window = commands(robot, v, w, most_mps, error)
    near = shapely.distance(shapely.Point(pose[:2]), things)
    kept, touch = min(robot.radius_m + robot.margin_m, near), min(robot.radius_m, near) - 1e-9
    rows = [_judged(robot, pose, gone, *command, things, aim, kept, touch) for command in window]
    return Choice(window, *(np.array(column) for column in zip(*rows, strict=True)))


def _judged(robot, pose, gone, v, w, things, aim, kept, touch):
    places, heading = stop(robot, pose, v, w)
    end = places[-1]
    theta = abs(math.remainder(math.atan2(aim[1] - end[1], aim[0] - end[0]) - heading, math.tau))
    free, step = dist(robot, pose, v, w, things, touch), robot.arc_m / STEPS
    terms = 1.0 - theta / math.pi, free / robot.arc_m, v / robot.speed_mps
    worth = robot.alpha * terms[0] + robot.beta * terms[1] + robot.gamma * terms[2]
    line = shapely.LineString(places) if len(set(places)) > 1 else shapely.Point(end)
    room = shapely.distance(line, things) - kept
    astray = _astray(robot, gone, places)
    # contact lies within the step before the place that touches
    surely = room > 1e-7 and astray < -1e-7 and (free == robot.arc_m or _brakes(robot, v, w, free - step))
    perhaps = room > -1e-7 and astray < 1e-7 and (free > robot.arc_m - 1.5 * step or _brakes(robot, v, w, free))
    return worth, surely, perhaps


def _brakes(robot, v, w, free):
    free = max(free, 0.0)
    return v <= math.sqrt(2 * free * robot.acceleration_mps2) and w**2 <= 2 * free * robot.turn_acceleration_radps2


def _astray(robot, gone, places):
    """Return how much farther than is allowed the stop gets from the stretch ahead (ours: others rely on it)."""
    change, way = robot.acceleration_mps2 * robot.tick_s**2, math.dist(*gone)
    least = 1.05 * change
    allowed = min(least + way, max(robot.stray_m, least))
    start, stretch = places[0], shapely.Point(places[0])
    if way > 1e-9:
        ahead = sum(np.arange(way + change, 0.0, -change))
        (ax, ay), (bx, by) = gone
        stretch = shapely.LineString([start, (start[0] + (bx - ax) / way * ahead, start[1] + (by - ay) / way * ahead)])
    return shapely.distance(shapely.points(places), stretch).max() - allowed
