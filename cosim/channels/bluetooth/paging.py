"""Page and page scan (Core v1.2, Vol 2 Part B, section 8.3): how a master makes another device its slave.

The pager (the master to be) sends the other's access code through its trains, where it guesses the other to listen from
an estimate of its clock; how long a train is repeated follows the other's scan mode. What follows the ID that is heard,
at tick c of the pager, base = c rounded down to a multiple of 4:

    slave    ID    625 us after the ID                    response; its clock is frozen at the heard ID
    master   FHS   base + 4n, n = 1..4 until acknowledged its own clock and the slave's LT_ADDR
    slave    ID    625 us after the FHS                   acknowledgement; then it follows the master's hop sequence
    master   POLL  every transmit slot, 16 times at most  the first received one makes the slave a slave
    slave    NULL  625 us after the POLL                  the first received one makes the master a master

Whatever is lost leads back: the pager to paging (its trains go on as if nothing had happened), the scanner to scanning
when its time-out for the next frame is over. Kernel events exist for IDs that would be heard and for the start and end
of the frames above. As in an inquiry, IDs are on the air whether or not they are heard.
"""

from collections.abc import Callable
from functools import partial
from typing import Final, Literal, TypeAlias

from pydantic import Field

from cosim.channels.air.arbitration import Rank
from cosim.channels.bluetooth.hopping import (
    KOFFSET,
    NARROW,
    basic_channel,
    master_response_channel,
    page_channel,
    scan_channels,
    slave_response_channel,
)
from cosim.channels.bluetooth.packets import FHS_AIR, FHS_BITS, HEADER_AIR, ID_AIR
from cosim.channels.bluetooth.radio import FAR, GOOD, UNTUNED, Frame, Radio, was_sent
from cosim.channels.bluetooth.scanning import (
    RESPONSE_DELAY,
    IdTrain,
    Meeting,
    ScanSettings,
    ScanWindows,
    at_meeting,
    first_transmission,
    next_meeting,
    train_words,
)
from cosim.channels.courses import Phase
from cosim.kernel import Handle
from cosim.machine import Address
from cosim.settings import Count, Settings
from cosim.units import SLOT, Time

PAGE_RESPONSE_TIMEOUT: Final[Time] = 8 * SLOT
"""pagerespTO: time for which a responding slave waits for the FHS."""
NEW_CONNECTION_TIMEOUT: Final[Time] = 32 * SLOT
"""newconnectionTO: time for which a slave that has acknowledged waits for the first POLL."""
FHS_TRIES: Final = 4
POLL_TRIES: Final = 16
REPETITIONS: Final[dict[str, int]] = {"R0": 1, "R1": 128, "R2": 256}
"""N_page by the scan mode of the paged device."""


class PageSettings(Settings):
    """Parameters of a page."""

    mode: Literal["R0", "R1", "R2"] = "R1"
    """Scan mode that the paged devices are taken to have: R0 continuous, R1 every 1.28 s, R2 every 2.56 s."""
    timeout_slots: Count = Field(default=8192, ge=2, multiple_of=2)
    """pageTO in slots of 625 us."""

    @property
    def n_page(self) -> int:
        """Repetitions of a train before the other takes over."""
        return REPETITIONS[self.mode]


class PageScanner:
    """One device's side of being paged; off until it is enabled.

    *on_slave_connected* gets the pager's address and the LT_ADDR given to this device, at the end of the POLL that
    makes it a slave; from then on it is off until it is enabled again.
    """

    def __init__(
        self,
        radio: Radio,
        settings: ScanSettings,
        offset_ticks: int,
        on_slave_connected: Callable[[Address, int], None],
    ) -> None:
        self.kernel = radio.kernel
        self.address = radio.identity.address
        self.hop_address = radio.identity.hop_address
        self.clock = radio.identity.clock
        self.enabled = False
        self._on_slave_connected = on_slave_connected
        self._windows = ScanWindows(self.clock, offset_ticks, settings.interval_ticks, settings.interlaced)
        self._courses = radio.courses
        self._course = radio.courses.begin(self.address)
        self._since: Time = 0  # deaf before
        self._exchange: _Exchange | None = None  # the one it is engaged in
        self._pages: list[Page] = []  # under way, to this device

    def enable(self, now: Time) -> None:
        """Scan from *now* on; a window in progress counts for its remainder. Nothing happens if it scans already."""
        if not self.enabled:
            self.enabled = True
            if self._exchange is not None and not self._exchange.slave:
                self._exchange = None
            self._scan(now)
            self._plan(now)

    def disable(self) -> None:
        """Stop scanning, and take no further part in an exchange, unless it is a slave by now."""
        self.enabled = False
        if self._exchange is not None and not self._exchange.slave:
            self._exchange = None
        self._stop_course()
        self._notify_pages()

    def next_meeting(self, ids: IdTrain, tick: int) -> Meeting | None:
        """Return the first ID of a page at or after *tick* that would be heard, as far as is known now."""
        if not self.enabled or self._exchange is not None:
            return None
        return next_meeting(ids, self._windows, tick, max(self._since, self.kernel.now))

    def join(self, page: "Page") -> None:
        """Notify *page* from now on when this scanner starts or stops to listen."""
        self._pages.append(page)

    def leave(self, page: "Page") -> None:
        """Forget *page*: it is over."""
        if page in self._pages:
            self._pages.remove(page)

    def engage(self, exchange: "_Exchange") -> None:
        """Listen to one pager only."""
        self._exchange = exchange
        self._notify_pages()

    def wait(self, exchange: "_Exchange", until: Time) -> None:
        """Note that this side, if it takes part in *exchange*, scans again at *until* if it hears nothing more."""
        if self._courses.wanted and self._exchange is exchange and not exchange.slave:
            detail = f"peer={exchange.pager} role=slave"
            self._plan(until, Phase(self.kernel.now, "page_response", detail))

    def _plan(self, since: Time, *before: Phase) -> None:
        """Plan to listen in windows *since* then, and from now on what comes *before*."""
        if self._courses.wanted:
            windows = Phase(since, "page_scan", parts=self._windows.stretches)
            self._course.plan(self.kernel.now, *before, windows)

    def _stop_course(self) -> None:
        if self._courses.wanted:
            self._course.plan(self.kernel.now)

    def engaged_in(self, exchange: "_Exchange") -> bool:
        """Return whether this side still takes part in *exchange*."""
        return self._exchange is exchange

    def release(self, exchange: "_Exchange", at: Time) -> None:
        """Scan again from *at* on, when the time-out for the next frame of *exchange* is over."""
        if self._exchange is exchange:
            self.wait(exchange, at)
            self._exchange = None
            self._scan(at)

    def finish(self, exchange: "_Exchange") -> None:
        """Take other pages again: *exchange* is over for a device that has become a slave by it."""
        if self._exchange is exchange:
            self._exchange = None
            self._notify_pages()

    def become_slave(self, master: Address, lt_addr: int) -> None:
        """Stop scanning: there is a link now."""
        self.enabled = False
        self._stop_course()
        self._on_slave_connected(master, lt_addr)

    def _scan(self, since: Time) -> None:
        self._since = since
        self._notify_pages()

    def _notify_pages(self) -> None:
        for page in self._pages:
            page.look_again()


class Page:
    """One page: from the first transmit slot at or after now until the other is a slave, or pageTO.

    *estimate* is what to add to the pager's ticks to guess the scanner's clock, a multiple of 4. *on_connected* gets
    the tick of the POLL whose NULL was received, at the end of that NULL; *on_failed* ends a page without a link.
    """

    def __init__(
        self,
        radio: Radio,
        settings: PageSettings,
        scanner: PageScanner,
        estimate: int,
        lt_addr: int,
        on_connected: Callable[[int], None],
        on_failed: Callable[[], None],
    ) -> None:
        clock = radio.identity.clock
        first = first_transmission(clock, radio.kernel.now)
        self.kernel = radio.kernel
        self.air = radio.air
        self.address = radio.identity.address
        self.hop_address = radio.identity.hop_address
        end, narrow = first + 2 * settings.timeout_slots, bool(scanner.hop_address & NARROW)
        self.ids = IdTrain(clock, first, end, settings.n_page, "A", estimate, narrow)
        self.scanner = scanner
        self.lt_addr = lt_addr
        self._on_connected = on_connected
        self._on_failed = on_failed
        self._resumed = first  # the tick from which on it pages
        self._expected: Handle | None = None
        self._exchange: _Exchange | None = None
        self._sending = False
        self._courses = radio.courses
        self._course = radio.courses.begin(self.address)
        scanner.join(self)
        self.send_ids(first)
        self._seek(first)

    def cancel(self) -> None:
        """End it now; nothing is reported any more."""
        self._leave()
        if self._expected is not None:
            self._expected.cancel()
        if self._exchange is not None:
            self._exchange.abandon()

    def look_again(self) -> None:
        """Note that the scanner has started or stopped to listen."""
        if self._exchange is None:
            self._seek(self._resumed)

    def resume(self, tick: int) -> None:
        """Go on paging from *tick*: the exchange has failed."""
        self._exchange = None
        self.send_ids(tick)
        self._seek(tick)

    def send_ids(self, tick: int) -> None:
        """Send IDs from *tick* on, unless it does so already or its time is over."""
        if not self._sending and tick < self.ids.end:
            self._sending = True
            row = self.ids.on_air(self.address, self.ids.clock.time_of(tick))
            self.air.open_train(row, scan_channels(self.scanner.hop_address), self.kernel.now)
            if self._courses.wanted:
                self._plan(tick)

    def stop_ids(self) -> None:
        """Send no more IDs."""
        self._sending = False
        if self._courses.wanted:
            self._course.plan(self.kernel.now, self._exchanging())
        self.air.close_train(self.address, self.kernel.now)

    def _plan(self, tick: int) -> None:
        """Plan to send IDs from *tick* on; before, unless it is the first time, an exchange is not quite over."""
        before = f"peer={self.scanner.address} "
        parts = partial(self.ids.stretches, before=before, after=train_words(self.ids, self.scanner.hop_address))
        exchange = (self._exchanging(),) if tick > self.ids.first else ()
        self._course.plan(self.kernel.now, *exchange, Phase(self.ids.clock.time_of(tick), "page", parts=parts))

    def _exchanging(self) -> Phase:
        return Phase(self.kernel.now, "page_response", f"peer={self.scanner.address} role=master")

    def _leave(self) -> None:
        self.scanner.leave(self)
        self.stop_ids()
        self._courses.end(self._course, self.kernel.now)

    def connected(self, poll_tick: int) -> None:
        """Report the link: the NULL that answers the POLL of *poll_tick* was received."""
        self._leave()
        self._on_connected(poll_tick)

    def channel(self, tick: int) -> int:
        """Return the channel on which an ID is sent, or its answer expected, at *tick*."""
        return page_channel(self.scanner.hop_address, tick + self.ids.estimate, self.ids.train(tick))

    def _seek(self, tick: int) -> None:
        """Schedule the next ID at or after *tick* that might be heard, or the end."""
        self._resumed = tick
        if self._expected is not None:
            self._expected.cancel()
        meeting = self.scanner.next_meeting(self.ids, tick)
        if meeting is None:
            end = self.ids.clock.time_of(max(tick, self.ids.end))
            self._expected = at_meeting(self.kernel, end, self._fail)
        else:
            start = self.ids.clock.time_of(meeting.tick)
            self._expected = at_meeting(self.kernel, start, partial(self._look, meeting))

    def _look(self, meeting: Meeting) -> None:
        carrier = self.air.carrier(self.address, self.scanner.address)
        if self.air.reaches(carrier):
            channel = self.channel(meeting.tick)
            frame = Frame(self.kernel.now, ID_AIR, "ID", self.address, self.scanner.address, channel)
            if self.air.recorded:
                self.air.latest.append(frame)
            self._expected = self.kernel.after(ID_AIR, partial(self._heard, meeting, frame, carrier))
        else:
            self._seek(meeting.tick + 1)

    def _heard(self, meeting: Meeting, frame: Frame, carrier_dbm: float) -> None:
        if not was_sent(self.air, frame) or self.air.judge(frame, self.scanner.address, carrier_dbm) is not GOOD:
            self._seek(meeting.tick + 1)
            return
        if self.air.record_sent is not None:
            self.air.record_sent(frame, b"", False)
        self.air.record(frame, GOOD, carrier_dbm)
        self._exchange = _Exchange(self, meeting, frame.start)
        self.scanner.engage(self._exchange)
        self.scanner.wait(self._exchange, frame.start + RESPONSE_DELAY + PAGE_RESPONSE_TIMEOUT)

    def _fail(self) -> None:
        self._leave()
        self._on_failed()


_Then: TypeAlias = Callable[[bool], None]


class _Exchange:
    """The exchange that follows a heard page ID, both sides of it; one event is pending at a time."""

    def __init__(self, page: Page, meeting: Meeting, start: Time) -> None:
        self.slave = False
        """True if the paged device has received a POLL."""
        self.pager = page.address
        self._page = page
        self._kernel = page.kernel
        self._clock = page.ids.clock
        self._tick = meeting.tick
        self._base = meeting.tick & ~3
        self._koffset = KOFFSET[page.ids.train(meeting.tick)]
        self._frozen_clkn = page.scanner.clock.tick(start) + (meeting.second << 16)  # + 16 in bits 16-12
        self._frozen_clke = meeting.tick + 2 + page.ids.estimate
        self._scan_at = start + RESPONSE_DELAY + PAGE_RESPONSE_TIMEOUT
        self._acknowledged = False
        self._under_way: Frame | None = None
        self._pending = self._kernel.at(start + RESPONSE_DELAY, self._respond)

    def abandon(self) -> None:
        """Let the pager take no further part; the scanner notices by its time-out."""
        self._pending.cancel()
        if self._under_way is not None and self._page.air.record_sent is not None:  # nobody will ask what became of it
            self._page.air.record_sent(self._under_way, b"", False)
        if self.slave:
            self._page.scanner.finish(self)
        else:
            self._page.scanner.release(self, self._scan_at)

    @property
    def _present(self) -> bool:
        return self._page.scanner.engaged_in(self)

    def _fail(self, tick: int) -> None:
        """End the exchange; the pager goes on at *tick*."""
        self.abandon()
        self._page.resume(tick)

    def _respond(self) -> None:
        if not self._present:
            self._fail(self._tick + 1)
            return
        channel = self._slave_channel(2)
        tuned = channel == self._page.channel(self._tick + 2)
        self._send_back("ID", ID_AIR, channel, tuned, self._after_response)

    def _after_response(self, received: bool) -> None:
        if received:
            self._page.stop_ids()
            self._at_tick(self._base + 4, partial(self._send_fhs, 1))
        else:
            self._fail(self._tick + 1)

    def _send_fhs(self, n: int) -> None:
        channel = self._master_channel(4 * n)
        tuned = self._present and not self._acknowledged and channel == self._slave_channel(4 * n)
        self._send("FHS", FHS_AIR, channel, tuned, partial(self._after_fhs, n, self._kernel.now))

    def _after_fhs(self, n: int, start: Time, received: bool) -> None:
        if received:
            self._pending = self._kernel.at(start + RESPONSE_DELAY, partial(self._acknowledge, n))
            self._page.scanner.wait(self, start + RESPONSE_DELAY + NEW_CONNECTION_TIMEOUT)
        else:
            self._repeat_fhs(n)

    def _repeat_fhs(self, n: int) -> None:
        if n < FHS_TRIES:
            self._at_tick(self._base + 4 * (n + 1), partial(self._send_fhs, n + 1))
        else:
            self._fail(self._base + 4 * (n + 1))

    def _acknowledge(self, n: int) -> None:
        if not self._present:
            self._repeat_fhs(n)
            return
        self._acknowledged = True
        self._scan_at = self._kernel.now + NEW_CONNECTION_TIMEOUT
        channel = self._slave_channel(4 * n + 2)
        tuned = channel == self._master_channel(4 * n + 2)
        self._send_back("ID", ID_AIR, channel, tuned, partial(self._after_acknowledgement, n))

    def _after_acknowledgement(self, n: int, received: bool) -> None:
        if received:
            self._poll_at(self._base + 4 * n + 4, POLL_TRIES)
        else:
            self._repeat_fhs(n)

    def _poll_at(self, tick: int, tries: int) -> None:
        if tries:
            self._at_tick(tick, partial(self._poll, tick, tries))
        else:
            self._fail(tick)

    def _poll(self, tick: int, tries: int) -> None:
        channel = basic_channel(self._page.hop_address, tick)
        then = partial(self._after_poll, tick, tries, self._kernel.now)
        self._send("POLL", HEADER_AIR, channel, self._present, then, self._page.lt_addr)

    def _after_poll(self, tick: int, tries: int, start: Time, received: bool) -> None:
        if not received:
            self._poll_at(tick + 4, tries - 1)
            return
        self._pending = self._kernel.at(start + RESPONSE_DELAY, partial(self._answer, tick, tries))
        if not self.slave:
            self.slave = True
            self._page.scanner.become_slave(self._page.address, self._page.lt_addr)

    def _answer(self, tick: int, tries: int) -> None:
        if not self._present:
            self._poll_at(tick + 4, tries - 1)
            return
        channel = basic_channel(self._page.hop_address, tick + 2)
        then = partial(self._after_answer, tick, tries)
        self._send_back("NULL", HEADER_AIR, channel, True, then, self._page.lt_addr)

    def _after_answer(self, tick: int, tries: int, received: bool) -> None:
        if received:
            self._page.scanner.finish(self)
            self._page.connected(tick)
        else:
            self._poll_at(tick + 4, tries - 1)

    def _slave_channel(self, after: int) -> int:
        frozen = self._frozen_clkn
        return slave_response_channel(self._page.scanner.hop_address, frozen, (frozen & ~3) + after)

    def _master_channel(self, after: int) -> int:
        clke = self._base + after + self._page.ids.estimate
        return master_response_channel(self._page.scanner.hop_address, self._frozen_clke, clke, self._koffset)

    def _at_tick(self, tick: int, callback: Callable[[], None]) -> None:
        self._pending = self._kernel.at(self._clock.time_of(tick), callback)

    def _send(self, kind: str, duration: Time, channel: int, tuned: bool, then: _Then, lt_addr: int = 0) -> None:
        page = self._page
        frame = Frame(self._kernel.now, duration, kind, page.address, page.scanner.address, channel, lt_addr)
        self._transmit(frame, tuned, then)

    def _send_back(self, kind: str, duration: Time, channel: int, tuned: bool, then: _Then, lt_addr: int = 0) -> None:
        page = self._page
        frame = Frame(self._kernel.now, duration, kind, page.scanner.address, page.address, channel, lt_addr)
        self._transmit(frame, tuned, then)

    def _transmit(self, frame: Frame, tuned: bool, then: _Then) -> None:
        air, seats = self._page.air, self._page.air.seats
        if seats is not None:
            end = frame.start + frame.duration
            if seats.refused_until(frame.source, end, Rank.DATA) is not None:
                self._pending = self._kernel.at(end, partial(then, False))
                return
            if tuned and air.reaches(air.carrier(frame.source, frame.destination)):
                tuned = seats.refused_until(frame.destination, end, Rank.DATA) is None
        air.put(frame)
        if air.recorded:
            air.latest.append(frame)
        self._under_way = frame
        carrier = air.carrier(frame.source, frame.destination)
        self._pending = self._kernel.after(frame.duration, partial(self._arrive, frame, carrier, tuned, then))

    def _arrive(self, frame: Frame, carrier_dbm: float, tuned: bool, then: _Then) -> None:
        air = self._page.air
        self._under_way = None
        if not tuned:
            fate = UNTUNED if air.reaches(carrier_dbm) else FAR
        else:
            bits = FHS_BITS if frame.kind == "FHS" else 0
            fate = air.judge(frame, frame.destination, carrier_dbm, bits)
        if air.record_sent is not None:
            air.record_sent(frame, b"", False)
        air.record(frame, fate, carrier_dbm)
        then(fate is GOOD)
