"""When a robot that only passes a place has come to it: as near as the bodies let it that stand there already.

In a group stage all robots drive to one place, in leap-frog each passes all places that are held (paper 004, Fig. 3).
Nobody but who is to end up there needs the very place; without this those who pass would push each other off it.
"""

import math
from collections.abc import Sequence
from typing import Final

from cosim.units import Time, from_seconds
from protocols.deployment.driving.mover import Mover
from protocols.deployment.member.others import Others
from protocols.deployment.tasks.orders import Order
from protocols.deployment.tasks.plan import Go, Place
from protocols.motion.floor import Floor

NEARER_M: Final = 0.1
"""Who has come nearer by so much gets on."""


class Crowd:
    """Whether one robot stands in a crowd about the place that it is to pass."""

    def __init__(
        self, floor: Floor, radii_m: Sequence[float], radius_m: float, mover: Mover, patience_s: float
    ) -> None:
        self._floor, self._radii_m, self._radius_m, self._mover = floor, radii_m, radius_m, mover
        self._patience = from_seconds(patience_s)
        self._best_m = math.inf
        self._since: Time = 0

    def forget(self) -> None:
        """Begin anew: there is another place to go to."""
        self._best_m = math.inf

    def near(self, order: Order | None, here: Place, others: Others) -> bool:
        """Return whether it has come, but for the bodies that are nearer, to the place that it is ordered to pass."""
        go = None if order is None else order.errand
        return isinstance(go, Go) and not go.final and self._near(go.place_m, here, others)

    def _near(self, place_m: Place, here: Place, others: Others) -> bool:
        """Return whether the bodies that are nearer to a place would reach from there to it, one behind the other."""
        off_m = math.dist(here, place_m)
        nearer = [robot for robot, place in others.places_m.items() if math.dist(place, place_m) < off_m]
        reach_m = self._radius_m + sum(2.0 * self._radii_m[robot] + 2.0 * NEARER_M for robot in nearer)
        if not nearer or off_m > reach_m:
            return False
        way_m = self._floor.length_m(self._radius_m, here, place_m)
        return way_m is not None and way_m <= reach_m

    def come(self, go: Go, here: Place, others: Others, now: Time) -> bool:
        """Return whether it has come to a place that it passes: near, and it comes no nearer."""
        if go.final:
            return False
        off_m = math.dist(here, go.place_m)
        if off_m < self._best_m - NEARER_M:
            self._best_m, self._since = off_m, now
        held = self._mover.blocked_by is not None or now - self._since >= self._patience
        return held and self._near(go.place_m, here, others)
