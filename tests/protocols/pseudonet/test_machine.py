"""The Pseudonet machine keeps the laws of machines, whatever comes in; and what it refuses to begin with."""

from collections.abc import Callable
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.errors import UserError
from cosim.machine import (
    Connected,
    Disconnect,
    Discovered,
    Fate,
    GoTo,
    Inquire,
    InquiryComplete,
    Lost,
    Outcome,
    Outgoing,
    Page,
    PageFailed,
    Reception,
    Role,
    Scan,
)
from cosim.observation import Observation
from cosim.protocol import Surroundings
from cosim.testing import check_machine
from cosim.units import MS, S, Time
from protocols.pseudonet.application import PATIENCE_TICKS
from protocols.pseudonet.machine import Pseudonet
from protocols.pseudonet.messages import Action, Kind, Message, Packet, Reply, Sync, Verdict, decode, encode
from protocols.pseudonet.parameters import Parameters, timing
from protocols.pseudonet.setup import Setup
from protocols.pseudonet.spec import COLUMN_LIMIT, SPEC, measure
from tests.tiers import two_tiers

ALGORITHMS = ("oscard", "random_walk", "boustrophedon", "spanning_tree")
FREE = (Verdict.POSSIBLE,) * 4


def surroundings(
    starts: int | tuple[tuple[float, float], ...], bounds_m: tuple[float, float, float, float] = (0.0, 0.0, 10.0, 4.0)
) -> Surroundings:
    places = tuple((robot + 0.5, 0.5) for robot in range(starts)) if isinstance(starts, int) else starts

    def forbidden(points: np.ndarray) -> np.ndarray:
        x, y = points[:, 0], points[:, 1]
        return (x < bounds_m[0]) | (x > bounds_m[2]) | (y < bounds_m[1]) | (y > bounds_m[3])

    return Surroundings(places, 0.2, 0.5, 1.0, 100 * MS, np.zeros((0, 4)), bounds_m, forbidden)


def maker(size: int, algorithm: str = "boustrophedon", **more: object) -> Callable[[int, Time], Pseudonet]:
    parameters = Parameters(algorithm=algorithm, cell_m=1.0, **more)  # type: ignore[arg-type]
    setup: Setup = SPEC.prepare(parameters, surroundings(size))

    def make(me: int, start: Time) -> Pseudonet:
        machine = SPEC.make(parameters, setup, me, np.random.default_rng(me), start)
        assert isinstance(machine, Pseudonet)
        return machine

    return make


def stands_at(x_m: float, y_m: float, arrived: bool = True, blocked: bool = False) -> Observation:
    return Observation(x_m, y_m, 0.0, 0.0, arrived, blocked)


def started(me: int, size: int, **more: object) -> Pseudonet:
    """Return a robot that knows where it is and has begun its set-up."""
    machine = maker(size, **more)(me, 0)  # type: ignore[arg-type]
    machine.observe(stands_at(me + 0.5, 0.5), 0)
    machine.wake(0)
    return machine


@pytest.mark.slow
@pytest.mark.parametrize(("algorithm", "size"), two_tiers(product(ALGORITHMS, (2, 3, 8)), 4))
def test_masters_and_slaves_of_every_algorithm_keep_the_laws(algorithm: str, size: int) -> None:
    check_machine(maker(size, algorithm), surroundings(size).starts_m)


# ------------------------------------------------------------------ frames that are well formed and make no sense

_small = st.integers(0, 12) | st.sampled_from([4094, 4095])
messages = st.builds(
    Message,
    st.integers(0, 7),
    st.sampled_from([Kind.STATE, Kind.HELP, Kind.STOP]),
    st.integers(0, 6) | st.integers(250, 255),
    _small,
    _small,
    st.sampled_from(Action),
    st.tuples(*[st.sampled_from(Verdict)] * 4),
    st.booleans(),
)
_answers = st.builds(
    Message,
    st.integers(0, 7),
    st.just(Kind.ANSWER),
    st.integers(0, 6),
    _small,
    _small,
    st.sampled_from(Action),
    st.just(FREE),
    st.booleans(),
    st.none() | st.integers(0, 7),
    st.sampled_from(Reply),
    st.tuples(_small, _small),
)
_members = st.sampled_from([(0, 1), (0, 1, 2), (0, 2), (1,), (), tuple(range(8))])
_syncs = st.builds(Sync, st.integers(0, 7), st.integers(0, 6), _members, st.booleans())
_frames = st.lists(st.tuples(messages | messages | _answers | _syncs, st.sampled_from([0, 0, 0, 1, 255])), max_size=40)
"""Packets, and by how much their number is ahead of the exchange that the receiver is in."""


@pytest.mark.slow
@given(st.sampled_from(ALGORITHMS), st.integers(0, 2), _frames)
def test_well_formed_frames_of_any_content_never_raise(
    algorithm: str, me: int, frames: list[tuple[Packet, int]]
) -> None:
    machine = started(me, 3, algorithm=algorithm)
    if me == 0:
        for peer in (1, 2):
            machine.link(Discovered(peer), 1)
        machine.link(InquiryComplete((1, 2)), 1)
        for peer in (1, 2):
            machine.link(Connected(peer, Role.MASTER), 2)
    else:
        machine.link(Connected(0, Role.SLAVE), 2)
    for now, (packet, ahead) in enumerate(frames, 3):
        number = (machine.application.broadcast.exchange + ahead) % 256
        data = encode(replace(packet, exchange=number))
        machine.receive(data, Reception(packet.source if me == 0 else 0, False), now)
        if me == 0:  # the poll is answered
            machine.link(Fate(machine.application.broadcast.polls.token, Outcome.DELIVERED), now)
        machine.wake(now)
        deadline = machine.wake_at()
        assert deadline is None or deadline > now
        for item in machine.outbox():
            if isinstance(item, Outgoing):
                decode(item.payload)


# ------------------------------------------------------------------ setting up


def test_the_first_robot_looks_for_the_others_and_the_others_wait_to_be_found() -> None:
    assert started(0, 3).outbox() == [Scan(enabled=False), Inquire(10_240 * MS, 2)]
    assert started(1, 3).outbox() == [Scan(enabled=True)]


def test_nobody_begins_before_it_knows_where_it_is() -> None:
    machine = maker(3)(0, 5 * S)
    assert machine.wake_at() == 5 * S
    machine.wake(5 * S)
    assert machine.outbox() == []
    machine.observe(stands_at(0.5, 0.5), 5 * S + 1)
    assert machine.outbox() == [Scan(enabled=False), Inquire(10_240 * MS, 2)]


def test_the_master_asks_again_while_robots_are_missing_then_pages_those_it_has_found() -> None:
    machine = started(0, 3, inquiries=2)
    machine.outbox()
    machine.link(Discovered(2), 1 * S)
    machine.link(InquiryComplete((2,)), 10 * S)
    assert machine.outbox() == [Inquire(10_240 * MS, 2)]
    machine.link(InquiryComplete((2,)), 20 * S)
    assert machine.outbox() == [Page(2)]
    machine.link(Connected(2, Role.MASTER, 0x2A96EF25, 77), 21 * S)
    sync = machine.outbox()[0]
    assert isinstance(sync, Outgoing)
    assert decode(sync.payload) == Sync(0, 1, (0, 2), True, 0x2A96EF25, 77)
    assert (machine.bluetooth.inquiry_time, machine.bluetooth.page_time) == (20 * S, 1 * S)


def test_a_page_that_fails_is_tried_again_after_the_others() -> None:
    machine = started(0, 3, page_attempts=2)
    machine.outbox()
    for peer in (2, 1):
        machine.link(Discovered(peer), 1)
    machine.link(InquiryComplete((2, 1)), 1)
    pages = []
    for answer in (PageFailed(2), Connected(1, Role.MASTER), PageFailed(2)):
        pages += machine.outbox()
        machine.link(answer, 2)
    assert pages == [Page(2), Page(1), Page(2)]
    assert machine.application.broadcast.members == (0, 1)


def test_a_slave_that_is_lost_while_others_are_paged_is_not_called_up() -> None:
    machine = started(0, 3)
    for peer in (1, 2):
        machine.link(Discovered(peer), 1)
    machine.link(InquiryComplete((1, 2)), 1)
    machine.link(Connected(1, Role.MASTER), 2)
    machine.link(Lost(1), 3)
    machine.link(Connected(2, Role.MASTER), 4)
    assert machine.application.broadcast.members == (0, 2)


def test_a_master_that_finds_nobody_goes_alone() -> None:
    machine = started(0, 2, inquiries=1)
    machine.link(InquiryComplete(()), 1)
    assert machine.application.broadcast.members == (0,)
    assert machine.application.steps == 1
    assert [type(command) for command in machine.commands()] == [GoTo]


# ------------------------------------------------------------------ losing a team, and finding another


def slave(me: int, size: int, members: tuple[int, ...], master: int = 0, **more: object) -> Pseudonet:
    """Return a robot that has been called up by *master*."""
    machine = started(me, size, **more)
    machine.link(Connected(master, Role.SLAVE), 10)
    machine.receive(encode(Sync(master, 1, members, True)), Reception(master, True), 11)
    machine.outbox()
    return machine


def test_who_is_found_by_nobody_looks_for_others_after_those_with_lower_numbers() -> None:
    machine = started(2, 4, stagger_s=30.0)
    machine.outbox()
    assert machine.wake_at() == 60 * S
    machine.wake(60 * S)
    assert machine.outbox() == [Scan(enabled=False), Inquire(10_240 * MS, 3)]


def test_a_slave_that_loses_its_master_waits_for_those_before_it_who_are_left() -> None:
    for me, rank in ((1, 0), (2, 1), (3, 2)):
        machine = slave(me, 4, (0, 1, 2, 3), stagger_s=30.0, settle_s=2.0)
        machine.link(Lost(0), 20 * S)
        assert machine.outbox() == [Scan(enabled=True)]
        assert machine.wake_at() == 22 * S + rank * 30 * S
        machine.wake(22 * S + rank * 30 * S)
        assert machine.outbox() == [Scan(enabled=False), Inquire(10_240 * MS, 2)]
        assert not machine.finished


def test_a_slave_whose_master_is_silent_takes_it_for_lost() -> None:
    machine = slave(1, 2, (0, 1), silence_s=30.0)
    step = timing(Parameters(cell_m=1.0), surroundings(2)).step
    for now, lost in ((20 * S, False), (50 * S + 2 * step - 1, False), (50 * S + 2 * step, True)):
        if now == 20 * S:
            machine.receive(encode(Sync(0, 1, (0, 1), True)), Reception(0, True), now)
        machine.outbox()
        machine.wake(now)
        assert (Disconnect(0) in machine.outbox()) == lost
    assert machine.application.broadcast.find_master() is None


def test_a_robot_that_was_found_but_is_never_called_up_looks_for_others() -> None:
    machine = started(1, 3, stagger_s=30.0, settle_s=2.0)
    machine.link(Connected(0, Role.SLAVE), 5 * S)
    machine.outbox()
    machine.wake(35 * S)
    assert machine.outbox() == [Disconnect(0), Scan(enabled=True)]
    machine.wake(37 * S)
    assert machine.outbox() == [Scan(enabled=False), Inquire(10_240 * MS, 1)]  # robot 2: robot 0 does not answer


@pytest.mark.parametrize("lost_at", [None, 20 * S])
def test_a_robot_whose_device_answers_nothing_goes_on_alone(lost_at: int | None) -> None:
    machine = started(0, 3, inquiries=2) if lost_at is None else slave(1, 3, (0, 1, 2), inquiries=2)
    if lost_at is not None:
        machine.link(Lost(0), lost_at)
    for _ in range(6):
        now = machine.wake_at()
        if now is None or machine.application.steps:
            break
        machine.wake(now)
    assert machine.application.steps == 1
    assert machine.application.broadcast.members == (machine.me,)


def test_a_page_that_the_device_does_not_answer_is_given_up() -> None:
    machine = started(0, 3, page_attempts=1, page_s=12.0)
    machine.link(Discovered(1), 1)
    machine.link(Discovered(2), 1)
    machine.link(InquiryComplete((1, 2)), 1)
    assert machine.outbox()[-1] == Page(1)
    machine.wake(12 * S + 1)
    assert machine.outbox() == [Page(2)]
    machine.link(Connected(1, Role.MASTER), 13 * S)  # too late
    assert machine.outbox() == [Disconnect(1)]


def test_a_robot_that_works_alone_joins_the_team_of_who_pages_it() -> None:
    machine = started(0, 3, inquiries=1)
    machine.link(InquiryComplete(()), 1)
    assert machine.outbox()[-1] == Scan(enabled=True)
    machine.link(Connected(2, Role.SLAVE), 2 * S)
    machine.observe(stands_at(0.5, 1.5), 3 * S)
    machine.receive(encode(Sync(2, 9, (0, 2), True)), Reception(2, True), 4 * S)
    assert machine.application.broadcast.members == (0, 2)
    (roll,) = [decode(item.payload) for item in machine.outbox() if isinstance(item, Outgoing)]
    assert isinstance(roll, Message)
    assert (roll.kind, roll.exchange, roll.x, roll.y) == (Kind.ROLL, 9, 0, 1)


def test_masters_of_slaves_and_who_is_looking_for_others_refuse_another_master() -> None:
    looking = started(0, 3, inquiries=1)
    looking.outbox()
    looking.link(Connected(2, Role.SLAVE), 1)
    assert looking.outbox() == [Disconnect(2)]
    looking.link(Discovered(1), 2)
    looking.link(InquiryComplete((1,)), 2)
    looking.link(Connected(1, Role.MASTER), 3)
    looking.outbox()
    looking.link(Connected(2, Role.SLAVE), 4)
    assert looking.outbox() == [Disconnect(2)]
    assert looking.application.broadcast.members == (0, 1)


def test_payloads_of_robots_without_a_link_are_not_for_this_one() -> None:
    machine = slave(1, 3, (0, 1))
    machine.receive(encode(Sync(2, 2, (1, 2), True)), Reception(2, True), 20)
    assert machine.application.broadcast.members == (0, 1)
    assert machine.application.broadcast.find_master() == 0
    waiting = started(1, 3)
    waiting.receive(encode(Sync(2, 2, (1, 2), True)), Reception(2, True), 20)
    assert waiting.application.broadcast.find_master() is None


# ------------------------------------------------------------------ what is in the way


def test_a_robot_that_meets_something_unknown_turns_back_and_says_so() -> None:
    machine = started(0, 1)
    (first,) = machine.commands()
    assert isinstance(first, GoTo)
    for tick in range(1, PATIENCE_TICKS + 2):
        assert machine.commands() == []
        machine.observe(stands_at(0.5, 0.6, arrived=False, blocked=True), tick * 100 * MS)
    assert machine.commands() == [GoTo(0.5, 0.5)]
    machine.observe(stands_at(0.5, 0.5), 5 * S)
    blocked = machine.application.coordination.view.obstacles
    assert [machine.application.coordination.view.setup.grid.centre_m(cell) for cell in blocked] == [
        (first.x_m, first.y_m)
    ]


def test_a_robot_that_cannot_reach_the_middle_of_its_cell_stays_where_it_is_and_takes_part() -> None:
    machine = maker(2)(1, 0)
    machine.observe(stands_at(1.3, 0.5), 0)
    assert machine.commands() == [GoTo(1.5, 0.5)]
    machine.wake(0)
    machine.link(Connected(0, Role.SLAVE), 1)
    machine.receive(encode(Sync(0, 1, (0, 1), True)), Reception(0, True), 2)
    assert said(machine)[-1].busy
    machine.receive(encode(Message(0, Kind.ROLL, 1, 0, 0, Action.STAY, FREE)), Reception(0, True), 3)
    for tick in range(1, PATIENCE_TICKS + 2):
        assert machine.commands() == []
        assert said(machine) == []
        machine.observe(stands_at(1.4, 0.5, arrived=False, blocked=True), tick * 100 * MS)
    assert machine.commands() == [GoTo(1.4, 0.5)]
    (message,) = said(machine)
    assert (message.kind, message.exchange, message.x, message.busy) == (Kind.ROLL, 2, 1, False)


def said(machine: Pseudonet) -> list[Message]:
    """Return the messages that *machine* has sent."""
    packets = [decode(item.payload) for item in machine.outbox() if isinstance(item, Outgoing)]
    return [packet for packet in packets if isinstance(packet, Message)]


# ------------------------------------------------------------------ parameters, knowledge, metrics


@pytest.mark.parametrize(
    ("cell_m", "travel_s"),
    [
        (0.5, 1.5),  # 0.5 m at 0.5 m/s, and 0.5 s for speeding up and braking
        (0.16, 0.8),  # 0.4 m/s is reached after half of 0.16 m at 1 m/s^2: 2 sqrt(0.16)
    ],
)
def test_a_step_takes_the_time_that_distance_and_limits_give_and_two_ticks(cell_m: float, travel_s: float) -> None:
    times = timing(Parameters(cell_m=cell_m), surroundings(1)._replace(radius_m=0.05))
    assert times.step == round(travel_s * S) + 200 * MS


@pytest.mark.parametrize(
    ("cell_m", "starts", "error"),
    [
        (0.3, 1, r"cell_m: 0.3 is not >= 0.4, the diameter of the largest robot"),
        (5.0, 1, r"cell_m: 5.0 makes 2 x 0 cells of this floor, expected 1 to 4096 a side"),
        (3.0, ((9.5, 0.5),), r"team.starts\[0\]: \(9.5, 0.5\) is beyond the last whole cell of the floor"),
        (1.0, ((0.3, 0.3), (0.7, 0.7)), r"team.starts\[1\]: \(0.7, 0.7\) is in the same cell as team.starts\[0\]"),
    ],
)
def test_what_cannot_be_covered_is_refused_in_one_line(cell_m: float, starts: object, error: str) -> None:
    with pytest.raises(UserError, match=error):
        SPEC.prepare(Parameters(cell_m=cell_m), surroundings(starts))  # type: ignore[arg-type]


def test_a_team_too_slow_to_make_a_step_in_any_run_is_refused() -> None:
    around, parameters = surroundings(1), Parameters(cell_m=1.0)
    assert timing(parameters, around._replace(speed_mps=2e-9, acceleration_mps2=1.0)).step > 5e8 * S
    slow = around._replace(speed_mps=1e-310, acceleration_mps2=1.0)
    with pytest.raises(UserError, match=r"team.body.speed_mps: at 1e-310 m/s a step of 1 m takes inf s"):
        timing(parameters, slow)
    with pytest.raises(UserError, match=r"team.body.speed_mps: at 9e-10 m/s a step of 1 m takes 1.11111e\+09 s"):
        SPEC.prepare(parameters, around._replace(speed_mps=9e-10, acceleration_mps2=1.0))


def test_the_columns_that_messages_can_name_are_enough_or_refused() -> None:
    def wide(columns: int) -> Surroundings:
        return surroundings(((0.25, 0.25),), (0.0, 0.0, columns * 0.5, 0.5))

    assert SPEC.prepare(Parameters(cell_m=0.5), wide(COLUMN_LIMIT)).grid.nx == COLUMN_LIMIT
    with pytest.raises(UserError, match=r"makes 4097 x 1 cells"):
        SPEC.prepare(Parameters(cell_m=0.5), wide(COLUMN_LIMIT + 1))


def test_robots_are_spread_over_different_cells() -> None:
    starts = SPEC.place(Parameters(cell_m=1.0), surroundings(()), 8, np.random.default_rng(1))
    assert len(set(starts)) == 8
    assert all(x % 1 == y % 1 == 0.5 for x, y in starts)


def test_a_floor_with_fewer_cells_than_robots_is_refused() -> None:
    tiny = surroundings((), (0.0, 0.0, 2.0, 1.0))
    with pytest.raises(UserError, match=r"team.size: 3 robots, but the floor has 2 cells"):
        SPEC.place(Parameters(cell_m=1.0), tiny, 3, np.random.default_rng(1))


def test_all_metrics_that_are_named_are_measured() -> None:
    make = maker(2)
    setup = SPEC.prepare(Parameters(cell_m=1.0), surroundings(2))
    judged = SPEC.referee(Parameters(cell_m=1.0), setup, surroundings(2))
    judged.look(np.array([0.5, 1.5]), np.array([0.5, 0.5]), 0)
    measured = measure([make(robot, 0) for robot in range(2)]) | judged.verdict(0)
    assert {metric.name for metric in SPEC.metrics} == set(measured)


def test_the_referee_counts_cells_that_centres_enter_and_entries_that_were_for_nothing() -> None:
    parameters = Parameters(cell_m=1.0)
    judged = SPEC.referee(parameters, SPEC.prepare(parameters, surroundings(1)), surroundings(1))
    for tick, x in enumerate([0.5, 0.9, 1.1, 1.5, 0.9, 1.2]):  # cells 0, 0, 1, 1, 0, 1
        judged.look(np.array([x]), np.array([0.5]), tick)
    verdict = judged.verdict(6)
    assert verdict["coverage"] == 2 / 40
    assert verdict["overlap_ratio"] == 1.0  # four entries, two of cells that were covered
    assert np.isnan(verdict["time_to_cover_s"])
