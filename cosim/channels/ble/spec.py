"""What cosim must know of Bluetooth Low Energy: the entry point ``ble`` names ``SPEC``."""

from typing import Final

from cosim.channels.base import Channel
from cosim.channels.ble.settings import BleSettings
from cosim.channels.kinds import ChannelSite, ChannelSpec
from cosim.channels.propagation import PropagationSettings
from cosim.protocol import PayloadBytes


def _made(settings: BleSettings, site: ChannelSite) -> Channel:
    from cosim.channels.ble.channel import BleChannel  # only a run needs the model

    walls = site.walls, site.wall_loss_db
    return BleChannel(settings, site.kernel, site.trace, site.size, site.streams, walls, site.powers_dbm, site.air)


def _payload_bytes(settings: BleSettings) -> PayloadBytes:
    from cosim.channels.ble.broadcasts.ways import WAYS  # as the model, whose part it is
    from cosim.channels.ble.session import NOTIFICATION

    return PayloadBytes(settings.connection.mtu_octets - len(NOTIFICATION), WAYS[settings.broadcast.by].longest)


def _fades(settings: BleSettings) -> PropagationSettings | None:
    """Return how signals fade; raise ValueError if nothing disturbs them."""
    if settings.interference != "band":
        raise ValueError(f"interference {settings.interference}: nothing disturbs it")
    return settings.propagation


SPEC: Final = ChannelSpec(
    BleSettings,
    _made,
    lambda settings: None if settings.propagation is None else "power_dbm",
    lambda settings: settings.connection.parts,
    _payload_bytes,
    lambda settings: False,  # a device is in all of its piconets, whose events are at other times
    _fades,
    arbitrated=True,
)
"""The channel."""
