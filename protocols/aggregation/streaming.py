"""What a searcher sends its host beside its messages: pieces of its map, pictures or video, of which only bytes count.

Paper 002 has the targets' information collected through the radio, and says nothing of its size; other searches send
much more. Pieces are not acknowledged and not sent again, and nothing rests on what is in them.
"""

from typing import Final

from cosim.machine import Address
from cosim.units import Time, to_seconds
from protocols.aggregation.messages import Piece
from protocols.aggregation.radio import Radio

PIECE: Final = Piece(bytes(1393))
"""A piece whose frame has 1400 bytes: with the headers of IP and UDP it fits the 1500 of an Ethernet."""
PIECE_BYTES: Final = 1400


class Stream:
    """An even flow of pieces from one searcher."""

    def __init__(self, bytes_per_s: float, tick: Time, radio: Radio) -> None:
        """Send *bytes_per_s*, frames of the protocol included, if asked to each *tick*."""
        self._bytes_per_tick = bytes_per_s * to_seconds(tick)
        self._radio = radio
        self._due_bytes = 0.0

    def flow(self, host: Address) -> None:
        """Send *host* what is due after one more tick in contact with it."""
        self._due_bytes += self._bytes_per_tick
        while self._due_bytes >= PIECE_BYTES:
            self._due_bytes -= PIECE_BYTES
            self._radio.send(PIECE, host)
