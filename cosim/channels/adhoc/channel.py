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
from itertools import pairwise
from typing import ClassVar, Final

import numpy as np
import numpy.typing as npt

from cosim.channels.adhoc.air import Medium
from cosim.channels.adhoc.dcf import Station
from cosim.channels.adhoc.errors import frame_log_success
from cosim.channels.adhoc.forwarding import Forwarding, make_router
from cosim.channels.adhoc.jamming import Jamming, source
from cosim.channels.adhoc.mac import Frame, Packet
from cosim.channels.adhoc.reception import Levels, RangeReceiver, Receiver, SinrReceiver
from cosim.channels.adhoc.routing.base import Delivery
from cosim.channels.adhoc.settings import AdhocSettings, mw
from cosim.channels.base import Arrival, Positions
from cosim.channels.ideal import IdealChannel, IdealSettings, of_each
from cosim.channels.jamming import Jammer
from cosim.channels.propagation import Barrier, Propagation
from cosim.errors import UserError
from cosim.geometry.segments import SegmentGrid, segment_grid
from cosim.kernel import Kernel
from cosim.machine import BROADCAST, Address, Fate, Outcome, Outgoing, Reception
from cosim.protocol import Metric
from cosim.randomness import Draws, Streams
from cosim.trace import FRAMES, TRANSMISSIONS, Trace
from cosim.units import Time, from_seconds

FAINT_MW: Final = 1e-14
"""Power (-140 dBm) below which a signal is neglected, even as interference."""
RECEPTION: Final = 2
"""Purpose of the draws of errors."""
JITTER: Final = 3
"""Purpose of the draws of the time that a host takes to hand over a payload."""
UNJAMMED: Final = {"ofdm": "it works at 5 GHz", "fhss": "its hopping is not modelled"}


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


class AdhocChannel(IdealChannel):
    """All robots' radios on one 802.11 channel."""

    metrics: ClassVar[tuple[Metric, ...]] = (
        Metric("frames_sent", "1", "frames on the air, those of the MAC and repeated ones too"),
        Metric(
            "payloads_dropped", "1", "payloads to one robot that were sent as often as allowed, and not acknowledged"
        ),
    )

    def __init__(
        self,
        settings: AdhocSettings,
        kernel: Kernel,
        trace: Trace,
        size: int,
        streams: Streams,
        walls: tuple[SegmentGrid, npt.ArrayLike] | None = None,
        strengths: Sequence[float | None] = (),
    ) -> None:
        """*walls* and the loss of each in dB matter if signals fade.

        *strengths* are the robots' own values, if not None, of ``power_dbm``, or of ``range_m`` if signals do not fade.
        """
        super().__init__(IdealSettings(delay_s=settings.propagation_s), kernel, trace, size)
        self._settings = settings
        self._most = settings.queue_payloads
        self._frames_wanted = trace.wants(FRAMES)
        self._transmissions_wanted = trace.wants(TRANSMISSIONS)
        self._propagation = _fading(settings, walls, streams)
        self._strength = _strength(settings, strengths, size)
        self._alike = len(np.unique(self._strength)) == 1
        self._reached: list[tuple[tuple[Address, float], ...]] | None = None
        """Robots that each robot reaches, and with how many mW; None until it is needed after a move."""
        self._positions_m: Positions = np.zeros((size, 2))
        self._receptions = {(a, to_all): Reception(a, to_all) for a in range(size) for to_all in (False, True)}
        self._arrivals: list[Arrival] = []
        self._dropped = 0
        timing = settings.timing()
        self._air = Medium(kernel, timing.delay, self._reaches, self._note, self._ended)
        self._held = [0] * size
        """Number of payloads that each device has been handed and has not finished."""
        self._draws = streams.draws("adhoc")
        self._handover = Handover(from_seconds(settings.host_jitter_s), size, kernel, self._draws)
        self._receivers = [self._receiver(address) for address in range(size)]
        self._stations = [
            Station(address, timing, settings.access, receiver, kernel, self._air, self, self._draws)
            for address, receiver in enumerate(self._receivers)
        ]
        self._air.stations = self._stations
        self._jamming = Jamming(kernel, self._jam_mw, self._jamming_matters)
        self._jamming.stations = self._stations
        self._forwarding = self._routers(streams)

    def _routers(self, streams: Streams) -> Forwarding | None:
        routing = self._settings.routing
        if routing is None:
            return None
        draws = streams.draws("routing")
        return Forwarding(self.size, lambda robot, now: make_router(routing, robot, draws, now), self.kernel, self)

    def _receiver(self, address: Address) -> Receiver:
        if self._propagation is None:
            return RangeReceiver()
        return SinrReceiver(self._settings.limits(), partial(self._is_right, address))

    def _is_right(self, address: Address, frame: Frame, levels: Levels) -> bool:
        """Draw whether *frame*, heard at *levels*, arrives without errors at *address*."""
        form = frame.form
        chance = math.exp(frame_log_success(self._settings.radio, form.rate_kbps, form.octets, levels))
        return self._draws.uniform(frame.begin, frame.source << 16 | address, RECEPTION) < chance

    # ------------------------------------------------------------ the channel's contract

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
        self._handover.hand(source, partial(self._queue, source, packet))

    def moved(self, positions_m: Positions) -> None:
        """Note that robots have moved; links between robots that are no longer in reach of each other are lost."""
        self._positions_m = positions_m
        self._reached = None
        self._jamming.moved()
        self._lose_links()

    def advance(self, now: Time) -> None:
        """Bring the power of jammers at stations up to *now*, while robots are still where they were."""
        self._jamming.advance()

    def power(self, address: Address, on: bool) -> None:
        """Switch a device on or off; what it holds is lost, and what it is just sending is spoilt."""
        super().power(address, on)
        self._reached = None
        self._stations[address].power(on)
        self._held[address] = 0
        self._handover.forget(address)
        if self._forwarding is not None:
            self._forwarding.power(address, on)

    def summary(self) -> dict[str, float]:
        """Return the number of frames sent, and of payloads given up."""
        routed: dict[str, float] = {} if self._forwarding is None else self._forwarding.summary()
        return {"frames_sent": float(self._air.frames), "payloads_dropped": float(self._dropped), **routed}

    def obstruct(self, barriers: Sequence[Barrier]) -> None:
        """Put *barriers*, and no others, in the way of signals from now on; raise UserError if signals do not fade."""
        if self._propagation is None:
            raise UserError("radios without propagation notice no walls")
        self._jamming.advance()
        self._propagation.set_barriers(tuple(barriers))
        self._reached = None
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
        places_m = np.array([(jammer.x_m, jammer.y_m) for jammer in jammers])
        if self._propagation is None:
            apart = np.linalg.norm(places_m[:, None] - self._positions_m[None], axis=-1)
            near: list[list[float]] = np.where(apart <= (self._settings.range_m or math.inf), 1.0, 0.0).tolist()
            return near
        gains_db = self._propagation.gains_db(np.vstack((self._positions_m, places_m)))[self.size :, : self.size]
        power_dbm = np.array([[jammer.power_dbm] for jammer in jammers]) + gains_db
        received: list[list[float]] = (10.0 ** (power_dbm / 10.0)).tolist()
        return received

    def _jamming_matters(self) -> bool:
        """Return whether jammers matter to any station now."""
        return not self._air.silent or any(not station.at_rest for station in self._stations)

    def _hears(self, one: Address, other: Address) -> bool:
        """Return whether a frame of *one* can be received by *other*, if nothing else is on the air."""
        if not super()._hears(one, other):
            return False
        least = 0.0 if self._propagation is None else self._settings.limits().follows_mw
        return any(address == other and power_mw >= least for address, power_mw in self._powers()[one])

    def _reaches(self, source: Address) -> Sequence[tuple[Address, float]]:
        """Return the robots that *source* reaches now, with how many mW: all that are switched on, however weakly."""
        return self._powers()[source]

    def _powers(self) -> Sequence[tuple[tuple[Address, float], ...]]:
        if self._reached is None:
            if self._propagation is None:
                apart = np.linalg.norm(self._positions_m[:, None] - self._positions_m[None], axis=-1)
                power = np.where(apart <= self._strength, 1.0, 0.0)
                np.fill_diagonal(power, 0.0)
            else:
                power = self._strength * 10.0 ** (self._propagation.gains_db(self._positions_m) / 10.0)
            on = np.array(self._on)
            one, other = np.nonzero((power > FAINT_MW) & on & on[:, None])
            heard = list(zip(other.tolist(), power[one, other].tolist(), strict=True))
            ends = np.searchsorted(one, np.arange(self.size + 1)).tolist()
            self._reached = [tuple(heard[begin:end]) for begin, end in pairwise(ends)]
        return self._reached

    # ------------------------------------------------------------ what stations report

    def received(self, address: Address, frame: Frame) -> None:
        """Take what has arrived at *address*: a payload, or a packet for its router."""
        assert frame.packet is not None
        if self._forwarding is not None:
            self._forwarding.received(address, frame)
            return
        delivery = Delivery(frame.source, frame.packet.payload, frame.destination == BROADCAST)
        self.arrived(address, delivery, self._receivers[address].power_mw)

    def arrived(self, address: Address, delivery: Delivery, power_mw: float | None = None) -> None:
        """Take a payload for the host at *address*; all of one instant are delivered together."""
        if not self._arrivals:
            self.kernel.soon(self._hand_over)
        reception = self._receptions[delivery.source, delivery.broadcast]
        if power_mw is not None:
            reception = reception._replace(rssi_dbm=10.0 * math.log10(power_mw))
        self._arrivals.append((address, delivery.payload, reception))

    def done(self, address: Address, packet: Packet, acknowledged: bool) -> None:
        """Report the fate of a packet to its host, or its router."""
        self._dropped += not acknowledged
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
            self._queue(address, packet)
        elif self._forwarding is not None:
            self._forwarding.refused(address, packet)

    def _queue(self, address: Address, packet: Packet) -> None:
        self._jamming.follow()
        self._stations[address].send(packet)

    def _hand_over(self) -> None:
        arrivals, self._arrivals = self._arrivals, []
        self.deliver([arrival for arrival in arrivals if self._on[arrival[0]]])

    def _note(self, frame: Frame, address: Address, received: bool) -> None:
        """Record every frame at every station in reach that it is meant for."""
        if self._frames_wanted and frame.destination in (BROADCAST, address):
            self._row(frame, address, "received" if received else "collided")

    def _ended(self, frame: Frame, whole: bool, reached: Sequence[tuple[Address, float]]) -> None:
        """Record what was on the air, and a row for a frame that has reached no robot that it was meant for."""
        meant_for = frame.destination
        if self._frames_wanted and not (reached if meant_for == BROADCAST else any(a == meant_for for a, _ in reached)):
            self._row(frame, meant_for, "out_of_range")
        if self._transmissions_wanted:
            packet = frame.packet
            again = packet is not None and packet.short + packet.long > 0  # a CTS has put failures of RTS back to 0
            body = "" if packet is None else packet.payload.hex()
            sent = frame.kind, meant_for, frame.reserves, frame.number, again, self._forwarding is not None, whole, body
            self.trace.row(TRANSMISSIONS, frame.begin, frame.source, *sent)

    def _row(self, frame: Frame, receiver: Address, outcome: str) -> None:
        length = 0 if frame.packet is None else len(frame.packet.payload)
        row = frame.begin, frame.source, receiver, frame.form.duration, frame.kind, -1, 0, length, outcome, ""
        self.trace.row(FRAMES, *row)


def _fading(
    settings: AdhocSettings, walls: tuple[SegmentGrid, npt.ArrayLike] | None, streams: Streams
) -> Propagation | None:
    if settings.propagation is None:
        return None
    grid, loss_db = walls or (segment_grid(()), ())
    return Propagation(settings.propagation, grid, loss_db, streams.draws("shadowing"))


def _strength(settings: AdhocSettings, own: Sequence[float | None], size: int) -> npt.NDArray[np.float64]:
    """Return the power of each robot in mW, or its range in m if signals do not fade; shape (size, 1)."""
    if settings.propagation is None:
        return np.array([[reach_m] for reach_m in of_each(own, settings.range_m or math.inf, size)])
    return np.array([[mw(power_dbm)] for power_dbm in of_each(own, settings.power_dbm, size)])
