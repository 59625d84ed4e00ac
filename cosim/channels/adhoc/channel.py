"""An 802.11 ad hoc network as a channel: a station for every robot, on one medium.

A payload to one robot is acknowledged by its radio, and sent again if it is not; one to all is sent once, at the lowest
basic rate. What looks like a link to a host is reach: inquiry finds the robots in reach, and a link ends with it. There
is no such thing in 802.11; it lets protocols that manage links run here unchanged.

Robots may have transmit powers of their own, or, where signals do not fade, ranges of their own: a frame arrives at all
robots within the sender's range, whatever theirs. So a robot may hear another that does not hear it: its
acknowledgements are lost, and payloads for it are repeated up to the limit.
"""

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import ClassVar, Final

import numpy as np
import numpy.typing as npt

import cosim.elementary as elementary
from cosim.arrays import Floats, Int64s
from cosim.channels.adhoc.forwarding import Forwarding, make_router
from cosim.channels.adhoc.jamming import Jamming, source
from cosim.channels.adhoc.mac import KINDS, Packet
from cosim.channels.adhoc.neighbours import Neighbours
from cosim.channels.adhoc.reach import FAINT_MW, Reach
from cosim.channels.adhoc.routing.base import COUNTS, Delivery, Router
from cosim.channels.adhoc.settings import UNJAMMED, AdhocSettings, mw
from cosim.channels.adhoc.state import END, FAILURE, FINISHED, HEARD, NEVER, NOTHING, Records, Report
from cosim.channels.adhoc.stations import Kept, Rules, Stations, Wanted
from cosim.channels.adhoc.tables import doings, receptions, transmissions
from cosim.channels.air.arbitration import Arbitration
from cosim.channels.air.shared import SharedAir
from cosim.channels.base import Arrival, Flying, Positions
from cosim.channels.energy import Accounts
from cosim.channels.ideal import IdealChannel, IdealSettings, of_each
from cosim.channels.jamming import Jammer
from cosim.channels.propagation import Barrier, Propagation
from cosim.errors import UserError
from cosim.geometry.segments import SegmentGrid, segment_grid
from cosim.intervals import Interval
from cosim.kernel import WORLD, Kernel
from cosim.machine import BROADCAST, Address, Fate, Outcome, Outgoing, Reception
from cosim.protocol import Metric
from cosim.randomness import Draws, Streams
from cosim.trace import FRAMES, RECEPTIONS, TRANSMISSIONS, Trace
from cosim.units import Time, from_seconds

JITTER: Final = 3
"""Purpose of the draws of the time that a host takes to hand over a payload."""


class Handover:
    """The ways from hosts to their radios: each takes a random time, and no payload overtakes another."""

    def __init__(self, jitter: Time, size: int, kernel: Kernel, draws: Draws) -> None:
        self._jitter = jitter
        self._kernel = kernel
        self._draws = draws
        self._handed = [0] * size
        self._last: list[Time] = [0] * size
        """Instant at which the last payload of each was handed over, or will be."""
        self._incarnations = [0] * size
        """Number of times that what was under way has been forgotten."""

    def hand(self, source: Address, take: Callable[[], None]) -> None:
        """Call *take* when a payload of *source* has reached its radio: at once if hosts take no time."""
        if self._jitter == 0:
            take()
            return
        late = self._draws.below(self._jitter + 1, self._handed[source], source, JITTER)
        self._handed[source] += 1
        self._last[source] = max(self._last[source], self._kernel.now + late)
        self._kernel.at(self._last[source], partial(self._arrive, source, self._incarnations[source], take))

    def forget(self, source: Address) -> None:
        """Lose what is under way from *source*."""
        self._incarnations[source] += 1

    def _arrive(self, source: Address, incarnation: int, take: Callable[[], None]) -> None:
        if incarnation == self._incarnations[source]:
            take()


_SENT = (
    Metric("frames_sent", "1", "frames on the air, those of the MAC and repeated ones too"),
    Metric("payloads_dropped", "1", "payloads to one robot that were sent as often as allowed, and not acknowledged"),
)
"""What all channels count, with routers or without."""


class AdhocChannel(IdealChannel):
    """All robots' radios on one 802.11 channel."""

    metrics: ClassVar[tuple[Metric, ...]] = (*_SENT, *COUNTS)

    def __init__(
        self,
        settings: AdhocSettings,
        kernel: Kernel,
        trace: Trace,
        size: int,
        streams: Streams,
        walls: tuple[SegmentGrid, npt.ArrayLike] | None = None,
        strengths: Sequence[float | None] = (),
        air: SharedAir | None = None,
    ) -> None:
        """*walls* and the loss of each in dB matter if signals fade.

        *strengths* are the robots' own values, if not None, of ``power_dbm``, or of ``range_m`` if signals do not fade.
        *air* is None if no radios of other kinds are heard.
        """
        super().__init__(IdealSettings(delay_s=settings.propagation_s), kernel, trace, size)
        self._settings = settings
        self._most = settings.queue_payloads
        self._air = air
        self._propagation = _fading(settings, walls, streams) if air is None else air.propagation
        self._strength = _strength(settings, strengths, size)
        self._alike = len(np.unique(self._strength)) == 1
        faintest_mw = FAINT_MW if self._propagation is None else max(FAINT_MW, settings.neglected_mw())
        self._reach = Reach(size, self._strength, faintest_mw, self._propagation)
        self._receptions = {(a, to_all): Reception(a, to_all) for a in range(size) for to_all in (False, True)}
        self._arrivals: list[Arrival] = []
        self._least_mw = 0.0 if self._propagation is None else settings.limits().follows_mw
        self._held = [0] * size
        """Number of payloads that each device has been handed and has not finished, where that has a limit."""
        self._draws = streams.draws("adhoc")
        self._handover = Handover(from_seconds(settings.host_jitter_s), size, kernel, self._draws)
        rules = Rules(settings.timing(), settings.access, None if settings.propagation is None else settings.limits())
        neighbours = None if air is None else Neighbours(air, settings, kernel, self._strength)
        wanted = Wanted(
            frames=trace.wants(FRAMES),
            intervals=self.intervals.wanted,
            transmissions=trace.wants(TRANSMISSIONS),
            receptions=trace.wants(RECEPTIONS),
            packets=self.payloads.wanted,
            begun=None if neighbours is None else neighbours.tell,
        )
        self._stations = Stations(size, rules, kernel, self._draws, self, wanted)
        if settings.energy is not None:
            self.accounts = Accounts(settings.energy, self._stations.uses, [settings.power_dbm] * size)
        self._jamming = Jamming(kernel, self._jam_mw, self._stations, size, neighbours)
        if neighbours is not None:
            neighbours.begun, neighbours.noticed = self._stations.take_begun, self._jamming.noticed
            if air is not None and air.arbitration is not None:
                self._arbitrate(air.arbitration, neighbours)
        self._forwarding = self._routers(streams)

    def _arbitrate(self, arbitration: Arbitration, neighbours: Neighbours) -> None:
        """Have stations ask before they send, and be deaf while another radio of their robot sends."""
        for robot in range(self.size):
            uses = partial(self._stations.used_until, robot)
            seat = arbitration.seat(robot, neighbours.number, uses, self.intervals)
            if seat is not None:
                self._stations.arbitrate(robot, seat)
        neighbours.own = self._hear_own

    def _hear_own(self, robot: Address, start: Time, end: Time) -> None:
        """Have the station of *robot* hear nothing in [start, end), in which another radio of it sends."""
        if start > self.kernel.now:
            self.kernel.at(start, partial(self._stations.deafen, robot, end), WORLD)
        else:
            self._stations.deafen(robot, end)

    def _routers(self, streams: Streams) -> Forwarding | None:
        routing = self._settings.routing
        if routing is None:
            return None
        draws = streams.draws("routing")

        def make(robot: Address, now: Time) -> Router:
            return make_router(routing, robot, draws, now)

        return Forwarding(self.size, make, self.kernel, self, self.intervals)

    # ------------------------------------------------------------ the channel's contract

    @property
    def columns(self) -> tuple[Metric, ...]:
        """The metrics that ``summary`` returns: those of the routers follow, if there are any."""
        routed = () if self._forwarding is None else self._forwarding.metrics
        return (*_SENT, *routed, *(() if self.accounts is None else self.accounts.columns))

    def send(self, source: Address, outgoing: Outgoing) -> None:
        """Queue a payload; its fate is DELIVERED when it is acknowledged, SENT when a broadcast has ended.

        UNACKNOWLEDGED when it has been tried often enough, QUEUE_FULL at once. A device that is off sends nothing.
        """
        if not self._on[source]:
            return
        if self._forwarding is not None:
            self._handover.hand(source, partial(self._forwarding.send, source, outgoing))
            return
        if self._most is not None and self._held[source] >= self._most:
            self.note_unsent(source, outgoing.destination, len(outgoing.payload), Outcome.QUEUE_FULL)
            if outgoing.token is not None:
                self._report((source, Fate(outgoing.token, Outcome.QUEUE_FULL)))
            return
        self._held[source] += 1
        packet = Packet(outgoing.destination, outgoing.payload, outgoing.token)
        if self.payloads.wanted:
            self._accept(source, packet)
        self._handover.hand(source, partial(self._queue, source, packet))

    def moved(self, positions_m: Positions) -> None:
        """Note that robots have moved; links between robots that are no longer in reach of each other are lost."""
        self._reach.moved(positions_m)
        self._stations.moved()
        self._jamming.moved()
        self._lose_links()

    def advance(self, now: Time) -> None:
        """Bring the power of jammers at stations up to *now*, while robots are still where they were."""
        self._jamming.advance()

    def power(self, address: Address, on: bool) -> None:
        """Switch a device on or off; what it holds is lost, and what it is just sending is spoilt."""
        super().power(address, on)
        if on:
            self.intervals.end(address, "off", self.kernel.now)
        else:
            self.intervals.begin(address, "off", self.kernel.now)
        self._reach.power(address, on)
        self._stations.moved()
        self._note_begun()
        self._stations.power(address, on)
        self.payloads.lose(address, self.kernel.now)
        self._held[address] = 0
        self._handover.forget(address)
        if self._forwarding is not None:
            self._forwarding.power(address, on)

    def under_way(self, now: Time) -> list[Interval]:
        """Return what its radios are doing *now*; what they have done before is written."""
        if self._forwarding is not None:
            self._forwarding.settle(now)
        columns = doings(self._stations.under_way(now))
        of_each = zip(columns.starts.tolist(), columns.stations.tolist(), columns.states, columns.details, strict=True)
        waits = [Interval(start, robot, now, 0, state, detail) for start, robot, state, detail in of_each]
        return super().under_way(now) + waits

    def flying(self, now: Time) -> list[Flying]:
        """Return the frames that are on the air *now*."""
        return self._stations.flying()

    def _note_begun(self) -> None:
        if self.payloads.wanted:
            for packet, at in self._stations.begun():
                self.payloads.begin(packet, at)

    def close(self, now: Time) -> None:
        """Write the intervals that are not over, and what is not written yet: the run is over."""
        if self._forwarding is not None:
            self._forwarding.settle(now)
        super().close(now)
        self._stations.close(now)

    def summary(self) -> dict[str, float]:
        """Return the number of frames sent, and of payloads given up."""
        routed: dict[str, float] = {} if self._forwarding is None else self._forwarding.summary()
        return {
            "frames_sent": float(self._stations.frames),
            "payloads_dropped": float(self._stations.dropped),
            **routed,
            **self._used(),
        }

    def obstruct(self, barriers: Sequence[Barrier]) -> None:
        """Put *barriers*, and no others, in the way of signals from now on; raise UserError if signals do not fade."""
        if self._propagation is None:
            raise UserError("radios without propagation notice no walls")
        self._jamming.advance()
        self._propagation.set_barriers(tuple(barriers))
        if self._air is not None:
            self._air.obstruct(barriers)
        self._reach.changed()
        self._stations.moved()
        self._jamming.moved()

    def jam(self, jammer: Jammer) -> None:
        """Put *jammer* on the air as well, at its times; raise UserError for a radio that is not in its band.

        Without a law of propagation its power does not matter: it spoils all that arrives in range_m of it.
        """
        if self._settings.phy in UNJAMMED:
            raise UserError(f"a radio with phy: {self._settings.phy} cannot be jammed: {UNJAMMED[self._settings.phy]}")
        heard = source(jammer, self._settings.channel, self._settings.radio.bandwidth_hz)
        if heard is not None:
            self._jamming.add(heard)

    def _jam_mw(self, jammers: Sequence[Jammer]) -> list[list[float]]:
        """Return the power of each jammer (row) at each robot on one of its channels, in mW."""
        places_m = [(jammer.x_m, jammer.y_m) for jammer in jammers]
        if self._propagation is None:
            return self._reach.from_others(places_m, [1.0] * len(jammers), self._settings.range_m or math.inf)
        return self._reach.from_others(places_m, [mw(jammer.power_dbm) for jammer in jammers], math.inf)

    def in_reach(self, address: Address) -> tuple[Address, ...]:
        """Return the robots that can receive a frame of *address*, if nothing else is on the air."""
        return self._reach.hearers(address, self._least_mw)

    def _hears(self, one: Address, other: Address) -> bool:
        """Return whether a frame of *one* can be received by *other*, if nothing else is on the air."""
        return super()._hears(one, other) and other in self.in_reach(one)

    def write_rows(self, first: Address, last: Address, rows: Records, begin: int) -> Int64s:
        """Write whom *first* to *last* reach now, with how many mW: all that are switched on, however weakly."""
        return self._reach.write(first, last, rows, begin)

    # ------------------------------------------------------------ what stations report

    def received(self, receivers: Sequence[Address], source: Address, packet: Packet, mw: Sequence[float]) -> None:
        """Take what has arrived at *receivers*: a payload, or a packet for their routers."""
        if self._forwarding is not None:
            self._forwarding.received(receivers, source, packet.payload)
            return
        if not self._arrivals:
            self.kernel.soon(self._hand_over)
        to_all, payload = packet.destination == BROADCAST, packet.payload
        if self._propagation is None:
            reception = self._receptions[source, to_all]
            self._arrivals += [(address, payload, reception) for address in receivers]
            return
        for address, power_mw in zip(receivers, mw, strict=True):
            self._arrivals.append((address, payload, Reception(source, to_all, 10.0 * elementary.log10(power_mw))))

    def arrived(self, address: Address, delivery: Delivery) -> None:
        """Take a payload for the host at *address*; all of one instant are delivered together."""
        if not self._arrivals:
            self.kernel.soon(self._hand_over)
        self._arrivals.append((address, delivery.payload, self._receptions[delivery.source, delivery.broadcast]))

    def done(self, address: Address, packet: Packet, acknowledged: bool) -> None:
        """Report the fate of a packet to its host, or its router."""
        self._held[address] -= 1
        if self._forwarding is not None:
            self._forwarding.done(address, packet, acknowledged)
            return
        if packet.token is not None:
            to_all = packet.destination == BROADCAST
            fate = Outcome.SENT if to_all else Outcome.DELIVERED if acknowledged else Outcome.UNACKNOWLEDGED
            self.report_fate(address, packet.token, fate)

    def report_fate(self, address: Address, token: int, outcome: Outcome) -> None:
        """Report the fate of a payload to the host of *address*."""
        self._report((address, Fate(token, outcome)))

    def transmit(self, address: Address, packet: Packet) -> None:
        """Have the station of *address* send a packet of its router; it is lost if there is no room for it."""
        if self._most is None or self._held[address] < self._most:
            self._held[address] += 1
            if self.payloads.wanted:
                self._accept(address, packet)
            self._queue(address, packet)
        elif self._forwarding is not None:
            self._forwarding.refused(address, packet)

    def _accept(self, address: Address, packet: Packet) -> None:
        self.payloads.accept(packet, address, packet.destination, len(packet.payload), self.kernel.now)

    def _queue(self, address: Address, packet: Packet) -> None:
        self._jamming.follow()
        if self._most is None and (packet.token is None or packet.only_failure):
            self._stations.send(address, packet, NOTHING if packet.token is None else FAILURE)
        else:
            self._stations.send(address, packet, END)

    def _hand_over(self) -> None:
        arrivals, self._arrivals = self._arrivals, []
        self.deliver([arrival for arrival in arrivals if self._on[arrival[0]]])

    def noted(self, report: Report, packet: Packet | None) -> None:
        """Record a frame at a robot that it is meant for, or that has not reached the one, or the end of a packet."""
        if report.what == FINISHED:
            if report.begin != NEVER:
                self.payloads.begin(packet, report.begin)
            to_all = report.right and packet is not None and packet.destination == BROADCAST
            fate = Outcome.SENT if to_all else Outcome.DELIVERED if report.right else Outcome.UNACKNOWLEDGED
            self.payloads.end(packet, report.begin + report.duration, fate.value)
        elif report.what == HEARD:
            if report.destination in (BROADCAST, report.station):
                self._row(report, packet, report.station, "received" if report.right else "collided")
        elif report.missed:
            self._row(report, packet, report.destination, "out_of_range")

    def logged(self, kept: Kept) -> None:
        """Write what the stations have kept for tables."""
        self.intervals.add_many(*doings(kept.intervals))
        self.trace.rows(TRANSMISSIONS, *transmissions(kept.transmissions, kept.carried, self._forwarding is not None))
        self.trace.rows(RECEPTIONS, *receptions(kept.receptions))

    def _row(self, report: Report, packet: Packet | None, receiver: Address, outcome: str) -> None:
        length = 0 if packet is None else len(packet.payload)
        frame = report.begin, report.source, receiver, report.duration, KINDS[report.kind]
        self.trace.row(FRAMES, *frame, -1, 0, length, outcome, "")


def _fading(
    settings: AdhocSettings, walls: tuple[SegmentGrid, npt.ArrayLike] | None, streams: Streams
) -> Propagation | None:
    if settings.propagation is None:
        return None
    grid, loss_db = walls or (segment_grid(()), ())
    return Propagation(settings.propagation, grid, loss_db, streams.draws("shadowing"))


def _strength(settings: AdhocSettings, own: Sequence[float | None], size: int) -> Floats:
    """Return the power of each robot in mW, or its range in m if signals do not fade; shape (size,)."""
    if settings.propagation is None:
        return np.array(of_each(own, settings.range_m or math.inf, size))
    return np.array([mw(power_dbm) for power_dbm in of_each(own, settings.power_dbm, size)])
