"""The one message of goal reflection, which a robot broadcasts to all in reach (paper 000, sections 3.1, 3.2, 5).

Big-endian: a header, the bearings of the robots that the sender sees, its goal terms (rules 1 and 2), its promises
(rules 3 and 4), and a CRC-16 (see ``protocols.wire``). A team of M makes at most M - 1 bearings, M terms, M promises.

A goal's place is relative to the sender's position along the axes of the sender's frame, as in the paper, where the
frame is centred on the robot. Numbers on the wire are IEEE single floats: a length of 64 to 128 m is rounded by at most
3.8 um, an angle by at most 0.12 urad, which moves a point that is 10 m away by 1.2 um.

The paper's messages arrive in the instant in which they are sent. Ours do not, so a frame bears the time of its
observation, and a promise the time at which its goal was seen, both in ms since the start, mod 2**32. The clocks of the
team are assumed to be synchronous.
"""

from collections.abc import Iterable, Sequence
from functools import cache, lru_cache
from itertools import chain
from struct import Struct
from typing import Final, NamedTuple, TypeAlias

from cosim.errors import WireError
from cosim.machine import Address
from protocols.wire import CRC_BYTES, check, seal

Bearing: TypeAlias = tuple[Address, float]
"""(robot, direction in which the sender sees it, radians in the sender's frame)"""
GoalTerm: TypeAlias = tuple[Address, int, float, float]
"""(owner, Id, x, y): the goal's place relative to the sender, metres along the axes of the sender's frame"""
Pledge: TypeAlias = tuple[Address, int, float, int]
"""(owner, Id, D, seen): the way from the sender to the goal, metres, and when that was seen last, ms since the start"""

MAGIC: Final = 0x52
IN_TROUBLE: Final = 1
OBJECTS: Final = 2
FAR_M: Final = 1e6
"""Greatest distance on the wire."""
HEADER: Final = Struct(">BBIBBB")
BEARING: Final = Struct(">Bf")
TERM: Final = Struct(">BIff")
PLEDGE: Final = Struct(">BIfI")
CLOCK_MS: Final = 1 << 32
"""Modulus of stamps."""
REMEMBERED: Final = 256
"""Number of decoded frames that are remembered."""


class Frame(NamedTuple):
    """The content of a frame."""

    in_trouble: bool
    """The state bit Tr."""
    objects: bool
    """True if goals are objects, known by their owner and number: the places in the terms mean nothing."""
    stamp_ms: int
    """When the sender made the observation, ms since the start, mod 2**32."""
    bearings: Sequence[Bearing]
    terms: Sequence[GoalTerm]
    pledges: Sequence[Pledge]


_new: Final = tuple.__new__  # what a named tuple's own constructor calls; a third faster


@cache
def _layout(bearings: int, terms: int, pledges: int) -> Struct:
    return Struct(f">BBIBBB{'Bf' * bearings}{'BIff' * terms}{'BIfI' * pledges}")


def encode(frame: Frame) -> bytes:
    """Return the bytes of *frame*; numbers must fit (addresses below 256, lengths up to FAR_M)."""
    flags = (IN_TROUBLE if frame.in_trouble else 0) | (OBJECTS if frame.objects else 0)
    _, _, stamp_ms, bearings, terms, pledges = frame
    flat = chain.from_iterable(chain(bearings, terms, pledges))
    return pack(flags, stamp_ms, len(bearings), len(terms), len(pledges), flat)


def pack(flags: int, stamp_ms: int, bearings: int, terms: int, pledges: int, flat: Iterable[float]) -> bytes:
    """Return the bytes of a frame with so many bearings, terms and pledges, whose numbers are *flat*, in that order."""
    data = _layout(bearings, terms, pledges).pack(MAGIC, flags, stamp_ms, bearings, terms, pledges, *flat)
    return seal(data)


@lru_cache(maxsize=REMEMBERED)
def decode(data: bytes) -> Frame:
    """Return the frame that *data* holds; raise :exc:`WireError` for anything that ``encode`` would not have made."""
    # The last frames are remembered: a broadcast is decoded once for all its receivers.
    if len(data) < HEADER.size + CRC_BYTES or data[0] != MAGIC:
        raise WireError("not a frame of goal reflection")
    _, flags, stamp_ms, seen, known, pledged = HEADER.unpack_from(data)
    bearings_end = HEADER.size + BEARING.size * seen
    terms_end = bearings_end + TERM.size * known
    end = terms_end + PLEDGE.size * pledged
    if len(data) != end + CRC_BYTES:
        raise WireError(f"{len(data)} bytes where {end + CRC_BYTES} were expected")
    check(data)
    bearings: tuple[Bearing, ...] = tuple(BEARING.iter_unpack(data[HEADER.size : bearings_end]))
    terms: tuple[GoalTerm, ...] = tuple(TERM.iter_unpack(data[bearings_end:terms_end])) if known else ()
    pledges: tuple[Pledge, ...] = tuple(PLEDGE.iter_unpack(data[terms_end:end])) if pledged else ()
    if flags > IN_TROUBLE | OBJECTS or not _plausible(bearings, terms, pledges):
        raise WireError("a number that no robot sends")
    return _new(Frame, (flags & IN_TROUBLE != 0, flags & OBJECTS != 0, stamp_ms, bearings, terms, pledges))


def _plausible(bearings: Sequence[Bearing], terms: Sequence[GoalTerm], pledges: Sequence[Pledge]) -> bool:
    """Return whether ``encode`` takes all numbers; it takes no NaN."""
    for _, angle in bearings:
        if not -4.0 <= angle <= 4.0:
            return False
    for _, number, x, y in terms:
        if not (-FAR_M <= x <= FAR_M and -FAR_M <= y <= FAR_M and number):
            return False
    for _, number, length, _ in pledges:  # noqa: SIM110  # all() of an expression takes twice as long
        if not (0.0 <= length <= FAR_M and number):
            return False
    return True
