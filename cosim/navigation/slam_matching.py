"""Scan matching: where a scan fits best on the map that a particle has made itself, and how well.

A scan's ends are compared with a field about the particle. A cell at the distance d (centre to centre) of the nearest
occupied cell of the map has

    log p = -d^2 / 2 sigma^2,  but no less than log(stray);

between centres of cells it is interpolated, so that poses are told apart within a cell. Ends that lie in the unknown,
far from all that is known, are left out: what a scan finds anew must not pull it back to what is known. Which they are
is settled once for each scan, where odometry puts the particle; each counts log(news) for the particle's weight.

The beams of a scan err together, as the map does: each counts only as *power* of an independent one. What is climbed is

    power sum(log p) - (dx^2 + dy^2) / 2 slack_m^2 - dheading^2 / 2 slack_rad^2,

with the offsets from where odometry puts the particle. Source of the climbing, six neighbours and steps that are halved
when none is better: GMapping (Grisetti, Stachniss and Burgard, IEEE T-RO 23(1), 2007, and their scanmatcher.cpp), where
the tie to odometry is off and each cell keeps the mean of its hits.
"""

import math
from typing import Any, Final, TypeAlias

import numpy as np

from cosim.arrays import Bytes, Floats, Int32s, Singles
from cosim.geometry.marking import mark_scan
from cosim.jit import njit
from cosim.navigation.localization_motion import wrapped

Evidence: TypeAlias = np.ndarray[Any, np.dtype[np.int8]]
Corner: TypeAlias = tuple[int, int]
Match: TypeAlias = tuple[float, float, float, float]
"""x_m, y_m, heading_rad and what was climbed."""

NUMBERS: Final = 7
POWER, SLACK_M, SLACK_RAD, STEP_M, STEP_RAD, STRAY, NEWS = range(NUMBERS)
"""Numbers of a search: power, the two slacks, the first steps (m, rad), and log(stray) and log(news)."""

_MOST_MOVES: Final = 60
"""A climb ends after so many steps upwards, however far it still could go."""
_NOTHING: Final = np.float32(1.0)
"""In a field: unknown, and nothing known is near. A logarithm of p is never above 0."""


def stamp_of(sigma_m: float, stray: float, cell_m: float) -> Singles:
    """Return log p about an occupied cell, square, of an odd size: as far as it is more than log(*stray*)."""
    reach = max(int(sigma_m * math.sqrt(-2.0 * math.log(stray)) / cell_m), 1)
    off = np.arange(-reach, reach + 1) * cell_m
    squares = off[:, np.newaxis] ** 2 + off**2
    return np.asarray(np.maximum(-squares / (2.0 * sigma_m**2), math.log(stray)), np.float32)


def field_size(range_m: float, slack_m: float, cell_m: float) -> int:
    """Return how many cells a field has on a side: as far as ends can come while a particle is pulled 3 slacks."""
    return 2 * (math.ceil((range_m + 3.0 * slack_m) / cell_m) + 2) + 1


@njit(cache=True)
def make_field(evidence: Evidence, u: float, v: float, stamp: Singles, stray: float, field: Singles) -> Corner:
    """Set *field* (n, n) to log p about the place (u, v), in cells; return which cell (ix, iy) of the map its first is.

    A cell off the map is unknown. *stray* is a logarithm.
    """
    ny, nx = evidence.shape
    n, reach = field.shape[0], stamp.shape[0] // 2
    left, low = math.floor(u) - n // 2, math.floor(v) - n // 2
    for j in range(n):
        for i in range(n):
            ix, iy = left + i, low + j
            known = 0 <= ix < nx and 0 <= iy < ny and evidence[iy, ix] != 0
            field[j, i] = stray if known else _NOTHING
    for iy in range(max(low - reach, 0), min(low + n + reach, ny)):
        for ix in range(max(left - reach, 0), min(left + n + reach, nx)):
            if evidence[iy, ix] <= 0:
                continue
            for j in range(max(iy - reach - low, 0), min(iy + reach + 1 - low, n)):
                for i in range(max(ix - reach - left, 0), min(ix + reach + 1 - left, n)):
                    here = stamp[low + j - iy + reach, left + i - ix + reach]
                    if field[j, i] > 0.0 or field[j, i] < here:
                        field[j, i] = here
    return left, low


@njit(cache=True)
def choose_ends(field: Singles, u: float, v: float, heading: float, ends: Floats, chosen: Floats) -> int:
    """Copy those of *ends* (m, 2) that lie near what is known to *chosen* (m, 2); return how many they are.

    Ends are in the body's frame, in cells; (u, v) is the body's place in *field*, in cells.
    """
    n = field.shape[0]
    cos, sin = math.cos(heading), math.sin(heading)
    count = 0
    for k in range(ends.shape[0]):
        across = min(max(u + cos * ends[k, 0] - sin * ends[k, 1], 0.0), n - 1.0)
        up = min(max(v + sin * ends[k, 0] + cos * ends[k, 1], 0.0), n - 1.0)
        if field[int(up), int(across)] <= 0.0:
            chosen[count, 0], chosen[count, 1] = ends[k, 0], ends[k, 1]
            count += 1
    return count


@njit(cache=True)
def settle_field(field: Singles, stray: float) -> None:
    """Let the unknown in *field* fit as badly as the empty."""
    for j in range(field.shape[0]):
        for i in range(field.shape[1]):
            if field[j, i] > 0.0:
                field[j, i] = stray


@njit(cache=True)
def field_fit(field: Singles, u: float, v: float, heading: float, ends: Floats, count: int) -> float:
    """Return the sum of log p over the first *count* of *ends* (m, 2), seen from a pose; all in cells of *field*."""
    n = field.shape[0]
    most = n - 1.001
    cos, sin = math.cos(heading), math.sin(heading)
    left, low = u - 0.5, v - 0.5  # values of the field are those of the centres of cells
    total = 0.0
    for k in range(count):
        across = min(max(left + cos * ends[k, 0] - sin * ends[k, 1], 0.0), most)
        up = min(max(low + sin * ends[k, 0] + cos * ends[k, 1], 0.0), most)
        i, j = int(across), int(up)
        a, b = across - i, up - j
        below = (1.0 - a) * field[j, i] + a * field[j, i + 1]
        above = (1.0 - a) * field[j + 1, i] + a * field[j + 1, i + 1]
        total += (1.0 - b) * below + b * above
    return total


@njit(cache=True)
def climb(
    field: Singles, u: float, v: float, heading: float, ends: Floats, count: int, cell_m: float, numbers: Floats
) -> Match:
    """Return the pose near (u, v, heading) from which *ends* fit *field* best, in cells of it, and its value.

    The steps begin with STEP_M and STEP_RAD of *numbers* (NUMBERS,) and are halved five times (GMapping's iterations).
    """
    per_u, per_turn = 0.5 * (cell_m / numbers[SLACK_M]) ** 2, 0.5 / numbers[SLACK_RAD] ** 2
    step, turn, power = numbers[STEP_M] / cell_m, numbers[STEP_RAD], numbers[POWER]
    at_u, at_v, at_turn = 0.0, 0.0, 0.0
    best = power * field_fit(field, u, v, heading, ends, count)
    halved, moves = 0, 0
    while halved <= 5 and moves < _MOST_MOVES and count > 0:
        to_u, to_v, to_turn, found = at_u, at_v, at_turn, best
        for k in range(6):
            sign = 1.0 if k % 2 else -1.0
            try_u = at_u + sign * step * (k // 2 == 0)
            try_v = at_v + sign * step * (k // 2 == 1)
            try_turn = at_turn + sign * turn * (k // 2 == 2)
            value = -per_u * (try_u**2 + try_v**2) - per_turn * try_turn**2
            if value > found:  # the rest is at most 0
                value += power * field_fit(field, u + try_u, v + try_v, heading + try_turn, ends, count)
                if value > found:
                    to_u, to_v, to_turn, found = try_u, try_v, try_turn, value
        if found > best:
            at_u, at_v, at_turn, best, moves = to_u, to_v, to_turn, found, moves + 1
        else:
            step, turn, halved = 0.5 * step, 0.5 * turn, halved + 1
    return u + at_u, v + at_v, heading + at_turn, best


@njit(cache=True)
def match_particles(
    maps: Evidence,
    poses: Floats,
    ends: Floats,
    frame: Floats,
    stamp: Singles,
    numbers: Floats,
    field: Singles,
    scores: Floats,
) -> None:
    """Pull each of *poses* (n, 3) to where the scan's *ends* (m, 2; metres, body's frame) fit its map, of *maps*.

    *maps* has the shape (n, ny, nx), *frame* is x_m and y_m of their lower left corner and cell_m, *field* scratch of
    ``field_size``. *scores* (n,) are set to what was climbed, with what the ends count that were left out.
    """
    cell = frame[2]
    in_cells = ends / cell
    chosen = np.empty_like(in_cells)
    for i in range(poses.shape[0]):
        u, v = (poses[i, 0] - frame[0]) / cell, (poses[i, 1] - frame[1]) / cell
        left, low = make_field(maps[i], u, v, stamp, numbers[STRAY], field)
        count = choose_ends(field, u - left, v - low, poses[i, 2], in_cells, chosen)
        settle_field(field, numbers[STRAY])
        to_u, to_v, heading, score = climb(field, u - left, v - low, poses[i, 2], chosen, count, cell, numbers)
        poses[i, 0], poses[i, 1] = frame[0] + (to_u + left) * cell, frame[1] + (to_v + low) * cell
        poses[i, 2] = wrapped(heading)
        scores[i] = score + numbers[POWER] * numbers[NEWS] * (ends.shape[0] - count)


@njit(cache=True)
def mark_particles(
    maps: Evidence,
    poses: Floats,
    ranges_m: Floats,
    beams: Floats,
    range_m: float,
    frame: Floats,
    weights: tuple[int, int, int],
    frontier: Bytes,
    changed: Int32s,
    bodies: Floats,
) -> None:
    """Mark a scan into each of *maps* (n, ny, nx) from its pose; *beams* (m, 2) are in the body's frame.

    *frontier* and *changed* are scratch of :func:`cosim.geometry.marking.mark_scan`: no frontier is kept.
    """
    ways = np.empty_like(beams)
    hit, miss, cap = weights
    for i in range(poses.shape[0]):
        cos, sin = math.cos(poses[i, 2]), math.sin(poses[i, 2])
        for k in range(beams.shape[0]):
            ways[k, 0] = cos * beams[k, 0] - sin * beams[k, 1]
            ways[k, 1] = sin * beams[k, 0] + cos * beams[k, 1]
        mark_scan(
            maps[i],
            frontier,
            frame[0],
            frame[1],
            frame[2],
            poses[i, 0],
            poses[i, 1],
            ranges_m,
            ways,
            range_m,
            hit,
            miss,
            cap,
            bodies,
            changed,
            True,
        )
