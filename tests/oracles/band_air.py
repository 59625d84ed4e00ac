"""What is on the air of the whole band, how strong it arrives, and which section of a frame it destroys.

Every frame and every ID is a concrete (start, end, source, channel). A frame is judged by looking at each other frame
that began less than 6 ms ago: all that can overlap it did. Jammers are sources like any other, with addresses behind
those of the devices.
"""

from bisect import bisect_right
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import chain, takewhile
from math import inf, log10
from typing import Literal, NamedTuple

from cosim import elementary
from cosim.channels.bluetooth.bits.errors import section_probabilities
from tests.oracles.medium import COLLIDED, OUT_OF_RANGE, RECEIVED, US, OnAir
from tests.oracles.philox import philox

BIT_ERRORS = "bit_errors"
LONGEST_AGO = 6_000_000
Matrix = tuple[tuple[float, ...], ...]
"""dBm by [transmitter][receiver]."""
Mode = Literal["none", "co_channel", "neighbouring"]
WEIGHTS = (1.0, 10**-1.1, 10**-4.1, 10**-5.1)
"""What an interferer 0, 1, 2, 3 or more MHz away counts."""
CARRIER_TO_INTERFERENCE = 10**-1.1
SECTIONS = ("access_code", "header", "payload")


class Contents(NamedTuple):
    """What errors depend on: bits of the payload before coding, whether they are coded, whether there is a header."""

    bits: int = 0
    coded: bool = False
    header: bool = True


IDENT = Contents(header=False)
POLLING = Contents()
FHS = Contents(160, True)


@dataclass(frozen=True)
class Jammer:
    """A jammer on the air in [start, until).

    *constant*: on all its channels; *sweeping*: on one after the other, *dwell* on each; *pulsed*: on all of them for
    the first *on* of every *period*. A channel that it is on at any instant of a section counts once, and in full.
    """

    mode: Literal["constant", "sweeping", "pulsed"]
    start: int
    until: int
    channels: tuple[int, ...]
    dwell: int = 1
    on: int = 1
    period: int = 1

    def at(self, time: int) -> tuple[int, ...]:
        """Return the channels that it is on at the instant *time*."""
        if not self.start <= time < self.until:
            return ()
        since = time - self.start
        if self.mode == "sweeping":
            return (self.channels[since // self.dwell % len(self.channels)],)
        return self.channels if self.mode == "constant" or since % self.period < self.on else ()

    def within(self, start: int, end: int) -> list[int]:
        """Return the channels that it is on at any instant of [start, end).

        If it is on one, then at the first instant of that time, or at one at which it comes on the air or changes; and
        what it does repeats when it has been on each of its channels.
        """
        length = {"constant": self.until - self.start, "sweeping": self.dwell, "pulsed": self.period}[self.mode]
        first = max(0, (start - self.start) // length)
        turns = range(first, min((end - self.start) // length, first + len(self.channels)) + 2)
        changes = [self.start + turn * length for turn in turns]
        on = {channel for time in (start, *changes) if start <= time < end for channel in self.at(time)}
        return [channel for channel in self.channels if channel in on]


@dataclass(frozen=True)
class Radio:
    """Powers over time, noise and interference; *noise_dbm* None is a disc: no noise."""

    powers: tuple[tuple[int, Matrix], ...]
    """(from when, matrix), ascending, the first one from 0; jammers stand behind the devices."""
    switches: tuple[tuple[int, int, bool], ...] = ()
    """(when, device, on), ascending."""
    noise_dbm: float | None = None
    mode: Mode = "co_channel"
    jammers: tuple[Jammer, ...] = ()
    key: tuple[int, int] = (0, 0)
    """Of the stream of errors."""


@lru_cache
def milliwatts(dbm: float) -> float:
    # the channel's own power of ten, which has tests of its own: at a ratio of exactly 11 dB its last bit decides
    return 0.0 if dbm == -inf else elementary.exp10(dbm / 10.0)


@dataclass
class Air:
    """All frames that were ever on the air, in the order of their starts, between *devices* devices."""

    radio: Radio
    devices: int
    frames: list[OnAir] = field(default_factory=list)

    def power(self, source: int, receiver: int, time: int) -> float:
        """Return the power in dBm with which *receiver* has *source* at *time*."""
        if not (self.is_on(source, time) and self.is_on(receiver, time)):
            return -inf
        powers = self.radio.powers
        return powers[bisect_right(powers, time, key=lambda piece: piece[0]) - 1][1][source][receiver]

    def is_on(self, device: int, time: int) -> bool:
        state = True
        for when, which, on in self.radio.switches:
            if which == device and when <= time:
                state = on
        return state

    def es_n0(self, carrier: float) -> float:
        if self.radio.noise_dbm is None:
            return inf if carrier > -inf else -inf
        return carrier - self.radio.noise_dbm

    def out_of_range(self, carrier: float) -> bool:
        return self.es_n0(carrier) < 0.0

    def put(self, start: int, duration: int, source: int, channel: int) -> OnAir:
        frame = OnAir(start, start + duration, source, channel)
        self.frames.append(frame)
        return frame

    def interference(self, frame: OnAir, receiver: int, start: int, end: int, now: int) -> float:
        """Return the sum in mW of what overlaps [start, end), as strong as it is at *now*."""
        if self.radio.mode == "none":
            return 0.0
        recent = takewhile(lambda other: other.start > now - LONGEST_AGO, reversed(self.frames))
        jamming = (
            OnAir(start, end, self.devices + number, channel)
            for number, jammer in enumerate(self.radio.jammers)
            for channel in jammer.within(start, end)
        )
        total = 0.0
        for other in chain(recent, jamming):
            if other is frame or other.source in (frame.source, receiver):
                continue
            if not (other.start < end and other.end > start):
                continue
            distance = abs(other.channel - frame.channel)
            if self.radio.mode == "co_channel" and distance > 0:
                continue
            total += milliwatts(self.power(other.source, receiver, now)) * WEIGHTS[min(distance, 3)]
        return total

    def least_ratio(self, frame: OnAir, receiver: int, carrier: float, now: int) -> float | None:
        """Return the least ratio in dB of *carrier* to noise and interference, by sections; None without either."""
        begin, header, payload, end = frame.start, frame.start + 72 * US, frame.start + 126 * US, frame.end
        spans = ((begin, end),) if end - begin <= 68 * US else ((begin, header), (header, payload), (payload, end))
        met = max(self.interference(frame, receiver, *span, now) for span in spans if span[0] < span[1])
        noise = -inf if self.radio.noise_dbm is None else self.radio.noise_dbm
        total = milliwatts(noise) + met
        return 10.0 * log10(milliwatts(carrier) / total) if total else None

    def judge(
        self,
        frame: OnAir,
        receiver: int,
        carrier: float,
        contents: Contents,
        now: int,
        which: tuple[str, ...] = SECTIONS,
    ) -> tuple[str, str | None]:
        """Return the outcome of the sections *which* of a frame that its receiver is tuned to, and which one failed.

        The access code of an FHS that is judged alone (at 68 us, for the lock) ends there.
        """
        if self.out_of_range(carrier):
            return OUT_OF_RANGE, None
        begin, until = frame.start, frame.end
        access = begin + (72 * US if contents.header and now == until else 68 * US)
        spans = {
            "access_code": (begin, access),
            "header": (begin + 72 * US, begin + 126 * US),
            "payload": (begin + 126 * US, until),
        }
        for section in which:
            start, end = spans[section]
            if start >= end or (section != "access_code" and not contents.header):
                continue
            noise = self.interference(frame, receiver, start, end, now)
            if noise > 0.0 and milliwatts(carrier) * CARRIER_TO_INTERFERENCE < noise:
                return COLLIDED, section
            if self.has_bit_errors(frame, receiver, carrier, contents, section):
                return BIT_ERRORS, section
        return RECEIVED, None

    def has_bit_errors(self, frame: OnAir, receiver: int, carrier: float, contents: Contents, section: str) -> bool:
        counter = (frame.start % (1 << 32), frame.start >> 32, frame.source << 16 | receiver, 2)
        w0, w1, w2, w3 = philox(counter, self.radio.key)
        access, header, payload = section_probabilities(self.es_n0(carrier), contents.bits, contents.coded)
        if section == "access_code":
            return w0 < access * 2.0**32
        if section == "header":
            return w1 < header * 2.0**32
        return ((w2 << 32 | w3) >> 11) * 2.0**-53 < payload
