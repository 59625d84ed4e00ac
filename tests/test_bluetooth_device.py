"""The Bluetooth channel from a host's side: finding, connecting, talking, losing; and every frame recomputed."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from pydantic import ValidationError

from cosim.channels.bluetooth.device import BluetoothChannel, BluetoothSettings
from cosim.channels.bluetooth.hopping import (
    basic_channel,
    inquiry_channel,
    inquiry_response_channel,
    inquiry_scan_channel,
    page_scan_channel,
    slave_response_channel,
)
from cosim.channels.bluetooth.packets import PACKETS
from cosim.kernel import WORLD, Kernel
from cosim.machine import (
    BROADCAST,
    Address,
    Connected,
    Disconnect,
    Discovered,
    Fate,
    Flush,
    Inquire,
    InquiryComplete,
    LinkCommand,
    LinkEvent,
    Lost,
    Outcome,
    Outgoing,
    Page,
    PageFailed,
    Reception,
    Role,
    Scan,
)
from cosim.randomness import Streams
from cosim.trace import CALLS, FRAMES, Trace
from cosim.units import MS, SLOT, US, S, Time


class Host:
    """An endpoint that writes down what it gets, and acts on link events as *react* has it."""

    def __init__(self, world: "World", address: Address) -> None:
        self.world = world
        self.address = address
        self.events: list[tuple[Time, LinkEvent]] = []
        self.received: list[tuple[Time, Address, bytes, bool]] = []
        self.react: Callable[[LinkEvent], None] = lambda event: None
        self.drained = 0

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        self.received.append((now, reception.source, data, reception.broadcast))

    def link(self, event: LinkEvent, now: Time) -> None:
        assert not self.world.commanding, "a link event came inside a command"
        self.events.append((now, event))
        self.react(event)

    def drain(self, now: Time) -> None:
        self.drained += 1

    def got(self, kind: type) -> list[LinkEvent]:
        return [event for _, event in self.events if isinstance(event, kind)]

    def when(self, kind: type) -> list[Time]:
        return [time for time, event in self.events if isinstance(event, kind)]


class World:
    """A Bluetooth channel for *size* devices with a host on each."""

    def __init__(self, size: int, seed: int = 1, **settings: object) -> None:
        self.kernel = Kernel()
        self.trace = Trace((FRAMES, CALLS))
        self.channel = BluetoothChannel(
            BluetoothSettings.model_validate(settings), self.kernel, self.trace, size, Streams(seed)
        )
        self.commanding = False
        self.hosts = [Host(self, address) for address in range(size)]
        for host in self.hosts:
            self.channel.attach(host.address, host)

    def command(self, address: Address, *commands: LinkCommand) -> None:
        self.commanding = True
        for command in commands:
            self.channel.command(address, command)
        self.commanding = False

    def at(self, time: Time, act: Callable[[], None], phase: int = 1) -> None:
        self.kernel.at(time, act, phase)

    def connect(self, *slaves: Address, master: Address = 0) -> None:
        """Inquire until all slaves are found, then page them in this order, and run until all are connected."""
        self.hosts[master].react = lambda event: (
            self.command(master, *(Page(slave) for slave in slaves)) if isinstance(event, InquiryComplete) else None
        )
        self.at(self.kernel.now, lambda: self.command(master, Inquire(11 * S, len(slaves))))
        while len(self.hosts[master].got(Connected)) < len(slaves):
            assert self.kernel.now < 60 * S
            self.kernel.run(self.kernel.now + 100 * MS)

    def frames(self) -> list[dict[str, object]]:
        columns = self.trace.columns("frames")
        return [dict(zip(columns, row, strict=True)) for row in sorted(zip(*columns.values(), strict=True))]


def test_a_device_is_found_connected_and_talked_to() -> None:
    world = World(2)
    world.connect(1)
    master, slave = world.hosts
    assert master.got(Discovered) == [Discovered(1)]
    assert master.got(InquiryComplete) == [InquiryComplete((1,))]
    identity = world.channel.devices[0].identity
    (up,), (down,) = master.got(Connected), slave.got(Connected)
    assert isinstance(up, Connected)
    assert isinstance(down, Connected)
    assert (up.peer, up.role, down.peer, down.role) == (1, Role.MASTER, 0, Role.SLAVE)
    assert up.hop_address == down.hop_address == identity.hop_address
    for host, event in ((master, up), (slave, down)):
        assert event.hop_clock == identity.clock.tick(host.when(Connected)[0]) % 2**28
    assert 0 < master.when(Connected)[0] - slave.when(Connected)[0] <= SLOT

    now = world.kernel.now
    world.at(now, lambda: world.channel.send(0, Outgoing(1, b"ping", 1)))
    world.at(now, lambda: world.channel.send(1, Outgoing(0, b"pong", 2)))
    world.at(now, lambda: world.channel.send(0, Outgoing(BROADCAST, b"all", 3)))
    world.kernel.run(now + 200 * MS)
    assert [(source, data, wide) for _, source, data, wide in slave.received] == [
        (0, b"ping", False),
        (0, b"all", True),
    ]
    assert [(source, data, wide) for _, source, data, wide in master.received] == [(1, b"pong", False)]
    assert master.got(Fate) == [Fate(1, Outcome.DELIVERED), Fate(3, Outcome.SENT)]
    assert slave.got(Fate) == [Fate(2, Outcome.DELIVERED)]


@pytest.mark.slow
def test_seven_slaves_fit_into_a_piconet_and_an_eighth_does_not() -> None:
    world = World(9)
    world.connect(*range(1, 8))
    world.command(0, Page(8))
    world.kernel.run(world.kernel.now + 1)
    assert world.hosts[0].got(PageFailed) == [PageFailed(8)]
    assert [event.peer for event in world.hosts[0].got(Connected) if isinstance(event, Connected)] == list(range(1, 8))
    now = world.kernel.now
    world.at(now, lambda: world.channel.send(0, Outgoing(BROADCAST, b"all")))
    drained = [host.drained for host in world.hosts]
    world.kernel.run(now + 100 * MS)
    assert [len(host.received) for host in world.hosts] == [0, 1, 1, 1, 1, 1, 1, 1, 0]
    assert [host.drained - before for host, before in zip(world.hosts, drained, strict=True)][1:8] == [1] * 7


def test_a_connected_slave_is_neither_found_nor_paged_and_may_not_page() -> None:
    world = World(3)
    world.connect(1)
    world.command(2, Inquire(11 * S, 2), Page(1))
    world.command(1, Page(2), Inquire(1 * S, 1))
    world.kernel.run(world.kernel.now + 20 * S)
    assert world.hosts[2].got(Discovered) == []  # the master is connected too
    assert world.hosts[2].got(PageFailed) == [PageFailed(1)]
    assert world.hosts[1].got(PageFailed) == [PageFailed(2)]
    assert world.hosts[1].got(InquiryComplete) == [InquiryComplete(())]


def test_scanning_can_be_switched_off_and_on() -> None:
    world = World(2)
    world.command(1, Scan(False))
    world.command(0, Inquire(11 * S, 1))
    world.at(15 * S, lambda: world.command(1, Scan(True)))
    world.at(15 * S, lambda: world.command(0, Inquire(11 * S, 1)))
    world.kernel.run(30 * S)
    assert world.hosts[0].got(InquiryComplete) == [InquiryComplete(()), InquiryComplete((1,))]
    assert world.hosts[0].when(Discovered)[0] > 15 * S


@pytest.mark.parametrize("peer", [0, 7, -1])
def test_a_page_to_nobody_fails_in_an_event(peer: Address) -> None:
    world = World(2)
    world.command(0, Page(peer))
    assert world.hosts[0].events == []
    world.kernel.run(1)
    assert world.hosts[0].events == [(0, PageFailed(peer))]


def test_a_page_out_of_reach_fails_after_the_page_timeout() -> None:
    world = World(2, range_m=10.0)
    world.channel.moved(np.array([[0.0, 0.0], [10.1, 0.0]]))
    assert world.channel.in_reach(0) == ()
    world.command(0, Page(1))
    world.kernel.run(10 * S)
    (failed,) = world.hosts[0].when(PageFailed)
    assert 5.12 * S <= failed <= 5.12 * S + 2 * SLOT + 1 * MS


def test_what_is_learned_in_an_inquiry_makes_the_page_quick() -> None:
    """R1 with an exact estimate of the clock takes 0.64 s in the mean and hardly ever more than one scan interval."""
    world = World(2, seed=5)
    world.connect(1)
    spent = world.hosts[0].when(Connected)[0] - world.hosts[0].when(InquiryComplete)[0]
    assert spent < 1.28 * S + 30 * MS
    assert world.channel.devices[0].paging_time == spent
    assert world.channel.devices[0].inquiry_time == world.hosts[0].when(InquiryComplete)[0]


def test_the_piconet_is_silent_while_its_master_pages_and_serves_due_links_in_between() -> None:
    world = World(3, idle_frames=True, t_poll_slots=16)
    world.connect(1, 2)
    world.kernel.run(world.kernel.now + 100 * MS)
    world.channel.advance(world.kernel.now)
    first, second = world.hosts[0].when(Connected)
    to_first = [frame["time_ns"] for frame in world.frames() if frame["lt_addr"] == 1 and frame["source"] == 0]
    between = [time for time in to_first if isinstance(time, int) and first < time < second]
    assert between == []  # nothing was due when the second page started, and then there was no slot
    after = [time for time in to_first if isinstance(time, int) and time > second]
    assert after[0] < second + 2 * SLOT  # overdue by now


def test_a_page_waits_until_links_that_are_due_are_served() -> None:
    world = World(3, idle_frames=True)
    world.connect(1)
    clock = world.channel.devices[0].identity.clock
    world.kernel.run(world.kernel.now + 1 * S)
    polls = [frame["time_ns"] for frame in world.frames() if frame["kind"] == "POLL"]
    due = polls[-1]
    assert isinstance(due, int)
    while due < world.kernel.now:
        due = clock.time_of(clock.tick(due) + 80)
    world.at(due, lambda: world.command(0, Page(2)))
    world.kernel.run(due + 8 * S)
    served = [f for f in world.frames() if f["time_ns"] == due and f["kind"] == "POLL" and f["lt_addr"] == 1]
    assert len(served) == 1
    page_began = world.hosts[0].when(Connected)[-1] - world.channel.devices[0].paging_time
    assert page_began != due


def test_a_link_is_lost_on_both_sides_when_robots_drive_apart_and_can_be_made_again() -> None:
    world = World(2, range_m=10.0, supervision_s=2.0)
    world.connect(1)
    apart = world.kernel.now
    world.at(apart, lambda: world.channel.moved(np.array([[0.0, 0.0], [0.0, 11.0]])), WORLD)
    world.kernel.run(apart + 3 * S)
    assert world.hosts[0].got(Lost) == [Lost(1)]
    assert world.hosts[1].got(Lost) == [Lost(0)]
    for host in world.hosts:
        assert apart + 2 * S - 30 * MS < host.when(Lost)[0] < apart + 2 * S
    world.channel.moved(np.array([[0.0, 0.0], [0.0, 9.0]]))
    world.command(0, Page(1))
    world.kernel.run(world.kernel.now + 8 * S)
    assert len(world.hosts[0].got(Connected)) == 2
    assert len(world.hosts[1].got(Connected)) == 2


def test_small_moves_change_nothing() -> None:
    world = World(2, range_m=10.0)
    world.channel.moved(np.array([[0.0, 0.0], [0.0, 10.0]]))
    assert world.channel.in_reach(0) == (1,)
    assert world.channel.hears(0, 1, 0)
    assert not world.channel.hears(0, 0, 0)


def test_a_radio_that_is_switched_off_hears_nothing_and_is_missed_by_its_master() -> None:
    world = World(3, supervision_s=2.0)
    world.connect(1, 2)
    off = world.kernel.now
    world.at(off, lambda: world.channel.power(1, False))
    world.at(off + 1, lambda: world.channel.send(0, Outgoing(BROADCAST, b"x")))
    world.at(off + 1, lambda: world.channel.send(1, Outgoing(0, b"x", 9)))
    world.kernel.run(off + 3 * S)
    assert world.channel.in_reach(1) == ()
    assert world.channel.in_reach(0) == (2,)
    assert world.hosts[1].received == []
    assert world.hosts[1].got(Lost) + world.hosts[1].got(Fate) == []
    assert len(world.hosts[2].received) == 1
    assert world.hosts[0].got(Lost) == [Lost(1)]
    world.channel.power(1, True)
    world.command(0, Page(1))
    world.kernel.run(world.kernel.now + 8 * S)
    assert world.hosts[0].got(Connected)[-1] == world.hosts[0].got(Connected)[2]


def test_a_master_that_is_switched_off_is_missed_by_its_slaves() -> None:
    world = World(3, supervision_s=2.0)
    world.connect(1, 2)
    off = world.kernel.now
    world.at(off, lambda: world.channel.power(0, False))
    world.kernel.run(off + 3 * S)
    assert [host.got(Lost) for host in world.hosts] == [[], [Lost(0)], [Lost(0)]]
    world.command(1, Page(2))
    world.kernel.run(off + 11 * S)
    assert len(world.hosts[1].got(Connected)) == 2


def test_a_procedure_ends_silently_when_the_radio_is_switched_off() -> None:
    world = World(2)
    world.command(0, Inquire(1 * S, 2), Page(1))
    world.at(500 * MS, lambda: world.channel.power(0, False))
    world.kernel.run(10 * S)
    assert world.hosts[0].got(InquiryComplete) + world.hosts[0].got(Connected) == []
    assert world.channel.devices[0].inquiry_time == 500 * MS


def test_disconnect_closes_both_sides_and_both_can_be_found_again() -> None:
    world = World(2)
    world.connect(1)
    world.hosts[0].react = lambda event: None
    world.command(1, Disconnect(0))
    world.kernel.run(world.kernel.now + 1)
    assert world.hosts[0].got(Lost) == [Lost(1)]
    assert world.hosts[1].got(Lost) == [Lost(0)]
    world.command(1, Inquire(11 * S, 1))
    world.kernel.run(world.kernel.now + 11 * S)
    assert world.hosts[1].got(InquiryComplete) == [InquiryComplete((0,))]


def test_flush_and_sending_without_a_link() -> None:
    world = World(2)
    world.channel.send(0, Outgoing(1, b"x", 1))
    world.channel.send(0, Outgoing(BROADCAST, b"x", 2))
    world.kernel.run(1)
    assert world.hosts[0].got(Fate) == [Fate(1, Outcome.NO_LINK), Fate(2, Outcome.NO_LINK)]
    world.connect(1)
    world.channel.send(1, Outgoing(0, b"x", 3))
    world.command(1, Flush(0))
    world.kernel.run(world.kernel.now + 1)
    assert world.hosts[1].got(Fate) == [Fate(3, Outcome.FLUSHED)]


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
                tick = master.clock.tick(start + 1)
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


def test_clocks_words_and_windows_are_random_and_windows_are_half_an_interval_apart() -> None:
    world = World(40)
    identities = [device.identity for device in world.channel.devices]
    assert len({identity.hop_address for identity in identities}) == 40
    assert all(0 <= identity.clock.phase < 2**28 * 312_500 for identity in identities)
    assert len({identity.clock.phase % 312_500 for identity in identities}) > 30
    assert {identity.clock.ppm for identity in identities} <= set(range(-20, 21))
    assert len({identity.clock.ppm for identity in identities}) > 15
    for device in world.channel.devices:
        inquiry, page = device.inquiry_scanner._windows, device.page_scanner._windows
        assert (page.offset - inquiry.offset) % 4096 == 2048


def test_more_devices_move_no_ones_clock() -> None:
    few, many = World(3).channel.devices, World(9).channel.devices
    assert [device.identity for device in few] == [device.identity for device in many[:3]]


def test_the_way_down_is_traced_as_nested_calls() -> None:
    world = World(2)
    world.connect(1)
    world.channel.send(0, Outgoing(1, b"four"))
    columns = world.trace.columns("calls")
    calls = list(zip(columns["depth"], columns["call"], columns["detail"], strict=True))
    assert [(depth, name) for depth, name, _ in calls] == [
        (5, "hci.inquiry"),
        (6, "lm.inquiry"),
        (7, "lc.inquiry"),
        (4, "l2cap.connection_request"),
        (5, "hci.create_connection"),
        (6, "lm.page"),
        (7, "lc.page"),
        (4, "l2cap.data_request"),
        (5, "hci.acl_data"),
        (6, "lc.transmit"),
    ]
    assert calls[-1][2] == "4 bytes to 1"
    assert set(columns["room"]) == {"bluetooth"}


def test_the_summary_counts_frames_and_set_up_time() -> None:
    world = World(2)
    world.connect(1)
    connected = world.hosts[0].when(Connected)[0]
    now = world.kernel.now
    world.at(now, lambda: world.channel.send(0, Outgoing(1, bytes(100))))
    world.kernel.run(connected + 10 * S)
    summary = world.channel.summary()
    assert summary["frames_dm3"] == summary["frames_sent"] == 1
    assert summary["idle_polls"] == summary["frames_poll"] == pytest.approx(10 * S / (40 * SLOT), abs=2)
    assert summary["inquiry_s"] + summary["paging_s"] == pytest.approx(connected / S)


@pytest.mark.parametrize(
    ("settings", "place"),
    [
        ({"t_poll_slots": 41}, "t_poll_slots"),
        ({"t_poll_slots": 14}, "t_poll_slots"),
        ({"packet_types": ["DM2"]}, "packet_types"),
        ({"packet_types": []}, "packet_types"),
        ({"range_m": 0}, "range_m"),
        ({"n_bc": 0}, "n_bc"),
        ({"page": {"mode": "R3"}}, "mode"),
        ({"nonsense": 1}, "nonsense"),
    ],
)
def test_settings_that_mean_nothing_are_refused(settings: dict[str, object], place: str) -> None:
    with pytest.raises(ValidationError) as error:
        BluetoothSettings.model_validate(settings)
    assert place in str(error.value)


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
