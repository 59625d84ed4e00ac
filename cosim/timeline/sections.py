"""Which section of a frame its receiver has lost, by the part that failed first: when it begins and ends."""

from functools import cache
from typing import Final, NamedTuple

from cosim.channels.ble.phy import HEADER_OCTETS, LE_1M, MAX_PAYLOAD, PHYS, Phy
from cosim.channels.bluetooth.packets import ACCESS_AIR, HEADER_AIR
from cosim.units import Time


class Section(NamedTuple):
    """A part of a frame's time, ns after its start."""

    begin: Time
    end: Time | None
    """None: the end of the frame."""


WHOLE: Final = Section(0, None)
_OF_BLUETOOTH: Final = {
    "access_code": Section(0, ACCESS_AIR),
    "header": Section(ACCESS_AIR, HEADER_AIR),
    "payload": Section(HEADER_AIR, None),
}
_BESIDE: Final = {"CONTROL": 2, "AUX_ADV_IND": 13, "AUX_CHAIN_IND": 8}
"""Least octets of a PDU's payload besides those of users, by the type of the packet; none in others."""
_OF_LE_1M: Final = frozenset({"ADV_IND", "ADV_EXT_IND", "CONNECT_IND", "SCAN_REQ", "SCAN_RSP"})


def of_bluetooth(part: str) -> Section:
    """Return the section of a packet of Bluetooth that is its *part*; the whole if there is none of that name."""
    return _OF_BLUETOOTH.get(part, WHOLE)


@cache
def of_low_energy(part: str, kind: str, duration: Time, length: int) -> Section:
    """Return the section of a packet of Low Energy that is its *part*, *length* being the octets of users in it.

    The header is all up to the end of that of the PDU: preamble and access address as well.
    """
    phy = _phy_of(kind, duration, length)
    if phy is None:
        return WHOLE
    begin_of_payload = phy.lead + HEADER_OCTETS * phy.octet
    return Section(0, begin_of_payload) if part == "header" else Section(begin_of_payload, None)


def _phy_of(kind: str, duration: Time, length: int) -> Phy | None:
    """Return the PHY of a packet of Low Energy of that *kind* and *duration* with *length* octets of users.

    It is the slowest on which the packet would have as many octets as it must. None if there is none.
    """
    if kind in _OF_LE_1M:
        return LE_1M
    least = length + _BESIDE.get(kind, 0)
    for phy in sorted(PHYS.values(), key=lambda each: -each.octet):
        octets, rest = divmod(duration - phy.air_time(0), phy.octet)
        if not rest and least <= octets <= MAX_PAYLOAD:
            return phy
    return None
