"""How much fits into the events of connections: exchanges, octets and links, as arithmetic."""

from cosim.channels.ble.phy import T_IFS, Phy
from cosim.units import Time


def exchange_time(down: Phy, octets_down: int, up: Phy, octets_up: int) -> Time:
    """Return the time in ns from the start of a packet with *octets_down* to when the one after its answer may start.

    *down* and *up* are the PHYs of the central's and of the peripheral's packets.
    """
    return down.air_time(octets_down) + T_IFS + up.air_time(octets_up) + T_IFS


def exchanges(interval: Time, exchange: Time) -> int:
    """Return how many whole exchanges of that length an event as long as the *interval* holds."""
    return interval // exchange


def links(interval: Time, event: Time) -> int:
    """Return how many links a central can serve in each *interval* if each has events of that length."""
    return interval // event
