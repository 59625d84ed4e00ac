"""The team as planner and executive know it: the robots' bodies and abilities, and the place of base."""

from typing import Literal, NamedTuple, Protocol

from cosim.machine import Address
from protocols.deployment.tasks.plan import Place


class Body(NamedTuple):
    """One robot, as far as plans depend on it (paper 004, section 7: sizes, speeds, laser or sonar, camera or none)."""

    radius_m: float = 0.25
    speed_mps: float = 0.5
    acceleration_mps2: float = 0.5
    half_turn_s: float = 7.0
    """Time of half a turn on the spot, s."""
    camera: bool = True
    sensor: Literal["laser", "sonar"] = "laser"


class Crew(NamedTuple):
    """The whole team; a robot's address is its index in *bodies*."""

    bodies: tuple[Body, ...]
    base_m: Place = (0.0, 0.0)
    """Place from which robots start and to which they return, m."""

    @property
    def robots(self) -> range:
        """All addresses."""
        return range(len(self.bodies))

    def radius_m(self, robot: Address) -> float:
        """Return a robot's radius."""
        return self.bodies[robot].radius_m

    def has_camera(self, robot: Address) -> bool:
        """Return whether a robot can take pictures."""
        return self.bodies[robot].camera


# ---------------------------------------------------------------- ways
# The questions that planner and executive ask about the known map.


class Ways(Protocol):
    """The navigation layer, as far as plans need it: "summary information in the form of constraints" (section 4)."""

    def length_m(self, radius_m: float, a: Place, b: Place) -> float | None:
        """Return the length of the way of a disc from *a* to *b*; None if there is none."""

    def way(self, radius_m: float, a: Place, b: Place) -> list[Place] | None:
        """Return the corners of that way, both ends included."""

    def free(self, radius_m: float, at: Place) -> bool:
        """Return whether a disc can stand at *at*."""
