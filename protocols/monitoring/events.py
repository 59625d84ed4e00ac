"""The events of monitoring: suspicion, trust, and bytes that are no heartbeat."""

from dataclasses import dataclass, field

_PEER = {"meaning": "the robot that is watched"}


@dataclass(frozen=True, slots=True)
class Suspected:
    """A robot suspects another from now on."""

    peer: int = field(metadata=_PEER)


@dataclass(frozen=True, slots=True)
class Trusted:
    """A robot trusts another again: the suspicion was a mistake, or the other has been rebooted."""

    peer: int = field(metadata=_PEER)


@dataclass(frozen=True, slots=True)
class BadHeartbeat:
    """Bytes that are no heartbeat, or from a robot that is not to send any."""

    sender: int = field(metadata={"meaning": "the last hop"})
    length: int = field(metadata={"unit": "B", "meaning": "length of the payload"})
    reason: str = field(metadata={"meaning": "what is wrong"})


EVENTS = (Suspected, Trusted, BadHeartbeat)
