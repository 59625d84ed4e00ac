"""Simultaneous localisation and mapping: a robot's map and its place on it, from odometry and range scans alone.

Rao-Blackwellised particles with scan matching: Grisetti, Stachniss and Burgard, "Improved techniques for grid mapping
with Rao-Blackwellized particle filters", IEEE T-RO 23(1), 2007. Each particle is a pose and a map of its own. It moves
as odometry says, with its own errors (:mod:`cosim.navigation.localization.motion`, or tick by tick those of
:mod:`cosim.navigation.odometry`), is pulled to where the scan fits its map best, weighed by how well that is, and marks
the scan into its map (:mod:`cosim.geometry.marking`). Particles are resampled by weight when the effective sample size
1 / sum w^2 falls below a share of their number (eq. 20).

The spread of the particles is the robot's uncertainty. A robot is to slow down or stop where it exceeds a threshold
(Lau, paper 001, section 5 and figure 5): :func:`share_of_speed`. Where a scan meets nothing, particles keep the errors
that they were moved with; back on known ground each finds its place on its map again.

Scan matching finds where a scan fits best on the map that a particle has made itself, and how well. A scan's ends are
compared with a field about the particle. A cell at the distance d (centre to centre) of the nearest occupied cell of
the map has

    log p = -d^2 / 2 sigma^2,  but no less than log(stray);

between centres of cells it is interpolated, so that poses are told apart within a cell. Where a wall is in its cell is
not known so: where walls are on the edges of cells, the map and all poses on it move by up to half a cell. With ``hit:
mean`` each cell keeps the mean of the hits that fell in it, as GMapping's do, and d is how far an end is from the mean
that is nearest to the centre of the end's cell; nothing is interpolated.

Ends that lie in the unknown, far from all that is known, are left out: what a scan has just found must not pull it back
to what is known. They are determined once for each scan, where odometry puts the particle; each counts log(news) for
the particle's weight.

The beams of a scan err together, as the map does: each counts only as *power* of an independent one. What is climbed is

    power sum(log p) - (dx^2 + dy^2) / 2 slack_m^2 - dheading^2 / 2 slack_rad^2,

with the offsets from where odometry puts the particle. Source of the climbing, six neighbours and steps that are halved
when none is better: GMapping (Grisetti, Stachniss and Burgard, IEEE T-RO 23(1), 2007, and their scanmatcher.cpp), where
the tie to odometry is off.

Where it differs from the paper and GMapping:

- the pose is the best that climbing finds from a pose drawn by the motion model, as in GMapping's program. The paper
  draws it from a normal distribution about the best (eq. 14 to 19).
- ties of a particle to odometry are parameters, wider than odometry's errors of one step: few particles must be able
  to take back what they have gone astray in many.
- maps are whole grids of int8, copied when a particle is drawn twice; GMapping shares patches.
- a robot that rests is updated, too, after some ticks (GMapping's temporalUpdate): so that waiting may help.

The spread is smaller than the error. Beams of a scan err together, and as those before them that met the same walls.
Taken for independent they make one particle by far the heaviest; soon all descend from it, and what it has gone astray
is in all of their maps. A lower *power* and more particles help: on a loop through two rooms the error was 2.5 times
the spread with 0.1 and 10, 0.6 times with 0.03 and 30; on longer drives through an office of 20 m x 16 m, 3 and 1.5
times. But a lower power makes the filter slower to know its place again, and with 0.01 it was lost in one of three
drives. With matches scattered by the curvature of their fit (as by eq. 14 to 19) it was lost in both of two.
"""

import math
from typing import Final, Literal, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt
from pydantic import Field

import cosim.elementary as elementary
from cosim.arrays import Bytes, Floats, Int32s, Singles
from cosim.geometry.marking import DOUBTFUL, Evidence, Weights, add_hits, mark_scan, most_changes
from cosim.jit import njit
from cosim.navigation.localization.motion import (
    PICK,
    Pose,
    fill_uniform,
    mean_pose,
    move_particles,
    odometry_motion,
    place_covariance,
    turned_back,
    wrapped,
)
from cosim.navigation.localization.resampling import low_variance
from cosim.navigation.odometry import drift_particles
from cosim.randomness import Draws
from cosim.settings import Angle, Count, Gain, Metres, Settings

Corner: TypeAlias = tuple[int, int]
Match: TypeAlias = tuple[float, float, float, float]
"""x_m, y_m, heading_rad and what was climbed."""

NUMBERS: Final = 8
POWER, SLACK_M, SLACK_RAD, STEP_M, STEP_RAD, STRAY, NEWS, SIGMA_M = range(NUMBERS)
"""Numbers of a search: power, the two slacks, the first steps (m, rad), log(stray) and log(news), and sigma_m."""

_MOST_MOVES: Final = 60
"""Largest number of steps of a climb."""
_NOTHING: Final = np.float32(1.0)
"""Value of a field's cell that is unknown and far from all known ones: a logarithm of p is never above 0."""
_TURN: Final = 2.0 * math.pi
_NO_BODIES: Final = np.empty((0, 3))


class SlamParameters(Settings):
    """Parameters of the filter. GMapping's are those of its ROS node (slam_gmapping), made for lasers of 80 m.

    By the alphas the filter reckons with 5 % of each way and turn: over 0.25 m at 0.3 m/s that is twice the heading's
    errors here and eight times those of the way. By senses it reckons with the errors of
    :mod:`cosim.navigation.odometry`, which the robots' senses make; three of them have the same names there.
    """

    particles: int = Field(default=10, ge=1, le=200, description="particles (GMapping 30)")
    range_m: Metres = Field(default=2.5, gt=0, description="m, how far a beam reaches")
    max_beams: Count = Field(default=90, ge=2, description="at most so many beams of a scan are matched, evenly spaced")
    hit: Literal["centre", "mean"] = Field(
        default="centre",
        description="where the wall is in an occupied cell: its centre, or the mean of the cell's hits",
    )
    sigma_m: Metres = Field(default=0.1, gt=0, description="m, standard deviation of a hit from there (GMapping 0.05)")
    stray: float = Field(default=0.05, gt=0, lt=1, description="p of an end in the open, where that on a wall is 1")
    news: float = Field(default=0.5, gt=0, le=1, description="p of an end in the unknown, where that on a wall is 1")
    power: float = Field(
        default=0.1, gt=0, le=1, description="as how many independent ones a beam counts (GMapping 1 / 3 particles)"
    )
    slack_m: Metres = Field(default=0.1, gt=0, description="m, standard deviation of how far a scan pulls a particle")
    slack_rad: Angle = Field(default=0.1, gt=0, description="rad, the same of its heading")
    step_m: Metres = Field(default=0.05, gt=0, description="m, first step of the climbing (GMapping 0.05)")
    step_rad: Angle = Field(default=0.05, gt=0, description="rad, first turn of the climbing (GMapping 0.05)")
    matching: bool = Field(default=True, description="whether scans pull particles; without they are only weighed")
    odometry: Literal["alphas", "senses"] = Field(
        default="alphas", description="errors of odometry that are assumed: normal, of an update; or the senses' own"
    )
    odometry_slip: float = Field(default=0.03, ge=0, lt=1, description="senses: share by which a tick's way is wrong")
    odometry_turn_rad: Angle = Field(
        default=0.03, ge=0, description="senses: rad, by which a tick's way of one metre turns the heading wrongly"
    )
    odometry_way_m: Metres | None = Field(
        default=None, gt=0, description="senses: m, a tick's way at which odometry errs so; null: at any"
    )
    alpha1: Gain = Field(default=0.0025, ge=0, description="variance of a turn, per square of the turn")
    alpha2: Gain = Field(default=0.0025, ge=0, description="variance of a turn, rad^2 per square metre of way")
    alpha3: Gain = Field(default=0.0025, ge=0, description="variance of a way, per square of the way")
    alpha4: Gain = Field(default=0.0025, ge=0, description="variance of a way, square metres per square of a turn")
    update_way_m: Metres = Field(default=0.25, ge=0, description="m of way after which the filter is updated")
    update_turn_rad: Angle = Field(default=0.2, ge=0, description="rad of turn after which the filter is updated")
    update_ticks: Count = Field(default=10, ge=1, description="observations after which it is updated in any case")
    resample_below: float = Field(
        default=0.5, ge=0, le=1, description="effective share of the particles below which they are drawn anew"
    )


class SlamEstimate(NamedTuple):
    """Where a robot takes itself to be, and how sure it is of that."""

    x_m: float
    y_m: float
    heading_rad: float
    spread_m: float
    """Root of the mean squared distance from (x, y): of the particles, or by the covariance."""
    spread_rad: float
    """Circular standard deviation of the heading."""


def share_of_speed(spread_m: float, slow_m: float, stop_m: float) -> float:
    """Return the share of its speed that a robot may drive with: 1 up to a spread *slow_m*, 0 from *stop_m* on.

    Between them it falls linearly (our reading of Lau, section 5: speed that maintains accuracy, and a threshold).
    Raise ValueError if not 0 <= slow_m < stop_m.
    """
    if not 0.0 <= slow_m < stop_m:
        raise ValueError(f"slow_m {slow_m} is not from 0 to below stop_m {stop_m}")
    return min(max((stop_m - spread_m) / (stop_m - slow_m), 0.0), 1.0)


class MapGrid(NamedTuple):
    """The cells of a map, with their lower left corner at *origin_m*."""

    shape: tuple[int, int]
    """Rows and columns, (ny, nx)."""
    origin_m: tuple[float, float]
    cell_m: float


class Slam:
    """The filter of one robot.

    All maps have the cells of *grid*; the robot starts at *start*, which is certain and given in the map's frame.
    *beams* (n, 2) are unit vectors in the frame of odometry or the body's, as those of
    :class:`cosim.navigation.localization.localizer.Localizer`. *draws* is its own stream: the same draws and
    observations give the same estimates and maps.
    """

    def __init__(
        self,
        grid: MapGrid,
        start: Pose,
        beams: Floats,
        draws: Draws,
        parameters: SlamParameters | None = None,
        beams_in: Literal["frame", "body"] = "frame",
        weights: Weights = DOUBTFUL,
    ) -> None:
        own = SlamParameters() if parameters is None else parameters
        shape, origin_m, cell_m = grid
        self._own, self._key = own, draws.key
        self._beams: Floats = np.ascontiguousarray(beams, np.float64)
        self._turns = beams_in == "frame"
        self._frame = np.array([*origin_m, cell_m])
        self._marks = weights.hit, weights.miss, weights.cap
        self._alphas = np.array([own.alpha1, own.alpha2, own.alpha3, own.alpha4])
        self._errors = np.array([own.odometry_slip, own.odometry_turn_rad, own.odometry_way_m or 0.0])
        # a scan that only weighs is one that cannot pull
        slacks = (own.slack_m, own.slack_rad) if own.matching else (1e-9, 1e-9)
        logs = elementary.log(own.stray), elementary.log(own.news)
        self._numbers = np.array([own.power, *slacks, own.step_m, own.step_rad, *logs, own.sigma_m])
        self._stamp = stamp_of(own.sigma_m, own.stray, cell_m)
        size = field_size(own.range_m, own.slack_m, cell_m)
        means = own.hit == "mean"
        self._field = np.empty((size, size), np.float32)
        self._nearest = np.empty((size, size, 2), np.float32) if means else None
        self._frontier = np.zeros((shape[0], (shape[1] + 7) // 8 * 8), np.uint8)
        self._changed = np.empty(most_changes(own.range_m, cell_m), np.int32)
        self.maps: Evidence = np.zeros((own.particles, *shape), np.int8)
        """Shape (n, ny, nx): each particle's evidence, as :mod:`cosim.geometry.marking` has it."""
        self.hits: Singles | None = np.zeros((own.particles, *shape, 3), np.float32) if means else None
        """Shape (n, ny, nx, 3), if means are kept: each particle's :func:`cosim.geometry.marking.add_hits`."""
        self.poses: Floats = np.tile(np.array(start, np.float64), (own.particles, 1))
        """Shape (n, 3): x_m, y_m, heading_rad of each particle at the last update."""
        self.weights: Floats = np.full(own.particles, 1.0 / own.particles)
        """Shape (n,); their sum is 1."""
        self.updates = 0
        """Number of updates of the filter."""
        self.resamplings = 0
        """Number of resamplings."""
        self._odometry: Pose | None = None  # at the last update
        self._ticks = 0  # since then
        self._told: Pose | None = None  # odometry at the last tick
        self._drifts = 0  # ticks for which particles have drifted
        self._mean = self._estimated()

    @property
    def heaviest(self) -> int:
        """The particle of the greatest weight: its map is the robot's."""
        return int(np.argmax(self.weights))

    @property
    def effective(self) -> float:
        """The effective sample size, from 1 to the number of particles."""
        return float(1.0 / (self.weights * self.weights).sum())

    @property
    def place_covariance(self) -> tuple[float, float, float]:
        """The covariance of the particles' places at the last update: xx, xy and yy, m^2."""
        return place_covariance(self.poses, self.weights)

    def observe(self, odometry: Pose, ranges_m: npt.ArrayLike) -> SlamEstimate:
        """Return the estimate after one more tick: *odometry* and the scan's *ranges_m* (n,) of now.

        A beam that meets nothing reads the range or more; one that reads NaN (or has met another robot, and is made so
        by the caller) counts for nothing. The first call updates the filter; a later one does if the robot has moved
        far enough since the last update, or that is long ago.

        Raise ValueError if there are not as many ranges as beams.
        """
        ranges = np.ascontiguousarray(ranges_m, np.float64)
        if ranges.shape != (len(self._beams),):
            raise ValueError(f"the scan has the shape {ranges.shape}, but there are {len(self._beams)} beams")
        self._drift(odometry)
        before = odometry if self._odometry is None else self._odometry
        motion = odometry_motion(before, odometry)
        turn = abs(math.remainder(odometry[2] - before[2], _TURN))
        self._ticks += 1
        own = self._own
        if (
            self._odometry is not None
            and motion.way_m < own.update_way_m
            and turn < own.update_turn_rad
            and self._ticks < own.update_ticks
        ):
            x, y, heading = carried(self._mean[:3], before, odometry)
            return self._mean._replace(x_m=x, y_m=y, heading_rad=heading)
        if own.odometry == "alphas":
            move_particles(self.poses, *motion, self._alphas, self.updates, *self._key)
        self._update(ranges, self._turned(odometry[2]))
        self._odometry, self._ticks = odometry, 0
        return self._mean

    def _drift(self, odometry: Pose) -> None:
        """Move the particles by a tick if they err as the senses do, tick by tick."""
        if self._own.odometry == "senses" and self._told is not None:
            drift_particles(self.poses, self._told, odometry, self._errors, self._drifts, *self._key)
            self._drifts += 1
        self._told = odometry

    def _update(self, ranges: Floats, beams: Floats) -> None:
        """Match, weigh, estimate, mark and resample; *beams* (n, 2) are in the body's frame."""
        own = self._own
        hit = np.flatnonzero(ranges < own.range_m)
        hit = hit[hit % -(-len(ranges) // own.max_beams) == 0]
        if self.updates and len(hit):
            scores = np.empty(own.particles)
            ends = ranges[hit, np.newaxis] * beams[hit]
            frame, numbers = self._frame, self._numbers
            fields = self._field, self._nearest
            match_particles(self.maps, self.hits, self.poses, ends, frame, self._stamp, numbers, *fields, scores)
            self.weights *= elementary.exps(scores - scores.max())
            self.weights /= self.weights.sum()
        self._mean = self._estimated()
        if self.updates and self.effective < own.resample_below * own.particles:
            self._resample()
        scratch, marks = (self._frontier, self._changed), self._marks
        mark_particles(
            self.maps, self.hits, self.poses, ranges, beams, own.range_m, self._frame, marks, *scratch, _NO_BODIES
        )
        self.updates += 1

    def _turned(self, heading: float) -> Floats:
        """Return the beams (n, 2) in the body's frame."""
        if not self._turns:
            return self._beams
        return turned_back(self._beams, heading)

    def _estimated(self) -> SlamEstimate:
        poses, weights = self.poses, self.weights
        x, y, cos, sin, spread = mean_pose(poses, weights)
        length = min(max(math.hypot(cos, sin), 1e-300), 1.0)
        return SlamEstimate(
            float(x), float(y), elementary.atan2(sin, cos), spread, math.sqrt(-2.0 * elementary.log(length))
        )

    def _resample(self) -> None:
        """Resample the particles by weight; survivors keep their places, and only copies are copied."""
        uniform = np.empty(1)
        fill_uniform(uniform, self.updates, PICK, *self._key)
        chosen = low_variance(self.weights, len(self.weights), float(uniform[0]))
        counts = np.bincount(chosen, minlength=len(self.weights))
        spare = np.repeat(np.arange(len(counts)), np.maximum(counts - 1, 0))
        free = np.flatnonzero(counts == 0)
        self.poses[free] = self.poses[spare]
        self.maps[free] = self.maps[spare]
        if self.hits is not None:
            self.hits[free] = self.hits[spare]
        self.weights[:] = 1.0 / len(self.weights)
        self.resamplings += 1


def carried(pose: Pose, before: Pose, now: Pose) -> Pose:
    """Return *pose* moved as odometry has been from *before* to *now*."""
    turned = pose[2] - before[2]
    cos, sin = elementary.cos(turned), elementary.sin(turned)
    dx, dy = now[0] - before[0], now[1] - before[1]
    return pose[0] + cos * dx - sin * dy, pose[1] + sin * dx + cos * dy, math.remainder(now[2] + turned, _TURN)


# ---------------------------------------------------------------- scan matching


def stamp_of(sigma_m: float, stray: float, cell_m: float) -> Singles:
    """Return log p about an occupied cell, square, of an odd size: as far as it is more than log(*stray*)."""
    reach = max(int(sigma_m * math.sqrt(-2.0 * elementary.log(stray)) / cell_m), 1)
    off = np.arange(-reach, reach + 1) * cell_m
    squares = off[:, np.newaxis] ** 2 + off**2
    return np.asarray(np.maximum(-squares / (2.0 * sigma_m * sigma_m), elementary.log(stray)), np.float32)


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
    cos, sin = elementary.cos(heading), elementary.sin(heading)
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
    cos, sin = elementary.cos(heading), elementary.sin(heading)
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
def find_nearest(evidence: Evidence, hits: Singles, left: int, low: int, reach: int, nearest: Singles) -> None:
    """Set *nearest* (n, n, 2) to the mean of hits that is nearest to the centre of each cell, in cells of the field.

    It is infinite where none is in the cells up to *reach* away. The field's first cell is (left, low) of the map.
    *hits* (ny, nx, 3) are the sums of :func:`cosim.geometry.marking.add_hits`; cells that are not occupied count for
    nothing.
    """
    ny, nx = evidence.shape
    n = nearest.shape[0]
    nearest[:] = np.inf
    for iy in range(max(low - reach, 0), min(low + n + reach, ny)):
        for ix in range(max(left - reach, 0), min(left + n + reach, nx)):
            if evidence[iy, ix] <= 0:
                continue
            u = ix - left + 0.5 + hits[iy, ix, 0] / hits[iy, ix, 2]
            v = iy - low + 0.5 + hits[iy, ix, 1] / hits[iy, ix, 2]
            for j in range(max(iy - reach - low, 0), min(iy + reach + 1 - low, n)):
                for i in range(max(ix - reach - left, 0), min(ix + reach + 1 - left, n)):
                    here = (u - i - 0.5) ** 2 + (v - j - 0.5) ** 2
                    if here < (nearest[j, i, 0] - i - 0.5) ** 2 + (nearest[j, i, 1] - j - 0.5) ** 2:
                        nearest[j, i, 0], nearest[j, i, 1] = u, v


@njit(cache=True)
def means_fit(
    nearest: Singles, u: float, v: float, heading: float, ends: Floats, count: int, sigma: float, stray: float
) -> float:
    """Return the sum of log p over the first *count* of *ends* (m, 2), seen from a pose; all in cells of *nearest*.

    *nearest* (n, n, 2) are the means of :func:`find_nearest`, *sigma* is in cells, *stray* a logarithm.
    """
    most = nearest.shape[0] - 0.001
    per_square = 0.5 / (sigma * sigma)
    cos, sin = elementary.cos(heading), elementary.sin(heading)
    total = 0.0
    for k in range(count):
        across = min(max(u + cos * ends[k, 0] - sin * ends[k, 1], 0.0), most)
        up = min(max(v + sin * ends[k, 0] + cos * ends[k, 1], 0.0), most)
        i, j = int(across), int(up)
        du, dv = across - nearest[j, i, 0], up - nearest[j, i, 1]
        total += max(-per_square * (du * du + dv * dv), stray)
    return total


@njit(cache=True)
def _fit(
    field: Singles,
    nearest: Singles | None,
    u: float,
    v: float,
    heading: float,
    ends: Floats,
    count: int,
    cell_m: float,
    numbers: Floats,
) -> float:
    """Return what :func:`means_fit` does if there are means, else what :func:`field_fit` does."""
    if nearest is None:  # numba knows that when it compiles
        return field_fit(field, u, v, heading, ends, count)
    return means_fit(nearest, u, v, heading, ends, count, numbers[SIGMA_M] / cell_m, numbers[STRAY])


@njit(cache=True)
def climb(
    field: Singles,
    nearest: Singles | None,
    u: float,
    v: float,
    heading: float,
    ends: Floats,
    count: int,
    cell_m: float,
    numbers: Floats,
) -> Match:
    """Return the pose near (u, v, heading) from which *ends* fit best, in cells of *field*, and its value.

    They are to fit the means *nearest* (n, n, 2) of :func:`find_nearest` if there are, else *field* (n, n).
    The steps begin with STEP_M and STEP_RAD of *numbers* (NUMBERS,) and are halved five times (GMapping's iterations).
    """
    per_u, per_turn = 0.5 * (cell_m / numbers[SLACK_M]) ** 2, 0.5 / numbers[SLACK_RAD] ** 2
    step, turn, power = numbers[STEP_M] / cell_m, numbers[STEP_RAD], numbers[POWER]
    at_u, at_v, at_turn = 0.0, 0.0, 0.0
    best = power * _fit(field, nearest, u, v, heading, ends, count, cell_m, numbers)
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
                to = u + try_u, v + try_v, heading + try_turn
                value += power * _fit(field, nearest, *to, ends, count, cell_m, numbers)
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
    hits: Singles | None,
    poses: Floats,
    ends: Floats,
    frame: Floats,
    stamp: Singles,
    numbers: Floats,
    field: Singles,
    nearest: Singles | None,
    scores: Floats,
) -> None:
    """Pull each of *poses* (n, 3) to where the scan's *ends* (m, 2; metres, body's frame) fit its map, of *maps*.

    *maps* has the shape (n, ny, nx), *hits* (n, ny, nx, 3), *frame* is x_m and y_m of their lower left corner and
    cell_m, *field* and *nearest* (.., 2) are scratch of ``field_size``. Without *hits* and *nearest* the centres of
    cells are matched. *scores* (n,) are set to what was climbed, with what the ends count that were left out.
    """
    cell = frame[2]
    in_cells = ends / cell
    chosen = np.empty_like(in_cells)
    reach = int(numbers[SIGMA_M] * math.sqrt(-2.0 * numbers[STRAY]) / cell) + 1  # from a cell's rim to another's
    for i in range(poses.shape[0]):
        u, v = (poses[i, 0] - frame[0]) / cell, (poses[i, 1] - frame[1]) / cell
        left, low = make_field(maps[i], u, v, stamp, numbers[STRAY], field)
        count = choose_ends(field, u - left, v - low, poses[i, 2], in_cells, chosen)
        settle_field(field, numbers[STRAY])
        if hits is not None and nearest is not None:
            find_nearest(maps[i], hits[i], left, low, reach, nearest)
        near = u - left, v - low, poses[i, 2]
        to_u, to_v, heading, score = climb(field, nearest, *near, chosen, count, cell, numbers)
        poses[i, 0], poses[i, 1] = frame[0] + (to_u + left) * cell, frame[1] + (to_v + low) * cell
        poses[i, 2] = wrapped(heading)
        scores[i] = score + numbers[POWER] * numbers[NEWS] * (ends.shape[0] - count)


@njit(cache=True)
def mark_particles(
    maps: Evidence,
    hits: Singles | None,
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

    Its hits are added to *hits* (n, ny, nx, 3), if there are.
    *frontier* and *changed* are scratch of :func:`cosim.geometry.marking.mark_scan`: no frontier is kept.
    """
    ways = np.empty_like(beams)
    hit, miss, cap = weights
    for i in range(poses.shape[0]):
        cos, sin = elementary.cos(poses[i, 2]), elementary.sin(poses[i, 2])
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
        if hits is not None:
            add_hits(hits[i], frame[0], frame[1], frame[2], poses[i, 0], poses[i, 1], ranges_m, ways, range_m)
