"""Floors of the experiments, and bodies that walk on them: cosim's fleet and senses without a kernel around them."""

import math
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
import yaml

from cosim.geometry.segments import clearance, packed_walls
from cosim.machine import GoTo
from cosim.observation import Observation
from cosim.randomness import Streams
from cosim.robots.body import BodySettings
from cosim.robots.motion import Fleet
from cosim.robots.senses import Senses, SenseSettings
from cosim.units import MS
from protocols.aggregation.ground import Ground, ground
from tests.checkout import FLOORS

Point = tuple[float, float]
TICK = 100 * MS
RADIUS_M = 0.25


@cache
def floor(name: str) -> tuple[Any, tuple[float, float, float, float], dict[str, tuple[Point, ...]], tuple[Any, ...]]:
    """Return walls, bounds, named places and solid polygons of a floor of the experiments."""
    text = yaml.safe_load((FLOORS / f"{name}.yaml").read_text())
    rings = tuple(tuple(map(tuple, ring)) for ring in text.get("polygons", ()))
    sides = [(*a, *b) for ring in rings for a, b in zip(ring, (*ring[1:], ring[0]), strict=True)]
    walls = np.array([*map(tuple, text.get("walls", ())), *sides], float).reshape(-1, 4)
    places = {key: tuple(map(tuple, value)) for key, value in text.get("places", {}).items()}
    return walls, tuple(map(float, text["bounds_m"])), places, rings


def in_rings(points: Any, rings: Sequence[Any]) -> Any:
    """Return which points lie in a polygon, by shapely."""
    import shapely

    inside = np.zeros(len(points), bool)
    for ring in rings:
        inside |= shapely.intersects_xy(shapely.Polygon(ring), points[:, 0], points[:, 1])
    return inside


def ground_of(name: str, camera_m: float, cell_m: float, **options: Any) -> Ground:
    """Return the ground of a floor of the experiments."""
    walls, bounds, places, rings = floor(name)
    return ground(walls, bounds, places, RADIUS_M, camera_m, cell_m, lambda at: in_rings(at, rings), **options)


def hall(width_m: float, height_m: float, walls: Sequence[tuple[float, ...]] = (), cell_m: float = 0.25) -> Ground:
    """Return the ground of a rectangle with some walls in it."""
    rows = np.array(walls, float).reshape(-1, 4)
    return ground(rows, (0.0, 0.0, width_m, height_m), {}, RADIUS_M, 5.0, cell_m)


class Stage:
    """Robots at *starts* on a ground; those without a walker stand where they are."""

    def __init__(
        self,
        on: Ground,
        starts: Sequence[Point],
        drive: str = "grid",
        speed_mps: float = 1.0,
        range_m: float = 20.0,
        acceleration_mps2: float = 1.0,
    ) -> None:
        body = BodySettings(radius_m=RADIUS_M, drive=drive, speed_mps=speed_mps, acceleration_mps2=acceleration_mps2)
        self.ground = on
        self.walkers: list[Any] = [None] * len(starts)
        self.fleet = Fleet([body] * len(starts), starts, on.walls, TICK)
        self.senses = Senses(
            SenseSettings(),
            packed_walls(on.walls),
            [RADIUS_M] * len(starts),
            [(0.0, 0.0, 0.0)] * len(starts),
            range_m,
            TICK,
            Streams(1),
        )
        self.ticks = 0
        self.orders: list[list[tuple[int, Any]]] = [[] for _ in starts]
        self.nearest_m = math.inf
        """The least room between two bodies so far."""
        self.least_clearance_m = math.inf
        """The least distance of a middle from a wall so far."""

    def tick(self) -> list[Observation]:
        """Move, sense, decide."""
        self.fleet.step()
        observations = self.senses.observe(self.fleet)
        self.ticks += 1
        for robot, walker in enumerate(self.walkers):
            if walker is None:
                continue
            order = walker.step(observations[robot])
            if order is not None:
                self.orders[robot].append((self.ticks, order))
                self.fleet.apply([(robot, order)])
        return observations

    def run(self, seconds: float) -> float | None:
        """Tick until all walkers have arrived; return how long that took in s, None for longer than *seconds*."""
        begin = self.ticks
        while self.ticks - begin < seconds * 10:
            self.tick()
            self._measure()
            if all(walker is None or walker.arrived for walker in self.walkers):
                return (self.ticks - begin) / 10
        return None

    def place(self, robot: int) -> Point:
        """Return where a robot is."""
        return float(self.fleet.x_m[robot]), float(self.fleet.y_m[robot])

    def stand(self, robot: int) -> None:
        """Have a robot without a walker stay where it is."""
        self.fleet.apply([(robot, GoTo(*self.place(robot)))])

    def _measure(self) -> None:
        places = np.array([self.place(robot) for robot in range(len(self.walkers))])
        self.least_clearance_m = min(self.least_clearance_m, float(clearance(self.ground.walls, places, 5.0).min()))
        for k in range(1, len(places)):
            gaps = np.hypot(*(places[k:] - places[:-k]).T)
            self.nearest_m = min(self.nearest_m, float(gaps.min()) - 2 * RADIUS_M)
