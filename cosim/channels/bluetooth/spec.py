"""What cosim must know of Bluetooth: the entry point ``bluetooth`` names ``SPEC``."""

from typing import Final

from cosim.channels.base import Channel
from cosim.channels.bluetooth.settings import BluetoothSettings
from cosim.channels.kinds import ChannelSite, ChannelSpec


def _made(settings: BluetoothSettings, site: ChannelSite) -> Channel:
    from cosim.channels.bluetooth.device import BluetoothChannel  # only a run needs the model

    walls = site.walls, site.wall_loss_db
    return BluetoothChannel(settings, site.kernel, site.trace, site.size, site.streams, walls, site.power_classes)


SPEC: Final = ChannelSpec(BluetoothSettings, _made)
"""The channel."""
