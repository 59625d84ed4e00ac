"""The messages of a search team (paper 002, sections III to VI); ``frames`` encodes them.

Robots are named by their addresses, posts and targets by their numbers, which mean the same to all robots. Stamps are
whole ms since the start, mod 2**32; the clocks of the team are assumed to be synchronised.

Equal tuples may be messages of different kinds, and one without fields is false: tell them apart by ``match`` or
``isinstance`` only.
"""

from typing import NamedTuple, TypeAlias

from cosim.geometry.planning import Point
from cosim.machine import Address


class Finding(NamedTuple):
    """A target that was found."""

    number: int
    x_m: float
    y_m: float


class Plan(NamedTuple):
    """A host's way as it is announced: see ``protocols.aggregation.course`` for what it means."""

    host: Address
    version: int
    departed_ms: int
    """Instant at which the host leaves the first point, ms since the start, mod 2**32."""
    speed_mps: float
    way_m: tuple[Point, ...]
    """1 to 255 points: the starting point, way points, the goal."""


class Heartbeat(NamedTuple):
    """A host is alive; with its place and the versions of what it knows. Broadcast by both radios."""

    number: int
    stamp_ms: int
    x_m: float
    y_m: float
    round: int
    """Number of the present meeting period."""
    plan: int
    """Version of the host's plan."""
    found: int
    """Number of targets that the host knows."""
    visited: int
    """Number of visited posts on its map."""
    over: bool
    """True if the task is done."""
    syncing: bool
    """MRP: True while the host stands and waits until all its searchers have reported."""
    astray: bool
    """True while the host receives no other host and heads for them."""
    silent: tuple[Address, ...]
    """Hosts that this one suspects."""


class Plans(NamedTuple):
    """From a host to its searchers: its own plan, then those of its neighbours; 1 to 255 plans."""

    plans: tuple[Plan, ...]


class Status(NamedTuple):
    """A host's map, members and plan, broadcast to the other hosts; or sent to a rebooted host, its own last ones.

    The plan's host is the one whose members they are.
    """

    targets: tuple[Finding, ...]
    visited: bytes
    """Bitmap of posts, see ``frames.bitmap``."""
    members: tuple[tuple[Address, int], ...]
    """(searcher, epoch of its membership)"""
    plan: Plan


class Hello(NamedTuple):
    """From a searcher to its host: it is here, and what it received last from the host."""

    epoch: int
    x_m: float
    y_m: float
    assignment: int
    plan: int


class Report(NamedTuple):
    """From a searcher to its host: what it has found and where it has been."""

    number: int
    epoch: int
    targets: tuple[Finding, ...]
    visited: bytes
    """Bitmap of posts, see ``frames.bitmap``."""


class Receipt(NamedTuple):
    """From a host: the report of this number has been received."""

    number: int


class Assign(NamedTuple):
    """From a host to a searcher: the posts to visit, in this order."""

    epoch: int
    number: int
    posts: tuple[int, ...]


class Join(NamedTuple):
    """From a searcher to a host: a request to join its sub-team."""

    epoch: int
    x_m: float
    y_m: float


class Confirm(NamedTuple):
    """From a host: the searcher is a member now."""

    epoch: int


class Leave(NamedTuple):
    """From a searcher to a host that it has left, or from a host that does not have it as a member."""

    epoch: int


class Stop(NamedTuple):
    """From a host: all targets are known, stop searching."""


class Stopped(NamedTuple):
    """From a searcher: it has stopped."""


class Piece(NamedTuple):
    """From a searcher to its host: a piece of a map, a picture or a video; what is in it means nothing here."""

    data: bytes


Message: TypeAlias = (
    Heartbeat | Plans | Status | Hello | Report | Receipt | Assign | Join | Confirm | Leave | Stop | Stopped | Piece
)
