"""A team that was parted goes on together, straight to where its play ends, and so does who comes back later."""

import math
from itertools import permutations

import pytest

from cosim.observation import Observation
from cosim.units import S
from protocols.deployment.executing.executive import Executive
from protocols.deployment.executing.recovery import lengths, reassigned
from protocols.deployment.planning.augmenting import ExecutiveParameters
from protocols.deployment.planning.methods import expanded_to, stages
from protocols.deployment.planning.staging import StageLeg, remaining
from protocols.deployment.tasks.events import RobotFound, RobotLost
from protocols.deployment.tasks.facts import Heard, Terminated
from protocols.deployment.tasks.orders import Report, Result
from protocols.deployment.tasks.plan import Deployment, Go, Photo, Place, Plan, Strategy, Task
from protocols.deployment.team.reunion import Past, is_reunited, reunited
from protocols.motion.traffic import Other, Traffic
from tests.protocols.deployment.crew_scene import PLACES_M
from tests.protocols.deployment.hosts_scene import Team, drives, over
from tests.protocols.deployment.play_scene import Plain, Scene, Troubles, crew_of

LINE: tuple[Place, ...] = ((10.0, 0.0), (20.0, 0.0), (30.0, 0.0), (40.0, 0.0))


def deploy(strategy: Strategy, robots: tuple[int, ...], places_m: tuple[Place, ...], name: str = "p/deploy") -> Task:
    return Task(name=name, act=Deployment(strategy=strategy, robots=robots, places_m=places_m))


def plan_of(*subtasks: Task) -> Plan:
    return Plan(number=1, play="p", robots=(0, 1, 2, 3), root=Task(name="p", subtasks=subtasks))


def parts(plan: Plan | None, fixed: bool = False) -> list[dict[int, Place]]:
    """Return the deployments of a reunited plan: who is to come to where."""
    assert plan is not None
    assert is_reunited(plan)
    (places,) = [task for task in plan.root.subtasks if task.label == "places"]
    found = list[dict[int, Place]]()
    for task in places.subtasks:
        assert isinstance(task.act, Deployment)
        assert task.act.strategy == ("fixed" if fixed else "direct")
        found.append(dict(zip(task.act.robots, task.act.places_m, strict=True)))
    return found


# ---------------------------------------------------------------- the plan


@pytest.mark.parametrize("depth", [-1, None])
def test_a_reunited_team_goes_straight_to_where_the_play_ends(depth: int | None) -> None:
    whole = expanded_to(deploy("wave", (2, 0), ((1.0, 1.0), (2.0, 2.0))), depth)
    first = Task(name="p/go", act=Go(robot=0, place_m=(9.0, 9.0)))
    again = reunited(plan_of(first, whole), 2, Past())
    assert again is not None
    assert (again.number, again.play, again.robots) == (2, "p", (0, 2))
    assert parts(again) == [{2: (1.0, 1.0), 0: (2.0, 2.0)}]
    assert [task.on_failure for task in again.root.subtasks[-1].subtasks] == ["fail"]
    twice = reunited(again, 3, Past())
    assert twice is not None
    assert parts(twice, fixed=True) == parts(again), "nobody goes to fill a place out of reach"
    thrice = reunited(twice, 4, Past())
    assert thrice is not None
    assert thrice.root == twice.root


def test_each_deployment_keeps_those_of_its_robots_that_end_up_there() -> None:
    gather = deploy("group", (0, 1, 2, 3), LINE, "p/gather")
    alone = Task(name="p/alone", act=Go(robot=3, place_m=(9.0, 9.0)))
    beyond = deploy("leap_frog", (2, 1), ((50.0, 0.0), (60.0, 0.0)), "p/beyond")
    again = reunited(plan_of(gather, alone, beyond), 2, Past())
    found = parts(again)
    assert again is not None
    assert {task.on_failure for task in again.root.subtasks[-1].subtasks} == {"skip"}, "one ends no other"
    assert found == [{0: LINE[0]}, {2: (50.0, 0.0), 1: (60.0, 0.0)}, {3: (9.0, 9.0)}]


def test_nothing_is_begun_again_that_leads_nowhere() -> None:
    assert reunited(plan_of(Task(name="p/photo", act=Photo(robot=0))), 2, Past()) is None


# ---------------------------------------------------------------- how it is played


def test_who_goes_directly_has_one_stage_and_only_if_it_is_not_there() -> None:
    assert stages(Deployment(strategy="direct", robots=(5, 3), places_m=LINE[:2])) == [
        [(5, LINE[0], True), (3, LINE[1], True)]
    ]
    assert remaining("direct", {0: 1, 1: 0, 2: 2}, {0: 1, 1: -1, 2: 0}) == [[StageLeg(1, 0), StageLeg(2, 2)]]
    assert remaining("direct", {0: 1}, {0: 1}) == []


@pytest.mark.parametrize("at_m", list(permutations([0.0, 12.0, 14.0, 39.0])))
def test_in_a_corridor_nobody_who_goes_directly_passes_another(at_m: tuple[float, ...]) -> None:
    crew = crew_of(4)
    stands_m = {robot: (x_m, 0.0) for robot, x_m in enumerate(at_m)}
    posts = reassigned("direct", [0, 1, 2, 3], dict.fromkeys(range(4), -1), stands_m, LINE, lengths(crew, Plain()))
    assert [robot for robot, _ in sorted(posts.items(), key=lambda item: item[1])] == sorted(
        range(4), key=at_m.__getitem__
    )


def test_who_stands_at_a_place_as_all_go_directly_keeps_that_and_the_others_fill_the_rest() -> None:
    act = Deployment(strategy="direct", robots=(0, 1, 2), places_m=LINE[:3])
    plan = Plan(number=1, play="p", robots=(0, 1, 2), root=Task(name="p", act=act))
    starts_m = {0: LINE[1], 1: LINE[2], 2: (0.0, 0.0)}
    executive = Executive(plan, crew_of(3), Plain(), ExecutiveParameters(), 0, starts_m)
    goals = {order.robot: order.errand.place_m for order in executive.orders() if isinstance(order.errand, Go)}
    assert goals == {0: LINE[1], 1: LINE[2], 2: LINE[0]}


@pytest.mark.parametrize("dead", range(4))
@pytest.mark.parametrize("at_s", [1.0, 15.0, 29.0])
def test_after_a_death_the_others_go_to_the_first_places_that_are_open(dead: int, at_s: float) -> None:
    plan = reunited(plan_of(deploy("wave", (0, 1, 2, 3), LINE)), 2, Past())
    assert plan is not None
    scene = Scene(plan, crew_of(4), troubles=Troubles(deaths={dead: at_s})).run()
    body = scene.robots[dead].at_m
    if math.dist(body, LINE[3]) > 1.0 or at_s < 29.0:  # else all had ended before
        open_first = sorted(LINE, key=lambda place: math.dist(place, body) < 2.0 * scene.crew.radius_m(dead))
        living = [robot.at_m for robot in scene.robots if robot.alive]
        assert {place for place in LINE if any(math.dist(place, at) < 0.2 for at in living)} == set(open_first[:3])


def test_who_has_only_passed_a_place_is_sent_there_if_it_is_to_end_up_there() -> None:
    """It has come as near as those let it that stood there: in one run 1.1 m short of what became its post."""
    crew = crew_of(3)
    plan = Plan(number=1, play="p", robots=(0, 1, 2), root=deploy("wave", (0, 1, 2), LINE[:3], "deploy"))
    executive = Executive(plan, crew, Plain(), ExecutiveParameters(), 0)

    def done(task: str, robot: int, at_s: int) -> None:
        report = Report(plan=1, serial=0, task=task, robot=robot, result=Result.DONE, at=at_s * S)
        executive.report(report, at_s * S)

    done("deploy/stage-1/robot-2", 2, 10)
    done("deploy/stage-2/robot-2", 2, 20)
    executive.orders()
    executive.lost(1, 30 * S)
    orders = {order.robot: order.errand for order in executive.orders()}
    assert orders == {0: Go(robot=0, place_m=LINE[0]), 2: Go(robot=2, place_m=LINE[1])}


# ---------------------------------------------------------------- hosts


def test_a_team_that_was_parted_still_takes_the_pictures_of_which_the_host_has_not_heard() -> None:
    team = Team(3)
    team.until(1)
    seen = Task(name="p/seen", act=Photo(robot=0), on_failure="skip")
    last = Task(name="p/look", act=Photo(robot=2, heading_rad=1.0), on_failure="skip")
    team.play(Task(name="p", subtasks=(seen, drives(3).model_copy(update={"name": "p/go"}), last)))
    team.until(2.0)
    team.robots[0].reports("p/seen")
    away = {(a, 2) for a in (0, 1)} | {(2, a) for a in (0, 1)}
    team.until(3.0)
    team.cut |= away
    team.until(20.0)
    assert team.robots[0].times(RobotLost, robot=2) != []
    assert team.robots[2].host.leads
    team.cut -= away
    team.until(24.0)
    orders = [order for order in team.robots[2].orders if order.plan == 2]
    assert [order.errand for order in orders] == [Go(robot=2, place_m=PLACES_M[2], final=False)]
    team.robots[2].reports(orders[-1].task, plan=2)
    team.until(25.0)
    last_order = team.robots[2].orders[-1]
    assert last_order.errand == Photo(robot=2, heading_rad=1.0)
    team.robots[2].reports(last_order.task, plan=2)
    team.until(26.0)
    assert team.robots[2].orders[-1].errand == Go(robot=2, place_m=PLACES_M[2])
    mine = [order for order in team.robots[0].orders if order.plan == 2]
    assert [order.errand.act for order in mine] == ["go"], "its picture was taken"


def test_who_is_lost_already_as_a_team_meets_again_is_not_waited_for() -> None:
    team = Team(4)
    team.until(1)
    team.play(deploy("group", (0, 1, 2, 3), (*PLACES_M, (6.0, 1.0)), "p"))
    team.until(3)
    team.dead = {3}
    away = {(a, 2) for a in (0, 1)} | {(2, a) for a in (0, 1)}
    team.cut |= away
    team.until(20)
    team.cut -= away
    team.until(24)
    play = team.robots[0].host.play
    assert play is not None
    record = play.ledger.record()
    assert play.number == 2
    assert [fact for fact in record.facts if isinstance(fact, Heard)] == [
        Heard(robot=3, again=False, place_m=team.setup.starts_m[3], at=record.start)
    ]
    assert record.starts_m == dict(enumerate(team.setup.starts_m)), "the host's own place is among them"


def test_nothing_more_is_sent_to_who_is_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    team, forgotten = Team(), list[int]()
    monkeypatch.setattr(team.robots[0], "forget", lambda other, now: forgotten.append(other))
    team.play(drives(3))
    team.dead = {2}
    team.until(10)
    assert forgotten == [2]


def test_who_is_found_again_after_a_reunion_is_sent_where_it_belongs() -> None:
    """Its deployment has ended without it."""
    team = Team()
    team.play(drives(3).model_copy(update={"name": "p/reunited"}))
    team.dead = {2}
    team.until(30)
    assert team.robots[0].times(RobotLost, robot=2)
    team.dead = set()
    team.boot(2)
    team.until(60)
    assert team.robots[0].times(RobotFound, robot=2)
    assert [robot.host.number for robot in team.robots] == [2, 2, 2]
    goes = [order.errand for order in team.robots[2].orders]
    assert goes[-1] == Go(robot=2, place_m=PLACES_M[2])


@pytest.mark.parametrize("ended", ["done", "terminated", "without it"])
def test_who_comes_back_when_the_play_is_over_is_called_to_its_place_unless_that_was_given_up(ended: str) -> None:
    team = Team()
    team.play(drives(3))
    if ended != "without it":
        team.dead = {2}
    team.until(10)
    if ended == "terminated":
        team.robots[0].host.say(Terminated(task="p", at=team.now), team.now)
    for robot in (0, 1):
        team.robots[robot].reports(f"p/{robot}")
    if ended == "without it":
        team.robots[2].reports("p/2")
        team.until(11)
        team.dead = {2}
    team.until(20)
    assert over(team.robots[0])
    team.dead = set()
    team.boot(2)
    team.until(40)
    found = team.robots[0].times(RobotFound, robot=2)
    numbers = [robot.host.number for robot in team.robots]
    if ended == "done":
        assert found
        assert numbers == [2, 2, 2]
        assert team.robots[2].orders[-1].errand == Go(robot=2, place_m=PLACES_M[2])
    else:
        assert numbers == [1, 1, 1]
        assert bool(found) == (ended == "terminated"), "nobody is lost to a play that is over"


# ---------------------------------------------------------------- the dead in the way


@pytest.mark.parametrize(
    ("age_s", "stands_s", "idle"), [(15.0, 15.0, True), (14.9, 15.0, False), (15.0, 14.9, False), (0.0, 99.0, False)]
)
def test_nobody_makes_way_for_one_that_has_been_silent_and_still_for_long(
    age_s: float, stands_s: float, idle: bool
) -> None:
    traffic = Traffic(0, 0.3, 0.01, 0.1)
    observation = Observation(0.0, 0.0, 0.0, 0.0, True, False)
    other = Other(1, 3.0, 4.0, 0.3, goal_m=(9.0, 9.0))
    traffic.look(observation, [other], 0)
    traffic.look(observation, [other._replace(age_s=age_s)], round(stands_s * S))
    track = traffic.of(1)
    assert track is not None
    assert track.idle == idle
