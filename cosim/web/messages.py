"""The messages between pages and server.

A message is one JSON object in one WebSocket text frame; its ``say`` is its kind. To the server:

    {"say": "play"}  {"say": "pause"}  {"say": "step", "ticks": 1}  {"say": "speed", "speed": 2.5}
    {"say": "seek", "time_s": 12.0}  {"say": "operator", "robot": 0, "data": {...}}

To the page: ``scene`` (what does not change, and ``page``, a number that no other connection to the server has: all
pages are sent what robots answer, and find their own answers by it), ``now`` (where everything is, and what has
happened since the last one), ``operator`` (what a robot sends to its operator), ``ended`` (the metrics), ``missed``
(how many answers a slow page was not sent) and ``error`` (with ``why``, and the ``data`` that therefore no robot
receives, so that the page does not wait for an answer).
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
    """Pause, and go on by a few ticks of the world; backwards in a recorded run only."""

    say: Literal["step"]
    ticks: int = Field(default=1, ge=-1000, le=1000)


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


Wish: TypeAlias = Play | Pause | Step | Speed | Seek | Operate
"""What a page may ask for."""

_ASKED: TypeAdapter[Wish | Question] = TypeAdapter(Annotated[Wish | Question, Field(discriminator="say")])


def parsed(text: str | bytes) -> Wish | Question:
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
