"""What LE devices put on the air, and what disturbs them there: their tenancy of a band.

The band is their own, or that of an air which radios of other kinds share. In their own what is sent is told when
somebody asks what has disturbed a packet, of what follows from arithmetic only as much as can matter then. In a shared
air what is sent is told as it begins: others may listen before they talk.
"""

from collections.abc import Callable, Iterable, Sequence
from typing import Final, TypeAlias

import numpy as np

import cosim.elementary as elementary
from cosim.arrays import Floats
from cosim.channels.air.band import Band, Emission, Section
from cosim.channels.air.emissions import Tuning, Wanted, sends_otherwise
from cosim.channels.air.jammers import emissions
from cosim.channels.air.shared import NEVER, SharedAir
from cosim.channels.air.spectra import LE_1M as KIND_1M
from cosim.channels.air.spectra import LE_2M as KIND_2M
from cosim.channels.ble.packets import LOOKBACK, Sent
from cosim.channels.ble.phy import LE_2M, Phy
from cosim.channels.jamming import Jammer
from cosim.channels.reach import Disc, Fading
from cosim.kernel import Kernel
from cosim.machine import Address
from cosim.units import US, Time

SHORT_PACKETS: Final[Time] = 1_100 * US
"""Time of an advertisement that is being received, and of what follows from arithmetic and was on the air before it."""

Lazy: TypeAlias = Callable[[Time, Time], Iterable[Sent]]
"""(since, until) -> what follows from arithmetic and begins in [since, until)."""
Next: TypeAlias = Callable[[Time], Time]
"""(time) -> the first instant after it at which something that follows from arithmetic may begin, or NEVER."""


class Tenancy:
    """The tenancy of LE devices that send with *sent_dbm*; *shared* is None if they have a band of their own."""

    def __init__(
        self, kernel: Kernel, reach: Disc | Fading, sent_dbm: Sequence[float], shared: SharedAir | None
    ) -> None:
        self.lazies: list[Lazy] = []
        self.nexts: list[Next] = []
        self.shared = shared
        self._kernel = kernel
        self._reach = reach
        self._size = len(sent_dbm)
        self._fading = isinstance(reach, Fading)
        self._sent_dbm = np.array(sent_dbm, dtype=np.float64) if self._fading else np.zeros(self._size)
        self._sent_mw = elementary.exp10s(self._sent_dbm / 10.0).tolist()
        self._untold: list[Sent] = []
        """What has been sent, or will be at once, and the band does not know."""
        self._told: Time = 0
        self._jammers: list[tuple[Jammer, Address]] = []
        """Jammers, and their numbers among the senders."""
        self._band = Band(self._size, 0.0) if shared is None else shared.band
        self.number = self._band.join(self) if shared is None else shared.join(self)
        """Its number in the band."""
        self.reconsider: Callable[[], None] = lambda: None
        """Called when others begin, or cease, to be silent."""
        self.silent = False
        """False: LE devices mostly advertise."""
        self.alone = True
        """True if nobody else sends anything."""
        self._changed_at: Time | None = 0
        """Since when a band of their own does not know the gains; None if it does."""

    @property
    def jammed(self) -> bool:
        """True if jammers may disturb what is sent."""
        return bool(self._jammers)

    def jam(self, jammer: Jammer) -> None:
        """Put *jammer* on the air as well, at its times, which are to come."""
        if self.shared is None:
            self._jammers.append((jammer, self._size + len(self._jammers)))
            self._band.grow(1)
            self.changed()
        else:
            self._jammers.append((jammer, self.shared.place(jammer)))

    def changed(self) -> None:
        """Note that the powers between devices are others from now on."""
        if self.shared is None:
            self._changed_at = self._kernel.now

    def send(self, packet: Sent) -> None:
        """Put *packet*, which begins now or soon, on the air."""
        if self.shared is None or self.alone:
            self._untold.append(packet)
        else:
            self.shared.tell(self._emission(packet))

    def interference(self, packet: Sent, receiver: Address, oldest: Time, powers_dbm: Floats) -> list[Section]:
        """Return what disturbs the *receiver* of *packet*, which ends now, section by section.

        *oldest* is the start of what has been on the air for longest; *powers_dbm* are those of now, (n, n).
        """
        if self.shared is None:
            self._take_gains(powers_dbm)
            self._catch_up(packet.end, min(oldest, packet.start) - SHORT_PACKETS)
        else:
            self.shared.refresh()
            self._catch_up(packet.end, packet.end - LOOKBACK)
        tuning = Tuning(_kind(packet.phy), 2 * packet.centre_mhz, receiver)
        wanted = Wanted(self.number, packet.source)
        return self._band.interference(tuning, packet.start, packet.end, wanted)

    def deaf(self, packet: Sent, receiver: Address) -> bool:
        """Return whether another radio of the *receiver* has sent during *packet*, after ``interference``.

        Where nothing arbitrates such a radio only disturbs.
        """
        if self.shared is None or self.shared.arbitration is None:
            return False
        return sends_otherwise(self._band.table, receiver, self.number, packet.start, packet.end)

    # ---------------------------------------------------------------- as a tenant

    @property
    def asks_from(self) -> Time:
        """Instant from which it may still ask for interference."""
        return self._kernel.now - LOOKBACK

    def catch_up(self, until: Time) -> None:
        """Tell the band what begins before *until*: of what follows from arithmetic, as far back as it can matter."""
        self._catch_up(until, until - LOOKBACK)

    def others_changed(self, alone: bool) -> None:
        """Have links rest only while nobody else sends anything."""
        self.alone = alone
        if not alone:
            self.catch_up(self._kernel.now)
            for packet in self._untold:  # it begins soon
                self._tell(packet)
            self._untold = []
        self.reconsider()

    @property
    def attentive(self) -> bool:
        """False: LE devices never listen before they talk."""
        return False

    def hear(self, emission: Emission) -> None:
        """Do nothing."""

    @property
    def punctual(self) -> bool:
        """False: what asks an arbiter has events of its own."""
        return False

    def begins_after(self, time: Time) -> Time:
        """Return the first instant after *time* at which something that follows from arithmetic may begin."""
        return min((following(time) for following in self.nexts), default=NEVER)

    def send_due(self, now: Time) -> None:
        """Tell the air what follows from arithmetic and begins *now*."""
        self._catch_up(now + 1, now + 1 - LOOKBACK)

    # ---------------------------------------------------------------- what is told

    def _catch_up(self, until: Time, since: Time) -> None:
        """Catch up to *until*: nobody asks for times before *since* any more."""
        since, self._told = max(self._told, since), max(self._told, until)
        for packet in self._untold:
            if packet.start < until:
                self._tell(packet)
        self._untold = [packet for packet in self._untold if packet.start >= until]
        if since < until:
            for lazy in self.lazies:
                for packet in lazy(since, until):
                    self._tell(packet)
            for (jammer, number), mw in zip(self._jammers, self._jam_mw(), strict=True):
                for emission in emissions(jammer, number, self.number, mw, since, until):
                    self._band.tell(emission)

    def _tell(self, packet: Sent) -> None:
        (self._band if self.shared is None else self.shared).tell(self._emission(packet))

    def _emission(self, packet: Sent) -> Emission:
        mw = self._sent_mw[packet.source]
        at = 2 * packet.centre_mhz
        return Emission(packet.start, packet.end, _kind(packet.phy), at, packet.source, self.number, mw)

    # ---------------------------------------------------------------- a band of their own

    def _take_gains(self, powers_dbm: Floats) -> None:
        """Have the band know the powers of now, from the instant of their change on."""
        if self._changed_at is not None:
            since, self._changed_at = max(self._changed_at, self._told), None
            size, jammers = self._size, [jammer for jammer, _ in self._jammers]
            gains_db = np.full((size + len(jammers), size + len(jammers)), -np.inf)
            gains_db[:size, :size] = powers_dbm - self._sent_dbm[:, None]
            if jammers:
                gains_db[size:, :size] = self._reach.jam_dbm(jammers) - self._jam_dbm()[:, None]
            self._band.moved(gains_db, since)

    def _jam_dbm(self) -> Floats:
        """Return the powers of the jammers; where signals do not fade they are received as devices are."""
        return np.array([jammer.power_dbm if self._fading else 0.0 for jammer, _ in self._jammers])

    def _jam_mw(self) -> list[float]:
        return elementary.exp10s(self._jam_dbm() / 10.0).tolist() if self._jammers else []


def _kind(phy: Phy) -> int:
    return KIND_2M if phy == LE_2M else KIND_1M
