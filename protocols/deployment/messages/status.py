"""What a robot says of itself to all every so often: news, of which only the latest counts, in one short frame.

Beside where it is (:class:`protocols.deployment.tasks.orders.Whereabouts`) it says whom it takes for the host, and what
it knows of the plan: so that those who know less, or follow another, find out.
"""

import math
from struct import Struct
from typing import Final, NamedTuple

from cosim.errors import WireError
from cosim.machine import Address
from protocols.deployment.tasks.orders import Whereabouts
from protocols.deployment.tasks.plan import Place

TOPIC: Final = 0
"""Of all news."""
TASK_BYTES: Final = 120
"""Of a longer name the end is told, which says more than the beginning."""
NONE: Final = 0xFFFFFFFF
"""In place of a serial: it has no order."""
FAST_MPS: Final = 0.02
"""Whoever is slower stands."""
_HEAD: Final = Struct(">BHIBIIBffffff")
MOST_BYTES: Final = _HEAD.size + TASK_BYTES
"""The longest news."""
_IDLE: Final = 1
_BOUND: Final = 2
_OVER: Final = 4


class News(NamedTuple):
    """One robot's news."""

    host: Address
    """Whom it follows."""
    term: int
    """That host's."""
    plan: int
    """Number of the plan that it knows; 0 if none."""
    calls: int
    """How many of the scenario's calls have been dealt with, as far as it knows."""
    digest: int
    """Of the facts that it knows."""
    serial: int | None
    """Of the order that it has; None without one."""
    idle: bool
    """Whether it has nothing to do."""
    x_m: float
    y_m: float
    heading_rad: float
    speed_mps: float
    goal_m: Place | None
    """Where it is going; None: nowhere."""
    task: str
    """What it is at; empty: nothing."""
    over: bool = False
    """Whether the plan has been played to its end, as its author says as host, or has heard that a host says."""

    @property
    def moves(self) -> bool:
        """Whether it drives."""
        return abs(self.speed_mps) > FAST_MPS

    def whereabouts(self, robot: Address) -> Whereabouts:
        """Return what they tell an executive, if *robot* is their author."""
        return Whereabouts(
            robot=robot,
            x_m=self.x_m,
            y_m=self.y_m,
            heading_rad=self.heading_rad,
            plan=self.plan,
            task=self.task,
            moving=self.moves,
        )


def encode(news: News) -> bytes:
    """Return *news* as bytes."""
    serial = NONE if news.serial is None else min(news.serial, NONE - 1)
    flags = _IDLE * news.idle | _BOUND * (news.goal_m is not None) | _OVER * news.over
    goal_m = news.goal_m or (0.0, 0.0)
    pose = news.x_m, news.y_m, news.heading_rad, news.speed_mps
    known = news.term & 0xFFFF, news.plan & 0xFFFFFFFF, news.calls & 0xFF, news.digest & 0xFFFFFFFF
    return _HEAD.pack(news.host, *known, serial, flags, *pose, *goal_m) + news.task.encode()[-TASK_BYTES:]


def decode(data: bytes, size: int) -> News:
    """Return the news that *data* are, in a team of *size*; raise WireError if they are none."""
    if not _HEAD.size <= len(data) <= MOST_BYTES:
        raise WireError(f"{len(data)} bytes are no news")
    host, term, plan, calls, digest, serial, flags, *numbers = _HEAD.unpack_from(data)
    if host >= size or flags > _IDLE | _BOUND | _OVER or not all(map(math.isfinite, numbers)):
        raise WireError(f"news with host {host}, flags {flags}, numbers {numbers}")
    x_m, y_m, heading_rad, speed_mps, goal_x_m, goal_y_m = numbers
    return News(
        host=host,
        term=term,
        plan=plan,
        calls=calls,
        digest=digest,
        serial=None if serial == NONE else serial,
        idle=bool(flags & _IDLE),
        x_m=x_m,
        y_m=y_m,
        heading_rad=heading_rad,
        speed_mps=speed_mps,
        goal_m=(goal_x_m, goal_y_m) if flags & _BOUND else None,
        task=data[_HEAD.size :].decode(errors="replace"),
        over=bool(flags & _OVER),
    )
