"""VisBug-21 against Bug2 on random scenes: right answers, targets on Bug2's path, never longer; and what it knows."""

import math
from collections import Counter

import numpy as np
import pytest
import shapely

from cosim.geometry.boundary import boundary
from cosim.navigation.bug2 import bug2_path
from cosim.navigation.status import Status
from cosim.navigation.visbug import LOST, target_of, visbug_path, visbug_step
from tests.navigation.scenes import Scene, scenes, spiral
from tests.tiers import soak_count

SQUARE = [(4, -1), (6, -1), (6, 2), (4, 2)]
TOWER = [(4, -1), (5.5, -1), (5.4, 1), (5.2, 1), (5.2, 0.5), (5, 0.5), (5, 4), (4, 4)]
ROOM = [(0, -5), (10, -5), (10, 5), (0, 5)]
ENDED = (Status.ARRIVED, Status.UNREACHABLE)
ROUNDING_M = 1e-5
"""Eyes stand a few micrometres beside the boundary; nothing else is allowed for."""


def compare(scene: Scene, vision_m: float, step_m: float) -> float:
    """Check a VisBug-21 path against Bug2's and against shapely; return how much of Bug2's length it took."""
    loops = scene.loops
    bug, (path, targets) = (
        bug2_path(loops, scene.start, scene.goal),
        visbug_path(loops, scene.start, scene.goal, vision_m=vision_m, step_m=step_m, limit=100_000),
    )
    assert path.status is (Status.ARRIVED if scene.reachable else Status.UNREACHABLE), scene
    on_bug = shapely.distance(shapely.LineString(bug.points_m), shapely.points(targets))
    assert on_bug.max() < ROUNDING_M, scene
    assert path.length_m <= bug.length_m + ROUNDING_M, scene
    # a step around a bend of at most 60 degrees cuts the corner by less than 0.29 of the step
    way = shapely.LineString(path.points_m)
    assert way.intersection(scene.solid.buffer(-0.3 * step_m - ROUNDING_M)).length == 0.0, scene
    return path.length_m / max(bug.length_m, ROUNDING_M)


def radius_of(number: int) -> float:
    return float(10 ** np.random.default_rng((45, number)).uniform(-0.7, 1.5))


@pytest.mark.slow
def test_on_random_scenes_it_is_right_on_bug2s_path_never_longer_and_shorter_in_the_mean():
    ratios, outcomes = [], Counter()
    for number, scene in enumerate(scenes(90, 2_000)):
        ratios.append(compare(scene, radius_of(number), 0.3))
        outcomes[scene.reachable] += 1
    assert outcomes[True] > 50
    assert outcomes[False] >= 5
    assert np.mean(ratios) < 0.95
    assert np.mean(np.array(ratios) < 1 - 1e-3) > 0.5


@pytest.mark.soak
@pytest.mark.parametrize("part", range(4))
def test_on_a_thousand_scenes_it_is_right_on_bug2s_path_and_never_longer(part, record_property):
    count, first = soak_count(250), 50_000 * (part + 1)
    ratios = [compare(scene, radius_of(first + n), 0.25) for n, scene in enumerate(scenes(count, first))]
    record_property("scenes of VisBug-21", count)
    record_property("shorter than Bug2", sum(ratio < 1 - 1e-3 for ratio in ratios))
    assert np.mean(ratios) < 0.95 if count >= 100 else max(ratios) < 1 + 1e-9  # a few may all be as long


@pytest.mark.slow
@pytest.mark.parametrize(("number", "vision_m"), [(2264, 23.163), (2741, 28.97)])
def test_an_m_line_that_runs_along_a_wall_leads_through_nothing_solid(number, vision_m):
    compare(next(scenes(1, number)), vision_m, 0.3)  # seen from its main side, the end of the wall looks free


@pytest.mark.slow
@pytest.mark.parametrize("vision_m", [1.7, 100.0])
def test_a_shortcut_never_leads_back_behind_where_the_m_line_was_met_last(vision_m):
    """Between H and X (step 4) a piece of the M-line is free and in sight here, but not on Bug2's path."""
    compare(next(scenes(1, 2719)), vision_m, 0.3)


@pytest.mark.slow
@pytest.mark.parametrize("step_m", [0.02, 0.07, 0.5, 1.5])
def test_no_length_of_step_makes_it_longer_than_bug2(step_m):
    for number, scene in enumerate(scenes(9, 3_000)):
        compare(scene, radius_of(number), step_m)


@pytest.mark.slow
@pytest.mark.parametrize("left", [True, False])
def test_in_and_out_of_a_spiral_it_is_shorter_than_bug2(left):
    loop = spiral(turns=9, width=1.0)
    for start, goal in (((0.5, 0.5), (30.0, 3.0)), ((30.0, 3.0), (0.5, 0.5))):
        scene = Scene([loop], [], start, goal, left, shapely.Polygon(loop), "spiral")
        ratios = [compare(scene, vision_m, 0.05) for vision_m in (0.5, 2.0, 8.0, 100.0)]
        assert max(ratios) < 0.99
        assert ratios[0] > ratios[-1]


def test_with_a_far_sight_it_goes_straight_to_the_corner_it_has_to_pass():
    path, _ = visbug_path(boundary([SQUARE]), (0, 0), (10, 0), vision_m=100, step_m=0.01)
    assert path.status is Status.ARRIVED
    # T is first seen from the corner (6, 2); the way there touches the corner (4, 2)
    shortest = math.hypot(4, 2) + 2 + math.hypot(4, 2)
    assert path.length_m == pytest.approx(shortest, abs=1e-3)  # steps cut the corners by less than 3 % of a step


def test_from_the_main_half_plane_it_takes_the_farthest_visible_point_of_the_m_line():
    loops = boundary([TOWER])
    position, memory, target = (0.0, 0.0), None, (0.0, 0.0)
    while target[0] <= 5.0:
        x, y, status, memory = visbug_step(loops, position, (20, 0), memory, vision_m=8.0, step_m=0.1, near_m=0.01)
        position, target = (x, y), target_of(loops, memory)
        assert status is Status.UNDERWAY
    # from the corner over the corner (5.4, 1), behind which the boundary is out of sight, to the end of the sight
    assert math.dist(position, (5.0, 4.0)) < 0.1
    assert target == pytest.approx((5 + math.sqrt(8**2 - 4**2), 0.0), abs=1e-5)


@pytest.mark.parametrize("goal", [(5, 0), (12, 0), (12, 4.5)])
@pytest.mark.parametrize("left", [True, False])
def test_what_cannot_be_reached_is_proved_so_no_later_than_by_bug2(goal, left):
    loops = boundary([SQUARE], [ROOM], left=left)
    path, _ = visbug_path(loops, (1, 0), goal, vision_m=3.0, step_m=0.1)
    assert path.status is Status.UNREACHABLE
    assert path.length_m <= bug2_path(loops, (1, 0), goal).length_m


def test_a_proof_stands_until_the_goal_changes():
    loops, position, memory, status = boundary([SQUARE], [ROOM]), (1.0, 0.0), None, Status.UNDERWAY
    while status is not Status.UNREACHABLE:
        *position, status, memory = visbug_step(
            loops, tuple(position), (5, 0), memory, vision_m=3.0, step_m=0.1, near_m=0.01
        )
    again = visbug_step(loops, tuple(position), (5, 0), memory, vision_m=3.0, step_m=0.1, near_m=0.01)
    assert again[:3] == (*position, Status.UNREACHABLE)
    other = visbug_step(loops, tuple(position), (9, 0), again.memory, vision_m=3.0, step_m=0.1, near_m=0.01)
    assert other.status is Status.UNDERWAY
    assert math.dist(other[:2], position) == pytest.approx(0.1)


@pytest.mark.slow
def test_without_sight_it_is_bug2():
    compared = 0
    for scene in scenes(36, 4_000):
        bug = bug2_path(scene.loops, scene.start, scene.goal)
        if scene.family != "lattice" or bug.length_m > 60:
            continue
        # gaps of a lattice are a metre wide: no way is cut that is longer than the sight
        path, _ = visbug_path(scene.loops, scene.start, scene.goal, vision_m=0.01, step_m=0.004)
        corners = len(bug.points_m)
        assert bug.length_m - 0.02 * corners <= path.length_m <= bug.length_m + ROUNDING_M
        one, two = shapely.LineString(path.points_m), shapely.LineString(bug.points_m)
        if bug.status is Status.ARRIVED:  # a proof takes one look less
            assert shapely.hausdorff_distance(one, two, 0.05) <= 0.011
        compared += 1
    assert compared >= 5


@pytest.mark.slow
def test_the_robot_uses_nothing_that_it_does_not_see():
    """All edges that no look has seen are moved away or changed: every decision is the same."""
    changed = 0
    for number, scene in enumerate(scenes(60, 5_000)):
        if len(scene.obstacles) < 3:
            continue
        vision = 3.0
        memory, position = None, scene.start
        moves = []
        for _ in range(40):
            x, y, status, memory = visbug_step(
                scene.loops, position, scene.goal, memory, vision_m=vision, step_m=0.1, near_m=1e-6
            )
            moves.append((x, y, status))
            position = (x, y)
        way = shapely.LineString([scene.start, *[move[:2] for move in moves]])
        rng = np.random.default_rng(number)
        other = [_elsewhere(rng, loop, way, vision) for loop in scene.obstacles]
        changed += sum(one is not two for one, two in zip(other, scene.obstacles, strict=True))
        loops = boundary(other, scene.enclosures, left=scene.left)
        memory, position = None, scene.start
        for move in moves:
            x, y, status, memory = visbug_step(
                loops, position, scene.goal, memory, vision_m=vision, step_m=0.1, near_m=1e-6
            )
            assert (x, y) == pytest.approx(move[:2], abs=1e-9)
            assert status is move[2]
            position = (x, y)
    assert changed > 50


def _elsewhere(rng, loop, way, vision: float):
    """Return a loop with other vertices where it is out of sight of the way, the loop itself if that is nowhere."""
    out = shapely.distance(shapely.points(loop), way) > vision
    apart = out & np.roll(out, 1) & np.roll(out, -1)  # both edges at the vertex end out of sight
    sides = shapely.linestrings(np.stack((loop, np.roll(loop, -1, axis=0)), axis=1))
    clear = shapely.distance(sides, way) > vision + 0.01
    apart &= clear & np.roll(clear, 1)
    if not apart.any():
        return loop
    moved = np.array(loop, dtype=float)
    moved[apart] += rng.uniform(-0.005, 0.005, (int(apart.sum()), 2))
    return moved


def test_what_stands_behind_a_wall_changes_nothing_before_it_is_seen():
    wall = [(2, -6), (2.2, -6), (2.2, 6), (2, 6)]
    behind = [[(3, -1), (3.5, -1), (3.5, 1), (3, 1)], [(4, 0), (4.5, 2), (2.5, 3)], []]
    ways = []
    for hidden in behind:
        loops = boundary([wall, hidden] if hidden else [wall])
        ways.append([])
        position, memory = (0.0, 0.0), None
        for _ in range(60):
            x, y, _, memory = visbug_step(loops, position, (10, 0), memory, vision_m=5.0, step_m=0.1, near_m=0.01)
            ways[-1].append((x, y))
            position = (x, y)
    assert ways[0] == ways[1] == ways[2]
    assert 5 < ways[0][-1][1] < 6  # about to see around the end of the wall


def run(scene: Scene, disturb, vision_m: float = 2.0, steps: int = 200_000):
    """Run steps; *disturb(count, here, asked)* says where the robot really gets. Return place, status and restarts."""
    position, memory, status = scene.start, None, Status.UNDERWAY
    for count in range(steps):
        x, y, status, memory = visbug_step(
            scene.loops, position, scene.goal, memory, vision_m=vision_m, step_m=0.2, near_m=1e-6
        )
        if status in ENDED:
            break
        position = disturb(count, position, (x, y))
    return position, status, int(memory[LOST])


@pytest.mark.slow
def test_a_robot_that_is_stopped_short_goes_on_and_hardly_ever_begins_anew():
    rng = np.random.default_rng(6)

    def stopped(count, here, asked):
        share = (1.0, 1.0, rng.random(), 0.0)[count % 4]
        return tuple(h + share * (a - h) for h, a in zip(here, asked, strict=True))

    outcomes, restarts = Counter(), 0
    for scene in scenes(24, 6_000):
        _, status, lost = run(scene, stopped)
        assert (status is Status.ARRIVED) == scene.reachable
        outcomes[status] += 1
        restarts += lost
    assert min(outcomes[status] for status in ENDED) >= 2
    assert restarts <= 10


@pytest.mark.compiles
@pytest.mark.slow
def test_a_robot_that_is_pushed_about_or_kidnapped_still_ends_right():
    rng = np.random.default_rng(7)
    outcomes, restarts = Counter(), 0
    for scene in scenes(24, 7_000):
        free = [p for p in rng.uniform(0, 20, (40, 2)).tolist() if not scene.solid.intersects(shapely.Point(p))]

        def moved(count, here, asked, free=free):
            if count in (20, 60, 150) and free:
                return tuple(free.pop())
            return tuple(asked + rng.normal(0, 0.05, 2)) if count < 300 else asked

        position, status, lost = run(scene, moved)
        near = scene._replace(start=position)
        if scene.solid.contains(shapely.Point(position)):  # pushed into a wall at the last
            continue
        assert (status is Status.ARRIVED) == near.reachable
        outcomes[status] += 1
        restarts += lost
    assert min(outcomes[status] for status in ENDED) >= 2
    assert restarts > 10


def test_a_robot_that_is_stopped_before_a_corner_goes_back_to_the_target_that_it_saw():
    loops = boundary([TOWER])
    position, memory, target = (0.0, 0.0), None, (0.0, 0.0)
    while target[0] <= 5.0:
        before = position
        *position, _, memory = visbug_step(
            loops, tuple(position), (20, 0), memory, vision_m=8.0, step_m=0.1, near_m=0.01
        )
        target = target_of(loops, memory)
    short = (before[0] + 0.02, before[1])  # from here the corner (5, 4) hides the M-line
    *_, memory = visbug_step(loops, short, (20, 0), memory, vision_m=8.0, step_m=0.01, near_m=0.01)
    assert memory[LOST] == 0
    assert target_of(loops, memory) == (5.0, 4.0)


def test_a_robot_that_is_pushed_back_along_a_wall_or_around_a_corner_keeps_its_search():
    loops = boundary([SQUARE])
    position, memory = (3.9, 0.0), None

    def step(place):
        return visbug_step(loops, place, (10, 0), memory, vision_m=0.3, step_m=0.1, near_m=1e-6)

    for _ in range(15):
        *position, _, memory = step(tuple(position))
    assert target_of(loops, memory)[0] == 4.0
    *_, memory = step((3.99, position[1] - 0.2))  # nearly out of the sight of its target
    assert memory[LOST] == 0
    for _ in range(15):
        *position, _, memory = step(tuple(position))
    assert target_of(loops, memory)[1] == 2.0
    assert position[0] > 4.2
    *_, memory = step((3.99, 1.8))  # on the other side of the corner
    assert (memory[LOST], target_of(loops, memory)) == (0, pytest.approx((4.0, 2.0)))
    *_, memory = step((8, -3))
    assert memory[LOST] == 1


@pytest.mark.slow
def test_no_place_and_no_goal_makes_it_raise():
    rng = np.random.default_rng(8)
    said = Counter()
    for scene in scenes(12, 8_000):
        loops = scene.loops
        corners = [tuple(row[:2]) for row in loops.grid.walls_m[:8].tolist()]
        odd = [(0.0, 0.0), (1e9, -1e9), (1e-300, 5.0), *corners, *map(tuple, rng.uniform(-5, 25, (8, 2)).tolist())]
        memory = None
        for position in odd:
            for goal in odd:
                x, y, status, memory = visbug_step(loops, position, goal, memory, vision_m=3.0, step_m=0.1, near_m=0.01)
                x, y, status, memory = visbug_step(loops, (x, y), goal, memory, vision_m=3.0, step_m=0.1, near_m=0.01)
                assert math.isfinite(x)
                assert math.isfinite(y)
                said[status] += 1
    assert said[Status.UNDERWAY] > 1_000
    assert said[Status.ARRIVED] > 100


def test_a_robot_that_is_held_is_stuck_until_it_moves():
    loops, memory, said = boundary([SQUARE]), None, []
    for _ in range(22):
        *_, status, memory = visbug_step(loops, (1, 0), (9, 0), memory, vision_m=2.0, step_m=0.1, near_m=0.01)
        said.append(status)
    assert said == [Status.UNDERWAY] * 20 + [Status.STUCK] * 2
    *_, status, _ = visbug_step(loops, (1.1, 0), (9, 0), memory, vision_m=2.0, step_m=0.1, near_m=0.01)
    assert status is Status.UNDERWAY


def test_a_step_ends_at_a_sharp_corner_and_goes_on_around_a_round_one():
    position, memory, places = (3.95, 0.0), None, []
    for _ in range(30):
        x, y, _, memory = visbug_step(
            boundary([SQUARE]), position, (10, 0), memory, vision_m=5.0, step_m=0.13, near_m=0.01
        )
        position = (x, y)
        places.append(position)
    assert (4.0, 2.0) in places
    round_one = [(math.cos(a), math.sin(a)) for a in np.arange(16) * math.pi / 8]
    loops = boundary([round_one])
    position, memory = (-1.0, 0.0), None
    lengths = []
    for _ in range(5):
        x, y, _, memory = visbug_step(loops, position, (3, 0), memory, vision_m=5.0, step_m=0.2, near_m=0.01)
        lengths.append(math.dist(position, (x, y)))
        position = (x, y)
    assert min(lengths) > 0.19
