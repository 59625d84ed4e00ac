"""The floors of the searches of paper 002: rooms, doors, ways and places are what their heads say."""

from functools import lru_cache
from typing import Any

import numpy as np
import pytest

from cosim.geometry.grids import Cell
from cosim.geometry.planning import PlanningGrid, cost_to_go, wall_planning_grid
from cosim.geometry.segments import sees
from cosim.world.floorplan import Floorplan, FloorplanSettings, load_floorplan
from tests.checkout import FLOORS

SEARCHES = ("search", "search_open", "search_nested")
RADIUS_M = 0.25
Point = tuple[float, float]


@lru_cache
def floor(name: str) -> Floorplan:
    return load_floorplan(FloorplanSettings(map=f"{name}.yaml"), FLOORS)


@lru_cache
def grid_of(name: str, radius_m: float = RADIUS_M, cell_m: float = 0.25) -> PlanningGrid:
    plan = floor(name)
    return wall_planning_grid(plan.bounds_m, cell_m, radius_m, plan.walls_m, plan.forbidden)


@lru_cache
def lengths(name: str, radius_m: float = RADIUS_M, cell_m: float = 0.25) -> Any:
    """Return the length in metres of the shortest way from the start to every cell."""
    grid = grid_of(name, radius_m, cell_m)
    return cost_to_go(grid.free, [grid.cell_at(*floor(name).places_m["start"][0])]) * cell_m


def way_m(name: str, to: Point, radius_m: float = RADIUS_M, cell_m: float = 0.25) -> float:
    return float(lengths(name, radius_m, cell_m).flat[grid_of(name, radius_m, cell_m).cell_at(*to)])


def boxes(name: str) -> list[tuple[Point, Point]]:
    corners = floor(name).places_m["room_corners"]
    return list(zip(corners[::2], corners[1::2], strict=True))


def cells_in(grid: PlanningGrid, low: Point, high: Point, every: int = 1) -> list[Cell]:
    """Return the free cells whose centres are in a rectangle, one in *every* x *every*."""
    rows, columns = np.nonzero(grid.free)
    x = grid.origin_m[0] + (columns + 0.5) * grid.cell_m
    y = grid.origin_m[1] + (rows + 0.5) * grid.cell_m
    inside = (x > low[0]) & (x < high[0]) & (y > low[1]) & (y < high[1])
    inside &= (rows % every == 0) & (columns % every == 0)
    cells: list[Cell] = (rows[inside] * grid.free.shape[1] + columns[inside]).tolist()
    return cells


def seen(name: str, viewers: list[Point], points: list[Point]) -> Any:
    """Return which of *points* any of *viewers* has a line of sight to."""
    a_m = np.repeat(np.array(viewers), len(points), axis=0)
    b_m = np.tile(np.array(points), (len(viewers), 1))
    return sees(floor(name).grid, a_m, b_m).reshape(len(viewers), len(points)).any(axis=0)


@pytest.mark.parametrize("name", SEARCHES)
def test_a_floor_of_150_m_has_twenty_rooms_one_a_rectangle(name: str) -> None:
    plan = floor(name)
    rooms = plan.places_m["rooms"]
    assert plan.bounds_m == (0, 0, 150, 150)
    assert len(rooms) == len(boxes(name)) == 20
    for number, (low, high) in enumerate(boxes(name)):
        held = [k for k, (x, y) in enumerate(rooms) if low[0] < x < high[0] and low[1] < y < high[1]]
        assert held == [number]


@pytest.mark.slow
@pytest.mark.parametrize("name", SEARCHES)
def test_a_rectangle_is_one_room(name: str) -> None:
    grid = grid_of(name)
    for room, (low, high) in zip(floor(name).places_m["rooms"], boxes(name), strict=True):
        cells = cells_in(grid, low, high)
        inside = np.zeros_like(grid.free)
        inside.flat[cells] = True
        cost = cost_to_go(inside, [grid.cell_at(*room)])
        assert np.isfinite(cost.flat[cells]).all()


@pytest.mark.parametrize("name", [*SEARCHES, "laboratory"])
def test_a_robot_gets_everywhere_from_the_start(name: str) -> None:
    cell_m = 0.1 if name == "laboratory" else 0.25
    grid, way = grid_of(name, RADIUS_M, cell_m), lengths(name, RADIUS_M, cell_m)
    assert np.isfinite(way[grid.free]).all()
    for places in floor(name).places_m.values():
        for place in places:
            if place not in floor(name).places_m.get("room_corners", ()):
                assert np.isfinite(way_m(name, place, RADIUS_M, cell_m)), place


@pytest.mark.slow
@pytest.mark.parametrize(("name", "door_m"), [("search", 2.0), ("search_nested", 2.0), ("search_open", 8.0)])
def test_the_doors_are_as_wide_as_they_are_said_to_be(name: str, door_m: float) -> None:
    for room in floor(name).places_m["rooms"]:
        assert np.isfinite(way_m(name, room, door_m / 2 - 0.13))  # half a cell less
        assert not np.isfinite(way_m(name, room, door_m / 2 + 0.01))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "seen_wholly"),
    [("search", [7, 12, 17]), ("search_open", list(range(20))), ("search_nested", [])],
)
def test_rooms_have_corners_that_nobody_sees_from_outside(name: str, seen_wholly: list[int]) -> None:
    """But for the bays of the open floor, and the rectangles in three L, which are seen from their other arm."""
    grid = grid_of(name)
    outside = np.array(grid.free)
    for low, high in boxes(name):
        outside.flat[cells_in(grid, low, high)] = False
    rows, columns = np.nonzero(outside)
    thin = (rows % 8 == 0) & (columns % 8 == 0)
    viewers = [grid.centre_m(cell) for cell in (rows[thin] * grid.free.shape[1] + columns[thin]).tolist()]
    found = []
    for number, (low, high) in enumerate(boxes(name)):
        points = [grid.centre_m(cell) for cell in cells_in(grid, low, high, 6)]
        if seen(name, viewers, points).all():
            found.append(number)
    assert found == seen_wholly


@pytest.mark.parametrize("name", [*SEARCHES, "laboratory"])
def test_the_robots_begin_near_the_start_and_do_not_touch(name: str) -> None:
    plan = floor(name)
    starts = np.array(plan.places_m["starts"])
    reach_m = 1.0 if name == "laboratory" else 20.0
    apart = np.linalg.norm(starts[:, None] - starts[None], axis=2)[np.triu_indices(len(starts), 1)]
    assert len(starts) == (3 if name == "laboratory" else 9)
    assert apart.min() >= 2 * RADIUS_M + 0.1
    assert np.linalg.norm(starts - starts[0], axis=1).max() < reach_m
    assert tuple(starts.mean(axis=0)) == pytest.approx(plan.places_m["start"][0], abs=0.5)


@pytest.mark.parametrize("family", ["targets", "targets_a", "targets_b"])
def test_each_distribution_in_the_laboratory_is_farther_than_the_one_before(family: str) -> None:
    sets = [floor("laboratory").places_m[f"{family}_{number}"] for number in (1, 2, 3, 4)]
    assert [len(targets) for targets in sets] == [3, 3, 3, 3]
    farthest = [max(way_m("laboratory", target, RADIUS_M, 0.1) for target in targets) for targets in sets]
    assert np.all(np.diff(farthest) > 0.5)


def test_two_robots_get_past_each_other_in_the_laboratory() -> None:
    for room in (*floor("laboratory").places_m["rooms"], *floor("laboratory").places_m["exit"]):
        assert np.isfinite(way_m("laboratory", room, 2 * RADIUS_M - 0.01, 0.05))
