"""What robots send by OLSR, when, and who repeats what."""

from collections import Counter
from itertools import pairwise

import networkx as nx
import pytest

from cosim.channels.adhoc.routing.base import Delivery
from cosim.channels.adhoc.routing.ip import PAYLOAD_PORT, decode
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
    encode_tc,
)
from cosim.machine import BROADCAST, Outcome
from cosim.units import S
from tests.channels.adhoc.lossless_hops import DELAY, LosslessHops
from tests.channels.adhoc.olsr_cases import (
    CONVERGED,
    GRAPHS,
    JITTER,
    converged,
    messages,
    network,
    olsr,
    packet,
    router,
)


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
    senders = Counter(n for _, n, hop in net.sent[begin:] if decode(hop.payload).port == PAYLOAD_PORT)
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
    assert sum(decode(hop.payload).port == PAYLOAD_PORT for _, _, hop in net.sent[begin:]) == 1


def test_nobody_forwards_a_message_twice() -> None:
    net = converged("random 0")
    forwarded = Counter(
        (sender, message.origin, message.number)
        for _, sender, hop in net.sent
        for message in decode_packet(decode(hop.payload).data)[1]
    )
    assert max(forwarded.values()) == 1


def test_a_message_of_an_unknown_kind_is_forwarded_for_those_whose_relay_one_is() -> None:
    each = olsr(1)
    names_us = encode_hello(Hello(2 * S, 3, {10: [1]}))  # as a symmetric neighbour, and its relay
    each.receive(packet(0, 1, Message(HELLO, 6 * S, 0, 1, 0, 1, names_us)), 0, 0)
    strange = Message(99, S, 7, 10, 3, 55, b"whatever")
    for number in (2, 3):  # the second time it is known
        each.receive(packet(0, number, strange), 0, 0)
    each.receive(packet(5, 1, strange._replace(number=56)), 5, 0)  # no neighbour
    due = each.wake_at()
    assert due is not None
    each.wake(due - 1)
    assert each.hops() == []
    each.wake(JITTER)
    sent = [m for hop in each.hops() for m in decode_packet(decode(hop.payload).data)[1] if m.kind == 99]
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
    data = [decode(hop.payload).data for hop in each.hops()]
    sizes = [sum(message.kind == 99 for message in decode_packet(one)[1]) for one in data]
    assert sum(sizes) == 10
    assert max(sizes) == 3  # of 400 octets each
    numbers = [decode_packet(one)[0] for one in data]
    assert [number - numbers[0] for number in numbers] == list(range(len(data)))
