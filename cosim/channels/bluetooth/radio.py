"""The air between Bluetooth devices, as the procedures see it: frames are put on it, and their fates asked for.

The arithmetic is in ``medium`` (what overlaps, what survives) and ``band`` (piconets without payloads, advanced
together). Every change of powers, or of the devices that send, comes through here: all piconets are brought up to now
first.
"""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Final, Literal, NamedTuple, TypeAlias

import numpy as np

import cosim.elementary as elementary
from cosim.arrays import Floats, Int64s
from cosim.channels.bluetooth import band as bands
from cosim.channels.bluetooth import medium as mediums
from cosim.channels.bluetooth.band import LOG_FIELDS, Band
from cosim.channels.bluetooth.bits.errors import ACCESS_CODE
from cosim.channels.bluetooth.clock import NativeClock
from cosim.channels.bluetooth.hopping import basic_hop
from cosim.channels.bluetooth.medium import BIT_ERRORS, NOT_TUNED, OUT_OF_RANGE, RECEIVED, T_DEVICE, T_TO
from cosim.channels.bluetooth.polling import HELD, MASTER, RUNNING, STAGE, USED, WORD, run_alone
from cosim.channels.jamming import Jammer
from cosim.kernel import Kernel
from cosim.machine import Address
from cosim.units import MS, Time

Interference: TypeAlias = Literal["none", "co_channel", "neighbouring"]
MODES: Final[dict[str, int]] = {
    "none": mediums.NONE,
    "co_channel": mediums.CO_CHANNEL,
    "neighbouring": mediums.NEIGHBOURING,
}
LONGEST_FRAME: Final[Time] = 4 * MS
"""Bound of the air time of a frame of Basic Rate (five slots are 3.125 ms)."""
FOREVER: Final[Time] = 1 << 61
_NOTHING_DBM: Final = float("-inf")
_NO_LOG: Final = np.empty((0, LOG_FIELDS), dtype=np.int64)
_LOG_ROWS: Final = 4096


class Heard(StrEnum):
    """The fate of a frame at the receiver that it was meant for."""

    RECEIVED = "received"
    OUT_OF_RANGE = "out_of_range"
    COLLIDED = "collided"
    BIT_ERRORS = "bit_errors"
    NOT_TUNED = "not_tuned"
    """The receiver listened on another channel, or not at all."""
    BUSY = "busy"
    """The receiver was in the middle of another frame."""
    REFUSED = "refused"
    """The receiver had no room for the payload (flow control)."""


class Part(StrEnum):
    """The section of a frame that failed first, as collisions and bit errors have it."""

    NONE = ""
    ACCESS_CODE = "access_code"
    HEADER = "header"
    PAYLOAD = "payload"


class Fate(NamedTuple):
    """The fate of a frame, and which part of it failed if one did."""

    heard: Heard
    part: Part = Part.NONE

    @property
    def header_heard(self) -> bool:
        """True if the receiver has noticed the frame and knows its header."""
        return self.heard in (Heard.RECEIVED, Heard.REFUSED) or self.part is Part.PAYLOAD


_PARTS: Final = tuple(Part)
FATES: Final[tuple[Fate, ...]] = (
    Fate(Heard.RECEIVED),
    *(Fate(Heard.COLLIDED, part) for part in _PARTS[1:]),
    Fate(Heard.RECEIVED),  # BIT_ERRORS in no section
    *(Fate(Heard.BIT_ERRORS, part) for part in _PARTS[1:]),
    Fate(Heard.OUT_OF_RANGE),
    Fate(Heard.NOT_TUNED),
)
"""The fates by the numbers that compiled functions return."""
assert FATES[BIT_ERRORS + 1].heard is Heard.BIT_ERRORS
GOOD, FAR, UNTUNED, TAKEN = FATES[RECEIVED], FATES[OUT_OF_RANGE], FATES[NOT_TUNED], Fate(Heard.BUSY)
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


IdleFrame: TypeAlias = Callable[[int, int, bool, Fate], None]
"""Called with (tick, LT_ADDR, whether the frame went up to the master, its fate)."""


class Air:
    """The air between *size* devices. *record*, if given, is called with every frame that is judged, and its fate.

    *key* is the key of the draws of bit errors; without noise (-inf dBm) there are none.
    """

    def __init__(
        self,
        size: int,
        record: Callable[[Frame, Fate], None] | None = None,
        interference: Interference = "co_channel",
        noise_dbm: float = float("-inf"),
        key: tuple[int, int] = (0, 0),
    ) -> None:
        self.band: Band = bands.new_band(mediums.new_medium(size, MODES[interference], noise_dbm, key))
        self.calm = True
        """True if no frame that starts from ``stray`` on can be destroyed."""
        self.fades = noise_dbm > float("-inf")
        """True if powers are those of a law of propagation."""
        self._detectable_dbm = noise_dbm + mediums.DETECTABLE_DB
        self._record = record
        self._rows = list(zip(self.band.piconets, self.band.links, strict=True))
        self._running = 0
        self._master: Address | None = None
        """The only piconet that sends anything, while it is not known whether everything is received there."""
        self._alone: tuple[Int64s, Int64s] | None = None
        """Arrays of the only piconet that sends anything, if its air is calm and everything is received there."""
        self._in_flight: deque[tuple[Address, Time, Time, int]] = deque(maxlen=mediums.RING)
        """Frames (source, start, end, channel) of a calm air, which the medium needs only when the calm ends."""
        self._idle: dict[Address, IdleFrame] = {}  # by master, where idle frames are wanted
        self.stray: Time = 0
        """Instant from which nothing is on the air that a change, an inquiry or a page has left there."""
        self._closing: Time = FOREVER  # when the first train that has ended may be forgotten
        self._power: list[list[float]] = self.band.medium.power_dbm.tolist()

    # ------------------------------------------------------------ powers

    def set_powers(self, power_dbm: Floats, now: Time) -> None:
        """Let devices receive each other with *power_dbm*, shape (n, n), from now on; -inf is nothing."""
        self.advance(now, now - 1)
        self._disturb()
        mediums.set_powers(self.band.medium, power_dbm)
        self._power = self.band.medium.power_dbm.tolist()

    def carrier(self, source: Address, receiver: Address) -> float:
        """Return the power in dBm with which *receiver* gets *source* now."""
        return self._power[source][receiver]

    def reaches(self, carrier_dbm: float) -> bool:
        """Return whether a receiver notices a frame of this power."""
        return carrier_dbm >= self._detectable_dbm and carrier_dbm > _NOTHING_DBM

    def set_jammers(self, jammers: Sequence[Jammer], now: Time) -> None:
        """Put these jammers, and no others, on the air; no device receives them before :meth:`set_jam_powers`."""
        self.advance(now)
        jams, channels = mediums.jam_arrays(jammers)
        power_mw = np.zeros((len(jammers), len(self._power)))
        medium = self.band.medium._replace(jams=jams, jam_channels=channels, jam_mw=power_mw)
        self.band = self.band._replace(medium=medium)
        self.changed(now)

    def set_jam_powers(self, power_dbm: Floats, now: Time) -> None:
        """Let the jammers be received with *power_dbm*, shape (jammers, n), from now on."""
        self.advance(now, now - 1)
        self.band.medium.jam_mw[:] = elementary.exp10s(power_dbm / 10.0)

    # ------------------------------------------------------------ time

    def advance(self, now: Time, last_end: Time | None = None) -> None:
        """Bring all piconets up to *now*: slots that start before, frames that end by *last_end*, by default now.

        A frame that ends at the instant at which powers change is judged with the new ones.
        """
        last_end = now if last_end is None else last_end
        if self._idle:
            self._advance_and_report(now, last_end)
        elif self._alone is not None:
            run_alone(*self._alone, now)
        elif self._running:
            if self.calm and self._master is not None and self.stray < now:  # from there on there may be a shortcut
                bands.advance(self.band, self.stray, self.stray, _NO_LOG)
                self._seek_shortcut(self.stray)
                self.advance(now, last_end)
                return
            bands.advance(self.band, now, last_end, _NO_LOG)
            self._seek_shortcut(now)
        if now >= self._closing:
            self._forget_trains(now)

    def _advance_and_report(self, now: Time, last_end: Time) -> None:
        more = True
        while more:
            log = np.empty((_LOG_ROWS, LOG_FIELDS), dtype=np.int64)
            count = bands.advance(self.band, now, last_end, log)
            more = count > _LOG_ROWS
            for master, tick, k, up, fate in log[:count].tolist():
                if master in self._idle:
                    self._idle[master](tick, k, bool(up), FATES[fate])

    def report_idle(self, master: Address, report: IdleFrame) -> None:
        """Call *report* with every idle POLL and NULL of the piconet of *master* from now on."""
        self._idle[master] = report

    def changed(self, now: Time) -> None:
        """Note that devices have begun or ended to send or to listen; all piconets must be advanced to *now* before."""
        self._disturb()
        self._stray_until(now + LONGEST_FRAME)
        masters = [p for p, row in enumerate(self._rows) if row[0][RUNNING] and row[1][HELD].any()]
        # a pair under way outlives the pause, and the last link, of its piconet
        ending = any(row[0][STAGE] and p not in masters for p, row in enumerate(self._rows))
        self._running = len(masters) + ending
        self.calm = bool(bands.calm(self.band))
        self._master = masters[0] if len(masters) == 1 and not ending else None

    def _seek_shortcut(self, now: Time) -> None:
        """Take the shortcut from *now* on if only one piconet sends, nothing else is on the air, and all hear it."""
        if self.calm and self._master is not None and now >= self.stray:
            master, self._master = self._master, None
            if bands.all_hear(self.band, master):
                self._alone = self._rows[master]

    def _disturb(self) -> None:
        """End the calm: put what is on the air now into the medium."""
        medium = self.band.medium
        for source, start, end, channel in self._in_flight:
            mediums.put(medium.frames, medium.cursor, source, start, end, channel)
        self._in_flight.clear()
        if self._alone is not None:
            self._master = int(self._alone[0][MASTER])
            self._alone = None
            bands.expose(self.band, self._master)

    def _stray_until(self, time: Time) -> None:
        self.stray = max(self.stray, time)

    # ------------------------------------------------------------ frames of piconets

    def send(self, source: Address, start: Time, duration: Time, channel: int) -> None:
        """Put a frame of a piconet on the air; all piconets must have been advanced to now."""
        if self.calm and start >= self.stray:
            self._in_flight.append((source, start, start + duration, channel))
        else:
            medium = self.band.medium
            mediums.put(medium.frames, medium.cursor, source, start, start + duration, channel)

    def channel(self, master: Address, tick: int) -> int:
        """Return the channel on which the piconet of *master* is at *tick*."""
        piconet, _ = self._rows[master]
        if piconet[USED]:
            return int(bands.channel_of(self.band, master, tick))
        hop: int = basic_hop(piconet[WORD], tick)
        return hop

    def spares(self, start: Time) -> bool:
        """Return whether a frame that starts at *start* cannot be destroyed where it is noticed."""
        return self.calm and start >= self.stray

    def fate(self, frame: Frame, receiver: Address, carrier_dbm: float, bits: int, coded: bool) -> Fate:
        """Return the fate of the *frame* of a piconet at *receiver*, at its end; *bits* as in :meth:`judge`."""
        if not self.reaches(carrier_dbm):
            return FAR
        if self.calm and frame.start >= self.stray:
            return GOOD
        return self._sections(frame, receiver, carrier_dbm, bits, coded, ACCESS_CODE)

    # ------------------------------------------------------------ frames of inquiries and pages

    def put(self, frame: Frame) -> None:
        """Put *frame*, which starts now and belongs to no piconet, on the air."""
        self.advance(frame.start)
        self._disturb()
        end = frame.start + frame.duration
        medium = self.band.medium
        mediums.put(medium.frames, medium.cursor, frame.source, frame.start, end, frame.channel)
        self._stray_until(end)

    def judge(self, frame: Frame, receiver: Address, carrier_dbm: float, bits: int = 0, first: int = 1) -> Fate:
        """Return the fate of *frame* at *receiver*, at its end, from the section *first* on.

        *carrier_dbm* is its power there; *bits* counts its payload with header and CRC, all of it coded (an FHS).
        """
        if not self.reaches(carrier_dbm):
            return FAR
        return self._sections(frame, receiver, carrier_dbm, bits, True, first)

    def _sections(
        self, frame: Frame, receiver: Address, carrier_dbm: float, bits: int, coded: bool, first: int
    ) -> Fate:
        start, end = frame.start, frame.start + frame.duration
        self.advance(end)
        medium, source = self.band.medium, frame.source
        return FATES[
            mediums.judge(medium, source, receiver, frame.channel, start, end, carrier_dbm, bits, coded, first)
        ]

    @property
    def recorded(self) -> bool:
        """True if a trace wants frames."""
        return self._record is not None

    def record(self, frame: Frame, fate: Fate) -> None:
        """Hand *frame* and its fate to the trace, if there is one."""
        if self._record is not None:
            self._record(frame, fate)

    # ------------------------------------------------------------ trains of IDs

    def open_train(self, row: Int64s, channels: Int64s, now: Time) -> None:
        """Have a device send IDs, one train at a time, until its end or :meth:`close_train`.

        *row* has the fields of ``medium.Medium.trains``, *channels* the channel of each X.
        """
        self.advance(now)
        self._forget_trains(now)
        medium = self.band.medium
        count = int(medium.numbers[1])
        if count == len(medium.trains):
            trains, each = np.zeros_like(medium.trains), np.zeros_like(medium.train_channels)
            medium = medium._replace(
                trains=np.concatenate((medium.trains, trains)),
                train_channels=np.concatenate((medium.train_channels, each)),
            )
            self.band = self.band._replace(medium=medium)
        medium.trains[count], medium.train_channels[count] = row, channels
        medium.numbers[1] = count + 1
        self._closing = min(self._closing, int(row[T_TO]) + 2 * LONGEST_FRAME)
        self.changed(now)

    def close_train(self, device: Address, at: Time) -> None:
        """Let the train of *device*, if it sends one, send nothing more that would start at or after *at*."""
        medium = self.band.medium
        for row in range(int(medium.numbers[1])):
            train = medium.trains[row]
            if train[T_DEVICE] == device and train[T_TO] > at:
                train[T_TO] = at
                self._closing = min(self._closing, at + 2 * LONGEST_FRAME)

    def _forget_trains(self, now: Time) -> None:
        """Drop the trains that ended so long ago that nothing on the air can have met them."""
        medium = self.band.medium
        count = int(medium.numbers[1])
        kept = [row for row in range(count) if medium.trains[row, T_TO] + 2 * LONGEST_FRAME > now]
        if len(kept) == count:
            return
        medium.trains[: len(kept)] = medium.trains[kept]
        medium.train_channels[: len(kept)] = medium.train_channels[kept]
        medium.numbers[1] = len(kept)
        ends = (int(medium.trains[row, T_TO]) for row in range(len(kept)))
        self._closing = min(ends, default=FOREVER) + 2 * LONGEST_FRAME
        self.changed(now)


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
