"""Upcalls of the broadcast layer to the application, in a single piconet and in a scatternet alike."""

from dataclasses import dataclass
from typing import Final, TypeAlias

from cosim.machine import Address
from protocols.pseudonet.messages import Message

EXCHANGES: Final = 256
"""Modulus of the numbers of exchanges."""


@dataclass(frozen=True, slots=True)
class Exchanged:
    """An exchange is complete; *messages* holds one of each member, by source."""

    messages: dict[Address, Message]
    roll_call: bool
    """True if it was the first exchange of this team."""


@dataclass(frozen=True, slots=True)
class TeamChanged:
    """A roll call has begun: the first message of this team is wanted."""

    members: tuple[Address, ...]


@dataclass(frozen=True, slots=True)
class MessageWanted:
    """The master has begun an exchange for which this slave has not loaded a message yet."""


@dataclass(frozen=True, slots=True)
class Answered:
    """An answer to this robot alone was received."""

    message: Message


@dataclass(frozen=True, slots=True)
class Garbage:
    """Bytes were received that are no packet."""

    reason: str


@dataclass(frozen=True, slots=True)
class Broken:
    """The team has broken up, or goes on without this robot; the robots *dead* are known to be gone."""

    dead: tuple[Address, ...] = ()


Upcall: TypeAlias = Exchanged | TeamChanged | MessageWanted | Answered | Garbage | Broken


def ahead_of(exchange: int, number: int) -> int:
    """Return by how much the exchange *number* is ahead of *exchange*, modulo ``EXCHANGES``."""
    return (number - exchange) % EXCHANGES
