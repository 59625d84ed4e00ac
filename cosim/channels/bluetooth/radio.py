"""The air between Bluetooth devices, as the procedures see it: frames are put on it, and their fates asked for.

The arithmetic is in ``medium`` (what overlaps, what survives) and ``band`` (piconets without payloads, advanced
together). Every change of powers, or of the devices that send, comes through here: all piconets are brought up to now
first.
"""

import sys
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property
from typing import Final, Literal, NamedTuple, TypeAlias

import numpy as np

import cosim.elementary as elementary
from cosim.arrays import Floats, Int64s
from cosim.channels.bluetooth import band as bands
from cosim.channels.bluetooth import medium as mediums
from cosim.channels.bluetooth.band import LOG_FIELDS, LOG_POWERS, Adapted, Band
from cosim.channels.bluetooth.bits.errors import ACCESS_CODE
from cosim.channels.bluetooth.hopping import adapted_hop, basic_hop
from cosim.channels.bluetooth.medium import (
    BIT_ERRORS,
    BUSY,
    MET,
    NOT_TUNED,
    OUT_OF_RANGE,
    RECEIVED,
    Foreign,
    Noise,
    Records,
)
from cosim.channels.bluetooth.packets import HEADER_AIR, ID_AIR
from cosim.channels.bluetooth.polling import (
    PAIR_LINK,
    PAIR_TICK,
    PHASE,
    PPM,
    SLAVE,
    STAGE,
    USED,
    WORD,
)
from cosim.channels.bluetooth.reporting.metering import LOG_ROWS, Meter
from cosim.channels.bluetooth.reporting.seats import Seats
from cosim.channels.bluetooth.reporting.tenancy import Tenancy
from cosim.channels.clock import NativeClock, start_of
from cosim.channels.courses import Courses
from cosim.channels.jamming import Jammer
from cosim.kernel import Kernel
from cosim.machine import Address
from cosim.payloads import Payloads
from cosim.units import MS, Time

Interference: TypeAlias = Literal["none", "co_channel", "neighbouring"]
MODES: Final[dict[str, int]] = {
    "none": mediums.NONE,
    "co_channel": mediums.CO_CHANNEL,
    "neighbouring": mediums.NEIGHBOURING,
}
LONGEST_FRAME: Final[Time] = 4 * MS
"""Bound of the air time of a frame of Basic Rate (five slots are 3.125 ms)."""
LATEST: Final = 16
"""Number of latest frames that are kept for each device: it sends one a half-slot at most, and none lasts so long."""
FOREVER: Final[Time] = 1 << 61
_NOTHING_DBM: Final = float("-inf")
_NO_LOG: Final = np.empty((0, LOG_FIELDS), dtype=np.int64)
_NO_POWERS: Final = np.empty((0, LOG_POWERS))


class Heard(StrEnum):
    """The fate of a frame at the receiver that it was meant for."""

    RECEIVED = "received"
    OUT_OF_RANGE = "out_of_range"
    COLLIDED = "collided"
    BIT_ERRORS = "bit_errors"
    NOT_TUNED = "not_tuned"
    """The receiver listened on another channel, or not at all."""
    BUSY = "busy"
    """The receiver was in the middle of another frame, or another radio of the robot has sent."""
    REFUSED = "refused"
    """The receiver had no room for the payload (flow control)."""


class Part(StrEnum):
    """The section of a frame that failed first, as collisions and bit errors have it."""

    NONE = ""
    ACCESS_CODE = "access_code"
    HEADER = "header"
    PAYLOAD = "payload"


@dataclass(frozen=True)
class Fate:
    """The fate of a frame, and which part of it failed if one did."""

    heard: Heard
    part: Part = Part.NONE

    @cached_property
    def judged(self) -> bool:
        """True if it depends on what else is on the air."""
        return self.heard not in _UNJUDGED

    @cached_property
    def header_heard(self) -> bool:
        """True if the receiver has noticed the frame and knows its header."""
        return self.heard is Heard.RECEIVED or self.heard is Heard.REFUSED or self.part is Part.PAYLOAD


_UNJUDGED: Final = (Heard.OUT_OF_RANGE, Heard.NOT_TUNED)
_UNHEARD: Final = (*_UNJUDGED, Heard.BUSY)
_PARTS: Final = tuple(Part)
FATES: Final[tuple[Fate, ...]] = (
    Fate(Heard.RECEIVED),
    *(Fate(Heard.COLLIDED, part) for part in _PARTS[1:]),
    Fate(Heard.RECEIVED),  # BIT_ERRORS in no section
    *(Fate(Heard.BIT_ERRORS, part) for part in _PARTS[1:]),
    Fate(Heard.OUT_OF_RANGE),
    Fate(Heard.NOT_TUNED),
    Fate(Heard.BUSY),
)
"""The fates by the numbers that compiled functions return."""
assert FATES[BIT_ERRORS + 1].heard is Heard.BIT_ERRORS
GOOD, FAR, UNTUNED, TAKEN = (FATES[number] for number in (RECEIVED, OUT_OF_RANGE, NOT_TUNED, BUSY))
REFUSED: Final = Fate(Heard.REFUSED)


class Frame(NamedTuple):
    """One frame on the air."""

    start: Time
    duration: Time
    kind: str
    """Packet type: ID, FHS, POLL, NULL, DM1..."""
    source: Address
    destination: Address
    """The receiver that it is meant for; BROADCAST for all slaves."""
    channel: int
    """RF channel k, 2402 + k MHz."""
    lt_addr: int = 0
    """Logical transport address; 0 for a broadcast and outside of a piconet."""
    length: int = 0
    """User payload in bytes."""


def was_sent(air: "Air", frame: Frame) -> bool:
    """Return whether the *frame* of a train has been sent, for all that other radios of its sender do."""
    return air.seats is None or air.seats.has_sent_id(frame.source, frame.start)


IdleFrame: TypeAlias = Callable[[int, int, bool, Fate, float, float], None]
"""Called with (tick, LT_ADDR, whether the frame went up to the master, its fate, and, if they are wanted, its power at
the receiver in dBm and the most that overlaps one of its sections there in mW)."""


class Air:
    """The air between *size* devices. *record*, if given, is called with every frame that is judged, and its fate.

    *sent*, if given, is called with every frame that is recorded, once, its body, and whether that has been on the air
    before; *arrived* for each receiver with the frame, its fate, its power there in dBm, and the most that overlaps one
    of its sections there in mW.

    *key* is the key of the draws of bit errors; without noise (-inf dBm) there are none.
    """

    seats: Seats | None = None
    """Where devices ask before they send, if arbiters divide the air between a robot's radios."""
    meter: Meter | None = None
    """Takes what devices do, if a scenario asks for that."""

    def __init__(
        self,
        size: int,
        record: Callable[[Frame, Fate], None] | None = None,
        interference: Interference = "co_channel",
        noise_dbm: float = float("-inf"),
        key: tuple[int, int] = (0, 0),
        sent: Callable[[Frame, bytes, bool], None] | None = None,
        arrived: Callable[[Frame, Fate, float, float], None] | None = None,
        neighbours: Callable[["Air"], Tenancy] | None = None,
    ) -> None:
        self.medium = mediums.new_medium(size, MODES[interference])
        self.band: Band = bands.new_band(self.medium)
        self.adapted: Adapted | None = None
        """The adapted hop sets, if there are any."""
        self.noise = Noise(noise_dbm, *key) if noise_dbm > _NOTHING_DBM else None
        self.fades = self.noise is not None
        """True if powers are those of a law of propagation."""
        self._jammers: Foreign | None = None
        self.tenancy = None if neighbours is None else neighbours(self)
        """Its place in an air that others share,"""
        self.neighbours: Tenancy | None = None
        """which is this as long as they send anything."""
        self.calm = True
        """True if no frame that starts from ``stray`` on can be destroyed."""
        self.least_dbm = max(noise_dbm + mediums.DETECTABLE_DB, -sys.float_info.max)
        """Power from which on a receiver notices a frame."""
        self._record = record
        self.record_sent = sent
        """Takes each frame that has been on the air, once, if a trace wants that."""
        self._arrived = arrived
        self.recorded = not (record is None and sent is None and arrived is None)
        """True if a trace wants frames, or what is sent, or what arrives."""
        self.latest: deque[Frame] = deque(maxlen=LATEST * size)
        """Frames that have been sent last, or are sent soon, of those that a trace is told at their ends."""
        self._clear: tuple[Address, Time, Address] | None = None
        """(source, start, receiver) of a frame that has just been found to meet nothing, if anybody wants to know."""
        self._running = 0
        """Number of piconets that send anything."""
        self._master: Address | None = None
        """The only one, if it is, and nothing else that could destroy a frame is sent from ``stray`` on."""
        self._alone = False
        """True if that is so from now on: its idle frames are not put on the air."""
        self.sent: deque[tuple[Address, Time, Time, int]] = deque()
        """Frames (source, start, end, channel) that are not in the medium yet, which needs few of them."""
        self._others: Time = 0
        """Instant at which the last frame that is in the medium may be over."""
        self._idle: dict[Address, IdleFrame] = {}  # by master, where idle frames are wanted
        self._log = _NO_LOG
        self._powers = _NO_POWERS
        """What kernels write of idle frames; without rows if nobody wants that."""
        self.stray: Time = 0
        """Instant from which nothing is on the air that a change, an inquiry or a page has left there."""
        self._trains: list[_Train] = []  # as in the medium
        self._silences: tuple[Int64s, Int64s]
        """Where the medium keeps when trains are interrupted, by train."""
        self._closing: Time = FOREVER  # when the first train that has ended may be forgotten
        self._power: list[list[float]] | None = None
        """The powers, if anybody has asked for one since they changed."""

    # ------------------------------------------------------------ powers

    def set_powers(self, power_dbm: Floats, now: Time) -> None:
        """Let devices receive each other with *power_dbm*, shape (n, n), from now on; -inf is nothing."""
        self.advance(now, now - 1)
        self.medium.power_dbm[:] = power_dbm
        self._power = None
        if self.meter is not None:
            self.meter.changed(now)

    def carrier(self, source: Address, receiver: Address) -> float:
        """Return the power in dBm with which *receiver* gets *source* now."""
        if self._power is None:
            self._power = self.medium.power_dbm.tolist()
        return self._power[source][receiver]

    def reaches(self, carrier_dbm: float) -> bool:
        """Return whether a receiver notices a frame of this power."""
        return carrier_dbm >= self.least_dbm

    def set_jammers(self, jammers: Sequence[Jammer], now: Time) -> None:
        """Put these jammers, and no others, on the air; no device receives them before :meth:`set_jam_powers`."""
        self.advance(now)
        self._jammers = mediums.jamming(jammers, len(self.medium.power_dbm)) if jammers else None
        self.changed(now)

    def set_jam_powers(self, power_dbm: Floats, now: Time) -> None:
        """Let the jammers be received with *power_dbm*, shape (jammers, n), from now on."""
        self.advance(now, now - 1)
        if self._jammers is not None:
            self._jammers.power_mw[:] = elementary.exp10s(power_dbm / 10.0)

    # ------------------------------------------------------------ time

    def advance(self, now: Time, last_end: Time | None = None) -> None:
        """Bring all piconets up to *now*: slots that start before, frames that end by *last_end*, by default now.

        A frame that ends at the instant at which powers change is judged with the new ones.
        """
        last_end = now if last_end is None else last_end
        neighbours = self.neighbours
        if neighbours is not None:
            neighbours.gather(last_end)
        if self._running and self._closing < now:
            self.advance(self._closing)  # from there on a piconet may be alone
        if self._idle:
            self._advance_together(now, last_end)
        elif self._running:
            if self._master is not None and not self._alone:
                since = min(self.stray, now)
                self._advance_together(since, last_end if since == now else since)
                self._alone = self.stray <= now
            if self._master is None:
                self._advance_together(now, last_end)
            elif self._alone:
                if self.meter is None:
                    bands.run_alone(*self.band, self.noise, self.adapted, self._master, now, last_end, None)
                else:
                    self._log_alone(self._master, now, last_end, self.meter.log)
        if now >= self._closing:
            self._forget_trains(now)

    def _advance_together(self, now: Time, last_end: Time) -> None:
        self._put_sent()
        self._others = max(self._others, now + LONGEST_FRAME)
        log, more = self._log if self.meter is None else self.meter.log, True
        while more:
            state = self.band, self.medium, self.noise, self._foreign, self.adapted
            count = int(bands.advance(*state, now, last_end, log, self._powers))
            more = count > len(log)
            if count:
                self._report(log[:count])
            if self.neighbours is not None and self.neighbours.tell_begun():
                more = True

    def _log_alone(self, master: Address, now: Time, last_end: Time, log: Int64s) -> None:
        more = True
        while more:
            count = bands.run_alone(*self.band, self.noise, self.adapted, master, now, last_end, log)
            more = count > len(log)
            if count:
                self._report(log[:count])

    @property
    def _foreign(self) -> Foreign | None:
        """What disturbs and is not Bluetooth's."""
        neighbours = self.neighbours
        return self._jammers if neighbours is None else neighbours.heard(self._jammers)

    def _report(self, log: Int64s) -> None:
        """Report the idle frames of these rows of the log, and of as many of the powers."""
        powers = self._powers[: len(log)]
        if self.meter is not None:
            self.meter.take(log)
        if not self._idle:
            return
        arrived = powers.tolist() if len(powers) else [(_NOTHING_DBM, 0.0)] * len(log)
        for (master, tick, k, up, fate), (power_dbm, met_mw) in zip(log.tolist(), arrived, strict=True):
            if master in self._idle:
                self._idle[master](tick, k, bool(up), FATES[fate], power_dbm, met_mw)

    def report_idle(self, master: Address, report: IdleFrame) -> None:
        """Call *report* with every idle POLL and NULL of the piconet of *master* from now on."""
        self._idle[master] = report
        self._log = np.empty((LOG_ROWS, LOG_FIELDS), dtype=np.int64)
        self._powers = _NO_POWERS if self._arrived is None else np.empty((LOG_ROWS, LOG_POWERS))

    def changed(self, now: Time) -> None:
        """Note that devices have begun or ended to send or to listen; all piconets must be advanced to *now* before."""
        self._disturb()
        self._running, master = bands.senders(self.band.piconets, self.band.links)
        self._settle(master if master >= 0 else None, now)
        self._review()
        if self.meter is not None:
            self.meter.changed(now)

    def _trains_changed(self, now: Time) -> None:
        """Note that a train has begun or is forgotten."""
        if self._running:  # or perhaps not any more
            self.changed(now)
            return
        self._disturb()
        self._settle(None, now)
        self._review()

    def _review(self) -> None:
        """Have others notice if Bluetooth has begun, or ceased, to send."""
        if self.tenancy is not None:
            self.tenancy.review()

    def _settle(self, master: Address | None, now: Time) -> None:
        """Note what can destroy frames; *master* is that of the only piconet that sends anything, if it is."""
        self._stray_until(now + LONGEST_FRAME)
        medium = self.medium
        quiet = medium.mode == mediums.NONE or (
            not len(medium.trains) and self._jammers is None and self.neighbours is None
        )
        self._master = master if quiet else None
        alone = medium.mode == mediums.NONE or self._running <= 1
        self.calm = self.noise is None and quiet and alone

    def _disturb(self) -> None:
        """End the time in which a piconet is alone on the air."""
        if self._alone and self._master is not None:
            self._alone = False
            self._expose(self._master)

    def _expose(self, master: Address) -> None:
        """Put the idle pair under way in a piconet, which was alone up to now, on the air for others to meet."""
        for start, duration, _, source, _, channel, *_ in self._idle_pair(master):
            self._note(source, start, start + duration, channel)

    def _note(self, source: Address, start: Time, end: Time, channel: int) -> None:
        """Note a frame that is on the air; a frame that has been over for long can meet nothing any more."""
        sent = self.sent
        while sent and sent[0][2] + 2 * LONGEST_FRAME < start:
            sent.popleft()
        sent.append((source, start, end, channel))
        if self.meter is not None:
            self.meter.sent(source, start, end)
        if self.neighbours is not None:
            self.neighbours.tell(source, start, end, channel)

    def _put_sent(self) -> None:
        """Put into the medium what is not there yet."""
        for source, start, end, channel in self.sent:
            mediums.put(self.medium, source, start, end, channel)
            self._others = max(self._others, end)
        self.sent.clear()

    def _stray_until(self, time: Time) -> None:
        if time > self.stray:
            self.stray = time

    # ------------------------------------------------------------ frames of piconets

    def send(self, source: Address, start: Time, duration: Time, channel: int) -> None:
        """Put a frame of a piconet on the air; all piconets must have been advanced to now."""
        self._note(source, start, start + duration, channel)

    def adapt(self) -> Adapted:
        """Return the adapted hop sets, for a piconet that has one."""
        if self.adapted is None:
            self.adapted = bands.new_adapted(len(self.band.piconets))
        return self.adapted

    def channel(self, master: Address, tick: int) -> int:
        """Return the channel on which the piconet of *master* is at *tick*."""
        piconets = self.band.piconets
        if self.adapted is not None and piconets[master, USED]:
            used = self.adapted.used[master, : piconets[master, USED]]
            return int(adapted_hop(piconets[master, WORD], tick, used))
        hop: int = basic_hop(piconets[master, WORD], tick)
        return hop

    def fate(self, frame: Frame, receiver: Address, carrier_dbm: float, bits: int, coded: bool) -> Fate:
        """Return the fate of the *frame* of a piconet at *receiver*, at its end; *bits* as in :meth:`judge`."""
        if carrier_dbm < self.least_dbm:
            return FAR
        if self.calm and frame.start >= self.stray:
            return GOOD
        return self._sections(frame, receiver, carrier_dbm, bits, coded, ACCESS_CODE, frame.duration)

    def flying(self, now: Time) -> list[Frame]:
        """Return the frames that a trace wants and that are on the air *now*, but for those that begin."""
        if self._idle:
            self.advance(now, now - 1)
        sent = [*self.latest, *(frame for master in self._idle for frame in self._idle_pair(master))]
        return [frame for frame in sent if frame.start < now <= frame.start + frame.duration]

    def _idle_pair(self, master: Address) -> list[Frame]:
        """Return the POLL and, if that has come, the NULL of the idle pair under way in a piconet."""
        piconet, links = self.band.piconets[master], self.band.links[master]
        k, found = int(piconet[PAIR_LINK]), []
        for i in range(piconet[STAGE]):
            tick, ends = int(piconet[PAIR_TICK]) + 2 * i, (master, int(links[SLAVE, k]))
            start = start_of(int(piconet[PHASE]), int(piconet[PPM]), tick)
            source, destination = ends[::-1] if i else ends
            found.append(
                Frame(start, HEADER_AIR, "NULL" if i else "POLL", source, destination, self.channel(master, tick), k)
            )
        return found

    # ------------------------------------------------------------ frames of inquiries and pages

    def put(self, frame: Frame) -> None:
        """Put *frame*, which starts now and belongs to no piconet, on the air."""
        self.advance(frame.start)
        self._disturb()
        end = frame.start + frame.duration
        self._note(frame.source, frame.start, end, frame.channel)
        self._stray_until(end)

    def judge(self, frame: Frame, receiver: Address, carrier_dbm: float, bits: int = 0, first: int = 1) -> Fate:
        """Return the fate of *frame* at *receiver*, at its end, from the section *first* on.

        *carrier_dbm* is its power there; *bits* counts its payload with header and CRC, all of it coded (an FHS).
        """
        if carrier_dbm < self.least_dbm:
            return FAR
        return self._sections(frame, receiver, carrier_dbm, bits, True, first, frame.duration)

    def judge_id(self, frame: Frame, receiver: Address, carrier_dbm: float) -> Fate:
        """Return the fate at *receiver* of what *frame* begins with, as long as an ID, at the end of that."""
        if carrier_dbm < self.least_dbm:
            return FAR
        return self._sections(frame, receiver, carrier_dbm, 0, True, ACCESS_CODE, ID_AIR)

    def _sections(
        self, frame: Frame, receiver: Address, carrier_dbm: float, bits: int, coded: bool, first: int, duration: Time
    ) -> Fate:
        start, end = frame.start, frame.start + duration
        self.advance(end)
        if self._undisturbed(frame.source, receiver, start, end):
            noise = self.noise
            if noise is None:
                return GOOD
            lost: int = mediums.broken(noise, frame.source, receiver, start, carrier_dbm, bits, coded)
            return GOOD if lost < first or (lost > ACCESS_CODE and duration <= ID_AIR) else FATES[BIT_ERRORS + lost]
        self._put_sent()
        fate: int = mediums.judge(
            self.medium,
            self.noise,
            self._foreign,
            frame.source,
            receiver,
            frame.channel,
            start,
            end,
            carrier_dbm,
            bits,
            coded,
            first,
        )
        if not fate & MET and self._arrived is not None and duration == frame.duration:
            self._clear = frame.source, start, receiver
        return FATES[fate & ~MET]

    def _undisturbed(self, source: Address, receiver: Address, start: Time, end: Time) -> bool:
        """Return whether nobody but *source* and *receiver* sends anything during [start, end), on any channel."""
        if start < self._others or self._jammers is not None or self.neighbours is not None:
            return False
        for train in self._trains:
            if train.device not in (source, receiver):
                return False
        for other, begun, over, _ in self.sent:
            if begun < end and over > start and other not in (source, receiver):
                return False
        return True

    def record(self, frame: Frame, fate: Fate, power_dbm: float = _NOTHING_DBM, met_mw: float | None = None) -> None:
        """Hand *frame* and its fate to the trace, as far as that wants them, and to the meter.

        *power_dbm* is its power at the receiver, *met_mw* the most that overlaps one of its sections there; if that is
        not given, the frame has ended just now.
        """
        if self.meter is not None and fate.heard not in _UNHEARD:  # it knows of those of piconets by itself
            self.meter.received(frame.destination, frame.start, frame.start + frame.duration)
        if self._record is not None:
            self._record(frame, fate)
        if self._arrived is not None:
            if met_mw is None:
                met_mw = self._interference_mw(frame, frame.destination) if fate.judged else 0.0
            self._arrived(frame, fate, power_dbm, met_mw)

    def _interference_mw(self, frame: Frame, receiver: Address) -> float:
        """Return the most that overlaps a section of *frame*, which ends now and has been judged, at *receiver*."""
        start, end = frame.start, frame.start + frame.duration
        if (self.calm and start >= self.stray) or self._undisturbed(frame.source, receiver, start, end):
            return 0.0
        if self._clear == (frame.source, start, receiver):
            return 0.0
        self._put_sent()
        ways = frame.source, receiver, frame.channel
        met: float = mediums.greatest_interference_mw(self.medium, self._foreign, *ways, start, end)
        return met

    # ------------------------------------------------------------ trains of IDs

    def open_train(self, train: Records, channels: Int64s, now: Time) -> None:
        """Have a device send the IDs of *train*, shape (1,), until its end or :meth:`close_train`.

        *channels* are those of each X.
        """
        self.advance(now)
        train["channels"] = channels
        self._forget_trains(now)
        before = self.medium.trains
        trains = mediums.records(len(before) + 1, mediums.TRAIN)
        trains[:-1], trains[-1] = before, train[0]
        new = _Train(int(train["sender"][0]), int(train["until"][0]))
        self._set_trains(trains, [*self._trains, new], now)
        self._trains_changed(now)

    def silence_train(self, device: Address, since: Time, until: Time) -> None:
        """Let the train of *device*, if it sends one, send nothing that would start in [since, until)."""
        if self.meter is not None:
            self.meter.count_ids(since)
        begins, ends = self._silences
        for row, train in enumerate(self._trains):
            if train.end > since and train.device == device:
                gap, train.gaps = train.gaps, (train.gaps + 1) % mediums.GAPS
                begins[row, gap], ends[row, gap] = since, until

    def close_train(self, device: Address, at: Time) -> None:
        """Let the train of *device*, if it sends one, send nothing more that would start at or after *at*."""
        for row, train in enumerate(self._trains):
            if train.end > at and train.device == device:
                self.medium.trains["until"][row] = train.end = at
                self._closing = min(self._closing, at + 2 * LONGEST_FRAME)

    def _forget_trains(self, now: Time) -> None:
        """Drop the trains that ended so long ago that nothing on the air can have met them."""
        kept = [row for row, train in enumerate(self._trains) if train.end + 2 * LONGEST_FRAME > now]
        if len(kept) < len(self._trains):
            self._set_trains(self.medium.trains[kept], [self._trains[row] for row in kept], now)
            self._trains_changed(now)

    def _set_trains(self, records: Records, trains: list["_Train"], now: Time) -> None:
        if self.meter is not None:
            self.meter.count_ids(now)
        self.medium = self.medium._replace(trains=records)
        self._trains = trains
        self._silences = records["silent_since"], records["silent_until"]
        self._closing = min((train.end for train in trains), default=FOREVER) + 2 * LONGEST_FRAME


@dataclass(slots=True)
class _Train:
    """A train in the medium."""

    device: Address
    end: Time
    gaps: int = 0
    """Place of the next time at which it is interrupted."""


@dataclass(frozen=True, slots=True)
class Identity:
    """The identity of one device."""

    address: Address
    hop_address: int
    """The 32-bit UAP/LAP word."""
    clock: NativeClock


@dataclass(frozen=True, slots=True)
class Radio:
    """One device on the air, as its scanners, its procedures and its piconet use it."""

    kernel: Kernel
    air: Air
    identity: Identity
    courses: Courses = field(default_factory=Courses)
    """What all devices do, for who wants to see it."""
    payloads: Payloads | None = None
    """What all devices hold, for who wants to see that."""
