"""Simultaneous localisation and mapping by features: an extended Kalman filter over a pose and landmarks.

Landmarks are corners, points (x, y), and walls, infinite lines (alpha, r); :mod:`cosim.navigation.features` finds both
in scans. The filter is that of Smith, Self and Cheeseman, "Estimating uncertain spatial relationships in robotics",
1990, as in Thrun, Burgard and Fox, "Probabilistic Robotics", 2005, chapter 10, and of Dissanayake et al., "A solution
to the simultaneous localization and map building (SLAM) problem", IEEE T-RA 17(3), 2001.

State. The pose (x, y, theta) and two numbers a landmark. A wall is one face of it: its normal n = (cos alpha,
sin alpha) points into the wall, and r is n . (p - c) for its points p. The anchor c is a constant of each wall, where
it was seen first: with the map's origin for all, a small turn of a wall far away would be a large and curved change
of r.

Prediction. Odometry errs as the robots' does (:mod:`cosim.robots.sense_kernels`, ``locate``): the way of a tick is
stretched by 1 + slip, slip uniform and new every tick, and before it the heading is turned by an error that is uniform
and in proportion to the root of the way, so that its variance a metre is the same whatever the ticks. Between updates
the errors of ticks are composed, with the pose at the last update as their origin.

Correction. A wall is measured as alpha - theta and r - n . (p - c), a corner as R(-theta) (f - p). A corner is a
function of two lines of the same scan; the covariance of what is measured is that of all of it together, so nothing
counts twice. To be a full one, corners have a small variance of their own (``corner_m``).

Association. A feature may be a landmark that it is individually compatible with (chi-square of the innovation, 2
degrees of freedom); of several it is the likeliest. A wall must also have been seen near there, a corner open the same
way. All pairs must be compatible together (Neira and Tardós, "Data association in stochastic mapping using the joint
compatibility test", IEEE T-RA 17(6), 2001), else the pair without which the others fit best is given up, one by one:
no search through all sets of pairs as in theirs. Only a feature that is far from all landmarks becomes a new one.

Consistency. The filter linearises where its estimates are, which change: so it takes the heading of the whole map for
observable and becomes too sure of it. Jacobians are evaluated at first estimates instead, landmarks' when they are new
and the pose's before its correction: Huang, Mourikis and Roumeliotis, "Observability-based rules for designing
consistent EKF SLAM estimators", Int. J. Robotics Research 29(5), 2010 (FEJ-EKF). For that also a new landmark's
derivative by the heading is taken about the pose before the correction.

Size. At most ``most_landmarks``: of more, those not seen for longest are forgotten, of equal ones those seen least. And
a landmark that was seen a few times only, and then not for some updates, is taken for none. To forget one is to strike
its rows: what others have learnt by it they keep, and the filter stays consistent.
"""

import math
from dataclasses import dataclass, replace
from typing import Final, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt
from pydantic import Field

import cosim.elementary as elementary
from cosim.arrays import Bools, Floats, Int64s
from cosim.jit import njit
from cosim.navigation.features import FeatureParameters, Features, corner_slopes, extract, sandwich, squared_distance
from cosim.navigation.localization.motion import Pose, turned_back
from cosim.navigation.slam import SlamEstimate, carried
from cosim.settings import Angle, Count, Gain, Metres, Settings

_TURN: Final = 2.0 * math.pi
_UNIFORM: Final = 1.0 / math.sqrt(3.0)
"""Standard deviation of a uniform number from -1 to 1."""


class FeatureSlamParameters(Settings):
    """Parameters of the filter. The errors of odometry have the names and the meaning of the robots' senses."""

    features: FeatureParameters = FeatureParameters()
    odometry_slip: float = Field(default=0.03, ge=0, lt=1, description="share by which a tick's way is wrong, at most")
    odometry_turn_rad: Angle = Field(
        default=0.03, ge=0, description="rad, by which a tick's way of one metre turns the heading wrongly, at most"
    )
    odometry_way_m: Metres | None = Field(
        default=None, gt=0, description="m, a tick's way at which odometry errs so, and else in proportion to it"
    )
    corner_m: Metres = Field(
        default=0.01, gt=0, description="m, standard deviation of a corner beside that of its lines"
    )
    gate: Gain = Field(default=9.21, gt=0, description="chi-square (2) up to which a feature may be a landmark")
    joint: Gain = Field(default=3.0, gt=0, description="standard deviations by which that of all may be too large")
    news: Gain = Field(
        default=25.0, gt=0, description="chi-square (2) from which on a feature is none of the landmarks"
    )
    beside_m: Metres = Field(default=2.0, ge=0, description="m, from a wall as far as it was seen to where it goes on")
    facing_rad: Angle = Field(default=0.8, gt=0, description="rad, by which the sides of one corner may seem turned")
    most_landmarks: Count = Field(default=100, ge=4, le=500, description="the largest number of landmarks")
    least_sightings: Count = Field(default=3, ge=1, description="so often seen, a landmark is kept")
    lone_updates: Count = Field(default=20, ge=1, description="updates after which another one is forgotten")
    first_estimates: bool = Field(default=True, description="Jacobians at first estimates; else at the latest")
    update_way_m: Metres = Field(default=0.25, ge=0, description="m of way after which the filter is updated")
    update_turn_rad: Angle = Field(default=0.2, ge=0, description="rad of turn after which the filter is updated")
    update_ticks: Count = Field(default=10, ge=1, description="observations after which it is updated in any case")


# ---------------------------------------------------------------- what odometry tells


class Way(NamedTuple):
    """How odometry has moved since an update, in the body's frame of then."""

    x_m: float = 0.0
    y_m: float = 0.0
    turn_rad: float = 0.0
    covariance: Floats = np.zeros((3, 3))
    """Shape (3, 3), of x, y and the turn."""


def further(
    way: Way, x_m: float, y_m: float, turn_rad: float, slip: float, turn_error_rad: float, at_m: float | None = None
) -> Way:
    """Return *way* after one more tick, at whose end odometry has moved by *x_m*, *y_m* and *turn_rad* in all.

    *slip* and *turn_error_rad* are the largest errors of a tick, as :class:`FeatureSlamParameters` has them; with
    *at_m* they are those of a tick with so long a way, and grow with it.
    """
    dx, dy = x_m - way.x_m, y_m - way.y_m
    square = dx * dx + dy * dy
    more = 1.0 if at_m is None else math.sqrt(square) / at_m
    # the heading's error comes before the way, and so turns it
    slopes = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
    covariance = way.covariance.copy()
    covariance[2, 2] += (more * turn_error_rad * _UNIFORM) ** 2 * math.sqrt(square)
    stretched = more * slip * _UNIFORM * np.array([dx, dy, 0.0])
    return Way(x_m, y_m, turn_rad, sandwich(slopes, covariance) + stretched[:, np.newaxis] * stretched)


# ---------------------------------------------------------------- what a scan tells


class Measured(NamedTuple):
    """Features of one scan as the filter measures them, in the body's frame."""

    values: Floats
    """Shape (m, 2): alpha and r of a wall, x and y of a corner."""
    walls: Bools
    """Shape (m,): True for a wall, False for a corner."""
    covariance: Floats
    """Shape (2 m, 2 m), of all values together."""
    ends_m: Floats
    """Shape (m, 2, 2): the ends of a wall as seen; those of a corner mean nothing."""
    facing_rad: Floats
    """Shape (m,): the direction between the sides of a corner; that of a wall means nothing."""


def measured(features: Features, corner_m: float) -> Measured:
    """Return *features* with their joint covariance, of which *corner_m* is a corner's own standard deviation."""
    count, corners = len(features.lines), len(features.corners_m)
    lines = np.zeros((2 * count, 2 * count))
    slopes = np.zeros((2 * (count + corners), 2 * count))
    facing, ends = np.zeros(count + corners), np.zeros((count + corners, 2, 2))
    for k, line in enumerate(features.lines):
        two = slice(2 * k, 2 * k + 2)
        lines[two, two], slopes[two, two], ends[k] = line.covariance, np.eye(2), line.ends_m
    for k, sides in enumerate(features.sides.tolist(), start=count):
        one, other = (features.lines[side] for side in sides)
        both = [2 * sides[0], 2 * sides[0] + 1, 2 * sides[1], 2 * sides[1] + 1]
        slopes[2 * k : 2 * k + 2, both] = corner_slopes(one, other)
        facing[k] = _between(one.ends_m[0] - one.ends_m[1], other.ends_m[1] - other.ends_m[0])
    covariance = sandwich(slopes, lines)
    own = np.repeat([0.0, corner_m * corner_m], [2 * count, 2 * corners])
    covariance[np.diag_indices(len(own))] += own
    values = np.array([line[:2] for line in features.lines]).reshape(-1, 2)
    walls = np.repeat([True, False], [count, corners])
    return Measured(np.concatenate((values, features.corners_m)), walls, covariance, ends, facing)


def _between(one: Floats, other: Floats) -> float:
    """Return the direction in the middle between two others, given as vectors (2,)."""
    (a, b), (c, d) = one.tolist(), other.tolist()
    first, second = math.sqrt(a * a + b * b), math.sqrt(c * c + d * d)
    return elementary.atan2(b / first + d / second, a / first + c / second)


# ---------------------------------------------------------------- the filter's state


@dataclass(frozen=True)
class Belief:
    """The pose and m landmarks, with what is known of each."""

    mean: Floats
    """Shape (3 + 2 m,): x_m, y_m, heading_rad, and alpha and r of a wall or x and y of a corner."""
    covariance: Floats
    """Shape (3 + 2 m, 3 + 2 m)."""
    place_m: tuple[float, float]
    """The place about which derivatives by the heading are taken: the robot's before the last correction."""
    first: Floats
    """Shape (m, 2): the landmarks as they were first estimated."""
    walls: Bools
    """Shape (m,): True for a wall."""
    anchors_m: Floats
    """Shape (m, 2): the point of a wall, its r is relative to."""
    reach_m: Floats
    """Shape (m, 2): from where to where a wall was seen, to the left of its normal from its anchor."""
    facing_rad: Floats
    """Shape (m,): the direction between the sides of a corner."""
    sightings: Int64s
    """Shape (m,): how often each was seen."""
    latest: Int64s
    """Shape (m,): the update in which each was seen last."""

    @property
    def landmarks(self) -> Floats:
        """Shape (m, 2): the landmarks' part of the mean."""
        return self.mean[3:].reshape(-1, 2)


Pairs: TypeAlias = tuple[Int64s, Int64s]
"""Numbers of features, and of the landmarks that they are, both (k,)."""


def begun(start: Pose) -> Belief:
    """Return the belief of a robot that knows its pose and nothing else."""
    none, pairs = np.zeros(0), np.zeros((0, 2))
    numbers = np.zeros(0, np.int64)
    mean = np.array(start, np.float64)
    place = float(start[0]), float(start[1])
    return Belief(mean, np.zeros((3, 3)), place, pairs, none > 0.0, pairs, pairs, none, numbers, numbers)


def moved(belief: Belief, way: Way) -> Belief:
    """Return *belief* after a *way*."""
    x, y, heading = belief.mean[:3].tolist()
    cos, sin = elementary.cos(heading), elementary.sin(heading)
    to_x, to_y = x + cos * way.x_m - sin * way.y_m, y + sin * way.x_m + cos * way.y_m
    from_x, from_y = belief.place_m
    mean, covariance = belief.mean.copy(), belief.covariance.copy()
    mean[:3] = to_x, to_y, math.remainder(heading + way.turn_rad, _TURN)
    for axis, slope in ((0, from_y - to_y), (1, to_x - from_x)):  # rows, then columns: the same as a product
        covariance[axis] += slope * covariance[2]
    for axis, slope in ((0, from_y - to_y), (1, to_x - from_x)):
        covariance[:, axis] += slope * covariance[:, 2]
    covariance[:3, :3] += sandwich(np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]]), way.covariance)
    return replace(belief, mean=mean, covariance=covariance, place_m=(to_x, to_y))


def expected(belief: Belief, first_estimates: bool = True) -> tuple[Floats, Floats]:
    """Return what would be measured of each landmark (m, 2), and its derivatives (m, 2, 5).

    Derivatives are by x, y, heading and the landmark's own two numbers.
    """
    x, y, heading = belief.mean[:3].tolist()
    cos, sin = elementary.cos(heading), elementary.sin(heading)
    values, slopes = np.empty_like(belief.first), np.zeros((len(belief.first), 2, 5))
    latest, first = belief.landmarks.tolist(), belief.first.tolist()
    rows = zip(belief.walls.tolist(), latest, first if first_estimates else latest, belief.anchors_m, strict=True)
    for k, (wall, (a, b), (a_1, b_1), (from_x, from_y)) in enumerate(rows):
        if wall:
            dx, dy = x - from_x, y - from_y
            values[k] = math.remainder(a - heading, _TURN), b - elementary.cos(a) * dx - elementary.sin(a) * dy
            n_x, n_y = elementary.cos(a_1), elementary.sin(a_1)
            slopes[k] = (0.0, 0.0, -1.0, 1.0, 0.0), (-n_x, -n_y, 0.0, n_y * dx - n_x * dy, 1.0)
        else:
            dx, dy = a - x, b - y
            values[k] = cos * dx + sin * dy, cos * dy - sin * dx
            dx, dy = a_1 - x, b_1 - y
            slopes[k] = (
                (-cos, -sin, cos * dy - sin * dx, cos, sin),
                (sin, -cos, -sin * dy - cos * dx, -sin, cos),
            )
    return values, slopes


def innovations(belief: Belief, seen: Measured, values: Floats, pairs: Pairs) -> Floats:
    """Return what was measured less what was expected, *values* (m, 2), for each of *pairs*, shape (k, 2)."""
    features, landmarks = pairs
    off = seen.values[features] - values[landmarks]
    turned = off - _TURN * np.rint(off / _TURN)
    off[:, 0] = np.where(belief.walls[landmarks], turned[:, 0], off[:, 0])
    return off


class Correction(NamedTuple):
    """What k features tell of the state, in the coordinates in which they are independent and of the variance 1."""

    factor: Floats
    """Shape (2 k, 2 k): the Cholesky factor of the innovations' covariance."""
    off: Floats
    """Shape (2 k, 1): the innovations."""
    gain: Floats
    """Shape (2 k, n): their covariance with the state."""

    @property
    def chi_square(self) -> float:
        """The squared Mahalanobis distance of all innovations together."""
        return float((self.off * self.off).sum())


def correction(belief: Belief, seen: Measured, values: Floats, slopes: Floats, pairs: Pairs) -> Correction:
    """Return what *pairs* tell; *values* and *slopes* are as :func:`expected` has them."""
    features, landmarks = pairs
    count = len(features)
    columns = np.column_stack([np.tile([0, 1, 2], (count, 1)), 3 + 2 * landmarks, 4 + 2 * landmarks])
    of_pairs = slopes[landmarks]
    # (k, 5, n) by (k, 2, 5): the rows of H P
    spread = (of_pairs[:, :, :, np.newaxis] * belief.covariance[columns][:, np.newaxis]).sum(axis=2)
    spread = spread.reshape(2 * count, -1)
    own = spread[:, columns]
    within = (own[:, :, np.newaxis, :] * of_pairs[np.newaxis]).sum(axis=3).reshape(2 * count, 2 * count)
    rows = np.column_stack([2 * features, 2 * features + 1]).ravel()
    factor = cholesky(within + seen.covariance[np.ix_(rows, rows)])
    off = innovations(belief, seen, values, pairs).reshape(-1, 1)
    return Correction(factor, forward(factor, off), forward(factor, spread))


def corrected(belief: Belief, told: Correction, pairs: Pairs, update: int, first_estimates: bool = True) -> Belief:
    """Return *belief* with what was *told* by *pairs* in an *update*."""
    mean = belief.mean + gram(told.gain, told.off)[:, 0]
    mean[2] = math.remainder(float(mean[2]), _TURN)
    covariance = belief.covariance - gram(told.gain, told.gain)
    sightings, latest = belief.sightings.copy(), belief.latest.copy()
    sightings[pairs[1]] += 1  # once, though a wall may be seen in several pieces
    latest[pairs[1]] = update
    place = belief.place_m if first_estimates else (float(mean[0]), float(mean[1]))
    return replace(belief, mean=mean, covariance=covariance, place_m=place, sightings=sightings, latest=latest)


def grown(belief: Belief, seen: Measured, told: Correction | None, pairs: Pairs, new: Int64s, update: int) -> Belief:
    """Return *belief*, already corrected by what was *told*, with landmarks for the features *new* (q,).

    Their errors go with those of the features of *pairs*: what these have told of them is taken into account.
    """
    rows = np.column_stack([2 * new, 2 * new + 1]).ravel()
    errors = seen.covariance[np.ix_(rows, rows)]
    values, with_state = seen.values[new], np.zeros((len(belief.mean), len(rows)))
    if told is not None:
        used = np.column_stack([2 * pairs[0], 2 * pairs[0] + 1]).ravel()
        known = forward(told.factor, seen.covariance[np.ix_(used, rows)])
        errors = errors - gram(known, known)
        with_state = gram(told.gain, known)  # what errs is the estimate: too large a measurement makes it too large
        values = values - gram(known, told.off).reshape(-1, 2)
    landmarks, anchors, slopes = _placed(belief, seen.walls[new], values, seen.ends_m[new])
    by_pose, by_value = _block_rows(slopes[:, :, :3]), _block_diagonal(slopes[:, :, 3:])
    of_state = product(by_pose, belief.covariance[:3]) + product(by_value, with_state.T)
    mixed = product(product(by_pose, with_state[:3]), by_value.T)
    own = sandwich(by_pose, belief.covariance[:3, :3]) + sandwich(by_value, errors) + mixed + mixed.T
    ones = np.ones(len(new), np.int64)
    return Belief(
        mean=np.concatenate((belief.mean, landmarks.ravel())),
        covariance=np.block([[belief.covariance, of_state.T], [of_state, own]]),
        place_m=belief.place_m,
        first=np.concatenate((belief.first, landmarks)),
        walls=np.concatenate((belief.walls, seen.walls[new])),
        anchors_m=np.concatenate((belief.anchors_m, anchors)),
        reach_m=np.concatenate((belief.reach_m, np.zeros((len(new), 2)))),
        facing_rad=np.concatenate((belief.facing_rad, seen.facing_rad[new] + belief.mean[2])),
        sightings=np.concatenate((belief.sightings, ones)),
        latest=np.concatenate((belief.latest, ones * update)),
    )


def _placed(belief: Belief, walls: Bools, values: Floats, ends: Floats) -> tuple[Floats, Floats, Floats]:
    """Return landmarks (q, 2), anchors (q, 2) and derivatives (q, 2, 5) by the pose and the *values* (q, 2)."""
    x, y, heading = belief.mean[:3].tolist()
    before_x, before_y = belief.place_m
    cos, sin = elementary.cos(heading), elementary.sin(heading)
    landmarks, anchors, slopes = np.zeros_like(values), np.zeros_like(values), np.zeros((len(values), 2, 5))
    for k, (wall, (a, b)) in enumerate(zip(walls.tolist(), values.tolist(), strict=True)):
        if wall:
            middle_x, middle_y = (0.5 * (ends[k, 0] + ends[k, 1])).tolist()
            from_x, from_y = x + cos * middle_x - sin * middle_y, y + sin * middle_x + cos * middle_y
            alpha = math.remainder(a + heading, _TURN)
            n_x, n_y = elementary.cos(alpha), elementary.sin(alpha)
            landmarks[k] = alpha, b + n_x * (x - from_x) + n_y * (y - from_y)
            anchors[k] = from_x, from_y
            by_heading = n_x * (before_y - from_y) - n_y * (before_x - from_x)
            by_alpha = n_x * (y - from_y) - n_y * (x - from_x)
            slopes[k] = (0.0, 0.0, 1.0, 1.0, 0.0), (n_x, n_y, by_heading, by_alpha, 1.0)
        else:
            landmarks[k] = to_x, to_y = x + cos * a - sin * b, y + sin * a + cos * b
            slopes[k] = (1.0, 0.0, before_y - to_y, cos, -sin), (0.0, 1.0, to_x - before_x, sin, cos)
    return landmarks, anchors, slopes


def kept(belief: Belief, keep: Bools) -> Belief:
    """Return *belief* without the landmarks that are not to *keep* (m,)."""
    if keep.all():
        return belief
    rows = np.flatnonzero(np.concatenate(([True] * 3, np.repeat(keep, 2))))
    return Belief(
        belief.mean[rows],
        belief.covariance[np.ix_(rows, rows)],
        belief.place_m,
        belief.first[keep],
        belief.walls[keep],
        belief.anchors_m[keep],
        belief.reach_m[keep],
        belief.facing_rad[keep],
        belief.sightings[keep],
        belief.latest[keep],
    )


def widened(belief: Belief, seen: Measured, pairs: Pairs) -> Belief:
    """Return *belief* with the walls of *pairs* known to reach as far as they were *seen*."""
    reach = belief.reach_m.copy()
    for feature, landmark in zip(*(numbers.tolist() for numbers in pairs), strict=True):
        if belief.walls[landmark]:
            low, high = reaching(belief, seen.ends_m[feature], np.array([landmark]))[0].tolist()
            reach[landmark] = min(reach[landmark, 0], low), max(reach[landmark, 1], high)
    return replace(belief, reach_m=reach)


def reaching(belief: Belief, ends: Floats, walls: Int64s) -> Floats:
    """Return from where to where *ends* (2, 2) in the body's frame are along each of *walls* (w,), shape (w, 2)."""
    x, y, heading = belief.mean[:3].tolist()
    cos, sin = elementary.cos(heading), elementary.sin(heading)
    in_map = np.stack((x + cos * ends[:, 0] - sin * ends[:, 1], y + sin * ends[:, 0] + cos * ends[:, 1]), axis=1)
    alphas = belief.landmarks[walls, 0].tolist()
    along = np.array([(-elementary.sin(alpha), elementary.cos(alpha)) for alpha in alphas]).reshape(-1, 2)
    away = in_map[np.newaxis] - belief.anchors_m[walls, np.newaxis]
    return np.sort((away * along[:, np.newaxis]).sum(axis=2), axis=1)


# ---------------------------------------------------------------- which landmark a feature is


def associated(belief: Belief, seen: Measured, own: FeatureSlamParameters) -> tuple[Pairs, Int64s]:
    """Return the pairs that are compatible, each by itself and all together, and the features that are new."""
    values, slopes = expected(belief, own.first_estimates)
    columns = np.column_stack(
        [np.tile([0, 1, 2], (len(values), 1)), *(3 + 2 * np.arange(len(values)) + k for k in (0, 1))]
    )
    own_five = belief.covariance[columns[:, :, np.newaxis], columns[:, np.newaxis, :]]
    left = (slopes[:, :, :, np.newaxis] * own_five[:, np.newaxis]).sum(axis=2)
    spread = (left[:, :, np.newaxis, :] * slopes[:, np.newaxis]).sum(axis=3)
    found: dict[int, tuple[float, int]] = {}
    new: list[int] = []
    for feature in range(len(seen.values)):
        candidates = _alike(belief, seen, feature, own)
        off = innovations(belief, seen, values, (np.full(len(candidates), feature), candidates))
        two = slice(2 * feature, 2 * feature + 2)
        apart, unlikely = _distances(off, spread[candidates] + seen.covariance[two, two])
        close = apart < own.news
        if seen.walls[feature]:
            close[close] = _beside(belief, seen.ends_m[feature], candidates[close], own.beside_m)
        near = close & (apart < own.gate)
        if near.any():
            best = int(np.argmin(np.where(near, unlikely, np.inf)))
            found[feature] = float(unlikely[best]), int(candidates[best])
        elif not close.any() and not any(_same(seen, feature, other, own) for other in new):
            new.append(feature)
    features = _single(found, seen.walls)
    pairs = np.array(features, np.int64), np.array([found[feature][1] for feature in features], np.int64)
    return _jointly(belief, seen, values, slopes, pairs, own.joint), np.array(new, np.int64)


def _alike(belief: Belief, seen: Measured, feature: int, own: FeatureSlamParameters) -> Int64s:
    """Return the landmarks (c,) that are of the kind of a *feature*: walls, or corners that are open the same way."""
    if seen.walls[feature]:
        return np.flatnonzero(belief.walls)
    turn = seen.facing_rad[feature] + belief.mean[2] - belief.facing_rad
    return np.flatnonzero(~belief.walls & (np.abs(turn - _TURN * np.rint(turn / _TURN)) <= own.facing_rad))


def _beside(belief: Belief, ends: Floats, walls: Int64s, beside_m: float) -> Bools:
    """Return which of *walls* (w,) have been seen within *beside_m* of the *ends* (2, 2) of a piece of one."""
    along, reach = reaching(belief, ends, walls), belief.reach_m[walls]
    beside: Bools = np.maximum(along[:, 0] - reach[:, 1], reach[:, 0] - along[:, 1]) <= beside_m
    return beside


def _distances(off: Floats, covariance: Floats) -> tuple[Floats, Floats]:
    """Return squared Mahalanobis distances (k,) of *off* (k, 2), and the same with the logarithm of the determinant."""
    a, b, c = covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]
    whole = a * c - b * b
    apart = (c * off[:, 0] ** 2 - 2.0 * b * off[:, 0] * off[:, 1] + a * off[:, 1] ** 2) / whole
    return apart, apart + elementary.logs(whole)


def _same(seen: Measured, one: int, other: int, own: FeatureSlamParameters) -> bool:
    """Return whether two features of a scan may be one wall: the second is not to be another, it will be seen again."""
    if not (seen.walls[one] and seen.walls[other]):
        return False
    off = seen.values[one] - seen.values[other]
    first, second = (seen.covariance[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] for k in (one, other))
    return squared_distance(math.remainder(float(off[0]), _TURN), float(off[1]), first + second) < own.news


def _single(found: dict[int, tuple[float, int]], walls: Bools) -> list[int]:
    """Return the features to use: a wall may be seen in several pieces, a corner is the likeliest of its features."""
    best: dict[int, int] = {}
    for feature in sorted(found, key=lambda number: found[number]):
        best.setdefault(found[feature][1], feature)
    return [feature for feature in found if walls[feature] or best[found[feature][1]] == feature]


def _jointly(belief: Belief, seen: Measured, values: Floats, slopes: Floats, pairs: Pairs, deviations: float) -> Pairs:
    """Return those of *pairs* that are compatible together."""
    while len(pairs[0]) > 1:
        free = 2 * len(pairs[0])
        if correction(belief, seen, values, slopes, pairs).chi_square <= free + deviations * math.sqrt(2.0 * free):
            break
        fewer = [(np.delete(pairs[0], k), np.delete(pairs[1], k)) for k in range(len(pairs[0]))]
        pairs = min(fewer, key=lambda some: correction(belief, seen, values, slopes, some).chi_square)
    return pairs


# ---------------------------------------------------------------- the filter


class FeatureSlam:
    """The filter of one robot, which starts at *start*: that is certain, and given in the map's frame.

    *beams* (n, 2) are unit vectors in the frame of odometry, a ring in counter-clockwise order, as those of
    :class:`cosim.navigation.slam.Slam`. Nothing is drawn: the same observations give the same estimates.
    """

    def __init__(self, start: Pose, beams: Floats, parameters: FeatureSlamParameters | None = None) -> None:
        self._own = FeatureSlamParameters() if parameters is None else parameters
        self._beams: Floats = np.ascontiguousarray(beams, np.float64)
        self.belief = begun(start)
        """The state at the last update."""
        self.updates = 0
        """Number of updates of the filter."""
        self._way = Way()
        self._odometry: Pose | None = None  # at the last update
        self._ticks = 0  # since then

    @property
    def place_covariance(self) -> tuple[float, float, float]:
        """The covariance of the place at the last update: xx, xy and yy, m^2."""
        covariance = self.belief.covariance
        return float(covariance[0, 0]), float(covariance[0, 1]), float(covariance[1, 1])

    def observe(self, odometry: Pose, ranges_m: npt.ArrayLike) -> SlamEstimate:
        """Return the estimate after one more tick: *odometry* and the scan's *ranges_m* (n,) of now.

        A beam that meets nothing reads the range or more; NaN counts for nothing. The first call updates the filter; a
        later one does if the robot has moved far enough since the last update, or that is long ago.

        Raise ValueError if there are not as many ranges as beams.
        """
        ranges = np.ascontiguousarray(ranges_m, np.float64)
        if ranges.shape != (len(self._beams),):
            raise ValueError(f"the scan has the shape {ranges.shape}, but there are {len(self._beams)} beams")
        own = self._own
        before = odometry if self._odometry is None else self._odometry
        relative = carried((0.0, 0.0, 0.0), before, odometry)
        self._way = further(self._way, *relative, own.odometry_slip, own.odometry_turn_rad, own.odometry_way_m)
        self._ticks += 1
        if (
            self._odometry is None
            or math.hypot(relative[0], relative[1]) >= own.update_way_m
            or abs(relative[2]) >= own.update_turn_rad
            or self._ticks >= own.update_ticks
        ):
            scan = extract(ranges, turned_back(self._beams, odometry[2]), own.features)
            self.update(measured(scan, own.corner_m))
            self._odometry, self._ticks = odometry, 0
        return self._estimated()

    def update(self, seen: Measured) -> None:
        """Move the belief along the way so far, and correct it by what was *seen* at its end."""
        own = self._own
        belief = moved(self.belief, self._way)
        self._way = Way()
        pairs, new = associated(belief, seen, own)
        told = None
        if len(pairs[0]):
            told = correction(belief, seen, *expected(belief, own.first_estimates), pairs)
            belief = corrected(belief, told, pairs, self.updates, own.first_estimates)
        belief = widened(belief, seen, pairs)
        if len(new):
            count = len(belief.first)
            belief = grown(belief, seen, told, pairs, new, self.updates)
            belief = widened(belief, seen, (new, count + np.arange(len(new))))
        self.belief = kept(belief, self._worth(belief))
        self.updates += 1

    def _worth(self, belief: Belief) -> Bools:
        """Return which landmarks (m,) are worth keeping."""
        own = self._own
        known = belief.sightings >= own.least_sightings
        worth = known | (self.updates - belief.latest < own.lone_updates)
        if worth.sum() > own.most_landmarks:
            order = np.lexsort((belief.sightings, belief.latest, worth))
            worth[order[: len(order) - own.most_landmarks]] = False
        return worth

    def _estimated(self) -> SlamEstimate:
        belief = moved(self.belief, self._way) if self._ticks else self.belief
        (x, y, heading), covariance = belief.mean[:3].tolist(), belief.covariance
        spread = math.sqrt(float(covariance[0, 0] + covariance[1, 1]))
        return SlamEstimate(x, y, heading, spread, math.sqrt(float(covariance[2, 2])))


# ---------------------------------------------------------------- products in a stated order


def gram(left: Floats, right: Floats) -> Floats:
    """Return the product of *left* (k, m), transposed, and *right* (k, n)."""
    return product(left.T, right)


def product(left: Floats, right: Floats) -> Floats:
    """Return the product of *left* (m, k) and *right* (k, n); without a BLAS, whose last bits differ."""
    return _product(np.ascontiguousarray(left), np.ascontiguousarray(right))


@njit(cache=True)
def _product(left: Floats, right: Floats) -> Floats:
    out = np.zeros((left.shape[0], right.shape[1]))
    for i in range(left.shape[0]):
        for k in range(left.shape[1]):
            of_left = left[i, k]
            if of_left != 0.0:
                for j in range(right.shape[1]):
                    out[i, j] += of_left * right[k, j]
    return out


@njit(cache=True)
def cholesky(matrix: Floats) -> Floats:
    """Return the lower triangle L (n, n) of a positive definite *matrix* = L L^T."""
    count = matrix.shape[0]
    lower = np.zeros((count, count))
    for i in range(count):
        for j in range(i + 1):
            rest = matrix[i, j]
            for k in range(j):
                rest -= lower[i, k] * lower[j, k]
            lower[i, j] = math.sqrt(rest) if i == j else rest / lower[j, j]
    return lower


@njit(cache=True)
def forward(lower: Floats, right: Floats) -> Floats:
    """Return the solution (n, m) of L X = *right* (n, m), L a *lower* triangle (n, n)."""
    out = right.copy()
    for i in range(lower.shape[0]):
        for k in range(i):
            for j in range(out.shape[1]):
                out[i, j] -= lower[i, k] * out[k, j]
        for j in range(out.shape[1]):
            out[i, j] /= lower[i, i]
    return out


def _block_rows(blocks: Floats) -> Floats:
    """Return *blocks* (q, 2, n) one below another."""
    return np.ascontiguousarray(blocks.reshape(-1, blocks.shape[2]))


def _block_diagonal(blocks: Floats) -> Floats:
    """Return *blocks* (q, 2, 2) along the diagonal."""
    out = np.zeros((2 * len(blocks), 2 * len(blocks)))
    for k, block in enumerate(blocks):
        out[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = block
    return out
