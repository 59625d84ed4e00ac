"""Elementary functions whose last bit is the same everywhere: what decides anything takes them from here.

A C library's exp, log, pow, sin, cos, atan2 and erfc, and NumPy's, differ in the last bit by version and by what the
processor can do (fused multiplication and addition, wide vectors). These kernels are + - * / and sqrt of IEEE 754 in a
stated order, which are rounded alike everywhere, and exact operations (powers of 2 by their bits, floor, fmod,
copysign). numba neither reorders nor fuses them, as it compiles without fastmath.

Each function reduces its argument to a short interval by constants in parts, a high one with trailing zeros, whose
products with small integers are exact, and low ones for the rest. On the interval a Taylor polynomial of so many terms
that what is left out is less than 2**-57 of the result; for erfc a Chebyshev expansion. What is rounded in the parts
is carried along, so that little but the last rounding counts. A polynomial is evaluated as two of the square, which
do not wait for each other.

Errors are at most 1 unit in the last place of the result (ulp): exp, exp10, log, sin, cos; 2 ulp: log10, log1p, expm1,
atan2, asin, hypot; 6 ulp: erfc. Beyond 2**20 rad sin and cos take the nearest float for 2 pi: their error grows to
3e-17 of the angle. Out of a function's domain the result is NaN, at a pole it is infinite; nothing is raised.
"""

import math
from typing import Final

import numpy as np

from cosim.arrays import Floats
from cosim.jit import njit

_LN_2: Final = (0.6931471803691238, 1.9082149292705877e-10)
_LOG2_E: Final = 1.4426950408889634
_LOG10_2: Final = (0.3010299955494702, 1.1451100898021838e-10)
_LOG2_10: Final = 3.321928094887362
_LN_10: Final = (2.3025850653648376, 2.7629208037533617e-08)
_LOG10_E: Final = 0.4342944819032518
_HALF_PI: Final = (1.5707963267341256, 6.077100506303966e-11, 2.0222662487111665e-21, 8.4784276603689e-32)
"""pi / 2 in four parts, the first three of 33 bits."""
_QUARTER: Final = (1.5707963267948966, 6.123233995736766e-17)
_HALF: Final = (3.141592653589793, 1.2246467991473532e-16)
"""A quarter and a half of a turn, as a float and what it lacks."""
_TWO_OVER_PI: Final = 0.6366197723675814
_SQRT_HALF: Final = 0.7071067811865476
_MOST_RAD: Final = 1048576.0
_EIGHTHS: Final[Floats] = np.array(
    [
        (0.0, 0.0),
        (0.12435499454676144, -3.1253241424539383e-18),
        (0.24497866312686414, 1.0698755618734451e-17),
        (0.35877067027057225, -2.4623815582638635e-17),
        (0.4636476090008061, 2.2698777452961687e-17),
        (0.5585993153435624, -5.4556305485916264e-18),
        (0.6435011087932844, 1.5834785051444286e-17),
        (0.7188299996216245, -2.1478388444456983e-17),
        (0.7853981633974483, 3.061616997868383e-17),
    ]
)
"""The arc tangents of 0, 1/8, ... 1 as floats, and what these lack."""
_SPLIT: Final = 134217729.0
"""2**27 + 1: times a float, it parts it in the middle (Veltkamp)."""


# ---------------------------------------------------------------- floats and their exponents
#
# ldexp and frexp by bits: without calls of a C library, and without branches, loops over them become vectors.

_FRACTION: Final = (1 << 52) - 1
_ONE: Final = 1023
"""The biased exponent of 1.0."""
_LEAST: Final = 2.2250738585072014e-308
"""The least float with a whole fraction."""


@njit(cache=True)
def _power_of_2(k: int) -> float:
    """Return 2 to the power of *k*, from -1022 to 1023."""
    return float(np.int64(k + _ONE << 52).view(np.float64))


@njit(cache=True)
def _scaled(x: float, k: int) -> float:
    """Return *x*, about 1, times 2 to the power of *k*, from -2000 to 2000; rounded once, if at all."""
    half = k >> 1
    return x * _power_of_2(half) * _power_of_2(k - half)


@njit(cache=True)
def _parts(x: float) -> tuple[float, int]:
    """Return f and k, with *x* = (1 + f) 2**k and sqrt(1/2) - 1 <= f < sqrt(2) - 1, of *x* > 0."""
    small = x < _LEAST
    bits = np.float64(x * 18014398509481984.0 if small else x).view(np.int64)  # 2**54
    half = float(np.int64(bits & _FRACTION | _ONE - 1 << 52).view(np.float64))
    under = half < _SQRT_HALF
    k = (bits >> 52) - (_ONE - 1) - (54 if small else 0) - (1 if under else 0)
    return (2.0 * half if under else half) - 1.0, int(k)


# ---------------------------------------------------------------- exponentials


@njit(cache=True)
def _exp_tail(r: float) -> float:
    """Return exp(r) - 1 - r for |r| < 0.35."""
    s = r * r
    even = 1 / 40320 + s * (1 / 3628800 + s * (1 / 479001600))
    even = 1 / 2 + s * (1 / 24 + s * (1 / 720 + s * even))
    odd = 1 / 362880 + s * (1 / 39916800 + s * (1 / 6227020800))
    odd = 1 / 6 + s * (1 / 120 + s * (1 / 5040 + s * odd))
    return s * (even + r * odd)


@njit(cache=True)
def exp(x: float) -> float:
    """Return e to the power of *x*."""
    if not abs(x) < 746.0:
        return x if x != x else (math.inf if x > 0.0 else 0.0)
    k = math.floor(x * _LOG2_E + 0.5)
    high, low = x - k * _LN_2[0], k * _LN_2[1]
    r = high - low
    return _scaled(1.0 + (r + (((high - r) - low) + _exp_tail(r))), int(k))


@njit(cache=True, forceinline=True)
def exp10(x: float) -> float:
    """Return 10 to the power of *x*: a ratio for bels."""
    if not abs(x) < 325.0:
        return x if x != x else (math.inf if x > 0.0 else 0.0)
    k = math.floor(x * _LOG2_10 + 0.5)
    tens, rest = x - k * _LOG10_2[0], k * _LOG10_2[1]
    part = tens * _SPLIT
    part -= part - tens
    high = part * _LN_10[0]
    low = part * _LN_10[1] + (tens - part - rest) * (_LN_10[0] + _LN_10[1])
    r = high + low
    return _scaled(1.0 + (r + (((high - r) + low) + _exp_tail(r))), int(k))


@njit(cache=True)
def expm1(x: float) -> float:
    """Return exp(x) - 1, exact to the last places also where *x* is near 0."""
    if abs(x) < 0.35:
        return x + _exp_tail(x) if x != 0.0 else x
    if not abs(x) < 40.0:
        return exp(x) - 1.0
    k = math.floor(x * _LOG2_E + 0.5)
    r = (x - k * _LN_2[0]) - k * _LN_2[1]
    scale = _power_of_2(int(k))
    return (scale - 1.0) + scale * (r + _exp_tail(r))


# ---------------------------------------------------------------- logarithms


@njit(cache=True, error_model="numpy")  # a division does not look for 0: it is none
def _log_tail(f: float) -> float:
    """Return f - log(1 + f) for sqrt(1/2) - 1 <= f <= sqrt(2) - 1.

    With s = f / (2 + f), log(1 + f) = 2 artanh(s) = 2 s + s R, and 2 s = f - s f = f - f^2 / 2 + s f^2 / 2.
    """
    s = f / (2.0 + f)
    z = s * s
    w = z * z
    one = 2 / 3 + w * (2 / 7 + w * (2 / 11 + w * (2 / 15 + w * (2 / 19 + w * (2 / 23)))))
    other = 2 / 5 + w * (2 / 9 + w * (2 / 13 + w * (2 / 17 + w * (2 / 21))))
    half = 0.5 * f * f
    return half - s * (half + z * (one + z * other))


@njit(cache=True)
def log(x: float) -> float:
    """Return the natural logarithm of *x*."""
    if not 0.0 < x < math.inf:
        return -math.inf if x == 0.0 else (x if x > 0.0 else math.nan)
    f, k = _parts(x)
    return k * _LN_2[0] + (f - (_log_tail(f) - k * _LN_2[1]))


@njit(cache=True, forceinline=True)
def log10(x: float) -> float:
    """Return the logarithm of *x* to base 10."""
    if not 0.0 < x < math.inf:
        return -math.inf if x == 0.0 else (x if x > 0.0 else math.nan)
    f, k = _parts(x)
    return k * _LOG10_2[0] + ((f - _log_tail(f)) * _LOG10_E + k * _LOG10_2[1])


@njit(cache=True)
def log1p(x: float) -> float:
    """Return log(1 + x), exact to the last places also where *x* is near 0."""
    if -0.29 < x < 0.41:
        return x - _log_tail(x)
    u = 1.0 + x
    if not 0.0 < u < math.inf:
        return log(u)
    return log(u) + (x - (u - 1.0) if x < 1.0 else 1.0 - (u - x)) / u


# ---------------------------------------------------------------- angles


@njit(cache=True)
def _reduced(x: float) -> tuple[int, float, float]:
    """Return a number n mod 4, and x - n pi / 2, between -pi / 4 and pi / 4, in two parts."""
    if abs(x) < 0.785:
        return 0, x, 0.0
    if not abs(x) < _MOST_RAD:
        if not abs(x) < math.inf:
            return 0, math.nan, math.nan
        x = math.copysign(abs(x) % (2.0 * _HALF[0]), x)
    n = math.floor(x * _TWO_OVER_PI + 0.5)
    one = x - n * _HALF_PI[0]
    part = n * _HALF_PI[1]
    two = one - part
    back = one - two
    low = (one - (two + back)) + (back - part)
    part = n * _HALF_PI[2]
    three = two - part
    back = two - three
    low += (two - (three + back)) + (back - part)
    low -= n * _HALF_PI[3]
    high = three + low
    return int(n) & 3, high, (three - high) + low


@njit(cache=True)
def _sin_near(r: float, low: float) -> float:
    """Return sin(r + low) for |r| < 0.79, a *low* in the last place of *r* or below."""
    s = r * r
    w = s * s
    one = -1 / 6 + w * (-1 / 5040 + w * (-1 / 39916800 + w * (-1 / 1307674368000)))
    other = 1 / 120 + w * (1 / 362880 + w * (1 / 6227020800 + w * (1 / 355687428096000)))
    return r + (r * s * (one + s * other) + low * (1.0 - 0.5 * s))


@njit(cache=True)
def _cos_near(r: float, low: float) -> float:
    """Return cos(r + low) for |r| < 0.79, a *low* in the last place of *r* or below."""
    s = r * r
    w = s * s
    one = 1 / 24 + w * (1 / 40320 + w * (1 / 479001600 + w * (1 / 20922789888000)))
    other = -1 / 720 + w * (-1 / 3628800 + w * (-1 / 87178291200))
    half = 0.5 * s
    near = 1.0 - half
    return near + (((1.0 - near) - half) + (w * (one + s * other) - r * low))


@njit(cache=True)
def sin(x: float) -> float:
    """Return the sine of *x* rad."""
    if x == 0.0:
        return x  # with its sign
    n, r, low = _reduced(x)
    value = _cos_near(r, low) if n & 1 else _sin_near(r, low)
    return -value if n & 2 else value


@njit(cache=True)
def cos(x: float) -> float:
    """Return the cosine of *x* rad."""
    n, r, low = _reduced(x)
    value = _sin_near(r, low) if n & 1 else _cos_near(r, low)
    return -value if n == 1 or n == 2 else value


@njit(cache=True)
def atan2(y: float, x: float) -> float:
    """Return the angle of the vector (*x*, *y*), from -pi to pi; zeros and infinities as C's atan2 has them.

    With c the nearest eighth to a ratio q, atan(q) = atan(c) + atan((q - c) / (1 + c q)).
    """
    if x != x or y != y:
        return math.nan
    least, most = min(abs(x), abs(y)), max(abs(x), abs(y))
    if most == 0.0 or most == math.inf:
        least, most = (1.0 if least == most > 0.0 else 0.0), 1.0
    elif not 1e-290 < most < 1e290:  # so that no product is lost
        scale = 1e300 if most < 1.0 else 1e-300
        least, most = least * scale, most * scale
    steep, back = abs(y) > abs(x), math.copysign(1.0, x) < 0.0
    if least == 0.0:  # along an axis, as robots often go: what follows comes to the same
        return math.copysign(_QUARTER[0] if steep else (_HALF[0] if back else 0.0), y)
    eighth = int(8.0 * (least / most) + 0.5)
    c = 0.125 * eighth
    t = (least - c * most) / (most + c * least)
    s = t * t
    small = t - t * s * (1 / 3 - s * (1 / 5 - s * (1 / 7 - s * (1 / 9 - s * (1 / 11 - s * (1 / 13))))))
    high, low = _EIGHTHS[eighth, 0], _EIGHTHS[eighth, 1] + small
    if steep or back:
        if not (steep and back):
            high, low = -high, -low
        whole = _QUARTER if steep else _HALF
        turn = whole[0] + high
        low += high - (turn - whole[0]) + whole[1]
        high = turn
    return math.copysign(high + low, y)


@njit(cache=True)
def asin(x: float) -> float:
    """Return the angle from -pi / 2 to pi / 2 whose sine is *x*."""
    return atan2(x, math.sqrt((1.0 - x) * (1.0 + x))) if abs(x) <= 1.0 else math.nan


@njit(cache=True)
def hypot(x: float, y: float) -> float:
    """Return the length of the vector (*x*, *y*)."""
    square = x * x + y * y
    if 1e-280 < square < math.inf or square != square:
        return math.sqrt(square)
    most = max(abs(x), abs(y))  # squares are lost
    if most == 0.0 or most == math.inf:
        return most
    x, y = x / most, y / most
    return most * math.sqrt(x * x + y * y)


# ---------------------------------------------------------------- the normal distribution

_ERFC: Final[Floats] = np.array(
    [
        *(1.2329951186255526, -0.1396211168405623, 0.015379652102619604, 0.06809705425466908, -0.10103906603630056),
        *(0.0937328349990944, -0.06633036581218697, 0.03716751552655567, -0.016197734059799265, 0.005031970067657489),
        *(-0.0007577732613730956, -0.00019925714661091188, 0.0001506214900124047, -2.4397746422436416e-05),
        *(-1.1221287012353486e-05, 5.706604414895734e-06, 2.919733377963012e-07, -8.210939042560568e-07),
        *(7.746992727017941e-08, 1.0633855618594884e-07, -2.05606492756992e-08, -1.234686604382353e-08),
        *(3.1695881915648173e-09, 9.311744978232572e-10, -2.659599690242689e-10),
    ]
)
"""(1 + 2 x) exp(x^2) erfc(x) for x >= 0 in powers of t = (x - 4) / (x + 4): its Chebyshev expansion on [-1, 1]."""


@njit(cache=True)
def erfc(x: float) -> float:
    """Return the complementary error function: 2 / sqrt(pi) times the integral of exp(-u^2) over u > *x*."""
    if x != x:
        return x
    far = min(abs(x), 27.5)  # there it is 0
    t = (far - 4.0) / (far + 4.0)
    total = 0.0
    for k in range(len(_ERFC) - 1, -1, -1):
        total = total * t + _ERFC[k]
    part = far * _SPLIT
    part -= part - far
    tail = total / (1.0 + 2.0 * far) * (1.0 + expm1(-(far - part) * (far + part))) * exp(-part * part)
    return 2.0 - tail if x < 0.0 else tail


# ---------------------------------------------------------------- arrays


@njit(cache=True)
def exps(values: Floats) -> Floats:
    """Return :func:`exp` of each of *values*, in their shape."""
    found = np.empty(values.shape)
    for at, value in np.ndenumerate(values):
        found[at] = exp(value)
    return found


@njit(cache=True)
def logs(values: Floats) -> Floats:
    """Return :func:`log` of each of *values*, in their shape."""
    found = np.empty(values.shape)
    for at, value in np.ndenumerate(values):
        found[at] = log(value)
    return found


@njit(cache=True)
def exp10s(values: Floats) -> Floats:
    """Return :func:`exp10` of each of *values*, in their shape."""
    found = np.empty(values.shape)
    for at, value in np.ndenumerate(values):
        found[at] = exp10(value)
    return found


def hypots(x: Floats, y: Floats) -> Floats:
    """Return the lengths of vectors: each is less than 1e150, and more than 1e-140 or 0."""
    return np.asarray(np.sqrt(x * x + y * y))
