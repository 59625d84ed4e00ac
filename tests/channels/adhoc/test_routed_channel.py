"""Payloads over several hops of a real 802.11: flooding, AODV and OLSR, and what happens when a relay goes off."""

from typing import Any

import numpy as np
import pytest

from cosim.channels.adhoc.channel import AdhocChannel
from cosim.channels.adhoc.settings import AdhocSettings
from cosim.kernel import Kernel
from cosim.machine import BROADCAST, Address, Fate, LinkEvent, Outcome, Outgoing, Reception
from cosim.randomness import Streams
from cosim.trace import FRAMES, Trace
from cosim.units import S, Time

ROUTERS = ["flooding", "aodv", "olsr"]
LINE = [(15.0 * n, 0.0) for n in range(5)]
RING = [(0.0, 0.0), (15.0, 8.0), (30.0, 0.0), (15.0, -8.0)]


class Host:
    def __init__(self) -> None:
        self.heard: list[tuple[Time, Address, bytes, bool]] = []
        self.events: list[LinkEvent] = []

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        self.heard.append((now, reception.source, data, reception.broadcast))

    def link(self, event: LinkEvent, now: Time) -> None:
        self.events.append(event)

    def drain(self, now: Time) -> None:
        pass


class Field:
    def __init__(
        self, places_m: list[tuple[float, float]], kind: str, most: int | None = None, **settings: Any
    ) -> None:
        self.kernel = Kernel()
        given = AdhocSettings(range_m=20.0, queue_payloads=most, routing={"kind": kind, **settings})
        self.channel = AdhocChannel(given, self.kernel, Trace((FRAMES,)), len(places_m), Streams(5))
        self.hosts = [Host() for _ in places_m]
        for address, host in enumerate(self.hosts):
            self.channel.attach(address, host)
        self.channel.moved(np.array(places_m))

    def send_at(
        self, at: Time, source: Address, destination: Address, payload: bytes, token: int | None = None
    ) -> None:
        self.kernel.at(at, lambda: self.channel.send(source, Outgoing(destination, payload, token)))


@pytest.mark.parametrize("kind", ROUTERS)
def test_a_payload_gets_from_end_to_end_of_a_line_and_back(kind: str) -> None:
    field = Field(LINE, kind)
    for second in range(30, 40):
        field.send_at(second * S, 0, 4, b"there")
        field.send_at(second * S + S // 2, 4, 0, b"back")
    field.kernel.run(60 * S)
    assert [(source, data, to_all) for _, source, data, to_all in field.hosts[4].heard] == [(0, b"there", False)] * 10
    assert [(source, data, to_all) for _, source, data, to_all in field.hosts[0].heard] == [(4, b"back", False)] * 10
    assert all(not host.heard for host in field.hosts[1:4])


@pytest.mark.parametrize("kind", ROUTERS)
def test_a_broadcast_gets_to_everybody_once(kind: str) -> None:
    field = Field(LINE, kind)
    field.send_at(30 * S, 2, BROADCAST, b"all")
    field.kernel.run(40 * S)
    told = [[(source, data, to_all) for _, source, data, to_all in host.heard] for host in field.hosts]
    assert told == [[(2, b"all", True)] if robot != 2 else [] for robot in range(5)]


@pytest.mark.parametrize("kind", ROUTERS)
def test_when_a_relay_goes_off_another_takes_over(kind: str) -> None:
    """Two ways lead round the ring; the one in use dies while payloads go. A rebooted relay is asked at once."""
    field = Field(RING, kind, **({"reboot_hold": False} if kind == "aodv" else {}))
    for tenth in range(300, 600):
        field.send_at(tenth * S // 10, 0, 2, tenth.to_bytes(2, "big"))
    field.kernel.at(35 * S, lambda: field.channel.power(1, False))
    field.kernel.run(38 * S)
    field.kernel.at(45 * S, lambda: field.channel.power(1, True))
    field.kernel.at(46 * S, lambda: field.channel.power(3, False))
    field.kernel.run(70 * S)
    arrived = {int.from_bytes(data, "big") for _, _, data, _ in field.hosts[2].heard}
    assert len(field.hosts[2].heard) == len(arrived), "none twice"
    assert {*range(300, 349), *range(440, 459), *range(560, 599)} <= arrived


def test_a_relay_that_starts_anew_is_none_for_aodv_until_its_routes_are_forgotten() -> None:
    """RFC 3561, 6.13: for DELETE_PERIOD, 15 s, it passes nothing on. At 45 s it starts, at 46 s the other one dies."""
    field = Field(RING, "aodv", net_diameter=2)
    for tenth in range(300, 650):
        field.send_at(tenth * S // 10, 0, 2, tenth.to_bytes(2, "big"))
    field.kernel.at(35 * S, lambda: field.channel.power(1, False))
    field.kernel.at(45 * S, lambda: field.channel.power(1, True))
    field.kernel.at(46 * S, lambda: field.channel.power(3, False))
    field.kernel.run(60 * S)
    arrived = [int.from_bytes(data, "big") for _, _, data, _ in field.hosts[2].heard]
    assert arrived == [*range(300, 460)]
    field.kernel.run(70 * S)
    arrived = [int.from_bytes(data, "big") for _, _, data, _ in field.hosts[2].heard[160:]]
    # a search without an answer takes at most 240 + 160 + 320 + 640 ms, and the next payload begins another
    assert {*range(614, 650)} <= {*arrived}


@pytest.mark.parametrize("kind", ["aodv", "olsr"])
def test_own_payloads_without_a_route_are_counted_as_never_sent_with_a_token_or_without(kind: str) -> None:
    field = Field([(0.0, 0.0), (15.0, 0.0), (100.0, 0.0)], kind)
    field.send_at(40 * S, 0, 2, b"lost", token=4)
    field.send_at(41 * S, 0, 2, b"lost too")
    field.send_at(42 * S, 1, 0, b"found")
    field.send_at(43 * S, 1, 0, bytes(1 << 16))
    field.kernel.run(80 * S)
    assert field.channel.unsent == {(0, Outcome.NO_ROUTE): 2, (1, Outcome.TOO_LONG): 1}


def test_who_has_no_way_is_told_so_by_aodv() -> None:
    field = Field([(0.0, 0.0), (15.0, 0.0), (100.0, 0.0)], "aodv", net_diameter=3)
    field.send_at(1 * S, 0, 2, b"lost", token=4)
    field.send_at(1 * S, 0, 1, b"found", token=5)
    field.kernel.run(30 * S)
    assert Fate(4, Outcome.NO_ROUTE) in field.hosts[0].events
    assert Fate(5, Outcome.DELIVERED) in field.hosts[0].events


@pytest.mark.parametrize("kind", ROUTERS)
def test_a_payload_that_a_full_radio_refuses_is_told_so_and_breaks_no_link(kind: str) -> None:
    field = Field(LINE[:3], kind, most=2, **({} if kind == "flooding" else {"use_mac_feedback": True}))
    field.send_at(30 * S, 0, 2, b"first")
    for token in range(5):
        field.send_at(35 * S, 0, 2, bytes([token]), token)
    field.send_at(36 * S, 0, 2, b"last")
    field.kernel.run(37 * S)
    good = Outcome.SENT if kind == "flooding" else Outcome.DELIVERED
    told = {event.token: event.outcome for event in field.hosts[0].events if isinstance(event, Fate)}
    assert told == {0: good, 1: good, 2: Outcome.QUEUE_FULL, 3: Outcome.QUEUE_FULL, 4: Outcome.QUEUE_FULL}
    assert [data for _, _, data, _ in field.hosts[2].heard] == [b"first", b"\0", b"\1", b"last"]
    assert field.channel.summary().get("links_broken", 0) == 0
