"""Range scans, converted from the frame in which they are sensed to that of the map.

Beam k of a scan looks along 2 pi k / n in the frame of odometry; a driver wants beam k along that direction of the map.
Between two beams that meet the same straight wall, the range follows exactly from theirs; elsewhere it is that of the
nearer beam.

A ring of sonars has only every k-th of these beams, and may reach less far. Its other beams read inf in a scan of all n
beams, or are left out.
"""

import math
from typing import Any, Final, NamedTuple

import numpy as np

import cosim.elementary as elementary
from cosim.arrays import Floats
from cosim.jit import njit
from cosim.navigation.schemas import beam_directions
from cosim.observation import Sighting, View

SAME_M: Final = 0.3
"""Difference in range below which two neighbouring beams have met the same wall."""
BODY_SLACK_M: Final = 0.1
"""Distance from the body of a robot in sight within which a beam that ends there has met that robot."""


class Sensor(NamedTuple):
    """The range sensor of one robot."""

    beams: int
    """Number of beams of the scanner."""
    every: int = 1
    """Step between the beams that the sensor has, among those."""
    range_m: float = math.inf
    """Range of the sensor; it reads nothing beyond."""
    noise_m: float = 0.0
    """Standard deviation of the sensor's own noise."""

    @property
    def directions(self) -> Floats:
        """Unit vectors (m, 2) of the sensor's beams, in the frame in which it scans."""
        return np.ascontiguousarray(beam_directions(self.beams)[:: self.every])

    @property
    def whole(self) -> bool:
        """True if it reads just what the scanner does."""
        return self.every == 1 and self.range_m == math.inf and self.noise_m == 0.0


class Scan:
    """The readings of one robot's sensor at one tick, computed when they are asked for first."""

    def __init__(self, view: View, sensor: Sensor, stream: np.random.Generator | None) -> None:
        """Take the *stream* that noise is drawn from; without one there is no noise."""
        self._view, self._sensor, self._stream = view, sensor, stream
        self._dense: Floats | None = None

    @property
    def dense_m(self) -> Floats:
        """Ranges of all the scanner's beams, in the frame in which they are sensed; inf beyond the sensor's range."""
        if self._dense is None:
            ranges, own = np.asarray(self._view.ranges_m(), np.float64), self._sensor
            if own.noise_m > 0.0 and self._stream is not None:
                ranges = np.maximum(ranges + own.noise_m * self._stream.standard_normal(len(ranges)), 0.0)
            self._dense = np.where(ranges <= own.range_m, ranges, math.inf) if own.range_m < math.inf else ranges
        return self._dense

    def along_m(self, turned_rad: float) -> Floats:
        """Return ranges (n,) along the directions of a map turned against the scan; inf for beams that are missing."""
        ranges = self.dense_m
        if turned_rad != 0.0:
            ranges = turned_ranges(ranges, turned_rad, SAME_M)
        if self._sensor.every > 1:
            kept = np.full(len(ranges), math.inf)
            kept[:: self._sensor.every] = ranges[:: self._sensor.every]
            return kept
        return ranges

    def of_walls_m(
        self, here_m: tuple[float, float], sightings: tuple[Sighting, ...], radii_m: tuple[float, ...]
    ) -> Floats:
        """Return the ranges (m,) of the sensor's own beams as it senses them; NaN where one has met a robot in sight.

        A robot of which only an edge shows may not be in sight; it is then taken for a wall.
        """
        ranges = self.dense_m[:: self._sensor.every]
        if len(self.dense_m) != self._sensor.beams:  # a robot without a scanner
            return np.full(len(self._sensor.directions), math.nan)
        return without_bodies(ranges, self._sensor.directions, here_m, sightings, radii_m)


def without_bodies(
    ranges_m: Floats,
    beams: Floats,
    here_m: tuple[float, float],
    sightings: tuple[Sighting, ...],
    radii_m: tuple[float, ...],
) -> Floats:
    """Return the ranges (m,) along unit vectors *beams* (m, 2) from a place; NaN where one has met a robot in sight."""
    if not sightings:
        return ranges_m
    met = np.zeros(len(ranges_m), np.bool_)
    for other, x_m, y_m in sightings:
        dx, dy = x_m - here_m[0], y_m - here_m[1]
        along, aside = beams[:, 0] * dx + beams[:, 1] * dy, np.abs(beams[:, 1] * dx - beams[:, 0] * dy)
        reach = radii_m[other] + BODY_SLACK_M
        met |= (aside < reach) & (np.abs(ranges_m - along) < reach)
    return np.where(met, math.nan, ranges_m)


@njit(cache=True)
def turned_ranges(ranges: Floats, turned: float, same: float) -> Any:
    """Return the ranges (n,) that a ring of beams has in a frame in which all directions have grown by *turned*.

    Beam k of both looks along 2 pi k / n of its frame. Neighbours whose *ranges* differ by less than *same* have met
    one straight wall.
    """
    count = ranges.shape[0]
    apart = 2.0 * math.pi / max(count, 1)
    found = np.empty(count)
    for k in range(count):
        at = k - turned / apart
        first = math.floor(at)
        part = at - first
        a, b = ranges[int(first) % count], ranges[(int(first) + 1) % count]
        if part == 0.0:
            found[k] = a
        elif abs(a - b) < same:
            # the line through both ends, in polar coordinates
            of_b, of_a = elementary.sin((1.0 - part) * apart), elementary.sin(part * apart)
            found[k] = a * b * elementary.sin(apart) / max(a * of_a + b * of_b, 1e-12)
        else:
            found[k] = a if part < 0.5 else b
    return found
