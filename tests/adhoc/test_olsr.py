"""OLSR on a network whose hops never fail: routes, relays, how fast links come and go, who repeats what."""

from collections import Counter
from itertools import groupby, pairwise

import networkx as nx
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from cosim.channels.adhoc.routing.base import Delivery
from cosim.channels.adhoc.routing.ip import AODV_PORT, OLSR_PORT, PAYLOAD_PORT, Datagram, decode, encode
from cosim.channels.adhoc.routing.olsr import Olsr, OlsrSettings
from cosim.channels.adhoc.routing.olsr_wire import (
    HELLO,
    TC,
    Hello,
    Message,
    Tc,
    decode_hello,
    decode_packet,
    decode_tc,
    encode_hello,
    encode_packet,
    encode_tc,
)
from cosim.machine import BROADCAST, Outcome
from cosim.randomness import Draws
from cosim.units import MS, S, Time
from tests.adhoc.lossless_hops import DELAY, LosslessHops

CONVERGED = 30 * S
JITTER = S // 2
GRAPHS = {
    "line": nx.path_graph(7),
    "ring": nx.cycle_graph(8),
    "star": nx.star_graph(5),
    "full": nx.complete_graph(5),
    "grid": nx.convert_node_labels_to_integers(nx.grid_2d_graph(3, 4)),
} | {f"random {seed}": nx.connected_watts_strogatz_graph(12, 4, 0.5, seed=seed) for seed in range(4)}


def olsr(address: int, **settings: object) -> Olsr:
    return Olsr(address, OlsrSettings.model_validate(settings), Draws(1, "olsr"))


def network(graph: nx.Graph, **settings: object) -> LosslessHops:
    return LosslessHops([olsr(address, **settings) for address in range(len(graph))], graph.edges)


def converged(name: str, **settings: object) -> LosslessHops:
    net = network(GRAPHS[name], **settings)
    net.run(CONVERGED)
    return net


def router(net: LosslessHops, address: int) -> Olsr:
    found = net.routers[address]
    assert isinstance(found, Olsr)
    return found


def messages(net: LosslessHops, address: int, kind: int) -> list[tuple[Time, Message]]:
    """Return all own messages of that kind that *address* has sent, and when."""
    return [
        (time, message)
        for time, sender, hop in net.sent
        if sender == address and (datagram := decode(hop.packet)).port == OLSR_PORT
        for message in decode_packet(datagram.data)[1]
        if message.kind == kind and message.origin == address
    ]


def gone_at(net: LosslessHops, address: int, destination: int, until: Time, step: Time = 10 * MS) -> Time:
    """Return when *address* has no route any more, to the step."""
    while destination in router(net, address).routes(net.now):
        assert net.now < until
        net.run(net.now + step)
    return net.now


# ---------------------------------------------------------------- routes


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
    path = [(n, hop.neighbour) for _, n, hop in net.sent[begin:] if decode(hop.packet).port == PAYLOAD_PORT]
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


# ---------------------------------------------------------------- links that end


def last_hello(net: LosslessHops, sender: int) -> Time:
    return max(time for time, _ in messages(net, sender, HELLO) if time + DELAY <= net.now) + DELAY


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


# ---------------------------------------------------------------- what is sent


def test_hellos_and_tcs_come_at_their_intervals_less_the_jitter() -> None:
    net = converged("line")
    for kind, interval in ((HELLO, 2 * S), (TC, 5 * S)):
        times = [time for time, _ in messages(net, 3, kind)]
        gaps = {after - before for before, after in pairwise(times)}
        assert len(gaps) > 2
        assert all(interval - JITTER <= gap <= interval for gap in gaps)
    hello, tc = messages(net, 3, HELLO)[-1][1], messages(net, 3, TC)[-1][1]
    assert (hello.validity, hello.ttl, hello.hops) == (6 * S, 1, 0)
    assert decode_hello(hello.body) == Hello(2 * S, 3, {10: [2, 4]})  # both are needed as relays
    assert (tc.validity, tc.ttl, tc.hops) == (15 * S, 255, 0)


def test_a_tc_tells_who_has_chosen_the_relay_or_more() -> None:
    graph = nx.Graph([(0, 1), (1, 2), (1, 3), (3, 0)])  # 0 and 3 are neighbours, 1 is the relay of all for 2
    for redundancy, others in ((0, []), (1, [1]), (2, [1, 3])):
        net = network(graph, tc_redundancy=redundancy)
        net.run(CONVERGED)
        assert decode_tc(messages(net, 1, TC)[-1][1].body).neighbours == [0, 2, 3]
        tcs = messages(net, 0, TC)
        assert (decode_tc(tcs[-1][1].body).neighbours if tcs else []) == others


def test_who_never_forwards_tells_nothing_whatever_the_redundancy() -> None:
    routers = [olsr(address, willingness=0, tc_redundancy=2) for address in range(2)]
    net = LosslessHops([*routers], [(0, 1)])
    net.run(CONVERGED)
    assert routers[0].routes(net.now).keys() == {1}
    assert messages(net, 0, TC) == []


@pytest.mark.parametrize("name", GRAPHS)
@pytest.mark.parametrize("relays_only", [True, False])
def test_a_payload_to_all_reaches_everybody_once_and_is_sent_once_at_most(name: str, relays_only: bool) -> None:
    net = converged(name, mpr_broadcasts=relays_only)
    begin = len(net.sent)
    net.send(1, BROADCAST, b"all", token=2)
    net.run(net.now + S)
    assert sorted(address for _, address, _ in net.delivered) == [n for n in range(len(net.routers)) if n != 1]
    assert {each for _, _, each in net.delivered} == {Delivery(1, b"all", True)}
    assert net.fates == [(CONVERGED + DELAY, 1, 2, Outcome.SENT)]
    senders = Counter(n for _, n, hop in net.sent[begin:] if decode(hop.packet).port == PAYLOAD_PORT)
    assert set(senders.values()) == {1}
    everybody = set(range(len(net.routers)))
    relays = {relay for each in everybody for relay in router(net, each).relays(net.now)} | {1}
    assert senders.keys() <= relays if relays_only else senders.keys() == everybody


def test_in_a_full_network_nobody_repeats() -> None:
    net = converged("full")
    assert all(router(net, n).relays(net.now) == frozenset() for n in range(5))
    begin = len(net.sent)
    net.send(0, BROADCAST, b"")
    net.run(net.now + S)
    assert sum(decode(hop.packet).port == PAYLOAD_PORT for _, _, hop in net.sent[begin:]) == 1


def test_nobody_forwards_a_message_twice() -> None:
    net = converged("random 0")
    forwarded = Counter(
        (sender, message.origin, message.number)
        for _, sender, hop in net.sent
        for message in decode_packet(decode(hop.packet).data)[1]
    )
    assert max(forwarded.values()) == 1


def packet(source: int, number: int, *sent: Message) -> bytes:
    return encode(Datagram(source, BROADCAST, 1, OLSR_PORT, number, encode_packet(number, sent)))


def test_a_message_of_an_unknown_kind_is_forwarded_for_those_whose_relay_one_is() -> None:
    each = olsr(1)
    names_us = encode_hello(Hello(2 * S, 3, {10: [1]}))  # as a symmetric neighbour, and its relay
    each.receive(packet(0, 1, Message(HELLO, 6 * S, 0, 1, 0, 1, names_us)), 0, 0)
    strange = Message(99, S, 7, 10, 3, 55, b"whatever")
    for number in (2, 3):  # the second time it is known
        each.receive(packet(0, number, strange), 0, 0)
    each.receive(packet(5, 1, strange._replace(number=56)), 5, 0)  # no neighbour
    each.wake(JITTER)
    sent = [m for hop in each.hops() for m in decode_packet(decode(hop.packet).data)[1] if m.kind == 99]
    assert sent == [strange._replace(ttl=9, hops=4)]


def test_a_tc_that_is_older_or_of_a_stranger_changes_nothing() -> None:
    each = olsr(1)
    each.receive(packet(0, 1, Message(HELLO, 6 * S, 0, 1, 0, 1, encode_hello(Hello(2 * S, 3, {6: [1, 2]})))), 0, 0)
    assert each.routes(0).keys() == {0, 2}

    def tell(ansn: int, number: int, hop: int, *neighbours: int) -> set[int]:
        each.receive(packet(hop, number, Message(TC, 15 * S, 2, 9, 1, number, encode_tc(Tc(ansn, neighbours)))), hop, 0)
        return set(each.routes(0))

    assert tell(65535, 20, 0, 3) == {0, 2, 3}
    assert tell(65534, 21, 0, 4) == {0, 2, 3}  # older
    assert tell(0, 22, 5, 4) == {0, 2, 3}  # of no neighbour
    assert tell(0, 20, 0, 4) == {0, 2, 3}  # a message that is known
    assert tell(0, 23, 0, 4) == {0, 2, 4}  # 0 comes after 65535
    assert tell(0, 24, 0, 5) == {0, 2, 4, 5}  # of the same set
    each.receive(packet(0, 2, Message(HELLO, 60 * S, 0, 1, 0, 2, encode_hello(Hello(2 * S, 3, {6: [1, 2]})))), 0, 0)
    assert each.routes(15 * S - 1).keys() == {0, 2, 4, 5}
    assert each.routes(15 * S).keys() == {0, 2}


def test_many_messages_are_put_into_several_packets() -> None:
    each = olsr(1)
    names_us = encode_hello(Hello(2 * S, 3, {10: [1]}))
    each.receive(packet(0, 1, Message(HELLO, 6 * S, 0, 1, 0, 1, names_us)), 0, 0)
    for number in range(10):
        each.receive(packet(0, 2 + number, Message(99, S, 7, 10, 3, number, bytes(388))), 0, 0)
    each.wake(JITTER)
    data = [decode(hop.packet).data for hop in each.hops()]
    sizes = [sum(message.kind == 99 for message in decode_packet(one)[1]) for one in data]
    assert sum(sizes) == 10
    assert max(sizes) == 3  # of 400 octets each
    numbers = [decode_packet(one)[0] for one in data]
    assert [number - numbers[0] for number in numbers] == list(range(len(data)))


# ---------------------------------------------------------------- laws


@given(st.binary(max_size=80), st.sampled_from([OLSR_PORT, PAYLOAD_PORT, AODV_PORT]), st.integers(-1, 5))
def test_arbitrary_bytes_never_raise(data: bytes, port: int, hop: int) -> None:
    each = olsr(0, hysteresis=True)
    each.receive(data, hop, 0)
    each.receive(encode(Datagram(1, 0, 9, port, 1, data)), hop, 0)
    for kind in (HELLO, TC, 4):
        message = Message(kind, S, 1, 3, 0, 5, data)
        each.receive(packet(1, 1, message), 1, S)
    each.wake(2 * S)
    each.routes(2 * S)
    assert each.summary()["packets_malformed"] >= 1


def rejected(hop: int, data: bytes) -> bool:
    each = olsr(0)
    each.receive(data, hop, 0)
    return each.summary()["packets_malformed"] == 1


def test_packets_that_are_not_their_senders_own_are_rejected() -> None:
    body = encode_hello(Hello(2 * S, 3, {}))
    good = packet(1, 1, Message(HELLO, S, 1, 1, 0, 5, body))
    assert not rejected(1, good)
    assert rejected(2, good)
    assert rejected(1, packet(1, 1, Message(HELLO, S, 2, 1, 0, 5, body)))
    assert rejected(1, encode(Datagram(1, 0, 9, AODV_PORT, 1, b"")))
    assert rejected(1, encode(Datagram(BROADCAST, 0, 9, PAYLOAD_PORT, 1, b"")))


def test_own_packets_that_come_back_change_nothing() -> None:
    net = converged("line")
    each = router(net, 1)
    own = [hop.packet for _, sender, hop in net.sent if sender == 1]
    before = each.routes(net.now), each.wake_at(), each.summary()
    for data in own:
        each.receive(data, 1, net.now)
        each.receive(data, 2, net.now)
    assert (each.routes(net.now), each.wake_at(), each.summary()) == before
    assert (each.hops(), each.deliveries(), each.fates()) == ([], [], [])


def test_two_runs_are_alike_and_a_later_start_shifts_all_times() -> None:
    def times(start: Time) -> list[Time]:
        each = Olsr(0, OlsrSettings(), Draws(1, "olsr"), start)
        found = []
        for _ in range(6):
            at = each.wake_at()
            assert at is not None
            each.wake(at)
            found.append(at - start)
        return found

    assert times(0) == times(0) == times(7 * S)


def test_waking_when_nothing_is_due_does_nothing() -> None:
    each = olsr(0)
    at = each.wake_at()
    assert at is not None
    each.wake(at - 1)
    assert each.hops() == []
    each.wake(at)
    assert len(each.hops()) <= 1
    next_at = each.wake_at()
    assert next_at is not None
    assert next_at > at
    each.wake(at)
    assert each.hops() == []


def test_a_token_of_an_earlier_life_is_ignored() -> None:
    each = olsr(0, use_mac_feedback=True)
    each.hop_done(5, False, 0)
    assert each.fates() == []


def test_a_payload_that_no_packet_holds_is_refused() -> None:
    each = olsr(0)
    each.send(BROADCAST, bytes(65_508), 1, 0)
    assert (each.fates(), each.hops()) == ([(1, Outcome.TOO_LONG)], [])
    each.send(BROADCAST, bytes(65_507), 2, 0)
    assert (each.fates(), len(each.hops())) == ([], 1)


def test_a_payload_to_oneself_is_there_at_once() -> None:
    each = olsr(0)
    each.send(0, b"me", 1, 0)
    assert each.deliveries() == [Delivery(0, b"me", False)]
    assert (each.fates(), each.hops()) == ([(1, Outcome.DELIVERED)], [])


def test_what_is_sent_is_counted() -> None:
    net = converged("line")
    for address in range(7):
        packets = [hop.packet for _, sender, hop in net.sent if sender == address]
        summary = router(net, address).summary()
        assert summary["control_packets"] == len(packets)
        assert summary["control_octets"] == sum(map(len, packets))


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"hello_interval_s": 0.05}, "hello_interval_s: 0.05 is not in 0.0625..3968"),
        ({"refresh_interval_s": 2000}, "neighb_hold_s: 6000 is not in"),
        ({"top_hold_s": 4000}, "top_hold_s: 4000 is not in"),
        ({"maxjitter_s": 2}, "maxjitter_s: 2 is not below"),
        ({"hyst_threshold_low": 0.9}, "hyst_threshold_high: 0.8 is not >= 0.9"),
    ],
)
def test_settings_that_do_not_fit_are_refused(settings: dict[str, float], said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        OlsrSettings.model_validate(settings)


def test_defaults_are_those_of_section_18() -> None:
    each = OlsrSettings()
    assert (each.hello_interval, each.hold, each.topology_hold, each.jitter) == (2 * S, 6 * S, 15 * S, S // 2)
    assert (each.tc_interval_s, each.dup_hold_s, each.willingness, each.tc_redundancy, each.mpr_coverage) == (
        5.0, 30.0, 3, 0, 1,
    )  # fmt: skip
    assert (each.hyst_threshold_high, each.hyst_threshold_low, each.hyst_scaling) == (0.8, 0.3, 0.5)
