"""The soak: random deployments end deployed, and touch nothing, with robots killed and orders lost."""

import os
from typing import Any

import numpy as np
import pytest

from cosim.scenario import Scenario
from tests.deployment.soak_scene import Case, Floor, box, deserted, drawn, judged, touched

RUNS = 300
SHARE = float(os.environ.get("SOAK_SHARE", "1"))


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(max(1, round(RUNS * SHARE))))
def test_a_random_deployment_ends_deployed_and_touches_nothing(seed: int, record_property: Any) -> None:
    case = drawn(seed)
    record_property("random deployments through the whole stack", 1)
    verdict = judged(case, seed)
    assert verdict.complaints == [], case.faults


# ---------------------------------------------------------------- the judge is judged

DOOR = [(4.0, 0.0, 4.0, 1.5), (4.0, 2.5, 4.0, 4.0)]


def case(places: list[tuple[float, float]]) -> Case:
    floor = Floor("two rooms", [*box(0.0, 0.0, 8.0, 4.0), *DOOR], 8.0, 4.0)
    return Case(Scenario.model_construct(), floor, [0.3] * 3, places, "")


@pytest.mark.parametrize(
    ("moved", "complaints"),
    [
        ((1.0, 2.0), []),
        ((1.6001, 1.0), []),
        ((1.5999, 1.0), ["robots 0 and 1 touch at tick 1"]),
        ((0.2999, 2.0), ["robot 1 touches a wall at tick 1"]),
        ((3.7, 1.4), ["robot 1 touches a wall at tick 1"]),
    ],
)
def test_the_judge_sees_bodies_that_touch(moved: tuple[float, float], complaints: list[str]) -> None:
    ticks = [[(1.0, 1.0), (2.0, 2.0), (6.0, 2.0)], [(1.0, 1.0), moved, (6.0, 2.0)]]
    assert touched(case([]), np.array(ticks)) == complaints


@pytest.mark.parametrize(
    ("ends", "dead", "complaints"),
    [
        ([(1.0, 1.0), (2.0, 3.0), (6.0, 2.0)], set(), []),
        ([(1.0, 1.0), (2.0, 2.6), (6.0, 2.0)], set(), ["2 places are held, 3 could be"]),
        ([(1.0, 1.0), (2.0, 2.6), (6.0, 2.0)], {1}, []),
        ([(1.0, 1.0), (2.0, 2.0), (4.0, 2.0)], {2}, ["1 places are held, 2 could be"]),
        ([(1.0, 1.0), (5.0, 3.0), (4.0, 2.0)], {2}, []),  # in the other room, behind the dead one: its place is held
        ([(1.0, 1.0), (2.0, 3.0), (4.0, 2.0)], {2}, []),
    ],
)
def test_the_judge_excuses_what_the_dead_stand_in_front_of(
    ends: list[tuple[float, float]], dead: set[int], complaints: list[str]
) -> None:
    places = [(1.0, 1.0), (2.0, 3.0), (6.0, 2.0)] if ends[1] != (5.0, 3.0) else [(1.0, 1.0), (2.0, 3.0), (5.0, 3.0)]
    assert deserted(case(places), ends, dead) == complaints
