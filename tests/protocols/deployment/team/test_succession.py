"""Who is host: who takes over, who yields, and what a ledger of facts and the gossip about it make of that."""

from itertools import permutations
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.units import S
from protocols.deployment.messages.messages import Ordered, Told
from protocols.deployment.messages.status import News
from protocols.deployment.tasks.facts import Ended, Fact, Heard, Record, Switched, Terminated
from protocols.deployment.tasks.orders import Order, Result
from protocols.deployment.tasks.plan import Go, Plan, Task
from protocols.deployment.team.gossip import Gossip, lacking
from protocols.deployment.team.ledger import Ledger
from protocols.deployment.team.succession import Succession
from tests.protocols.deployment.crew_scene import TICK, call, rows, run

SILENCE, ALONE = 10 * S, 30 * S
SILENCE_OF_RUNS = 4 * S


def team(size: int = 4, first: int = 0) -> list[Succession]:
    return [Succession(me, size, first, SILENCE, ALONE) for me in range(size)]


# ---------------------------------------------------------------- who takes over


def test_the_lowest_living_address_takes_over_from_a_silent_host() -> None:
    times = {0: 0 * S, 1: 0 * S, 2: 11 * S, 3: 11 * S}
    succession = team()[2]
    assert not succession.judge(times.__getitem__, 10 * S)
    assert succession.judge(times.__getitem__, 11 * S)
    assert (succession.host, succession.leads, succession.term) == (2, True, 1)
    other = team()[3]
    assert other.judge(times.__getitem__, 11 * S)
    assert (other.host, other.leads) == (2, False)


def test_who_hears_nobody_waits_longer() -> None:
    times = {0: 0, 2: 1 * S, 3: 0}
    succession = team()[1]
    assert not succession.judge(times.__getitem__, 20 * S)
    assert not succession.judge(times.__getitem__, 30 * S)
    assert succession.judge(times.__getitem__, 30 * S + 1)
    assert succession.leads


def test_the_host_itself_never_judges_that_another_leads() -> None:
    assert not team()[0].judge(lambda other: 0, 1000 * S)


@pytest.mark.parametrize("first", [0, 2])
def test_of_two_hosts_with_one_plan_the_lower_address_stays(first: int) -> None:
    high, low = team(first=3)[3], team(first=first)[first]
    assert high.claimed(first, low.term, 1, 1)
    assert (high.host, high.leads) == (first, False)
    assert not low.claimed(3, high.term, 1, 1)
    assert low.leads


def test_of_two_hosts_the_one_with_the_later_plan_stays() -> None:
    rebooted = team()[0]
    assert rebooted.claimed(3, 5, 2, 0)
    assert (rebooted.host, rebooted.term) == (3, 5)
    leading = Succession(3, 4, 3, SILENCE, ALONE)
    assert not leading.claimed(0, 0, 0, 2)
    assert leading.leads


def test_whoever_says_to_be_host_is_followed_by_who_only_guesses() -> None:
    guessing = team()[3]
    times = {0: 0, 1: 11 * S, 2: 11 * S}
    guessing.judge(times.__getitem__, 11 * S)
    assert guessing.host == 1
    assert guessing.claimed(2, 7, 1, 1)
    assert guessing.host == 2
    assert guessing.claimed(1, 7, 1, 1), "now both have said so"
    assert not guessing.claimed(2, 7, 1, 1)


@given(st.permutations(range(4)), st.lists(st.tuples(st.integers(0, 3), st.integers(0, 3)), max_size=12))
def test_a_team_whose_robots_all_claim_to_be_host_agrees_once_all_have_heard_all(
    order: list[int], early: object
) -> None:
    robots = [Succession(me, 4, me, SILENCE, ALONE) for me in range(4)]
    for _ in range(2):
        for source in order:
            for other in robots:
                if robots[source].leads and other.me != source:
                    other.claimed(source, robots[source].term, 1, 1)
    assert [each.host for each in robots] == [0, 0, 0, 0]


def test_a_host_learns_from_news_that_another_has_led_meanwhile() -> None:
    host = team()[0]
    assert not host.rivalled(2, 0, 0)
    assert host.rivalled(2, 2, 0), "it says to be host"
    assert host.rivalled(3, 0, host.term + 1), "its term counts a host of which this one knows nothing"
    assert not host.rivalled(3, 0, host.term)


# ---------------------------------------------------------------- what is known

GO = Task(name="play/go", act=Go(robot=1, place_m=(3.0, 4.0)))
PLAN = Plan(number=3, play="play", robots=(0, 1, 2), root=Task(name="play", subtasks=(GO,)))
TOLD = Told(host=0, record=Record(plan=PLAN, start=5), calls=2)
FACTS: list[Fact] = [
    Ended(task="play/go", robot=1, result=Result.DONE, at=7),
    Heard(robot=2, again=False, at=9),
    Heard(robot=2, again=True, at=12),
    Switched(strategy="group", at=10),
    Terminated(task="play", at=11),
]


@pytest.mark.parametrize("order", list(permutations(range(5)))[::17])
def test_ledgers_that_know_the_same_are_the_same_in_whatever_order_they_heard_it(order: tuple[int, ...]) -> None:
    one, other = Ledger(TOLD), Ledger(TOLD)
    assert one.add(FACTS) == FACTS
    for at in order:
        other.add([FACTS[at]])
        other.add([FACTS[at]])
    assert one.digest == other.digest
    assert one.facts() == other.facts()
    assert one.lost == other.lost == frozenset()
    assert one.add(FACTS) == []


def test_every_fact_changes_the_digest() -> None:
    ledger = Ledger(TOLD)
    digests = [ledger.digest]
    for fact in FACTS:
        ledger.add([fact])
        digests.append(ledger.digest)
    assert len(set(digests)) == len(digests)


def test_a_robot_is_lost_by_what_was_said_last_of_it() -> None:
    ledger = Ledger(TOLD)
    ledger.add([FACTS[2]])
    ledger.add([FACTS[1]])
    assert ledger.lost == frozenset()
    ledger.add([Heard(robot=2, again=False, at=20)])
    assert ledger.lost == {2}


def news(plan: int = 3, digest: int = 0, serial: int | None = None) -> News:
    return News(0, 0, plan, 0, digest, serial, False, 0.0, 0.0, 0.0, 0.0, None, "")


def test_who_knows_less_is_told_what_it_lacks() -> None:
    ledger = Ledger(TOLD)
    ledger.add(FACTS[1:])
    order = Order(plan=3, serial=4, task="play/go", robot=1, errand=Go(robot=1, place_m=(3.0, 4.0)))
    assert lacking(ledger, news(2), 0, order, 1) == [ledger.told(0)]
    assert lacking(ledger, news(4), 0, order, 1) == []
    assert lacking(ledger, news(3, ledger.digest, 4), 0, order, 1) == []
    assert lacking(ledger, news(3, ledger.digest, 3), 0, order, 1) == [Ordered(term=1, order=order)]
    assert lacking(ledger, news(3, ledger.digest ^ 1, None), 0, None, 1) == [ledger.facts()]
    assert lacking(ledger, news(3, ledger.digest ^ 1 << 31, None), 0, order, 1) == [ledger.told(0)], "another plan 3"
    ledger.add(FACTS[:1])
    assert lacking(ledger, news(3, ledger.digest, None), 0, order, 1) == [], "it has ended"


def test_a_difference_is_told_only_if_it_lasts_and_not_again_at_once() -> None:
    gossip = Gossip(5 * S)
    assert not gossip.overdue(1, True, 0)
    assert not gossip.overdue(1, True, 4 * S)
    assert gossip.overdue(1, True, 5 * S)
    assert not gossip.overdue(1, True, 9 * S)
    assert gossip.overdue(1, True, 10 * S)
    assert not gossip.overdue(1, False, 11 * S)
    assert not gossip.overdue(1, True, 16 * S), "it begins anew"
    gossip.told(2, 17 * S)
    assert not gossip.overdue(2, True, 21 * S)
    assert gossip.overdue(2, True, 22 * S)


# ---------------------------------------------------------------- with whole machines


@pytest.mark.slow
@pytest.mark.parametrize("executive", ["central", "distributed"])
def test_a_dead_host_is_lost_at_the_instant_at_which_another_leads(executive: str) -> None:
    quick: Any = {"silence_s": SILENCE_OF_RUNS / S, "alone_s": 12.0, "again_s": 2.0}
    kill = {"kind": "kill", "robot": 0, "at_s": 14.0}
    outcome = run("ideal", [kill], executive=executive, calls=[call("deploy/wave")], **quick)
    (lost,) = rows(outcome, "RobotLost")
    changed = [row["time_ns"] for row in rows(outcome, "HostChanged") if row["source"] == 1]
    assert (lost["source"], lost["robot"]) == (1, 0)
    assert changed == [lost["time_ns"]]
    assert lost["time_ns"] <= 14 * S + SILENCE_OF_RUNS + 2 * TICK
    assert outcome.metrics["deployed"] == 1.0
