"""People in a team: they may see less far than robots or farther, and they know only the straight line to a place."""

import math
from typing import Any

import numpy as np
import pytest
from shapely import LineString, MultiLineString

from cosim.errors import UserError
from cosim.units import MS, to_seconds
from protocols.aggregation.events import HostFailed, TargetFound
from protocols.aggregation.ground import Ground
from protocols.aggregation.messages import Plan, Plans
from protocols.aggregation.touring import Motion
from tests.protocols.aggregation.team_scene import TARGETS_M, WALLS_M, Alone, Point, prepared, run, scenario
from tests.tiers import each_value

STARTS_M = [(9.5, 9.0), (10.5, 9.0), (9.5, 10.4), (10.0, 10.4), (10.5, 10.4)]
"""Two hosts, three searchers, close together: 2 and 4 are led by host 0, 3 by host 1."""
HERE_M: Point = (9.0, 3.0)
"""By the wall x = 10, whose next opening begins at (10, 8)."""
BEYOND_M: Point = (11.0, 3.0)
"""Two metres away, behind the wall; round its end it is more than ten."""
FARTHER_M: Point = (3.0, 3.0)
"""Six metres away, in the same room."""


# ---------------------------------------------------------------- what is recognised


def finds_at(robot: int, distance_m: float, **parameters: Any) -> bool:
    """Return whether a searcher that comes so near to a target recognises it."""
    searcher = Alone(robot, STARTS_M, targets=((3.0, 3.0),), **parameters)
    assert searcher.noted == []
    searcher.looks((3.0 + distance_m, 3.0))
    return TargetFound(0, 3.0, 3.0) in searcher.noted


def test_a_person_with_a_shorter_sight_finds_a_target_only_nearer() -> None:
    people: dict[str, Any] = {"humans": (2, 4), "human_camera_m": 2.0}
    for person in (2, 4):
        assert not finds_at(person, 2.1, **people)
        assert finds_at(person, 1.9, **people)
    assert finds_at(3, 5.9, **people), "a robot sees as far as before"


def test_people_see_as_far_as_robots_if_nothing_else_is_said() -> None:
    assert finds_at(2, 5.9, humans=(2,))
    assert finds_at(2, 5.9, humans=(2,), human_vision_m=1.0)


@pytest.mark.parametrize(
    ("robot", "parameters", "sees"),
    [
        (2, {"humans": (2,)}, True),
        (2, {"humans": (2,), "human_vision_m": 4.0}, True),
        (2, {"humans": (2,), "human_vision_m": 2.0}, False),
        (2, {"humans": (2,), "human_vision_m": 0.0}, False),
        (2, {"humans": (2,), "human_vision_m": 4.0, "vision_m": 2.0}, True),
        (2, {"humans": (4,), "human_vision_m": 2.0}, True),
    ],
)
def test_a_searcher_heads_for_its_host_where_it_recognises_it(
    robot: int, parameters: dict[str, Any], sees: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It sees the host three metres off, elsewhere than where the host's plan says."""
    goals = goals_of(monkeypatch)
    searcher = Alone(robot, STARTS_M, **parameters)
    searcher.hears(0, Plans((Plan(0, 1, 0, 1.0, ((9.5, 9.0),)),)))
    searcher.passes(2.8)
    assert goals[-1] == (9.5, 9.0)
    searcher.now += 100 * MS
    searcher.looks(seen=[(0, 6.5, 10.4)])
    assert goals[-1] == ((6.5, 10.4) if sees else (9.5, 9.0))


# ---------------------------------------------------------------- posts


def ground_with(**parameters: Any) -> Ground:
    return prepared(STARTS_M, **parameters)[1].ground


def unseen_m(ground: Ground, range_m: float) -> list[Point]:
    """Return which of many points of the floor lie in range and sight of no post."""
    walls = MultiLineString([((a, b), (c, d)) for a, b, c, d in WALLS_M])
    points = np.random.default_rng(1).uniform(0.01, 19.99, (1500, 2)).tolist()

    def seen(point: Point) -> bool:
        near = (post for post in ground.posts_m if math.dist(post, point) <= range_m)
        return any(not LineString([post, point]).crosses(walls) for post in near)

    return [(x, y) for x, y in points if not seen((x, y))]


@pytest.mark.slow
def test_posts_are_so_close_together_that_people_see_the_whole_floor_from_them() -> None:
    robots, people = ground_with(), ground_with(humans=(3,), human_camera_m=3.0)
    assert len(people.posts_m) > 1.5 * len(robots.posts_m)
    assert unseen_m(people, 3.0) == []
    assert unseen_m(robots, 6.0) == []
    assert unseen_m(robots, 3.0), "for robots they are farther apart"


def test_posts_are_those_of_robots_if_people_see_as_far() -> None:
    posts_m = ground_with().posts_m
    assert ground_with(humans=(3,)).posts_m == posts_m
    assert ground_with(humans=(3,), human_camera_m=9.0, human_vision_m=1.0).posts_m == posts_m


# ---------------------------------------------------------------- ways without a map


def goals_of(monkeypatch: pytest.MonkeyPatch) -> list[Point]:
    """Return a list that the places will be in for which searchers head in order to meet a host."""
    goals: list[Point] = []
    monkeypatch.setattr(Motion, "approach", lambda self, goal_m, observation: goals.append(goal_m))
    return goals


def meeting_m(way_m: float, depart_m: Point, speed_mps: float, now_s: float) -> Point:
    """Return where a host that goes along x from *depart_m* since 0 s is when a way has been gone at 2 m/s."""
    return depart_m[0] + speed_mps * (now_s + way_m / 2.0), depart_m[1]


def first_goal_m(monkeypatch: pytest.MonkeyPatch, **parameters: Any) -> tuple[Point, float]:
    """Return where a searcher expects its host, which moves away behind the wall, and when it thought of that."""
    goals = goals_of(monkeypatch)
    searcher = Alone(2, [BEYOND_M, *STARTS_M[:1], HERE_M, *STARTS_M[3:]], **parameters)
    searcher.hears(0, Plans((Plan(0, 1, 0, 0.5, (BEYOND_M, (19.0, 3.0))),)))
    while not goals:
        searcher.passes(0.1)
    return goals[0], to_seconds(searcher.now)


def test_a_person_reckons_with_the_straight_line_to_its_host(monkeypatch: pytest.MonkeyPatch) -> None:
    goal, now_s = first_goal_m(monkeypatch, humans=(2,))
    there = meeting_m(0.0, BEYOND_M, 0.5, now_s)
    assert goal == pytest.approx(meeting_m(math.dist(HERE_M, there), BEYOND_M, 0.5, now_s))


def test_a_robot_reckons_with_the_way_round_the_wall(monkeypatch: pytest.MonkeyPatch) -> None:
    goal, now_s = first_goal_m(monkeypatch)
    there, end = meeting_m(0.0, BEYOND_M, 0.5, now_s), (10.0, 8.0)
    around_m = math.dist(HERE_M, end) + math.dist(end, there)
    assert goal[0] > meeting_m(around_m, BEYOND_M, 0.5, now_s)[0]


@pytest.mark.parametrize("others_m", [(BEYOND_M, FARTHER_M), (FARTHER_M, BEYOND_M)])
@pytest.mark.parametrize(("humans", "closest_m"), [((3,), BEYOND_M), ((), FARTHER_M)])
def test_the_closest_host_is_that_in_a_straight_line_for_people(
    humans: tuple[int, ...], closest_m: Point, others_m: tuple[Point, ...]
) -> None:
    """The own host is silent, and so is everybody; the others are looked for one after the other."""
    hosts_m = (HERE_M, *others_m)
    searcher = Alone(3, [*hosts_m, HERE_M], hosts=3, humans=humans)
    searcher.hears(0, Plans(tuple(Plan(host, 1, 0, 1.0, (at,)) for host, at in enumerate(hosts_m))))
    searcher.passes(90.0, walks=True)
    failed_m = [hosts_m[event.host] for event in searcher.noted if isinstance(event, HostFailed)]
    assert len(failed_m) == 3
    assert failed_m[:2] == [HERE_M, closest_m]


# ---------------------------------------------------------------- what is refused


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"humans": (2,), "human_camera_m": 0.0}, r"human_camera_m: 0\.0 is not >= 0\.1"),
        ({"humans": (2,), "human_vision_m": -1.0}, r"human_vision_m: -1\.0 is not >= 0"),
        ({"humans": (2,), "human_camera_m": math.nan}, "human_camera_m: nan is not a finite number"),
        ({"human_camera_m": 3.0}, r"human_camera_m: 3\.0 is nobody's, expected a searcher in humans"),
        ({"human_vision_m": 0.0}, r"human_vision_m: 0\.0 is nobody's, expected a searcher in humans"),
        ({"humans": "everybody", "human_vision_m": 2.0}, "humans: 'everybody' is not a valid tuple$"),
    ],
)
def test_a_sight_that_nobody_can_have_is_refused(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(UserError, match=r"protocol\.parameters\." + message):
        scenario(**wrong)


# ---------------------------------------------------------------- a whole search


@pytest.mark.compiles
@pytest.mark.slow
@pytest.mark.parametrize(("strategy", "humans"), each_value(["srp", "mi", "random"], [(3,), (2, 3, 4)]))
def test_a_search_with_people_of_shorter_sight_ends(strategy: str, humans: tuple[int, ...]) -> None:
    search = run(strategy, humans=humans, human_camera_m=2.5, human_vision_m=1.0)
    assert search.ended
    for row in search.told("TargetFound"):
        here = search.place_m(row["source"], row["s"])
        sight_m = 2.5 if row["source"] in humans else 6.0
        assert math.dist(here, TARGETS_M[row["target"]]) <= sight_m + 1e-6
    assert all(search.way_m(person) > 5.0 for person in humans)
