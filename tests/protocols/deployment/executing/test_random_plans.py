"""Random plans with everything that can go wrong: they end, and what they come to depends on the facts alone."""

import math
import random

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from protocols.deployment.executing.executive import Executive
from protocols.deployment.tasks.facts import Heard, Record
from protocols.deployment.tasks.plan import Deployment, Plan, Task
from tests.protocols.deployment.plan_strategies import deployments, plans
from tests.protocols.deployment.play_scene import Scene, Troubles, crew_of, posts_of
from tests.tiers import soak_count

QUICK = settings(max_examples=25, suppress_health_check=[HealthCheck.too_slow])
LONG = settings(max_examples=max(soak_count(2000), 10), suppress_health_check=[HealthCheck.too_slow])


@st.composite
def troubles(draw: st.DrawFn) -> Troubles:
    deaths = draw(st.dictionaries(st.integers(0, 3), st.integers(0, 60).map(float), max_size=3))
    returns = {robot: at_s + draw(st.integers(1, 40)) for robot, at_s in deaths.items() if draw(st.booleans())}
    return Troubles(
        delay_s=(0.0, draw(st.sampled_from([0.0, 0.5, 4.0]))),
        twice=draw(st.sampled_from([0.0, 0.5])),
        failing=draw(st.sampled_from([0.0, 0.02])),
        deaths=deaths,
        returns=returns,
        hosts=tuple(draw(st.lists(st.integers(0, 60).map(float), max_size=2, unique=True))),
    )


def ends(plan: Plan, trouble: Troubles, seed: int) -> None:
    """Run a plan, and see that all of it has ended."""
    scene = Scene(plan, crew_of(4), troubles=trouble, seed=seed).run()
    assert scene.executive is not None
    assert set(scene.executive.states.values()) <= {"done", "failed", "terminated"}
    for robot in scene.robots:  # nobody is left at something
        if robot.alive and robot.order is not None and not robot.reported:
            assert robot.order.errand.act == "halt"


def depends_on_facts_alone(plan: Plan, trouble: Troubles, seed: int) -> None:
    """Run a plan, and tell its facts again, shuffled and twice, and as JSON."""
    scene = Scene(plan, crew_of(4), troubles=trouble, seed=seed).run()
    assert scene.executive is not None
    record, now = scene.executive.record, scene.now
    facts = list(record.facts) * 2
    random.Random(seed).shuffle(facts)
    room = scene.crew, scene.ways, scene.parameters
    shuffled = Executive.restored(record.model_copy(update={"facts": ()}), *room, record.start)
    for fact in facts:
        shuffled.learn(fact, now)
    shuffled.wake(now)
    copied = Executive.restored(Record.model_validate_json(record.model_dump_json()), *room, now)
    for other in (shuffled, copied):
        assert other.states == scene.executive.states
        assert other.results == scene.executive.results
        assert other.progress.errands() == scene.executive.progress.errands()
        assert other.record.facts == record.facts


def ends_deployed(plan: Plan, trouble: Troubles, seed: int) -> None:
    """Run a deployment, and see that who lives stands where it ends up, the first places taken that no body covers."""
    scene = Scene(plan, crew_of(4), troubles=trouble, seed=seed).run()
    assert scene.executive is not None
    act = plan.root.act
    assert isinstance(act, Deployment)
    team = [scene.robots[robot] for robot in posts_of(scene.executive)]
    over = next(end.at for end in reversed(scene.ends) if end.task == "play")
    heard = [fact for fact in scene.executive.record.facts if isinstance(fact, Heard) and fact.at < over]
    last = {fact.robot: fact for fact in heard}
    bodies = [fact.place_m for fact in last.values() if not fact.again and fact.place_m is not None]
    open_first = sorted(act.places_m, key=lambda place: any(math.dist(place, body) < 0.5 for body in bodies))
    posts = posts_of(scene.executive).values()
    assert len(set(posts)) == len(team)
    if not trouble.failing:  # who cannot come to its place tries another
        assert set(posts) == set(open_first[: len(team)])
    for robot in team:
        if robot.alive and not trouble.failing:
            assert math.dist(robot.at_m, posts_of(scene.executive)[robot.address]) < 1e-9


PLANS = given(plan=plans(), trouble=troubles(), seed=st.integers(0, 99))
DEPLOYMENTS = given(
    plan=deployments().map(
        lambda act: Plan(number=1, play="deploy", robots=act.robots, root=Task(name="play", act=act))
    ),
    trouble=troubles(),
    seed=st.integers(0, 99),
)

test_any_plan_ends_whatever_goes_wrong = pytest.mark.slow(QUICK(PLANS(ends)))
test_any_plan_ends_soak = pytest.mark.soak(LONG(PLANS(ends)))
test_what_facts_come_to_depends_on_no_order = pytest.mark.slow(QUICK(PLANS(depends_on_facts_alone)))
test_what_facts_come_to_soak = pytest.mark.soak(LONG(PLANS(depends_on_facts_alone)))
test_the_team_ends_deployed = pytest.mark.slow(QUICK(DEPLOYMENTS(ends_deployed)))
test_the_team_ends_deployed_soak = pytest.mark.soak(LONG(DEPLOYMENTS(ends_deployed)))
