"""Scans marked into grids, against beams clipped at every cell, and lists and frontiers against whole grids."""

import math

import numpy as np
import pytest

from cosim.geometry.marking import (
    CERTAIN,
    DOUBTFUL,
    EMPTY,
    OCCUPIED,
    UNKNOWN,
    Weights,
    frontier_grid,
    mark_scan,
    merge_cells,
    most_changes,
    states,
)

CELL = 0.1
ORIGIN = (-1.3, 2.1)
NOBODY = np.empty((0, 3))
RARELY = 1e-4
"""Cells in which less of a beam lies, in cells, may count as passed or not."""

PARTS = ((0.5, 0.5), (0.2, 0.2), (0.8, 0.2), (0.2, 0.8), (0.8, 0.8))
"""Points of a cell: who sees them all sees the cell."""


def beams(angles):
    return np.ascontiguousarray(np.stack((np.cos(angles), np.sin(angles)), axis=1))


def ring(count, turn=0.0):
    return beams(turn + 2 * np.pi * np.arange(count) / count)


def blank(ny, nx):
    return np.zeros((ny, nx), np.int8), np.zeros((ny, -(-nx // 8) * 8), np.uint8)


def marked(evidence, frontier, place, ranges, directions, range_m, weights=CERTAIN, bodies=NOBODY, diagonal=True):
    """Mark a scan seen from *place*, in cells; return the numbers of the cells that changed."""
    x, y = ORIGIN[0] + CELL * place[0], ORIGIN[1] + CELL * place[1]
    changed = np.full(most_changes(range_m, CELL), -1, np.int32)
    count = mark_scan(
        *(evidence, frontier, *ORIGIN, CELL, x, y, np.asarray(ranges, float), directions, range_m),
        *(*weights, np.asarray(bodies, float), changed, diagonal),
    )
    return changed[:count].tolist()


def clipped(place, along, ny, nx):
    """Return where a beam without end enters each cell and where it leaves it, in cells; entry > exit: it does not."""
    with np.errstate(divide="ignore"):
        x = (np.arange(nx + 1) - place[0]) / along[0]
        y = (np.arange(ny + 1) - place[1]) / along[1]
    near = np.maximum(np.minimum(x[:-1], x[1:])[None, :], np.minimum(y[:-1], y[1:])[:, None])
    far = np.minimum(np.maximum(x[:-1], x[1:])[None, :], np.maximum(y[:-1], y[1:])[:, None])
    return np.maximum(near, 0.0), far


def cast(solid, place, along):
    """Return how far the first of the *solid* cells is along a beam, in cells, and which it is: closed squares."""
    near, far = clipped(place, along, *solid.shape)
    near = np.where(solid & (near <= far), near, np.inf)
    return near.min(), int(near.argmin())


def random_world(seed, ny=31, nx=27):
    """Return solid cells, a place in a free one, and the generator."""
    draw = np.random.default_rng(seed)
    solid = draw.random((ny, nx)) < 0.06
    while True:
        place = draw.uniform(1, (nx - 1, ny - 1))
        if not solid[int(place[1]), int(place[0])]:
            return solid, place, draw


def slow_frontier(evidence, diagonal):
    ny, nx = evidence.shape
    frontier = np.zeros((ny, -(-nx // 8) * 8), np.uint8)
    for iy in range(ny):
        for ix in range(nx):
            for jy in range(max(iy - 1, 0), min(iy + 2, ny)):
                for jx in range(max(ix - 1, 0), min(ix + 2, nx)):
                    beside = diagonal or abs(jy - iy) + abs(jx - ix) == 1
                    if evidence[iy, ix] == 0 and evidence[jy, jx] < 0 and beside:
                        frontier[iy, ix] = 1
    return frontier


# ---------------------------------------------------------------- which cells a beam passes


@pytest.mark.parametrize("seed", range(6))
def test_each_beam_lowers_each_cell_that_it_passes_once_and_no_other(seed):
    draw = np.random.default_rng(seed)
    ny, nx, cap = 31, 27, 9
    guarded = np.zeros((ny + 2, nx), np.int8)
    evidence, frontier = guarded[1:-1], blank(ny, nx)[1]
    place = draw.uniform(0, (nx, ny))
    range_m = draw.uniform(0.3, 5.0)  # from well inside the grid to beyond it on all sides
    directions = beams(draw.uniform(0, 2 * np.pi, 60))
    ranges = draw.choice([np.inf, range_m, 9.0], 60)
    marked(evidence, frontier, place, ranges, directions, range_m, Weights(3, 1, cap))
    passing, doubtful = np.zeros((ny, nx), int), np.zeros((ny, nx), bool)
    for along in directions:
        near, far = clipped(place, along, ny, nx)
        inside = np.minimum(far, range_m / CELL) - near
        passing += inside > 0
        doubtful |= (inside > 0) & (inside < RARELY)
    assert doubtful.mean() < 0.02
    assert ((evidence == np.maximum(-passing, -cap)) | doubtful).all()
    assert not guarded[0].any()
    assert not guarded[-1].any()


@pytest.mark.parametrize("seed", range(6))
def test_a_scan_of_walls_on_the_edges_of_cells_is_what_its_beams_saw(seed):
    solid, place, draw = random_world(seed)
    directions = ring(90, draw.uniform(0, 2 * np.pi))
    expected, doubtful = np.zeros(solid.shape, int), np.zeros(solid.shape, bool)
    ranges = []
    for along in directions:
        distance, cell = cast(solid, place, along)
        ranges.append(CELL * distance)
        near, far = clipped(place, along, *solid.shape)
        inside = np.minimum(far, min(distance, 15)) - near
        expected[(inside > 0) & (expected == UNKNOWN)] = EMPTY
        doubtful |= (inside > 0) & (inside < RARELY)
        if distance < 15:
            expected.flat[cell] = OCCUPIED
    evidence, frontier = blank(*solid.shape)
    marked(evidence, frontier, place, ranges, directions, 1.5)
    assert (expected == OCCUPIED).sum() > 5
    assert ((states(evidence) == expected) | doubtful).all()


def test_a_dense_scan_marks_every_cell_that_is_wholly_seen():
    solid, place, _ = random_world(3, 54, 54)
    place, solid[25:30, 25:30] = np.array([27.3, 27.6]), False
    directions = ring(360, 0.001)
    ranges = [CELL * cast(solid, place, along)[0] for along in directions]
    evidence, frontier = blank(54, 54)
    marked(evidence, frontier, place, ranges, directions, 2.5)
    seen = 0
    for cell in np.flatnonzero(~solid):
        points = np.array([(cell % 54 + a, cell // 54 + b) for a, b in PARTS]) - place
        lengths = np.hypot(*points.T)
        if lengths.max() <= 25 and all(
            cast(solid, place, point / length)[0] > length for point, length in zip(points, lengths, strict=True)
        ):
            seen += 1
            assert evidence.flat[cell] < 0
    assert seen > 200


@pytest.mark.parametrize("place", [(8.5, 6.5), (8.0, 6.0), (5.5, 6.5), (7.3, 4.9)])
def test_nothing_outside_a_closed_room_is_ever_marked(place):
    solid = np.ones((14, 16), bool)
    solid[2:12, 2:14] = False
    solid[8, 10] = solid[9, 11] = True  # a pillar of two cells that meet at a corner
    evidence, frontier = blank(14, 16)
    directions = ring(16)  # also along the diagonals, through corners of cells
    directions[np.abs(directions) < 1e-12] = 1e-13
    ranges = [CELL * cast(solid, place, along)[0] for along in directions]
    for _ in range(2):
        marked(evidence, frontier, place, ranges, directions, 2.5)
        assert not (states(evidence)[solid] == EMPTY).any()
        assert not (states(evidence)[~solid] == OCCUPIED).any()
    assert not states(evidence)[[0, -1]].any()
    assert not states(evidence)[:, [0, -1]].any()
    assert (evidence < 0).sum() > 20


def test_a_beam_through_corners_passes_the_cells_on_its_way_only():
    evidence, frontier = blank(9, 9)
    marked(evidence, frontier, (2.5, 2.5), [np.inf], beams(np.array([np.pi / 4])), 0.5)
    assert sorted(np.flatnonzero(evidence)) == [20, 30, 40, 50, 60]
    evidence[:] = 0
    marked(evidence, frontier, (6.5, 2.5), [np.inf], beams(np.array([3 * np.pi / 4])), 0.5)
    assert sorted(np.flatnonzero(evidence)) == [24, 32, 40, 48, 56]


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_beam_along_an_edge_of_cells_passes_those_of_one_side(axis, sign):
    evidence, frontier = blank(9, 9)
    place, along = np.full(2, 4.0), np.zeros((1, 2))  # on the edges in both axes
    place[axis], along[0, axis] = 4.5, sign
    marked(evidence, frontier, place, [np.inf], along, 0.3)
    passed = np.argwhere(evidence)[:, ::-1]
    assert sorted(passed[:, axis]) == ([4, 5, 6, 7] if sign > 0 else [1, 2, 3, 4])
    assert len(set(passed[:, 1 - axis])) == 1


@pytest.mark.parametrize(("v", "slope"), [(0.0, 3e-5), (9.0 - 1e-9, -3e-5)])
def test_a_beam_that_hardly_rises_from_the_edge_of_the_grid_passes_no_cell_beyond(v, slope):
    guarded = np.zeros((11, 9), np.int8)
    marked(guarded[1:-1], blank(9, 9)[1], (0.9, v), [np.inf], np.array([[1.0, slope]]), 0.5)
    row = 1 if slope > 0 else 9
    assert np.argwhere(guarded).tolist() == [[row, ix] for ix in range(6)]


def test_a_hit_at_a_corner_of_cells_counts_for_none_of_them():
    evidence, frontier = blank(9, 9)
    along = beams(np.array([np.pi / 4]))
    marked(evidence, frontier, (2.5, 2.5), [2.5 * math.sqrt(2) * CELL], along, 2.5)
    assert sorted(np.flatnonzero(evidence < 0)) == [20, 30, 40]
    assert not (evidence > 0).any()
    marked(evidence, frontier, (2.5, 2.5), [2.6 * math.sqrt(2) * CELL], along, 2.5)
    assert np.flatnonzero(evidence > 0).tolist() == [50]


def test_a_hit_just_beside_a_corner_lowers_no_cell_behind_the_wall():
    evidence, frontier = blank(9, 9)
    along = beams(np.array([math.atan(0.5)]))
    place = np.array([5.0, 5.0 - 6e-6]) - 4 * along[0]
    marked(evidence, frontier, place, [4 * CELL], along, 2.5)
    assert evidence[:, :5].any()
    assert not evidence[:, 5:].any()


# ---------------------------------------------------------------- evidence


def along_a_row(evidence, frontier, cells_far, weights):
    """Mark one beam from the middle of cell 0 that hits the edge of a cell so far, or nothing within 10 cells."""
    reading = CELL * (cells_far - 0.5) if cells_far else np.inf
    return marked(evidence, frontier, (0.5, 0.5), [reading], np.array([[1.0, 0.0]]), 1.0, weights)


def test_doubtful_evidence_grows_and_shrinks_within_its_cap_and_is_never_unknown_again():
    evidence, frontier = blank(1, 12)
    history = []
    for far in (5, 5, 0, 0, 0, 0, 0, 0, 0, 5, 5):
        changes = along_a_row(evidence, frontier, far, Weights(3, 1, 5))
        history.append((int(evidence[0, 5]), 5 in changes))
    assert history == [
        *((3, True), (5, False), (4, False), (3, False), (2, False), (1, False)),
        *((-1, True), (-2, False), (-3, False), (1, True), (4, False)),
    ]
    assert evidence[0].tolist() == [-5] * 5 + [4] + [-5] * 5 + [0]


def test_a_certain_hit_stays_and_outdoes_what_was_empty():
    evidence, frontier = blank(1, 12)
    along_a_row(evidence, frontier, 0, CERTAIN)
    assert evidence[0].tolist() == [-127] * 11 + [0]
    assert along_a_row(evidence, frontier, 5, CERTAIN) == [5]
    assert along_a_row(evidence, frontier, 0, CERTAIN) == []
    assert evidence[0, 5] == 127


@pytest.mark.parametrize("reading", [np.nan, -0.1, -np.inf])
def test_a_reading_that_is_none_says_nothing(reading):
    evidence, frontier = blank(1, 12)
    assert marked(evidence, frontier, (0.5, 0.5), [reading], np.array([[1.0, 0.0]]), 1.0) == []
    assert not evidence.any()


def test_a_hit_of_a_known_body_is_no_hit_but_what_lies_before_it_is_empty():
    bodies = [(-9.0, 0.0, 0.5), (ORIGIN[0] + 0.9, ORIGIN[1] + 0.05, 0.3)]
    for distance, occupied in ((0.5499, True), (0.5501, False), (0.6, False), (1.2499, False), (1.2501, True)):
        evidence, frontier = blank(1, 20)
        reading = [distance - 0.05]  # the body's rim is at 0.6 and 1.2, half a cell before and beyond it are no hits
        marked(evidence, frontier, (0.5, 0.5), reading, np.array([[1.0, 0.0]]), 2.5, CERTAIN, bodies)
        at = int(distance / CELL + 1e-4)
        assert states(evidence)[0].tolist() == [EMPTY] * at + [OCCUPIED if occupied else UNKNOWN] + [UNKNOWN] * (
            19 - at
        )


def test_a_hit_of_a_body_counts_by_its_rim_though_its_centre_is_out_of_range():
    evidence, frontier = blank(1, 20)
    bodies = [(ORIGIN[0] + 0.05 + 3.0, ORIGIN[1] + 0.05, 2.0)]
    marked(evidence, frontier, (0.5, 0.5), [1.0], np.array([[1.0, 0.0]]), 1.5, CERTAIN, bodies)
    assert states(evidence)[0].tolist() == [EMPTY] * 10 + [UNKNOWN] * 10


@pytest.mark.parametrize("place", [(-0.01, 3), (3, 9.01), (9.0, 3), (math.nan, 3)])
def test_from_a_place_off_the_grid_nothing_is_marked(place):
    evidence, frontier = blank(9, 9)
    assert marked(evidence, frontier, place, [np.inf] * 8, ring(8), 0.5) == []
    assert not evidence.any()


def test_arrays_that_do_not_fit_are_refused():
    evidence, frontier = blank(30, 30)
    with pytest.raises(ValueError, match="shapes"):
        marked(evidence, frontier[:-1].copy(), (5, 5), [1.0], ring(1), 0.5)
    with pytest.raises(ValueError, match="shapes"):
        marked(evidence, frontier[:, :24].copy(), (5, 5), [1.0], ring(1), 0.5)
    with pytest.raises(ValueError, match="shapes"):
        marked(evidence, frontier, (5, 5), [1.0, 1.0], ring(1), 0.5)
    scan = (*ORIGIN, CELL, 0.0, 3.0, np.ones(1), ring(1), 0.5, *CERTAIN, NOBODY)
    with pytest.raises(ValueError, match="most_changes"):
        mark_scan(evidence, frontier, *scan, np.empty(most_changes(0.5, CELL) - 1, np.int32), True)
    assert not evidence.any()


# ---------------------------------------------------------------- states, frontiers and deltas


@pytest.mark.parametrize("diagonal", [True, False])
@pytest.mark.parametrize("weights", [CERTAIN, DOUBTFUL, Weights(2, 3, 4)])
def test_changes_are_listed_once_and_the_frontier_is_that_of_the_whole_grid(diagonal, weights):
    draw = np.random.default_rng(7)
    evidence, frontier = blank(19, 21)
    total = 0
    for step in range(40):
        before = states(evidence)
        if step % 4 == 3:
            cells = draw.integers(0, evidence.size, 30).astype(np.int32)
            told = draw.integers(0, 3, 30).astype(np.uint8)
            scratch = np.empty(30, np.int32)
            newer = draw.random(30) < 0.5
            count = merge_cells(evidence, frontier, cells, told, newer, weights.cap, scratch, diagonal)
            changes = scratch[:count].tolist()
        else:  # readings that contradict each other, so that cells change to and fro in one scan
            ranges = draw.choice([0.2, 0.5, 0.7, np.inf], 40)
            changes = marked(
                *(evidence, frontier, draw.uniform(0, (21, 19)), ranges, beams(draw.uniform(0, 7, 40)), 0.8),
                *(weights, NOBODY, diagonal),
            )
        assert sorted(changes) == np.flatnonzero(before != states(evidence)).tolist()
        assert (frontier == slow_frontier(evidence, diagonal)).all()
        total += len(changes)
    assert total > 300
    assert (frontier_grid(evidence, diagonal) == frontier).all()


def test_states_follow_the_sign_of_the_evidence():
    assert states(np.array([[-128, -1, 0], [1, 2, 127]], np.int8)).tolist() == [[1, 1, 0], [2, 2, 2]]


def merged(evidence, frontier, cells, told, newer):
    scratch = np.empty(len(cells), np.int32)
    arrays = np.array(cells, np.int32), np.array(told, np.uint8), np.array(newer, np.bool_)
    return scratch[: merge_cells(evidence, frontier, *arrays, 127, scratch, True)].tolist()


def test_the_unknown_becomes_what_is_told_and_the_known_only_if_it_is_news():
    evidence, frontier = blank(1, 8)
    evidence[0, 3:7] = -7, 9, 9, 5
    told = [EMPTY, OCCUPIED, UNKNOWN, OCCUPIED, EMPTY, OCCUPIED, UNKNOWN]
    assert merged(evidence, frontier, range(7), told, [False] * 7) == [0, 1]
    assert evidence[0].tolist() == [-127, 127, 0, -7, 9, 9, 5, 0]
    assert merged(evidence, frontier, range(7), told, [True] * 7) == [3, 4]
    assert evidence[0].tolist() == [-127, 127, 0, 127, -127, 9, 5, 0]
    assert merged(evidence, frontier, [7, 7], [EMPTY, OCCUPIED], [False] * 2) == [7]
    assert evidence[0, 7] == -127


@pytest.mark.parametrize("cell", [-1, 8])
def test_a_delta_off_the_grid_changes_nothing(cell):
    evidence, frontier = blank(1, 8)
    with pytest.raises(LookupError, match="off the grid"):
        merged(evidence, frontier, [2, cell], [EMPTY, EMPTY], [False, False])
    assert not evidence.any()


def test_a_delta_whose_columns_differ_in_length_is_refused():
    evidence, frontier = blank(1, 8)
    for told, newer in (([EMPTY], [True, True]), ([EMPTY, EMPTY], [True])):
        with pytest.raises(ValueError, match="length"):
            merged(evidence, frontier, [2, 3], told, newer)
