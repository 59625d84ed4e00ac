"""A device as its host sees it: everything that can be asked of it, and everything that comes up, in one life."""

from cosim.machine import (
    BROADCAST,
    Connected,
    Disconnect,
    Discovered,
    Fate,
    Flush,
    Inquire,
    InquiryComplete,
    LinkEvent,
    Lost,
    Outcome,
    Outgoing,
    Page,
    PageFailed,
    Role,
    Scan,
)
from cosim.units import MS, S
from tests.channels.bluetooth.bluetooth_world import World


def kinds(events: list[tuple[int, LinkEvent]]) -> list[str]:
    return [type(event).__name__ for _, event in events]


def test_the_life_of_a_link_from_inquiry_to_disconnection() -> None:
    world = World(3)
    master, slave, other = world.hosts
    world.command(2, Scan(False))
    world.command(0, Inquire(5 * S, 2))
    world.kernel.run(6 * S)
    assert kinds(master.events) == ["Discovered", "InquiryComplete"]
    assert master.events[1][1] == InquiryComplete((1,))
    assert isinstance(master.events[0][1], Discovered)
    # a device that does not scan accepts no page; one that does becomes a slave without being asked again
    world.command(0, Page(2), Page(1))
    world.kernel.run(18 * S)
    assert [type(event) for _, event in master.events[2:]] == [PageFailed, Connected]
    assert master.got(PageFailed) == [PageFailed(2)]
    (up,), (down,) = master.got(Connected), slave.got(Connected)
    assert isinstance(up, Connected)
    assert isinstance(down, Connected)
    assert (up.peer, up.role) == (1, Role.MASTER)
    assert (down.peer, down.role) == (0, Role.SLAVE)
    # payloads in both directions and to all, each with its fate
    for source, destination, token in ((0, 1, 1), (1, 0, 2), (0, BROADCAST, 3), (0, 2, 4), (1, BROADCAST, 5)):
        world.channel.send(source, Outgoing(destination, bytes([token]), token))
    world.channel.send(1, Outgoing(0, bytes(340), 6))
    world.channel.send(1, Outgoing(0, bytes([7]), 7))
    world.command(1, Flush(0))
    world.kernel.run(19 * S)
    assert [data for _, _, data, _ in slave.received] == [b"\1", b"\3"]
    assert [data for _, _, data, _ in master.received] == []
    fates = {event.token: event.outcome for host in (master, slave) for event in host.got(Fate)}
    assert fates == {
        1: Outcome.DELIVERED,
        2: Outcome.FLUSHED,
        3: Outcome.SENT,
        4: Outcome.NO_LINK,
        5: Outcome.NO_LINK,
        6: Outcome.TOO_LONG,
        7: Outcome.FLUSHED,
    }
    world.command(1, Disconnect(0))
    world.kernel.run(19 * S + 1 * MS)
    assert master.events[-1] == (19 * S, Lost(1))
    assert slave.events[-1] == (19 * S, Lost(0))
    assert other.events == []
