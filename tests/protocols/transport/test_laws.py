"""The laws of transports: bytes raise nothing, clocks may jump, and nothing is lost silently."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.machine import Address, Outgoing, Reception
from cosim.units import MS, S, Time
from protocols.transport.frames import Ack, Frame, Part, Publication, encode
from protocols.transport.streams import Outbound, Pace
from protocols.wire import BadBytes
from tests.protocols.transport.lossy_air import Air
from tests.protocols.transport.transport_alone import PLAN, all_sent, hears, transport
from tests.tiers import tiers

# ---------------------------------------------------------------- laws


BAD = {
    "junk": b"\x4cjunk",
    "another team": encode(Frame(3, 0, 0, Ack(0, 0, 0))),
    "to another team": encode(Frame(1, 3, 0, Ack(0, 0, 0))),
    "answer to nothing": encode(Frame(1, 0, 0, Ack(0, 0, 0))),
    "answer to more than was sent": encode(Frame(2, 0, 0, Ack(0, 2, 0))),
    "answer to more than was sent, beyond": encode(Frame(2, 0, 0, Ack(0, 0, 1))),
}


@pytest.mark.parametrize("case", BAD)
def test_what_nobody_can_mean_becomes_an_event(case: str) -> None:
    robot = transport()
    robot.send(2, b"x", 0)
    robot.drain()
    robot.receive(BAD[case], Reception(2, False), 0)
    assert robot.bad == [BadBytes(2, len(BAD[case]))]
    assert robot.drain() == []
    assert robot.messages() == []


@given(st.lists(st.binary(max_size=60), max_size=20))
def test_bytes_of_any_kind_raise_nothing(junk: list[bytes]) -> None:
    robot = transport()
    for data in junk:
        robot.receive(data, Reception(1, False), 0)
        robot.receive(b"\x4c" + data, Reception(1, True), 0)


@given(
    st.lists(st.builds(Part, *[st.integers(0, 99)] * 2, st.integers(0, 3), st.integers(1, 4), st.binary(max_size=2)))
)
def test_parts_of_any_kind_raise_nothing(parts: list[Part]) -> None:
    robot = transport()
    for part in parts:
        if part.place < part.parts and part.number >= max(part.place, part.oldest):
            hears(robot, 1, part)


@given(st.lists(st.tuples(st.integers(0, 120), st.integers(0, 2**32 - 1), st.integers(0, 2)), max_size=20))
def test_answers_of_any_kind_raise_nothing(answers: list[tuple[int, int, int]]) -> None:
    robot = transport()
    robot.send(1, PLAN, 0)
    for number, beyond, life in answers:
        all_sent(robot, 0)
        hears(robot, 1, Ack(0, number, beyond), incarnation=life)
    robot.wake(100 * S)


def test_own_frames_that_come_back_change_nothing() -> None:
    one, other = transport(), transport()
    for robot in (one, other):
        robot.send(1, b"x", 0)
        robot.publish(0, b"y", 0)
    for item in one.drain():
        assert isinstance(item, Outgoing)
        one.receive(item.payload, Reception(0, True), 0)
    other.drain()
    assert one.drain() == []
    assert (one.messages(), one.published(), one.bad) == ([], [], [])
    assert one.wake_at() == other.wake_at()
    assert one.heard(0) is None


def test_a_later_start_makes_all_later_by_as_much() -> None:
    def outline(start: Time) -> list[tuple[Time, int, int]]:
        air = Air(3, loss=0.2, jitter=40 * MS, start=start)
        log = []
        for number in range(6):
            air.send(number % 2, 2, PLAN[: 900 * number])
            for _ in range(10):
                air.run(100 * MS)
                log.append((air.now - start, len(air.frames), len(air.messages[2])))
        return log

    assert outline(0) == outline(86_399 * S + 123_456_789)


def test_a_clock_that_is_set_back_delays_what_is_sent_again_by_no_more_than_a_tick() -> None:
    robot = transport()
    start = 1000 * S
    robot.tick((), start)
    robot.send(1, b"x", start)
    all_sent(robot, start)
    hears(robot, 2, Publication(0, 1, b""), start)
    robot.tick((), 10 * S)
    assert robot.wake_at() == 11 * S
    assert robot.heard(2) == 10 * S
    robot.wake(11 * S)
    assert len(all_sent(robot, 11 * S)) == 1


def test_a_clock_that_jumps_ahead_gives_nothing_up() -> None:
    robot = transport(give_up_s=60.0)
    robot.send(1, b"x", 0)
    all_sent(robot, 0)
    robot.wake(10_000 * S)
    assert robot.returned() == []
    assert len(all_sent(robot, 10_000 * S)) == 1


# ---------------------------------------------------------------- nothing is lost silently


def check_nothing_is_lost(seed: int, loss: float, jitter: Time, outage: tuple[int, int], messages: int) -> None:
    """What was posted has arrived once and in order, or come back; of what came back some may have arrived."""
    air = Air(3, loss=loss, doubled=0.1, jitter=jitter, seed=seed, give_up_s=6.0, retry_most_s=2.0)
    posted: dict[tuple[Address, Address], dict[int, bytes]] = {(a, b): {} for a in range(3) for b in range(3) if a != b}
    for step in range(messages):
        outside = outage[0] <= step < outage[1]
        air.reach = (lambda teller, hearer: 1 not in (teller, hearer)) if outside else lambda teller, hearer: True
        pair = list(posted)[step * 5 % 6]
        payload = bytes([step]) * (step * 131 % 1500)
        posted[pair][air.send(*pair, payload)] = payload
        air.run((step * 7 % 5) * 300 * MS)
    air.run(60 * S)
    for (source, destination), sent in posted.items():
        back = [number for to, number in air.returned[source] if to == destination]
        assert len(set(back)) == len(back)
        assert set(back) <= set(sent)
        got = [message.payload for message in air.messages[destination] if message.source == source]
        surely = [payload for number, payload in sent.items() if number not in back]
        rest = iter(sent.values())
        assert all(any(payload == each for each in rest) for payload in got)  # in order, and each once
        left = iter(got)
        assert all(any(payload == each for each in left) for payload in surely)
    assert all(robot.wake_at() is None and robot.bad == [] for robot in air.transports)


CASES = (
    st.integers(0, 2**32 - 1),
    st.sampled_from([0.0, 0.1, 0.4, 0.7]),
    st.sampled_from([0, 5 * MS, 400 * MS]),
    st.tuples(st.integers(0, 20), st.integers(0, 40)),
    st.integers(1, 30),
)


@tiers(12, 100, *CASES)
def test_nothing_is_lost_silently(seed: int, loss: float, jitter: Time, outage: tuple[int, int], messages: int) -> None:
    check_nothing_is_lost(seed, loss, jitter, outage, messages)


# ---------------------------------------------------------------- robots that boot again, and frames that are late


PACE = Pace(S, 200 * MS, 4 * S, 60 * S)


def message_of_three_parts() -> Outbound:
    outbound = Outbound(16, 10, PACE)
    outbound.enqueue(1, bytes(30), 0)
    send(outbound, 0)
    return outbound


def send(outbound: Outbound, now: Time) -> list[int]:
    numbers = []
    while (number := outbound.due()) is not None:
        outbound.take(number, now)
        outbound.left_device(number, now)
        numbers.append(number)
    return numbers


def test_a_late_answer_of_a_robots_former_incarnation_says_nothing_of_its_new_one() -> None:
    outbound = message_of_three_parts()
    outbound.acknowledged(Ack(0, 1, 0), 7, S)
    outbound.acknowledged(Ack(0, 0, 0), 8, 2 * S)
    outbound.acknowledged(Ack(0, 3, 0), 7, 3 * S)
    assert outbound.deadline is not None, "incarnation 8 has got nothing of it"
    outbound.time_out(outbound.deadline)
    assert 0 in send(outbound, 10 * S)
    outbound.acknowledged(Ack(0, 3, 0), 8, 11 * S)
    assert outbound.deadline is None


def test_a_new_incarnation_may_be_heard_of_before_the_last_words_of_the_former_come() -> None:
    outbound = message_of_three_parts()
    outbound.acknowledged(Ack(0, 1, 0), 8, S)
    outbound.acknowledged(Ack(0, 2, 0), 7, 2 * S)
    outbound.acknowledged(Ack(0, 3, 0), 8, 3 * S)
    assert outbound.deadline is None


def test_a_robot_whose_clock_was_set_back_before_it_booted_is_believed_in_time() -> None:
    outbound = message_of_three_parts()
    outbound.acknowledged(Ack(0, 1, 0), 100, S)
    outbound.acknowledged(Ack(0, 1, 0), 50, 2 * S)
    outbound.acknowledged(Ack(0, 2, 0), 100, 3 * S)
    outbound.acknowledged(Ack(0, 3, 0), 50, 4 * S)
    assert outbound.deadline is not None, "which of them lives is not known yet"
    outbound.acknowledged(Ack(0, 3, 0), 50, 3 * S + 30 * S)
    assert outbound.deadline is None, "sooner than a message is given up"


def test_of_a_robots_incarnations_only_the_last_are_remembered() -> None:
    robot = transport()
    for life in range(6):
        hears(robot, 1, Publication(0, 1, b"x"), incarnation=life)
        hears(robot, 1, Publication(0, 1, b"x"), incarnation=life)
    assert len(robot.published()) == 6
    hears(robot, 1, Publication(0, 1, b"x"), incarnation=5)
    hears(robot, 1, Publication(0, 1, b"x"), incarnation=2)
    assert robot.published() == []
    hears(robot, 1, Publication(0, 1, b"x"), incarnation=1)
    assert len(robot.published()) == 1, "it was forgotten"


def test_an_incarnation_that_goes_on_is_remembered_longer_than_later_ones_that_do_not() -> None:
    robot = transport()
    for number, life in enumerate((0, 1, 2, 3, 0, 4), 1):
        hears(robot, 1, Publication(0, number, b"x"), incarnation=life)
    robot.published()
    hears(robot, 1, Publication(0, 5, b"x"), incarnation=0)
    assert robot.published() == [], "0 was heard after 1"
    hears(robot, 1, Publication(0, 2, b"x"), incarnation=1)
    assert len(robot.published()) == 1, "1 was forgotten in place of it"
