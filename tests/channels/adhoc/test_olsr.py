"""OLSR on a network whose hops never fail: routes, relays, and how fast links come and go."""

from itertools import groupby

import networkx as nx
import pytest

from cosim.channels.adhoc.routing.base import Delivery
from cosim.channels.adhoc.routing.ip import PAYLOAD_PORT, decode
from cosim.channels.adhoc.routing.olsr import Olsr, OlsrSettings
from cosim.channels.adhoc.routing.olsr_wire import TC, decode_tc
from cosim.machine import Outcome
from cosim.randomness import Draws
from cosim.units import MS, S, Time
from tests.channels.adhoc.lossless_hops import DELAY, LosslessHops
from tests.channels.adhoc.olsr_cases import (
    CONVERGED,
    GRAPHS,
    JITTER,
    converged,
    gone_at,
    last_hello,
    messages,
    network,
    olsr,
    router,
)


@pytest.mark.parametrize("name", GRAPHS)
def test_routes_have_as_few_hops_as_there_can_be_and_lead_there(name: str) -> None:
    net, graph = converged(name), GRAPHS[name]
    for source, hops in nx.all_pairs_shortest_path_length(graph):
        routes = router(net, source).routes(net.now)
        assert {far: route.hops for far, route in routes.items()} == {far: n for far, n in hops.items() if n}
        for far, route in routes.items():
            assert graph.has_edge(source, route.next_hop)
            assert nx.shortest_path_length(graph, route.next_hop, far) == route.hops - 1


@pytest.mark.parametrize("name", GRAPHS)
def test_relays_reach_everybody_two_hops_away(name: str) -> None:
    net, graph = converged(name), GRAPHS[name]
    for address in graph:
        relays = router(net, address).relays(net.now)
        far = {each for each, n in nx.single_source_shortest_path_length(graph, address).items() if n == 2}
        assert relays <= set(graph[address])
        assert far <= {each for relay in relays for each in graph[relay]}


@pytest.mark.parametrize("settings", [{}, {"hysteresis": True}, {"use_mac_feedback": True, "mpr_coverage": 2}], ids=str)
def test_after_all_links_have_changed_routes_are_right_again(settings: dict[str, object]) -> None:
    net = network(nx.empty_graph(9), **settings)
    for seed in range(3):
        graph = nx.gnp_random_graph(9, 0.25, seed=seed)  # seldom connected
        net.links = {frozenset(edge) for edge in graph.edges}
        for source in graph:
            net.send(source, (source + 1) % 9, b"")
        net.run(net.now + 45 * S)  # 6 s until links end, 5 s until TCs tell it, 15 s until those of who is gone do
        for source, hops in nx.all_pairs_shortest_path_length(graph):
            routes = router(net, source).routes(net.now)
            assert {far: route.hops for far, route in routes.items()} == {far: n for far, n in hops.items() if n}


def test_a_payload_to_one_goes_from_hop_to_hop() -> None:
    net = converged("line")
    begin = len(net.sent)
    net.send(0, 4, b"four", token=9)
    net.run(net.now + 10 * MS)
    assert net.delivered == [(CONVERGED + 4 * DELAY, 4, Delivery(0, b"four", False))]
    assert net.fates == [(CONVERGED + DELAY, 0, 9, Outcome.DELIVERED)]
    path = [(n, hop.destination) for _, n, hop in net.sent[begin:] if decode(hop.payload).port == PAYLOAD_PORT]
    assert path == [(0, 1), (1, 2), (2, 3), (3, 4)]


def test_a_payload_makes_as_many_hops_as_its_time_to_live() -> None:
    net = converged("line", payload_ttl=3)
    net.send(0, 3, b"")
    net.send(0, 4, b"")
    net.run(net.now + S)
    assert [address for _, address, _ in net.delivered] == [3]
    assert [router(net, address).summary()["payloads_unrouted"] for address in range(7)] == [0, 0, 0, 1, 0, 0, 0]


def test_without_a_way_the_host_is_told_at_once() -> None:
    net = network(nx.empty_graph(2))
    net.run(CONVERGED)
    net.send(0, 1, b"", token=3)
    assert net.fates == [(CONVERGED, 0, 3, Outcome.NO_ROUTE)]
    assert router(net, 0).summary()["payloads_unrouted"] == 1


def test_two_hops_never_lead_over_a_robot_that_does_not_forward() -> None:
    graph = nx.cycle_graph(4)  # 2 is reached from 0 over 1 and 3
    routers = [olsr(address, willingness=0 if address == 1 else 3) for address in graph]
    net = LosslessHops([*routers], graph.edges)
    net.run(CONVERGED)
    assert routers[0].routes(net.now)[2].next_hop == 3
    assert routers[0].relays(net.now) == {3}
    assert all(1 not in each.relays(net.now) for each in routers)


@pytest.mark.parametrize(("hysteresis", "after"), [(False, 6 * S), (True, 4 * S)])
def test_a_dead_link_is_noticed_after_the_hold_time_or_two_lost_hellos(hysteresis: bool, after: Time) -> None:
    net = network(nx.path_graph(2), hysteresis=hysteresis)
    net.run(CONVERGED)
    net.links.clear()
    heard = last_hello(net, 1)
    assert heard > CONVERGED - 2 * S
    net.run(heard + after - 1)
    assert 1 in router(net, 0).routes(net.now)
    net.run(heard + after)
    assert router(net, 0).routes(net.now) == {}


def test_with_mac_feedback_the_first_lost_payload_breaks_the_link() -> None:
    net = network(nx.path_graph(2), use_mac_feedback=True)
    net.run(CONVERGED)
    net.links.clear()
    net.send(0, 1, b"", token=4)
    assert 1 in router(net, 0).routes(net.now)
    net.run(net.now + DELAY)
    assert router(net, 0).routes(net.now) == {}
    assert net.fates == [(CONVERGED + DELAY, 0, 4, Outcome.UNACKNOWLEDGED)]
    assert router(net, 0).summary()["links_broken"] == 1


def test_with_mac_feedback_the_next_payload_takes_another_way() -> None:
    net = network(nx.complete_graph(3), use_mac_feedback=True)
    net.run(CONVERGED)
    net.links.remove(frozenset((0, 1)))
    for payload in (b"lost", b"over 2"):
        net.send(0, 1, payload)
        net.run(net.now + 5 * MS)
    assert net.delivered == [(CONVERGED + 5 * MS + 2 * DELAY, 1, Delivery(0, b"over 2", False))]


def test_a_link_that_the_mac_has_broken_is_told_as_lost_for_the_hold_time() -> None:
    net = network(nx.path_graph(2), use_mac_feedback=True)
    net.run(CONVERGED)
    net.links.clear()
    net.send(0, 1, b"")
    net.run(net.now + DELAY)
    net.links.add(frozenset((0, 1)))
    broken = net.now
    assert gone_at(net, 1, 0, broken + 2 * S + 20 * MS) > broken  # the other side, with the next HELLO
    net.run(broken + 6 * S - 1)
    assert router(net, 0).routes(net.now) == {}
    net.run(broken + 6 * S)
    assert 1 in router(net, 0).routes(net.now)


def test_without_mac_feedback_a_lost_payload_breaks_nothing() -> None:
    net = network(nx.path_graph(2))
    net.run(CONVERGED)
    net.links.clear()
    net.send(0, 1, b"")
    net.run(net.now + DELAY)
    assert 1 in router(net, 0).routes(net.now)


@pytest.mark.parametrize("seed", range(4))
def test_remote_robots_learn_of_it_within_a_tc_interval_and_the_jitter_of_the_hops(seed: int) -> None:
    graph = nx.path_graph(6)
    routers = [Olsr(address, OlsrSettings(), Draws(seed, "olsr")) for address in graph]
    net = LosslessHops([*routers], graph.edges)
    net.run(CONVERGED)
    net.links.remove(frozenset((4, 5)))
    noticed = last_hello(net, 5) + 6 * S
    net.run(noticed)
    assert 5 not in routers[4].routes(net.now)
    assert 5 in routers[0].routes(net.now)
    net.run(noticed + 5 * S + 3 * (JITTER + DELAY) + DELAY)  # 3, 2 and 1 forward what 4 tells
    assert 5 not in routers[0].routes(net.now)


def test_a_robot_that_is_no_relay_any_more_takes_back_what_it_has_told_and_is_silent_then() -> None:
    net = network(nx.path_graph(3))
    net.run(CONVERGED)
    net.links.remove(frozenset((1, 2)))
    net.run(CONVERGED + 40 * S)
    told = [(time, decode_tc(message.body)) for time, message in messages(net, 1, TC)]
    sets = [list(group) for _, group in groupby(told, key=lambda each: each[1].neighbours)]
    assert [list(group[0][1].neighbours) for group in sets if group[0][1].neighbours != [0]] == [[0, 2], []]
    assert [{tc.ansn for _, tc in group} for group in sets] == [{sets[0][0][1].ansn + n} for n in range(len(sets))]
    full, empty = sets[-2], sets[-1]
    assert 2 <= len(empty) <= 4
    assert empty[-1][0] < full[-1][0] + 15 * S
