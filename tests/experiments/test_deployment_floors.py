"""The floors of the deployment experiments: ways are as long as their heads say, and all who drive there fit."""

import math
from functools import lru_cache
from itertools import pairwise
from typing import Any

import pytest
import shapely
import yaml

from cosim.world.floorplan import Floorplan, FloorplanSettings, load_floorplan
from protocols.motion.floor import Floor
from tests.checkout import EXPERIMENTS

LARGEST_M = 0.33
Point = tuple[float, float]


@lru_cache
def plan(name: str) -> Floorplan:
    return load_floorplan(FloorplanSettings(map=f"{name}.yaml"), EXPERIMENTS / "floors")


@lru_cache
def floor(name: str) -> Floor:
    own = plan(name)
    return Floor(own.walls_m, own.bounds_m, own.forbidden)


def place(letter: str) -> Point:
    (at,) = plan("wean").places_m[letter]
    return at


def walls(name: str) -> Any:
    return shapely.MultiLineString([((x1, y1), (x2, y2)) for x1, y1, x2, y2 in plan(name).walls_m.tolist()])


ROUTES = ("ABC", "ABCD", "ABE", "ABEF")
"""What each of the four robots drives: two leap-frog, two as a group (paper 004, section 7)."""


def test_the_routes_of_the_typical_scenario_are_50_m_in_the_mean() -> None:
    lengths = [sum(math.dist(place(a), place(b)) for a, b in pairwise(route)) for route in ROUTES]
    assert sum(lengths) / len(lengths) == 50.0


@pytest.mark.parametrize("leg", ["AB", "BC", "CD", "BE", "EF"])
def test_a_leg_is_straight_for_every_body(leg: str) -> None:
    """No way is shorter than a straight one, and the widest robot drives it 15 cm off the walls or more."""
    line = shapely.LineString([place(leg[0]), place(leg[1])])
    assert line.distance(walls("wean")) >= LARGEST_M + 0.15


@pytest.mark.parametrize("radius_m", [0.25, 0.267, 0.305, LARGEST_M])
def test_the_planner_finds_these_routes(radius_m: float) -> None:
    lengths = []
    for route in ROUTES:
        legs = [floor("wean").length_m(radius_m, place(a), place(b)) for a, b in pairwise(route)]
        lengths.append(sum(leg for leg in legs if leg is not None))
        assert None not in legs
    assert sum(lengths) / len(lengths) == pytest.approx(50.0, abs=0.1)  # a cell


def test_two_of_the_widest_pass_each_other_in_the_corridors_but_not_in_the_door() -> None:
    for name, at, across in (("wean", (15.0, 34.0), 2.4), ("wean", (6.0, 34.0), 1.2), ("deploy", (11.0, 4.0), 2.4)):
        assert 2 * shapely.Point(at).distance(walls(name)) == pytest.approx(across)
    assert 1.2 < 4 * LARGEST_M < 2.4


def test_the_posts_lie_in_a_row_and_everybody_fits() -> None:
    base, *_ = plan("deploy").places_m["base"]
    posts = plan("deploy").places_m["posts"]
    assert len(posts) == 8
    for number, post in enumerate(posts):
        assert floor("deploy").free(LARGEST_M, post)
        assert 2 * shapely.Point(post).distance(walls("deploy")) == pytest.approx(2.4)
        assert math.dist(posts[max(number - 1, 0)], post) in (0.0, 6.0, math.hypot(6.0, 6.0))
    lengths = [floor("deploy").length_m(LARGEST_M, base, post) or math.nan for post in posts]
    assert lengths == sorted(lengths)
    assert lengths[3] == pytest.approx(28.0, abs=0.2)
    assert 48.0 < lengths[7] <= 58.0 + 0.2  # a corner is cut


def test_the_platforms_are_documented() -> None:
    platforms = yaml.safe_load((EXPERIMENTS / "deployment_wean" / "platforms.yaml").read_text(encoding="utf-8"))
    assert set(platforms) == {"pioneer_at", "b21", "b24"}
    for each in platforms.values():
        assert each["source"]
        assert 0.2 < each["radius_m"] <= LARGEST_M
        assert 0 < each["acceleration_mps2"] <= each["speed_mps"] < 1
