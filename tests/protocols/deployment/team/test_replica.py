"""Replicas of the team's log: who leads, what a merge keeps, and all that can happen to three of them, step by step."""

import os
import sys
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from cosim.errors import LocalProtocolError, WireError
from cosim.machine import next_state
from cosim.units import S
from protocols.deployment.messages import status as codec
from protocols.deployment.messages.messages import Facts, Ordered, Told
from protocols.deployment.messages.status import News
from protocols.deployment.tasks.facts import Heard, Record
from protocols.deployment.tasks.orders import Halt, Order
from protocols.deployment.tasks.plan import Photo, Plan, Task
from protocols.deployment.team import replica as replicas
from protocols.deployment.team.replica import TABLE, Agreed, Input, Learned, Led, Replica, State, Taken, Term, Waits
from tests.protocols.deployment.team import model
from tests.protocols.deployment.team.model import (
    BrokenError,
    Budget,
    Team,
    check_liveness,
    explored,
    explored_plainly,
    wander,
)
from tests.tiers import SOAK_SHARE, soak_count

SILENCE, ALONE, AGAIN = 10 * S, 30 * S, 5 * S
WAITS = Waits(SILENCE, ALONE, AGAIN, 2 * S)
PLAN = Plan(number=1, play="p", robots=(0, 1), root=Task(name="p", act=Photo(robot=1)))
TOLD = Told(host=0, record=Record(plan=PLAN, start=0), calls=1)


@pytest.fixture(autouse=True)
def forgetful() -> Iterator[None]:
    """Have the model forget what robots do after each test: that takes memory, and some tests change it."""
    yield
    model.forget()


def team(size: int = 4, first: int = 0) -> list[Replica]:
    return [Replica(me, size, first, WAITS, 0) for me in range(size)]


def status(host: int, term: int = 0, plan: int = 0, digest: int = 0, serial: int | None = None) -> News:
    return News(host, term, plan, 0, digest, serial, False, 0.0, 0.0, 0.0, 0.0, None, "")


def ever(other: int) -> int:
    """Everybody was heard just now."""
    return 10**18


# ---------------------------------------------------------------- who leads


def test_the_lowest_living_address_takes_over_from_a_silent_leader() -> None:
    times = {0: 0 * S, 1: 0 * S, 2: 11 * S, 3: 11 * S}
    lowest, other = team()[2], team()[3]
    lowest.tick(times.__getitem__, 10 * S)
    assert (lowest.state, lowest.expected) == (State.CANDIDATE, 0)
    lowest.tick(times.__getitem__, 11 * S)
    assert (lowest.state, lowest.term) == (State.LEADER, Term(1, 2))
    other.tick(times.__getitem__, 11 * S)
    assert (other.state, other.expected, other.term) == (State.CANDIDATE, 2, Term(0, 0))
    assert other.changes() == [Led(2, "nothing heard of robot 0")]
    other.status(2, status(2, 1), 12 * S)
    assert (other.state, other.term) == (State.FOLLOWER, Term(1, 2))


def test_a_robot_that_hears_no_other_waits_longer() -> None:
    times = {0: 0, 2: 1 * S, 3: 0}
    replica = team()[1]
    for now, leads in ((20 * S, False), (30 * S, False), (30 * S + 1, True)):
        replica.tick(times.__getitem__, now)
        assert replica.leads is leads


def test_a_leader_never_judges_that_another_leads() -> None:
    leader = team()[0]
    leader.tick(lambda other: 0, 1000 * S)
    assert leader.term == Term(0, 0)


@pytest.mark.parametrize(
    ("term", "plan", "state", "own"),
    [
        (Term(3, 2), 0, State.LEADER, Term(4, 1)),
        (Term(3, 0), 0, State.FOLLOWER, Term(3, 0)),
        (Term(3, 2), 1, State.FOLLOWER, Term(3, 2)),
        (Term(0, 2), 1, State.LEADER, Term(1, 1)),
    ],
    ids=["of a higher address", "of a lower address", "with a later plan", "of a smaller term"],
)
def test_a_leader_that_hears_another(term: Term, plan: int, state: State, own: Term) -> None:
    leader = Replica(1, 4, 1, WAITS, 0)
    leader.term = Term(1, 1)
    leader.status(term.leader, status(term.leader, term.number, plan), S)
    assert (leader.state, leader.term) == (state, own)


@pytest.mark.parametrize("gone", [False, True])
def test_a_leader_hears_of_another_from_those_who_follow_that(gone: bool) -> None:
    leader = team()[0]
    leader.tick(lambda other: 0 if other == 2 and gone else 20 * S, 20 * S)
    leader.status(3, status(2, 5), 20 * S)
    assert (leader.leads, leader.term) == ((True, Term(6, 0)) if gone else (False, Term(5, 2)))


@pytest.mark.parametrize("first", [0, 1])
def test_a_robot_that_has_booted_again_takes_a_term_after_those_that_others_follow(first: int) -> None:
    booted = Replica(1, 4, first, WAITS, 0)
    booted.status(3, status(1, 7), S)
    assert (booted.state, booted.term) == (State.LEADER, Term(8, 1))


@pytest.mark.parametrize("host", [1, 2])
def test_a_leader_that_exceeds_the_greatest_term_that_is_believed_does_not_begin_again_from_0(host: int) -> None:
    leader = Replica(1, 4, 1, WAITS, 0)
    for _ in range(3):
        leader.status(2, codec.decode(codec.encode(status(host, codec.MOST_TERM)), 4), S)
    assert leader.term == Term(codec.MOST_TERM + 1, 1)
    told = codec.encode(status(1, leader.term.number))
    assert told[1:3] == leader.term.number.to_bytes(2, "big")
    with pytest.raises(WireError):
        codec.decode(told, 4)


def test_an_order_of_a_smaller_term_than_was_confirmed_is_not_obeyed() -> None:
    robot = team()[1]
    order = Order(plan=1, serial=0, task="p", robot=1, errand=Halt(robot=1))
    robot.message(0, TOLD, S)
    assert robot.message(0, Ordered(term=0, order=order), S) == order
    robot.status(2, status(2, 1, plan=2), S)
    assert robot.term == Term(1, 2)
    assert robot.message(0, Ordered(term=0, order=order), S) is None
    assert robot.message(2, Ordered(term=1, order=order), S) == order
    earlier = order.model_copy(update={"plan": 0})
    assert robot.message(2, Ordered(term=1, order=earlier), S) is None, "of an earlier plan"
    assert robot.message(2, Ordered(term=1, order=order.model_copy(update={"robot": 3})), S) is None
    later = order.model_copy(update={"plan": 2})
    assert robot.message(3, Ordered(term=1, order=later), S) == later, "of a greater term: it follows that"
    assert robot.term == Term(1, 3)


@pytest.mark.parametrize("gone", [False, True])
def test_a_robot_stays_with_a_leader_that_lives_and_goes_first(gone: bool) -> None:
    robot = team()[3]
    robot.status(0, status(0), S)
    robot.tick(lambda other: 20 * S if not gone or other == 1 else 0, 20 * S)
    robot.status(2, status(2, 1), 20 * S)
    assert robot.expected == (2 if gone else 0)


def test_a_robot_that_hears_no_other_follows_the_first_that_leads_again() -> None:
    robot = team()[3]
    robot.status(0, status(0), 0)
    robot.tick(lambda other: 0, 11 * S)
    assert (robot.state, robot.expected) == (State.FOLLOWER, 0), "it waits longer"
    robot.status(2, status(2, 1), 11 * S)
    assert robot.expected == 2


def test_a_greater_term_of_the_same_leader_is_no_change() -> None:
    robot = team()[3]
    robot.status(0, status(0), 0)
    robot.status(0, status(0, 3), S)
    assert (robot.term, robot.changes()) == (Term(3, 0), [])


def test_a_robot_follows_whom_its_leader_follows() -> None:
    robot = team()[3]
    robot.status(0, status(0), S)
    robot.status(0, status(2, 4), S)
    assert (robot.state, robot.term) == (State.FOLLOWER, Term(4, 2))


# ---------------------------------------------------------------- the log


def leading() -> Replica:
    leader = team(3)[0]
    leader.begin(Record(plan=PLAN, start=0), 1, 0)
    assert [destination for destination, _ in leader.messages()] == [1, 2]
    leader.changes()
    return leader


def test_what_another_lacks_it_is_sent_once_it_has_lacked_that_for_a_while_and_not_again_at_once() -> None:
    leader = leading()
    sent = []
    for second in range(12):
        leader.status(1, status(0), second * S)
        sent += [second] * len(leader.messages())
    assert sent == [5, 10]
    leader.status(1, status(0, plan=1, digest=leader._digest), 13 * S)
    for second in (16, 20, 21):
        leader.status(1, status(0), second * S)
        sent += [second] * len(leader.messages())
    assert sent == [5, 10, 21], "it begins anew once it has lacked nothing"


def test_an_order_is_sent_again_until_its_robot_has_got_it() -> None:
    leader = leading()
    leader.order(Order(plan=1, serial=4, task="p", robot=1, errand=Photo(robot=1)), 0)
    ((to, first),) = leader.messages()
    for second, serial in ((4, 3), (5, 3), (9, 3), (10, 4)):
        leader.status(1, status(0, 0, 1, leader._digest, serial), second * S)
        assert leader.messages() == ([(to, first)] if second == 5 else [])


def test_facts_about_another_plan_or_none_are_not_noted_and_those_that_are_known_are_no_news() -> None:
    leader, idle = leading(), team(3)[0]
    known, facts = leader._digest, (Heard(robot=2, again=False, at=5),)
    for plan in (0, 2):
        leader.message(1, Facts(plan=plan, facts=facts), S)
    idle.message(1, Facts(plan=0, facts=facts), S)
    assert (leader._digest, leader.changes(), idle.changes()) == (known, [], [])
    record = TOLD.record.model_copy(update={"facts": facts})
    for _ in range(2):
        idle.message(1, TOLD.model_copy(update={"record": record}), S)
    assert idle.changes() == [Taken()]
    told = leading()
    told.message(1, TOLD.model_copy(update={"record": record}), S)
    assert told.changes() == [Learned(facts)], "a plan that is known comes with facts"
    for learned in ([Learned(facts)], []):
        leader.message(1, Facts(plan=1, facts=facts), S)
        assert leader.changes() == learned


def test_a_robot_that_follows_another_sends_that_its_facts_at_once() -> None:
    robot = team(3)[1]
    robot.message(0, TOLD, 0)
    robot.note([Heard(robot=2, again=False, at=5)], 0)
    robot.status(2, status(2, 3, 1, robot._digest ^ 1), S)
    ((to, message),) = robot.messages()
    assert (to, type(message)) == (2, Facts)


def test_of_plans_of_one_number_the_leaders_is_taken_once_its_status_tells_of_it() -> None:
    own, stale, later = (TOLD.model_copy(update={"record": Record(plan=PLAN, start=start)}) for start in (0, 1, 2))
    robot, leader = team(3)[1], team(3)[0]
    leader.message(2, later, 0)
    robot.message(2, own, 0)
    known = robot._digest
    robot.status(2, status(0, 0, 1, leader._digest)._replace(over=True), S)
    assert not robot.over, "only the leader's word counts"
    robot.message(0, later, S)
    assert robot._digest == known, "it may have told that before it led"
    robot.status(0, status(0, 0, 1, leader._digest), 2 * S)
    robot.message(2, later, 3 * S)
    robot.message(0, stale, 3 * S)
    assert robot._digest == known, "of another, or another plan"
    robot.message(0, later, 4 * S)
    assert robot._digest == leader._digest
    robot.status(0, status(0, 0, 1, known), 5 * S)
    robot.status(0, status(0, 0, 2, known), 6 * S)
    robot.message(0, own, 7 * S)
    assert robot._digest == leader._digest, "it has a later one by now"
    robot = Replica(2, 3, 1, WAITS, 0)
    robot.message(0, own, 0)
    robot.status(1, status(1, 0, 1, leader._digest), S)
    robot.tick(lambda other: S if other == 1 else 20 * S, 20 * S)
    robot.message(0, later, 20 * S)
    assert (robot.expected, robot._digest) == (0, known), "that was another leader's status"


# ---------------------------------------------------------------- merging


def parted(leader: Replica, now: int) -> None:
    """Let a leader hear of another that has gone on with the same plan."""
    leader.status(2, status(2, 1, 1, leader._digest ^ 1), now)


@pytest.mark.parametrize(("plan", "other"), [(1, 0), (0, 1), (2, 1)])
def test_a_leader_merges_only_with_who_has_other_facts_about_its_plan(plan: int, other: int) -> None:
    leader = leading()
    leader.status(2, status(2, 1, plan, leader._digest ^ other), S)
    assert not leader.merging
    parted(leader, S)
    assert leader.merging is (plan < 2), "one with a later plan goes first"


def test_a_merge_waits_until_all_who_live_agree() -> None:
    leader = leading()
    leader.tick(ever, 0)
    parted(leader, S)
    assert (leader.state, leader.term) == (State.MERGING, Term(2, 0))
    agreed = status(0, 2, 1, leader._digest)
    leader.status(1, agreed, 2 * S)
    leader.tick(ever, 10 * S)
    assert leader.merging, "robot 2 has not agreed"
    leader.status(2, agreed, 11 * S)
    leader.note([Heard(robot=1, again=False, at=5)], 11 * S)
    leader.tick(ever, 12 * S)
    assert leader.merging, "there is a fact that they do not have"
    for robot in (1, 2):
        leader.status(robot, status(0, 2, 1, leader._digest), 13 * S)
    leader.changes()
    leader.tick(ever, 13 * S)
    assert (leader.state, leader.changes()) == (State.LEADER, [Agreed()])


def test_a_merge_waits_for_a_while_in_any_case_and_not_for_ever() -> None:
    leader = leading()
    parted(leader, S)
    for robot in (1, 2):
        leader.status(robot, status(0, 2, 1, leader._digest), S)
    leader.tick(ever, 3 * S - 1)
    assert leader.merging
    leader.tick(ever, 3 * S)
    assert not leader.merging
    parted(leader, 4 * S)
    leader.tick(ever, 4 * S + ALONE - 1)
    assert leader.merging
    leader.tick(ever, 4 * S + ALONE)
    assert not leader.merging


def test_a_merge_does_not_wait_for_the_dead_and_is_not_begun_again_if_it_was_in_vain() -> None:
    leader = leading()
    parted(leader, S)
    leader.status(1, status(0, 2, 1, leader._digest), 2 * S)
    leader.tick(lambda other: 0 if other == 2 else 20 * S, 20 * S)
    assert not leader.merging
    leader.keep()
    parted(leader, 21 * S)
    assert not leader.merging


# ---------------------------------------------------------------- the table


def test_what_the_table_does_not_hold_cannot_happen() -> None:
    follow, lead = (State.FOLLOWER, State.CANDIDATE), (State.LEADER, State.MERGING)
    of_leaders = (Input.PARTED, Input.AGREED)
    of_others = (Input.CONFIRMED, Input.SUCCEEDS, Input.AWAITS)
    impossible = {*product(follow, of_leaders), *product(lead, of_others)}
    impossible |= {(State.LEADER, Input.AGREED), (State.CANDIDATE, Input.PRESUMED), (State.FOLLOWER, Input.CONFIRMED)}
    assert {(state, what) for state in State for what in Input} - TABLE.keys() == impossible
    for state, what in impossible:
        with pytest.raises(LocalProtocolError):
            next_state(TABLE, state, what)


# ---------------------------------------------------------------- all that can happen

QUICK = [Budget(2, 1, 0, 2), Budget(2, 0, 1, 1), Budget(0, 0, 1, 2), Budget(0, 1, 1, 1)]
"""Two losses or delays, a crash with forgetting, a partition, two calls: as many at a time as a few seconds are for."""
LONG = [Budget(1, 1, 1, 1), Budget(2, 0, 1, 2), Budget(2, 1, 1, 1), Budget(0, 1, 1, 2)]
"""A few million states, five minutes."""
WHOLE = Budget(2, 1, 1, 2)
"""134,193,064 states, an hour and a half, ten gigabytes."""
WHOLE_GB = 12
"""Memory that this wants."""
SMALL = [Budget(0, 1, 0, 1), Budget(0, 1, 1, 0), Budget(0, 0, 1, 1), Budget(2, 0, 0, 1), Budget(1, 1, 0, 1)]
"""Small enough for a plain search."""


def shown(budget: Budget) -> str:
    return ", ".join(f"{count} {name}" for name, count in budget._asdict().items() if count)


@pytest.mark.slow
@pytest.mark.parametrize("budget", QUICK, ids=shown)
def test_three_replicas_keep_their_promises_in_every_state(budget: Budget, record_property: Any) -> None:
    record_property("states of three replicas", explored(3, budget).states)


@pytest.mark.slow
@pytest.mark.parametrize("budget", SMALL, ids=shown)
def test_what_the_model_leaves_out_changes_nothing(budget: Budget) -> None:
    plain = explored_plainly(3, budget)
    robots = {*model.Robot.known}
    model.forget()
    found = explored(3, budget)
    assert (found.states, {*model.Robot.known}) == (plain.states, robots)
    assert found.steps < plain.steps


@pytest.mark.soak
@pytest.mark.parametrize("budget", LONG, ids=shown)
def test_three_replicas_keep_their_promises_in_every_state_of_many(budget: Budget, record_property: Any) -> None:
    if soak_count(100) < 100:
        pytest.skip("a share of the states says nothing of the others")
    record_property("states of three replicas", explored(3, budget).states)


@pytest.mark.soak
@pytest.mark.skipif(SOAK_SHARE < 1, reason="takes an hour and a half: only in a whole soak")
def test_three_replicas_keep_their_promises_in_every_state_of_all(record_property: Any) -> None:
    room_gb = os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 2**30
    if room_gb < WHOLE_GB:
        pytest.skip(f"{room_gb:.0f} GB are free, and {WHOLE_GB} are wanted")
    record_property("states of three replicas", explored(3, WHOLE).states)


@pytest.mark.soak
def test_five_replicas_keep_their_promises_in_seeded_schedules(record_property: Any) -> None:
    schedules = soak_count(100_000)
    for seed in range(schedules):
        wander(5, Budget(2, 1, 1, 2), seed, 120)
    record_property("schedules of five replicas", schedules)


# ---------------------------------------------------------------- the model finds what is left out

FAULTY = [Budget(0, 1, 0, 1), Budget(0, 1, 1, 0), Budget(0, 0, 1, 1), Budget(0, 0, 1, 2), Budget(0, 1, 1, 1)]
"""In the order of their sizes: most faults show in the small ones."""
LATER = Budget(0, 1, 1, 2)
"""Of those that show in none of them, some show here."""


def is_found(budgets: list[Budget]) -> bool:
    try:
        for budget in budgets:
            explored(3, budget)
    except (BrokenError, LocalProtocolError):
        return True
    return False


def row_name(row: tuple[State, Input]) -> str:
    return f"{row[0].value} {row[1].name}"


@pytest.mark.slow
@pytest.mark.parametrize("row", [row for row in TABLE if row != (State.MERGING, Input.OUTDATED)], ids=row_name)
def test_a_row_that_is_left_out_is_missed(row: tuple[State, Input], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(TABLE, row)
    assert is_found(FAULTY)


RETURNED: list[tuple[Any, ...]] = [
    ("part", frozenset({0, 1})),
    ("tick", 2),
    ("call", 2),
    ("heal",),
    ("deliver", 2, 0, True),
    ("do", 0),
    ("call", 2),
    ("deliver", 2, 0, True),
    ("status", 0, 1, True),
    ("status", 0, 2, True),
    ("deliver", 2, 0, True),
    ("status", 2, 0, True),
    ("status", 0, 2, True),
    ("crash", 0),
]
"""The shortest way to a state from which a leader that merges hears that it led a greater term before it crashed."""


def test_the_row_that_needs_most_to_happen_is_missed(monkeypatch: pytest.MonkeyPatch) -> None:
    team = Team(3, LATER)
    for action in RETURNED:
        assert action in team.actions()
        team = team.after(action)
    check_liveness(team, {})
    model.forget()
    monkeypatch.delitem(TABLE, (State.MERGING, Input.OUTDATED))
    team = Team(3, LATER)
    for action in RETURNED:
        team = team.after(action)
    with pytest.raises(LocalProtocolError, match="OUTDATED is not legal"):
        check_liveness(team, {})


SPOILT = {
    "orders of smaller terms are obeyed": ("        led = self.term ==", "        led = True or self.term =="),
    "whoever leads contends with any other": ("first = led and", "first = led or"),
    "a merge waits for no answer": ("living <= self._agreeing", "living"),
    "an old term is not exceeded": ("self.term.number) + 1, self.me)", "self.term.number), self.me)"),
    "one that others followed before it booted does not notice": ("if term.leader == self.me and", "if False and"),
    "nobody follows whom its leader follows": ("elif source == self.expected and", "elif False and"),
    "facts of a follower stay with it": ("elif self.leads or source == self.expected:", "elif self.leads:"),
    "plans of equal numbers stay different": (" or (plan == self.number and self._leads_now(source, told))", ""),
    "what a leader told before it led is taken": (
        " and self._leads_by is not None and Ledger(told).began_alike(self._leads_by)",
        "",
    ),
}
"""Conditions of the replica, each of which is left out, or turned round."""


LATE = {"what a leader told before it led is taken"}
"""Those that show in a large model only."""
LATE_MARKS = [pytest.mark.soak, pytest.mark.skipif(SOAK_SHARE < 1, reason="takes long: only in a whole soak")]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("old", "new"),
    [pytest.param(*each, id=name, marks=LATE_MARKS * (name in LATE)) for name, each in SPOILT.items()],
)
def test_a_condition_that_is_left_out_is_missed(old: str, new: str, monkeypatch: pytest.MonkeyPatch) -> None:
    source = Path(str(replicas.__file__)).read_text(encoding="utf-8")
    assert source.count(old) == 1
    spoilt = ModuleType(replicas.__name__)
    monkeypatch.setitem(sys.modules, replicas.__name__, spoilt)  # NamedTuples look their module up
    exec(compile(source.replace(old, new), str(replicas.__file__), "exec"), vars(spoilt))
    for name in ("Replica", "State", "Agreed", "Taken"):
        monkeypatch.setattr(model, name, vars(spoilt)[name])
    assert is_found([*FAULTY, LATER])
