"""The broadcast room on a medium that a test can look into: who says what when, and what happens when frames fail."""

from dataclasses import replace

import pytest

from cosim.machine import BROADCAST, Fate, Outcome, Outgoing, Reception
from protocols.pseudonet.algorithms.base import UNJUDGED
from protocols.pseudonet.messages import Acknowledgement, Action, Kind, Message, Missing, Reply, Sync, encode
from protocols.pseudonet.upcalls import EXCHANGES, Answered, Broken, Garbage, TeamChanged
from tests.protocols.pseudonet.paper_air import HOP, REPAIR, RETRIES, TIMEOUT, PaperAir

SIZES = range(2, 9)


def direct(source: int, exchange: int, addressee: int) -> Message:
    return Message(source, Kind.ANSWER, exchange, 1, 2, Action.STAY, UNJUDGED, False, addressee, Reply.DIRECT, (3, 4))


def test_the_order_of_a_roll_call_is_that_of_figure_9a() -> None:
    air = PaperAir(3)
    air.assemble()
    air.run()
    sync = Sync(0, 1, (0, 1, 2), True, *HOP)
    states = [robot.exchanged[0].messages[robot.room.me] for robot in air.robots]
    assert air.air == [
        (0, BROADCAST, sync),
        (0, BROADCAST, states[0]),
        (0, 1, sync),
        (1, 0, states[1]),
        (0, BROADCAST, states[1]),
        (0, 2, sync),
        (2, 0, states[2]),
        (0, BROADCAST, states[2]),
    ]


@pytest.mark.parametrize("size", SIZES)
def test_an_exchange_makes_all_messages_known_to_all(size: int) -> None:
    air = PaperAir(size, exchanges=5)
    air.assemble()
    air.run()
    for robot in air.robots:
        assert robot.heard[0] == TeamChanged(tuple(range(size)))
        assert [upcall.roll_call for upcall in robot.exchanged] == [True, False, False, False, False]
        for row, exchanged in enumerate(robot.exchanged):
            assert {source: (m.x, m.y) for source, m in exchanged.messages.items()} == {
                s: (s, row) for s in range(size)
            }


@pytest.mark.parametrize("size", SIZES)
def test_an_exchange_takes_4m_minus_2_slots(size: int) -> None:
    air = PaperAir(size, exchanges=2)
    air.assemble()
    air.run()
    frames = [
        (destination, packet) for _, destination, packet in air.air if packet is not None and packet.exchange == 2
    ]
    broadcasts = sum(destination == BROADCAST for destination, _ in frames)
    polls_and_answers = len(frames) - broadcasts
    assert 2 * broadcasts + polls_and_answers == 4 * size - 2  # nobody answers in the second slot of a broadcast


def test_a_team_of_one_exchanges_with_itself() -> None:
    air = PaperAir(1, exchanges=3)
    air.assemble()
    air.run()
    assert air.air == []
    assert [list(upcall.messages) for upcall in air.robots[0].exchanged] == [[0], [0], [0]]


def test_exchanges_are_numbered_modulo_256() -> None:
    air = PaperAir(3, exchanges=600)
    air.assemble()
    air.run()
    for robot in air.robots:
        numbers = [upcall.messages[0].exchange for upcall in robot.exchanged]
        assert numbers == [number % EXCHANGES for number in range(1, 601)]
        assert [upcall.messages[2].y for upcall in robot.exchanged] == list(range(600))


@pytest.mark.parametrize("frames", [4, 8])
def test_a_repeated_message_is_not_kept_until_the_numbers_come_back(frames: int) -> None:
    air = PaperAir(3)
    air.assemble()
    air.run(frames)  # within the exchange that it belongs to, and after that
    repeated, master = air.air[3][2], air.robots[0].room
    assert isinstance(repeated, Message)
    master.receive(encode(repeated), Reception(1, False), air.now)
    assert master._early == {}


def test_a_slave_that_has_missed_a_whole_roll_call_joins_the_next() -> None:
    air = PaperAir(4)
    air.assemble()
    air.run()
    slave = air.robots[1]
    slave.room.receive(encode(Sync(0, slave.room.exchange + 2, (0, 1), True)), Reception(0, True), air.now)
    assert slave.heard[-1] == TeamChanged((0, 1))


def test_an_answer_for_another_robot_is_none_of_mine() -> None:
    air = PaperAir(4)
    air.assemble()
    air.run()
    heard = list(air.robots[1].heard)
    air.robots[1].room.receive(encode(direct(0, 2, addressee=3)), Reception(0, True), air.now)
    assert air.robots[1].heard == heard


@pytest.mark.parametrize("count", [254, 255, 256])
def test_a_roll_call_is_joined_when_the_numbers_wrap(count: int) -> None:
    air = PaperAir(3, exchanges=count)
    air.assemble()
    air.run()
    air.robots[0].room.lost(2, air.now)
    air.run()
    for robot in air.robots[:2]:
        assert robot.heard[-2] == TeamChanged((0, 1))
        assert robot.exchanged[-1].messages.keys() == {0, 1}
        assert robot.exchanged[-1].roll_call


def test_an_empty_answer_is_polled_again() -> None:
    air = PaperAir(3)
    air.empty[1] = RETRIES
    air.assemble()
    air.run()
    polls = [frame for frame in air.air if frame[:2] == (0, 1)]
    assert len(polls) == RETRIES + 1
    assert all(robot.exchanged[0].messages.keys() == {0, 1, 2} for robot in air.robots)


def test_a_slave_whose_answers_stay_empty_is_dropped() -> None:
    air = PaperAir(3)
    air.empty[1] = RETRIES + 1
    air.assemble()
    air.run()
    assert not air.robots[1].alive
    for robot in (air.robots[0], air.robots[2]):
        assert robot.heard[-2] == TeamChanged((0, 2))
        assert robot.exchanged[-1].messages.keys() == {0, 2}


def test_a_slave_that_is_released_is_polled_no_more_and_the_exchange_of_the_others_is_shorter() -> None:
    air = PaperAir(3)
    air.assemble()
    air.run()
    before = len(air.air)
    master = air.robots[0].room
    assert [robot for robot in master.members if master.dispensable(robot)] == [1, 2]
    master.release((1,), air.now)
    air.run()
    assert not air.robots[1].alive  # its link is taken down
    later = air.air[before:]
    assert not [frame for frame in later if 1 in frame[:2]]
    assert len(later) == 5  # the new roll; the master's message; a poll, its answer, and the answer for all
    for robot in (air.robots[0], air.robots[2]):
        assert robot.heard[-2] == TeamChanged((0, 2))
        assert robot.exchanged[-1].messages.keys() == {0, 2}


def test_a_poll_without_an_answer_ends_when_its_time_is_over() -> None:
    air = PaperAir(3)
    air.robots[1].alive = False
    air.assemble()
    air.run(frames=3)
    assert air.robots[0].room.deadline == TIMEOUT  # the poll was handed down at 0
    air.robots[0].room.wake(TIMEOUT - 1)
    assert air.robots[0].room.members == (0, 1, 2)
    air.run()
    assert [upcall for upcall in air.robots[0].heard if isinstance(upcall, TeamChanged)] == [
        TeamChanged((0, 1, 2)),
        TeamChanged((0, 2)),
    ]
    assert air.robots[2].exchanged[-1].messages.keys() == {0, 2}
    assert air.robots[0].room.deadline is None


@pytest.mark.parametrize("outcome", [Outcome.NO_LINK, Outcome.FLUSHED])
def test_a_poll_that_cannot_be_sent_drops_its_robot_at_once(outcome: Outcome) -> None:
    air = PaperAir(3)
    air.assemble()
    air.run(frames=2)
    poll = next(item for item in air.robots[0].room.out if isinstance(item, Outgoing) and item.token is not None)
    air.robots[0].room.fate(Fate(poll.token or 0, outcome), air.now)
    assert air.robots[0].room.members == (0, 2)


def test_a_fate_that_comes_late_is_not_taken_for_that_of_the_present_poll() -> None:
    air = PaperAir(3)
    air.assemble()
    air.run(frames=4)  # slave 1 has answered, slave 2 is polled next
    air.robots[0].room.fate(Fate(1, Outcome.NO_LINK), air.now)
    air.run()
    assert air.robots[0].room.members == (0, 1, 2)


def test_a_slave_that_is_dropped_learns_so_from_the_roll_call() -> None:
    air = PaperAir(3)
    air.assemble()
    air.run()
    air.robots[0].room.lost(2, air.now)
    sync = next(item for item in air.robots[0].room.out if isinstance(item, Outgoing))
    air.robots[2].room.receive(sync.payload, Reception(0, True), air.now)
    assert air.robots[2].heard[-1] == Broken()


def test_a_slave_that_has_missed_a_broadcast_is_sent_it_again_and_nobody_falls_out_of_step() -> None:
    air = PaperAir(3, exchanges=3)
    air.deaf.add((1, 7))  # robot 2's message of the roll call, the last of its eight frames
    air.assemble()
    air.run()
    assert [(source, packet) for source, _, packet in air.air if isinstance(packet, Missing)] == [
        (1, Missing(1, 1, (2,)))
    ]
    again = next(packet for source, to, packet in air.air if (source, to) == (0, 1) and isinstance(packet, Message))
    assert again == air.robots[2].exchanged[0].messages[2]
    assert not any(message.busy for robot in air.robots for e in robot.exchanged for message in e.messages.values())
    check_equal_exchanges(air)


def test_a_slave_asks_by_itself_for_the_end_of_the_last_exchange() -> None:
    air = PaperAir(3)
    air.deaf.add((1, 7))
    air.assemble()
    air.run()
    assert air.robots[1].exchanged == []
    asks_at = air.robots[1].room.deadline
    assert asks_at is not None
    assert air.now < asks_at <= air.now + REPAIR
    air.robots[1].room.wake(asks_at)
    air.robots[1].fill()
    air.answer_of(1)
    air.run()
    check_equal_exchanges(air)
    assert air.robots[1].room.deadline is None


@pytest.mark.parametrize("loss", [0.2, 0.5])
@pytest.mark.parametrize("size", [2, 5, 8])
def test_however_many_broadcasts_are_lost_all_see_the_same_exchanges(size: int, loss: float) -> None:
    for seed in range(20):
        air = PaperAir(size, exchanges=30)
        air.lose(loss, seed)
        air.assemble()
        air.run_to_the_end()
        check_equal_exchanges(air)
        assert all(robot.room.members == tuple(range(size)) for robot in air.robots)


def check_equal_exchanges(air: PaperAir) -> None:
    """Fail unless all robots have completed the same exchanges, all that there were to be."""
    master = air.robots[0].exchanged
    assert len(master) == air.exchanges
    assert all(robot.exchanged == master for robot in air.robots)


def test_a_slave_that_has_missed_the_roll_call_joins_with_its_poll() -> None:
    air = PaperAir(3)
    air.deaf |= {(2, 0), (2, 1), (2, 4)}
    air.assemble()
    air.run()
    assert air.robots[2].heard[0] == TeamChanged((0, 1, 2))
    assert air.robots[0].exchanged[0].messages.keys() == {0, 1, 2}


def test_an_answer_reaches_its_addressee_alone_by_way_of_the_master() -> None:
    air = PaperAir(4, exchanges=2)
    air.assemble()
    answer = direct(1, 1, addressee=3)
    air.robots[1].room.answer(answer)
    assert air.robots[1].room.out == []  # before a robot knows its master it can send to nobody
    air.run(frames=1)
    air.robots[1].room.answer(answer)
    air.robots[1].fill()
    air.run()
    assert [frame for frame in air.air if frame[2] == answer] == [(1, 0, answer), (0, 3, answer)]
    assert [Answered(answer) in robot.heard for robot in air.robots] == [False, False, False, True]
    assert all(len(robot.exchanged) == 2 for robot in air.robots)


def test_the_master_answers_and_is_answered_without_a_detour() -> None:
    air = PaperAir(3, exchanges=2)
    air.assemble()
    air.run(frames=1)
    to_master, to_slave = direct(1, 1, addressee=0), direct(0, 1, addressee=2)
    air.robots[1].room.answer(to_master)
    air.robots[1].fill()
    air.robots[0].room.answer(to_slave)
    air.run()
    assert Answered(to_master) in air.robots[0].heard
    assert [frame for frame in air.air if frame[2] in (to_master, to_slave)] == [(0, 2, to_slave), (1, 0, to_master)]
    assert Answered(to_slave) in air.robots[2].heard


@pytest.mark.parametrize(("kind", "acknowledged"), [(Kind.HELP, True), (Kind.TRAP, True), (Kind.STATE, False)])
def test_the_master_acknowledges_where_reliability_is_asked_for(kind: Kind, acknowledged: bool) -> None:
    air = PaperAir(2, acknowledge=True)
    air.assemble()
    air.run(frames=1)
    master = air.robots[0].room
    master.out.clear()
    master.receive(encode(replace(air.robots[1].state(1), kind=kind)), Reception(1, False), air.now)
    expected = [Outgoing(1, encode(Acknowledgement(0, 1)))] if acknowledged else []
    assert master.out == expected


def test_bytes_that_are_no_packet_are_reported_and_their_message_is_sent_again() -> None:
    air = PaperAir(2, acknowledge=True)
    air.assemble()
    air.run(frames=1)
    slave, master = air.robots[1], air.robots[0]
    damaged = slave.queue.popleft().payload[:-1] + b"\x00"
    master.room.receive(damaged, Reception(1, False), air.now)
    assert master.heard[-1] == Garbage("the CRC does not fit")
    air.run()
    assert (0, 1, Acknowledgement(0, 1, negative=True)) in air.air
    assert master.exchanged[0].messages[1] == replace(slave.state(1), y=0)
    assert master.room.members == (0, 1)


def test_without_acknowledgements_bytes_that_are_no_packet_are_only_reported() -> None:
    air = PaperAir(2)
    air.assemble()
    air.run(frames=1)
    master = air.robots[0]
    master.room.out.clear()
    master.room.receive(b"\x00", Reception(1, False), air.now)
    assert master.heard[-1] == Garbage("the CRC does not fit")
    assert master.room.out == []


@pytest.mark.parametrize(
    "packet",
    [
        Message(5, Kind.STATE, 1, 0, 0, Action.STAY, UNJUDGED),
        Message(2, Kind.STATE, 1, 0, 0, Action.STAY, UNJUDGED),
        Sync(1, 9, (1,), True),
        Acknowledgement(1, 1, negative=True),
    ],
    ids=["stranger", "in another's name", "sync", "acknowledgement"],
)
def test_the_master_takes_only_messages_of_its_slaves_own(packet: Message | Sync | Acknowledgement) -> None:
    air = PaperAir(3)
    air.assemble()
    air.run(frames=2)
    air.robots[0].room.receive(encode(packet), Reception(1, False), air.now)
    assert air.robots[0].room._early == {}
    air.run()
    assert air.robots[0].exchanged[0].messages == air.robots[1].exchanged[0].messages
    assert [(m.x, m.source) for m in air.robots[0].exchanged[0].messages.values()] == [(0, 0), (1, 1), (2, 2)]


def test_a_slave_listens_to_nobody_but_its_master() -> None:
    air = PaperAir(3, exchanges=2)
    air.assemble()
    air.run()
    slave = air.robots[1]
    heard = len(slave.heard)
    slave.room.receive(encode(Sync(2, 40, (1, 2), True)), Reception(2, True), air.now)
    slave.room.receive(encode(air.robots[2].state(3)), Reception(2, False), air.now)
    assert len(slave.heard) == heard
    assert slave.room.find_master() == 0
    assert slave.room.members == (0, 1, 2)
