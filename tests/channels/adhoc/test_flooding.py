"""Flooding: everybody gets it, nobody repeats it twice, only whom it is for delivers it."""

from collections import Counter

import networkx as nx
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.channels.adhoc.routing.base import Delivery
from cosim.channels.adhoc.routing.flooding import Flooding, FloodingSettings
from cosim.channels.adhoc.routing.ip import AODV_PORT, PAYLOAD_PORT, Datagram, decode, encode
from cosim.machine import BROADCAST, Outcome
from cosim.randomness import Draws
from cosim.units import MS, S
from tests.channels.adhoc.lossless_hops import DELAY, LosslessHops

GRAPHS = {
    "line": nx.path_graph(8),
    "ring": nx.cycle_graph(9),
    "full": nx.complete_graph(6),
    "random": nx.connected_watts_strogatz_graph(14, 4, 0.4, seed=3),
}


def flooding(address: int, **settings: float) -> Flooding:
    return Flooding(address, FloodingSettings.model_validate(settings), Draws(1, "flooding"))


def network(graph: nx.Graph, **settings: float) -> LosslessHops:
    return LosslessHops([flooding(address, **settings) for address in range(len(graph))], graph.edges)


@pytest.mark.parametrize("name", GRAPHS)
def test_a_payload_to_all_reaches_everybody_once_and_is_sent_once_by_everybody(name: str) -> None:
    net = network(GRAPHS[name])
    net.send(2, BROADCAST, b"all")
    net.run(S)
    others = [address for address in range(len(net.routers)) if address != 2]
    assert sorted(address for _, address, _ in net.delivered) == others
    assert {each for _, _, each in net.delivered} == {Delivery(2, b"all", True)}
    assert Counter(address for _, address, _ in net.sent) == dict.fromkeys(range(len(net.routers)), 1)


@pytest.mark.parametrize("name", GRAPHS)
def test_a_payload_to_one_is_delivered_there_only_and_not_repeated_there(name: str) -> None:
    net = network(GRAPHS[name])
    net.send(0, 4, b"four")
    net.run(S)
    assert [(address, each) for _, address, each in net.delivered] == [(4, Delivery(0, b"four", False))]
    assert 4 not in {address for _, address, _ in net.sent}


def test_without_jitter_it_travels_a_hop_in_the_time_of_a_hop() -> None:
    net = network(GRAPHS["ring"], jitter_s=0)
    net.send(0, BROADCAST, b"")
    net.run(S)
    hops = nx.single_source_shortest_path_length(GRAPHS["ring"], 0)
    assert {address: time for time, address, _ in net.delivered} == {
        address: n * DELAY for address, n in hops.items() if n
    }


def test_jitter_delays_what_is_repeated_and_nothing_else() -> None:
    net = network(GRAPHS["full"], jitter_s=0.02)
    net.send(0, BROADCAST, b"")
    net.run(S)
    times = {address: time for time, address, _ in net.sent}
    assert times.pop(0) == 0
    assert all(DELAY <= time <= DELAY + 20 * MS for time in times.values())
    assert len(set(times.values())) == 5
    assert max(times.values()) > 6 * MS


def test_it_makes_as_many_hops_as_its_time_to_live() -> None:
    net = network(GRAPHS["line"], ttl=3)
    net.send(0, BROADCAST, b"")
    net.run(S)
    assert sorted(address for _, address, _ in net.delivered) == [1, 2, 3]
    assert sorted((address, decode(hop.payload).ttl) for _, address, hop in net.sent) == [(0, 3), (1, 2), (2, 1)]


def test_a_number_that_returns_after_the_hold_time_is_a_new_payload() -> None:
    router = flooding(1, dup_hold_s=30.0)
    packet = encode(Datagram(0, BROADCAST, 9, PAYLOAD_PORT, 77, b"x"))
    for now, new in ((0, 1), (30 * S - 1, 0), (30 * S, 1), (59 * S, 0)):
        router.receive(packet, 0, now)
        assert len(router.deliveries()) == new


def test_two_sources_may_use_the_same_number() -> None:
    router = flooding(1)
    for source in (0, 2):
        router.receive(encode(Datagram(source, BROADCAST, 9, PAYLOAD_PORT, 77, b"x")), source, 0)
    assert len(router.deliveries()) == 2


def test_a_robot_takes_no_notice_of_its_own_payloads() -> None:
    router = flooding(0)
    router.send(BROADCAST, b"x", None, 0)
    (hop,) = router.hops()
    router.receive(hop.payload, 1, MS)
    assert router.deliveries() == []
    assert router.wake_at() is None


def test_the_host_learns_that_its_payload_was_on_the_air() -> None:
    net = network(GRAPHS["line"])
    net.send(0, 3, b"", token=5)
    net.send(0, BROADCAST, b"", token=6)
    net.run(S)
    assert net.fates == [(DELAY, 0, 5, Outcome.SENT), (DELAY, 0, 6, Outcome.SENT)]


def test_a_payload_that_no_packet_holds_is_refused() -> None:
    router = flooding(0)
    router.send(BROADCAST, bytes(65_508), 1, 0)
    assert router.fates() == [(1, Outcome.TOO_LONG)]
    assert router.hops() == []
    router.send(BROADCAST, bytes(65_507), 2, 0)
    assert (router.fates(), len(router.hops())) == ([], 1)


def test_a_payload_to_oneself_is_there_at_once() -> None:
    router = flooding(0)
    router.send(0, b"me", 1, 0)
    assert router.deliveries() == [Delivery(0, b"me", False)]
    assert router.fates() == [(1, Outcome.DELIVERED)]
    assert router.hops() == []


def test_a_robot_that_restarts_goes_on_with_other_numbers() -> None:
    numbers = []
    for now in (0, 10 * S):
        router = Flooding(0, FloodingSettings(), Draws(1, "flooding"), now)
        router.send(BROADCAST, b"", None, now)
        numbers += [decode(hop.payload).number for hop in router.hops()]
    assert numbers[0] != numbers[1]


def test_all_robots_at_once_are_no_source() -> None:
    router = flooding(0)
    router.receive(encode(Datagram(BROADCAST, 0, 9, PAYLOAD_PORT, 1, b"")), 1, 0)
    assert router.deliveries() == []
    assert router.summary()["packets_malformed"] == 1


@given(st.binary(max_size=60))
def test_bytes_that_make_no_sense_are_counted(data: bytes) -> None:
    router = flooding(0)
    router.receive(data, 1, 0)
    router.receive(encode(Datagram(1, BROADCAST, 9, AODV_PORT, 1, data)), 1, 0)
    assert router.summary() == {"payloads_forwarded": 0, "packets_malformed": 2}
    assert (router.hops(), router.deliveries(), router.wake_at()) == ([], [], None)
