"""When a robot that only passes a place has come to it: as near as the bodies let it that stand there already.

In a group stage all robots drive to one place, in leap-frog each passes all places that are held (paper 004, Fig. 3).
Nobody but who is to end up there needs the very place; without this those who pass would push each other off it.
"""

import math
from collections.abc import Sequence
from typing import Final

from cosim.units import Time, from_seconds
from protocols.deployment.floor import Floor
from protocols.deployment.member_others import Others
from protocols.deployment.mover import Mover
from protocols.deployment.plan import Place

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

    def near(self, here: Place, place_m: Place, others: Others) -> bool:
        """Return whether the bodies that are nearer to the place keep it from coming nearer.

        It has come near if they would reach from the place to where it is, one behind the other. No body: not near.
        """
        off_m = math.dist(here, place_m)
        nearer = [robot for robot, place in others.places_m.items() if math.dist(place, place_m) < off_m]
        reach_m = self._radius_m + sum(2.0 * self._radii_m[robot] + 2.0 * NEARER_M for robot in nearer)
        if not nearer or off_m > reach_m:
            return False
        way_m = self._floor.length_m(self._radius_m, here, place_m)
        return way_m is not None and way_m <= reach_m

    def come(self, here: Place, place_m: Place, others: Others, now: Time) -> bool:
        """Return whether it has come to the place, for one that passes it: near, and it comes no nearer."""
        off_m = math.dist(here, place_m)
        if off_m < self._best_m - NEARER_M:
            self._best_m, self._since = off_m, now
        held = self._mover.blocked_by is not None or now - self._since >= self._patience
        return held and self.near(here, place_m, others)
