"""The algorithm A of a robot, as its parameters name it, and how it walks by VisBug.

VisBug sends a robot from corner to corner of the grown walls. A robot that overshoots a corner by a step may be out of
sight of its intermediate target, and a command acts a tick late. So VisBug is asked from where the robot will be when
the answer takes effect. Bodies, of which VisBug knows nothing, are rounded as on a straight way.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from cosim.arrays import Floats
from cosim.geometry.boundary import Boundary, packed_boundary
from cosim.machine import Address
from cosim.navigation.schemas import Vector
from cosim.navigation.status import STATUSES, STUCK, UNREACHABLE, Status
from cosim.navigation.steering import AvoidPast, Navigator, PotentialField, Steer
from cosim.navigation.visbug import MEMORY, visbug_packed
from cosim.observation import Observation
from cosim.randomness import Draws
from cosim.units import Time
from protocols.reflection.parameters import Parameters
from protocols.reflection.setup import Point
from protocols.reflection.straight import AHEAD_STEPS, Straight

_new: Final = tuple.__new__  # what a named tuple's own constructor calls; a third faster
RANDOM_PERSISTENCE = 30
"""Motion steps for which random motion keeps its direction."""
# A goal in sight is headed for before VisBug is asked, which only has to know when it is there.
VISBUG_NEAR_M = 0.01
"""Distance at which VisBug is at its goal."""
WHOLE = 0.999
"""Least square of the length of a whole step."""


class HeadStraight:
    """The simplest algorithm A: head for the goal, whatever is in the way."""

    def steer(
        self,
        x_m: float,
        y_m: float,
        goal_m: Vector,
        ranges_m: Sequence[float] | Floats,
        sightings_m: Sequence[Vector] = (),
        step_m: float = 0.1,
    ) -> Steer:
        """Return the unit vector to the goal."""
        dx, dy = goal_m[0] - x_m, goal_m[1] - y_m
        distance = math.hypot(dx, dy)
        if distance == 0.0:
            return Steer(0.0, 0.0, Status.ARRIVED)
        return Steer(dx / distance, dy / distance, Status.UNDERWAY)

    def restart(self) -> None:
        """Forget nothing: there is no memory."""


class VisBug:
    """VisBug-21 behind the convention of navigators: the walls come from the loops, seen up to its radius of vision.

    It does not use the scan, and knows nothing of other robots. Where the way bends a step is shorter than the others.
    """

    def __init__(self, loops: Boundary, vision_m: float, near_m: float) -> None:
        """Walk among *loops*, in the robot's own frame and grown by its radius; be at a goal within *near_m*."""
        self._loops = packed_boundary(loops)
        self._vision_m = vision_m
        self._near_m = near_m
        self._memory = np.zeros(MEMORY)
        self._begun = False

    def steer(
        self,
        x_m: float,
        y_m: float,
        goal_m: Vector,
        ranges_m: Sequence[float] | Floats,
        sightings_m: Sequence[Vector] = (),
        step_m: float = 0.1,
    ) -> Steer:
        """Return the vector to where the step ends, in steps."""
        x, y, status = visbug_packed(
            *self._loops, self._memory, self._begun, x_m, y_m, *goal_m, self._vision_m, step_m, self._near_m
        )
        self._begun = True
        return _new(Steer, ((x - x_m) / step_m, (y - y_m) / step_m, STATUSES[status]))

    def restart(self) -> None:
        """Begin a new search."""
        self._begun = False


class LoopWalk:
    """One robot's way by an algorithm that knows the walls and nothing else."""

    def __init__(self, navigator: Navigator, straight: Straight, step_m: float, near_m: float) -> None:
        """Walk as *navigator* steers; a robot within *near_m* may be what blocks this one."""
        self._navigator = navigator
        self._straight = straight
        self._step_m = step_m
        self._near_m = near_m

    def choose(
        self,
        observation: Observation,
        sightings: Mapping[Address, Point],
        place: Point,
        going: Point | None,
        now: Time,
    ) -> Point | None:
        """Return where to go in order to reach *place*; None if that is proved impossible.

        *going* is where the robot goes now.
        """
        here = observation.x_m, observation.y_m
        x, y = here if observation.blocked or going is None else self._ahead(here, going)
        steer = self._navigator.steer(x, y, place, (), (), self._step_m)
        if steer.status == UNREACHABLE:
            return None
        whole = steer.dx * steer.dx + steer.dy * steer.dy > WHOLE
        ahead = (AHEAD_STEPS if whole else 1.0) * self._step_m
        there = x + ahead * steer.dx, y + ahead * steer.dy
        if self._straight.rounding or (observation.blocked and self._held(here, sightings, steer.status)):
            return self._straight.towards(there, 0.0, observation, now)
        return there

    def _ahead(self, here: Point, going: Point) -> Point:
        """Return where the robot will be a tick from now."""
        dx, dy = going[0] - here[0], going[1] - here[1]
        distance = math.hypot(dx, dy)
        if distance <= self._step_m:
            return going
        return here[0] + self._step_m * dx / distance, here[1] + self._step_m * dy / distance

    def _held(self, here: Point, sightings: Mapping[Address, Point], status: Status) -> bool:
        """Return whether it is a body that blocks the robot, as far as it knows."""
        return status == STUCK or any(math.dist(here, peer) < self._near_m for peer in sightings.values())


def algorithm(parameters: Parameters, loops: Boundary | None, stream: np.random.Generator) -> Navigator:
    """Return the algorithm A; for objects, whose places no robot knows, it is random motion.

    *loops* are those of VisBug, in the robot's own frame.
    """
    draws = draws_of(stream)
    if parameters.goals == "object":
        wander = {"goal_gain": 0.0, "noise_gain": 1.0, "noise_persistence": RANDOM_PERSISTENCE}
        return PotentialField(parameters.potential_field.model_copy(update=wander), draws)
    match parameters.algorithm:
        case "potential_field":
            return PotentialField(parameters.potential_field, draws)
        case "avoid_past":
            return AvoidPast(parameters.avoid_past, draws)
        case "visbug":
            assert loops is not None  # prepare has made them
            return VisBug(loops, parameters.vision_m, VISBUG_NEAR_M)
        case "straight":
            return HeadStraight()


def draws_of(stream: np.random.Generator) -> Draws:
    """Return counter-based draws that depend on nothing but *stream*."""
    return Draws(int(stream.integers(1 << 62)), "reflection")


def way_back(parameters: Parameters, stream: np.random.Generator) -> Navigator:
    """Return the algorithm that brings a lost helper back to its way points: no local minimum holds Avoid Past."""
    return AvoidPast(parameters.avoid_past, draws_of(stream))
