"""Inquiries and pages in the oracle of the whole band: every tick is visited, every ID is put on the air and judged."""

from dataclasses import dataclass, field
from typing import Any, cast

from cosim.channels.bluetooth.hopping import (
    basic_channel,
    inquiry_channel,
    inquiry_response_channel,
    inquiry_scan_channel,
    master_response_channel,
    page_channel,
    page_scan_channel,
)
from tests.oracles.band_air import FHS, IDENT, POLLING, Contents
from tests.oracles.band_scene import ALL, News, Seen, Sent
from tests.oracles.band_stage import AIR, DELIVER, SEARCH, Device, Link, Stage
from tests.oracles.medium import (
    BUSY,
    FHS_AIR,
    HEADER_AIR,
    ID_AIR,
    NOT_TUNED,
    OUT_OF_RANGE,
    RECEIVED,
    SLOT,
    OnAir,
)
from tests.oracles.scanners import CONNECTED, RESPONSE, Paged, Scanner
from tests.oracles.scanners import HOPPING as HOPS

KOFFSET = {"A": 24, "B": 8}
AIR_TIMES = {"ID": ID_AIR, "FHS": FHS_AIR, "POLL": HEADER_AIR, "NULL": HEADER_AIR}
CONTENTS = {"ID": IDENT, "FHS": FHS, "POLL": POLLING, "NULL": POLLING}


def see(
    stage: Stage,
    frame: OnAir,
    kind: str,
    to: int,
    carrier: float,
    outcome: str,
    part: str | None = None,
    lt_addr: int = 0,
) -> None:
    start, end, source, channel = frame
    stage.arrive(frame, to, carrier, outcome, part)
    stage.book.seen.append(Seen(start, end - start, kind, source, to, channel, lt_addr, outcome, part))


def letter(first: str, swapped: bool) -> Any:
    """Return the train *first*, or the other one."""
    return first if not swapped else "B" if first == "A" else "A"


# ---------------------------------------------------------------- inquiry


@dataclass
class Inquiry:
    """One inquiry of *device* for *duration* ticks, or until *enough* devices were found."""

    stage: Stage
    device: Device
    duration: int
    enough: int
    found: list[int] = field(default_factory=list)
    lock: OnAir | None = None
    ended: bool = False

    def begin(self) -> None:
        clock = self.device.clock
        self.first = clock.first_transmit_tick(self.stage.now)
        self.last = self.first + self.duration
        self.end = clock.start(self.last + 1)
        self.visit_at(self.first)
        self.stage.at(self.end, SEARCH, self.device.address, self.complete)

    def visit_at(self, tick: int) -> None:
        self.stage.at(self.device.clock.start(tick), SEARCH, self.device.address, lambda: self.visit(tick))

    def channel(self, tick: int) -> int:
        scene = self.stage.scene
        train = letter(scene.first_train, (tick - self.first) // (32 * scene.n_inquiry) % 2 == 1)
        return inquiry_channel(tick, train)

    def visit(self, tick: int) -> None:
        if self.ended or tick >= self.last:
            return
        now = self.stage.now
        receiving = self.lock is not None and self.lock.start < now < self.lock.end
        if tick % 4 in (0, 1) and not receiving:
            frame = self.stage.air.put(now, ID_AIR, self.device.address, self.channel(tick))
            self.stage.book.ids.append((now, self.device.address, frame.channel))
            self.stage.at(frame.end, DELIVER, self.device.address, lambda: self.end_of_id(tick, frame))
        self.visit_at(tick + 1)

    def end_of_id(self, tick: int, frame: OnAir) -> None:
        """See who has heard an ID."""
        air = self.stage.air
        for other in self.stage.devices:
            scanner = other.inquiry_scan
            if scanner is None or other is self.device:
                continue
            offset = scanner.listens(frame.start)
            if scanner.heard == (frame.start, frame.channel) and self.stage.scene.radio.mode == "none":
                self.stage.doubt("two IDs of the same instant can be heard")
            if offset is None:
                continue
            if inquiry_scan_channel(scanner.clock.tick(frame.start), offset) != frame.channel:
                continue
            carrier = air.power(self.device.address, other.address, frame.start)
            if air.judge(frame, other.address, carrier, IDENT, self.stage.now, ("access_code",))[0] != RECEIVED:
                continue
            see(self.stage, frame, "ID", other.address, carrier, RECEIVED)
            row = Sent(frame.start, frame.source, "ID", ALL, ID_AIR, frame.channel, 0)
            self.stage.book.sent += [row] if row not in self.stage.book.sent else []
            scanner.heard = (frame.start, frame.channel)
            if scanner.hear(frame.start):
                self.expect(tick, frame, scanner, offset)

    def expect(self, tick: int, ident: OnAir, scanner: Scanner, offset: int) -> None:
        """Let the scanner answer 625 us after the start of the ID."""
        start = ident.start + SLOT
        self.stage.at(start, AIR, scanner.address, lambda: Reply(self, scanner, ident.start, tick + 2, offset).begin())

    def receives(self, frame: OnAir, address: int, tick: int, carrier: float) -> None:
        """Take in an FHS: note a device that is new."""
        if address in self.found:
            return
        self.found.append(address)
        told = self.stage.devices[address].clock.tick(frame.start) & ~3  # an FHS carries bits 27-2
        offset = (told - (tick & ~3)) % (1 << 28)
        self.stage.book.news.append(News(frame.end, self.device.address, "discovered", address, offset))
        if len(self.found) == self.enough:
            self.end = frame.end
            self.complete()

    def complete(self) -> None:
        if self.ended:
            return
        self.ended = True
        self.device.procedure = None
        self.stage.book.news.append(News(self.stage.now, self.device.address, "complete"))
        self.stage.update_scan(self.device)


@dataclass
class Reply:
    """An FHS of *scanner* to the ID at *heard*, looked for at the inquirer's *tick*."""

    inquiry: Inquiry
    scanner: Scanner
    heard: int
    tick: int
    offset: int
    outcome: str = RECEIVED
    part: str | None = None

    def begin(self) -> None:
        stage, scanner = self.inquiry.stage, self.scanner
        if scanner.reply != stage.now:
            return  # it does not scan any more
        channel = inquiry_response_channel(scanner.clock.tick(stage.now), self.offset)
        frame = stage.air.put(stage.now, FHS_AIR, scanner.address, channel)
        to = self.inquiry.device.address
        stage.book.sent.append(Sent(stage.now, scanner.address, "FHS", to, FHS_AIR, channel, 0))
        self.carrier = stage.air.power(scanner.address, self.inquiry.device.address, stage.now)
        stage.at(frame.start + ID_AIR, DELIVER, scanner.address, lambda: self.end_of_access_code(frame))
        stage.at(frame.end, DELIVER, scanner.address, lambda: self.end_of_frame(frame))

    def end_of_access_code(self, frame: OnAir) -> None:
        """Let the inquirer lock on the frame, unless something hinders it."""
        inquiry, air = self.inquiry, self.inquiry.stage.air
        if air.out_of_range(self.carrier):
            self.outcome = OUT_OF_RANGE
        elif frame.channel != inquiry.channel(self.tick) or frame.start >= inquiry.end:
            self.outcome = NOT_TUNED
        elif inquiry.lock is not None and frame.start < inquiry.lock.end:
            self.outcome = BUSY
        else:
            self.judge(frame, "access_code")
            if self.outcome == RECEIVED:
                inquiry.lock = frame

    def judge(self, frame: OnAir, *which: str) -> None:
        stage, receiver = self.inquiry.stage, self.inquiry.device.address
        self.outcome, self.part = stage.air.judge(frame, receiver, self.carrier, FHS, stage.now, which)

    def end_of_frame(self, frame: OnAir) -> None:
        inquiry = self.inquiry
        if frame.end > inquiry.end and self.outcome != OUT_OF_RANGE:
            self.outcome, self.part = NOT_TUNED, None
        elif self.outcome == RECEIVED:
            self.judge(frame, "header", "payload")
        see(inquiry.stage, frame, "FHS", inquiry.device.address, self.carrier, self.outcome, self.part)
        self.scanner.replied(self.heard)
        if self.outcome == RECEIVED:
            inquiry.receives(frame, frame.source, self.tick, self.carrier)


# ---------------------------------------------------------------- page


@dataclass
class Page:
    """One page of *peer*, whose clock *device* takes to be *offset* ticks ahead of its own."""

    stage: Stage
    device: Device
    peer: Device
    offset: int
    paging: bool = True
    resume: int = 0
    ended: bool = False
    link: Link | None = None

    def begin(self) -> None:
        mine = [link for link in self.device.links if link.master == self.device.address]
        taken = {link.lt_addr for link in mine if link.above.alive or link.below.alive}
        self.lt_addr = min(set(range(1, 8)) - taken)
        self.first = self.device.clock.first_transmit_tick(self.stage.now)
        self.give_up = self.first + self.stage.scene.page_timeout
        self.visit_at(self.first)

    @property
    def scanner(self) -> Paged:
        return cast(Paged, self.peer.page_scan)

    def train(self, tick: int) -> Any:
        return letter("A", (tick - self.first) // (32 * self.stage.scene.repetitions) % 2 == 1)

    def visit_at(self, tick: int) -> None:
        self.stage.at(self.device.clock.start(tick), SEARCH, self.device.address, lambda: self.visit(tick))

    def visit(self, tick: int) -> None:
        """Send an ID, or wait for what an exchange brings."""
        if self.ended:
            return
        if not self.paging and tick == self.resume:
            self.paging = True
        if self.paging and tick >= self.give_up:
            self.finish("page failed")
            return
        if self.paging and tick % 4 in (0, 1):
            channel = page_channel(self.peer.body.word, tick + self.offset, self.train(tick))
            frame = self.stage.air.put(self.stage.now, ID_AIR, self.device.address, channel)
            self.stage.book.ids.append((self.stage.now, self.device.address, channel))
            self.stage.at(frame.end, DELIVER, self.device.address, lambda: self.end_of_id(tick, frame))
        self.visit_at(tick + 1)

    def finish(self, what: str) -> None:
        self.ended = True
        self.device.procedure = None
        self.stage.book.news.append(News(self.stage.now, self.device.address, what, self.peer.address))
        self.stage.update_scan(self.device)

    def end_of_id(self, tick: int, frame: OnAir) -> None:
        """See whether the paged device has heard an ID; if so, let it respond."""
        if self.peer.page_scan is None:
            return
        scanner, stage = self.scanner, self.stage
        part = scanner.hears(frame.start)
        if scanner.heard == (frame.start, frame.channel) and stage.scene.radio.mode == "none":
            stage.doubt("two IDs of the same instant can be heard")
        if part is None or page_scan_channel(scanner.word, scanner.clock_at(frame.start, part)) != frame.channel:
            return
        carrier = stage.air.power(self.device.address, self.peer.address, frame.start)
        if stage.air.judge(frame, self.peer.address, carrier, IDENT, stage.now, ("access_code",))[0] != RECEIVED:
            return
        see(stage, frame, "ID", self.peer.address, carrier, RECEIVED)
        row = Sent(frame.start, frame.source, "ID", self.peer.address, ID_AIR, frame.channel, 0)
        stage.book.sent.append(row)
        scanner.heard = (frame.start, frame.channel)
        scanner.frozen = scanner.clock_at(frame.start, part)
        scanner.partner = self.device.address
        scanner.state, scanner.limit = RESPONSE, frame.start + SLOT + 8 * SLOT
        self.answer(frame.start + SLOT, "ID", scanner.channel(2), lambda: self.mine(tick + 2), self.response(tick))

    def mine(self, tick: int) -> int:
        return page_channel(self.peer.body.word, tick + self.offset, self.train(tick))

    def response(self, tick: int) -> Any:
        def judged(frame: OnAir, received: bool) -> None:
            if not received:
                return
            self.paging = False
            self.base, self.frozen, self.koffset = tick - tick % 4, tick + 2 + self.offset, KOFFSET[self.train(tick)]
            self.at_tick(self.base + 4, lambda: self.fhs(1))

        return judged

    def at_tick(self, tick: int, act: Any) -> None:
        self.stage.at(self.device.clock.start(tick), AIR, self.device.address, act)

    # ------------------------------------------------------------ one frame

    def ask(self, kind: str, channel: int, tuned: Any, judged: Any) -> None:
        """Send a frame to the paged device now; at its end call *judged* with it and whether it was received."""
        self.send(self.device.address, self.peer.address, kind, channel, tuned, judged)

    def answer(self, start: int, kind: str, channel: int, tuned: Any, judged: Any) -> None:
        """Let the paged device send a frame at *start*."""
        here, there = self.device.address, self.peer.address
        self.stage.at(start, AIR, there, lambda: self.send(there, here, kind, channel, tuned, judged))

    def send(self, source: int, to: int, kind: str, channel: int, tuned: Any, judged: Any) -> None:
        """Put a frame on the air; *tuned* returns the channel to which its receiver is tuned, or None."""
        stage = self.stage
        frame = stage.air.put(stage.now, AIR_TIMES[kind], source, channel)
        carrier = stage.air.power(source, to, stage.now)
        lt_addr = self.lt_addr if kind in ("POLL", "NULL") else 0
        stage.book.sent.append(Sent(stage.now, source, kind, to, AIR_TIMES[kind], channel, lt_addr))

        def end() -> None:
            outcome, part = self.outcome(frame, to, carrier, CONTENTS[kind], tuned())
            see(stage, frame, kind, to, carrier, outcome, part, lt_addr)
            judged(frame, outcome == RECEIVED)

        stage.at(frame.end, DELIVER, source, end)

    def outcome(
        self, frame: OnAir, to: int, carrier: float, contents: Contents, tuned: int | None
    ) -> tuple[str, str | None]:
        if self.stage.air.out_of_range(carrier):
            return OUT_OF_RANGE, None
        if tuned != frame.channel:
            return NOT_TUNED, None
        return self.stage.air.judge(frame, to, carrier, contents, self.stage.now)

    # ------------------------------------------------------------ the exchange

    def fhs(self, n: int) -> None:
        """Send the n-th FHS."""
        scanner, tick, start = self.scanner, self.base + 4 * n, self.stage.now

        def theirs() -> int | None:
            return scanner.channel(4 * n) if scanner.with_partner(self.device.address, start, RESPONSE) else None

        def judged(frame: OnAir, received: bool) -> None:
            if not received:
                self.again(n)
                return
            scanner.state, scanner.limit = HOPS, frame.start + SLOT + 32 * SLOT
            self.answer(
                frame.start + SLOT, "ID", scanner.channel(4 * n + 2), lambda: self.hop(tick + 2), self.acknowledged(n)
            )

        self.ask("FHS", self.hop(tick), theirs, judged)

    def hop(self, tick: int) -> int:
        return master_response_channel(self.peer.body.word, self.frozen, tick + self.offset, self.koffset)

    def again(self, n: int) -> None:
        """Go on after an FHS or its acknowledgement was lost."""
        if n < 4:
            self.at_tick(self.base + 4 * (n + 1), lambda: self.fhs(n + 1))
        else:
            self.resume = self.base + 20

    def acknowledged(self, n: int) -> Any:
        def judged(frame: OnAir, received: bool) -> None:
            if received:
                first = self.base + 4 * n + 4
                self.at_tick(first, lambda: self.poll(first, 0))
            else:
                self.again(n)

        return judged

    def poll(self, first: int, j: int) -> None:
        """Send the POLL number *j*; the one at *first* was number 0."""
        scanner, tick, start = self.scanner, first + 4 * j, self.stage.now
        channel = basic_channel(self.device.body.word, tick)

        def theirs() -> int | None:
            return channel if scanner.with_partner(self.device.address, start, HOPS, CONNECTED) else None

        def judged(frame: OnAir, received: bool) -> None:
            if not received:
                self.poll_again(first, j)
                return
            self.slave_hears(frame)
            back = basic_channel(self.device.body.word, tick + 2)
            self.answer(frame.start + SLOT, "NULL", back, lambda: back, self.null(first, j))

        self.ask("POLL", channel, theirs, judged)

    def slave_hears(self, frame: OnAir) -> None:
        """Let the paged device be connected by its first POLL; further ones do not count as heard."""
        if self.scanner.state == HOPS:
            self.scanner.state = CONNECTED
            self.link = Link(self.device.address, self.peer.address, self.lt_addr)
            self.stage.come_up(self.link, self.peer)
            self.stage.book.news.append(News(frame.end, self.peer.address, "slave", self.device.address))

    def poll_again(self, first: int, j: int) -> None:
        if j < 15:
            self.at_tick(first + 4 * (j + 1), lambda: self.poll(first, j + 1))
        else:
            self.resume = first + 64
            if self.link is not None:
                self.stage.doubt("the paged device is connected, and its pager does not know")

    def null(self, first: int, j: int) -> Any:
        def judged(frame: OnAir, received: bool) -> None:
            if not received:
                self.poll_again(first, j)
                return
            assert self.link is not None
            self.link.due = first + 4 * j + 2 * self.stage.scene.t_poll
            self.stage.come_up(self.link, self.device)
            self.finish("master")

        return judged
