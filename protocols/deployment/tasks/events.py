"""The events of a deployment, as rows of the trace."""

from dataclasses import dataclass, field

from cosim.machine import Address, Unrecorded
from protocols.deployment.tasks.plan import Place
from protocols.wire import BadBytes

_X_M = {"unit": "m", "meaning": "where it is"}
_Y_M = {"unit": "m", "meaning": "where it is"}
_GOAL_X_M = {"unit": "m", "meaning": "where it is to go; where the robot is if nowhere"}
_GOAL_Y_M = {"unit": "m", "meaning": "where it is to go; where the robot is if nowhere"}
_PLAN = {"meaning": "number of the plan"}
_SERIAL = {"meaning": "number of the order, of all of that plan to that robot"}
_TASK = {"meaning": "name of the task"}
_WHY = {"meaning": "in words"}
_PLAY = {"meaning": "path of the play in its library"}
_ROBOT = {"meaning": "which robot"}
_ACT = {"meaning": "what kind of errand"}
_RESULT = {"meaning": "done, failed or terminated"}
_ROBOTS = {"meaning": "how many robots it makes use of"}
_HOST = {"meaning": "who is host now"}


@dataclass(frozen=True, slots=True)
class PlanTaken:
    """A robot knows a plan that is to be executed."""

    plan: int = field(metadata=_PLAN)
    play: str = field(metadata=_PLAY)
    robots: int = field(metadata=_ROBOTS)


@dataclass(frozen=True, slots=True)
class PlanRefused:
    """A play that was called cannot be played."""

    play: str = field(metadata=_PLAY)
    why: str = field(metadata={"meaning": "the constraints in conflict"})
    mend: str = field(metadata={"meaning": "what would mend it"})

    def __str__(self) -> str:
        told = f"{self.play} is refused: {self.why.removeprefix(self.play + ': ')}"
        return f"{told}; what would mend it: {self.mend}" if self.mend else told


@dataclass(frozen=True, slots=True)
class PlanEnded:
    """The host's executive has ended a plan."""

    plan: int = field(metadata=_PLAN)
    result: str = field(metadata=_RESULT)


@dataclass(frozen=True, slots=True)
class Ordered:
    """The executive has ordered a robot to do something."""

    robot: int = field(metadata=_ROBOT)
    plan: int = field(metadata=_PLAN)
    serial: int = field(metadata=_SERIAL)
    task: str = field(metadata=_TASK)
    act: str = field(metadata=_ACT)


@dataclass(frozen=True, slots=True)
class TaskStarted:
    """A robot has begun to carry out an order."""

    plan: int = field(metadata=_PLAN)
    serial: int = field(metadata=_SERIAL)
    task: str = field(metadata=_TASK)
    act: str = field(metadata=_ACT)
    x_m: float = field(metadata=_X_M)
    y_m: float = field(metadata=_Y_M)
    goal_x_m: float = field(metadata=_GOAL_X_M)
    goal_y_m: float = field(metadata=_GOAL_Y_M)


@dataclass(frozen=True, slots=True)
class TaskEnded:
    """A robot has ended an order."""

    plan: int = field(metadata=_PLAN)
    serial: int = field(metadata=_SERIAL)
    task: str = field(metadata=_TASK)
    result: str = field(metadata=_RESULT)
    why: str = field(metadata=_WHY)
    x_m: float = field(metadata=_X_M)
    y_m: float = field(metadata=_Y_M)


@dataclass(frozen=True, slots=True)
class SteppedAside:
    """A robot makes room for another."""

    robot: int = field(metadata={"meaning": "which robot passes"})
    x_m: float = field(metadata=_X_M)
    y_m: float = field(metadata=_Y_M)


@dataclass(frozen=True, slots=True)
class PictureTaken:
    """A robot has taken a picture."""

    task: str = field(metadata=_TASK)
    x_m: float = field(metadata=_X_M)
    y_m: float = field(metadata=_Y_M)
    heading_rad: float = field(metadata={"unit": "rad", "meaning": "where the camera looks"})


@dataclass(frozen=True, slots=True)
class RobotLost:
    """The host takes a robot for lost: nothing was heard of it for long."""

    robot: int = field(metadata=_ROBOT)
    x_m: float = field(metadata={"unit": "m", "meaning": "where it was when it was heard last"})
    y_m: float = field(metadata={"unit": "m", "meaning": "where it was when it was heard last"})


@dataclass(frozen=True, slots=True)
class RobotFound:
    """The host has heard a robot again that it had taken for lost."""

    robot: int = field(metadata=_ROBOT)


@dataclass(frozen=True, slots=True)
class HostChanged:
    """A robot follows another host than before."""

    host: int = field(metadata=_HOST)
    why: str = field(metadata=_WHY)


@dataclass(frozen=True, slots=True)
class Breached:
    """A temporal constraint of a plan has not been kept, or cannot be any more."""

    plan: int = field(metadata=_PLAN)
    why: str = field(metadata={"meaning": "which constraint, in words"})


@dataclass(frozen=True, slots=True)
class PlanBegun(Unrecorded):
    """The leader begins to execute a plan."""

    number: int
    robots: tuple[Address, ...]
    """All robots that the plan uses."""
    places_m: tuple[Place, ...]
    """Places where robots are to be in the end."""


@dataclass(frozen=True, slots=True)
class Driving(Unrecorded):
    """A robot is at an order to drive (a ``Go``), at one tick."""

    task: str
    """Task of the order."""
    waits: bool
    """True if it waits for its turn, as the order says (a staggered start)."""
    under_way: bool
    """True if it drives, or would if it could."""
    speeds_mps: tuple[float, float] | None
    """Its speed, and that without the others (:mod:`protocols.deployment.driving.twin`), m/s; None if unknown."""


EVENTS = (
    *(PlanTaken, PlanRefused, PlanEnded, Ordered, TaskStarted, TaskEnded, SteppedAside, PictureTaken),
    *(RobotLost, RobotFound, HostChanged, Breached, BadBytes),
)
"""All recorded events, for the protocol's specification."""
