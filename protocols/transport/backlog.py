"""What the own radio holds of what it was given to send, as far as its host knows: so that nothing piles up in it.

What waits in the radio can be neither replaced by what is newer nor taken back; what waits here can.
"""

from typing import NamedTuple

from cosim.machine import Address
from cosim.units import Time


class Held(NamedTuple):
    """A frame in the radio."""

    neighbour: Address
    """To whom it goes over the next hop; ``BROADCAST`` for all."""
    since: Time
    part: tuple[Address, int] | None
    """If it is a part of a letter: for whom, and its number."""


class Radio:
    """The frames in it, by their tokens."""

    def __init__(self, room: int, patience: Time) -> None:
        """Have *room* for frames to each neighbour; after *patience* it has forgotten a frame."""
        self._room = room
        self._patience = patience
        self._tokens = 0
        self._held: dict[int, Held] = {}

    def free(self, neighbour: Address) -> bool:
        """Return whether there is room for a frame to *neighbour*."""
        return sum(held.neighbour == neighbour for held in self._held.values()) < self._room

    def enter(self, neighbour: Address, part: tuple[Address, int] | None, now: Time) -> int:
        """Note that a frame is given to it; return the token to be sent with it."""
        self._tokens += 1
        self._held[self._tokens] = Held(neighbour, now, part)
        return self._tokens

    def leave(self, token: int) -> Held | None:
        """Return the frame of which the radio has told the fate; None for what it has long forgotten."""
        return self._held.pop(token, None)

    def forget(self, now: Time) -> list[Held]:
        """Return the frames, once, whose fate was not told in time."""
        gone = [token for token, held in self._held.items() if now - held.since >= self._patience]
        return [self._held.pop(token) for token in gone]

    @property
    def deadline(self) -> Time | None:
        """When it has forgotten the oldest of its frames."""
        for held in self._held.values():  # in the order in which they were given
            return held.since + self._patience
        return None
