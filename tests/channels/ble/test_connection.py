"""Connections in time: bounds of parameters, anchors and drift, latency, supervision, instants."""

from fractions import Fraction
from math import ceil

import pytest

from cosim.channels.ble.bits.control import (
    PHY_1M,
    PHY_2M,
    PHY_CODED,
    ChannelMapInd,
    ConnectionUpdateInd,
    Lengths,
    Phys,
    PhyUpdateInd,
    encode_control,
)
from cosim.channels.ble.bits.pdu import LLData, Llid
from cosim.channels.ble.connections.anchors import Anchors, Expectation
from cosim.channels.ble.connections.arq import Fragment
from cosim.channels.ble.connections.channel_map import ALL_CHANNELS, ChannelMap
from cosim.channels.ble.connections.connection import event_at, instant_for
from cosim.channels.ble.connections.exchange import Packet, Reception, Side
from cosim.channels.ble.connections.link import Link, Loss, run_event
from cosim.channels.ble.connections.parameters import ConnectionParameters, TransmitWindow
from cosim.channels.ble.phy import CODED_S8, LE_1M, LE_2M
from cosim.channels.clock import NativeClock
from cosim.errors import LocalProtocolError, UserError

US, MS, S = 1_000, 1_000_000, 1_000_000_000
HEARD, MISSED, BAD = Reception.HEARD, Reception.MISSED, Reception.BAD_CRC
CENTRAL, PERIPHERAL = Side.CENTRAL, Side.PERIPHERAL
SCA_PPM = (500, 250, 150, 100, 75, 50, 30, 20)


def always(_: Packet) -> Reception:
    return HEARD


def never(_: Packet) -> Reception:
    return MISSED


def link_with(
    interval: int = 30 * MS,
    latency: int = 0,
    timeout: int = 1 * S,
    ppm: tuple[int, int] = (0, 0),
    sca: int = 0,
    sca_ppm: int = 500,
    start: int = 0,
    size: int = 2_500 * US,
    offset: int = 0,
    created: int = 5 * MS,
) -> Link:
    ll_data = LLData(0x71764129, 0x123456, size, offset, interval, latency, timeout, ALL_CHANNELS, 7, sca)
    clocks = NativeClock(123_456_789, ppm[0]), NativeClock(987_654_321, ppm[1])
    return Link(ll_data, created, clocks, sca_ppm, start=start)


def run(link: Link, events: int, heard=always) -> list[list[tuple[Packet, Reception]]]:
    """Run events with all the time up to the next one, and return the packets of each."""
    interval = link.central.parameters.interval
    return [[(p, r) for p, r, _ in run_event(link, link.anchor + interval - MS, heard)] for _ in range(events)]


def answered(events: list[list[tuple[Packet, Reception]]]) -> list[bool]:
    return [any(packet.sender is PERIPHERAL for packet, _ in event) for event in events]


# ---------------------------------------------------------------- parameters


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ((6_250 * US, 0, S), "connection interval: 6.25 ms is not a multiple of 1.25 ms from 7.5 to 4000 ms"),
        ((8 * MS, 0, S), "connection interval: 8 ms is not a multiple of 1.25 ms from 7.5 to 4000 ms"),
        (
            (4_001_250 * US, 0, 32 * S),
            "connection interval: 4001.25 ms is not a multiple of 1.25 ms from 7.5 to 4000 ms",
        ),
        ((7_500 * US, 500, 32 * S), "latency: 500 events is not from 0 to 499"),
        ((7_500 * US, -1, 32 * S), "latency: -1 events is not from 0 to 499"),
        ((7_500 * US, 0, 90 * MS), "supervision timeout: 90 ms is not a multiple of 10 ms from 100 to 32000 ms"),
        ((7_500 * US, 0, 105 * MS), "supervision timeout: 105 ms is not a multiple of 10 ms from 100 to 32000 ms"),
        ((7_500 * US, 0, 32_010 * MS), "supervision timeout: 32010 ms is not a multiple of 10 ms from 100 to 32000 ms"),
        ((100 * MS, 4, S), "supervision timeout: 1000 ms is not > 1000 ms, 2 (1 + latency) intervals"),
    ],
)
def test_parameters_out_of_bounds_are_told_in_one_line(values: tuple[int, int, int], told: str):
    with pytest.raises(UserError) as error:
        ConnectionParameters(*values)
    assert str(error.value) == told


@pytest.mark.parametrize("values", [(7_500 * US, 499, 32 * S), (4 * S, 2, 32 * S), (7_500 * US, 0, 100 * MS)])
def test_parameters_at_the_bounds_are_allowed(values: tuple[int, int, int]):
    assert ConnectionParameters(*values).interval == values[0]


@pytest.mark.parametrize(
    ("size", "offset", "interval"),
    [
        (0, 0, 30 * MS),
        (11_250 * US, 0, 30 * MS),
        (7_500 * US, 0, 7_500 * US),
        (1_250 * US, 31_250 * US, 30 * MS),
        (MS, 0, 30 * MS),
    ],
)
def test_transmit_windows_have_bounds(size: int, offset: int, interval: int):
    with pytest.raises(UserError, match=r"transmit window( offset)?: .* is not a multiple of 1.25 ms from"):
        TransmitWindow(size, offset).check(interval)
    TransmitWindow(6_250 * US, 7_500 * US).check(7_500 * US)
    TransmitWindow(10 * MS, 0).check(30 * MS)


# ---------------------------------------------------------------- anchors and drift


def test_anchors_are_on_the_central_s_clock():
    link = link_with(ppm=(500, 0), start=1_000 * US, offset=5 * MS)
    opening = 5 * MS + 1_250 * US + 5 * MS + 1_000 * US  # end of CONNECT_IND, delay, offset, place in the window
    for number in range(50):
        nominal = opening - 5 * MS + number * 30 * MS  # 500 ppm fast: it comes early
        assert abs(link.anchor - 5 * MS - Fraction(nominal * 1_000_000, 1_000_500)) <= 2
        run(link, 1)


def test_the_first_anchor_not_before_an_instant_is_found():
    clock = NativeClock(77, -300)
    anchors = Anchors(5, 1_000_000, 30 * MS)
    for event in (5, 6, 100):
        time = clock.at_local(anchors.at(event))
        assert [anchors.first_from(clock, time + shift) for shift in (-1, 0, 1)] == [event, event, event + 1]


@pytest.mark.parametrize("central", SCA_PPM)
@pytest.mark.parametrize("interval", [7_500 * US, 30 * MS, 4 * S])
def test_a_packet_is_heard_within_the_widened_window_only(interval: int, central: int):
    ppm = central + 50
    expected = Expectation(0, 0, interval, -interval, ppm).anchored(6, 12_345)
    for silent in (1, 2, 3):
        event, elapsed = 6 + silent, silent * interval
        w = ceil(Fraction(ppm * elapsed, 1_000_000)) + 16 * US
        assert expected.widening(event) == w
        at = 12_345 + elapsed
        for shift in (-w, -1, 0, 1, w):
            assert expected.event_at(at + shift) == event
        assert expected.event_at(at - w - 1) is None
        assert expected.event_at(at + w + 1) is None


def test_the_window_of_one_second_at_500_ppm_is_as_a_maker_tells():
    expected = Expectation(0, 0, S, -S, 500).anchored(0, 0)
    assert expected.closes(1) - expected.opens(1) == 2 * (16 + 250 + 250) * US
    # Nordic's S140 document has 16 us of jitter for either side more than Vol 6 Part B, 4.2.2


def drifting(p: int, interval: int, silent: int, sca_ppm: int) -> bool:
    """Return whether the packet after *silent* missed events is heard if the clocks drift by *p* ppm apart."""
    link = link_with(interval=interval, timeout=32 * S, ppm=(p, 0), sca=7, sca_ppm=sca_ppm)
    run(link, 3)
    run(link, silent, never)
    return answered(run(link, 1))[0]


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("silent", [0, 3, 9])
def test_with_a_drift_of_p_ppm_a_packet_is_heard_if_the_error_is_within_w(sign: int, silent: int):
    interval, sca_ppm = 500 * MS, 30
    elapsed = (silent + 1) * interval
    promised = 20 + sca_ppm
    limit = promised + 16 * US * 1_000_000 // elapsed  # p elapsed <= (promised elapsed) + 16 us
    assert drifting(sign * (limit - 1), interval, silent, sca_ppm)
    assert not drifting(sign * (limit + 2), interval, silent, sca_ppm)


@pytest.mark.slow
@pytest.mark.parametrize("ppm", [(500, -500), (-500, 500), (500, 500)])
@pytest.mark.parametrize("interval", [7_500 * US, 4 * S])
@pytest.mark.parametrize("start", [0, 2_500 * US])
def test_honest_clocks_without_latency_are_never_lost(ppm: tuple[int, int], interval: int, start: int):
    link = link_with(interval=interval, timeout=32 * S, ppm=ppm, start=start)
    assert all(answered(run(link, 2_000)))
    assert link.peripheral.loss is None


def test_a_peripheral_that_knows_too_little_gives_up():
    link = link_with(interval=7_500 * US, timeout=32 * S)
    run(link, 2)
    heard = link.expected.heard
    room = 7_500 * US // 2 - 150 * US - 16 * US
    # 1000 ppm: w reaches its limit as soon as 1e-3 elapsed, rounded up, does
    elapsed = (room - 1) * 1_000 + 1
    events = -(-elapsed // (7_500 * US))
    assert link.expected.lost_from() == 1 + events
    expected = link.expected
    assert [expected.widening(event) >= 3_600 * US for event in (events, events + 1)] == [False, True]
    lost = link.peripheral.clock.at_local(heard + events * 7_500 * US)
    assert link.deadline(PERIPHERAL) == lost
    link.advance(lost - 1)
    assert link.peripheral.loss is None
    link.advance(lost)
    assert (link.peripheral.loss, link.peripheral.lost_at) == (Loss.WIDENING, lost)


@pytest.mark.parametrize("ppm", [40, 70, 999, 1_000])
@pytest.mark.parametrize("window", [0, 10 * MS])
def test_the_first_event_that_is_not_listened_to_is_the_first_whose_w_is_too_wide(ppm: int, window: int):
    limit = 30 * MS // 2 - 150 * US
    longest = (limit - 16 * US - 1) * 1_000_000 // ppm  # the longest time whose w, rounded up, is below the limit
    for shift in (-30 * MS, -1, 0, 1, 2, 1_000_000 // ppm, 30 * MS):
        expected = Expectation(3, longest + shift - window, 30 * MS, 0, ppm, window)
        by_steps = next(event for event in range(3, 10) if expected.widening(event) >= limit)
        assert expected.lost_from() == by_steps == 3 + max(0, (shift <= 0) + (shift <= -30 * MS))


def test_an_update_before_the_last_one_s_window_was_met_makes_the_window_longer():
    expected = Expectation(0, 0, 30 * MS, -30 * MS, 40).updated(5, 0, 2_500 * US, 30 * MS)
    again = expected.updated(8, 5 * MS, 10 * MS, 50 * MS)
    assert (again.event, again.local, again.interval, again.window) == (8, 8 * 30 * MS + 5 * MS, 50 * MS, 12_500 * US)


# ---------------------------------------------------------------- latency


def test_a_peripheral_with_nothing_to_send_sleeps_through_its_latency():
    link = link_with(latency=3)
    assert answered(run(link, 10)) == [True, False, False, False, True, False, False, False, True, False]


def test_a_peripheral_wakes_for_its_data_and_after_a_loss_until_it_hears_again():
    link = link_with(latency=3)
    run(link, 2)
    link.peripheral.arq.push(Fragment(Llid.START, b"data"))
    assert answered(run(link, 1)) == [True]
    assert not link.peripheral.arq.more
    run(link, 1)  # which acknowledges it
    assert answered(run(link, 4)) == [False, False, False, True]
    run(link, 4, never)
    assert answered(run(link, 2)) == [True, False]


def test_a_peripheral_stays_awake_while_the_central_has_more():
    link = link_with(latency=3)
    for _ in range(3):
        link.central.arq.push(Fragment(Llid.START, bytes(27)))
    exchange = 676 * US
    events = [run_event(link, link.anchor + exchange, always) for _ in range(5)]
    assert [len(event) for event in events] == [2, 2, 2, 1, 1]


# ---------------------------------------------------------------- supervision


@pytest.mark.parametrize("ppm", [(0, 0), (50, -50)])
@pytest.mark.parametrize(
    ("interval", "timeout"), [(7_500 * US, 100 * MS), (30 * MS, 70 * MS + 30 * MS), (S, 2_500 * MS)]
)
def test_silence_ends_a_link_after_the_timeout_and_within_an_interval(
    ppm: tuple[int, int], interval: int, timeout: int
):
    link = link_with(interval=interval, timeout=timeout, ppm=ppm)
    *_, last = run(link, 5)
    began, (first, answer) = last[0][0].start, (last[0][0].end, last[1][0].end)
    for side in sorted(Side, key=link.deadline):
        clock, end = link.ends[side].clock, first if side is PERIPHERAL else answer
        deadline = link.deadline(side)
        assert clock.local(deadline) - clock.local(end) == timeout
        assert began + timeout * (1 - 1e-4) < deadline <= began + (timeout + interval) * (1 + 1e-4)
        link.advance(deadline - 1)
        assert link.ends[side].loss is None
        link.advance(deadline)
        assert (link.ends[side].loss, link.ends[side].lost_at) == (Loss.SUPERVISION, deadline)


def test_a_link_that_never_was_is_lost_after_six_intervals():
    link = link_with(interval=30 * MS, timeout=S, created=5 * MS)
    assert [link.deadline(side) for side in Side] == [5 * MS + 180 * MS] * 2
    run(link, 3, never)
    assert [link.deadline(side) for side in Side] == [5 * MS + 180 * MS] * 2
    link.advance(185 * MS)
    assert [end.loss for end in link.ends] == [Loss.NOT_ESTABLISHED] * 2
    with pytest.raises(LocalProtocolError, match="no connection"):
        link.begin(10**12)


def test_wrong_crcs_keep_anchors_but_not_the_link():
    link = link_with(interval=30 * MS, timeout=300 * MS)
    run(link, 2)
    deadlines = [link.deadline(side) for side in Side]
    expected = link.expected
    run(link, 3, lambda _: BAD)
    assert [link.deadline(side) for side in Side] == deadlines
    assert link.expected.event == expected.event + 3


def test_what_is_asked_out_of_turn_is_misuse():
    link = link_with()
    with pytest.raises(LocalProtocolError):
        link.ended(HEARD)
    with pytest.raises(LocalProtocolError):
        link.finish()
    link.begin(S)
    with pytest.raises(LocalProtocolError):
        link.begin(S)
    with pytest.raises(LocalProtocolError, match="window"):
        link_with(start=2_500 * US + 1)


# ---------------------------------------------------------------- instants


def test_instants_lie_ahead_modulo_65536():
    assert instant_for(65_530, 3) == 4
    assert event_at(4, 65_530) == 65_540
    assert event_at(10, 9) == 10
    assert [event_at(10, event) for event in (10, 11, 10 + 32_768)] == [None, None, None]
    assert event_at(32_766, 0) == 32_766
    assert event_at(32_767, 0) is None


@pytest.mark.parametrize("latency", [0, 2])
def test_both_ends_change_the_map_at_the_instant(latency: int):
    link = link_with(latency=latency)
    run(link, 3)
    used = ChannelMap((3, 8, 20))
    link.announce(lambda instant: ChannelMapInd(used, instant))
    instant = 3 + latency + 7
    channels = []
    for event in range(3, instant + 2):
        channels.append({link.channel(side, event) for side in Side})
        run(link, 1)
        assert [end.used == used for end in link.ends] == [event >= instant] * 2
    assert answered(run(link, 12)).count(True) >= 4


def test_a_peripheral_that_missed_a_new_map_stays_on_the_old_one_s_channels():
    link = link_with(timeout=10 * S)
    run(link, 3)
    used = ChannelMap((3, 8))
    link.announce(lambda instant: ChannelMapInd(used, instant))
    run(link, 7, never)
    while link.peripheral.loss is None:  # the first event that both take for the same channel tells what was missed
        link.advance(link.anchor)
        assert [end.used for end in link.ends] == [used, ALL_CHANNELS]
        alone = link.channel(PERIPHERAL, link.event) != link.channel(CENTRAL, link.event)
        run(link, 1)
        assert (link.peripheral.loss is None) == alone
    assert link.peripheral.loss is Loss.INSTANT_PASSED


def test_new_parameters_begin_in_a_window_after_the_instant_s_old_anchor():
    link = link_with(ppm=(100, -100))
    run(link, 3)
    parameters = ConnectionParameters(50 * MS, 1, 2 * S)
    window = TransmitWindow(2_500 * US, 10 * MS)
    before = link.anchors
    link.announce(lambda instant: ConnectionUpdateInd(window, parameters, instant))
    run(link, 7)
    local = link.central.clock.local
    assert local(link.anchor) == before.at(10) + 10 * MS
    assert all(answered(run(link, 1)))
    assert local(link.anchor) == before.at(10) + 60 * MS
    assert [end.parameters for end in link.ends] == [parameters] * 2
    assert answered(run(link, 4)) == [False, True, False, True]


def test_the_timer_begins_anew_at_the_instant_of_new_parameters():
    link = link_with(timeout=500 * MS)
    run(link, 3)
    link.announce(
        lambda instant: ConnectionUpdateInd(
            TransmitWindow(2_500 * US, 30 * MS), ConnectionParameters(4 * S, 0, 9 * S), instant
        )
    )
    run(link, 7)
    instants = [
        end.clock.at_local(at) for end, at in zip(link.ends, (link.anchors.at(10), link.expected.at(10)), strict=True)
    ]
    link.advance(max(instants))
    assert [link.deadline(side) for side in Side] == [at + 9 * S for at in instants]


# ---------------------------------------------------------------- procedures


@pytest.mark.parametrize("side", list(Side))
def test_a_link_is_terminated_at_both_ends(side: Side):
    link = link_with()
    run(link, 2)
    link.terminate(side)
    packets = [packet for event in run(link, 1 + side) for packet, _ in event]
    assert [end.loss for end in link.ends] == [Loss.TERMINATED] * 2
    assert {end.lost_at for end in link.ends} == {packets[-1].end}


def test_a_lost_acknowledgement_of_the_end_leaves_the_other_to_its_timer():
    link = link_with(timeout=200 * MS)
    run(link, 2)
    link.terminate(CENTRAL)
    run(link, 1, lambda packet: MISSED if packet.sender is PERIPHERAL else HEARD)
    assert [end.loss for end in link.ends] == [None, Loss.TERMINATED]
    run(link, 3)
    link.advance(S)
    assert link.central.loss is Loss.SUPERVISION


def test_lengths_are_the_least_of_what_one_sends_and_the_other_receives():
    link = link_with()
    assert [end.longest for end in link.ends] == [27, 27]
    run(link, 1)
    link.peripheral.lengths = Lengths(False, 100, 2_120 * US, 251, 2_120 * US)
    link.request_lengths(CENTRAL, Lengths(False, 251, 1_000 * US, 251, 2_120 * US))
    run(link, 2)
    assert link.central.longest == 100
    assert link.peripheral.longest == (1_000 - 80) // 8 - 4


@pytest.mark.parametrize(("side", "events"), [(CENTRAL, 1), (PERIPHERAL, 2)])
@pytest.mark.parametrize(("likes", "phy"), [(PHY_2M, LE_2M), (PHY_CODED, CODED_S8), (PHY_1M | PHY_2M, LE_2M)])
def test_phys_change_at_their_instant(side: Side, events: int, likes: int, phy: object):
    link = link_with()
    run(link, 2)
    link.request_phys(side, likes)
    while not link.central.pending:
        run(link, 1)
    ((instant, change),) = link.central.pending
    assert isinstance(change, PhyUpdateInd)
    run(link, instant - link.event)
    assert link.central.phys == (LE_1M, LE_1M)
    (event,) = run(link, 1)
    assert [packet.air for packet, _ in event] == [phy.air_time(0)] * 2
    assert [end.phys for end in link.ends] == [(phy, phy)] * 2


def test_each_direction_has_the_phy_that_was_asked_for_it():
    link = link_with()
    run(link, 2)
    link.peripheral.arq.push(encode_control(Phys(False, PHY_2M, PHY_CODED)))  # to send on, to receive on
    run(link, 12)
    assert [end.phys for end in link.ends] == [(CODED_S8, LE_2M)] * 2


def test_a_peripheral_that_missed_new_phys_hears_nothing_from_their_instant_on():
    link = link_with(timeout=300 * MS)
    run(link, 2)
    link.announce(lambda instant: PhyUpdateInd(PHY_2M, PHY_2M, instant))
    run(link, 7, never)
    assert not any(answered(run(link, 2)))
    link.advance(S)
    assert [end.loss for end in link.ends] == [Loss.SUPERVISION] * 2


def test_control_pdus_that_are_none_are_left_alone_and_counted():
    link = link_with()
    for payload in (b"", b"\xff", b"\x02", bytes(12)):
        link.central.arq.push(Fragment(Llid.CONTROL, payload))
    link.peripheral.arq.push(Fragment(Llid.CONTROL, bytes.fromhex("01 ffffffff1f 0900")))  # a map, of a peripheral
    run(link, 2)
    assert link.errors == 5
    assert [end.loss for end in link.ends] == [None, None]
