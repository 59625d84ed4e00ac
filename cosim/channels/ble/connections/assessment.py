"""Adaptive frequency hopping of a link: its central learns which channels are bad, and announces maps without them.

For each event the central counts whether it has heard anything without an error, by the channel of the event. That an
event failed since its peripheral did not listen it cannot tell: one that may leave out events is not assessed.
"""

from cosim.channels.air.quality import ChannelQuality
from cosim.channels.ble.channels import DATA_CHANNELS
from cosim.channels.ble.connections.channel_map import LEAST_USED, ChannelMap
from cosim.units import Time


class Assessment:
    """What the central of one link has counted since the last choice of channels, every *interval* from *now* on.

    A bad channel is tried again after *retry*. All times are in ns.
    """

    def __init__(self, interval: Time, retry: Time, now: Time) -> None:
        self._quality = ChannelQuality(DATA_CHANNELS, LEAST_USED, retry)
        self._interval = interval
        self._due = now + interval
        self._heard, self._failed = [0] * DATA_CHANNELS, [0] * DATA_CHANNELS

    def note(self, channel: int, heard: bool) -> None:
        """Count an event on *channel*, in which the central has *heard* something or nothing."""
        (self._heard if heard else self._failed)[channel] += 1

    def choose(self, now: Time) -> ChannelMap | None:
        """Return the map to be used, if it is time for a choice and that is another one than before."""
        if now < self._due:
            return None
        self._due = now + self._interval
        changed = self._quality.update(self._heard, self._failed, now)
        self._heard, self._failed = [0] * DATA_CHANNELS, [0] * DATA_CHANNELS
        return ChannelMap(tuple(self._quality.used)) if changed else None
