"""What stands for the radio of a live run: the ideal channel's links, reach and fates, while payloads go by UDP."""

from collections.abc import Iterable
from typing import Final, Literal

from cosim.channels.base import Arrival
from cosim.channels.ideal import IdealChannel, IdealSettings
from cosim.channels.kinds import ChannelSettings, ChannelSpec
from cosim.machine import Address, LinkEvent

KIND: Final = "cosim.live.loopback:SPEC"


class LoopbackSettings(ChannelSettings):
    """Settings of the ideal channel that hold for UDP as well."""

    kind: Literal["cosim.live.loopback:SPEC"] = KIND
    ideal: IdealSettings = IdealSettings()


class LoopbackChannel(IdealChannel):
    """An ideal channel that reports of links and payloads, and leaves it to others to carry these."""

    def deliver(self, arrivals: Iterable[Arrival], events: Iterable[tuple[Address, LinkEvent]] = ()) -> None:
        """Hand link events to their endpoints; payloads have gone another way."""
        super().deliver((), events)


SPEC: Final = ChannelSpec(
    LoopbackSettings,
    lambda settings, site: LoopbackChannel(
        settings.ideal, site.kernel, site.trace, site.size, site.streams, site.reaches_m
    ),
    lambda settings: "reach_m",
)
"""The channel."""
