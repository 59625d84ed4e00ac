"""What LE devices have on the air, and what others hear of it: all packets that overlap in time, one by one.

Powers are those of a packet's start. Without a law of propagation a packet has 1 mW within reach, and nothing beyond.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from cosim import elementary
from cosim.channels.air.spectra import LE_1M, LE_2M, OFFSETS, shares
from cosim.channels.ble import phy as phys
from cosim.channels.ble.bits.errors import CLEAR_G, UNNOTICED, noise_mw, ratio, received
from cosim.channels.ble.channels import frequency_mhz, rf_channel
from cosim.channels.ble.connections.exchange import Reception
from cosim.channels.ble.phy import Phy
from cosim.channels.ble.settings import BleSettings
from cosim.channels.propagation import Propagation
from cosim.geometry.segments import segment_grid
from cosim.randomness import Streams
from cosim.units import MS

if TYPE_CHECKING:
    from tests.oracles.le_device import Device

KEPT = 60 * MS
"""Time for which packets are kept that are over: more than the longest one lasts."""
WORD = 2.0**32


@dataclass(eq=False)
class Packet:
    """A packet of *source* on the channel with an index, from *start* on."""

    source: int
    start: int
    phy: Phy
    octets: int
    channel: int
    powers_mw: Sequence[float] = field(default_factory=list)
    """Power at each device."""

    @property
    def end(self) -> int:
        return self.start + self.phy.air_time(self.octets)

    @property
    def kind(self) -> int:
        return LE_2M if self.phy == phys.LE_2M else LE_1M


class Air:
    """The air between *size* devices."""

    def __init__(self, settings: BleSettings, size: int, streams: Streams) -> None:
        self.settings = settings
        self.draws = streams.draws("ble", "errors")
        self.packets: list[Packet] = []
        self.places = [(0.0, 0.0)] * size
        law = settings.propagation
        shadowing = streams.draws("ble", "shadowing")
        self.law = None if law is None else Propagation(law, segment_grid([]), [], shadowing)

    def put(self, packet: Packet) -> None:
        """Let *packet* begin."""
        self.packets = [each for each in self.packets if each.end > packet.start - KEPT]
        packet.powers_mw = [self.power_mw(packet.source, to) for to in range(len(self.places))]
        self.packets.append(packet)

    def power_mw(self, source: int, to: int) -> float:
        """Return the power of *source* at *to*, now."""
        if source == to:
            return 0.0
        if self.law is None:
            (ax, ay), (bx, by) = self.places[source], self.places[to]
            reach = self.settings.range_m
            return 1.0 if reach is None or (ax - bx) ** 2 + (ay - by) ** 2 <= reach**2 else 0.0
        gain = self.law.gains_db(np.array(self.places))[source, to]
        return float(elementary.exp10((self.settings.power_dbm + gain) / 10.0))

    def clear(self, one: "Device", other: "Device", phy: Phy) -> bool:
        """Return whether packets of *one* come to *other*, both on, without errors if nothing disturbs them."""
        return self.reaches(one, other, phy, CLEAR_G)

    def notices(self, one: "Device", other: "Device") -> bool:
        """Return whether *other* may ever notice *one*, both on."""
        return self.reaches(one, other, phys.LE_1M, UNNOTICED)

    def reaches(self, one: "Device", other: "Device", phy: Phy, least: float) -> bool:
        power = self.power_mw(one.address, other.address)
        noise = 0.0 if self.law is None else noise_mw(phy, self.settings.sensitivity_dbm)
        return one.on and other.on and power > 0.0 and ratio(phy, power, noise) >= least

    def rssi_dbm(self, packet: Packet, receiver: int) -> float | None:
        """Return what a host is told of the power of *packet*."""
        return None if self.law is None else float(10.0 * elementary.log10(packet.powers_mw[receiver]))

    def reception(self, packet: Packet, receiver: int) -> Reception:
        """Return what *receiver* makes of *packet*, which is over, if it listens."""
        power = packet.powers_mw[receiver]
        noise = 0.0 if self.law is None else noise_mw(packet.phy, self.settings.sensitivity_dbm)
        if power == 0.0 or (noise and ratio(packet.phy, power, noise) < UNNOTICED):
            return Reception.MISSED
        sections = self.sections(packet, receiver)
        header, payload = received(packet.phy, packet.octets, power, noise, sections, packet.start)
        words = self.draws.words(packet.start, 65_536 * packet.source + receiver)
        if words[0] / WORD >= header:
            return Reception.MISSED
        return Reception.HEARD if words[1] / WORD < payload else Reception.BAD_CRC

    def sections(self, packet: Packet, receiver: int) -> list[tuple[int, int, float]]:
        """Return the interference during *packet* at *receiver*: (from, until, mW)."""
        others = []
        if self.settings.interference == "band":
            others = [
                each
                for each in self.packets
                if each.source not in (packet.source, receiver) and each.start < packet.end and packet.start < each.end
            ]
        edges = {packet.start, packet.end, *(edge for each in others for edge in (each.start, each.end))}
        times = sorted(edge for edge in edges if packet.start <= edge <= packet.end)
        return [
            (begin, end, sum(leak(each, packet, receiver) for each in others if each.start < end and begin < each.end))
            for begin, end in pairwise(times)
        ]


def leak(other: Packet, packet: Packet, receiver: int) -> float:
    """Return the power of *other* that passes the filter for *packet*, in mW."""
    apart = 2 * abs(frequency_mhz(rf_channel(other.channel)) - frequency_mhz(rf_channel(packet.channel)))
    share = float(shares()[other.kind, packet.kind, apart]) if apart < OFFSETS else 0.0
    return share * other.powers_mw[receiver]
