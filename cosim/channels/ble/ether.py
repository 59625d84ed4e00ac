"""What LE devices send, how strong it is where, and what a receiver makes of it.

Whoever sends a packet says so when it begins, and when it is over; in between nobody is told. What a receiver has made
of a packet is decided at its end, when all is known that was on the air meanwhile. Each packet stands by itself: that a
receiver is taken up with another one, earlier and weaker, is neglected.

What follows from arithmetic, such as advertising that nobody scans for, is not sent one by one.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

import cosim.elementary as elementary
from cosim.arrays import Bools, Floats
from cosim.channels.air.band import Section
from cosim.channels.air.shared import SharedAir
from cosim.channels.base import Positions
from cosim.channels.ble.bits.errors import CLEAR_G, UNNOTICED, least_dbm, noise_mw, ratio, received
from cosim.channels.ble.connections.exchange import Reception
from cosim.channels.ble.packets import LOOKBACK, Sent
from cosim.channels.ble.phy import LE_1M, PHYS, Phy
from cosim.channels.ble.settings import BleSettings
from cosim.channels.ble.tenancy import Tenancy
from cosim.channels.reach import Disc, Fading
from cosim.kernel import Kernel
from cosim.machine import Address
from cosim.randomness import Draws
from cosim.units import Time

_ANY_DBM: Final = -1e300
"""What everything that is received at all has more of."""


class Judgement(NamedTuple):
    """What became of a packet at a receiver."""

    reception: Reception
    outcome: str
    """As in the table ``frames``."""
    part: str = ""
    power_dbm: float | None = None
    sinr_db: float | None = None


class Ether:
    """What devices that send with *sent_dbm* send to each other."""

    def __init__(
        self,
        settings: BleSettings,
        kernel: Kernel,
        reach: Disc | Fading,
        sent_dbm: Sequence[float],
        draws: Draws,
        shared: SharedAir | None = None,
    ) -> None:
        """*shared* is None if the devices have a band of their own."""
        size = len(sent_dbm)
        self.on: Bools = np.ones(size, dtype=np.bool_)
        """Which devices are switched on."""
        self.sent = 0
        """Packets that carried something of hosts."""
        self._on_air: list[Sent] = []
        self._kernel = kernel
        self._reach = reach
        self._fading = isinstance(reach, Fading)
        self._sensitivity_dbm = settings.sensitivity_dbm if self._fading else _ANY_DBM
        self._noises_mw = {phy.name: self._fading * noise_mw(phy, settings.sensitivity_dbm) for phy in PHYS.values()}
        least = {
            g: [least_dbm(phy, settings.sensitivity_dbm, g) for phy in PHYS.values()] for g in (UNNOTICED, CLEAR_G)
        }
        if not self._fading:
            least = dict.fromkeys(least, [_ANY_DBM] * len(PHYS))
        self._noticed_dbm = dict(zip(PHYS, least[UNNOTICED], strict=True))
        self._clear_dbm = dict(zip(PHYS, least[CLEAR_G], strict=True))
        self._draws = draws
        self._switched_at: list[Time] = [-1] * size  # when each was last switched on or off
        self._moved_at: Time = 0
        self._powers: list[tuple[Time, Floats]] = [(-LOOKBACK, reach.power_dbm())]
        """(since when, powers between all), of late; the last are of now unless they are stale."""
        self._stale = False
        self._asks = settings.interference == "band"
        self.tenancy = Tenancy(kernel, reach, sent_dbm, shared)

    # ---------------------------------------------------------------- who hears whom

    def moved(self, positions_m: Positions) -> bool:
        """Take new positions, and return whether that changes anything."""
        if not self._reach.moved(positions_m):
            return False
        self.changed()
        return True

    def changed(self) -> None:
        """Note that the powers between devices are others from now on."""
        self._moved_at = self._kernel.now
        self._stale = True
        self.tenancy.changed()

    @property
    def powers_dbm(self) -> Floats:
        """What each device (column) receives of each other (row) now, (n, n)."""
        if self._stale:
            while len(self._powers) > 1 and self._powers[1][0] <= self._moved_at - LOOKBACK:
                del self._powers[0]
            self._powers.append((self._moved_at, self._reach.power_dbm()))
            self._stale = False
        return self._powers[-1][1]

    def _powers_at(self, time: Time) -> Floats:
        """Return the powers of an instant of late."""
        now = self.powers_dbm
        return next((powers for since, powers in reversed(self._powers) if since <= time), now)

    def hears(self, sender: Address, receiver: Address) -> bool:
        """Return whether *receiver* receives *sender* with its sensitivity, or more, and both are on."""
        return self._reaches(sender, receiver, self._sensitivity_dbm)

    def notices(self, sender: Address, receiver: Address) -> bool:
        """Return whether *receiver* may ever notice a packet of *sender* on LE 1M, and both are on."""
        return self._reaches(sender, receiver, self._noticed_dbm[LE_1M.name])

    def clear(self, sender: Address, receiver: Address, phy: Phy) -> bool:
        """Return whether packets of *sender* on *phy* come to *receiver* without errors if nothing disturbs them."""
        return self._reaches(sender, receiver, self._clear_dbm[phy.name])

    def _reaches(self, sender: Address, receiver: Address, least_dbm: float) -> bool:
        there = self.on[sender] and self.on[receiver]
        return bool(there and self.powers_dbm[sender, receiver] >= least_dbm)

    def _ratio(self, phy: Phy, power_dbm: float, interference_mw: float) -> float:
        return ratio(phy, elementary.exp10(power_dbm / 10.0), self._noises_mw[phy.name] + interference_mw)

    # ---------------------------------------------------------------- packets

    def send(self, packet: Sent) -> None:
        """Put *packet*, which begins now or soon, on the air."""
        self.sent += packet.length > 0
        self._on_air = [*self.on_air(self._kernel.now), packet]
        if self._asks:
            self.tenancy.send(packet)

    def on_air(self, now: Time) -> list[Sent]:
        """Return what has been sent and is not over *now*."""
        return [packet for packet in self._on_air if packet.end > now]

    def judge(self, packet: Sent, receiver: Address) -> Judgement:
        """Return what a *receiver* that has listened to all of *packet*, which ends now, makes of it."""
        power_dbm = float(self._powers_at(packet.start)[packet.source, receiver])
        if not self.was_on(packet.source, packet.start) or power_dbm < self._noticed_dbm[packet.phy.name]:
            return Judgement(Reception.MISSED, "out_of_range")
        sections = self._interference(packet, receiver)
        if self.tenancy.deaf(packet, receiver):
            return Judgement(Reception.MISSED, "busy")
        worst = max(section.mw for section in sections)
        g = self._ratio(packet.phy, power_dbm, worst)
        shown = (power_dbm, _decibels(g)) if self._fading else (None, _decibels(g) if worst else None)
        if g >= CLEAR_G:
            return Judgement(Reception.HEARD, "received", "", *shown)
        return self._drawn(packet, receiver, power_dbm, sections)._replace(power_dbm=shown[0], sinr_db=shown[1])

    def _drawn(self, packet: Sent, receiver: Address, power_dbm: float, sections: Sequence[Section]) -> Judgement:
        power_mw, noise = elementary.exp10(power_dbm / 10.0), self._noises_mw[packet.phy.name]
        header, payload = received(packet.phy, packet.octets, power_mw, noise, sections, packet.start)
        words = self._draws.words(packet.start, packet.source << 16 | receiver)
        broken = "collided" if any(section.mw for section in sections) else "bit_errors"
        if words[0] * 2.0**-32 >= header:
            return Judgement(Reception.MISSED, broken, "header")
        if words[1] * 2.0**-32 >= payload:
            return Judgement(Reception.BAD_CRC, broken, "payload")
        return Judgement(Reception.HEARD, "received")

    def _interference(self, packet: Sent, receiver: Address) -> list[Section]:
        if not self._asks:
            return [Section(packet.start, packet.end, 0.0)]
        oldest = min((each.start for each in self.on_air(self._kernel.now - 1)), default=packet.start)
        return self.tenancy.interference(packet, receiver, oldest, self.powers_dbm)

    def was_on(self, device: Address, since: Time) -> bool:
        """Return whether *device* is on, and has been all the time *since* then."""
        return bool(self.on[device]) and self._switched_at[device] <= since

    def switch(self, device: Address, on: bool) -> None:
        """Note that *device* is on, or off, from now on."""
        self.on[device] = on
        self._switched_at[device] = self._kernel.now


def _decibels(factor: float) -> float | None:
    return None if factor == float("inf") else 10.0 * elementary.log10(factor)
