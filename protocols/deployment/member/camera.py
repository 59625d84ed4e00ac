"""A robot's camera: it turns to what is to be photographed; a picture is the range of walls and bodies in each column.

The world renders no colours, but from ranges a page can draw a robot's view of a corridor.
"""

import math
from typing import Final

import cosim.elementary as elementary
from cosim.machine import Address, Drive
from cosim.observation import Observation
from cosim.units import Time, from_seconds
from protocols.deployment.messages.messages import COLUMNS, Picture
from protocols.deployment.parameters import MemberParameters
from protocols.deployment.tasks.events import PictureTaken

ALIGNED_RAD: Final = 0.02
"""Error of the heading up to which the camera faces a direction."""
APPROACH_PER_S: Final = 2.0
"""Rate of turning per error of the heading, near the direction that is wanted."""
STILL_MPS: Final = 0.01
"""Speed below which the robot stands still enough for a picture."""


def half_turn_s(rate_radps: float) -> float:
    """Return the time of :meth:`Camera.turn` for half a turn at *rate_radps*: constant at first, then exponential."""
    slows_rad = min(math.pi, max(ALIGNED_RAD, rate_radps / APPROACH_PER_S))
    return (math.pi - slows_rad) / rate_radps + elementary.log(slows_rad / ALIGNED_RAD) / APPROACH_PER_S


class Camera:
    """The camera of one robot, if it *works*; otherwise the robot has none."""

    def __init__(self, parameters: MemberParameters, works: bool) -> None:
        self.works = works
        self._view_rad = math.radians(parameters.view_deg)
        self._turn_radps = parameters.look_radps
        self._patience = from_seconds(parameters.stuck_s)
        self._since: Time = 0
        """Time at which the robot began to turn."""
        self._asked: list[tuple[Address, int]] = []

    def begin(self, now: Time) -> None:
        """Note that the robot begins to turn to what is to be photographed."""
        self._since = now

    def stuck(self, now: Time) -> bool:
        """Return whether the robot has turned for too long."""
        return now - self._since > self._patience  # other bodies may hold it, or push it about

    def turn(self, wanted_rad: float | None, observation: Observation) -> Drive | None:
        """Return how to turn to a direction; None if the robot faces it and stands, or if any direction will do."""
        if wanted_rad is None:
            return None
        error = math.remainder(wanted_rad - observation.heading_rad, math.tau)
        if abs(error) <= ALIGNED_RAD and observation.speed_mps < STILL_MPS:
            return None
        return Drive(0.0, max(-self._turn_radps, min(self._turn_radps, APPROACH_PER_S * error)))

    def taken(self, task: str, observation: Observation) -> PictureTaken:
        """Return the event of a picture that is taken."""
        return PictureTaken(task, observation.x_m, observation.y_m, observation.heading_rad)

    def ask(self, asked_by: Address, request: int) -> None:
        """Take a picture at the next tick for robot *asked_by*."""
        self._asked.append((asked_by, request))

    def pictures(self, me: Address, observation: Observation) -> list[tuple[Address, Picture]]:
        """Drain the pictures that robot *me* was asked for, each with the robot that asked."""
        asked, self._asked = self._asked, []
        return [(asked_by, self.picture(me, request, observation)) for asked_by, request in asked]

    def picture(self, me: Address, request: int, observation: Observation) -> Picture:
        """Return what is in front of robot *me*, in answer to *request*; without columns if it has no camera."""
        ranges_m = observation.ranges_m
        columns: list[float | None] = []
        if self.works and len(ranges_m):
            left = observation.heading_rad + 0.5 * self._view_rad
            for column in range(COLUMNS):
                angle = left - (column + 0.5) * self._view_rad / COLUMNS
                beam = round(angle / math.tau * len(ranges_m)) % len(ranges_m)
                range_m = float(ranges_m[beam])
                columns.append(round(range_m, 3) if math.isfinite(range_m) else None)
        return Picture(
            request=request,
            robot=me,
            at_m=(observation.x_m, observation.y_m),
            heading_rad=observation.heading_rad,
            view_rad=self._view_rad,
            columns_m=tuple(columns),
        )
