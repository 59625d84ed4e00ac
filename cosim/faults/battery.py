"""A battery: an amount of energy that host, radio and drive use up, from world tick to world tick.

The law is linear: constant power of the host and of the radio while they are on, and a constant energy for each metre
driven. What a radio takes in listening is most of what it takes at all (Feeney and Nilsson, "Investigating the energy
consumption of a wireless network interface in an ad hoc networking environment", INFOCOM 2001), so frames are not
counted; neither is braking, nor what standing costs beyond the host.
"""

from typing import Final

from cosim.faults.settings import BatterySettings
from cosim.units import Time, to_seconds

_ROUNDING: Final = 1e-9
"""The share of its capacity that counts as nothing, so that rounding costs no tick."""


class Battery:
    """What is left of the energy of one robot."""

    def __init__(self, settings: BatterySettings) -> None:
        self.left_j = settings.capacity_j
        self._settings = settings
        self._since: Time = 0

    def last(self, now: Time, host_on: bool, radio_on: bool) -> None:
        """Take what the time since the last call has cost, in which host and radio were on or off."""
        power_w = self._settings.idle_w * host_on + self._settings.radio_w * radio_on
        self.left_j -= power_w * to_seconds(now - self._since)
        self._since = now

    def drive(self, way_m: float) -> None:
        """Take what a way has cost."""
        self.left_j -= self._settings.drive_j_per_m * way_m

    @property
    def empty(self) -> bool:
        """Whether nothing is left."""
        return self.left_j <= _ROUNDING * self._settings.capacity_j
