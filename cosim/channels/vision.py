"""Messages in sight: every payload reaches those in mutual line of sight, at a rate, after a latency.

With an unlimited rate and the default latency it is the paper's assumption that robots in sight of each other talk at
once (Sgorbissa and Arkin, "Local navigation strategies for a team of robots", section 1). With a rate and a latency it
is an optical link: light signals that a camera reads picture by picture. One payload is on its way from a sender at a
time; it is received by robots that are in sight of the sender when it begins and when it arrives. A sender that is
switched off before the end of its payload has not sent it.

What looks like a link to a host is the line of sight: inquiry finds the robots in sight, and a link ends when sight
does.
"""

from collections import deque
from collections.abc import Sequence
from functools import partial
from typing import ClassVar, Final, Literal, NamedTuple

import numpy as np
from pydantic import Field

from cosim.channels.base import Arrival, Flying, Positions
from cosim.channels.ideal import IdealChannel, IdealSettings
from cosim.channels.kinds import ChannelSettings, ChannelSpec
from cosim.geometry.segments import PackedWalls
from cosim.kernel import Handle, Kernel
from cosim.machine import BROADCAST, Address, Fate, LinkEvent, Outcome, Outgoing, Reception
from cosim.payloads import OFF
from cosim.protocol import Metric
from cosim.settings import BitRate, Metres, Seconds
from cosim.trace import FRAMES, RECEPTIONS, TRANSMISSIONS, Trace
from cosim.units import S, Time
from cosim.world.sight import look_again, seen_by_each

_KIND: Final = "OPTICAL"
"""Packet type of all its frames."""
_new: Final = tuple.__new__  # what a named tuple's own constructor calls; a third faster


class OpticalSettings(ChannelSettings):
    """Messages go by line of sight: a link with a rate and a latency to every robot that is seen."""

    kind: Literal["optical"] = "optical"
    range_m: Metres | None = Field(default=None, gt=0, description="m, how far one sees; without limit if not given")
    rate_bps: BitRate | None = Field(default=None, gt=0, description="bit/s of a sender; unlimited if not given")
    latency_s: Seconds = Field(default=1e-6, gt=0, description="s from the end of a payload to its arrival")


class _Flight(NamedTuple):
    """A payload on its way."""

    source: Address
    outgoing: Outgoing
    begin: Time
    looks: int
    """Number of the look at lines of sight by which it was sent."""
    audience: tuple[Address, ...]
    """Robots that were in sight when it began."""
    held: object
    """What it is known by among the payloads that radios hold."""


class OpticalChannel(IdealChannel):
    """All robots see and are seen all around; walls hide them, bodies do not."""

    metrics: ClassVar[tuple[Metric, ...]] = (
        Metric("frames_sent", "1", "payloads sent"),
        Metric("frames_missed", "1", "payloads times robots that were in sight at the beginning and did not get them"),
    )

    def __init__(self, settings: OpticalSettings, kernel: Kernel, trace: Trace, size: int, walls: PackedWalls) -> None:
        super().__init__(IdealSettings(delay_s=settings.latency_s), kernel, trace, size)
        self._rows_wanted = any(map(trace.wants, (FRAMES, TRANSMISSIONS, RECEPTIONS)))
        self._all_on = True
        self._walls = walls
        self._range_m = settings.range_m or float("inf")
        self._rate_bps = settings.rate_bps
        self._receptions = {(a, to_all): Reception(a, to_all) for a in range(size) for to_all in (False, True)}
        self._free_at: list[Time] = [0] * size
        self._waiting: list[deque[Handle]] = [deque() for _ in range(size)]
        """Payloads of each robot that begin when all before them have been sent."""
        self._in_flight: dict[Time, list[_Flight]] = {}
        """Flights by their time of arrival."""
        self._positions_m: Positions | None = None
        """Positions of the robots that lines of sight have not yet been computed for."""
        self._in_sight: list[tuple[Address, ...]] = [()] * size
        """Robots in sight of each, switched on or not; to be read by ``_sight`` only."""
        self._seen = np.zeros((size, size), np.bool_)
        """The lines of sight as a matrix."""
        self._looks = 0
        """Number of times that it has changed, or may have."""
        self._missed = 0
        self._occluded: set[tuple[Address, Address]] = set()
        """(receiver, sender) of whom a payload is on the air while there is no line of sight; if that is wanted."""

    def moved(self, positions_m: Positions) -> None:
        """Note that lines of sight have changed; links between robots that no longer see each other are lost."""
        self._positions_m = positions_m
        self._looks += 1
        if self._paged:
            self._lose_links()
        if self._in_flight and self.intervals.wanted:
            self._note_occlusions()

    def power(self, address: Address, on: bool) -> None:
        """Switch a device on or off; those in sight lose a dead one at once."""
        super().power(address, on)
        if not on:  # what waits is lost, and what has not come to its end
            for handle in self._waiting[address]:
                handle.cancel()
            self._waiting[address].clear()
            self._free_at[address] = self.kernel.now
            self._cut_off(address)
            self.payloads.lose(address, self.kernel.now, waiting=True)
        self._looks += 1
        self._all_on = all(self._on)

    def _cut_off(self, source: Address) -> None:
        """Lose the payload that *source* is just sending; what has been sent to its end arrives."""
        for arrival, flights in self._in_flight.items():
            if arrival - self.delay > self.kernel.now:
                for flight in [flight for flight in flights if flight.source == source]:
                    flights.remove(flight)
                    self._missed += len(flight.audience)
                    if self._rows_wanted:
                        self._note(flight, (), whole=False)
                    self.payloads.end(flight.held, self.kernel.now, OFF)
        if self._occluded:
            self._note_occlusions()

    def in_reach(self, address: Address) -> tuple[Address, ...]:
        """Return all other devices in sight that are switched on, if this one is."""
        if self._all_on:
            return self._sight()[address]
        return super().in_reach(address)

    def send(self, source: Address, outgoing: Outgoing) -> None:
        """Send as soon as all before it has been sent; NO_LINK, at once, to a robot that is not in sight.

        A device that is switched off sends nothing.
        """
        if not self._on[source]:
            return
        if outgoing.destination != BROADCAST and not self._hears(source, outgoing.destination):
            self.note_unsent(source, outgoing.destination, len(outgoing.payload), Outcome.NO_LINK)
            if outgoing.token is not None:
                self._report((source, Fate(outgoing.token, Outcome.NO_LINK)))
            return
        held = None
        if self.payloads.wanted:
            held = object()
            self.payloads.accept(held, source, outgoing.destination, len(outgoing.payload), self.kernel.now)
        if self._rate_bps is None:
            self._begin(source, outgoing, 0, held)
            return
        begin = max(self.kernel.now, self._free_at[source])
        duration = -(-8 * len(outgoing.payload) * S // self._rate_bps)
        self._free_at[source] = begin + duration
        if begin == self.kernel.now:
            self._begin(source, outgoing, duration, held)
        else:
            turn = partial(self._begin_next, source, outgoing, duration, held)
            self._waiting[source].append(self.kernel.at(begin, turn))

    def _begin_next(self, source: Address, outgoing: Outgoing, duration: Time, held: object) -> None:
        self._waiting[source].popleft()
        self._begin(source, outgoing, duration, held)

    def _begin(self, source: Address, outgoing: Outgoing, duration: Time, held: object) -> None:
        """Let a payload begin that takes *duration* without the latency."""
        audience = self.in_reach(source) if outgoing.destination == BROADCAST else (outgoing.destination,)
        self.sent += 1
        now = self.kernel.now
        arrival = now + duration + self.delay
        flights = self._in_flight.get(arrival)
        if flights is None:
            flights = self._in_flight[arrival] = []
            self.kernel.at(arrival, partial(self._land, arrival))
        flights.append(_new(_Flight, (source, outgoing, now, self._looks, audience, held)))
        if held is not None:
            self.payloads.begin(held, now)

    def _land(self, arrival: Time) -> None:
        """Deliver what arrives now to robots that are still in sight, and report fates to the senders."""
        arrivals: list[Arrival] = []
        events: list[tuple[Address, LinkEvent]] = []
        for flight in self._in_flight.pop(arrival):
            source, outgoing, begin, looks, audience, held = flight
            to_all = outgoing.destination == BROADCAST
            heard = audience
            if looks != self._looks:  # robots have moved meanwhile, or devices have been switched
                in_sight = self._sight()[source]
                heard = tuple(address for address in audience if self._on[address] and address in in_sight)
                self._missed += len(audience) - len(heard)
            reception, payload = self._receptions[source, to_all], outgoing.payload
            for address in heard:
                arrivals.append((address, payload, reception))
            if self._rows_wanted:
                self._note(flight, heard)
            fate = Outcome.SENT if to_all else Outcome.DELIVERED if heard else Outcome.NO_LINK
            if outgoing.token is not None and self._knows_of(source, begin):
                events.append((source, Fate(outgoing.token, fate)))
            if held is not None:
                self.payloads.end(held, self.kernel.now, fate.value)
        if self._occluded:
            self._note_occlusions()
        self.deliver(arrivals, events)

    def _note(self, flight: _Flight, heard: Sequence[Address], whole: bool = True) -> None:
        """Write the rows of a flight that is over, of which some have *heard*; its sender was on if it is *whole*."""
        source, outgoing, begin, _, audience, _ = flight
        duration, length = self.kernel.now - begin, len(outgoing.payload)
        if self._transmissions_wanted:
            self._write_transmission(_KIND, begin, source, outgoing, duration, whole)
        for address in audience:
            outcome = "received" if address in heard else "out_of_range"
            self.trace.row(FRAMES, begin, source, address, duration, _KIND, -1, 0, length, outcome, "")
            self.trace.row(RECEPTIONS, begin, source, address, None, None, outcome, "")

    def _note_occlusions(self) -> None:
        """Open and close the intervals in which robots do not see a sender whose payload is on the air for them."""
        sight, now = self._sight(), self.kernel.now
        flights = (flight for flights in self._in_flight.values() for flight in flights)
        occluded = {(a, flight.source) for flight in flights for a in flight.audience if a not in sight[flight.source]}
        for receiver, source in sorted(self._occluded - occluded):
            self.intervals.end(receiver, "occluded", now, f"peer={source}")
        for receiver, source in sorted(occluded - self._occluded):
            self.intervals.begin(receiver, "occluded", now, f"peer={source}")
        self._occluded = occluded

    def flying(self, now: Time) -> list[Flying]:
        """Return the payloads that are on the air *now*."""
        return [
            Flying(each.begin, each.source, arrival, _KIND, each.outgoing.destination, len(each.outgoing.payload))
            for arrival, flights in self._in_flight.items()
            for each in flights
        ]

    def close(self, now: Time) -> None:
        """Write the intervals that are not over, and the payloads that are on the air: the run is over."""
        super().close(now)
        if not self._transmissions_wanted:
            return
        for arrival, flights in self._in_flight.items():
            for flight in flights:
                self._write_transmission(_KIND, flight.begin, flight.source, flight.outgoing, arrival - flight.begin)

    def summary(self) -> dict[str, float]:
        """Return how many payloads were sent, and how often a robot in sight did not get one."""
        numbers = {"frames_sent": self.sent, "frames_missed": self._missed}
        return {name: float(number) for name, number in numbers.items()}

    def _hears(self, one: Address, other: Address) -> bool:
        return super()._hears(one, other) and other in self._sight()[one]

    def _sight(self) -> list[tuple[Address, ...]]:
        """Return the robots in sight of each, computed once after a move when it is first needed."""
        positions_m = self._positions_m
        if positions_m is not None:
            self._positions_m = None
            if look_again(self._walls, positions_m, self._range_m, self._seen):
                self._in_sight = seen_by_each(self._seen)
        return self._in_sight


SPEC: Final = ChannelSpec(
    OpticalSettings,
    lambda settings, site: OpticalChannel(settings, site.kernel, site.trace, site.size, site.packed),
)
"""The channel."""
