"""OLSR whatever happens: bytes that make no sense, calls in any order, settings."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from cosim.channels.adhoc.routing.base import Delivery
from cosim.channels.adhoc.routing.ip import AODV_PORT, OLSR_PORT, PAYLOAD_PORT, Datagram, encode
from cosim.channels.adhoc.routing.olsr import Olsr, OlsrSettings
from cosim.channels.adhoc.routing.olsr_wire import HELLO, TC, Hello, Message, Tc, encode_hello, encode_tc
from cosim.machine import BROADCAST, Outcome
from cosim.randomness import Draws
from cosim.units import S, Time
from tests.channels.adhoc.olsr_cases import converged, olsr, packet, router


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
    assert rejected(2, packet(1, 1, Message(TC, S, 3, 9, 0, 5, encode_tc(Tc(1, [2])))))
    assert rejected(1, encode(Datagram(1, 0, 9, AODV_PORT, 1, b"")))
    assert rejected(1, encode(Datagram(BROADCAST, 0, 9, PAYLOAD_PORT, 1, b"")))


def test_own_packets_that_come_back_change_nothing() -> None:
    net = converged("line")
    each = router(net, 1)
    own = [hop.payload for _, sender, hop in net.sent if sender == 1]
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
        packets = [hop.payload for _, sender, hop in net.sent if sender == address]
        summary = router(net, address).summary()
        assert summary["control_packets"] == len(packets)
        assert summary["control_octets"] == sum(map(len, packets))


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"hello_interval_s": 0.05}, "hello_interval_s\n  is not in 0.0625..3968.*=0.05"),
        ({"refresh_interval_s": 2000}, "neighb_hold_s\n  is not in .*=6000"),
        ({"top_hold_s": 4000}, "top_hold_s\n  is not in .*=4000"),
        ({"maxjitter_s": 2}, "maxjitter_s\n  is not below"),
        ({"hyst_threshold_low": 0.9}, "hyst_threshold_high\n  is not >= 0.9"),
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
