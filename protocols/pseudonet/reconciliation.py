"""Making the knowledge of a new team equal: digests first, then, where they differ, maps piece by piece.

A plan that every robot computes for itself is one plan only if all know the same. Within a team that is so, as all
robots see the same exchanges; but a team may be made of robots that were in different teams, or that have missed the
end of an exchange when a team broke up. So the messages with which a roll call is answered carry a digest. Where all
are equal the team begins. Otherwise further exchanges follow, in each of which every robot's message carries one piece
of its map; all take the union. Obstacles are forgotten then: they may have been robots that are now in the team.
"""

from collections.abc import Mapping
from enum import Enum, auto
from zlib import crc32

from cosim.machine import Address
from protocols.pseudonet.messages import Kind, Message
from protocols.pseudonet.setup import Setup, View


class Equality(Enum):
    """What the messages of an exchange show of the team's knowledge."""

    EQUAL = auto()
    ROLL_WANTED = auto()
    MAP_WANTED = auto()


class Reconciliation:
    """One robot's part in making the team's maps equal."""

    def __init__(self, setup: Setup, map_bytes: int) -> None:
        self.chunk = 0
        """Number of the next piece of the map."""
        self._cells = sorted(setup.cells)
        self._bytes = map_bytes
        self._chunks = max(1, -(-len(self._cells) // (8 * map_bytes)))

    def digest(self, view: View) -> int:
        """Return 32 bits that stand for all covered cells and obstacles of *view*."""
        covered = bytes(cell in view.covered for cell in self._cells)
        return crc32(repr(sorted(view.obstacles)).encode(), crc32(covered))

    def marks(self, view: View) -> bytes:
        """Return the next piece of the map, a bit for each cell that is covered, the last byte filled with zeros."""
        word, cells = 0, self._piece()
        for cell in cells:
            word = word << 1 | (cell in view.covered)
        size = -(-len(cells) // 8)
        return (word << 8 * size - len(cells)).to_bytes(size, "big")

    def take(self, view: View, messages: Mapping[Address, Message]) -> Equality:
        """Process the messages of an exchange in which all robots stood still; return what is to come next."""
        kinds = {message.kind for message in messages.values()}
        if kinds == {Kind.ROLL}:
            self.chunk = 0
            same = len({message.digest for message in messages.values()}) == 1
            return Equality.EQUAL if same else Equality.MAP_WANTED
        if kinds != {Kind.MAP} or any(message.chunk != self.chunk for message in messages.values()):
            return Equality.ROLL_WANTED
        cells = self._piece()
        for message in messages.values():
            word = int.from_bytes(message.marks, "big") >> max(0, 8 * len(message.marks) - len(cells))
            view.covered.update(cell for index, cell in enumerate(reversed(cells)) if word >> index & 1)
        self.chunk += 1
        if self.chunk < self._chunks:
            return Equality.MAP_WANTED
        self.chunk = 0
        view.obstacles = frozenset()
        return Equality.EQUAL

    def _piece(self) -> list[int]:
        size = 8 * self._bytes
        return self._cells[size * self.chunk : size * (self.chunk + 1)]
