"""The pieces of all robots' maps that one robot has, and who lacks which of them.

A piece never changes, so two robots that have the same numbers have the same map, whoever told them: what one has missed
because it was out of reach, or because frames were lost, any other that has it can tell.
"""

from collections.abc import Sequence

from cosim.machine import Address
from protocols.exploration.frames import Piece


class Ledger:
    """The pieces that are known, by author."""

    def __init__(self, size: int) -> None:
        self._pieces: list[dict[int, Piece]] = [{} for _ in range(size)]
        self.counts: list[int] = [0] * size
        """How many pieces of each robot are known from the first on without a gap."""

    def add(self, piece: Piece) -> bool:
        """Note a piece; return whether it was not known."""
        known = self._pieces[piece.author]
        if piece.number in known:
            return False
        known[piece.number] = piece
        while self.counts[piece.author] in known:
            self.counts[piece.author] += 1
        return True

    def lacking(self, counts: Sequence[int], most: int) -> list[Piece]:
        """Return the pieces, *most* at most, that somebody with so many of each robot's lacks; the oldest first."""
        found: list[Piece] = []
        for author, (theirs, ours) in enumerate(zip(counts, self.counts, strict=True)):
            found += [self._pieces[author][number] for number in range(theirs, min(ours, theirs + most))]
        return sorted(found, key=lambda piece: piece.number)[:most]
