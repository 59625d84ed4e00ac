"""What a camera recognises, and when it needs to look."""

import math

import numpy as np
import pytest

from cosim.observation import Observation
from protocols.aggregation.findings import Camera, Findings
from protocols.aggregation.messages import Finding

RANGE_M = 3.0


class Open:
    """A floor without walls; counts the questions."""

    def __init__(self):
        self.asked = 0

    def sees(self, points_m):
        self.asked += len(points_m)
        return [True] * len(points_m)

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
        found = camera.look(at(place, Open()), known)
        assert [(each.number, (each.x_m, each.y_m)) for each in found] == [(n, targets[n]) for n in expected]
        known.add(found)
    assert len(known.targets) > 2


def test_what_is_in_range_behind_a_wall_is_looked_for_at_every_tick():
    class Walled(Open):
        def sees(self, points_m):
            super().sees(points_m)
            return [False] * len(points_m)

    view, camera = Walled(), Camera([(2.0, 0.0), (50.0, 0.0)], RANGE_M)
    assert [camera.look(at((0.0, 0.0), view), Findings()) for _ in range(5)] == [[]] * 5
    assert view.asked == 5


def test_where_no_target_can_be_in_range_none_is_looked_for():
    class Unasked(Findings):
        def __init__(self):
            self.visited, self.changes = set(), 0

        @property
        def targets(self):
            raise AssertionError("not asked")

    camera = Camera([(10.0, 0.0), (0.0, 30.0)], RANGE_M)
    assert camera.look(at((0.0, 0.0), Open()), Findings()) == []
    for k in range(1, 700):
        assert camera.look(at((0.01 * k, 0.0), Open()), Unasked()) == []
    (found,) = camera.look(at((7.0, 0.0), Open()), Findings())
    assert found.number == 0
