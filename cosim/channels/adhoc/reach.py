"""Whom a frame of each sender reaches now, and with how much power.

Where signals do not fade these are all within the sender's range. Where they fade, all at whom its power is above the
faintest that counts; at a distance at which the law alone takes more than that, nobody has to be asked. So robots are
sorted into square cells as wide as a part of the farthest reach, and a sender looks at those of its surroundings only;
but a few are not worth sorting.
"""

import math
from collections.abc import Iterator, Sequence
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
    """All False, (n,) and up to seven more: room for a kernel's notes."""
    eights: Int64s
    """Eight of them at a time: most are as they were."""
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
    eights = np.zeros(-(-count // 8), np.int64)
    near = eights.view(np.bool_)
    if count <= FEW:
        first, member = np.array((0, count)), np.arange(count)
        return Places(positions, on, near, eights, 0.0, 0.0, 1.0, 1, 1, first, member)
    low = positions.min(axis=0)
    (x_m, y_m), (width, height) = low.tolist(), (positions.max(axis=0) - low).tolist()
    extent_m = max(width, height, 1e-3)
    cell_m = min(max(cell_m, extent_m / math.sqrt(count)), 2.0 * extent_m)
    nx, ny = int(width / cell_m) + 1, int(height / cell_m) + 1
    columns, rows = ((positions - low) / cell_m).astype(np.int64).T
    cells = rows * nx + columns
    first = np.concatenate(((0,), np.cumsum(np.bincount(cells, minlength=nx * ny))))
    member = np.argsort(cells, kind="stable")
    return Places(positions, on, near, eights, x_m, y_m, cell_m, nx, ny, first, member)


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
        self._task = np.zeros(3, np.int64)
        """What is to be written: first, last, begin; and as Python writes it."""
        self._task_written = self._task.data
        self._ends = np.zeros(size, np.int64)
        self._written: Records | None = None
        """Where the last rows were written, as long as the next can be written by the same call of a kernel."""
        self._writing: Iterator[None]
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
        self._hearers.clear()
        if self._places is not None and len(positions_m) <= FEW:
            self._places.positions_m[:] = positions_m
        else:
            self._places = self._written = None

    def power(self, address: Address, on: bool) -> None:
        """Note that a radio has been switched on or off."""
        self._on[address] = on
        self._hearers.clear()

    def changed(self) -> None:
        """Note that barriers have changed."""
        assert self._propagation is not None
        self._losses = self._propagation.losses
        self._written = None
        self._hearers.clear()

    def write(self, first: Address, last: Address, rows: Records, begin: int = 0) -> Int64s:
        """Write whom *first* to *last* reach to *rows* from *begin* on, row after row, each rising, with how many mW.

        Return where the rows of all end; those of others are not to be looked at.
        """
        if self._written is not rows:
            if self._places is None:
                self._places = sorted_places(self._positions_m.copy(), self._on, self._cell_m)
            sent = self._powers_mw, self._limits_m, self._faintest_mw
            self._writing = _writing(self._places, self._losses, *sent, self._task, rows, self._ends)
            self._written = rows
        self._task_written[0], self._task_written[1], self._task_written[2] = first, last, begin
        next(self._writing)
        return self._ends

    def hearers(self, source: Address, least_mw: float) -> tuple[Address, ...]:
        """Return at whom the power of *source* is at least *least_mw*."""
        hearers = self._hearers.get(source)
        if hearers is None:
            row = self._room[: self.write(source, source, self._room)[source]]
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
        sent_mw, limits_m = np.array((*(0.0 for _ in range(size)), *powers_mw)), np.full(len(positions_m), limit_m)
        rows, received = new_records(len(positions_m), REACHED), np.zeros((len(places_m), len(positions_m)))
        for number in range(len(places_m)):
            task, ends = np.array((size + number, size + number, 0)), np.empty(len(positions_m), np.int64)
            next(_writing(places, self._losses, sent_mw, limits_m, 0.0, task, rows, ends))
            row = rows[: ends[size + number]]
            received[number, row["address"]] = row["mw"]
        at_each: list[list[float]] = received[:, :size].tolist()
        return at_each


# ---------------------------------------------------------------- kernels


@njit(cache=True)
def _writing(
    places: Places,
    losses: Losses | None,
    powers_mw: Floats,
    limits_m: Floats,
    faintest_mw: float,
    task: Int64s,
    rows: Records,
    ends: Int64s,
) -> Iterator[None]:
    """Write the rows of which *task* tells, (3,), and where each *ends*, as often as asked for the next result.

    All take over the arrays from Python only once: *powers_mw*, *limits_m* and *ends* of all radios, (n,).
    """
    while True:
        end = task[2]
        for source in range(task[0], task[1] + 1):
            end += _write_row(places, losses, source, powers_mw[source], limits_m[source], faintest_mw, rows[end:])
            ends[source] = end
        yield


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
    count, positions = 0, places.positions_m
    ax, ay = positions[source]
    for eight in range(len(places.eights)):  # not cell by cell: rows rise
        if places.eights[eight] == 0:
            continue
        for other in range(8 * eight, 8 * eight + 8):
            if not places.near[other] or other == source or not places.on[other]:
                continue
            bx, by = positions[other, 0], positions[other, 1]
            if math.sqrt((bx - ax) * (bx - ax) + (by - ay) * (by - ay)) > limit_m:
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
        places.eights[eight] = 0
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
