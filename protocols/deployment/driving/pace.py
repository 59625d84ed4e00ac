"""A mover that also knows the pace of its double, for the judge (:mod:`protocols.deployment.interference`)."""

from collections.abc import Sequence
from typing import Any

from cosim.machine import Drive
from cosim.observation import Observation
from cosim.units import Time
from protocols.deployment.driving.double import Double
from protocols.deployment.driving.mover import Mover
from protocols.deployment.tasks.plan import Place
from protocols.motion.traffic import Other


class PacedMover(Mover):
    """Drives as any mover does; the double moves nobody."""

    def __init__(self, *arguments: Any) -> None:
        """Take what a mover takes."""
        super().__init__(*arguments)
        self._double = Double(self._floor, self._radius_m, self._own.arrive_m)

    @property
    def pace_mps(self) -> tuple[float, float] | None:
        """How fast it goes by its last order, and would go without the others, m/s; None if it is not under way."""
        return self._double.pace_mps

    def go(self, place_m: Place, via_m: Sequence[Place] = ()) -> None:
        """Drive to a place, past way points in their order; what it did before is given up."""
        super().go(place_m, via_m)
        self._double.restart()

    def step(self, observation: Observation, others: Sequence[Other], now: Time) -> Drive | None:
        """Return what to do from the next tick on; None if that is what it does already."""
        drive = super().step(observation, others, now)
        goal = self._next_m if self.state in ("driving", "stuck") else None
        bodies = [((other.x_m, other.y_m), other.radius_m) for other in others]
        self._double.look(self._wheel, goal, bodies, self._held, self.yielding_to is not None)
        return drive
