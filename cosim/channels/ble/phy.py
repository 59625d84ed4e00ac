"""The physical layers LE 1M, LE 2M and LE Coded: how long a packet is on the air (Core v5.0, Vol 6 Part B, section 2).

A packet is preamble, access address (4 octets), header (2), payload (0 to 255) and CRC (3). LE Coded sends preamble,
access address, coding indicator and TERM1 with S = 8 always; header, payload, CRC and TERM2 (3 bits) with S = 2 or 8.
"""

from typing import Final, NamedTuple

from cosim.units import US, Time

HEADER_OCTETS: Final = 2
CRC_OCTETS: Final = 3
MAX_PAYLOAD: Final = 255
"""Octets of the longest payload: 251 and a message integrity check of 4 in a connection."""

T_IFS: Final[Time] = 150 * US
"""Time from the end of a packet to the start of the next one on the same channel (section 4.1)."""
T_IFS_TOLERANCE: Final[Time] = 2 * US
"""Largest error of ``T_IFS``, to either side."""
T_MAFS: Final[Time] = 300 * US
"""Least time from the end of a packet to the start of the auxiliary packet that it points to."""


class Phy(NamedTuple):
    """One physical layer; times in ns."""

    name: str
    lead: Time
    """Air time of what comes before the header: preamble and access address; in LE Coded CI and TERM1 as well."""
    octet: Time
    """Air time of an octet of header, payload and CRC."""
    tail: Time
    """Air time of what follows the CRC: TERM2 in LE Coded."""
    sensitivity_dbm: float
    """Sensitivity of a part that is sold, of Microchip (data sheet, table 49.34)."""

    def air_time(self, octets: int) -> Time:
        """Return the duration in ns of a packet with a payload of *octets*; ValueError if it is longer than allowed."""
        if not 0 <= octets <= MAX_PAYLOAD:
            raise ValueError(f"{octets} octets are no payload (0 to {MAX_PAYLOAD})")
        return self.lead + (HEADER_OCTETS + octets + CRC_OCTETS) * self.octet + self.tail


LE_1M: Final = Phy("1M", (8 + 32) * US, 8 * US, 0, -99.0)
LE_2M: Final = Phy("2M", (8 + 16) * US, 4 * US, 0, -96.0)
CODED_S2: Final = Phy("Coded S=2", (80 + 256 + 16 + 24) * US, 16 * US, 3 * 2 * US, -103.0)
CODED_S8: Final = Phy("Coded S=8", (80 + 256 + 16 + 24) * US, 64 * US, 3 * 8 * US, -108.5)

PHYS: Final[dict[str, Phy]] = {phy.name: phy for phy in (LE_1M, LE_2M, CODED_S2, CODED_S8)}
