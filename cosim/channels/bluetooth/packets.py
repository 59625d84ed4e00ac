"""Packet types of Basic Rate: how many slots, how many bytes, how long on the air (Core v1.2, Vol 2 Part B, section 6).

Every bit lasts 1 us. A packet with a header starts with 72 bits of access code and 54 of header. The payload of an ACL
packet is its own header (1 byte in one-slot packets, 2 in longer ones), the user's bytes and a CRC of 2 bytes; DM
packets code every 10 bits as 15, DH packets send them as they are.
"""

from functools import cache
from typing import Final, Literal, NamedTuple, TypeAlias

from cosim.units import US, Time

AclName: TypeAlias = Literal["DM1", "DH1", "DM3", "DH3", "DM5", "DH5"]

ID_BITS: Final = 68
"""The access code without its trailer, which is a whole ID packet."""
ACCESS_CODE_BITS: Final = 72
"""The access code with its trailer, as every packet with a header begins."""
TOLERATED_BITS: Final = 7
"""Wrong bits with which an access code is still recognised: 65 of 72 agree."""
HEADER_BITS: Final = 18
"""Bits of the packet header, each of which is sent three times."""
ID_AIR: Final[Time] = ID_BITS * US
ACCESS_AIR: Final[Time] = ACCESS_CODE_BITS * US
HEADER_AIR: Final[Time] = ACCESS_AIR + 3 * HEADER_BITS * US
"""Air time of access code and header, which are a whole POLL or NULL packet."""
FHS_AIR: Final[Time] = 366 * US
FHS_BITS: Final = 160
"""Payload of an FHS packet: 144 bits of contents and the CRC, coded as those of DM packets."""


class PacketType(NamedTuple):
    """One type of packet."""

    name: str
    slots: int
    """Slots that it occupies, counted from its start; the other side answers in the next one."""
    capacity: int
    """User payload in bytes that it can carry."""
    header: int
    """Length of the payload header in bytes; 0 for packets that carry no user data."""
    coded: bool
    """True if the payload is protected by the (15, 10) code."""

    def payload_bits(self, length: int) -> int:
        """Return the bits of the payload with *length* bytes of user data, before coding: header, data and CRC.

        Raise ValueError if they do not fit.
        """
        if not 0 <= length <= self.capacity:
            raise ValueError(f"{length} bytes do not fit into {self.name} ({self.capacity} bytes)")
        if not self.header:
            return FHS_BITS if self.name == "FHS" else 0
        return 8 * (self.header + length + 2)

    def air_time(self, length: int) -> Time:
        """Return the duration in ns with *length* bytes of user payload; ValueError if they do not fit."""
        return _air_time(self, length)


@cache
def _air_time(kind: PacketType, length: int) -> Time:
    bits = kind.payload_bits(length)
    if not kind.header:
        return {"ID": ID_AIR, "FHS": FHS_AIR}.get(kind.name, HEADER_AIR)
    return HEADER_AIR + (-(-bits // 10) * 15 if kind.coded else bits) * US


ID: Final = PacketType("ID", 1, 0, 0, False)
POLL: Final = PacketType("POLL", 1, 0, 0, False)
NULL: Final = PacketType("NULL", 1, 0, 0, False)
FHS: Final = PacketType("FHS", 1, 0, 0, True)
DM1: Final = PacketType("DM1", 1, 17, 1, True)
DH1: Final = PacketType("DH1", 1, 27, 1, False)
DM3: Final = PacketType("DM3", 3, 121, 2, True)
DH3: Final = PacketType("DH3", 3, 183, 2, False)
DM5: Final = PacketType("DM5", 5, 224, 2, True)
DH5: Final = PacketType("DH5", 5, 339, 2, False)

ACL: Final[dict[str, PacketType]] = {kind.name: kind for kind in (DM1, DH1, DM3, DH3, DM5, DH5)}
"""The types that carry user data, by name, from the smallest to the largest."""
PACKETS: Final[dict[str, PacketType]] = {kind.name: kind for kind in (ID, POLL, NULL, FHS)} | ACL


@cache
def smallest(types: tuple[PacketType, ...], length: int) -> PacketType | None:
    """Return the one of *types* with the least capacity that holds *length* bytes, or None if none does."""
    fitting = [kind for kind in types if kind.header and kind.capacity >= length]
    return min(fitting, key=lambda kind: kind.capacity, default=None)
