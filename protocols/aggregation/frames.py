"""The messages of a search team on the wire: one kind of frame for each of ``protocols.aggregation.messages``.

Every frame is big-endian: magic, kind, sender, the body of its kind, and a CRC-16 (see ``protocols.wire``). A list is
preceded by its length. The paper (002) prints no formats.

Numbers on the wire are IEEE single floats: a coordinate of 128 to 256 m is rounded by at most 7.7 um, a speed by at
most 6e-8 of itself.
"""

import struct
from collections.abc import Callable, Iterable
from functools import lru_cache
from itertools import chain
from struct import Struct
from typing import Any, Final

from cosim.errors import LocalProtocolError, WireError
from cosim.geometry.planning import Point
from cosim.machine import Address
from cosim.units import MS, Time
from protocols.aggregation.messages import (
    Assign,
    Confirm,
    Finding,
    Heartbeat,
    Hello,
    Join,
    Leave,
    Message,
    Piece,
    Plan,
    Plans,
    Receipt,
    Report,
    Status,
    Stop,
    Stopped,
)
from protocols.wire import CRC_BYTES, check, seal

MAGIC: Final = 0x41
FAR_M: Final = 1e6
"""Upper bound of coordinates, in metres, and of speeds, in m/s, on the wire."""
CLOCK_MS: Final = 1 << 32
"""Modulus of stamps."""
COUNTS: Final = 1 << 16
"""Modulus of counts of 16 bits: versions of plans, assignments, reports, rounds, epochs of memberships."""
REMEMBERED: Final = 256
"""Number of frames, and of bitmaps, whose decoded values are cached."""

HEAD: Final = Struct(">BBB")
HEARTBEAT: Final = Struct(">BBBIIffHHBHBB")
OVER: Final = 1
SYNCING: Final = 2
ASTRAY: Final = 4
PLAN: Final = Struct(">BHIfB")
POINT: Final = Struct(">ff")
FINDING: Final = Struct(">Bff")
MEMBER: Final = Struct(">BH")
REPORT: Final = Struct(">BBBHHB")
ASSIGN: Final = Struct(">BBBHHH")
COUNT: Final = Struct(">H")

_new: Final = tuple.__new__  # what a named tuple's own constructor calls; a third faster


# ---------------------------------------------------------------- counts, stamps and bitmaps


def following(count: int) -> int:
    """Return the count after *count*: 1 after the last, as 0 stands for none yet."""
    return count % (COUNTS - 1) + 1


def stamp(at: Time) -> int:
    """Return the stamp of the instant *at* in whole ms, mod 2**32, rounded down."""
    return at // MS % CLOCK_MS


def instant(stamp_ms: int, now: Time) -> Time:
    """Return the instant nearest to *now* with the stamp *stamp_ms*; right within 24 days to either side."""
    now_ms = now // MS
    return (now_ms + (stamp_ms - now_ms + CLOCK_MS // 2) % CLOCK_MS - CLOCK_MS // 2) * MS


def bitmap(posts: Iterable[int], count: int) -> bytes:
    """Return *posts*, of 0 to *count* - 1, as bits: post k is bit k % 8, counted from the least, of byte k // 8."""
    data = bytearray(-(-count // 8))
    for post in posts:
        if not 0 <= post < count:
            raise LocalProtocolError(f"no post {post} among {count}")
        data[post >> 3] |= 1 << (post & 7)
    return bytes(data)


@lru_cache(maxsize=REMEMBERED)
def posts_in(data: bytes) -> frozenset[int]:
    """Return the posts in a :func:`bitmap`; one off the wire may have any length, so the numbers are not bounded."""
    return frozenset(8 * at + bit for at, byte in enumerate(data) if byte for bit in range(8) if byte >> bit & 1)


# ---------------------------------------------------------------- writing


def encode(sender: Address, message: Message) -> bytes:
    """Return the bytes of *message*; raise :exc:`LocalProtocolError` for a value or list that does not fit a frame."""
    kind = type(message)
    try:
        data = _WRITERS[kind](CODES[kind], sender, message)
    except (struct.error, ValueError) as error:
        raise LocalProtocolError(f"{kind.__name__} of {sender}: {error}") from error
    return seal(data)


def _near(x: float, y: float) -> bool:
    """Return True if both are coordinates that a frame can hold; False for NaN."""
    return -FAR_M <= x <= FAR_M and -FAR_M <= y <= FAR_M


def _written_heartbeat(code: int, sender: Address, beat: Heartbeat) -> bytes:
    number, stamp_ms, x, y, turn, plan, found, visited, over, syncing, astray, silent = beat
    if not _near(x, y):
        raise ValueError(f"nobody is at ({x}, {y})")
    flags = (OVER if over else 0) | (SYNCING if syncing else 0) | (ASTRAY if astray else 0)
    head = HEARTBEAT.pack(MAGIC, code, sender, number, stamp_ms, x, y, turn, plan, found, visited, flags, len(silent))
    return head + bytes(silent)


def _written_plan(plan: Plan) -> bytes:
    host, version, departed_ms, speed_mps, way_m = plan
    if not way_m or not 0.0 <= speed_mps <= FAR_M:
        raise ValueError(f"no way at {speed_mps} m/s over {len(way_m)} points")
    for x, y in way_m:
        if not _near(x, y):
            raise ValueError(f"nothing is at ({x}, {y})")
    points = _points(len(way_m)).pack(*chain.from_iterable(way_m))
    return PLAN.pack(host, version, departed_ms, speed_mps, len(way_m)) + points


def _written_targets(targets: tuple[Finding, ...]) -> bytes:
    for _, x, y in targets:
        if not _near(x, y):
            raise ValueError(f"no target is at ({x}, {y})")
    return b"".join(FINDING.pack(*target) for target in targets)


def _written_plans(code: int, sender: Address, message: Plans) -> bytes:
    if not message.plans:
        raise ValueError("no plan")
    return HEAD.pack(MAGIC, code, sender) + bytes((len(message.plans),)) + b"".join(map(_written_plan, message.plans))


def _written_status(code: int, sender: Address, status: Status) -> bytes:
    targets, visited, members, plan = status
    return b"".join(
        (
            HEAD.pack(MAGIC, code, sender),
            bytes((len(targets),)),
            _written_targets(targets),
            COUNT.pack(len(visited)),
            visited,
            bytes((len(members),)),
            *(MEMBER.pack(*member) for member in members),
            _written_plan(plan),
        )
    )


def _written_report(code: int, sender: Address, report: Report) -> bytes:
    number, epoch, targets, visited = report
    head = REPORT.pack(MAGIC, code, sender, number, epoch, len(targets))
    return b"".join((head, _written_targets(targets), COUNT.pack(len(visited)), visited))


def _written_assign(code: int, sender: Address, order: Assign) -> bytes:
    epoch, number, posts = order
    return ASSIGN.pack(MAGIC, code, sender, epoch, number, len(posts)) + _numbers(len(posts)).pack(*posts)


def _written_piece(code: int, sender: Address, piece: Piece) -> bytes:
    return HEAD.pack(MAGIC, code, sender) + COUNT.pack(len(piece.data)) + piece.data


@lru_cache(maxsize=REMEMBERED)
def _numbers(count: int) -> Struct:
    return Struct(f">{count}H")


@lru_cache(maxsize=REMEMBERED)
def _points(count: int) -> Struct:
    return Struct(f">{2 * count}f")


# ---------------------------------------------------------------- reading


@lru_cache(maxsize=REMEMBERED)
def decode(data: bytes) -> tuple[Address, Message]:
    """Return sender and message of *data*; raise :exc:`WireError` for anything that ``encode`` would not have made.

    The last frames are cached: a broadcast is decoded once for all receivers.
    """
    if len(data) < HEAD.size + CRC_BYTES or data[0] != MAGIC or not 0 < data[1] <= len(_READERS):
        raise WireError("not a frame of a search team")
    check(data)
    try:
        message, end = _READERS[data[1] - 1](data)
    except (struct.error, IndexError):
        raise WireError(f"{len(data)} bytes are too few") from None
    if end != len(data) - CRC_BYTES:  # a list that ran into the CRC or beyond ends here too
        raise WireError(f"{len(data)} bytes where {end + CRC_BYTES} were expected")
    return data[2], message


def _checked(x: float, y: float) -> None:
    if not _near(x, y):
        raise WireError("a number that no robot sends")


def _read_heartbeat(data: bytes) -> tuple[Heartbeat, int]:
    _, _, _, number, stamp_ms, x, y, turn, plan, found, visited, flags, count = HEARTBEAT.unpack_from(data)
    _checked(x, y)
    if flags > OVER | SYNCING | ASTRAY:
        raise WireError(f"flags {flags:#x}")
    end = HEARTBEAT.size + count
    states = flags & OVER != 0, flags & SYNCING != 0, flags & ASTRAY != 0
    silent = tuple(data[HEARTBEAT.size : end])
    return _new(Heartbeat, (number, stamp_ms, x, y, turn, plan, found, visited, *states, silent)), end


def _read_plan(data: bytes, at: int) -> tuple[Plan, int]:
    host, version, departed_ms, speed_mps, count = PLAN.unpack_from(data, at)
    at += PLAN.size
    end = at + POINT.size * count
    way_m: tuple[Point, ...] = tuple(POINT.iter_unpack(data[at:end]))
    if not way_m or not 0.0 <= speed_mps <= FAR_M:
        raise WireError("a way that no host goes")
    for x, y in way_m:
        _checked(x, y)
    return _new(Plan, (host, version, departed_ms, speed_mps, way_m)), end


def _read_targets(data: bytes, at: int, count: int) -> tuple[tuple[Finding, ...], int]:
    end = at + FINDING.size * count
    targets: tuple[Finding, ...] = tuple(_new(Finding, target) for target in FINDING.iter_unpack(data[at:end]))
    for _, x, y in targets:
        _checked(x, y)
    return targets, end


def _read_bytes(data: bytes, at: int) -> tuple[bytes, int]:
    at += COUNT.size
    end = at + int(COUNT.unpack_from(data, at - COUNT.size)[0])
    return data[at:end], end


def _read_plans(data: bytes) -> tuple[Plans, int]:
    at = HEAD.size + 1
    if not data[HEAD.size]:
        raise WireError("no plan")
    plans = []
    for _ in range(data[HEAD.size]):
        plan, at = _read_plan(data, at)
        plans.append(plan)
    return Plans(tuple(plans)), at


def _read_status(data: bytes) -> tuple[Status, int]:
    targets, at = _read_targets(data, HEAD.size + 1, data[HEAD.size])
    visited, at = _read_bytes(data, at)
    end = at + 1 + MEMBER.size * data[at]
    members: tuple[tuple[Address, int], ...] = tuple(MEMBER.iter_unpack(data[at + 1 : end]))
    plan, end = _read_plan(data, end)
    return Status(targets, visited, members, plan), end


def _read_report(data: bytes) -> tuple[Report, int]:
    _, _, _, number, epoch, count = REPORT.unpack_from(data)
    targets, at = _read_targets(data, REPORT.size, count)
    visited, end = _read_bytes(data, at)
    return Report(number, epoch, targets, visited), end


def _read_assign(data: bytes) -> tuple[Assign, int]:
    _, _, _, epoch, number, count = ASSIGN.unpack_from(data)
    posts = _numbers(count)
    return Assign(epoch, number, posts.unpack_from(data, ASSIGN.size)), ASSIGN.size + posts.size


def _read_piece(data: bytes) -> tuple[Piece, int]:
    content, end = _read_bytes(data, HEAD.size)
    return Piece(content), end


# ---------------------------------------------------------------- messages of fixed length


def _fixed(
    kind: type[Any], fields: str, place: int | None = None
) -> tuple[Callable[[int, Address, Any], bytes], Callable[[bytes], tuple[Any, int]]]:
    """Return writer and reader of a *kind* with these *fields* (``struct`` codes); x is at *place*, y after it."""
    layout = Struct(f">BBB{fields}")

    def write(code: int, sender: Address, message: Any) -> bytes:
        if place is not None and not _near(message[place], message[place + 1]):
            raise ValueError(f"nobody is at {message[place : place + 2]}")
        return layout.pack(MAGIC, code, sender, *message)

    def read(data: bytes) -> tuple[Any, int]:
        values = layout.unpack_from(data)[3:]
        if place is not None:
            _checked(values[place], values[place + 1])
        return _new(kind, values), layout.size

    return write, read


_CODECS: Final[dict[type[Any], tuple[Callable[[int, Address, Any], bytes], Callable[[bytes], tuple[Any, int]]]]] = {
    Heartbeat: (_written_heartbeat, _read_heartbeat),
    Plans: (_written_plans, _read_plans),
    Status: (_written_status, _read_status),
    Hello: _fixed(Hello, "HffHH", place=1),
    Report: (_written_report, _read_report),
    Receipt: _fixed(Receipt, "H"),
    Assign: (_written_assign, _read_assign),
    Join: _fixed(Join, "Hff", place=1),
    Confirm: _fixed(Confirm, "H"),
    Leave: _fixed(Leave, "H"),
    Stop: _fixed(Stop, ""),
    Stopped: _fixed(Stopped, ""),
    Piece: (_written_piece, _read_piece),
}
"""Writer and reader of each kind; the kind's byte on the wire is its position here, from 1."""
CODES: Final = {kind: code for code, kind in enumerate(_CODECS, 1)}
_WRITERS: Final = {kind: write for kind, (write, _) in _CODECS.items()}
_READERS: Final = tuple(read for _, read in _CODECS.values())
