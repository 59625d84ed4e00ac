"""Channel maps: which of the 37 general-purpose channels are used (Core v5.0, Vol 6 Part B, section 1.4.2)."""

from dataclasses import dataclass
from typing import Final

from cosim.channels.ble.channels import DATA_CHANNELS
from cosim.errors import WireError

MAP_OCTETS: Final = 5
LEAST_USED: Final = 2
"""Least number of channels in a map."""


@dataclass(frozen=True, slots=True)
class ChannelMap:
    """The used channels, by index, ascending; ValueError if they are fewer than two, not ascending or no channels."""

    used: tuple[int, ...]

    def __post_init__(self) -> None:
        ascending = tuple(sorted(set(self.used)))
        if (
            self.used != ascending
            or len(self.used) < LEAST_USED
            or not 0 <= self.used[0] <= self.used[-1] < DATA_CHANNELS
        ):
            raise ValueError(
                f"used channels: {list(self.used)} are not two or more of 0 to {DATA_CHANNELS - 1}, ascending"
            )

    def encode(self) -> bytes:
        """Return the five octets of the map: channel 0 is the least significant bit of the first."""
        return sum(1 << channel for channel in self.used).to_bytes(MAP_OCTETS, "little")


ALL_CHANNELS: Final = ChannelMap(tuple(range(DATA_CHANNELS)))


def decode_channel_map(data: bytes) -> ChannelMap:
    """Return the map of five octets, of which the three highest bits do not count; raise WireError if it is none."""
    if len(data) != MAP_OCTETS:
        raise WireError(f"a channel map of {len(data)} octets")
    bits = int.from_bytes(data, "little")
    used = tuple(channel for channel in range(DATA_CHANNELS) if bits >> channel & 1)
    if len(used) < LEAST_USED:
        raise WireError(f"a channel map with {len(used)} used channels")
    return ChannelMap(used)
