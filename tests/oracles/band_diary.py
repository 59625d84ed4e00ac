"""What all devices do, for the oracle of the whole band: looked at in every tick of their clocks, and at every event.

What a device is found in at two looks after each other it has been in all the time between; equal neighbours make one
row. An event in which something is sent, or an ID is to be, changes what its own device does, any other what all do.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from tests.oracles.band_searches import Inquiry, Page
from tests.oracles.band_stage import AIR, SEARCH, Device, Stage
from tests.oracles.medium import WINDOW, Windows
from tests.oracles.scanners import CONNECTED, SCAN, Paged, Scanner

LOOK = 9
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
class Diary:
    """Looks at everything on a *stage*."""

    stage: Stage
    rows: list[Row] = field(default_factory=list)
    since: list[dict[Doing, int]] = field(default_factory=list)
    """When what is still going on has begun, by device."""
    looks: set[tuple[int, int]] = field(default_factory=set)
    """(instant, device) at which it has looked, or will."""

    def start(self) -> None:
        """Look from now on at what happens on the stage."""
        self.stage.happened = self.happened
        for device in self.stage.devices:
            self.since.append({})
            self.look_at(0, device)
            self.look_in(device, device.clock.tick(0) + 1)

    def happened(self, phase: int, order: int) -> None:
        own = phase in (SEARCH, AIR)
        for device in [self.stage.devices[order]] if own else self.stage.devices:
            self.look_at(self.stage.now, device)

    def look_in(self, device: Device, tick: int) -> None:
        """Look at *device* in a *tick* of its clock, and in all after it."""

        def look() -> None:
            self.look(device)
            self.look_in(device, tick + 1)

        self.stage.at(device.clock.start(tick), LOOK, device.address, look)

    def look_at(self, time: int, device: Device) -> None:
        """Look at *device* at *time*, when all that happens then has happened."""
        if (time, device.address) not in self.looks:
            self.looks.add((time, device.address))
            self.stage.at(time, LOOK, device.address, lambda: self.look_ahead(device))

    def look_ahead(self, device: Device) -> None:
        """Look at *device*, and again when what an event may have changed begins or ends without another one."""
        self.look(device)
        for time in turns(device):
            if time > self.stage.now:
                self.look_at(time, device)

    def look(self, device: Device) -> None:
        now, since = self.stage.now, self.since[device.address]
        found = set(all_of(device, now))
        if device.links:
            found.update(absences(self.stage, device, now))
        if found == since.keys():
            return
        for doing in since.keys() - found:
            self.end(device.address, doing, now)
        for doing in found:
            since.setdefault(doing, now)

    def end(self, address: int, doing: Doing, now: int) -> None:
        self.rows.append(Row(self.since[address].pop(doing), address, now, *doing))

    def close(self, now: int) -> list[Row]:
        """Return all rows: the scene is over."""
        for address, since in enumerate(self.since):
            for doing in list(since):
                self.end(address, doing, now)
        return sorted(row for row in self.rows if row.end > row.start)


def turns(device: Device) -> Iterator[int]:
    """Return instants at which something begins or ends without an event."""
    scanner, paged = device.inquiry_scan, device.page_scan
    yield device.absent_until
    if scanner is not None:
        yield scanner.begin
        if scanner.limit is not None:
            yield scanner.limit
    if paged is not None:
        yield from (paged.begin, paged.limit)


def all_of(device: Device, now: int) -> Iterator[Doing]:
    """Return all that *device* does now."""
    if device.inquiry_scan is not None:
        yield from inquiry_scan(device.inquiry_scan, now)
    if device.page_scan is not None:
        yield from page_scan(device.page_scan, now)
    if isinstance(device.procedure, Inquiry):
        yield from inquiry(device.procedure, now)
    if isinstance(device.procedure, Page):
        yield from page(device.procedure, now)
    for link in device.links:
        if link.side(device.address).alive and link.master == device.address:
            yield "master", f"slave={link.slave} lt_addr={link.lt_addr}"
        elif link.side(device.address).alive:
            yield "slave", f"master={link.master} lt_addr={link.lt_addr}"


def absences(stage: Stage, device: Device, now: int) -> Iterator[Doing]:
    """Return of which piconets *device* is a member without being there, or being there in parts of the time only."""
    links = device.alive()
    latest = max(links, key=lambda link: link.side(device.address).up, default=None)
    for master in {link.master for link in links}:
        whole = device.share is None and latest is not None and latest.master == master
        part = next((part for part in device.share.parts if part[0] == master), None) if device.share else None
        if device.procedure is not None or now < device.absent_until or not (whole or part):
            yield "away", f"master={master}"
        elif device.share is not None and part is not None:
            body = stage.devices[device.share.reference].body
            slots = f"interval_slots={device.share.period} offset_slots={part[1]} attempt_slots={part[2]}"
            yield "part_time", f"master={master} {slots} phase_ns={body.phase} ppm={body.ppm}"


def inquiry_scan(scanner: Scanner, now: int) -> Iterator[Doing]:
    sends = scanner.reply is not None and scanner.reply <= now
    if scanner.is_off(now) and not sends:
        return
    if scanner.reply is not None:
        yield "inquiry_response", ""
    elif now < scanner.begin:
        yield "inquiry_backoff", ""
    elif scanner.limit is not None and now < scanner.limit:
        yield "inquiry_response", ""
    else:
        yield from window("inquiry_scan", scanner.windows, now)


def page_scan(paged: Paged, now: int) -> Iterator[Doing]:
    off = paged.off is not None and now >= paged.off
    if off or paged.state == CONNECTED:
        return
    if paged.state != SCAN and now < paged.limit:
        yield "page_response", f"peer={paged.partner} role=slave"
    elif now >= (paged.begin if paged.state == SCAN else paged.limit):
        yield from window("page_scan", paged.windows, now)


def window(state: str, windows: Windows, now: int) -> Iterator[Doing]:
    """Return that a scanner listens, if *now* is in a window."""
    into = (windows.clock.tick(now) - windows.offset) % windows.interval
    if into < WINDOW:
        yield state, "window=1" if windows.interlaced else ""
    elif into < 2 * WINDOW and windows.interlaced:
        yield state, "window=2"


def inquiry(procedure: Inquiry, now: int) -> Iterator[Doing]:
    device, scene = procedure.device, procedure.stage.scene
    tick = device.clock.tick(now)
    if procedure.first <= tick < procedure.last and not procedure.ended:
        turn = (tick - procedure.first) // (32 * scene.n_inquiry)
        yield "inquiry", train("AB" if scene.first_train == "A" else "BA", turn, device, GIAC, 0)


def page(procedure: Page, now: int) -> Iterator[Doing]:
    device, peer = procedure.device, f"peer={procedure.peer.address}"
    tick = device.clock.tick(now)
    if procedure.ended or tick < procedure.first:
        return
    if not procedure.paging:
        yield "page_response", f"{peer} role=master"
    elif tick < procedure.give_up:
        turn = (tick - procedure.first) // (32 * procedure.stage.scene.repetitions)
        yield "page", f"{peer} {train('AB', turn, device, procedure.peer.body.word, procedure.offset)}"


def train(letters: str, turn: int, device: Device, word: int, estimate: int) -> str:
    phase, ppm = device.body.phase, device.body.ppm
    return f"train={letters[turn % 2]} word={word:#x} phase_ns={phase} ppm={ppm} estimate={estimate}"
