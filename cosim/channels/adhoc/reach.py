"""Whom a frame of each sender reaches now, and with how much power.

Where signals do not fade these are all within the sender's range. Where they fade, all at whom its power is above the
faintest that counts; at a distance at which the law alone takes more than that, nobody has to be asked. So robots are
sorted into square cells as wide as a part of the farthest reach, and a sender looks at those of its surroundings only;
but a few are not worth sorting.
"""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

import cosim.elementary as elementary
from cosim.arrays import Bools, Floats, Int64s
from cosim.channels.adhoc.state import REACHED, Records, new_records
from cosim.channels.propagation import Losses, Propagation, gain_db
from cosim.jit import njit
from cosim.machine import Address

FAINT_MW: Final = 1e-14
"""Power (-140 dBm) up to which a signal is neglected, even as interference."""
CELLS: Final = 4
"""Number of cells along the farthest reach."""
FEW: Final = 32
"""Number of radios up to which all are in one cell, and whom one of them reaches is not asked for alone."""
_PAD: Final = 1e-6
"""Share of a cell by which it is taken to be wider: more than rounding."""


class Places(NamedTuple):
    """Where radios are, and which of them are in each cell c = iy * nx + ix: ``member[first[c]:first[c + 1]]``."""

    positions_m: Floats
    """(n, 2)"""
    on: Bools
    """Which are switched on, (n,)."""
    near: Bools
    """All False, (n,): room for a kernel's notes."""
    x_m: float
    y_m: float
    cell_m: float
    nx: int
    ny: int
    first: Int64s
    member: Int64s


def sorted_places(positions_m: Floats, on: Bools, cell_m: float) -> Places:
    """Return *positions_m*, (n, 2), of radios of which some are *on*, (n,), in at most about n cells of *cell_m*."""
    positions = np.ascontiguousarray(positions_m, dtype=np.float64)
    count = len(positions)
    if count <= FEW:
        first, member = np.array((0, count)), np.arange(count)
        return Places(positions, on, np.zeros(count, np.bool_), 0.0, 0.0, 1.0, 1, 1, first, member)
    low = positions.min(axis=0)
    (x_m, y_m), (width, height) = low.tolist(), (positions.max(axis=0) - low).tolist()
    extent_m = max(width, height, 1e-3)
    cell_m = min(max(cell_m, extent_m / math.sqrt(count)), 2.0 * extent_m)
    nx, ny = int(width / cell_m) + 1, int(height / cell_m) + 1
    columns, rows = ((positions - low) / cell_m).astype(np.int64).T
    cells = rows * nx + columns
    first = np.concatenate(((0,), np.cumsum(np.bincount(cells, minlength=nx * ny))))
    member = np.argsort(cells, kind="stable")
    return Places(positions, on, np.zeros(count, np.bool_), x_m, y_m, cell_m, nx, ny, first, member)


class Reach:
    """Whom each of *size* radios reaches, which are all on in the beginning."""

    def __init__(self, size: int, strength: Floats, faintest_mw: float, propagation: Propagation | None) -> None:
        """*strength*, (size,), are powers in mW, or ranges in m if there is no *propagation*."""
        self._faintest_mw = faintest_mw
        self._propagation = propagation
        self._on = np.ones(size, np.bool_)
        self._positions_m: Floats = np.zeros((size, 2))
        self._places: Places | None = None
        """None until they are needed after a move."""
        self._losses = None if propagation is None else propagation.losses
        self._room = new_records(size, REACHED)
        self._hearers: dict[Address, tuple[Address, ...]] = {}
        """Who can receive frames of whom, as far as it was asked since the last change."""
        if propagation is None:
            self._powers_mw, self._limits_m = np.ones(size), strength
        else:
            self._powers_mw = strength
            ratios = (strength / faintest_mw).tolist()
            self._limits_m = np.array([propagation.distance_m(10.0 * elementary.log10(ratio)) for ratio in ratios])
        self._cell_m = float(self._limits_m.max()) / CELLS

    def moved(self, positions_m: Floats) -> None:
        """Take new positions, (size, 2), which stay as they are until the next."""
        self._positions_m = positions_m
        self._places = None
        self._hearers.clear()

    def power(self, address: Address, on: bool) -> None:
        """Note that a radio has been switched on or off."""
        self._on[address] = on
        self._hearers.clear()

    def changed(self) -> None:
        """Note that barriers have changed."""
        assert self._propagation is not None
        self._losses = self._propagation.losses
        self._hearers.clear()

    def write(self, first: Address, last: Address, rows: Records) -> Int64s:
        """Write whom *first* to *last* reach, row after row, each rising, with how many mW; return where rows end."""
        if self._places is None:
            self._places = sorted_places(self._positions_m, self._on, self._cell_m)
        powers_mw, limits_m = self._powers_mw[first : last + 1], self._limits_m[first : last + 1]
        ends = np.empty(len(powers_mw), np.int64)
        _write_rows(self._places, self._losses, first, powers_mw, limits_m, self._faintest_mw, rows, ends)
        return ends

    def hearers(self, source: Address, least_mw: float) -> tuple[Address, ...]:
        """Return at whom the power of *source* is at least *least_mw*."""
        hearers = self._hearers.get(source)
        if hearers is None:
            row = self._room[: self.write(source, source, self._room)[0]]
            hearers = self._hearers[source] = tuple(row["address"][row["mw"] >= least_mw].tolist())
        return hearers

    def from_others(
        self, places_m: Sequence[tuple[float, float]], powers_mw: Sequence[float], limit_m: float
    ) -> list[list[float]]:
        """Return the power in mW at each radio (column), on or off, of others at *places_m* that send *powers_mw*.

        Farther than *limit_m* they are not heard.
        """
        size = len(self._on)
        positions_m = np.vstack((self._positions_m, np.array(places_m)))
        places = sorted_places(positions_m, np.ones(len(positions_m), np.bool_), math.inf)
        rows, received = new_records(len(positions_m), REACHED), np.zeros((len(places_m), len(positions_m)))
        for number, power_mw in enumerate(powers_mw):
            sent_mw, limits_m, ends = np.array((power_mw,)), np.array((limit_m,)), np.empty(1, np.int64)
            _write_rows(places, self._losses, size + number, sent_mw, limits_m, 0.0, rows, ends)
            row = rows[: ends[0]]
            received[number, row["address"]] = row["mw"]
        at_each: list[list[float]] = received[:, :size].tolist()
        return at_each


# ---------------------------------------------------------------- kernels


@njit(cache=True, borrows=True)
def _write_rows(
    places: Places,
    losses: Losses | None,
    first: int,
    powers_mw: Floats,
    limits_m: Floats,
    faintest_mw: float,
    rows: Records,
    ends: Int64s,
) -> None:
    """Write the rows of *first* and those after it, of *powers_mw* and *limits_m*, and where each *ends*, all (n,)."""
    end = 0
    for at in range(len(ends)):
        end += _write_row(places, losses, first + at, powers_mw[at], limits_m[at], faintest_mw, rows[end:])
        ends[at] = end


@njit(cache=True, borrows=True)
def _write_row(
    places: Places,
    losses: Losses | None,
    source: int,
    power_mw: float,
    limit_m: float,
    faintest_mw: float,
    rows: Records,
) -> int:
    """Write to *rows* who is on within *limit_m* of *source* and gets more than *faintest_mw*; return how many.

    Without *losses* (their kernels are not compiled then) all get *power_mw*.
    """
    if not places.on[source]:
        return 0
    _mark_near(places, source, limit_m)
    count, positions, on, near = 0, places.positions_m, places.on, places.near
    ax, ay = positions[source]
    for other in range(len(positions)):  # not cell by cell: rows rise
        if not near[other]:
            continue
        near[other] = False
        bx, by = positions[other, 0], positions[other, 1]
        if other == source or not on[other] or math.sqrt((bx - ax) * (bx - ax) + (by - ay) * (by - ay)) > limit_m:
            continue
        mw = power_mw
        if losses is not None:
            if source < other:
                gain = gain_db(losses, source, other, ax, ay, bx, by)
            else:
                gain = gain_db(losses, other, source, bx, by, ax, ay)
            mw *= elementary.exp10(gain / 10.0)
        if mw > faintest_mw:
            rows[count].address, rows[count].mw = other, mw
            count += 1
    return count


@njit(cache=True, borrows=True)
def _mark_near(places: Places, source: int, limit_m: float) -> None:
    """Note all in cells that are within *limit_m* of *source*."""
    x, y = places.positions_m[source, 0] - places.x_m, places.positions_m[source, 1] - places.y_m
    low_x, high_x = _cells(x, limit_m, places.cell_m, places.nx)
    low_y, high_y = _cells(y, limit_m, places.cell_m, places.ny)
    for iy in range(low_y, high_y + 1):
        for slot in range(places.first[iy * places.nx + low_x], places.first[iy * places.nx + high_x + 1]):
            places.near[places.member[slot]] = True


@njit(cache=True, borrows=True)
def _cells(middle: float, limit: float, cell: float, count: int) -> tuple[int, int]:
    """Return the first and the last of *count* cells in a row that are within *limit* of *middle*."""
    low, high = (middle - limit) / cell - _PAD, (middle + limit) / cell + _PAD
    return int(min(max(low, 0.0), count - 1.0)), int(min(max(high, 0.0), count - 1.0))
