"""A connection, event by event: two ends, each with its own clock and its own knowledge of what is in force.

Time is an argument. Whoever runs a link asks for ``anchor``, begins the event there (or skips it), tells what became of
each packet, and finishes the event. What an end has not heard of does not hold for it: a peripheral that has missed a
new channel map listens on the old one's channels from the instant on.

Of the procedures of the link layer (Core v5.0, Vol 6 Part B, 5.1) there are connection update, channel map update,
termination, data length and PHY update, each in its plain course: no collisions, no time-outs of their own.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final, TypeAlias

from cosim.channels.ble.bits.control import (
    PHY_1M,
    PHY_2M,
    PHY_CODED,
    ChannelMapInd,
    ConnectionUpdateInd,
    Lengths,
    Phys,
    PhyUpdateInd,
    TerminateInd,
    decode_control,
    encode_control,
)
from cosim.channels.ble.bits.l2cap import LEAST_OCTETS, LEAST_TIME, LEAST_TIME_CODED, longest_payload
from cosim.channels.ble.bits.pdu import CLOCK_ACCURACIES_PPM, LLData, Llid
from cosim.channels.ble.connections.anchors import WINDOW_DELAYS, Anchors, Expectation
from cosim.channels.ble.connections.arq import EMPTY, Arq, Fragment, Heard
from cosim.channels.ble.connections.channel_map import ChannelMap
from cosim.channels.ble.connections.connection import Supervision, event_at, instant_for
from cosim.channels.ble.connections.exchange import ConnectionEvent, Packet, Reception, Side
from cosim.channels.ble.connections.parameters import ConnectionParameters, TransmitWindow
from cosim.channels.ble.phy import CODED_S8, LE_1M, LE_2M, T_IFS, Phy
from cosim.channels.ble.selection import channel_1, channel_2, identifier
from cosim.channels.clock import NativeClock
from cosim.errors import LocalProtocolError, WireError
from cosim.units import Time

Change: TypeAlias = ConnectionUpdateInd | ChannelMapInd | PhyUpdateInd
"""What takes effect at an instant."""

UNCHANGED: Final = Lengths(False, LEAST_OCTETS, LEAST_TIME, LEAST_OCTETS, LEAST_TIME)
"""The lengths of PDUs until they have been exchanged."""
PHY_OF_BIT: Final[dict[int, Phy]] = {PHY_2M: LE_2M, PHY_1M: LE_1M, PHY_CODED: CODED_S8}
"""PHYs by their bits, in the order in which a central chooses among those that both ends would like."""


class Loss(StrEnum):
    """Why a connection has ended for one end."""

    SUPERVISION = "supervision"
    NOT_ESTABLISHED = "not_established"
    """No packet has come within six intervals."""
    WIDENING = "widening"
    """The peripheral knows too little of when the next packet comes."""
    TERMINATED = "terminated"
    INSTANT_PASSED = "instant_passed"
    """A change was heard of at its instant or later."""


@dataclass(slots=True)
class LinkEnd:
    """What one end of a connection knows."""

    side: Side
    clock: NativeClock
    parameters: ConnectionParameters
    used: ChannelMap
    phys: tuple[Phy, Phy]
    """PHYs of the central's and of the peripheral's packets."""
    supervision: Supervision
    arq: Arq = field(default_factory=Arq)
    lengths: Lengths = UNCHANGED
    """The longest PDUs that it can receive and will send."""
    peer_lengths: Lengths = UNCHANGED
    likes: int = PHY_1M | PHY_2M | PHY_CODED
    """PHYs, as bits, that it would like to use."""
    pending: list[tuple[int, Change]] = field(default_factory=list)
    """(event, what changes then), in order."""
    leaving: bool = False
    """True if its next packet acknowledges the end of the connection."""
    loss: Loss | None = None
    """Why the connection has ended for it."""
    lost_at: Time | None = None

    @property
    def longest(self) -> int:
        """The longest payload of a data PDU that it sends now, for :func:`l2cap.fragments`."""
        phy = self.phys[self.side]
        time = min(self.lengths.tx_time, self.peer_lengths.rx_time)
        if phy not in (LE_1M, LE_2M):
            time = max(time, LEAST_TIME_CODED)
        return longest_payload(phy, min(self.lengths.tx_octets, self.peer_lengths.rx_octets), time)

    def schedule(self, event: int, change: Change) -> None:
        """Note a *change* from *event* on."""
        self.pending = sorted([*self.pending, (event, change)], key=lambda item: item[0])

    def lose(self, loss: Loss, time: Time) -> None:
        """End the connection for this end."""
        if self.loss is None:
            self.loss, self.lost_at = loss, time

    def apply(self, change: Change, instant: Time) -> None:
        """Let *change* take effect; *instant* is the local time at which its event was to begin."""
        match change:
            case ConnectionUpdateInd(_, parameters, _):
                self.parameters = parameters
                self.supervision.renew(instant, parameters)
            case ChannelMapInd(used, _):
                self.used = used
            case PhyUpdateInd(down, up, _):
                self.phys = PHY_OF_BIT.get(down, self.phys[0]), PHY_OF_BIT.get(up, self.phys[1])


class Link:
    """A connection that a CONNECT_IND with *ll_data* has made, which ended at *created*.

    *clocks* and *sca_ppm* are the ends' clocks and what is promised of the peripheral's; *phy* is that of the
    CONNECT_IND; *delay* is transmitWindowDelay. The central begins *start* after the beginning of the transmit window.
    """

    def __init__(
        self,
        ll_data: LLData,
        created: Time,
        clocks: tuple[NativeClock, NativeClock],
        sca_ppm: int,
        phy: Phy = LE_1M,
        algorithm_2: bool = True,
        delay: Time = WINDOW_DELAYS["legacy"],
        start: Time = 0,
    ) -> None:
        parameters = ConnectionParameters(ll_data.interval, ll_data.latency, ll_data.timeout)
        TransmitWindow(ll_data.window_size, ll_data.window_offset).check(ll_data.interval)
        if not 0 <= start <= ll_data.window_size:
            raise LocalProtocolError(f"anchor 0 is {start} ns after the beginning of its window")
        self.event = 0
        """Number of the next event."""
        self.errors = 0
        """Control PDUs that were none, or none that is known here; they are left alone."""
        self.on_air: ConnectionEvent | None = None
        """The event under way."""
        self.access_address = ll_data.access_address
        self.crc_init = ll_data.crc_init
        self._key = identifier(ll_data.access_address)
        self._hop, self._algorithm_2 = ll_data.hop, algorithm_2
        local, heard = (clock.local(created) for clock in clocks)
        self.ends = tuple(
            LinkEnd(side, clock, parameters, ll_data.channel_map, (phy, phy), Supervision(clock, since, parameters))
            for side, clock, since in zip(Side, clocks, (local, heard), strict=True)
        )
        self.central, self.peripheral = self.ends
        opening = delay + ll_data.window_offset
        ppm = CLOCK_ACCURACIES_PPM[ll_data.sca] + sca_ppm
        self.anchors = Anchors(0, local + opening + start, parameters.interval)
        self.expected = Expectation(0, heard + opening, parameters.interval, heard, ppm, ll_data.window_size)
        self._awake = 0  # the event from which on the peripheral listens even with nothing to send
        self._taken = 0  # the event that the peripheral takes this one for

    # ---------------------------------------------------------------- what is asked for

    @property
    def anchor(self) -> Time:
        """The instant at which the next event begins."""
        anchors = self.anchors
        for event, change in self.central.pending:
            if event <= self.event and isinstance(change, ConnectionUpdateInd):
                anchors = anchors.updated(event, change.window.offset, change.parameters.interval)
        return self.central.clock.at_local(anchors.at(self.event))

    def channel(self, side: Side, event: int) -> int:
        """Return the channel index on which an end is in *event*, by the map in force (see :meth:`advance`)."""
        used = self.ends[side].used
        if self._algorithm_2:
            return channel_2(used, self._key, event)
        return channel_1(used, self._hop, event)

    def deadline(self, side: Side) -> Time:
        """Return the instant at which the connection ends for an end if it hears nothing more."""
        return min(self._deadlines(side).values())

    def _deadlines(self, side: Side) -> dict[Loss, Time]:
        supervision = self.ends[side].supervision
        loss = Loss.SUPERVISION if supervision.established else Loss.NOT_ESTABLISHED
        deadlines = {loss: supervision.deadline()}
        if side is Side.PERIPHERAL:
            gone = self.expected.at(self.expected.lost_from())
            deadlines[Loss.WIDENING] = self.peripheral.clock.at_local(gone)
        return deadlines

    # ---------------------------------------------------------------- what the hosts ask for

    def terminate(self, side: Side) -> None:
        """Ask for the end of the connection."""
        self.ends[side].arq.push(encode_control(TerminateInd()))

    def announce(self, make: Callable[[int], Change]) -> None:
        """Let the central announce the change that *make* makes of an instant."""
        latency = self.central.parameters.latency
        change = make(instant_for(self.event, latency))
        event = event_at(change.instant, self.event)
        assert event is not None  # it lies ahead
        self.central.schedule(event, change)
        self.central.arq.push(encode_control(change))

    def request_lengths(self, side: Side, lengths: Lengths) -> None:
        """Let an end make *lengths* known, and ask for those of the other."""
        self.ends[side].lengths = lengths._replace(response=False)
        self.ends[side].arq.push(encode_control(self.ends[side].lengths))

    def request_phys(self, side: Side, likes: int) -> None:
        """Let an end ask for PHYs, as bits, in both directions."""
        self.ends[side].likes = likes
        self.ends[side].arq.push(encode_control(Phys(False, likes, likes)))

    # ---------------------------------------------------------------- events

    def advance(self, now: Time) -> None:
        """Let what was to happen until *now* happen: instants and deadlines."""
        for side, end in zip(Side, self.ends, strict=True):
            while end.pending and self._reached(side, end.pending[0][0], now):
                event, change = end.pending.pop(0)
                instant = (self.expected if side else self.anchors).at(event)
                if isinstance(change, ConnectionUpdateInd):  # nothing can come from here to the instant
                    self._expire(side, end.clock.at_local(instant))
                    self._shift(side, event, change)
                end.apply(change, instant)
            self._expire(side, now)

    def _reached(self, side: Side, event: int, now: Time) -> bool:
        first = self.anchors.at(event) if side is Side.CENTRAL else self.expected.opens(event)
        return first <= self.ends[side].clock.local(now)

    def _shift(self, side: Side, event: int, change: ConnectionUpdateInd) -> None:
        size, offset, interval = change.window.size, change.window.offset, change.parameters.interval
        if side is Side.CENTRAL:
            self.anchors = self.anchors.updated(event, offset, interval)
        else:
            self.expected = self.expected.updated(event, offset, size, interval)

    def _expire(self, side: Side, now: Time) -> None:
        loss, deadline = min(self._deadlines(side).items(), key=lambda item: item[1])
        if deadline <= now:
            self.ends[side].lose(loss, deadline)

    def skip(self) -> None:
        """Leave the next event out: the central does not send."""
        self.event += 1

    @property
    def may_rest(self) -> bool:
        """Whether nothing is to be said, so that events without errors change nothing but what :meth:`rest` does."""
        quiet = not any(end.arq.busy or end.pending or end.leaving or end.loss for end in self.ends)
        met = self.expected.window == 0 and self.peripheral.arq.sent == EMPTY
        return quiet and met and self.on_air is None and self.central.phys == self.peripheral.phys

    def rest(self, event: int) -> None:
        """Pass over the events before *event*, which are polls and empty answers without errors.

        Of each 1 + latency of them the peripheral hears one. Raise LocalProtocolError unless it ``may_rest``.
        """
        if not self.may_rest or event < self.event:
            raise LocalProtocolError(f"a link that has come to event {self.event} does not rest until event {event}")
        central, peripheral, step = self.central, self.peripheral, 1 + self.peripheral.parameters.latency
        first = max(self.event, self._awake)
        if first < event:
            heard = (event - 1 - first) // step
            last = first + heard * step
            for end in self.ends:
                end.arq.sn, end.arq.nesn = end.arq.sn ^ 1 ^ (heard & 1), end.arq.nesn ^ 1 ^ (heard & 1)
            central.arq.sent = None
            anchor = central.clock.at_local(self.anchors.at(last))
            polled = anchor + central.phys[Side.CENTRAL].air_time(0)
            peripheral.supervision.heard(polled)
            central.supervision.heard(polled + T_IFS + central.phys[Side.PERIPHERAL].air_time(0))
            self.expected = self.expected.anchored(last, peripheral.clock.local(anchor))
            self._taken, self._awake = last, last + step
        if self._taken < event - 1 and event > self.event:
            central.arq.sent = EMPTY  # the last poll has had no answer
        self.event = event

    def anchor_at_rest(self, event: int) -> Time:
        """Return the instant at which *event*, not an earlier one than the next, begins if the link rests till then."""
        return self.central.clock.at_local(self.anchors.at(event))

    def opens_at_rest(self, event: int) -> Time | None:
        """Return from when on the peripheral listens for such an *event*; None if it sleeps through that one."""
        first, step = max(self.event, self._awake), 1 + self.peripheral.parameters.latency
        if event < first or (event - first) % step:
            return None
        clock, expected = self.peripheral.clock, self.expected
        if event > first:
            expected = expected.anchored(event - step, clock.local(self.anchor_at_rest(event - step)))
        return clock.at_local(expected.opens(event))

    def listening(self, since: Time, until: Time) -> Iterator[tuple[Time, Time]]:
        """Yield when in [since, until) the peripheral listens for events that have not begun, and do not begin then."""
        end, expected, clock = self.peripheral, self.expected, self.peripheral.clock
        if end.loss is not None:
            return
        first = expected.event if end.arq.busy else max(expected.event, self._awake)
        near = expected.event + (clock.local(since) - expected.local) // expected.interval - 2  # windows may overlap it
        for event in range(max(first, near), expected.lost_from()):
            opens = clock.at_local(expected.opens(event))
            if opens >= until:
                return
            closes = clock.at_local(expected.closes(event)) + end.phys[Side.CENTRAL].lead
            if closes > since:
                yield max(opens, since), min(closes, until)

    def begin(self, until: Time, present: bool = True) -> ConnectionEvent:
        """Begin the next event, for which there is time *until* then; raise LocalProtocolError if there is no link.

        *present*: whether the peripheral can listen, for all that is known of it elsewhere.
        """
        anchor = self.anchor
        self.advance(anchor)
        if self.central.loss is not None or self.on_air is not None:
            raise LocalProtocolError("the central has no connection any more, or an event is under way")
        event = self.expected.event_at(self.peripheral.clock.local(anchor))
        listening = present and event is not None and self._listens(event)
        self._taken = self.event if event is None else event
        ends = self.central.arq, self.peripheral.arq
        self.on_air = ConnectionEvent(ends, self.central.phys, anchor, until, listening)
        return self.on_air

    def _listens(self, event: int) -> bool:
        """Return whether the peripheral hears what the central sends now, which it takes for *event*."""
        end = self.peripheral
        return (
            end.loss is None
            and (event >= self._awake or end.arq.busy)
            and end.phys == self.central.phys
            and self.channel(Side.PERIPHERAL, event) == self.channel(Side.CENTRAL, self.event)
        )

    def ended(self, reception: Reception, room: bool = True) -> Heard:
        """Take what the other end made of the packet on the air, at its end (see :class:`ConnectionEvent`)."""
        event = self.on_air
        if event is None or event.packet is None:
            raise LocalProtocolError("no packet is on the air")
        packet = event.packet
        sender, receiver = self.ends[packet.sender], self.ends[1 - packet.sender]
        heard = event.hear(reception, room)
        if event.last_heard[receiver.side] == packet.end:
            receiver.supervision.heard(packet.end)
        if sender.leaving:
            sender.lose(Loss.TERMINATED, packet.end)
        if heard.acknowledged is not None and heard.acknowledged == encode_control(TerminateInd()):
            receiver.lose(Loss.TERMINATED, packet.end)
        if heard.new is not None and heard.new.llid is Llid.CONTROL:
            self._control(receiver, heard.new, packet.end)
        if sender.loss is None and receiver.loss is None:
            event.go_on()
        return heard

    def finish(self) -> None:
        """Go on to the next event once this one has ended; raise LocalProtocolError before that."""
        event, end = self.on_air, self.peripheral
        if event is None or event.packet is not None:
            raise LocalProtocolError("no event has ended")
        if event.anchored:
            self.expected = self.expected.anchored(self._taken, end.clock.local(event.anchor))
            resting = event.quiet and not end.arq.busy and not end.pending
            self._awake = self._taken + 1 + (end.parameters.latency if resting else 0)
        self.on_air = None
        self.event += 1

    # ---------------------------------------------------------------- control PDUs

    def _control(self, end: LinkEnd, fragment: Fragment, now: Time) -> None:
        """Do what a control PDU asks of the *end* that has heard it."""
        try:
            pdu = decode_control(fragment.payload)
        except WireError:
            self.errors += 1
            return
        match pdu:
            case TerminateInd():
                end.leaving = True
            case Lengths():
                end.peer_lengths = pdu
                if not pdu.response:
                    end.arq.push(encode_control(end.lengths._replace(response=True)))
            case Phys():
                self._answer_phys(end, pdu)
            case _:
                self._take_change(end, pdu, now)

    def _take_change(self, end: LinkEnd, change: Change, now: Time) -> None:
        if end.side is Side.CENTRAL:  # only centrals announce changes
            self.errors += 1
        elif (event := event_at(change.instant, self._taken)) is not None:
            end.schedule(event, change)
        else:
            end.lose(Loss.INSTANT_PASSED, now)

    def _answer_phys(self, end: LinkEnd, pdu: Phys) -> None:
        if end.side is Side.PERIPHERAL:
            end.arq.push(encode_control(Phys(True, end.likes, end.likes)))
            return
        down, up = (next((bit for bit in PHY_OF_BIT if bit & end.likes & wish), 0) for wish in (pdu.rx, pdu.tx))
        self.announce(lambda instant: PhyUpdateInd(down, up, instant))


def run_event(link: Link, until: Time, heard: Callable[[Packet], Reception]) -> list[tuple[Packet, Reception, Heard]]:
    """Run the next event of *link*; *heard* says what a listening end makes of each packet. Return them in order."""
    event, packets = link.begin(until), []
    while (packet := event.packet) is not None:
        reception = heard(packet)
        packets.append((packet, reception, link.ended(reception)))
    link.finish()
    return packets
