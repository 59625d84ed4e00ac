"""The frames by which robots merge their maps: pieces of maps, and summaries of the pieces that a robot has.

Every frame is big-endian: magic, kind, sender, the body of its kind, and a CRC-16 (see ``protocols.wire``). The paper
(001) has one map in one memory, and prints no formats.

Cells travel as runs: neighbours in a row that are in the same state. A run is a word of 32 bits: the first cell (22
bits, so that a map has at most 4,194,304 cells), whether the cells are occupied or empty (1 bit), and their number less
one (9 bits). Unknown cells are not sent.
"""

from collections.abc import Sequence
from struct import Struct, error
from typing import Final, NamedTuple, TypeAlias

import numpy as np

from cosim.arrays import Bools, Int32s, Words
from cosim.errors import LocalProtocolError, WireError
from cosim.geometry.grids import Cell
from cosim.machine import Address
from protocols.wire import CRC_BYTES, check, seal

MAGIC: Final = 0x45
FAR_M: Final = 1e6
"""Greatest coordinate on the wire."""
MOST_PIECES: Final = 0xFFFF
"""Number of pieces that a stream may have."""
STAMPS: Final = 1 << 32
"""Bound of stamps and incarnations: milliseconds of 49 days."""
MOST_CELLS: Final = 1 << 22
"""Cells of a map that runs can name."""
LONGEST: Final = 1 << 9
"""Cells of the longest run."""

_OCCUPIED: Final = 1 << 9
_HEAD: Final = Struct(">BBB")
_PIECE: Final = Struct(">BIHI")
_PLACE: Final = Struct(">ff")
_ENTRY: Final = Struct(">BIHB")
_PIECE_KIND: Final = 1
_SUMMARY_KIND: Final = 2
RUN_BYTES: Final = 4
ENTRY_BYTES: Final = _ENTRY.size
PIECE_OVERHEAD: Final = _HEAD.size + _PIECE.size + CRC_BYTES
"""Bytes of a piece beyond its runs."""
SUMMARY_OVERHEAD: Final = _HEAD.size + _PLACE.size + CRC_BYTES
"""Bytes of a summary beyond its entries."""
LEAST_OCTETS: Final = max(PIECE_OVERHEAD + RUN_BYTES, SUMMARY_OVERHEAD + ENTRY_BYTES)
"""Bytes of a frame that holds at least one run, or one entry."""


class Stream(NamedTuple):
    """All pieces that *author* sends from one boot to the next.

    A robot that boots again has lost its map, and does not know how many pieces it has sent: it counts from 0 again, in
    a new *incarnation*.
    """

    author: Address
    incarnation: int
    """When it began, in milliseconds of the author's clock, mod 2**32."""


class Piece(NamedTuple):
    """Part of what the author of *stream* has seen for itself, its *number*-th from 0; runs (n,) of :func:`to_runs`."""

    stream: Stream
    number: int
    stamp: int
    """Age of the piece: of two pieces about one cell, that with the greater stamp is newer."""
    runs: Words


class Entry(NamedTuple):
    """How many pieces of a stream, from the first on without a gap, the sender of a summary has."""

    stream: Stream
    pieces: int
    source: Address
    """The robot that it asks for more; itself if it asks no robot."""


class Summary(NamedTuple):
    """Where the sender is, and some of what it has; nothing follows about streams that it does not list."""

    x_m: float
    y_m: float
    entries: tuple[Entry, ...]


Message: TypeAlias = Piece | Summary


def encode(sender: Address, message: Message) -> bytes:
    """Return the frame of *message*; raise LocalProtocolError for what does not fit into a frame."""
    try:
        match message:
            case Piece(stream=stream, number=number, stamp=stamp, runs=runs):
                if number >= MOST_PIECES:
                    raise LocalProtocolError(f"no piece has the number {number}")
                body = _HEAD.pack(MAGIC, _PIECE_KIND, sender) + _PIECE.pack(*stream, number, stamp)
                body += runs.astype(">u4").tobytes()
            case Summary(x_m=x_m, y_m=y_m, entries=entries):
                if not (abs(x_m) <= FAR_M and abs(y_m) <= FAR_M):
                    raise LocalProtocolError(f"nobody is at ({x_m}, {y_m})")
                body = _HEAD.pack(MAGIC, _SUMMARY_KIND, sender) + _PLACE.pack(x_m, y_m)
                body += b"".join(_ENTRY.pack(*stream, count, source) for stream, count, source in entries)
    except error as wrong:
        raise LocalProtocolError(f"{message} does not fit into a frame: {wrong}") from None
    return seal(body)


def decode(data: bytes) -> tuple[Address, Message]:
    """Return the sender and the message; raise WireError for bytes that are no frame of ours."""
    check(data)
    if len(data) < _HEAD.size + CRC_BYTES:
        raise WireError("too short for a head")
    magic, kind, sender = _HEAD.unpack_from(data)
    body = data[_HEAD.size : -CRC_BYTES]
    if magic != MAGIC:
        raise WireError(f"magic {magic:#x}")
    if kind == _PIECE_KIND:
        return sender, _piece(body)
    if kind == _SUMMARY_KIND:
        return sender, _summary(body)
    raise WireError(f"kind {kind}")


def _piece(body: bytes) -> Piece:
    if len(body) < _PIECE.size or (len(body) - _PIECE.size) % RUN_BYTES:
        raise WireError(f"a piece with a body of {len(body)} bytes")
    author, incarnation, number, stamp = _PIECE.unpack_from(body)
    if number >= MOST_PIECES:
        raise WireError(f"a piece with the number {number}")
    runs = np.frombuffer(body, ">u4", offset=_PIECE.size).astype(np.uint32)
    return Piece(Stream(author, incarnation), number, stamp, runs)


def _summary(body: bytes) -> Summary:
    if len(body) < _PLACE.size or (len(body) - _PLACE.size) % ENTRY_BYTES:
        raise WireError(f"a summary with a body of {len(body)} bytes")
    x_m, y_m = _PLACE.unpack_from(body)
    if not (abs(x_m) <= FAR_M and abs(y_m) <= FAR_M):  # NaN as well
        raise WireError("a place that is nowhere")
    entries = _ENTRY.iter_unpack(body[_PLACE.size :])
    return Summary(x_m, y_m, tuple(Entry(Stream(author, since), count, by) for author, since, count, by in entries))


class Run(NamedTuple):
    """Neighbours in a row of a map that are in the same state."""

    first: int
    """The first cell."""
    cells: int
    occupied: bool


def decode_all(data: bytes) -> dict[str, object]:
    """Return the sender and the message, with the runs of a piece, for who looks at it; raise WireError for others."""
    sender, message = decode(data)
    if isinstance(message, Summary):
        return {"sender": sender, "summary": message}
    runs = [Run(word >> 10, (word & LONGEST - 1) + 1, bool(word & _OCCUPIED)) for word in message.runs.tolist()]
    return {"sender": sender, "piece": message._asdict() | {"runs": runs}}


# ---------------------------------------------------------------- runs


def to_runs(cells: Sequence[Cell] | Int32s, occupied: Sequence[bool] | Bools) -> Words:
    """Return the runs (n,) of *cells*, which come in any order and without doubles; some are *occupied*.

    A run may go on from the end of a row to the beginning of the next.
    """
    order = np.argsort(cells, kind="stable")
    sorted_cells = np.asarray(cells, np.int64)[order]
    states = np.asarray(occupied, np.bool_)[order]
    if not len(sorted_cells):
        return np.empty(0, np.uint32)
    broken = (np.diff(sorted_cells) != 1) | (np.diff(states.view(np.int8)) != 0)
    starts = np.concatenate(([0], np.flatnonzero(broken) + 1))
    lengths = np.diff(np.concatenate((starts, [len(sorted_cells)])))
    pieces = -(-lengths // LONGEST)
    nth = np.arange(pieces.sum()) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    firsts = np.repeat(sorted_cells[starts], pieces) + nth * LONGEST
    sizes = np.minimum(np.repeat(lengths, pieces) - nth * LONGEST, LONGEST)
    occupancy = np.where(np.repeat(states[starts], pieces), _OCCUPIED, 0)
    words: Words = (firsts << 10 | occupancy | sizes - 1).astype(np.uint32)
    return words


def from_runs(words: Words) -> tuple[Int32s, Bools]:
    """Return the cells (n,) that the runs name, and which of them are occupied (n,)."""
    wide = words.astype(np.int64)
    sizes = (wide & LONGEST - 1) + 1
    firsts = np.repeat(wide >> 10, sizes)
    nth = np.arange(sizes.sum()) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    return (firsts + nth).astype(np.int32), np.repeat(wide & _OCCUPIED != 0, sizes)


def fits(words: Words, cells: int) -> bool:
    """Return whether all runs lie on a map of so many *cells*."""
    wide = words.astype(np.int64)
    return bool(np.all((wide >> 10) + (wide & LONGEST - 1) < cells))
