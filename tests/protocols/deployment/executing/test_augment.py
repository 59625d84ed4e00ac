"""What is left of deployments, where robots of a group stand, who makes room, who takes over."""

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocols.deployment.executing.executive import Executive
from protocols.deployment.executing.recovery import lengths, reassigned, substitute
from protocols.deployment.planning.augmenting import ExecutiveParameters, Standing, along, in_line, in_the_way, off_m
from protocols.deployment.planning.methods import stages
from protocols.deployment.planning.staging import NOWHERE, remaining
from protocols.deployment.tasks.crew import Body, Crew
from protocols.deployment.tasks.orders import Report, Result, Retreat, Whereabouts
from protocols.deployment.tasks.plan import Deployment, Go, Place, Plan, Task
from tests.protocols.deployment.play_scene import Plain, Scene, Troubles, crew_of

STRATEGIES = ("group", "wave", "leap_frog")
SETTINGS = ExecutiveParameters()


class Corridor(Plain):
    """A corridor along x, 2 m wide, with a pillar that nobody can stand in from x = 2 to 3.5; the rest is rock."""

    def free(self, radius_m: float, at: Place) -> bool:
        return abs(at[1]) + radius_m <= 1.0 and not 2.0 - radius_m < at[0] < 3.5 + radius_m

    def length_m(self, radius_m: float, a: Place, b: Place) -> float | None:
        return math.dist(a, b)


class Narrow(Corridor):
    """The same, where there is no way to a place that is not free."""

    def length_m(self, radius_m: float, a: Place, b: Place) -> float | None:
        return math.dist(a, b) if self.free(radius_m, b) else None


# ---------------------------------------------------------------- stages


@pytest.mark.parametrize("strategy", STRATEGIES)
@pytest.mark.parametrize("size", range(1, 7))
def test_from_the_beginning_what_is_left_are_the_stages_of_the_figure(strategy: str, size: int):
    places = tuple((float(number), 0.0) for number in range(size))
    act = Deployment(strategy=strategy, robots=tuple(range(size)), places_m=places)  # type: ignore[arg-type]
    figure = [[(move.robot, move.place_m) for move in stage] for stage in stages(act)]
    left = remaining(act.strategy, {robot: robot for robot in range(size)}, dict.fromkeys(range(size), NOWHERE))
    assert [[(robot, places[place]) for robot, place in stage] for stage in left] == figure


@pytest.mark.slow
@given(st.data(), st.integers(1, 6), st.sampled_from(STRATEGIES))
def test_from_anywhere_all_come_to_their_posts_and_no_two_to_one_place(data: st.DataObject, size: int, strategy: str):
    order = data.draw(st.permutations(range(size)))
    posts = dict(enumerate(order))
    reached = {robot: data.draw(st.integers(NOWHERE, size)) for robot in range(size)}
    stands = dict(reached)
    for stage in remaining(strategy, posts, reached):  # type: ignore[arg-type]
        assert stage
        stands |= dict(stage)
        if strategy == "wave" and all(reached[robot] <= posts[robot] for robot in posts):
            assert len({place for _, place in stage}) == len(stage)
    assert stands == posts


# ---------------------------------------------------------------- the line to the next goal


def line(size: int, goals: list[Place], ways: Plain, radius_m: float = 0.25) -> dict[int, Place]:
    robots = [Standing(robot, radius_m) for robot in range(1, size + 1)]
    return in_line(robots, goals, radius_m, ways, SETTINGS)


def test_a_group_stands_on_the_line_to_the_next_goal_a_fixed_distance_apart():
    places = line(3, [(0.0, 0.0), (6.0, 8.0)], Plain())
    for number, place in places.items():
        assert place == pytest.approx((0.6 * SETTINGS.spacing_m * number, 0.8 * SETTINGS.spacing_m * number))


def test_a_place_that_is_not_free_slides_along_the_way():
    places = line(2, [(0.0, 0.0), (10.0, 0.0)], Corridor())
    assert places[1] == pytest.approx((SETTINGS.spacing_m, 0.0))
    assert places[2][0] == pytest.approx(3.9)  # the first quarter of a spacing from 2.4 m on that is free: 3.75 m
    assert places[2][1] == 0.0


@pytest.mark.slow
@given(st.integers(1, 7), st.floats(0.5, 12.0), st.floats(0.1, 0.45))
def test_nobody_stands_in_anybody_or_in_a_wall(size: int, length_m: float, radius_m: float):
    ways = Corridor()
    goals = [(0.0, 0.0), (length_m, 0.0), (length_m + 9.0, 0.0)]
    places = line(size, goals, ways, radius_m)
    bodies = [(0.0, 0.0), *places.values()]
    assert all(math.dist(a, b) >= 2 * radius_m for a, b in itertools.combinations(bodies, 2))
    assert all(ways.free(radius_m, place) for place in places.values())


def test_without_a_next_goal_robots_stand_around_the_place():
    places = line(3, [(0.0, 0.0)], Plain())
    bodies = [(0.0, 0.0), *places.values()]
    assert all(math.dist(a, b) >= 0.5 for a, b in itertools.combinations(bodies, 2))


def test_who_goes_farthest_is_in_front_and_the_others_start_behind():
    act = Deployment(strategy="group", robots=(2, 0, 1), places_m=((5.0, 0.0), (15.0, 0.0), (25.0, 0.0)))
    plan = Plan(number=1, play="group", robots=(0, 1, 2), root=Task(name="deploy", act=act))
    scene = Scene(plan, crew_of(3)).run()
    first = {order.robot: order.errand for order in scene.orders if order.serial == 0}
    goes = [first[robot] for robot in (2, 0, 1)]
    assert all(isinstance(go, Go) for go in goes)
    assert [go.place_m[0] for go in goes] == pytest.approx(
        [5.0, 5.0 + SETTINGS.spacing_m, 5.0 + 2 * SETTINGS.spacing_m]
    )
    assert [go.behind for go in goes] == [0, 1, None]
    assert [go.behind_m for go in goes] == [SETTINGS.behind_m, SETTINGS.behind_m, 0.0]


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_without_augmentation_everybody_is_sent_to_the_places_themselves(strategy: str):
    act = Deployment(
        strategy=strategy,
        robots=(0, 1, 2),
        places_m=((5.0, 0.0), (15.0, 0.0), (25.0, 0.0)),
        augmented=False,  # type: ignore[arg-type]
    )
    scene = Scene(Plan(number=1, play="x", robots=(0, 1, 2), root=Task(name="deploy", act=act)), crew_of(3)).run()
    goes = [order.errand for order in scene.orders]
    assert all(isinstance(go, Go) and go.place_m in act.places_m and go.behind is None for go in goes)


# ---------------------------------------------------------------- making room


def test_a_robot_is_in_the_way_until_it_has_been_passed():
    post = (5.0, 0.0)
    assert in_the_way([(0.0, 0.2), (9.0, 0.2)], 0.25, post, 0.25, 0.5)
    assert not in_the_way([(6.5, 0.2), (9.0, 0.2)], 0.25, post, 0.25, 0.5)
    assert not in_the_way([(0.0, 1.5), (9.0, 1.5)], 0.25, post, 0.25, 0.5)


@pytest.mark.slow
@given(
    st.lists(st.tuples(st.floats(-9, 9), st.floats(-9, 9)), min_size=1, max_size=5), st.floats(-9, 9), st.floats(-9, 9)
)
def test_the_distance_from_a_way_is_that_from_its_nearest_point(way: list[Place], x_m: float, y_m: float):
    samples = [
        (a[0] + (b[0] - a[0]) * share / 400, a[1] + (b[1] - a[1]) * share / 400)
        for a, b in itertools.pairwise([*way, way[-1]])
        for share in range(401)
    ]
    assert off_m((x_m, y_m), way) == pytest.approx(min(math.dist((x_m, y_m), at) for at in samples), abs=0.04)


def test_along_a_way_lengths_add_up():
    way = [(0.0, 0.0), (3.0, 0.0), (3.0, 4.0)]
    assert along(way, 1.0) == (1.0, 0.0)
    assert along(way, 5.0) == (3.0, 2.0)
    assert along(way, 99.0) == (3.0, 4.0)


def leap(**troubles: object) -> Scene:
    places = ((5.0, 0.0), (10.0, 0.0), (15.0, 0.0))
    act = Deployment(strategy="leap_frog", robots=(0, 1, 2), places_m=places)
    plan = Plan(number=1, play="leap", robots=(0, 1, 2), root=Task(name="deploy", act=act))
    return Scene(plan, crew_of(3), troubles=Troubles(**troubles)).run()  # type: ignore[arg-type]


def test_deployed_robots_step_aside_and_come_back():
    scene = leap()
    asides = [(o.robot, o.errand.passing) for o in scene.orders if isinstance(o.errand, Retreat)]
    assert asides == [(0, 1), (0, 2), (1, 2)]
    assert [robot.at_m for robot in scene.robots] == [(5.0, 0.0), (10.0, 0.0), (15.0, 0.0)]
    acts = [order.errand.act for order in scene.robots[0].obeyed]
    assert acts == ["go", "retreat", "go", "retreat", "go"]


def test_a_robot_that_steps_aside_is_given_room_for_the_whole_stop_at_its_post():
    """The leaping robot stops at the very post: meanwhile nobody comes back to it."""
    scene = leap()
    backs = [order for order in scene.orders if order.errand.act == "go" and "~back" in order.task]
    assert len(backs) == 3


def test_who_stood_aside_comes_back_when_the_passing_robot_dies():
    scene = leap(deaths={1: 9.0}, silence_s=3.0)
    assert scene.robots[0].at_m == (5.0, 0.0)
    assert scene.robots[2].at_m == (10.0, 0.0)


def test_who_stood_aside_comes_back_when_the_host_dies():
    scene = leap(hosts=(9.0,))
    assert [robot.at_m for robot in scene.robots] == [(5.0, 0.0), (10.0, 0.0), (15.0, 0.0)]


def leaping() -> Executive:
    """Robot 0 is at its post, robot 1 has leapt to it and is on its way on."""
    places = ((5.0, 0.0), (15.0, 0.0))
    act = Deployment(strategy="leap_frog", robots=(0, 1), places_m=places)
    plan = Plan(number=1, play="leap", robots=(0, 1), root=Task(name="deploy", act=act))
    here = Executive(plan, crew_of(2), Plain(), SETTINGS, 0)
    for robot, task in ((0, "deploy/stage-1/robot-0-leg-1"), (1, "deploy/stage-2/robot-1-leg-1")):
        here.report(Report(plan=1, serial=0, task=task, robot=robot, result=Result.DONE, at=robot), robot)
    here.orders()
    return here


def at(x_m: float) -> Whereabouts:
    return Whereabouts(robot=1, x_m=x_m, y_m=0.0, heading_rad=0.0, moving=True)


def test_who_stands_aside_does_not_dither():
    here = leaping()
    acts = []
    for x_m in (5.9, 6.1, 5.9, 6.1, 6.6, 6.1):  # 1 m is the least room, 1.5 m enough to come back
        here.whereabouts(at(x_m), 5)
        acts.append([order.errand.act for order in here.orders()])
    assert acts == [["retreat"], [], [], [], ["go"], []]


def test_a_successor_calls_back_who_may_stand_aside():
    successor = Executive.restored(leaping().record, crew_of(2), Plain(), SETTINGS, 5)
    assert {
        (order.robot, order.errand.act, order.errand.place_m)
        for order in successor.orders()
        if order.errand.act == "go"
    } == {(0, "go", (5.0, 0.0)), (1, "go", (15.0, 0.0))}
    assert not successor.finished


@pytest.mark.parametrize(("plans", "orders"), [((1, 0), [(0, (5.0, 0.0))]), ((1, 1), []), ((0, 0), [])])
def test_who_has_forgotten_the_plan_is_called_back_to_its_post(plans: tuple[int, int], orders: list[object]):
    """It may have booted again while it stood aside for another."""
    here = leaping()
    for plan in plans:
        here.whereabouts(Whereabouts(robot=0, x_m=5.0, y_m=1.0, heading_rad=0.0, plan=plan), 5)
    given = here.orders()
    assert [(order.robot, order.errand.place_m) for order in given if order.errand.act == "go"] == orders
    assert len(given) == len(orders)


def test_who_has_forgotten_the_plan_before_it_came_to_its_post_is_not_called_back():
    here = leaping()
    for plan in (1, 0):
        here.whereabouts(at(9.0).model_copy(update={"plan": plan, "moving": False}), 5)
    assert here.orders() == []


# ---------------------------------------------------------------- taking over


@pytest.mark.slow
@given(st.data(), st.integers(1, 5), st.sampled_from(["group", "leap_frog"]))
def test_posts_are_given_at_the_least_cost(data: st.DataObject, size: int, strategy: str):
    spots = st.tuples(st.integers(-9, 9).map(float), st.integers(-9, 9).map(float))
    places = data.draw(st.lists(spots, min_size=size, max_size=size + 2))
    stands = dict(enumerate(data.draw(st.lists(spots, min_size=size, max_size=size))))
    reached = dict.fromkeys(range(size), NOWHERE)
    length = lengths(crew_of(size), Plain())
    posts = reassigned(strategy, range(size), reached, stands, places, length)  # type: ignore[arg-type]
    best = min(
        sum(math.dist(stands[robot], places[post]) for robot, post in enumerate(order))
        for order in itertools.permutations(range(size))
    )
    assert sorted(posts.values()) == list(range(size))
    assert sum(math.dist(stands[robot], places[post]) for robot, post in posts.items()) == pytest.approx(best, abs=1e-3)


def test_a_wave_keeps_its_order():
    reached = {4: 1, 7: NOWHERE, 5: NOWHERE, 9: 0}
    posts = reassigned("wave", [4, 7, 9, 5], reached, {}, [(0.0, 0.0)] * 5, lambda *_: 0.0)
    assert posts == {7: 0, 5: 1, 9: 2, 4: 3}


def test_only_who_has_a_camera_and_a_way_takes_over():
    crew = Crew((Body(), Body(camera=False), Body(radius_m=0.9), Body()), (0.0, 0.0))
    tasks = [Task(name="go", act=Go(robot=0, place_m=(1.0, 0.5))), Task(name="photo", act={"act": "photo", "robot": 0})]  # type: ignore[arg-type]
    stands = {1: (0.0, 0.0), 2: (1.0, 0.0), 3: (0.0, -0.5)}
    length = lengths(crew, Narrow())
    assert substitute(tasks, {1, 2, 3}, stands, crew, length) == 3
    assert substitute(tasks[:1], {1, 2, 3}, stands, crew, length) == 1  # nearer
    assert substitute(tasks, {1, 2}, stands, crew, length) is None
