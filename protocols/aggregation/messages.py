"""What the robots of a search team tell each other (paper 002, sections III to VI); ``frames`` puts it on the wire.

Of whom a message speaks is told by addresses, of what by the numbers of posts and targets, which mean the same to all.
Stamps are whole ms since the start, mod 2**32; the clocks of the team are taken to be set alike.

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
    """A host's way as it is told: see ``protocols.aggregation.course`` for what it means."""

    host: Address
    version: int
    departed_ms: int
    """When the host leaves the first point, ms since the start, mod 2**32."""
    speed_mps: float
    way_m: tuple[Point, ...]
    """1 to 255 points: the starting point, way points, the goal."""


class Heartbeat(NamedTuple):
    """A host tells all who hear it that it lives, and what is newest with it (both radios)."""

    number: int
    stamp_ms: int
    x_m: float
    y_m: float
    round: int
    """Which period of meeting it is."""
    plan: int
    """Version of the host's plan."""
    found: int
    """How many targets the host knows."""
    visited: int
    """How many posts of its map are visited."""
    over: bool
    """The task is done."""
    syncing: bool
    """MRP: the host stands, and waits until all its searchers have reported."""
    astray: bool
    """The host hears no other host, and heads for them."""
    silent: tuple[Address, ...]
    """Hosts that this one holds for failed or out of reach."""


class Plans(NamedTuple):
    """A host tells its searchers its way, and then those of its neighbours: 1 to 255 plans."""

    plans: tuple[Plan, ...]


class News(NamedTuple):
    """A host tells the others its map, its members and its way; or one that was rebooted what its own last were.

    Whose members and way they are says the plan.
    """

    targets: tuple[Finding, ...]
    visited: bytes
    """Bitmap of posts, see ``frames.bitmap``."""
    members: tuple[tuple[Address, int], ...]
    """(searcher, epoch of its membership)"""
    plan: Plan


class Hello(NamedTuple):
    """A searcher tells its host that it is here, and what it last heard of it."""

    epoch: int
    x_m: float
    y_m: float
    assignment: int
    plan: int


class Report(NamedTuple):
    """A searcher brings its host what it found and where it has been."""

    number: int
    epoch: int
    targets: tuple[Finding, ...]
    visited: bytes
    """Bitmap of posts, see ``frames.bitmap``."""


class Receipt(NamedTuple):
    """A host has the report of this number."""

    number: int


class Assign(NamedTuple):
    """A host gives a searcher the posts to visit, in this order."""

    epoch: int
    number: int
    posts: tuple[int, ...]


class Join(NamedTuple):
    """A searcher asks a host to take it in."""

    epoch: int
    x_m: float
    y_m: float


class Confirm(NamedTuple):
    """A host has taken the searcher in."""

    epoch: int


class Leave(NamedTuple):
    """A searcher leaves its host for another."""

    epoch: int


class Stop(NamedTuple):
    """The hosts know every target: stop searching."""


class Stopped(NamedTuple):
    """The searcher has stopped."""


Message: TypeAlias = (
    Heartbeat | Plans | News | Hello | Report | Receipt | Assign | Join | Confirm | Leave | Stop | Stopped
)
