"""A connected piconet: one master, up to seven slaves, time division duplex.

The master transmits in slots that start where 4 divides its tick; only the slave that it addresses answers, in the next
slot. At every free TX slot the master serves the link whose poll is overdue, else the head of its queue, else no link.
Each device has one queue, strictly first in, first out, broadcasts among the rest. (Core v1.2, Vol 2 Part B, sections
4.5, 7 and 8.)

What is sent in a slot pair is decided at its start, in the kernel's phase AIR, with what is queued and received at that
instant. What becomes of a frame is decided at its end. Kernel events exist only for slots with a payload in them and
for supervision time-outs; idle polls are a loop over arrays, run for all piconets together when it is needed
(``band``).

Link supervision (section 3.1): a side that has heard nothing for too long takes the link for lost.

Automatic flush: a payload that has not been acknowledged a given time after it was queued leaves the queue at the next
TX slot boundary, when nothing that concerns it is on the air. SEQN has one bit, so a receiver could take the payload
behind it for its repetition: the two sides settle that when they flush (the time that this takes is neglected), and the
next payload is new. Broadcasts, which are not acknowledged, do not expire.
"""

from collections.abc import Callable

from cosim.channels.air.arbitration import Rank
from cosim.channels.bluetooth import polling
from cosim.channels.bluetooth.afh import Adaptation
from cosim.channels.bluetooth.links import Links, Memberships, Parking, Presence
from cosim.channels.bluetooth.modes import Modes
from cosim.channels.bluetooth.packets import smallest
from cosim.channels.bluetooth.polling import (
    ARQN,
    EVERYONE,
    HEARD_DOWN,
    HEARD_UP,
    HELD,
    HERE,
    JOINED,
    MOST_SLAVES,
    NEXT,
    NOTHING,
    RUNNING,
    SEEN_DOWN,
    SEEN_UP,
    SEQ_DOWN,
    SEQ_UP,
)
from cosim.channels.bluetooth.queues import LinkEvents, Payload, Queues, fate
from cosim.channels.bluetooth.radio import Radio
from cosim.channels.bluetooth.scanning import first_transmission
from cosim.channels.bluetooth.slots import Slots
from cosim.channels.bluetooth.state import SCHEDULERS, Deliver, PiconetSettings, PiconetState
from cosim.channels.bluetooth.transport import Transport
from cosim.kernel import WAKE, Handle
from cosim.machine import BROADCAST, Address, Lost, Outcome, Outgoing
from cosim.units import Time


class Piconet:
    """The links of the master that *radio* belongs to, and the payloads that wait on either side of them."""

    def __init__(
        self,
        radio: Radio,
        settings: PiconetSettings,
        deliver: Deliver,
        on_lost: Callable[[Address, Address], None] = lambda side, peer: None,
        transport: Transport | None = None,
    ) -> None:
        """*on_lost* is called with (side, peer) before the side's host learns that its link is lost.

        Payloads reach hosts through *transport*, if there is one, else by *deliver* at once.
        """
        kernel, air, identity = radio.kernel, radio.air, radio.identity
        address, clock, scheduler = identity.address, identity.clock, SCHEDULERS[settings.scheduler]
        piconet, table = air.band.piconets[address], air.band.links[address]
        longest = max(kind.slots for kind in settings.types)
        polling.reset(piconet, table, settings.t_poll_slots, clock.phase, clock.ppm, longest)
        piconet[polling.MASTER], piconet[polling.WORD] = address, identity.hop_address
        piconet[polling.SCHEDULER] = scheduler
        self.address = address
        self.clock = clock
        self.links = Links(address, piconet, table, transport, Memberships(address, radio.courses.intervals))
        self._kernel = kernel
        self._air = air
        self._settings = settings
        self._deliver = deliver
        self._on_lost = on_lost
        self._queues = Queues(table, scheduler, radio.payloads, lambda: kernel.now)
        self.parking = Parking(self.links, settings.park_interval_slots, settings.park_window_slots)
        state = PiconetState(kernel, air, clock, settings, self.links, self.parking, self._queues, deliver)
        self._report = state.report
        self.modes = Modes(state, self._changed)
        self._slots = Slots(state, self.modes.beacon_heard)
        self._adaptation: Adaptation | None = None
        if settings.afh is not None:
            interval, retry = settings.afh
            self._adaptation = Adaptation(state, interval, retry)
        self._timeout: Handle | None = None
        """The earliest supervision time-out of all sides of all links, parked slaves included."""
        self._expiry: Handle | None = None
        """The next automatic flush."""

    # ------------------------------------------------------------ links

    def members(self) -> tuple[Address, ...]:
        """Return the slaves whose link the master takes to be up, by LT_ADDR."""
        return tuple(self.links.slaves[k] for k in self.links.held())

    def free_lt_addr(self) -> int | None:
        """Return the smallest LT_ADDR that no side of a link uses, or None."""
        return self.links.free_lt_addr()

    def linked(self, slave: Address) -> bool:
        """Return whether either side takes *slave* for a member, parked or not."""
        return slave in self.links.lt_addr or self.parking.number(slave) is not None

    def join(self, slave: Address, lt_addr: int) -> None:
        """Bring the side of *slave* up: it has received the first POLL now."""
        self.advance(self._kernel.now)
        self.links.join(slave, lt_addr, self._kernel.now)
        self._changed()

    def admit(self, slave: Address, due: int) -> None:
        """Bring the master's side up: it has heard *slave* now; the next packet to it is due at the tick *due*."""
        self.advance(self._kernel.now)
        self.links.admit(self.links.lt_addr[slave], due, self._kernel.now)
        self._changed()

    def _changed(self) -> None:
        self._air.changed(self._kernel.now)
        self._watch()
        self._slots.arm()
        if self._adaptation is not None:
            self._adaptation.wake()

    def hand_over(self, slave: Address, other: "Piconet") -> LinkEvents:
        """Turn the link to *slave* round: from now on it belongs to *other*, the slave's piconet, with all that waits.

        Return the fates of broadcasts, which are flushed. To be called between two slot pairs.
        """
        k = self.links.lt_addr[slave]
        bits = [int(self.links.table[row, k]) for row in (SEQ_UP, SEEN_UP, SEQ_DOWN, SEEN_DOWN)]
        down, up = self._queues.take(EVERYONE), self._queues.take(k)
        for side in (HELD, JOINED):
            self.links.take_down(k, side, self._kernel.now)
        self._changed()
        other.resume()
        other.add_slave(self.address, 1, int(other.links.piconet[NEXT]))
        other.links.table[[SEQ_DOWN, SEEN_DOWN, SEQ_UP, SEEN_UP], 1] = bits
        other._take_over([payload for payload in down if payload.lt_addr != EVERYONE], up)
        return self._queues.fates([payload for payload in down if payload.lt_addr == EVERYONE], self.address)

    def _take_over(self, up: list[Payload], down: list[Payload]) -> None:
        """Queue what waits on a link that has been turned round to LT_ADDR 1, in its slave (*up*) and here (*down*)."""
        for payload in (*up, *down):
            payload.lt_addr = 1
        for queue, payloads in ((1, up), (EVERYONE, down)):
            for payload in payloads:
                self._push(queue, payload)

    def add_slave(self, slave: Address, lt_addr: int, due: int) -> None:
        """Bring both sides of a link up now, without a page."""
        self.join(slave, lt_addr)
        self.admit(slave, due)

    def close(self, side: Address, peer: Address) -> None:
        """End the link between *side* and *peer* at once on its own side and, if it is in reach, on the other.

        The time that the detach message takes is neglected. A peer out of reach finds out by supervision.
        """
        self.advance(self._kernel.now)
        from_master = side == self.address
        k = self._number(peer if from_master else side)
        if k is None or self.address not in (side, peer):
            return
        heard = self._air.reaches(self._air.carrier(side, peer))
        events = self._drop(k, HELD) if from_master or heard else []
        events += self._drop(k, JOINED) if heard or not from_master else []
        self._slots.arm()
        self._report(events)

    def vanish(self, device: Address) -> None:
        """Take *device*, whose radio is switched off, out of the piconet; its peers find out by supervision."""
        self.advance(self._kernel.now)
        k = self._number(device)
        if device == self.address:
            for held in (*self.links.held(), *self.parking.members):
                self._drop(held, HELD)
        elif k is not None:
            self._drop(k, JOINED)
        self._slots.arm()

    def _number(self, slave: Address) -> int | None:
        """Return the LT_ADDR of a slave, or its number if it is parked."""
        return self.links.lt_addr.get(slave, self.parking.number(slave))

    # ------------------------------------------------------------ time

    def advance(self, now: Time) -> None:
        """Decide all slots before *now*, which must be done before anything is changed or read."""
        self._air.advance(now)

    def set_presence(self, device: Address, presence: Presence) -> None:
        """Note when *device*, the master or a slave, is there from now on."""
        self.advance(self._kernel.now)
        self.links.memberships.change_presence(device, presence, self._kernel.now)
        parked = self.parking.number(device)
        if parked is None:
            self.links.set_presence(device, presence)
        else:
            self.parking.members[parked].presence = presence
        self._air.changed(self._kernel.now)
        self._slots.arm()

    def suspend(self) -> None:
        """Use no more slots from now on: the master inquires or pages."""
        self.advance(self._kernel.now)
        self.links.piconet[RUNNING] = 0
        self.links.memberships.suspend(True, self._kernel.now)
        self._air.changed(self._kernel.now)
        self._slots.arm()

    def resume(self) -> None:
        """Use slots again, from the first TX slot at or after now."""
        self.advance(self._kernel.now)
        self.links.piconet[RUNNING] = 1
        self.links.memberships.suspend(False, self._kernel.now)
        self._air.changed(self._kernel.now)
        first = first_transmission(self.clock, self._kernel.now)
        self.links.piconet[NEXT] = max(int(self.links.piconet[NEXT]), first)
        self._slots.arm()

    def pair_ends(self) -> Time | None:
        """Return when the slot pair under way ends, or None if there is none. To be called before the phase AIR."""
        self.advance(now := self._kernel.now)
        free = int(self.links.piconet[NEXT])
        return self.clock.time_of(free) if free > first_transmission(self.clock, now) else None

    def boundary(self) -> Time:
        """Return the start of the first TX slot that is not decided yet: nothing is on the air then."""
        self.advance(self._kernel.now)
        return self.clock.time_of(int(self.links.piconet[NEXT]))

    def next_pause(self) -> Time | None:
        """Return None if the piconet may be suspended for a procedure that starts now: no slot under way, no link due.

        Otherwise return the start of the next TX slot, at which to call again. To be called before the phase AIR.
        """
        now = self._kernel.now
        self.advance(now)
        tick = first_transmission(self.clock, now)
        free = int(self.links.piconet[NEXT])
        if free <= tick and polling.overdue(self.links.piconet, self.links.table, tick) == NOTHING:
            return None
        return self.clock.time_of(free if free > tick else tick + 4)

    def planned_until(self, device: Address, start: Time, end: Time, rank: Rank) -> Time | None:
        """Return the end of the next pair in [start, end) that is more to *device*, its master or a slave, than *rank*.

        What there is to say, and how soon a link is lost, is as it is known now; all slots before now are decided. None
        if there is no such pair.
        """
        links = self.links
        if not links.piconet[RUNNING]:
            return None
        if device == self.address:
            ends = [self._slots.own_until(start, end)] if rank < Rank.DATA else []
            ends += [self._slots.turn_until(k, HEARD_UP, start, end, rank) for k in links.held()]
        else:
            k = links.lt_addr.get(device, NOTHING)
            there = links.up(k, JOINED) and links.table[HERE, k]
            ends = [self._slots.turn_until(k, HEARD_DOWN, start, end, rank)] if there else []
        return max((each for each in ends if each is not None), default=None)

    def counts(self) -> dict[str, int]:
        """Return the number of frames sent so far by packet type, and of polls without a payload on either side."""
        self.advance(self._kernel.now)
        piconet = self.links.piconet
        polls = {"POLL": piconet[polling.POLLS], "NULL": piconet[polling.NULLS], "idle": piconet[polling.IDLE]}
        return {**self._slots.frames, **{name: int(count) for name, count in polls.items()}}

    # ------------------------------------------------------------ payloads

    def send(self, source: Address, outgoing: Outgoing) -> Outcome | None:
        """Queue a payload at *source*, the master or a slave, or return why not; the fate also comes as a new event."""
        settings, length = self._settings, len(outgoing.payload)
        queue, lt_addr = self._route(source, outgoing.destination)
        kind = smallest(settings.types, length)
        if lt_addr == NOTHING:
            why = Outcome.NO_LINK
        elif kind is None:
            why = Outcome.TOO_LONG
        elif settings.queue is not None and self._queues.length(queue) >= settings.queue:
            why = Outcome.QUEUE_FULL
        else:
            payload = Payload(lt_addr, outgoing, kind, kind.air_time(length), self._kernel.now)
            if self._queues.payloads is not None:
                self._queues.payloads.accept(payload, source, outgoing.destination, length, payload.queued)
            self._push(queue, payload)
            return None
        self._report(fate(source, outgoing, why))
        return why

    def _push(self, queue: int, payload: Payload) -> None:
        """Append *payload* to a queue."""
        piconet, now = self.links.piconet, self._kernel.now
        # whether a payload that is not the head may change what is sent next
        overtaking = piconet[polling.SHARED] or self._settings.scheduler != "lazy"
        if overtaking:
            self._air.advance(now)
        if self._queues.push(queue, payload) or overtaking:
            self._air.advance(now)
            self._slots.arm()
        flush = self._settings.flush
        if flush is not None:
            self._flush_at(max(now, payload.queued + flush))

    def _flush_at(self, time: Time) -> None:
        """Have the next automatic flush at *time*, unless there is an earlier one."""
        if self._expiry is not None:
            if self._expiry.time <= time:
                return
            self._expiry.cancel()
        self._expiry = self._kernel.at(time, self._flush_aged)

    def flush(self, source: Address, destination: Address) -> None:
        """Take out of the queue of *source* what is meant for *destination* and has never been on the air."""
        queue = EVERYONE if source == self.links.master else self.links.lt_addr.get(source, NOTHING)
        if queue == NOTHING:
            return
        self._air.advance(self._kernel.now)
        events = self._queues.flush(queue, source, lambda p: _untouched(p, destination))
        self._slots.arm()
        self._report(events)

    def _route(self, source: Address, destination: Address) -> tuple[int, int]:
        """Return (number of the queue, LT_ADDR of the packets), or NOTHING for the latter where there is no link."""
        links = self.links
        if source != links.master:
            k = links.lt_addr.get(source, NOTHING)
            return k, k if destination == links.master and links.up(k, JOINED) else NOTHING
        if destination == BROADCAST:
            return EVERYONE, EVERYONE if links.audience() else NOTHING
        k = links.lt_addr.get(destination, NOTHING)
        return EVERYONE, k if links.up(k, HELD) else NOTHING

    # ------------------------------------------------------------ automatic flush

    def _flush_aged(self) -> None:
        """Flush payloads that are too old, at the next slot boundary; wait for the next that will be."""
        now, timeout = self._kernel.now, self._settings.flush
        self._expiry = None
        self._air.advance(now)
        boundary = self.clock.time_of(int(self.links.piconet[NEXT]))
        if timeout is None:
            return
        if boundary > now:
            self._expiry = self._kernel.at(boundary, self._flush_aged)
            return
        events: LinkEvents = []
        for queue in range(MOST_SLAVES + 1):
            events += self._flush_old(queue, now - timeout)
        ages = [payload.queued for queue in range(MOST_SLAVES + 1) for payload in self._queues.acknowledged(queue)]
        if ages:
            self._expiry = self._kernel.at(min(ages) + timeout, self._flush_aged)
        self._slots.arm()
        self._report(events)

    def _flush_old(self, queue: int, limit: Time) -> LinkEvents:
        """Flush what was queued at *limit* or before."""
        table = self.links.table
        old = {payload for payload in self._queues.acknowledged(queue) if payload.queued <= limit}
        for payload in old:
            if payload.tries and queue == EVERYONE:
                table[SEEN_DOWN, payload.lt_addr] = table[SEQ_DOWN, payload.lt_addr]
            elif payload.tries:
                table[SEEN_UP, queue] = table[SEQ_UP, queue]
                table[ARQN, queue] = 0
        source = self.links.master if queue == EVERYONE else self.links.slaves.get(queue, NOTHING)
        return self._queues.flush(queue, source, lambda payload: payload in old) if old else []

    # ------------------------------------------------------------ ends

    def _watch(self) -> None:
        """Wait for the earliest supervision time-out of all sides of all links, parked slaves included."""
        sides = [heard for heard in (self.links.last_heard(), self.parking.last_heard()) if heard is not None]
        if not sides:
            return
        deadline = min(sides) + self._settings.supervision
        if self._timeout is not None:
            if self._timeout.time <= deadline:
                return
            self._timeout.cancel()
        self._timeout = self._kernel.at(deadline, self._supervise, WAKE)

    def _supervise(self) -> None:
        """Take down the sides that have heard nothing for too long: perhaps none, as deadlines move meanwhile."""
        self._timeout = None
        now, table = self._kernel.now, self.links.table
        self.advance(now)
        limit = now - self._settings.supervision
        silent = [
            (k, side)
            for k in sorted(self.links.slaves)
            for side, heard in ((HELD, HEARD_UP), (JOINED, HEARD_DOWN))
            if table[side, k] and table[heard, k] <= limit
        ]
        events: LinkEvents = []
        for k, side in silent + self.parking.silent(limit):
            events += self._drop(k, side)
        self._slots.arm()
        if events:
            self._deliver((), events)
        self._watch()

    def _drop(self, k: int, side: int) -> LinkEvents:
        """Take one side of a link down and return its host's events: Lost, and the fates of its queued payloads."""
        parked = k in self.parking.members
        if not (self.parking.up(k, side) if parked else self.links.up(k, side)):
            return []
        slave = self.parking.members[k].slave if parked else self.links.slaves[k]
        (self.parking if parked else self.links).take_down(k, side, self._kernel.now)
        self._air.changed(self._kernel.now)
        if side == HELD:
            host, peer = self.address, slave
            fates = self._queues.flush_link(k, host, master_alone=not self.links.audience())
        else:
            host, peer = slave, self.address
            fates = [] if parked else self._queues.flush(k, host)
        self._on_lost(host, peer)
        return [(host, Lost(peer)), *fates]


def _untouched(payload: Payload, destination: Address) -> bool:
    """Return whether *payload* is meant for *destination*, has never been on the air, and is not about to be."""
    return payload.outgoing.destination == destination and not payload.tries and not payload.chosen
