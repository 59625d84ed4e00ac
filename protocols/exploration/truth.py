"""What a team can see of a floor: cells in sight, within the scanners' range, from where some robot can get."""

import math
from typing import Final

import numpy as np

from cosim.arrays import Bools, Floats
from cosim.geometry.grids import TOUCH_M, CoverageGrid, coverage_grid, distances
from cosim.geometry.planning import Point
from cosim.geometry.segments import SegmentGrid, sees, segment_grid, swept_clearance
from cosim.protocol import Surroundings
from protocols.mapping.belief import Frame

_NEAR_CELLS: Final = 1.5
"""A robot enters the grid by the centres of cells that are no farther than this, if it fits all along the way."""
_ROUNDING: Final = 1e-9


def reachable_cells(frame: Frame, surroundings: Surroundings) -> Bools:
    """Return which cells, shape (ny * nx,), have a centre that some robot can drive to: a flood fill, cell by cell.

    Each robot begins where it starts and fills with its own radius; the others' bodies are not in its way.
    """
    (left, low), size = frame.origin_m, frame.cell_m
    bounds = left, low, left + frame.nx * size, low + frame.ny * size
    walls, starts = segment_grid(surroundings.walls_m), surroundings.starts_m
    radii = surroundings.radii_m or (surroundings.radius_m,) * len(starts)
    reachable = np.zeros(frame.nx * frame.ny, np.bool_)
    for radius in sorted(set(radii)):
        own = [start for start, other in zip(starts, radii, strict=True) if other == radius]
        grid = coverage_grid(bounds, size, radius, surroundings.walls_m, surroundings.forbidden, own)
        entries = [cell for start in own for cell in _entries(grid, walls, start, radius)]
        reachable |= distances(grid.steps, entries) >= 0
    return reachable


def _entries(grid: CoverageGrid, walls: SegmentGrid, start_m: Point, radius_m: float) -> list[int]:
    """Return the cells to whose centres a disc can be moved straight from a start: it may not fit into its own cell."""
    centres = grid.centres_m()
    near = np.flatnonzero(grid.free & (np.hypot(*(centres - start_m).T) <= _NEAR_CELLS * grid.cell_m))
    room_m = swept_clearance(walls, np.broadcast_to(start_m, (len(near), 2)), centres[near], radius_m + 2.0 * TOUCH_M)
    cells: list[int] = near[room_m >= radius_m - TOUCH_M].tolist()
    return cells


def coverable_cells(frame: Frame, surroundings: Surroundings) -> Bools:
    """Return which cells, shape (ny * nx,), the team can see from cells it can reach: free ones in sight and in range.

    From centre to centre; a wall between them hides a cell, one in its centre does not.
    """
    reachable = reachable_cells(frame, surroundings)
    rows, columns = np.divmod(np.arange(frame.nx * frame.ny), frame.nx)
    centres = np.stack((columns + 0.5, rows + 0.5), axis=1) * frame.cell_m + frame.origin_m
    walls, seen = segment_grid(surroundings.walls_m), reachable.copy()
    left = np.flatnonzero(~seen)
    left = left[~surroundings.forbidden(centres[left])]
    offsets = _offsets(surroundings.scan_range_m / frame.cell_m)
    reach = int(np.abs(offsets).max())
    posts = np.pad(reachable.reshape(frame.ny, frame.nx), reach)
    for dy, dx in offsets.tolist():  # the nearest first: of most cells no farther post is asked
        near = np.flatnonzero(posts[rows[left] + dy + reach, columns[left] + dx + reach])
        cells = left[near]
        in_sight = sees(walls, centres[cells], centres[cells + dy * frame.nx + dx])
        seen[cells[in_sight]] = True
        left = np.delete(left, near[in_sight])
    return seen


def _offsets(reach: float) -> "np.ndarray[tuple[int, ...], np.dtype[np.int64]]":
    """Return (dy, dx) of all cells within *reach* cells of one, the nearest first."""
    most = math.floor(reach + _ROUNDING)
    dy, dx = (each.reshape(-1) for each in np.mgrid[-most : most + 1, -most : most + 1])
    away = np.hypot(dy, dx)
    order = np.argsort(away, kind="stable")
    return np.stack((dy, dx), axis=1)[order][np.sort(away) <= reach + _ROUNDING]


def first_in_way_m(ranges_m: Floats, beams: Floats, place_m: Point, bodies: Floats) -> Floats:
    """Return *ranges_m* (n,) along *beams* (n, 2) from a place, lowered to where they meet *bodies* (k, 3) before."""
    for x, y, radius in bodies.tolist():
        dx, dy = x - place_m[0], y - place_m[1]
        along, aside = dx * beams[:, 0] + dy * beams[:, 1], dx * beams[:, 1] - dy * beams[:, 0]
        half = np.sqrt(np.maximum(radius * radius - aside * aside, 0.0))
        meets = (np.abs(aside) < radius) & (along > 0.0)
        ranges_m = np.where(meets, np.minimum(ranges_m, np.maximum(along - half, 0.0)), ranges_m)
    return ranges_m
