"""The messages between pages and server.

A message is one JSON object in one WebSocket text frame; its ``say`` is its kind. To the server:

    {"say": "play"}  {"say": "pause"}  {"say": "speed", "speed": 2.5}  {"say": "step", "by": "tick", "count": 1}
    {"say": "seek", "time_s": 12.0}  {"say": "reach", "robot": 0, "x_m": 1.0, "y_m": 2.0}
    {"say": "map", "robot": -1}  {"say": "scan", "robot": 0}
    {"say": "operator", "robot": 0, "data": {...}}  {"say": "again"}

To the page: ``scene`` (what does not change, and ``page``, a number that no other connection to the server has: all
pages are sent what robots answer, and find their own answers by it), ``now`` (where everything is, and what has
happened since the last one), ``operator`` (what a robot sends to its operator), ``ended`` (the metrics), ``missed``
(how many answers a slow page was not sent), ``reach`` (see :mod:`cosim.web.reach`), ``map`` (see
:mod:`cosim.web.beliefs`), ``scan`` (see :mod:`cosim.web.scans`), ``again`` (a new run has begun: the
page is to connect again) and ``error`` (with ``why``, and the ``data`` that therefore no robot receives, so that the
page does not wait for an answer).
"""

import json
import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal, TypeAlias

from pydantic import Field, JsonValue, TypeAdapter, ValidationError

from cosim.errors import UserError
from cosim.settings import Settings
from cosim.web.pacing import FASTEST, SLOWEST
from cosim.web.timeline import Question

LONGEST = 1 << 20
"""Maximum length of a message that a server reads, B."""

Plain: TypeAlias = dict[str, Any]
"""A message as plain data."""


class Play(Settings):
    """Let time go on."""

    say: Literal["play"]


class Pause(Settings):
    """Keep time where it is."""

    say: Literal["pause"]


class Step(Settings):
    """Pause, and go on by ticks of the world, slots of the radio, frames or events; back in a recorded run only."""

    say: Literal["step"]
    by: Literal["tick", "slot", "frame", "event"] = "tick"
    count: int = Field(default=1, ge=-1000, le=1000)


class Speed(Settings):
    """Let time pass faster or slower."""

    say: Literal["speed"]
    speed: float = Field(ge=SLOWEST, le=FASTEST)


class Seek(Settings):
    """Go to a time of a recorded run."""

    say: Literal["seek"]
    time_s: float = Field(ge=0, le=1e9)


class Operate(Settings):
    """Send something to the console of a robot, in a run that is under way."""

    say: Literal["operator"]
    robot: int = Field(ge=0, lt=1 << 31)
    data: dict[str, JsonValue]


class Again(Settings):
    """Begin a run anew that has ended."""

    say: Literal["again"]


class AskReach(Settings):
    """Ask how far a robot is heard from a place of the floor."""

    say: Literal["reach"]
    robot: int = Field(ge=0, lt=1 << 31)
    x_m: float = Field(ge=-1e6, le=1e6)
    y_m: float = Field(ge=-1e6, le=1e6)


class AskMap(Settings):
    """Ask what a robot knows of the floor; -1: what the team does."""

    say: Literal["map"]
    robot: int = Field(ge=-1, lt=1 << 31)


class AskScan(Settings):
    """Ask what the range scanner of a robot reads."""

    say: Literal["scan"]
    robot: int = Field(ge=0, lt=1 << 31)


Wish: TypeAlias = Play | Pause | Step | Speed | Seek | Operate | Again
"""What a page may ask for."""

AskPresent: TypeAlias = AskMap | AskScan
"""What a page may ask about the present of a run."""

Asked: TypeAlias = Wish | AskReach | AskPresent | Question
"""All that a page may send."""
_ASKED: TypeAdapter[Asked] = TypeAdapter(Annotated[Asked, Field(discriminator="say")])


def parsed(text: str | bytes) -> Asked:
    """Return what a page asks for in *text*; raise UserError, one line, if that is no message."""
    try:
        return _ASKED.validate_json(text)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False, include_input=False)[0]
        place = ".".join(str(part) for part in first["loc"])
        raise UserError(f"{place}: {first['msg']}" if place else first["msg"]) from None


def written(message: Mapping[str, Any]) -> str:
    """Return *message* as JSON, which has no NaN and no infinity: null stands for them."""
    try:
        return json.dumps(message, separators=(",", ":"), allow_nan=False)
    except ValueError:
        return json.dumps(finite(message), separators=(",", ":"), allow_nan=False)


def finite(plain: Any) -> Any:
    """Return *plain* data with None for numbers that are not finite."""
    if isinstance(plain, Mapping):
        return {key: finite(value) for key, value in plain.items()}
    if isinstance(plain, list | tuple):
        return [finite(value) for value in plain]
    return None if isinstance(plain, float) and not math.isfinite(plain) else plain


def error(why: str, wish: Wish | None = None) -> Plain:
    """Return the message that what a page has sent cannot be done; *wish*: what it asked for, if that was clear."""
    return {"say": "error", "why": why} | ({"data": wish.data} if isinstance(wish, Operate) else {})
