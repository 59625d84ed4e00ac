"""The 40 RF channels and their indices (Core v5.0, Vol 6 Part B, section 1.4.1).

RF channel k is centred at 2402 + 2 k MHz. The indices 37, 38 and 39 are the primary advertising channels, RF channels
0, 12 and 39; the indices 0 to 36 are the others, ascending. Whitening, channel maps and PDUs have the index.
"""

from typing import Final

CHANNELS: Final = 40
DATA_CHANNELS: Final = 37
"""Number of general-purpose channels, whose indices are 0 to 36."""
ADVERTISING: Final = (37, 38, 39)
"""Indices of the primary advertising channels, in the order in which an event uses them."""

_RF_CHANNELS: Final[tuple[int, ...]] = (*range(1, 12), *range(13, 39), 0, 12, 39)
"""RF channel of every index."""
_INDICES: Final = tuple(_RF_CHANNELS.index(channel) for channel in range(CHANNELS))


def rf_channel(index: int) -> int:
    """Return the RF channel of the channel *index*; ValueError if there is none."""
    return _RF_CHANNELS[_checked(index)]


def channel_index(channel: int) -> int:
    """Return the index of the RF *channel*; ValueError if there is none."""
    return _INDICES[_checked(channel)]


def frequency_mhz(channel: int) -> int:
    """Return the centre frequency of the RF *channel* in MHz; ValueError if there is none."""
    return 2402 + 2 * _checked(channel)


def _checked(channel: int) -> int:
    if not 0 <= channel < CHANNELS:
        raise ValueError(f"{channel} is no channel (0 to {CHANNELS - 1})")
    return channel
