"""A robot's camera: it turns to what is wanted, and a picture is how far walls and bodies are, column by column.

The world renders no colours: a picture of distances is what a page can draw as a robot's view of a corridor.
"""

import math
from typing import Final

from cosim.machine import Address, Drive
from cosim.observation import Observation
from cosim.units import Time, from_seconds
from protocols.deployment.messages.messages import COLUMNS, Picture
from protocols.deployment.parameters import MemberParameters
from protocols.deployment.tasks.events import PictureTaken

ALIGNED_RAD: Final = 0.02
"""As near to a direction as this is in it."""
STILL_MPS: Final = 0.01


class Camera:
    """One robot's camera, or its lack of one."""

    def __init__(self, parameters: MemberParameters, works: bool) -> None:
        self.works = works
        self._view_rad = math.radians(parameters.view_deg)
        self._turn_radps = parameters.look_radps
        self._patience = from_seconds(parameters.stuck_s)
        self._since: Time = 0
        """When it began to turn."""
        self._asked: list[tuple[Address, int]] = []

    def begin(self, now: Time) -> None:
        """Begin to turn to what is to be photographed."""
        self._since = now

    def stuck(self, now: Time) -> bool:
        """Return whether it has turned for so long that something must hinder it, or pushes it about."""
        return now - self._since > self._patience

    def turn(self, wanted_rad: float | None, observation: Observation) -> Drive | None:
        """Return how to turn to a direction; None if it looks there, and stands, or if any direction will do."""
        if wanted_rad is None:
            return None
        error = math.remainder(wanted_rad - observation.heading_rad, math.tau)
        if abs(error) <= ALIGNED_RAD and observation.speed_mps < STILL_MPS:
            return None
        return Drive(0.0, max(-self._turn_radps, min(self._turn_radps, 2.0 * error)))

    def taken(self, task: str, observation: Observation) -> PictureTaken:
        """Return the event of a picture that is taken."""
        return PictureTaken(task, observation.x_m, observation.y_m, observation.heading_rad)

    def ask(self, asked_by: Address, request: int) -> None:
        """Take a picture at the next tick for who asks."""
        self._asked.append((asked_by, request))

    def pictures(self, me: Address, observation: Observation) -> list[tuple[Address, Picture]]:
        """Drain the pictures that robot *me* was asked for, with who did."""
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
