"""The lower layer: how a desired heading becomes motion (paper 001, section 3.2; speeds and subsumption, section 5).

The robot drives at a constant speed and turns towards the heading at a rate that grows with the error. A sensor-linked
layer subsumes that where the robot's own scanner shows no room: it takes the nearest heading along which the body fits
for a while, and the robot stands while it turns if there is no room ahead.
"""

import math
from typing import Final

import numpy as np

import cosim.elementary as elementary
from cosim.arrays import Floats
from cosim.jit import njit
from cosim.machine import Drive
from protocols.exploration.parameters import SteeringParameters

_HEADINGS: Final = 36
"""Number of headings that are tried, on both sides of the desired one."""
_CLEAR_S: Final = 1.0
"""Time for which a robot could drive on along a heading that it takes."""
# A robot that comes towards it needs as much room to stop as it does itself.
_STOP_S: Final = 0.5
"""Time for which it must be able to drive on; else it stands."""

_SCANS: Final = 5
"""Number of scans that are remembered."""
_BEHIND_RAD: Final = 0.5 * math.pi
"""Heading error above which a standing robot goes on standing."""
_ABOUT_RAD: Final = 0.75 * math.pi
"""Heading error above which a turning robot keeps the side to which it turns."""
_AMPLE_M: Final = 0.01
"""Margin, more than rounding, beyond which points are too far off to matter."""
_ASIDE_RAD: Final = 1e-6
"""Difference below which headings are the same."""


@njit(cache=True)
def free_m(ranges_m: Floats, beams: Floats, ux: float, uy: float, half_m: float) -> float:
    """Return how far a disc of radius *half_m* can go along the unit vector (ux, uy) until it touches a point seen.

    *ranges_m* (n,) along *beams* (n, 2); below 0 if the disc already overlaps a point ahead, inf if none is in the way.
    """
    free = math.inf
    for k in range(ranges_m.shape[0]):
        along = ranges_m[k] * (beams[k, 0] * ux + beams[k, 1] * uy)
        if 0.0 < along < math.inf:
            aside = ranges_m[k] * (beams[k, 0] * uy - beams[k, 1] * ux)
            if abs(aside) < half_m:
                free = min(free, along - math.sqrt(half_m * half_m - aside * aside))
    return free


@njit(cache=True)
def free_heading(ranges_m: Floats, beams: Floats, desired: float, half_m: float, need_m: float, side: int) -> float:
    """Return the heading nearest to *desired* along which there is *need_m* of room; NaN if none is.

    Of two equally near ones, take that on the *side* (1 left, -1 right).
    """
    for k in range(_HEADINGS // 2 + 1):
        for sign in (side, -side):
            heading = desired + sign * k * (2.0 * math.pi / _HEADINGS)
            if free_m(ranges_m, beams, elementary.cos(heading), elementary.sin(heading), half_m) >= need_m:
                return heading
    return math.nan


@njit(cache=True)
def overruled(
    scans: Floats,
    newest: int,
    ranges_m: Floats,
    beams: Floats,
    desired: float,
    heading: float,
    half_m: float,
    slow_mps: float,
    fast_mps: float,
    fast_m: float,
    side: int,
) -> tuple[float, float, float]:
    """Return the heading to turn to (NaN if there is room along none), the speed, and the room ahead.

    Room is only measured as far as it is needed, and is infinite where nothing so near is in the way.

    *ranges_m* (n,) becomes row *newest* of *scans* (m, n). For each beam the shortest of its last ranges counts, as the
    end of a thin wall may be between two beams. With *half_m* 0 nothing is in the way.
    """
    close, count = 0, 0
    for k in range(ranges_m.shape[0]):
        scans[newest, k] = ranges_m[k]
        close += ranges_m[k] <= fast_m
    speed = slow_mps if close else fast_mps
    need_m = _CLEAR_S * speed
    near, near_m = np.zeros(ranges_m.shape[0], np.bool_), need_m + half_m + _AMPLE_M
    for row in range(scans.shape[0]):  # this loop and the first hold no branch: processors do several beams at once
        for k in range(ranges_m.shape[0]):
            near[k] |= scans[row, k] < near_m
    met, along = np.empty_like(ranges_m), np.empty_like(beams)
    for k in range(ranges_m.shape[0]):
        if near[k]:  # what is farther leaves the room that is needed
            met[count], along[count, 0], along[count, 1] = scans[:, k].min(), beams[k, 0], beams[k, 1]
            count += 1
    found = free_heading(met[:count], along[:count], desired, half_m, need_m, side)
    return found, speed, free_m(met[:count], along[:count], elementary.cos(heading), elementary.sin(heading), half_m)


def without_lone(ranges_m: Floats) -> Floats:
    """Return a scan (n,), a ring, in which no beam is shorter than both of its neighbours.

    What a single beam has met may be a false return, which the robot would turn away from, and mark.
    """
    return np.asarray(np.maximum(ranges_m, np.minimum(np.roll(ranges_m, 1), np.roll(ranges_m, -1))))


class Steering:
    """The lower layer of one robot."""

    def __init__(self, parameters: SteeringParameters, beams: Floats, radius_m: float, most_mps: float) -> None:
        self._own = parameters
        self._beams = beams
        self._slow_mps = min(parameters.speed_mps, most_mps)
        self._fast_mps = min(parameters.fast_mps or parameters.speed_mps, most_mps)
        self._half_m = 0.0 if parameters.margin_m is None else radius_m + parameters.margin_m
        self._side = 1
        self._turns = 0.0
        """Side to which it turned last: 1 left, -1 right."""
        self._stands = False
        self._scans: Floats = np.full((_SCANS, len(beams)), math.inf)
        """Last ranges of each beam."""
        self._noted = 0

    def drive(self, desired_rad: float, heading_rad: float, ranges_m: Floats) -> Drive:
        """Return the order that turns the robot towards *desired_rad*; angles and beams in the robot's frame."""
        if self._scans.shape[1] != len(ranges_m):  # a robot without a scanner has none to remember
            self._scans = np.full((_SCANS, len(ranges_m)), math.inf)
        own = self._own
        found, speed, room = overruled(
            self._scans,
            self._noted % _SCANS,
            ranges_m,
            self._beams,
            desired_rad,
            heading_rad,
            self._half_m,
            self._slow_mps,
            self._fast_mps,
            own.fast_m,
            self._side,
        )
        self._noted += 1
        if found != desired_rad and not math.isnan(found):
            self._keep_to_side(math.remainder(found - desired_rad, math.tau))
            desired_rad = found
        error = self._on_one_side(math.remainder(desired_rad - heading_rad, math.tau))
        turn = min(max(own.turn_gain * error, -own.turn_radps), own.turn_radps)
        # the end of a thin wall may be between two beams at the next tick
        self._stands = room < _STOP_S * speed or (self._stands and abs(error) > _BEHIND_RAD)
        return Drive(0.0 if self._stands else speed, turn)

    def _on_one_side(self, error_rad: float) -> float:
        """Return the heading error, on the side to which the robot already turns if the error is nearly a half turn."""
        # A desired heading that trembles behind the robot would make it turn left and right, and drive straight on.
        if abs(error_rad) > _ABOUT_RAD and error_rad * self._turns < 0.0:
            error_rad += self._turns * math.tau
        self._turns = math.copysign(1.0, error_rad)
        return error_rad

    def _keep_to_side(self, aside_rad: float) -> None:
        if abs(aside_rad) > _ASIDE_RAD:
            self._side = 1 if aside_rad > 0.0 else -1
