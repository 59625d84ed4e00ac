"""Hosts of one team, without robots that drive: who is lost when, what a new host knows, what is not done twice."""

import pytest

from cosim.machine import Address
from cosim.units import S, Time
from protocols.deployment.messages import status
from protocols.deployment.messages.messages import Ordered
from protocols.deployment.messages.status import News
from protocols.deployment.tasks.events import HostChanged, PlanTaken, RobotLost
from protocols.deployment.tasks.facts import Ended
from protocols.deployment.tasks.orders import Halt, Result
from tests.protocols.deployment.crew_scene import TICK
from tests.protocols.deployment.hosts_scene import SILENCE, Robot, Team, drives, over

# ---------------------------------------------------------------- who is lost when


@pytest.mark.parametrize("executive", ["central", "distributed"])
def test_a_host_that_fell_silent_is_lost_as_soon_as_another_leads(executive: str) -> None:
    team = Team(4, executive)
    team.until(1)
    team.play(drives(4))
    team.until(5.0)
    team.dead.add(0)
    team.until(20.0)
    new = team.robots[1]
    last = new.when(0)
    assert last == 5 * S
    assert new.times(HostChanged) == [last + SILENCE + TICK]
    assert new.times(RobotLost, robot=0) == [last + SILENCE + TICK]
    for robot in team.living:
        assert robot.host.play is not None
        assert robot.host.play.ledger.lost == {0}
        assert robot.times(RobotLost, robot=robot.me) == []


@pytest.mark.parametrize("executive", ["central", "distributed"])
def test_hosts_that_die_one_after_the_other_are_lost_as_soon_as_the_last_one_leads(executive: str) -> None:
    team = Team(4, executive)
    team.until(1)
    team.play(drives(4))
    team.until(5.0)
    team.dead.add(0)
    team.until(7.0)
    team.dead.add(1)
    team.until(20.0)
    new = team.robots[2]
    assert new.when(1) == 6 * S + TICK
    assert [host for _, host in _hosts(new)] == [1, 2]
    lost = new.when(1) + SILENCE + TICK
    assert new.times(RobotLost) == [lost, lost]
    assert new.host.play is not None
    assert new.host.play.ledger.lost == {0, 1}


def _hosts(robot: Robot) -> list[tuple[Time, Address]]:
    return [(at, event.host) for at, event in robot.events if isinstance(event, HostChanged)]


def test_a_new_host_gives_those_time_that_were_out_of_touch_with_the_old_one() -> None:
    """Where radios need links, their slaves hear each other by their master, and nobody once that has died."""
    team = Team(4)
    team.until(1)
    team.play(drives(4))
    team.until(5.0)
    team.dead.add(0)
    pairs = {(a, b) for a in (1, 2, 3) for b in (1, 2, 3)}
    team.cut |= pairs
    team.until(8.0)
    team.cut -= {(1, 2), (2, 1)}  # robot 2 has a link with its new master, robot 3 not yet
    team.until(12.0)
    new = team.robots[1]
    (changed,) = new.times(HostChanged)
    assert new.times(RobotLost, robot=0) == [changed]
    assert now_silent(new, 3, changed)
    team.until((changed + SILENCE) / S)
    assert new.times(RobotLost, robot=3) == []
    team.tick()
    assert new.times(RobotLost, robot=3) == [changed + SILENCE + TICK]
    assert new.times(RobotLost, robot=2) == []


def now_silent(robot: Robot, other: Address, now: Time) -> bool:
    return now - robot.when(other) > SILENCE


def test_a_former_host_that_was_heard_again_is_given_time_like_the_others() -> None:
    team = Team(3)
    team.until(1)
    team.play(drives(3))
    team.until(5.0)
    replica = team.robots[2].host.replica
    replica.tick({0: 5 * S, 1: 9 * S}.__getitem__, 10 * S)
    assert replica.expected == 1
    replica.since = 20 * S
    assert replica.missed(0, 5 * S, False, 10 * S)
    assert not replica.missed(0, 10 * S + 1, False, 24 * S), "it was heard since, and there is another host"
    assert replica.missed(0, 10 * S + 1, False, 24 * S + 1)
    assert not replica.missed(1, 9 * S, False, 24 * S)
    assert replica.missed(1, 9 * S, False, 24 * S + 1)


def test_a_host_that_hears_nobody_takes_its_predecessor_for_lost_by_the_longer_patience() -> None:
    team = Team(3)
    team.until(1)
    team.play(drives(3))
    team.until(5.0)
    team.dead |= {0, 2}
    team.until(30.0)
    new = team.robots[1]
    assert new.times(RobotLost, robot=0) == new.times(HostChanged) == [5 * S + 12 * S + TICK]
    assert new.times(RobotLost, robot=2) == [5 * S + 2 * 12 * S + 2 * TICK]


# ---------------------------------------------------------------- reports that a dead host has taken with it


def test_a_robot_does_not_do_again_what_only_a_dead_host_has_heard_that_it_has_done() -> None:
    team = Team(3)
    team.until(1)
    team.play(drives(3, "serial"))
    team.robots[0].reports("p/0")
    team.until(2.0)
    assert [order.task for order in team.robots[1].orders] == ["p/1"]
    team.robots[1].reports("p/1")
    team.until(4.0)
    assert [order.task for order in team.robots[2].orders] == ["p/2"]
    team.spoilt.add((2, 1))
    team.robots[2].reports("p/2")
    team.tick()
    assert team.robots[0].host.play is not None
    assert team.robots[0].host.play.over
    team.dead.add(0)
    team.letters.clear()
    team.until(5.0)
    team.spoilt.clear()
    while not team.robots[1].host.leads:
        team.tick()
    led = team.now
    assert not over(team.robots[1])
    while not over(team.robots[1]):
        team.tick()
    assert team.now <= led + 2 * TICK, "one letter to and fro"
    assert [order.task for order in team.robots[2].orders] == ["p/2"], "nothing is done twice"


def test_what_has_failed_or_was_halted_is_done_again_when_it_is_ordered_again() -> None:
    team = Team(3)
    team.until(1)
    team.play(drives(3))
    team.until(2.0)
    robot = team.robots[2]
    (order,) = robot.orders
    robot.reports("p/2", Result.TERMINATED)
    assert robot.host.play is not None
    assert robot.host.play.ledger.done(order) is None
    robot.reports("p/2")
    done = robot.host.play.ledger.done(order)
    assert done == Ended(task="p/2", robot=2, result=Result.DONE, at=team.now)
    assert robot.host.play.ledger.done(order.model_copy(update={"plan": 2})) is None
    assert robot.host.play.ledger.done(order.model_copy(update={"robot": 1})) is None


def test_what_a_robot_ends_before_it_has_been_told_the_plan_again_is_not_forgotten() -> None:
    team = Team(3)
    team.until(1)
    team.play(drives(3))
    team.robots[0].reports("p/0")
    team.until(2.0)
    team.robots[1].reports("p/1")
    team.until(4.0)
    team.boot(2)
    host = team.robots[0].host
    assert host.play is not None
    order = host.replica._ordered.get(2)
    assert order is not None
    team.robots[2].orders.append(order)  # a letter that was on its way when it booted: it is where it is to be
    team.robots[2].reports("p/2")
    assert team.robots[2].host.play is None
    team.until(10.0)
    assert team.robots[2].times(PlanTaken, plan=1) != []
    assert over(team.robots[0])


def test_a_halt_is_obeyed_whatever_has_been_done() -> None:
    team = Team(3)
    team.until(1)
    team.play(drives(3))
    team.until(2.0)
    robot = team.robots[2]
    robot.reports("p/2")
    halt = robot.orders[0].model_copy(update={"serial": 9, "errand": Halt(robot=2)})
    robot.host.letter(0, Ordered(term=0, order=halt), team.now)
    robot.settle()
    assert robot.orders[-1] == halt


# ---------------------------------------------------------------- when a play is over


def test_those_who_do_not_run_a_play_are_busy_until_the_host_says_that_it_is_over() -> None:
    team = Team(3)
    team.until(1)
    team.play(drives(3))
    team.until(2.5)
    for robot in team.robots:
        robot.reports(f"p/{robot.me}")
    team.tick()
    assert over(team.robots[0])
    assert [robot.host.busy for robot in team.robots] == [False, True, True]
    team.until(2.9)
    assert team.robots[1].host.busy, "the host's next news are told at 3.0 s"
    team.until(3.0)
    assert [robot.host.busy for robot in team.robots] == [False, False, False]
    team.play(drives(3), number=2)
    team.tick()
    assert [robot.host.busy for robot in team.robots] == [True, True, True]
    team.until(5.0)
    assert [robot.host.busy for robot in team.robots] == [True, True, True]


@pytest.mark.parametrize("flags", [(False, False), (True, False), (False, True), (True, True)])
def test_news_say_whether_the_play_is_over_beside_whether_the_robot_is_idle(flags: tuple[bool, bool]) -> None:
    idle, done = flags
    news = News(0, 0, 3, 0, 7, None, idle, 1.0, 2.0, 0.0, 0.0, None, "", done)
    assert status.decode(status.encode(news), 3) == news
