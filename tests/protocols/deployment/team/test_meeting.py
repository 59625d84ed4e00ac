"""A team that was parted meets: once, in agreement, and not again and again."""

import math

import pytest

from cosim.observation import Observation, Seen
from cosim.units import S
from protocols.deployment.executing.executive import Executive
from protocols.deployment.member.others import Others
from protocols.deployment.messages.messages import Told
from protocols.deployment.planning.augmenting import ExecutiveParameters
from protocols.deployment.tasks.events import PlanTaken, RobotFound, RobotLost
from protocols.deployment.tasks.facts import Heard, Record, Terminated
from protocols.deployment.tasks.orders import Halt, Report, Result, Whereabouts
from protocols.deployment.tasks.plan import Deployment, Go, Photo, Place, Plan, Strategy, Task
from protocols.deployment.team.ledger import Ledger
from protocols.deployment.team.reunion import Past, reunited
from tests.protocols.deployment.crew_scene import PLACES_M, TICK
from tests.protocols.deployment.hosts_scene import Robot, Team, drives, over
from tests.protocols.deployment.play_scene import Plain, crew_of

FOUR_M = (*PLACES_M, (6.0, 1.0))
LINE: tuple[Place, ...] = ((10.0, 0.0), (20.0, 0.0), (30.0, 0.0))
EXECUTIVES = ("central", "distributed")


def deploy(strategy: Strategy, places_m: tuple[Place, ...], name: str = "p") -> Task:
    robots = tuple(range(len(places_m)))
    return Task(name=name, act=Deployment(strategy=strategy, robots=robots, places_m=places_m))


def between(some: tuple[int, ...], others: tuple[int, ...]) -> set[tuple[int, int]]:
    return {(a, b) for a in some for b in others} | {(b, a) for a in some for b in others}


def plans(robot: Robot) -> list[int]:
    return [event.plan for _, event in robot.events if isinstance(event, PlanTaken)]


# ---------------------------------------------------------------- once


@pytest.mark.slow
@pytest.mark.parametrize(("size", "parts"), [(4, ((0, 1), (2, 3))), (5, ((0, 1), (2, 3, 4)))])
def test_two_parts_of_a_team_that_meet_begin_one_plan_however_many_they_are(
    size: int, parts: tuple[tuple[int, ...], tuple[int, ...]]
) -> None:
    team = Team(size)
    team.until(1)
    team.play(deploy("group", (*FOUR_M, (7.0, 2.0))[:size]))
    team.until(3)
    team.cut |= between(*parts)
    team.until(40)
    team.cut.clear()
    team.until(41)
    orders = [len(robot.orders) for robot in team.robots]
    lost = [len(robot.times(RobotLost)) for robot in team.robots]
    while team.robots[0].host.number == 1:
        assert [len(robot.orders) for robot in team.robots] == orders, "nobody is ordered anything until then"
        team.tick()
    assert [len(robot.times(RobotLost)) for robot in team.robots] == lost
    team.until(60)
    assert [plans(robot) for robot in team.robots] == [[1, 2]] * size
    assert {robot.host.leader for robot in team.robots} == {0}
    play = team.robots[0].host.play
    assert play is not None
    assert play.ledger.lost == frozenset()


@pytest.mark.slow
@pytest.mark.parametrize("executive", EXECUTIVES)
def test_of_two_hosts_that_begin_a_plan_of_the_same_number_at_once_one_s_is_played_by_all(executive: str) -> None:
    team = Team(3, executive)
    team.until(1)
    photos = tuple(Task(name=f"p/x{robot}", act=Photo(robot=robot), on_failure="skip") for robot in range(3))
    first = Task(name="p/x", order="parallel", subtasks=photos)
    team.play(Task(name="p", subtasks=(first, deploy("wave", PLACES_M, "p/d"))))
    team.until(3)
    team.cut |= between((0, 1), (2,))
    team.until(5)
    team.robots[0].reports("p/x0")
    team.until(40)
    others = team.robots[2]
    others.host.execute(team.robots[2].host.play.ledger.plan.model_copy(update={"number": 2}), {}, 1, team.now)  # type: ignore[union-attr]
    team.robots[0].host.execute(
        team.robots[0].host.play.ledger.plan.model_copy(update={"number": 2}),  # type: ignore[union-attr]
        {0: (1.0, 1.0)},
        1,
        team.now + 1,
    )
    team.cut.clear()
    team.until(70)
    counters = list[Record]()
    for robot in team.robots:
        assert robot.host.play is not None
        counters.append(robot.host.play.ledger.record())
    assert [record.start for record in counters] == [counters[0].start] * 3
    assert [record.plan for record in counters] == [counters[0].plan] * 3
    assert len({robot.host.digest for robot in team.robots}) == 1


def test_until_a_team_meets_nobody_is_ordered_what_has_become_due() -> None:
    team = Team(3)
    team.until(1)
    team.play(drives(3, "serial"))
    team.until(3)
    team.cut |= between((0, 1), (2,))
    team.until(40)
    team.cut.clear()
    team.until(41)
    host = team.robots[0].host
    assert host.busy
    team.robots[0].reports("p/0")
    while host.number == 1:
        team.tick()
    team.until(45)
    assert {robot.me: {order.plan for order in robot.orders} for robot in team.robots} == {0: {1, 2}, 1: {2}, 2: {1, 2}}


def test_a_host_s_plan_replaces_an_equal_one_of_the_same_number_that_began_at_another_time() -> None:
    team = Team(2)
    team.until(1)
    team.play(drives(2))
    team.until(3)
    led = team.robots[1].host
    assert led.play is not None
    record = led.play.ledger.record()
    for later, told in ((0, False), (1, True)):
        again = record.model_copy(update={"start": record.start + later})
        letter = Told(host=0, record=again, calls=1)
        led.hear(0, team.robots[0].news()._replace(digest=Ledger(letter).digest), team.now)
        led.letter(0, letter, team.now)
        assert led.play.ledger.record().start == again.start
        assert (plans(team.robots[1]) == [1, 1]) is told


# ---------------------------------------------------------------- not without end


class Moving(Team):
    """Robots that drive 0.5 m/s, and are heard as far as 10 m, by way of others too."""

    def __init__(self, size: int, executive: str) -> None:
        super().__init__(size, executive)
        self.at_m = list(self.setup.starts_m[:size])
        self.ended = [0] * size
        for robot in self.robots:
            robot.where = lambda robot=robot: self.whereabouts(robot)  # type: ignore[method-assign, misc]

    def whereabouts(self, robot: Robot) -> Whereabouts:
        x_m, y_m = self.at_m[robot.me]
        return Whereabouts(robot=robot.me, x_m=x_m, y_m=y_m, heading_rad=0.0, plan=robot.host.number)

    def reaches(self, source: int, other: int) -> bool:
        heard, pending = {source}, [source]
        while pending:
            here = self.at_m[pending.pop()]
            new = [robot for robot, at in enumerate(self.at_m) if robot not in heard and math.dist(here, at) <= 10.0]
            heard.update(new)
            pending += new
        return super().reaches(source, other) and other in heard

    def tick(self) -> None:
        super().tick()
        for robot in self.robots:
            if len(robot.orders) > self.ended[robot.me]:
                self.drive(robot)

    def drive(self, robot: Robot) -> None:
        order, (x_m, y_m) = robot.orders[-1], self.at_m[robot.me]
        result = Result.TERMINATED if isinstance(order.errand, Halt) else Result.DONE
        if isinstance(order.errand, Go):
            to_m = order.errand.place_m
            share = min(1.0, 0.05 / max(math.dist(to_m, (x_m, y_m)), 1e-9))
            self.at_m[robot.me] = x_m + share * (to_m[0] - x_m), y_m + share * (to_m[1] - y_m)
            if share < 1.0:
                return
        self.ended[robot.me] = len(robot.orders)
        done = Report(plan=order.plan, serial=order.serial, task=order.task, robot=robot.me, result=result, at=self.now)
        robot.host.report(done, self.now)
        robot.settle()


@pytest.mark.slow
@pytest.mark.parametrize(("strategy", "executive"), [("group", "central"), ("wave", "distributed")])
def test_a_place_out_of_reach_does_not_part_and_reunite_a_team_for_ever(strategy: Strategy, executive: str) -> None:
    """Who is out of reach is taken for lost, and the others go to fill its place, and hear of it."""
    places_m = ((5.0, 3.0), (30.0, 2.0), (8.0, 4.5))
    team = Moving(3, executive)
    team.until(1)
    team.play(deploy(strategy, places_m))
    team.until(200)
    numbers = [robot.host.number for robot in team.robots]
    team.until(260)
    assert [robot.host.number for robot in team.robots] == numbers
    assert {(round(x_m, 3), round(y_m, 3)) for x_m, y_m in team.at_m} == set(places_m)


def test_with_fixed_places_nobody_takes_that_of_a_lost_robot_nor_is_switched() -> None:
    act = Deployment(strategy="fixed", robots=(0, 1, 2), places_m=LINE)
    plan = Plan(number=2, play="p", robots=(0, 1, 2), root=Task(name="p", act=act))
    starts_m = {0: (29.0, 0.0), 1: (19.0, 0.0), 2: (9.0, 0.0)}
    lost = (Heard(robot=0, again=False, at=5 * S),)
    record = Record(plan=plan, start=5 * S, starts_m=starts_m, facts=lost)
    executive = Executive.restored(record, crew_of(4), Plain(), ExecutiveParameters(), 5 * S)
    assert {order.robot: order.errand for order in executive.orders()} == {
        robot: Go(robot=robot, place_m=LINE[robot]) for robot in (1, 2)
    }
    executive.lost(1, 6 * S)
    executive.switch("group", 7 * S)
    orders = executive.orders()
    assert [order.errand for order in orders] == [Go(robot=2, place_m=LINE[2])]
    executive.found(1, 7 * S)
    found = [(order.robot, order.errand.act) for order in executive.orders()]
    assert found == [(1, "halt")], "who is there again has to wait until all begin again"
    assert [executive.progress.misses(robot) for robot in range(4)] == [True, True, False, False]
    done = Report(plan=2, serial=1001, task=orders[0].task, robot=2, result=Result.DONE, at=8 * S)
    executive.report(done, 8 * S)
    assert executive.finished
    assert executive.results["p"] is Result.DONE


@pytest.mark.parametrize(("body_m", "place_m"), [((30.0, 0.3), LINE[0]), ((25.0, 0.0), LINE[2])])
def test_who_has_a_fixed_place_on_which_a_lost_robot_stands_takes_an_open_one(body_m: Place, place_m: Place) -> None:
    act = Deployment(strategy="fixed", robots=(0, 1, 2), places_m=LINE)
    plan = Plan(number=2, play="p", robots=(0, 1, 2), root=Task(name="p", act=act))
    record = Record(plan=plan, start=5 * S, facts=(Heard(robot=0, again=False, place_m=body_m, at=5 * S),))
    executive = Executive.restored(record, crew_of(3), Plain(), ExecutiveParameters(), 5 * S)
    goals = {order.robot: order.errand.place_m for order in executive.orders() if isinstance(order.errand, Go)}
    assert goals == {1: LINE[1], 2: place_m}


def test_who_goes_directly_is_not_sent_back_by_a_change_of_strategy() -> None:
    act = Deployment(strategy="direct", robots=(0, 1, 2), places_m=LINE)
    plan = Plan(number=2, play="p", robots=(0, 1, 2), root=Task(name="p", act=act))
    starts_m = {0: (9.0, 0.0), 1: (19.0, 0.0), 2: (29.0, 0.0)}
    executive = Executive(plan, crew_of(3), Plain(), ExecutiveParameters(), 0, starts_m)
    executive.orders()
    executive.switch("group", S)
    assert executive.orders() == []


# ---------------------------------------------------------------- what is not begun again


def test_what_an_operator_has_ended_is_not_begun_again_as_a_team_meets() -> None:
    team = Team(3)
    team.until(1)
    team.play(drives(3))
    team.until(3)
    team.cut |= between((0, 1), (2,))
    team.until(20)
    team.robots[0].host.say(Terminated(task="p", at=team.now), team.now)
    team.until(22)
    team.cut.clear()
    team.until(60)
    assert [robot.host.number for robot in team.robots] == [1, 1, 1]
    assert not team.robots[0].host.busy, "it does not meet again and again to find that nothing is to be done"


def test_a_part_of_a_play_that_an_operator_has_ended_is_left_out_as_somebody_comes_back() -> None:
    team = Team(3)
    team.until(1)
    later = deploy("group", tuple((x_m + 5.0, y_m) for x_m, y_m in PLACES_M), "p/b")
    team.play(Task(name="p", subtasks=(drives(3).model_copy(update={"name": "p/a"}), later)))
    team.until(2)
    team.dead = {2}
    team.until(10)
    team.robots[0].host.say(Terminated(task="p/b", at=team.now), team.now)
    for robot in (0, 1):
        team.robots[robot].reports(f"p/{robot}")
    team.until(12)
    assert over(team.robots[0])
    team.dead = set()
    team.boot(2)
    team.until(30)
    assert [robot.orders[-1].errand for robot in team.robots] == [
        Go(robot=robot, place_m=PLACES_M[robot]) for robot in range(3)
    ]


def test_whoever_stands_in_for_another_does_so_in_a_reunited_plan_too() -> None:
    photo = Task(name="p/photo", act=Photo(robot=2))
    alone = Task(name="p/go", act=Go(robot=4, place_m=(9.0, 9.0)))
    root = Task(name="p", subtasks=(deploy("group", PLACES_M, "p/d"), photo, alone))
    plan = Plan(number=1, play="p", robots=(0, 1, 2, 4), root=root)
    again = reunited(plan, 2, Past(casts={"p/d": (0, 3, 2)}, roles={2: 5, 4: 6}))
    assert again is not None
    acts = [task.act for task in again.root.walk()]
    direct = [act for act in acts if isinstance(act, Deployment)]
    assert [act.robots for act in direct] == [(0, 3, 2), (6,)]
    assert [act for act in acts if isinstance(act, Photo)] == [Photo(robot=5)]
    assert again.robots == (0, 2, 3, 5, 6)


def test_a_spare_robot_stands_in_for_the_lost_one_in_the_cast() -> None:
    act = Deployment(strategy="group", robots=(0, 1, 2), places_m=LINE)
    plan = Plan(number=2, play="p", robots=(0, 1, 2), root=Task(name="p", act=act))
    executive = Executive(plan, crew_of(4), Plain(), ExecutiveParameters(), 0)
    executive.lost(1, S)
    assert executive.progress.deployments["p"].cast == (0, 3, 2)


@pytest.mark.parametrize("root", [drives(3), deploy("group", PLACES_M)])
def test_nobody_is_sent_where_a_spare_robot_stands_that_has_taken_over(root: Task) -> None:
    team = Team(4)
    team.until(1)
    plan = Plan(number=1, play="p", robots=(0, 1, 2), root=root)
    team.robots[0].host.execute(plan, dict(enumerate(team.setup.starts_m)), 1, team.now)
    team.robots[0].settle()
    team.until(3)
    team.dead = {2}
    for at_s in range(10, 40, 2):  # whatever they are ordered they have done by the next time
        team.until(at_s)
        for robot in team.living:
            if robot.orders:
                robot.reports(robot.orders[-1].task)
    assert over(team.robots[0])
    assert team.robots[3].orders
    team.dead = set()
    team.boot(2)
    team.until(60)
    assert team.robots[0].times(RobotFound, robot=2)
    assert [robot.host.number for robot in team.robots] == [1, 1, 1, 1]


def test_who_is_found_before_the_end_and_has_no_part_any_more_is_called_at_the_end() -> None:
    team = Team(3)
    team.play(drives(3))
    team.dead = {2}
    team.until(10)
    team.dead = set()
    team.boot(2)
    team.until(20)
    assert team.robots[0].times(RobotFound, robot=2)
    assert [robot.host.number for robot in team.robots] == [1, 1, 1], "the others are still on their way"
    for robot in (0, 1):
        team.robots[robot].reports(f"p/{robot}")
    team.until(21)
    assert over(team.robots[0])
    assert team.robots[0].host.busy, "it has called a meeting"
    team.until(30)
    assert team.robots[2].orders[-1].errand == Go(robot=2, place_m=PLACES_M[2])


def test_of_whom_nothing_was_ever_heard_that_is_infinitely_old() -> None:
    bodies, starts_m = crew_of(2).bodies, [(0.0, 0.0), (3.0, 0.0)]
    seen = Observation(0.0, 0.0, 0.0, 0.0, True, False, Seen((1,), ((1, 3.0, 0.0),)))  # type: ignore[arg-type]
    (other,) = Others(0, bodies, starts_m).look(seen, 5 * TICK)
    assert other.age_s == math.inf
