"""How well a scan fits a pose on a known map: the likelihood field and the beam model.

Thrun, Burgard and Fox, "Probabilistic Robotics", 2005, sections 6.3 and 6.4, as in Nav2's AMCL. With d the distance of
a beam's end from the nearest obstacle, at most max_distance_m,

    p = z_hit exp(-d^2 / 2 sigma_hit^2) + z_rand / range,

and beams that reach the range count for nothing. The beam model, with z read and z* the map's own range, is

    p = z_hit exp(-(z - z*)^2 / 2 sigma_hit^2) + [z < z*] z_short lambda exp(-lambda z)
        + [z = range] z_max + [z < range] z_rand / range.

The normal terms are not normalised (Nav2). Neighbouring beams err together, so their product is far too sure of itself;
AMCL takes 1 + sum p^3 instead, "ad hoc, works well". Both are sums over the beams: of p^3, or of log p. So the
likelihood field is one array of what an end in each cell adds, and a beam costs one look into it.

Distances are between centres of cells (Nav2). Obstacles are the occupied cells next to one that is not: inside a thick
wall, or the unknown that counts as occupied, a beam's end fits no better than in the open. A wall of one cell is as in
Nav2, which counts all occupied cells.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.ndimage

import cosim.elementary as elementary
from cosim.arrays import Bools, Floats, Int32s, Singles
from cosim.jit import njit
from cosim.navigation.localization.motion import PLACE
from cosim.randomness import philox_words

LEAST: Final = 1e-12
"""Least value of p, so that it has a logarithm."""
BEAM_NUMBERS: Final = 7
_HIT, _SHORT, _MOST, _RANDOM, _SIGMA, _LAMBDA, _RANGE = range(BEAM_NUMBERS)
_CORNERS: Final = 1.415  # two centres of cells are so much farther apart than points of them can be, in cells
_HAIR: Final = 1e-9  # so far beyond a cell's edge a ray goes on, in cells
_WORD: Final = 2.0**-32


@dataclass(frozen=True, eq=False)
class KnownMap:
    """Cells of *cell_m* metres, row 0 at the bottom; cell (0, 0) has its lower left corner at *origin_m*.

    Its rows lie along the x axis: on a map that is turned in the world, poses are given in the map's own frame.
    """

    occupied: Bools
    """Shape (ny, nx)."""
    distance_m: Singles
    """Shape (ny, nx): from each cell's centre to that of the nearest obstacle, inf where there is none."""
    standing: Int32s
    """Shape (n,): the cells iy * nx + ix that a robot's centre can be in."""
    origin_m: tuple[float, float]
    cell_m: float

    @property
    def frame(self) -> Floats:
        """Origin and size of a cell as the kernels take them: x_m, y_m, cell_m."""
        return np.array([*self.origin_m, self.cell_m])


def known_map(
    occupied: Bools, free: Bools, origin_m: tuple[float, float], cell_m: float, radius_m: float = 0.0
) -> KnownMap:
    """Make a map of the cells *occupied* and *free*, both (ny, nx), for robots of *radius_m*.

    Occupied is what stops a beam, free where a robot may be; the unknown may be either or neither. Raise ValueError if
    shapes differ or a robot can stand nowhere.
    """
    occupied = np.ascontiguousarray(occupied, np.bool_)
    if occupied.ndim != 2 or occupied.shape != np.shape(free):
        raise ValueError(f"occupied and free have the shapes {occupied.shape} and {np.shape(free)}, not one (ny, nx)")
    distance = np.full(occupied.shape, np.inf, np.float32)
    obstacle = surface(occupied)
    if obstacle.any():
        distance = (scipy.ndimage.distance_transform_edt(~obstacle) * cell_m).astype(np.float32)
    # a disc that just touches a cell's edge has its centre in a cell whose centre is nearer by the half of a diagonal
    near = radius_m + (0.5 - math.sqrt(0.5)) * cell_m
    standing = np.flatnonzero(np.asarray(free, np.bool_) & ~occupied & (distance >= near - 1e-6)).astype(np.int32)
    if not len(standing):
        raise ValueError(f"no cell is free and {radius_m} m from what is occupied")
    return KnownMap(occupied, distance, standing, origin_m, cell_m)


def surface(occupied: Bools) -> Bools:
    """Return which cells (ny, nx) are occupied and next to one that is not, if only by a corner; see the module.

    The edge of the map counts as what lies at it.
    """
    inner = scipy.ndimage.minimum_filter(occupied, size=3, mode="nearest")
    return np.asarray(occupied & ~inner, np.bool_)


def field_addends(
    distance_m: Singles, z_hit: float, z_rand: float, sigma_m: float, range_m: float, most_m: float, cubes: bool
) -> Singles:
    """Return what a beam that ends in a cell adds: p^3, or log p, of the likelihood field; shape (ny + 2, nx + 2).

    The rim is what an end off the map adds: as much as the farthest distance *most_m*.
    """
    padded = np.pad(np.minimum(distance_m, most_m).astype(np.float64), 1, constant_values=most_m)
    p = z_hit * elementary.exps(-(padded * padded) / (2.0 * sigma_m * sigma_m)) + z_rand / range_m
    addends = p * p * p if cubes else elementary.logs(np.maximum(p, LEAST))
    return np.ascontiguousarray(addends, np.float32)


# ---------------------------------------------------------------- the likelihood field


@njit(cache=True)
def pose_score(x: float, y: float, heading: float, ends: Floats, addends: Singles, frame: Floats) -> float:
    """Return the sum of *addends* over the *ends* (m, 2) of beams, in the body's frame, seen from one pose."""
    ny, nx = addends.shape
    per_m = 1.0 / frame[2]
    left, low = (x - frame[0]) * per_m + 1.0, (y - frame[1]) * per_m + 1.0
    cos, sin = elementary.cos(heading) * per_m, elementary.sin(heading) * per_m
    total = 0.0
    for j in range(ends.shape[0]):
        # the rim takes all that lies off the map
        across = min(max(left + cos * ends[j, 0] - sin * ends[j, 1], 0.0), nx - 0.5)
        up = min(max(low + sin * ends[j, 0] + cos * ends[j, 1], 0.0), ny - 0.5)
        total += addends[int(up), int(across)]
    return total


@njit(cache=True)
def field_scores(poses: Floats, ends: Floats, addends: Singles, frame: Floats, scores: Floats) -> None:
    """Set *scores* (n,) to the likelihood field's sums for *poses* (n, 3), see :func:`pose_score`."""
    for i in range(poses.shape[0]):
        scores[i] = pose_score(poses[i, 0], poses[i, 1], poses[i, 2], ends, addends, frame)


@njit(cache=True)
def random_poses(
    poses: Floats,
    tries: int,
    standing: Int32s,
    nx: int,
    frame: Floats,
    ends: Floats,
    addends: Singles,
    step: int,
    key_0: int,
    key_1: int,
) -> None:
    """Set each of *poses* (n, 3) to the one of *tries* random poses that fits the scan best.

    A random pose is uniform in the cells *standing*, with any heading. One try is the uniform injection of AMCL; many
    draw from where the scan fits, as sensor resetting does (Lenser and Veloso, ICRA 2000).
    """
    for i in range(poses.shape[0]):
        best = -math.inf
        for j in range(tries):
            a, b, c, d = philox_words(step, step >> 32, i * tries + j, PLACE, key_0, key_1)
            cell = standing[(a * standing.shape[0]) >> 32]
            x = frame[0] + (cell % nx + b * _WORD) * frame[2]
            y = frame[1] + (cell // nx + c * _WORD) * frame[2]
            heading = math.pi * (2.0 * _WORD * d - 1.0)
            score = pose_score(x, y, heading, ends, addends, frame) if tries > 1 else 0.0
            if score > best:
                best = score
                poses[i, 0], poses[i, 1], poses[i, 2] = x, y, heading


# ---------------------------------------------------------------- the beam model


@njit(cache=True)
def grid_range(
    occupied: Bools, distance_m: Singles, frame: Floats, x: float, y: float, dx: float, dy: float, limit_m: float
) -> float:
    """Return how far it is from (x, y) along the unit vector (dx, dy) to an occupied cell, at most *limit_m*.

    The map ends without a wall. Where *distance_m* says that no obstacle is near, the ray jumps: exact, but faster.
    """
    ny, nx = occupied.shape
    per_m = 1.0 / frame[2]
    start_x, start_y, limit, gone = (x - frame[0]) * per_m, (y - frame[1]) * per_m, limit_m * per_m, 0.0
    while gone < limit:
        across, up = start_x + gone * dx, start_y + gone * dy
        if not (0.0 <= across < nx and 0.0 <= up < ny):
            return limit_m
        ix, iy = int(across), int(up)
        if occupied[iy, ix]:
            range_m: float = gone * frame[2]
            return range_m
        jump = distance_m[iy, ix] * per_m - _CORNERS
        if jump <= 1.0:
            jump = math.inf
            if dx != 0.0:
                jump = ((ix + 1.0 if dx > 0.0 else ix) - across) / dx
            if dy != 0.0:
                jump = min(jump, ((iy + 1.0 if dy > 0.0 else iy) - up) / dy)
            jump += _HAIR
        gone += jump
    return limit_m


@njit(cache=True)
def beam_probability(read_m: float, true_m: float, model: Floats) -> float:
    """Return p of the beam model for a range *read_m* where the map has *true_m*.

    *model* (BEAM_NUMBERS,) holds z_hit, z_short, z_max, z_rand, sigma_hit (m), lambda (1/m) and the range (m).
    """
    off = read_m - true_m
    p: float = model[_HIT] * elementary.exp(-(off**2) / (2.0 * model[_SIGMA] ** 2))
    if off < 0.0:
        p += model[_SHORT] * model[_LAMBDA] * elementary.exp(-model[_LAMBDA] * read_m)
    p += model[_RANDOM] / model[_RANGE] if read_m < model[_RANGE] else model[_MOST]
    return p


@njit(cache=True)
def beam_scores(
    poses: Floats,
    ranges: Floats,
    beams: Floats,
    occupied: Bools,
    distance_m: Singles,
    frame: Floats,
    model: Floats,
    cubes: bool,
    scores: Floats,
) -> None:
    """Set *scores* (n,) to the sums of p^3, or of log p, of the beam model over *ranges* (m,), at most the range.

    *beams* (m, 2) are unit vectors in the body's frame.
    """
    for i in range(poses.shape[0]):
        x, y = poses[i, 0], poses[i, 1]
        cos, sin = elementary.cos(poses[i, 2]), elementary.sin(poses[i, 2])
        total = 0.0
        for j in range(ranges.shape[0]):
            dx, dy = cos * beams[j, 0] - sin * beams[j, 1], sin * beams[j, 0] + cos * beams[j, 1]
            true_m = grid_range(occupied, distance_m, frame, x, y, dx, dy, model[_RANGE])
            p = beam_probability(ranges[j], true_m, model)
            total += p**3 if cubes else elementary.log(max(p, LEAST))
        scores[i] = total
