"""A Bluetooth world whose devices leave range, or are switched off, and what must hold whatever comes of it."""

from collections import Counter
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import pytest

from cosim.kernel import DELIVER, WORLD
from cosim.machine import (
    Address,
    Connected,
    Fate,
    Lost,
    Outcome,
    Outgoing,
    Page,
)
from cosim.units import MS, SLOT, TICK, S, Time
from tests.channels.bluetooth.bluetooth_world import World
from tests.channels.bluetooth.radio_scene import equal_powers_dbm

CONTINUOUS = 0.01125
SUPERVISION = 300 * MS
PAGE_TIMEOUT = 160 * SLOT
EXCHANGE = (4 + 4 * 4 + 16 * 4 + 4) * TICK
"""The longest exchange that a page may be in the midst of when its time is over."""
QUICK: dict[str, Any] = {
    "supervision_s": SUPERVISION / S,
    "t_poll_slots": 16,
    "page": {"mode": "R0", "timeout_slots": PAGE_TIMEOUT // SLOT},
    "page_scan": {"interval_s": CONTINUOUS},
    "inquiry": {"n_inquiry": 1},
    "inquiry_scan": {"interval_s": CONTINUOUS},
}
OUTCOMES = {"received", "out_of_range", "not_tuned", "busy", "collided", "bit_errors"}


class Arena(World):
    """A world in which the air between two devices can fall silent one way, and which knows who is off since when."""

    def __init__(self, size: int = 2, **settings: Any) -> None:
        super().__init__(size, **(QUICK | settings))
        self.silent: set[tuple[Address, Address]] = set()
        self.off: dict[Address, Time] = {}
        self.sent: Counter[tuple[Address, int]] = Counter()

    def silence(self, ways: Iterable[tuple[Address, Address]], silent: bool = True) -> None:
        """Let nothing go any of the *ways* (transmitter, receiver) from now on, or let it go again."""
        self.silent = self.silent | set(ways) if silent else self.silent - set(ways)
        powers = equal_powers_dbm(len(self.hosts), self.silent)
        for device in self.off:
            powers[device, :] = powers[:, device] = -np.inf
        self.channel.air.set_powers(powers, self.kernel.now)

    def switch(self, device: Address, on: bool) -> None:
        self.channel.power(device, on)
        if on:
            del self.off[device]
        else:
            self.off[device] = self.kernel.now

    def say(self, source: Address, destination: Address, length: int) -> None:
        """Have *source* send a payload that names itself, and asks for its fate."""
        token = sum(self.sent.values())
        self.sent[source, token] += 1
        self.channel.send(source, Outgoing(destination, token.to_bytes(2, "big") + bytes(length - 2), token))

    def link_news(self, device: Address) -> list[tuple[Address, bool]]:
        events = [event for _, event in self.hosts[device].events]
        return [(e.peer, isinstance(e, Connected)) for e in events if isinstance(e, Connected | Lost)]

    def links(self, device: Address) -> set[Address]:
        """Return the links of a device as its host has been told of them."""
        return {peer for peer, up in dict(self.link_news(device)).items() if up}


Fault = Callable[[Arena, bool], None]


def silence(*ways: tuple[Address, Address]) -> Fault:
    return lambda world, begins: world.silence(ways, begins)


def switch(device: Address) -> Fault:
    return lambda world, begins: world.switch(device, not begins)


FAULTS: dict[str, Fault] = {
    "down": silence((0, 1)),
    "up": silence((1, 0)),
    "both": silence((0, 1), (1, 0)),
    "master_off": switch(0),
    "slave_off": switch(1),
}


def instants(world: Arena, begin: Time, end: Time, step: Time = TICK) -> list[Time]:
    """Return every half slot of [begin, end) and a nanosecond about the boundaries of the frames in it."""
    edges = {time for frame in world.frames() for time in (frame["time_ns"], frame["time_ns"] + frame["duration_ns"])}
    near = {edge + after for edge in edges for after in (-1, 0, 1)}
    return sorted(time for time in near | set(range(begin, end, step)) if begin <= time < end)


def strike(world: Arena, fault: Fault, at: Time, until: Time | None, number: int) -> None:
    """Let a fault begin, and perhaps end; in turn before and after what else happens at that instant."""
    world.at(at, lambda: fault(world, True), WORLD if number % 2 else DELIVER)
    if until is not None:
        world.at(until, lambda: fault(world, False), WORLD)


def check(world: Arena, killed: Address | None) -> None:
    """Check what must hold after any course of events, when all is quiet; *killed* was switched off meanwhile."""
    for host in world.hosts:
        news = world.link_news(host.address)
        for peer in {peer for peer, _ in news}:
            ups = [up for other, up in news if other == peer]
            if host.address != killed:  # who is switched off is not told that its links are gone
                assert ups == [number % 2 == 0 for number in range(len(ups))], news
        fates = Counter(event.token for event in host.got(Fate) if isinstance(event, Fate))
        asked = {token for source, token in world.sent if source == host.address}
        assert fates.keys() <= asked
        assert max(fates.values(), default=1) == 1
        if host.address != killed:
            assert fates.keys() == asked, f"no fate of {asked - fates.keys()} at {host.address}"
        arrivals = Counter((source, data[:2]) for _, source, data, _ in host.received)
        assert max(arrivals.values(), default=1) == 1
    for frame in world.frames():
        assert frame["outcome"] in OUTCOMES
        # what a slot pair holds is fixed at its start: a slave may answer the longest packet
        grace = 0 if frame["kind"] in ("ID", "FHS") else 6 * SLOT
        if frame["source"] in world.off and frame["time_ns"] > world.off[frame["source"]] + grace:
            pytest.fail(f"a frame of a radio that is off: {frame}")


def check_at_rest(world: Arena) -> None:
    """Check that no link is left, and that all that are on can be found and paged."""
    now = world.kernel.now
    world.silence(set(world.silent), silent=False)
    for device in list(world.off):
        world.switch(device, on=True)
    for device in world.channel.devices:
        assert not device.master_of.members()
        assert not device.masters
        assert device.inquiry_scanner.enabled
        assert device.page_scanner.enabled
    before = len(world.hosts[0].got(Connected))
    world.command(0, Page(1))
    world.kernel.run(now + PAGE_TIMEOUT + EXCHANGE + SLOT)
    assert len(world.hosts[0].got(Connected)) == before + 1
    world.say(0, 1, 10)
    world.say(1, 0, 10)
    world.kernel.run(world.kernel.now + 30 * MS)
    assert world.hosts[0].got(Fate)[-1].outcome is Outcome.DELIVERED  # type: ignore[union-attr]
    assert world.hosts[1].got(Fate)[-1].outcome is Outcome.DELIVERED  # type: ignore[union-attr]


def paging() -> Arena:
    world = Arena()
    world.at(0, lambda: world.command(0, Page(1)))
    return world
