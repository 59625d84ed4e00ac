"""Maps merged by messages: robots end with equal ledgers and equal maps, whatever was lost and whoever was away."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.machine import Address, Outgoing
from cosim.scenario import build
from cosim.simulation import Simulation
from cosim.units import S
from protocols.mapping import sharing
from protocols.mapping.frames import LEAST_OCTETS, Piece, Stream, Summary, encode
from protocols.mapping.sharing import Ledger
from tests.protocols.mapping.sharing_scene import CELLS, EMPTY, OCCUPIED, UNKNOWN, Team


def wander(team: Team, periods: int, seed: int = 1, robots: tuple[Address, ...] = ()) -> np.ndarray[Any, Any]:
    """Have robots see cells at random, 20 a period, and return the map of all that was seen if hits are certain."""
    stream = np.random.default_rng(seed)
    whole = np.zeros(CELLS, np.int8)
    for _ in range(periods):
        for me in robots or range(len(team.robots)):
            for cell in stream.integers(0, CELLS, 20).tolist():
                state = int(stream.integers(EMPTY, OCCUPIED + 1))
                team.see(me, cell, state)
                whole[cell] = max(whole[cell], state)
        team.pass_periods(1)
    return whole


# ---------------------------------------------------------------- all get all


def test_with_nothing_lost_everything_is_told_once() -> None:
    team = Team(4)
    whole = wander(team, 6)
    team.pass_periods(1)
    assert team.agree
    assert (team.maps[2] == whole).all()
    assert len(team.told()) == len(set(team.told())) > 24
    assert team.count("pieces_again") == team.count("pieces_known") == 0


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("certain", [True, False])
def test_what_was_lost_is_told_again(seed: int, certain: bool) -> None:
    team = Team(3, certain, loss=0.3)
    whole = wander(team, 8, seed)
    assert not team.agree
    team.pass_periods(15)
    assert team.agree
    assert not certain or (team.maps[0] == whole).all()
    assert team.count("pieces_again") > 0


def test_pieces_come_over_a_chain_to_who_is_never_in_reach_of_their_author() -> None:
    team = Team(4)
    team.reach = lambda teller, hearer: abs(teller - hearer) == 1
    whole = wander(team, 4)
    team.pass_periods(20)
    assert team.agree
    assert (team.maps[3] == whole).all()


def test_groups_that_were_apart_tell_each_other_what_was_missed_once() -> None:
    """Each piece that a group has missed is told again by one of the other group, and all of the group hear it."""
    team = Team(6)
    team.reach = lambda teller, hearer: teller // 3 == hearer // 3
    whole = wander(team, 5)
    before = team.told()
    assert len(before) == len(set(before))
    team.reach = lambda teller, hearer: True
    team.pass_periods(12)
    assert team.agree
    assert (team.maps[5] == whole).all()
    assert sorted(team.told()[len(before) :]) == sorted(before)


def test_a_group_catches_up_by_the_one_member_that_meets_another() -> None:
    team = Team(4)
    team.reach = lambda teller, hearer: teller // 2 == hearer // 2
    whole = wander(team, 3)
    team.reach = lambda teller, hearer: {teller, hearer} in ({0, 1}, {1, 2}, {2, 3})
    team.pass_periods(20)
    assert team.agree
    assert (team.maps[0] == whole).all()


def test_who_asks_in_vain_asks_another() -> None:
    """1 and 2 have what 3 lacks; 1 does not hear it."""
    team = Team(4)
    team.reach = lambda teller, hearer: 3 not in (teller, hearer)
    wander(team, 2, robots=(0,))
    team.reach = lambda teller, hearer: 0 not in (teller, hearer) and (teller, hearer) != (3, 1)
    team.pass_periods(8)
    assert team.robots[3].ledger.counts == team.robots[0].ledger.counts
    assert team.counters[1].pieces_again == 0 < team.counters[2].pieces_again


# ---------------------------------------------------------------- booting again


def test_who_boots_again_gets_its_own_map_back() -> None:
    team = Team(2)
    whole = wander(team, 3)
    team.boot(0)
    team.pass_periods(10)
    assert team.agree
    assert (team.maps[0] == whole).all()


def test_who_boots_again_and_hears_first_who_has_few_of_its_pieces_confuses_nobody() -> None:
    """1 has missed most of what 0 has told; 0 tells new pieces before it hears 2, which has all the old ones."""
    team = Team(3)
    team.reach = lambda teller, hearer: True
    one = wander(team, 1, seed=1)
    team.reach = lambda teller, hearer: 1 not in (teller, hearer)
    two = wander(team, 4, seed=2, robots=(0,))
    team.boot(0)
    team.reach = lambda teller, hearer: 2 not in (teller, hearer)
    three = wander(team, 3, seed=3, robots=(0,))
    team.reach = lambda teller, hearer: True
    team.pass_periods(15)
    assert team.agree
    assert (team.maps[1] == np.maximum(np.maximum(one, two), three)).all()


def test_who_has_told_all_that_numbers_are_for_counts_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sharing, "MOST_PIECES", 3)
    team = Team(2, octets=LEAST_OCTETS)
    team.pass_periods(1)
    for me in (0, 1):
        for cell in range(0, 20, 2):
            team.see(me, cell + 100 * me, OCCUPIED)
    team.pass_periods(4)
    assert team.agree
    assert (team.maps[0] == OCCUPIED).sum() == 20
    assert max(team.robots[0].ledger.counts.values()) == 3


# ---------------------------------------------------------------- frames


@pytest.mark.parametrize("octets", [LEAST_OCTETS, 30, 54, 90])
def test_no_frame_is_longer_than_it_may_be(octets: int) -> None:
    team = Team(7, octets=octets, loss=0.2)
    wander(team, 3)
    team.pass_periods(1)
    lengths = [len(data) for _, data in team.frames]
    assert octets - 8 < max(lengths) <= octets
    assert team.count("frames") == len(lengths)
    assert team.count("payload_bytes") == sum(lengths)
    assert len({entry.stream for sender, summary in team.messages(Summary) for entry in summary.entries}) == 7


@pytest.mark.parametrize("again", [1, 3])
def test_an_answer_has_as_many_pieces_as_it_may_and_the_oldest(again: int) -> None:
    team = Team(2, again=again)
    team.reach = lambda teller, hearer: False
    wander(team, 6, robots=(0,))
    told = [stream_and_number[2] for stream_and_number in team.told()]
    team.reach = lambda teller, hearer: True
    team.frames.clear()
    team.pass_periods(2)
    assert [number for *_, number in team.told()] == told[: 2 * again][: len(team.told())]
    assert len(team.told()) in (again, 2 * again)


def test_nothing_new_is_told_by_summaries_only() -> None:
    """The ledger of a team that learns nothing does not grow."""
    team = Team(2)
    wander(team, 1)
    team.pass_periods(2)
    counts = dict(team.robots[0].ledger.counts)
    team.frames.clear()
    team.pass_periods(50)
    assert len(team.messages(Summary)) == len(team.frames) == 100
    assert team.robots[0].ledger.counts == counts


def test_robots_tell_one_after_the_other() -> None:
    team = Team(4)
    tellers = []
    for _ in range(10):
        team.frames.clear()
        team.tick()
        tellers.append([teller for teller, _ in team.frames])
    assert tellers == [[0], [], [], [1], [], [2], [], [], [3], []]


# ---------------------------------------------------------------- cells that change


@pytest.mark.parametrize("states", [(EMPTY, OCCUPIED, EMPTY), (EMPTY, OCCUPIED)])
def test_a_cell_that_changes_back_and_forth_within_a_period_is_told_once_as_it_is(states: tuple[int, ...]) -> None:
    team = Team(2, certain=False)
    team.pass_periods(1)
    for state in states:
        team.see(0, 7, state)
    team.pass_periods(1)
    ((_, piece),) = team.messages(Piece)
    assert piece.runs.tolist() == [7 << 10 | (states[-1] == OCCUPIED) << 9]
    assert team.maps[1, 7] == states[-1]


def test_of_robots_that_have_not_heard_each_other_who_has_seen_a_cell_last_is_right() -> None:
    """Also if it has told less."""
    team = Team(2, certain=False)
    team.reach = lambda teller, hearer: False
    wander(team, 5, robots=(0,))
    team.see(0, 7, OCCUPIED)
    team.pass_periods(2)
    team.see(1, 7, EMPTY)
    team.reach = lambda teller, hearer: True
    team.pass_periods(10)
    assert team.agree
    assert team.maps[0, 7] == EMPTY


def test_what_was_told_and_has_changed_is_told_again_and_counts() -> None:
    team = Team(3, certain=False)
    for state in (EMPTY, OCCUPIED, EMPTY):
        team.see(0, 7, state)
        team.pass_periods(2)
        assert (team.maps[:, 7] == state).all()
    team.see(2, 7, OCCUPIED)  # who contradicts what it has heard is right
    team.pass_periods(2)
    assert (team.maps[:, 7] == OCCUPIED).all()


def test_who_contradicts_what_it_has_heard_is_right_even_if_its_clock_is_slow() -> None:
    team = Team(2, certain=False)
    for robot, ahead in zip(team.robots, (1000 * S, 0), strict=True):
        for me, state in ((0, EMPTY), (1, OCCUPIED)):
            if robot.me == me:
                team.see(me, 7, state)
        robot.tick(0.0, 0.0, 10 * S + ahead)
        for item in robot.drain():
            assert isinstance(item, Outgoing)
            team.hear(1 - robot.me, robot.me, item.payload)
    assert (team.maps[:, 7] == OCCUPIED).all()


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
@pytest.mark.parametrize(("certain", "left"), [(True, OCCUPIED), (False, EMPTY)])
def test_pieces_may_come_in_any_order(order: tuple[int, int], certain: bool, left: int) -> None:
    """What was seen last is empty; if hits are certain the cell is occupied all the same."""
    team = Team(3, certain)
    frames = [
        encode(0, Piece(Stream(0, 0), 0, 500, np.array([7 << 10 | 1 << 9], np.uint32))),
        encode(1, Piece(Stream(1, 0), 0, 900, np.array([7 << 10], np.uint32))),
    ]
    for k in order:
        team.hear(2, k, frames[k])
    assert team.maps[2, 7] == left


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_of_pieces_of_one_instant_the_same_one_counts_for_all(order: tuple[int, int]) -> None:
    team = Team(3, certain=False)
    frames = [
        encode(author, Piece(Stream(author, 0), 0, 500, np.array([7 << 10 | (1 - author) << 9], np.uint32)))
        for author in (0, 1)
    ]
    for k in order:
        team.hear(2, k, frames[k])
    assert team.maps[2, 7] == EMPTY


@pytest.mark.parametrize(("certain", "left"), [(True, OCCUPIED), (False, EMPTY)])
def test_what_is_still_to_be_told_is_newer_than_what_is_heard_unless_hits_are_certain(certain: bool, left: int) -> None:
    team = Team(3, certain)
    team.pass_periods(1)
    team.see(0, 7, EMPTY)
    for me in (0, 1):
        team.hear(me, 2, encode(2, Piece(Stream(2, 99), 0, 10**6, np.array([7 << 10 | 1 << 9], np.uint32))))
    assert team.maps[0, 7] == left
    team.pass_periods(10)
    assert (team.maps[:, 7] == left).all()


# ---------------------------------------------------------------- a whole run


@pytest.mark.slow
@pytest.mark.parametrize("flaws", [{}, {"range_m": 4.0, "loss": 0.3}])
def test_robots_that_explore_an_office_end_with_the_same_map(flaws: dict[str, float]) -> None:
    """Also if they are mostly out of each other's reach, and frames are lost."""
    plain = {
        "duration_s": 400.0,
        "floorplan": {"map": "office", "office": {"width_m": 8, "depth_m": 6, "rooms": 2}},
        "team": {
            "size": 3,
            "senses": {"beams": 360, "beam_range_m": 2.5},
            "body": {"radius_m": 0.2, "speed_mps": 0.3, "drive": "differential"},
        },
        "channel": {"kind": "ideal", **flaws},
        "protocol": {"use": "protocols.exploration.spec:SPEC", "parameters": {"map": "messages"}},
    }
    run = Simulation(build(plain, "test", Path()), 1)
    outcome = run.run()
    machines: list[Any] = run.machines
    maps = [np.sign(machine.belief.evidence) for machine in machines]
    assert outcome.simulated_s < 400.0
    assert outcome.metrics["coverage"] == 1.0
    assert (maps[0] != UNKNOWN).sum() > 1000
    assert all((each == maps[0]).all() for each in maps)
    ledgers = [machine.sharing.ledger.counts for machine in machines]
    assert len(ledgers[0]) == 3
    assert all(each == ledgers[0] for each in ledgers)
    assert any(machine.counters.pieces_again for machine in machines) == bool(flaws)


# ---------------------------------------------------------------- the ledger of pieces

OURS, REBORN = Stream(1, 0), Stream(1, 5000)


def numbered(number: int, stream: Stream = OURS) -> Piece:
    return Piece(stream, number, 0, np.empty(0, np.uint32))


@given(st.lists(st.integers(0, 12), max_size=20))
def test_counts_go_up_to_the_first_gap(numbers: list[int]) -> None:
    ledger, seen = Ledger(), set[int]()
    for number in numbers:
        assert ledger.add(numbered(number)) == (number not in seen)
        seen.add(number)
        assert ledger.count(OURS) == min(set(range(14)) - seen)


def test_what_lies_beyond_a_gap_is_not_told() -> None:
    """Who asks has said how much it has without a gap; what is known beyond a gap counts once that is filled."""
    ledger = Ledger()
    for number in (0, 1, 3):
        ledger.add(numbered(number))
    assert [each.number for each in ledger.beyond(OURS, 0)] == [0, 1]
    ledger.add(numbered(2))
    assert [each.number for each in ledger.beyond(OURS, 1)] == [1, 2, 3]


def test_nothing_is_beyond_what_is_not_known() -> None:
    ledger = Ledger()
    ledger.add(numbered(0))
    assert ledger.beyond(OURS, 1) == ledger.beyond(OURS, 60_000) == ledger.beyond(REBORN, 0) == []
    assert ledger.count(REBORN) == 0


def test_lives_of_one_author_are_told_apart() -> None:
    ledger = Ledger()
    assert ledger.add(numbered(0))
    assert ledger.add(numbered(0, REBORN))
    assert ledger.counts == {OURS: 1, REBORN: 1}
    assert ledger.beyond(REBORN, 0)[0].stream == REBORN
