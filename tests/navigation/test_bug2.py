"""Bug2 against closed forms, against a telling of it with shapely, and against what shapely says can be reached."""

import math
from collections import Counter

import numpy as np
import pytest
import shapely

from cosim.geometry.boundary import boundary
from cosim.navigation.bug2 import bug2_path, bug2_step, crossings
from cosim.navigation.status import Status
from tests.navigation.bug2_oracle import bug2_by_hand
from tests.navigation.scenes import scenes, spiral
from tests.tiers import soak_count

SQUARE = [(4, -1), (6, -1), (6, 2), (4, 2)]
ROOM = [(0, -5), (10, -5), (10, 5), (0, 5)]


def steps(loops, start, goal, step_m=0.1, limit=100_000):
    """Return where the steps of Bug2 lead, and the last status."""
    points, memory, status = [start], None, Status.UNDERWAY
    while status in (Status.UNDERWAY, Status.STUCK) and len(points) < limit:
        x, y, status, memory = bug2_step(loops, points[-1], goal, memory, step_m=step_m, near_m=1e-6)
        points.append((x, y))
    return np.array(points), status


@pytest.mark.parametrize(("left", "length"), [(True, 14.0), (False, 12.0)])
def test_it_walks_around_a_square_on_the_side_of_its_local_direction(left, length):
    path = bug2_path(boundary([SQUARE], left=left), (0, 0), (10, 0))
    top = 2.0 if left else -1.0
    assert path.points_m.tolist() == [[0, 0], [4, 0], [4, top], [6, top], [6, 0], [10, 0]]
    assert (path.status, path.length_m) == (Status.ARRIVED, length)


def test_crossings_come_in_the_order_of_the_m_line_a_hit_and_a_leave_in_turn():
    loops = boundary([SQUARE, [(8, -1), (9, 0.5), (7, 0.5)]])
    edges, along, line, leaves = crossings(loops, (0, 0), (10, 0)).T
    assert line == pytest.approx([4, 6, 7 + 1 / 3, 8 + 2 / 3])
    assert along == pytest.approx([1, 2, 2 / 3 * math.hypot(1, 1.5), 1 / 3 * math.hypot(1, 1.5)])
    assert leaves.tolist() == [0, 1, 0, 1]
    assert loops.loop[edges.astype(int)].tolist() == [0, 0, 1, 1]


@pytest.mark.parametrize("left", [True, False])
@pytest.mark.parametrize("goal", [(5, 0), (12, 0), (12, 4.5)])
def test_a_goal_inside_an_obstacle_or_behind_the_walls_is_proved_unreachable(left, goal):
    path = bug2_path(boundary([SQUARE], [ROOM], left=left), (1, 0), goal)
    assert path.status is Status.UNREACHABLE
    assert path.points_m[-1].tolist() in path.points_m[:-1].tolist()  # at the hit point again
    assert path.length_m <= 12 + 10 + 40


@pytest.mark.parametrize("left", [True, False])
@pytest.mark.parametrize(
    ("start", "goal", "length"),
    [
        ((1, 2), (9, 2), {8.0}),  # along an edge: on it, or around the other side
        ((1, -1), (9, -1), {8.0}),
        ((4, 2), (9, 2), {5.0}),  # from a corner
        ((1, 1), (4, 1), {3.0}),  # to a place on an edge
        ((1, 1), (4, 2), {math.hypot(3, 1)}),  # to a corner
    ],
)
def test_m_lines_along_edges_and_through_corners(left, start, goal, length):
    path = bug2_path(boundary([SQUARE], left=left), start, goal)
    ways = {*length, *(one + 6 for one in length)} if start[1] == goal[1] else length
    assert path.status is Status.ARRIVED
    assert any(path.length_m == pytest.approx(way, abs=1e-4) for way in ways)


@pytest.mark.parametrize("tip", [-1e-9, -1e-13, -1e-16, 0.0, 1e-16, 1e-13, 1e-9])
@pytest.mark.parametrize("left", [True, False])
@pytest.mark.parametrize("dent", [True, False])
def test_a_corner_that_just_touches_the_m_line_costs_at_most_one_round(tip, left, dent):
    if dent:  # the point of a dent just reaches the line, inside the obstacle
        loop = [(3, -2), (6, tip), (9, -2), (9, 2), (3, 2)]
        away = 14 + 2 * math.hypot(3, 2)
    else:
        loop = [(6, tip), (9, -2), (3, -2)]
        away = 6 + 2 * math.hypot(3, 2)
    path = bug2_path(boundary([loop], left=left), (0, 0), (12, 0.0))
    assert path.status is Status.ARRIVED
    assert path.length_m <= 12 + away


def test_a_spiral_is_left_again_and_a_goal_in_its_middle_is_found():
    loop = spiral(turns=9, width=1.0)
    lengths = []
    for left in (True, False):
        loops = boundary([loop], left=left)
        out = bug2_path(loops, (0.5, 0.5), (30, 3))
        assert out.status is Status.ARRIVED
        back = bug2_path(loops, (30, 3), (0.5, 0.5))
        assert back.status is Status.ARRIVED
        lengths += [out.length_m, back.length_m]
    assert max(lengths) > 2 * 30


@pytest.mark.slow
def test_it_goes_the_way_that_shapely_tells_and_never_beyond_lumelskys_bound():
    seen = Counter()
    for scene in scenes(90):
        if scene.family == "lattice":  # not in general position: the telling has no order for corners on the line
            continue
        path, told = bug2_path(scene.loops, scene.start, scene.goal), bug2_by_hand(scene)
        assert (path.status is Status.ARRIVED) == told.arrived
        assert path.length_m == pytest.approx(told.length_m, abs=1e-4)
        if told.arrived:
            assert path.length_m <= told.bound_m + 1e-4  # D + sum of n_i p_i / 2 (equation 3.9)
        seen[told.arrived] += 1
        seen["hits"] += told.hits
    assert seen[True] > 30
    assert seen[False] >= 5
    assert seen["hits"] > 60


def agrees(scene) -> bool:
    """Whether Bug2 reaches the goal exactly if shapely says that it can be reached; return that."""
    path = bug2_path(scene.loops, scene.start, scene.goal)
    assert (path.status is Status.ARRIVED) == scene.reachable, scene
    assert path.status is not Status.UNDERWAY
    return scene.reachable


@pytest.mark.slow
def test_no_goal_is_falsely_called_unreachable_and_none_falsely_reached():
    seen = Counter((scene.family, agrees(scene)) for scene in scenes(180, 1_000))
    assert len(seen) == 6
    assert min(seen.values()) >= 3


@pytest.mark.soak
@pytest.mark.parametrize("part", range(4))
def test_no_goal_is_falsely_called_unreachable_in_a_thousand_scenes(part, record_property):
    count = soak_count(250)
    reached = sum(map(agrees, scenes(count, 10_000 * (part + 1))))
    record_property("scenes of Bug2", count)
    record_property("goals of Bug2 reached", reached)


@pytest.mark.slow
def test_steps_follow_the_path_and_their_number_is_its_length():
    for scene in scenes(30, 400):
        path = bug2_path(scene.loops, scene.start, scene.goal)
        points, status = steps(scene.loops, scene.start, scene.goal)
        assert status is path.status
        on_path = shapely.distance(shapely.LineString(path.points_m), shapely.points(points))
        assert on_path.max() < 1e-5
        moves = np.hypot(*np.diff(points, axis=0).T)
        assert moves.max() <= 0.1 + 1e-9
        corners = len(path.points_m)
        assert path.length_m / 0.1 - corners <= len(points) - 1 <= path.length_m / 0.1 + corners + 2


def test_the_robot_knows_only_what_it_touches():
    near, far = [(2, -1), (3, -1), (3, 1), (2, 1)], [(20, -1), (21, -1), (21, 1), (20, 1)]
    one, two = boundary([near, far]), boundary([near, [(30, 0), (35, 3), (30, 3)]])
    points, status = steps(one, (0, 0), (40, 0), limit=60)
    again, _ = steps(two, (0, 0), (40, 0), limit=60)
    assert status is Status.UNDERWAY
    assert points.tolist() == again.tolist()


def test_a_robot_that_is_held_is_stuck_and_goes_on_when_let_go():
    loops, position, memory, said = boundary([SQUARE]), (1.0, 0.0), None, []
    for _ in range(25):
        *_, status, memory = bug2_step(loops, position, (9, 0), memory, step_m=0.1, near_m=1e-6)
        said.append(status)
    assert said == [Status.UNDERWAY] * 20 + [Status.STUCK] * 5
    x, y, _, memory = bug2_step(loops, position, (9, 0), memory, step_m=0.1, near_m=1e-6)
    assert (x, y) == pytest.approx((1.1, 0.0))
    assert bug2_step(loops, (x, y), (9, 0), memory, step_m=0.1, near_m=1e-6).status is Status.UNDERWAY


def test_the_answer_depends_on_the_arguments_alone_and_leaves_the_memory_as_it_was():
    loops = boundary([SQUARE])
    first = bug2_step(loops, (3.95, 0), (9, 0), None, step_m=0.1, near_m=1e-6)
    kept = first.memory.copy()
    again = [bug2_step(loops, first[:2], (9, 0), first.memory, step_m=0.1, near_m=1e-6) for _ in range(2)]
    assert first.memory.tolist() == kept.tolist()
    assert again[0][:3] == again[1][:3]
    assert again[0].memory.tolist() == again[1].memory.tolist()


def test_another_goal_begins_anew_and_a_goal_within_reach_is_arrived_at():
    loops = boundary([SQUARE])
    move = bug2_step(loops, (4, 1), (9, 0), None, step_m=0.1, near_m=0.05)
    other = bug2_step(loops, (3, 1), (0, 1), move.memory, step_m=0.1, near_m=0.05)
    assert other[:2] == pytest.approx((2.9, 1.0))
    assert bug2_step(loops, (3, 1), (3.04, 1), other.memory, step_m=0.1, near_m=0.05).status is Status.ARRIVED


@pytest.mark.slow
def test_a_robot_that_is_moved_begins_anew_and_still_ends_right():
    rng = np.random.default_rng(5)
    outcomes = Counter()
    for scene in scenes(30, 700):
        free = [p for p in rng.uniform(0, 20, (40, 2)).tolist() if not scene.solid.intersects(shapely.Point(p))]
        position, memory, status = scene.start, None, Status.UNDERWAY
        for count in range(100_000):
            if count in (20, 60, 150) and free:
                position = tuple(free.pop())
            x, y, status, memory = bug2_step(scene.loops, position, scene.goal, memory, step_m=0.2, near_m=1e-6)
            if status in (Status.ARRIVED, Status.UNREACHABLE):
                break
            position = (x, y)
        moved = scene._replace(start=position)
        assert (status is Status.ARRIVED) == (moved.reachable or math.dist(position, scene.goal) <= 1e-6)
        outcomes[status] += 1
    assert min(outcomes[Status.ARRIVED], outcomes[Status.UNREACHABLE]) >= 2


def test_a_robot_that_is_moved_behind_an_obstacle_does_not_go_back_through_it():
    loops = boundary([SQUARE])
    move = bug2_step(loops, (1, 0), (10, 0), None, step_m=0.1, near_m=1e-6)
    seen = bug2_step(loops, (1.1, 0.5), (10, 0), move.memory, step_m=0.1, near_m=1e-6)
    assert seen[:2] == pytest.approx((1.1, 0.4)), "back to its path, which it sees"
    moved = bug2_step(loops, (7, 1), (10, 0), move.memory, step_m=0.1, near_m=1e-6)
    assert moved[:2] == pytest.approx((7 + 0.3 / math.sqrt(10), 1 - 0.1 / math.sqrt(10)))


@pytest.mark.parametrize("left", [True, False])
def test_a_goal_anywhere_on_an_outline_is_reached(left):
    loops = boundary([SQUARE], [ROOM], left=left)
    rng = np.random.default_rng(10)
    for edge, (x1, y1, x2, y2) in enumerate(loops.grid.walls_m.tolist()):
        for share in (0.0, 0.5, 1.0, *rng.random(5)):
            goal = (x1 + share * (x2 - x1), y1 + share * (y2 - y1))
            for start in (
                (1, 0),
                (5, -3),
                (8, 2),
                (6, 3),
                (1, 2),
                (2.0, -1.0),
                *rng.uniform((0, 2.1), (10, 5), (5, 2)),
            ):
                assert bug2_path(loops, start, goal).status is Status.ARRIVED, (edge, share, start)
