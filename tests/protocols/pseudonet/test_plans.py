"""Coverage plans: every cell once, drives that exist, equal shares, and walks as short as theory says."""

from collections.abc import Iterable
from functools import partial
from inspect import cleandoc
from itertools import pairwise

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment

from cosim.errors import LocalProtocolError
from cosim.geometry.grids import EAST, NORTH, CoverageGrid, distances
from protocols.pseudonet.plans.boustrophedon import boustrophedon, sweep_cells
from protocols.pseudonet.plans.spanning_tree import closed_walks, spanning_tree
from protocols.pseudonet.plans.tours import Tour, assign, drive_costs, least_sum, nearest, split

PLANS = [boustrophedon, spanning_tree]


def grid_of(
    free: np.ndarray, walls: Iterable[tuple[int, int]] = (), reachable: np.ndarray | None = None
) -> CoverageGrid:
    """Make a grid of *free*, shape (ny, nx), in which steps between the pairs of cells *walls* are missing."""
    ny, nx_ = free.shape
    flat = free.ravel()
    steps = np.full((flat.size, 4), -1, np.int32)
    closed = {frozenset(pair) for pair in walls}
    for cell in range(flat.size):
        for direction, other, inside in (
            (EAST, cell + 1, cell % nx_ + 1 < nx_),
            (NORTH, cell + nx_, cell + nx_ < flat.size),
        ):
            if inside and flat[cell] and flat[other] and frozenset((cell, other)) not in closed:
                steps[cell, direction] = other
                steps[other, direction + 2] = cell
    return CoverageGrid((0.0, 0.0), 0.5, nx_, ny, steps, flat, flat if reachable is None else reachable)


def drawn(text: str) -> CoverageGrid:
    """Make a grid of a picture, north up, of '.' free and '#' blocked cells, with | and - for walls between them."""
    rows = cleandoc(text).splitlines()[::-1]
    free = np.array([[mark == "." for mark in row[::2]] for row in rows[::2]])
    width = free.shape[1]
    sideways = [
        (y * width + x, y * width + x + 1)
        for y, row in enumerate(rows[::2])
        for x, m in enumerate(row[1::2])
        if m == "|"
    ]
    upward = [
        (y * width + x, (y + 1) * width + x)
        for y, row in enumerate(rows[1::2])
        for x, m in enumerate(row[::2])
        if m == "-"
    ]
    return grid_of(free, sideways + upward)


@st.composite
def grids(draw: st.DrawFn) -> CoverageGrid:
    """Grids of up to 9 x 9 with blocked cells and with walls between free ones; often in several pieces."""
    width, height = draw(st.integers(1, 9)), draw(st.integers(1, 9))
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    free = rng.random((height, width)) >= draw(st.sampled_from([0.0, 0.15, 0.4]))
    pairs = [(c, c + d) for c in range(width * height) for d in (1, width)]
    share = draw(st.sampled_from([0.0, 0.15, 0.4]))
    return grid_of(free, [pair for pair in pairs if rng.random() < share])


def graph_of(grid: CoverageGrid) -> "nx.Graph[int]":
    graph: nx.Graph[int] = nx.Graph()
    graph.add_nodes_from(np.flatnonzero(grid.reachable).tolist())
    graph.add_edges_from((a, b) for a in graph for b in grid.steps[a].tolist() if b >= 0)
    return graph


def cost(grid: CoverageGrid, tour: Tour) -> int:
    graph = graph_of(grid)
    return sum(nx.shortest_path_length(graph, a, b) for a, b in pairwise(tour))


# ---------------------------------------------------------------- both plans


@pytest.mark.slow
@pytest.mark.parametrize("plan", PLANS)
@given(grid=grids(), team=st.integers(1, 8), data=st.data())
@settings(max_examples=150)
def test_every_cell_is_in_exactly_one_tour(plan, grid, team, data):
    reachable = np.flatnonzero(grid.reachable)
    left = reachable[: data.draw(st.integers(0, len(reachable)))] if data.draw(st.booleans()) else reachable[::3]
    tours = plan(grid, left, team)
    assert len(tours) == team
    assert sorted(cell for tour in tours for cell in tour) == left.tolist()
    assert sum(1 for tour in tours if tour) == min(team, len(left))


@pytest.mark.parametrize("plan", PLANS)
@given(grid=grids(), team=st.integers(1, 8))
@settings(max_examples=60)
def test_no_tour_costs_more_than_its_share(plan, grid, team):
    island = max(nx.connected_components(graph_of(grid)), key=len, default=set())
    whole = plan(grid, sorted(island), 1)[0]
    assert max(cost(grid, tour) for tour in plan(grid, sorted(island), team)) <= cost(grid, whole) // team


@pytest.mark.parametrize("plan", PLANS)
@given(grid=grids())
@settings(max_examples=60)
def test_no_tour_leads_where_there_is_no_way_if_there_are_robots_for_all_pieces(plan, grid):
    pieces = list(nx.connected_components(graph_of(grid)))
    for tour in plan(grid, np.flatnonzero(grid.reachable), max(1, len(pieces))):
        assert sum(1 for piece in pieces if piece.intersection(tour)) <= 1


@pytest.mark.parametrize("plan", PLANS)
def test_a_plan_depends_on_which_cells_are_left_not_on_their_order(plan):
    grid = drawn("""
        . . .|. .
            -
        . # . . .

        . . . # .
    """)
    cells = np.flatnonzero(grid.free)
    assert plan(grid, cells, 3) == plan(grid, cells[::-1], 3)
    assert plan(grid, np.concatenate((cells, cells)), 3) == plan(grid, cells, 3)


@pytest.mark.parametrize("plan", PLANS)
@pytest.mark.parametrize("team", range(1, 9))
def test_a_team_with_nothing_left_gets_empty_tours(plan, team):
    assert plan(grid_of(np.ones((2, 3), bool)), [], team) == ((),) * team


@pytest.mark.parametrize("plan", PLANS)
def test_robots_without_a_cell_get_empty_tours(plan):
    tours = plan(grid_of(np.ones((2, 3), bool)), [1, 4], 4)
    assert sorted(tours) == [(), (), (1,), (4,)]


# ---------------------------------------------------------------- boustrophedon


@pytest.mark.parametrize(("width", "height"), [(1, 1), (1, 7), (6, 1), (5, 4), (4, 5), (9, 9)])
def test_an_empty_rectangle_is_mown_without_a_detour(width, height):
    grid = grid_of(np.ones((height, width), bool))
    (tour,) = boustrophedon(grid, np.arange(width * height), 1)
    assert cost(grid, tour) == width * height - 1


def test_an_obstacle_makes_four_sweep_cells_around_it():
    # Choset's first example: before, below, above and behind the obstacle
    grid = drawn("""
        . . . . .

        . . # . .

        . . . . .
    """)
    sweeps, graph = sweep_cells(grid, np.flatnonzero(grid.free))
    assert sweeps == [[[0, 5, 10], [1, 6, 11]], [[2]], [[12]], [[3, 8, 13], [4, 9, 14]]]
    assert sorted(graph.edges) == [(0, 1), (0, 2), (1, 3), (2, 3)]


def test_a_wall_between_free_cells_divides_a_slice():
    grid = drawn("""
        . . .
        - -
        . . .
    """)
    sweeps, graph = sweep_cells(grid, np.arange(6))
    assert sweeps == [[[0], [1]], [[3], [4]], [[2, 5]]]
    assert sorted(graph.edges) == [(0, 2), (1, 2)]


def test_a_wall_between_slices_ends_a_sweep_cell():
    grid = drawn("""
        . .|.
           |
        . .|.
    """)
    sweeps, graph = sweep_cells(grid, np.arange(6))
    assert sweeps == [[[0, 3], [1, 4]], [[2, 5]]]
    assert not graph.edges


def test_a_sweep_cell_is_entered_at_its_nearest_corner():
    grid = drawn("""
        . . . .

        . # # .

        . . . .
    """)
    # up the first column, along the top, down the last column, and back along the bottom
    assert boustrophedon(grid, np.flatnonzero(grid.free), 1) == ((0, 4, 8, 9, 10, 11, 7, 3, 2, 1),)


# ---------------------------------------------------------------- spanning tree


@pytest.mark.slow
@given(grid=grids())
@settings(max_examples=200)
def test_a_walk_is_closed_steps_over_all_cells_of_its_piece(grid):
    walks = closed_walks(grid)
    assert {frozenset(walk) for walk in walks} == {frozenset(c) for c in nx.connected_components(graph_of(grid))}
    for walk in walks:
        assert all(b in grid.steps[a] for a, b in pairwise((*walk, walk[0]))) or len(walk) == 1
        assert len(walk) <= max(1, 2 * (len(set(walk)) - 1))


@given(seed=st.integers(0, 2**32), width=st.integers(1, 5), height=st.integers(1, 5))
@settings(max_examples=100)
def test_whole_mega_cells_are_walked_around_without_a_second_visit(seed, width, height):
    blocks = np.random.default_rng(seed).random((height, width)) < 0.75
    for walk in closed_walks(grid_of(np.kron(blocks, np.ones((2, 2), bool)))):
        assert len(walk) == len(set(walk)) >= 4


def test_a_dead_end_of_one_cell_costs_two_steps():
    grid = drawn("""
        . . #

        . . .
    """)
    (walk,) = closed_walks(grid)
    assert len(walk) == 4 + 2
    assert walk.count(2) == 1


def test_two_halves_of_walled_mega_cells_are_walked_around_together():
    # no mega-cell is whole, yet there is a cycle over the four middle cells
    grid = drawn("""
        .|. .|.

        .|. .|.
    """)
    assert sorted(len(walk) for walk in closed_walks(grid)) == [2, 2, 4]


def test_an_odd_grid_has_no_mega_cell_over_its_edge():
    (walk,) = closed_walks(grid_of(np.ones((4, 3), bool)))
    # four cells of the third column, each half of a mega-cell, joined side by side: nothing is visited twice
    assert len(walk) == 12


def test_what_is_left_keeps_the_order_of_the_first_plan():
    grid = grid_of(np.ones((6, 6), bool))
    (whole,) = spanning_tree(grid, np.arange(36), 1)
    left = set(whole[5:9]) | set(whole[20:30])
    assert spanning_tree(grid, sorted(left), 1) == (tuple(cell for cell in whole if cell in left),)


def test_a_cell_out_of_reach_is_our_own_mistake():
    free = np.array([[True, True, True]])
    grid = grid_of(free, [(1, 2)], reachable=np.array([True, True, False]))
    with pytest.raises(LocalProtocolError, match=r"cells \[2\]"):
        spanning_tree(grid, [0, 2], 1)


# ---------------------------------------------------------------- tours


def least_maximum(costs: list[int], count: int) -> int:
    """Return the smallest maximum over all ways to cut, by trying them (dynamic programming over prefixes)."""
    size = len(costs) + 1
    best = [sum(costs[:end]) for end in range(size)]
    for _ in range(count - 1):
        best = [
            min([best[end]] + [max(best[cut - 1], sum(costs[cut:end])) for cut in range(1, end + 1)])
            for end in range(size)
        ]
    return best[-1]


@given(costs=st.lists(st.integers(0, 9) | st.just(60), max_size=14), team=st.integers(1, 8))
def test_the_greatest_part_is_as_small_as_can_be(costs, team):
    parts = split(range(len(costs) + 1), np.array(costs, np.int64), team)
    assert [cell for part in parts for cell in part] == list(range(len(costs) + 1))
    assert sum(1 for part in parts if part) == min(team, len(costs) + 1)
    assert max(sum(costs[part[0] : part[-1]]) for part in parts if part) == least_maximum(costs, team)


@pytest.mark.parametrize(("size", "team"), [(13, 4), (100, 7), (5, 4), (8, 8), (64, 3)])
def test_parts_of_unit_steps_differ_by_at_most_one(size, team):
    lengths = [len(part) for part in split(range(size), np.ones(size - 1, np.int64), team)]
    assert max(lengths) - min(lengths) <= 1


def test_a_long_drive_is_where_a_tour_is_cut():
    parts = split("abcdefgh", np.array([1, 90, 1, 1, 1, 1, 1]), 3)  # type: ignore[arg-type]
    assert parts == (("a", "b"), ("c", "d", "e"), ("f", "g", "h"))


def test_a_tour_cannot_be_split_among_nobody():
    with pytest.raises(LocalProtocolError, match="0 robots"):
        split([1], np.empty(0, np.int64), 0)


@given(grid=grids(), data=st.data())
@settings(max_examples=40)
def test_drives_are_shortest_paths_and_the_impossible_ones_the_dearest(grid, data):
    cells = np.flatnonzero(grid.reachable).tolist()
    if not cells:
        return
    order = data.draw(st.lists(st.sampled_from(cells), unique=True, min_size=1, max_size=8))
    graph = graph_of(grid)
    known = [nx.shortest_path_length(graph, a, b) if nx.has_path(graph, a, b) else None for a, b in pairwise(order)]
    dear = 1 + sum(steps for steps in known if steps is not None)
    assert drive_costs(grid, order).tolist() == [dear if steps is None else steps for steps in known]


def test_the_nearest_target_is_nearest_by_driving_not_by_distance():
    grid = drawn("""
        . . .
        -
        . . .
    """)
    assert nearest(grid, 0, [3, 2]) == 2
    assert nearest(drawn(". . .|."), 0, [3]) is None


def test_parts_go_to_the_robots_that_drive_least_in_sum():
    grid = grid_of(np.ones((1, 10), bool))
    way = partial(distances, grid.steps)
    # greedily robot 0 would take the part at 5 (1 step) and leave robot 1 the one at 0 (7 steps)
    assert assign([(0, 1), (5, 4), ()], [4, 7, 9], way) == ((0, 1), (5, 4), ())
    assert assign([(9,)], [0, 8], way) == ((), (9,))
    assert assign([(), ()], [0, 8], way) == ((), ())


@given(
    st.integers(1, 5).flatmap(
        lambda n: st.lists(st.lists(st.integers(0, 4), min_size=n, max_size=n), min_size=1, max_size=n)
    )
)
def test_an_assignment_is_the_one_of_scipy_also_among_equal_ones(costs: list[list[int]]):
    assert least_sum(costs) == linear_sum_assignment(costs)[1].tolist()


def test_a_part_behind_a_wall_goes_to_the_robot_behind_it():
    grid = drawn(". . . . .|.")
    parts = [(5,), (0,)]
    assert assign(parts, [4, 5], partial(distances, grid.steps)) == ((0,), (5,))


def test_a_robot_has_one_part_at_most():
    grid = grid_of(np.ones((1, 3), bool))
    with pytest.raises(LocalProtocolError, match="2 parts for 1 robots"):
        assign([(0,), (1,)], [0], partial(distances, grid.steps))
