"""The CRC of a PDU: x^24 + x^10 + x^9 + x^6 + x^4 + x^3 + x + 1 (Core v5.0, Vol 6 Part B, section 3.1.1).

The register is mirrored here: what leaves it first, position 23, is the least significant bit, so that the CRC goes on
the air as octets do.
"""

from typing import Final

ADVERTISING_INIT: Final = 0x555555
"""CRCInit of all packets on the advertising channels but those of periodic trains."""

_TAPS: Final = 0xDA6000
"""The polynomial, mirrored, without its highest power."""


def _divided(register: int) -> int:
    for _ in range(8):
        register = register >> 1 ^ (_TAPS if register & 1 else 0)
    return register


_TABLE: Final = tuple(_divided(octet) for octet in range(256))
"""The register eight bits later, by its low octet."""


def crc24(pdu: bytes, init: int = ADVERTISING_INIT) -> bytes:
    """Return the three octets that check *pdu*, header and payload, as they are on the air; *init* is CRCInit.

    Over a PDU and its CRC they are 0. Raise ValueError if *init* has more than 24 bits.
    """
    if not 0 <= init < 1 << 24:
        raise ValueError(f"{init:#x} is no CRCInit of 24 bits")
    register = int(f"{init:024b}"[::-1], 2)
    for octet in pdu:
        register = register >> 8 ^ _TABLE[(register ^ octet) & 0xFF]
    return register.to_bytes(3, "little")
