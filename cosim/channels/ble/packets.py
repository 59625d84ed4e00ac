"""A packet of LE on the air, as all that send, judge and record it see it."""

from dataclasses import dataclass
from typing import Final

from cosim.channels.ble.channels import frequency_mhz, rf_channel
from cosim.channels.ble.phy import Phy
from cosim.machine import Address
from cosim.units import MS, Time

LOOKBACK: Final[Time] = 18 * MS
"""Time before an instant in which what is on the air at that instant began (17.04 ms), and what follows from arithmetic
and was on the air when it did (0.72 ms)."""


@dataclass(slots=True)
class Sent:
    """A packet on the air."""

    start: Time
    source: Address
    destination: Address
    kind: str
    channel: int
    """Index of its channel."""
    phy: Phy
    octets: int
    """Of its payload."""
    length: int = 0
    """Octets of users' payloads in it."""
    access_address: int = 0
    crc_init: int = 0
    pdu: bytes = b""
    again: bool = False
    """True if its payload has been on the air before."""

    @property
    def end(self) -> Time:
        """The end of its last bit."""
        return self.start + self.phy.air_time(self.octets)

    @property
    def centre_mhz(self) -> int:
        """The centre of its channel."""
        return frequency_mhz(rf_channel(self.channel))
