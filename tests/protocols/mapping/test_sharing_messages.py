"""Sharing maps: who is asked, what is answered, what nobody can have meant, when all has been told, and the laws."""

from collections.abc import Callable

import numpy as np
import pytest

from cosim.geometry.marking import CERTAIN, DOUBTFUL, states
from cosim.machine import Address, Command, Event, LinkCommand, LinkEvent, Machine, Outgoing, Reception
from cosim.observation import Observation, Sighting
from cosim.testing import check_machine
from cosim.units import S, Time
from protocols.mapping.belief import Belief, Frame
from protocols.mapping.frames import Entry, Message, Piece, Stream, Summary, encode
from protocols.mapping.sharing import AWAY_PERIODS, QUIET_PERIODS, Sharing, SharingCounters, SharingParameters
from protocols.wire import BadBytes
from tests.protocols.mapping.sharing_scene import CELLS, EMPTY, OCCUPIED, PERIOD, UNKNOWN, Team

PARAMETERS = SharingParameters(octets=60)


def last_entries(team: Team, me: Address) -> dict[Stream, Entry]:
    """Return what a robot has said of each stream the last time."""
    summary = [message for sender, message in team.messages(Summary) if sender == me][-1]
    return {entry.stream: entry for entry in summary.entries}


def alone(me: Address = 0, size: int = 3, start: Time = 0) -> Sharing:
    return Sharing(PARAMETERS, me, size, CELLS, SharingCounters(), start)


def hears(robot: Sharing, sender: Address, message: Message) -> int:
    """Return how many frames the robot has answered."""
    assert robot.receive(encode(sender, message), Reception(sender, True), 0) is None
    return len(robot.drain())


def piece(author: Address, number: int, run: int = 0, life: int = 0) -> Piece:
    return Piece(Stream(author, life), number, 0, np.array([run], np.uint32))


def test_a_summary_that_claims_more_than_there_is_changes_nothing() -> None:
    team = Team(3)
    team.pass_periods(1)
    forged = Entry(Stream(0, 0), 60_000, 1), Entry(Stream(1, 0), 60_000, 1), Entry(Stream(2, 77), 60_000, 1)
    team.hear(0, 1, encode(1, Summary(0.0, 0.0, forged)))
    team.see(0, 7, OCCUPIED)
    team.pass_periods(1)
    found = last_entries(team, 0)
    assert found == {
        Stream(0, 0): Entry(Stream(0, 0), 1, 0),  # nobody can have more of its own
        Stream(1, 0): Entry(Stream(1, 0), 0, 1),  # this it asks for, in vain
        Stream(2, 77): Entry(Stream(2, 77), 0, 1),
    }
    team.see(1, 8, OCCUPIED)
    team.pass_periods(AWAY_PERIODS + 1)
    assert team.agree
    assert last_entries(team, 0).keys() == {Stream(0, 0), Stream(1, 0)}  # what nobody claims any more is forgotten


def test_only_who_is_asked_answers() -> None:
    robot = alone()
    robot.changed(np.array([7], np.int32), [True])
    robot.tick(0.0, 0.0, 0)
    robot.drain()
    lacking = Summary(0.0, 0.0, (Entry(Stream(0, 0), 0, 0),))
    assert hears(robot, 1, lacking) == 0  # it has just been told
    robot.tick(0.0, 0.0, PERIOD)
    robot.drain()
    assert hears(robot, 1, Summary(0.0, 0.0, (Entry(Stream(0, 0), 0, 2),))) == 0
    assert hears(robot, 1, Summary(0.0, 0.0, (Entry(Stream(0, 0), 5, 0),))) == 0
    assert hears(robot, 1, lacking) == 1
    assert hears(robot, 2, lacking) == 0  # 2 has heard that as well, or asks again


@pytest.mark.parametrize(
    ("sender", "message"),
    [
        (3, Summary(0.0, 0.0, ())),
        (1, Summary(0.0, 0.0, (Entry(Stream(3, 0), 1, 1),))),
        (1, piece(3, 0)),
        (3, piece(1, 0)),
        (1, piece(1, 0, CELLS << 10)),
        (1, piece(1, 0, CELLS - 1 << 10 | 1)),
        (1, piece(0, 0)),  # its own, which it has never told
    ],
)
def test_what_nobody_of_the_team_can_have_sent_is_noted(sender: Address, message: Message) -> None:
    robot = alone()
    data = encode(sender, message)
    assert robot.receive(data, Reception(2, True), 0) is None
    assert robot.bad == [BadBytes(2, len(data))]
    assert robot.ledger.counts == {}


@pytest.mark.parametrize("certain", [True, False])
def test_pieces_in_whatever_order_and_however_often_make_the_same_map(certain: bool) -> None:
    """Merging is commutative and idempotent, down to the frontier."""
    stream = np.random.default_rng(4)
    frames = []
    for number in range(8):
        for author in (0, 1):
            runs = stream.integers(0, CELLS - 4, 6).astype(np.uint32) << 10 | stream.integers(0, 2, 6) << 9 | 3
            stamp = int(stream.integers(0, 1000))
            frames.append(encode(author, Piece(Stream(author, 0), number, stamp, runs.astype(np.uint32))))
    found = []
    for _ in range(6):
        robot = Sharing(PARAMETERS, 2, 3, CELLS, SharingCounters(), 0, certain)
        belief = Belief(Frame((0.0, 0.0), 0.1, 20, CELLS // 20), CERTAIN if certain else DOUBTFUL, 1.0)
        for k in [*stream.permutation(len(frames)), *stream.permutation(len(frames))]:
            told = robot.receive(frames[k], Reception(0, True), 0)
            if told is not None:
                belief.merge(*told)
        found.append((states(belief.evidence).tolist(), belief.frontier.tolist(), robot.ledger.counts))
    assert all(each == found[0] for each in found)
    assert {UNKNOWN, EMPTY, OCCUPIED} == {state for row in found[0][0] for state in row}


def test_what_is_known_is_not_learnt_again() -> None:
    robot, counters = alone(), SharingCounters()
    robot._counters = counters
    data = encode(1, piece(1, 0))
    assert robot.receive(data, Reception(1, True), 0) is not None
    assert robot.receive(data, Reception(1, True), 0) is None
    assert counters.pieces_known == 1


def test_own_frames_that_come_back_change_nothing() -> None:
    robot = alone(start=PERIOD)
    robot.tick(0.0, 0.0, PERIOD)
    earlier = Entry(Stream(2, 5), 9, 0), Entry(Stream(0, 0), 3, 0)  # from before it booted again
    hears(robot, 0, Summary(3.0, 4.0, earlier))
    hears(robot, 0, piece(0, 0))
    assert robot.places(PERIOD) == []
    robot.tick(0.0, 0.0, 2 * PERIOD)
    assert [item.payload for item in robot.drain() if isinstance(item, Outgoing)] == [encode(0, Summary(0.0, 0.0, ()))]


def test_where_others_are_is_known_for_a_while() -> None:
    robot = alone()
    robot.tick(0.0, 0.0, 0)
    other = alone(1)
    other.tick(3.0, 4.0, PERIOD)
    (item,) = other.drain()
    assert isinstance(item, Outgoing)
    robot.receive(item.payload, Reception(1, True), 0)
    assert robot.places(S // 2) == [(1, (3.0, 4.0), 0.5)]
    assert robot.places(-S) == [(1, (3.0, 4.0), 0.0)]  # its clock was set back
    for k in range(1, AWAY_PERIODS + 1):
        robot.tick(0.0, 0.0, k * PERIOD)
        assert len(robot.places(k * PERIOD)) == 1
    robot.tick(0.0, 0.0, (AWAY_PERIODS + 1) * PERIOD)
    assert robot.places((AWAY_PERIODS + 1) * PERIOD) == []


def test_where_others_were_seen_counts_as_well() -> None:
    """Who is seen no more, as a wall hides it, and out of reach, is near for a while still."""
    robot = alone()
    robot.tick(0.0, 0.0, 0, [Sighting(2, 1.0, 2.0)])
    assert robot.places(S) == [(2, (1.0, 2.0), 1.0)]
    assert robot.places_m == {2: (1.0, 2.0)}
    for k in range(1, AWAY_PERIODS + 2):
        robot.tick(0.0, 0.0, k * PERIOD)
    assert robot.places((AWAY_PERIODS + 1) * PERIOD) == []


def test_a_clock_that_is_set_back_silences_nobody() -> None:
    robot = alone(start=1000 * S)
    for now in (1000 * S, 10 * S, 10 * S + PERIOD // 2, 10 * S + PERIOD):
        robot.tick(0.0, 0.0, now)
    assert len(robot.drain()) == 3


def periods_to_silence(robot: Sharing, now: Time) -> int:
    """Return how often the robot tells before it takes all to have been told."""
    for count in range(3 * QUIET_PERIODS):
        if robot.silent:
            return count
        robot.tick(0.0, 0.0, now + count * PERIOD)
    return 3 * QUIET_PERIODS


def test_all_has_been_told_when_nothing_new_has_been_told_or_heard_for_a_while() -> None:
    robot = alone()
    assert periods_to_silence(robot, 0) == QUIET_PERIODS
    robot.changed(np.array([7], np.int32), [True])
    assert not robot.silent
    assert periods_to_silence(robot, 100 * S) == QUIET_PERIODS + 1
    robot.receive(encode(1, piece(1, 0)), Reception(1, True), 0)
    assert periods_to_silence(robot, 200 * S) == QUIET_PERIODS
    robot.receive(encode(1, piece(1, 0)), Reception(1, True), 0)
    assert robot.silent  # it was known
    robot.drain()
    assert hears(robot, 1, Summary(0.0, 0.0, (Entry(Stream(0, 0), 0, 0),))) == 1
    assert periods_to_silence(robot, 300 * S) == QUIET_PERIODS


def test_who_has_missed_something_asks_before_all_is_silent() -> None:
    team = Team(3, loss=0.3)
    for cell in range(0, 300, 2):
        team.see(cell % 3, cell, OCCUPIED)
    team.pass_periods(2)
    assert not team.agree
    for _ in range(1000):
        if all(robot.silent for robot in team.robots):
            break
        team.tick()
    assert team.robots[0].silent
    assert team.agree


# ---------------------------------------------------------------- laws


class Teller:
    """A machine that sees a new cell at each tick and does nothing but share."""

    def __init__(self, me: Address, start: Time, certain: bool) -> None:
        self._sharing = Sharing(PARAMETERS, me, 3, CELLS, SharingCounters(), start, certain)
        self._ticks = 0
        self.finished = False

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        self._sharing.receive(data, reception, now)

    def observe(self, observation: Observation, now: Time) -> None:
        self._ticks += 1
        cell = self._ticks * 7 % CELLS
        self._sharing.changed(np.array([cell], np.int32), [cell % 2 == 0])
        self._sharing.tick(observation.x_m, observation.y_m, now)

    def link(self, event: LinkEvent, now: Time) -> None: ...

    def wake(self, now: Time) -> None: ...

    def wake_at(self) -> Time | None:
        return None

    def outbox(self) -> list[Outgoing | LinkCommand]:
        return self._sharing.drain()

    def commands(self) -> list[Command]:
        return []

    def events(self) -> list[Event]:
        events, self._sharing.bad = self._sharing.bad, []
        return events


@pytest.mark.slow
@pytest.mark.parametrize("certain", [True, False])
def test_sharing_keeps_the_laws_of_machines(certain: bool) -> None:
    make: Callable[[Address, Time], Machine] = lambda me, start: Teller(me, start, certain)  # noqa: E731
    check_machine(make, duration=4 * S)
