"""What the broadcast room tells the application room, in a single piconet and in a scatternet alike."""

from dataclasses import dataclass
from typing import Final, TypeAlias

from cosim.machine import Address
from protocols.pseudonet.messages import Message

EXCHANGES: Final = 256
"""Exchanges are numbered modulo this."""


@dataclass(frozen=True, slots=True)
class Exchanged:
    """An exchange is complete; *messages* holds one of each member, by source."""

    messages: dict[Address, Message]
    roll_call: bool
    """It was the first one of this team."""


@dataclass(frozen=True, slots=True)
class TeamChanged:
    """A roll call has begun: the first message of this team is wanted."""

    members: tuple[Address, ...]


@dataclass(frozen=True, slots=True)
class MessageWanted:
    """The master has begun an exchange for which this slave has not loaded a message yet."""


@dataclass(frozen=True, slots=True)
class Answered:
    """An answer to this robot alone has come in."""

    message: Message


@dataclass(frozen=True, slots=True)
class Garbage:
    """Bytes came in that are no packet."""

    reason: str


@dataclass(frozen=True, slots=True)
class Broken:
    """The team has fallen apart, or goes on without this robot; *dead* are those who are known to be gone."""

    dead: tuple[Address, ...] = ()


Upcall: TypeAlias = Exchanged | TeamChanged | MessageWanted | Answered | Garbage | Broken


def ahead_of(exchange: int, number: int) -> int:
    """Return by how much the exchange *number* is ahead of *exchange*, modulo ``EXCHANGES``."""
    return (number - exchange) % EXCHANGES
