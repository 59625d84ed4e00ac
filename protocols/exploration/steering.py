"""The lower layer: how a desired heading becomes motion (paper 001, section 3.2; speeds, section 5).

The robot drives at a constant speed and turns towards the heading, the less the nearer it is to it. A sensor-linked
layer subsumes that where a beam of its own scanner ends too near in the way (section 5.1, "subsumption").
"""

import math

from cosim.machine import Drive
from cosim.navigation.schemas import Floats
from protocols.exploration.parameters import SteeringParameters


class Steering:
    """The lower layer of one robot."""

    def __init__(self, parameters: SteeringParameters, radius_m: float, most_mps: float) -> None:
        self._own = parameters
        self._slow_mps = min(parameters.speed_mps, most_mps)
        self._fast_mps = min(parameters.fast_mps or parameters.speed_mps, most_mps)
        self._stop_m = None if parameters.margin_m is None else radius_m + parameters.margin_m

    def drive(self, desired_rad: float, heading_rad: float, ranges_m: Floats) -> Drive:
        """Return the order that turns the robot towards *desired_rad*; angles and beams in the robot's frame."""
        error = math.remainder(desired_rad - heading_rad, math.tau)
        turn = min(max(self._own.turn_gain * error, -self._own.turn_radps), self._own.turn_radps)
        nearest_m = float(ranges_m.min())
        speed = self._fast_mps if nearest_m > self._own.fast_m else self._slow_mps
        if self._stop_m is not None and nearest_m < self._stop_m and self._ahead(ranges_m, heading_rad):
            speed = 0.0
        return Drive(speed, turn)

    def _ahead(self, ranges_m: Floats, heading_rad: float) -> bool:
        """Return whether something nearer than the margin lies before the robot: it may drive away from what is behind."""
        count = len(ranges_m)
        ahead = round(heading_rad / math.tau * count)
        half = count // 4
        return any(ranges_m[(ahead + k) % count] < self._stop_m for k in range(-half, half + 1))
