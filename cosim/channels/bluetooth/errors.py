"""Bit errors of Basic Rate, and what they do to a packet: which of its parts arrives broken, and how often.

GFSK with modulation index h, detected without carrier phase, makes an error with probability (Robert, Valenti; Proakis
for two correlated signals), with g = Es/N0 and rho = abs(sin(2 pi h) / (2 pi h)),

    Pb = Q1(a, b) - exp(-(a^2 + b^2) / 2) I0(a b) / 2,    a, b = sqrt(g / 2 (1 -+ sqrt(1 - rho^2)))

Q1(a, b) is the sum of exp(-(a^2 + b^2) / 2) (a / b)^k I_k(a b) over k >= 0, a^2 + b^2 = g and a b = g rho / 2. So

    Pb = exp(-g / 2) [I0(z) / 2 + sum over k >= 1 of r^k I_k(z)],    z = g rho / 2,    r = rho / (1 + sqrt(1 - rho^2))

in which nothing cancels and, as r = 0.24 for h = 0.32, every term is less than a quarter of the one before. Bit errors
are independent. A packet is made of sections (Core v1.2, Vol 2 Part B, sections 6 and 7):

    access code  72 bits (68 in an ID packet, which has no trailer); lost if more than 7 are wrong
    header       18 bits, each sent three times; lost if two or three copies of any bit are wrong
    payload      DM, FHS: every 10 bits as 15, a block is lost with more than one wrong bit; DH: lost with any wrong bit

The exact probabilities come from scipy; a run takes them from kernels that interpolate the logarithm of the bit error
rate in a table.
"""

import math
from collections.abc import Iterable
from functools import cache
from typing import Any, Final, TypeAlias

import numpy as np
import numpy.typing as npt
from scipy import special

from cosim.channels.bluetooth.packets import ACCESS_CODE_BITS, HEADER_BITS, ID_BITS, TOLERATED_BITS, PacketType
from cosim.jit import njit
from cosim.units import MS, SLOT

Floats: TypeAlias = np.ndarray[Any, np.dtype[np.float64]]

MODULATION_INDEX: Final = 0.32
"""Nominal; the specification allows 0.28 to 0.35."""
NEGLIGIBLE: Final = 2.0**-40
"""A kernel returns 0 for what is less probable."""
SENSITIVITY_BER: Final = 1e-3
"""The bit error rate at which the specification measures sensitivity."""

# the sections of a packet
NONE: Final = 0
ACCESS_CODE: Final = 1
HEADER: Final = 2
PAYLOAD: Final = 3


# ---------------------------------------------------------------- exact


def bit_error_rate(es_n0_db: npt.ArrayLike, modulation_index: float = MODULATION_INDEX) -> Floats:
    """Return the probability that a bit is wrong at *es_n0_db*, of any shape, dB; the formula of this module."""
    g = 10.0 ** (np.asarray(es_n0_db, dtype=np.float64) / 10.0)
    rho = abs(math.sin(2 * math.pi * modulation_index) / (2 * math.pi * modulation_index))
    ratio = rho / (1.0 + math.sqrt(1.0 - rho * rho))
    z = 0.5 * rho * g
    # ive(k, z) is exp(-z) I_k(z)
    total = 0.5 * special.ive(0, z)
    for k in range(1, 1 + math.ceil(-40.0 / math.log(ratio))):
        total = total + ratio**k * special.ive(k, z)
    return np.asarray(np.exp(z - 0.5 * g) * total)


@cache
def es_n0_db_at(bit_errors: float) -> float:
    """Return the Es/N0 in dB, to 1e-9, at which the bit error rate is *bit_errors*.

    Raise ValueError if it is not between the rates at -20 and 20 dB.
    """
    low, high = -20.0, 20.0
    if not bit_error_rate(high) < bit_errors < bit_error_rate(low):
        raise ValueError(f"a bit error rate of {bit_errors} is not met between {low:g} and {high:g} dB")
    while high - low > 1e-9:  # the rate falls all the way
        middle = 0.5 * (low + high)
        low, high = (middle, high) if bit_error_rate(middle) > bit_errors else (low, middle)
    return 0.5 * (low + high)


def section_errors(kind: PacketType, length: int, es_n0_db: npt.ArrayLike) -> tuple[Floats, Floats, Floats]:
    """Return the exact probabilities, each of the shape of *es_n0_db* (dB), that a section is broken by itself.

    The sections are access code, header and payload of a packet of type *kind* with *length* bytes of user data; what
    a type does not have is never broken. Raise ValueError if the bytes do not fit.
    """
    wrong = bit_error_rate(es_n0_db)
    never = np.zeros_like(wrong)
    bits = kind.payload_bits(length)
    access = _more_than(TOLERATED_BITS, ID_BITS if kind.name == "ID" else ACCESS_CODE_BITS, wrong)
    if kind.name == "ID":
        return access, never, never
    header = _any_of(HEADER_BITS, _more_than(1, 3, wrong))
    payload = _any_of(-(-bits // 10), _more_than(1, 15, wrong)) if kind.coded else _any_of(bits, wrong)
    return access, header, payload


def throughput_kbps(kind: PacketType, es_n0_db: npt.ArrayLike) -> Floats:
    """Return the rate in kb/s, of the shape of *es_n0_db* (dB), of full packets sent one way and repeated until heard.

    A packet counts if all of it arrives, and the access code and header of the NULL that acknowledges it (Valenti,
    Robert, Reed, WCNC 2002).
    """
    access, header, payload = section_errors(kind, kind.capacity, es_n0_db)
    heard = ((1 - access) * (1 - header)) ** 2 * (1 - payload)
    return np.asarray(8 * kind.capacity * heard * MS / ((kind.slots + 1) * SLOT))


def _more_than(limit: int, bits: int, wrong: Floats) -> Floats:
    return np.asarray(special.bdtrc(limit, bits, wrong), dtype=np.float64)


def _any_of(count: int, each: Floats) -> Floats:
    """Return the probability that at least one of *count* independent things happens."""
    return np.asarray(-np.expm1(count * np.log1p(-each)))


# ---------------------------------------------------------------- for the run

_STEPS_PER_DB: Final = 8
_LOWEST_DB: Final = -40.0
_HIGHEST_DB: Final = 22.0
"""Above, not even the longest payload is broken with a probability that is not negligible."""
# a point more at each end, for the cubic
_LOG_BER: Final[Floats] = np.log(
    bit_error_rate(_LOWEST_DB + np.arange(-1, (_HIGHEST_DB - _LOWEST_DB) * _STEPS_PER_DB + 2) / _STEPS_PER_DB)
)


@njit(cache=True)
def fast_bit_error_rate(es_n0_db: float) -> float:
    """Return the bit error rate at *es_n0_db*, 1e-5 of it wrong at most; 0 above 22 dB; a kernel for kernels.

    A cubic through the four nearest entries of a table of the logarithm, in steps of 1/8 dB. Below -40 dB the value
    there, which is a half but for 1e-4 of it.
    """
    if es_n0_db >= _HIGHEST_DB:
        return 0.0
    x = (max(es_n0_db, _LOWEST_DB) - _LOWEST_DB) * _STEPS_PER_DB
    at = int(x)
    t = x - at
    before, low, high, after = _LOG_BER[at], _LOG_BER[at + 1], _LOG_BER[at + 2], _LOG_BER[at + 3]
    outer = t * (t - 1.0) * ((t + 1.0) * after - (t - 2.0) * before) / 6.0
    inner = (t + 1.0) * (t - 2.0) * ((t - 1.0) * low - t * high) / 2.0
    return math.exp(outer + inner)


@njit(cache=True)
def _tail(limit: int, bits: int, wrong: float) -> float:
    """Return the probability that more than *limit* of *bits* are wrong, each with probability *wrong* <= 1/2."""
    if wrong == 0.0:
        return 0.0
    odds = wrong / (1.0 - wrong)
    term = (1.0 - wrong) ** bits
    for k in range(limit + 1):
        term *= odds * (bits - k) / (k + 1)
    total = term
    for k in range(limit + 1, bits):
        factor = odds * (bits - k) / (k + 1)
        term *= factor
        total += term
        if factor < 0.5 and term < 1e-12 * total:
            break
    return total


@njit(cache=True)
def _at_least_one(count: int, each: float) -> float:
    if each >= 1.0:
        return 1.0 if count else 0.0
    probability = -math.expm1(count * math.log1p(-each))
    return probability if probability >= NEGLIGIBLE else 0.0


@njit(cache=True)
def section_probabilities(es_n0_db: float, payload_bits: int, coded: bool) -> tuple[float, float, float]:
    """Return how probably access code, header and payload of a packet at *es_n0_db* are broken; a kernel for kernels.

    *payload_bits* are those of payload header, user data and CRC (FHS: 160; POLL and NULL: 0) before they are *coded*
    by the (15, 10) code, or not. 1e-4 of a probability is wrong at most, and 0 stands for less than 2**-40.
    """
    wrong = fast_bit_error_rate(es_n0_db)
    access = _at_least_one(1, _tail(TOLERATED_BITS, ACCESS_CODE_BITS, wrong))
    header = _at_least_one(HEADER_BITS, wrong * wrong * (3.0 - 2.0 * wrong))
    if coded:
        return access, header, _at_least_one((payload_bits + 9) // 10, _tail(1, 15, wrong))
    return access, header, _at_least_one(payload_bits, wrong)


@njit(cache=True)
def failed_section(w0: int, w1: int, w2: int, w3: int, p_access: float, p_header: float, p_payload: float) -> int:
    """Return which section of a packet is the first that breaks, or NONE, given four random words of 32 bits.

    The access code and the header take a word each, the payload 53 bits of two: it alone may matter when it breaks
    less often than once in 2**32. A kernel for kernels.
    """
    if w0 < p_access * 4294967296.0:
        return ACCESS_CODE
    if w1 < p_header * 4294967296.0:
        return HEADER
    if (w2 << 21 | w3 >> 11) * 2.0**-53 < p_payload:
        return PAYLOAD
    return NONE


# ---------------------------------------------------------------- the choice of a type


def best_type(types: Iterable[PacketType], length: int, es_n0_db: float) -> PacketType:
    """Return the one of *types* that carries *length* bytes at *es_n0_db* at the highest expected rate.

    The rate is that of :func:`throughput_kbps`, with this payload; of equal ones the type with the least capacity wins.
    Raise ValueError if none holds so many bytes.
    """
    fitting = sorted(
        (kind for kind in types if kind.header and kind.capacity >= length), key=lambda kind: kind.capacity
    )
    if not fitting:
        raise ValueError(f"no packet type that may be chosen holds {length} bytes")
    return max(fitting, key=lambda kind: _payload_success(kind, length, es_n0_db) / (kind.slots + 1))


def _payload_success(kind: PacketType, length: int, es_n0_db: float) -> float:
    # access codes and headers, those of the answer too, break alike whatever the type
    return 1.0 - section_probabilities(es_n0_db, kind.payload_bits(length), kind.coded)[2]
