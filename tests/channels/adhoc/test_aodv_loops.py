"""AODV whatever happens: no bytes raise, and no routes make a loop."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cosim.channels.adhoc.mac import Packet
from cosim.channels.adhoc.routing.aodv import Aodv, AodvSettings
from cosim.channels.adhoc.routing.aodv_wire import Rrep, RrepAck, encode_message
from cosim.channels.adhoc.routing.ip import AODV_PORT, PAYLOAD_PORT, Datagram, decode, encode
from cosim.machine import BROADCAST, Address
from cosim.randomness import Draws
from cosim.units import MS, S, Time
from tests.channels.adhoc.aodv_cases import MESSAGES, NEAR, QUIET, way
from tests.channels.adhoc.lossless_hops import LosslessHops

PACKETS = st.one_of(
    st.binary(max_size=80),
    st.builds(
        lambda source, to, ttl, port, data: encode(Datagram(source, to, ttl, port, 1, data)),
        NEAR,
        st.integers(-1, 5),
        st.integers(0, 255),
        st.sampled_from([AODV_PORT, PAYLOAD_PORT, 698]),
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


@pytest.mark.slow
@settings(max_examples=200, deadline=None)
@given(CALLS, st.lists(st.integers(0, 3 * S), min_size=40, max_size=40), st.booleans())
def test_no_bytes_and_no_order_of_calls_raise(calls: list[tuple], steps: list[Time], repair: bool) -> None:
    said = AodvSettings(local_repair=repair, use_rrep_ack=repair, queue_payloads=3, rreq_ratelimit=2)
    one, now, watched = Aodv(0, said, Draws(1, "aodv")), 0, []
    for (what, first, second), step in zip(calls, steps, strict=False):
        now += step
        match what:
            case "receive":
                one.receive(first, second, now)
            case "send":
                one.send(first, second, 1, now)
            case "done" if watched:
                one.hop_done(watched.pop(first % len(watched)), second, now)
            case "wake":
                one.wake(now)
        hops = one.hops()
        watched += [hop.token for hop in hops if hop.token is not None]
        assert all(decode(hop.payload) is not None for hop in hops)
        assert one.next_hop(0, now) is None
        at, searched = one.wake_at(), searched_deadline(one)
        assert searched is None or (at is not None and at <= searched)
        if what == "wake":
            assert at is None or at > now
            assert at == searched


def searched_deadline(one: Aodv) -> Time | None:
    """Return when something is due next, of all that waits: what ``wake_at`` keeps is not later."""
    due = [heard + one.times.loss for _, heard in one._neighbours.values()]
    due += [*one._acks.values(), *(at for at, *_ in one._held), *(search.due for search in one._searches.values())]
    return min(due if one._hello_at is None else [*due, one._hello_at], default=None)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.integers(0, S), st.integers(1, 5), st.booleans()), max_size=60), st.booleans())
def test_a_deadline_is_kept_as_one_that_is_searched(inputs: list[tuple[Time, Address, bool]], always: bool) -> None:
    """Hellos, payloads, and searches at random; a router that is woken when it said does all that is due in time."""
    one, now = Aodv(0, AodvSettings(hello_always=always, rreq_ratelimit=1), Draws(1, "aodv")), 0
    for step, robot, hello in inputs:
        until = now + step
        while (at := one.wake_at()) is not None and at <= until:
            searched = searched_deadline(one)
            assert searched is None or at <= searched
            one.wake(at)
            assert one.wake_at() == searched_deadline(one)
        now = until
        if hello:
            data = encode_message(Rrep(0, robot, 1, robot, 2000))
            one.receive(encode(Datagram(robot, BROADCAST, 1, AODV_PORT, 1, data)), robot, now)
        else:
            one.send(robot, b"", None, now)
        at, searched = one.wake_at(), searched_deadline(one)
        assert searched is None or (at is not None and at <= searched)
        assert all(heard + one.times.loss > now for _, heard in one._neighbours.values())


def test_bytes_that_make_no_sense_are_counted() -> None:
    one = Aodv(0, AodvSettings(), Draws(1, "aodv"))
    one.receive(b"nonsense", 1, 0)
    one.receive(encode(Datagram(2, 0, 1, AODV_PORT, 1, encode_message(RrepAck()))), 1, 0)  # not from who sends it
    assert one.summary()["packets_malformed"] == 2


class Checked(LosslessHops):
    """After whatever happens no routes make a loop; a share of hops is lost."""

    checks, lost = 0, 0.0
    generator = np.random.default_rng(0)

    def _drain(self, address: Address) -> None:
        super()._drain(address)
        self.checks += 1
        for source, destination in product(range(len(self.routers)), repeat=2):
            way(self, source, destination)

    def _arrive(self, source: Address, hop: Packet) -> None:
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
