"""Capture files in the pcapng format, as Wireshark and tshark read them (draft-ietf-opsawg-pcapng).

A file is one section: a section header, a description of every interface, then packets in the order of time. These
three kinds of block are written by hand: python-pcapng wants times as two halves, the resolution as raw bytes, has no
types, and takes ten times as long.
"""

import os
import struct
from collections.abc import Iterable, Sequence
from itertools import chain
from pathlib import Path
from typing import Final, NamedTuple

from cosim.units import Time

_SECTION: Final = 0x0A0D0D0A
_INTERFACE: Final = 1
_PACKET: Final = 6
_BYTE_ORDER: Final = 0x1A2B3C4D
_TO_THE_END: Final = -1

_OPT_COMMENT: Final = 1
_SHB_USERAPPL: Final = 4
_IF_NAME: Final = 2
_IF_DESCRIPTION: Final = 3
_IF_TSRESOL: Final = 9
_EPB_FLAGS: Final = 2

INBOUND: Final = 1
OUTBOUND: Final = 2
"""Flags of a packet: it was received, it was sent."""
UNICAST: Final = 1 << 2
BROADCAST: Final = 3 << 2
CRC_ERROR: Final = 1 << 24


class Interface(NamedTuple):
    """What packets are captured at."""

    link_type: int
    """Link type of its packets (LINKTYPE_ number)."""
    name: str
    description: str


class Packet(NamedTuple):
    """One captured packet."""

    time: Time
    """Simulated time, ns; readers take it for the time since 1970."""
    interface: int
    """Number of the interface, from 0."""
    flags: int
    data: bytes


def write_pcapng(
    path: Path,
    interfaces: Sequence[Interface],
    packets: Iterable[Packet],
    application: str = "cosim",
    comment: str = "",
) -> int:
    """Write *packets*, in the order of time, to *path* whole, as ``trace.write_parquet`` does; return their number.

    Raise OSError if the file cannot be written.
    """
    count = 0
    draft = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with draft.open("wb") as file:
            file.write(_section(application, comment))
            file.writelines(_described(interface) for interface in interfaces)
            for packet in packets:
                file.write(_packet(packet))
                count += 1
        draft.replace(path)
    except BaseException:
        draft.unlink(missing_ok=True)
        raise
    return count


def _block(kind: int, *parts: bytes) -> bytes:
    body = b"".join(parts)
    length = len(body) + 12
    return struct.pack("<II", kind, length) + body + struct.pack("<I", length)


def _padded(data: bytes) -> bytes:
    return data + bytes(-len(data) % 4)


def _options(*options: tuple[int, bytes]) -> bytes:
    """Return *options*, pairs of code and value, but those without a value; none at all are nothing."""
    packed = [struct.pack("<HH", code, len(value)) + _padded(value) for code, value in options if value]
    return b"".join(chain(packed, [bytes(4)])) if packed else b""


def _section(application: str, comment: str) -> bytes:
    options = _options((_OPT_COMMENT, comment.encode()), (_SHB_USERAPPL, application.encode()))
    return _block(_SECTION, struct.pack("<IHHq", _BYTE_ORDER, 1, 0, _TO_THE_END), options)


def _described(interface: Interface) -> bytes:
    options = _options(
        (_IF_NAME, interface.name.encode()),
        (_IF_DESCRIPTION, interface.description.encode()),
        (_IF_TSRESOL, b"\x09"),  # times in units of 10**-9 s
    )
    return _block(_INTERFACE, struct.pack("<HHI", interface.link_type, 0, 0), options)


def _packet(packet: Packet) -> bytes:
    time, interface, flags, data = packet
    fixed = struct.pack("<IIIII", interface, time >> 32, time & 0xFFFFFFFF, len(data), len(data))
    return _block(_PACKET, fixed, _padded(data), _options((_EPB_FLAGS, struct.pack("<I", flags))))
