"""The stage of the oracle of the whole band: devices, their links, what hosts do to them, and one agenda for all.

The agenda holds (instant, phase, order): powers change first, then frames end, links time out, hosts act, inquirers and
pagers visit their ticks, and last the masters decide their slots and frames go on the air.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from heapq import heappop, heappush
from math import inf
from typing import Any

from tests.oracles.band_air import Air, Contents
from tests.oracles.band_hosts import Transport
from tests.oracles.band_scene import ALL, KINDS, Arrived, Body, Book, Delivery, Flush, Loss, Scene, Send, Share, Verdict
from tests.oracles.medium import HEADER_AIR, NOT_TUNED, OUT_OF_RANGE, US, Clock, OnAir, Windows
from tests.oracles.scanners import CONNECTED, SCAN, Paged, Scanner

DELIVER, LOSS, HOST, SEARCH, AIR = 1, 2, 3, 4, 5


@dataclass
class Entry:
    """A payload in a queue."""

    destination: int
    token: int
    kind: str
    length: int
    sent: int = 0
    """How often it has been on the air."""
    chosen: bool = False
    """It will be the answer of the slot pair under way, if the slave hears the master."""

    @property
    def slots(self) -> int:
        return KINDS[self.kind].slots

    @property
    def contents(self) -> Contents:
        kind = KINDS[self.kind]
        return Contents(8 * (kind.header + self.length + 2), kind.coded)

    @property
    def air(self) -> int:
        bits, coded, _ = self.contents
        return HEADER_AIR + US * (-(-bits // 10) * 15 if coded else bits)


@dataclass
class Side:
    """What one end of a link knows of the other."""

    alive: bool = False
    heard: int = 0
    """End of the last frame heard."""
    up: int = 0
    """The how-manieth of all links' ends came up."""
    taken: int | None = None
    """The token of the last payload taken from the other end."""
    owes_ack: int | None = None
    """Master: the token that the last answer brought."""


@dataclass
class Link:
    """A master and one of its slaves."""

    master: int
    slave: int
    lt_addr: int
    due: int = 0
    above: Side = field(default_factory=Side)
    """The master's side."""
    below: Side = field(default_factory=Side)
    queue: list[Entry] = field(default_factory=list)
    """The slave's queue."""
    broadcasts: set[int] = field(default_factory=set)
    """Tokens of broadcasts delivered."""
    stopped: bool = False
    """The slave's last answer has said that it has no place for a payload."""

    def side(self, device: int) -> Side:
        return self.above if device == self.master else self.below


@dataclass
class Device:
    """A device and all that it has at the moment."""

    address: int
    body: Body
    clock: Clock
    transport: Transport
    last_taken: int = -1
    """When it received a payload last."""
    inquiry_scan: Scanner | None = None
    page_scan: Paged | None = None
    links: list[Link] = field(default_factory=list)
    """All that it ever had."""
    queue: list[Entry] = field(default_factory=list)
    """As a master."""
    procedure: Any = None
    absent_until: int = 0
    share: Share | None = None
    scan_asked: bool = False
    """By its host, since its last link came up."""
    scan_refused: bool = False
    """By its host."""
    scanning: bool = False
    free: int = 0
    """The master's tick from which a slot pair can begin."""

    def own(self) -> list[Link]:
        """Return the links of its own piconet that it still has."""
        return [link for link in self.links if link.master == self.address and link.above.alive]

    def alive(self) -> list[Link]:
        return [link for link in self.links if link.side(self.address).alive]

    def to(self, peer: int) -> Link | None:
        return next((link for link in self.alive() if peer in (link.master, link.slave)), None)


class Watcher:
    """Somebody who looks at what happens on a stage; this one does not."""

    def happened(self, phase: int, order: int) -> None:
        """Take in that an event of that phase and order has happened."""

    def nothing_until(self, time: int) -> None:
        """Take in that all that happens now has happened, and that nothing else will before *time*."""


@dataclass
class Stage:
    """Devices on one air, and the agenda."""

    scene: Scene
    draw: Callable[[int, int, int], int]
    """(device, bound, tick) -> an integer in [0, bound): the scanner's back-off."""
    book: Book = field(default_factory=Book)
    now: int = 0
    watcher: Watcher = field(default_factory=Watcher)

    def __post_init__(self) -> None:
        self.air = Air(self.scene.radio, len(self.scene.bodies))
        self.agenda: list[tuple[int, int, int, int, Callable[[], None]]] = []
        self.count = self.ups = 0
        self.devices = [self.device(address, body) for address, body in enumerate(self.scene.bodies)]
        for device in self.devices:
            self.update_scan(device)

    def device(self, address: int, body: Body) -> Device:
        clock = Clock(body.phase, body.ppm)
        device = Device(address, body, clock, Transport(self.scene.host_bps, self.scene.room))
        if body.inquiry_scan is not None:
            offset, interval, interlaced, version, n = body.inquiry_scan
            windows = Windows(clock, offset, interval, interlaced)
            draw = lambda bound, tick: self.draw(address, bound, tick)  # noqa: E731
            device.inquiry_scan = Scanner(address, windows, version, draw, 0, n, 0)
        if body.page_scan is not None:
            offset, interval, interlaced, _, _ = body.page_scan
            device.page_scan = Paged(address, body.word, Windows(clock, offset, interval, interlaced), off=0)
        return device

    def at(self, time: int, phase: int, order: int, act: Callable[[], None]) -> None:
        assert time >= self.now, (time, self.now)
        self.count += 1
        heappush(self.agenda, (time, phase, order, self.count, act))

    def run(self) -> None:
        while self.agenda and self.agenda[0][0] < self.scene.end:
            time, phase, order, _, act = heappop(self.agenda)
            if time > self.now:
                self.watcher.nothing_until(time)
                self.now = time
            act()
            self.watcher.happened(phase, order)
        self.watcher.nothing_until(self.scene.end)
        self.book.sort()

    def arrive(self, frame: OnAir, to: int, carrier: float, outcome: str, part: str | None, idle: bool = False) -> None:
        """Note what has arrived at *to* of a frame that ends now."""
        unheard = outcome in (OUT_OF_RANGE, NOT_TUNED)
        ratio = None if unheard else self.air.least_ratio(frame, to, carrier, self.now)
        power = carrier if self.scene.radio.noise_dbm is not None and carrier > -inf else None
        self.book.arrived.append(Arrived(frame.start, frame.source, to, power, ratio, outcome, part, idle))

    def doubt(self, why: str) -> None:
        self.book.doubts.append((self.now, why))

    # ------------------------------------------------------------ scanning

    def update_scan(self, device: Device) -> None:
        """Scan without links and procedures, or because the host has asked for it."""
        wanted = not device.scan_refused and (device.scan_asked or not device.alive())
        wanted = wanted and device.procedure is None
        if wanted == device.scanning:
            return
        device.scanning = wanted
        if device.inquiry_scan is not None:
            self.switch_inquiry_scan(device.inquiry_scan, wanted)
        if device.page_scan is not None:
            self.switch_page_scan(device.page_scan, wanted)

    def switch_inquiry_scan(self, scanner: Scanner, on: bool) -> None:
        if on:
            scanner.begin, scanner.off = max(self.now, scanner.begin if scanner.reply else 0), None
            return
        scanner.off, scanner.limit = self.now, None
        if scanner.reply is not None and scanner.reply >= self.now:
            scanner.reply = None  # never sent

    def switch_page_scan(self, paged: Paged, on: bool) -> None:
        paged.settle(self.now)
        if paged.state not in (SCAN, CONNECTED):
            self.doubt("page scan is switched during an exchange")
        if on:
            paged.begin, paged.off, paged.state = self.now, None, SCAN
        else:
            paged.off = self.now

    # ------------------------------------------------------------ links

    def come_up(self, link: Link, device: Device) -> None:
        """Let one side of a link come up now."""
        side = link.side(device.address)
        self.ups += 1
        side.alive, side.up, side.heard = True, self.ups, self.now
        if link not in device.links:
            device.links.append(link)
        device.scan_asked = False
        self.update_scan(device)
        self.hear(link, device, self.now)

    def hear(self, link: Link, device: Device, time: int) -> None:
        """Note that *device* has heard the other side until *time*, and when it will be patient no longer."""
        side = link.side(device.address)
        side.heard = time
        self.at(time + self.scene.supervision, LOSS, device.address, lambda: self.time_out(link, device))

    def time_out(self, link: Link, device: Device) -> None:
        side = link.side(device.address)
        if side.alive and side.heard + self.scene.supervision == self.now:
            self.lose(link, device)

    def lose(self, link: Link, device: Device) -> None:
        side, other = link.side(device.address), link.slave if device.address == link.master else link.master
        side.alive = False
        if not link.above.up:
            self.doubt("a slave loses its master while that one still pages it")
        self.book.losses.append(Loss(self.now, device.address, other))
        if device.address == link.slave:
            self.drop(link.queue, device, lambda entry: True)
        else:
            self.drop(device.queue, device, lambda entry: entry.destination == link.slave)
            if not device.own():
                self.drop(device.queue, device, lambda entry: entry.destination == ALL)
        self.update_scan(device)

    def drop(self, queue: list[Entry], device: Device, unwanted: Callable[[Entry], bool]) -> None:
        for entry in [entry for entry in queue if unwanted(entry)]:
            queue.remove(entry)
            self.verdict(device.address, entry.token, "flushed")

    def deliver(self, receiver: Device, source: int, entry: Entry) -> None:
        """Let *receiver* take a payload now, and its host have it when it is its turn."""
        if receiver.transport.bps is not None and receiver.last_taken == self.now:
            self.doubt("two payloads are received at the same instant")
        receiver.last_taken = self.now
        to_all = entry.destination == ALL
        time = receiver.transport.take(entry.length, None if to_all else source, self.now)
        if time < self.scene.end:
            self.book.deliveries.append(Delivery(time, source, receiver.address, entry.token, to_all))

    def verdict(self, owner: int, token: int, outcome: str) -> None:
        self.book.verdicts.append(Verdict(self.now, owner, token, outcome))

    # ------------------------------------------------------------ presence

    def present(self, device: Device, master: int, need: int) -> bool:
        """Return whether *device* is in the piconet of *master* now, and will be for *need* ticks if it has parts."""
        if device.procedure is not None or self.now < device.absent_until:
            return False
        if device.share is not None:
            return self.in_part(device.share, master, need)
        latest = max(device.alive(), key=lambda link: link.side(device.address).up, default=None)
        return latest is not None and latest.master == master

    def in_part(self, share: Share, master: int, need: int) -> bool:
        """Return whether a transaction of *need* ticks that begins now lies in the part for *master*."""
        for whose, first, count in share.parts:
            if whose == master:
                tick = self.devices[share.reference].clock.tick(self.now)
                return (tick - 2 * first) % (2 * share.period) + need <= 2 * count
        return False

    # ------------------------------------------------------------ hosts

    def send(self, wish: Send) -> None:
        device = self.devices[wish.source]
        link = device.to(wish.destination)
        has_link = bool(device.own()) if wish.destination == ALL else link is not None
        fitting = [name for name in self.scene.kinds if KINDS[name].capacity >= wish.length]
        if not has_link:
            self.verdict(wish.source, wish.token, "no_link")
        elif not fitting:
            self.verdict(wish.source, wish.token, "too_long")
        else:
            kind = min(fitting, key=lambda name: KINDS[name].capacity)
            queue = device.queue if link is None or link.master == wish.source else link.queue
            queue.append(Entry(wish.destination, wish.token, kind, wish.length))

    def flush(self, wish: Flush) -> None:
        device = self.devices[wish.source]
        for queue in [device.queue, *(link.queue for link in device.links if link.slave == wish.source)]:
            self.drop(
                queue,
                device,
                lambda entry: entry.destination == wish.destination and entry.sent == 0 and not entry.chosen,
            )
