"""Captures of Bluetooth Low Energy: the table of what was on the air as packets of LINKTYPE_BLUETOOTH_LE_LL_WITH_PHDR.

Captured is every packet, once, however many hear it, and also if nobody does, as by a sniffer beside each sender. All
are of one interface, as Wireshark follows a connection on one only. A packet whose sender was switched off while it
sent is marked as having a wrong CRC. Advertising that no device has looked at, and the polls of links at rest, are
arithmetic and not in the table: with ``idle_frames`` the polls are.

Before a packet is a header of ten octets (as tcpdump.org and Wireshark's btle_rf dissector have it): RF channel, signal
and noise, which the sender does not know, offences against the access address, the address that was expected, flags.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import starmap
from operator import itemgetter
from struct import Struct
from typing import Any, Final

from cosim.channels.ble.bits.access import ADVERTISING_ADDRESS
from cosim.channels.ble.phy import CODED_S2, CODED_S8, CRC_OCTETS, HEADER_OCTETS, LE_1M, LE_2M, PHYS, Phy
from cosim.export.ieee80211 import Sent
from cosim.export.pcapng import BROADCAST as FOR_ALL
from cosim.export.pcapng import CRC_ERROR, OUTBOUND, UNICAST, Interface, Packet
from cosim.machine import BROADCAST, Address
from cosim.trace import TRANSMISSIONS
from cosim.units import Time

LINK_TYPE: Final = 256
"""LINKTYPE_BLUETOOTH_LE_LL_WITH_PHDR."""

_HEADER: Final = Struct("<BbbBIH")
"""RF channel, signal, noise, offences, reference access address, flags."""
_ADDRESS: Final = Struct("<I")
_DEWHITENED, _REFERENCE, _OFFENCES, _CRC_CHECKED, _CRC_VALID = 0x1, 0x10, 0x20, 0x400, 0x800
_TYPE: Final = 7
_PHY: Final = 14
_AUXILIARY_KIND: Final = 12
"""Place of the lowest bit of a field of the flags."""
_AUXILIARY, _TO_PERIPHERAL, _TO_CENTRAL = 1, 2, 3
_AUXILIARIES: Final = {"AUX_ADV_IND": 0, "AUX_CHAIN_IND": 1}
_PHYS: Final = {LE_1M.name: 0, LE_2M.name: 1, CODED_S2.name: 2, CODED_S8.name: 2}
_CODINGS: Final = {CODED_S2.name: b"\x01", CODED_S8.name: b"\x00"}
"""The coding indicator, which follows the access address on LE Coded."""
_LL_DATA_AT: Final = 4 + HEADER_OCTETS + 12
"""Where in a CONNECT_IND the access address of its connection is."""


def interface(radio: int) -> Interface:
    """Return the interface of all radios of that number."""
    return Interface(LINK_TYPE, f"radio {radio}", "Bluetooth Low Energy, all robots")


def packets(transmissions: Mapping[str, Sequence[Any]]) -> Iterator[Packet]:
    """Yield the packets of the table *transmissions* (lists by column), all of radios of one number, in order of time.

    The interface of each is its sender's address; senders of one instant come in the order of these.
    """
    rows = starmap(Sent, zip(*(transmissions[field.name] for field in TRANSMISSIONS.fields), strict=True))
    centrals: dict[int, Address] = {}
    for sent in sorted(rows, key=itemgetter(0, 1)):
        body = bytes.fromhex(sent.body)
        if sent.kind == "CONNECT_IND":
            centrals[_ADDRESS.unpack_from(body, _LL_DATA_AT)[0]] = sent.source
        cast = FOR_ALL if sent.destination == BROADCAST else UNICAST
        flags = OUTBOUND | cast | (0 if sent.whole else CRC_ERROR)
        yield Packet(sent.time, sent.source, flags, _octets(sent, body, centrals))


def _octets(sent: Sent, body: bytes, centrals: Mapping[int, Address]) -> bytes:
    (address,) = _ADDRESS.unpack_from(body)
    phy = _phy_of(sent.duration, len(body) - 4 - HEADER_OCTETS - CRC_OCTETS)
    flags = _DEWHITENED | _REFERENCE | _OFFENCES | _CRC_CHECKED | _PHYS[phy.name] << _PHY
    flags |= _CRC_VALID if sent.whole else 0
    if address != ADVERTISING_ADDRESS:
        flags |= (_TO_PERIPHERAL if centrals.get(address) == sent.source else _TO_CENTRAL) << _TYPE
    elif sent.kind in _AUXILIARIES:
        flags |= _AUXILIARY << _TYPE | _AUXILIARIES[sent.kind] << _AUXILIARY_KIND
    head = _HEADER.pack(sent.channel // 2, 0, 0, 0, address, flags)
    return head + body[:4] + _CODINGS.get(phy.name, b"") + body[4:]


def _phy_of(duration: Time, octets: int) -> Phy:
    """Return the PHY on which a packet with a payload of *octets* lasts so long: no two have the same times."""
    return next(phy for phy in PHYS.values() if phy.air_time(octets) == duration)
