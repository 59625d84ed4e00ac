"""Which router a network has."""

from typing import Annotated, TypeAlias

from pydantic import Field

from cosim.channels.adhoc.routing.aodv import Aodv
from cosim.channels.adhoc.routing.aodv_settings import AodvSettings
from cosim.channels.adhoc.routing.base import Router
from cosim.channels.adhoc.routing.flooding import Flooding, FloodingSettings
from cosim.channels.adhoc.routing.olsr import Olsr, OlsrSettings
from cosim.machine import Address
from cosim.randomness import Draws
from cosim.units import Time

RoutingSettings: TypeAlias = Annotated[FloodingSettings | AodvSettings | OlsrSettings, Field(discriminator="kind")]


def make_router(settings: RoutingSettings, address: Address, draws: Draws, now: Time) -> Router:
    """Return the router of the robot *address*, which begins at *now* and knows nothing."""
    match settings:
        case FloodingSettings():
            return Flooding(address, settings, draws, now)
        case AodvSettings():
            return Aodv(address, settings, draws, now)
        case OlsrSettings():
            return Olsr(address, settings, draws, now)
