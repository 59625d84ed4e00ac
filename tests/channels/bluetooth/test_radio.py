"""Who hears what: frames that overlap destroy each other where the carrier is too weak, and noise takes its share.

Every expectation is worked out here from the rules (two half-open intervals overlap or they do not; a carrier of less
than 11 dB above the sum of what the receiver's filter lets through is lost), none is taken from the code under test.
"""

import math
from typing import Any

import numpy as np
import pytest

from cosim.channels.bluetooth.hopping import GIAC, inquiry_channel, page_channel, scan_channels
from cosim.channels.bluetooth.medium import GAPS
from cosim.channels.bluetooth.radio import Fate, Frame, Heard, Interference, Part
from cosim.channels.bluetooth.scanning import IdTrain
from cosim.channels.clock import NativeClock
from cosim.units import MS, TICK, US, Time
from tests.channels.bluetooth.radio_scene import (
    ACCESS_END,
    BEGIN,
    DM1_AIR,
    DM5_AIR,
    HAIR_DB,
    HEADER_END,
    ID_AIR,
    NEVER,
    RECEIVED,
    Scene,
)


def collision(start: Time, end: Time, duration: Time = DM1_AIR, channel: int = 40) -> Fate:
    """Return the fate of the frame from BEGIN on when another device sends during [BEGIN + start, BEGIN + end)."""
    scene = Scene()
    frames = [(BEGIN + start, 2, end - start, channel), (BEGIN, 1, duration, 40)]
    wanted = [scene.put(source, at, length, on) for at, source, length, on in sorted(frames)]
    return scene.judge(next(frame for frame in wanted if frame.source == 1))


# ---------------------------------------------------------------- overlap


def test_a_frame_that_is_alone_is_received():
    scene = Scene()
    assert scene.judge(scene.put(1, BEGIN)) == RECEIVED


@pytest.mark.parametrize(
    ("start", "end", "part"),
    [
        (-DM1_AIR, 0, Part.NONE),
        (-DM1_AIR, 1, Part.ACCESS_CODE),
        (0, DM1_AIR, Part.ACCESS_CODE),
        (ACCESS_END - 1, ACCESS_END, Part.ACCESS_CODE),
        (ACCESS_END, ACCESS_END + 1, Part.HEADER),
        (HEADER_END - 1, DM1_AIR, Part.HEADER),
        (HEADER_END, DM1_AIR, Part.PAYLOAD),
        (DM1_AIR - 1, 2 * DM1_AIR, Part.PAYLOAD),
        (DM1_AIR, 2 * DM1_AIR, Part.NONE),
        (-5 * MS, 5 * MS, Part.ACCESS_CODE),
    ],
)
def test_the_first_part_that_another_frame_overlaps_is_lost_to_the_nanosecond(start: Time, end: Time, part: Part):
    assert collision(start, end) == (Fate(Heard.COLLIDED, part) if part else RECEIVED)


@pytest.mark.parametrize(
    ("start", "lost"), [(ID_AIR - 1, True), (ID_AIR, False), (-DM1_AIR + 1, True), (-DM1_AIR, False)]
)
def test_an_id_has_no_trailer_and_no_header_to_lose(start: Time, lost: bool):
    fate = Fate(Heard.COLLIDED, Part.ACCESS_CODE) if lost else RECEIVED
    assert collision(start, start + DM1_AIR, ID_AIR) == fate


def test_a_packet_without_payload_ends_with_its_header():
    assert collision(HEADER_END - 1, HEADER_END + 1, HEADER_END) == Fate(Heard.COLLIDED, Part.HEADER)
    assert collision(HEADER_END, HEADER_END + 1, HEADER_END) == RECEIVED


def test_both_of_two_frames_that_overlap_are_destroyed():
    scene = Scene()
    first, second = scene.put(1, BEGIN), scene.put(2, BEGIN + DM1_AIR - 1)
    assert scene.judge(first) == Fate(Heard.COLLIDED, Part.PAYLOAD)
    assert scene.judge(second) == Fate(Heard.COLLIDED, Part.ACCESS_CODE)


def test_a_collision_happens_only_where_both_are_heard():
    scene = Scene()
    scene.power(2, NEVER, receiver=0)
    frame = scene.put(1, BEGIN)
    scene.put(2, BEGIN)
    assert scene.judge(frame, receiver=0) == RECEIVED
    assert scene.judge(frame, receiver=3) == Fate(Heard.COLLIDED, Part.ACCESS_CODE)


def test_a_disturber_counts_as_strong_as_it_is_when_the_frame_ends():
    scene = Scene()
    frame = scene.put(1, BEGIN)
    scene.put(2, BEGIN)
    scene.power(2, NEVER)
    assert scene.judge(frame) == RECEIVED
    scene.power(2, 0.0)
    assert scene.judge(frame) == Fate(Heard.COLLIDED, Part.ACCESS_CODE)


def test_frames_of_the_transmitter_and_the_receiver_themselves_do_not_interfere():
    scene = Scene()
    frame = scene.put(1, BEGIN)
    scene.put(1, BEGIN + 100)
    scene.put(0, BEGIN + 200)
    assert scene.judge(frame) == RECEIVED
    assert scene.judge(frame, receiver=2) == Fate(Heard.COLLIDED, Part.ACCESS_CODE)  # device 0 disturbs others


def test_a_carrier_that_is_too_weak_is_out_of_range_and_without_noise_none_is():
    noisy = Scene(noise_dbm=-92.0)
    assert noisy.air.judge(noisy.put(1, BEGIN), 0, math.nextafter(-92.0, NEVER)).heard is Heard.OUT_OF_RANGE
    assert noisy.air.judge(noisy.put(1, BEGIN), 0, -92.0).heard is Heard.BIT_ERRORS
    quiet = Scene()
    assert quiet.air.judge(quiet.put(1, BEGIN), 0, -300.0) == RECEIVED
    assert quiet.air.judge(quiet.put(1, BEGIN), 0, NEVER).heard is Heard.OUT_OF_RANGE


# ---------------------------------------------------------------- carrier to interference

THRESHOLD_DB = {0: 11.0, 1: 0.0, 2: -30.0, 3: -40.0, 4: -40.0, 38: -40.0}
"""By distance in MHz (Core v1.2, Vol 2 Part A, section 4.2)."""


@pytest.mark.parametrize("carrier_dbm", [0.0, -70.0])
@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("apart", THRESHOLD_DB)
def test_a_frame_survives_at_its_carrier_to_interference_ratio_and_not_a_hair_below(
    apart: int, side: int, carrier_dbm: float
):
    for hair, fate in ((-HAIR_DB, RECEIVED), (HAIR_DB, Fate(Heard.COLLIDED, Part.ACCESS_CODE))):
        scene = Scene()
        scene.power(1, carrier_dbm)
        scene.power(2, carrier_dbm - THRESHOLD_DB[apart] + hair)
        frame = scene.put(1, BEGIN)
        scene.put(2, BEGIN, channel=40 + side * apart)
        assert scene.judge(frame) == fate


def test_one_equal_frame_in_the_next_channel_destroys_nothing():
    assert collision(0, DM1_AIR, channel=41) == RECEIVED


@pytest.mark.parametrize(("mode", "lost"), [("none", ()), ("co_channel", (0,)), ("neighbouring", (0, 1, 2, 3))])
def test_the_mode_says_which_channels_can_disturb_at_all(mode: Interference, lost: tuple[int, ...]):
    for apart in range(5):
        scene = Scene(interference=mode)
        scene.power(2, 39.0 if apart > 2 else 29.0 if apart == 2 else 10.0)
        frame = scene.put(1, BEGIN)
        scene.put(2, BEGIN, channel=40 + apart)
        expected = apart in lost and apart < 2  # C/I of -29 and -39 dB are enough two and three channels away
        assert (scene.judge(frame) != RECEIVED) == expected
        scene.power(2, 41.0)  # not enough anywhere
        assert (scene.judge(frame) != RECEIVED) == (min(apart, 3) in lost)


@pytest.mark.parametrize("hair", [-HAIR_DB, HAIR_DB])
@pytest.mark.parametrize(
    "others",
    [
        [(0, 1.0), (0, 1.0)],
        [(0, 1.0), (1, 2.0)],
        [(0, 3.0), (1, 2.0), (2, 5.0), (7, 1.0)],
        [(1, 1.0), (-1, 1.0), (2, 1.0), (-2, 1.0)],
    ],
)
def test_interferers_add_up(others: list[tuple[int, float]], hair: float):
    """Each has a share of the interference that is just endured: 11 dB below the carrier, behind the filter."""
    scene = Scene()
    whole = sum(share for _, share in others)
    for source, (apart, share) in enumerate(others, 2):
        weakened = 11.0 - THRESHOLD_DB[abs(apart) if abs(apart) < 4 else 4]
        scene.power(source, -11.0 + weakened + 10 * math.log10(share / whole) + hair)
    frame = scene.put(1, BEGIN)
    for source, (apart, _) in enumerate(others, 2):
        scene.put(source, BEGIN + 100 * US, channel=40 + apart)
    assert scene.judge(frame) == (RECEIVED if hair < 0 else Fate(Heard.COLLIDED, Part.HEADER))


def test_interferers_that_follow_each_other_within_a_part_count_together():
    scene = Scene()
    for source in (2, 3):
        scene.power(source, -13.0)  # each 13 dB below the carrier, 9.99 dB both
    frame = scene.put(1, BEGIN, DM5_AIR)
    scene.put(2, BEGIN + MS)
    scene.put(3, BEGIN + 2 * MS)
    assert scene.judge(frame) == Fate(Heard.COLLIDED, Part.PAYLOAD)


# ---------------------------------------------------------------- trains of IDs


def brute_force(clock: NativeClock, begin: int, since: Time, until: Time, channel_of: Any, frame: Frame) -> bool:
    """Tell whether an ID on the frame's channel overlaps it: every tick about it is looked at."""
    about = clock.tick(frame.start)
    for tick in range(max(begin, about - 3), clock.tick(frame.start + frame.duration) + 2):
        start = clock.time_of(tick)
        sent = tick % 4 in (0, 1) and since <= start < until
        overlaps = start < frame.start + frame.duration and start + ID_AIR > frame.start
        if sent and overlaps and channel_of(tick) == frame.channel:
            return True
    return False


@pytest.mark.parametrize("pager", [False, True])
def test_a_frame_is_hit_by_exactly_the_ids_that_overlap_it(pager: bool):
    draw = np.random.default_rng(pager)
    word = 0x2A96EF25 if pager else GIAC
    hits = 0
    for _ in range(1_000):
        clock = NativeClock(int(draw.integers(1 << 28)) * TICK + int(draw.integers(TICK)), int(draw.integers(-20, 21)))
        begin = -(-clock.tick(MS) // 4) * 4
        estimate = int(draw.integers(1 << 20)) * 4 if pager else 0
        train = IdTrain(clock, begin, begin + 400, 1, "B" if draw.integers(2) else "A", estimate)
        since = clock.time_of(begin + int(draw.integers(40))) + int(draw.integers(-1, 2))

        def channel_of(tick: int, train: IdTrain = train) -> int:
            turn = train.train(tick)
            return page_channel(word, tick + train.estimate, turn) if pager else inquiry_channel(tick, turn)

        scene = Scene(interference="co_channel")
        scene.air.open_train(train.on_air(2, since), scan_channels(word), 0)
        until = clock.time_of(train.end)
        if draw.integers(2):
            until = clock.time_of(begin + int(draw.integers(10, 120))) + int(draw.integers(-1, 2))
            scene.air.close_train(2, until)
        tick = begin + 4 * int(draw.integers(-1, 30)) + int(draw.integers(2))
        # about the start or the end of an ID, or long before it
        edge = clock.time_of(tick) + (0, ID_AIR)[draw.integers(2)]
        length = int(draw.choice([ID_AIR, DM1_AIR, DM5_AIR]))
        start = edge + int(draw.integers(-1, 2)) - (length if draw.integers(2) else 0)
        frame = scene.put(1, start, length, channel_of(tick))
        expected = brute_force(clock, begin, since, until, channel_of, frame)
        assert (scene.judge(frame) != RECEIVED) == expected
        hits += expected
    assert 200 < hits < 900


def test_a_train_that_pauses_sends_no_id_that_would_start_meanwhile():
    clock = NativeClock(0)
    pauses = [range(64 + 8 * i, 68 + 8 * i) for i in range(GAPS + 1)]  # the first is so old that it counts no more
    for tick in (tick for tick in range(64, pauses[-1].stop + 8) if tick & 2 == 0):
        scene = Scene(interference="co_channel")
        scene.air.open_train(IdTrain(clock, 32, 640, 100).on_air(2, 0), scan_channels(GIAC), 0)
        for pause in pauses:
            scene.air.silence_train(2, clock.time_of(pause.start) + 1, clock.time_of(pause.stop))
        silent = any(tick in pause and tick > pause.start for pause in pauses[1:])
        frame = scene.put(1, clock.time_of(tick), channel=inquiry_channel(tick, "A"))
        assert (scene.judge(frame) == RECEIVED) == silent


def test_a_train_does_not_disturb_its_own_device_or_who_does_not_hear_it():
    clock = NativeClock(0)
    train = IdTrain(clock, 32, 64, 1)
    frame_of = {"start": clock.time_of(32), "channel": inquiry_channel(32, "A")}
    for device, power_dbm, lost in ((2, 0.0, True), (0, 0.0, False), (1, 0.0, False), (2, NEVER, False)):
        scene = Scene()
        scene.power(2, power_dbm)
        scene.air.open_train(train.on_air(device, 0), scan_channels(GIAC), 0)
        assert (scene.judge(scene.put(1, **frame_of)) != RECEIVED) == lost


def test_a_train_beside_the_channel_counts_by_its_distance():
    clock = NativeClock(0)
    channels = [inquiry_channel(tick, "A") for tick in (32, 33)]
    assert min(abs(channels[0] - channels[1] + side) for side in (-1, 1)) > 3  # two IDs, of which one is far away
    for power_dbm, lost in ((-1.0, False), (1.0, True)):
        scene = Scene()
        scene.power(2, power_dbm)
        scene.air.open_train(IdTrain(clock, 32, 64, 1).on_air(2, 0), scan_channels(GIAC), 0)
        frame = scene.put(1, clock.time_of(32), channel=channels[0] + (1 if channels[0] < 78 else -1))
        assert (scene.judge(frame) != RECEIVED) == lost
