"""Ways over the known map: lengths against shapely and by hand, where a body fits, and bodies that stand in the way."""

import math
from itertools import pairwise

import numpy as np
import pytest
import shapely

from cosim.world.offices import OfficeSettings, office_walls
from protocols.motion.floor import Blocker, Floor
from protocols.motion.parameters import DrivingParameters
from tests.protocols.deployment.driving_scene import box, line

OFFICE = OfficeSettings(width_m=14, depth_m=9, rooms=4, seed=3)


def office():
    return Floor(office_walls(OFFICE), (0.0, 0.0, 14.0, 9.0), None)


def walls_of(floor):
    return shapely.MultiLineString([[(a, b), (c, d)] for a, b, c, d in floor.walls.walls_m.tolist()])


def corridor(width=2.0, length=10.0):
    return Floor(box(length, width), (0.0, 0.0, length, width), None)


def test_a_straight_way_is_as_long_as_the_line():
    assert corridor().length_m(0.2, (1.0, 1.0), (9.0, 1.0)) == pytest.approx(8.0, abs=0.1)


def test_a_way_round_a_wall_is_as_long_as_round_its_end():
    floor = Floor([*box(10, 10), *line((5, 0), (5, 6))], (0.0, 0.0, 10.0, 10.0), None)
    length = floor.length_m(0.2, (3.0, 2.0), (7.0, 2.0))
    tight = 2 * math.dist((3.0, 2.0), (5.0, 6.0))
    assert length is not None
    assert tight < length < tight + 4 * (0.2 + 0.3) + 0.2


@pytest.mark.parametrize("radius", [0.15, 0.25])
def test_ways_keep_bodies_off_the_walls(radius):
    floor, walls, draw = office(), walls_of(office()), np.random.default_rng(4)
    found = 0
    for _ in range(40):
        a, b = (tuple(draw.uniform((0, 0), (14, 9)).tolist()) for _ in range(2))
        if not (floor.free(radius, a) and floor.free(radius, b)):
            continue
        way = floor.way(radius, a, b)
        if way is None:
            continue
        found += 1
        assert way[0] == a
        assert way[-1] == b
        for p, q in pairwise(way):
            assert shapely.LineString([p, q]).distance(walls) >= radius + 0.03 - math.hypot(0.05, 0.05) - 1e-9
        assert floor.length_m(radius, a, b) == pytest.approx(sum(math.dist(p, q) for p, q in pairwise(way)))
    assert found > 10


def test_a_body_fits_where_it_is_the_margin_off_all_walls():
    floor, walls, draw = office(), walls_of(office()), np.random.default_rng(5)
    for _ in range(300):
        x, y = draw.uniform((-1, -1), (15, 10)).tolist()
        inside = 0 <= x <= 14 and 0 <= y <= 9
        off = shapely.Point(x, y).distance(walls)
        if abs(off - 0.23) > 1e-6:
            assert floor.free(0.2, (x, y)) == (inside and off > 0.23)


def test_nothing_leads_through_a_door_that_is_too_narrow():
    walls = [*box(10, 4), *line((5, 0), (5, 1.7)), *line((5, 2.3), (5, 4))]
    floor = Floor(walls, (0.0, 0.0, 10.0, 4.0), None)
    assert floor.length_m(0.2, (1.0, 2.0), (9.0, 2.0)) == pytest.approx(8.0, abs=0.3)
    assert floor.length_m(0.35, (1.0, 2.0), (9.0, 2.0)) is None
    assert floor.length_m(0.2, (1.0, 2.0), (29.0, 2.0)) is None
    assert floor.way(0.2, (1.0, 20.0), (9.0, 2.0)) is None


def test_forbidden_ground_is_gone_round():
    def pit(points):
        return (np.abs(points[:, 0] - 5.0) < 0.5) & (points[:, 1] < 3.0)

    floor = Floor(box(10, 4), (0.0, 0.0, 10.0, 4.0), pit)
    way = floor.way(0.2, (1.0, 1.0), (9.0, 1.0))
    assert way is not None
    assert max(y for _, y in way) > 3.0
    assert not floor.free(0.2, (5.0, 1.0))


def test_ways_lead_through_the_middle_of_a_door():
    walls = [*box(10, 6), *line((5, 0), (5, 2)), *line((5, 3.2), (5, 6))]
    field = Floor(walls, (0.0, 0.0, 10.0, 6.0), None).field(0.2, (9.0, 5.0))
    at, passed = (1.0, 1.0), []
    for _ in range(400):
        aim = field.aim(at, 0.2)
        if aim is None or math.dist(at, (9.0, 5.0)) < 0.2:
            break
        heading = math.atan2(aim.place_m[1] - at[1], aim.place_m[0] - at[0])
        at = at[0] + 0.05 * math.cos(heading), at[1] + 0.05 * math.sin(heading)
        passed.append(at)
    assert math.dist(at, (9.0, 5.0)) < 0.2
    assert min(abs(y - 2.6) for x, y in passed if abs(x - 5.0) < 0.1) < 0.2


def test_a_field_is_kept_and_tells_what_is_left():
    floor = corridor()
    field = floor.field(0.2, (9.0, 1.0))
    assert floor.field(0.2, (9.0, 1.0)) is field
    assert field.distance_m((1.0, 1.0)) == pytest.approx(8.0, abs=0.11)
    assert field.cost_m((1.0, 1.0)) >= field.distance_m((1.0, 1.0))
    assert field.distance_m((1.0, 40.0)) == math.inf
    aim = field.aim((1.0, 1.0), 2.0)
    assert aim is not None
    assert 1.8 < math.dist(aim.place_m, (1.0, 1.0)) <= 2.1
    assert not aim.last
    near = field.aim((8.5, 1.0), 2.0)
    assert near is not None
    assert near.last
    assert near.place_m == (9.0, 1.0)


def test_a_goal_where_the_body_does_not_fit_is_the_nearest_place_where_it_does():
    field = corridor().field(0.2, (9.95, 1.0))
    assert field.goal_m[0] == pytest.approx(9.75, abs=0.06)


def test_a_body_in_the_way_is_gone_round_or_closes_it():
    wide, narrow = corridor(2.0), corridor(1.0)
    blocker = Blocker(5.0, 1.0, 0.2)
    field = wide.field_among(0.2, (9.0, 1.0), [blocker])
    way = field.way((1.0, 1.0))
    assert way is not None
    assert shapely.LineString(way).distance(shapely.Point(5.0, 1.0)) > 0.4
    assert narrow.field_among(0.2, (9.0, 0.5), [Blocker(5.0, 0.5, 0.2)]).cost_m((1.0, 0.5)) == math.inf
    assert narrow.field(0.2, (9.0, 0.5)).cost_m((1.0, 0.5)) < math.inf


def test_comfort_makes_ways_longer_but_not_wider_off():
    walls = [*box(10, 10), *line((5, 0), (5, 6))]
    bounds = (0.0, 0.0, 10.0, 10.0)
    tight = Floor(walls, bounds, None, DrivingParameters(comfort_price=1.0)).field(0.2, (7.0, 2.0))
    wide = Floor(walls, bounds, None, DrivingParameters(comfort_price=6.0)).field(0.2, (7.0, 2.0))
    assert wide.distance_m((3.0, 2.0)) > tight.distance_m((3.0, 2.0))
    assert tight.cost_m((3.0, 2.0)) == pytest.approx(tight.distance_m((3.0, 2.0)))
