"""A corridor with rooms, movers on it whose odometry drifts, and what tells them where they are."""

import math
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np

from cosim.arrays import Floats
from cosim.geometry.segments import ray_casts, segment_grid
from cosim.machine import Event
from cosim.observation import Observation, Seen, Sighting
from cosim.protocol import Surroundings
from cosim.robots.senses import SenseSettings
from protocols.localization.positioning import KnownMaps, Localised, PositioningParameters
from protocols.localization.scan import Sensor
from tests.protocols.deployment.driving_scene import TICK, Scene, body, box, line

BEAMS, RANGE_M = 180, 8.0
RADIUS_M = 0.25
WALLS = [
    *box(24.0, 10.0),
    *line((0.0, 4.0), (5.0, 4.0)),
    *line((6.5, 4.0), (14.0, 4.0)),
    *line((15.5, 4.0), (24.0, 4.0)),
    *line((0.0, 6.5), (10.0, 6.5)),
    *line((11.5, 6.5), (20.0, 6.5)),
    *line((21.5, 6.5), (24.0, 6.5)),
    *line((10.0, 0.0), (10.0, 4.0)),
    *line((15.5, 6.5), (15.5, 10.0)),
]
DRIFT = {"odometry_slip": 0.05, "odometry_turn_rad": 0.1}
"""Of odometry as a robot of the time has it: after 40 m it is off by half a radian."""


def charts(walls: Sequence[tuple[float, ...]] = WALLS) -> KnownMaps:
    rows = np.array(walls, np.float64)
    low, high = rows.reshape(-1, 2).min(axis=0), rows.reshape(-1, 2).max(axis=0)
    known = SimpleNamespace(
        walls_m=rows,
        bounds_m=(*low.tolist(), *high.tolist()),
        forbidden=lambda points: np.zeros(len(points), np.bool_),
    )
    return KnownMaps(known)  # type: ignore[arg-type]


def localised(
    events: list[Event] | None = None,
    seed: int = 1,
    sensor: Sensor | None = None,
    frame: tuple[float, float, float] = (0.0, 0.0, 0.0),
    cell_m: float = 0.1,
    **own: Any,
) -> Localised:
    sensor, parameters = sensor or Sensor(BEAMS), PositioningParameters.model_validate({"kind": "mcl", **own})
    reach = {"range_m": min(sensor.range_m, RANGE_M)}
    return Localised(
        parameters.model_copy(update={"filter": parameters.filter.model_copy(update=reach)}),
        charts().known(cell_m, RADIUS_M),
        sensor,
        frame,
        (RADIUS_M,) * 4,
        TICK,
        np.random.default_rng(seed),
        ([] if events is None else events).append,
    )


def scanned(pose: tuple[float, float, float], frame_rad: float = 0.0, beams: int = BEAMS) -> Floats:
    """Return what a ring meets at a true *pose*, whose frame is turned by *frame_rad* in the world."""
    angles = frame_rad + 2.0 * np.pi * np.arange(beams) / beams
    ranges = ray_casts(segment_grid(WALLS), np.tile(pose[:2], (beams, 1)), angles, RANGE_M)
    return np.where(ranges < RANGE_M, ranges, math.inf)


class Scanned:
    """A view that shows some ranges, counts how often it is asked, and sees what is right of the y axis.

    Marks of the world within range of its origin it detects 1 m farther along x.
    """

    def __init__(self, ranges_m: Floats) -> None:
        self._ranges_m, self.asked = ranges_m, 0

    def sees(self, points_m: Any) -> list[bool]:
        return [x > 0.0 for x, _ in points_m]

    def detects(self, marks_m: Any, range_m: float) -> list[tuple[float, float] | None]:
        return [(x + 1.0, y) if math.hypot(x, y) <= range_m else None for x, y in marks_m]

    def ranges_m(self) -> Floats:
        self.asked += 1
        return self._ranges_m


def told(pose: tuple[float, float, float], *others: Sighting, ranges_m: Floats | None = None) -> Observation:
    ranges_m = np.full(BEAMS, math.inf) if ranges_m is None else ranges_m
    picture = Seen(tuple(each.address for each in others), others)
    return Observation(*pose, 0.3, True, False, picture, Scanned(ranges_m))


class Drifting(Scene):
    """Movers among the walls by an odometry that drifts; with a filter each, or by odometry alone."""

    def __init__(self, starts: Sequence[tuple[float, float]], filters: bool = True, **own: Any) -> None:
        scanner = {"beams": BEAMS, "beam_range_m": RANGE_M, "range_noise_m": 0.02}
        settings = SenseSettings.model_validate(scanner | DRIFT)
        bodies = [body(radius_m=RADIUS_M, speed_mps=0.5, acceleration_mps2=0.5)] * len(starts)
        super().__init__(WALLS, starts, bodies, senses=settings)
        self.filters = [localised(seed=me + 1, **own) if filters else None for me in range(len(starts))]
        self.believed: list[Observation] = []
        self.worst_m = 0.0
        """Farthest that anybody ever was from where it took itself to be."""
        sensed = self.senses.observe
        self.senses = SimpleNamespace(observe=lambda fleet: self.located(sensed(fleet)))  # type: ignore[assignment]

    def located(self, observations: list[Observation]) -> list[Observation]:
        self.believed = [
            seen if filter_ is None else filter_.locate(seen)
            for filter_, seen in zip(self.filters, observations, strict=True)
        ]
        errors = [math.dist(self.place(me), seen[:2]) for me, seen in enumerate(self.believed)]
        self.worst_m = max(self.worst_m, *errors)
        return self.believed


def surroundings_of(walls: Floats, bounds_m: tuple[float, float, float, float]) -> Surroundings:
    return Surroundings(((1.0, 1.0),), 0.2, 0.5, 0.5, TICK, walls, bounds_m, lambda p: np.zeros(len(p), np.bool_))
