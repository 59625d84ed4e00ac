"""What a dead host has taken with it: plans that nobody else was told, calls, ends, changes of strategy."""

import json
from typing import Any

import numpy as np
import pytest

from cosim.machine import OPERATOR, Address, Outgoing, Reception
from cosim.observation import Observation
from cosim.units import S, Time, to_seconds
from protocols.deployment.counters import Counters
from protocols.deployment.messages import status
from protocols.deployment.messages.messages import Facts, Told
from protocols.deployment.messages.status import News
from protocols.deployment.operator.calls import Calls
from protocols.deployment.parameters import Parameters
from protocols.deployment.runner import Runner
from protocols.deployment.tasks.events import Breached, HostChanged, PlanEnded
from protocols.deployment.tasks.facts import Record
from protocols.deployment.tasks.plan import Between, Instant, Photo, Plan, Task
from protocols.deployment.team.replica import Replica, Waits
from protocols.transport.frames import ALL, Frame, Publication, encode
from tests.protocols.deployment.crew_scene import BY_CABLE, PLACES_M, STARTS_M, TICK, call, rows, run, setup
from tests.protocols.deployment.hosts_scene import Robot, Team, drives, over

QUICK: dict[str, Any] = {"silence_s": 4.0, "alone_s": 12.0, "again_s": 2.0}


class Listener:
    """The machine of robot 1 of three, which stands, and hears what the test has others say."""

    def __init__(self, me: Address = 1, **parameters: Any) -> None:
        own, known = setup(**QUICK, **parameters)
        self.runner = Runner(own, known, me, 0, np.random.default_rng(me))
        self.now: Time = 0
        self.frames = 0
        self.finished: list[Time] = []

    def hear(self, source: Address, host: Address, plan: int, calls: int) -> None:
        self.frames += 1
        told = News(host, 0, plan, calls, 0, None, True, *STARTS_M[source], 0.0, 0.0, None, "")
        news = Publication(status.TOPIC, self.frames, status.encode(told))
        data = encode(Frame(source, ALL, 0, news))
        self.runner.receive(data, Reception(source, True), self.now)

    def ask(self, say: str, **more: Any) -> dict[str, Any]:
        """Ask as an operator, and return the answer."""
        self.runner.receive(json.dumps({"request": 1, "say": say, **more}).encode(), BY_CABLE, self.now)
        said = [each for each in self.runner.outbox() if isinstance(each, Outgoing) and each.destination == OPERATOR]
        answers: list[dict[str, Any]] = [json.loads(each.payload) for each in said]
        return next(each for each in answers if each.get("answer") == 1)

    def until(self, at_s: float, *speakers: tuple[Address, Address, int, int]) -> None:
        """Let time pass; each speaker says the same all along: its source, host, plan and calls."""
        while self.now < at_s * S:
            self.now += TICK
            if self.now % S == 0:
                for speaker in speakers:
                    self.hear(*speaker)
            seen = Observation(*STARTS_M[self.runner.me], 0.0, 0.0, True, False)
            self.runner.observe(seen, self.now)
            self.runner.outbox()
            if self.runner.finished:
                self.finished.append(self.now)


# ---------------------------------------------------------------- plans


@pytest.mark.slow
def test_a_play_whose_plan_has_died_with_its_host_is_called_again() -> None:
    robot = Listener(calls=[call(places=PLACES_M[:2])])
    robot.until(2.0, (0, 0, 0, 0), (2, 0, 0, 0))
    robot.until(3.0, (0, 0, 1, 1), (2, 0, 0, 0))
    assert robot.runner.host.busy, "the host can tell it the plan"
    robot.until(10.0, (2, 0, 0, 0))
    host = robot.runner.host
    assert host.leads
    assert host.play is not None
    assert host.number == 2, "somebody may be at orders of plan 1"
    assert host.calls == 1
    assert robot.finished == []


def test_a_new_host_waits_for_a_plan_that_another_knows_who_lives() -> None:
    robot = Listener(calls=[call()])
    robot.until(3.0, (0, 0, 1, 1), (2, 0, 1, 1))
    robot.until(20.0, (2, 1, 1, 1))
    host = robot.runner.host
    assert host.leads
    assert host.busy
    assert (host.play, robot.runner.counters.plans) == (None, 0)


def test_a_call_that_was_refused_is_not_made_again_by_a_new_host() -> None:
    robot = Listener(calls=[call()])
    robot.until(3.0, (0, 0, 0, 1), (2, 0, 0, 1))
    robot.until(12.0, (2, 0, 0, 1))
    assert robot.runner.host.leads
    assert (robot.runner.counters.plans, robot.runner.counters.refused) == (0, 0)


def test_calls_of_a_plan_that_is_not_known_here_count_once_it_is() -> None:
    replica = Replica(1, 3, 0, Waits(4 * S, 12 * S, 5 * S, 2 * S), 0)

    def hear(source: int, plan: int, calls: int) -> None:
        replica.status(source, News(0, 0, plan, calls, 0, None, False, 0.0, 0.0, 0.0, 0.0, None, ""), 0)

    hear(0, 2, 3)
    assert (replica.calls, replica.newest, replica.awaited) == (0, 2, True)
    replica.tick({0: 0, 2: 9 * S}.__getitem__, 10 * S)
    assert not replica.awaited, "who knows it is silent"
    hear(2, 1, 1)
    assert (replica.calls, replica.newest, replica.awaited) == (0, 2, True)
    for number, calls in ((1, 1), (2, 3)):
        plan = Plan(number=number, play="p", robots=(0,), root=Task(name="p", act=Photo(robot=0)))
        replica.message(0, Told(host=0, record=Record(plan=plan, start=0)), 0)
        assert replica.calls == calls
    assert not replica.awaited


# ---------------------------------------------------------------- ends


def ends(team: Team) -> list[tuple[Address, int]]:
    return [
        (robot.me, event.plan) for robot in team.robots for _, event in robot.events if isinstance(event, PlanEnded)
    ]


@pytest.mark.parametrize("executive", ["central", "distributed"])
def test_a_play_that_ends_while_nobody_leads_is_said_to_have_ended_by_the_next_host(executive: str) -> None:
    team = Team(3, executive)
    team.until(1)
    team.play(drives(3, "serial"))
    team.robots[0].reports("p/0")
    team.until(2.0)
    team.robots[1].reports("p/1")
    team.until(4.5)
    team.dead.add(0)
    team.until(7.0)
    team.robots[2].reports("p/2")
    team.tick()
    assert all(robot.host.busy for robot in team.living), "nobody has said that it is over"
    team.until(12.0)
    assert team.robots[1].host.leads
    assert ends(team) == [(1, 1)]
    assert not any(robot.host.busy for robot in team.living)


@pytest.mark.parametrize("executive", ["central", "distributed"])
def test_the_end_of_a_play_is_not_said_again_by_a_new_host_nor_by_one_that_was_booted(executive: str) -> None:
    team = Team(3, executive)
    team.until(1)
    team.play(drives(3))
    team.until(2.5)
    for robot in team.robots:
        robot.reports(f"p/{robot.me}")
    team.until(5.0)
    assert ends(team) == [(0, 1)]
    before = team.robots[0]
    team.boot(0)
    team.until(10.0)
    assert over(team.robots[0])
    assert ends(team) == []
    team.dead.add(0)
    team.until(20.0)
    assert team.robots[1].host.leads
    assert over(team.robots[1])
    assert ends(team) == []
    assert len(before.times(PlanEnded)) == 1


@pytest.mark.parametrize("executive", ["central", "distributed"])
def test_of_windows_that_break_a_new_host_names_those_that_its_predecessor_cannot_have(executive: str) -> None:
    team = Team(3, executive)
    team.until(1)
    late = [Between(later=Instant(task=f"p/{robot}", edge="end"), at_most_s=at_s) for robot, at_s in ((1, 2), (2, 6))]
    team.play(drives(3), constraints=tuple(late))
    team.until(5.5)
    assert len(team.robots[0].times(Breached)) == 1
    team.dead.add(0)
    team.until(20.0)
    new = team.robots[1]
    assert new.host.leads
    assert [event.why.count("p/2") for _, event in new.events if isinstance(event, Breached)] == [1]
    assert team.robots[2].times(Breached) == []


@pytest.mark.slow
def test_a_run_goes_on_until_somebody_says_that_the_play_is_over() -> None:
    plain = run(executive="distributed", calls=[call()], **QUICK)
    end_s = plain.metrics["played_s"]
    kill = {"kind": "kill", "robot": 0, "at_s": round(end_s - 3.0, 1)}
    outcome = run(executive="distributed", calls=[call()], faults=[kill], **QUICK)
    (ended,) = rows(outcome, "PlanEnded")
    assert ended["source"] == 1
    assert outcome.metrics["plans_ended"] == 1.0


# ---------------------------------------------------------------- the scenario's changes and calls


class Switching:
    """A team with a scenario that changes the strategy."""

    def __init__(self, switches: list[tuple[float, str]]) -> None:
        self.team = Team(3)
        plain = [{"at_s": at_s, "strategy": strategy} for at_s, strategy in switches]
        own = Parameters.model_validate({"switches": plain})
        nobody: Any = None
        self.calls = [Calls(own, nobody, robot.host, robot.note, Counters(), 0) for robot in self.team.robots]

    def until(self, at_s: float) -> None:
        while self.team.now < at_s * S:
            self.team.tick()
            for robot in self.team.living:
                self.calls[robot.me].tick(self.team.now)

    def said(self) -> list[tuple[float, str]]:
        """Return the changes that the team's living robots know of, with their times."""
        known = {self._facts(robot) for robot in self.team.living}
        assert len(known) == 1
        return list(known.pop())

    @staticmethod
    def _facts(robot: Robot) -> tuple[tuple[float, str], ...]:
        assert robot.host.play is not None
        facts: Facts = robot.host.play.ledger.facts()
        return tuple((to_seconds(fact.at), fact.strategy) for fact in facts.facts if fact.fact == "switched")


def test_a_new_host_says_only_the_last_change_that_its_predecessor_has_not_said() -> None:
    scene = Switching([(3.0, "wave"), (6.0, "leap_frog"), (6.5, "wave"), (30.0, "group")])
    scene.until(2.0)
    scene.team.play(drives(3))
    scene.until(5.0)
    assert scene.said() == [(3.0, "wave")]
    scene.team.dead.add(0)
    scene.until(20.0)
    (led,) = scene.team.robots[1].times(HostChanged)
    assert scene.said() == [(3.0, "wave"), (to_seconds(led), "wave")]
    scene.until(31.0)
    assert scene.said()[2:] == [(30.0, "group")]


def test_a_new_host_says_no_change_that_was_said_nor_one_from_before_the_play() -> None:
    scene = Switching([(2.5, "leap_frog"), (5.0, "wave")])
    scene.until(4.0)
    scene.team.play(drives(3))
    scene.until(4.5)
    assert scene.said() == [], "nothing was played then"
    scene.until(7.0)
    assert scene.said() == [(5.0, "wave")]
    scene.team.dead.add(0)
    scene.until(20.0)
    assert scene.team.robots[1].host.leads
    assert scene.said() == [(5.0, "wave")]


def test_a_change_from_before_the_play_is_not_made_up_for_by_a_new_host() -> None:
    scene = Switching([(2.5, "leap_frog")])
    scene.until(4.0)
    scene.team.play(drives(3))
    scene.until(5.0)
    scene.team.dead.add(0)
    scene.until(20.0)
    assert scene.team.robots[1].host.leads
    assert scene.said() == []


@pytest.mark.slow
def test_calls_are_timed_from_the_start_of_the_run_whenever_the_host_was_booted() -> None:
    back = call("return", None, parameters={"robots": 3})
    back["call"].pop("places")
    crash = {"kind": "crash", "robot": 0, "at_s": 20.0, "for_s": 1.0}
    calls = [call(places=PLACES_M, parameters={"robots": [0, 1, 2]}), {"at_s": 70.0, **back}]
    outcome = run(faults=[crash], calls=calls, **QUICK)
    taken = [row["time_ns"] for row in rows(outcome, "PlanTaken") if (row["source"], row["plan"]) == (0, 2)]
    assert len(taken) == 1
    assert 70 * S <= taken[0] <= 70 * S + TICK
    assert outcome.metrics["plans_done"] == 2.0


# ---------------------------------------------------------------- false rivals


def test_who_followed_another_in_vain_does_not_make_the_team_begin_anew() -> None:
    team = Team(4)
    team.until(1)
    team.play(drives(4))
    team.until(4.0)
    team.cut |= {(0, 3), (3, 0)}
    team.spoilt |= {(0, 3), (3, 0)}
    team.until(6.0)
    team.robots[1].reports("p/1")
    team.until(12.0)
    assert team.robots[3].host.leader == 1, "in vain: that follows robot 0"
    team.cut.clear()
    team.until(13.9)
    team.robots[2].reports("p/2")
    team.until(16.0)
    team.spoilt.clear()
    team.until(25.0)
    assert team.robots[3].host.leader == 0
    assert [robot.host.number for robot in team.robots] == [1, 1, 1, 1]
    for robot in team.robots:
        assert robot.host.play is not None
        assert not robot.host.play.ledger.lost


def test_a_host_that_has_led_and_died_is_a_rival_all_the_same() -> None:
    """Robot 1 led 2 and 3 while 0 was out of touch; 0 never heard it, but hears of its term."""
    team = Team(4)
    team.until(1)
    team.play(drives(4))
    team.until(3.0)
    away = {(a, b) for a in (0,) for b in (1, 2, 3)} | {(b, a) for a in (0,) for b in (1, 2, 3)}
    team.cut |= away
    team.until(12.0)
    assert [robot.host.leader for robot in team.robots] == [0, 1, 1, 1]
    team.dead.add(1)
    team.cut.clear()
    team.until(20.0)
    assert [robot.host.number for robot in team.living] == [2, 2, 2]


# ---------------------------------------------------------------- an operator in the meantime


def test_an_operator_can_neither_end_nor_change_a_play_of_which_the_host_was_not_told_yet() -> None:
    robot = Listener(0)
    robot.until(3.0, (1, 0, 5, 0))
    assert robot.runner.host.busy
    assert robot.ask("terminate")["why"] == robot.ask("switch", strategy="wave")["why"] == "nothing is being played"


@pytest.mark.slow
def test_a_play_that_an_operator_calls_meanwhile_gets_a_number_that_no_plan_has() -> None:
    robot = Listener(0)
    robot.until(3.0, (1, 0, 5, 0), (2, 0, 0, 0))
    shown = robot.ask("call", call={"play": "deploy/group", "places": PLACES_M})
    assert shown["plan"]["number"] == 6
    robot.until(4.0, (1, 0, 6, 0))
    assert robot.ask("execute", plan=6)["plan"] == 7
    assert robot.runner.host.number == 7
