"""Settings of the channel and commands of hosts reach the piconets."""

import pytest
from pydantic import ValidationError

from cosim.channels.bluetooth.polling import USED
from cosim.channels.bluetooth.settings import BluetoothSettings
from cosim.machine import (
    BROADCAST,
    Connected,
    Discovered,
    Fate,
    Hold,
    Inquire,
    InquiryComplete,
    LinkEvent,
    Lost,
    Mode,
    ModeChanged,
    Outcome,
    Outgoing,
    Page,
    Park,
    Role,
    RoleChanged,
    Sniff,
    SwitchRole,
    Unpark,
)
from cosim.units import MS, SLOT, S
from tests.channels.bluetooth.bluetooth_world import World


def connected(size: int, *slaves: int, **settings: object) -> World:
    world = World(size, **settings)
    world.connect(*slaves)
    return world


@pytest.mark.parametrize("scheduler", ["round_robin", "exhaustive", "backlog"])
def test_a_scheduler_is_taken_from_the_settings(scheduler: str) -> None:
    world = connected(3, 1, 2, scheduler=scheduler)
    before = world.channel.summary()["idle_polls"]
    world.kernel.run(world.kernel.now + 1 * S)
    assert world.channel.summary()["idle_polls"] - before == pytest.approx(1 * S / (2 * SLOT), abs=2)


def test_queues_and_flushes_are_taken_from_the_settings() -> None:
    world = connected(2, 1, queue_payloads=2, flush_s=0.05)
    now = world.kernel.now
    for token in range(3):
        world.channel.send(0, Outgoing(1, b"x", token))
    world.channel.power(1, False)
    world.kernel.run(now + 100 * MS)
    fates = {event.token: event.outcome for event in world.hosts[0].got(Fate) if isinstance(event, Fate)}
    assert fates == {0: Outcome.FLUSHED, 1: Outcome.FLUSHED, 2: Outcome.QUEUE_FULL}


def test_adapted_hopping_is_taken_from_the_settings() -> None:
    assert World(2, afh=True).channel.air.band.piconets[:, USED].tolist() == [79, 79]
    assert World(2).channel.air.band.piconets[:, USED].tolist() == [0, 0]


def test_hosts_change_modes_and_roles_by_commands() -> None:
    world = connected(2, 1, park_interval_slots=128)
    seen: list[LinkEvent] = []
    world.hosts[1].react = seen.append
    for command in (Hold(1, 100), Sniff(1, 100, 0, 2), Sniff(1, 0, 0, 0), Park(1), Unpark(1), SwitchRole(1)):
        world.command(0, command)
        world.kernel.run(world.kernel.now + 200 * MS)
    modes = [Mode.HOLD, Mode.ACTIVE, Mode.SNIFF, Mode.ACTIVE, Mode.PARKED, Mode.ACTIVE]
    assert seen == [*(ModeChanged(0, mode) for mode in modes), RoleChanged(0, Role.MASTER)]
    assert world.hosts[0].got(RoleChanged) == [RoleChanged(1, Role.SLAVE)]


@pytest.mark.slow
def test_ten_robots_in_one_piconet_hear_their_masters_broadcasts() -> None:
    """Found, connected seven at a time, parked to make room, and all still members."""
    world = World(10, park_interval_slots=256)
    world.connect(*range(1, 8))
    for slave in (1, 2):
        world.command(0, Park(slave))
    world.command(0, Inquire(11 * S, 2))
    world.kernel.run(world.kernel.now + 12 * S)
    world.command(0, Page(8), Page(9))
    world.kernel.run(world.kernel.now + 12 * S)
    assert len(world.hosts[0].got(Connected)) == 9
    assert [host.got(Lost) for host in world.hosts] == [[]] * 10
    world.channel.send(0, Outgoing(BROADCAST, b"all"))
    world.kernel.run(world.kernel.now + 1 * S)
    assert [len(host.received) for host in world.hosts] == [0] + [1] * 9


def test_a_parked_slave_is_not_found_by_an_inquiry() -> None:
    world = connected(2, 1)
    world.command(0, Park(1))
    world.kernel.run(world.kernel.now + 10 * MS)
    world.command(0, Inquire(3 * S, 1))
    world.kernel.run(world.kernel.now + 4 * S)
    assert world.hosts[0].got(InquiryComplete)[-1] == InquiryComplete(())


# ---------------------------------------------------------------- 23 channels


def test_devices_meet_and_talk_on_23_channels() -> None:
    world = connected(2, 1, channels=23, idle_frames=True)
    world.channel.send(1, Outgoing(0, b"x", 1))
    world.kernel.run(world.kernel.now + 5 * S)
    world.channel.advance(world.kernel.now)
    assert {frame["channel"] for frame in world.frames()} == set(range(23))
    assert world.hosts[1].got(Fate) == [Fate(1, Outcome.DELIVERED)]
    (event,) = world.hosts[0].got(Connected)
    assert isinstance(event, Connected)
    assert event.hop_address < 1 << 32


@pytest.mark.slow
def test_on_23_channels_everyone_is_found_in_one_scan_interval_for_both_trains_hold_all_channels() -> None:
    for seed in range(25):
        world = World(2, seed=seed, channels=23)
        world.command(0, Inquire(3 * S, 1))
        world.kernel.run(3 * S)
        (found,) = world.hosts[0].when(Discovered)
        assert found < 1.28 * S + 15 * MS


@pytest.mark.parametrize(
    ("settings", "place"),
    [
        ({"afh": True, "channels": 23}, "afh"),
        ({"park_interval_slots": 64, "park_window_slots": 66}, "park_window_slots"),
        ({"channels": 40}, "channels"),
        ({"scheduler": "fair"}, "scheduler"),
        ({"flush_s": 0}, "flush_s"),
        ({"queue_payloads": 0}, "queue_payloads"),
        ({"park_interval_slots": 65}, "park_interval_slots"),
    ],
)
def test_settings_of_features_that_mean_nothing_are_refused(settings: dict[str, object], place: str) -> None:
    with pytest.raises(ValidationError) as error:
        BluetoothSettings.model_validate(settings)
    assert place in str(error.value)
