"""Messages between robots, which the transport delivers reliably, as JSON of the models here.

Plans are nets of pydantic models with a schema already, and a message takes little time beside a drive: so JSON.
"""

from collections.abc import Iterable
from typing import Annotated, Final, Literal, TypeAlias

from pydantic import Field, TypeAdapter, ValidationError

from cosim.errors import WireError
from cosim.machine import Address
from cosim.settings import Angle, Count, Metres, Settings
from protocols.deployment.messages.status import MOST_PLAN, MOST_TERM
from protocols.deployment.tasks.facts import Ended, Fact, Heard, Record
from protocols.deployment.tasks.orders import Errand, Halt, Order, Retreat
from protocols.deployment.tasks.plan import Act, Go, Place, actors

MOST_BYTES: Final = 1 << 20
"""Greatest size of a message in bytes."""
COLUMNS: Final = 64
"""Greatest number of columns in a picture."""

Robot: TypeAlias = Count


class Facts(Settings):
    """What has happened to a plan, as far as the sender knows.

    A set of facts only grows, so two robots that have exchanged all their facts know the same.
    """

    say: Literal["facts"] = "facts"
    plan: Count = Field(ge=0, description="its number")
    facts: tuple[Fact, ...] = ()


class Told(Settings):
    """A plan that is executed, and what has happened to it: from the host, or for a robot that lacks it."""

    say: Literal["plan"] = "plan"
    host: Robot = Field(description="who leads, as far as the sender knows")
    record: Record
    calls: Count = Field(default=0, ge=0, description="how many of the scenario's calls have been dealt with")


class Ordered(Settings):
    """The host orders a robot to do something."""

    say: Literal["order"] = "order"
    term: Count = Field(ge=0, description="of the host: a new host takes the next one")
    order: Order


class YieldRequest(Settings):
    """A robot asks one that stands in its way to step aside."""

    say: Literal["aside"] = "aside"
    robot: Robot = Field(description="the robot that asks")
    from_m: Place = Field(description="m, where that robot is")
    way_m: tuple[Place, ...] = Field(max_length=64, description="m, the corners of its way from there")


class Look(Settings):
    """The host asks for a picture of what a robot sees."""

    say: Literal["look"] = "look"
    request: Count = Field(ge=0)


class Picture(Settings):
    """Ranges of walls and bodies in front of a robot, column by column from the left to the right."""

    say: Literal["picture"] = "picture"
    request: Count = Field(ge=0)
    robot: Robot
    at_m: Place
    heading_rad: Angle
    view_rad: Angle = Field(gt=0, description="rad, how wide the picture is")
    columns_m: tuple[Metres | None, ...] = Field(
        max_length=COLUMNS, description="m; None: beyond the sensor's range; no columns: there is no camera"
    )


Letter: TypeAlias = Annotated[Told | Facts | Ordered | YieldRequest | Look | Picture, Field(discriminator="say")]
_LETTERS: Final[TypeAdapter[Letter]] = TypeAdapter(Letter)


def encode(message: Letter) -> bytes:
    """Return a message as bytes; fields that are None are left out."""
    return message.model_dump_json(exclude_none=True).encode()


def decode(data: bytes, size: int) -> Letter:
    """Return the message that *data* holds, to a team of *size*; raise WireError if it holds none."""
    if len(data) > MOST_BYTES:
        raise WireError(f"{len(data)} bytes, more than {MOST_BYTES}")
    try:
        message = _LETTERS.validate_json(data)
    except ValidationError as error:
        raise WireError(f"{error.error_count()} faults in a letter") from error
    term, plan = _numbers(message)
    if term > MOST_TERM or plan > MOST_PLAN:
        raise WireError(f"a letter of term {term}, plan {plan}")
    # robots are used as indices from here on
    strangers = [robot for robot in _robots(message) if robot >= size]
    if strangers:
        raise WireError(f"robot {strangers[0]} is not of the team")
    return message


def _numbers(message: Letter) -> tuple[int, int]:
    """Return the numbers of the term and of the plan that a message is of; 0 if of none."""
    match message:
        case Told(record=record):
            return 0, record.plan.number
        case Facts(plan=plan):
            return 0, plan
        case Ordered(term=term, order=order):
            return term, order.plan
    return 0, 0


def _robots(message: Letter) -> list[Address]:
    """Return the robots that a message names."""
    match message:
        case Told(host=host, record=record):
            acts = [robot for task in record.plan.root.walk() for robot in _mentioned(task.act)]
            return [host, *record.plan.robots, *acts, *record.serials, *_named(record.facts)]
        case Facts(facts=facts):
            return _named(facts)
        case Ordered(order=order):
            return [order.robot, *_mentioned(order.errand)]
        case YieldRequest(robot=robot) | Picture(robot=robot):
            return [robot]
    return []


def _named(facts: Iterable[Fact]) -> list[Address]:
    return [fact.robot for fact in facts if isinstance(fact, Ended | Heard)]


def _mentioned(act: Act | Errand | None) -> tuple[Address, ...]:
    """Return the robots that *act* names: the one that does it, and the one that it refers to."""
    match act:
        case Go(robot=robot, behind=int(behind)):
            return robot, behind
        case Retreat(robot=robot, passing=passing):
            return robot, passing
        case Halt(robot=robot):
            return (robot,)
        case _:
            return actors(act)
