"""The executive runs plans to their ends, whatever is lost, late, told twice, or dies."""

import math

import pytest

from cosim.units import S
from protocols.deployment.orders import Result
from protocols.deployment.plan import Deployment, Place, Plan, Task
from tests.deployment.play_scene import Scene, Troubles, crew_of

PLACES: tuple[Place, ...] = ((10.0, 0.0), (20.0, 0.0), (30.0, 0.0), (40.0, 0.0))
STRATEGIES = ("group", "wave", "leap_frog")


def deployment(strategy: str, size: int = 4, augmented: bool = True) -> Plan:
    act = Deployment(
        strategy=strategy,
        robots=tuple(range(size)),
        places_m=PLACES[:size],
        augmented=augmented,  # type: ignore[arg-type]
    )
    return Plan(number=1, play=strategy, robots=act.robots, root=Task(name="deploy", act=act))


def standing(scene: Scene, places: tuple[Place, ...]) -> list[int | None]:
    """Return who stands at each of *places*."""
    return [
        next((each.address for each in scene.robots if each.alive and math.dist(each.at_m, place) < 0.2), None)
        for place in places
    ]


@pytest.mark.parametrize("augmented", [True, False])
@pytest.mark.parametrize("strategy", STRATEGIES)
def test_every_strategy_leaves_every_robot_at_its_place(strategy: str, augmented: bool):
    scene = Scene(deployment(strategy, augmented=augmented), crew_of(4)).run()
    assert standing(scene, PLACES) == [0, 1, 2, 3]
    assert scene.executive is not None
    assert scene.executive.results["deploy"] is Result.DONE


@pytest.mark.parametrize("strategy", STRATEGIES)
@pytest.mark.parametrize("dead", range(4))
@pytest.mark.parametrize("at_s", [1.0, 15.0, 29.0, 45.0])
def test_after_a_death_the_others_occupy_the_first_places(strategy: str, dead: int, at_s: float):
    scene = Scene(deployment(strategy), crew_of(4), troubles=Troubles(deaths={dead: at_s})).run()
    assert scene.executive is not None
    if any(end.task == "deploy" and end.at > (at_s + 3.0) * S for end in scene.ends):  # else it was over before
        assert set(standing(scene, PLACES[:3])) == {0, 1, 2, 3} - {dead}
