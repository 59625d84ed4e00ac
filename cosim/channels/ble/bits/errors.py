"""Bit errors of LE, and how often they break which part of a packet.

GFSK with a modulation index of 0.5, detected without carrier phase, makes an error with probability exp(-g / 2) / 2,
where g is the ratio of signal to noise and interference (the formula of ``bluetooth.bits.errors`` with rho = 0). A
receiver has the bit error rate 1e-3 at its sensitivity, thus at g = 2 ln 500, 10.94 dB; from that follows its noise. LE
Coded raises g by its gain, against noise and interference alike. Bit errors are independent. A packet has two parts:

    header     access address (32 bits) and header (16): with an error in it nobody notices the packet
    payload    payload and CRC: with an error in it the CRC is wrong

Their bits are spread evenly over the time from the end of the preamble to that of the header, and over the rest; that
is exact on 1M and 2M. Each part meets the interference of its own time, section by section.
"""

from collections.abc import Iterable
from typing import Final

import cosim.elementary as elementary
from cosim.channels.air.band import Section
from cosim.channels.ble.phy import CODED_S2, CODED_S8, CRC_OCTETS, HEADER_OCTETS, LE_1M, LE_2M, Phy
from cosim.units import US, Time

SENSITIVITY_G: Final = 2.0 * elementary.log(500.0)
"""Signal to noise ratio, as a factor, at the sensitivity."""
NEGLIGIBLE: Final = 2.0**-40
"""Probability up to which a part is not broken."""
UNNOTICED: Final = 1.0
"""Signal to noise ratio, as a factor, below which nobody notices a packet: one in 30 million would be."""
CODING_GAIN: Final = {
    phy.name: elementary.exp10((LE_1M.sensitivity_dbm - phy.sensitivity_dbm) / 10.0) for phy in (CODED_S2, CODED_S8)
}
"""What LE Coded gains, as a factor: what its sensitivity is better than that of LE 1M."""
_PREAMBLES: Final[dict[str, Time]] = {
    LE_1M.name: 8 * US,
    LE_2M.name: 8 * US,
    CODED_S2.name: 80 * US,
    CODED_S8.name: 80 * US,
}
_HEADER_BITS: Final = 32 + 8 * HEADER_OCTETS
CLEAR_G: Final = 2.0 * elementary.log(0.5 * 8 * 258 / NEGLIGIBLE)
"""Signal to noise ratio, as a factor, from which on even the longest packet is not broken."""


def bit_error_rate(g: float) -> float:
    """Return the probability that a bit is wrong where the signal is *g* times noise and interference."""
    rate: float = 0.5 * elementary.exp(-0.5 * g)
    return rate


def noise_mw(phy: Phy, sensitivity_dbm: float) -> float:
    """Return the noise in mW at a receiver on *phy* whose sensitivity on LE 1M is *sensitivity_dbm*."""
    wider_db = LE_2M.sensitivity_dbm - LE_1M.sensitivity_dbm if phy == LE_2M else 0.0
    power: float = elementary.exp10((sensitivity_dbm + wider_db) / 10.0)
    return power / SENSITIVITY_G


def ratio(phy: Phy, power_mw: float, against_mw: float) -> float:
    """Return g of a signal of *power_mw* against noise and interference of *against_mw*; infinite against nothing."""
    return power_mw * CODING_GAIN.get(phy.name, 1.0) / against_mw if against_mw > 0.0 else float("inf")


def least_dbm(phy: Phy, sensitivity_dbm: float, g: float) -> float:
    """Return the power in dBm that is *g* times the noise of a receiver whose sensitivity on LE 1M is that."""
    power: float = elementary.log10(g * noise_mw(phy, sensitivity_dbm) / CODING_GAIN.get(phy.name, 1.0))
    return 10.0 * power


def received(
    phy: Phy, octets: int, power_mw: float, noise: float, sections: Iterable[Section], start: Time
) -> tuple[float, float]:
    """Return the probabilities that header and payload of a packet from *start* on, with *octets*, are received.

    *sections* are the interference of its whole time, *noise* is in mW.
    """
    begins = start + _PREAMBLES[phy.name]
    turns = start + phy.lead + HEADER_OCTETS * phy.octet
    ends = start + phy.air_time(octets)
    header = payload = 1.0
    for begin, end, interference in sections:
        right = 1.0 - bit_error_rate(ratio(phy, power_mw, noise + interference))
        header *= _survives(right, _HEADER_BITS, begin, end, begins, turns)
        payload *= _survives(right, 8 * (octets + CRC_OCTETS), begin, end, turns, ends)
    return header, payload


def _survives(right: float, bits: int, begin: Time, end: Time, since: Time, until: Time) -> float:
    """Return the probability that what of *bits*, spread over [since, until), lies in [begin, end) is all right."""
    share = max(0, min(end, until) - max(begin, since)) / (until - since)
    power: float = elementary.exp(bits * share * elementary.log(right)) if share else 1.0
    return power
