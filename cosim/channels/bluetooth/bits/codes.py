"""The codes of Basic Rate, bit by bit (Core v1.2, Vol 2 Part B, sections 6.3, 7.1 to 7.6).

Bits are lists of 0 and 1 in the order of transmission: of every field the least significant bit comes first. In the
polynomials of the access code, of HEC and CRC the first bit on the air has the lowest index as well; registers are
therefore written mirrored, with the bit that leaves next at position 0. Only the (15, 10) code sends its highest power
first.
"""

from collections.abc import Iterable, Sequence
from functools import cache
from typing import Final, NamedTuple, TypeAlias

Bits: TypeAlias = list[int]

_ACCESS_GENERATOR: Final = 0o260534236651
"""g of the (64, 30) code, of degree 34, its highest power on the left."""
_PSEUDO_NOISE: Final = 0x83848D96BBCC54FC
"""The overlay p, p63 on the left."""
_BARKER: Final = ((0, 0, 1, 1, 0, 1), (1, 1, 0, 0, 1, 0))
"""Bits that complete a LAP to 30, by its last bit."""
_HEC_TAPS: Final = 0xE5
"""D^8 + D^7 + D^5 + D^2 + D + 1, mirrored, without its highest power."""
_CRC_TAPS: Final = 0x8408
"""D^16 + D^12 + D^5 + 1, mirrored, without its highest power."""
_FEC_GENERATOR: Final = 0b110101
"""(D + 1)(D^4 + D + 1), its highest power on the left."""


# ---------------------------------------------------------------- bits and bytes


def to_bits(value: int, width: int) -> Bits:
    """Return the *width* low bits of *value*, the least significant first."""
    return [value >> i & 1 for i in range(width)]


def from_bits(bits: Iterable[int]) -> int:
    """Return the number that *bits* make, the least significant first."""
    return sum(bit << i for i, bit in enumerate(bits))


def bytes_to_bits(data: bytes) -> Bits:
    """Return the bits of *data*, the first byte's least significant one first."""
    return to_bits(int.from_bytes(data, "little"), 8 * len(data))


def bits_to_bytes(bits: Sequence[int]) -> bytes:
    """Return the bytes of *bits*, whose number 8 divides (ValueError otherwise)."""
    if len(bits) % 8:
        raise ValueError(f"{len(bits)} bits are no whole bytes")
    return from_bits(bits).to_bytes(len(bits) // 8, "little")


# ---------------------------------------------------------------- access code


@cache
def access_code(lap: int) -> tuple[int, ...]:
    """Return the 72 bits of the access code of *lap*, 24 bits: preamble, sync word, trailer (section 6.3).

    An ID packet ends before the trailer: the first 68 bits.
    """
    sync = sync_word(lap)
    preamble = (0, 1, 0, 1) if sync[0] == 0 else (1, 0, 1, 0)
    trailer = (1, 0, 1, 0) if sync[-1] == 0 else (0, 1, 0, 1)
    return (*preamble, *sync, *trailer)


def sync_word(lap: int) -> Bits:
    """Return the 64 bits of the sync word of *lap*: 34 of parity, the LAP, 6 of a Barker sequence (section 6.3.3.1)."""
    if not 0 <= lap < 1 << 24:
        raise ValueError(f"{lap:#x} is no LAP of 24 bits")
    noise = to_bits(_PSEUDO_NOISE, 64)
    information = [*to_bits(lap, 24), *_BARKER[lap >> 23]]
    scrambled = from_bits(information) ^ from_bits(noise[34:])
    remainder = scrambled << 34
    for power in range(63, 33, -1):
        if remainder >> power & 1:
            remainder ^= _ACCESS_GENERATOR << (power - 34)
    parity = remainder ^ from_bits(noise[:34])
    return to_bits(parity, 34) + information


# ---------------------------------------------------------------- HEC and CRC


def hec(uap: int, word: int) -> int:
    """Return the 8 bits that check *word*, the 10 information bits of a packet header (section 7.1.1)."""
    return _divide(to_bits(word, 10), _mirrored(uap), _HEC_TAPS)


def crc16(uap: int, data: bytes) -> int:
    """Return the 16 bits that check *data*, payload header and body; they are sent little-endian (section 7.1.2)."""
    return _divide(bytes_to_bits(data), _mirrored(uap) << 8, _CRC_TAPS)


def _mirrored(uap: int) -> int:
    if not 0 <= uap < 1 << 8:
        raise ValueError(f"{uap:#x} is no UAP of 8 bits")
    return from_bits(to_bits(uap, 8)[::-1])


def _divide(bits: Iterable[int], register: int, taps: int) -> int:
    for bit in bits:
        carry = (register ^ bit) & 1
        register = register >> 1 ^ (taps if carry else 0)
    return register


# ---------------------------------------------------------------- forward error correction


class Corrected(NamedTuple):
    """The result of a decoder."""

    bits: Bits
    corrected: int
    """Number of wrong bits that were corrected."""
    beyond: int = 0
    """Number of blocks with more errors than the code corrects; their bits are as received."""


def repeat(bits: Iterable[int]) -> Bits:
    """Return every bit three times: rate 1/3 (section 7.4)."""
    return [bit for bit in bits for _ in range(3)]


def vote(bits: Sequence[int]) -> Corrected:
    """Return the majority of three copies of each bit; *bits* has the copies one after the other."""
    sums = [bits[i] + bits[i + 1] + bits[i + 2] for i in range(0, len(bits), 3)]
    return Corrected([int(total >= 2) for total in sums], sum(total in (1, 2) for total in sums))


@cache
def _parity(block: int) -> int:
    """Return the 5 parity bits of 10 bits; the first bit on the air is the highest power here."""
    remainder = block << 5
    for power in range(14, 4, -1):
        if remainder >> power & 1:
            remainder ^= _FEC_GENERATOR << (power - 5)
    return remainder


@cache
def _wrong_bit() -> dict[int, int]:
    """Return which of the 15 bits on the air is wrong, by the syndrome that it leaves; 0 for none has no entry."""
    return {_parity(1 << (14 - i) >> 5) ^ (1 << (14 - i) & 31): i for i in range(15)}


def protect(bits: Sequence[int]) -> Bits:
    """Return *bits*, filled up with zeros to tens, in blocks of 15: rate 2/3 (section 7.5)."""
    coded: Bits = []
    padded = [*bits, *[0] * (-len(bits) % 10)]
    for start in range(0, len(padded), 10):
        block = padded[start : start + 10]
        coded += block + to_bits(_parity(from_bits(block[::-1])), 5)[::-1]
    return coded


def correct(coded: Sequence[int]) -> Corrected:
    """Return the data of blocks of 15 bits: one wrong bit a block is corrected, two are noticed (section 7.5).

    Raise ValueError if 15 does not divide the number of bits.
    """
    if len(coded) % 15:
        raise ValueError(f"{len(coded)} bits are no whole blocks of 15")
    data: Bits = []
    corrected = beyond = 0
    for start in range(0, len(coded), 15):
        block = list(coded[start : start + 15])
        syndrome = _parity(from_bits(block[9::-1])) ^ from_bits(block[:9:-1])
        wrong = _wrong_bit().get(syndrome)
        if wrong is not None:
            block[wrong] ^= 1
            corrected += 1
        elif syndrome:
            beyond += 1
        data += block[:10]
    return Corrected(data, corrected, beyond)


# ---------------------------------------------------------------- whitening


def clock_seed(clock: int) -> int:
    """Return the start of the whitening register in a connection: CLK6-1 and a one above (section 7.2)."""
    return 0x40 | clock >> 1 & 0x3F


def response_seed(x: int) -> int:
    """Return the start for the FHS of an inquiry or page response: the hop kernel's X and two ones above."""
    return 0x60 | x & 0x1F


def whitening(seed: int, length: int) -> Bits:
    """Return *length* bits of the whitening sequence from the 7-bit register *seed* (D^7 + D^4 + 1, section 7.2)."""
    if not 0 < seed < 1 << 7:
        raise ValueError(f"{seed:#x} is no register of 7 bits that runs")
    sequence: Bits = []
    for _ in range(length):
        out = seed >> 6
        sequence.append(out)
        seed = (seed << 1 & 0x7F) ^ (0x11 if out else 0)
    return sequence
