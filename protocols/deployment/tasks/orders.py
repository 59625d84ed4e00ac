"""Orders of an executive to robots, and their reports and statuses for it."""

from enum import StrEnum
from typing import Annotated, Literal, Self, TypeAlias

from pydantic import Field, model_validator

from cosim.settings import Angle, Count, Int64, Metres, Settings
from protocols.deployment.tasks.plan import Place, RobotAct


class Retreat(Settings):
    """A robot that is deployed already makes room for one that passes, then comes back (paper 004, section 5)."""

    act: Literal["retreat"] = "retreat"
    robot: Count = Field(ge=0)
    post_m: Place = Field(description="m, where it stands, and where it comes back to")
    passing: Count = Field(ge=0, description="the robot that passes")
    way_m: tuple[Place, ...] = Field(
        default=(), max_length=64, description="m, the corners of that robot's way to its goal; empty: to the post"
    )

    @model_validator(mode="after")
    def _for_another(self) -> Self:
        if self.passing == self.robot:
            raise ValueError(f"robot {self.robot} is to make room for itself")
        return self


class Halt(Settings):
    """A robot stops where it is, whatever it was doing."""

    act: Literal["halt"] = "halt"
    robot: Count = Field(ge=0)


Errand: TypeAlias = Annotated[RobotAct | Retreat | Halt, Field(discriminator="act")]


class Order(Settings):
    """One robot is to do something. A robot obeys the order of the highest *serial* of the highest *plan* only."""

    plan: Count = Field(ge=0)
    serial: Count = Field(ge=0, description="number of the order among those of a plan to one robot, from 0")
    task: str = Field(description="name of the task in the plan; the report repeats it")
    robot: Count = Field(ge=0)
    errand: Errand


class Result(StrEnum):
    """How an order or a task has ended."""

    DONE = "done"
    FAILED = "failed"
    TERMINATED = "terminated"
    """Ended by a command."""


class Report(Settings):
    """The end of an order's task, from a robot; or of any task, from the executive."""

    plan: Count = Field(ge=0)
    serial: Count = Field(ge=0)
    task: str
    robot: Count = Field(ge=0)
    result: Result
    why: str = ""
    at: Int64 = Field(description="ns, by the reporter's clock")


class Whereabouts(Settings):
    """The part of a robot's status broadcast that an executive uses; only the latest counts."""

    robot: Count = Field(ge=0)
    x_m: Metres
    y_m: Metres
    heading_rad: Angle
    plan: Count = Field(default=0, ge=0)
    task: str = Field(default="", description="its present task; empty: none")
    moving: bool = False
