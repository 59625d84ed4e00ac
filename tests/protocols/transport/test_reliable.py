"""Transports and their messages: these arrive once and in order or come back, and what that costs."""

from cosim.machine import Connected, Fate, Outcome, Outgoing, Role
from cosim.units import MS, S
from protocols.transport.frames import PART_OVERHEAD, WINDOW, Ack, Part, Publication
from protocols.transport.transport import Message
from tests.protocols.transport.lossy_air import Air
from tests.protocols.transport.transport_alone import PLAN, all_sent, hears, sent, transport

# ---------------------------------------------------------------- messages


def test_a_plan_arrives_at_ten_percent_loss() -> None:
    air = Air(2, loss=0.1)
    air.send(0, 1, PLAN)
    took = air.run_until(lambda: bool(air.messages[1]))
    assert air.messages[1] == [Message(0, PLAN)]
    assert took < 5 * S
    air.run(30 * S)
    assert air.returned[0] == []
    assert [transport.wake_at() for transport in air.transports] == [None, None]


def test_without_loss_each_part_is_sent_once_and_every_fourth_is_acknowledged() -> None:
    air = Air(2)
    air.send(0, 1, PLAN)
    air.run(5 * S)
    parts = -(-len(PLAN) // (200 - PART_OVERHEAD))
    sent = [teller for teller, _ in air.frames]
    assert sent.count(0) == parts == 102
    assert sent.count(1) <= -(-parts // 4) + 1
    assert max(len(data) for _, data in air.frames) == 200
    assert air.transports[0].counts.frames == 102
    assert air.transports[0].counts.octets == len(PLAN) + 102 * PART_OVERHEAD
    assert air.transports[0].counts.parts_again == 0


def test_what_is_lost_is_sent_again_and_hardly_anything_else() -> None:
    air = Air(2, loss=0.1)
    air.send(0, 1, 10 * PLAN)
    air.run_until(lambda: bool(air.messages[1]))
    parts = -(-len(10 * PLAN) // (200 - PART_OVERHEAD))
    expected = parts * 0.1 / 0.9
    assert 0.6 * expected < air.transports[0].counts.parts_again < 1.5 * expected


def test_messages_of_any_size_arrive_in_order_and_also_empty_ones() -> None:
    air = Air(2, loss=0.2, doubled=0.2, jitter=300 * MS)
    messages = [b"", b"a", PLAN[:177], PLAN[:178], PLAN[:179], b"", PLAN, b"z"]
    for each in messages:
        air.send(0, 1, each)
    air.run(60 * S)
    assert [message.payload for message in air.messages[1]] == messages


def test_a_message_to_oneself_has_arrived() -> None:
    robot = transport()
    assert robot.send(0, b"me", 0) == 1
    assert robot.messages() == [Message(0, b"me")]
    assert robot.messages() == []
    assert robot.drain() == []


def test_both_ways_and_among_all_at_once() -> None:
    air = Air(4, loss=0.1, jitter=50 * MS)
    for source in range(4):
        for destination in range(4):
            for number in range(5):
                air.send(source, destination, bytes([source, destination, number]))
    air.run(30 * S)
    for me in range(4):
        for source in range(4):
            got = [message.payload for message in air.messages[me] if message.source == source]
            assert got == [bytes([source, me, number]) for number in range(5)]


def test_a_message_to_who_never_answers_comes_back_after_the_time_to_give_up() -> None:
    air = Air(2, give_up_s=20.0)
    air.reach = lambda teller, hearer: False
    first = air.send(0, 1, b"first")
    air.run(10 * S)
    second = air.send(0, 1, b"second")
    air.run(9 * S)
    assert air.returned[0] == []
    air.run(5 * S)  # it is found out at the end of a wait, of 4 s at most
    assert air.returned[0] == [(1, first)]
    air.run(10 * S)
    assert air.returned[0] == [(1, first), (1, second)]
    assert air.transports[0].wake_at() is None


def test_who_never_answers_is_tried_ever_more_rarely() -> None:
    air = Air(2, give_up_s=100.0)
    air.reach = lambda teller, hearer: False
    air.send(0, 1, b"x")
    air.run(20 * S)
    assert air.sent_at == [second * S for second in (0, 1, 3, 7, 11, 15, 19)]


def test_what_comes_after_a_message_that_was_given_up_arrives() -> None:
    air = Air(2, give_up_s=5.0)
    air.send(0, 1, b"before")
    air.run(S)
    air.reach = lambda teller, hearer: False
    lost = air.send(0, 1, PLAN)
    air.run(4 * S)
    later = air.send(0, 1, b"after")
    air.run_until(lambda: bool(air.returned[0]))
    assert air.returned[0] == [(1, lost)]
    air.reach = lambda teller, hearer: True
    air.run(10 * S)
    assert [message.payload for message in air.messages[1]] == [b"before", b"after"]
    assert later not in dict(air.returned[0])


def test_who_was_out_of_reach_for_less_than_the_time_to_give_up_gets_all() -> None:
    air = Air(2, loss=0.1)
    air.send(0, 1, PLAN)
    air.run(50 * MS)
    air.reach = lambda teller, hearer: False
    air.run(50 * S)
    assert air.messages[1] == []
    air.reach = lambda teller, hearer: True
    air.run(10 * S)
    assert air.messages[1] == [Message(0, PLAN)]


def test_who_is_heard_again_is_tried_at_once() -> None:
    air = Air(2, retry_most_s=30.0)
    air.reach = lambda teller, hearer: False
    air.send(0, 1, b"x")
    air.run(20 * S)
    air.reach = lambda teller, hearer: True
    air.publish(1, 0, b"here")
    assert air.run_until(lambda: bool(air.messages[1])) <= 1200 * MS


def test_being_heard_shortens_no_time_to_give_up() -> None:
    """Its news arrive, but what is sent to it does not."""
    air = Air(2, give_up_s=30.0)
    air.reach = lambda teller, hearer: teller == 1
    air.send(0, 1, b"x")
    for _ in range(140):
        air.publish(1, 0, b"here")
        air.run(200 * MS)
    assert air.returned[0] == []
    air.run(6 * S)
    assert len(air.returned[0]) == 1


def test_messages_for_who_is_forgotten_come_back_at_once() -> None:
    air = Air(3)
    air.reach = lambda teller, hearer: hearer != 1
    numbers = [air.send(0, 1, PLAN), air.send(0, 1, b"b")]
    air.send(0, 2, b"c")
    air.forget(0, 1)
    assert air.returned[0] == [(1, number) for number in numbers]
    air.reach = lambda teller, hearer: True
    air.send(0, 1, b"again")
    air.run(5 * S)
    assert [message.payload for message in air.messages[1]] == [b"again"]
    assert [message.payload for message in air.messages[2]] == [b"c"]
    assert air.returned[0] == [(1, number) for number in numbers]


def test_a_full_radio_takes_no_more() -> None:
    robot = transport(in_device=3)
    robot.send(1, PLAN, 0)
    assert len(robot.drain()) == 3
    robot.wake(100 * MS)
    assert robot.drain() == []
    robot.send(2, b"another neighbour", 100 * MS)
    (item,) = robot.drain()
    assert isinstance(item, Outgoing)
    assert item.destination == 2
    assert item.token is not None
    robot.link(Fate(item.token + 5, Outcome.DELIVERED), 200 * MS)  # nobody's
    assert robot.drain() == []


def test_what_the_radio_holds_is_not_sent_again() -> None:
    robot = transport(fate_s=3.0)
    robot.send(1, b"x", 0)
    assert len(robot.drain()) == 1
    for time in (1 * S, 2 * S, 2900 * MS):
        robot.wake(time)
        assert robot.drain() == []
    robot.wake(3 * S)
    assert len(robot.drain()) == 1


def test_who_waits_for_an_answer_or_owes_one_is_not_settled_but_news_that_a_radio_keeps_are_nobody_s_business() -> None:
    robot = transport(spread_s=0.0, fate_s=3.0)
    robot.publish(0, b"news", 0)
    assert [type(frame.body) for _, frame in sent(robot)] == [Publication]  # the radio is off: it tells no fate
    assert robot.wake_at() == 3 * S
    assert robot.settled
    robot.send(1, b"letter", 0)
    assert not robot.settled
    robot.forget(1, 0)
    assert robot.settled
    hears(robot, 1, Part(0, 0, 0, 2, b"half a letter"))
    assert not robot.settled
    all_sent(robot, 0)
    robot.wake(1 * S)
    assert robot.settled


def test_a_radio_that_tells_no_fates_slows_down_but_stops_nothing() -> None:
    air = Air(2, fate_s=0.5)
    air.fates = False
    air.send(0, 1, PLAN)
    air.run(60 * S)
    assert air.messages[1] == [Message(0, PLAN)]


def test_no_more_parts_are_on_the_way_than_the_window_allows() -> None:
    robot = transport(window=5, in_device=100)
    robot.send(1, PLAN, 0)
    numbers = [frame.body.number for frame in all_sent(robot, 0) if isinstance(frame.body, Part)]
    assert numbers == [0, 1, 2, 3, 4]
    hears(robot, 1, Ack(0, 0, 0b1))  # part 1
    assert all_sent(robot, 0) == []
    hears(robot, 1, Ack(0, 2, 0))
    assert [frame.body[0] for frame in all_sent(robot, 0)] == [5, 6]


def test_a_part_that_three_later_ones_have_overtaken_is_sent_again_at_once() -> None:
    robot = transport(window=8, in_device=100)
    robot.send(1, PLAN, 0)
    all_sent(robot, 0)
    hears(robot, 1, Ack(0, 0, 0b10))  # part 2: overtaken by one, and by two
    assert [frame.body[0] for frame in all_sent(robot, 0)] == []
    hears(robot, 1, Ack(0, 0, 0b110))
    assert [frame.body[0] for frame in all_sent(robot, 0)] == [0]
    hears(robot, 1, Ack(0, 0, 0b1110))
    assert [frame.body[0] for frame in all_sent(robot, 0)] == [1]


def test_an_answer_resets_the_time_to_give_up() -> None:
    """Two parts of one message, each answered after most of that time."""
    robot = transport(window=1, give_up_s=20.0, octets=23)
    robot.send(1, b"xy", 0)
    now = 0
    for number in (1, 2):
        for _ in range(7):
            all_sent(robot, now)
            now = robot.wake_at() or 0
            if now < (19 * number - 2) * S:
                robot.wake(now)
        assert robot.returned() == []
        hears(robot, 1, Ack(0, number, 0), now)
    assert robot.wake_at() is None


def test_only_answers_to_what_was_sent_once_are_timed() -> None:
    """One that comes 20 ms after the second copy may answer the first: the wait stays what it was, a second."""
    robot = transport(window=1, octets=23)
    robot.send(1, b"xyz", 0)
    all_sent(robot, 0)
    robot.wake(S)
    all_sent(robot, S)
    hears(robot, 1, Ack(0, 1, 0), S + 20 * MS)
    assert robot.wake_at() == 2 * S + 20 * MS
    all_sent(robot, S + 20 * MS)
    hears(robot, 1, Ack(0, 2, 0), S + 40 * MS)
    assert robot.wake_at() == S + 240 * MS  # 20 ms and four times half of that, but 200 ms at least


def test_every_fourth_part_is_answered_at_once_and_others_after_a_while() -> None:
    robot = transport(ack_s=0.02)
    for number in range(3):
        hears(robot, 1, Part(number, 0, number, 99, b""))
    assert all_sent(robot, 0) == []
    hears(robot, 1, Part(3, 0, 3, 99, b""))
    assert [frame.body for frame in all_sent(robot, 0)] == [Ack(0, 4, 0)]
    hears(robot, 1, Part(4, 0, 4, 99, b""), S)
    assert robot.wake_at() == S + 20 * MS
    robot.wake(S + 20 * MS)
    assert [frame.body for frame in all_sent(robot, S)] == [Ack(0, 5, 0)]


def test_who_does_not_answer_is_sent_two_parts_at_a_time() -> None:
    robot = transport(window=8, in_device=100)
    robot.send(1, PLAN, 0)
    assert len(all_sent(robot, 0)) == 8
    robot.wake(S)
    assert [frame.body[0] for frame in all_sent(robot, S)] == [0, 1]


def test_robots_to_which_messages_go_take_turns() -> None:
    """Over one neighbour, whose place in the radio they share: a master."""
    robot = transport(me=0, size=4, in_device=1, links={})
    robot.link(Connected(3, Role.SLAVE), 0)
    robot.links.leading = False  # type: ignore[union-attr]
    robot.link(Connected(3, Role.SLAVE), 0)
    for other in (1, 2):
        robot.send(other, PLAN, 0)
    assert [frame.destination for frame in all_sent(robot, 0)][:6] == [1, 2, 1, 2, 1, 2]


def test_parts_far_ahead_are_not_kept_but_answered() -> None:
    robot = transport()
    for ahead in (1, WINDOW, WINDOW + 1):
        hears(robot, 1, Part(6 + ahead, 6, 1, 99, b""))
    (answer,) = [frame.body for frame in all_sent(robot, 0)][-1:]
    assert answer == Ack(0, 6, 1 | 1 << WINDOW - 1)


# ---------------------------------------------------------------- booting again


def test_a_robot_that_boots_again_begins_a_new_stream() -> None:
    air = Air(2)
    air.send(0, 1, b"old")
    air.run(S)
    air.boot(0)
    air.send(0, 1, b"new")
    air.run(S)
    assert [message.payload for message in air.messages[1]] == [b"old", b"new"]


def test_who_boots_again_in_mid_message_gets_the_whole_of_it() -> None:
    air = Air(2)
    air.send(0, 1, b"before")
    air.run(S)
    air.send(0, 1, PLAN)
    air.run(50 * MS)
    assert [message.payload for message in air.messages[1]] == [b"before"]
    air.boot(1)
    air.run(10 * S)
    assert [message.payload for message in air.messages[1]] == [b"before", PLAN]


def test_an_acknowledgement_of_a_former_incarnation_is_none() -> None:
    robot = transport(start=5 * MS)
    robot.send(1, b"x", 5 * MS)
    all_sent(robot, 5 * MS)
    hears(robot, 1, Ack(4, 1, 0), 6 * MS)
    assert robot.wake_at() is not None
    hears(robot, 1, Ack(5, 1, 0), 6 * MS)
    assert robot.wake_at() is None


def test_late_frames_of_a_former_incarnation_disturb_nothing() -> None:
    robot = transport(1)
    for life in (1, 2):
        hears(robot, 0, Part(0, 0, 0, 1, bytes([life])), incarnation=life)
    hears(robot, 0, Part(0, 0, 0, 1, b"\x01"), incarnation=1)
    hears(robot, 0, Part(1, 0, 0, 1, b"\x03"), incarnation=2)
    assert [message.payload for message in robot.messages()] == [b"\x01", b"\x02", b"\x03"]
