"""Captures of 802.11 runs: the table of what was on the air as frames of LINKTYPE_IEEE802_11, one interface a radio.

Captured is every frame, at the radio that sends it: each is in the capture once, however many hear it, and also if
nobody does; only what is still on the air when the run ends is missing, here as in the table of frames. A frame whose
sender was switched off while it sent is marked as having a bad CRC. Frames are as IEEE 802.11-1999, clause 7, has them
in an ad hoc network (To DS and From DS are 0), without their check sequence, which readers expect in files of this type
only if they are told so.

Robots have no MAC addresses of their own. Robot r's radio n has the locally administered 02:00:00:nn:rr:rr, and the
network of radios n the BSSID 02:63:6f:73:69:nn. What a router has made is an IPv4 packet after LLC and SNAP headers
(RFC 1042); a payload that is not routed has the EtherType for local experiments (IEEE 802, local experimental EtherType
1). These headers are there whatever overhead the settings have.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import starmap
from operator import itemgetter
from struct import Struct
from typing import Any, Final, NamedTuple

from cosim.channels.adhoc.mac import ACK, CTS, DATA, KINDS, RTS
from cosim.export.pcapng import BROADCAST as FOR_ALL
from cosim.export.pcapng import CRC_ERROR, OUTBOUND, UNICAST, Interface, Packet
from cosim.machine import BROADCAST, Address
from cosim.trace import TRANSMISSIONS
from cosim.units import US, Time

LINK_TYPE: Final = 105
"""LINKTYPE_IEEE802_11."""
IPV4: Final = 0x0800
EXPERIMENTAL: Final = 0x88B5
"""EtherTypes."""

_TYPES: Final = {DATA: 0x08, RTS: 0xB4, CTS: 0xC4, ACK: 0xD4}
"""The first octet of frame control: version, type and subtype (7.1.3.1)."""
_RETRY: Final = 0x08
_LONGEST_US: Final = 32767
"""Largest value of a duration field (7.1.3.2)."""
_HEAD: Final = Struct("<BBH6s")
"""Frame control, duration, address 1: the beginning of every frame, and all of an ACK or a CTS."""
_DATA: Final = Struct("<6s6sH")
"""Addresses 2 and 3, sequence control."""
_SNAP: Final = Struct(">6sH")
_SNAP_START: Final = bytes.fromhex("aa aa 03 00 00 00")
"""LLC: both service access points are SNAP, unnumbered information. SNAP: the organisation of EtherTypes."""
_MAC: Final = Struct(">BHBH")


class Sent(NamedTuple):
    """A frame on the air: a row of the table TRANSMISSIONS."""

    time: Time
    source: Address
    kind: str
    destination: Address
    reserves: Time
    number: int
    retry: bool
    routed: bool
    whole: bool
    body: str
    duration: Time = 0
    channel: int = -1
    lt_addr: int = 0
    length: int = 0


def interface(robot: Address, radio: int, name: str) -> Interface:
    """Return the interface *name* of a robot's radio."""
    return Interface(LINK_TYPE, name, f"MAC address {mac_of(robot, radio).hex(':')}")


def packets(transmissions: Mapping[str, Sequence[Any]], radio: int = 0) -> Iterator[Packet]:
    """Yield the frames of the table *transmissions* (lists by column), all of radios of one number, in order of time.

    The interface of each is its sender's address; senders of one instant come in the order of these.
    """
    rows = starmap(Sent, zip(*(transmissions[field.name] for field in TRANSMISSIONS.fields), strict=True))
    for sent in sorted(rows, key=itemgetter(0, 1)):
        cast = FOR_ALL if sent.destination == BROADCAST else UNICAST
        flags = OUTBOUND | cast | (0 if sent.whole else CRC_ERROR)
        yield Packet(sent.time, sent.source, flags, frame_octets(sent, radio))


def frame_octets(sent: Sent, radio: int = 0) -> bytes:
    """Return the octets of a frame from frame control to the end of its body, without the check sequence (7.2).

    The time for which others are to be silent is rounded up to microseconds; only DATA frames say that they are sent
    again.
    """
    duration_us = min(-(-sent.reserves // US), _LONGEST_US)
    kind = KINDS.index(sent.kind)
    flags = _RETRY if sent.retry and kind == DATA else 0
    head = _HEAD.pack(_TYPES[kind], flags, duration_us, mac_of(sent.destination, radio))
    sender = mac_of(sent.source, radio)
    if kind == RTS:
        return head + sender
    if kind != DATA:
        return head
    rest = _DATA.pack(sender, bssid_of(radio), sent.number % 4096 << 4)  # one fragment, of number 0
    return head + rest + _SNAP.pack(_SNAP_START, IPV4 if sent.routed else EXPERIMENTAL) + bytes.fromhex(sent.body)


def mac_of(robot: Address, radio: int = 0) -> bytes:
    """Return the MAC address of a robot's radio, or that of all for BROADCAST."""
    return b"\xff" * 6 if robot == BROADCAST else _MAC.pack(0x02, 0, radio, robot)


def bssid_of(radio: int = 0) -> bytes:
    """Return the address of the network that radios of this number form."""
    return b"\x02cosi" + bytes((radio,))
