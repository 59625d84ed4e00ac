"""What a router leaves for its station and its host, until they drain it."""

from typing import Final

from cosim.channels.adhoc.routing.base import Delivery, Hop, Unsent
from cosim.channels.adhoc.routing.ip import HEADER_OCTETS
from cosim.machine import Address, Outcome

MOST_OCTETS: Final = 0xFFFF - HEADER_OCTETS
"""Of a payload: what one IPv4 packet holds."""


class Queues:
    """Packets, payloads and fates that wait to be drained."""

    def __init__(self, address: Address) -> None:
        self._address = address
        self._hops: list[Hop] = []
        self._deliveries: list[Delivery] = []
        self._fates: list[tuple[int, Outcome]] = []
        self._unsent: list[Unsent] = []

    def hops(self) -> list[Hop]:
        """Drain packets for the station."""
        hops, self._hops = self._hops, []
        return hops

    def deliveries(self) -> list[Delivery]:
        """Drain payloads for the host."""
        deliveries, self._deliveries = self._deliveries, []
        return deliveries

    def fates(self) -> list[tuple[int, Outcome]]:
        """Drain what has become of payloads."""
        fates, self._fates = self._fates, []
        return fates

    def unsent(self) -> list[Unsent]:
        """Drain payloads of the host that it could not send at all."""
        unsent, self._unsent = self._unsent, []
        return unsent

    def _tell(self, token: int | None, outcome: Outcome) -> None:
        if token is not None:
            self._fates.append((token, outcome))

    def _settled(self, destination: Address, payload: bytes, token: int | None) -> bool:
        """Return whether *payload* needs no radio: no packet holds it (TOO_LONG), or it is for this robot."""
        if len(payload) > MOST_OCTETS:
            self._unsent.append(Unsent(destination, len(payload), Outcome.TOO_LONG))
            self._tell(token, Outcome.TOO_LONG)
            return True
        if destination == self._address:
            self._deliveries.append(Delivery(destination, payload, False))
            self._tell(token, Outcome.DELIVERED)
            return True
        return False
