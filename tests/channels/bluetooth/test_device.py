"""The Bluetooth channel from a host's side: finding, connecting, talking, losing."""

import numpy as np
import pytest
from pydantic import ValidationError

from cosim.channels.bluetooth.settings import BluetoothSettings
from cosim.kernel import WORLD
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
    Lost,
    Outcome,
    Outgoing,
    Page,
    PageFailed,
    Role,
    Scan,
)
from cosim.units import MS, SLOT, US, S
from tests.channels.bluetooth.bluetooth_world import World


def test_a_device_is_found_connected_and_talked_to() -> None:
    world = World(2)
    world.connect(1)
    master, slave = world.hosts
    assert [event.peer for event in master.got(Discovered)] == [1]
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
    assert (slave.rssi_dbm, master.rssi_dbm) == ([None, None], [None])  # all in range are heard alike


@pytest.mark.parametrize("host_bps", [None, 115_200])
def test_hosts_learn_how_strongly_a_payload_was_received(host_bps: int | None) -> None:
    """Class 2 sends 4 dBm; in free space 40.2 dB are lost at 1 m, 20 dB more at ten times the distance."""
    world = World(3, propagation={"model": "free_space"}, power_class=2, host_bps=host_bps)
    world.channel.moved(np.array([(0.0, 0.0), (10.0, 0.0), (1.0, 0.0)]))
    world.connect(1, 2)
    for source, destination in ((0, 1), (1, 0), (0, 2), (0, BROADCAST)):
        world.channel.send(source, Outgoing(destination, b"hello"))
    world.kernel.run(world.kernel.now + S)
    near, far = pytest.approx(4.0 - 40.2), pytest.approx(4.0 - 60.2)
    assert [host.rssi_dbm for host in world.hosts] == [[far], [far, far], [near, near]]


@pytest.mark.parametrize(
    ("payload", "why"), [(Outgoing(BROADCAST, b"all"), Outcome.NO_LINK), (Outgoing(0, bytes(9999)), Outcome.TOO_LONG)]
)
def test_what_a_slave_says_to_all_is_counted_as_never_sent(payload: Outgoing, why: Outcome) -> None:
    world = World(3)
    world.connect(1, 2)
    world.channel.send(1, payload)
    world.channel.send(1, Outgoing(0, b"to my master"))
    world.channel.send(0, Outgoing(BROADCAST, b"to my slaves"))
    world.kernel.run(world.kernel.now + S)
    assert world.channel.unsent == {(1, why): 1}


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
    world.channel.moved(np.array([[0.0, 0.0], [0.0, 9.9]]))
    assert world.channel.in_reach(0) == (1,)


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
    world.at(600 * MS, lambda: world.channel.power(0, True))
    world.kernel.run(10 * S)
    assert world.hosts[0].got(InquiryComplete) + world.hosts[0].got(Connected) == []
    assert world.channel.devices[0].inquiry_time == 500 * MS
    world.command(0, Page(1))  # what was asked for before is forgotten; this is not
    world.kernel.run(20 * S)
    assert len(world.hosts[0].got(Connected)) == 1
    assert world.hosts[0].got(PageFailed) == []


@pytest.mark.parametrize("device", [0, 1])
def test_a_radio_forgets_its_links_even_if_it_is_off_for_a_moment_only(device: Address) -> None:
    world = World(2, supervision_s=2.0, idle_frames=True)
    world.connect(1)
    off = world.kernel.now
    world.at(off, lambda: world.channel.power(device, False))
    world.at(off + 100 * MS, lambda: world.channel.power(device, True))
    world.kernel.run(off + 3 * S)
    assert world.hosts[device].got(Lost) == []
    assert world.hosts[1 - device].got(Lost) == [Lost(device)]
    polls = [(f["time_ns"] < off + 100 * MS, f["outcome"]) for f in world.frames() if f["time_ns"] > off]
    expected = {(True, "out_of_range"), (False, "not_tuned")} if device == 1 else set()
    assert set(polls) == expected


def test_a_radio_that_is_switched_off_in_the_middle_of_a_frame_does_not_receive_it() -> None:
    world = World(2)
    world.connect(1)
    now = world.kernel.now
    clock = world.channel.devices[0].identity.clock
    start = clock.time_of((clock.tick(now) // 4 + 1) * 4)
    world.at(start, lambda: world.channel.send(0, Outgoing(BROADCAST, bytes(17))))
    world.at(start + 100 * US, lambda: world.channel.power(1, False))
    world.kernel.run(start + 5 * MS)
    assert world.trace.columns("frames")["kind"][-1] == "DM1"
    assert world.hosts[1].received == []


def test_disconnect_closes_both_sides_and_both_can_be_found_again() -> None:
    world = World(2)
    world.connect(1)
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
    assert list(summary) == [metric.name for metric in world.channel.metrics]
    assert summary["frames_dm3"] == summary["frames_sent"] == 1
    assert summary["idle_polls"] == summary["frames_poll"] == pytest.approx(10 * S / (40 * SLOT), abs=2)
    assert summary["radio_inquiry_s"] + summary["radio_paging_s"] == pytest.approx(connected / S)


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
