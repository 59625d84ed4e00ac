"""Grounds: everything is seen from a post, ways keep clear of walls; against dense samples, shapely and scipy."""

import math
from itertools import pairwise

import numpy as np
import pytest
import shapely

from cosim.geometry.segments import sees
from protocols.aggregation.ground import ground
from tests.protocols.aggregation.ground_scene import RADIUS_M, floor, ground_of, hall, in_rings

CASES = [("laboratory", 1.5, 0.1), ("laboratory", 3.0, 0.1), ("storey", 4.0, 0.1)]
BIG = [("search", 8.0, 0.5), ("search", 15.0, 0.5), ("search_nested", 10.0, 0.5)]


def unseen_points(name, on, camera_m, points):
    """Return which of *points* lie on the free floor, but in range and sight of no post: one by one."""
    _, _, _, rings = floor(name)
    left = points[~in_rings(points, rings)]
    for post in np.array(on.posts_m):
        near = np.hypot(*(left - post).T) <= camera_m
        near[near] = sees(on.walls, np.repeat(post[None], near.sum(), axis=0), left[near])
        left = left[~near]
    return left


def wall_lines(on):
    return shapely.MultiLineString(list(on.walls.walls_m.reshape(-1, 2, 2)))


# ---------------------------------------------------------------- posts


@pytest.mark.slow
@pytest.mark.parametrize(("name", "camera_m", "cell_m"), CASES + BIG)
def test_every_point_of_the_floor_is_in_range_and_sight_of_a_post(name, camera_m, cell_m):
    on = ground_of(name, camera_m, cell_m)
    walls, (x, y, x_max, y_max), _, _ = floor(name)
    draw = np.random.default_rng(1)
    points = draw.uniform((x, y), (x_max, y_max), (30_000, 2))
    middles = 0.5 * (walls[:, :2] + walls[:, 2:])
    beside = np.repeat(middles, 20, axis=0) + draw.uniform(-0.3, 0.3, (20 * len(walls), 2))
    assert len(unseen_points(name, on, camera_m, points)) == 0
    assert len(unseen_points(name, on, camera_m, beside)) == 0


@pytest.mark.slow
@pytest.mark.parametrize(("name", "camera_m", "cell_m"), CASES + BIG)
def test_posts_are_few_and_can_all_be_stood_at_and_reached(name, camera_m, cell_m):
    on = ground_of(name, camera_m, cell_m)
    walls, bounds, _, _ = floor(name)
    area = (bounds[2] - bounds[0]) * (bounds[3] - bounds[1])
    length = float(np.hypot(*(walls[:, 2:] - walls[:, :2]).T).sum())
    # squares of the camera's range times root two would do on an open floor; walls cost about a post for a range each
    most = 1.7 * area / (2.0 * camera_m**2) + length / camera_m + len(set(on.rooms))
    assert len(on.posts_m) <= most
    away = shapely.distance(wall_lines(on), shapely.points(on.posts_m))
    assert away.min() >= RADIUS_M
    assert np.isfinite(on.lengths_m).all()
    assert len(set(on.posts_m)) == len(on.posts_m)


def test_one_post_is_enough_for_a_small_hall():
    assert len(hall(6.0, 6.0).posts_m) == 1
    assert len(hall(8.0, 3.0).posts_m) == 1
    assert 2 <= len(hall(14.0, 6.0).posts_m) <= 3


def test_what_nobody_can_enter_or_see_into_needs_no_post():
    closed = [(10, 0, 10, 6), (12, 0, 12, 6), (10, 6, 12, 6)]
    on = hall(16.0, 8.0, closed)
    assert not any(10 < x < 12 and y < 6 for x, y in on.posts_m)
    assert np.isfinite(on.lengths_m).all()


@pytest.mark.slow
def test_posts_belong_to_the_rooms_in_whose_walls_they_stand():
    on = ground_of("search", 8.0, 0.5)
    _, _, places, _ = floor("search")
    corners = places["room_corners"]
    rectangles = list(zip(corners[::2], corners[1::2], strict=True))
    told = 0
    for (x, y), room in zip(on.posts_m, on.rooms, strict=True):
        inside = [k for k, (low, high) in enumerate(rectangles) if low[0] < x < high[0] and low[1] < y < high[1]]
        if inside:
            told += 1
            assert room == inside[0], (x, y)
        elif room >= 0:
            # the rooms R are an L, of which the rectangle is but a part
            assert room % 5 == 2, (x, y)
    assert told > 150
    assert {-1, *range(20)} == set(on.rooms)


@pytest.mark.slow
def test_neighbours_in_number_are_neighbours_on_the_floor():
    on = ground_of("search", 8.0, 0.5)
    hops = [math.dist(a, b) for a, b in pairwise(on.posts_m)]
    assert np.median(hops) < 1.6 * 8.0
    changes = sum(a != b for a, b in pairwise(on.rooms))
    assert changes == len(set(on.rooms)) - 1, "room by room"


def test_parts_of_one_space_are_the_rooms_of_a_small_floor():
    on = ground_of("laboratory", 1.5, 0.1)
    _, _, places, _ = floor("laboratory")
    assert set(on.rooms) == {0, 1, 2, 3}
    for post, room in zip(on.posts_m, on.rooms, strict=True):
        lengths = [on.length_m(post, middle) for middle in places["rooms"]]
        assert lengths[room] <= min(lengths) + 0.3


# ---------------------------------------------------------------- ways


@pytest.mark.slow
@pytest.mark.parametrize(("name", "cell_m"), [("laboratory", 0.1), ("storey", 0.1), ("search", 0.5)])
def test_a_body_on_its_way_touches_no_wall(name, cell_m):
    on = ground_of(name, 5.0, cell_m)
    walls = wall_lines(on)
    _, (x, y, x_max, y_max), _, rings = floor(name)
    points = np.random.default_rng(4).uniform((x, y), (x_max, y_max), (300, 2))
    points = [tuple(p) for p in points[~in_rings(points, rings)].tolist()]
    ways = 0
    for a, b in pairwise(points):
        way = on.way(a, b)
        if on.stands(a) is None or on.stands(b) is None:
            assert way is None
            continue
        assert way is not None
        ways += 1
        assert way[-1] == (b if on.stands(b) == b else on.stands(b))
        legs = list(pairwise([a, *way]))
        if on.stands(a) != a:
            assert legs[0][1] == on.stands(a)
            legs = legs[1:]
        # where one can stand only beside the goal, the last leg ends at a centre like the others
        distance = shapely.distance(walls, shapely.linestrings([list(leg) for leg in legs]))
        assert distance.min() >= RADIUS_M
        assert on.length_m(a, b) == pytest.approx(sum(math.dist(p, q) for p, q in pairwise([a, *way])), abs=1e-6)
    assert ways > 100


def test_places_in_sight_of_each_other_have_a_straight_way():
    on = hall(16.0, 8.0, [(8, 0, 8, 3), (8, 5, 8, 8)])
    assert on.way((2.0, 4.0), (14.3, 4.1)) == [(14.3, 4.1)]
    bent = on.way((2.0, 1.0), (14.0, 1.0))
    assert bent is not None
    assert len(bent) in (2, 3)
    assert all(abs(x - 8.0) < 1.0 and 3.0 < y < 4.0 for x, y in bent[:-1])


def test_no_way_leads_into_a_closed_room():
    on = hall(16.0, 8.0, [(8, 0, 8, 8)])
    assert on.way((2.0, 4.0), (14.0, 4.0)) is None
    assert on.length_m((2.0, 4.0), (14.0, 4.0)) is None
    assert not on.open((2.0, 4.0), (14.0, 4.0))


def test_who_stands_at_a_wall_goes_to_the_nearest_free_place_on_the_same_side():
    on = hall(16.0, 8.0, [(8, 0, 8, 3), (8, 5, 8, 8)])
    for x in (7.75, 8.25):
        place = on.stands((x, 6.0))
        assert place is not None
        assert (place[0] > 8.0) == (x > 8.0)
        assert math.dist(place, (x, 6.0)) < 0.6
        way = on.way((x, 6.0), (2.0, 2.0))
        assert way is not None
        assert way[0] == place
    # beside this wall the nearest free centre of all lies on the other side
    place = hall(16.0, 8.0, [(8.05, 0, 8.05, 3), (8.05, 5, 8.05, 8)]).stands((8.04, 6.5))
    assert place is not None
    assert place[0] < 8.05
    assert on.stands((2.0, 4.0)) == (2.0, 4.0)
    assert on.way((2.0, 4.0), (7.9, 7.0))[-1] == on.stands((7.9, 7.0))


@pytest.mark.parametrize("walls", [[(8, 0, 8, 3), (8, 5, 8, 8)], [(4, 0, 4, 6), (8, 2, 8, 8), (12, 0, 12, 6)]])
def test_ways_from_wavefronts_alone_are_about_as_long(walls):
    bounds = (0.0, 0.0, 16.0, 8.0)
    rows = np.array(walls, float)
    by_corners = ground(rows, bounds, {}, RADIUS_M, 5.0, 0.25)
    by_waves = ground(rows, bounds, {}, RADIUS_M, 5.0, 0.25, most_corners=0)
    assert by_waves.roadmap is None
    assert by_corners.posts_m == by_waves.posts_m
    points = [tuple(p) for p in np.random.default_rng(2).uniform(1, (15, 7), (40, 2)).tolist()]
    for a, b in pairwise(points):
        one, other = by_corners.length_m(a, b), by_waves.length_m(a, b)
        assert one is not None
        assert other is not None
        assert 0.9 * other - 0.3 <= one <= other + 0.3
    assert np.abs(by_waves.lengths_m - by_corners.lengths_m).max() < 0.1 * by_corners.lengths_m.max()


def test_ways_around_bodies_keep_away_from_them():
    on = hall(16.0, 8.0, [(8, 0, 8, 1), (8, 3, 8, 5), (8, 7, 8, 8)])
    start, goal, bodies = (3.0, 2.0), (13.0, 2.0), [(8.0, 2.0), (7.5, 2.3)]
    assert on.way(start, goal) == [goal]
    way = on.way_around(start, goal, bodies, 1.2)
    assert way is not None
    line = shapely.LineString([start, *way])
    assert shapely.distance(line, shapely.MultiPoint(bodies)) > 1.2 - 0.5 * 0.25 * math.sqrt(2.0)
    assert any(5.0 < y < 7.0 for _, y in way), "by the other door"
    assert on.way_around(start, goal, [(8.0, 2.0), (8.0, 6.0)], 1.2) is None
    beside = on.way_around((0.26, 2.0), goal, bodies, 1.2)
    assert beside is not None
    assert beside[0] == on.stands((0.26, 2.0)), "who stands at a wall leaves it first"


def test_lengths_from_a_place_are_those_of_the_ways():
    on = hall(16.0, 8.0, [(4, 0, 4, 6), (8, 2, 8, 8), (12, 0, 12, 6)])
    for start in ((1.0, 1.0), (6.0, 4.0), (7.9, 7.0), (15.0, 1.0)):
        found = on.lengths_from_m(start)
        exact = np.array([on.length_m(start, post) for post in on.posts_m])
        assert np.abs(found - exact).max() < 1e-6


# ---------------------------------------------------------------- the same ground for all


def test_a_ground_is_built_once_for_a_floor():
    walls, bounds, places, rings = floor("laboratory")
    options = (bounds, places, RADIUS_M, 1.5, 0.1)
    one = ground(walls.copy(), *options, lambda points: in_rings(points, rings))
    assert ground(walls.copy(), *options, lambda points: in_rings(points, rings)) is one
    assert ground(walls.copy(), *options) is not one, "without solids it is another floor"
    assert ground(walls.copy(), bounds, places, RADIUS_M, 1.6, 0.1, lambda at: in_rings(at, rings)) is not one


def test_the_sides_of_the_floor_are_walls_whether_drawn_or_not():
    sides = [(0, 0, 9, 0), (9, 0, 9, 5), (9, 5, 0, 5), (0, 5, 0, 0)]
    drawn = hall(9.0, 5.0, sides)
    assert drawn.posts_m == hall(9.0, 5.0).posts_m
    assert len(drawn.walls.walls_m) == 4
    assert not hall(9.0, 5.0).fits((0.2, 2.0), (0.2, 3.0))
    assert hall(9.0, 5.0).fits((0.3, 2.0), (0.3, 3.0))


def test_a_floor_that_nobody_fits_on_is_refused():
    with pytest.raises(ValueError, match="fits nowhere"):
        ground(np.empty((0, 4)), (0.0, 0.0, 0.6, 5.0), {}, RADIUS_M, 5.0, 0.2)
    with pytest.raises(ValueError, match="camera"):
        ground(np.empty((0, 4)), (0.0, 0.0, 6.0, 5.0), {}, RADIUS_M, 0.0, 0.2)
