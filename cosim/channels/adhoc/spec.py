"""What cosim must know of 802.11 ad hoc networks: the entry point ``adhoc`` names ``SPEC``."""

from typing import Final

from cosim.channels.adhoc.routing.base import MOST_OCTETS
from cosim.channels.adhoc.settings import UNJAMMED, AdhocSettings
from cosim.channels.base import Channel
from cosim.channels.kinds import ChannelSite, ChannelSpec
from cosim.channels.propagation import PropagationSettings
from cosim.protocol import PayloadBytes


def _made(settings: AdhocSettings, site: ChannelSite) -> Channel:
    from cosim.channels.adhoc.channel import AdhocChannel  # only a run needs the model

    strengths = site.reaches_m if settings.propagation is None else site.powers_dbm
    walls = site.walls, site.wall_loss_db
    return AdhocChannel(settings, site.kernel, site.trace, site.size, site.streams, walls, strengths, site.air)


def _payload_bytes(settings: AdhocSettings) -> PayloadBytes:
    """Return what one IPv4 packet holds, if routers make packets; a station alone sends payloads of any length."""
    return PayloadBytes() if settings.routing is None else PayloadBytes(MOST_OCTETS, MOST_OCTETS)


def _fades(settings: AdhocSettings) -> PropagationSettings | None:
    """Return how signals fade; raise ValueError for what shares no air."""
    if settings.phy in UNJAMMED:
        raise ValueError(f"phy {settings.phy}: {UNJAMMED[settings.phy]}")
    return settings.propagation


SPEC: Final = ChannelSpec(
    AdhocSettings,
    _made,
    lambda settings: "reach_m" if settings.propagation is None else "power_dbm",
    payload_bytes=_payload_bytes,
    fades=_fades,
    listens=True,
    arbitrated=True,
)
"""The channel."""
