"""Whole packets of Basic Rate as bits in the order of transmission, and back (Core v1.2, Vol 2 Part B, section 6).

A packet is an access code, a header of 18 bits sent three times each, and a payload; what its type lacks is left out.
Check bits are computed first, then header and payload are whitened in one sequence, then coded. The UAP that starts
HEC and CRC, and the LAP of the access code, are the master's in a piconet, the paged device's in a page, and GIAC with
UAP 0 in an inquiry.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

from cosim.channels.bluetooth.bits.codes import (
    Bits,
    access_code,
    bits_to_bytes,
    bytes_to_bits,
    correct,
    crc16,
    from_bits,
    hec,
    protect,
    repeat,
    sync_word,
    to_bits,
    vote,
    whitening,
)
from cosim.channels.bluetooth.packets import (
    ACCESS_CODE_BITS,
    FHS,
    HEADER_BITS,
    ID,
    ID_BITS,
    PACKETS,
    TOLERATED_BITS,
    PacketType,
)
from cosim.channels.bluetooth.radio import Part

TYPE_CODES: Final = {"NULL": 0, "POLL": 1, "FHS": 2, "DM1": 3, "DH1": 4, "DM3": 10, "DH3": 11, "DM5": 14, "DH5": 15}
"""TYPE of the packet header, by the type's name (section 6.5, table 6.2)."""
KINDS: Final = {code: PACKETS[name] for name, code in TYPE_CODES.items()}

_HEADER_END: Final = ACCESS_CODE_BITS + 3 * HEADER_BITS
FHS_BYTES: Final = 18
START_OF_MESSAGE: Final = 2
"""LLID of the first, or only, fragment of an L2CAP message."""


class Header(NamedTuple):
    """The fields of a packet header (section 6.4)."""

    lt_addr: int
    type: int
    flow: int = 1
    arqn: int = 0
    seqn: int = 0

    def word(self) -> int:
        """Return the 10 information bits as a number, LT_ADDR lowest."""
        return self.lt_addr & 7 | (self.type & 15) << 3 | self.flow << 7 | self.arqn << 8 | self.seqn << 9

    def checked(self, uap: int) -> int:
        """Return the 18 bits with the HEC above."""
        return self.word() | hec(uap, self.word()) << 10


def header_of(word: int) -> Header:
    """Return the fields of the 10 information bits *word*."""
    return Header(word & 7, word >> 3 & 15, word >> 7 & 1, word >> 8 & 1, word >> 9 & 1)


class Fhs(NamedTuple):
    """The contents of an FHS packet (section 6.5.1.4): a device's identity and clock."""

    lap: int
    uap: int
    nap: int
    device_class: int
    """24 bits."""
    lt_addr: int
    """Logical transport address given to the receiver; 0 in an inquiry."""
    clk_27_2: int
    """The sender's clock at the start of the packet, without its two low bits."""
    scan_repetition: int = 1
    """Page scan mode: 0 for R0, 1 for R1, 2 for R2."""

    def to_bytes(self) -> bytes:
        """Return the 18 bytes, without CRC; the 34 parity bits are those of the device's own access code."""
        bits = [
            *sync_word(self.lap)[:34],
            *to_bits(self.lap, 24),
            *to_bits(0, 2),  # undefined
            *to_bits(self.scan_repetition, 2),
            *to_bits(2, 2),  # SP, 10 since v1.2
            *to_bits(self.uap, 8),
            *to_bits(self.nap, 16),
            *to_bits(self.device_class, 24),
            *to_bits(self.lt_addr, 3),
            *to_bits(self.clk_27_2, 26),
            *to_bits(0, 3),  # mandatory page scan mode
        ]
        return bits_to_bytes(bits)


def fhs_of(data: bytes) -> Fhs:
    """Return the contents of an FHS packet of 18 bytes; the parity bits follow from the LAP and are not looked at."""
    if len(data) != FHS_BYTES:
        raise ValueError(f"an FHS packet has {FHS_BYTES} bytes, not {len(data)}")
    word = int.from_bytes(data, "little")

    def field(first: int, width: int) -> int:
        return word >> first & (1 << width) - 1

    return Fhs(
        lap=field(34, 24),
        uap=field(64, 8),
        nap=field(72, 16),
        device_class=field(88, 24),
        lt_addr=field(112, 3),
        clk_27_2=field(115, 26),
        scan_repetition=field(60, 2),
    )


class Decoded(NamedTuple):
    """One packet as a receiver decodes it."""

    kind: PacketType | None
    """ID if there is an access code only; None if the header failed or names a type that is not in ``KINDS``."""
    header: Header | None
    body: bytes
    """User data, or the 18 bytes of an FHS; empty if the payload failed."""
    llid: int
    failed: Part
    """The first part that failed."""
    corrected: int = 0
    """Number of wrong bits that the codes have corrected, in header and payload."""


def payload_bytes(kind: PacketType, uap: int, body: bytes, llid: int = START_OF_MESSAGE) -> bytes:
    """Return the payload of a packet before whitening and coding: its header, *body* and CRC; of FHS without header.

    Raise ValueError if *body* does not fit the type.
    """
    if kind is FHS:
        if len(body) != FHS_BYTES:
            raise ValueError(f"an FHS packet has {FHS_BYTES} bytes, not {len(body)}")
        data = body
    elif len(body) > kind.capacity:
        raise ValueError(f"{len(body)} bytes do not fit into {kind.name} ({kind.capacity} bytes)")
    elif not kind.header:
        return b""
    else:
        data = (llid | 1 << 2 | len(body) << 3).to_bytes(kind.header, "little") + body  # FLOW = 1: go
    return data + crc16(uap, data).to_bytes(2, "little")


def encode(
    kind: PacketType,
    lap: int,
    uap: int,
    header: Header | None = None,
    body: bytes = b"",
    seed: int | None = None,
    llid: int = START_OF_MESSAGE,
) -> Bits:
    """Return the bits of a packet of type *kind*; the type in *header* does not count, an ID has no header.

    *seed* starts the whitening (``codes.clock_seed``, ``codes.response_seed``); None leaves it out. *body* is user
    data or ``Fhs.to_bytes()``. Raise ValueError for what does not fit.
    """
    if kind is ID:
        return list(access_code(lap)[:ID_BITS])
    if header is None:
        raise ValueError(f"{kind.name} has a header")
    word = header._replace(type=TYPE_CODES[kind.name]).checked(uap)
    plain = to_bits(word, HEADER_BITS) + bytes_to_bits(payload_bytes(kind, uap, body, llid))
    white = _whitened(plain, seed)
    payload = white[HEADER_BITS:]
    return [*access_code(lap), *repeat(white[:HEADER_BITS]), *(protect(payload) if kind.coded else payload)]


def _whitened(bits: Sequence[int], seed: int | None) -> Bits:
    if seed is None:
        return list(bits)
    return [bit ^ noise for bit, noise in zip(bits, whitening(seed, len(bits)), strict=True)]


def decode(bits: Sequence[int], lap: int, uap: int, seed: int | None = None) -> Decoded:
    """Return the packet that a receiver waiting for *lap* decodes from *bits*, from its first bit to its last.

    The other arguments are those of :func:`encode`. Nothing is raised for bad bits: ``failed`` names the part.
    """
    wanted = access_code(lap)[: ACCESS_CODE_BITS if len(bits) > ID_BITS else ID_BITS]
    wrong = len(wanted) - sum(one == other for one, other in zip(wanted, bits, strict=False))
    if wrong > TOLERATED_BITS:
        return Decoded(None, None, b"", 0, Part.ACCESS_CODE)
    if len(bits) <= ID_BITS:
        return Decoded(ID, None, b"", 0, Part.NONE)
    if len(bits) < _HEADER_END:
        return Decoded(None, None, b"", 0, Part.HEADER)
    voted = vote(bits[ACCESS_CODE_BITS:_HEADER_END])
    word = from_bits(_whitened(voted.bits, seed))
    header = header_of(word & 0x3FF)
    if hec(uap, header.word()) != word >> 10:
        return Decoded(None, None, b"", 0, Part.HEADER, voted.corrected)
    kind = KINDS.get(header.type)
    failed = Decoded(kind, header, b"", 0, Part.PAYLOAD, voted.corrected)
    return failed if kind is None else _decode_payload(failed, kind, bits[_HEADER_END:], uap, seed)


def _decode_payload(failed: Decoded, kind: PacketType, coded: Sequence[int], uap: int, seed: int | None) -> Decoded:
    """Return *failed*, which knows the header, or the packet with its payload."""
    if not kind.header and kind is not FHS:
        return failed._replace(failed=Part.PAYLOAD if coded else Part.NONE)
    bits, corrected, beyond = list(coded), 0, 0
    if kind.coded:
        if len(coded) % 15:
            return failed
        bits, corrected, beyond = correct(coded)
    failed = failed._replace(corrected=failed.corrected + corrected)
    if beyond:
        return failed
    plain = _whitened([0] * HEADER_BITS + bits, seed)[HEADER_BITS:]
    data = bits_to_bytes(plain[: len(plain) // 8 * 8])
    length, llid = FHS_BYTES, 0
    if kind is not FHS:
        word = int.from_bytes(data[: kind.header], "little")
        length, llid = kind.header + (word >> 3 & (0x1F if kind.header == 1 else 0x1FF)), word & 3
    whole = kind is FHS or length - kind.header <= kind.capacity
    if not whole or len(data) < length + 2 or crc16(uap, data[: length + 2]):
        return failed
    return failed._replace(body=data[kind.header : length], llid=llid, failed=Part.NONE)
