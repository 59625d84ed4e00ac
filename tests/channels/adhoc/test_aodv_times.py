"""The times and rates of AODV: searches, hellos, and a router that starts anew."""

from itertools import pairwise

from cosim.channels.adhoc.routing.aodv import Aodv, AodvSettings
from cosim.channels.adhoc.routing.aodv_wire import Rerr, Rrep, Rreq, decode_message, encode_message
from cosim.channels.adhoc.routing.ip import AODV_PORT, PAYLOAD_PORT, Datagram, decode, encode
from cosim.machine import BROADCAST, Outcome
from cosim.randomness import Draws
from cosim.units import MS, S
from tests.channels.adhoc.aodv_cases import line, messages, network, router
from tests.channels.adhoc.lossless_hops import DELAY


def test_a_search_fails_after_its_rings_and_doubling_waits() -> None:
    net = network(2, [])
    net.send(0, 1, b"", 9)
    net.run(60 * S)
    requests = messages(net, Rreq)
    starts = [0, 240, 640, 1200, 1920, 4720, 10320]  # after 240, 400, 560, 720 ms and 2.8, 5.6 s
    assert [time // MS for time, *_ in requests] == starts
    assert [decode(hop.payload).ttl for _, _, hop, _ in requests] == [1, 3, 5, 7, 35, 35, 35]
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
    assert decode(net.sent[before][2].payload).ttl == 3 + 2


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
    one.receive(encode(Datagram(0, 5, 64, PAYLOAD_PORT, 1, b"")), 0, 110 * S)
    assert [decode_message(decode(hop.payload).data) for hop in one.hops()] == [Rerr(((5, 0),))]
    one.wake(115 * S)
    assert one.hops() == []
    assert one.wake_at() == 125 * S
    one.wake(125 * S)
    assert [hop.destination for hop in one.hops()] == [BROADCAST]


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


def test_only_robots_on_active_routes_send_hellos() -> None:
    net = network(4, line(4), use_hello=True)
    net.send(0, 1, b"")
    net.run(30 * S)
    hellos = [(time, sender) for time, sender, hop, _ in messages(net, Rrep) if hop.destination == BROADCAST]
    assert {sender for _, sender in hellos} == {0, 1}
    assert max(time for time, _ in hellos) <= 6 * S + 2 * DELAY  # MY_ROUTE_TIMEOUT
    always = network(4, [], use_hello=True, hello_always=True)
    always.run(30 * S)
    for robot in range(4):
        times = [time for time, sender, _, _ in messages(always, Rrep) if sender == robot]
        assert {later - sooner for sooner, later in pairwise(times)} == {S}
        assert len(times) >= 29


def test_hellos_come_a_little_early_and_never_in_step_with_anything() -> None:
    net = network(1, [], use_hello=True, hello_always=True, broadcast_jitter_s=0.01)
    net.run(60 * S)
    gaps = [later - sooner for (sooner, *_), (later, *_) in pairwise(messages(net, Rrep))]
    assert len(gaps) >= 58
    assert all(990 * MS <= gap <= S for gap in gaps)
    assert len(set(gaps)) == len(gaps)


def test_a_network_that_begins_at_once_has_not_been_rebooted() -> None:
    net = network(3, line(3), reboot_hold=True)
    net.send(0, 2, b"first")
    net.run(S)
    assert [delivery.payload for _, _, delivery in net.delivered] == [b"first"]


def test_the_payload_that_has_waited_longest_gives_way_whatever_its_search() -> None:
    net = network(3, [], queue_payloads=2)
    for destination, token in ((2, 0), (1, 1), (2, 2)):
        net.send(0, destination, b"", token)
        net.run(net.now + MS)
    assert [fate[2:] for fate in net.fates] == [(0, Outcome.QUEUE_FULL)]
    net.send(0, 2, b"", 3)
    assert [fate[2:] for fate in net.fates[1:]] == [(1, Outcome.QUEUE_FULL)]


def test_an_ended_route_is_remembered_while_it_is_searched() -> None:
    """RFC 3561, 6.4: for 2 * NET_TRAVERSAL_TIME after a request, here longer than DELETE_PERIOD, 2 * 3 s."""
    net = network(2, [], delete_factor=2, net_diameter=100, rreq_retries=0)
    router(net, 0).table.offer(1, 1, 1, 7, S)
    net.run(S)
    net.send(0, 1, b"")
    net.run(10 * S)  # after requests that went 3, 5, 7 and, 1.68 s later, 100 hops; a wait of 8 s
    assert router(net, 0).next_hop(1, net.now) is None
    ended = router(net, 0).table.get(1)
    assert ended is not None
    assert (ended.active, ended.sequence) == (False, 8)
