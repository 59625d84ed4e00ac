"""Links of AODV that break: how it is noticed, who is told, and where payloads go then."""

from cosim.channels.adhoc.mac import Packet
from cosim.channels.adhoc.routing.aodv import Aodv, AodvSettings
from cosim.channels.adhoc.routing.aodv_wire import Rerr, Rrep, RrepAck, Rreq, decode_message, encode_message
from cosim.channels.adhoc.routing.ip import AODV_PORT, PAYLOAD_PORT, Datagram, decode, encode
from cosim.machine import BROADCAST, Address, Outcome
from cosim.randomness import Draws
from cosim.units import MS, S, Time
from tests.channels.adhoc.aodv_cases import line, messages, network, router, way
from tests.channels.adhoc.lossless_hops import DELAY, LosslessHops


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
    assert [(time, sender, hop.destination) for time, sender, hop, _ in errors[:1]] == [(last + DELAY + 2 * S, 1, 0)]
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
    assert [(time, sender, hop.destination) for time, sender, hop, _ in messages(net, Rerr)] == [
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
    assert [(sender, hop.destination) for _, sender, hop, _ in messages(net, Rerr)] == [(3, 2), (2, BROADCAST)]
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
    one.receive(encode(Datagram(1, 9, 64, PAYLOAD_PORT, 1, b"lost")), 2, 0)
    (hop,) = one.hops()
    assert (hop.destination, decode_message(decode(hop.payload).data)) == (2, Rerr(((9, 0),)))


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
        (sender, hop.destination, message.no_delete)
        for _, sender, hop, message in messages(net, Rerr)
        if message.unreachable[0][0] == 4
    ]
    assert errors == [(2, 1, True), (1, 0, True)]
    assert way(net, 0, 4) == [0, 1, 2, 5, 6, 4]


def test_the_request_of_a_repair_goes_half_as_far_as_the_source_is_and_two_hops_more() -> None:
    """RFC 3561, 6.12: max(1 hop to the destination, 6 / 2 to the source) + LOCAL_ADD_TTL."""
    net = network(8, line(8), local_repair=True)
    net.send(0, 7, b"")
    net.run(2 * S)
    net.links.discard(frozenset((6, 7)))
    net.send(0, 7, b"")
    net.run(2 * S + 10 * MS)
    (repair,) = [hop for time, sender, hop, _ in messages(net, Rreq) if time >= 2 * S and sender == 6]
    assert decode(repair.payload).ttl == 5


def test_a_repair_that_fails_ends_in_an_error() -> None:
    net = network(4, line(4), local_repair=True)
    net.send(0, 3, b"")
    net.run(S)
    net.links.discard(frozenset((2, 3)))
    net.send(0, 3, b"")
    net.run(2 * S)
    # at 2: 1 hop to 3, 2 hops to 0, so TTL max(1, 1) + 2 = 3, and 2 * 40 ms * (3 + 2) of waiting
    (error, *_) = [each for each in messages(net, Rerr) if 3 in dict(each[3].unreachable)]
    assert (error[0], error[1], error[2].destination, error[3].no_delete) == (S + 3 * DELAY + 400 * MS, 2, 1, False)


def test_who_does_not_take_a_reply_is_not_heard_for_a_while() -> None:
    said = AodvSettings(use_hello=False, broadcast_jitter_s=0)
    one = Aodv(0, said, Draws(1, "aodv"))

    def asked(number: int, now: Time) -> list[Packet]:
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
    assert [(sender, hop.destination) for _, sender, hop, _ in messages(net, RrepAck)] == [(1, 2), (0, 1)]
    assert net.fates[0][3] == Outcome.DELIVERED


def test_any_packet_is_a_sign_of_life_of_who_has_sent_a_hello() -> None:
    one = Aodv(0, AodvSettings(use_mac_feedback=False), Draws(1, "aodv"))
    hello = encode_message(Rrep(0, 1, 5, 1, 2000))
    one.receive(encode(Datagram(1, BROADCAST, 1, AODV_PORT, 1, hello)), 1, 0)
    one.receive(encode(Datagram(1, 0, 64, PAYLOAD_PORT, 2, b"data")), 1, 1500 * MS)
    one.wake(2 * S)
    one.wake(3500 * MS - 1)
    assert one.summary()["links_broken"] == 0
    one.table.offer(3, 1, 2, 50, 10 * S)
    one.wake(3500 * MS)
    assert one.next_hop(3, 3500 * MS) is None
    assert one.summary()["links_broken"] == 1


def test_who_does_not_acknowledge_a_reply_when_asked_is_not_heard_for_a_while() -> None:
    """RFC 3561, 6.8: NEXT_HOP_WAIT is 50 ms, BLACKLIST_TIMEOUT 5.6 s."""
    said = AodvSettings(use_hello=False, use_mac_feedback=False, use_rrep_ack=True, broadcast_jitter_s=0)

    def hears(one: Aodv, number: int, now: Time) -> int:
        request = encode_message(Rreq(0, number, 0, None, 1, number))
        one.receive(encode(Datagram(1, BROADCAST, 1, AODV_PORT, 1, request)), 1, now)
        return len(one.hops())

    silent, polite = (Aodv(0, said, Draws(1, "aodv")) for _ in range(2))
    assert hears(silent, 1, 0) == hears(polite, 1, 0) == 1
    polite.receive(encode(Datagram(1, 0, 1, AODV_PORT, 1, encode_message(RrepAck()))), 1, 49 * MS)
    for one in (silent, polite):
        one.wake(50 * MS)
    assert (hears(silent, 2, 51 * MS), hears(polite, 2, 51 * MS)) == (0, 1)
    assert (hears(silent, 3, 5650 * MS - 1), hears(silent, 4, 5650 * MS)) == (0, 1)


def test_a_reply_that_the_station_has_no_room_for_is_nobody_s_fault() -> None:
    one = Aodv(0, AodvSettings(use_hello=False, use_rrep_ack=True, broadcast_jitter_s=0), Draws(1, "aodv"))
    for number in (1, 2):
        request = encode_message(Rreq(0, number, 0, None, 1, number))
        one.receive(encode(Datagram(1, BROADCAST, 1, AODV_PORT, 1, request)), 1, number * S)
        (hop,) = one.hops()
        assert hop.token is not None
        one.hop_refused(hop.token, number * S)
        one.wake(number * S + 50 * MS)
