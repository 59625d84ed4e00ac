"""AODV: the octets of its messages, and its laws, times and routes in networks whose hops take 1 ms."""

from collections.abc import Iterable
from itertools import pairwise, product

import networkx as nx
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from cosim.channels.adhoc.routing.aodv import Aodv, AodvSettings
from cosim.channels.adhoc.routing.aodv_routes import RouteTable, newer
from cosim.channels.adhoc.routing.aodv_wire import (
    Message,
    Rerr,
    Rrep,
    RrepAck,
    Rreq,
    decode_message,
    encode_message,
)
from cosim.channels.adhoc.routing.base import Hop
from cosim.channels.adhoc.routing.ip import AODV_PORT, Datagram, decode, encode
from cosim.errors import WireError
from cosim.machine import BROADCAST, Address, Outcome
from cosim.randomness import Draws
from cosim.units import MS, S, Time
from tests.adhoc.lossless_hops import DELAY, LosslessHops

QUIET = {"use_hello": False, "broadcast_jitter_s": 0.0}


def network(size: int, links: Iterable[tuple[Address, Address]], **said: object) -> LosslessHops:
    chosen = AodvSettings.model_validate(QUIET | said)
    return LosslessHops([Aodv(address, chosen, Draws(1, "aodv")) for address in range(size)], links)


def line(size: int) -> list[tuple[Address, Address]]:
    return list(pairwise(range(size)))


def router(net: LosslessHops, address: Address) -> Aodv:
    found = net.routers[address]
    assert isinstance(found, Aodv)
    return found


def messages(net: LosslessHops, kind: type[Message]) -> list[tuple[Time, Address, Hop, Message]]:
    """Return all messages of a kind that were sent: when, by whom, the hop, the message."""
    found = []
    for time, sender, hop in net.sent:
        datagram = decode(hop.packet)
        if datagram.port == AODV_PORT:
            message = decode_message(datagram.data)
            if isinstance(message, kind):
                found.append((time, sender, hop, message))
    return found


def way(net: LosslessHops, source: Address, destination: Address) -> list[Address]:
    """Follow next hops as far as they lead; fail on a loop."""
    at, passed = source, [source]
    while at != destination:
        after = router(net, at).next_hop(destination, net.now)
        if after is None:
            break
        assert after not in passed, f"{passed} and on to {after} is a loop on the way to {destination}"
        passed.append(after)
        at = after
    return passed


# ---------------------------------------------------------------- octets


GOLDEN = [
    # type, flags J R G D U and reserved (16 bits), hops; RREQ ID; destination, its number; originator, its number
    (Rreq(3, 0x01020304, 1, 0x11121314, 2, 0x21222324), "01 00 00 03 01020304 0a000002 11121314 0a000003 21222324"),
    (Rreq(0, 7, 1, None, 2, 9), "01 08 00 00 00000007 0a000002 00000000 0a000003 00000009"),
    (Rreq(0, 7, 1, 5, 2, 9, gratuitous=True), "01 20 00 00 00000007 0a000002 00000005 0a000003 00000009"),
    (Rreq(0, 7, 1, 5, 2, 9, destination_only=True), "01 10 00 00 00000007 0a000002 00000005 0a000003 00000009"),
    # type, flags R A, reserved and prefix size (16 bits), hops; destination, its number; originator; lifetime, 6000 ms
    (Rrep(4, 250, 0xFFFFFFFF, 0, 6000), "02 00 00 04 0a000101 ffffffff 0a000001 00001770"),
    (Rrep(4, 250, 1, 0, 6000, ack=True), "02 40 00 04 0a000101 00000001 0a000001 00001770"),
    # type, flag N and reserved (16 bits), count; then destinations and numbers
    (Rerr(((1, 2), (3, 4))), "03 00 00 02 0a000002 00000002 0a000004 00000004"),
    (Rerr(((1, 2),), no_delete=True), "03 80 00 01 0a000002 00000002"),
    (RrepAck(), "04 00"),
]


@pytest.mark.parametrize(("message", "octets"), GOLDEN)
def test_messages_have_the_octets_of_section_5(message: Message, octets: str) -> None:
    assert encode_message(message) == bytes.fromhex(octets)
    assert decode_message(bytes.fromhex(octets)) == message


def test_reserved_bits_and_those_of_multicast_are_ignored() -> None:
    request, reply = encode_message(Rreq(1, 2, 3, 4, 5, 6)), encode_message(Rrep(1, 2, 3, 4, 5))
    assert decode_message(request[:1] + b"\xc7\xff" + request[3:]) == Rreq(1, 2, 3, 4, 5, 6)
    assert decode_message(reply[:1] + b"\xbf\xe0" + reply[3:]) == Rrep(1, 2, 3, 4, 5)


@pytest.mark.parametrize(
    "octets",
    [
        "",
        "05 00",
        "04 00 00",
        "03 00 00 00",  # no destination
        "03 00 00 02 0a000002 00000002",  # fewer than it says
        "02 00 01 04 0a000101 00000001 0a000001 00001770",  # a subnet
        "02 00 00 04 ffffffff 00000001 0a000001 00001770",  # a route to all
        "02 00 00 04 0b000001 00000001 0a000001 00001770",  # nobody's address
    ],
)
def test_other_octets_are_no_message(octets: str) -> None:
    with pytest.raises(WireError):
        decode_message(bytes.fromhex(octets))


NEAR = st.integers(0, 5)
NUMBER = st.integers(0, 0xFFFFFFFF)
MESSAGES: st.SearchStrategy[Message] = st.one_of(
    st.builds(Rreq, st.integers(0, 255), NUMBER, NEAR, st.none() | NUMBER, NEAR, NUMBER, st.booleans(), st.booleans()),
    st.builds(Rrep, st.integers(0, 255), NEAR, NUMBER, NEAR, NUMBER, st.booleans()),
    st.builds(Rerr, st.lists(st.tuples(NEAR, NUMBER), min_size=1, max_size=3).map(tuple), st.booleans()),
    st.builds(RrepAck),
)


@given(MESSAGES)
def test_messages_survive_their_octets(message: Message) -> None:
    assert decode_message(encode_message(message)) == message


# ---------------------------------------------------------------- laws


@example(0xFFFFFFFF, 1)
@given(st.integers(0, 0xFFFFFFFF), st.integers(1, 0x7FFFFFFF))
def test_sequence_numbers_are_compared_across_the_wrap(number: int, step: int) -> None:
    later = number + step & 0xFFFFFFFF
    assert newer(later, number)
    assert not newer(number, later)
    assert not newer(number, number)


def test_a_route_that_ends_takes_the_next_number_across_the_wrap() -> None:
    table = RouteTable(0, 15 * S)
    table.offer(1, 2, 3, 0xFFFFFFFF, 10 * S)
    table.end(1, S)
    ended = table.get(1)
    assert ended is not None
    assert (ended.sequence, ended.active) == (0, False)
    assert not table.offer(1, 2, 1, 0xFFFFFFFF, 10 * S)
    assert table.offer(1, 2, 9, 0, 10 * S)


def test_a_table_takes_newer_routes_and_shorter_ones_as_new() -> None:
    table = RouteTable(0, 15 * S)
    assert table.offer(1, 2, 3, 5, 9 * S)
    assert not table.offer(1, 3, 3, 5, 9 * S)
    assert table.offer(1, 3, 2, 5, 9 * S)
    assert not table.offer(1, 2, 1, 4, 9 * S)
    assert table.offer(1, 2, 7, 6, 9 * S)
    assert not table.offer(0, 2, 7, 6, 9 * S)  # to itself


def test_an_unused_route_ends_and_is_forgotten_later() -> None:
    table = RouteTable(0, 15 * S)
    table.offer(1, 2, 3, 5, 3 * S)
    table.age(3 * S - 1)
    assert table.active(1) is not None
    table.age(3 * S)
    ended = table.get(1)
    assert ended is not None
    assert (ended.active, ended.sequence) == (False, 6)
    table.age(18 * S - 1)
    assert table.get(1) is not None
    table.age(18 * S)
    assert table.get(1) is None


def test_a_route_that_was_merely_heard_ends_without_another_number() -> None:
    table = RouteTable(0, 15 * S)
    table.offer(1, 1, 1, 5, 10 * S)
    for _ in range(3):
        table.end(1, S)
        table.hear(1, 10 * S)
    heard = table.get(1)
    assert heard is not None
    assert (heard.sequence, heard.known, heard.active) == (6, False, True)
    table.learn(1, 5)
    assert not heard.known
    table.learn(1, 6)
    assert heard.known


PACKETS = st.one_of(
    st.binary(max_size=80),
    st.builds(
        lambda source, to, ttl, port, data: encode(Datagram(source, to, ttl, port, 1, data)),
        NEAR,
        st.integers(-1, 5),
        st.integers(0, 255),
        st.sampled_from([AODV_PORT, 5000, 698]),
        st.binary(max_size=40) | MESSAGES.map(encode_message),
    ),
)
CALLS = st.lists(
    st.one_of(
        st.tuples(st.just("receive"), PACKETS, st.integers(-1, 5)),
        st.tuples(st.just("send"), st.integers(-1, 5), st.binary(max_size=3)),
        st.tuples(st.just("done"), st.integers(0, 20), st.booleans()),
        st.tuples(st.just("wake"), st.just(0), st.just(0)),
    ),
    max_size=40,
)


@settings(max_examples=200, deadline=None)
@given(CALLS, st.lists(st.integers(0, 3 * S), min_size=40, max_size=40), st.booleans())
def test_no_bytes_and_no_order_of_calls_raise(calls: list[tuple], steps: list[Time], repair: bool) -> None:
    said = AodvSettings(local_repair=repair, use_rrep_ack=repair, queue_payloads=3, rreq_ratelimit=2)
    one, now = Aodv(0, said, Draws(1, "aodv")), 0
    for (what, first, second), step in zip(calls, steps, strict=False):
        now += step
        match what:
            case "receive":
                one.receive(first, second, now)
            case "send":
                one.send(first, second, 1, now)
            case "done":
                one.hop_done(first, second, now)
            case "wake":
                one.wake(now)
        assert all(decode(hop.packet) is not None for hop in one.hops())
        assert one.next_hop(0, now) is None
        at = one.wake_at()
        if what == "wake":
            assert at is None or at > now


def test_bytes_that_make_no_sense_are_counted() -> None:
    one = Aodv(0, AodvSettings(), Draws(1, "aodv"))
    one.receive(b"nonsense", 1, 0)
    one.receive(encode(Datagram(2, 0, 1, AODV_PORT, 1, encode_message(RrepAck()))), 1, 0)  # not from who sends it
    assert one.summary()["packets_malformed"] == 2


# ---------------------------------------------------------------- routes


GRAPHS = {
    "line": nx.path_graph(9),
    "ring": nx.cycle_graph(11),
    "random 1": nx.connected_watts_strogatz_graph(16, 4, 0.4, seed=1),
    "random 2": nx.random_labeled_tree(14, seed=2),
    "random 3": nx.gnp_random_graph(14, 0.3, seed=3),
}


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
        took = [hop for _, _, hop in net.sent if decode(hop.packet).port == 5000]
        assert len(took) == away[destination]


@pytest.mark.parametrize("name", ["line", "ring", "random 1"])
def test_all_pairs_find_shortest_ways_if_only_destinations_answer(name: str) -> None:
    graph = GRAPHS[name]
    net = network(len(graph), graph.edges, destination_only=True)
    for source, destination in product(range(len(graph)), repeat=2):
        if source != destination:
            net.run(net.now + 10 * S)  # until all routes have ended
            before = len(net.sent)
            net.send(source, destination, b"", 1)
            net.run(net.now + 3 * S)
            took = [hop for _, _, hop in net.sent[before:] if decode(hop.packet).port == 5000]
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
    assert (hop.neighbour, decode_message(decode(hop.packet).data)) == (1, Rrep(0, 0, 0xFFFFFFF0, 1, 6000))


def test_a_request_goes_out_with_the_newest_number_that_is_known_on_its_way() -> None:
    one = Aodv(0, AodvSettings(broadcast_jitter_s=0, destination_only=True), Draws(1, "aodv"))
    one.table.offer(3, 4, 2, 50, 10 * S)
    for number, (asked, passed_on) in enumerate([(None, 50), (49, 50), (51, 51)]):
        request = Rreq(1, number, 3, asked, 1, 5 + number, destination_only=True)
        one.receive(encode(Datagram(2, BROADCAST, 9, AODV_PORT, 1, encode_message(request))), 2, 0)
        (hop,) = one.hops()
        datagram = decode(hop.packet)
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
    assert (sent.neighbour, type(decode_message(decode(sent.packet).data))) == ((hop, Rrep) if answered else (-1, Rreq))


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


# ---------------------------------------------------------------- times


def test_a_search_fails_after_its_rings_and_doubling_waits() -> None:
    net = network(2, [])
    net.send(0, 1, b"", 9)
    net.run(60 * S)
    requests = messages(net, Rreq)
    starts = [0, 240, 640, 1200, 1920, 4720, 10320]  # after 240, 400, 560, 720 ms and 2.8, 5.6 s
    assert [time // MS for time, *_ in requests] == starts
    assert [decode(hop.packet).ttl for _, _, hop, _ in requests] == [1, 3, 5, 7, 35, 35, 35]
    assert net.fates == [(21_520 * MS, 0, 9, Outcome.NO_ROUTE)]


def test_a_search_in_a_small_network_ends_soon() -> None:
    net = network(2, [], net_diameter=4, rreq_retries=1)
    net.send(0, 1, b"", 9)
    net.run(60 * S)
    # 2 * 40 ms * (1 + 2), * (3 + 2), then NET_TRAVERSAL_TIME = 2 * 40 ms * 4, twice, the second time doubled
    assert net.fates == [((240 + 400 + 320 + 640) * MS, 0, 9, Outcome.NO_ROUTE)]


def test_a_lost_route_is_searched_from_its_last_length_on() -> None:
    net = network(5, line(5))
    net.send(0, 3, b"")
    net.run(20 * S)
    assert router(net, 0).next_hop(3, net.now) is None
    before = len(net.sent)
    net.send(0, 3, b"")
    net.run(21 * S)
    assert decode(net.sent[before][2].packet).ttl == 3 + 2


def test_a_robot_that_starts_anew_waits_until_nobody_sends_over_it() -> None:
    one = Aodv(1, AodvSettings(use_hello=False), Draws(1, "aodv"), 100 * S)
    one.send(2, b"", 1, 100 * S)
    request = Rreq(0, 1, 1, None, 0, 1)
    one.receive(encode(Datagram(0, BROADCAST, 9, AODV_PORT, 1, encode_message(request))), 0, 101 * S)
    one.receive(
        encode(Datagram(0, BROADCAST, 9, AODV_PORT, 1, encode_message(request._replace(number=2, destination=5)))),
        0,
        101 * S,
    )
    assert one.hops() == []
    assert one.wake_at() == 115 * S
    one.receive(encode(Datagram(0, 5, 64, 5000, 1, b"")), 0, 110 * S)
    assert [decode_message(decode(hop.packet).data) for hop in one.hops()] == [Rerr(((5, 0),))]
    one.wake(115 * S)
    assert one.hops() == []
    assert one.wake_at() == 125 * S
    one.wake(125 * S)
    assert [hop.neighbour for hop in one.hops()] == [BROADCAST]


def test_a_robot_that_starts_anew_need_not_wait_for_answers() -> None:
    net = network(5, line(4), net_diameter=5)
    for token in range(3):
        net.send(0, 4, b"", token)  # nobody is there: many requests, so many sequence numbers
        net.run(net.now + 8 * S)
    net.send(0, 3, b"old")
    net.run(net.now + 8 * S)  # all routes have ended, and are remembered
    net.routers[0] = Aodv(0, AodvSettings(use_hello=False, reboot_hold=False), Draws(1, "aodv"), net.now)
    net.send(0, 3, b"new")
    start = net.now
    net.run(start + S)
    # the first ring of 1 hop takes 240 ms; then 3 hops there, 3 back, and 3 for the payload
    assert [time - start for time, _, delivery in net.delivered if delivery.payload == b"new"] == [249 * MS]


def test_requests_keep_to_their_rate() -> None:
    net = network(30, [], rreq_ratelimit=10)
    for destination in range(1, 30):
        net.send(0, destination, b"")
    net.run(5 * S)
    times = [time for time, *_ in messages(net, Rreq)]
    assert len(times) >= 50
    assert all(later - sooner >= S for sooner, later in zip(times, times[10:], strict=False))


def test_the_oldest_gives_way_when_too_many_payloads_wait() -> None:
    net = network(2, [], queue_payloads=2)
    for token in range(3):
        net.send(0, 1, b"", token)
    net.run(30 * S)
    assert [fate[2:] for fate in net.fates] == [
        (0, Outcome.QUEUE_FULL),
        (1, Outcome.NO_ROUTE),
        (2, Outcome.NO_ROUTE),
    ]


# ---------------------------------------------------------------- breaks


def test_silence_breaks_a_link_after_two_hello_intervals() -> None:
    net = network(3, line(3), use_hello=True, use_mac_feedback=False)
    chatter(net, 0, 2, until=10 * S)
    net.run(10 * S + 500 * MS)
    assert way(net, 0, 2) == [0, 1, 2]
    assert messages(net, Rerr) == []
    net.links.discard(frozenset((1, 2)))
    last = max(time for time, sender, hop in net.sent if sender == 2 and time + DELAY <= net.now)
    net.run(20 * S)
    errors = messages(net, Rerr)
    assert [(time, sender, hop.neighbour) for time, sender, hop, _ in errors[:1]] == [(last + DELAY + 2 * S, 1, 0)]
    assert [robot for robot, _ in errors[0][3].unreachable] == [2]


def chatter(net: LosslessHops, source: Address, destination: Address, until: Time) -> None:
    for time in range(0, until + 1, 500 * MS):
        net.at(time, lambda: net.send(source, destination, b"more"))


def test_a_hop_that_is_not_acknowledged_breaks_a_link_at_once() -> None:
    net = network(4, line(4))
    net.send(0, 3, b"")
    net.run(S)
    net.links.discard(frozenset((2, 3)))
    net.send(0, 3, b"", 5)
    net.run(S + 10 * MS)
    # two hops, the third fails; an error takes one hop to each
    assert [(time, sender, hop.neighbour) for time, sender, hop, _ in messages(net, Rerr)] == [
        (S + 3 * DELAY, 2, 1),
        (S + 4 * DELAY, 1, 0),
    ]
    assert [way(net, robot, 3) for robot in range(3)] == [[0], [1], [2]]


def test_errors_go_to_all_if_more_than_one_uses_the_route() -> None:
    # 0 and 1 both reach 4 over 2 and 3
    net = network(5, [(0, 2), (1, 2), (2, 3), (3, 4)], destination_only=True)
    for source in (0, 1):
        net.send(source, 4, b"")
        net.run(net.now + S // 2)
    net.links.discard(frozenset((3, 4)))
    net.send(0, 4, b"")
    net.run(net.now + 10 * MS)
    assert [(sender, hop.neighbour) for _, sender, hop, _ in messages(net, Rerr)] == [(3, 2), (2, BROADCAST)]
    assert [way(net, robot, 4) for robot in range(4)] == [[0], [1], [2], [3]]


def test_the_source_takes_another_way_after_a_break() -> None:
    net = network(4, [(0, 1), (1, 3), (0, 2), (2, 3)])
    net.send(0, 3, b"one", 1)
    net.run(S)
    first = router(net, 0).next_hop(3, net.now)
    assert first is not None
    net.links.discard(frozenset((0, first)))
    net.send(0, 3, b"two", 2)
    net.run(2 * S)
    assert [delivery.payload for _, at, delivery in net.delivered if at == 3] == [b"one", b"two"]
    assert [fate[2:] for fate in net.fates] == [(1, Outcome.DELIVERED), (2, Outcome.DELIVERED)]


def test_a_payload_without_a_route_on_its_way_is_answered_by_an_error() -> None:
    one = Aodv(0, AodvSettings(), Draws(1, "aodv"))
    one.receive(encode(Datagram(1, 9, 64, 5000, 1, b"lost")), 2, 0)
    (hop,) = one.hops()
    assert (hop.neighbour, decode_message(decode(hop.packet).data)) == (2, Rerr(((9, 0),)))


def test_a_robot_on_the_way_repairs_a_route() -> None:
    # 0 1 2 3 4 in a line, and 2 5 6 4 as a longer way around 3
    links = [*line(5), (2, 5), (5, 6), (6, 4)]
    net = network(7, links, local_repair=True, destination_only=True)
    net.send(0, 4, b"one")
    net.run(S)
    net.links.discard(frozenset((2, 3)))
    net.send(0, 4, b"two")
    net.run(2 * S)
    assert [delivery.payload for _, at, delivery in net.delivered if at == 4] == [b"one", b"two"]
    assert {message.originator for time, _, _, message in messages(net, Rreq) if time >= S} == {2}
    errors = [
        (sender, hop.neighbour, message.no_delete)
        for _, sender, hop, message in messages(net, Rerr)
        if message.unreachable[0][0] == 4
    ]
    assert errors == [(2, 1, True), (1, 0, True)]
    assert way(net, 0, 4) == [0, 1, 2, 5, 6, 4]


def test_a_repair_that_fails_ends_in_an_error() -> None:
    net = network(4, line(4), local_repair=True)
    net.send(0, 3, b"")
    net.run(S)
    net.links.discard(frozenset((2, 3)))
    net.send(0, 3, b"")
    net.run(2 * S)
    # at 2: 1 hop to 3, 2 hops to 0, so TTL max(1, 1) + 2 = 3, and 2 * 40 ms * (3 + 2) of waiting
    (error, *_) = [each for each in messages(net, Rerr) if 3 in dict(each[3].unreachable)]
    assert (error[0], error[1], error[2].neighbour, error[3].no_delete) == (S + 3 * DELAY + 400 * MS, 2, 1, False)


def test_who_does_not_take_a_reply_is_not_heard_for_a_while() -> None:
    said = AodvSettings(use_hello=False, broadcast_jitter_s=0)
    one = Aodv(0, said, Draws(1, "aodv"))

    def asked(number: int, now: Time) -> list[Hop]:
        request = Rreq(0, number, 0, None, 1, number)
        one.receive(encode(Datagram(1, BROADCAST, 1, AODV_PORT, 1, encode_message(request))), 1, now)
        return one.hops()

    (hop,) = asked(1, 0)
    assert hop.token is not None
    one.hop_done(hop.token, False, S)
    assert asked(2, S + 5600 * MS - 1) == []
    assert len(asked(3, S + 5600 * MS)) == 1


def test_a_reply_can_ask_for_an_acknowledgement() -> None:
    net = network(3, line(3), use_rrep_ack=True)
    net.send(0, 2, b"", 1)
    net.run(S)
    assert [(sender, hop.neighbour) for _, sender, hop, _ in messages(net, RrepAck)] == [(1, 2), (0, 1)]
    assert net.fates[0][3] == Outcome.DELIVERED


def test_only_robots_on_active_routes_send_hellos() -> None:
    net = network(4, line(4), use_hello=True)
    net.send(0, 1, b"")
    net.run(30 * S)
    hellos = [(time, sender) for time, sender, hop, _ in messages(net, Rrep) if hop.neighbour == BROADCAST]
    assert {sender for _, sender in hellos} == {0, 1}
    assert max(time for time, _ in hellos) <= 6 * S + 2 * DELAY  # MY_ROUTE_TIMEOUT
    always = network(4, [], use_hello=True, hello_always=True)
    always.run(30 * S)
    for robot in range(4):
        times = [time for time, sender, _, _ in messages(always, Rrep) if sender == robot]
        assert {later - sooner for sooner, later in pairwise(times)} == {S}
        assert len(times) >= 29


# ---------------------------------------------------------------- loops


class Checked(LosslessHops):
    """After whatever happens no routes make a loop; a share of hops is lost."""

    checks, lost = 0, 0.0
    generator = np.random.default_rng(0)

    def _drain(self, address: Address) -> None:
        super()._drain(address)
        self.checks += 1
        for source, destination in product(range(len(self.routers)), repeat=2):
            way(self, source, destination)

    def _arrive(self, source: Address, hop: Hop) -> None:
        kept = self.links
        self.links = {link for link in kept if self.generator.random() >= self.lost}
        super()._arrive(source, hop)
        self.links = kept


def storm(seed: int, said: dict[str, object], lost: float, steps: int = 90) -> Checked:
    """Let links come and go at random while payloads go to and fro."""
    size, generator = 7, np.random.default_rng(seed)
    pairs = [(one, other) for one in range(size) for other in range(one)]
    chosen = AodvSettings.model_validate(QUIET | {"net_diameter": 8, "active_route_timeout_s": 1.0} | said)
    routers = [Aodv(address, chosen, Draws(seed, "aodv")) for address in range(size)]
    net = Checked(routers, [pair for pair in pairs if generator.random() < 0.35])
    net.generator, net.lost = generator, lost
    for _ in range(steps):
        net.run(net.now + int(generator.integers(1, 600)) * MS)
        for pair in generator.choice(pairs, 2):
            net.links ^= {frozenset(pair.tolist())}
        source, destination = generator.choice(size, 2, replace=False).tolist()
        net.send(source, destination, b"")
    return net


@pytest.mark.parametrize("said", [{}, {"local_repair": True}, {"use_hello": True}, {"use_mac_feedback": False}])
@pytest.mark.parametrize(("seed", "lost"), [(0, 0.0), (1, 0.2), (2, 0.5)])
def test_there_are_never_loops_however_links_change(seed: int, lost: float, said: dict[str, object]) -> None:
    net = storm(seed, said, lost)
    assert net.checks > 500
    assert len(net.delivered) > 5
