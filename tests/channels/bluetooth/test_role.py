"""Role switch: who polls and hops from then on, what happens to what waits, and when it is refused."""

import pytest

from cosim.channels.bluetooth.hopping import basic_channel
from cosim.machine import (
    BROADCAST,
    Address,
    Fate,
    Hold,
    Inquire,
    Lost,
    Mode,
    ModeChanged,
    Outcome,
    Outgoing,
    Page,
    Role,
    RoleChanged,
    SwitchRole,
)
from cosim.units import MS, SLOT, S
from tests.channels.bluetooth.bluetooth_world import World
from tests.channels.bluetooth.radio_scene import equal_powers_dbm


def switch(world: World, device: Address, peer: Address) -> None:
    world.channel.devices[device].command(SwitchRole(peer))


def connected(size: int, *slaves: Address, **settings: object) -> World:
    world = World(size, idle_frames=True, **settings)
    world.connect(*slaves)
    return world


def roles(world: World) -> list[list[RoleChanged]]:
    return [[event for event in host.got(RoleChanged) if isinstance(event, RoleChanged)] for host in world.hosts]


@pytest.mark.parametrize("asking", [0, 1])
def test_the_new_master_polls_on_its_own_clock_and_hop_sequence(asking: Address) -> None:
    world = connected(2, 1)
    now = world.kernel.now
    world.at(now + 1, lambda: switch(world, asking, 1 - asking))
    world.kernel.run(now + 1 * S)
    world.channel.advance(world.kernel.now)
    assert roles(world) == [[RoleChanged(1, Role.SLAVE)], [RoleChanged(0, Role.MASTER)]]
    frames = [frame for frame in world.frames() if frame["time_ns"] > now + 2 * SLOT + 1]
    assert len(frames) > 60
    identity = world.channel.devices[1].identity
    assert not [
        frame for frame in world.frames() if frame["kind"] == "POLL" and frame["source"] and frame not in frames
    ]
    for frame in frames:
        tick = identity.clock.tick(frame["time_ns"])
        assert identity.clock.time_of(tick) == frame["time_ns"]
        assert (frame["kind"], frame["source"], tick % 4) in (("POLL", 1, 0), ("NULL", 0, 2))
        assert frame["channel"] == basic_channel(identity.hop_address, tick)
        assert frame["outcome"] == "received"
    assert world.channel.devices[1].master_of.members() == (0,)
    assert world.channel.devices[0].master_of.members() == ()
    assert list(world.channel.devices[0].masters) == [1]
    assert world.channel.devices[1].masters == {}


def test_what_waits_on_either_side_survives_once_and_in_order() -> None:
    world = connected(2, 1)
    now = world.kernel.now
    for token in range(6):
        world.at(now, lambda token=token: world.channel.send(0, Outgoing(1, bytes([token]) * 100, token)))
        world.at(now, lambda token=token: world.channel.send(1, Outgoing(0, bytes([token]) * 100, token)))
    world.at(now, lambda: world.channel.send(0, Outgoing(BROADCAST, b"all", 9)))
    world.at(now + 9 * MS, lambda: switch(world, 1, 0))
    world.kernel.run(now + 2 * S)
    (at,) = world.hosts[1].when(RoleChanged)
    for host in world.hosts:
        assert [data[0] for _, _, data, _ in host.received] == list(range(6))
        assert [event.token for event in host.got(Fate) if event.outcome is Outcome.DELIVERED] == list(range(6))
        assert 0 < sum(time < at for time, *_ in host.received) < 6
    assert Fate(9, Outcome.FLUSHED) in world.hosts[0].got(Fate)


@pytest.mark.parametrize("lost", [(0, 1), (1, 0)], ids=["down", "up"])
@pytest.mark.parametrize("source", [0, 1])
@pytest.mark.parametrize("slots", range(20, 26))
def test_a_payload_arrives_once_whether_it_or_its_acknowledgement_was_lost_before(
    source: Address, lost: tuple[int, int], slots: int
) -> None:
    world = connected(2, 1, t_poll_slots=16)
    now = world.kernel.now
    air = world.channel.air
    world.at(now, lambda: air.set_powers(equal_powers_dbm(2, [lost]), world.kernel.now))
    world.at(now, lambda: world.channel.send(source, Outgoing(1 - source, b"first", 1)))
    world.at(now, lambda: world.channel.send(source, Outgoing(1 - source, b"second", 2)))
    world.at(now + slots * SLOT, lambda: air.set_powers(equal_powers_dbm(2), world.kernel.now))
    world.at(now + slots * SLOT, lambda: switch(world, 0, 1))
    world.kernel.run(now + 2 * S)
    assert len(world.hosts[0].got(RoleChanged)) == 1
    before = [frame["outcome"] for frame in world.frames() if now <= frame["time_ns"] <= now + slots * SLOT]
    assert before.count("out_of_range") > 0
    assert [data for _, _, data, _ in world.hosts[1 - source].received] == [b"first", b"second"]
    assert [event.outcome for event in world.hosts[source].got(Fate)] == [Outcome.DELIVERED] * 2


@pytest.mark.parametrize("half_slots", range(0, 24, 3))
def test_a_slot_pair_under_way_is_finished_before(half_slots: int) -> None:
    world = connected(2, 1)
    now = world.kernel.now
    clock = world.channel.devices[0].identity.clock
    first = clock.time_of((clock.tick(now) // 4 + 2) * 4)
    for token in range(6):
        world.at(first, lambda token=token: world.channel.send(0, Outgoing(1, bytes([token]) * 300, token)))
        world.at(first, lambda token=token: world.channel.send(1, Outgoing(0, bytes([token]) * 300, token)))
    world.at(first + half_slots * SLOT // 2 + 1, lambda: switch(world, 0, 1))
    world.kernel.run(now + 2 * S)
    (at,) = world.hosts[1].when(RoleChanged)
    # a pair of two DH5 takes ten slots
    assert at == first + -(-(half_slots * SLOT // 2 + 1) // (10 * SLOT)) * 10 * SLOT + (at - first) % SLOT
    assert (at - first) % SLOT < 10
    for host in world.hosts:
        assert [data[0] for _, _, data, _ in host.received] == list(range(6))
        assert [event.outcome for event in host.got(Fate)] == [Outcome.DELIVERED] * 6
    assert {frame["outcome"] for frame in world.frames()} == {"received"}


def test_a_link_that_has_been_turned_round_is_supervised_and_can_be_turned_back() -> None:
    world = connected(2, 1, supervision_s=2.0)
    now = world.kernel.now
    world.at(now, lambda: switch(world, 0, 1))
    world.at(now + 1 * S, lambda: switch(world, 0, 1))
    world.at(now + 2 * S, lambda: switch(world, 0, 1))
    world.at(now + 10 * S, lambda: world.channel.power(0, False))
    world.kernel.run(now + 9 * S)
    assert [event.role for event in roles(world)[0]] == [Role.SLAVE, Role.MASTER, Role.SLAVE]
    assert world.hosts[1].got(Lost) == []
    world.kernel.run(now + 14 * S)
    assert world.hosts[1].got(Lost) == [Lost(0)]


def test_it_is_refused_where_either_has_another_link() -> None:
    world = connected(3, 1, 2)
    now = world.kernel.now
    world.at(now, lambda: switch(world, 0, 1))
    world.at(now, lambda: switch(world, 2, 0))
    world.kernel.run(now + 10 * MS)
    assert roles(world) == [[RoleChanged(1, Role.MASTER)], [], [RoleChanged(0, Role.SLAVE)]]
    assert world.channel.devices[0].master_of.members() == (1, 2)


def test_it_is_refused_on_hold_during_a_procedure_and_out_of_reach_and_unknown_without_a_link() -> None:
    world = connected(3, 1)
    now = world.kernel.now
    devices = world.channel.devices
    world.at(now, lambda: switch(world, 2, 0))
    world.at(now, lambda: switch(world, 0, 7))
    world.kernel.run(now + 10 * MS)
    assert world.hosts[2].got(ModeChanged) == [ModeChanged(0, Mode.NONE)]
    assert world.hosts[0].got(ModeChanged) == [ModeChanged(7, Mode.NONE)]
    world.at(now + 20 * MS, lambda: devices[0].command(Hold(1, 100)))
    world.at(now + 21 * MS, lambda: switch(world, 1, 0))
    world.kernel.run(now + 200 * MS)
    assert roles(world)[1] == [RoleChanged(0, Role.SLAVE)]
    world.command(0, Inquire(1 * S, 1))
    world.at(now + 300 * MS, lambda: switch(world, 1, 0))
    world.kernel.run(now + 2 * S)
    assert roles(world)[1] == [RoleChanged(0, Role.SLAVE)] * 2
    world.at(now + 3 * S, lambda: world.channel.power(0, False))
    world.at(now + 3 * S + 1 * MS, lambda: switch(world, 1, 0))
    world.kernel.run(now + 4 * S)
    assert roles(world)[1] == [RoleChanged(0, Role.SLAVE)] * 3


def test_the_new_master_may_page_others() -> None:
    world = connected(3, 1)
    now = world.kernel.now
    world.at(now, lambda: switch(world, 0, 1))
    world.at(now + 100 * MS, lambda: world.command(1, Page(2)))
    world.kernel.run(now + 12 * S)
    assert world.channel.devices[1].master_of.members() == (0, 2)


def test_the_new_masters_piconet_begins_when_the_roles_change() -> None:
    """Whatever it has not done before: it has had no link since the run began."""
    world = World(2)
    world.connect(1)
    now = world.kernel.now
    world.at(now, lambda: switch(world, 0, 1))
    world.kernel.run(now + 4 * S)
    polls = world.channel.devices[1].master_of.counts()["idle"]
    assert polls == pytest.approx(4 * S / (40 * SLOT), abs=2)
