"""Captures of Bluetooth runs: the table of frames as packets of LINKTYPE_BLUETOOTH_BREDR_BB, one interface a radio.

Captured is, at the radio of its receiver, every frame whose header was received, that is each row of the table whose
outcome is "received" or (a whole payload for which there was no room) "refused", or of which the payload alone was
lost; such a one is marked as having a bad CRC. A frame that its receiver did not hear is in no capture. Times,
channels, addresses, types and lengths are the run's; the bytes of payloads, which the table does not hold, are zeros.
FLOW is 1, ARQN and SEQN are 0: the table does not have them.
"""

from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from itertools import starmap
from operator import attrgetter
from struct import Struct
from typing import Any, Final, NamedTuple

from cosim.channels.bluetooth.bits.packet import TYPE_CODES, Fhs, Header, payload_bytes
from cosim.channels.bluetooth.hopping import GIAC
from cosim.channels.bluetooth.packets import ACL, PACKETS
from cosim.channels.bluetooth.radio import Heard, Identity, Part
from cosim.channels.bluetooth.scanning import RESPONSE_DELAY
from cosim.channels.clock import NativeClock
from cosim.export.pcapng import BROADCAST, CRC_ERROR, INBOUND, UNICAST, Interface, Packet
from cosim.machine import Address
from cosim.units import SLOT, Time

LINK_TYPE: Final = 255
"""LINKTYPE_BLUETOOTH_BREDR_BB."""

_PSEUDO_HEADER: Final = Struct("<BbbBBBhI3sBIH")
"""RF channel, signal and noise power, access code offenses, transport and rate, corrected bits of header and payload,
LAP, reference LAP and UAP, packet header, flags."""
_TRANSPORT: Final = 0x30
"""ACL transport at Basic Rate."""
_ANY_TRANSPORT: Final = 0x00
"""Packet type of an ID, which could be anything."""

# flags of the pseudo-header
_PLAIN: Final = 0x0009  # de-whitened, not encrypted
_LAP_VALID: Final = 0x0010
_PAYLOAD: Final = 0x0020
_UAP_VALID: Final = 0x0080
_HEC_PASSED: Final = 0x0300
_CRC_CHECKED: Final = 0x0400
_CRC_PASSED: Final = 0x0800

_WHOLE: Final = (Heard.RECEIVED, Heard.REFUSED)
"""Outcomes of frames of which no bit was wrong."""
INQUIRY: Final = -1
"""Value for the general inquiry access code, which belongs to no device."""
NO_LLID: Final = 0
"""The channel sends payloads as they are: they belong to no logical link, L2CAP or LMP."""
_PAGE_LIMIT: Final = 48 * SLOT
"""From an FHS to the POLL of the same page: pagerespTO and newconnectionTO are 8 and 32 slots."""


class Row(NamedTuple):
    """What a capture needs of a row of the table of frames."""

    time: Time
    source: Address
    destination: Address
    kind: str
    channel: int
    lt_addr: int
    length: int
    outcome: str
    part: str


def interface(device: Identity, name: str) -> Interface:
    """Return the interface *name* of *device*; the NAP of its address, which nothing here depends on, is 0."""
    return Interface(LINK_TYPE, name, f"BD_ADDR {device.hop_address.to_bytes(6, 'big').hex(':')}")


def packets(frames: Mapping[str, Sequence[Any]], devices: Sequence[Identity]) -> Iterator[Packet]:
    """Yield the packets that the receivers of *frames* (lists by column) between *devices* capture, in order of time.

    The interface of each is its receiver's address.
    """
    rows = sorted(_rows(frames), key=attrgetter("time"))
    for row, owner, called in zip(rows, access_codes(rows, devices), lt_addrs_given(rows), strict=True):
        if row.outcome in _WHOLE or row.part == Part.PAYLOAD:
            yield _packet(row, owner, called, devices)


# ---------------------------------------------------------------- packets


def _packet(row: Row, owner: Address, called: int, devices: Sequence[Identity]) -> Packet:
    """Return the packet of *row*, which begins with the access code of *owner*; an FHS says that it is *called* so."""
    word = GIAC if owner == INQUIRY else devices[owner].hop_address
    lap, uap = word & 0xFFFFFF, word >> 24
    passed = row.outcome in _WHOLE
    payload = b""
    if row.kind == "ID":
        header, transport, flags = 0, _ANY_TRANSPORT, _LAP_VALID
    else:
        header = _header(row.kind, row.lt_addr, uap)
        transport, flags = _TRANSPORT, _PLAIN | _LAP_VALID | _UAP_VALID | _HEC_PASSED
        if row.kind == "FHS":
            payload = payload_bytes(PACKETS["FHS"], uap, _contents(devices[row.source], row.time, called))
        elif row.kind not in ("POLL", "NULL"):
            payload = _zeros(row.kind, uap, row.length)
        if payload:
            flags |= _PAYLOAD | _CRC_CHECKED | (_CRC_PASSED if passed else 0)
    if not passed:
        payload = payload[:-2] + bytes(byte ^ 0xFF for byte in payload[-2:])
    pseudo = _PSEUDO_HEADER.pack(
        row.channel, 0, 0, 0, transport, 0, 0, lap, lap.to_bytes(3, "little"), uap, header, flags
    )
    cast = BROADCAST if row.kind in ACL and not row.lt_addr else UNICAST
    return Packet(row.time, row.destination, INBOUND | cast | (0 if passed else CRC_ERROR), pseudo + payload)


@cache
def _header(kind: str, lt_addr: int, uap: int) -> int:
    return Header(lt_addr, TYPE_CODES[kind]).checked(uap)


@cache
def _zeros(kind: str, uap: int, length: int) -> bytes:
    return payload_bytes(PACKETS[kind], uap, bytes(length), NO_LLID)


def _contents(device: Identity, time: Time, called: int) -> bytes:
    """Return the fields of an FHS that *device* sends at *time*."""
    clock = device.clock.tick(time) >> 2 & (1 << 26) - 1
    fhs = Fhs(device.hop_address & 0xFFFFFF, device.hop_address >> 24, 0, 0, called, clock)
    return fhs.to_bytes()


# ---------------------------------------------------------------- what the table does not tell


def _rows(frames: Mapping[str, Sequence[Any]]) -> Iterator[Row]:
    names = ("time_ns", "source", "destination", "kind", "channel", "lt_addr", "length", "outcome")
    parts = frames.get("part") or [Part.NONE] * len(frames["outcome"])
    return starmap(Row, zip(*(frames[name] for name in names), parts, strict=True))


def access_codes(rows: Sequence[Row], devices: Sequence[Identity]) -> list[Address]:
    """Return for each of *rows*, in the order of time, whose access code the frame begins with: a device, or INQUIRY.

    In a piconet it is the master's, on whose clock all frames begin; it sends every POLL and, where clocks do not tell,
    the first frame of a link. In a page it is the paged device's. A page's ID or FHS is known by its answer: all
    answers begin exactly 625 us after what they answer, and in a page an ID or FHS is answered by an ID, in an inquiry
    an ID by an FHS, or nothing. So the ID of a page that the paged device leaves unanswered, because it is gone by
    then, passes for one of an inquiry.
    """
    sent = {(row.kind, row.time, row.source, row.destination) for row in rows if row.kind in ("ID", "FHS")}
    masters: dict[frozenset[Address], Address] = {}
    return [_asked(row, sent) if row.kind in ("ID", "FHS") else _master(row, devices, masters) for row in rows]


def _master(row: Row, devices: Sequence[Identity], masters: dict[frozenset[Address], Address]) -> Address:
    """Return the master of the piconet of *row*; *masters* holds that of each link as the rows before have it."""
    ends = frozenset((row.source, row.destination))
    down = row.kind == "POLL" or _begins(row.time, devices[row.source].clock, 0)
    up = row.kind != "POLL" and _begins(row.time, devices[row.destination].clock, 2)
    if down != up:
        masters[ends] = row.source if down else row.destination
    return masters.setdefault(ends, row.source)


def _begins(time: Time, clock: NativeClock, phase: int) -> bool:
    """Return whether a tick of *clock* begins at *time* that is *phase* mod 4: 0 where masters send, 2 where slaves."""
    tick = clock.tick(time)
    return tick % 4 == phase and clock.time_of(tick) == time


def _asked(row: Row, sent: set[tuple[str, Time, Address, Address]]) -> Address:
    """Return whose access code an ID or FHS begins with: who is asked for, by what *sent* has before and after it."""
    source, destination = row.source, row.destination

    def answers(time: Time, source: Address, destination: Address) -> bool:
        return any((kind, time - RESPONSE_DELAY, destination, source) in sent for kind in ("ID", "FHS"))

    if row.kind == "ID":
        if answers(row.time, source, destination):
            return source
        return destination if ("ID", row.time + RESPONSE_DELAY, destination, source) in sent else INQUIRY
    asked = row.time - RESPONSE_DELAY
    inquiry = ("ID", asked, destination, source) in sent and not answers(asked, destination, source)
    return INQUIRY if inquiry else destination


def lt_addrs_given(rows: Sequence[Row]) -> list[int]:
    """Return for each of *rows*, in the order of time, the LT_ADDR that it, an FHS, gives: the next POLL has it.

    It is 0 where a page fails before its POLL, in an inquiry, and for all other types.
    """
    polls: dict[tuple[Address, Address], Row] = {}
    given = []
    for row in reversed(rows):
        ends = row.source, row.destination
        if row.kind == "POLL":
            polls[ends] = row
        poll = polls.get(ends) if row.kind == "FHS" else None
        given.append(poll.lt_addr if poll and poll.time - row.time < _PAGE_LIMIT else 0)
    return given[::-1]
