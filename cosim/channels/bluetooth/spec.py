"""What cosim must know of Bluetooth: the entry point ``bluetooth`` names ``SPEC``."""

from typing import Final

from cosim.channels.base import Channel
from cosim.channels.bluetooth.packets import ACL
from cosim.channels.bluetooth.polling import MOST_SLAVES
from cosim.channels.bluetooth.settings import BluetoothSettings
from cosim.channels.kinds import ChannelSite, ChannelSpec
from cosim.channels.propagation import PropagationSettings
from cosim.protocol import PayloadBytes


def _made(settings: BluetoothSettings, site: ChannelSite) -> Channel:
    from cosim.channels.bluetooth.device import BluetoothChannel  # only a run needs the model

    walls = site.walls, site.wall_loss_db
    run = site.kernel, site.trace, site.size, site.streams
    return BluetoothChannel(settings, *run, walls, site.power_classes, site.air)


def _payload_bytes(settings: BluetoothSettings) -> PayloadBytes:
    longest = max(ACL[name].capacity for name in settings.packet_types)
    return PayloadBytes(longest, longest)


def _fades(settings: BluetoothSettings) -> PropagationSettings | None:
    """Return how signals fade; raise ValueError if nothing disturbs them."""
    if settings.interference == "none":
        raise ValueError("interference none: nothing disturbs it")
    return settings.propagation


SPEC: Final = ChannelSpec(
    BluetoothSettings,
    _made,
    links=lambda settings: MOST_SLAVES,
    payload_bytes=_payload_bytes,
    fades=_fades,
    arbitrated=True,
)
"""The channel."""
