"""The judge of exploration against slow models in shapely: what can be seen, what scans cover, when how much was."""

import math
from itertools import pairwise
from typing import Any

import networkx
import numpy as np
import pytest
import shapely
from shapely.ops import substring

from cosim.protocol import Death, Surroundings
from cosim.units import MS, S
from protocols.exploration.parameters import Parameters
from protocols.exploration.referee import LOOK_TICKS, SHARES, CoverageReferee, coverable_cells, reachable_cells, when_s
from protocols.exploration.setup import prepare
from protocols.exploration.spec import SPEC
from protocols.mapping.belief import Frame

WIDE_M, HIGH_M = 2.4, 1.6
CELL_M = 0.1
RADIUS_M = 0.15
BOX = shapely.box(0.0, 0.0, WIDE_M, HIGH_M)
BLOCK = shapely.box(1.72, 1.13, 2.03, 1.41)
"""Solid: nobody is in it."""
NARROW = [[0.8317, 0.0, 0.8317, 1.0137], [0.8317, 1.2291, 0.8317, HIGH_M], [1.5617, 0.3713, 1.5617, HIGH_M]]
"""Two walls across the floor: the first has a door for the eye alone, the second one that is wide enough."""
DIVIDED = np.array([[0.0, 0.0, 0.0, HIGH_M], [1.2, -1.0, 1.2, 9.0]])
"""A wall on the edges of cells, and nothing but the floor's end round about."""
BEHIND = (1.18, 0.61)
LEFT = (0.37, 0.41)


def edges(shape: Any) -> list[list[float]]:
    corners = list(shape.exterior.coords)
    return [[*a, *b] for a, b in pairwise(corners)]


def forbidden(points: Any) -> Any:
    places = shapely.points(points)
    return ~shapely.contains(BOX, places) | shapely.contains(BLOCK, places)


def around(*starts: tuple[float, float], **more: Any) -> Surroundings:
    plain = {
        "starts_m": starts,
        "radius_m": RADIUS_M,
        "speed_mps": 0.3,
        "acceleration_mps2": 1.0,
        "tick": 100 * MS,
        "walls_m": np.array(edges(BOX) + edges(BLOCK) + NARROW),
        "bounds_m": (0.0, 0.0, WIDE_M, HIGH_M),
        "forbidden": forbidden,
        "scan_range_m": 0.75,
        "beams": 360,
    }
    return Surroundings(**(plain | more))


def frame(surroundings: Surroundings) -> Frame:
    found = prepare(Parameters.model_validate({"schemas": {"obstacle_m": 0.3}}), surroundings).frame
    assert (found.nx, found.ny, found.cell_m) == (26, 18, CELL_M)
    return found


def centres() -> Any:
    return [(0.1 * (k % 26) - 0.05, 0.1 * (k // 26) - 0.05) for k in range(26 * 18)]


def walls(surroundings: Surroundings) -> Any:
    return shapely.multilinestrings(surroundings.walls_m.reshape(-1, 2, 2))


def reachable_by_hand(surroundings: Surroundings, start: tuple[float, float], radius_m: float) -> set[int]:
    """Return the cells to whose centres a disc gets from *start*, over four neighbours; its edge may touch walls."""
    points = [*centres(), start]
    last = len(points) - 1
    stands = ~forbidden(points)
    pairs = [
        (a, b) for a in range(last) for b in (a + 1, a + 26, last) if b < last or math.dist(points[a], start) < 0.2
    ]
    pairs = [(a, b) for a, b in pairs if stands[a] and stands[b] and math.dist(points[a], points[b]) <= 1.5 * CELL_M]
    ways = shapely.linestrings([(points[a], points[b]) for a, b in pairs])
    fits = shapely.distance(ways, walls(surroundings)) >= radius_m - 1e-9
    graph = networkx.Graph([pair for pair, fit in zip(pairs, fits.tolist(), strict=True) if fit])
    graph.add_node(last)
    return set(networkx.node_connected_component(graph, last)) - {last}


def seen_by_hand(surroundings: Surroundings, posts: set[int]) -> set[int]:
    """Return the free cells whose centre some post has in sight and in range."""
    solid, points, most = walls(surroundings), centres(), surroundings.scan_range_m + 1e-9
    free = np.flatnonzero(~forbidden(points)).tolist()
    pairs = [(cell, post) for cell in free for post in posts if math.dist(points[cell], points[post]) <= most]
    lines = shapely.linestrings([(points[cell], points[post]) for cell, post in pairs if cell != post])
    distances = shapely.distance(lines, solid)
    assert not ((distances > 0.0) & (distances < 1e-9)).any()
    blocked = iter((distances == 0.0).tolist())
    return {cell for cell, post in pairs if cell == post or not next(blocked)}


def test_a_team_reaches_what_a_flood_fill_with_its_body_reaches() -> None:
    for start in (LEFT, BEHIND):
        found = set(np.flatnonzero(reachable_cells(frame(around(start)), around(start))).tolist())
        assert found == reachable_by_hand(around(start), start, RADIUS_M)
        assert 20 < len(found) < 150


def test_every_robot_reaches_what_its_own_body_lets_it() -> None:
    mixed = around(LEFT, BEHIND, radii_m=(0.08, 0.25))
    found = set(np.flatnonzero(reachable_cells(frame(mixed), mixed)).tolist())
    small, large = reachable_by_hand(mixed, LEFT, 0.08), reachable_by_hand(mixed, BEHIND, 0.25)
    assert found == small | large
    alike = around(LEFT, BEHIND)
    left, behind = (reachable_by_hand(alike, start, RADIUS_M) for start in (LEFT, BEHIND))
    assert set(np.flatnonzero(reachable_cells(frame(alike), alike)).tolist()) == left | behind
    assert left - behind
    assert behind - left
    through = around(LEFT, radii_m=(0.08,))
    assert found != large
    assert set(np.flatnonzero(reachable_cells(frame(through), through)).tolist()) == small


def test_a_robot_that_stands_where_the_centre_of_its_cell_does_not_fit_reaches_the_next() -> None:
    corner = around((0.155, 0.155))  # the centre of its cell, (0.15, 0.15), is a radius off; those beside are nearer
    tight = around((0.19, 0.155), radius_m=0.155)
    for surroundings in (corner, tight):
        start = surroundings.starts_m[0]
        expected = reachable_by_hand(surroundings, start, surroundings.radius_m)
        assert set(np.flatnonzero(reachable_cells(frame(surroundings), surroundings)).tolist()) == expected
        assert expected


def test_a_robot_does_not_reach_the_other_side_of_a_wall_beside_which_it_starts() -> None:
    small = around((1.1437, 0.6513), radius_m=0.04, walls_m=DIVIDED)
    reachable = np.flatnonzero(reachable_cells(frame(small), small))
    assert {centres()[cell][0] < 1.2 for cell in reachable} == {True}


@pytest.mark.parametrize("start", [(0.3, 0.4), (0.57, 0.4)])  # the second: beside what is unknown
def test_what_is_unknown_or_outside_cannot_be_covered(start: tuple[float, float]) -> None:
    def half(points: Any) -> Any:
        return forbidden(points) | (np.asarray(points)[:, 0] > 0.6)

    surroundings = around(start, walls_m=DIVIDED, forbidden=half)
    found = np.flatnonzero(coverable_cells(frame(surroundings), surroundings))
    assert max(centres()[cell][0] for cell in found) == pytest.approx(0.55)


def test_where_nothing_can_be_covered_there_is_no_share_of_it() -> None:
    verdict = judge(around(LEFT, forbidden=lambda points: np.ones(len(points), np.bool_))).verdict(0)
    assert math.isnan(verdict["coverage"])
    assert verdict["cells_missed"] == 0.0


@pytest.mark.parametrize("range_m", [0.75, 1.3])
def test_what_can_be_covered_is_what_shapely_sees_from_where_the_team_can_get(range_m: float) -> None:
    surroundings = around(LEFT, scan_range_m=range_m)
    found = set(np.flatnonzero(coverable_cells(frame(surroundings), surroundings)).tolist())
    posts = reachable_by_hand(surroundings, LEFT, RADIUS_M)
    assert found == seen_by_hand(surroundings, posts)
    assert len(posts) < len(found) < 26 * 18 - 150
    peeped = [cell for cell in found if centres()[cell][0] > 0.83]
    assert len(peeped) > 5  # through the door that is too narrow


# ---------------------------------------------------------------- what is covered


def passed_by_hand(surroundings: Surroundings, place: tuple[float, float], others: Any = ()) -> set[int]:
    """Return the cells of which a beam from *place* passes more than a hair before it hits a wall or a body."""
    solid = shapely.union_all([walls(surroundings), *(shapely.Point(x, y).buffer(r, 256) for x, y, r in others)])
    squares = [shapely.box(x - 0.05, y - 0.05, x + 0.05, y + 0.05) for x, y in centres()]
    tree, found = shapely.STRtree(squares), set()
    for k in range(surroundings.beams):
        angle, reach = 2.0 * math.pi * k / surroundings.beams, surroundings.scan_range_m
        end = place[0] + reach * math.cos(angle), place[1] + reach * math.sin(angle)
        beam = shapely.LineString([place, end])
        hit = shapely.intersection(beam, solid)
        length = reach if hit.is_empty else shapely.distance(shapely.Point(place), hit)
        beam = substring(beam, 0.0, length)
        for cell in tree.query(beam, predicate="intersects").tolist():
            inside = shapely.intersection(squares[cell], beam).length
            assert not 1e-7 < inside < 5e-6, "too near to a hair to say"
            if inside > 1e-6:
                found.add(cell)
    return found


def judge(surroundings: Surroundings) -> CoverageReferee:
    parameters = Parameters.model_validate({"schemas": {"obstacle_m": 0.3}})
    referee = SPEC.referee(parameters, prepare(parameters, surroundings), surroundings)
    assert isinstance(referee, CoverageReferee)
    return referee


def look(referee: CoverageReferee, *places: tuple[float, float], at: int = 0) -> None:
    x_m, y_m = np.array(places).T
    for tick in range(LOOK_TICKS):
        assert not referee.look(x_m, y_m, at + tick)


def test_coverage_is_the_share_of_what_can_be_covered_that_beams_have_passed() -> None:
    surroundings = around(LEFT)
    wanted = set(np.flatnonzero(coverable_cells(frame(surroundings), surroundings)).tolist())
    referee = judge(surroundings)
    assert referee.verdict(0)["coverage"] == 0.0
    assert math.isnan(referee.verdict(0)["covered_twice"])
    places = [LEFT, (0.213, 1.337), (0.6737, 1.1173)]
    covered: set[int] = set()
    counts = []
    for second, place in enumerate(places):
        look(referee, place, at=second * S)
        covered |= passed_by_hand(surroundings, place) & wanted
        counts.append(len(covered))
        verdict = referee.verdict(second * S)
        assert verdict["coverage"] == len(covered) / len(wanted)
        assert verdict["cells_missed"] == len(wanted) - len(covered)
    assert counts[0] < counts[1] < counts[2]
    times = {share: next((s for s, n in enumerate(counts) if n >= share * len(wanted)), math.nan) for share in SHARES}
    assert {share: verdict[f"time_{round(100 * share)}_s"] for share in SHARES} == pytest.approx(times, nan_ok=True)
    assert len({str(time) for time in times.values()}) > 1


def test_the_truth_is_looked_at_from_the_first_tick_on_every_so_many() -> None:
    surroundings, other = around(LEFT), (0.213, 1.337)
    referee, missed = judge(surroundings), []
    for tick, (x, y) in enumerate([LEFT, *[other] * LOOK_TICKS]):
        referee.look(np.array([x]), np.array([y]), tick)
        missed.append(referee.verdict(tick)["cells_missed"])
    assert 0 < missed[LOOK_TICKS] < missed[0] < np.count_nonzero(coverable_cells(frame(surroundings), surroundings))
    assert missed[:LOOK_TICKS] == [missed[0]] * LOOK_TICKS


def test_covered_twice_are_cells_that_another_robot_covers_too_not_the_same_one_again() -> None:
    places = LEFT, (0.213, 1.337)
    surroundings = around(*places)
    wanted = set(np.flatnonzero(coverable_cells(frame(surroundings), surroundings)).tolist())
    bodies = [[*place, RADIUS_M] for place in places]
    first = passed_by_hand(surroundings, places[0], bodies[1:]) & wanted
    second = passed_by_hand(surroundings, places[1], bodies[:1]) & wanted
    referee = judge(surroundings)
    for at in range(3):
        look(referee, *places, at=at)
    verdict = referee.verdict(3)
    assert verdict["covered_twice"] == len(first & second) / len(first | second)
    assert 0.0 < verdict["covered_twice"] < 1.0
    assert verdict["coverage"] == len(first | second) / len(wanted)


@pytest.mark.parametrize(("away_m", "radius_m"), [(0.4, RADIUS_M), (0.93, 0.37)])  # the second: its rim is in range
def test_a_body_hides_what_is_behind_it(away_m: float, radius_m: float) -> None:
    near = LEFT, (LEFT[0], LEFT[1] + away_m)
    surroundings = around(*near, radii_m=(RADIUS_M, radius_m))
    open_view = passed_by_hand(surroundings, near[0])
    hidden = open_view - passed_by_hand(surroundings, near[0], [[*near[1], radius_m]])
    assert len(hidden) > 5
    referee = judge(surroundings)
    referee.died(Death(1, 0, *near[1], radius_m))  # sees nothing, and stays
    look(referee, *near)
    wanted = set(np.flatnonzero(coverable_cells(frame(surroundings), surroundings)).tolist())
    assert referee.verdict(0)["coverage"] == len((open_view - hidden) & wanted) / len(wanted)


def test_a_body_behind_a_wall_is_not_what_ends_a_beam() -> None:
    places = (0.873, 0.641), (1.5371, 0.6173)
    surroundings = around(*places, walls_m=DIVIDED)
    wanted = set(np.flatnonzero(coverable_cells(frame(surroundings), surroundings)).tolist())
    seen = passed_by_hand(surroundings, places[0], [[*places[1], RADIUS_M]]) & wanted
    assert any(1.2 < centres()[cell][0] < 1.38 for cell in wanted - seen)
    referee = judge(surroundings)
    referee.died(Death(1, 0, *places[1], RADIUS_M))
    look(referee, *places)
    assert referee.verdict(0)["coverage"] == len(seen) / len(wanted)


def test_a_cell_beyond_a_wall_on_its_edge_is_not_covered_by_a_hit_and_not_spoilt_by_many() -> None:
    sides = (0.873, 0.641), (1.5371, 0.6173)
    surroundings = around(*sides, walls_m=DIVIDED)
    wanted = set(np.flatnonzero(coverable_cells(frame(surroundings), surroundings)).tolist())
    referee = judge(surroundings)
    referee.died(Death(1, 0, -9.0, -9.0, RADIUS_M))
    covered: set[int] = set()
    for second, place in enumerate(sides):  # the same robot, so that it has hit what it covers later
        for at in range(150):
            look(referee, place, (-9.0, -9.0), at=second * S + at)
        covered |= passed_by_hand(surroundings, place) & wanted
        assert referee.verdict(0)["coverage"] == len(covered) / len(wanted)


def test_a_cell_is_covered_since_the_first_robot_covered_it() -> None:
    surroundings, away = around(LEFT, (0.213, 1.337)), (-9.0, -9.0)
    referee = judge(surroundings)
    look(referee, LEFT, away, at=1 * S)
    look(referee, away, LEFT, at=2 * S)
    assert referee.verdict(3 * S)["time_50_s"] == 1.0
    assert referee.verdict(3 * S)["covered_twice"] == 1.0


def test_a_share_is_reached_with_the_cell_that_completes_it() -> None:
    since = np.array([1, 2, 2, 5]) * S
    wanted = {0.0: 1.0, 1.0: 1.0, 1.01: 2.0, 3.0: 2.0, 3.01: 5.0, 4.0: 5.0}
    wanted[0.1 * 3 * 10] = 2.0  # three but for rounding
    assert {cells: when_s(since, cells) for cells in wanted} == wanted
    assert math.isnan(when_s(since, 4.01))


def test_all_metrics_of_the_referee_and_of_the_machines_are_declared() -> None:
    surroundings = around(LEFT)
    measured = SPEC.measure([]) | judge(surroundings).verdict(0)
    assert {metric.name for metric in SPEC.metrics} == set(measured)
