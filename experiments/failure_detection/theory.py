"""Chen, Toueg and Aguilera's theorem on NFD-S on a channel that loses and delays each heartbeat by itself.

With a period eta, freshness points delta after a heartbeat is sent, losses with probability p and a delay D:

    p_j(x) = p + (1 - p) P(D > delta + x - j eta)       m_{i+j} has not come x after the freshness point of m_i
    u(x) = prod p_j(x), j = 0 .. ceil(delta / eta)      nor has any other that counts
    p_s = (1 - p) P(D < delta + eta) u(0)               a mistake begins there: m_{i-1} came in time

    E(T_MR) = eta / p_s    E(T_M) = integral of u over a period / p_s    P_A = 1 - that integral / eta

("On the quality of service of failure detectors", IEEE Transactions on Computers 51(5), 2002.) D is exponential here,
as in the paper's simulations.
"""

import math
from itertools import pairwise
from typing import NamedTuple

from scipy.integrate import quad

TAILS = 15.0
"""Number of mean delays after which the rest of the tail counts as nothing (3e-7)."""


class Theory(NamedTuple):
    """The metrics of NFD-S; inf and NaN where there are no mistakes."""

    recurrence_s: float
    """E(T_MR)"""
    mistake_s: float
    """E(T_M)"""
    accuracy: float
    """P_A"""


def nfd_s(shift_s: float, period_s: float, loss: float, mean_delay_s: float) -> Theory:
    """Return the metrics for delta = *shift_s*, eta = *period_s*, p = *loss* and exponential delays."""
    last = math.ceil(shift_s / period_s)

    def late(x_s: float) -> float:
        return math.exp(-max(x_s, 0.0) / mean_delay_s)

    def u(x_s: float) -> float:
        return math.prod(loss + (1.0 - loss) * late(shift_s + x_s - j * period_s) for j in range(last + 1))

    kinks = [j * period_s - shift_s for j in range(last + 1)]
    ends = {0.0, period_s, *kinks, *(kink + TAILS * mean_delay_s for kink in kinks)}
    ends |= {TAILS * mean_delay_s}  # the tail of m_i begins before the freshness point
    pieces = pairwise(sorted(end for end in ends if 0.0 <= end <= period_s))
    distrust_s = sum(quad(u, low, high)[0] for low, high in pieces)
    begins = (1.0 - loss) * (1.0 - late(shift_s + period_s)) * u(0.0)
    return Theory(period_s / begins, distrust_s / begins, 1.0 - distrust_s / period_s)
