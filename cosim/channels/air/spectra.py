"""The share of a sender's power that falls into the filter of a receiver, by their kinds and how far they are apart.

    share = integral of S(f) H(f - offset) df,    the integral of S being 1

Models of the senders' spectra S:

    DSSS      random chips of 11 Mchip/s, sinc^2(f / 11 MHz), filtered where that is above the standard's mask (-30 dB
              from 11 to 22 MHz, -50 dB beyond); the power is that behind the filter, which has taken 9.5 %
    OFDM      802.11 of 20 MHz as BabbleSim has it: below the standard's mask (0 dB to 9 MHz, -20 at 11, -28 at 20, -40
              at 30, by straight lines; so ns-3 has it), and nothing beyond 12.3 MHz
    CLASSIC   flat over the 1 MHz of its channel
    LE        GFSK as BabbleSim has it: below what the specification allows, and nothing beyond 1.3 MHz (2.5 for 2M)
    JAMMER    flat over 1 MHz, on each of its channels

Models of the receivers' filters H:

    DSSS, OFDM, CLASSIC    all of 22, 20 and 1 MHz, and nothing else
    LE                     as BabbleSim has it; the gain for the wanted signal is about 1; nothing beyond 4 (8) MHz

So no mask of a standard is taken for a spectrum but where DSSS meets its own; what a filter lets through at any
distance (blocking), intermodulation and phase noise are neglected.

BabbleSim: ext_2G4_modem_BLE_simple, src/modem_BLE_simple.c, powers per 200 kHz, here as the points between which they
are straight lines in dB; the same steps of 200 kHz are kept.
"""

import math
from functools import cache
from typing import Final

import numpy as np

import cosim.elementary as elementary
from cosim.arrays import Floats
from cosim.jit import njit

DSSS: Final = 0
"""802.11 direct sequence and CCK: 22 MHz."""
OFDM: Final = 1
"""802.11 OFDM: 20 MHz."""
CLASSIC: Final = 2
"""Bluetooth Basic Rate: 1 MHz."""
LE_1M: Final = 3
"""Bluetooth LE, 1M and Coded."""
LE_2M: Final = 4
JAMMER: Final = 5
"""One channel of a jammer: it only sends."""

SENDERS: Final = 6
RECEIVERS: Final = 5

STEPS_PER_MHZ: Final = 2
"""Centres are whole steps of 0.5 MHz: 4804 is 2402 MHz."""
LIMIT_MHZ: Final = 40
"""Distance from the centre at which spectra end."""
OFFSETS: Final = (LIMIT_MHZ + 11) * STEPS_PER_MHZ + 1
"""Number of distances between centres, 0 upwards in steps, at which anything can be received."""

_FINE: Final = 50
"""Points of integration in 1 MHz, each in the middle of its interval."""
_CHIPS_MHZ: Final = 11.0
_BIN_MHZ: Final = 0.2

# (MHz from the centre, dB)
_OFDM_SENT: Final[Floats] = np.array(
    [
        *[(0.0, -7.0), (0.2, 0.0), (8.2, 0.0), (8.4, -10.0), (8.6, -12.0), (8.8, -11.5), (9.0, -12.3), (9.2, -13.3)],
        *[(9.4, -15.25), (9.6, -16.0), (9.8, -14.2), (10.0, -15.0), (10.2, -16.5), (10.8, -21.0), (11.0, -22.5)],
        *[(11.2, -25.0), (11.8, -31.0), (12.2, -39.0)],
    ]
)
_LE_1M_SENT: Final[Floats] = np.array(
    [(0.0, 0.0), (0.2, -0.92), (0.4, -5.2), (0.6, -13.7), (0.8, -27.95), (1.0, -30.24), (1.2, -38.56)]
)
_LE_2M_SENT: Final[Floats] = np.array(
    [
        *[(0.0, 0.0), (0.2, -0.56), (0.4, -1.8), (0.6, -3.43), (0.8, -6.3), (1.0, -10.87), (1.2, -17.25)],
        *[(1.4, -27.31), (1.6, -31.34), (1.8, -29.07), (2.0, -30.67), (2.2, -34.99), (2.4, -40.99)],
    ]
)
_LE_1M_TAKEN: Final[Floats] = np.array(
    [
        *[(0.0, 0.72), (0.2, -0.06), (0.4, -1.0), (0.6, -1.73), (0.8, -5.8), (1.0, -9.43), (1.2, -14.0)],
        *[(1.4, -20.0), (2.6, -50.0), (2.8, -53.0), (3.0, -55.0), (4.0, -60.0)],
    ]
)
_LE_2M_TAKEN: Final[Floats] = np.array(
    [
        *[(0.0, 0.04), (0.8, 0.04), (1.0, -0.66), (1.2, -3.62), (1.4, -6.91), (1.6, -8.62), (1.8, -11.87)],
        *[(2.0, -12.83), (2.2, -15.01), (2.4, -22.0), (2.6, -25.0), (2.8, -28.0), (3.0, -30.0), (3.2, -32.0)],
        *[(7.2, -52.0), (8.0, -60.0)],
    ]
)


@cache
def shares() -> Floats:
    """Return the shares, (SENDERS, RECEIVERS, OFFSETS): the last index is the distance of the centres in steps."""
    return _shares()


# ---------------------------------------------------------------- kernels


@njit(cache=True)
def sinc_squared(mhz: float) -> float:
    """Return the density per MHz of random chips of 11 Mchip/s, unfiltered, at *mhz* from the centre."""
    x = math.pi * mhz / _CHIPS_MHZ
    ratio = elementary.sin(x) / x if x != 0.0 else 1.0
    return ratio * ratio / _CHIPS_MHZ


@njit(cache=True)
def _along(points: Floats, mhz: float) -> float:
    """Return the power at *mhz* >= 0, by lines in dB between *points* that are sampled every 200 kHz; 0 beyond."""
    at = _BIN_MHZ * math.floor(mhz / _BIN_MHZ + 0.5)
    for k in range(1, len(points)):
        if at <= points[k, 0] + 1e-6:
            (low, low_db), (high, high_db) = points[k - 1], points[k]
            return float(elementary.exp10((low_db + (high_db - low_db) * (at - low) / (high - low)) / 10.0))
    return 0.0


@njit(cache=True)
def _sent(kind: int, mhz: float) -> float:
    """Return the density of a sender at *mhz* >= 0 from its centre, in any unit."""
    if kind == DSSS:
        mask = 1.0 if mhz < 11.0 else (1e-3 if mhz < 22.0 else 1e-5)
        return min(_CHIPS_MHZ * sinc_squared(mhz), mask)
    if kind == OFDM:
        return _along(_OFDM_SENT, mhz)
    if kind == LE_1M:
        return _along(_LE_1M_SENT, mhz)
    if kind == LE_2M:
        return _along(_LE_2M_SENT, mhz)
    return 1.0 if mhz < 0.5 else 0.0


@njit(cache=True)
def _taken(kind: int, mhz: float) -> float:
    """Return the gain of a receiver's filter at *mhz* >= 0 from its centre."""
    if kind == LE_1M:
        return _along(_LE_1M_TAKEN, mhz)
    if kind == LE_2M:
        return _along(_LE_2M_TAKEN, mhz)
    half = 11.0 if kind == DSSS else (10.0 if kind == OFDM else 0.5)
    return 1.0 if mhz < half else 0.0


@njit(cache=True)
def _shares() -> Floats:
    """Return the integrals, by sums over points every 20 kHz."""
    half, reach = LIMIT_MHZ * _FINE, 11 * _FINE  # no filter is wider than that of DSSS
    table = np.zeros((SENDERS, RECEIVERS, OFFSETS))
    taken = np.empty((RECEIVERS, reach))
    for receiver in range(RECEIVERS):
        for at in range(reach):
            taken[receiver, at] = _taken(receiver, (at + 0.5) / _FINE)
    sent = np.empty(2 * half)
    for sender in range(SENDERS):
        total = 0.0
        for at in range(2 * half):
            sent[at] = _sent(sender, abs(at + 0.5 - half) / _FINE)
            total += sent[at]
        for receiver in range(RECEIVERS):
            for offset in range(OFFSETS):
                middle = half + offset * _FINE // STEPS_PER_MHZ
                found = 0.0
                for at in range(reach):
                    if middle + at < 2 * half:
                        found += taken[receiver, at] * sent[middle + at]
                    if middle - 1 - at < 2 * half:
                        found += taken[receiver, at] * sent[middle - 1 - at]
                table[sender, receiver, offset] = found / total
    return table
