"""Which frontier each robot of a team goes to, by what it costs to come there.

- :func:`by_utility`: W. Burgard, M. Moors, C. Stachniss and F. E. Schneider, "Coordinated multi-robot exploration",
  IEEE Trans. Robotics 21(3), 2005: again and again the robot and frontier with the greatest utility less cost are taken
  out, and the utility of frontiers near by falls. Costs count in shares of the greatest one that is finite.
- :func:`by_assignment`: the assignment of the least sum of costs (Kuhn, 1955; Jonker and Volgenant, 1987).
"""

import math

import numpy as np
from scipy.optimize import linear_sum_assignment

from cosim.arrays import Bools, Floats


def by_utility(costs: Floats, places: Floats, reach: float, weight: float) -> list[int | None]:
    """Return to which frontier each robot goes, None where no way leads to any.

    *costs* (robots, frontiers), inf where no way leads; *places* (frontiers, 2) as *reach*, the scanner's range.
    Utilities begin at 1. One falls by max(0, 1 - away / reach) when a frontier so far away is taken: the chance that
    it is seen from there. Source: Burgard et al., 2005, Algorithm 1.
    """
    can: Bools = np.isfinite(costs)
    share = np.where(can, costs, 0.0) / max(float(costs[can].max(initial=0.0)), 1.0)
    utility, left = np.ones(costs.shape[1]), np.asarray(can.any(axis=1))
    chosen: list[int | None] = [None] * len(costs)
    while left.any():
        gain = np.where(can & left[:, None], utility - weight * share, -math.inf)
        row, frontier = divmod(int(gain.argmax()), costs.shape[1])
        chosen[row] = frontier
        left[row] = False
        away = np.hypot(*(places - places[frontier]).T)
        utility = utility - np.clip(1.0 - away / reach, 0.0, None)
    return chosen


def by_assignment(costs: Floats) -> list[int | None]:
    """Return to which frontier each robot goes, each to another: of the most that can go, those of the least sum.

    *costs* (robots, frontiers), inf where no way leads; None for a robot that is left over.
    """
    can: Bools = np.isfinite(costs)
    forbidden = 2.0 * len(costs) * (float(costs[can].max(initial=0.0)) + 1.0)
    chosen: list[int | None] = [None] * len(costs)
    for row, frontier in zip(*linear_sum_assignment(np.where(can, costs, forbidden)), strict=True):
        if can[row, frontier]:
            chosen[row] = int(frontier)
    return chosen
