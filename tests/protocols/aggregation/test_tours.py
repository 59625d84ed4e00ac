"""Regions and tours: all posts once, no room cut, about equally long; small cases against all orders tried out."""

import dataclasses
import itertools
import math

import numpy as np
import pytest

from protocols.aggregation.tours import regions, tours
from tests.protocols.aggregation.ground_scene import floor, ground_of, hall

WALLS = [(8, 0, 8, 3), (8, 5, 8, 8)]


def length(on, start, tour):
    if not tour:
        return 0.0
    first = on.length_m(start, on.posts_m[tour[0]])
    return first + sum(on.length_m(on.posts_m[a], on.posts_m[b]) for a, b in itertools.pairwise(tour))


def search():
    return ground_of("search", 8.0, 0.5)


# ---------------------------------------------------------------- regions


@pytest.mark.slow
@pytest.mark.parametrize("count", [1, 2, 3, 4, 6])
def test_regions_share_out_all_posts_about_equally_and_cut_no_room(count):
    on = search()
    parts = regions(on, count, (75.0, 75.0))
    assert sorted(post for part in parts for post in part) == list(range(len(on.posts_m)))
    for room in range(20):
        own = {post for post, of in enumerate(on.rooms) if of == room}
        assert sum(bool(own & part) for part in parts) == 1, room
    sizes = [len(part) for part in parts]
    largest_room = max(on.rooms.count(room) for room in range(20))
    assert max(sizes) - min(sizes) <= largest_room
    assert max(sizes) <= len(on.posts_m) / count + largest_room / 2


@pytest.mark.parametrize("sizes", [(4, 3, 1, 4), (5, 1, 5, 1), (1, 6, 2, 3, 3), (2, 2, 7, 1, 1, 3)])
@pytest.mark.parametrize("count", [2, 3])
def test_the_largest_region_is_as_small_as_arcs_of_whole_rooms_allow(sizes, count):
    on = hall(16.0, 16.0)
    posts, rooms = [], []
    for room, size in enumerate(sizes):
        for k in range(size):
            angle = -3.0 + 6.0 * (room + 0.1 * k / size) / len(sizes)
            posts.append((8.0 + 6.0 * math.cos(angle), 8.0 + 6.0 * math.sin(angle)))
            rooms.append(room)
    parts = regions(dataclasses.replace(on, posts_m=tuple(posts), rooms=tuple(rooms)), count, (8.0, 8.0))
    best = sum(sizes)
    for cuts in itertools.combinations(range(len(sizes)), count):
        ends = [*cuts[1:], cuts[0] + len(sizes)]
        arcs = [sum(sizes[k % len(sizes)] for k in range(a, b)) for a, b in zip(cuts, ends, strict=True)]
        best = min(best, max(arcs))
    assert max(map(len, parts)) == best
    assert sum(map(len, parts)) == sum(sizes)


@pytest.mark.slow
def test_a_region_is_a_sector_about_the_start():
    on = search()
    for part in regions(on, 3, (75.0, 75.0)):
        middles = {}
        for post in part:
            middles.setdefault(on.rooms[post] if on.rooms[post] >= 0 else -1 - post, []).append(on.posts_m[post])
        turns = sorted(
            math.atan2(*(np.mean(points, axis=0) - 75.0)[::-1].tolist()) % math.tau for points in middles.values()
        )
        gaps = [(b - a) % math.tau for a, b in zip(turns, [*turns[1:], turns[0]], strict=True)]
        others = 3 * len(turns)
        assert max(gaps) > 0.25 * math.tau, f"an arc leaves most of the circle to {others} others"


def test_more_regions_than_posts_leave_some_empty():
    on = hall(6.0, 6.0)
    parts = regions(on, 3, (3.0, 3.0))
    assert sorted(map(len, parts)) == [0, 0, len(on.posts_m)]
    with pytest.raises(ValueError, match="0 regions"):
        regions(on, 0, (3.0, 3.0))


# ---------------------------------------------------------------- tours


@pytest.mark.slow
@pytest.mark.parametrize("searchers", [1, 2, 3, 5])
def test_tours_share_out_all_posts_and_begin_near_their_searchers(searchers):
    on = search()
    posts = regions(on, 3, (75.0, 75.0))[1]
    starts = [(72.0 + 2 * k, 73.0) for k in range(searchers)]
    found = tours(on, posts, starts)
    assert len(found) == searchers
    assert sorted(post for tour in found for post in tour) == sorted(posts)
    assert tours(on, sorted(posts, reverse=True), starts) == found, "whatever the order they are given in"
    lengths = [length(on, start, tour) for start, tour in zip(starts, found, strict=True)]
    assert max(lengths) < 1.6 * sum(lengths) / searchers
    cuts = sum(len({on.rooms[post] for post in tour if on.rooms[post] >= 0}) for tour in found)
    rooms = len({on.rooms[post] for post in posts if on.rooms[post] >= 0})
    assert cuts <= rooms + searchers - 1


@pytest.mark.slow
@pytest.mark.parametrize("name", ["search", "search_nested"])
def test_a_tour_leaves_a_room_when_it_is_done_with_it(name):
    on = ground_of(name, 8.0, 0.5)
    (tour,) = tours(on, range(len(on.posts_m)), [(75.0, 75.0)])
    rooms = [room for room, _ in itertools.groupby(on.rooms[post] for post in tour)]
    assert sum(room >= 0 for room in rooms) <= 21, "of 20 rooms hardly any is entered twice"
    assert len(rooms) <= 28


@pytest.mark.parametrize("seed", range(6))
def test_one_searchers_tour_is_as_short_as_the_shortest_of_all_orders(seed):
    on = hall(16.0, 8.0, WALLS, cell_m=0.25)
    many = ground_with_posts(on, seed, 7)
    start = (1.0, 1.0)
    (tour,) = tours(many, range(7), [start])
    best = min(length(many, start, order) for order in itertools.permutations(range(7)))
    assert length(many, start, tour) <= 1.06 * best + 1e-6


@pytest.mark.parametrize("seed", range(6))
def test_two_searchers_tours_are_nearly_as_even_as_can_be(seed):
    on = hall(16.0, 8.0, WALLS, cell_m=0.25)
    many = ground_with_posts(on, seed, 6)
    starts = [(1.0, 1.0), (1.0, 7.0)]
    found = tours(many, range(6), starts)
    longest = max(length(many, start, tour) for start, tour in zip(starts, found, strict=True))
    best = math.inf
    for order in itertools.permutations(range(6)):
        for cut in range(7):
            pair = order[:cut], order[cut:]
            best = min(best, max(length(many, s, t) for s, t in zip(starts, pair, strict=True)))
    assert longest <= 1.45 * best


def ground_with_posts(on, seed, count):
    """Return the same ground with other posts, none in a room."""
    draw = np.random.default_rng(seed)
    posts = tuple((float(x), float(y)) for x, y in draw.uniform((0.7, 0.7), (15.3, 7.3), (60, 2)))
    posts = tuple(post for post in posts if on.stands(post) == post)[:count]
    return dataclasses.replace(on, posts_m=posts, rooms=(-1,) * count)


def test_nothing_to_do_and_nobody_to_do_it():
    on = hall(6.0, 6.0)
    assert tours(on, (), [(1.0, 1.0), (2.0, 2.0)]) == ((), ())
    assert tours(on, (0,), []) == ()
    found = tours(on, (0,), [(1.0, 1.0), (3.0, 3.0)])
    assert sorted(map(len, found)) == [0, 1]


def test_posts_out_of_reach_come_last():
    on = ground_with_posts(hall(16.0, 8.0, [(8, 0, 8, 8)]), 1, 6)
    near = {post for post, (x, _) in enumerate(on.posts_m) if x < 8.0}
    (tour,) = tours(on, range(6), [(1.0, 1.0)])
    assert set(tour[: len(near)]) == near
    assert len(near) < 6


def test_laboratory_is_shared_by_two():
    on = ground_of("laboratory", 1.5, 0.1)
    _, _, places, _ = floor("laboratory")
    starts = places["starts"][1:]
    found = tours(on, range(len(on.posts_m)), starts)
    lengths = [length(on, start, tour) for start, tour in zip(starts, found, strict=True)]
    assert sum(map(len, found)) == len(on.posts_m)
    assert max(lengths) <= 1.5 * min(lengths)
