"""The events of aggregation, as rows of the trace."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class TargetFound:
    """A searcher's camera has recognised a target that its robot did not know of."""

    target: int
    x_m: float
    y_m: float


@dataclass(frozen=True, slots=True)
class TargetKnown:
    """A host has learnt of a target, from *teller*."""

    target: int
    teller: int


@dataclass(frozen=True, slots=True)
class AllKnown:
    """A host knows all targets: its sub-team is to stop."""

    targets: int


@dataclass(frozen=True, slots=True)
class ErrandChanged:
    """A searcher does something else: search, meet its host, wait with it, change to another, or no more."""

    errand: str
    why: str


@dataclass(frozen=True, slots=True)
class HostFailed:
    """A searcher takes a host for failed: close by, it has heard nothing of it for a time."""

    host: int


@dataclass(frozen=True, slots=True)
class Joined:
    """A host has confirmed a searcher's request to join its sub-team."""

    host: int
    epoch: int


@dataclass(frozen=True, slots=True)
class MemberAdded:
    """A host has taken a searcher into its sub-team."""

    searcher: int
    epoch: int


@dataclass(frozen=True, slots=True)
class MemberRemoved:
    """A host has struck a searcher off: it left, is in another sub-team, or was not heard for long."""

    searcher: int
    why: str


@dataclass(frozen=True, slots=True)
class Assigned:
    """A host has given a searcher posts to visit."""

    searcher: int
    number: int
    posts: int


@dataclass(frozen=True, slots=True)
class HostSuspected:
    """A host takes another for failed or lost."""

    host: int


@dataclass(frozen=True, slots=True)
class HostTrusted:
    """A host hears another again that it has suspected, or that counts its heartbeats anew."""

    host: int


@dataclass(frozen=True, slots=True)
class Departed:
    """A host goes a new way, of *length_m* metres, and tells it; *astray* if it leads back to the other hosts."""

    version: int
    length_m: float
    astray: bool


@dataclass(frozen=True, slots=True)
class Reconvened:
    """A host's sub-team is complete at a reconvening point, or it has waited long enough."""

    round: int
    missing: int


@dataclass(frozen=True, slots=True)
class BadBytes:
    """Bytes came in that are no message of this protocol, or none for this robot."""

    sender: int
    length: int


EVENTS = (
    TargetFound,
    TargetKnown,
    AllKnown,
    ErrandChanged,
    HostFailed,
    Joined,
    MemberAdded,
    MemberRemoved,
    Assigned,
    HostSuspected,
    HostTrusted,
    Departed,
    Reconvened,
    BadBytes,
)
