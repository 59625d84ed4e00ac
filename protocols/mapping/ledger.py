"""The pieces of all robots' maps that one robot has.

A piece never changes, so two robots that have the same numbers have the same map, whoever told them: what one has
missed because it was out of reach, or because frames were lost, any other that has it can tell. Only changes of cells
are told: where hits are certain, nobody tells of a cell more than twice, however long a run is.
"""

from protocols.mapping.frames import Piece, Stream


class Ledger:
    """The pieces that are known, by stream and number."""

    def __init__(self) -> None:
        self._pieces: dict[Stream, dict[int, Piece]] = {}
        self.counts: dict[Stream, int] = {}
        """How many pieces of each stream are known from the first on without a gap."""

    def add(self, piece: Piece) -> bool:
        """Note a piece; return whether it was not known."""
        known = self._pieces.setdefault(piece.stream, {})
        if piece.number in known:
            return False
        known[piece.number] = piece
        count = self.counts.get(piece.stream, 0)
        while count in known:
            count += 1
        self.counts[piece.stream] = count
        return True

    def count(self, stream: Stream) -> int:
        """Return how many pieces of *stream* are known from the first on without a gap."""
        return self.counts.get(stream, 0)

    def beyond(self, stream: Stream, count: int) -> list[Piece]:
        """Return the pieces of *stream* that somebody with the first *count* of them lacks, in order."""
        return [self._pieces[stream][number] for number in range(count, self.count(stream))]
