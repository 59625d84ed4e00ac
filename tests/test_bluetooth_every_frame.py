"""Every frame of a run follows from the clocks, the address words and the LT_ADDR that were given."""

from itertools import pairwise

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
from cosim.channels.bluetooth.packets import PACKETS
from cosim.kernel import WORLD
from cosim.machine import BROADCAST, Connected, InquiryComplete, Outgoing
from cosim.units import MS, SLOT, US, S
from tests.bluetooth_world import World


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


@pytest.mark.parametrize("seed", [1, 2])
def test_every_frame_follows_from_clocks_address_words_and_lt_addr_alone(seed: int) -> None:
    world = _talking_run(seed)
    identities = [device.identity for device in world.channel.devices]
    master = identities[0]
    lt_addr = {3: 1, 1: 2, 2: 3}  # in the order of the pages
    replies: dict[object, int] = {}
    frozen = 0
    paged = None
    ids_since_page = 0
    kinds: set[object] = set()
    linked_at = dict(zip(lt_addr, world.hosts[0].when(Connected), strict=True))
    connected_at = {slave: world.hosts[slave].when(Connected)[0] for slave in lt_addr}
    for frame in world.frames():
        start, source, kind, channel = frame["time_ns"], frame["source"], frame["kind"], frame["channel"]
        destination = frame["destination"]
        assert isinstance(start, int)
        assert isinstance(source, int)
        assert isinstance(destination, int)
        assert isinstance(kind, str)
        assert isinstance(frame["length"], int)
        assert frame["duration_ns"] == PACKETS[kind].air_time(frame["length"])
        kinds.add(kind)
        slave = destination if source == 0 else source
        tick = master.clock.tick(start)
        if kind not in ("ID", "FHS"):
            if kind == "NULL" and start < linked_at[slave]:  # 625 us after its POLL, whatever the master's drift
                tick = master.clock.tick(start + US)
                assert start == master.clock.time_of(tick - 2) + SLOT
            else:
                assert start == master.clock.time_of(tick)
            assert tick % 4 == (0 if source == 0 else 2)
            assert channel == basic_channel(master.hop_address, tick % 2**28)
            broadcast = source == 0 and kind not in ("POLL", "NULL") and frame["lt_addr"] == 0
            assert frame["lt_addr"] == (0 if broadcast else lt_addr[slave])
            assert kind != "POLL" or start > connected_at[slave] - 40 * SLOT
        elif start < world.hosts[0].when(InquiryComplete)[0] - 1:
            clkn = identities[slave].clock.tick(start)
            if kind == "ID":
                assert start == master.clock.time_of(tick)
                assert channel == inquiry_scan_channel(clkn, replies.get(slave, 0))
                assert channel in (inquiry_channel(tick, "A"), inquiry_channel(tick, "B"))
            else:
                assert channel == inquiry_response_channel(clkn, replies.get(slave, 0))
                replies[slave] = replies.get(slave, 0) + 1
        else:
            word, clock = identities[slave].hop_address, identities[slave].clock
            if kind == "ID" and source == 0:
                paged, frozen, ids_since_page = slave, clock.tick(start), 0
                base = tick & ~3
                assert channel == page_scan_channel(word, frozen)
            else:
                assert slave == paged
                after = {"ID": 2, "FHS": 4}[kind] + (4 if ids_since_page and kind == "ID" else 0)
                assert channel == slave_response_channel(word, frozen, (frozen & ~3) + after)
                if kind == "FHS":
                    assert start == master.clock.time_of(base + 4)
                ids_since_page += 1
    assert kinds >= {"ID", "FHS", "POLL", "NULL", "DM1", "DM3", "DH3", "DM5", "DH5"}
    outcomes = {frame["outcome"] for frame in world.frames()}
    assert outcomes >= {"received", "out_of_range"}


def test_no_two_frames_of_a_piconet_overlap() -> None:
    frames = [f for f in _talking_run(3).frames() if f["kind"] not in ("ID", "FHS")]
    seen = sorted({(f["time_ns"], f["duration_ns"], f["source"]) for f in frames})
    for (start, duration, _), (following, _, _) in pairwise(seen):
        assert start + duration <= following  # type: ignore[operator]


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
