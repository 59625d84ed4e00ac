"""Every frame of a run follows from the clocks, the address words and the LT_ADDR that were given."""

from itertools import pairwise
from typing import Any, ClassVar

import numpy as np
import pytest

from cosim.channels.bluetooth.hopping import (
    basic_channel,
    inquiry_channel,
    inquiry_response_channel,
    inquiry_scan_channel,
    page_scan_channel,
    slave_response_channel,
)
from cosim.channels.bluetooth.packets import ACL, PACKETS
from cosim.kernel import WORLD
from cosim.machine import BROADCAST, Connected, InquiryComplete, Outgoing
from cosim.units import MS, SLOT, US, S
from tests.channels.bluetooth.bluetooth_world import World


def _talking_run(seed: int) -> World:
    """Three slaves, everyone sends to everyone now and then, one slave out of reach for a while."""
    world = World(4, seed=seed, range_m=20.0, idle_frames=True, n_bc=2, t_poll_slots=24)
    world.connect(3, 1, 2)
    start = world.kernel.now
    for number in range(60):
        at = start + number * 7_770_001
        size = (5, 60, 150, 200, 300)[number % 5]
        source, destination = ((0, BROADCAST), (0, 1), (2, 0), (3, 0), (0, 3))[number % 5]
        world.at(at, lambda s=source, d=destination, n=size: world.channel.send(s, Outgoing(d, bytes(n))))  # type: ignore[misc]
    here, there = np.zeros((4, 2)), np.array([[0.0, 0.0], [30.0, 0.0], [0.0, 0.0], [0.0, 0.0]])
    world.at(start + 100 * MS, lambda: world.channel.moved(there), WORLD)
    world.at(start + 200 * MS, lambda: world.channel.moved(here), WORLD)
    world.kernel.run(start + 1 * S)
    world.channel.advance(world.kernel.now)
    return world


class Auditor:
    """Recomputes frames from clocks, words and the order of the pages; what it keeps is read off frames before."""

    lt_addr: ClassVar = {3: 1, 1: 2, 2: 3}

    def __init__(self, world: World) -> None:
        self.identities = [device.identity for device in world.channel.devices]
        self.master = self.identities[0]
        self.inquiry_end = world.hosts[0].when(InquiryComplete)[0]
        self.up_at_master = dict(zip(self.lt_addr, world.hosts[0].when(Connected), strict=True))
        self.up_at_slave = {slave: world.hosts[slave].when(Connected)[0] for slave in self.lt_addr}
        self.replies = dict.fromkeys(self.lt_addr, 0)
        self.paged = self.heard = self.frozen = self.since_page = 0

    def audit(self, frame: dict[str, Any]) -> None:
        assert frame["duration_ns"] == PACKETS[frame["kind"]].air_time(frame["length"])
        slave = frame["destination"] if frame["source"] == 0 else frame["source"]
        if frame["kind"] not in ("ID", "FHS"):
            self.connection(frame, slave)
        elif frame["time_ns"] < self.inquiry_end - 1:
            self.inquiry(frame, slave)
        else:
            self.page(frame, slave)

    def connection(self, frame: dict[str, Any], slave: int) -> None:
        start, kind, to_slave = frame["time_ns"], frame["kind"], frame["source"] == 0
        clock = self.master.clock
        tick = clock.tick(start)
        if kind == "NULL" and start < self.up_at_master[slave]:  # 625 us after its POLL, whatever the master's drift
            tick = clock.tick(start + US)
            assert start == clock.time_of(tick - 2) + SLOT
        else:
            assert start == clock.time_of(tick)
        assert tick % 4 == (0 if to_slave else 2)
        assert frame["channel"] == basic_channel(self.master.hop_address, tick % 2**28)
        broadcast = to_slave and kind in ACL and frame["lt_addr"] == 0
        assert frame["lt_addr"] == (0 if broadcast else self.lt_addr[slave])
        assert start > self.up_at_slave[slave] - 40 * SLOT

    def inquiry(self, frame: dict[str, Any], slave: int) -> None:
        start, channel = frame["time_ns"], frame["channel"]
        clkn, tick = self.identities[slave].clock.tick(start), self.master.clock.tick(start)
        if frame["kind"] == "ID":
            assert start == self.master.clock.time_of(tick)
            assert channel == inquiry_scan_channel(clkn, self.replies[slave])
            assert channel in (inquiry_channel(tick, "A"), inquiry_channel(tick, "B"))
        else:
            assert channel == inquiry_response_channel(clkn, self.replies[slave])
            self.replies[slave] += 1

    def page(self, frame: dict[str, Any], slave: int) -> None:
        start, identity = frame["time_ns"], self.identities[slave]
        if frame["kind"] == "ID" and frame["source"] == 0:
            self.paged, self.frozen, self.since_page = slave, identity.clock.tick(start), 0
            self.heard = self.master.clock.tick(start)
            assert start == self.master.clock.time_of(self.heard)
            assert frame["channel"] == page_scan_channel(identity.hop_address, self.frozen)
            return
        assert slave == self.paged
        kind, after = (("ID", 2), ("FHS", 4), ("ID", 6))[self.since_page]
        assert frame["kind"] == kind
        clkn = (self.frozen & ~3) + after
        assert frame["channel"] == slave_response_channel(identity.hop_address, self.frozen, clkn)
        if kind == "FHS":
            assert start == self.master.clock.time_of((self.heard & ~3) + 4)
        self.since_page += 1


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_every_frame_follows_from_clocks_address_words_and_lt_addr_alone(seed: int) -> None:
    world = _talking_run(seed)
    auditor = Auditor(world)
    frames = world.frames()
    for frame in frames:
        auditor.audit(frame)
    assert {frame["kind"] for frame in frames} >= {"ID", "FHS", "POLL", "NULL", "DM1", "DM3", "DH3", "DM5", "DH5"}
    assert {frame["outcome"] for frame in frames} >= {"received", "out_of_range"}


def test_no_two_frames_of_a_piconet_overlap() -> None:
    frames = [f for f in _talking_run(3).frames() if f["kind"] not in ("ID", "FHS")]
    seen = sorted({(f["time_ns"], f["duration_ns"], f["source"]) for f in frames})
    for (start, duration, _), (following, _, _) in pairwise(seen):
        assert start + duration <= following


def test_a_run_depends_on_its_seed_only() -> None:
    assert _talking_run(4).trace.digest() == _talking_run(4).trace.digest()
    assert _talking_run(4).trace.digest() != _talking_run(5).trace.digest()


def test_a_frame_of_one_slot_is_delivered_within_the_slot() -> None:
    world = World(2)
    world.connect(1)
    now = world.kernel.now + 3 * MS
    world.at(now, lambda: world.channel.send(0, Outgoing(1, b"x")))
    world.kernel.run(now + 10 * MS)
    (arrival,) = (time for time, *_ in world.hosts[1].received)
    start = arrival - PACKETS["DM1"].air_time(1)
    clock = world.channel.devices[0].identity.clock
    assert clock.time_of(clock.tick(start)) == start
    assert now <= start < now + 4 * SLOT + 126 * US
