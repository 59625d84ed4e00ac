"""The other radios of a shared air, as the stations of one 802.11 channel hear them, and what those hear of it.

What other radios send is noise to a station: it makes the medium busy if it is energy enough, and disturbs what is
received. All of it that falls into the channel's band counts, as in ``air.spectra``; it arrives at once, as a frame
arrives at other radios as soon as it begins.
"""

from collections.abc import Callable
from typing import Final

import numpy as np

from cosim.arrays import Floats
from cosim.channels.adhoc.jamming import FIRST_MHZ, MEMORY, SPACING_MHZ
from cosim.channels.adhoc.settings import AdhocSettings
from cosim.channels.adhoc.state import BEGUN, Records, new_records
from cosim.channels.air.band import Emission
from cosim.channels.air.emissions import GENERATION, Listening, next_change, write_levels
from cosim.channels.air.shared import NEVER, SharedAir
from cosim.channels.air.spectra import DSSS, JAMMER, OFDM, OFFSETS, STEPS_PER_MHZ
from cosim.kernel import Kernel
from cosim.machine import Address
from cosim.units import Time

KINDS: Final = {"dsss": DSSS, "dsss_short": DSSS, "erp": OFDM, "erp_long_slot": OFDM}
"""What its physical layers are in ``air.spectra``."""


class Neighbours:
    """The others in *air*, as stations with *settings* that send with *sent_mw*, (n,), hear them."""

    def __init__(self, air: SharedAir, settings: AdhocSettings, kernel: Kernel, sent_mw: Floats) -> None:
        self.attentive = False
        """True while stations must notice what others send as it begins."""
        self.noticed: Callable[[Time], None] = lambda start: None
        """Called with the instant from which another one will send."""
        self.own: Callable[[Address, Time, Time], None] | None = None
        """Called with robot, start and end of what robots' other radios send, now or soon, if they are arbitrated."""
        self.begun: Callable[[Time], Records] = lambda until: new_records(0, BEGUN)
        """Takes from the stations the frames that have begun before an instant."""
        self._air, self._kernel = air, kernel
        self._sent_mw = sent_mw
        middle_mhz = FIRST_MHZ + SPACING_MHZ * (settings.channel - 1)
        self._shares = air.band.table.shares
        self.number = air.join(self)
        """Its number in the band."""
        self._listening = Listening(KINDS[settings.phy], int(STEPS_PER_MHZ * middle_mhz), self.number)

    # ------------------------------------------------------------ what stations hear

    def listen(self) -> None:
        """Be told of all that others begin to send, from now on."""
        self.attentive = True
        self._air.review()
        self._air.reconsider()
        if self.own is not None:
            self._tell_own(self.own)

    def _tell_own(self, own: Callable[[Address, Time, Time], None]) -> None:
        """Tell of what is on the air, or will be soon, and was told while no station was attentive."""
        table, now = self._air.band.table, self._kernel.now
        for start, end, kind, _, sender, tenant in table.rows[: table.state[0], :GENERATION].tolist():
            if end > now and tenant != self.number and kind != JAMMER:
                own(sender, start, end)

    def ignore(self) -> None:
        """Be told no more: all stations are at rest."""
        self.attentive = False
        self._air.review()

    def settle(self) -> None:
        """Have all others tell what they have begun to send before now."""
        now = self._kernel.now
        self.catch_up(now)
        self._air.band.settle(now, self._listening.tenant)

    def powers_mw(self, at: Time) -> Floats:
        """Return the power that comes to each station from all others at the instant *at*, (n,)."""
        levels = np.zeros(len(self._sent_mw))
        write_levels(self._air.band.table, self._listening, at, levels)
        return levels

    def change_after(self, time: Time) -> Time | None:
        """Return the first instant after *time*, for all that is known, at which these powers change."""
        change = int(next_change(self._air.band.table, self._listening, time))
        return None if change == NEVER else change

    # ------------------------------------------------------------ as a tenant of the air

    @property
    def asks_from(self) -> Time:
        """Instant from which the stations may still ask for what disturbs them."""
        return self._kernel.now - MEMORY

    def catch_up(self, until: Time) -> None:
        """Tell the air of the frames that have begun before *until*."""
        if len(frames := self.begun(until)):
            self.tell(frames)

    def tell(self, frames: Records) -> None:
        """Tell the air of *frames*: begin, end and source of each. No other radio listens before it talks."""
        self._air.band.tell_all(self._listening, frames["begin"], frames["end"], frames["source"], self._sent_mw)

    @property
    def silent(self) -> bool:
        """True if no station has anything to say."""
        return not self.attentive

    def others_changed(self, alone: bool) -> None:
        """Do nothing: frames are told when somebody asks."""

    @property
    def punctual(self) -> bool:
        """False: stations send by events."""
        return False

    def begins_after(self, time: Time) -> Time:
        """Return NEVER: stations send by events."""
        return NEVER

    def send_due(self, now: Time) -> None:
        """Do nothing."""

    def hear(self, emission: Emission) -> None:
        """Have the stations notice *emission*, if any of it falls into the channel's band, or it is their robot's."""
        if self.own is not None and emission.kind != JAMMER:
            self.own(emission.sender, emission.start, emission.end)
        kind, centre, _ = self._listening
        offset = abs(emission.centre - centre)
        if offset < OFFSETS and self._shares[emission.kind, kind, offset] > 0.0:
            self.noticed(emission.start)
