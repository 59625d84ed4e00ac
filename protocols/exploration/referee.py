"""The truth of an exploration: which cells the team's scanners have covered, when, and by how many robots.

A cell is covered when a beam from a true place passes it, as the robots' own maps are marked, but without noise. Only
cells that can be covered at all count (:func:`coverable_cells`): those in sight, within the scanners' range, of a place
that some robot can reach.
"""

import math
from collections.abc import Sequence
from functools import cached_property
from typing import Final

import numpy as np

import cosim.elementary as elementary
from cosim.arrays import Bools, Floats, Int64s
from cosim.geometry.grids import TOUCH_M, CoverageGrid, coverage_grid, distances
from cosim.geometry.marking import Weights
from cosim.geometry.planning import Point
from cosim.geometry.segments import SegmentGrid, in_sight, ring_casts, segment_grid, swept_clearance
from cosim.jit import njit
from cosim.navigation.schemas import beam_directions
from cosim.protocol import Death, Referee, Surroundings
from cosim.units import Time, to_seconds
from protocols.exploration.setup import Setup
from protocols.mapping.belief import Belief, Frame

LOOK_TICKS: Final = 2
"""Interval between looks at the truth."""
SHARES: Final = (0.5, 0.95, 0.99)
"""Shares of what can be covered whose times are measured."""
# What a beam passes is empty, also if another has hit it: the far side of a wall may be in the same cell.
_PASSED: Final = Weights(1, 127, 127)
"""Weights of hits and passes."""
_NEAR_CELLS: Final = 1.5
"""Distance of the cell centres by which a robot enters the grid, if it fits all along the way."""
_ROUNDING: Final = 1e-9


class CoverageReferee(Referee):
    """Observes what each robot's beams pass. It ends no run: robots find out for themselves that they have finished."""

    def __init__(self, setup: Setup, surroundings: Surroundings) -> None:
        self._surroundings = surroundings
        self._frame = setup.frame
        self._range_m = setup.range_m
        self._radii_m = np.array(setup.radii_m)
        self._walls = segment_grid(surroundings.walls_m)
        self._beams = beam_directions(setup.beams)
        self._maps = [Belief(setup.frame, _PASSED, setup.range_m) for _ in range(setup.size)]
        cells = setup.frame.nx * setup.frame.ny
        self._covered = np.zeros((setup.size, cells), np.bool_)
        """Cells that each robot has covered."""
        self._since = np.full(cells, -1, np.int64)
        """When the first robot covered a cell; -1 if none has."""
        self._dead: set[int] = set()
        self._looks = 0

    def look(self, x_m: Floats, y_m: Floats, now: Time) -> bool:
        """Mark what is covered from the true places."""
        self._looks += 1
        if (self._looks - 1) % LOOK_TICKS == 0:
            bodies = np.stack((x_m, y_m, self._radii_m), axis=1)
            for robot in range(len(bodies)):
                if robot not in self._dead:
                    self._cover(robot, bodies, now)
        return False

    def _cover(self, robot: int, bodies: Floats, now: Time) -> None:
        place = float(bodies[robot, 0]), float(bodies[robot, 1])
        away = elementary.hypots(bodies[:, 0] - place[0], bodies[:, 1] - place[1]) - bodies[:, 2]
        near = away <= self._range_m
        near[robot] = False
        others = bodies[near]
        ranges_m = ring_casts(self._walls, place, self._beams, self._range_m)
        ranges_m = first_in_way_m(ranges_m, self._beams, place, others)
        known, covered = self._maps[robot], self._covered[robot]
        changed = known.mark(place, ranges_m, self._beams, others)
        covered[changed[~known.occupied(changed)]] = True
        self._since[changed[covered[changed] & (self._since[changed] < 0)]] = now

    def died(self, death: Death) -> None:
        """Note that a robot no longer sees anything; its body stays in the way."""
        self._dead.add(death.robot)

    def coverage(self) -> float:
        """Return the share of what can be covered that has been covered; NaN if nothing can be."""
        whole = np.count_nonzero(self._wanted)
        return float(np.count_nonzero(self._since[self._wanted] >= 0) / whole) if whole else math.nan

    @property
    def coverable(self) -> int:
        """Number of cells that can be covered; only computed on request."""
        return int(np.count_nonzero(self._wanted))

    def times_s(self, shares: Sequence[float]) -> list[float]:
        """Return when each of *shares* of what can be covered had been covered; NaN if it never was."""
        since = self._since[self._wanted]
        ordered = np.sort(since[since >= 0])
        return [when_s(ordered, share * len(since)) for share in shares]

    def verdict(self, now: Time) -> dict[str, float]:
        """Return how much of what can be covered was covered, when, and how much of it by two robots or more."""
        wanted = self._wanted
        covered = int(np.count_nonzero(self._since[wanted] >= 0))
        twice = int(np.count_nonzero(self._covered[:, wanted].sum(axis=0) > 1))
        return {
            **{
                f"time_{round(100 * share)}_s": time_s
                for share, time_s in zip(SHARES, self.times_s(SHARES), strict=True)
            },
            "coverage": self.coverage(),
            "cells_missed": float(np.count_nonzero(wanted) - covered),
            "covered_twice": twice / covered if covered else math.nan,
        }

    @cached_property
    def _wanted(self) -> Bools:
        """Cells that can be covered, flat; only computed on request."""
        return coverable_cells(self._frame, self._surroundings)


def when_s(since: "np.ndarray[tuple[int, ...], np.dtype[np.int64]]", cells: float) -> float:
    """Return when as many as *cells* were covered, given the ordered times of each; NaN if they never were."""
    nth = max(math.ceil(cells - _ROUNDING), 1)
    return to_seconds(int(since[nth - 1])) if nth <= len(since) else math.nan


# ---------------------------------------------------------------- what can be seen of a floor


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
    """Return the cells to whose centres a disc can move straight from a start; it may not fit into the start's cell."""
    iy, ix = divmod(grid.cell_at(*start_m), grid.nx)
    reach = math.ceil(_NEAR_CELLS)
    rows = range(max(iy - reach, 0), min(iy + reach + 1, grid.ny))
    columns = range(max(ix - reach, 0), min(ix + reach + 1, grid.nx))
    near = [cell for row in rows for cell in range(row * grid.nx + columns.start, row * grid.nx + columns.stop)]
    near = [cell for cell in near if grid.free[cell]]
    centres = np.array([grid.centre_m(cell) for cell in near]).reshape(-1, 2)
    room_m = swept_clearance(walls, np.broadcast_to(start_m, centres.shape), centres, radius_m + 2.0 * TOUCH_M)
    fits = (elementary.hypots(*(centres - start_m).T) <= _NEAR_CELLS * grid.cell_m) & (room_m >= radius_m - TOUCH_M)
    return [cell for cell, fit in zip(near, fits.tolist(), strict=True) if fit]


def coverable_cells(frame: Frame, surroundings: Surroundings) -> Bools:
    """Return which cells, shape (ny * nx,), the team can see from cells it can reach: free, in sight and in range.

    Sight is from centre to centre: a wall between them hides a cell, a wall in its centre does not.
    """
    reachable = reachable_cells(frame, surroundings)
    offsets = _offsets(surroundings.scan_range_m / frame.cell_m)
    seen, posts = reachable.copy(), reachable.reshape(frame.ny, frame.nx)
    left = np.flatnonzero(~reachable & _some_near(posts, int(np.abs(offsets).max())).reshape(-1))
    rows, columns = np.divmod(left, frame.nx)
    centres = np.stack((columns + 0.5, rows + 0.5), axis=1) * frame.cell_m + frame.origin_m
    left = left[~surroundings.forbidden(centres)]
    _add_seen(segment_grid(surroundings.walls_m), *frame.origin_m, frame.cell_m, posts, left, offsets, seen)
    return seen


def _some_near(cells: Bools, reach: int) -> Bools:
    """Return where one of *cells* (ny, nx) lies within *reach* cells, in the square about a cell."""
    for axis in (0, 1):
        counts = np.cumsum(cells, axis, np.int32)
        size = cells.shape[axis]
        high = counts.take(np.minimum(np.arange(size) + reach, size - 1), axis)
        low = counts.take(np.maximum(np.arange(size) - reach - 1, 0), axis)
        inside = np.arange(size) > reach  # before them there are cells that do not count
        cells = high > low * (inside[:, None] if axis == 0 else inside)
    return cells


@njit(cache=True)
def _add_seen(
    walls: SegmentGrid, x: float, y: float, size: float, posts: Bools, cells: Int64s, offsets: Int64s, seen: Bools
) -> None:
    """Set *seen* for those of *cells* that have one of *posts*, (ny, nx), in sight at one of the *offsets* (dy, dx)."""
    ny, nx = posts.shape
    for cell in cells:
        iy, ix = cell // nx, cell % nx
        here_x, here_y = (ix + 0.5) * size + x, (iy + 0.5) * size + y
        for k in range(offsets.shape[0]):  # the nearest first: of most cells no farther post is asked
            at_y, at_x = iy + offsets[k, 0], ix + offsets[k, 1]
            if not (0 <= at_y < ny and 0 <= at_x < nx and posts[at_y, at_x]):
                continue
            if in_sight(walls, here_x, here_y, (at_x + 0.5) * size + x, (at_y + 0.5) * size + y):
                seen[cell] = True
                break


def _offsets(reach: float) -> "np.ndarray[tuple[int, ...], np.dtype[np.int64]]":
    """Return (dy, dx) of all cells within *reach* cells of one, the nearest first."""
    most = math.floor(reach + _ROUNDING)
    dy, dx = (each.reshape(-1) for each in np.mgrid[-most : most + 1, -most : most + 1])
    away = elementary.hypots(dy, dx)
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
