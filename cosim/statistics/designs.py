"""Designs: which combinations of settings a sweep tries, as points of the unit cube that are mapped to the settings.

- Latin hypercube: of n points each n-th of every axis has one (McKay and others, Technometrics 21, 1979).
- Sobol's sequence, scrambled: 2^m points that fill the cube more evenly (Owen, J. Complexity 14, 1998).
- Saltelli's sample, from which Sobol's indices are estimated: for each of n points A of Sobol's sequence, with another
  one B: the points A, A with one coordinate of B for each axis, B; n (d + 2) in all (Saltelli and others, Computer
  Physics Communications 181, 2010).
- Morris's trajectories: n ways of d steps from a random point of a grid of four levels, each step two thirds along
  another axis: n (d + 1) points (Morris, Technometrics 33, 1991).

Points depend on the seed, the kind, their number and that of the axes only.
"""

import math
from typing import Final, NamedTuple

import numpy as np

from cosim.arrays import Floats
from cosim.elementary import exp, log
from cosim.randomness import Streams

LEVELS: Final = 4
"""Levels of the grid that Morris's trajectories are on."""
STEP: Final = LEVELS / (2 * (LEVELS - 1))
"""Length of a step of theirs."""
SAMPLED: Final = ("latin hypercube", "sobol", "saltelli", "morris")
"""Designs that are drawn."""
BALANCED: Final = ("sobol", "saltelli")
"""Those whose number of points is a power of two."""
DIGITS: Final = 6
"""Significant digits of what is drawn."""


class Span(NamedTuple):
    """What an axis goes from and to, both included."""

    low: float
    high: float
    log: bool
    """True if the logarithm is drawn evenly."""
    whole: bool
    """True if whole numbers are drawn, each as often."""

    def at(self, place: float) -> float | int:
        """Return the value at *place*, of [0, 1]."""
        low, high = self.low, self.high + 1 if self.whole else self.high
        value = exp(log(low) + place * (log(high) - log(low))) if self.log else low + place * (high - low)
        # the levels of a grid fall on the bounds of whole numbers, but for their last bit
        drawn = math.floor(round(value, 9)) if self.whole else float(f"{value:.{DIGITS}g}")
        return min(max(drawn, self.low), self.high)


def is_balanced(count: int) -> bool:
    """Return whether *count* is a power of two."""
    return count > 0 and count & (count - 1) == 0


def points(kind: str, count: int, axes: int, seed: int) -> Floats:
    """Return the points of the design *kind*, one of ``SAMPLED``, a row each (rows, axes), all in [0, 1]."""
    rng = Streams(seed)("design", kind, count, axes)
    if kind == "morris":
        return _trajectories(count, axes, rng)
    from scipy.stats import qmc

    if kind == "latin hypercube":
        drawn: Floats = qmc.LatinHypercube(axes, rng=rng).random(count)
    elif kind == "sobol":
        drawn = qmc.Sobol(axes, rng=rng).random(count)
    else:
        drawn = _crossed(qmc.Sobol(2 * axes, rng=rng).random(count))
    return drawn


def _crossed(both: Floats) -> Floats:
    """Return Saltelli's points of *both*, (n, 2 axes) with A in the first half of the columns and B in the other."""
    axes = both.shape[1] // 2
    first, second = both[:, :axes], both[:, axes:]
    rows = np.repeat(first[:, None, :], axes + 2, axis=1)
    for axis in range(axes):
        rows[:, 1 + axis, axis] = second[:, axis]
    rows[:, -1, :] = second
    return rows.reshape(-1, axes)


def _trajectories(count: int, axes: int, rng: np.random.Generator) -> Floats:
    rows = np.empty((count, axes + 1, axes))
    for trajectory in rows:
        trajectory[:] = rng.integers(LEVELS, size=axes) / (LEVELS - 1)
        for step, axis in enumerate(rng.permutation(axes), start=1):
            trajectory[step:, axis] += STEP if trajectory[0, axis] < 0.5 else -STEP
    return np.clip(rows, 0.0, 1.0).reshape(-1, axes)
