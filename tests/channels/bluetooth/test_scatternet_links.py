"""Devices with several links: where they are when, to the slot, and what of one link never touches another.

Whether a device is in its part is worked out here from the clock of reference, frame by frame; that it takes part in
one frame at a time is looked for in the whole table of frames.
"""

from collections import defaultdict

import numpy as np
import pytest

from cosim.machine import (
    BROADCAST,
    Address,
    Connected,
    Disconnect,
    Lost,
    Outcome,
    Outgoing,
    Page,
    PageFailed,
    Role,
    Scan,
    Share,
)
from cosim.units import MS, SLOT, TICK, S, Time
from tests.channels.bluetooth.bluetooth_net import (
    LONGEST,
    MASTER_SLAVE,
    PERIOD,
    SLAVE_SLAVE,
    SUPERVISION,
    TOPOLOGIES,
    Net,
    check_one_at_a_time,
    check_parts,
)
from tests.channels.bluetooth.radio_scene import equal_powers_dbm


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("topology", TOPOLOGIES)
def test_bridges_keep_their_parts_and_take_part_in_one_frame_at_a_time(topology: str, seed: int):
    size, links = TOPOLOGIES[topology]
    net = Net(size, links, seed=seed) if seed == 1 else Net(size, links, clock_ppm=250)
    shared = {device for device in range(size) if len(net.piconets(device)) > 1}
    assert shared
    draw = np.random.default_rng(seed)
    begin = net.kernel.now
    asked: dict[Address, int] = defaultdict(int)
    for number in range(200):
        master, slave = links[draw.integers(len(links))]
        source, destination = (master, slave) if draw.integers(2) else (slave, master)
        if draw.integers(8) == 0:
            source, destination = master, BROADCAST
        asked[source] += 1
        payload = Outgoing(destination, bytes(int(draw.choice([5, 27, 150, 339]))), number)
        net.at(begin + int(draw.integers(5 * S)), lambda s=source, p=payload: net.channel.send(s, p))  # type: ignore[misc]
    frames = net.run_for(12 * S)
    assert net.up() == set(links)
    assert {device: len(net.outcomes(device)) for device in asked} == asked
    for device in asked:
        assert {outcome for _, outcome in net.outcomes(device)} <= {Outcome.DELIVERED, Outcome.SENT}
    check_one_at_a_time(frames)
    assert check_parts(net, frames, shared) > 1_000
    for master, slave in links:  # every link has been polled as often as the parts allow it
        polls = [f for f in frames if (f["source"], f["destination"], f["kind"]) == (master, slave, "POLL")]
        assert len(polls) > 12 * S // (2 * PERIOD * SLOT)


@pytest.mark.slow
@pytest.mark.parametrize("ppm", [0, 250])
def test_parts_are_kept_over_minutes_of_drifting_clocks(ppm: int):
    """In 3 minutes clocks of 250 ppm come 90 ms apart, more than a period of 40 ms."""
    net = Net(5, SLAVE_SLAVE, clock_ppm=ppm, t_poll_slots=100)
    clocks = [device.identity.clock.ppm for device in net.channel.devices]
    assert ppm == 0 or abs(clocks[0] - clocks[3]) * 180 > 2_000
    frames = net.run_for(180 * S)
    assert net.up() == set(SLAVE_SLAVE)
    check_one_at_a_time(frames)
    assert check_parts(net, frames, {2}) == 4 * 180 * S // (
        80 * MS
    )  # POLL and NULL in every second part, due after 62.5 ms
    assert {frame["outcome"] for frame in frames} == {"received"}


def within_part(net: Net, first: int) -> Time:
    """Return the next instant at which the period of all shares has lasted for *first* ticks."""
    clock = net.channel.devices[0].identity.clock
    tick = clock.tick(net.kernel.now + 2 * PERIOD * TICK)
    return clock.time_of(tick - tick % (2 * PERIOD) + first)


def test_a_master_sends_to_a_bridge_from_the_first_slot_of_its_part_to_the_last_that_leaves_room():
    """One slot down and up to five up: that takes 12 ticks and is begun until 12 ticks before the end."""
    net = Net(5, SLAVE_SLAVE)
    latest = PERIOD - 2 * (1 + LONGEST)
    begun = set()
    for offset in range(0, 2 * PERIOD, 3):
        at = within_part(net, offset)
        net.at(at, lambda: net.channel.send(0, Outgoing(2, b"x")))
        net.kernel.run(at)
        (frame,) = [f for f in net.run_for(60 * MS) if f["kind"] == "DM1" and f["destination"] == 2]
        position = net.position(frame["time_ns"])
        begun.add(position)
        if offset <= latest - 8:
            assert offset <= position <= offset + 8  # the next TX slot, or the one behind a poll
        elif offset > latest:
            assert position <= 4
    assert (min(begun), max(begun)) == (0, latest)


def test_broadcasts_reach_all_that_are_present_and_no_others():
    net = Net(5, SLAVE_SLAVE)
    for offset, received in ((4, {1, 2}), (PERIOD + 4, {1})):
        for host in net.hosts:
            host.received.clear()
        at = within_part(net, offset)
        net.at(at, lambda: net.channel.send(0, Outgoing(BROADCAST, b"all", 1)))
        net.kernel.run(at)
        rows = [frame for frame in net.run_for(30 * MS) if frame["length"] == 3]
        assert {row["destination"]: row["outcome"] for row in rows} == {
            slave: "received" if slave in received else "not_tuned" for slave in (1, 2)
        }
        assert {host.address for host in net.hosts if host.received} == received
    assert net.outcomes(0) == [(1, Outcome.SENT), (1, Outcome.SENT)]


def test_what_waits_for_an_absent_slave_blocks_nobody_else_and_is_never_overtaken():
    net = Net(5, SLAVE_SLAVE)
    at = within_part(net, PERIOD + 4)  # device 2 has just left for the other piconet

    def act() -> None:
        for token, destination in enumerate((2, 1, 2, 1, BROADCAST, 1)):
            net.channel.send(0, Outgoing(destination, bytes([token]), token))

    net.at(at, act)
    net.run_for(at - net.kernel.now + 60 * MS)
    order = [token for token, _ in net.outcomes(0)]
    assert order[:2] == [1, 3]  # sent while device 2 was away
    assert order[2:] == [0, 2, 4, 5]  # a broadcast waits for all before it, and all behind it for the broadcast
    arrivals = {address: [data[0] for _, _, data, _ in net.hosts[address].received] for address in (1, 2)}
    assert arrivals == {1: [1, 3, 4, 5], 2: [0, 2, 4]}
    when = [time for time, _, data, _ in net.hosts[1].received if data[0] in (1, 3)]
    assert max(when) < at + 20 * MS


def test_a_piconet_without_a_part_is_not_polled_and_ends_by_supervision_and_the_other_lives():
    net = Net(5, SLAVE_SLAVE)
    net.command(2, Share(PERIOD, ((0, 0, 30),), 0))
    shared_at = net.kernel.now
    frames = net.run_for(SUPERVISION + 100 * MS)
    assert [f for f in frames if {f["source"], f["destination"]} == {2, 3} and f["time_ns"] > shared_at + 4 * MS] == []
    assert net.peers_lost(2) == [3]
    assert net.peers_lost(3) == [2]
    assert net.up() == set(SLAVE_SLAVE) - {(3, 2)}
    net.channel.send(0, Outgoing(2, b"x", 9))
    net.run_for(100 * MS)
    assert net.outcomes(0) == [(9, Outcome.DELIVERED)]


def test_a_device_that_stops_dividing_its_time_is_in_the_piconet_of_its_latest_link_only():
    net = Net(5, SLAVE_SLAVE)
    net.command(2, Share(PERIOD, (), 0))
    frames = net.run_for(SUPERVISION + 100 * MS)
    assert {f["outcome"] for f in frames if (f["source"], f["destination"]) == (0, 2)} == {"not_tuned"}
    assert net.peers_lost(2) == [0]
    assert net.peers_lost(0) == [2]
    assert net.up() == set(SLAVE_SLAVE) - {(0, 2)}


def test_presence_that_changes_while_one_piconet_is_alone_is_noticed():
    """The other master dies; its slave, which is still there for it, stops dividing its time: 0 must not hear it."""
    net = Net(3, [(0, 1), (2, 1)], idle_frames=False, interference="co_channel")
    net.run_for(500 * MS)
    net.channel.power(2, False)
    net.run_for(500 * MS)
    net.command(1, Share(PERIOD, (), 0))
    net.run_for(10 * MS)
    before = net.channel.summary()
    net.run_for(500 * MS)
    after = net.channel.summary()
    assert after["frames_poll"] >= before["frames_poll"] + 19
    assert after["frames_null"] == before["frames_null"]
    net.run_for(2 * SUPERVISION)  # it has lost the other link meanwhile, and is back
    assert net.up() == {(0, 1)}
    assert net.channel.summary()["frames_null"] > after["frames_null"] + 50


def test_a_master_that_is_away_as_a_slave_silences_its_piconet():
    net = Net(5, MASTER_SLAVE)
    at = within_part(net, 4)  # device 2 is with 0 now
    net.at(at, lambda: net.channel.send(2, Outgoing(3, b"down", 1)))
    net.at(at, lambda: net.channel.send(2, Outgoing(BROADCAST, b"all", 2)))
    net.at(at, lambda: net.channel.send(4, Outgoing(2, b"up", 3)))
    net.kernel.run(at)
    frames = [frame for frame in net.run_for(2 * S) if frame["source"] == 2 and frame["destination"] in (3, 4)]
    assert all(net.position(frame["time_ns"]) >= PERIOD for frame in frames)
    assert len(frames) > 50
    assert net.outcomes(2) == [(1, Outcome.DELIVERED), (2, Outcome.SENT)]
    assert net.outcomes(4) == [(3, Outcome.DELIVERED)]


@pytest.mark.parametrize("side", [0, 1])
def test_closing_one_link_of_a_bridge_leaves_the_other_alone(side: int):
    net = Net(5, SLAVE_SLAVE)
    closer, peer = ((2, 3), (3, 2))[side]
    net.at(net.kernel.now + 1, lambda: net.channel.send(2, Outgoing(0, b"stays", 1)))
    net.at(net.kernel.now + 1, lambda: net.channel.send(2, Outgoing(3, bytes(300), 2)))
    net.at(net.kernel.now + 2, lambda: net.command(closer, Disconnect(peer)))
    net.run_for(SUPERVISION + 500 * MS)
    assert net.up() == set(SLAVE_SLAVE) - {(3, 2)}
    assert net.peers_lost(2) == [3]
    assert net.peers_lost(3) == [2]
    assert sorted(net.outcomes(2)) == [(1, Outcome.DELIVERED), (2, Outcome.FLUSHED)]
    assert net.peers_lost(0) == net.peers_lost(1) == net.peers_lost(4) == []


@pytest.mark.parametrize("ways", [[(3, 2)], [(2, 3)], [(2, 3), (3, 2)]])
def test_a_link_of_a_bridge_that_times_out_leaves_the_other_alone(ways: list[tuple[Address, Address]]):
    net = Net(5, SLAVE_SLAVE)
    net.channel.air.set_powers(equal_powers_dbm(5, ways), net.kernel.now)
    net.run_for(3 * SUPERVISION)
    assert net.up() == set(SLAVE_SLAVE) - {(3, 2)}
    assert net.peers_lost(2) == [3]
    assert net.peers_lost(3) == [2]
    assert net.peers_lost(0) == net.peers_lost(1) == net.peers_lost(4) == []


def test_a_bridge_that_is_switched_off_is_lost_to_both_masters_and_to_nobody_else():
    net = Net(5, SLAVE_SLAVE)
    at = net.kernel.now
    net.channel.power(2, False)
    net.channel.send(0, Outgoing(2, b"x", 1))
    net.channel.send(3, Outgoing(2, b"x", 1))
    frames = net.run_for(SUPERVISION + 500 * MS)
    for master in (0, 3):
        assert net.peers_lost(master) == [2]
        assert at < net.hosts[master].when(Lost)[0] <= at + SUPERVISION
        assert net.outcomes(master) == [(1, Outcome.FLUSHED)]
    assert net.peers_lost(1) == net.peers_lost(4) == []
    assert [frame for frame in frames if frame["source"] == 2 and frame["time_ns"] > at + 10 * SLOT] == []
    assert net.hosts[2].got(Lost) == []
    net.channel.power(2, True)
    net.command(3, Page(2))
    net.run_for(1 * S)
    assert (3, 2) in net.up()


def test_a_slave_pages_and_is_the_master_of_another_and_stays_a_slave_if_it_divides_its_time():
    net = Net(3, [(0, 1)])
    net.command(1, Page(2))
    net.run_for(100 * MS)
    net.masters.add(1)
    assert [event.role for event in net.hosts[1].got(Connected) if isinstance(event, Connected)] == [
        Role.SLAVE,
        Role.MASTER,
    ]
    net.divide(1)
    net.channel.send(0, Outgoing(1, b"down", 1))
    net.channel.send(2, Outgoing(1, b"up", 2))
    frames = net.run_for(2 * SUPERVISION)
    assert net.up() == {(0, 1), (1, 2)}
    assert net.outcomes(0) == [(1, Outcome.DELIVERED)]
    assert net.outcomes(2) == [(2, Outcome.DELIVERED)]
    check_one_at_a_time(frames)
    assert check_parts(net, frames, {1}) > 100


def test_a_slave_that_pages_is_away_meanwhile_and_comes_back():
    net = Net(3, [(0, 1)])
    net.channel.power(2, False)
    begin = net.kernel.now
    net.command(1, Page(2))
    net.channel.send(0, Outgoing(1, b"later", 1))
    frames = net.run_for(1 * S)
    away = [f for f in frames if f["source"] == 0 and f["time_ns"] > begin + 10 * MS]
    assert {frame["outcome"] for frame in away} == {"not_tuned"}
    assert net.outcomes(0) == []
    net = Net(3, [(0, 1)], page={"mode": "R0", "timeout_slots": 800})
    net.channel.power(2, False)
    net.command(1, Page(2))
    net.channel.send(0, Outgoing(1, b"later", 1))
    net.run_for(1 * S)
    assert net.hosts[1].got(PageFailed) == [PageFailed(2)]
    assert net.outcomes(0) == [(1, Outcome.DELIVERED)]
    assert net.up() == {(0, 1)}


@pytest.mark.parametrize("length", [17, 339])
def test_a_slave_begins_to_page_when_the_slot_pair_under_way_is_over(length: int):
    net = Net(3, [(0, 1)])
    at = net.kernel.now + 100 * MS
    net.at(at, lambda: net.channel.send(0, Outgoing(1, bytes(length))))
    net.kernel.run(at)
    (frame,) = [f for f in net.run_for(20 * MS) if f["length"] == length]
    for after in (1, frame["duration_ns"] - 1, frame["duration_ns"], frame["duration_ns"] + 1):
        net = Net(3, [(0, 1)])
        net.at(at, lambda n=net: n.channel.send(0, Outgoing(1, bytes(length))))  # type: ignore[misc]
        net.at(frame["time_ns"] + after, lambda n=net: n.command(1, Page(2)))  # type: ignore[misc]
        net.kernel.run(at)
        frames = net.run_for(8 * MS)
        (answer,) = [f for f in frames if (f["source"], f["destination"]) == (1, 0)]
        assert answer["outcome"] == "received"
        trains = net.channel.air.medium.trains
        (first_id,) = trains["since"][trains["sender"] == 1]
        assert answer["time_ns"] + answer["duration_ns"] <= first_id <= answer["time_ns"] + 4 * SLOT


def test_a_slave_is_paged_by_another_only_if_it_insists_on_scanning():
    net = Net(3, [(0, 1)], page={"mode": "R0", "timeout_slots": 800})
    net.command(2, Page(1))
    net.run_for(1 * S)
    assert net.hosts[2].got(PageFailed) == [PageFailed(1)]
    net.command(1, Scan(True))
    polled = [frame for frame in net.run_for(200 * MS) if (frame["source"], frame["destination"]) == (0, 1)]
    assert {frame["outcome"] for frame in polled} == {"received"}  # scanning silences nothing
    net.command(2, Page(1))
    net.run_for(100 * MS)
    assert net.up() == {(0, 1), (2, 1)}
    assert not net.channel.devices[1].page_scanner.enabled  # a new link ends what it had asked for


def test_a_bridge_sends_to_each_of_its_masters_and_to_its_own_slaves():
    net = Net(5, MASTER_SLAVE)
    for token, destination in enumerate((0, 3, 4, 1, BROADCAST)):
        net.channel.send(2, Outgoing(destination, bytes([token]), token))
    net.run_for(500 * MS)
    assert sorted(net.outcomes(2)) == [
        (0, Outcome.DELIVERED),
        (1, Outcome.DELIVERED),
        (2, Outcome.DELIVERED),
        (3, Outcome.NO_LINK),  # a slave like itself
        (4, Outcome.SENT),
    ]
    assert [(source, wide) for _, source, _, wide in net.hosts[0].received] == [(2, False)]
    assert [(data[0], wide) for _, _, data, wide in net.hosts[3].received] == [(1, False), (4, True)]


def test_the_lt_addr_of_a_bridge_is_that_of_each_piconet():
    net = Net(5, SLAVE_SLAVE)
    frames = net.run_for(200 * MS)
    numbers = {(f["source"], f["lt_addr"]) for f in frames if f["destination"] == 2}
    assert numbers == {(0, 2), (3, 2)}
    assert {(f["destination"], f["lt_addr"]) for f in frames if f["source"] == 2} == {(0, 2), (3, 2)}


def test_a_full_master_may_still_be_a_slave():
    net = Net(9, [(0, slave) for slave in range(1, 8)])
    net.command(0, Page(8))
    net.run_for(10 * MS)
    assert net.hosts[0].got(PageFailed) == [PageFailed(8)]
    net.command(0, Scan(True))
    net.command(8, Page(0))
    net.run_for(200 * MS)
    net.masters.add(8)
    net.divide(0)
    frames = net.run_for(SUPERVISION)
    assert len(net.up()) == 8
    check_one_at_a_time(frames)
