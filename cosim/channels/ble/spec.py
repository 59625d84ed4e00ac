"""What cosim must know of Bluetooth Low Energy: the entry point ``ble`` names ``SPEC``."""

from typing import Final

from cosim.channels.base import Channel
from cosim.channels.ble.settings import BleSettings
from cosim.channels.kinds import ChannelSite, ChannelSpec


def _made(settings: BleSettings, site: ChannelSite) -> Channel:
    from cosim.channels.ble.channel import BleChannel  # only a run needs the model

    walls = site.walls, site.wall_loss_db
    return BleChannel(settings, site.kernel, site.trace, site.size, site.streams, walls, site.powers_dbm)


SPEC: Final = ChannelSpec(BleSettings, _made, lambda settings: None if settings.propagation is None else "power_dbm")
"""The channel."""
