"""What a robot counts: frames, bytes and energy by radio, its way; what the metrics are made of.

The radio's energy is that which Feeney and Nilsson measured on a 2.4 GHz 802.11 card at 2 Mb/s ("Investigating the
energy consumption of a wireless network interface in an ad hoc networking environment", INFOCOM 2001, Table 1): linear
in the payload's bytes, with a constant that holds the MAC's own frames. Idling is left out.
"""

from dataclasses import dataclass, field
from typing import Final

from cosim.units import Time

SEND_J: Final = (454e-6, 1.9e-6)
"""Unicast: joules a frame, and a byte."""
BROADCAST_J: Final = (266e-6, 1.9e-6)
RECEIVE_J: Final = (356e-6, 0.5e-6)
HEAR_J: Final = (56e-6, 0.5e-6)
"""A broadcast that is received."""


@dataclass(slots=True)
class Records:
    """Counts of one robot."""

    frames: int = 0
    payload_bytes: int = 0
    radio_j: float = 0.0
    joins: list[Time] = field(default_factory=list)
    """When a searcher was taken in by another host."""
    contacts: int = 0
    """Times that a searcher came into contact with its host."""
    reported: int = 0
    """Targets that a host has heard of first from a searcher of its own."""
    failures: list[tuple[int, Time]] = field(default_factory=list)
    """(host, when) it was taken for failed."""
    known_at: Time | None = None
    """When a host knew all targets."""
    stopped_at: Time | None = None
    """When a searcher heard that it is over."""
    ways_m: list[float] = field(default_factory=list)
    """The way driven up to each tick."""
    last_tick: Time = 0
    """When it observed last: a dead one's death."""

    def spend(self, cost: tuple[float, float], octets: int) -> None:
        """Count the energy of a frame with *octets* of payload."""
        self.radio_j += cost[0] + cost[1] * octets

    def moved(self, way_m: float, now: Time) -> None:
        """Count the way of one tick."""
        self.ways_m.append((self.ways_m[-1] if self.ways_m else 0.0) + way_m)
        self.last_tick = now
