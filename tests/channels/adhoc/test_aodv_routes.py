"""How AODV finds routes: who answers, what is learnt on the way, and payloads to all."""

from itertools import product

import networkx as nx
import pytest

from cosim.channels.adhoc.routing.aodv import Aodv, AodvSettings
from cosim.channels.adhoc.routing.aodv_wire import Rerr, Rrep, Rreq, decode_message, encode_message
from cosim.channels.adhoc.routing.ip import AODV_PORT, PAYLOAD_PORT, Datagram, decode, encode
from cosim.machine import BROADCAST, Address, Outcome
from cosim.randomness import Draws
from cosim.units import S
from tests.channels.adhoc.aodv_cases import GRAPHS, line, messages, network, way
from tests.channels.adhoc.lossless_hops import DELAY


@pytest.mark.parametrize(("ttl", "sent", "reached"), [(1, 1, [1]), (2, 2, [1, 2]), (None, 4, [1, 2, 3])])
def test_payloads_to_all_go_as_far_as_set_and_others_all_the_way(
    ttl: int | None, sent: int, reached: list[Address]
) -> None:
    net = network(4, line(4), broadcast_ttl=ttl)
    net.send(0, BROADCAST, b"all", 1)
    net.run(S)
    assert [at for _, at, _ in net.delivered] == reached
    assert len(net.sent) == sent
    assert [fate[1:] for fate in net.fates] == [(0, 1, Outcome.SENT)]
    net.send(0, 3, b"one")
    net.run(9 * S)
    assert [at for _, at, delivery in net.delivered if delivery.payload == b"one"] == [3]


@pytest.mark.parametrize("name", GRAPHS)
def test_a_payload_takes_a_shortest_way(name: str) -> None:
    graph = GRAPHS[name]
    away = nx.single_source_shortest_path_length(graph, 0)
    for destination in range(1, len(graph)):
        net = network(len(graph), graph.edges)
        net.send(0, destination, b"hello", 7)
        net.run(10 * S)
        if destination not in away:
            assert net.delivered == []
            continue
        assert [(at, delivery.payload) for _, at, delivery in net.delivered] == [(destination, b"hello")]
        assert [fate[1:] for fate in net.fates] == [(0, 7, Outcome.DELIVERED)]
        took = [hop for _, _, hop in net.sent if decode(hop.payload).port == PAYLOAD_PORT]
        assert len(took) == away[destination]


@pytest.mark.parametrize("name", ["line", "ring", pytest.param("random 1", marks=pytest.mark.slow)])
def test_all_pairs_find_shortest_ways_if_only_destinations_answer(name: str) -> None:
    graph = GRAPHS[name]
    net = network(len(graph), graph.edges, destination_only=True)
    for source, destination in product(range(len(graph)), repeat=2):
        if source != destination:
            net.run(net.now + 10 * S)  # until all routes have ended
            before = len(net.sent)
            net.send(source, destination, b"", 1)
            net.run(net.now + 3 * S)
            took = [hop for _, _, hop in net.sent[before:] if decode(hop.payload).port == PAYLOAD_PORT]
            assert len(took) == nx.shortest_path_length(graph, source, destination)
    assert {fate[3] for fate in net.fates} == {Outcome.DELIVERED}


def test_who_has_a_route_answers_and_tells_the_destination() -> None:
    net = network(5, line(5))
    net.send(1, 4, b"")
    net.run(S)
    before = net.now
    net.send(0, 4, b"", 1)
    net.run(2 * S)
    assert [(who, message.destination, message.originator, message.hops) for time, who, _, message in
            messages(net, Rrep) if time >= before] == [
        (1, 4, 0, 3),  # 1 knows 4, 3 hops away
        (1, 0, 4, 1),  # and tells 4 that 0 is 1 hop from itself
        (2, 0, 4, 2),
        (3, 0, 4, 3),
    ]  # fmt: skip
    assert way(net, 4, 0) == [4, 3, 2, 1, 0]
    assert [time - before for time, at, _ in net.delivered if at == 4 and time > before] == [6 * DELAY]


@pytest.mark.parametrize("flags", [{"destination_only": True}, {"gratuitous": False}])
def test_flags_keep_the_one_in_between_from_answering_or_telling(flags: dict[str, bool]) -> None:
    net = network(5, line(5), **flags)
    net.send(1, 4, b"")
    net.run(S)
    net.send(0, 4, b"", 1)
    net.run(2 * S)
    replies = [(who, message.destination) for time, who, _, message in messages(net, Rrep) if time >= S]
    assert replies == ([(4, 4), (3, 4), (2, 4), (1, 4)] if "destination_only" in flags else [(1, 4)])


def test_the_destination_does_not_fall_behind_what_others_know_of_it() -> None:
    one = Aodv(0, AodvSettings(broadcast_jitter_s=0), Draws(1, "aodv"))
    request = Rreq(0, 1, 0, 0xFFFFFFF0, 1, 5)
    one.sequence = 0xFFFFFF00
    one.receive(encode(Datagram(1, BROADCAST, 1, AODV_PORT, 1, encode_message(request))), 1, 0)
    (hop,) = one.hops()
    assert (hop.destination, decode_message(decode(hop.payload).data)) == (1, Rrep(0, 0, 0xFFFFFFF0, 1, 6000))


def test_a_request_goes_out_with_the_newest_number_that_is_known_on_its_way() -> None:
    one = Aodv(0, AodvSettings(broadcast_jitter_s=0, destination_only=True), Draws(1, "aodv"))
    one.table.offer(3, 4, 2, 50, 10 * S)
    for number, (asked, passed_on) in enumerate([(None, 50), (49, 50), (51, 51)]):
        request = Rreq(1, number, 3, asked, 1, 5 + number, destination_only=True)
        one.receive(encode(Datagram(2, BROADCAST, 9, AODV_PORT, 1, encode_message(request))), 2, 0)
        (hop,) = one.hops()
        datagram = decode(hop.payload)
        assert datagram.ttl == 8
        assert decode_message(datagram.data) == request._replace(hops=2, sequence=passed_on)
    known = one.table.get(3)
    assert known is not None
    assert known.sequence == 50


@pytest.mark.parametrize(
    ("asked", "hop", "answered"),
    [(None, 2, True), (50, 2, True), (51, 2, False), (0xFFFFFFF0, 2, True), (50, 4, False)],
)
def test_who_has_an_old_route_or_one_back_does_not_answer(asked: int | None, hop: Address, answered: bool) -> None:
    one = Aodv(0, AodvSettings(broadcast_jitter_s=0), Draws(1, "aodv"))
    one.table.offer(3, 4, 2, 50, 10 * S)
    request = Rreq(1, 7, 3, asked, 1, 5)
    one.receive(encode(Datagram(hop, BROADCAST, 9, AODV_PORT, 1, encode_message(request))), hop, 0)
    (sent,) = one.hops()
    assert (sent.destination, type(decode_message(decode(sent.payload).data))) == (
        (hop, Rrep) if answered else (-1, Rreq)
    )


def test_an_error_ends_routes_over_its_sender_only() -> None:
    one = Aodv(0, AodvSettings(), Draws(1, "aodv"))
    one.table.offer(3, 4, 2, 50, 10 * S)
    error = encode_message(Rerr(((3, 60),)))
    one.receive(encode(Datagram(5, BROADCAST, 1, AODV_PORT, 1, error)), 5, 0)
    assert one.next_hop(3, 0) == 4
    one.receive(encode(Datagram(4, BROADCAST, 1, AODV_PORT, 1, error)), 4, 0)
    assert one.next_hop(3, 0) is None
    ended = one.table.get(3)
    assert ended is not None
    assert ended.sequence == 60


def test_a_payload_to_all_reaches_each_once_and_within_net_diameter() -> None:
    graph = GRAPHS["random 1"]
    net = network(len(graph), graph.edges)
    net.send(0, BROADCAST, b"all", 3)
    net.run(S)
    assert sorted(at for _, at, delivery in net.delivered if delivery == (0, b"all", True)) == list(range(1, 16))
    assert len(net.sent) == 16
    assert [fate[1:] for fate in net.fates] == [(0, 3, Outcome.SENT)]
    near = network(9, line(9), net_diameter=4)
    near.send(0, BROADCAST, b"all")
    near.run(S)
    assert [at for _, at, _ in near.delivered] == [1, 2, 3, 4]


def test_a_reply_that_is_no_news_is_passed_on_as_what_is_known_here() -> None:
    one = Aodv(0, AodvSettings(broadcast_jitter_s=0), Draws(1, "aodv"))
    one.table.offer(3, 4, 2, 50, 10 * S)
    one.table.offer(1, 1, 1, 5, 10 * S)
    old = encode_message(Rrep(4, 3, 49, 1, 6000))
    one.receive(encode(Datagram(2, 0, 1, AODV_PORT, 1, old)), 2, 0)
    (hop,) = one.hops()
    assert (hop.destination, decode_message(decode(hop.payload).data)) == (1, Rrep(2, 3, 50, 1, 10_000))


def test_who_passes_a_reply_on_knows_at_once_whom_to_tell_if_the_route_breaks() -> None:
    """RFC 3561, 6.7: of the route, and of the one to the next hop; no payload has gone there yet."""
    one = Aodv(0, AodvSettings(broadcast_jitter_s=0), Draws(1, "aodv"))
    one.table.offer(1, 1, 1, 5, 10 * S)
    one.receive(encode(Datagram(2, 0, 1, AODV_PORT, 1, encode_message(Rrep(1, 3, 50, 1, 6000)))), 2, 0)
    assert [(each, route.precursors) for each in (2, 3) if (route := one.table.get(each))] == [(2, {1}), (3, {1})]


def test_a_payload_that_no_packet_holds_is_refused() -> None:
    one = Aodv(0, AodvSettings(), Draws(1, "aodv"))
    one.send(BROADCAST, bytes(65_508), 1, 0)
    assert (one.fates(), one.hops()) == ([(1, Outcome.TOO_LONG)], [])
    one.send(BROADCAST, bytes(65_507), 2, 0)
    assert (one.fates(), len(one.hops())) == ([], 1)
