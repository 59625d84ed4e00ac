"""A battery: an amount of energy that host, radio and drive use up, from world tick to world tick.

The law is linear: constant power of the host and of the radio while they are on, and a constant energy for each metre
driven. What a radio takes in listening is most of what it takes at all (Feeney and Nilsson, "Investigating the energy
consumption of a wireless network interface in an ad hoc networking environment", INFOCOM 2001), so frames are not
counted; neither is braking, nor what standing costs beyond the host.
"""

from cosim.faults.settings import BatterySettings


class Battery:
    """What is left of the energy of one robot."""

    def __init__(self, settings: BatterySettings) -> None:
        self.left_j = settings.capacity_j
        self._settings = settings

    def drain(self, seconds: float, way_m: float, host_on: bool, radio_on: bool) -> bool:
        """Take what *seconds* and *way_m* have cost; return whether nothing is left."""
        settings = self._settings
        power_w = settings.idle_w * host_on + settings.radio_w * radio_on
        self.left_j -= power_w * seconds + settings.drive_j_per_m * way_m
        return self.left_j <= 0.0
