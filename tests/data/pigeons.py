"""A channel of a user's own: pigeons, which carry a payload to whoever it is for, as fast as they fly."""

from cosim.channels.ideal import IdealChannel, IdealSettings
from cosim.channels.kinds import ChannelSettings, ChannelSite, ChannelSpec
from cosim.settings import Metres, Rate


class PigeonSettings(ChannelSettings):
    """Messages are carried by birds."""

    kind: str = "pigeons"
    loft_m: Metres = 100.0
    speed_mps: Rate = 20.0


def make(settings: PigeonSettings, site: ChannelSite) -> IdealChannel:
    delay_s = settings.loft_m / settings.speed_mps
    return IdealChannel(IdealSettings(delay_s=delay_s), site.kernel, site.trace, site.size, site.streams)


SPEC = ChannelSpec(PigeonSettings, make)
NO_SPEC = PigeonSettings
