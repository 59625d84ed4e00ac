"""What range scans reveal of a grid: the evidence of its cells, their states, and where the unexplored begins.

``evidence``, int8 of shape (ny, nx), row 0 at the bottom, is 0 where nothing is known, below 0 where a cell seems
empty, above where it seems occupied. A hit adds to it, a beam that passes takes away, and it stays within a cap. A cell
that is known stays known: where evidence would come to 0, it takes the sign of the last reading. A hit of the cap's
weight or more is certain (the map of Lau, section 4.3: no false returns): it sets evidence to the cap, and what is at
the cap is not lowered.

``frontier``, uint8 of shape (ny, nx padded to a multiple of 8), is 1 where an unexplored cell is adjacent to a known
empty one (Lau, section 3.3; Yamauchi's frontiers are in ``frontiers``). That adjacent includes diagonally is our
reading. The padding is 0, so that a sum over frontiers may read eight cells at once.

A beam is a segment, and it passes the cells in which more than a hair of it lies: where it only touches the corner of
a cell, it does not pass it. A hair is 1e-5 of a cell. Walls may lie on the edges of cells: the cells are passed up to a
hair before a hit, and the hit counts for the cell a hair beyond. A hit within two hairs of a corner of cells counts for
none of them: a beam that grazes the corner of a wall would make the free cell behind it occupied for ever. A beam that
hits nothing passes the cell in which its range ends, too.
"""

import math
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np

import cosim.elementary as elementary
from cosim.arrays import Bools, Bytes, Floats, Int32s, Singles
from cosim.jit import njit

Evidence: TypeAlias = np.ndarray[Any, np.dtype[np.int8]]
Way: TypeAlias = tuple[int, int, int, int, int, int, int, int, int]

UNKNOWN: Final = 0
EMPTY: Final = 1
OCCUPIED: Final = 2

_HAIR: Final = 1e-5
"""Share of a cell, far more than rounding loses, also that of the steps of 2^-32 cells along a beam."""
_MARGIN: Final = 3.0 * _HAIR
"""Least distance of a beam's end from the grid's edge, so that no cell beyond it is read."""
_BITS: Final = 32
_ONE: Final = 4294967296.0
"""One cell in fixed point: 2 ** _BITS."""
_LISTED: Final = 2
"""During a call frontier bytes of this and more, _LISTED << state, mark listed cells and the state they had before."""


class Weights(NamedTuple):
    """What a hit adds to a cell's evidence, what a passing beam takes away, and how much of it counts at most."""

    hit: int
    miss: int
    cap: int


CERTAIN: Final = Weights(127, 127, 127)
"""No false returns, as in the paper: what was hit once is occupied for ever, else what was passed once is empty."""
DOUBTFUL: Final = Weights(3, 1, 40)
"""For noisy ranges and false returns: a false hit is gone after a scan or two, a wall that has gone after about 40."""


def states(evidence: Evidence) -> Bytes:
    """Return UNKNOWN, EMPTY or OCCUPIED for each cell, uint8, of the shape of *evidence*."""
    return (evidence < 0).astype(np.uint8) * np.uint8(EMPTY) + (evidence > 0).astype(np.uint8) * np.uint8(OCCUPIED)


def frontier_grid(evidence: Evidence, diagonal: bool) -> Bytes:
    """Return the frontier of *evidence* (ny, nx) from scratch, shape (ny, nx padded to a multiple of 8)."""
    ny, nx = evidence.shape
    empty = np.pad(evidence < 0, 1)
    beside = empty[:-2, 1:-1] | empty[2:, 1:-1] | empty[1:-1, :-2] | empty[1:-1, 2:]
    if diagonal:
        beside |= empty[:-2, :-2] | empty[:-2, 2:] | empty[2:, :-2] | empty[2:, 2:]
    frontier = np.zeros((ny, (nx + 7) // 8 * 8), np.uint8)
    frontier[:, :nx] = beside & (evidence == 0)
    return frontier


def most_changes(range_m: float, cell_m: float) -> int:
    """Return how many cells a scan of so much range can change: the size of scratch that ``mark_scan`` needs."""
    return (2 * math.ceil(range_m / cell_m) + 3) ** 2


@njit(cache=True)
def mark_scan(
    evidence: Evidence,
    frontier: Bytes,
    origin_x: float,
    origin_y: float,
    cell_m: float,
    x: float,
    y: float,
    ranges_m: Floats,
    directions: Floats,
    range_m: float,
    hit: int,
    miss: int,
    cap: int,
    bodies: Floats,
    changed: Int32s,
    diagonal: bool,
) -> int:
    """Mark a scan from (x, y) into *evidence* and *frontier*; return how many cells changed their state.

    Their numbers, ``iy * nx + ix``, are in ``changed[:n]``, scratch that holds ``most_changes`` or all cells. The
    grid's lower left corner is at the origin (metres). Beam k looks along the unit vector ``directions[k]``, shape (n,
    2), in the grid's frame; it has hit something if ``ranges_m[k]`` is less than *range_m*; a reading of NaN or below 0
    counts for nothing. *hit*, *miss* >= 1 and *cap* <= 127 are ``Weights``. *bodies*, shape (k, 3), are places and
    radii (metres) of known bodies: a hit as near to one as its radius and half a cell counts for nothing, and only the
    cells before it are passed. A beam ends where the grid does. From a place off the grid nothing is marked.

    Raise ValueError if the arrays do not fit together.
    """
    ny, nx = evidence.shape
    u, v, reach = (x - origin_x) / cell_m, (y - origin_y) / cell_m, range_m / cell_m
    if frontier.shape[0] != ny or frontier.shape[1] < nx or directions.shape[0] < ranges_m.shape[0]:
        raise ValueError("the shapes of evidence and frontier, or of ranges and directions, do not agree")
    if changed.shape[0] < min(ny * nx, (2 * math.ceil(reach) + 3) ** 2):
        raise ValueError("changed does not hold all cells that may change: see most_changes")
    if not (0.0 <= u < nx and 0.0 <= v < ny):
        return 0
    u, v = min(max(u, _MARGIN), nx - _MARGIN), min(max(v, _MARGIN), ny - _MARGIN)
    weights = hit, miss, cap, cap if hit >= cap else 128
    cells = evidence.reshape(ny * nx)
    near = bodies if _any_near(bodies, x, y, range_m + cell_m) else bodies[:0]
    in_cells = u, v, reach, cell_m
    count = _mark_beams(cells, frontier, nx, ny, in_cells, ranges_m, directions, range_m, weights, near, x, y, changed)
    return _settle(evidence, frontier, changed, count, diagonal)


@njit(cache=True)
def merge_cells(
    evidence: Evidence,
    frontier: Bytes,
    cells: Int32s,
    told: Bytes,
    newer: Bools,
    weight: int,
    changed: Int32s,
    diagonal: bool,
) -> int:
    """Take over the states *told* (n,) of *cells* (n,) from another's map; return how many cells changed their state.

    Their numbers are in ``changed[:count]``, which holds n. An unknown cell takes the state received, with evidence of
    the *weight* (the cap where hits are certain). A cell known otherwise keeps its state, unless ``newer[k]`` is true,
    because the other has seen it later. Cells that are unknown to the other are left alone.

    Raise ValueError if the arrays do not fit together, LookupError if a cell is off the grid; nothing is changed then.
    """
    ny, nx = evidence.shape
    n = cells.shape[0]
    if frontier.shape[0] != ny or frontier.shape[1] < nx:
        raise ValueError("the shapes of evidence and frontier do not agree")
    if told.shape[0] != n or newer.shape[0] != n or changed.shape[0] < n:
        raise ValueError("told and newer have not the length of cells, or changed is shorter")
    for cell in cells:
        if not 0 <= cell < ny * nx:
            raise LookupError("a cell is off the grid")
    mine = evidence.reshape(ny * nx)
    count = 0
    for k in range(n):
        cell = int(cells[k])
        before = _state(int(mine[cell]))
        if told[k] != UNKNOWN and told[k] != before and (before == UNKNOWN or newer[k]):
            count = _list(frontier, changed, count, nx, cell, before)
            mine[cell] = weight if told[k] == OCCUPIED else -weight
    return _settle(evidence, frontier, changed, count, diagonal)


@njit(cache=True)
def add_hits(
    sums: Singles,
    origin_x: float,
    origin_y: float,
    cell_m: float,
    x: float,
    y: float,
    ranges_m: Floats,
    directions: Floats,
    range_m: float,
) -> None:
    """Add the hits of a scan from (x, y) to *sums* (ny, nx, 3), from which the mean of each cell's hits follows.

    They are of each cell: how far its hits are from its centre in x and in y, and how many they are; all in cells. What
    hits which cell is as in :func:`mark_scan` without bodies, and so are the arguments. That a cell keeps the sum and
    the number of its hits is GMapping's (Grisetti, Stachniss and Burgard, IEEE T-RO 23(1), 2007; its PointAccumulator).
    """
    ny, nx = sums.shape[0], sums.shape[1]
    u, v = (x - origin_x) / cell_m, (y - origin_y) / cell_m
    if not (0.0 <= u < nx and 0.0 <= v < ny):
        return
    u, v = min(max(u, _MARGIN), nx - _MARGIN), min(max(v, _MARGIN), ny - _MARGIN)
    for k in range(ranges_m.shape[0]):
        if not 0.0 <= ranges_m[k] < range_m:
            continue
        length = ranges_m[k] / cell_m
        _, end, strikes = _hit(u, v, directions[k, 0], directions[k, 1], length, nx, ny)
        if strikes:
            iy = end // nx
            ix = end - iy * nx
            sums[iy, ix, 0] += u + length * directions[k, 0] - (ix + 0.5)
            sums[iy, ix, 1] += v + length * directions[k, 1] - (iy + 0.5)
            sums[iy, ix, 2] += 1.0


# ---------------------------------------------------------------- beams


@njit(cache=True)
def _mark_beams(
    cells: Evidence,
    frontier: Bytes,
    nx: int,
    ny: int,
    in_cells: tuple[float, float, float, float],
    ranges_m: Floats,
    directions: Floats,
    range_m: float,
    weights: tuple[int, int, int, int],
    bodies: Floats,
    x: float,
    y: float,
    changed: Int32s,
) -> int:
    """Mark all beams; return how many cells are listed, which may have changed their state.

    *in_cells* are place and range in cells, and a cell's size. In one column a beam passes at most two cells, that by
    which it comes and that by which it goes. Mostly both are as empty as can be, and nothing is to be done. Else, if
    both are empty, they are lowered without asking whether they are the same, since no processor can guess that. A call
    to which arrays are passed costs as much as ten columns (numba counts references), so there is none without news.
    """
    u, v, reach, cell_m = in_cells
    hit, miss, cap, _ = weights
    count, floor = 0, -cap
    for k in range(ranges_m.shape[0]):
        if not ranges_m[k] >= 0.0:
            continue
        along_u, along_v = directions[k, 0], directions[k, 1]
        length, end, strikes = reach, -1, False
        if ranges_m[k] < range_m:
            length, end, strikes = _hit(u, v, along_u, along_v, ranges_m[k] / cell_m, nx, ny)
            if strikes and bodies.shape[0] > 0:
                strikes = not _on_body(bodies, x + ranges_m[k] * along_u, y + ranges_m[k] * along_v, 0.5 * cell_m)
        length = _within(_within(length, u, along_u, nx), v, along_v, ny)
        columns, base, step, stride, coming, last, before, after, rise = _way(u, v, along_u, along_v, length, nx)
        for left in range(columns, -1, -1):
            one, other = base + coming * stride, base + (before >> _BITS) * stride
            if left == 0:
                one, other = _but(one, base + last * stride, end)
                if one < 0:
                    break
            # an unsigned index is not asked whether it counts from the end
            found, beside = int(cells[np.uint64(one)]), int(cells[np.uint64(other)])
            if found != floor or beside != floor:
                if found & beside < 0:
                    cells[np.uint64(one)] = max(found - miss, floor)
                    cells[np.uint64(other)] = max(int(cells[np.uint64(other)]) - miss * (other != one), floor)
                else:
                    count = _pass(cells, frontier, changed, count, nx, one, other, weights)
            coming = after >> _BITS
            before, after, base = before + rise, after + rise, base + step
        if strikes:
            if cells[end] > 0:
                cells[end] = min(int(cells[end]) + hit, cap)
            else:
                count = _strike(cells, frontier, changed, count, nx, end, weights)
    return count


@njit(cache=True)
def _hit(
    u: float, v: float, along_u: float, along_v: float, length: float, nx: int, ny: int
) -> tuple[float, int, bool]:
    """Return how far a beam that has hit something passes (cells), in which cell it ends, and if that was hit."""
    beyond = length + _HAIR
    end_u, end_v = u + beyond * along_u, v + beyond * along_v
    end = -1
    if 0.0 <= end_u < nx and 0.0 <= end_v < ny:
        end = int(end_v) * nx + int(end_u)
    strikes = end >= 0 and not _at_corner(u + length * along_u, v + length * along_v)
    return max(length - _HAIR, 0.0), end, strikes


@njit(cache=True)
def _way(u: float, v: float, along_u: float, along_v: float, length: float, nx: int) -> Way:
    """Return a beam of some *length* (cells) from (u, v) as a way from column to column, in whole numbers.

    Columns are columns of cells where the beam is flatter than 45 degrees, else rows. The way is: how many columns the
    beam leaves; number of cell 0 in the first column, and how much it grows by from column to column and from cell to
    cell; the cell where it begins and that where it ends; then, in fixed point, the height a hair before the first
    column's end, a hair after it, and how much both rise from column to column.
    """
    if abs(along_u) >= abs(along_v):
        p, q, along_p, along_q, step, stride = u, v, along_u, along_v, 1, nx
    else:
        p, q, along_p, along_q, step, stride = v, u, along_v, along_u, nx, 1
    column = int(p)
    columns = abs(int(p + length * along_p) - column)
    slope = along_q / abs(along_p)
    to_edge = column + 1 - p if along_p > 0.0 else p - column
    hair = 0.0  # a beam along the columns leaves none through a corner
    if abs(slope) > 2.0 * _HAIR:
        hair = math.copysign(_HAIR, slope)
    height = q + to_edge * slope
    before, after, rise = int((height - hair) * _ONE), int((height + hair) * _ONE), int(slope * _ONE)
    base = column * step
    if along_p < 0.0:
        step = -step
    return columns, base, step, stride, int(q), int(q + length * along_q), before, after, rise


@njit(cache=True)
def _but(one: int, other: int, end: int) -> tuple[int, int]:
    """Return two cells without *end*: one of them twice if it is among them, -1 twice if it is both."""
    if one == end:
        one = other
    if other == end:
        other = one
    return (-1, -1) if one == end else (one, other)


@njit(cache=True)
def _pass(
    cells: Evidence,
    frontier: Bytes,
    changed: Int32s,
    count: int,
    nx: int,
    one: int,
    other: int,
    weights: tuple[int, int, int, int],
) -> int:
    """Lower the evidence of two cells, or of one that is given twice; return how many cells are listed."""
    _, miss, cap, kept = weights
    for k in range(1 if one == other else 2):
        cell = other if k else one
        found = int(cells[cell])
        if found == kept:
            continue
        left = max(found - miss, -cap)
        if left == 0:
            left = -1
        cells[cell] = left
        if found >= 0 and left < 0:
            count = _list(frontier, changed, count, nx, cell, _state(found))
    return count


@njit(cache=True)
def _strike(
    cells: Evidence,
    frontier: Bytes,
    changed: Int32s,
    count: int,
    nx: int,
    cell: int,
    weights: tuple[int, int, int, int],
) -> int:
    """Raise the evidence of a cell that did not seem occupied and was hit; return how many cells are listed."""
    hit, _, cap, _ = weights
    found = int(cells[cell])
    grown = cap if hit >= cap else min(found + hit, cap)
    if grown == 0:
        grown = 1
    if grown > 0:
        count = _list(frontier, changed, count, nx, cell, _state(found))
    cells[cell] = grown
    return count


@njit(cache=True)
def _within(length: float, start: float, along: float, n: int) -> float:
    """Return *length*, or less of it where a beam would otherwise leave the n cells of its axis."""
    stop = start + length * along
    if stop > n - _MARGIN:
        return max((n - _MARGIN - start) / along, 0.0)
    if stop < _MARGIN:
        return max((_MARGIN - start) / along, 0.0)
    return length


@njit(cache=True)
def _at_corner(u: float, v: float) -> bool:
    near_u, near_v = abs(u - math.floor(u + 0.5)), abs(v - math.floor(v + 0.5))
    return near_u < 2.0 * _HAIR and near_v < 2.0 * _HAIR


@njit(cache=True)
def _any_near(bodies: Floats, x: float, y: float, reach_m: float) -> bool:
    near = False
    for k in range(bodies.shape[0]):
        near |= elementary.hypot(bodies[k, 0] - x, bodies[k, 1] - y) <= reach_m + bodies[k, 2]
    return near


@njit(cache=True)
def _on_body(bodies: Floats, x: float, y: float, slack_m: float) -> bool:
    for k in range(bodies.shape[0]):
        dx, dy, reach = bodies[k, 0] - x, bodies[k, 1] - y, bodies[k, 2] + slack_m
        if dx * dx + dy * dy <= reach * reach:
            return True
    return False


# ---------------------------------------------------------------- changes of state


@njit(cache=True)
def _state(evidence: int) -> int:
    if evidence == 0:
        return UNKNOWN
    return EMPTY if evidence < 0 else OCCUPIED


@njit(cache=True)
def _list(frontier: Bytes, changed: Int32s, count: int, nx: int, cell: int, before: int) -> int:
    """Note that *cell* leaves the state *before*, if it is not noted yet; return how many are."""
    iy = cell // nx
    ix = cell - iy * nx
    if frontier[iy, ix] < _LISTED:
        frontier[iy, ix] |= np.uint8(_LISTED << before)
        changed[count] = cell
        count += 1
    return count


@njit(cache=True)
def _settle(evidence: Evidence, frontier: Bytes, changed: Int32s, count: int, diagonal: bool) -> int:
    """Strike those off the list that are what they were before, and renew the frontier about the others."""
    nx = evidence.shape[1]
    kept = 0
    for k in range(count):
        iy = changed[k] // nx
        ix = changed[k] - iy * nx
        flags = int(frontier[iy, ix])
        frontier[iy, ix] = flags % _LISTED
        if flags - flags % _LISTED != _LISTED << _state(int(evidence[iy, ix])):
            changed[kept] = changed[k]
            kept += 1
    for k in range(kept):
        iy = changed[k] // nx
        ix = changed[k] - iy * nx
        frontier[iy, ix] = 0  # it is known now
        _renew_about(evidence, frontier, iy, ix, diagonal)
    return kept


@njit(cache=True)
def _renew_about(evidence: Evidence, frontier: Bytes, iy: int, ix: int, diagonal: bool) -> None:
    """Renew the frontier flags of the neighbours of a cell that is known."""
    ny, nx = evidence.shape
    empty = evidence[iy, ix] < 0
    for jy in range(max(iy - 1, 0), min(iy + 2, ny)):
        for jx in range(max(ix - 1, 0), min(ix + 2, nx)):
            if evidence[jy, jx] != 0 or not (diagonal or jy == iy or jx == ix):
                continue
            if empty:
                frontier[jy, jx] = 1
            elif frontier[jy, jx] != 0:
                frontier[jy, jx] = _is_frontier(evidence, jy, jx, diagonal)


@njit(cache=True)
def _is_frontier(evidence: Evidence, iy: int, ix: int, diagonal: bool) -> int:
    """Return 1 if an unknown cell is adjacent to an empty one, else 0."""
    ny, nx = evidence.shape
    for jy in range(max(iy - 1, 0), min(iy + 2, ny)):
        for jx in range(max(ix - 1, 0), min(ix + 2, nx)):
            if evidence[jy, jx] < 0 and (diagonal or jy == iy or jx == ix):
                return 1
    return 0
