"""Adaptive frequency hopping: bad channels are found, left out, tried again; and the answer stays on its channel."""

from math import sqrt

import pytest

from cosim.channels.air.quality import SAMPLES, ChannelQuality
from cosim.channels.bluetooth.afh import LEAST_CHANNELS, in_order
from cosim.channels.bluetooth.hopping import adapted_channel, basic_channel
from cosim.channels.bluetooth.polling import USED
from cosim.channels.bluetooth.radio import Heard
from cosim.channels.jamming import CONSTANT, Jammer
from cosim.units import MS, SLOT, S, Time
from tests.channels.bluetooth.piconet_bench import WORD, Bench

JAMMED = tuple(range(30, 50))
FREE = [channel for channel in range(79) if channel not in JAMMED]
AFH = (1 * S, 60 * S)


def jammer(end: Time = 1 << 60) -> Jammer:
    return Jammer(0.0, 0.0, 0.0, JAMMED, CONSTANT, 0, 0, 0, 0, end)


def loss(bench: Bench, since: Time) -> tuple[int, float]:
    """Number of polls from *since* on, and the part of them that was not answered."""
    polls = sum(frame.start >= since and frame.kind == "POLL" for frame, _ in bench.frames)
    answers = [heard for frame, heard in bench.frames if frame.start >= since and frame.kind == "NULL"]
    return polls, 1 - answers.count(Heard.RECEIVED) / polls


# ---------------------------------------------------------------- the map


def none() -> list[int]:
    return [0] * 79


def test_a_channel_that_fails_more_often_than_not_is_left_out_once_there_are_enough_samples() -> None:
    channels = ChannelQuality(79, LEAST_CHANNELS, 10 * S)
    heard, failed = none(), none()
    failed[3], failed[5], failed[7], heard[7] = SAMPLES, SAMPLES - 1, 3, 3
    assert channels.update(heard, failed, 0)
    assert channels.used == [channel for channel in range(79) if channel != 3]
    assert not channels.update(none(), none(), 1)
    failed = none()
    failed[5] = 1  # with what was counted before
    assert channels.update(none(), failed, 2)
    assert {3, 5}.isdisjoint(channels.used)


def test_a_bad_channel_is_tried_again_after_a_while_and_judged_anew() -> None:
    channels = ChannelQuality(79, LEAST_CHANNELS, 10 * S)
    bad = none()
    bad[3] = 9
    channels.update(none(), bad, 0)
    assert not channels.update(none(), none(), 10 * S - 1)
    assert channels.update(none(), none(), 10 * S)
    assert 3 in channels.used
    bad[3] = SAMPLES - 1
    assert not channels.update(none(), bad, 11 * S)
    bad[3] = 1
    assert channels.update(none(), bad, 12 * S)


def test_a_channel_that_was_good_for_long_is_found_bad_soon() -> None:
    channels = ChannelQuality(79, LEAST_CHANNELS, 10 * S)
    good = none()
    good[3] = 1000
    channels.update(good, none(), 0)
    bad = none()
    bad[3] = 4 * SAMPLES
    assert channels.update(none(), bad, 1)


def test_at_least_twenty_channels_stay_the_best_of_the_bad() -> None:
    channels = ChannelQuality(79, LEAST_CHANNELS, 10 * S)
    heard, failed = [0] * 79, [6] * 79
    for channel in range(40, 60):
        heard[channel] = 4
    assert channels.update(heard, failed, 0)
    assert channels.used == list(range(40, 60))
    assert len(channels.used) == LEAST_CHANNELS


def test_channels_are_given_in_the_order_in_which_the_hop_kernel_counts_them() -> None:
    assert in_order([1, 2, 3, 0, 78, 77]) == [0, 2, 78, 1, 3, 77]


# ---------------------------------------------------------------- at work


@pytest.mark.slow
def test_with_a_jammer_on_twenty_channels_the_loss_falls_to_nothing() -> None:
    bench = Bench(1, t_poll_slots=16, afh=AFH)
    bench.jam(jammer())
    bench.run(40 * S)
    assert loss(bench, 30 * S) == (1000, 0.0)
    early = [heard for frame, heard in bench.frames if frame.start < 2 * S and frame.kind == "POLL"]
    assert 0.1 < 1 - early.count(Heard.RECEIVED) / len(early) < 0.4  # 20 / 79 of 200, four standard deviations
    assert bench.air.adapted.used[0, :59].tolist() == in_order(FREE)
    assert bench.air.band.piconets[0, USED] == 59


@pytest.mark.slow
@pytest.mark.parametrize("source", [0, 1])
def test_payloads_tell_of_bad_channels_as_well_as_polls_do(source: int) -> None:
    bench = Bench(1, t_poll_slots=16 if source else 4000, first_due=4, afh=(1 * S, 60 * S))
    bench.jam(jammer())
    for i in range(1500):
        bench.send(i * 5 * MS, source, 1 - source, bytes(27))
    bench.run(12 * S)
    assert bench.air.adapted.used[0, :59].tolist() == in_order(FREE)
    assert bench.air.band.piconets[0, USED] == 59


@pytest.mark.slow
def test_without_it_the_loss_stays() -> None:
    bench = Bench(1, t_poll_slots=16)
    bench.jam(jammer())
    bench.run(40 * S)
    polls, part = loss(bench, 0)
    expected = 1 - (59 / 79) ** 2  # POLL and NULL go on channels of their own
    assert abs(part - expected) < 4 * sqrt(expected * (1 - expected) / polls)


@pytest.mark.slow
def test_when_the_jammer_is_gone_all_channels_come_back() -> None:
    bench = Bench(1, t_poll_slots=16, afh=(1 * S, 10 * S))
    bench.jam(jammer(end=20 * S))
    bench.run(11 * S)
    assert bench.air.band.piconets[0, USED] <= 65
    bench.run(32 * S)
    assert bench.air.band.piconets[0, USED] == 79
    assert bench.air.adapted.used[0].tolist() == in_order(range(79))


@pytest.mark.parametrize("slots", [1, 3, 5])
def test_a_slave_answers_on_the_channel_of_the_packet_that_it_answers(slots: int) -> None:
    length = {1: 5, 3: 120, 5: 300}[slots]
    for afh in (None, AFH):
        bench = Bench(1, afh=afh)
        for i in range(20):
            bench.send(i * 10 * MS, 0, 1, bytes(length))
            bench.send(i * 10 * MS, 1, 0, bytes(length))
        bench.run(400 * SLOT)
        frames = [(bench.clock.tick(frame.start), frame.channel, frame.source) for frame, _ in bench.frames]
        asked = [tick for tick, _, source in frames if source == 0]
        assert len(frames) == 2 * len(asked) > 40
        for (asking, _, _), (tick, channel, source) in zip([(None, 0, 0), *frames], frames, strict=False):
            own = tick if source == 0 else asking
            expected = basic_channel(WORD, tick) if afh is None else adapted_channel(WORD, own, range(79))
            assert channel == expected


def test_a_new_hop_set_waits_for_the_end_of_the_slot_pair_under_way() -> None:
    bench = Bench(1, afh=(1 * S + 1 * MS, 60 * S))
    bench.send(1 * S, 0, 1, bytes(300))  # six slots: until 1.00375 s
    bench.kernel.at(1 * S, lambda: bench.air.adapted.tallies[0, 1].__setitem__(5, 10))
    bench.run(1003 * MS)
    assert bench.air.band.piconets[0, USED] == 79
    bench.run(1004 * MS)
    assert bench.air.band.piconets[0, USED] == 78


def test_a_new_hop_set_is_used_from_a_slot_pair_on_and_never_within_one() -> None:
    bench = Bench(3, t_poll_slots=16, afh=(500 * MS + 1, 3 * S))
    bench.jam(jammer())
    for i in range(300):
        bench.send(i * 20 * MS, i % 2 * 2, 2 - i % 2 * 2, bytes(300))
    bench.run(8 * S)
    last: dict[int, int] = {}
    pairs = 0
    for frame, _ in bench.frames:
        if frame.source:
            assert frame.channel == last[frame.lt_addr]
            pairs += 1
        last[frame.lt_addr] = frame.channel
    assert pairs > 500
    assert len({frame.channel for frame, _ in bench.frames if frame.start > 7 * S}) < 79


def test_a_piconet_without_links_assesses_nothing() -> None:
    bench = Bench(0, devices=2, afh=AFH)
    bench.run(100 * S)
    assert bench.kernel.executed == 0
