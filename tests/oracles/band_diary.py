"""What all devices do, for the oracle of the whole band: looked at in every tick of their clocks, and at every event.

What a device is found in at two looks after each other it has been in all the time between; equal neighbours make one
row. An event in which something is sent, or an ID is to be, changes what its own device does, any other what all do.
What links make of a device does not change with its clock, so that no tick but only an event is a reason to look at it.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple

from tests.oracles.band_searches import Inquiry, Page, letter
from tests.oracles.band_stage import AIR, SEARCH, Device, Link, Stage, Watcher
from tests.oracles.medium import WINDOW, Windows
from tests.oracles.scanners import CONNECTED, SCAN, Paged, Scanner

GIAC = 0x9E8B33
Doing = tuple[str, str]
"""(state, detail)"""


class Row(NamedTuple):
    """A device was in a state from *start* to *end*."""

    start: int
    device: int
    end: int
    state: str
    detail: str


@dataclass
class Watched:
    """A device that is looked at, and what it was found in at the last look."""

    device: Device
    tick: int
    tick_over: int
    """When the *tick* of its clock is over."""
    again: int = 0
    """When to look again."""
    concerned: bool = True
    """Whether there has been an event since the last look that may have changed what it does."""
    of_links: list[Doing | None] = field(default_factory=list)
    """What it was found in at the last look at its links."""
    found: list[Doing | None] = field(default_factory=list)
    since: dict[Doing, int] = field(default_factory=dict)
    """When what is still going on has begun."""


@dataclass
class Diary(Watcher):
    """Looks at everything on a *stage*."""

    stage: Stage
    rows: list[Row] = field(default_factory=list)
    watched: list[Watched] = field(default_factory=list)

    def start(self) -> None:
        """Look from now on at what happens on the stage."""
        self.stage.watcher = self
        for device in self.stage.devices:
            tick = device.clock.tick(0)
            self.watched.append(Watched(device, tick, device.clock.start(tick + 1)))

    def happened(self, phase: int, order: int) -> None:
        """Let those whom an event may have changed be looked at when all that happens now has happened."""
        own = phase in (SEARCH, AIR)
        for watched in [self.watched[order]] if own else self.watched:
            watched.again, watched.concerned = self.stage.now, True

    def nothing_until(self, time: int) -> None:
        """Look at all at whom it is time to look before *time*."""
        for watched in self.watched:
            while watched.again < time:
                self.look(watched, watched.again)

    def look(self, watched: Watched, now: int) -> None:
        """Look at a device, and again in its next tick, or when something begins or ends before that."""
        device = watched.device
        if now == watched.tick_over:
            watched.tick += 1
            watched.tick_over = device.clock.start(watched.tick + 1)
        watched.again = watched.tick_over
        for time in turns(device):
            if now < time < watched.again:
                watched.again = time
        if device.links and (watched.concerned or now == device.absent_until):
            watched.of_links, watched.concerned = links(self.stage, device, now), False
        found = searches(device, now, watched.tick) + watched.of_links
        if found != watched.found:
            watched.found = found
            self.note(watched, {doing for doing in found if doing is not None}, now)

    def note(self, watched: Watched, found: set[Doing], now: int) -> None:
        """Note what has ended *now*, and what has begun."""
        for doing in watched.since.keys() - found:
            self.end(watched, doing, now)
        for doing in found:
            watched.since.setdefault(doing, now)

    def end(self, watched: Watched, doing: Doing, now: int) -> None:
        self.rows.append(Row(watched.since.pop(doing), watched.device.address, now, *doing))

    def close(self, now: int) -> list[Row]:
        """Return all rows: the scene is over."""
        for watched in self.watched:
            self.note(watched, set(), now)
        return sorted(row for row in self.rows if row.end > row.start)


def turns(device: Device) -> list[int]:
    """Return instants at which something begins or ends without an event; not of scans that are off."""
    scanner, paged = device.inquiry_scan, device.page_scan
    times = [device.absent_until]
    if scanner is not None and scanner.off is None:
        times += [scanner.begin] if scanner.limit is None else [scanner.begin, scanner.limit]
    if paged is not None and paged.off is None:
        times += [paged.begin, paged.limit]
    return times


def searches(device: Device, now: int, tick: int) -> list[Doing | None]:
    """Return what *device* does now, in a *tick* of its clock, to be found or to find; None is nothing."""
    return [
        inquiry_scan(device.inquiry_scan, now, tick),
        page_scan(device.page_scan, now, tick),
        procedure(device.procedure, tick),
    ]


def links(stage: Stage, device: Device, now: int) -> list[Doing | None]:
    """Return what *device* is now because of its links."""
    alive = device.alive()
    if not alive:
        return []
    return [*(membership(link, device.address) for link in alive), *absences(stage, device, alive, now)]


def membership(link: Link, address: int) -> Doing:
    if link.master == address:
        return member("master", "slave", link.slave, link.lt_addr)
    return member("slave", "master", link.master, link.lt_addr)


@lru_cache
def member(role: str, peer_role: str, peer: int, lt_addr: int) -> Doing:
    return role, f"{peer_role}={peer} lt_addr={lt_addr}"


def absences(stage: Stage, device: Device, alive: list[Link], now: int) -> Iterator[Doing]:
    """Return of which piconets *device* is a member without being there, or being there in parts of the time only."""
    share, leaves = device.share, device.procedure is not None or now < device.absent_until
    latest = max(alive, key=lambda link: link.side(device.address).up)
    for master in {link.master for link in alive}:
        part = next((part for part in share.parts if part[0] == master), None) if share else None
        if leaves or (part is None if share else latest.master != master):
            yield away(master)
        elif share is not None and part is not None:
            body = stage.devices[share.reference].body
            yield part_time(master, share.period, part[1], part[2], body.phase, body.ppm)


@lru_cache
def away(master: int) -> Doing:
    return "away", f"master={master}"


@lru_cache
def part_time(master: int, period: int, first: int, count: int, phase: int, ppm: int) -> Doing:
    slots = f"interval_slots={period} offset_slots={first} attempt_slots={count}"
    return "part_time", f"master={master} {slots} phase_ns={phase} ppm={ppm}"


def inquiry_scan(scanner: Scanner | None, now: int, tick: int) -> Doing | None:
    if scanner is None or (scanner.is_off(now) and not (scanner.reply is not None and scanner.reply <= now)):
        return None
    if scanner.reply is not None:
        return "inquiry_response", ""
    if now < scanner.begin:
        return "inquiry_backoff", ""
    if scanner.limit is not None and now < scanner.limit:
        return "inquiry_response", ""
    return window("inquiry_scan", scanner.windows, tick)


def page_scan(paged: Paged | None, now: int, tick: int) -> Doing | None:
    if paged is None or (paged.off is not None and now >= paged.off) or paged.state == CONNECTED:
        return None
    if paged.state != SCAN and now < paged.limit:
        return "page_response", f"peer={paged.partner} role=slave"
    if now < (paged.begin if paged.state == SCAN else paged.limit):
        return None
    return window("page_scan", paged.windows, tick)


def window(state: str, windows: Windows, tick: int) -> Doing | None:
    """Return that a scanner listens, if the *tick* of its clock is in a window."""
    into = (tick - windows.offset) % windows.interval
    if into < WINDOW:
        return state, "window=1" if windows.interlaced else ""
    if into < 2 * WINDOW and windows.interlaced:
        return state, "window=2"
    return None


def procedure(what: Inquiry | Page | None, tick: int) -> Doing | None:
    """Return what a procedure does in a *tick* of the clock of its device."""
    if what is None or what.ended or tick < what.first:
        return None
    return inquiry(what, tick) if isinstance(what, Inquiry) else page(what, tick)


def inquiry(what: Inquiry, tick: int) -> Doing | None:
    body, scene = what.device.body, what.stage.scene
    if tick >= what.last:
        return None
    turn = (tick - what.first) // (32 * scene.n_inquiry)
    return train("inquiry", "", letter(scene.first_train, turn % 2 == 1), GIAC, body.phase, body.ppm, 0)


def page(what: Page, tick: int) -> Doing | None:
    body, peer = what.device.body, what.peer
    if not what.paging:
        return "page_response", f"peer={peer.address} role=master"
    if tick >= what.give_up:
        return None
    turn = (tick - what.first) // (32 * what.stage.scene.repetitions)
    who, word = f"peer={peer.address} ", peer.body.word
    return train("page", who, letter("A", turn % 2 == 1), word, body.phase, body.ppm, what.offset)


@lru_cache
def train(state: str, who: str, which: str, word: int, phase: int, ppm: int, estimate: int) -> Doing:
    """Return that IDs of *word* are sent on the train *which*."""
    return state, f"{who}train={which} word={word:#x} phase_ns={phase} ppm={ppm} estimate={estimate}"
