"""Outlines of obstacles: their orientation, where a point stands beside them, and what it sees of them (by shapely)."""

import math

import numpy as np
import pytest
import shapely

from cosim.geometry.boundary import (
    CLEAR_M,
    boundary,
    edge_length,
    free_height,
    inflated,
    last_seen,
    point_at,
    seen_until,
    stand_clear,
    visible_stretches,
    within,
)
from tests.navigation.scenes import SIZE_M, Scene, scenes

SQUARE = [(4, -1), (6, -1), (6, 2), (4, 2)]


def sees(scene: Scene, eye, point) -> bool:
    """Whether nothing solid lies between an eye and a point, says shapely."""
    return shapely.LineString([eye, point]).intersection(scene.solid).length < 1e-6


def free_points(scene: Scene, rng, count: int):
    points = rng.uniform(0, SIZE_M, (count, 2))
    return points[shapely.distance(scene.solid, shapely.points(points)) > 1e-3]


@pytest.mark.slow
@pytest.mark.parametrize("left", [True, False])
def test_the_free_side_of_every_edge_is_outside_of_what_is_solid(left):
    for scene in scenes(12):
        loops = boundary(scene.obstacles, scene.enclosures, left=left)
        x1, y1, x2, y2 = loops.grid.walls_m.T
        middle = np.stack((x1 + x2, y1 + y2), axis=1) / 2
        normal = np.stack((y1 - y2, x2 - x1), axis=1) / np.hypot(x2 - x1, y2 - y1)[:, None]
        offset = (1e-7 if left else -1e-7) * normal  # the obstacle is at the right hand of who turns left
        assert not shapely.contains_xy(scene.solid, *(middle + offset).T).any()
        assert shapely.contains_xy(scene.solid, *(middle - offset).T).all()
        heights = [free_height(loops, edge, *(middle + offset)[edge]) for edge in range(len(middle))]
        assert heights == pytest.approx([1e-7] * len(middle), rel=1e-6)


def test_a_walk_along_the_loop_comes_back_after_its_perimeter():
    triangle = [(10, 0), (13, 0), (10, 4)]
    loops = boundary([SQUARE], [triangle])
    lengths = [edge_length(loops, edge) for edge in range(7)]
    assert loops.loop.tolist() == [0] * 4 + [1] * 3
    for first, perimeter in ((0, 10.0), (4, 12.0)):
        edge, walked = first, 0.0
        while True:
            assert loops.preceding[loops.following[edge]] == edge
            assert point_at(loops, edge, lengths[edge]) == point_at(loops, loops.following[edge], 0.0)
            walked += lengths[edge]
            edge = loops.following[edge]
            if edge == first:
                break
        assert walked == pytest.approx(perimeter)


def test_repeated_vertices_are_dropped_and_loops_that_enclose_nothing_refused():
    assert len(boundary([[*SQUARE, SQUARE[-1], SQUARE[0]]]).following) == 4
    for wrong in ([(0, 0), (1, 0)], [(0, 0), (1, 0), (2, 0)], [(0, 0, 0), (1, 0, 0), (0, 1, 0)]):
        with pytest.raises(ValueError, match="encloses nothing"):
            boundary([wrong])
    assert len(boundary([]).following) == 0


@pytest.mark.parametrize("quad_segs", [1, 3, 8])
def test_inflated_loops_keep_the_radius_from_the_walls_and_little_more(quad_segs):
    walls = [(0, 0, 4, 0), (4, 0, 4, 4), (4, 4, 0, 4), (0, 4, 0, 0), (8, 1, 11, 3)]
    obstacles, enclosures = inflated(walls, 0.5, quad_segs)
    drawn = shapely.union_all([shapely.LineString([w[:2], w[2:]]) for w in walls])
    assert (len(obstacles), len(enclosures)) == (2, 1)
    reach = 0.5 / math.cos(math.pi / (4 * quad_segs))
    for loop in (*obstacles, *enclosures):
        edges = shapely.linestrings(np.stack((loop, np.roll(loop, -1, axis=0)), axis=1))
        assert shapely.distance(edges, drawn).min() >= 0.5 - 1e-9
        assert shapely.distance(shapely.points(loop), drawn).max() == pytest.approx(reach)


def test_inflated_walls_close_a_gap_that_is_too_narrow():
    walls = [(0, 0, 2, 0), (2.9, 0, 5, 0)]
    assert len(inflated(walls, 0.4)[0]) == 2
    assert len(inflated(walls, 0.5)[0]) == 1


@pytest.mark.slow
def test_a_point_stands_where_it_is_or_at_the_nearest_place_and_its_eye_is_free():
    rng = np.random.default_rng(2)
    inside = 0
    for scene in scenes(24):
        loops = scene.loops
        edges = shapely.MultiLineString([shapely.LineString(w.reshape(2, 2)) for w in loops.grid.walls_m])
        for point in rng.uniform(-0.5, SIZE_M + 0.5, (50, 2)):
            place = shapely.Point(point)
            depth = edges.distance(place) if scene.solid.contains(place) else 0.0
            x, y, *eye = stand_clear(loops, *point)
            if depth == 0.0 or depth > 1.0:
                assert (x, y, *eye) == (*point, *point)
            else:
                inside += 1
                assert math.dist((x, y), point) == pytest.approx(depth, abs=1e-9)
                assert edges.distance(shapely.Point(x, y)) < 1e-9
                assert not scene.solid.contains(shapely.Point(eye))
                assert math.dist(eye, (x, y)) <= 20 * CLEAR_M * 1.001
    assert inside > 50


@pytest.mark.slow
def test_the_eye_of_a_point_on_the_boundary_is_free_and_beside_it():
    for scene in scenes(9):
        loops = scene.loops
        for edge in range(len(loops.following)):
            for share in (0.0, 0.3, 1.0):
                x, y, *eye = stand_clear(loops, *point_at(loops, edge, share * edge_length(loops, edge)))
                assert not scene.solid.contains(shapely.Point(eye))
                assert scene.solid.boundary.distance(shapely.Point(eye)) > 0.9 * CLEAR_M
                assert math.dist((x, y), eye) <= 20 * CLEAR_M * 1.001


@pytest.mark.slow
def test_visible_stretches_are_what_shapely_sees():
    rng = np.random.default_rng(3)
    seen = hidden = far = 0
    for scene in scenes(18):
        loops = scene.loops
        for eye in free_points(scene, rng, 3):
            radius = rng.uniform(1.0, 12.0)
            rows = visible_stretches(loops, *eye, radius)
            for edge in range(len(loops.following)):
                length = edge_length(loops, edge)
                along = rng.uniform(0, length)
                point = point_at(loops, edge, along)
                mine = rows[rows[:, 0] == edge]
                if len(mine) and np.abs(mine[:, 1:] - along).min() < 1e-4:
                    continue
                visible = bool(((mine[:, 1] < along) & (along < mine[:, 2])).any())
                near = math.dist(eye, point) < radius
                assert visible == (near and sees(scene, eye, point)), (scene.family, edge, along)
                seen, hidden, far = seen + visible, hidden + (near and not visible), far + (not near)
    assert min(seen, hidden, far) > 100


@pytest.mark.slow
def test_the_part_of_a_line_seen_without_a_gap_and_the_last_seen_are_what_shapely_sees():
    rng = np.random.default_rng(4)
    gaps = whole = none = 0
    for scene in scenes(60):
        loops = scene.loops
        points = free_points(scene, rng, 12)
        for eye, p, q in zip(points[::3], points[1::3], points[2::3], strict=False):
            shares = np.arange(0.5, 200) / 200
            on_line = p + shares[:, None] * (q - p)
            visible = np.array([sees(scene, eye, point) for point in on_line])
            # a line that is hidden from the beginning has no part to see from there
            if sees(scene, eye, p):
                until = seen_until(loops, *eye, *p, *q, -1)
                first = shares[np.argmin(visible)] if not visible.all() else 1.0
                assert first - 1 / 200 - 1e-9 <= until <= first + 1e-9
            last = last_seen(loops, *eye, *p, *q)
            highest = shares[visible].max() if visible.any() else 0.0
            assert last >= highest - 1e-9
            if last > highest + 1 / 200:  # between two samples
                assert sees(scene, eye, p + (last - 1e-6) * (q - p))
            gaps, whole, none = gaps + (not visible.all()), whole + visible.all(), none + (not visible.any())
    assert min(gaps, whole, none) > 10


def test_a_corner_that_only_grazes_the_line_of_sight_to_the_beginning_hides_nothing_behind_the_sweep():
    rng = np.random.default_rng(9)
    for _ in range(200):
        angle, far = rng.uniform(0, 2 * math.pi), rng.uniform(2, 20)
        turn = np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
        tip, p, q = far * np.array([(0.53, 0.0), (1.0, 0.0), (1.0, 1.0)]) @ turn
        behind, ahead = far * np.array([[(0.4, -0.2), (0.6, -0.2)], [(0.4, 0.2), (0.6, 0.2)]]) @ turn
        assert seen_until(boundary([[tip, *behind]]), 0.0, 0.0, *p, *q, -1) == 1.0
        assert seen_until(boundary([[tip, *ahead]]), 0.0, 0.0, *p, *q, -1) < 1e-9


def test_the_part_of_a_segment_within_a_disc():
    assert within(0, 0, 5.0, -10, 3, 10, 3) == pytest.approx((0.3, 0.7))
    assert within(0, 0, 5.0, 0, 0, 10, 0) == (0.0, 0.5)
    assert within(0, 0, 5.0, -10, 0, 0, 0) == (0.5, 1.0)
    assert within(0, 0, 5.0, -10, 6, 10, 6) == (1.0, 0.0)
    assert within(0, 0, 5.0, 6, 0, 9, 0) == (1.0, 0.0)
    assert within(0, 0, 5.0, 1, 1, 1, 1) == (0.0, 1.0)
    assert within(0, 0, 5.0, 9, 1, 9, 1) == (1.0, 0.0)
