"""What planner and executive ask of the known map."""

from typing import Protocol

from protocols.deployment.tasks.plan import Place


class Ways(Protocol):
    """The navigation layer, as far as plans need it: "summary information in the form of constraints" (section 4)."""

    def length_m(self, radius_m: float, a: Place, b: Place) -> float | None:
        """Return the length of the way of a disc from *a* to *b*; None if there is none."""

    def way(self, radius_m: float, a: Place, b: Place) -> list[Place] | None:
        """Return the corners of that way, both ends included."""

    def free(self, radius_m: float, at: Place) -> bool:
        """Return whether a disc can stand at *at*."""
