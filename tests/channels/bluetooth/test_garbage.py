"""Commands without sense, payloads of any length and content: each has an answer, and none stops anything."""

from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from cosim.errors import LocalProtocolError
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
    Outcome,
    Outgoing,
    Page,
    PageFailed,
    Role,
    Scan,
    Share,
)
from cosim.scenario import Scenario
from cosim.simulation import Simulation
from cosim.units import MS, S, Time
from tests.channels.bluetooth.bluetooth_arena import (
    Arena,
    paging,
)


def garbage_commands(draw: np.random.Generator) -> list[Any]:
    """Return commands that name nobody, or too much, and payloads that no packet holds."""
    peers = [-7, -1, 0, 1, 2, 3, 99, 1 << 40]

    def peer() -> int:
        return peers[draw.integers(len(peers))]

    makers: list[Callable[[], Any]] = [
        lambda: Page(peer(), [None, -5, 1, (1 << 28) + 3][draw.integers(4)]),
        lambda: Disconnect(peer()),
        lambda: Flush(peer()),
        lambda: Inquire([0, 1, 10 * MS][draw.integers(3)], [-1, 0, 1, 99][draw.integers(4)]),
        lambda: Scan(bool(draw.integers(2))),
        lambda: Share(64, ((peer(), 0, 30), (peer(), 30, 34)), int(draw.integers(4))),
        lambda: Share(64, (), 0),
        lambda: Outgoing(peer(), draw.bytes(int(draw.integers(0, 400))), int(draw.integers(1 << 40))),
    ]
    return [makers[draw.integers(len(makers))]() for _ in range(60)]


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_commands_without_sense_are_answered_and_stop_nothing(seed: int):
    draw = np.random.default_rng(seed)
    world = Arena(4)
    tokens: list[list[int]] = [[] for _ in world.hosts]
    pages = Counter[Address]()
    inquiries = Counter[Address]()

    def act(address: Address, item: Any) -> None:
        if isinstance(item, Outgoing):
            tokens[address].append(item.token or 0)
            world.channel.send(address, item)
        else:
            pages[address] += isinstance(item, Page)
            inquiries[address] += isinstance(item, Inquire)
            world.command(address, item)

    for address in range(4):
        for item in garbage_commands(draw):
            world.at(int(draw.integers(2 * S)), lambda a=address, i=item: act(a, i))  # type: ignore[misc]
    world.kernel.run(60 * S)
    for host in world.hosts:
        masters = [event for event in host.got(Connected) if event.role is Role.MASTER]  # type: ignore[union-attr]
        assert len(masters) + len(host.got(PageFailed)) == pages[host.address]
        assert len(host.got(InquiryComplete)) == inquiries[host.address]
        held = world.channel.devices[host.address]
        fates = [event.token for event in host.got(Fate)]  # type: ignore[union-attr]
        assert len(fates) == len(set(fates))
        unanswered = set(tokens[host.address]) - set(fates)
        assert set(fates) <= set(tokens[host.address])
        # a link that is still up may hold what its peer has no time for
        assert not unanswered or held.master_of.members() or held.masters


@pytest.mark.parametrize("length", [0, 1, 17, 18, 27, 28, 121, 122, 183, 184, 224, 225, 339])
def test_payloads_of_any_length_that_a_packet_holds_arrive_both_ways(length: int):
    world = paging()
    world.kernel.run(100 * MS)
    payload = bytes(range(256))[: length % 256] + bytes(max(0, length - length % 256))
    world.channel.send(0, Outgoing(1, payload, 1))
    world.channel.send(1, Outgoing(0, payload, 2))
    world.channel.send(0, Outgoing(BROADCAST, payload, 3))
    world.kernel.run(200 * MS)
    assert [data for _, _, data, _ in world.hosts[1].received] == [payload, payload]
    assert [data for _, _, data, _ in world.hosts[0].received] == [payload]
    sizes = {frame["length"] for frame in world.frames() if frame["kind"][:2] in ("DM", "DH")}
    assert sizes == {length}


@pytest.mark.parametrize("length", [340, 1021, 1 << 20])
def test_payloads_that_no_packet_holds_are_too_long_on_both_sides_and_hold_nothing_up(length: int):
    world = paging()
    world.kernel.run(100 * MS)
    for source, destination in ((0, 1), (1, 0), (0, BROADCAST)):
        world.channel.send(source, Outgoing(destination, bytes(length), 1))
        world.channel.send(source, Outgoing(destination, b"short", 2))
    world.kernel.run(200 * MS)
    assert world.hosts[1].got(Fate) == [Fate(1, Outcome.TOO_LONG), Fate(2, Outcome.DELIVERED)]
    assert sorted(str(event) for event in world.hosts[0].got(Fate)) == sorted(
        str(Fate(token, outcome))
        for token, outcome in ((1, Outcome.TOO_LONG), (1, Outcome.TOO_LONG), (2, Outcome.DELIVERED), (2, Outcome.SENT))
    )


def test_two_thousand_commands_that_wait_for_an_inquiry_are_all_refused():
    world = Arena()
    world.command(0, Inquire(20 * MS, 9), *[Page(0)] * 2_000)
    world.kernel.run(1 * S)
    assert len(world.hosts[0].got(PageFailed)) == 2_000
    assert set(world.hosts[0].when(PageFailed)) == set(world.hosts[0].when(InquiryComplete))


@pytest.mark.slow
def test_seventy_devices_may_inquire_at_once():
    world = Arena(70)
    for address in range(68):
        world.command(address, Inquire(60 * MS, 9))
    world.kernel.run(1 * S)
    assert [len(host.got(InquiryComplete)) for host in world.hosts] == [1] * 68 + [0] * 2
    assert sum(len(host.got(Discovered)) for host in world.hosts) > 0


@pytest.mark.parametrize(
    "share",
    [
        Share(48, ((0, 0, 30), (1, 20, 20)), 0),
        Share(48, ((0, 40, 10), (1, 0, 10)), 0),
        Share(48, ((0, -2, 10),), 0),
        Share(48, ((0, 48, 10),), 0),
        Share(48, ((0, 0, 0),), 0),
        Share(0, ((0, 0, 10),), 0),
        Share(48, ((0, 0, 10),), 2),
        Share(48, ((0, 0, 10),), -1),
    ],
)
def test_parts_that_nobody_can_keep_are_the_misuse_that_they_are(share: Share):
    world = paging()
    world.kernel.run(100 * MS)
    with pytest.raises(LocalProtocolError):
        world.channel.command(1, share)


@pytest.mark.slow
@pytest.mark.parametrize("size", [3, 5])
def test_a_team_covers_its_floor_while_strange_payloads_are_on_the_air(size: int):
    """Garbage of any length, and broken copies of what was really said, from every device to all that it may reach."""
    scenario = Scenario.model_validate(
        {
            "duration_s": 600,
            "floorplan": {"map": "walls", "bounds_m": [0, 0, 3, 3]},
            "team": {"size": size},
            "channel": {"kind": "bluetooth"},
            "protocol": {"use": "pseudonet", "parameters": {"algorithm": "boustrophedon"}},
        }
    )
    simulation = Simulation(scenario, 1)
    draw = np.random.default_rng(size)
    heard: list[bytes] = []
    for node in simulation.nodes:
        simulation.channel.attach(node.address, Eavesdropper(node, heard))

    def babble() -> None:
        payload = draw.bytes(int(draw.integers(0, 60)))
        if heard and draw.integers(2):
            copy = bytearray(heard[draw.integers(len(heard))])
            if copy:
                copy[draw.integers(len(copy))] ^= 1 << int(draw.integers(8))
            payload = bytes(copy[: draw.integers(1, len(copy) + 2)])
        source = int(draw.integers(size))
        simulation.channel.send(source, Outgoing([BROADCAST, 0, 1, 2][draw.integers(4)], payload))
        simulation.kernel.after(int(draw.integers(50 * MS, 500 * MS)), babble)

    simulation.kernel.at(1 * S, babble)
    outcome = simulation.run()
    assert outcome.metrics["simulated_s"] < 600
    events = outcome.trace.columns("events")["event"]
    assert list(events).count("BadBytes") > 10


class Eavesdropper:
    """Passes everything on to a node, and keeps what was said."""

    def __init__(self, node: Any, heard: list[bytes]) -> None:
        self._node = node
        self._heard = heard

    def receive(self, data: bytes, reception: Any, now: Time) -> None:
        self._heard.append(data)
        self._node.receive(data, reception, now)

    def link(self, event: Any, now: Time) -> None:
        self._node.link(event, now)

    def drain(self, now: Time) -> None:
        self._node.drain(now)
