"""What the radios of Bluetooth devices do, ns by ns, for the energy that it takes.

A radio transmits while a frame of it is on the air. It receives while a frame is on the air that it listens for and
that is strong enough to be noticed, whether it makes anything of it or not:

- the packets of a piconet for it, and those for all; of its master's packets for others access code and header only,
- the frames of an inquiry or a page for it; of the IDs of trains those that it hears.

It is idle, and listens without receiving,

- as a slave, at every slot at which its master may send to it, as long as an access code takes: that is every other
  slot, in hold none, in sniff mode and parked those of its windows, with divided time those of its part in which there
  is room for a packet and the longest answer, and away none. In slots that a packet which it has heard has reserved for
  itself, or an own one, it has nothing to listen for,
- as a master, in the slot after what it has sent to one slave, as long as an access code takes,
- in inquiry and page in every other slot, the one after its two IDs, to the end; while it answers a page, is answered,
  or waits for the second ID of an inquiry it listens whenever it does not send,
- in the windows of its scans.

Else it is asleep, also between the two IDs of a slot, in the back-off of an inquiry and during packets for others. The
uncertainty of slots (10 us either way) is left out, as clocks of members are in step here.

Nothing is scheduled for this. Kernels log the idle packets that they send; windows, slots and trains follow from
arithmetic, and are counted when somebody asks. What a frame is to its receiver may be known only at its end.
"""

from collections.abc import Callable, Iterable, Iterator
from typing import Final, NamedTuple, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cosim.arrays import Int64s
from cosim.channels.bluetooth import polling
from cosim.channels.bluetooth.band import LOG_FIELDS, Band
from cosim.channels.bluetooth.medium import GAPS, NOT_TUNED, OUT_OF_RANGE, Medium
from cosim.channels.bluetooth.packets import HEADER_AIR, ID_AIR
from cosim.channels.bluetooth.polling import EVERYONE, HERE, JOINED, NOTHING, SLAVE
from cosim.channels.clock import NativeClock
from cosim.channels.energy import IDLE, OFF, RECEIVE, SLEEP, TRANSMIT, Use, Uses
from cosim.machine import Address
from cosim.units import MS, S, Time

LOG_ROWS: Final = 4096
"""Number of idle packets that are logged at once."""
_AT_ONCE: Final[Time] = 10 * S
"""Longest time that is counted at once."""
_LATE: Final[Time] = 4 * MS
"""Longest time after the start of a frame at which it becomes known what it is to its receiver."""
_LISTENING: Final = ("inquiry_scan", "page_scan", "inquiry_response", "page_response")
"""The states of intervals in which a radio listens whenever it does not send."""

_Flags: TypeAlias = NDArray[np.bool_]
Parked: TypeAlias = tuple[Address, Address, int, int]
"""(master, slave, ticks from one beacon window to the next, ticks of a window)"""

# what a radio does, the first that holds; _PASSED are slots in which a slave has nothing to listen for
_OFF, _TRANSMIT, _RECEIVE, _LISTEN, _PASSED, _ATTEND = range(6)
_STATES: Final = (OFF, TRANSMIT, RECEIVE, IDLE, SLEEP, IDLE, SLEEP)


class OnAir(Protocol):
    """What is on the air."""

    band: Band
    medium: Medium
    least_dbm: float
    """Power from which on a receiver notices a frame."""


class _Attention(NamedTuple):
    """The slots at which a slave listens to its master."""

    master: Address
    slave: Address
    k: int
    """LT_ADDR; NOTHING if it is parked."""
    clock: NativeClock
    """The master's."""
    held_until: int = 0
    """Its first tick."""
    window: tuple[int, int, int] = (0, 0, 0)
    """(period, first tick, number of ticks) on the master's clock; period 0: all."""
    part: tuple[int, int, int] = (0, 0, 0)
    """The same for slots with room for a packet and an answer, on the clock that its time is divided by."""
    divider: NativeClock = NativeClock(0)

    def slots(self, since: Time, until: Time) -> Int64s:
        """Return the instants from *since* on and before *until* at which it listens."""
        first, end = (-(-(self.clock.tick(time - 1) + 1) // 4) * 4 for time in (since, until))
        ticks = np.arange(first, end, 4, dtype=np.int64)
        starts = self.clock.times_of(ticks)
        return starts[self.listens(ticks, starts)]

    def listens(self, ticks: Int64s, starts: Int64s) -> _Flags:
        """Return at which of these TX slots it listens."""
        flags: _Flags = ticks >= self.held_until
        if self.window[0]:
            period, first, count = self.window
            flags &= (ticks - first) % period < count
        if self.part[0]:
            period, first, count = self.part
            flags &= (self.divider.ticks_at(starts) - first) % period < count
        return flags


class _Phase(NamedTuple):
    """What holds from *since* on: who listens to whom, and who is in whose reach, shape (n, n)."""

    since: Time
    attentions: tuple[_Attention, ...]
    reach: _Flags


class _Doings:
    """What one radio does."""

    def __init__(self) -> None:
        self._times = [0] * len(_STATES)
        self._settled: Time = 0
        """Instant before which all is in the times, by rank."""
        self._few: list[tuple[Time, Time, int]] = []
        self._many: list[Int64s] = []
        """(start, end, rank) of what is not, or not wholly."""
        self._off_since: Time | None = None

    def note(self, start: Time, end: Time, rank: int) -> None:
        """Note what it does in [*start*, *end*)."""
        self._few.append((start, end, rank))

    def note_all(self, starts: Int64s, ends: Int64s, rank: int) -> None:
        """Note many of these."""
        if len(starts):
            self._many.append(np.stack((starts, ends, np.full(len(starts), rank, dtype=np.int64)), axis=1))

    def switch(self, now: Time, on: bool) -> None:
        """Note that it is switched on or off *now*."""
        if on and self._off_since is not None:
            self.note(self._off_since, now, _OFF)
        self._off_since = None if on else now

    def times(self, until: Time) -> list[Time]:
        """Return how long it has done what before *until*, by rank and at last nothing."""
        return self._added(self._noted(), until)

    def settle(self, until: Time) -> None:
        """Forget what was before *until*, but for the times."""
        rows = self._noted()
        self._times, self._settled = self._added(rows, until), until
        self._few, self._many = [], [rows[rows[:, 1] > until]]

    def _noted(self) -> Int64s:
        few = np.array(self._few, dtype=np.int64).reshape(-1, 3)
        return np.concatenate((few, *self._many))

    def _added(self, rows: Int64s, until: Time) -> list[Time]:
        """Return the times with those of *rows* from the last settlement to *until*: of what overlaps, the first."""
        since, times, covered = self._settled, [*self._times], 0
        if self._off_since is not None:
            rows = np.concatenate((rows, [(self._off_since, until, _OFF)]))
        rows = rows[np.argsort(rows[:, 0], kind="stable")]
        starts, ends = np.clip(rows[:, :2], since, until).T
        for rank in range(_ATTEND + 1):
            chosen = rows[:, 2] <= rank
            before, covered = covered, _length(starts[chosen], ends[chosen])
            times[rank] += covered - before
        times[-1] += until - since - covered
        return times


def _length(starts: Int64s, ends: Int64s) -> Time:
    """Return how much time lies in at least one of the spans from *starts*, ascending, to *ends*."""
    if not len(starts):
        return 0
    over = np.maximum.accumulate(ends)
    begins = starts.copy()
    begins[1:] = np.maximum(starts[1:], over[:-1])
    return int(np.maximum(over - begins, 0).sum())


class Meter:
    """The meters of all devices on one *air*, from the beginning of the run on."""

    def __init__(self, air: OnAir, tell: Callable[[Time], None], parked: Callable[[], Iterable[Parked]]) -> None:
        """*tell* has :meth:`listened` called with all that is over at an instant; *parked* returns who is parked."""
        self.log: Int64s = np.empty((LOG_ROWS, LOG_FIELDS), dtype=np.int64)
        """The log of ``band``."""
        self._air = air
        self._tell = tell
        self._parked = parked
        self._devices = [_Doings() for _ in air.medium.power_dbm]
        self._phases = [_Phase(0, (), self._reach())]
        self._packets: list[tuple[Address, int, int, Time, int]] = []
        """(master, tick, LT_ADDR, duration, slots) of masters' packets."""
        self._idle: list[Int64s] = []
        """Rows of the log of idle packets, each with the slave."""
        self._counted: Time = 0
        """Instant before which slots, windows and IDs are noted."""
        self._ids_counted: Time = 0
        self._settled: Time = 0

    # ------------------------------------------------------------ what is noted

    def switch(self, device: Address, now: Time, on: bool) -> None:
        """Note that *device* is switched on or off *now*."""
        self._devices[device].switch(now, on)

    def sent(self, source: Address, start: Time, end: Time) -> None:
        """Note a frame of *source*."""
        self._devices[source].note(start, end, _TRANSMIT)

    def received(self, receiver: Address, start: Time, end: Time) -> None:
        """Note a frame that *receiver* has received."""
        self._devices[receiver].note(start, end, _RECEIVE)

    def listened(self, device: Address, start: Time, end: Time, state: str) -> None:
        """Note an interval of *device* in a *state*, or a part of one."""
        if state in _LISTENING:
            self._devices[device].note(start, end, _LISTEN)

    def asked(self, master: Address, tick: int, k: int, duration: Time, slots: int) -> None:
        """Note a packet of *master* to its link *k*, or to all, that begins at *tick* and reserves so many *slots*."""
        self._packets.append((master, tick, k, duration, slots))

    def answered(self, slave: Address, start: Time, over: Time) -> None:
        """Note an answer of *slave*, which has reserved the slots before *over*."""
        self._devices[slave].note(start, over, _PASSED)

    def take(self, log: Int64s) -> None:
        """Note idle packets, of the log of ``band``, in the order of their ends; all before are known."""
        links, (master, tick, k) = self._air.band.links, log[:, :3].T
        self._idle.append(np.column_stack((log, links[master, SLAVE, k])))
        last = self._clock(int(master[-1])).time_of(int(tick[-1])) - HEADER_AIR
        if last - self._counted >= _AT_ONCE:
            self._count(last)

    def changed(self, now: Time) -> None:
        """Note that devices may listen, or reach each other, as they did not before *now*."""
        phase, before = _Phase(now, tuple(self._attentions()), self._reach()), self._phases[-1]
        if phase.attentions == before.attentions and np.array_equal(phase.reach, before.reach):
            return
        if before.since == now:
            self._phases.pop()
        self._phases.append(phase)

    def count_ids(self, now: Time) -> None:
        """Note the IDs that begin before *now*, and the slots after them: trains change."""
        since, self._ids_counted = self._ids_counted, max(self._ids_counted, now)
        for train in self._air.medium.trains:
            begin, end = max(since, int(train["since"])), min(now, int(train["until"]))
            if begin >= end:
                continue
            device, clock = self._devices[train["sender"]], NativeClock(int(train["phase"]), int(train["ppm"]))
            ticks = np.arange(clock.tick(begin) - 2, clock.tick(end) + 1, dtype=np.int64)
            starts = clock.times_of(ticks[ticks & 2 == 0])
            starts = starts[(starts >= begin) & (starts < end)]
            for gap in range(GAPS):
                starts = starts[(starts < train["silent_since"][gap]) | (starts >= train["silent_until"][gap])]
            device.note_all(starts, starts + ID_AIR, _TRANSMIT)
            slots = ticks[ticks & 3 == 2]
            opens, closes = (np.clip(clock.times_of(each), begin, end) for each in (slots, slots + 2))
            device.note_all(opens, closes, _LISTEN)

    # ------------------------------------------------------------ what is asked

    def uses(self, device: Address, now: Time) -> Uses:
        """Return how long the radio of *device* has done what before *now*; all piconets have been advanced to it."""
        self._count(now)
        times: dict[Use, Time] = {}
        for state, time in zip(_STATES, self._devices[device].times(now), strict=True):
            if time:
                times[Use(state)] = times.get(Use(state), 0) + time
        return times

    # ------------------------------------------------------------ what follows

    def _clock(self, master: Address) -> NativeClock:
        phase, ppm = self._air.band.piconets[master, [polling.PHASE, polling.PPM]].tolist()
        return NativeClock(phase, ppm)

    def _reach(self) -> _Flags:
        reach: _Flags = self._air.medium.power_dbm >= self._air.least_dbm
        return reach

    def _attentions(self) -> Iterator[_Attention]:
        """Yield who listens to whom."""
        links, piconets = self._air.band.links, self._air.band.piconets
        for master, k in zip(*np.nonzero(links[:, JOINED, 1:] & links[:, HERE, 1:]), strict=True):
            link, need = links[master, :, k + 1].tolist(), 2 * (1 + int(piconets[master, polling.LONGEST]))
            yield _Attention(
                int(master),
                link[SLAVE],
                int(k) + 1,
                self._clock(master),
                link[polling.HELD_UNTIL],
                (link[polling.SNIFF_PERIOD], link[polling.SNIFF_FIRST], link[polling.SNIFF_COUNT]),
                (link[polling.PERIOD], link[polling.FIRST], link[polling.COUNT] - need + 1),
                NativeClock(link[polling.CLOCK_PHASE], link[polling.CLOCK_PPM]),
            )
        for master, slave, period, window in self._parked():
            yield _Attention(master, slave, NOTHING, self._clock(master), window=(period, 0, window))

    def _count(self, now: Time) -> None:
        """Note all that follows from arithmetic before *now*."""
        self._count_packets()
        while self._counted < now:
            until = min(now, self._counted + _AT_ONCE)
            self._tell(until)
            self.count_ids(until)
            self._count_slots(until)
            self._counted = until
            if until - self._settled > _AT_ONCE + _LATE:
                self._settled = until - _LATE
                for device in self._devices:
                    device.settle(self._settled)
        while len(self._phases) > 1 and self._phases[1].since < self._counted - _LATE:
            del self._phases[0]

    def _spans(self) -> Iterator[tuple[_Phase, Time]]:
        """Yield the phases, each with its end."""
        ends = [*(phase.since for phase in self._phases[1:]), polling.NEVER]
        return zip(self._phases, ends, strict=True)

    def _count_slots(self, until: Time) -> None:
        """Note the slots before *until* at which slaves listen."""
        for phase, end in self._spans():
            since, over = max(phase.since, self._counted), min(end, until)
            if since < over:
                for attention in phase.attentions:
                    starts = attention.slots(since, over)
                    self._devices[attention.slave].note_all(starts, starts + ID_AIR, _ATTEND)

    def _count_packets(self) -> None:
        """Note who has sent and who has received the packets of piconets, but for answers with a payload."""
        if not self._packets and not self._idle:
            return
        idle = np.concatenate((np.empty((0, 6), dtype=np.int64), *self._idle))
        few = np.array(self._packets, dtype=np.int64).reshape(-1, 5)
        self._packets, self._idle = [], []
        polls, nulls = idle[idle[:, 3] == 0], idle[idle[:, 3] == 1]
        of_poll = np.broadcast_to((HEADER_AIR, 1), (len(polls), 2))
        packets = np.concatenate((few, np.column_stack((polls[:, :3], of_poll))))
        for master in np.unique(packets[:, 0]).tolist():
            self._count_asked(master, *packets[packets[:, 0] == master, 1:].T)
        for master in np.unique(nulls[:, 0]).tolist():
            self._count_nulls(master, nulls[nulls[:, 0] == master])

    def _count_asked(self, master: Address, ticks: Int64s, ks: Int64s, durations: Int64s, slots: Int64s) -> None:
        clock = self._clock(master)
        starts, overs = clock.times_of(ticks), clock.times_of(ticks + 2 * slots)
        self._devices[master].note_all(starts, starts + durations, _TRANSMIT)
        answers = overs[ks != EVERYONE]
        self._devices[master].note_all(answers, answers + ID_AIR, _LISTEN)
        for phase, end in self._spans():
            now = (starts >= phase.since) & (starts < end)
            for attention in phase.attentions if now.any() else ():
                slave = attention.slave
                if attention.master != master or not phase.reach[master, slave]:
                    continue
                heard = now & attention.listens(ticks, starts)
                whole = (ks == attention.k) | (ks == EVERYONE)
                ends = starts + np.where(whole, durations, HEADER_AIR)
                self._devices[slave].note_all(starts[heard], ends[heard], _RECEIVE)
                reserved = heard & (slots > 1)
                self._devices[slave].note_all(starts[reserved], overs[reserved], _PASSED)

    def _count_nulls(self, master: Address, nulls: Int64s) -> None:
        starts = self._clock(master).times_of(nulls[:, 1])
        heard = starts[(nulls[:, 4] != OUT_OF_RANGE) & (nulls[:, 4] != NOT_TUNED)]
        self._devices[master].note_all(heard, heard + HEADER_AIR, _RECEIVE)
        for slave in np.unique(nulls[:, 5]).tolist():
            own = starts[nulls[:, 5] == slave]
            self._devices[slave].note_all(own, own + HEADER_AIR, _TRANSMIT)
