"""Bug2 told with shapely: rings, distances along them and points in polygons. Slow, for scenes in general position."""

from typing import NamedTuple

import numpy as np
import shapely

from tests.navigation.scenes import Scene

NEAR_M = 1e-6


class Told(NamedTuple):
    """Whether the goal was reached, over how many metres, and the bound on that from the M-line's crossings."""

    arrived: bool
    length_m: float
    hits: int
    bound_m: float


def bug2_by_hand(scene: Scene) -> Told:
    """Follow the M-line; at each obstacle turn, walk along its ring, and leave where that helps."""
    rings = [shapely.LinearRing(loop) for loop in (*scene.obstacles, *scene.enclosures)]
    line = shapely.LineString([scene.start, scene.goal])
    met = [_crossings(line, ring) for ring in rings]
    bound = line.length + sum(len(found) * ring.length for found, ring in zip(met, rings, strict=True)) / 2
    walked, at, hits = 0.0, 0.0, 0
    while True:
        ahead = [(d, number) for number, found in enumerate(met) for d in found if d > at + NEAR_M]
        if not ahead:
            return Told(True, walked + line.length - at, hits, bound)
        hit, number = min(ahead)
        walked, hits = walked + hit - at, hits + 1
        ring = rings[number]
        leave = _walk(scene, line, ring, met[number], hit)
        if leave is None:
            return Told(False, walked + ring.length, hits, bound)
        at, way = leave
        walked += way


def _crossings(line: shapely.LineString, ring: shapely.LinearRing) -> list[float]:
    return [float(line.project(point)) for point in shapely.get_parts(line.intersection(ring)) if not point.is_empty]


def _walk(
    scene: Scene, line: shapely.LineString, ring: shapely.LinearRing, met: list[float], hit: float
) -> tuple[float, float] | None:
    """Return the distance of the leave point from the start, and the way to it along the ring."""
    begin = ring.project(line.interpolate(hit))
    sign = _turn(scene, line, ring, begin)
    ways = sorted(((sign * (ring.project(line.interpolate(d)) - begin)) % ring.length, d) for d in met)
    for way, distance in ways:
        ahead = line.interpolate(min(distance + NEAR_M, line.length))
        if distance > hit + NEAR_M and not scene.solid.contains(ahead):
            return distance, way
    return None


def _turn(scene: Scene, line: shapely.LineString, ring: shapely.LinearRing, begin: float) -> int:
    """Return whether the local direction follows the ring's own order (1) or not (-1)."""
    (x1, y1), (x2, y2) = (np.array(ring.interpolate((begin + d) % ring.length).coords[0]) for d in (-NEAR_M, NEAR_M))
    (sx, sy), (tx, ty) = line.coords
    turns_left = (tx - sx) * (y2 - y1) - (ty - sy) * (x2 - x1) > 0
    return 1 if turns_left == scene.left else -1
