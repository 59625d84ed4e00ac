"""What a camera recognises: by where its robot truly is, and where it appears by the robot's own pose."""

import math

import numpy as np
import pytest

from cosim.observation import Observation
from protocols.aggregation.findings import Camera, Findings
from protocols.aggregation.messages import Finding

RANGE_M = 3.0


class Body:
    """Where a robot truly is on a floor without walls, for one that takes itself to be elsewhere."""

    def __init__(self, place, off=(0.0, 0.0)):
        self._place, self._off = place, off

    def detects(self, marks_m, range_m):
        return [
            (x + self._off[0], y + self._off[1]) if math.dist((x, y), self._place) <= range_m else None
            for x, y in marks_m
        ]

    def sees(self, points_m):
        raise AssertionError("not asked")

    def ranges_m(self):
        raise AssertionError("not asked")


def at(place, view):
    return Observation(*place, 0.0, 1.0, False, False, view=view)


@pytest.mark.parametrize("seed", range(20))
def test_a_target_is_recognised_at_the_first_tick_at_which_it_is_in_range(seed):
    random = np.random.default_rng(seed)
    targets = [tuple(place) for place in random.uniform(0.0, 30.0, (8, 2)).tolist()]
    camera, known, here = Camera(targets, RANGE_M), Findings(), np.array([15.0, 15.0])
    for tick in range(1500):
        if tick % 40 == 0:
            course = random.uniform(-0.5, 0.5, 2)
        if tick % 500 == 499:  # carried away
            here = random.uniform(0.0, 30.0, 2)
        here = np.clip(here + course, 0.0, 30.0)
        place = tuple(here.tolist())
        if tick == 700:  # somebody else tells of it
            known.add([Finding(0, *targets[0])])
        expected = [n for n, each in enumerate(targets) if n not in known.targets and math.dist(place, each) <= RANGE_M]
        found = camera.look(at(place, Body(place)), known)
        assert [(each.number, (each.x_m, each.y_m)) for each in found] == [(n, targets[n]) for n in expected]
        known.add(found)
    assert len(known.targets) > 2


def test_a_robot_that_is_elsewhere_than_it_believes_sees_what_its_body_sees():
    camera = Camera([(10.0, 4.0), (10.0, 0.0)], RANGE_M)
    (found,) = camera.look(at((10.0, 2.0), Body((10.0, 5.0), (0.0, -3.0))), Findings())  # both are in range by belief
    assert found == Finding(0, 10.0, 1.0)
    assert camera.look(at((10.0, 4.0), Body((20.0, 4.0))), Findings()) == []


def test_who_stays_by_its_belief_sees_what_its_body_is_carried_to():
    camera = Camera([(10.0, 0.0)], RANGE_M)
    for x_m in range(7):
        assert camera.look(at((0.0, 0.0), Body((float(x_m), 0.0))), Findings()) == []
    (found,) = camera.look(at((0.0, 0.0), Body((7.0, 0.0))), Findings())
    assert found.number == 0
