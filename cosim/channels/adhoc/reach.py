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
from cosim.channels.propagation import Losses, Propagation, hindered_gain_db, hinders, law_gain_db
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
    x_m: float
    y_m: float
    cell_m: float
    nx: int
    ny: int
    first: Int64s
    member: Int64s
    member_m: Floats
    """Positions of the members in their order, (n, 2): those of a few are *positions_m* itself."""
    squares: Floats
    """Room for a kernel's notes of members, (n,): squares of their distances,"""
    values: Floats
    """and their gains in dB, or powers in mW."""
    reached: Bools
    """All False, (n,) and up to seven more: room for notes of radios in their order,"""
    eights: Int64s
    """eight of them at a time, as most are False,"""
    mw: Floats
    """and their powers, (n,)."""


def sorted_places(positions_m: Floats, on: Bools, cell_m: float) -> Places:
    """Return *positions_m*, (n, 2), of radios of which some are *on*, (n,), in at most about n cells of *cell_m*."""
    positions = np.ascontiguousarray(positions_m, dtype=np.float64)
    count = len(positions)
    eights = np.zeros(-(-count // 8), np.int64)
    room = np.empty(count), np.empty(count), eights.view(np.bool_), eights, np.empty(count)
    if count <= FEW:
        first, member = np.array((0, count)), np.arange(count)
        return Places(positions, on, 0.0, 0.0, 1.0, 1, 1, first, member, positions, *room)
    low = positions.min(axis=0)
    (x_m, y_m), (width, height) = low.tolist(), (positions.max(axis=0) - low).tolist()
    extent_m = max(width, height, 1e-3)
    cell_m = min(max(cell_m, extent_m / math.sqrt(count)), 2.0 * extent_m)
    nx, ny = int(width / cell_m) + 1, int(height / cell_m) + 1
    columns, rows = ((positions - low) / cell_m).astype(np.int64).T
    cells = rows * nx + columns
    first = np.concatenate(((0,), np.cumsum(np.bincount(cells, minlength=nx * ny))))
    member = np.argsort(cells, kind="stable")
    return Places(positions, on, x_m, y_m, cell_m, nx, ny, first, member, positions[member], *room)


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


@njit(cache=True, borrows=True)
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

    All take over the arrays from Python only once: *powers_mw*, *limits_m* and *ends* of all radios, (n,). ``Reach``
    holds them: a generator of numba's that is not asked to its end never gives back what it has counted as held.
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
    x, y = places.positions_m[source]
    low_x, high_x = _cells(x - places.x_m, limit_m, places.cell_m, places.nx)
    low_y, high_y = _cells(y - places.y_m, limit_m, places.cell_m, places.ny)
    for iy in range(low_y, high_y + 1):
        begin, end = places.first[iy * places.nx + low_x], places.first[iy * places.nx + high_x + 1]
        _write_squares(places.member_m[begin:end], x, y, places.squares[begin:end])
        if losses is None:
            places.values[begin:end] = power_mw
        else:
            _write_powers(places, losses, source, power_mw, limit_m, begin, end)
        _mark(places, source, limit_m, faintest_mw, begin, end)
    return _write_marked(places, rows)


@njit(cache=True, borrows=True)
def _write_squares(positions_m: Floats, x: float, y: float, squares: Floats) -> None:
    """Write the squares of the distances between *positions_m*, (n, 2), and (*x*, *y*)."""
    for at in range(len(squares)):
        along, across = positions_m[at, 0] - x, positions_m[at, 1] - y
        squares[at] = along * along + across * across


@njit(cache=True, borrows=True)
def _write_powers(
    places: Places, losses: Losses, source: int, power_mw: float, limit_m: float, begin: int, end: int
) -> None:
    """Write the powers of *source* at the members from *begin* to *end*, those within *limit_m* of it.

    One step for all members after the other: so the compiler makes vectors of the first and the last.
    """
    squares, values = places.squares[begin:end], places.values[begin:end]
    for at in range(len(values)):
        values[at] = law_gain_db(losses, squares[at])
    if hinders(losses):
        ax, ay = places.positions_m[source]
        for slot in range(begin, end):
            other = places.member[slot]
            if other == source or math.sqrt(places.squares[slot]) > limit_m:
                continue
            bx, by = places.member_m[slot]
            if source < other:
                places.values[slot] = hindered_gain_db(losses, places.values[slot], source, other, ax, ay, bx, by)
            else:
                places.values[slot] = hindered_gain_db(losses, places.values[slot], other, source, bx, by, ax, ay)
    for at in range(len(values)):
        values[at] = power_mw * elementary.exp10(values[at] / 10.0)


@njit(cache=True, borrows=True)
def _mark(places: Places, source: int, limit_m: float, faintest_mw: float, begin: int, end: int) -> None:
    """Note which of the members from *begin* to *end* are reached, and with how much power."""
    for slot in range(begin, end):
        other, mw = places.member[slot], places.values[slot]
        if mw > faintest_mw and math.sqrt(places.squares[slot]) <= limit_m and other != source and places.on[other]:
            places.reached[other], places.mw[other] = True, mw


@njit(cache=True, borrows=True)
def _write_marked(places: Places, rows: Records) -> int:
    """Write who has been noted to *rows*, rising, and forget the notes; return how many."""
    count = 0
    for eight in range(len(places.eights)):
        if places.eights[eight] == 0:
            continue
        for other in range(8 * eight, 8 * eight + 8):
            if places.reached[other]:
                rows[count].address, rows[count].mw = other, places.mw[other]
                count += 1
        places.eights[eight] = 0
    return count


@njit(cache=True, borrows=True)
def _cells(middle: float, limit: float, cell: float, count: int) -> tuple[int, int]:
    """Return the first and the last of *count* cells in a row that are within *limit* of *middle*."""
    low, high = (middle - limit) / cell - _PAD, (middle + limit) / cell + _PAD
    return int(min(max(low, 0.0), count - 1.0)), int(min(max(high, 0.0), count - 1.0))
