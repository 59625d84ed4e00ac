"""The judge of deployments sees who holds the places, who touches whom, and who moves in which stage."""

import math

import numpy as np
import pytest

from cosim.protocol import Death, Surroundings
from cosim.units import MS, S, Time
from protocols.deployment.planning.methods import expanded
from protocols.deployment.referee import HELD_M, MOST_STAGES, REFEREE_METRICS, TOUCH_M, DeploymentReferee
from protocols.deployment.tasks.events import Driving, PlanBegun, TaskEnded
from protocols.deployment.tasks.plan import Deployment, Place, Plan, Strategy, Task, ends_m

TICK = 100 * MS
RADIUS_M = 0.25
WALLS = np.array([[0.0, 0.0, 30.0, 0.0], [30.0, 0.0, 30.0, 30.0], [30.0, 30.0, 0.0, 30.0], [0.0, 30.0, 0.0, 0.0]])
POSTS: list[Place] = [(10.0, 5.0), (15.0, 5.0), (20.0, 5.0), (25.0, 5.0)]
STARTS: list[Place] = [(2.0, 5.0), (2.0, 7.0), (2.0, 9.0), (2.0, 11.0)]


class Scene:
    """A team whose bodies are put where a test wants them."""

    def __init__(self, size: int = 2, radii_m: tuple[float, ...] = (), interference: bool = True) -> None:
        self.places = [list(place) for place in STARTS[:size]]
        surroundings = Surroundings(
            starts_m=tuple(STARTS[:size]),
            radius_m=RADIUS_M,
            speed_mps=1.0,
            acceleration_mps2=1.0,
            tick=TICK,
            walls_m=WALLS,
            bounds_m=(0.0, 0.0, 30.0, 30.0),
            forbidden=lambda points: np.zeros(len(points), np.bool_),
            radii_m=radii_m,
        )
        self.referee = DeploymentReferee(interference, surroundings)
        self.now: Time = 0

    def put(self, robot: int, x_m: float, y_m: float) -> None:
        self.places[robot] = [x_m, y_m]

    def look(self, ticks: int = 1) -> None:
        for _ in range(ticks):
            self.now += TICK
            x_m, y_m = np.array(self.places).T
            assert not self.referee.look(x_m, y_m, self.now)

    def kill(self, robot: int) -> None:
        x_m, y_m = self.places[robot]
        self.referee.died(Death(robot, self.now, x_m, y_m, RADIUS_M))

    def begin(self, size: int = 2, number: int = 1, strategy: Strategy = "group") -> Plan:
        act = Deployment(strategy=strategy, robots=tuple(range(size)), places_m=tuple(POSTS[:size]))
        root = expanded(Task(name="deploy", act=act))
        plan = Plan(number=number, play="deploy", robots=act.robots, root=root)
        self.begins(plan)
        return plan

    def begins(self, plan: Plan) -> None:
        self.referee.note(0, PlanBegun(plan.number, plan.robots, tuple(ends_m(plan.root).values())), self.now)

    def drives(self, robot: int, task: str, waits: bool, speeds_mps: tuple[float, float] | None) -> None:
        self.referee.note(robot, Driving(task, waits, not waits, speeds_mps), self.now)

    def ends(self, robot: int) -> None:
        self.referee.note(robot, TaskEnded(1, 0, "t", "done", "", *self.places[robot]), self.now)

    def metric(self, name: str) -> float:
        return self.referee.verdict(self.now)[name]


def test_the_verdict_is_what_is_declared() -> None:
    assert list(Scene().referee.verdict(0)) == [metric.name for metric in REFEREE_METRICS]


def test_a_team_is_deployed_when_all_places_are_held_by_robots_that_stand() -> None:
    scene = Scene()
    scene.look(10)
    scene.begin()  # at 1 s
    scene.put(0, *POSTS[0])
    scene.look(20)
    assert math.isnan(scene.metric("deployment_s"))
    assert scene.metric("places_held") == 0.5
    scene.put(1, *POSTS[1])
    scene.look()  # it has just come: it moves
    assert math.isnan(scene.metric("deployment_s"))
    scene.look()
    assert scene.metric("deployment_s") == pytest.approx(2.2)
    assert scene.metric("deployed") == 1.0
    scene.look(50)
    assert scene.metric("deployment_s") == pytest.approx(2.2)


def test_it_does_not_matter_who_holds_which_place() -> None:
    scene = Scene()
    scene.begin()
    scene.put(0, *POSTS[1])
    scene.put(1, *POSTS[0])
    scene.look(2)
    assert scene.metric("deployed") == 1.0


@pytest.mark.parametrize(("off_m", "held"), [(0.99 * HELD_M, 1.0), (1.01 * HELD_M, 0.0), (2 * RADIUS_M, 0.0)])
def test_a_place_is_held_from_nearby_only(off_m: float, held: float) -> None:
    scene = Scene()
    scene.begin()
    scene.put(0, *POSTS[0])
    scene.put(1, POSTS[1][0], POSTS[1][1] + off_m)
    scene.look(2)
    assert scene.metric("deployed") == held


def test_a_team_that_leaves_its_places_does_not_end_deployed() -> None:
    scene = Scene()
    scene.begin()
    for robot in (0, 1):
        scene.put(robot, *POSTS[robot])
    scene.look(60)
    scene.put(1, 3.0, 3.0)
    scene.look(2)
    assert scene.metric("deployed") == 0.0
    assert scene.metric("deployment_s") == pytest.approx(0.2)


@pytest.mark.parametrize(("ticks", "passed"), [(51, True), (52, False)])
def test_places_that_are_held_in_passing_only_do_not_count(ticks: int, passed: bool) -> None:
    """At the first of the ticks a robot has just come, so it stands for 4.9 s, or for 5 s."""
    scene = Scene()
    scene.begin()
    for robot in (0, 1):
        scene.put(robot, *POSTS[robot])
    scene.look(ticks)
    assert scene.metric("deployment_s") == pytest.approx(0.2)  # if the run ended here
    scene.put(0, *POSTS[2])
    scene.look(2)
    assert math.isnan(scene.metric("deployment_s")) is passed
    scene.put(0, *POSTS[0])
    scene.look(60)
    assert scene.metric("deployment_s") == pytest.approx(ticks * 0.1 + 0.4 if passed else 0.2)


def test_a_stage_that_the_living_pass_is_not_taken_for_their_places_when_a_robot_dies() -> None:
    """Three of four stand at the places of a wave's third stage as the fourth, which is to come last, is killed."""
    scene = Scene(4)
    scene.begin(4)
    for robot in (0, 1, 2):
        scene.put(robot, *POSTS[robot])
    scene.look(10)
    scene.kill(3)
    scene.look(20)
    for robot in (0, 1, 2):
        scene.put(robot, POSTS[robot][0] + 2.5, POSTS[robot][1])
    scene.look(20)
    assert math.isnan(scene.metric("deployment_s"))
    for robot in (0, 1, 2):
        scene.put(robot, *POSTS[robot + 1])
    scene.look(60)
    assert scene.metric("deployment_s") == pytest.approx(5.2)


def test_without_a_plan_nobody_is_deployed() -> None:
    scene = Scene()
    scene.look(3)
    assert scene.metric("deployed") == 0.0
    assert math.isnan(scene.metric("places_held"))


def test_the_living_hold_as_many_places_as_they_are() -> None:
    scene = Scene(3)
    scene.begin(3)
    scene.put(0, *POSTS[0])
    scene.look(2)
    scene.kill(2)
    scene.look()
    assert math.isnan(scene.metric("deployment_s"))
    scene.put(1, *POSTS[2])
    scene.look(2)
    assert scene.metric("deployed") == 1.0
    assert scene.metric("places_held") == pytest.approx(2 / 3)


def test_a_dead_robot_holds_nothing_and_a_place_below_it_cannot_be_held() -> None:
    scene = Scene()
    scene.begin()
    scene.put(0, *POSTS[0])
    scene.look(2)
    scene.kill(0)
    scene.look()
    assert scene.metric("places_held") == 0.0
    scene.put(1, *POSTS[1])
    scene.look(2)
    assert scene.metric("deployed") == 1.0


def test_a_team_of_which_nobody_lives_is_not_deployed() -> None:
    scene = Scene()
    scene.begin()
    for robot in (0, 1):
        scene.put(robot, *POSTS[robot])
        scene.kill(robot)
    scene.look(2)
    assert scene.metric("deployed") == 0.0
    assert math.isnan(scene.metric("deployment_s"))


@pytest.mark.parametrize(("off_m", "enough"), [(0.0, 1.0), (0.19, 1.0), (0.21, 0.0)])
def test_the_body_of_another_team_s_dead_robot_covers_a_place_if_nobody_gets_near_enough(
    off_m: float, enough: float
) -> None:
    """Two bodies of 0.25 m are 0.5 m apart at least, and a place is held from 0.3 m."""
    scene = Scene(4)
    scene.begin(3)
    scene.put(3, POSTS[0][0], POSTS[0][1] + off_m)
    scene.kill(3)
    scene.put(0, *POSTS[1])
    scene.look(2)
    assert scene.metric("deployed") == 0.0
    scene.put(1, *POSTS[2])
    scene.look(2)
    assert scene.metric("deployed") == enough


def test_both_the_time_and_the_end_are_those_of_the_last_plan() -> None:
    scene = Scene()
    scene.begin(2, number=1)
    for robot in (0, 1):
        scene.put(robot, *POSTS[robot])
    scene.look(2)
    scene.put(1, 3.0, 3.0)
    scene.look(10)
    home = Deployment(strategy="group", robots=(0, 1), places_m=tuple(STARTS[:2]))
    scene.begins(Plan(number=2, play="home", robots=(0, 1), root=Task(name="home", act=home)))
    scene.look(30)
    assert scene.metric("deployed") == 0.0
    assert math.isnan(scene.metric("deployment_s"))
    for robot in (0, 1):
        scene.put(robot, *STARTS[robot])
    scene.look(2)
    assert scene.metric("deployed") == 1.0
    assert scene.metric("deployment_s") == pytest.approx(3.2)
    assert scene.metric("unoccupied_s") == 0.0


def test_the_time_of_a_plan_that_goes_on_with_another_counts_from_that_one() -> None:
    """So does a plan by which two parts of a team are reunited: to the same places, by another number."""
    scene = Scene(3)
    scene.look(10)
    scene.begin(3, number=1)
    scene.look(20)
    scene.begin(2, number=2)
    scene.look(10)
    scene.begin(2, number=3, strategy="wave")
    for robot in (0, 1):
        scene.put(robot, *POSTS[robot])
    scene.look(2)
    assert scene.metric("deployed") == 1.0
    assert scene.metric("deployment_s") == pytest.approx(1.2)


def test_a_place_that_is_left_is_unoccupied_until_somebody_comes_back() -> None:
    scene = Scene()
    scene.begin()
    scene.put(0, *POSTS[0])
    scene.look(2)
    scene.put(0, 10.0, 8.0)
    scene.look(30)
    scene.put(0, *POSTS[0])
    scene.look(20)
    assert scene.metric("unoccupied_s") == pytest.approx(3.1)  # at the first of these ticks it has just come


def test_the_way_is_that_of_each_robot_in_the_mean() -> None:
    scene = Scene()
    scene.look()
    scene.put(0, 2.0, 4.0)
    scene.look()
    scene.put(0, 5.0, 8.0)
    scene.look()
    assert scene.metric("way_m") == pytest.approx((1.0 + 5.0) / 2)


# ---------------------------------------------------------------- contacts


def test_a_contact_counts_once_until_the_bodies_part() -> None:
    scene = Scene(2, (0.25, 0.35))
    for gap_m in (0.5 * TOUCH_M, 0.0, 2 * TOUCH_M, 0.0):
        scene.put(0, 10.0, 10.0)
        scene.put(1, 10.0 + 0.25 + 0.35 + gap_m, 10.0)
        scene.look(3)
    assert scene.metric("collisions") == 2
    assert scene.metric("nearest_m") == pytest.approx(0.0, abs=1e-12)


def test_bodies_that_pass_close_do_not_collide() -> None:
    scene = Scene(2)
    scene.put(0, 10.0, 10.0)
    scene.put(1, 10.0 + 2 * RADIUS_M + 0.01, 10.0)
    scene.look(3)
    scene.put(1, 20.0, 10.0)
    scene.look()
    assert scene.metric("collisions") == 0
    assert scene.metric("nearest_m") == pytest.approx(0.01)


def test_a_body_at_a_wall_is_a_contact_of_its_own_radius() -> None:
    scene = Scene(2, (0.25, 0.45))
    scene.put(0, 10.0, 0.3)
    scene.put(1, 20.0, 0.5)
    scene.look(2)
    assert scene.metric("wall_contacts") == 0
    scene.put(1, 20.0, 0.45 + 0.5 * TOUCH_M)
    scene.look(2)
    assert scene.metric("wall_contacts") == 1


# ---------------------------------------------------------------- stages


def run_stages(strategy: Strategy, size: int) -> Scene:
    """Carry out the expanded strategy, each move at once, one tick after its beginning."""
    scene = Scene(size)
    plan = scene.begin(size, strategy=strategy)
    for stage in plan.root.subtasks:
        groups = [stage.subtasks] if stage.order == "parallel" else [(each,) for each in stage.subtasks]
        for moves in groups:
            for move in moves:
                assert move.act is not None
                assert move.act.act == "go"
                scene.drives(move.act.robot, move.name, False, None)
            scene.look()
            for move in moves:
                assert move.act is not None
                assert move.act.act == "go"
                scene.put(move.act.robot, *move.act.place_m)
            scene.look()
            for move in moves:
                assert move.act is not None
                assert move.act.act == "go"
                scene.ends(move.act.robot)
    scene.look(2)
    return scene


@pytest.mark.parametrize("size", [2, 3, 4])
@pytest.mark.parametrize("strategy", ["group", "wave", "leap_frog"])
def test_the_number_of_moving_robots_is_that_of_the_strategy(strategy: Strategy, size: int) -> None:
    scene = run_stages(strategy, size)
    falling = list(range(size, 0, -1))
    expected = {"group": falling, "wave": falling[::-1], "leap_frog": [1] * size}[strategy]
    assert [scene.metric(f"moving_{n}") for n in range(1, size + 1)] == expected
    assert scene.metric("stages") == size
    assert all(math.isnan(scene.metric(f"moving_{n}")) for n in range(size + 1, MOST_STAGES + 1))
    assert scene.metric("deployed") == 1.0


def test_who_steps_aside_or_is_pushed_does_not_move_in_the_stage() -> None:
    scene = Scene()
    scene.begin()
    scene.drives(1, "deploy/stage-1/robot-1", False, None)
    scene.look()
    scene.put(0, 3.0, 3.0)
    scene.put(1, 2.0, 7.05)
    scene.look()
    assert scene.metric("stages") == 0
    scene.put(1, 2.0, 8.0)
    scene.look()
    assert scene.metric("moving_1") == 1


def test_interference_is_what_the_robots_report() -> None:
    scene = Scene()
    for _ in range(20):
        scene.drives(0, "a/b", False, (0.1, 0.4))
    scene.drives(1, "a/b", True, None)
    assert scene.metric("interference_s") == pytest.approx(1.5)
    assert scene.metric("hindered_s") == pytest.approx(2.0)
    assert scene.metric("under_way_s") == pytest.approx(2.0)
    assert scene.metric("waited_s") == pytest.approx(0.1)
    assert scene.now < S


def test_interference_that_was_not_asked_for_is_unknown() -> None:
    scene = Scene(interference=False)
    scene.drives(0, "a/b", False, None)
    scene.drives(1, "a/b", True, None)
    assert math.isnan(scene.metric("interference_s"))
    assert math.isnan(scene.metric("hindered_s"))
    assert scene.metric("under_way_s") == scene.metric("waited_s") == pytest.approx(0.1)
