"""Who looks where: regions of the floor for sub-teams, and tours of posts for searchers.

A region is a sector about the place where the teams start: rooms are sorted by the direction in which they lie, and the
circle is cut into arcs of about equal work. A tour is a piece of one path through all posts of a region, cut so that
the longest piece is as short as possible. Rooms are left whole where that costs little.
"""

import math
from collections.abc import Collection, Sequence
from typing import Final

import numpy as np
import scipy.optimize

from cosim.geometry.planning import Floats, Point
from cosim.jit import njit
from protocols.aggregation.ground import Ground
from protocols.aggregation.ground_posts import Ints

CHANGE: Final = 2.0
"""To go to another room counts as so many camera's ranges more: a path leaves no room before it is done with it."""
CUT: Final = 0.15
"""To cut a room in two is worth it if the longest tour gets shorter by this share of the mean."""
FAR: Final = 1e6
"""Metres that stand for a way that there is not."""


def regions(
    ground: Ground, count: int, start_m: Point, hosts_m: Sequence[Point] | None = None
) -> tuple[frozenset[int], ...]:
    """Divide all posts into *count* regions of about equally many posts, sectors about *start_m*; no room is cut.

    With *hosts_m*, *count* places, region k is the one for the host at place k: together they have the shortest ways.
    Without, they are in order of their directions. Raise ValueError for a count that is not positive.
    """
    if count < 1:
        raise ValueError(f"{count} regions")
    units = _units(ground)
    centres = [_centre(ground, unit) for unit in units]
    angle = [math.atan2(y - start_m[1], x - start_m[0]) for x, y in centres]
    order = sorted(range(len(units)), key=lambda unit: (angle[unit], unit))
    sizes = np.array([len(units[unit]) for unit in order], np.int64)
    parts = [[unit for at in arc for unit in [order[at]]] for arc in _arcs(sizes, count)]
    found = [frozenset(post for unit in part for post in units[unit]) for part in parts]
    if hosts_m is None:
        return tuple(found)
    middles = [_centre(ground, sorted(region)) if region else start_m for region in found]
    ways = np.array([[math.dist(host, middle) for middle in middles] for host in hosts_m])
    _, chosen = scipy.optimize.linear_sum_assignment(ways)
    return tuple(found[region] for region in chosen.tolist())


def tours(ground: Ground, posts: Collection[int], starts_m: Sequence[Point]) -> tuple[tuple[int, ...], ...]:
    """Divide *posts* into an ordered tour for each searcher, who stands at *starts_m*; about equally long.

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
    path = _improved(ways + other, out.min(axis=0), _nearest_first(ways + other, out.min(axis=0)))
    pieces = _pieces(ways, rooms, path, out, searchers)
    gone = np.array([[_length(ways, out[k], piece) for piece in pieces] for k in range(searchers)])
    _, chosen = scipy.optimize.linear_sum_assignment(gone)
    result = []
    for k, at in enumerate(chosen.tolist()):
        piece = min(pieces[at], pieces[at][::-1], key=lambda way: _length(ways, out[k], way))
        result.append(tuple(numbers[_improved(ways + other, out[k], piece)].tolist()))
    return tuple(result)


def _units(ground: Ground) -> list[list[int]]:
    """Return the posts that stay together: those of a room, and each that is in none."""
    rooms: dict[int, list[int]] = {}
    alone = []
    for post, room in enumerate(ground.rooms):
        if room < 0:
            alone.append([post])
        else:
            rooms.setdefault(room, []).append(post)
    return [*rooms.values(), *alone]


def _centre(ground: Ground, posts: Sequence[int]) -> Point:
    xs, ys = zip(*(ground.posts_m[post] for post in posts), strict=True)
    return sum(xs) / len(xs), sum(ys) / len(ys)


def _arcs(sizes: Ints, count: int) -> list[list[int]]:
    """Cut a circle of *sizes* into *count* arcs whose largest is as small as possible; where it begins is tried out."""
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


def _cuts(sizes: Ints, count: int) -> list[int]:
    """Return where a row of *sizes* is cut into *count* parts so that the largest is smallest: the parts' ends."""
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


def _filled(total: Ints, most: int) -> list[int]:
    """Return the ends of parts that are each filled up to *most*."""
    ends, begin = [], 0
    while begin < len(total) - 1:
        begin = int(np.searchsorted(total, total[begin] + most, side="right")) - 1
        ends.append(begin)
    return ends


def _length(ways: Floats, out: Floats, path: Ints) -> float:
    if not len(path):
        return 0.0
    return float(out[path[0]] + ways[path[:-1], path[1:]].sum())


def _pieces(ways: Floats, rooms: Ints, path: Ints, out: Floats, count: int) -> list[Ints]:
    """Cut a *path* into *count* pieces, the longest, with the way to it, as short as possible; rather between rooms."""
    nearest = np.minimum.reduce(out)
    steps = np.concatenate(([0.0], np.cumsum(ways[path[:-1], path[1:]])))
    mean = steps[-1] / count + float(nearest.min())
    inside = np.concatenate(([False], rooms[path[:-1]] == rooms[path[1:]])) & (rooms[path] >= 0)
    costs = nearest[path] + inside * (CUT * mean)
    ends = _balanced(steps, costs, count)
    return [path[a:b] for a, b in zip([0, *ends[:-1]], ends, strict=True)]


# ---------------------------------------------------------------- kernels


@njit(cache=True)
def _nearest_first(ways: Floats, out: Floats) -> Ints:
    """Return all in the order of who always goes to the nearest next."""
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
def _improved(ways: Floats, out: Floats, path: Ints) -> Ints:
    """Return an open path that no reversal of a piece (2-opt) and no move of up to three posts (Or-opt) shortens."""
    path = path.copy()
    count = path.shape[0]
    for _ in range(50):
        better = _reversals(ways, out, path) | _moves(ways, out, path)
        if not better or count < 2:
            break
    return path


@njit(cache=True)
def _leg(ways: Floats, out: Floats, path: Ints, at: int, to: int) -> float:
    """Return the way from the post at a place of the path (-1: the start) to one, 0 beyond the end."""
    if to >= path.shape[0]:
        return 0.0
    return float(out[path[to]] if at < 0 else ways[path[at], path[to]])


@njit(cache=True)
def _reversals(ways: Floats, out: Floats, path: Ints) -> bool:
    count = path.shape[0]
    better = False
    for i in range(count - 1):
        for j in range(i + 1, count):
            before = _leg(ways, out, path, i - 1, i) + _leg(ways, out, path, j, j + 1)
            after = _leg(ways, out, path, i - 1, j)
            if j + 1 < count:
                after += ways[path[i], path[j + 1]]
            if after < before - 1e-9:
                path[i : j + 1] = path[i : j + 1][::-1].copy()
                better = True
    return better


@njit(cache=True)
def _moves(ways: Floats, out: Floats, path: Ints) -> bool:
    count = path.shape[0]
    better = False
    for size in range(1, 4):
        for i in range(count - size + 1):
            j = i + size  # the piece is path[i:j]
            rest = np.concatenate((path[:i], path[j:]))
            gain = _leg(ways, out, path, i - 1, i) + _leg(ways, out, path, j - 1, j)
            gain -= _leg(ways, out, rest, i - 1, i)
            place, most, turned = -1, 1e-9, False
            for at in range(rest.shape[0] + 1):
                if at == i:
                    continue
                gap = _leg(ways, out, rest, at - 1, at)
                for back in (False, True):
                    head, tail = (path[j - 1], path[i]) if back else (path[i], path[j - 1])
                    cost = out[head] if at == 0 else ways[rest[at - 1], head]
                    if at < rest.shape[0]:
                        cost += ways[tail, rest[at]]
                    if gain - (cost - gap) > most:
                        place, most, turned = at, gain - (cost - gap), back
            if place >= 0:
                piece = path[i:j][::-1].copy() if turned else path[i:j].copy()
                path[:] = np.concatenate((rest[:place], piece, rest[place:]))
                better = True
    return better


@njit(cache=True)
def _balanced(steps: Floats, costs: Floats, count: int) -> list[int]:
    """Return the ends of *count* pieces of a path, the costliest as cheap as possible.

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
