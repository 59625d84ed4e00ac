"""Who hears what: frames that overlap destroy each other where the carrier is too weak, and noise takes its share.

Every expectation is worked out here from the rules (two half-open intervals overlap or they do not; a carrier of less
than 11 dB above the sum of what the receiver's filter lets through is lost), none is taken from the code under test.
"""

import math
from typing import Any

import numpy as np
import pytest
from scipy import stats

from cosim.channels.bluetooth import medium, polling
from cosim.channels.bluetooth.clock import NativeClock
from cosim.channels.bluetooth.errors import section_errors
from cosim.channels.bluetooth.hopping import GIAC, basic_channel, inquiry_channel, page_channel, scan_channels
from cosim.channels.bluetooth.links import Links
from cosim.channels.bluetooth.packets import DH1, DM1, FHS, ID
from cosim.channels.bluetooth.radio import Air, Fate, Frame, Heard, Interference, Part
from cosim.channels.bluetooth.scanning import IdTrain
from cosim.channels.jamming import CONSTANT, PULSED, SWEEPING, Jammer
from cosim.machine import Address
from cosim.randomness import philox
from cosim.units import MS, TICK, US, Time

DM1_AIR, DM5_AIR, ID_AIR = 366 * US, 2871 * US, 68 * US
"""Air times with a full payload (Core v1.2, Vol 2 Part B, section 6.5)."""
ACCESS_END, HEADER_END = 72 * US, 126 * US
BEGIN = 10 * MS
RECEIVED = Fate(Heard.RECEIVED)
HAIR_DB = 1e-9
NEVER = -math.inf


class Scene:
    """An air between some devices; device 0 receives what device 1 sends from BEGIN on, on channel 40."""

    def __init__(self, size: int = 6, interference: Interference = "neighbouring", **settings: Any) -> None:
        self.air = Air(size, None, interference, **settings)
        self.powers = np.zeros((size, size))
        np.fill_diagonal(self.powers, NEVER)

    def power(self, source: Address, power_dbm: float, receiver: Address = 0) -> None:
        self.powers[source, receiver] = power_dbm
        self.air.set_powers(self.powers, 0)

    def put(self, source: Address, start: Time, duration: Time = DM1_AIR, channel: int = 40) -> Frame:
        frame = Frame(start, duration, "DM1", source, 0, channel)
        self.air.put(frame)
        return frame

    def judge(self, frame: Frame, receiver: Address = 0, bits: int = 160) -> Fate:
        return self.air.judge(frame, receiver, self.air.carrier(frame.source, receiver), bits)


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


# ---------------------------------------------------------------- what is remembered


def test_many_trains_come_and_go_and_the_last_one_is_still_met():
    """Each of a thousand trains ends one nanosecond after a long frame has begun that is judged as late as possible."""
    scene = Scene(interference="co_channel")
    air = scene.air
    for number in range(1, 1001):
        clock = NativeClock(0)
        first = 32 * number
        start = clock.time_of(first) + ID_AIR - 1
        air.open_train(IdTrain(clock, first, first + 32, 1).on_air(2, clock.time_of(first)), scan_channels(GIAC), 0)
        air.close_train(2, clock.time_of(first) + 1)
        frame = scene.put(1, start, DM5_AIR, inquiry_channel(first, "A"))
        air.advance(start + DM5_AIR)
        assert scene.judge(frame) == Fate(Heard.COLLIDED, Part.ACCESS_CODE)
        assert air.band.medium.numbers[1] <= 3


def test_any_number_of_trains_may_be_on_the_air_at_once():
    scene = Scene(size=100, interference="co_channel")
    clock = NativeClock(0)
    for device in range(2, 100):
        scene.power(device, NEVER if device < 99 else 0.0)
        scene.air.open_train(IdTrain(clock, 32, 640, 1).on_air(device, 0), scan_channels(GIAC), 0)
    frame = scene.put(1, clock.time_of(64), channel=inquiry_channel(64, "B"))
    assert scene.judge(frame) == Fate(Heard.COLLIDED, Part.ACCESS_CODE)
    scene.air.close_train(99, clock.time_of(64))
    assert scene.judge(frame) == RECEIVED


@pytest.mark.parametrize("later", [0, 1, 2])
def test_a_long_frame_is_destroyed_by_one_that_was_ending_when_it_began(later: int):
    """A device sends no more than a frame in every slot pair meanwhile: that one is not forgotten for them."""
    scene = Scene()
    scene.put(2, BEGIN - DM5_AIR + 1, DM5_AIR)
    frame = scene.put(1, BEGIN, DM5_AIR)
    for number in range(later):
        scene.put(2, BEGIN + (number + 1) * 1250 * US, HEADER_END, channel=3)
    scene.air.advance(BEGIN + DM5_AIR)
    assert scene.judge(frame) == Fate(Heard.COLLIDED, Part.ACCESS_CODE)


def lone_piconet(size: int = 4) -> tuple[Air, Any, Any]:
    """Device 0 polls device 1 every 10 ms; nobody else is heard of."""
    air = Air(size, interference="co_channel")
    piconet, table = air.band.piconets[0], air.band.links[0]
    polling.reset(piconet, table, 16, 0, 0, 5)
    piconet[polling.MASTER], piconet[polling.WORD] = 0, 0x2A96EF25
    links = Links(0, piconet, table)
    links.join(1, 1, 0)
    links.admit(1, 0, 0)
    air.changed(0)
    return air, piconet, table


def test_a_frame_of_a_page_meets_the_polls_of_a_piconet_that_was_alone_and_they_it():
    air, _, table = lone_piconet()
    air.advance(20 * MS)
    poll = 64  # every 32 ticks
    start, channel = poll * TICK, basic_channel(0x2A96EF25, poll)
    heard = int(table[polling.HEARD_DOWN, 1])
    assert heard == 32 * TICK + HEADER_END
    frame = Frame(start, HEADER_END, "POLL", 2, 3, channel)
    air.put(frame)
    assert air.judge(frame, 3, 0.0) == Fate(Heard.COLLIDED, Part.ACCESS_CODE)
    air.advance(start + 5 * MS)
    assert table[polling.HEARD_DOWN, 1] == heard
    air.advance(start + 15 * MS)  # the next one is heard again
    assert table[polling.HEARD_DOWN, 1] == 96 * TICK + HEADER_END


def test_a_poll_on_the_air_as_the_calm_ends_is_met_by_what_ends_it():
    for after, lost in ((HEADER_END - 1, True), (HEADER_END, False)):
        air, _, _ = lone_piconet()
        air.advance(20 * MS)
        start = 64 * TICK + after
        air.advance(start)
        frame = Frame(start, DM1_AIR, "FHS", 2, 3, basic_channel(0x2A96EF25, 64))
        air.put(frame)
        assert (air.judge(frame, 3, 0.0) != RECEIVED) == lost


def test_a_payload_on_the_air_as_the_calm_ends_is_met_by_what_ends_it():
    for after, lost in ((DM1_AIR - 1, True), (DM1_AIR, False)):
        air, _, _ = lone_piconet()
        air.advance(15 * MS)
        air.send(0, 15 * MS, DM1_AIR, 7)
        frame = Frame(15 * MS + after, DM1_AIR, "FHS", 2, 3, 7)
        air.put(frame)
        assert (air.judge(frame, 3, 0.0) != RECEIVED) == lost


def test_a_payload_that_begins_during_a_frame_of_a_page_meets_it():
    for before, lost in ((1, True), (0, False)):
        air, _, _ = lone_piconet()
        air.advance(15 * MS)
        frame = Frame(15 * MS, DM1_AIR, "FHS", 2, 3, 7)
        air.put(frame)
        air.send(0, 15 * MS + DM1_AIR - before, DM1_AIR, 7)
        assert (air.judge(frame, 3, 0.0) != RECEIVED) == lost


# ---------------------------------------------------------------- jammers


def jam(mode: int, channels: tuple[int, ...] = (40,), **times: Time) -> Jammer:
    values = {"dwell": 0, "on": 0, "period": 0, "start": 0, "end": 10**12} | times
    return Jammer(0.0, 0.0, 0.0, channels, mode, **values)


def jammed(jammer: Jammer, power_dbm: float = 0.0, start: Time = BEGIN, receiver: Address = 0) -> Fate:
    scene = Scene()
    scene.air.set_jammers([jammer], 0)
    powers = np.full((1, 6), NEVER)
    powers[0, 0] = power_dbm
    scene.air.set_jam_powers(powers, 0)
    return scene.judge(scene.put(1, start), receiver)


ACCESS_LOST, HEADER_LOST, PAYLOAD_LOST = (Fate(Heard.COLLIDED, part) for part in list(Part)[1:])


@pytest.mark.parametrize(
    ("jammer", "fate"),
    [
        (jam(CONSTANT), ACCESS_LOST),
        (jam(CONSTANT, end=BEGIN), RECEIVED),
        (jam(CONSTANT, end=BEGIN + 1), ACCESS_LOST),
        (jam(CONSTANT, start=BEGIN + ACCESS_END), HEADER_LOST),
        (jam(CONSTANT, start=BEGIN + DM1_AIR - 1), PAYLOAD_LOST),
        (jam(CONSTANT, start=BEGIN + DM1_AIR), RECEIVED),
        (jam(CONSTANT, (3, 60)), RECEIVED),
        # pulses of 50 us begin at multiples of 10 ms, and a nanosecond before the payload's end
        (jam(PULSED, on=50 * US, period=10 * MS), ACCESS_LOST),
        (jam(PULSED, on=50 * US, period=10 * MS, start=HEADER_END - 50 * US), HEADER_LOST),
        (jam(PULSED, on=50 * US, period=10 * MS, start=DM1_AIR - 1), PAYLOAD_LOST),
        (jam(PULSED, on=50 * US, period=10 * MS, start=DM1_AIR), RECEIVED),
        # a sweep comes to channel 40 as the frame begins, in it, and as it ends
        (jam(SWEEPING, (1, 40), dwell=10 * MS), ACCESS_LOST),
        (jam(SWEEPING, (1, 40), dwell=10 * MS, start=ACCESS_END), HEADER_LOST),
        (jam(SWEEPING, (40, 1), dwell=10 * MS), RECEIVED),
        (jam(SWEEPING, (1, 40, 2), dwell=10 * MS, start=DM1_AIR), RECEIVED),
    ],
)
def test_a_jammer_destroys_the_first_part_during_which_it_is_on_the_channel(jammer: Jammer, fate: Fate):
    assert jammed(jammer) == fate


def test_a_jammer_counts_by_its_power_where_it_is_heard_and_by_the_distance_of_its_channels():
    assert jammed(jam(CONSTANT), -11.0 - HAIR_DB) == RECEIVED
    assert jammed(jam(CONSTANT), -11.0 + HAIR_DB) == ACCESS_LOST
    assert jammed(jam(CONSTANT), receiver=3) == RECEIVED
    assert jammed(jam(CONSTANT, (41,))) == RECEIVED
    assert jammed(jam(CONSTANT, (39, 41)), -10 * math.log10(2) - HAIR_DB) == RECEIVED
    assert jammed(jam(CONSTANT, (39, 41)), -10 * math.log10(2) + HAIR_DB) == ACCESS_LOST


def test_jammers_add_to_frames():
    scene = Scene()
    scene.air.set_jammers([jam(CONSTANT)], 0)
    powers = np.full((1, 6), -13.0)
    scene.air.set_jam_powers(powers, 0)
    scene.power(2, -13.0)
    frame = scene.put(1, BEGIN)
    assert scene.judge(frame) == RECEIVED
    scene.put(2, BEGIN)
    assert scene.judge(frame) == ACCESS_LOST


# ---------------------------------------------------------------- noise

KEY = (0x12345678, 0x9ABCDEF0)


def noise_fates(es_n0_db: float, count: int = 4_000, spacing: Time = MS, key: tuple[int, int] = KEY) -> list[Fate]:
    scene = Scene(noise_dbm=-90.0, key=key)
    scene.power(1, -90.0 + es_n0_db)
    return [scene.judge(scene.put(1, BEGIN + spacing * number)) for number in range(count)]


@pytest.mark.parametrize("es_n0_db", [6.0, 9.0, 12.0])
def test_noise_destroys_each_part_as_often_as_its_bits_have_it(es_n0_db: float):
    """A block of 99.9 % for every part of every case, nine in all."""
    access, header, payload = (float(p) for p in section_errors(FHS, 0, es_n0_db))
    expected = {
        Part.ACCESS_CODE: access,
        Part.HEADER: (1 - access) * header,
        Part.PAYLOAD: (1 - access) * (1 - header) * payload,
    }
    fates = noise_fates(es_n0_db)
    for part, probability in expected.items():
        count = fates.count(Fate(Heard.BIT_ERRORS, part))
        assert stats.binomtest(count, len(fates), probability).pvalue > 0.001, (part, count, probability)


@pytest.mark.parametrize(("kind", "length"), [(DM1, 17), (DH1, 0), (FHS, 0), (ID, 0)])
def test_every_draw_is_that_of_its_counter(kind: Any, length: int):
    """Start, transmitter and receiver of a frame, and the key, decide alone what noise does to it."""
    es_n0_db = 8.0
    wide = section_errors(DM1 if kind is ID else kind, length if kind is not ID else 0, es_n0_db)
    access, header, payload = (float(p) for p in wide)
    duration = ID_AIR if kind is ID else kind.air_time(length)
    scene = Scene(noise_dbm=-90.0, key=KEY)
    scene.air.changed(0)
    assert not scene.air.calm
    parts: list[Part] = []
    expected: list[Part] = []
    for number in range(500):
        start, source = (1 << 33) + number * 1_234_567, 1 + number % 3
        frame = Frame(start, duration, kind.name, source, 5, 40)
        fate = scene.air.fate(frame, 5, -90.0 + es_n0_db, kind.payload_bits(length), kind.coded)
        parts.append(fate.part)
        w0, w1, w2, w3 = philox((start & 0xFFFFFFFF, start >> 32, source << 16 | 5, 2), KEY)
        broken = [w0 < access * 2**32]
        if kind is not ID:
            broken += [w1 < header * 2**32, ((w2 << 32 | w3) >> 11) * 2.0**-53 < payload]
        expected.append(next((part for part, lost in zip(list(Part)[1:], broken, strict=False) if lost), Part.NONE))
    assert parts == expected
    assert len(set(parts)) == (2 if kind is ID else 4)


def test_the_order_of_judgements_does_not_matter():
    scene = Scene(noise_dbm=-90.0, key=KEY)
    for source in (1, 2):
        scene.power(source, -82.5)
    frames = [scene.put(1 + number % 2, BEGIN + number * MS) for number in range(400)]
    forwards = [scene.judge(frame) for frame in frames]
    assert [scene.judge(frame) for frame in reversed(frames)][::-1] == forwards
    assert len(set(forwards)) == 4
    assert noise_fates(9.0, 400) != noise_fates(9.0, 400, key=(1, 2))


def test_parts_are_judged_in_their_order_and_a_collision_goes_before_noise():
    scene = Scene(noise_dbm=-90.0, key=KEY)
    scene.power(1, -82.5)
    seen = set()
    for number in range(400):
        alone = scene.put(1, BEGIN + number * 10 * MS)
        noise = scene.judge(alone)
        scene.put(2, alone.start + ACCESS_END, 1 * US)  # into the header
        assert scene.judge(alone) == (noise if noise.part is Part.ACCESS_CODE else HEADER_LOST)
        seen.add(noise.part)
    assert seen == set(Part)


def test_the_lock_on_an_fhs_and_its_rest_are_judged_with_the_same_draws():
    """Access code and rest judged apart, as the inquirer does, lose what is lost when they are judged at once."""
    scene = Scene(noise_dbm=-90.0, key=KEY)
    scene.power(1, -82.5)
    seen = set()
    for number in range(500):
        frame = scene.put(1, BEGIN + number * MS)
        whole = scene.judge(frame)
        carrier = scene.air.carrier(1, 0)
        lock = scene.air.judge(frame._replace(duration=ID_AIR), 0, carrier)
        rest = scene.air.judge(frame, 0, carrier, 160, medium.HEADER)
        assert (rest if lock == RECEIVED else lock) == whole
        seen.add(whole.part)
    assert seen == set(Part)


# ---------------------------------------------------------------- records


def test_fates_go_to_the_record_if_there_is_one():
    rows: list[tuple[Frame, Fate]] = []
    frame = Frame(5, DM1_AIR, "DM1", 1, 0, 40)
    Air(2, lambda *row: rows.append(row)).record(frame, ACCESS_LOST)
    assert rows == [(frame, ACCESS_LOST)]
    Air(2).record(frame, RECEIVED)
    assert len(rows) == 1


@pytest.mark.parametrize(
    ("fate", "heard"),
    [
        (RECEIVED, True),
        (PAYLOAD_LOST, True),
        (HEADER_LOST, False),
        (ACCESS_LOST, False),
        (Fate(Heard.BIT_ERRORS, Part.PAYLOAD), True),
        (Fate(Heard.BIT_ERRORS, Part.HEADER), False),
        (Fate(Heard.OUT_OF_RANGE), False),
        (Fate(Heard.NOT_TUNED), False),
        (Fate(Heard.BUSY), False),
    ],
)
def test_a_header_is_heard_unless_it_or_what_precedes_it_is_lost(fate: Fate, heard: bool):
    assert fate.header_heard is heard
