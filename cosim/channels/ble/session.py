"""A link in a run: its events, packet by packet, what its hosts send over it, and when it is lost.

While nothing is to be said, and nothing can go wrong, a link rests: there is no event for its polls, which are counted
when it goes on. It rests while both ends hear each other without errors, neither has a link to anybody but this central
and its peripherals, and no other piconet is near enough to be noticed. What is broadcast meanwhile does not disturb the
polls of a link that rests; nor would it matter, as the next one is an interval away. In an air that other radios share
no link rests: all of its packets are heard there, and may be lost.
"""

from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from typing import Final

from cosim.channels.air.arbitration import Rank
from cosim.channels.ble.antenna import Antenna, Doing
from cosim.channels.ble.bits.control import ChannelMapInd, ConnectionUpdateInd
from cosim.channels.ble.bits.l2cap import ATTRIBUTES, LEAST_OCTETS, MOST_OCTETS, Message, Reassembly, fragments
from cosim.channels.ble.bits.pdu import Llid, encode_data
from cosim.channels.ble.connections.arq import Fragment
from cosim.channels.ble.connections.assessment import Assessment
from cosim.channels.ble.connections.exchange import Packet, Reception, Side, exchange_time
from cosim.channels.ble.connections.link import Link
from cosim.channels.ble.connections.parameters import INTERVAL_UNIT, ConnectionParameters, TransmitWindow
from cosim.channels.ble.environment import Environment
from cosim.channels.ble.ether import Judgement
from cosim.channels.ble.packets import Sent
from cosim.channels.ble.phy import T_IFS, Phy
from cosim.channels.energy import RECEIVE, TRANSMIT, Use
from cosim.errors import UserError, WireError
from cosim.kernel import Handle
from cosim.machine import Address, Lost, Mode, ModeChanged, Outcome, Outgoing
from cosim.machine import Reception as Arrived
from cosim.units import US, Time

NOTIFICATION: Final = bytes.fromhex("1b0300")
"""Opcode and handle of an ATT notification, in which payloads are sent."""
LAST_EVENTS: Final = 6
"""Events before its time-out from which on a link goes before all that has not begun; or half of that time."""
_KINDS: Final = {Llid.START: "DATA", Llid.CONTINUATION: "DATA", Llid.CONTROL: "CONTROL"}


@dataclass(slots=True)
class Terminal:
    """An end of a link: the device *address*, and what its host has given it to send."""

    address: Address
    antenna: Antenna
    queue: deque[tuple[Outgoing, int]] = field(default_factory=deque)
    """(payload, number of its fragments) that are not acknowledged, in order."""
    reassembly: Reassembly = field(default_factory=Reassembly)
    gone: bool = False
    """True if its link is over, and its host knows it, or is off."""


@dataclass(frozen=True, slots=True)
class Limits:
    """What a link can carry."""

    mtu: int
    """Octets of the longest ATT PDU."""
    queue: int | None
    """Payloads that an end holds; None: any number."""
    part: Time
    """Time that each event has at least."""
    phy: Phy
    """The PHY to which it changes."""
    adaptation: tuple[Time, Time] | None = None
    """Time from one choice of channels to the next, and until a bad one is tried again; None: all are used."""


class Session:
    """A *link* between two *terminals*, central and peripheral; *lost* is called with (address, peer) for each end."""

    def __init__(
        self,
        environment: Environment,
        link: Link,
        part: int,
        terminals: tuple[Terminal, Terminal],
        limits: Limits,
        lost: Callable[[Address, Address], None],
        may_rest: "Callable[[Session], bool]",
    ) -> None:
        """*may_rest* tells whether nothing but what is said on the link itself keeps it from resting."""
        self.terminals = terminals
        self.central: Address = terminals[Side.CENTRAL].address
        self.link = link
        self.part = part
        """Which part of each interval of its central it has."""
        self._kernel, self._ether, self._hosts, self._record = environment
        self._limits = limits
        self._first = link.central.parameters
        self._told = [self._first, self._first]
        """What the hosts of both ends know that it has."""
        self._lost, self._may_rest = lost, may_rest
        self._metered = terminals[Side.CENTRAL].antenna.meter is not None
        self._resting = False
        self._next: Handle | None = None
        self._watch: Handle | None = None
        self._on_air: Sent | None = None
        self._assessment: Assessment | None = None
        if limits.adaptation is not None:
            self._assessment = Assessment(*limits.adaptation, self._kernel.now)
        for terminal in terminals:
            if not terminal.gone:
                terminal.antenna.claim(self, self._kernel.now)

    def begin(self) -> None:
        """Begin with its events."""
        self._go_on()

    def side(self, address: Address) -> Side:
        """Return which end *address* is."""
        return Side.CENTRAL if address == self.central else Side.PERIPHERAL

    @property
    def _least(self) -> Time:
        """The time that a poll and an empty answer take, with the pause behind each."""
        down, up = self.link.central.phys
        return exchange_time(down, 0, up, 0)

    # ---------------------------------------------------------------- what hosts want

    def send(self, address: Address, outgoing: Outgoing) -> None:
        """Queue a payload of the end *address*."""
        side = self.side(address)
        terminal, end = self.terminals[side], self.link.ends[side]
        information = NOTIFICATION + outgoing.payload
        if len(information) > self._limits.mtu:
            self._hosts.over(address, outgoing, Outcome.TOO_LONG)
        elif self._limits.queue is not None and len(terminal.queue) >= self._limits.queue:
            self._hosts.over(address, outgoing, Outcome.QUEUE_FULL)
        else:
            longest = min(end.longest, self._fitting())
            parts = fragments(Message(ATTRIBUTES, information), longest, outgoing)
            terminal.queue.append((outgoing, len(parts)))
            self._hosts.payloads.accept(
                outgoing, address, outgoing.destination, len(outgoing.payload), self._kernel.now
            )
            with self._awake():
                end.arq.data.extend(parts)

    def _fitting(self) -> int:
        """Return the longest payload of which both ends can send a packet in the time that an event has at least.

        Were it longer, an end with much to say could keep the other one silent: what has been sent must be repeated.
        """
        phys = {*self.link.ends[0].phys, self._limits.phy}
        half = self._limits.part // 2 - US  # anchors are rounded
        return max(LEAST_OCTETS, min(MOST_OCTETS, *((half - T_IFS - phy.air_time(0)) // phy.octet for phy in phys)))

    def flush(self, address: Address) -> None:
        """Take out of the queue of the end *address* what has not been on the air."""
        self._settle_meters()
        side = self.side(address)
        terminal, data = self.terminals[side], self.link.ends[side].arq.data
        while terminal.queue and terminal.queue[-1][1] <= len(data):
            outgoing, count = terminal.queue.pop()
            for _ in range(count):
                data.pop()
            self._hosts.over(address, outgoing, Outcome.FLUSHED)

    def close(self, address: Address) -> None:
        """End the link, as the host of *address* wants."""
        self.flush(address)
        with self._awake():
            self.link.terminate(self.side(address))

    def mode(self, address: Address) -> Mode:
        """Return the mode of the link for the end *address*: in SNIFF events are rarer than at first."""
        parameters = self.link.ends[self.side(address)].parameters
        return Mode.ACTIVE if parameters == self._first else Mode.SNIFF

    def sniff(self, address: Address, interval: Time) -> None:
        """Have the central announce an interval of *interval* at most, which is a multiple of the first one, or that.

        Its host, and that of the peripheral, hear of it when it takes effect; the host of *address* does at once if
        nothing changes: a peripheral announces nothing, and one change must be over before the next.
        """
        parameters, central = self._rarer(interval), self.link.central
        changing = any(isinstance(change, ConnectionUpdateInd) for _, change in central.pending)
        if address != self.central or parameters is None or changing or parameters == central.parameters:
            other = self.terminals[1 - self.side(address)]
            self._hosts.report(address, ModeChanged(other.address, self.mode(address)))
            return
        with self._awake():
            self.link.announce(partial(ConnectionUpdateInd, TransmitWindow(INTERVAL_UNIT, 0), parameters))

    def _rarer(self, interval: Time) -> ConnectionParameters | None:
        """Return parameters for events at the same time of some of the first intervals; None if there are none."""
        first = self._first.interval
        try:
            return self._first if interval < 2 * first else self._first.of_interval(interval // first * first)
        except UserError:
            return None

    def drop(self, address: Address) -> None:
        """Forget the link at the end *address*, whose device is switched off."""
        self._leave(self.side(address))
        self._end()

    # ---------------------------------------------------------------- resting

    @contextmanager
    def _awake(self) -> Iterator[None]:
        """Have it not rest while something is changed, and then go on as that demands."""
        self._settle_meters()
        rested = self._resting
        if rested:
            self._ether.tenancy.catch_up(self._kernel.now)
            self._resting = False
            self._resume()
        yield
        if rested and self._on_air is None:
            self._go_on()

    def _resume(self) -> None:
        """Come to now: pass over the events that have been, and be in the midst of one that is under way."""
        link, now = self.link, self._kernel.now
        event = link.anchors.first_from(link.central.clock, now)
        begun = link.central.clock.at_local(link.anchors.at(event - 1))
        if event - 1 < link.event or begun + self._least <= now:
            link.rest(max(link.event, event))
            return
        link.rest(event - 1)
        under_way = link.begin(self._until(begun))
        while under_way.packet is not None and under_way.packet.end <= now:
            link.ended(Reception.HEARD)
        if under_way.packet is None:
            link.finish()
        else:
            self._put(under_way.packet)

    def reconsider(self) -> None:
        """Go on event by event if it must not rest any more."""
        if self._resting and not self._may():
            with self._awake():
                pass

    def _may(self) -> bool:
        one, other = self.terminals
        down, up = self.link.central.phys
        clear = self._ether.clear(one.address, other.address, down) and self._ether.clear(
            other.address, one.address, up
        )
        return clear and not one.gone and not other.gone and self._may_rest(self)

    def taken_until(self, start: Time, end: Time) -> Time | None:
        """Return the end of the least exchange of its last event that has one in [start, end)."""
        link = self.link
        last = link.anchors.first_from(link.central.clock, end) - 1
        begin = link.central.clock.at_local(link.anchors.at(last))
        return begin + self._least if begin + self._least > start and last >= 0 else None

    def next_from(self, time: Time) -> Time:
        """Return its first anchor from *time* on."""
        link = self.link
        event = max(0, link.anchors.first_from(link.central.clock, time))
        return link.central.clock.at_local(link.anchors.at(event))

    def packets(self, since: Time, until: Time) -> Iterator[Sent]:
        """Yield the polls and answers that begin in [since, until) while it rests."""
        if not self._resting:
            return
        link = self.link
        down, up = link.central.phys
        event = max(link.event, link.anchors.first_from(link.central.clock, since - self._least))
        while (start := link.central.clock.at_local(link.anchors.at(event))) < until:
            channel = link.channel(Side.CENTRAL, event)
            for side, at, phy in ((0, start, down), (1, start + down.air_time(0) + T_IFS, up)):
                if since <= at < until:
                    source, destination = self.terminals[side].address, self.terminals[1 - side].address
                    yield Sent(at, source, destination, "EMPTY", channel, phy, 0)
            event += 1

    # ---------------------------------------------------------------- what radios do

    def _settle_meters(self) -> None:
        if self._metered:
            for terminal in self.terminals:
                terminal.antenna.settle(self._kernel.now)

    def doing(self, address: Address, since: Time, until: Time) -> Iterator[Doing]:
        """Yield what the end *address* does from a time in [since, until) on, if that has not been noted by packets."""
        side = self.side(address)
        if self._resting:
            for each in self._doing_at_rest(side, since, until):
                if since <= each.start < until:
                    yield each
        elif side is Side.PERIPHERAL and self.link.on_air is None:
            receives = Use(RECEIVE, self.link.peripheral.phys[Side.CENTRAL].name)
            for begin, end in self.link.listening(since, until):
                yield Doing(begin, end, receives)

    def _doing_at_rest(self, side: Side, since: Time, until: Time) -> Iterator[Doing]:
        """Yield what an end does in the events from before *since* to after *until*."""
        link, (down, up) = self.link, self.link.central.phys
        sends, receives = Use(TRANSMIT, link.central.phys[side].name), Use(RECEIVE, link.central.phys[1 - side].name)
        event = max(link.event, link.anchors.first_from(link.central.clock, since - self._least))
        while True:
            anchor, opens = link.anchor_at_rest(event), link.opens_at_rest(event)
            if min(anchor, anchor if opens is None else opens) >= until:
                return
            polled = anchor + down.air_time(0)
            answers = polled + T_IFS
            answered = answers + up.air_time(0)
            if side is Side.CENTRAL:
                yield Doing(anchor, polled, sends)
                yield Doing(polled, answers + up.lead, receives)
                if opens is not None:
                    yield Doing(answers, answered, receives)
            elif opens is not None:
                yield Doing(opens, anchor, receives)
                yield Doing(anchor, polled, receives)
                yield Doing(polled, answers, receives)
                yield Doing(answers, answered, sends)
            event += 1

    def _note(self, sent: Sent, packet: Packet) -> None:
        """Note what radios do for a *packet* that has been put on the air."""
        event, phys, now = self.link.on_air, self.link.central.phys, self._kernel.now
        assert event is not None
        sender, receiver = self.terminals[packet.sender], self.terminals[1 - packet.sender]
        answer = phys[1 - packet.sender]
        if not sender.gone:
            sender.antenna.listens(min(now, sent.start), sent.start, answer)
            sender.antenna.sends(sent)
            if packet.sender is Side.CENTRAL or packet.pdu.more or not event.quiet:
                sender.antenna.listens(sent.end, sent.end + T_IFS + answer.lead, answer)
        if not receiver.gone and (packet.sender is Side.PERIPHERAL or event.listening):
            receiver.antenna.listens(sent.start, sent.end, sent.phy)

    # ---------------------------------------------------------------- events

    def _go_on(self) -> None:
        """Rest, or have the next event begin at its anchor."""
        if self.terminals[Side.CENTRAL].gone:
            self._look_out()
            return
        if self.link.may_rest and self._may():
            self._resting = True
            if self._watch is not None:
                self._watch.cancel()
                self._watch = None
            return
        self._next = self._kernel.at(self.link.anchor, self._begin)
        self._look_out()

    def _begin(self) -> None:
        link, now = self.link, self._kernel.now
        self._settle_meters()
        link.advance(now)
        self._settle()
        central, peripheral = self.terminals
        if central.gone:
            return
        if central.antenna.booked_until(now, now + self._least, self) is not None or self._refused(Side.CENTRAL):
            link.skip()
            self._go_on()
            return
        present = not peripheral.gone and peripheral.antenna.booked_until(now, now + self._least, self) is None
        event = link.begin(self._until(now), present)
        if event.listening and self._refused(Side.PERIPHERAL):
            event.listening = False
        self._proceed()

    def _refused(self, side: Side) -> bool:
        """Return whether another radio of an end has the air, so that the end leaves out the event that begins now."""
        now, antenna = self._kernel.now, self.terminals[side].antenna
        if antenna.seat is None:
            return False
        return antenna.refused_until(now, now, now + self._least, self._rank(side, now)) is not None

    def _rank(self, side: Side, anchor: Time) -> Rank:
        """Return what an event at *anchor* is to an end, for all that it knows now."""
        end = self.link.ends[side]
        interval, latency, timeout = end.parameters.interval, end.parameters.latency, end.parameters.timeout
        if self.link.deadline(side) - anchor <= min(LAST_EVENTS * (1 + latency) * interval, timeout // 2):
            return Rank.SUPERVISION
        return Rank.DATA if end.arq.busy else Rank.EMPTY

    def claimed_until(self, address: Address, start: Time, end: Time, rank: Rank) -> Time | None:
        """Return the end of the least exchange of its next event, if that begins in [start, end) and is of more rank.

        What *address* has to say, or how soon it gives the link up, is as it is known now.
        """
        anchor = self.next_from(start)
        if anchor >= end or self._rank(self.side(address), anchor) <= rank:
            return None
        return anchor + self._least

    def _until(self, now: Time) -> Time:
        """Return when an event that begins *now* has to be over: the next one of this central begins."""
        claims = self.terminals[Side.CENTRAL].antenna.claims
        others = [claim for claim in claims if isinstance(claim, Session) and claim.central == self.central]
        return min(session.next_from(now + 1) for session in (self, *others))

    def _put(self, packet: Packet) -> None:
        """Put *packet* on the air: it begins now, or in T_IFS."""
        link, sender, receiver = self.link, self.terminals[packet.sender], self.terminals[1 - packet.sender]
        pdu, end = packet.pdu, link.ends[packet.sender]
        empty = pdu.llid is Llid.CONTINUATION and not pdu.payload
        channel, phy = link.channel(Side.CENTRAL, link.event), link.central.phys[packet.sender]
        length = len(pdu.payload) if pdu.llid is not Llid.CONTROL else 0
        self._on_air = sent = Sent(
            packet.start,
            sender.address,
            receiver.address,
            "EMPTY" if empty else _KINDS[pdu.llid],
            channel,
            phy,
            len(pdu.payload),
            length,
            link.access_address,
            link.crc_init,
            encode_data(pdu) if self._record.wanted else b"",
            end.arq.repeats,
        )
        now = self._kernel.now
        for terminal, until in ((sender, sent.end), (receiver, sent.end + T_IFS)):
            if not terminal.gone:
                terminal.antenna.book(sent.start, until, self, now)
        if sent.start >= self._kernel.now:  # else it has been sent while the link was at rest
            self._ether.send(sent)
        if self._metered:
            self._note(sent, packet)
        if sender.queue and not empty and not end.arq.repeats and pdu.llid is Llid.START:
            self._note_begun(sender, len(end.arq.data))
        self._next = self._kernel.at(sent.end, self._ended)

    def _note_begun(self, terminal: Terminal, waiting: int) -> None:
        """Note that the payload whose first fragment is being sent, with *waiting* fragments behind it, has begun."""
        behind = 0
        for outgoing, count in reversed(terminal.queue):
            behind += count
            if behind > waiting:
                self._hosts.payloads.begin(outgoing, self._kernel.now)
                return

    def _ended(self) -> None:
        sent, event = self._on_air, self.link.on_air
        assert sent is not None
        assert event is not None
        assert event.packet is not None
        side = Side(1 - event.packet.sender)
        terminal = self.terminals[side]
        judgement = self._judged(sent, terminal, side is Side.CENTRAL or event.listening)
        if self._record.wanted:
            self._record.sent(sent, self._ether.was_on(sent.source, sent.start))
            self._record.judged(sent, terminal.address, judgement)
        heard = self.link.ended(judgement.reception)
        if heard.new is not None and heard.new.llid is not Llid.CONTROL:
            self._take(terminal, sent.source, heard.new, judgement.power_dbm)
        if heard.acknowledged is not None and heard.acknowledged.token is not None:
            outgoing, _ = terminal.queue.popleft()
            self._hosts.over(terminal.address, outgoing, Outcome.DELIVERED)
        self._settle()
        self._proceed()

    def _proceed(self) -> None:
        """Put the next packet of the event under way on the air, or end it."""
        event = self.link.on_air
        if event is None or event.packet is None:
            self._finish()
        else:
            self._put(event.packet)

    def _judged(self, sent: Sent, terminal: Terminal, listening: bool) -> Judgement:
        if not self._ether.was_on(terminal.address, sent.start) or not listening or terminal.gone:
            return Judgement(Reception.MISSED, "not_tuned")
        if terminal.antenna.booked_until(sent.start, sent.end, self) is not None:
            return Judgement(Reception.MISSED, "busy")
        return self._ether.judge(sent, terminal.address)

    def _take(self, terminal: Terminal, source: Address, fragment: Fragment, power_dbm: float | None) -> None:
        try:
            message = terminal.reassembly.take(fragment)
        except WireError:  # the rest of one that was flushed at the other end
            return
        if message is not None:
            payload = message.information[len(NOTIFICATION) :]
            self._hosts.arrive((terminal.address, payload, Arrived(source, False, power_dbm)))

    def _finish(self) -> None:
        self._on_air = None
        self._settle_meters()
        self._assess()
        self.link.finish()
        self._go_on()

    def _assess(self) -> None:
        """Count the event that has ended, and have the central announce another map if it chooses one."""
        link, assessment = self.link, self._assessment
        if assessment is None or link.on_air is None:
            return
        assessment.note(link.channel(Side.CENTRAL, link.event), link.on_air.last_heard[Side.CENTRAL] is not None)
        if not link.central.pending and (used := assessment.choose(self._kernel.now)) is not None:
            link.announce(partial(ChannelMapInd, used))

    # ---------------------------------------------------------------- the end

    def _look_out(self) -> None:
        """Be there when an end would give the link up."""
        ends = zip(Side, self.terminals, strict=True)
        deadlines = [self.link.deadline(side) for side, terminal in ends if not terminal.gone]
        if not deadlines or (self._watch is not None and self._watch.time <= min(deadlines)):
            return
        if self._watch is not None:
            self._watch.cancel()
        self._watch = self._kernel.at(max(min(deadlines), self._kernel.now), self._watched)

    def _watched(self) -> None:
        self._watch = None
        self._settle_meters()
        self.link.advance(self._kernel.now)
        self._settle()
        self._look_out()

    def _settle(self) -> None:
        """Tell hosts of what has changed, or been lost."""
        for side, end in zip(Side, self.link.ends, strict=True):
            terminal, other = self.terminals[side], self.terminals[1 - side]
            if end.parameters != self._told[side] and not terminal.gone:
                self._told[side] = end.parameters
                self._hosts.report(terminal.address, ModeChanged(other.address, self.mode(terminal.address)))
            if end.loss is not None and not terminal.gone:
                self._leave(side)
                self._hosts.report(terminal.address, Lost(other.address))
                self._end()

    def _leave(self, side: Side) -> None:
        """Give up what the end *side* holds."""
        terminal = self.terminals[side]
        terminal.gone = True
        terminal.antenna.release(self, self._kernel.now)
        self._lost(terminal.address, self.terminals[1 - side].address)
        while terminal.queue:
            outgoing, _ = terminal.queue.popleft()
            self._hosts.over(terminal.address, outgoing, Outcome.FLUSHED)

    def _end(self) -> None:
        """Stop what only an end that is gone has kept going."""
        self.reconsider()
        if all(terminal.gone for terminal in self.terminals) and self._watch is not None:
            self._watch.cancel()
            self._watch = None
