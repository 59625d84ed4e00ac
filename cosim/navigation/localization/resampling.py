"""Resampling: how many particles, which survive, when some are replaced, and where most of their weight lies.

KLD sampling (Fox, "KLD-sampling: adaptive particle filters", NIPS 2001; Probabilistic Robotics, section 8.3.4): with k
bins of the space of poses occupied,

    n = (k - 1) / (2 error) (1 - 2 / (9 (k - 1)) + z sqrt(2 / (9 (k - 1))))^3

particles keep the Kullback-Leibler distance to the true posterior below the error, with the probability of which z is
the standard normal quantile. Nav2's pf_z is documented like that probability, and 0.99 its default, but is used as z,
as if 84 % were asked for; 99 % is z = 2.326. Player's 3 is a quantile. k <= 1 asks for as many as there may be.

Augmented recovery (Probabilistic Robotics, table 8.3): two running averages of how well the scans fit, a slow and a
fast one; a particle is replaced by a random pose with the probability max(0, 1 - fast / slow).
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
import scipy.sparse.csgraph

from cosim.arrays import Floats, Int64s
from cosim.jit import njit

_TURN: Final = 2.0 * np.pi
_MIDDLE: Final = 1 << 20  # bins of -2^20 to 2^20 - 1 each way have a key of their own
_ROW: Final = 1 << 21
_HEADINGS: Final = 1 << 10


def kld_size(bins: npt.ArrayLike, error: float, z: float) -> Floats:
    """Return the number of particles that so many occupied *bins* need, whole numbers; inf for one bin or none."""
    k = np.asarray(bins, np.float64) - 1.0
    part = 2.0 / (9.0 * np.maximum(k, 1.0))
    root = 1.0 - part + z * np.sqrt(part)
    size = np.ceil(k / (2.0 * error) * (root * root * root))
    return np.asarray(np.where(k > 0.0, size, np.inf), np.float64)


def pose_bins(poses: Floats, bin_m: float, headings: int) -> Int64s:
    """Return the bin (n,) of each of *poses* (n, 3), cut into squares of *bin_m* and *headings* sectors of the circle.

    Unlike in Player and Nav2 a heading and the same one after a full turn share a bin.
    """
    across = np.floor(poses[:, 0] / bin_m).astype(np.int64) + _MIDDLE
    up = np.floor(poses[:, 1] / bin_m).astype(np.int64) + _MIDDLE
    sector = np.floor(poses[:, 2] * (headings / _TURN)).astype(np.int64) % headings
    return (up * _ROW + across) * _HEADINGS + sector


def clusters(bins: Int64s, headings: int) -> Int64s:
    """Return the number of its cluster (n,) for each particle: *bins* that touch, if only by a corner, are one."""
    keys, member = np.unique(bins, return_inverse=True)
    sector = keys % _HEADINGS
    ends = []
    for step in (-1, 0, 1):
        turned = keys - sector + (sector + step) % headings
        for up, across in ((0, 0), (0, 1), (1, -1), (1, 0), (1, 1)):
            wanted = turned + (up * _ROW + across) * _HEADINGS
            at = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
            here = np.flatnonzero(keys[at] == wanted)
            ends.append(np.stack((here, at[here])))
    pairs = np.concatenate(ends, axis=1)
    graph = scipy.sparse.coo_array((np.ones(pairs.shape[1], np.int8), pairs), shape=(len(keys), len(keys)))
    _, label = scipy.sparse.csgraph.connected_components(graph, directed=False)
    return np.asarray(label[member], np.int64)


@njit(cache=True)
def low_variance(weights: Floats, count: int, offset: float) -> Int64s:
    """Return which particles (count,) survive: one for each tooth (m + offset) / count of a comb over the *weights*.

    *offset* is one uniform number in [0, 1). A share w of the weights survives w count times, rounded up or down.
    Source: Probabilistic Robotics, table 4.4.
    """
    chosen = np.empty(count, np.int64)
    total, last = weights.sum(), weights.shape[0] - 1
    i, reached = 0, weights[0]
    for m in range(count):
        tooth = (m + offset) * total / count
        while reached <= tooth and i < last:
            i += 1
            reached += weights[i]
        chosen[m] = i
    return chosen


def independent(weights: Floats, uniform: Floats) -> Int64s:
    """Return which particles survive if each is drawn by itself, by a number of *uniform* (count,) in [0, 1)."""
    reached = np.cumsum(weights)
    at = np.searchsorted(reached, uniform * reached[-1], side="right")
    return np.asarray(np.minimum(at, len(weights) - 1), np.int64)


@dataclass
class Recovery:
    """The two running averages of augmented recovery; with both rates 0 nothing is ever injected.

    The first 1 / rate of what an average takes in count alike: a start that happens to fit too well is soon forgotten.
    In Nav2 both begin with the first fit, and the slow one keeps it for 1 / rate updates, in which the filter may seem
    lost; in the book with 0, and for as long nothing is injected.
    """

    slow_rate: float
    fast_rate: float
    slow: float = 0.0
    fast: float = 0.0
    noted: int = 0
    """Number of scans in the averages."""

    def note(self, fit: float) -> None:
        """Take in how well a scan fits, a number > 0."""
        self.noted += 1
        self.slow += max(self.slow_rate, 1.0 / self.noted) * (fit - self.slow)
        self.fast += max(self.fast_rate, 1.0 / self.noted) * (fit - self.fast)

    @property
    def probability(self) -> float:
        """With which a particle is replaced by a random pose."""
        return max(0.0, 1.0 - self.fast / self.slow) if self.noted else 0.0

    def restart(self) -> None:
        """Forget all fits."""
        self.slow, self.fast, self.noted = 0.0, 0.0, 0
