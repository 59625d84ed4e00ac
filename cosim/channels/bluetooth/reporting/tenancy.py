"""Bluetooth in an air that radios of other kinds share: what it tells them, and how it hears of them.

Frames with payload, of inquiries and of pages are told as they begin. Idle frames, and the IDs of trains, follow from
arithmetic: they are told up to an instant when somebody asks, or one by one while somebody listens before it talks.

Where arbiters divide the air between a robot's radios, devices ask theirs before they send (:class:`Seats`). What goes
before what changes all the time: so each pair of slots and each ID is decided when it is to begin, and none before, as
long as others send anything.
"""

from collections import deque
from typing import Final, Protocol, TypeAlias

import numpy as np

import cosim.elementary as elementary
from cosim.arrays import Floats, Int64s
from cosim.channels.air.band import Emission
from cosim.channels.air.jammers import LOWEST_MHZ
from cosim.channels.air.shared import NEVER, SharedAir
from cosim.channels.air.spectra import CLASSIC, STEPS_PER_MHZ
from cosim.channels.bluetooth.band import Band, next_start, polls_at, senders
from cosim.channels.bluetooth.medium import BEGUN_FIELDS, Foreign, Medium, jamming, list_ids
from cosim.channels.bluetooth.packets import HEADER_AIR, ID_AIR
from cosim.channels.bluetooth.polling import (
    DUE,
    HEARD_DOWN,
    HEARD_UP,
    HERE,
    JOINED,
    NEXT,
    PAIR_HERE,
    PAIR_LINK,
    PAIR_TICK,
    PHASE,
    PPM,
    SLAVE,
    STAGE,
    first_slot_at,
    next_poll,
    time_of,
)
from cosim.channels.bluetooth.reporting.seats import Seats
from cosim.channels.clock import start_of, tick_at
from cosim.kernel import Kernel
from cosim.machine import Address
from cosim.units import MS, Time

ROOM: Final = 8192
"""Number of idle frames that have begun and can be kept until the air is told: more than are logged at once."""
_IDS: Final = 1024
"""Number of IDs that are told at once."""
MEMORY: Final[Time] = 10 * MS
"""Time for which others remember what has been on the air: longer than any interframe space."""
_ASKED: Final[Time] = 8 * MS
"""Time before the last decision of a frame that the next one can still depend on."""


_Frame: TypeAlias = tuple[Address, Time, Time, int]
"""(source, start, end, channel)"""


class Piconets(Protocol):
    """All piconets, inquiries and pages of a run."""

    band: Band
    medium: Medium
    sent: deque[_Frame]
    """Frames that are not in the medium yet."""
    neighbours: "Tenancy | None"
    """Their tenancy while others send anything."""

    def advance(self, now: Time, last_end: Time | None = None) -> None:
        """Decide all idle slots that start before *now*, and the fates of frames that end by *last_end*."""

    def changed(self, now: Time) -> None:
        """Note that others begin, or cease, to disturb them."""

    def channel(self, master: Address, tick: int) -> int:
        """Return the channel on which the piconet of *master* is at *tick*."""

    def carrier(self, source: Address, receiver: Address) -> float:
        """Return the power in dBm with which *receiver* gets *source* now."""

    def reaches(self, carrier_dbm: float) -> bool:
        """Return whether a receiver notices a frame of this power."""

    def silence_train(self, device: Address, since: Time, until: Time) -> None:
        """Let the train of *device*, if it sends one, send nothing that would start in [since, until)."""


class Tenancy:
    """The tenancy of *piconets*, whose devices send with *sent_dbm*, (n,), in the *air* that others share."""

    def __init__(self, air: SharedAir, kernel: Kernel, sent_dbm: Floats, piconets: Piconets) -> None:
        self._air, self._kernel, self._piconets = air, kernel, piconets
        self._sent_mw = elementary.exp10s(np.asarray(sent_dbm, np.float64) / 10.0).tolist()
        self.number = air.join(self)
        """Its number in the air."""
        self.seats: Seats | None = None
        """Where devices ask before they send, if arbiters divide the air between a robot's radios."""
        self._decided: Time = 0
        """Instant up to which the fates of idle frames are decided."""
        self._following = False
        """True while piconets are advanced for the air's sake: nothing is decided, so what begins next is as it was."""
        self._touched: Time = 0
        """Instant at which something was last decided, or may have been."""
        self._quiet_until: Time = 0
        """Instant before which nothing begins by itself, for all that is decided; 0 if that is not known."""
        self._ids_told: Time = 0
        self._next_id: Int64s = np.empty((1, 2), np.int64)  # start and channel
        self.alone = True
        """True if nobody else sends anything: then nobody is told anything."""
        begun = np.zeros((ROOM + 2 * len(self._sent_mw), BEGUN_FIELDS), np.int64)
        self._nobody = jamming((), len(self._sent_mw))._replace(tenant=self.number, begun=begun)

    def heard(self, jammers: Foreign | None) -> Foreign:
        """Return what kernels need to judge frames: *jammers*, and what others have told."""
        of_air = self._nobody._replace(table=self._air.band.table)
        return of_air if jammers is None else of_air._replace(sent=jammers.sent, power_mw=jammers.power_mw)

    def arbitrate(self, seats: Seats) -> None:
        """Have devices ask at *seats* before they send, and be deaf while another radio of their robot sends."""
        self.seats = seats
        self._nobody = self._nobody._replace(arbitrated=True)

    # ------------------------------------------------------------ what is told

    def tell(self, source: Address, start: Time, end: Time, channel: int) -> None:
        """Tell the air of a frame."""
        centre = STEPS_PER_MHZ * (LOWEST_MHZ + channel)
        self._air.tell(Emission(start, end, CLASSIC, centre, source, self.number, self._sent_mw[source]))

    def tell_begun(self) -> bool:
        """Tell the air of the idle frames that have begun; return whether there was no more room for them."""
        count, begun = int(self._nobody.noted[0]), self._nobody.begun
        self._nobody.noted[0] = 0
        for start, source, channel in begun[:count].tolist():
            self.tell(source, start, start + HEADER_AIR, channel)
        return count + 1 >= len(begun)

    def gather(self, until: Time) -> None:
        """Have all others tell what they have begun to send before *until*: frames that end then are to be judged."""
        assert not self.alone
        self._decided = max(self._decided, until)
        self._air.band.gather(until, self.number)
        if not self._following:
            self._touched, self._quiet_until = self._kernel.now, 0
            self._air.reconsider_soon()

    def review(self) -> None:
        """Have others notice if Bluetooth has begun, or ceased, to send."""
        self._air.review()

    def _tell_ids(self, until: Time) -> None:
        """Tell the air of the IDs that begin before *until*."""
        since, self._ids_told = self._ids_told, max(self._ids_told, until)
        for train in self._piconets.medium.trains:
            begin, found = since, np.empty((_IDS, 2), np.int64)
            while count := list_ids(train, begin, until, found):
                for start, channel in found[:count].tolist():
                    self.tell(int(train["sender"]), start, start + ID_AIR, channel)
                begin = int(found[count - 1, 0]) + 1

    # ------------------------------------------------------------ as a tenant of the air

    @property
    def asks_from(self) -> Time:
        """Instant from which it may still ask for what disturbs frames."""
        return self._kernel.now if self.alone else self._decided - _ASKED

    @property
    def silent(self) -> bool:
        """True if there are neither links nor trains."""
        band = self._piconets.band
        running, _ = senders(band.piconets, band.links)
        return not running and not len(self._piconets.medium.trains)

    def others_changed(self, alone: bool) -> None:
        """Judge frames by themselves while nobody else sends, and tell what has been on the air of late after that."""
        now, piconets = self._kernel.now, self._piconets
        piconets.advance(now)
        frames = () if alone else sorted(self._recent(max(now - MEMORY, 0)))
        self.alone, self._decided, self._ids_told = alone, now, max(self._ids_told, now - MEMORY)
        piconets.neighbours = None if alone else self
        for frame in frames:
            self.tell(*frame)
        if not alone:
            self._tell_ids(now)
        piconets.changed(now)
        if self.punctual:
            self._note_begun(now)
            self._air.reconsider_soon()

    def _recent(self, since: Time) -> set[_Frame]:
        """Return the frames, but not IDs, that were on the air after *since*.

        Of the idle frames of a piconet that was alone these are those that were received, without a pair under way.
        """
        band, rings = self._piconets.band, enumerate(self._piconets.medium.frames.tolist())
        found: set[_Frame] = {(source, *frame) for source, ring in rings for frame in ring if frame[1] > since}
        found |= {frame for frame in self._piconets.sent if frame[2] > since}
        known = {(source, end) for source, _, end, _ in found}
        for master, (piconet, links) in enumerate(zip(band.piconets.tolist(), band.links, strict=True)):
            clock, pair = (piconet[PHASE], piconet[PPM]), piconet[PAIR_TICK]
            under_way = {start_of(*clock, tick) for tick in (pair, pair + 2) if piconet[STAGE]}
            for heard in (HEARD_DOWN, HEARD_UP):
                for k, end in enumerate(links[heard].tolist()):
                    source, start = int(links[SLAVE, k]) if heard == HEARD_UP else master, end - HEADER_AIR
                    if end > since and (source, end) not in known and start not in under_way:
                        channel = self._piconets.channel(master, tick_at(*clock, start))
                        found.add((source, start, end, channel))
        return found

    @property
    def attentive(self) -> bool:
        """False: Bluetooth never listens before it talks."""
        return False

    def hear(self, emission: Emission) -> None:
        """Do nothing."""

    def catch_up(self, until: Time) -> None:
        """Tell the air of all that begins before *until*, unless nobody hears it."""
        if self.alone or until <= self._quiet_until:
            return
        self._follow(until, until - 1)
        self._tell_ids(until)
        if self._kernel.now > self._touched:
            # not for ever: what was on the air is remembered for as long as it may be asked for
            self._quiet_until = min(self.begins_after(until - 1), until + _ASKED)

    def begins_after(self, time: Time) -> Time:
        """Return an instant after *time* before which nothing begins by itself.

        Where it is punctual nothing ends by itself before that, either: what is said to an arbiter between two such
        instants does not depend on when piconets were advanced.
        """
        band = self._piconets.band
        soonest = next_start(band.piconets, band.links)
        if self.punctual:
            polls = [int(time_of(row, row[PAIR_TICK])) for row in band.piconets if row[STAGE] == 1]
            soonest = min([soonest, *(start + HEADER_AIR for start in polls)])
        for train in self._piconets.medium.trains:
            if list_ids(train, max(self._ids_told, time + 1), NEVER, self._next_id):
                soonest = min(soonest, int(self._next_id[0, 0]))
        return max(soonest, time + 1)

    def send_due(self, now: Time) -> None:
        """Tell the air of what begins *now*."""
        if self.seats is not None:
            self._ask_for_polls(self.seats, now)
            self._ask_for_ids(self.seats, now)
        self._follow(now + 1, now)
        self._tell_ids(now + 1)

    def _follow(self, now: Time, last_end: Time) -> None:
        self._following = True
        self._piconets.advance(now, last_end)
        self._following = False

    # ------------------------------------------------------------ what arbiters are asked

    @property
    def punctual(self) -> bool:
        """True if devices ask for what they send by themselves as it begins: others use the air as well."""
        return self.seats is not None and not self.alone

    def _ask_for_polls(self, seats: Seats, now: Time) -> None:
        """Ask for the idle pairs that are to begin *now*, at both ends; a master that is refused skips slots."""
        self._piconets.advance(now)
        band = self._piconets.band
        found = np.empty((len(band.piconets), 2), np.int64)
        for master, k in found[: polls_at(band.piconets, band.links, now, found)].tolist():
            piconet, links = band.piconets[master], band.links[master]
            tick, _ = next_poll(piconet, links, links[DUE], int(piconet[NEXT]))
            end = int(time_of(piconet, tick + 2)) + HEADER_AIR
            until = seats.refused_until(master, end, seats.rank(piconet, links, k, HEARD_UP, False, now))
            if until is not None:
                piconet[NEXT] = first_slot_at(piconet, until)
                continue
            slave = int(links[SLAVE, k])
            hears = self._piconets.reaches(self._piconets.carrier(master, slave))
            if hears and links[HERE, k] and links[JOINED, k]:
                until = seats.refused_until(slave, end, seats.rank(piconet, links, k, HEARD_DOWN, False, now))
            self._nobody.held[slave] = until or 0

    def _ask_for_ids(self, seats: Seats, now: Time) -> None:
        """Ask for the IDs that are to begin *now*; a train is silent until the other radio's use is over."""
        for train in self._piconets.medium.trains:
            if list_ids(train, now, now + 1, self._next_id):
                sender = int(train["sender"])
                until = seats.ask_for_id(sender)
                if until is not None:
                    self._piconets.silence_train(sender, now, until)

    def _note_begun(self, now: Time) -> None:
        """Note what is on the air *now*: nobody has been asked for it, as no other radio had anything to say."""
        band, seats = self._piconets.band, self.seats
        assert seats is not None
        for master, (piconet, links) in enumerate(zip(band.piconets, band.links, strict=True)):
            if piconet[STAGE]:
                end = int(time_of(piconet, piconet[PAIR_TICK] + 2)) + HEADER_AIR
                seats.begin(master, end)
                if piconet[PAIR_HERE]:
                    seats.begin(int(links[SLAVE, piconet[PAIR_LINK]]), end)
        for train in self._piconets.medium.trains:
            if list_ids(train, now - ID_AIR, now, self._next_id):
                seats.begin(int(train["sender"]), int(self._next_id[0, 0]) + ID_AIR)
