"""What an operator asks of the host's console, as JSON, one object a message; and how an answer is written.

Requests: plays, call (and execute it, or not: to be tailored), execute, switch, terminate, map, route, picture, state.
"""

import json
from typing import Annotated, Any, Final, Literal, TypeAlias

from pydantic import Field, TypeAdapter, ValidationError

from cosim.errors import WireError
from cosim.settings import Count, Int64, Settings
from protocols.deployment.planning.planner import Call
from protocols.deployment.tasks.plan import Place, Strategy

MOST_BYTES: Final = 1 << 18
"""A longer message is none."""


class Request(Settings):
    """What all requests have."""

    request: Int64 = Field(description="a number that the answer repeats")


class Plays(Request):
    """Which plays there are."""

    say: Literal["plays"]


class Calling(Request):
    """A play is called: a plan is made of it, and executed if wanted."""

    say: Literal["call"]
    call: Call
    execute: bool = Field(default=False, description="whether the plan is executed at once, or waits to be tailored")


class Execute(Request):
    """A plan that was made is executed."""

    say: Literal["execute"]
    plan: Count = Field(ge=0)


class Switch(Request):
    """What is left of the play is done by another strategy."""

    say: Literal["switch"]
    strategy: Strategy


class Terminate(Request):
    """A task, and all below it, ends."""

    say: Literal["terminate"]
    task: str = Field(default="", description="its name; empty: the whole plan")


class Map(Request):
    """The floor: walls, extent, base, places with names, the team."""

    say: Literal["map"]


class Route(Request):
    """The way of a robot to a place."""

    say: Literal["route"]
    robot: Annotated[Count, Field(ge=0)]
    to: Place = Field(description="m")


class Show(Request):
    """What a robot's camera sees."""

    say: Literal["picture"]
    robot: Annotated[Count, Field(ge=0)]


class State(Request):
    """What is being played, and how all its tasks stand."""

    say: Literal["state"]


Asked: TypeAlias = Annotated[
    Plays | Calling | Execute | Switch | Terminate | Map | Route | Show | State, Field(discriminator="say")
]
_REQUESTS: Final[TypeAdapter[Asked]] = TypeAdapter(Asked)


def read(data: bytes) -> Asked:
    """Return the request that *data* is; raise WireError that says in one line what is wrong with it."""
    if len(data) > MOST_BYTES:
        raise WireError(f"{len(data)} bytes, more than {MOST_BYTES}")
    try:
        return _REQUESTS.validate_json(data)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False)[0]
        place = ".".join(str(part) for part in first["loc"])
        raise WireError(f"{place}: {first['msg']}" if place else first["msg"]) from error


def number_of(data: bytes) -> int | None:
    """Return the number of a request that is otherwise wrong; None if it has none."""
    try:
        found = json.loads(data)
    except (ValueError, RecursionError):
        return None
    number = found.get("request") if isinstance(found, dict) else None
    return number if isinstance(number, int) and not isinstance(number, bool) else None


def write(**what: Any) -> bytes:
    """Return a message to the operator."""
    return json.dumps(what, allow_nan=False, separators=(",", ":")).encode()
