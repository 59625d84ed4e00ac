"""A channel that tells all that it sends by itself, and a band with one."""

from cosim.channels.air.band import Band
from cosim.units import Time


class Quiet:
    """A channel that never runs ahead, and may ask for anything since *asks_from*."""

    def __init__(self, asks_from: Time = 0) -> None:
        self.asks_from = asks_from

    def catch_up(self, until: Time) -> None:
        pass


def band_of(size: int, tenants: int = 2, isolation_db: float = 20.0) -> Band:
    """Return a band between *size* radios with channels that tell all by themselves."""
    band = Band(size, isolation_db)
    for _ in range(tenants):
        band.join(Quiet())
    return band
