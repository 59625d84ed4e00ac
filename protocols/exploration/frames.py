"""What explorers say to each other on the wire: pieces of their maps, and how many pieces of whom they have.

Every frame is big-endian: magic, kind, sender, the body of its kind, and a CRC-16 (see ``protocols.wire``). The paper
(001) has one map in one memory, and prints no formats.
"""

from binascii import crc_hqx
from struct import Struct, error
from typing import Final, NamedTuple, TypeAlias

import numpy as np

from cosim.errors import LocalProtocolError, WireError
from cosim.machine import Address
from protocols.exploration.runs import Words
from protocols.wire import CRC_BYTES, check

MAGIC: Final = 0x45
FAR_M: Final = 1e6
"""No coordinate on the wire is greater than this."""
MOST_PIECES: Final = 0xFFFF
"""Pieces of one robot: at one a second more than 18 hours."""

_HEAD: Final = Struct(">BBB")
_PIECE: Final = Struct(">BH")
_SUMMARY: Final = Struct(">ffB")
_PIECE_KIND: Final = 1
_SUMMARY_KIND: Final = 2
PIECE_OVERHEAD: Final = _HEAD.size + _PIECE.size + CRC_BYTES
"""Bytes of a piece beyond its runs, which have four each."""


class Piece(NamedTuple):
    """Part of what *author* has seen for itself, its *number*-th; runs as in ``runs``, shape (n,)."""

    author: Address
    number: int
    runs: Words


class Summary(NamedTuple):
    """Where the sender is, and how many pieces of each robot, from the first on without a gap, it has."""

    x_m: float
    y_m: float
    pieces: tuple[int, ...]


Message: TypeAlias = Piece | Summary


def encode(sender: Address, message: Message) -> bytes:
    """Return the frame that says *message*; raise LocalProtocolError for what no frame can say."""
    try:
        match message:
            case Piece(author=author, number=number, runs=runs):
                body = _HEAD.pack(MAGIC, _PIECE_KIND, sender) + _PIECE.pack(author, number)
                body += runs.astype(">u4").tobytes()
            case Summary(x_m=x_m, y_m=y_m, pieces=pieces):
                body = _HEAD.pack(MAGIC, _SUMMARY_KIND, sender) + _SUMMARY.pack(x_m, y_m, len(pieces))
                body += np.array(pieces, ">u2").tobytes()
    except (error, OverflowError) as wrong:
        raise LocalProtocolError(f"{message} does not fit into a frame: {wrong}") from None
    return body + crc_hqx(body, 0xFFFF).to_bytes(CRC_BYTES, "big")


def decode(data: bytes) -> tuple[Address, Message]:
    """Return who has sent what; raise WireError for bytes that are no frame of ours."""
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
    if len(body) < _PIECE.size or (len(body) - _PIECE.size) % 4:
        raise WireError(f"a piece with a body of {len(body)} bytes")
    author, number = _PIECE.unpack_from(body)
    return Piece(author, number, np.frombuffer(body, ">u4", offset=_PIECE.size).astype(np.uint32))


def _summary(body: bytes) -> Summary:
    if len(body) < _SUMMARY.size:
        raise WireError(f"a summary with a body of {len(body)} bytes")
    x_m, y_m, robots = _SUMMARY.unpack_from(body)
    if len(body) != _SUMMARY.size + 2 * robots:
        raise WireError(f"a summary of {robots} robots with a body of {len(body)} bytes")
    if not (abs(x_m) <= FAR_M and abs(y_m) <= FAR_M):  # NaN as well
        raise WireError("a place that is nowhere")
    return Summary(x_m, y_m, tuple(np.frombuffer(body, ">u2", offset=_SUMMARY.size).tolist()))
