"""What a piconet sends in slots that are not idle: decided at their start, judged at the ends of their frames.

Frames are counted by type and, if a trace wants them, recorded with channel and outcome; idle POLL and NULL packets,
which ``band`` computes, are recorded here as well.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Final, TypeAlias

from cosim.channels.air.arbitration import Rank
from cosim.channels.base import Arrival
from cosim.channels.bluetooth import polling
from cosim.channels.bluetooth.packets import HEADER_AIR, NULL, POLL, PacketType
from cosim.channels.bluetooth.polling import (
    ARQN,
    EVERYONE,
    FULL_UNTIL,
    HEARD_DOWN,
    HEARD_UP,
    HELD,
    HERE,
    JOINED,
    NEXT,
    NOTHING,
    QUEUED,
    RUNNING,
    SEEN_DOWN,
    SEQ_DOWN,
    SHARED,
    SLAVE,
    STOPPED,
    USED,
)
from cosim.channels.bluetooth.queues import LinkEvents, Payload
from cosim.channels.bluetooth.radio import FAR, GOOD, REFUSED, UNTUNED, Fate, Frame, Heard
from cosim.channels.bluetooth.schedule import Schedule
from cosim.channels.bluetooth.state import PiconetState
from cosim.kernel import AIR, Handle
from cosim.machine import BROADCAST, Address, Outcome, Reception
from cosim.units import Time

_new: Final = tuple.__new__  # what a named tuple's own constructor calls; a third faster
_Listener: TypeAlias = tuple[int, Address, float, bool]
"""(number of a link or a parked slave, its address, the power in dBm with which it gets its master, whether it is there
to receive a packet)"""


@dataclass(slots=True)
class _Pair:
    """A slot pair under way: all that was fixed at its start."""

    tick: int
    k: int
    slave: Address
    question: Payload | None
    answer: Payload | None
    """Payload that the slave sends if it hears the question; None for NULL."""
    acknowledges: bool
    """True if the master's packet carries ARQN = 1 for the head of the slave's queue."""
    down_dbm: float
    up_dbm: float
    here: bool
    """True if the slave is there."""
    noted: bool
    """True if its frames are recorded."""
    whole: bool = True
    """True if the slave has received the payload of the question, if there is one."""
    taken: bool = False
    """True if the slave had room for it as well."""


class Slots:
    """The TX slots of a master: one kernel event for the next one with a payload in it."""

    def __init__(self, state: PiconetState, on_beacon: Callable[[int], None]) -> None:
        """*on_beacon* is called with the number of a parked slave that has heard a broadcast packet which ends now."""
        self.frames: Counter[str] = Counter()
        """Frames with user data by packet type, retransmissions and repetitions included."""
        self.address = state.links.master
        self.clock = state.clock
        self.links = state.links
        self._kernel = state.kernel
        self._air = state.air
        self._n_bc = state.settings.n_bc
        self._queues = state.queues
        self._parking = state.parking
        self._transport = state.links.transport
        self._deliver = state.deliver
        self._schedule = Schedule(state)
        self._on_beacon = on_beacon
        self._recorded = state.air.recorded
        """True if the frames of transactions with a payload are recorded."""
        self._idle_recorded = self._recorded and state.settings.idle_frames
        """True if all other frames are recorded as well."""
        if self._idle_recorded:
            self._air.report_idle(self.address, self._record_idle)
        self._slot: Handle | None = None
        self._slot_tick = NOTHING

    def arm(self) -> None:
        """Schedule the next slot that is not idle as a kernel event; all slots before now are decided."""
        tick = self._schedule.next_slot() if self.links.piconet[RUNNING] else NOTHING
        if self._slot is not None:
            if tick == self._slot_tick:
                return
            self._slot.cancel()
            self._slot = None
        if tick != NOTHING:
            self._slot_tick = tick
            self._slot = self._kernel.at(self.clock.time_of(tick), self._decide, AIR)

    def _decide(self) -> None:
        self._slot = None
        tick = self._slot_tick
        self._air.advance(self._kernel.now)
        turn = self._schedule.choose(tick) if self.links.piconet[NEXT] <= tick else None
        if turn is not None and turn.k != EVERYONE:
            self._ask(tick, turn.k, turn.payload)
            return
        if turn is not None:
            self._broadcast(tick, turn.payload)
        self.arm()

    # ------------------------------------------------------------ pairs

    def _ask(self, tick: int, k: int, payload: Payload | None) -> None:
        """Send *payload*, or POLL, to the slave *k*; the next slot is known when the pair is over."""
        links, air, slave = self.links, self._air, self.links.slaves[k]
        listens = bool(links.table[HERE, k])
        if air.seats is not None:
            until = self._pair_ends(tick, k, payload)
            if self._leaves_out(k, payload is not None, until):
                self.arm()
                return
            listens = listens and self._listens(k, bool(links.table[QUEUED, k]), until)
        waiting = self._queues.first_two(k)
        noted = self._idle_recorded or (self._recorded and (payload is not None or bool(waiting)))
        kind, duration, first = _shape(payload, POLL)
        acknowledges = polling.begin_pair(links.piconet, links.table, tick, k, first, payload is not None, kind.slots)
        answer = waiting[acknowledges] if len(waiting) > acknowledges else None
        if self._full_until(self.address, slave):
            answer = None
        if answer is not None:
            self._schedule.sized(answer, up=True).chosen = True
        carriers = air.carrier(self.address, slave), air.carrier(slave, self.address)
        pair = _Pair(tick, k, slave, payload, answer, acknowledges, *carriers, listens, noted)
        frame = self._send(tick, kind, duration, self.address, slave, k, payload, tick)
        if noted:
            air.latest.append(frame)
        self._kernel.after(duration, partial(self._asked, pair, frame))

    def _pair_ends(self, tick: int, k: int, payload: Payload | None) -> Time:
        """Return when the pair that begins at *tick* with *payload*, or POLL, to the slave *k* is over."""
        waiting, acknowledged = self._queues.first_two(k), int(self.links.table[ARQN, k])
        air = HEADER_AIR
        if len(waiting) > acknowledged and not self._full_until(self.address, self.links.slaves[k]):
            air = self._schedule.sized(waiting[acknowledged], up=True).air
        return self.clock.time_of(tick + 2 * (1 if payload is None else payload.kind.slots)) + air

    def _asked(self, pair: _Pair, frame: Frame) -> None:
        """End the master's frame: the slave may hear it, take its payload, and answer."""
        links, k, question = self.links, pair.k, pair.question
        joined = pair.here and bool(links.table[JOINED, k])
        fate = self._fate(frame, pair.slave, pair.down_dbm, question, joined)
        if fate.heard is Heard.RECEIVED and self._overflows(pair):
            fate = REFUSED
        if pair.noted:
            self._record(frame, pair.question)
            self._air.record(frame, fate, pair.down_dbm)
        if pair.answer is not None:
            pair.answer.chosen = False
        if not fate.header_heard:
            self._assess(frame, False)
            links.table[STOPPED, k] = 0
            self.arm()
            return
        links.table[HEARD_DOWN, k] = self._kernel.now
        events: LinkEvents = []
        if pair.acknowledges:
            events = self._queues.ended(self._queues.pop(k), pair.slave, Outcome.DELIVERED)
        arrivals: list[Arrival] = []
        if question is not None and fate.heard is Heard.RECEIVED:
            pair.taken = True
            if polling.take_down_link(links.table, k):
                self._receive(arrivals, pair.slave, question, self.address, pair.down_dbm)
        pair.whole = question is None or fate.heard in (Heard.RECEIVED, Heard.REFUSED)
        links.table[FULL_UNTIL, k] = self._full_until(pair.slave, self.address)
        self._answer(pair)
        if arrivals or events:
            self._deliver(arrivals, events)

    def _overflows(self, pair: _Pair) -> bool:
        """Return whether the slave has no room for the payload that it has received; a repetition needs none."""
        table, k = self.links.table, pair.k
        if pair.question is None or table[SEEN_DOWN, k] == table[SEQ_DOWN, k]:
            return False
        return self._full_until(pair.slave, self.address) > 0

    def _answer(self, pair: _Pair) -> None:
        """Send the slave's answer to what it has just heard, in the slot after it."""
        links, answer = self.links, pair.answer
        slots = 1 if pair.question is None else pair.question.kind.slots
        tick = pair.tick + 2 * slots
        kind, duration, first = _shape(answer, NULL)
        polling.answer_pair(links.piconet, links.table, tick, pair.k, first, answer is not None, kind.slots)
        reply = self._send(tick, kind, duration, pair.slave, self.address, pair.k, answer, pair.tick)
        if self._air.meter is not None:
            self._air.meter.answered(pair.slave, reply.start, self.clock.time_of(tick + 2 * kind.slots))
        if pair.noted:
            self._air.latest.append(reply)
        self._kernel.at(reply.start + duration, partial(self._answered, pair, reply))

    def _answered(self, pair: _Pair, frame: Frame) -> None:
        """End the slave's frame: the master may hear it, and take its payload."""
        links, k, answer = self.links, pair.k, pair.answer
        held = bool(links.table[HELD, k])
        fate = self._fate(frame, self.address, pair.up_dbm, answer, held)
        if self._air.meter is not None and fate.judged:
            self._air.meter.received(self.address, frame.start, self._kernel.now)
        if pair.noted:
            self._record(frame, answer)
            self._air.record(frame, fate, pair.up_dbm)
        self._assess(frame, fate.heard is Heard.RECEIVED and pair.whole)
        if not fate.header_heard:
            links.table[STOPPED, k] = 0
            self.arm()
            return
        links.table[HEARD_UP, k] = self._kernel.now
        links.table[STOPPED, k] = links.table[FULL_UNTIL, k] > 0
        events: LinkEvents = []
        if pair.taken and pair.question is not None:
            self._queues.remove(pair.question)
            events = self._queues.ended(pair.question, self.address, Outcome.DELIVERED)
        arrivals: list[Arrival] = []
        if answer is not None and fate.heard is Heard.RECEIVED and polling.take_up_link(links.table, k):
            self._receive(arrivals, self.address, answer, pair.slave, pair.up_dbm)
        self.arm()
        if arrivals or events:
            self._deliver(arrivals, events)

    # ------------------------------------------------------------ broadcasts

    def _broadcast(self, tick: int, payload: Payload | None) -> None:
        """Send *payload*, or an empty beacon, to all."""
        kind, duration, _ = _shape(payload, NULL)
        until = self._kernel.now + duration
        if self._leaves_out(EVERYONE, payload is not None, until):
            return
        self.links.piconet[NEXT] = tick + 2 * kind.slots + 2
        self._parking.sent(tick)
        last = payload is not None and payload.tries + 1 >= self._n_bc
        if payload is not None and last:
            self._queues.remove(payload)
        listeners = self._listeners(tick, kind.slots, payload is None)
        if self._air.seats is not None:
            data = payload is not None
            listeners = [(k, slave, dbm, there and self._listens(k, data, until)) for k, slave, dbm, there in listeners]
        frame = self._send(tick, kind, duration, self.address, self.address, EVERYONE, payload, tick)
        if self._recorded if payload is not None else self._idle_recorded:
            self._air.latest.append(frame._replace(destination=BROADCAST))
        self._kernel.after(duration, partial(self._broadcast_ends, frame, payload, listeners, last))

    def _listeners(self, tick: int, slots: int, parked_only: bool) -> list[_Listener]:
        """Return who may hear a broadcast packet of *slots* from *tick* on: links by LT_ADDR, then parked slaves."""
        links, carrier, parked = self.links, self._air.carrier, self._parking.members
        listeners: list[_Listener] = []
        if not parked_only:
            piconet, table = links.piconet, links.table
            here, shared = table[HERE].tolist(), piconet[SHARED]
            for k, slave in sorted(links.slaves.items()):
                there = here[k] and (not shared or polling.open_slot(piconet, table, k, tick, slots) == tick)
                listeners.append((k, slave, carrier(self.address, slave), there))
        for number in sorted(parked):
            member = parked[number]
            listeners.append((number, member.slave, carrier(self.address, member.slave), member.presence.here))
        return listeners

    def _broadcast_ends(
        self, frame: Frame, payload: Payload | None, listeners: Sequence[_Listener], last: bool
    ) -> None:
        arrivals: list[Arrival] = []
        now, table, slaves, members = self._kernel.now, self.links.table, self.links.slaves, self._parking.members
        wanted = self._recorded if payload is not None else self._idle_recorded
        joined = table[JOINED].tolist()
        if wanted:
            self._record(frame._replace(destination=BROADCAST), payload)
        for k, slave, carrier_dbm, there in listeners:
            parked = members.get(k)
            if parked is None and slaves.get(k) != slave:
                continue  # it has left while the frame was on the air
            tuned = there and bool(joined[k] if parked is None else parked.joined)
            fate = self._fate(frame, slave, carrier_dbm, payload, tuned)
            if wanted:
                self._air.record(_new(Frame, (*frame[:4], slave, *frame[5:])), fate, carrier_dbm)
            if fate.heard is Heard.RECEIVED and payload is not None and not payload.taken >> k & 1:
                payload.taken |= 1 << k
                self._receive(arrivals, slave, payload, self.address, carrier_dbm, True)
            if not fate.header_heard:
                continue
            if parked is None:
                table[HEARD_DOWN, k] = now
            else:
                self._on_beacon(k)
        events: LinkEvents = []
        if payload is not None and last:
            events = self._queues.ended(payload, self.address, Outcome.SENT)
        if arrivals or events:
            self._deliver(arrivals, events)

    # ------------------------------------------------------------ other radios of the same robots

    def _leaves_out(self, k: int, data: bool, until: Time) -> bool:
        """Return whether the master must not begin now what lasts *until* then; it is silent for as long as that.

        That is a packet to link *k*, or to all, and its answer; *data* is True if the packet has a payload.
        """
        seats = self._air.seats
        if seats is None:
            return False
        refused = seats.refused_until(self.address, until, self._rank(k, HEARD_UP, data))
        if refused is None:
            return False
        self.links.piconet[NEXT] = polling.first_slot_at(self.links.piconet, refused)
        return True

    def _listens(self, k: int, data: bool, until: Time) -> bool:
        """Return whether other radios of the slave *k*, a link or a parked one, let it listen and answer *until* then.

        *data* is True if it has something to say, or what it hears is a payload for everyone.
        """
        seats, parked = self._air.seats, self._parking.members.get(k)
        slave = self.links.slaves[k] if parked is None else parked.slave
        if seats is None or not self._air.reaches(self._air.carrier(self.address, slave)):
            return True
        rank = self._rank(k if parked is None else EVERYONE, HEARD_DOWN, data)
        return seats.refused_until(slave, until, rank) is None

    def _rank(self, k: int, heard: int, data: bool) -> Rank:
        seats, piconet, table = self._air.seats, self.links.piconet, self.links.table
        if seats is None or k == EVERYONE:
            return Rank.DATA if data else Rank.EMPTY
        return seats.rank(piconet, table, k, heard, data, self._kernel.now)

    def own_until(self, start: Time, end: Time) -> Time | None:
        """Return the end of the next pair in [start, end) in which the master sends a payload; None for nothing."""
        head = self._queues.head(EVERYONE)
        tick = NOTHING if head is None else self._schedule.next_slot()
        if head is None or tick == NOTHING or self.clock.time_of(tick) >= end:
            return None
        over = self.clock.time_of(tick + 2 * head.kind.slots) + HEADER_AIR
        return over if over > start else None

    def turn_until(self, k: int, heard: int, start: Time, end: Time, rank: Rank) -> Time | None:
        """Return the end of the next turn of link *k* in [start, end), if that is of more than *rank* to a side of it.

        That is the one to which the row *heard* belongs. None for nothing.
        """
        seats, piconet, table = self._air.seats, self.links.piconet, self.links.table
        data = heard == HEARD_DOWN and bool(table[QUEUED, k])
        if seats is None or seats.rank(piconet, table, k, heard, data, end) <= rank:
            return None
        tick = polling.next_turn(piconet, table, k, end)
        if tick == NOTHING:
            return None
        over = self.clock.time_of(tick + 2) + HEADER_AIR
        begin = self.clock.time_of(tick)
        return over if over > start and seats.rank(piconet, table, k, heard, data, begin) > rank else None

    # ------------------------------------------------------------ packets

    def _send(
        self,
        tick: int,
        kind: PacketType,
        duration: Time,
        source: Address,
        destination: Address,
        lt_addr: int,
        payload: Payload | None,
        asked: int,
    ) -> Frame:
        """Put a packet, with *payload* or empty, on the air at *tick*, now or soon; it answers one of the tick *asked*.

        With an adapted hop set a slave answers on the channel of the packet that it answers.
        """
        length = 0
        if payload is not None:
            length = len(payload.outgoing.payload)
            payload.tries += 1
            self.frames[payload.kind.name] += 1
        channel = self._air.channel(self.address, asked if self.links.piconet[USED] else tick)
        start = self.clock.time_of(tick)
        if payload is not None and payload.tries == 1 and self._queues.payloads is not None:
            self._queues.payloads.begin(payload, start)
        self._air.send(source, start, duration, channel)
        if self._air.meter is not None and source == self.address:
            self._air.meter.asked(source, tick, lt_addr, duration, kind.slots)
        return _new(Frame, (start, duration, kind.name, source, destination, channel, lt_addr, length))

    def _fate(self, frame: Frame, receiver: Address, carrier_dbm: float, payload: Payload | None, tuned: bool) -> Fate:
        """Return the fate at *receiver* of a frame that ends now."""
        air = self._air
        if carrier_dbm < air.least_dbm:
            return FAR
        if not tuned:
            return UNTUNED
        if air.calm and frame.start >= air.stray:
            return GOOD
        if payload is None:
            return air.fate(frame, receiver, carrier_dbm, 0, False)
        return air.fate(frame, receiver, carrier_dbm, payload.kind.payload_bits(frame.length), payload.kind.coded)

    def _assess(self, frame: Frame, well: bool) -> None:
        """Count whether the pair that ends with *frame* went well on its channel, if the hop set is adapted."""
        if self.links.piconet[USED]:
            self._air.adapt().tallies[self.address, 0 if well else 1, frame.channel] += 1

    def _receive(
        self,
        arrivals: list[Arrival],
        receiver: Address,
        payload: Payload,
        source: Address,
        carrier_dbm: float,
        broadcast: bool = False,
    ) -> None:
        """Add to *arrivals* what reaches the host at *receiver* now, if *payload* need not wait for the line to it."""
        reception = Reception(source, broadcast, carrier_dbm) if self._air.fades else _unfaded(source, broadcast)
        arrival = (receiver, payload.outgoing.payload, reception)
        if self._transport is None:
            arrivals.append(arrival)
        else:
            self._transport.take(arrival)

    def _full_until(self, device: Address, peer: Address) -> Time:
        """Return until when *device* sends STOP (FLOW = 0) to *peer*: 0 if it has room now."""
        return 0 if self._transport is None else self._transport.full_until(device, peer)

    def _record(self, frame: Frame, payload: Payload | None) -> None:
        """Record that *frame* with *payload*, or without one, has been sent."""
        if self._air.record_sent is not None:
            body = b"" if payload is None else payload.outgoing.payload
            self._air.record_sent(frame, body, payload is not None and payload.tries > 1)

    def _record_idle(self, tick: int, k: int, up: bool, fate: Fate, power_dbm: float, met_mw: float) -> None:
        slave = int(self.links.table[SLAVE, k])  # the link itself may be gone by the end of the frame
        source, destination = (slave, self.address) if up else (self.address, slave)
        channel = self._air.channel(self.address, tick)
        start, kind = self.clock.time_of(tick), "NULL" if up else "POLL"
        frame = Frame(start, HEADER_AIR, kind, source, destination, channel, k)
        self._record(frame, None)
        self._air.record(frame, fate, power_dbm, met_mw)


@cache
def _unfaded(source: Address, broadcast: bool) -> Reception:
    """Return how a payload of *source* arrives where signals do not fade."""
    return Reception(source, broadcast)


def _shape(payload: Payload | None, empty: PacketType) -> tuple[PacketType, Time, bool]:
    """Return (packet type, air time, whether it goes on the air for the first time) of a packet, or of *empty*."""
    if payload is None:
        return empty, HEADER_AIR, False
    return payload.kind, payload.air, payload.tries == 0
