"""The packet type that a payload is sent in, chosen when it is sent for the first time."""

from cosim.channels.bluetooth.errors import best_type
from cosim.channels.bluetooth.links import Links
from cosim.channels.bluetooth.packets import PacketType
from cosim.channels.bluetooth.polling import EVERYONE
from cosim.channels.bluetooth.queues import Payload
from cosim.channels.bluetooth.radio import Air


class BestFit:
    """Of *types* the one with the best expected rate at the Es/N0 of the link now; a broadcast's is the worst link's.

    Interference is not looked at: the sender cannot know what it will meet.
    """

    def __init__(self, air: Air, links: Links, types: tuple[PacketType, ...]) -> None:
        self._air = air
        self._links = links
        self._types = types

    def __call__(self, payload: Payload, up: bool) -> None:
        """Give *payload*, which goes *up* to the master or down, its type; it must fit into one of the types."""
        length = len(payload.outgoing.payload)
        payload.kind = best_type(self._types, length, self._es_n0_db(payload.lt_addr, up))
        payload.air = payload.kind.air_time(length)

    def _es_n0_db(self, k: int, up: bool) -> float:
        links, carrier = self._links, self._air.carrier
        if k == EVERYONE:
            power_dbm = min((carrier(links.master, slave) for slave in links.slaves.values()), default=float("-inf"))
        elif up:
            power_dbm = carrier(links.slaves[k], links.master)
        else:
            power_dbm = carrier(links.master, links.slaves[k])
        return power_dbm - float(self._air.band.medium.noise_dbm[0]) if power_dbm > float("-inf") else power_dbm
