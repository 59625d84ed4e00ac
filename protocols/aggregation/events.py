"""The events of aggregation, as rows of the trace."""

from dataclasses import dataclass, field

from protocols.wire import BadBytes

_TARGET = {"meaning": "its number"}
_X_M = {"unit": "m", "meaning": "where it is"}
_Y_M = {"unit": "m", "meaning": "where it is"}
_TELLER = {"meaning": "the robot that has reported it"}
_TARGETS = {"meaning": "how many there are"}
_ERRAND = {"meaning": "its state from now on"}
_WHY = {"meaning": "the input or reason that caused it"}
_HOST = {"meaning": "which host"}
_EPOCH = {"meaning": "count of the searcher's memberships"}
_SEARCHER = {"meaning": "which searcher"}
_NUMBER = {"meaning": "of the assignment"}
_POSTS = {"meaning": "how many posts it holds"}
_VERSION = {"meaning": "of the host's plan"}
_LENGTH_M = {"unit": "m", "meaning": "length of the way"}
_ASTRAY = {"meaning": "whether it leads back to the other hosts"}
_ROUND = {"meaning": "which meeting, from 0"}
_MISSING = {"meaning": "searchers that have not come"}


@dataclass(frozen=True, slots=True)
class TargetFound:
    """A searcher's camera has recognised a target that the searcher did not know."""

    target: int = field(metadata=_TARGET)
    x_m: float = field(metadata=_X_M)
    y_m: float = field(metadata=_Y_M)


@dataclass(frozen=True, slots=True)
class TargetKnown:
    """A host has learned of a target from *teller*."""

    target: int = field(metadata=_TARGET)
    teller: int = field(metadata=_TELLER)


@dataclass(frozen=True, slots=True)
class AllKnown:
    """A host knows all targets: its sub-team is to stop."""

    targets: int = field(metadata=_TARGETS)


@dataclass(frozen=True, slots=True)
class ErrandChanged:
    """A searcher's state has changed: it searches, meets its host, waits, changes to another host, or stops."""

    errand: str = field(metadata=_ERRAND)
    why: str = field(metadata=_WHY)


@dataclass(frozen=True, slots=True)
class HostFailed:
    """A searcher suspects a host: close to where it should be, nothing has been received from it for a time."""

    host: int = field(metadata=_HOST)


@dataclass(frozen=True, slots=True)
class Joined:
    """A host has confirmed a searcher's request to join its sub-team."""

    host: int = field(metadata=_HOST)
    epoch: int = field(metadata=_EPOCH)


@dataclass(frozen=True, slots=True)
class MemberAdded:
    """A host has taken a searcher into its sub-team."""

    searcher: int = field(metadata=_SEARCHER)
    epoch: int = field(metadata=_EPOCH)


@dataclass(frozen=True, slots=True)
class MemberRemoved:
    """A host has removed a searcher: it left, is in another sub-team, or was silent for long."""

    searcher: int = field(metadata=_SEARCHER)
    why: str = field(metadata=_WHY)


@dataclass(frozen=True, slots=True)
class Assigned:
    """A host has given a searcher posts to visit."""

    searcher: int = field(metadata=_SEARCHER)
    number: int = field(metadata=_NUMBER)
    posts: int = field(metadata=_POSTS)


@dataclass(frozen=True, slots=True)
class HostSuspected:
    """A host suspects another."""

    host: int = field(metadata=_HOST)


@dataclass(frozen=True, slots=True)
class HostTrusted:
    """A host trusts another again that it has suspected, or that has been rebooted."""

    host: int = field(metadata=_HOST)


@dataclass(frozen=True, slots=True)
class Departed:
    """A host takes a new way of *length_m* metres and announces it; *astray* if it leads back to the other hosts."""

    version: int = field(metadata=_VERSION)
    length_m: float = field(metadata=_LENGTH_M)
    astray: bool = field(metadata=_ASTRAY)


@dataclass(frozen=True, slots=True)
class Reconvened:
    """A host's sub-team is complete at a reconvening point, or it has waited long enough."""

    round: int = field(metadata=_ROUND)
    missing: int = field(metadata=_MISSING)


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
