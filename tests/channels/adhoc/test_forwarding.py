"""Routers between hosts and stations: what a station has no room for, and what is counted in several lives."""

import numpy as np
import pytest

from cosim.channels.adhoc.channel import AdhocChannel
from cosim.channels.adhoc.forwarding import Forwarding, make_router
from cosim.channels.adhoc.mac import Packet
from cosim.channels.adhoc.routing.aodv_settings import AodvSettings
from cosim.channels.adhoc.routing.base import Delivery
from cosim.channels.adhoc.routing.flooding import FloodingSettings
from cosim.channels.adhoc.routing.ip import PAYLOAD_PORT, decode
from cosim.channels.adhoc.routing.olsr import OlsrSettings
from cosim.channels.adhoc.settings import AdhocSettings, RoutingSettings
from cosim.kernel import Kernel
from cosim.machine import Address, Outcome, Outgoing
from cosim.randomness import Draws, Streams
from cosim.trace import Trace
from cosim.units import S

SETTINGS: list[RoutingSettings] = [
    FloodingSettings(),
    AodvSettings(use_hello=False),
    OlsrSettings(use_mac_feedback=True),
]


class Stations:
    """Two stations in reach of each other; the first refuses payloads when it is *full*."""

    def __init__(self, settings: RoutingSettings) -> None:
        self.kernel = Kernel()
        self.full = False
        self.heard: list[bytes] = []
        self.fates: list[tuple[int, Outcome]] = []
        draws = Draws(1, "forwarding")
        self.routers = Forwarding(2, lambda robot, now: make_router(settings, robot, draws, now), self.kernel, self)

    def transmit(self, address: Address, packet: Packet) -> None:
        if self.full and address == 0 and decode(packet.payload).port == PAYLOAD_PORT:
            self.routers.refused(address, packet)
        else:
            self.kernel.after(1_000_000, lambda: self._arrive(address, packet))

    def _arrive(self, address: Address, packet: Packet) -> None:
        self.routers.received([1 - address], address, packet.payload)
        self.routers.done(address, packet, True)

    def arrived(self, address: Address, delivery: Delivery) -> None:
        self.heard.append(delivery.payload)

    def note_unsent(self, source: Address, destination: Address, length: int, why: Outcome) -> None:
        raise AssertionError("everybody has a route here")

    def report_fate(self, address: Address, token: int, outcome: Outcome) -> None:
        self.fates.append((token, outcome))


@pytest.mark.parametrize("settings", SETTINGS, ids=lambda each: each.kind)
def test_a_full_station_loses_a_payload_and_breaks_no_link(settings: RoutingSettings) -> None:
    net = Stations(settings)
    for token, (second, full) in enumerate([(30, False), (31, True), (32, False)]):
        net.kernel.run(second * S)
        net.full = full
        net.routers.send(0, Outgoing(1, bytes([token]), token))
    net.kernel.run(33 * S)
    good = Outcome.SENT if settings.kind == "flooding" else Outcome.DELIVERED
    assert net.fates == [(0, good), (1, Outcome.QUEUE_FULL), (2, good)]
    assert net.heard == [b"\0", b"\2"]
    counts = net.routers.summary()
    assert counts.get("links_broken", 0) == 0
    assert counts.get("route_requests", 1) == 1
    assert counts.get("payloads_unrouted", 1) == 1
    assert {metric.name for metric in net.routers.metrics} == set(counts)


def test_what_a_router_has_counted_in_an_earlier_life_is_not_lost() -> None:
    net = Stations(OlsrSettings())
    net.kernel.run(30 * S)
    before = net.routers.summary()["control_packets"]
    assert before > 20
    net.routers.power(0, False)
    net.routers.power(0, True)
    assert net.routers.summary()["control_packets"] == before
    net.kernel.run(40 * S)
    assert net.routers.summary()["control_packets"] > before + 5


@pytest.mark.parametrize(
    ("only_failure", "there", "told"), [(True, True, []), (True, False, [False]), (False, True, [True])]
)
def test_who_asks_for_a_failure_only_hears_of_no_acknowledgement(
    only_failure: bool, there: bool, told: list[bool], monkeypatch: pytest.MonkeyPatch
) -> None:
    heard: list[bool] = []
    kernel = Kernel()
    channel = AdhocChannel(AdhocSettings(range_m=10.0), kernel, Trace(()), 2, Streams(1))
    monkeypatch.setattr(channel, "received", lambda *heard: None)
    monkeypatch.setattr(channel, "done", lambda address, packet, acknowledged: heard.append(acknowledged))
    channel.moved(np.array([(0.0, 0.0), (5.0 if there else 50.0, 0.0)]))
    kernel.at(0, lambda: channel.transmit(0, Packet(1, b"data", "token", only_failure)))
    kernel.run(S)
    assert heard == told
