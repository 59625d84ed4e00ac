"""A router that knows where all stations are and which are on: no router can do better.

For every payload, at every hop, it asks networkx for a shortest way among those that are on. It sends nothing of its
own.
"""

from collections.abc import Sequence
from itertools import count
from typing import ClassVar

import networkx as nx

from cosim.channels.adhoc.mac import Packet
from cosim.channels.adhoc.routing.base import Delivery, Queues, counts
from cosim.channels.adhoc.routing.ip import PAYLOAD_PORT, Datagram, decode, encode
from cosim.machine import Address, Outcome
from cosim.protocol import Metric
from cosim.units import Time

TTL = 64


def reach(places_m: Sequence[tuple[float, float]], range_m: float) -> "nx.Graph[Address]":
    """Return which stations at *places_m* reach which, by number."""
    return nx.random_geometric_graph(len(places_m), range_m, pos=dict(enumerate(places_m)))


class Omniscient(Queues):
    """One robot's router."""

    metrics: ClassVar[tuple[Metric, ...]] = counts("control_octets")

    def __init__(self, address: Address, graph: "nx.Graph[Address]") -> None:
        """Read *graph*, all stations that are on and reach each other, again for every payload."""
        super().__init__(address)
        self._graph = graph
        self._sent: dict[int, tuple[Datagram, int | None]] = {}
        self._numbers = count()

    def send(self, destination: Address, payload: bytes, token: int | None, now: Time) -> None:
        """Send *payload* over a shortest way; its fate is DELIVERED when a neighbour has it, or NO_ROUTE."""
        if not self._settled(destination, payload, token):
            self._route(Datagram(self._address, destination, TTL, PAYLOAD_PORT, 0, payload), token)

    def receive(self, packet: bytes, hop: Address, now: Time) -> bool:
        """Take a payload, or pass it on."""
        datagram = decode(packet)
        if datagram.destination == self._address:
            self._deliveries.append(Delivery(datagram.source, datagram.data, False))
        else:
            self._route(datagram, None)
        return True

    def hop_done(self, token: int, acknowledged: bool, now: Time) -> None:
        """Send a payload another way that a neighbour has not taken: that one is known to be off."""
        datagram, told = self._sent.pop(token)
        if acknowledged:
            self._report_fate(told, Outcome.DELIVERED)
        else:
            self._route(datagram, told)

    def hop_refused(self, token: int, now: Time) -> None:
        """Lose a payload that the station has no room for."""
        self._report_fate(self._sent.pop(token)[1], Outcome.QUEUE_FULL)

    def wake(self, now: Time) -> None:
        """Do nothing."""

    def wake_at(self) -> Time | None:
        """Return that nothing will ever be due."""
        return None

    def summary(self) -> dict[str, float]:
        """Return that it has sent nothing."""
        return {"control_octets": 0.0}

    def _route(self, datagram: Datagram, token: int | None) -> None:
        try:
            neighbour = nx.shortest_path(self._graph, self._address, datagram.destination)[1]
        except (nx.NetworkXNoPath, nx.NodeNotFound):
            self._report_fate(token, Outcome.NO_ROUTE)
            return
        number = next(self._numbers)
        self._sent[number] = datagram, token
        self._hops.append(Packet(neighbour, encode(datagram), number))
