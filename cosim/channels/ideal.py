"""The null model: every payload reaches everyone after a fixed delay, nothing is lost, links are there at once.

An experiment's cost on this channel is that of its algorithm; what it costs more on a radio is due to the radio. Roles
and link commands are answered as by a radio, with an event at the same instant, so that a machine that manages links
runs here unchanged.

Three flaws can be asked for, each independent of all else, unlike those of a radio: a range, a share of payloads that
are lost, and a random delay. With a random delay payloads overtake each other, also those from one robot to one other;
without it they never do.

Robots may have ranges of their own. That of the sender decides which robots get a payload, not that of the
receiver; whether the sender learns that it has arrived, and whether there is a link, depends on both.
"""

import math
from collections.abc import Sequence
from functools import partial
from typing import ClassVar, Final, Literal, NamedTuple

import numpy as np
from pydantic import Field

import cosim.elementary as elementary
from cosim.channels.base import Arrival, Channel, Flying, Positions
from cosim.channels.kinds import ChannelSettings, ChannelSpec
from cosim.errors import LocalProtocolError
from cosim.kernel import Kernel
from cosim.machine import (
    BROADCAST,
    Address,
    Connected,
    Disconnect,
    Discovered,
    Fate,
    Flush,
    Hold,
    Inquire,
    InquiryComplete,
    LinkCommand,
    LinkEvent,
    Lost,
    Mode,
    ModeChanged,
    Outcome,
    Outgoing,
    Page,
    PageFailed,
    Park,
    Reception,
    Role,
    RoleChanged,
    Scan,
    Share,
    Sniff,
    SwitchRole,
    Unpark,
)
from cosim.protocol import Metric
from cosim.randomness import Draws, Streams
from cosim.settings import Metres, Seconds
from cosim.trace import FRAMES, RECEPTIONS, TRANSMISSIONS, Trace
from cosim.units import Time, from_seconds

_LOSS: Final = 1
"""Purpose of the draws of losses."""
_JITTER: Final = 2
"""Purpose of the draws of delays."""


class _Flight(NamedTuple):
    """A payload on its way to some of its receivers, all of which get it at one instant."""

    source: Address
    outgoing: Outgoing
    begin: Time
    number: int
    """Number of payloads that *source* had sent before."""
    receivers: Sequence[Address]
    reported: bool = True
    """True if the sender gets the payload's fate, if it asked for it."""


class IdealSettings(ChannelSettings):
    """Messages arrive at once, within a range and but for a share that is lost, if these are given."""

    kind: Literal["ideal"] = "ideal"
    delay_s: Seconds = Field(default=1e-6, gt=0, description="from sending to arrival, for every payload")
    range_m: Metres | None = Field(
        default=None,
        gt=0,
        description="m, farther than that nothing arrives, unless the team says otherwise; by default all are in reach",
    )
    loss: float = Field(
        default=0.0, ge=0, le=1, description="probability that a payload does not arrive, for each receiver by itself"
    )
    jitter_s: Seconds = Field(
        default=0.0,
        ge=0,
        description="s, mean of an exponential delay on top of delay_s, for each payload and receiver by itself",
    )


def of_each(own: Sequence[float | None], common: float, size: int) -> list[float]:
    """Return what each of *size* robots' radios has *own*, or else *common*; nothing is own if *own* is empty."""
    return [common if one is None else one for one in own or (None,) * size]


class IdealChannel(Channel):
    """Instant links between all devices that are switched on and in range, and a fixed delay without loss."""

    metrics: ClassVar[tuple[Metric, ...]] = (Metric("frames_sent", "1", "payloads sent"),)

    def __init__(
        self,
        settings: IdealSettings,
        kernel: Kernel,
        trace: Trace,
        size: int,
        streams: Streams | None = None,
        reaches_m: Sequence[float | None] = (),
    ) -> None:
        """Take the run's *streams*, and for each robot what it has instead of ``range_m``, if not None.

        Raise LocalProtocolError if there are no *streams*, but losses or jitter.
        """
        super().__init__(kernel, trace, size)
        self.delay: Time = max(1, from_seconds(settings.delay_s))
        self.sent = 0
        self._flaws = settings
        self._chance: Draws | None = None
        if settings.loss or settings.jitter_s:
            if streams is None:
                raise LocalProtocolError("an ideal channel with losses or jitter needs the streams of the run")
            self._chance = streams.draws("ideal")
        self._numbers = [0] * size
        """Number of payloads that each device has sent, by which the draws are counted."""
        self._places_m: Positions = np.zeros((size, 2))
        reaches_m = of_each(reaches_m, settings.range_m or math.inf, size)
        self._reach_m = np.array(reaches_m)[:, None]
        self._limited = min(reaches_m) < math.inf
        self._alike = len(set(reaches_m)) == 1
        """True if all have the same range, so that hearing is mutual."""
        self._in_range: list[list[bool]] | None = None
        """Whether each robot (row) has each other in its range; None until it is needed after a move."""
        self._on = [True] * size
        self._on_since: list[Time] = [0] * size
        self._scanning = [True] * size
        self._paged: set[tuple[Address, Address]] = set()  # (master, slave)
        self._linked: set[tuple[Address, Address]] = set()
        """Those of them whose intervals are open."""
        self._under_way: dict[Time, list[_Flight]] = {}
        """Flights by their time of arrival."""
        self._events: list[tuple[Address, LinkEvent]] = []
        self._transmissions_wanted, self._receptions_wanted = trace.wants(TRANSMISSIONS), trace.wants(RECEPTIONS)
        self._rows_wanted = trace.wants(FRAMES) or self._receptions_wanted
        """True if rows of a payload are wanted when it arrives."""

    def send(self, source: Address, outgoing: Outgoing) -> None:
        """Deliver after the delay to whoever is in reach then, unless it is lost.

        The fate is SENT for a broadcast, after the fixed delay; for others it comes when the payload would arrive:
        DELIVERED, NO_LINK if the receiver is not in reach (any more), UNACKNOWLEDGED if the payload is lost (it is
        tried once) or the receiver does not reach the sender. It is NO_LINK at once if the receiver is not in reach
        now. A device that is switched off sends nothing.
        """
        if not self._on[source]:
            return
        destination = outgoing.destination
        if destination != BROADCAST and not self._hears(source, destination):
            self.note_unsent(source, outgoing.destination, len(outgoing.payload), Outcome.NO_LINK)
            if outgoing.token is not None:
                self._report((source, Fate(outgoing.token, Outcome.NO_LINK)))
            return
        self.sent += 1
        receivers = range(self.size) if destination == BROADCAST else (destination,)
        flight = _Flight(source, outgoing, self.kernel.now, self._numbers[source], receivers)
        self._numbers[source] += 1
        if self.payloads.wanted:
            self.payloads.accept(flight, source, destination, len(outgoing.payload), flight.begin)
            self.payloads.begin(flight, flight.begin)
        duration = self.delay
        if not self._flaws.jitter_s:
            self._launch(flight, duration)
        elif destination == BROADCAST:
            if outgoing.token is not None:  # its fate depends on no receiver
                self._launch(flight._replace(receivers=()), duration)
            for address in receivers:
                if address != source:
                    late = self._late(flight, address)
                    self._launch(flight._replace(receivers=(address,), reported=False), late)
                    duration = max(duration, late)
        else:
            duration = self._late(flight, destination)
            self._launch(flight, duration)
        if self._transmissions_wanted:
            self._write_transmission("IDEAL", flight.begin, source, outgoing, duration)
        if self.payloads.wanted and destination == BROADCAST:  # its receivers may get it one by one
            self.payloads.end(flight, flight.begin + duration, Outcome.SENT.value)

    def _write_transmission(
        self, kind: str, begin: Time, source: Address, outgoing: Outgoing, duration: Time, whole: bool = True
    ) -> None:
        """Write a row for a payload that is on its way for *duration*, to the last of its receivers."""
        payload = outgoing.payload
        plain = 0, 0, False, False, whole, payload.hex(), duration, -1, 0, len(payload)
        self.trace.row(TRANSMISSIONS, begin, source, kind, outgoing.destination, *plain)

    def _launch(self, flight: _Flight, delay: Time) -> None:
        """Have *flight* arrive after *delay*: all that arrive at one instant are one event."""
        arrival = flight.begin + delay
        flights = self._under_way.get(arrival)
        if flights is None:
            flights = self._under_way[arrival] = []
            self.kernel.after(delay, partial(self._arrive, arrival))
        flights.append(flight)

    def _late(self, flight: _Flight, address: Address) -> Time:
        """Draw the delay of *flight* to *address*."""
        return self.delay + from_seconds(
            -self._flaws.jitter_s * elementary.log1p(-self._draw(flight, address, _JITTER))
        )

    def _draw(self, flight: _Flight, address: Address, purpose: int) -> float:
        assert self._chance is not None
        return self._chance.uniform(flight.number, flight.source << 16 | address, purpose)

    def command(self, source: Address, command: LinkCommand) -> None:
        """Answer like a radio that takes no time. Nothing happens if the device is off."""
        if not self._on[source]:
            return
        match command:
            case Inquire(enough=enough):
                there = self.in_reach(source) if self._alike else (a for a in range(self.size) if self._meet(source, a))
                found = tuple(a for a in there if self._scanning[a])[:enough]
                self._report(*((source, Discovered(peer)) for peer in found), (source, InquiryComplete(found)))
            case Page(peer=peer) if self._meet(source, peer) and self._scanning[peer]:
                self._paged.discard((peer, source))
                self._paged.add((source, peer))
                self._note_links()
                self._report((source, Connected(peer, Role.MASTER)), (peer, Connected(source, Role.SLAVE)))
            case Page(peer=peer):
                self._report((source, PageFailed(peer)))
            case Scan(enabled=enabled):
                self._scanning[source] = enabled
            case Disconnect(peer=peer) if self._meet(source, peer):
                self._paged -= {(source, peer), (peer, source)}
                self._note_links()
                self._report((source, Lost(peer)), (peer, Lost(source)))
            case Hold(peer=peer) | Sniff(peer=peer) | Park(peer=peer) | Unpark(peer=peer):
                mode = Mode.ACTIVE if self._meet(source, peer) else Mode.NONE  # links are never at rest
                self._report((source, ModeChanged(peer, mode)))
            case SwitchRole(peer=peer) if self._meet(source, peer):
                self._switch(source, peer)
            case SwitchRole(peer=peer):
                self._report((source, ModeChanged(peer, Mode.NONE)))
            case Disconnect() | Flush() | Share():
                pass  # there is no such link; nothing ever waits in a queue, and time is not divided

    def _switch(self, source: Address, peer: Address) -> None:
        """Exchange the roles that the last page between two devices has given them."""
        for pair in ((source, peer), (peer, source)):
            if pair in self._paged:
                self._paged.remove(pair)
                self._paged.add(pair[::-1])
                self._note_links()
                roles = (Role.SLAVE, Role.MASTER) if pair[0] == source else (Role.MASTER, Role.SLAVE)
                self._report((source, RoleChanged(peer, roles[0])), (peer, RoleChanged(source, roles[1])))
                return
        self._report((source, RoleChanged(peer, Role.PEER)))

    def in_reach(self, address: Address) -> tuple[Address, ...]:
        """Return all other devices in its range that are switched on, if this one is."""
        return tuple(a for a in range(self.size) if self._hears(address, a))

    def moved(self, positions_m: Positions) -> None:
        """Note that ranges have changed; links between robots that are no longer in range of each other are lost."""
        if self._limited:
            self._places_m = positions_m
            self._in_range = None
            self._lose_links()

    def power(self, address: Address, on: bool) -> None:
        """Switch a device on or off; the others lose a dead one at once."""
        lost_by = () if on else self.in_reach(address)
        self._on[address] = on
        (self.intervals.end if on else self.intervals.begin)(address, "off", self.kernel.now)
        if on:  # it knows nothing of what was before
            self._on_since[address] = self.kernel.now
            self._paged = {pair for pair in self._paged if address not in pair}
        self._note_links()
        self._report(*((a, Lost(address)) for a in lost_by))

    def flying(self, now: Time) -> list[Flying]:
        """Return the payloads that are on their way *now*; with jitter to each of their receivers."""
        found = []
        for arrival, flights in self._under_way.items():
            for source, outgoing, begin, _, receivers, _ in flights:
                to, length = receivers[0] if len(receivers) == 1 else BROADCAST, len(outgoing.payload)
                found += [Flying(begin, source, arrival, "IDEAL", to, length, told=True)] if receivers else []
        return found

    def summary(self) -> dict[str, float]:
        """Return the number of payloads sent."""
        return {"frames_sent": float(self.sent)}

    def _meet(self, one: Address, other: Address) -> bool:
        """Return whether each hears the other, which a link needs."""
        return self._hears(one, other) and (self._alike or self._hears(other, one))

    def _hears(self, one: Address, other: Address) -> bool:
        """Return whether what *one* sends now reaches *other*."""
        there = one != other and 0 <= other < self.size and self._on[one] and self._on[other]
        return there and self._is_in_range(one, other)

    def _is_in_range(self, one: Address, other: Address) -> bool:
        if not self._limited:
            return True
        if self._in_range is None:
            apart_m = np.linalg.norm(self._places_m[:, None] - self._places_m[None], axis=-1)
            self._in_range = (apart_m <= self._reach_m).tolist()
        return self._in_range[one][other]

    def _knows_of(self, source: Address, begin: Time) -> bool:
        """Return whether the device of *source* is on, and has been since it began to send at *begin*."""
        return self._on[source] and self._on_since[source] <= begin

    def _lose_links(self) -> None:
        """Report the loss of each link between devices that no longer hear each other; for channels with a reach."""
        for pair in sorted(self._paged):
            if not self._meet(*pair):
                self._paged.discard(pair)
                self._report((pair[0], Lost(pair[1])), (pair[1], Lost(pair[0])))
        self._note_links()

    def _note_links(self) -> None:
        """Open and close the intervals of links that have come or gone: those of devices that are both on."""
        if not self.intervals.wanted:
            return
        now = self.kernel.now
        linked = {pair for pair in self._paged if self._on[pair[0]] and self._on[pair[1]]}
        for pair, change in (
            *((pair, self.intervals.end) for pair in sorted(self._linked - linked)),
            *((pair, self.intervals.begin) for pair in sorted(linked - self._linked)),
        ):
            for robot, peer, role in ((*pair, Role.MASTER), (*pair[::-1], Role.SLAVE)):
                change(robot, "link", now, f"peer={peer} role={role.value}")
        self._linked = linked

    def _arrive(self, now: Time) -> None:
        """Deliver what arrives now to receivers that are in reach and do not lose it; report fates to the senders."""
        arrivals: list[Arrival] = []
        events: list[tuple[Address, LinkEvent]] = []
        for flight in self._under_way.pop(now):
            source, outgoing = flight.source, flight.outgoing
            to_all = outgoing.destination == BROADCAST
            there = [a for a in flight.receivers if a != source and self._on[a] and self._is_in_range(source, a)]
            heard = [a for a in there if not self._is_lost(flight, a)] if self._flaws.loss else there
            reception = Reception(source, to_all)
            arrivals += [(address, outgoing.payload, reception) for address in heard]
            if self._rows_wanted:
                self._record(flight, there, heard)
            told = flight.reported and outgoing.token is not None and self._knows_of(source, flight.begin)
            if told or self.payloads.wanted:
                if to_all:
                    fate = Outcome.SENT
                elif heard and (self._alike or self._is_in_range(outgoing.destination, source)):
                    fate = Outcome.DELIVERED
                else:
                    fate = Outcome.UNACKNOWLEDGED if there else Outcome.NO_LINK
                if self.payloads.wanted:
                    self.payloads.end(flight, now, fate.value)
                if told and outgoing.token is not None:
                    events.append((source, Fate(outgoing.token, fate)))
        self.deliver(arrivals, events)

    def _is_lost(self, flight: _Flight, address: Address) -> bool:
        return self._draw(flight, address, _LOSS) < self._flaws.loss

    def _report(self, *events: tuple[Address, LinkEvent]) -> None:
        if not self._events and events:
            self.kernel.soon(self._pass_on)
        self._events.extend(events)

    def _pass_on(self) -> None:
        events, self._events = self._events, []
        self.deliver((), [item for item in events if self._on[item[0]]])

    def _record(self, flight: _Flight, there: Sequence[Address], heard: Sequence[Address]) -> None:
        """Write a row for *flight*; one for every receiver if not all get the same, or receptions are wanted."""
        if self._receptions_wanted:
            for address in flight.receivers:
                if address != flight.source:
                    outcome = self._outcome(address, there, heard)
                    self.trace.row(RECEPTIONS, flight.begin, flight.source, address, None, None, outcome, "")
        if not self._limited and self._chance is None:
            self._write(flight, flight.outgoing.destination, "received" if heard else "out_of_range")
            return
        for address in flight.receivers:
            if address != flight.source:
                self._write(flight, address, self._outcome(address, there, heard))

    @staticmethod
    def _outcome(address: Address, there: Sequence[Address], heard: Sequence[Address]) -> str:
        return "received" if address in heard else "lost" if address in there else "out_of_range"

    def _write(self, flight: _Flight, destination: Address, outcome: str) -> None:
        duration, length = self.kernel.now - flight.begin, len(flight.outgoing.payload)
        self.trace.row(FRAMES, flight.begin, flight.source, destination, duration, "IDEAL", -1, 0, length, outcome, "")


SPEC: Final = ChannelSpec(
    IdealSettings,
    lambda settings, site: IdealChannel(settings, site.kernel, site.trace, site.size, site.streams, site.reaches_m),
    lambda settings: "reach_m",
)
"""The channel."""
