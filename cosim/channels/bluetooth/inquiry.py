"""Inquiry and inquiry scan (Core v1.1 and v1.2, Vol 2 Part B, section 8.4): how devices find each other.

The inquirer sends IDs through its trains; a scanner that hears one answers, 625 us after it, with an FHS packet that
carries its address and clock. Scanners that hear the same ID would answer at the same instant and destroy each other's
FHS, so each backs off for a random number of slots: in v1.1 between the first ID and the answer to a second one, in
v1.2 after the answer. Every answer moves a scanner one step on in its hop sequence (N), and N outlives the inquiry.

    v1.1   SCAN --ID--> back off 0..1023 slots --> RESPONSE (128 slots, no windows) --ID--> FHS, N + 1 --> SCAN
    v1.2   SCAN --ID--> FHS, N + 1 --> back off 0..1023 slots (0..127 at intervals below 1.28 s) --> SCAN

Kernel events exist for IDs that would be heard, and for the start and end of every FHS; everything else is arithmetic
(``scanning``). The inquirer is half duplex: while it receives an FHS it sends nothing, so the answer to an ID of a
second half slot silences the first ID of the next slot.

Its IDs are on the air all the time, heard or not, and may destroy what others send (``medium``).
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Annotated, Final, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from cosim.channels.air.arbitration import Rank
from cosim.channels.bluetooth.bits.errors import HEADER
from cosim.channels.bluetooth.hopping import (
    GIAC,
    NARROW,
    Train,
    inquiry_channel,
    inquiry_response_channel,
    scan_channels,
)
from cosim.channels.bluetooth.packets import FHS_AIR, FHS_BITS, ID_AIR
from cosim.channels.bluetooth.radio import FAR, FOREVER, GOOD, TAKEN, UNTUNED, Fate, Frame, Radio, was_sent
from cosim.channels.bluetooth.scanning import (
    RESPONSE_DELAY,
    IdTrain,
    Meeting,
    ScanSettings,
    ScanWindows,
    at_meeting,
    first_transmission,
    next_meeting,
    next_meeting_between,
    train_words,
)
from cosim.channels.clock import NativeClock
from cosim.channels.courses import Phase
from cosim.errors import LocalProtocolError
from cosim.kernel import Handle
from cosim.machine import BROADCAST, Address
from cosim.randomness import Draws
from cosim.settings import Count, Settings, error_at
from cosim.units import SLOT, Time

CLOCK_RANGE: Final = 1 << 28
RESPONSE_TIMEOUT: Final[Time] = 128 * SLOT
"""inqrespTO: time for which a v1.1 scanner waits for the second ID."""
BACKOFF_SLOTS: Final = 1024
SHORT_BACKOFF_SLOTS: Final = 128
"""Bound of the v1.2 back-off at short scan intervals."""
SHORT_BACKOFF_BELOW: Final = 4096
"""Ticks (1.28 s) below which a scan interval is short."""
BACKOFF_PURPOSE: Final = 1
"""Purpose of the draws of back-offs."""


class InquirySettings(Settings):
    """Parameters of an inquiry."""

    n_inquiry: Count = Field(default=256, ge=1)
    """Repetitions of a train before the other takes over; the specification asks for 256 at least (2.56 s)."""
    first_train: Train = "A"
    """The train of 16 hop channels that is sent first."""


class InquiryScanSettings(ScanSettings):
    """Parameters of an inquiry scan, by which a device can be found."""

    # YAML reads an unquoted 1.2 as a number
    version: Annotated[
        Literal["1.1", "1.2"], BeforeValidator(lambda value: str(value) if isinstance(value, float) else value)
    ] = "1.2"
    """Version of the specification, which decides when a scanner backs off."""

    @model_validator(mode="after")
    def _known_in_version(self) -> Self:
        if self.interlaced and self.version == "1.1":
            raise error_at(("interlaced",), True, "is not known to version 1.1")
        return self


class InquiryScanner:
    """One device's side of being found; it remembers N across inquiries and is off until it is enabled."""

    def __init__(
        self,
        radio: Radio,
        settings: InquiryScanSettings,
        offset_ticks: int,
        draws: Draws,
    ) -> None:
        self.address = radio.identity.address
        self.clock = radio.identity.clock
        self.enabled = False
        self.n = 0
        """FHS packets sent so far."""
        self._kernel = radio.kernel
        self._air = radio.air
        self._backs_off_first = settings.version == "1.1"
        self._bound = BACKOFF_SLOTS
        if settings.version == "1.2" and settings.interval_ticks < SHORT_BACKOFF_BELOW:
            self._bound = SHORT_BACKOFF_SLOTS
        self._windows = ScanWindows(self.clock, offset_ticks, settings.interval_ticks, settings.interlaced)
        self._draws = draws
        self._courses = radio.courses
        self._course = radio.courses.begin(self.address)
        self._answers_until: Time = 0  # the end of the last FHS
        self._since: Time = 0  # deaf before; then RESPONSE until the limit, if there is one, and SCAN
        self._limit: Time | None = None
        self._expected: dict[Inquiry, Handle | None] = {}  # the next ID of each inquiry that might be heard
        self._answering: Handle | None = None

    def enable(self, now: Time) -> None:
        """Scan from *now* on; a window in progress counts for its remainder. Nothing happens if it scans already."""
        if not self.enabled:
            self.enabled = True
            self._scan(now)
            self._plan()

    def disable(self) -> None:
        """Stop scanning; an answer that has not been started is not sent."""
        self.enabled = False
        if self._courses.wanted:
            now = self._kernel.now
            self._course.plan(now, Phase(now, "inquiry_response"), Phase(max(now, self._answers_until)))
        self._ignore()
        if self._answering is not None:
            self._answering.cancel()
            self._answering = None

    def join(self, inquiry: "Inquiry") -> None:
        """Listen to *inquiry* from its beginning."""
        self._expected[inquiry] = None
        if self.enabled and self._answering is None:
            self._expect(inquiry, inquiry.ids.first)

    def leave(self, inquiry: "Inquiry") -> None:
        """Forget *inquiry*: it is over."""
        handle = self._expected.pop(inquiry, None)
        if handle is not None:
            handle.cancel()

    def _scan(self, since: Time, limit: Time | None = None) -> None:
        """Listen from *since*: without windows until *limit*, if there is one, then in windows."""
        self._since, self._limit, self._answering = since, limit, None
        for inquiry in self._expected:
            self._expect(inquiry, inquiry.ids.first)

    def _plan(self, *before: Phase) -> None:
        """Plan what it does from now on: first what comes *before* it listens again."""
        if not self._courses.wanted:
            return
        phases, since = [*before], self._since
        if self._limit is not None:
            phases.append(Phase(since, "inquiry_response"))
            since = self._limit
        windows = Phase(since, "inquiry_scan", parts=self._windows.stretches)
        self._course.plan(self._kernel.now, *phases, windows)

    def _ignore(self) -> None:
        for inquiry, handle in self._expected.items():
            if handle is not None:
                handle.cancel()
                self._expected[inquiry] = None

    def _expect(self, inquiry: "Inquiry", tick: int) -> None:
        """Schedule the next ID of *inquiry* at or after *tick* that might be heard."""
        handle = self._expected[inquiry]
        if handle is not None:
            handle.cancel()
        meeting = self._next(inquiry.ids, tick)
        if meeting is None:
            self._expected[inquiry] = None
        else:
            start = inquiry.ids.clock.time_of(meeting.tick)
            self._expected[inquiry] = at_meeting(self._kernel, start, partial(self._look, inquiry, meeting))

    def _next(self, ids: IdTrain, tick: int) -> Meeting | None:
        if self._limit is None:
            return next_meeting(ids, self._windows, tick, self._since, self.n)
        response = next_meeting_between(ids, self.clock, tick, self._since, self._limit, self.n)
        return response or next_meeting(ids, self._windows, tick, self._limit, self.n)

    def _look(self, inquiry: "Inquiry", meeting: Meeting) -> None:
        """Check at the start of an ID that might be heard whether it is sent, and within reach."""
        start, air = self._kernel.now, self._air
        carrier = air.carrier(inquiry.address, self.address)
        if inquiry.sends(start) and air.reaches(carrier):
            channel = inquiry_channel(meeting.tick, inquiry.ids.train(meeting.tick), inquiry.word)
            frame = Frame(start, ID_AIR, "ID", inquiry.address, self.address, channel)
            if air.recorded:
                air.latest.append(frame._replace(destination=BROADCAST))
            heard = partial(self._hear, inquiry, meeting, frame, carrier)
            self._expected[inquiry] = self._kernel.at(start + ID_AIR, heard)
        else:
            self._expect(inquiry, meeting.tick + 1)

    def _hear(self, inquiry: "Inquiry", meeting: Meeting, frame: Frame, carrier_dbm: float) -> None:
        """Hear an ID at its end, if nothing has destroyed it."""
        start, end = frame.start, frame.start + ID_AIR
        if not was_sent(self._air, frame) or self._air.judge(frame, self.address, carrier_dbm) is not GOOD:
            self._expect(inquiry, meeting.tick + 1)
            return
        inquiry.record_id(frame)
        self._air.record(frame, GOOD, carrier_dbm)
        if self._backs_off_first and not (self._limit is not None and end <= self._limit):
            waited = self._backoff(start, start)
            self._scan(max(self.clock.at_local(waited), end), self.clock.at_local(waited + RESPONSE_TIMEOUT))
            self._plan(Phase(end, "inquiry_backoff"))
        else:
            self._ignore()
            if self._courses.wanted:
                self._course.plan(end, Phase(end, "inquiry_response"))
            self._answering = self._kernel.at(start + RESPONSE_DELAY, partial(self._answer, inquiry, meeting, start))

    def _backoff(self, heard: Time, begin: Time) -> Time:
        """Return the local time at which a back-off from *begin* ends, drawn for the ID that was *heard* then."""
        slots = self._draws.below(self._bound, self.clock.tick(heard), 0, BACKOFF_PURPOSE)
        return self.clock.local(begin) + slots * SLOT

    def _answer(self, inquiry: "Inquiry", meeting: Meeting, heard: Time) -> None:
        """Put the FHS on the air and go on scanning as the version requires."""
        start = self._kernel.now
        clkn = self.clock.tick(start)
        channel = inquiry_response_channel(clkn, self.n + 16 * meeting.second, inquiry.word)
        frame = Frame(start, FHS_AIR, "FHS", self.address, inquiry.address, channel)
        end = start + FHS_AIR
        seats = self._air.seats
        if seats is None or seats.refused_until(self.address, end, Rank.EMPTY) is None:
            self._air.put(frame)
            if self._air.recorded:
                self._air.latest.append(frame)
            inquiry.reply(frame, meeting.tick, clkn)
            self.n += 1
        self._answers_until = end
        self._scan(end if self._backs_off_first else self.clock.at_local(self._backoff(heard, end)))
        self._plan(Phase(start, "inquiry_response"), Phase(end, "inquiry_backoff"))


class _Reply:
    """An FHS on its way to the inquirer."""

    __slots__ = ("carrier_dbm", "clkn", "end", "frame", "lost", "tick")

    def __init__(self, frame: Frame, tick: int, clkn: int, carrier_dbm: float) -> None:
        self.frame = frame
        self.end = frame.start + frame.duration
        self.tick = tick
        self.clkn = clkn
        self.carrier_dbm = carrier_dbm
        self.lost: Fate | None = None
        """Reason why the inquirer did not lock on it; None if it did."""


def _order(reply: _Reply) -> tuple[Time, Address]:
    return reply.frame.start, reply.frame.source


class Inquiry:
    """One inquiry of one device, from the first transmit slot at or after now until its time is up or it has enough.

    *duration_ticks* is a multiple of 4. *on_found* gets the address of each device once, at the end of the first FHS
    received from it, and the distance from the inquirer's clock to that device's for paging: a multiple of 4 ticks in
    [0, 2**28). *on_complete* gets all addresses in the order of their replies. *scanners* are all that might hear.
    """

    def __init__(
        self,
        radio: Radio,
        settings: InquirySettings,
        duration_ticks: int,
        enough: int,
        scanners: Sequence[InquiryScanner],
        on_found: Callable[[Address, int], None],
        on_complete: Callable[[tuple[Address, ...]], None],
    ) -> None:
        if duration_ticks <= 0 or duration_ticks % 4:
            raise LocalProtocolError(f"duration_ticks: {duration_ticks} is not a positive multiple of 4")
        kernel, clock, narrow = radio.kernel, radio.identity.clock, radio.identity.hop_address & NARROW
        first = first_transmission(clock, kernel.now)
        end = first + duration_ticks
        self.address = radio.identity.address
        self.word = GIAC | narrow
        """Access code that it sends, GIAC, marked with NARROW in a system of 23 channels."""
        self.ids = IdTrain(clock, first, end, settings.n_inquiry, settings.first_train, 0, bool(narrow))
        self.found: list[Address] = []
        self._kernel = kernel
        self._air = radio.air
        self._enough = enough
        self._scanners = scanners
        self._on_found = on_found
        self._on_complete = on_complete
        self._over = False
        self._over_since: Time = FOREVER
        self._unsettled: list[_Reply] = []  # begun in this order, not yet known whether the receiver locks on them
        self._locked: _Reply | None = None
        self._recorded: Time = -1  # the start of the last ID that was heard
        # the answer to the last ID ends within the tick after the last receive slot
        self._end = kernel.at(clock.time_of(self.ids.end + 1), self._complete)
        train = self.ids.on_air(self.address, clock.time_of(first))
        self._air.open_train(train, scan_channels(self.word), kernel.now)
        self._courses = radio.courses
        self._course = radio.courses.begin(self.address)
        if radio.courses.wanted:
            parts = partial(self.ids.stretches, before="", after=train_words(self.ids, self.word))
            phases = Phase(clock.time_of(first), "inquiry", parts=parts), Phase(clock.time_of(end))
            self._course.plan(kernel.now, *phases)
        for scanner in scanners:
            scanner.join(self)

    def cancel(self) -> None:
        """End it now; nothing is reported any more, and answers under way are lost."""
        self._over = True
        self._over_since = self._kernel.now
        self._courses.end(self._course, self._kernel.now)
        self._air.close_train(self.address, self._kernel.now)
        self._end.cancel()
        for scanner in self._scanners:
            scanner.leave(self)

    def record_id(self, frame: Frame) -> None:
        """Record that an ID has been sent, as somebody has heard it: once, however many have."""
        if self._air.record_sent is not None and frame.start > self._recorded:
            self._recorded = frame.start
            self._air.record_sent(frame._replace(destination=BROADCAST), b"", False)

    def sends(self, start: Time) -> bool:
        """Return whether the ID at *start*, now, is sent: not while an FHS is being received."""
        self._settle()
        return self._locked is None or not self._locked.frame.start < start < self._locked.end

    def reply(self, frame: Frame, tick: int, clkn: int) -> None:
        """Take the FHS that a scanner, whose clock is *clkn*, begins to send now in answer to the ID of *tick*."""
        reply = _Reply(frame, tick, clkn, self._air.carrier(frame.source, self.address))
        self._unsettled.append(reply)
        self._kernel.at(frame.start + ID_AIR, self._settle)
        self._kernel.at(reply.end, partial(self._judge, reply))

    def _settle(self) -> None:
        """Decide on the replies whose access code is over whether the receiver locks on them."""
        unsettled, begun = self._unsettled, self._kernel.now - ID_AIR
        if not unsettled or unsettled[0].frame.start > begun:
            return
        ready = [reply for reply in unsettled if reply.frame.start <= begun]
        del unsettled[: len(ready)]
        for reply in sorted(ready, key=_order):
            reply.lost = self._hindrance(reply)
            if reply.lost is None:
                self._locked = reply
                self._air.silence_train(self.address, reply.frame.start + 1, reply.end)  # while it receives

    def _hindrance(self, reply: _Reply) -> Fate | None:
        frame, listens = reply.frame, reply.tick + 2
        if not self._air.reaches(reply.carrier_dbm):
            return FAR
        if self._over or frame.channel != inquiry_channel(listens, self.ids.train(listens), self.word):
            return UNTUNED
        if self._locked is not None and frame.start < self._locked.end:
            return TAKEN
        fate = self._air.judge_id(frame, self.address, reply.carrier_dbm)
        if fate is not GOOD:
            return fate
        seats = self._air.seats
        refused = seats is not None and seats.refused_until(self.address, reply.end, Rank.EMPTY) is not None
        return TAKEN if refused else None

    def _judge(self, reply: _Reply) -> None:
        """Record the fate of an FHS at its end, and report a device that is new."""
        self._settle()
        frame = reply.frame
        if self._over_since < reply.end and self._air.reaches(reply.carrier_dbm):
            fate = UNTUNED
        else:
            fate = reply.lost or self._air.judge(frame, self.address, reply.carrier_dbm, FHS_BITS, HEADER)
        if self._air.record_sent is not None:
            self._air.record_sent(frame, b"", False)
        self._air.record(frame, fate, reply.carrier_dbm)
        if fate is GOOD and frame.source not in self.found:
            self._report(reply)

    def _report(self, reply: _Reply) -> None:
        self.found.append(reply.frame.source)
        # an FHS carries bits 27-2 of the clock; the answer to tick c begins at tick c + 2
        self._on_found(reply.frame.source, ((reply.clkn >> 2) - ((reply.tick + 2) >> 2)) * 4 % CLOCK_RANGE)
        if len(self.found) >= self._enough and not self._over:
            self._complete()

    def _complete(self) -> None:
        self.cancel()
        self._on_complete(tuple(self.found))


def known_offset(inquirer: NativeClock, scanner: NativeClock, now: Time) -> int:
    """Return how far *scanner* is ahead of *inquirer* in ticks, as an inquiry at *now* would report it to a host.

    An FHS carries bits 27-2 of a clock, so the offset is a multiple of 4.
    """
    first = first_transmission(inquirer, now)
    return ((scanner.tick(inquirer.time_of(first)) - first) & ~3) % CLOCK_RANGE
