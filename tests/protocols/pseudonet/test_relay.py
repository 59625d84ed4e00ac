"""The broadcast room of a scatternet on a table: what is carried on, dropped, asked for again, and who is called up."""

from collections import deque
from collections.abc import Sequence
from contextlib import suppress

import numpy as np
import pytest

from cosim.errors import WireError
from cosim.machine import BROADCAST, Address, Disconnect, Outgoing, Reception, Role
from cosim.units import Time
from protocols.pseudonet.algorithms.base import UNJUDGED
from protocols.pseudonet.messages import Action, Kind, Message, Missing, Reply
from protocols.pseudonet.relay import Relay
from protocols.pseudonet.topology import Piconet, design, piconets_needed
from protocols.pseudonet.upcalls import Answered, Broken, Exchanged, Garbage, TeamChanged, Upcall
from protocols.pseudonet.wide import Census, Dissolution, WidePacket, decode, encode

REPAIR: Time = 100
SILENCE: Time = 10_000


class Member:
    """One relay room and the script above it: states that tell the robot's turn, as soon as they are wanted."""

    def __init__(self, me: Address, exchanges: int) -> None:
        self.links: dict[Address, Role] = {}
        self.room = Relay(me, (REPAIR, SILENCE), self.links, self._hear, lambda *_: None)
        self.heard: list[Upcall] = []
        self.mute = False
        self._left = exchanges

    @property
    def exchanged(self) -> list[Exchanged]:
        return [upcall for upcall in self.heard if isinstance(upcall, Exchanged)]

    def _hear(self, upcall: Upcall, now: Time) -> None:
        self.heard.append(upcall)
        match upcall:
            case TeamChanged():
                self.load(now)
            case Exchanged():
                self._left -= 1
                self.load(now)

    def load(self, now: Time) -> None:
        if self._left > 0 and not self.mute:
            self.room.load(self.state(self.room.exchange), now)

    def state(self, exchange: int) -> Message:
        row = len(self.exchanged)
        return Message(self.room.me, Kind.STATE, exchange, self.room.me, row, Action.STAY, UNJUDGED)


class Table:
    """Robots joined as *piconets* say; a frame takes one unit of time, and broadcasts are missed with a chance."""

    def __init__(self, piconets: Sequence[Piconet], exchanges: int = 1, loss: float = 0.0, seed: int = 0) -> None:
        robots = sorted({robot for piconet in piconets for robot in (piconet.master, *piconet.slaves)})
        self.members = {robot: Member(robot, exchanges) for robot in robots}
        self.piconets = list(piconets)
        self.now: Time = 0
        self.carried: list[tuple[Address, Address, WidePacket]] = []
        self.closed: list[tuple[Address, Address]] = []
        """Who wanted the link to whom closed; it stays."""
        self._loss = loss
        self._rng = np.random.default_rng(seed)
        self._air: deque[tuple[Address, Address, Outgoing]] = deque()
        for piconet in piconets:
            for slave in piconet.slaves:
                self.members[piconet.master].links[slave] = Role.MASTER
                self.members[slave].links[piconet.master] = Role.SLAVE

    def report(self) -> None:
        """Let all masters report, the root's first of the piconets."""
        root = self.piconets[0].master
        masters = tuple(piconet.master for piconet in self.piconets)
        for member in self.members.values():
            member.room.enter()
        self.members[root].room.enter()
        self.members[root].room.registry.expect(masters, 1, 1_000_000)
        for number, piconet in enumerate(self.piconets):
            census = Census(False, 0, 0, number, len(self.piconets), root, 1, piconet)
            self.members[piconet.master].room.placed(census, self.now)

    def run(self, until: Time = 100_000) -> None:
        """Carry frames, and let deadlines come, until nobody has anything more to do."""
        while self.now < until:
            self._collect()
            if self._air:
                self.now += 1
                source, destination, item = self._air.popleft()
                self._carry(source, destination, item)
                continue
            deadlines = [m.room.deadline for m in self.members.values() if m.room.deadline is not None]
            if not any(deadline < until for deadline in deadlines):
                return
            self.now = max(self.now, min(deadlines))
            for member in self.members.values():
                member.room.wake(self.now)

    def _collect(self) -> None:
        for robot, member in self.members.items():
            for item in member.room.out:
                if isinstance(item, Outgoing):
                    slaves = [peer for peer, role in member.links.items() if role is Role.MASTER]
                    to_all = item.destination == BROADCAST
                    self._air.extend((robot, to, item) for to in (slaves if to_all else [item.destination]))
                elif isinstance(item, Disconnect):
                    self.closed.append((robot, item.peer))
            member.room.out.clear()

    def _carry(self, source: Address, destination: Address, item: Outgoing) -> None:
        if source not in self.members or destination not in self.members[source].links:
            return
        to_all = item.destination == BROADCAST
        if to_all and self._rng.random() < self._loss:
            return
        room = self.members[destination].room
        with suppress(WireError):  # by a name of the last roll
            packet = decode(item.payload, self.members[source].room.registry.directory)
            self.carried.append((source, destination, packet))
        room.receive(item.payload, Reception(source, to_all), self.now)

    def kill(self, robot: Address) -> None:
        member = self.members.pop(robot)
        for peer in member.links:
            del self.members[peer].links[robot]
            self.members[peer].room.lost(robot, self.now)


def scatternet(topology: str, size: int, most: int = 4) -> list[Piconet]:
    count = piconets_needed(size, topology, most)  # type: ignore[arg-type]
    return design(range(count), range(count, size), topology, most)  # type: ignore[arg-type]


CASES = [(topology, size) for topology in ("ring", "tree", "bridged") for size in (5, 9, 12)]


@pytest.mark.parametrize(("topology", "size"), CASES)
@pytest.mark.parametrize("loss", [0.0, 0.3])
def test_all_messages_of_all_exchanges_reach_everybody(topology: str, size: int, loss: float) -> None:
    table = Table(scatternet(topology, size), exchanges=6, loss=loss, seed=size)
    table.report()
    table.run(SILENCE - 1)
    first = table.members[0]
    assert first.heard[0] == TeamChanged(tuple(range(size)))
    assert len(first.exchanged) == 6
    for member in table.members.values():
        assert member.exchanged == first.exchanged
        assert [upcall.roll_call for upcall in member.exchanged] == [True] + [False] * 5
        for row, upcall in enumerate(member.exchanged):
            assert {source: (m.x, m.y) for source, m in upcall.messages.items()} == {
                source: (source, row) for source in range(size)
            }


@pytest.mark.parametrize(("topology", "size"), CASES)
def test_nobody_takes_or_carries_on_a_message_twice(topology: str, size: int) -> None:
    piconets = scatternet(topology, size)
    table = Table(piconets)
    table.report()
    table.run(REPAIR)
    frames = [(a, b, packet.source) for a, b, packet in table.carried if isinstance(packet, Message)]
    assert len(frames) == len(set(frames))
    # at most once along each link in each direction
    assert len(frames) <= 2 * size * sum(len(piconet.slaves) for piconet in piconets)


def test_a_lost_plain_slave_is_done_without_after_a_new_roll_call() -> None:
    table = Table(scatternet("tree", 9), exchanges=20)
    plain = table.piconets[1].slaves[0]
    table.report()
    table.run(60)
    table.kill(plain)
    table.run(SILENCE - 1)
    left = tuple(robot for robot in range(9) if robot != plain)
    for member in table.members.values():
        assert TeamChanged(left) in member.heard
        assert member.exchanged[-1].messages.keys() == set(left)
        assert not any(isinstance(upcall, Broken) for upcall in member.heard)


@pytest.mark.parametrize(("topology", "gone"), [("tree", 0), ("tree", 1), ("ring", 1), ("bridged", 3)])
def test_without_a_master_or_a_bridge_the_scatternet_is_dissolved(topology: str, gone: int) -> None:
    table = Table(scatternet(topology, 9), exchanges=20)
    table.report()
    table.run(80)
    table.kill(gone)
    table.run(SILENCE // 2)
    lost = {robot for robot, member in table.members.items() if any(isinstance(u, Broken) for u in member.heard)}
    # who has lost all its links hears nothing more, and finds out by itself
    assert lost >= {robot for robot, member in table.members.items() if member.links}
    assert len(lost) >= 7


def test_the_root_does_without_robots_that_are_silent_for_long() -> None:
    table = Table(scatternet("ring", 12), exchanges=4)
    mute = table.piconets[2].slaves[0]
    table.members[mute].mute = True
    table.report()
    table.run(3 * SILENCE)
    left = tuple(robot for robot in range(12) if robot != mute)
    assert table.members[mute].heard[-1] == Broken()
    for robot in left:
        assert table.members[robot].exchanged[-1].messages.keys() == set(left)


def test_a_silent_master_breaks_the_scatternet_up_and_is_named() -> None:
    table = Table(scatternet("ring", 12), exchanges=4)
    table.members[2].mute = True
    table.report()
    table.run(3 * SILENCE)
    assert [member.heard[-1] for robot, member in table.members.items() if robot != 2] == [Broken((2,))] * 11


def test_masters_that_do_not_report_are_named_when_the_formation_is_given_up() -> None:
    table = Table(scatternet("tree", 9))
    room = table.members[0].room
    room.enter()
    room.registry.expect((0, 1, 2), 1, 500)
    room.placed(Census(False, 0, 0, 0, 3, 0, 1, table.piconets[0]), 0)
    for member in table.members.values():
        member.room.enter()
    table.members[1].room.placed(Census(False, 0, 0, 1, 3, 0, 1, table.piconets[1]), 0)
    table.run(1_000)
    assert table.now >= 500
    assert room.find_master() is None
    assert table.members[0].heard == [Broken((2,))]
    told = {robot for robot, member in table.members.items() if Broken((2,)) in member.heard}
    assert told == set(table.members)


def test_a_report_of_an_earlier_formation_is_not_taken() -> None:
    table = Table(scatternet("tree", 5))
    room = table.members[0].room
    room.enter()
    room.registry.expect((0, 1), 2, 500)
    room.placed(Census(False, 0, 0, 0, 2, 0, 2, table.piconets[0]), 0)
    old = Census(False, 3, 0, 1, 2, 0, 1, table.piconets[1])
    room.receive(encode(old, room.registry.directory), Reception(1, False), 1)
    assert room.find_master() is None
    room.receive(
        encode(Census(False, 0, 0, 1, 2, 0, 2, table.piconets[1]), room.registry.directory), Reception(1, False), 2
    )
    assert room.find_master() == 0
    assert room.members == (0, 1, 2, 3, 4)


def test_a_silent_robot_is_disconnected_by_its_master() -> None:
    table = Table(scatternet("tree", 5), exchanges=4)
    plain = next(slave for slave in table.piconets[0].slaves if slave > 1)
    table.members[plain].mute = True
    table.report()
    table.run(3 * SILENCE)
    assert table.closed == [(0, plain)]


def test_an_answer_reaches_its_addressee_across_piconets_and_nobody_else() -> None:
    table = Table(scatternet("ring", 12), exchanges=2)
    table.report()
    table.run(REPAIR)
    table.members[3].room.answer(
        Message(3, Kind.ANSWER, 1, 1, 2, Action.STAY, UNJUDGED, False, 11, Reply.DIRECT, (3, 4))
    )
    table.run(SILENCE - 1)
    answered = [robot for robot, m in table.members.items() if any(isinstance(u, Answered) for u in m.heard)]
    assert answered == [11]


def test_who_has_missed_messages_asks_and_is_answered_from_what_neighbours_keep() -> None:
    table = Table(scatternet("tree", 5, most=4), exchanges=2)
    table.report()
    table.run(REPAIR // 2)
    slave, master = table.piconets[1].slaves[0], table.piconets[1].master
    room = table.members[master].room
    last = (room.exchange - 1) % 256
    room.out.clear()
    directory = room.registry.directory
    room.receive(encode(Missing(slave, last, (0, slave)), directory), Reception(slave, False), table.now)
    again = [decode(item.payload, directory) for item in room.out if isinstance(item, Outgoing)]
    assert [(packet.source, packet.exchange) for packet in again if isinstance(packet, Message)] == [(0, last)]


def test_bytes_that_are_no_packet_are_reported_whoever_sent_them() -> None:
    member = Member(0, 1)
    member.room.receive(b"junk", Reception(1, False), 1)
    member.room.overhear(b"junk", 2)
    assert member.heard == [Garbage("the CRC does not fit")] * 2


def test_a_dissolution_is_passed_on_once_and_then_over() -> None:
    member = Member(0, 1)
    member.links |= {1: Role.SLAVE, 2: Role.MASTER}
    member.room.enter()
    data = encode(Dissolution((5,)), member.room.registry.directory)
    member.room.receive(data, Reception(1, False), 1)
    member.room.leave()
    member.room.receive(data, Reception(2, False), 2)
    assert member.heard == [Broken((5,))]
    assert member.room.out == [Outgoing(2, data)]
