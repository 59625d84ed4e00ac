"""Features of a range scan: straight pieces of walls, as lines (alpha, r), and corners where two of them meet.

A line is all points p with p . n = r, where n = (cos alpha, sin alpha) is its normal, away from the scanner, and r > 0
its distance. A corner is the intersection of two adjacent pieces. All is in the scanner's frame.

1. Hits of neighbouring beams belong together unless they are farther apart than a wall can have them that is met at a
   least angle: the adaptive breakpoints of Borges and Aldon, "Line extraction in 2D range images for mobile robotics",
   J. Intelligent and Robotic Systems 40, 2004, section 3.1.
2. Each group is split at the point that is farthest from the chord of its ends, as long as that is too far (iterative
   end point fit), and adjacent pieces are merged again if their lines agree: Siegwart, Nourbakhsh and Scaramuzza,
   "Introduction to Autonomous Mobile Robots", 2nd edition, 2011, section 4.7.2 (split and merge).
3. A line is fitted to each piece. A range errs by a normal error of one standard deviation sigma, a beam's direction
   does not err. So the beam in the direction theta reads r / cos(theta - alpha) + N(0, sigma^2), and alpha and r are
   those of maximum likelihood, by Gauss and Newton from the line of least squared distances (Siegwart et al., section
   4.7.1, with all weights alike). This is the weighted fit of Pfister, Roumeliotis and Burdick, "Weighted line fitting
   algorithms for mobile robot map building and efficient data representation", ICRA 2003, where ranges alone err.
   The covariance is the inverse of the information sum(h h^T) / sigma^2, h the derivative of the range by (alpha, r).
4. The covariance of a corner follows from those of its two lines to the first order. A corner says nothing that its
   lines do not: who uses both needs their joint covariance (:func:`corner_slopes`).

What is measured must not decide what is used, or lines are biased: the points next to an end of a piece are left out,
which might belong to another wall. Where a wall leaves the scanner's range only hits that read too short are left; a
wall almost that far away seems a fifth of a standard deviation too near by that. A piece whose points lie too far off
its line, by the sum of their squares, is none.
"""

import itertools
import math
from typing import Final, NamedTuple

import numpy as np
from pydantic import Field

import cosim.elementary as elementary
from cosim.arrays import Bools, Floats, Int64s
from cosim.settings import Angle, Count, Gain, Metres, Settings

_TURN: Final = 2.0 * math.pi
_ROUNDS: Final = 4
"""Number of Gauss-Newton steps of a fit: the last changes nothing that counts."""
_LEAST_COSINE: Final = 0.05
"""Least cosine between a beam and a line's normal: a beam along the wall has no range to predict."""


class FeatureParameters(Settings):
    """Parameters of the extraction of lines and corners."""

    range_m: Metres = Field(default=2.5, gt=0, description="m, how far a beam reaches")
    sigma_m: Metres = Field(default=0.02, gt=0, description="m, standard deviation of a range")
    break_rad: Angle = Field(default=0.17, gt=0, lt=1.5, description="rad, least angle between a beam and a wall")
    split_m: Metres = Field(default=0.1, gt=0, description="m off the chord of its ends from which a piece is split")
    least_points: Count = Field(default=6, ge=3, description="points of the shortest piece, without those at its ends")
    least_m: Metres = Field(default=0.4, gt=0, description="m, length of the shortest piece")
    trimmed: Count = Field(default=2, ge=0, le=20, description="points at each end of a piece that are left out")
    merging: Gain = Field(default=9.21, ge=0, description="chi-square (2) below which adjacent lines are one")
    straight: Gain = Field(default=4.0, gt=0, description="standard deviations by which chi-square may be too large")
    corner_rad: Angle = Field(default=0.6, gt=0, lt=1.5, description="rad, least angle between the sides of a corner")
    corner_m: Metres = Field(default=0.35, gt=0, description="m, farthest that a corner is from the ends of its sides")


class Line(NamedTuple):
    """A straight piece of wall as a scan shows it."""

    alpha_rad: float
    """Direction of its normal, away from the scanner; from -pi to pi."""
    r_m: float
    covariance: Floats
    """Shape (2, 2), of (alpha, r)."""
    ends_m: Floats
    """Shape (2, 2): the first and the last of its points, counter-clockwise, put onto the line."""


class Features(NamedTuple):
    """What a scan shows."""

    lines: list[Line]
    corners_m: Floats
    """Shape (c, 2)."""
    sides: Int64s
    """Shape (c, 2): the two lines that meet in each corner, counter-clockwise."""

    def corner_covariance(self, number: int) -> Floats:
        """Return the covariance (2, 2) of a corner, m^2."""
        one, other = (self.lines[side] for side in self.sides[number])
        slopes = corner_slopes(one, other)
        return sandwich(slopes[:, :2], one.covariance) + sandwich(slopes[:, 2:], other.covariance)


def extract(ranges_m: Floats, beams: Floats, parameters: FeatureParameters) -> Features:
    """Return the lines and corners of a scan.

    *ranges_m* (n,) are along the unit vectors *beams* (n, 2), a whole ring in counter-clockwise order. A range that is
    NaN, or as long as beams reach, is no hit.
    """
    hit = np.flatnonzero((ranges_m > 0.0) & (ranges_m < parameters.range_m))
    groups = _groups(hit, ranges_m, beams, parameters)
    lines: list[Line] = []
    adjacent: list[tuple[int, int]] = []
    for group in groups:
        begin = len(lines)
        lines += _lines_of(group, ranges_m, beams, parameters)
        adjacent += [(k, k + 1) for k in range(begin, len(lines) - 1)]
        if len(group) == len(beams) and len(lines) > 2:
            adjacent.append((len(lines) - 1, 0))
    found = [(sides, _corner(lines[sides[0]], lines[sides[1]], parameters)) for sides in adjacent]
    corners = [(*sides, *place) for sides, place in found if place is not None]
    rows = np.array(corners, np.float64).reshape(-1, 4)
    return Features(lines, rows[:, 2:], rows[:, :2].astype(np.int64))


# ---------------------------------------------------------------- points that belong together


def _groups(hit: Int64s, ranges: Floats, beams: Floats, own: FeatureParameters) -> list[Int64s]:
    """Return the numbers of the beams of each group of *hit* ones; each group goes on around the ring."""
    if len(hit) < own.least_points:
        return []
    points = ranges[hit, np.newaxis] * beams[hit]
    ahead = np.roll(np.arange(len(hit)), -1)
    away = points[ahead] - points
    apart = np.sqrt((away * away).sum(axis=1))
    step = elementary.sin(_TURN / len(beams)), elementary.sin(max(own.break_rad - _TURN / len(beams), 0.01))
    broken: Bools = (apart > ranges[hit] * step[0] / step[1] + 3.0 * own.sigma_m) | (
        (hit[ahead] - hit) % len(beams) != 1
    )
    # a closed ring has to begin somewhere: where it is farthest away there is a corner
    begin = int(np.flatnonzero(broken)[0]) + 1 if broken.any() else int(np.argmax(ranges[hit]))
    hit, broken = np.roll(hit, -begin), np.roll(broken, -begin)
    return [group for group in np.split(hit, np.flatnonzero(broken) + 1) if len(group) >= own.least_points]


def _lines_of(group: Int64s, ranges: Floats, beams: Floats, own: FeatureParameters) -> list[Line]:
    """Return the lines of one group of beams, in order."""
    points = ranges[group, np.newaxis] * beams[group]
    cuts = [0, *_splits(points, 0, len(group) - 1, own.split_m), len(group) - 1]
    fitted: list[tuple[int, int, Line]] = []
    for first, last in itertools.pairwise(cuts):
        line = _fitted(group[first : last + 1], ranges, beams, own)
        if line is None:  # a few points about a corner, mostly
            continue
        if fitted and _agree(fitted[-1][2], line, own):
            begin = fitted[-1][0]
            both = _fitted(group[begin : last + 1], ranges, beams, own)
            if both is not None:
                fitted[-1] = begin, last, both
                continue
        fitted.append((first, last, line))
    return [line for _, _, line in fitted]


def _splits(points: Floats, first: int, last: int, far: float) -> list[int]:
    """Return the points between *first* and *last* at which they are split."""
    if last - first < 2:
        return []
    dx, dy = (points[last] - points[first]).tolist()
    length = math.sqrt(dx * dx + dy * dy)
    rest = points[first + 1 : last] - points[first]
    off = np.abs(rest[:, 0] * dy - rest[:, 1] * dx) if length > 0.0 else np.sqrt((rest * rest).sum(axis=1))
    at = int(np.argmax(off))
    if off[at] <= far * (length or 1.0):
        return []
    middle = first + 1 + at
    return [*_splits(points, first, middle, far), middle, *_splits(points, middle, last, far)]


def _agree(one: Line, other: Line, own: FeatureParameters) -> bool:
    """Return whether two adjacent lines may be one, by their difference and its covariance."""
    turn = math.remainder(other.alpha_rad - one.alpha_rad, _TURN)
    return squared_distance(turn, other.r_m - one.r_m, one.covariance + other.covariance) < own.merging


# ---------------------------------------------------------------- lines


def _fitted(piece: Int64s, ranges: Floats, beams: Floats, own: FeatureParameters) -> Line | None:
    """Return the line of the beams of a *piece*; None if they are too few, too short a way, or not straight."""
    used = piece[own.trimmed : len(piece) - own.trimmed]
    fit = fit_line(ranges[used], beams[used], own.sigma_m) if len(used) >= own.least_points else None
    if fit is None:
        return None
    line, chi_square = fit
    dx, dy = (line.ends_m[1] - line.ends_m[0]).tolist()
    free = len(used) - 2
    straight = chi_square < free + own.straight * math.sqrt(2.0 * free)
    return line if straight and math.sqrt(dx * dx + dy * dy) >= own.least_m else None


def fit_line(ranges_m: Floats, beams: Floats, sigma_m: float) -> tuple[Line, float] | None:
    """Return the line of maximum likelihood, and chi-square of the ranges.

    *ranges_m* (n,) are along the unit vectors *beams* (n, 2), with errors of the standard deviation *sigma_m*. Return
    None if a beam is along the line, or the points are one.
    """
    points = ranges_m[:, np.newaxis] * beams
    alpha, r = _nearest_line(points)
    for _ in range(_ROUNDS):
        x, y = elementary.cos(alpha), elementary.sin(alpha)
        cosine, sine = beams[:, 0] * x + beams[:, 1] * y, beams[:, 1] * x - beams[:, 0] * y
        if cosine.min() < _LEAST_COSINE:
            return None
        by_r = 1.0 / cosine
        by_alpha = -r * sine * by_r * by_r
        off = ranges_m - r * by_r
        aa, ar, rr = (by_alpha * by_alpha).sum(), (by_alpha * by_r).sum(), (by_r * by_r).sum()
        a, b = (by_alpha * off).sum(), (by_r * off).sum()
        whole = float(aa * rr - ar * ar)
        if whole <= 1e-9 * float(aa * rr):
            return None
        alpha, r = alpha + float(rr * a - ar * b) / whole, r + float(aa * b - ar * a) / whole
    covariance = sigma_m * sigma_m / whole * np.array([[rr, -ar], [-ar, aa]])
    ends = _onto(points[[0, -1]], elementary.cos(alpha), elementary.sin(alpha), r)
    chi_square = float((off * off).sum()) / (sigma_m * sigma_m)
    return Line(math.remainder(alpha, _TURN), r, covariance, ends), chi_square


def _nearest_line(points: Floats) -> tuple[float, float]:
    """Return alpha and r of the line of least squared distances from *points* (n, 2)."""
    middle = points.sum(axis=0) / len(points)
    dx, dy = (points - middle).T
    sxx, sxy, syy = float((dx * dx).sum()), float((dx * dy).sum()), float((dy * dy).sum())
    alpha = 0.5 * elementary.atan2(-2.0 * sxy, syy - sxx)
    r = float(middle[0]) * elementary.cos(alpha) + float(middle[1]) * elementary.sin(alpha)
    return (alpha, r) if r >= 0.0 else (alpha + math.pi, -r)


def _onto(points: Floats, x: float, y: float, r: float) -> Floats:
    """Return the feet of *points* (n, 2) on the line of the normal (x, y)."""
    off = points[:, 0] * x + points[:, 1] * y - r
    feet: Floats = points - off[:, np.newaxis] * np.array([x, y])
    return feet


# ---------------------------------------------------------------- corners


def _corner(one: Line, other: Line, own: FeatureParameters) -> tuple[float, float] | None:
    """Return where two adjacent lines meet; None if that is too flat an angle, or off their ends."""
    between = abs(math.remainder(other.alpha_rad - one.alpha_rad, math.pi))
    if between < own.corner_rad:
        return None
    x, y = intersection(one, other)
    for end in (one.ends_m[1], other.ends_m[0]):
        dx, dy = x - float(end[0]), y - float(end[1])
        if math.sqrt(dx * dx + dy * dy) > own.corner_m:
            return None
    return x, y


def intersection(one: Line, other: Line) -> tuple[float, float]:
    """Return the point (m) that two lines share, which are not parallel."""
    cos_1, sin_1 = elementary.cos(one.alpha_rad), elementary.sin(one.alpha_rad)
    cos_2, sin_2 = elementary.cos(other.alpha_rad), elementary.sin(other.alpha_rad)
    cross = cos_1 * sin_2 - sin_1 * cos_2
    return (one.r_m * sin_2 - other.r_m * sin_1) / cross, (other.r_m * cos_1 - one.r_m * cos_2) / cross


def corner_slopes(one: Line, other: Line) -> Floats:
    """Return the derivatives (2, 4) of the corner of two lines by alpha and r of the one and of the other.

    A point p on a line moves by dp with n . dp = dr - (n' . p) dalpha, n' the derivative of the normal n; and so on
    the other line.
    """
    x, y = intersection(one, other)
    cos_1, sin_1 = elementary.cos(one.alpha_rad), elementary.sin(one.alpha_rad)
    cos_2, sin_2 = elementary.cos(other.alpha_rad), elementary.sin(other.alpha_rad)
    cross = cos_1 * sin_2 - sin_1 * cos_2
    by_one, by_other = np.array([sin_2, -cos_2]) / cross, np.array([-sin_1, cos_1]) / cross
    turn_1, turn_2 = x * sin_1 - y * cos_1, x * sin_2 - y * cos_2
    return np.stack((by_one * turn_1, by_one, by_other * turn_2, by_other), axis=1)


# ---------------------------------------------------------------- covariances of pairs


def squared_distance(first: float, second: float, covariance: Floats) -> float:
    """Return the squared Mahalanobis distance of a difference (*first*, *second*) with a *covariance* (2, 2)."""
    a, b, c = float(covariance[0, 0]), float(covariance[0, 1]), float(covariance[1, 1])
    return (c * first * first - 2.0 * b * first * second + a * second * second) / (a * c - b * b)


def sandwich(slopes: Floats, covariance: Floats) -> Floats:
    """Return J C J^T of *slopes* J (m, n) and a *covariance* C (n, n)."""
    left = (slopes[:, :, np.newaxis] * covariance).sum(axis=1)
    product: Floats = (left[:, np.newaxis, :] * slopes).sum(axis=2)
    return product
