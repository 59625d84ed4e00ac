"""Transmit powers by power class, and the noise that a receiver has within the 1 MHz of a channel."""

from typing import Final

from cosim.channels.bluetooth.bits.errors import SENSITIVITY_BER, es_n0_db_at

POWER_DBM: Final = {1: 20.0, 2: 4.0, 3: 0.0}
"""Greatest transmit power of power classes 1, 2 and 3."""
THERMAL_NOISE_DBM: Final = -114.0
"""Thermal noise at 290 K in a bandwidth of 1 MHz."""


def noise_dbm(sensitivity_dbm: float) -> float:
    """Return the noise in dBm at a receiver whose sensitivity, at a bit error rate of 1e-3, is this."""
    return sensitivity_dbm - es_n0_db_at(SENSITIVITY_BER)


def thermal_noise_dbm(noise_figure_db: float) -> float:
    """Return the noise in dBm within 1 MHz at a receiver with the noise figure *noise_figure_db*."""
    return THERMAL_NOISE_DBM + noise_figure_db
