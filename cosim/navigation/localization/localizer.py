"""Monte Carlo localisation: where a robot is on a known map, from odometry and range scans.

The filter of Nav2's AMCL (Thrun, Burgard and Fox, "Probabilistic Robotics", 2005, chapters 4 and 8): particles move as
odometry says, each with its own errors (:mod:`cosim.navigation.localization.motion`); the scan weighs them
(:mod:`cosim.navigation.localization.likelihood`); they are resampled by weight, as many as their spread needs, some of
them at random places if scans fit worse than they used to (:mod:`cosim.navigation.localization.resampling`). Nothing of
it happens before the robot has moved far enough; the estimate goes on by odometry alone until then.

Defaults are Nav2's, but for those of aggregation, alphas and recovery, which were chosen on real maps
(:class:`LocalizationParameters`). Where the filter differs:

- resampling. Nav2 draws each particle by itself until KLD sampling has enough (a comb "can't easily" be stopped): that
  is "independent" here. "low_variance" counts the bins among as many survivors as there may be, then draws as many as
  these bins need. Poses that are injected do not count as bins yet.
- the averages of recovery. Nav2 averages sum(w p) / n, where w is already 1 / n: the number of particles moves it. And
  p depends on how many beams hit something. Here it is the weighted mean over the particles of a beam's mean p^3, or of
  its geometric mean p. Nav2 forgets both averages after each injection, and so injects next to nothing: an option here.
- the estimate is the weighted mean of the heaviest cluster after the scan, before resampling adds noise to it. The
  spread of headings takes that cluster's own weight as 1 (Nav2 does not).
- the least way of an update is the distance, in Nav2 the greater of its two coordinates.
"""

import math
from typing import Final, Literal, NamedTuple, Self

import numpy as np
import numpy.typing as npt
from pydantic import Field, model_validator

import cosim.elementary as elementary
from cosim.arrays import Bools, Floats, Int64s
from cosim.navigation.localization.likelihood import (
    KnownMap,
    beam_scores,
    field_addends,
    field_scores,
    random_poses,
)
from cosim.navigation.localization.motion import (
    CHANCE,
    PICK,
    Pose,
    fill_uniform,
    mean_pose,
    move_particles,
    odometry_motion,
    place_covariance,
    scatter_particles,
    turned_back,
)
from cosim.navigation.localization.resampling import (
    Recovery,
    clusters,
    independent,
    kld_size,
    low_variance,
    pose_bins,
)
from cosim.randomness import Draws
from cosim.settings import Angle, Count, Gain, Metres, Rate, Settings, error_at

_TURN: Final = 2.0 * math.pi
_NO_ENDS: Final = np.empty((0, 2))


MOST_PARTICLES = 1_000_000


class LocalizationParameters(Settings):
    """Parameters of the filter; defaults of Nav2's AMCL (nav2_params.yaml, amcl_node.cpp) if not said otherwise.

    The alphas are what the filter reckons with, more than the true noise: it must not lose a robot that slips. But
    Nav2's 0.2 stand for 45 % of each way and turn. With them, and the cubes, a robot whose odometry errs by 3 % was
    0.3 m off in a fifth of all ticks on the map of a depot; with 0.05, that is 22 %, and the product, in none. Nav2
    does not recover by default: with these rates and tries all of 100 kidnapped robots were within 0.3 m again after
    60 s on a map of 2400 m^2, with neighbouring values 97 to 99, with a quarter of the tries 88.
    """

    model: Literal["likelihood_field", "beam"] = Field(
        default="likelihood_field", description="how a scan is compared with the map"
    )
    aggregation: Literal["cubes", "product"] = Field(
        default="product", description="how beams are put together: 1 + sum of p^3 (Nav2's), or the product of p"
    )
    product_power: float = Field(
        default=0.3,
        gt=0,
        le=1,
        description="power of the product: as how many independent ones a beam counts (not Nav2's)",
    )
    range_m: Metres = Field(default=8.0, gt=0, description="m, how far a beam reaches (not Nav2's: it asks the laser)")
    max_beams: Count = Field(default=60, ge=2, description="about so many beams of a scan are used, evenly spaced")
    z_hit: float = Field(default=0.5, gt=0, le=1, description="weight of a hit where the map has an obstacle")
    z_rand: float = Field(default=0.5, ge=0, le=1, description="weight of a reading of any length")
    z_max: float = Field(default=0.05, ge=0, le=1, description="weight of a missed obstacle (beam model)")
    z_short: float = Field(default=0.05, ge=0, le=1, description="weight of what is not on the map (beam model)")
    sigma_hit_m: Metres = Field(default=0.2, gt=0, description="m, standard deviation of a hit")
    lambda_short_per_m: Rate = Field(default=0.1, gt=0, description="1/m, rate of short readings (beam model)")
    max_distance_m: Metres = Field(default=2.0, gt=0, description="m; farther from an obstacle an end fits no worse")
    least_particles: Count = Field(default=500, ge=1, le=MOST_PARTICLES, description="particles at least")
    most_particles: Count = Field(default=2000, ge=1, le=MOST_PARTICLES, description="particles at most")
    kld_error: Gain = Field(default=0.05, gt=0, description="greatest Kullback-Leibler distance to the posterior")
    kld_z: Gain = Field(default=0.99, ge=0, description="its normal quantile; not the probability that it looks like")
    bin_m: Metres = Field(default=0.5, gt=0, description="m, side of a bin of poses")
    bin_headings: int = Field(default=36, ge=3, le=720, description="sectors of the circle that headings are binned to")
    alpha1: Gain = Field(default=0.05, ge=0, description="variance of a turn, per square of the turn")
    alpha2: Gain = Field(default=0.05, ge=0, description="variance of a turn, rad^2 per square metre of way")
    alpha3: Gain = Field(default=0.05, ge=0, description="variance of a way, per square of the way")
    alpha4: Gain = Field(default=0.05, ge=0, description="variance of a way, square metres per square of a turn")
    update_way_m: Metres = Field(default=0.25, ge=0, description="m of way after which the filter is updated")
    update_turn_rad: Angle = Field(default=0.2, ge=0, description="rad of turn after which the filter is updated")
    resampling: Literal["low_variance", "independent"] = Field(
        default="low_variance", description="how survivors are drawn; Nav2's way is independent"
    )
    resample_interval: Count = Field(default=1, ge=1, description="updates from one resampling to the next")
    recovery_slow: float = Field(
        default=0.01, ge=0, le=1, description="rate of the slow average of the fit; 0, Nav2's: no recovery"
    )
    recovery_fast: float = Field(
        default=0.1, ge=0, le=1, description="rate of the fast average of the fit; 0, Nav2's: no recovery"
    )
    recovery_forgets: bool = Field(default=False, description="whether an injection restarts both averages; Nav2's do")
    recovery_tries: Count = Field(
        default=20_000,
        ge=0,
        description="random poses tried at an update for those injected, which fit best (not Nav2's)",
    )

    @model_validator(mode="after")
    def _numbers_agree(self) -> Self:
        if self.least_particles > self.most_particles:
            raise error_at(
                ("least_particles",), self.least_particles, f"is not <= {self.most_particles}, most_particles"
            )
        if self.recovery_slow > self.recovery_fast or (self.recovery_fast > 0.0) != (self.recovery_slow > 0.0):
            expected = f"is not > 0 and <= {self.recovery_fast}, recovery_fast, nor are both 0"
            raise error_at(("recovery_slow",), self.recovery_slow, expected)
        return self


class Estimate(NamedTuple):
    """Where a robot takes itself to be on the map."""

    x_m: float
    y_m: float
    heading_rad: float
    share: float
    """Share of all weight in the heaviest cluster: the others are places where the robot might be, too."""
    spread_m: float
    """Root of the cluster's mean squared distance from (x, y)."""
    spread_rad: float
    """Circular standard deviation of its headings."""


def beam_stride(beams: int, max_beams: int) -> int:
    """Return the step from one used beam to the next; by Nav2's formula up to nearly twice *max_beams* are used."""
    return max((beams - 1) // (max_beams - 1), 1)


class Localizer:
    """The filter of one robot.

    *beams* (n, 2) are unit vectors: in the robot's frame F_i, that of its odometry, as
    :func:`cosim.navigation.schemas.beam_directions` has them, or in its body's. *draws* is its own stream: the same
    draws and the same observations give the same estimates.
    """

    def __init__(
        self,
        known: KnownMap,
        beams: Floats,
        draws: Draws,
        parameters: LocalizationParameters | None = None,
        beams_in: Literal["frame", "body"] = "frame",
    ) -> None:
        own = LocalizationParameters() if parameters is None else parameters
        self._own, self._known, self._key = own, known, draws.key
        self._cubes = own.aggregation == "cubes"
        self._stride = beam_stride(len(beams), own.max_beams)
        self._beams: Floats = np.ascontiguousarray(beams[:: self._stride], np.float64)
        self._turns = beams_in == "frame"
        self._frame = known.frame
        self._addends = field_addends(
            known.distance_m, own.z_hit, own.z_rand, own.sigma_hit_m, own.range_m, own.max_distance_m, self._cubes
        )
        self._alphas: Floats = np.array([own.alpha1, own.alpha2, own.alpha3, own.alpha4])
        self._model: Floats = np.array(
            [own.z_hit, own.z_short, own.z_max, own.z_rand, own.sigma_hit_m, own.lambda_short_per_m, own.range_m]
        )
        self.recovery = Recovery(own.recovery_slow, own.recovery_fast)
        """Averages of how well scans have fitted."""
        self.updates = 0
        """Number of updates of the filter."""
        self.injected = 0
        """Number of random poses that recovery has injected."""
        self.poses: Floats = np.empty((own.most_particles, 3))
        """Shape (n, 3): x_m, y_m, heading_rad of each particle."""
        self.weights: Floats = np.empty(own.most_particles)
        """Shape (n,); their sum is 1."""
        self._odometry: Pose | None = None  # at the last update
        self._step = 0  # of all draws
        self.start_anywhere()

    def start_at(self, pose: Pose, spread_m: float = 0.5, spread_rad: float = math.pi / 12.0) -> None:
        """Set all particles to normal ones about *pose*; the default spread (per axis) is Nav2's."""
        self._begin()
        scatter_particles(self.poses, *pose, np.array([spread_m, spread_rad]), self._step, *self._key)
        self._mean = self._estimated()

    def start_anywhere(self) -> None:
        """Set all particles to random poses where a robot can stand."""
        self._begin()
        self._place(self.poses, 1, _NO_ENDS)
        self._mean = self._estimated()

    def observe(self, odometry: Pose, ranges_m: npt.ArrayLike) -> Estimate:
        """Return the estimate after one more tick: *odometry* and the scan's *ranges_m* (n,) of now.

        A beam that meets nothing reads the range or more; one that reads NaN counts for nothing. The first call updates
        the filter, a later one does if the robot has moved far enough since the last update.
        """
        before = odometry if self._odometry is None else self._odometry
        motion = odometry_motion(before, odometry)
        turn = abs(math.remainder(odometry[2] - before[2], _TURN))
        if self._odometry is not None and motion.way_m < self._own.update_way_m and turn < self._own.update_turn_rad:
            return self._carried(before, odometry)
        self._odometry = odometry
        self._step += 1
        self.updates += 1
        if before is not odometry:
            move_particles(self.poses, *motion, self._alphas, self._step, *self._key)
        ranges, beams = self._readings(np.asarray(ranges_m, np.float64), odometry[2])
        hit = ranges < self._own.range_m
        ends = ranges[hit, np.newaxis] * beams[hit]
        if self._own.model == "beam":
            self._weigh(self._beam_scores(ranges, beams), len(ranges))
        else:
            scores = np.empty(len(self.poses))
            field_scores(self.poses, ends, self._addends, self._frame, scores)
            self._weigh(scores, len(ends))
        self._mean = self._estimated()
        if self.updates % self._own.resample_interval == 0:
            self._resample(ends)
        return self._mean

    def covariance(self) -> tuple[float, float, float]:
        """Return the covariance of the places in the heaviest cluster as the particles are now: xx, xy and yy, m^2."""
        members, share = self._heaviest()
        return place_covariance(self.poses[members], self.weights[members] / share)

    def _begin(self) -> None:
        """Make as many particles as there may be, of equal weights, and forget what was observed."""
        count = self._own.most_particles
        self.poses, self.weights = np.empty((count, 3)), np.full(count, 1.0 / count)
        self._odometry = None
        self.recovery.restart()
        self._step += 1

    def _carried(self, before: Pose, now: Pose) -> Estimate:
        """Return the last estimate, moved as odometry has since then."""
        mean = self._mean
        turned = mean.heading_rad - before[2]
        cos, sin = elementary.cos(turned), elementary.sin(turned)
        dx, dy = now[0] - before[0], now[1] - before[1]
        heading = math.remainder(now[2] + turned, _TURN)
        return mean._replace(
            x_m=mean.x_m + cos * dx - sin * dy, y_m=mean.y_m + sin * dx + cos * dy, heading_rad=heading
        )

    def _readings(self, ranges: Floats, heading: float) -> tuple[Floats, Floats]:
        """Return the ranges (m,), at most the laser's, and the beams (m, 2) in the body's frame that count."""
        ranges = ranges[:: self._stride]
        if len(ranges) != len(self._beams):
            raise ValueError(f"{len(ranges)} of the scan's ranges are used, but {len(self._beams)} of the beams")
        beams = self._beams
        if self._turns:
            beams = turned_back(beams, heading)
        known = ~np.isnan(ranges)
        return np.minimum(ranges[known], self._own.range_m), np.ascontiguousarray(beams[known])

    def _beam_scores(self, ranges: Floats, beams: Floats) -> Floats:
        scores = np.empty(len(self.poses))
        known = self._known
        beam_scores(
            self.poses, ranges, beams, known.occupied, known.distance_m, self._frame, self._model, self._cubes, scores
        )
        return scores

    def _weigh(self, scores: Floats, beams: int) -> None:
        """Multiply the weights by the likelihoods that *scores* (n,) stand for, and note how well the scan fits."""
        if not beams:
            return
        if self._cubes:
            factors, fits = 1.0 + scores, scores / beams
        else:
            factors = elementary.exps(self._own.product_power * (scores - scores.max()))
            fits = elementary.exps(scores / beams)
        self.recovery.note(float((self.weights * fits).sum()))
        self.weights *= factors
        total = self.weights.sum()
        if total > 0.0:
            self.weights /= total
        else:  # all that had weights fit so badly that nothing is left of them
            self.weights[:] = 1.0 / len(self.weights)

    def _estimated(self) -> Estimate:
        """Return mean and spread of the heaviest cluster."""
        members, share = self._heaviest()
        poses, weights = self.poses[members], self.weights[members] / share
        x, y, cos, sin, spread = mean_pose(poses, weights)
        length = min(max(math.hypot(cos, sin), 1e-300), 1.0)
        return Estimate(
            float(x), float(y), elementary.atan2(sin, cos), share, spread, math.sqrt(-2.0 * elementary.log(length))
        )

    def _heaviest(self) -> tuple[Bools, float]:
        """Return which particles are in the heaviest cluster, and their share of all weight."""
        own = self._own
        label = clusters(pose_bins(self.poses, own.bin_m, own.bin_headings), own.bin_headings)
        shares = np.bincount(label, self.weights)
        heaviest = int(np.argmax(shares))
        return label == heaviest, float(shares[heaviest])

    def _resample(self, ends: Floats) -> None:
        """Resample the particles by weight, and replace some by random poses if scans fit worse than they used to."""
        probability = self.recovery.probability
        chosen = self._survivors()
        uniform = np.empty(len(chosen))
        fill_uniform(uniform, self._step, CHANCE, *self._key)
        replaced = uniform < probability
        self.poses = self.poses[chosen]
        self.weights = np.full(len(chosen), 1.0 / len(chosen))
        count = int(np.count_nonzero(replaced))
        if count:
            poses = np.empty((count, 3))
            self._place(poses, max(self._own.recovery_tries // count, 1), ends)
            self.poses[replaced] = poses
            self.injected += count
        if probability > 0.0 and self._own.recovery_forgets:
            self.recovery.restart()

    def _survivors(self) -> Int64s:
        """Return the particles that survive, as many as KLD sampling needs."""
        own = self._own
        bins = pose_bins(self.poses, own.bin_m, own.bin_headings)
        uniform = np.empty(2 if own.resampling == "low_variance" else own.most_particles)
        fill_uniform(uniform, self._step, PICK, *self._key)
        if own.resampling == "low_variance":
            most = low_variance(self.weights, own.most_particles, float(uniform[0]))
            size = kld_size(len(np.unique(bins[most])), own.kld_error, own.kld_z)
            count = int(np.clip(size, own.least_particles, own.most_particles))
            return np.asarray(low_variance(self.weights, count, float(uniform[1])), np.int64)
        drawn = independent(self.weights, uniform)
        return drawn[: enough(bins[drawn], own)]

    def _place(self, poses: Floats, tries: int, ends: Floats) -> None:
        """Set *poses* (n, 3) to random ones, each the best of so many *tries*."""
        nx = self._known.occupied.shape[1]
        random_poses(poses, tries, self._known.standing, nx, self._frame, ends, self._addends, self._step, *self._key)


def enough(bins: Int64s, parameters: LocalizationParameters) -> int:
    """Return how many of the particles drawn, in *bins* (n,), KLD sampling takes: it stops as soon as it has enough."""
    _, first = np.unique(bins, return_index=True)
    new = np.zeros(len(bins), np.int64)
    new[first] = 1
    size = kld_size(np.cumsum(new), parameters.kld_error, parameters.kld_z)
    limit = np.clip(size, parameters.least_particles, parameters.most_particles)
    reached = np.flatnonzero(np.arange(1, len(bins) + 1) >= limit)
    return int(reached[0]) + 1 if len(reached) else len(bins)
