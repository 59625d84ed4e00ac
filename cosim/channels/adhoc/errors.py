"""Probability that the bits of an 802.11 frame arrive right, given the ratio of its power to noise and interference.

SINR is a plain ratio s, within the bandwidth of the receiver. All interference counts as white noise. The models are
those of ns-3 (DsssErrorRateModel, NistErrorRateModel), from Pei and Henderson, "Validation of ns-3 802.11b PHY model",
2009, and "Validation of OFDM error rate model in ns-3", 2010.

Direct sequence, noise within 22 MHz, g = Eb/N0:

    1 Mb/s    DBPSK   g = 22 s    a bit is wrong with probability exp(-g) / 2
    2 Mb/s    DQPSK   g = 11 s    (sqrt 2 + 1) / sqrt(8 pi sqrt 2) exp(-(2 - sqrt 2) g) / sqrt g
    5.5, 11   CCK     each 4 bits are one of 16 signals, two of which are opposites, the others orthogonal; right with
                      the integral over x > -b of (2 Phi(x + b) - 1)^7 phi(x), b^2 = 16 s (5.5 Mb/s) and 8 s (11 Mb/s)

OFDM, noise within 20 MHz, s = Es/N0: a bit before decoding is wrong with probability

    p = c erfc(sqrt(s / d))    BPSK 1/2, 1    QPSK 1/2, 2    16-QAM 3/8, 10    64-QAM 7/24, 42

and the bit after it, from the convolutional code of constraint length 7, with at most

    1 / (2 k) times the sum of B_j D^j,    D = sqrt(4 p (1 - p))

where B_j counts the wrong bits of all wrong paths at distance j that leave the right one within a period of k bits
(Frenger et al., "Multi-rate convolutional codes", 1998). This is for hard decisions; receivers with soft decisions need
2 to 3 dB less.

No bit is wrong with a probability above 1/2, whatever an approximation gives. Bits (with CCK groups of four) fail
independently, so parts of a frame multiply, and logarithms add.
"""

import math
from collections.abc import Iterable, Sequence
from functools import cache
from typing import Final

import numpy as np

import cosim.elementary as elementary
from cosim.arrays import Floats
from cosim.channels.adhoc.phy import HOPPING, Phy, sections
from cosim.jit import njit
from cosim.units import Time

_COIN: Final = -0.6931471805599453
"""Logarithm of the probability that a guessed bit is right."""


# ---------------------------------------------------------------- direct sequence

_DQPSK: Final = (math.sqrt(2.0) + 1.0) / math.sqrt(8.0 * math.pi * math.sqrt(2.0))


@njit(cache=True, borrows=True)
def _dbpsk(sinr: float) -> float:
    return elementary.log1p(-0.5 * elementary.exp(-22.0 * sinr))


@njit(cache=True, borrows=True)
def _dqpsk(sinr: float) -> float:
    g = 11.0 * sinr
    return elementary.log1p(-min(0.5, _DQPSK * elementary.exp(-(2.0 - math.sqrt(2.0)) * g) / math.sqrt(g)))


_STEPS: Final = 8
"""Entries of the table for each unit of b."""
_HIGHEST: Final = 24
"""Value of b above which errors are neglected: 1e-64."""


_GAUSS: Final = (
    (0.09501250983763744, 0.18945061045506864),
    (0.2816035507792589, 0.18260341504492364),
    (0.45801677765722737, 0.16915651939500265),
    (0.6178762444026438, 0.1495959888165767),
    (0.755404408355003, 0.12462897125553407),
    (0.8656312023878318, 0.0951585116824926),
    (0.9445750230732326, 0.062253523938647456),
    (0.9894009349916499, 0.027152459411754176),
)
"""Nodes > 0 and weights of the Gauss-Legendre rule of 16 points on [-1, 1] (Abramowitz and Stegun, table 25.4)."""


@cache  # when it is first asked for: few networks have such rates
def cck_table() -> Floats:
    """Return the logarithms of the probability that a group of four bits is wrong, for b from -1/8 on.

    In the integral y = x + b > 0; its complement to 1 is integrated instead, in which nothing cancels.
    """
    return _cck_table(np.arange(-1, _HIGHEST * _STEPS + 2) / _STEPS)


@njit(cache=True)
def _cck_table(bs: Floats) -> Floats:
    table = np.empty(len(bs))
    for row, b in enumerate(bs):
        reach = 0.5 * abs(b) + 10.0
        integral = 0.0
        for eighth in range(8):  # of the range
            for node, weight in _GAUSS:
                for side in (-1.0, 1.0):
                    y = reach * (eighth + 0.5 + 0.5 * side * node) / 8.0
                    wrong = -elementary.expm1(7.0 * elementary.log1p(-elementary.erfc(y * math.sqrt(0.5))))
                    integral += weight * wrong * elementary.exp(-0.5 * (y - b) * (y - b))
        integral *= reach / (16.0 * math.sqrt(2.0 * math.pi))
        table[row] = elementary.log(integral + 0.5 * elementary.erfc(b * math.sqrt(0.5)))
    return table


@njit(cache=True, borrows=True)
def _cck(gain: float, sinr: float, table: Floats) -> float:
    """Return a quarter of the logarithm for four bits, b^2 = *gain* *sinr*; a cubic through the nearest entries."""
    b = math.sqrt(gain * sinr)
    if b >= _HIGHEST:
        return 0.0
    x = b * _STEPS
    at = int(x)
    t = x - at
    before, low, high, after = table[at], table[at + 1], table[at + 2], table[at + 3]
    outer = t * (t - 1.0) * ((t + 1.0) * after - (t - 2.0) * before) / 6.0
    inner = (t + 1.0) * (t - 2.0) * ((t - 1.0) * low - t * high) / 2.0
    return 0.25 * elementary.log1p(-elementary.exp(outer + inner))


# ---------------------------------------------------------------- OFDM


# the sums of the convolutional code with generators 133 and 171 (octal), IEEE 802.11-2007, 17.3.5.5, by puncturing: B_j
# from the nearest wrong path on
_HALF: Final = (36.0, 211.0, 1404.0, 11633.0, 77433.0, 502690.0, 3322763.0, 21292910.0, 134365911.0, 0.0)
_TWO_THIRDS: Final = (3.0, 70.0, 285.0, 1276.0, 6160.0, 27128.0, 117019.0, 498860.0, 2103891.0, 8784123.0)
_THREE_QUARTERS: Final = (
    42.0,
    201.0,
    1492.0,
    10469.0,
    62935.0,
    379644.0,
    2253373.0,
    13073811.0,
    75152755.0,
    428005675.0,
)


@njit(cache=True, borrows=True)
def _coded(share: float, scale: float, code: tuple[float, int, int, tuple[float, ...]], sinr: float) -> float:
    """Return the logarithm for a bit that is wrong with the probability p before decoding, of *share* and *scale*.

    *code*: the period k in bits of its puncturing, the distance of the nearest wrong path, the step from one distance
    to the next, and B_j.
    """
    period, distance, step, wrong = code
    p = share * elementary.erfc(math.sqrt(sinr / scale))
    d = math.sqrt(4.0 * p * (1.0 - p))
    x = d if step == 1 else d * d
    total = 0.0
    for at in range(len(wrong) - 1, -1, -1):
        total = total * x + wrong[at]
    for _ in range(distance):
        total *= d
    return elementary.log1p(-min(0.5, total / (2.0 * period)))


# ---------------------------------------------------------------- bits, chunks, frames

CCK_KBPS: Final = (5500, 11000)
"""Rates with complementary code keying."""
_RATES_KBPS: Final = (1000, 2000, *CCK_KBPS, 6000, 9000, 12000, 18000, 24000, 36000, 48000, 54000)


@njit(cache=True, borrows=True)
def log_bit(rate_kbps: int, sinr: float, table: Floats) -> float:
    """Return the natural logarithm of the probability that a bit at *rate_kbps* is right, at a ratio *sinr*.

    *table* is :func:`cck_table` at the rates of CCK, and anything at others. A kernel for kernels.
    """
    if sinr <= 0.0:
        return _COIN
    if rate_kbps == 1000:
        return _dbpsk(sinr)
    if rate_kbps == 2000:
        return _dqpsk(sinr)
    if rate_kbps == 5500 or rate_kbps == 11000:
        return _cck(16.0 if rate_kbps == 5500 else 8.0, sinr, table)
    if rate_kbps == 48000:
        return _coded(7 / 24, 42.0, (2.0, 6, 1, _TWO_THIRDS), sinr)
    if rate_kbps == 6000 or rate_kbps == 9000:
        share, scale = 1 / 2, 1.0
    elif rate_kbps == 12000 or rate_kbps == 18000:
        share, scale = 1 / 2, 2.0
    elif rate_kbps == 24000 or rate_kbps == 36000:
        share, scale = 3 / 8, 10.0
    else:
        share, scale = 7 / 24, 42.0
    halves = rate_kbps == 6000 or rate_kbps == 12000 or rate_kbps == 24000
    return _coded(share, scale, (1.0, 10, 2, _HALF) if halves else (3.0, 5, 1, _THREE_QUARTERS), sinr)


def tables(rates_kbps: Iterable[int]) -> Floats:
    """Return the table that :func:`log_bit` needs at *rates_kbps*: empty without CCK, as it takes a while."""
    return cck_table() if any(rate in CCK_KBPS for rate in rates_kbps) else np.empty(0)


def log_success(rate_kbps: int, sinr: float, bits: float) -> float:
    """Return the natural logarithm of the probability that *bits*, also fractions, sent at *rate_kbps* are all right.

    *sinr* is a ratio, 0 or more, the same for all of them: where it changes, add up. Never below -0.7 a bit. Raise
    ValueError if there is no model for the rate.
    """
    if rate_kbps not in _RATES_KBPS:
        raise ValueError(f"there is no model of bit errors at {rate_kbps} kb/s")
    return bits * float(log_bit(rate_kbps, float(sinr), tables((rate_kbps,))))


def packet_success(rate_kbps: int, sinr: float, bits: float) -> float:
    """Return the probability that *bits* sent at *rate_kbps* are all right; as :func:`log_success`."""
    return elementary.exp(log_success(rate_kbps, sinr, bits))


def bit_error_rate(rate_kbps: int, sinr: float) -> float:
    """Return the bit error rate after decoding of independent errors that would lose as many frames."""
    return -elementary.expm1(log_success(rate_kbps, sinr, 1.0))


def frame_log_success(phy: Phy, rate_kbps: int, octets: int, levels: Sequence[tuple[Time, float]]) -> float:
    """Return the natural logarithm of the probability that header and payload of a frame of *octets* are right.

    *levels* are instants in ns since the beginning of the frame, rising, the first not above 0, and the SINR from each
    of them to the next. Raise ValueError if the PHY has no such rate, or hops: there is no model for that.
    """
    if phy.plcp == HOPPING:
        raise ValueError(f"there is no model of bit errors for {phy.name}")
    total = 0.0
    for begin, end, section_kbps, bits in sections(phy, rate_kbps, octets):
        for number, (since, sinr) in enumerate(levels):
            until = levels[number + 1][0] if number + 1 < len(levels) else end
            overlap = min(until, end) - max(since, begin)
            if overlap > 0:
                total += log_success(section_kbps, sinr, bits * overlap / (end - begin))
    return total
