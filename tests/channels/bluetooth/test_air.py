"""What the air remembers, and what jammers and noise do to frames; worked out here as in ``test_radio``."""

import math
from typing import Any

import numpy as np
import pytest
from scipy import stats

from cosim.channels.bluetooth import polling
from cosim.channels.bluetooth.bits.errors import HEADER, section_errors
from cosim.channels.bluetooth.hopping import GIAC, basic_channel, inquiry_channel, scan_channels
from cosim.channels.bluetooth.links import Links
from cosim.channels.bluetooth.packets import DH1, DM1, FHS, ID
from cosim.channels.bluetooth.radio import Air, Fate, Frame, Heard, Part
from cosim.channels.bluetooth.scanning import IdTrain
from cosim.channels.clock import NativeClock
from cosim.channels.jamming import CONSTANT, PULSED, SWEEPING, Jammer
from cosim.machine import Address
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
from tests.oracles.philox import philox

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
        assert len(air.medium.trains) <= 3


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


@pytest.mark.compiles
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
        lock = scene.air.judge_id(frame, 0, carrier)
        rest = scene.air.judge(frame, 0, carrier, 160, HEADER)
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
