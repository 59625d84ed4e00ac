"""What a robot knows of a plan: the same for those who have heard the same, and what others lack of it."""

from itertools import permutations
from typing import Any

import pytest

from cosim.units import S
from protocols.deployment.messages.messages import Ordered, Told
from protocols.deployment.messages.status import News
from protocols.deployment.tasks.facts import Ended, Fact, Heard, Record, Switched, Terminated
from protocols.deployment.tasks.orders import Order, Result
from protocols.deployment.tasks.plan import Go, Plan, Task
from protocols.deployment.team.ledger import Ledger
from tests.protocols.deployment.crew_scene import TICK, call, rows, run

SILENCE_OF_RUNS = 4 * S

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
    assert ledger.lacking(news(2), 0, 1, order) == [ledger.told(0)]
    assert ledger.lacking(news(4), 0, 1, order) == []
    assert ledger.lacking(news(3, ledger.digest, 4), 0, 1, order) == []
    assert ledger.lacking(news(3, ledger.digest, 3), 0, 1, order) == [Ordered(term=1, order=order)]
    assert ledger.lacking(news(3, ledger.digest ^ 1, None), 0, 1, None) == [ledger.facts()]
    assert ledger.lacking(news(3, ledger.digest ^ 1 << 31, None), 0, 1, order) == [ledger.told(0)], "another plan 3"
    ledger.add(FACTS[:1])
    assert ledger.lacking(news(3, ledger.digest, None), 0, 1, order) == [], "it has ended"


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
