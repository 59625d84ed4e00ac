"""Division of the search: regions of the floor for sub-teams, and tours of posts for searchers.

A region is a sector about the place where the teams start: rooms are sorted by the direction in which they lie, and the
circle is cut into arcs of about equal work. A tour is a piece of one path through all posts of a region, cut so that
the longest piece is as short as possible. Rooms are left whole where that costs little.
"""

import math
from collections.abc import Collection, Sequence
from typing import Final

import numpy as np
import scipy.optimize

import cosim.elementary as elementary
from cosim.arrays import Floats, Int64s
from cosim.geometry.planning import Point
from cosim.geometry.polylines import middle
from cosim.jit import njit
from protocols.aggregation.ground import Ground

CHANGE: Final = 2.0
"""Extra cost of going to another room, in camera ranges, so that a path finishes a room before it leaves it."""
CUT: Final = 0.15
"""Share of the mean tour by which the longest must get shorter for a room to be cut in two."""
_NEAR: Final = 10
"""Number of nearest posts that are tried as neighbours of each post on a tour."""
_ROUNDS: Final = 50
_LEAST: Final = 1e-9
"""Least gain that is not rounding, metres."""
FAR: Final = 1e6
"""Length that stands for a missing way, metres."""


def regions(ground: Ground, count: int, start_m: Point) -> tuple[frozenset[int], ...]:
    """Divide all posts into *count* regions of about equally many posts, sectors about *start_m*; no room is cut.

    The regions are in the order of their directions. Raise ValueError for a count that is not positive.
    """
    if count < 1:
        raise ValueError(f"{count} regions")
    units = _units(ground)
    centres = [middle([ground.posts_m[post] for post in unit]) for unit in units]
    angle = [elementary.atan2(y - start_m[1], x - start_m[0]) for x, y in centres]
    order = sorted(range(len(units)), key=lambda unit: (angle[unit], unit))
    sizes = np.array([len(units[unit]) for unit in order], np.int64)
    return tuple(frozenset(post for at in arc for post in units[order[at]]) for arc in _arcs(sizes, count))


def tours(ground: Ground, posts: Collection[int], starts_m: Sequence[Point]) -> tuple[tuple[int, ...], ...]:
    """Divide *posts* into one ordered tour for each searcher at *starts_m*, of about equal lengths.

    A tour's length is that of its ways, from the searcher's place on. Posts that cannot be reached come last.
    """
    searchers = len(starts_m)
    numbers = np.array(sorted(set(posts)), np.int64)
    if not len(numbers) or not searchers:
        return ((),) * searchers
    ways = np.minimum(ground.lengths_m[np.ix_(numbers, numbers)], FAR)
    rooms = np.array(ground.rooms, np.int64)[numbers]
    out = np.minimum(np.array([ground.lengths_from_m(start) for start in starts_m])[:, numbers], FAR)
    other = (rooms[:, None] != rooms[None, :]) * (CHANGE * ground.camera_m)
    near = np.argsort(ways + other, axis=1, kind="stable")[:, 1 : _NEAR + 1]
    nearest = out.min(axis=0)
    path = _improved(ways + other, nearest, _nearest_first(ways + other, nearest), near)
    pieces = _pieces(ways, rooms, path, out, searchers)
    gone = np.array([[_length(ways, out[k], piece) for piece in pieces] for k in range(searchers)])
    _, chosen = scipy.optimize.linear_sum_assignment(gone)
    result = []
    for k, at in enumerate(chosen.tolist()):
        piece = min(pieces[at], pieces[at][::-1], key=lambda way: _length(ways, out[k], way))
        result.append(tuple(numbers[_improved(ways + other, out[k], piece, near)].tolist()))
    return tuple(result)


def _units(ground: Ground) -> list[list[int]]:
    """Return the groups of posts that stay together: those of a room, and each post outside rooms by itself."""
    rooms: dict[int, list[int]] = {}
    alone = []
    for post, room in enumerate(ground.rooms):
        if room < 0:
            alone.append([post])
        else:
            rooms.setdefault(room, []).append(post)
    return [*rooms.values(), *alone]


def _arcs(sizes: Int64s, count: int) -> list[list[int]]:
    """Cut a circle of *sizes* into *count* arcs whose largest is as small as possible; all beginnings are tried."""
    best: list[list[int]] = [[] for _ in range(count)]
    least = math.inf
    for first in range(len(sizes)):
        turned = np.roll(sizes, -first)
        ends = _cuts(turned, count)
        sums = [int(turned[a:b].sum()) for a, b in zip([0, *ends], ends, strict=False)]
        worth = max(sums) + 1e-3 * (max(sums) - min(sums))
        if worth < least:
            least = worth
            best = [[(first + at) % len(sizes) for at in range(a, b)] for a, b in zip([0, *ends], ends, strict=False)]
    return best


def _cuts(sizes: Int64s, count: int) -> list[int]:
    """Return the ends of *count* parts of a row of *sizes* whose largest is as small as possible."""
    total = np.concatenate(([0], np.cumsum(sizes)))
    low, high = max(int(sizes.max()), math.ceil(total[-1] / count)), int(total[-1])
    while low < high:
        middle = (low + high) // 2
        if len(_filled(total, middle)) <= count:
            high = middle
        else:
            low = middle + 1
    ends = _filled(total, low)
    return [*ends, *[len(sizes)] * (count - len(ends))]


def _filled(total: Int64s, most: int) -> list[int]:
    """Return the ends of parts, each filled up to *most*."""
    ends, begin = [], 0
    while begin < len(total) - 1:
        begin = int(np.searchsorted(total, total[begin] + most, side="right")) - 1
        ends.append(begin)
    return ends


def _length(ways: Floats, out: Floats, path: Int64s) -> float:
    if not len(path):
        return 0.0
    return float(out[path[0]] + ways[path[:-1], path[1:]].sum())


def _pieces(ways: Floats, rooms: Int64s, path: Int64s, out: Floats, count: int) -> list[Int64s]:
    """Cut a *path* into *count* pieces, rather between rooms; the longest, with the way to it, as short as possible."""
    nearest = np.minimum.reduce(out)
    steps = np.concatenate(([0.0], np.cumsum(ways[path[:-1], path[1:]])))
    mean = steps[-1] / count + float(nearest.min())
    inside = np.concatenate(([False], rooms[path[:-1]] == rooms[path[1:]])) & (rooms[path] >= 0)
    costs = nearest[path] + inside * (CUT * mean)
    ends = _balanced(steps, costs, count)
    return [path[a:b] for a, b in zip([0, *ends[:-1]], ends, strict=True)]


# ---------------------------------------------------------------- kernels


@njit(cache=True)
def _nearest_first(ways: Floats, out: Floats) -> Int64s:
    """Return all posts in nearest-neighbour order."""
    count = ways.shape[0]
    path = np.empty(count, np.int64)
    left = np.ones(count, np.bool_)
    for at in range(count):
        best, least = -1, math.inf
        for k in range(count):
            way = out[k] if at == 0 else ways[path[at - 1], k]
            if left[k] and way < least:
                best, least = k, way
        path[at] = best
        left[best] = False
    return path


@njit(cache=True)
def _improved(ways: Floats, out: Floats, path: Int64s, near: Int64s) -> Int64s:
    """Return an open path that no reversal of a piece (2-opt) and no move of up to three posts (Or-opt) shortens.

    Only changes that bring one of the *near* posts, shape (n, k), next to another are tried.
    """
    count, size = ways.shape[0], path.shape[0]
    # the start and the end of the path are posts too, so that all legs are alike: the way to the end costs nothing
    legs = np.zeros((count + 2, count + 2))
    legs[:count, :count] = ways
    legs[count, :count] = out
    legs[:count, count] = out
    row = np.empty(size + 2, np.int64)
    row[0], row[1 : size + 1], row[size + 1] = count, path, count + 1
    places = np.full(count + 2, -1, np.int64)
    for at in range(size + 2):
        places[row[at]] = at
    for _ in range(_ROUNDS):
        better = _reversals(legs, row, places, near)
        better |= _moves(legs, row, places, near)
        if not better:
            break
    return row[1 : size + 1].copy()


@njit(cache=True)
def _reversals(legs: Floats, row: Int64s, places: Int64s, near: Int64s) -> bool:
    last = row.shape[0] - 2
    better = False
    for first in range(1, last + 1):
        for n in range(-1, near.shape[1]):
            j = places[near[row[first], n]] if n >= 0 else last
            if j < 0:
                continue
            low, high = min(first, j), max(first, j)
            for i, k in ((low + 1, high), (low, high - 1), (low, high)):
                if i >= k or k > last or i < 1:
                    continue
                gain = legs[row[i - 1], row[i]] + legs[row[k], row[k + 1]]
                gain -= legs[row[i - 1], row[k]] + legs[row[i], row[k + 1]]
                if gain > _LEAST:
                    row[i : k + 1] = row[i : k + 1][::-1].copy()
                    for at in range(i, k + 1):
                        places[row[at]] = at
                    better = True
    return better


@njit(cache=True)
def _moves(legs: Floats, row: Int64s, places: Int64s, near: Int64s) -> bool:
    last = row.shape[0] - 2
    better = False
    for size in range(1, 4):
        for i in range(1, last - size + 2):
            j = i + size - 1  # the piece is row[i..j]
            p, q = row[i], row[j]
            gain = legs[row[i - 1], p] + legs[q, row[j + 1]] - legs[row[i - 1], row[j + 1]]
            gap, most, turned = -1, _LEAST, False
            for n in range(2 * near.shape[1]):
                k = places[near[p if n % 2 else q, n // 2]]
                if k < 0 or i <= k <= j:
                    continue
                for after in (k - 1, k):  # the piece goes behind this place
                    if i - 1 <= after <= j:
                        continue
                    a, b = row[after], row[after + 1]
                    ahead, back = legs[a, p] + legs[q, b], legs[a, q] + legs[p, b]
                    more = gain + legs[a, b] - min(ahead, back)
                    if more > most:
                        gap, most, turned = after, more, back < ahead
            if gap >= 0:
                _shift(row, places, i, j, gap, turned)
                better = True
    return better


@njit(cache=True)
def _shift(row: Int64s, places: Int64s, i: int, j: int, gap: int, turned: bool) -> None:
    """Move the piece from place i to j behind the place *gap*, which is not in it; reversed if asked for."""
    piece = row[i : j + 1][::-1].copy() if turned else row[i : j + 1].copy()
    if gap < i:
        row[:] = np.concatenate((row[: gap + 1], piece, row[gap + 1 : i], row[j + 1 :]))
    else:
        row[:] = np.concatenate((row[:i], row[j + 1 : gap + 1], piece, row[gap + 1 :]))
    for at in range(min(i, gap + 1), max(j, gap) + 1):
        places[row[at]] = at


@njit(cache=True)
def _balanced(steps: Floats, costs: Floats, count: int) -> list[int]:
    """Return the ends of *count* pieces of a path whose costliest is as cheap as possible.

    A piece from a to b costs ``costs[a] + steps[b - 1] - steps[a]``; there may be empty ones.
    """
    size = steps.shape[0]
    worst = np.full((count + 1, size + 1), math.inf)
    cut = np.zeros((count + 1, size + 1), np.int64)
    worst[0, 0] = 0.0
    for k in range(1, count + 1):
        for b in range(size + 1):
            worst[k, b], cut[k, b] = worst[k - 1, b], b
            for a in range(b):
                piece = max(worst[k - 1, a], costs[a] + steps[b - 1] - steps[a])
                if piece < worst[k, b]:
                    worst[k, b], cut[k, b] = piece, a
    ends = [size]
    for k in range(count, 1, -1):
        ends.append(cut[k, ends[-1]])
    return ends[::-1]
