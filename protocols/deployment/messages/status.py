"""The status that a robot broadcasts periodically, in one short frame; only the latest one counts.

Besides where it is (:class:`protocols.deployment.tasks.orders.Whereabouts`) a robot reports which robot it takes for
the host, and how much of the plan it knows, so that robots which know less, or follow another host, find out.
"""

import math
from struct import Struct
from typing import Final, NamedTuple

from cosim.errors import WireError
from cosim.machine import Address
from protocols.deployment.tasks.orders import Whereabouts
from protocols.deployment.tasks.plan import Place

TOPIC: Final = 0
"""Topic of all statuses."""
TASK_BYTES: Final = 120  # the end of a name says more than its beginning
"""Greatest size of a task's name; of a longer one the end is sent."""
NONE: Final = 0xFFFFFFFF
"""Stands for the serial of a robot without an order."""
MOST_TERM: Final = 0x7FFF
"""Greatest number of a term that is believed: what a team has after nine hours with a new leader every second. A leader
that exceeds it has the next number, which is not believed, but encoded as it is, and does not begin again from 0."""
MOST_PLAN: Final = 0x3FFFFFFF
"""Greatest number of a plan that is believed. The next plan has a greater one, which has to be one of a plan, too."""
FAST_MPS: Final = 0.02
"""Speed up to which a robot counts as standing."""
_HEAD: Final = Struct(">BHIBIIBffffff")
MOST_BYTES: Final = _HEAD.size + TASK_BYTES
"""Size of the longest status."""
_IDLE: Final = 1
_BOUND: Final = 2
_OVER: Final = 4


class News(NamedTuple):
    """The status of one robot."""

    host: Address
    """Host that it follows."""
    term: int
    """Term of that host."""
    plan: int
    """Number of the plan that it knows; 0 if none."""
    calls: int
    """Number of the scenario's calls that have been dealt with, as far as it knows."""
    digest: int
    """Digest of the facts that it knows."""
    serial: int | None
    """Serial of the order that it has; None without one."""
    idle: bool
    """True if it has nothing to do."""
    x_m: float
    y_m: float
    heading_rad: float
    speed_mps: float
    goal_m: Place | None
    """Place to which it drives; None: nowhere."""
    task: str
    """Its present task; empty: none."""
    over: bool = False
    """True if the plan has been played to its end, as the sender knows as host, or from a host."""

    @property
    def moves(self) -> bool:
        """True if it drives."""
        return abs(self.speed_mps) > FAST_MPS

    def whereabouts(self, robot: Address) -> Whereabouts:
        """Return the part for an executive, if *robot* is the sender."""
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
    """Return a status as bytes."""
    serial = NONE if news.serial is None else min(news.serial, NONE - 1)
    flags = _IDLE * news.idle | _BOUND * (news.goal_m is not None) | _OVER * news.over
    goal_m = news.goal_m or (0.0, 0.0)
    pose = news.x_m, news.y_m, news.heading_rad, news.speed_mps
    known = news.term & 0xFFFF, news.plan & 0xFFFFFFFF, news.calls & 0xFF, news.digest & 0xFFFFFFFF
    return _HEAD.pack(news.host, *known, serial, flags, *pose, *goal_m) + news.task.encode()[-TASK_BYTES:]


def decode(data: bytes, size: int) -> News:
    """Return the status that *data* holds, in a team of *size*; raise WireError if it holds none."""
    if not _HEAD.size <= len(data) <= MOST_BYTES:
        raise WireError(f"{len(data)} bytes are no news")
    host, term, plan, calls, digest, serial, flags, *numbers = _HEAD.unpack_from(data)
    if host >= size or flags > _IDLE | _BOUND | _OVER or not all(map(math.isfinite, numbers)):
        raise WireError(f"news with host {host}, flags {flags}, numbers {numbers}")
    if term > MOST_TERM or plan > MOST_PLAN:
        raise WireError(f"news with term {term}, plan {plan}")
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
