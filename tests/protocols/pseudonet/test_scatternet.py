"""Robots of scatternets: the laws of machines, and what they say and do while a scatternet is formed."""

from dataclasses import replace
from itertools import product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.machine import (
    Connected,
    Disconnect,
    Discovered,
    Fate,
    InquiryComplete,
    Lost,
    Outcome,
    Outgoing,
    Page,
    PageFailed,
    Reception,
    Role,
    Scan,
    Share,
)
from cosim.testing import check_machine
from cosim.units import S, Time
from protocols.pseudonet.machine import Pseudonet
from protocols.pseudonet.messages import Kind, Message, Missing
from protocols.pseudonet.topology import Directory, Piconet
from protocols.pseudonet.wide import Assignment, Census, Dissolution, Welcome, WidePacket, decode, encode
from tests.protocols.pseudonet.test_machine import maker, messages, started, surroundings
from tests.tiers import two_tiers

NOBODY = Directory(())
CLOCKS = 1 << 28


@pytest.mark.slow
@pytest.mark.parametrize(
    ("algorithm", "topology"), two_tiers(product(("oscard", "spanning_tree"), ("ring", "tree", "bridged")), 2)
)
def test_robots_of_scatternets_keep_the_laws(algorithm: str, topology: str) -> None:
    check_machine(maker(6, algorithm, piconet_size=3, topology=topology), surroundings(6).starts_m, duration=5 * S)


# ------------------------------------------------------------------ frames that are well formed and make no sense

_TEAM = Directory((Piconet(0, (1, 3)), Piconet(1, (2, 4))))
_small_numbers = st.integers(0, 6)
_orders = (
    st.builds(Welcome, _small_numbers, _small_numbers, _small_numbers, st.integers(0, 1))
    | st.builds(
        Assignment,
        _small_numbers,
        _small_numbers,
        _small_numbers,
        st.integers(0, 1),
        st.integers(0, 3),
        st.integers(0, 3),
        _small_numbers,
        st.integers(0, 9),
    )
    | st.builds(
        Census,
        st.booleans(),
        st.integers(0, 2),
        st.integers(0, 255),
        st.integers(0, 2),
        st.integers(0, 3),
        st.integers(0, 2),
        st.integers(0, 1),
        st.builds(Piconet, _small_numbers, st.lists(_small_numbers, max_size=4).map(tuple)),
    )
    | st.builds(Dissolution, st.sampled_from([(), (0,), (1, 2)]))
)
_of_team = st.sampled_from(_TEAM.members)
_wide = (
    st.tuples(messages, _of_team).map(lambda pair: replace(pair[0], source=pair[1]))
    | st.builds(Missing, _of_team, st.integers(0, 6), st.sampled_from([(), (0, 2), (31,)]))
    | _orders
    | _orders
)
_roll = [Census(True, 1, 9, number, 2, 0, 1, piconet) for number, piconet in enumerate(_TEAM.piconets) if piconet]


@pytest.mark.slow
@given(st.integers(0, 2), st.booleans(), st.lists(st.tuples(_wide, st.sampled_from([0, 1, 2])), max_size=30))
def test_well_formed_wide_frames_of_any_content_never_raise(
    me: int, called_up: bool, frames: list[tuple[WidePacket, int]]
) -> None:
    machine = started(me, 5, piconet_size=3)
    neighbours = [robot for robot in range(3) if robot != me]
    for peer in neighbours:
        machine.link(Discovered(peer), 1)
        machine.link(Connected(peer, Role.SLAVE), 2)
    machine.link(InquiryComplete(tuple(neighbours)), 2)
    machine.link(Connected(neighbours[0], Role.MASTER), 2)
    if called_up:
        first: list[WidePacket] = [Welcome(0, 2, 0, 1), *_roll]
        frames = [(packet, 0) for packet in first] + frames
    for now, (packet, source) in enumerate(frames, 3):
        machine.receive(encode(packet, _TEAM), Reception(neighbours[source % 2], False), now)
        machine.link(Fate(1, Outcome.DELIVERED), now)
        machine.wake(now)
        deadline = machine.wake_at()
        assert deadline is None or deadline > now
        machine.outbox()


# ------------------------------------------------------------------ the coordinator


def said(machine: Pseudonet) -> list[object]:
    """Return what the machine wants done, with its packets decoded."""
    directory = machine.application.broadcast.registry.directory  # type: ignore[union-attr]
    return [
        (item.destination, decode(item.payload, directory)) if isinstance(item, Outgoing) else item
        for item in machine.outbox()
    ]


def coordinator(topology: str, size: int = 6, found: int | None = None) -> Pseudonet:
    """Return robot 0 of *size*, in piconets of three, that has found the others; robot r at an offset of 1000 r."""
    machine = started(0, size, piconet_size=3, topology=topology, inquiries=1)
    peers = tuple(range(1, size if found is None else found + 1))
    for peer in peers:
        machine.link(Discovered(peer, -1000 * peer % CLOCKS), 1)
    machine.outbox()
    machine.link(InquiryComplete(peers), 1)
    return machine


def connect(machine: Pseudonet, now: Time) -> list[object]:
    """Let the page succeed that was asked for last, and wait until the next one is asked for."""
    (page,) = [item for item in said(machine) if isinstance(item, Page)]
    machine.link(Connected(page.peer, Role.MASTER, 5, 6), now)
    done = said(machine)
    machine.wake(now + S)
    return done


def test_the_coordinator_of_a_ring_tells_each_master_whom_to_page_with_clocks_relative_to_the_masters() -> None:
    machine = coordinator("ring")
    connect(machine, 2 * S)  # robot 1 is to be a master
    orders = connect(machine, 4 * S)  # robot 2 too
    # piconets: 0 with 3 and 2; 1 with 4 and 0; 2 with 5 and 1
    assigned = [
        (to, packet) for to, packet in (o for o in orders if isinstance(o, tuple)) if isinstance(packet, Assignment)
    ]
    assert assigned == [
        (1, Assignment(1, 3, 0, 1, 2, 1, 4, (1000 - 4000) % CLOCKS)),
        (1, Assignment(1, 3, 0, 1, 2, 2, 0, 1000)),
        (2, Assignment(2, 3, 0, 1, 2, 1, 5, (2000 - 5000) % CLOCKS)),
        (2, Assignment(2, 3, 0, 1, 2, 2, 1, (2000 - 1000) % CLOCKS)),
    ]
    assert [to for to, packet in (o for o in orders if isinstance(o, tuple)) if isinstance(packet, Welcome)] == [2]
    assert Share(96, ((0, 0, 32),), 0) in orders


def test_a_master_that_is_no_slave_of_the_coordinators_is_left_once_it_has_been_told() -> None:
    machine = coordinator("ring")
    connect(machine, 2 * S)
    connect(machine, 4 * S)
    machine.link(Fate(1, Outcome.DELIVERED), 5 * S)
    assert said(machine) == [Disconnect(1)]
    machine.link(Lost(1), 5 * S)
    machine.link(Fate(2, Outcome.DELIVERED), 5 * S)
    machine.wake(6 * S)
    assert said(machine) == [Page(3)]  # its only other slave
    assert set(machine.bluetooth.links) == {2}


def test_a_coordinator_that_is_paged_by_a_master_of_the_ring_shares_its_time_at_once() -> None:
    machine = coordinator("ring")
    connect(machine, 2 * S)
    connect(machine, 4 * S)
    for token in (1, 2):
        machine.link(Fate(token, Outcome.DELIVERED), 5 * S)
    machine.wake(6 * S)
    machine.outbox()
    machine.link(Connected(3, Role.MASTER), 7 * S)
    machine.outbox()
    machine.link(Connected(1, Role.SLAVE), 8 * S)
    assert said(machine) == [Share(96, ((0, 0, 32), (1, 32, 32)), 0)]


def test_another_robot_becomes_a_master_where_a_page_fails() -> None:
    machine = coordinator("tree")
    for now, peer in enumerate((1, 2, 3), 2):
        assert Page(peer) in said(machine)
        machine.link(PageFailed(1) if peer == 1 else Connected(peer, Role.MASTER), now * S)
        machine.wake(now * S + S // 2)
    orders = [entry for entry in said(machine) if isinstance(entry, tuple) and isinstance(entry[1], Assignment)]
    assert {(to, order.piconet) for to, order in orders} == {(2, 1), (3, 2)}


def test_those_who_fit_into_one_piconet_need_no_scatternet() -> None:
    machine = coordinator("ring", size=6, found=2)
    for now in (2 * S, 4 * S):
        connect(machine, now)
    assert machine.application.broadcast.members == (0, 1, 2)


# ------------------------------------------------------------------ masters, slaves and bridges


def joined(me: int = 3, master: int = 0) -> Pseudonet:
    machine = started(me, 6, piconet_size=3, topology="ring", stagger_s=40.0)
    machine.link(Connected(master, Role.SLAVE), 1 * S)
    machine.outbox()
    return machine


def hear(machine: Pseudonet, source: int, packet: WidePacket, now: Time) -> None:
    machine.receive(encode(packet, NOBODY), Reception(source, False), now)


def test_a_slave_that_is_welcomed_can_be_paged_by_another_master_and_then_shares_its_time() -> None:
    machine = joined()
    hear(machine, 0, Welcome(0, 3, 0, 1), 2 * S)
    assert said(machine) == [Scan(enabled=True)]
    machine.link(Connected(2, Role.SLAVE), 3 * S)
    assert said(machine) == [Share(64, (), 3)]  # without parts the device is where its last link came up
    hear(machine, 2, Welcome(2, 3, 0, 1), 4 * S)
    assert said(machine)[0] == Share(96, ((0, 0, 32), (2, 64, 32)), 0)


def test_a_designated_master_pages_its_slaves_when_it_knows_all_welcomes_them_and_reports() -> None:
    machine = joined(1)
    hear(machine, 0, Assignment(1, 3, 0, 1, 2, 2, 0, 1000), 2 * S)
    assert said(machine) == []
    hear(machine, 0, Assignment(1, 3, 0, 1, 2, 1, 4, 77), 2 * S)
    assert said(machine) == [Share(96, ((1, 32, 32),), 0), Page(4, 77)]
    machine.link(Lost(0), 3 * S)
    machine.link(Connected(4, Role.MASTER, 5, 6), 3 * S)
    assert said(machine) == [(4, Welcome(1, 3, 0, 1, 5, 6)), Scan(enabled=True)]
    machine.wake(4 * S)
    assert said(machine)[-1] == Page(0, 1000)
    machine.link(Connected(0, Role.MASTER, 5, 6), 5 * S)
    reports = [entry for entry in said(machine) if isinstance(entry, tuple) and isinstance(entry[1], Census)]
    report = Census(False, 0, 0, 1, 3, 0, 1, Piconet(1, (0, 4)))
    assert reports == [(4, report), (0, report)]


def test_a_robot_belongs_to_one_formation_only() -> None:
    machine = joined()
    hear(machine, 0, Welcome(0, 3, 0, 1), 2 * S)
    machine.link(Connected(2, Role.SLAVE), 3 * S)
    machine.outbox()
    hear(machine, 2, Welcome(2, 3, 5, 1), 4 * S)  # of another coordinator
    assert Disconnect(2) in said(machine)
    assert set(machine.bluetooth.links) == {0}


def test_a_formation_that_its_coordinator_has_begun_anew_is_void() -> None:
    machine = joined()
    hear(machine, 0, Welcome(0, 3, 0, 1), 2 * S)
    machine.link(Connected(2, Role.SLAVE), 3 * S)
    machine.outbox()
    hear(machine, 2, Welcome(2, 3, 0, 2), 4 * S)
    assert said(machine) == [Disconnect(2), (0, Dissolution(()))]
    machine.wake(5 * S)
    assert said(machine)[:1] == [Share(64, (), 3)]
    assert machine.bluetooth.links == {}


def test_last_words_are_said_before_links_are_closed() -> None:
    machine = joined()
    hear(machine, 0, Welcome(0, 3, 0, 1), 2 * S)
    for number, content in enumerate((Piconet(0, (3, 2)), Piconet(1, (4, 0)), Piconet(2, (5, 1)))):
        hear(machine, 0, Census(True, 1, 9, number, 3, 0, 1, content), 3 * S)
    (roll,) = [entry[1] for entry in said(machine) if isinstance(entry, tuple)]
    assert isinstance(roll, Message)
    assert (roll.kind, roll.exchange) == (Kind.ROLL, 9)
    assert machine.application.broadcast.members == tuple(range(6))
    hear(machine, 0, Dissolution((4,)), 4 * S)
    assert said(machine) == []
    machine.wake(5 * S)
    assert Disconnect(0) in said(machine)
    machine.wake(6 * S)  # robot 4 is dead, 0 to 2 may come first
    assert machine.wake_at() == 6 * S + 80 * S + 10 * S


def test_a_robot_that_is_never_called_up_forms_a_team_itself() -> None:
    machine = joined()
    hear(machine, 0, Welcome(0, 3, 0, 1), 2 * S)
    machine.outbox()
    machine.wake(2 * S + 50 * S)
    machine.wake(53 * S)
    assert Disconnect(0) in said(machine)
