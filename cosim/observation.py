"""What a robot senses at one world tick: its own pose, who is in sight and where, how far the walls are.

Everything is told in the robot's own frame F_i, which is fixed in space. Where a scenario says so, that is the world;
else it is odometry: it begins at an unknown place, turned by an unknown angle, and nobody knows another's.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple, Protocol, TypeAlias

import numpy as np

from cosim.arrays import Floats

Marks: TypeAlias = Sequence[tuple[float, float]]
"""Places in the world's frame, m: of landmarks or targets that a sensor may detect."""

_NOTHING: Final = np.empty(0)


class Sighting(NamedTuple):
    """Another robot, where it is seen: in the observer's frame, with the errors of its sensor."""

    address: int
    x_m: float
    y_m: float


class Picture(Protocol):
    """What the camera of a robot has seen: made when it is first asked for, which may be later."""

    @property
    def visible(self) -> tuple[int, ...]:
        """The robots in line of sight within the sensor's range, in order of their numbers."""

    @property
    def sightings(self) -> tuple[Sighting, ...]:
        """Where they are seen, in the same order."""

    def around(self, x_m: float, y_m: float, reach_m: float) -> Sequence[Sighting]:
        """Return those of them that are nearer than *reach_m* to a place of the robot's frame, in the same order."""


class Seen(NamedTuple):
    """A picture that has been made."""

    visible: tuple[int, ...] = ()
    sightings: tuple[Sighting, ...] = ()

    def around(self, x_m: float, y_m: float, reach_m: float) -> Sequence[Sighting]:
        """Return the sightings that are nearer than *reach_m* to a place, in their order."""
        return [each for each in self.sightings if (each[1] - x_m) ** 2 + (each[2] - y_m) ** 2 < reach_m * reach_m]


NOBODY: Final = Seen()


class View(Protocol):
    """What a robot can look at, as long as it is at the pose of an observation."""

    def sees(self, points_m: Sequence[tuple[float, float]]) -> list[bool]:
        """Return which points of the robot's frame lie in its visibility region: in range, and no wall before them."""

    def detects(self, marks_m: Marks, range_m: float) -> list[tuple[float, float] | None]:
        """Return where marks of the world appear in the robot's frame: see :meth:`Observation.detects`."""

    def ranges_m(self) -> Floats:
        """Return how far each beam of a ring goes."""


class Observation(NamedTuple):
    """What a robot knows of itself and sees at one world tick. SI units; angles counter-clockwise from the x axis."""

    x_m: float
    y_m: float
    heading_rad: float
    speed_mps: float
    arrived: bool
    """The last ``GoTo`` has been carried out (or there was none)."""
    blocked: bool
    """A wall or another body has kept the robot from moving as commanded in the tick that just ended."""
    picture: Picture = NOBODY
    """The last picture of its camera."""
    view: View | None = None
    """Where the robot looks from."""

    @property
    def visible(self) -> tuple[int, ...]:
        """The robots in line of sight within the sensor's range, in order of their numbers."""
        return self.picture.visible

    @property
    def sightings(self) -> tuple[Sighting, ...]:
        """Where they are seen, in the same order; as old as the last picture of the camera."""
        return self.picture.sightings

    def sees(self, points_m: Sequence[tuple[float, float]]) -> list[bool]:
        """Return which points of the robot's frame lie in its visibility region V(R); to be asked at this tick only.

        (Sgorbissa and Arkin, section 2.) A robot without a sensor for it sees nothing.
        """
        return [False] * len(points_m) if self.view is None else self.view.sees(points_m)

    def detects(self, marks_m: Marks, range_m: float) -> list[tuple[float, float] | None]:
        """Return where in the robot's frame the marks at *marks_m* of the world appear; None for those it does not see.

        It sees those at most *range_m* from where its body truly is that lie in its visibility region, wherever it
        takes itself to be; they appear as far from the believed pose as they are from the true one. *marks_m* are
        places that only the world knows, for a sensor's model to ask about; to be asked at this tick only. A robot
        without a sensor for it sees nothing.
        """
        return [None] * len(marks_m) if self.view is None else self.view.detects(marks_m, range_m)

    @property
    def ranges_m(self) -> Floats:
        """How far n beams go: beam k, at the angle 2 pi k / n of the frame, meets a wall or a body so many metres off.

        inf beyond the scanner's range. To be asked at this tick only; nothing is scanned unless it is asked.
        """
        return _NOTHING if self.view is None else self.view.ranges_m()
