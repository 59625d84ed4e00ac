"""802.11 under jammers: who gets through when, next to which part of the band, and how well."""

import math
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from cosim.channels.adhoc.channel import AdhocChannel
from cosim.channels.adhoc.errors import frame_log_success
from cosim.channels.adhoc.phy import DSSS, noise_dbm
from cosim.channels.adhoc.settings import AdhocSettings
from cosim.channels.adhoc.stations import Stations
from cosim.channels.jamming import CONSTANT, PULSED, SWEEPING, Jammer
from cosim.errors import UserError
from cosim.kernel import WORLD, Kernel
from cosim.machine import BROADCAST, Address, Fate, LinkEvent, Outcome, Outgoing, Reception
from cosim.randomness import Streams
from cosim.trace import FRAMES, Trace
from cosim.units import MS, US, S, Time
from tests.channels.adhoc.ear import FRAME, LIMITS, Ear

ALL = tuple(range(79))
DIFS, EIFS, SLOT = 50 * US, 364 * US, 20 * US
FREE_SPACE = {"model": "free_space"}


class Host:
    def __init__(self) -> None:
        self.heard: list[tuple[Time, Address]] = []
        self.events: list[LinkEvent] = []

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        self.heard.append((now, reception.source))

    def link(self, event: LinkEvent, now: Time) -> None:
        self.events.append(event)

    def drain(self, now: Time) -> None:
        pass


class Field:
    """Robots and jammers on a plane."""

    def __init__(self, *places_m: tuple[float, float], **settings: Any) -> None:
        self.kernel = Kernel()
        self.trace = Trace((FRAMES,))
        given = AdhocSettings(**settings)
        self.channel = AdhocChannel(given, self.kernel, self.trace, len(places_m), Streams(3))
        self.hosts = [Host() for _ in places_m]
        for address, host in enumerate(self.hosts):
            self.channel.attach(address, host)
        self.channel.moved(np.array(places_m))

    def send(self, at: Time, source: Address, destination: Address = BROADCAST, length: int = 100) -> None:
        outgoing = Outgoing(destination, bytes(length), at)
        self.kernel.at(at, lambda: self.channel.send(source, outgoing), WORLD)

    def rows(self) -> list[tuple[Any, ...]]:
        columns = self.trace.columns("frames")
        names = ("time_ns", "source", "destination", "duration_ns", "kind", "outcome")
        return list(zip(*(columns[name] for name in names), strict=True))

    def heard_in(self, begin: Time, end: Time) -> list[int]:
        """Return how many payloads began and ended in [begin, end), by host."""
        received = [row for row in self.rows() if row[4:] == ("DATA", "received")]
        within = [row for row in received if begin <= row[0] and row[0] + row[3] + US <= end]
        return [sum(host_row[2] in (BROADCAST, address) for host_row in within) for address in range(len(self.hosts))]


def constant(x_m: float, y_m: float, start: Time, end: Time, power_dbm: float = 20.0, channels: Any = ALL) -> Jammer:
    return Jammer(x_m, y_m, power_dbm, tuple(channels), CONSTANT, 0, 0, 0, start, end)


def pulsed(start: Time, end: Time, on: Time, period: Time) -> Jammer:
    return Jammer(0.0, 0.0, 20.0, ALL, PULSED, 0, on, period, start, end)


def sweeping(start: Time, end: Time, dwell: Time, channels: tuple[int, ...] = ALL) -> Jammer:
    return Jammer(0.0, 0.0, 20.0, channels, SWEEPING, dwell, 0, 0, start, end)


# ---------------------------------------------------------------- all or nothing


def test_nobody_gets_through_while_jammed_and_all_goes_on_after() -> None:
    field = Field((0, 0), (5, 0), range_m=20.0)
    field.channel.jam(constant(2, 2, 100 * MS, 300 * MS))
    for number in range(40):
        field.send(5 * MS + number * 10 * MS, number % 2, 1 - number % 2)
    field.kernel.run(S)
    begun = [row[0] for row in field.rows() if row[4] == "DATA"]
    assert sum(begin < 100 * MS for begin in begun) == 10
    assert not [begin for begin in begun if 100 * MS <= begin < 300 * MS + DIFS]
    assert [len(host.heard) for host in field.hosts] == [20, 20]
    assert [host.events for host in field.hosts] == [
        [Fate(5 * MS + number * 10 * MS, Outcome.DELIVERED) for number in range(me, 40, 2)] for me in (0, 1)
    ]


def test_what_waits_for_the_end_of_a_jammer_backs_off_from_then_on() -> None:
    field = Field((0, 0), (5, 0), range_m=20.0)
    field.channel.jam(constant(2, 2, 100 * MS, 300 * MS + 7))
    field.send(150 * MS, 0, 1)
    field.kernel.run(S)
    slots, rest = divmod(field.rows()[0][0] - (300 * MS + 7 + DIFS), SLOT)
    assert rest == 0
    assert 0 <= slots <= 31


@pytest.mark.parametrize("propagation", [None, FREE_SPACE])
@pytest.mark.parametrize(("late", "sends"), [(14 * US, True), (15 * US, False)])
def test_a_jammer_is_sensed_after_the_time_of_clear_channel_assessment(
    propagation: Any, late: Time, sends: bool
) -> None:
    field = Field((0, 0), (5, 0), propagation=propagation)
    field.channel.jam(constant(2, 2, 100 * MS, 300 * MS))
    field.send(100 * MS + late, 0)
    field.kernel.run(200 * MS)
    assert [row[0] for row in field.rows()] == ([100 * MS + late] if sends else [])


@pytest.mark.parametrize("propagation", [None, FREE_SPACE])
def test_a_jammer_stops_a_back_off_after_the_slots_that_were_idle_before_it_was_sensed(propagation: Any) -> None:
    def begun(*jammers: Jammer) -> list[Time]:
        field = Field((0, 0), (5, 0), propagation=propagation)
        for jammer in jammers:
            field.channel.jam(jammer)
        for _ in range(10):
            field.send(1 * MS, 0)
        field.kernel.run(S)
        return [row[0] for row in field.rows()]

    plain = begun()
    number, counting_from = next(
        (number, before + 1280 * US + DIFS)
        for number, (before, after) in enumerate(pairwise(plain), 1)
        if after - before >= 1280 * US + DIFS + 6 * SLOT
    )
    slots = (plain[number] - counting_from) // SLOT
    end = counting_from + 100 * MS
    # sensed 15 us after it begins, in the fourth slot or just at its end: three are over
    for begin in (3 * SLOT - 14 * US, 4 * SLOT - 15 * US):
        jammed = begun(constant(2, 2, counting_from + begin, end))
        assert jammed[:number] == plain[:number]
        assert jammed[number] == end + DIFS + (slots - 3) * SLOT


@pytest.mark.parametrize("propagation", [None, FREE_SPACE])
def test_a_jammer_that_begins_while_a_frame_arrives_does_not_hide_that_the_medium_is_busy(propagation: Any) -> None:
    field = Field((0, 0), (5, 0), propagation=propagation)
    field.channel.jam(constant(2, 2, 1 * MS + 500 * US, 100 * MS))
    field.send(1 * MS, 1)
    field.send(1 * MS + 505 * US, 0)  # sooner than the jammer alone would be sensed
    field.kernel.run(S)
    (begun,) = [row[0] for row in field.rows() if row[1] == 0]
    slots, rest = divmod(begun - (100 * MS + EIFS), SLOT)  # the frame was spoilt
    assert rest == 0
    assert 0 <= slots <= 31


@pytest.mark.parametrize(
    ("start", "end", "outcome"),
    [
        (1 * MS + 500 * US, 1 * MS + 501 * US, "collided"),
        (0, 1 * MS + 101 * US + 1, "collided"),
        (0, 1 * MS + 101 * US, "received"),
        (1 * MS + 100 * US + 1281 * US - 1, S, "collided"),
        (1 * MS + 100 * US + 1281 * US, S, "received"),
    ],
)
def test_a_frame_is_spoilt_by_the_shortest_overlap_and_by_no_touch(start: Time, end: Time, outcome: str) -> None:
    # 192 us preamble, 136 octets at 1 Mb/s: on the air at the receiver from 1.101 ms to 2.381 ms
    field = Field((0, 0), (15, 0), range_m=20.0)
    field.channel.jam(constant(30, 0, start, end))  # in reach of the receiver only
    field.send(1 * MS + 100 * US, 0)
    field.kernel.run(S)
    ((_, _, _, duration, _, became),) = field.rows()
    assert duration == 1280 * US
    assert became == outcome


def test_stations_out_of_a_jammers_range_go_on() -> None:
    field = Field((0, 0), (5, 0), (100, 0), (105, 0), range_m=20.0)
    field.channel.jam(constant(0, 5, 0, S))
    for number in range(10):
        field.send(number * 10 * MS, 0)
        field.send(number * 10 * MS, 2)
    field.kernel.run(S)
    assert [len(host.heard) for host in field.hosts] == [0, 0, 0, 10]


def test_who_does_not_hear_the_jammer_that_its_receiver_hears_sends_in_vain() -> None:
    field = Field((0, 0), (15, 0), range_m=20.0)
    field.channel.jam(constant(30, 0, 0, S))
    field.send(1 * MS, 0, 1)
    field.kernel.run(2 * S)
    assert field.hosts[0].events == [Fate(1 * MS, Outcome.UNACKNOWLEDGED)]
    assert [row[5] for row in field.rows()] == ["collided"] * 7


def test_a_robot_that_drives_out_of_the_jammers_range_is_heard_again() -> None:
    field = Field((0, 0), (5, 0), range_m=20.0)
    field.channel.jam(constant(0, 5, 0, S))
    field.send(10 * MS, 0)
    field.kernel.at(500 * MS, lambda: field.channel.moved(np.array([(100.0, 0.0), (105.0, 0.0)])), WORLD)
    field.kernel.run(S)
    ((heard_at, _),) = field.hosts[1].heard
    assert 500 * MS + DIFS < heard_at < 503 * MS


# ---------------------------------------------------------------- the band


@pytest.mark.parametrize(
    ("phy", "channel", "inside", "outside"),
    [
        ("dsss", 1, (0, 21), (22,)),  # 2401 to 2423 MHz
        ("erp", 1, (0, 20), (21,)),  # 2402 to 2422 MHz
        ("dsss", 6, (24, 46), (23, 47)),  # 2426 to 2448 MHz
        ("dsss", 13, (59, 78), (58,)),  # 2461 to 2483 MHz
    ],
)
def test_a_jammer_disturbs_the_channels_whose_band_it_touches(
    phy: Any, channel: int, inside: tuple[int, ...], outside: tuple[int, ...]
) -> None:
    for jammed in (*inside, *outside):
        field = Field((0, 0), (5, 0), phy=phy, channel=channel)
        field.channel.jam(constant(0, 0, 0, S, channels=(jammed,)))
        field.send(1 * MS, 0)
        field.kernel.run(S)
        assert len(field.hosts[1].heard) == (jammed in outside), jammed


def test_a_jammer_outside_of_the_band_changes_nothing_and_costs_nothing() -> None:
    runs = []
    for jammed in (False, True):
        field = Field((0, 0), (5, 0), (0, 5), propagation=FREE_SPACE, channel=6)
        if jammed:
            field.channel.jam(constant(0, 0, 5 * MS, 10 * MS, 30.0, (*range(24), *range(47, 79))))
            field.channel.jam(sweeping(0, 15 * MS, MS, tuple(range(24))))
        for number in range(30):
            field.send(number * MS, number % 3)
        field.kernel.run(S)
        runs.append((field.rows(), field.kernel.executed))
    assert runs[0] == runs[1]
    assert len(runs[0][0]) == 60


@pytest.mark.parametrize(("phy", "why"), [("ofdm", "5 GHz"), ("fhss", "hopping")])
def test_radios_without_a_model_of_jamming_say_so(phy: str, why: str) -> None:
    with pytest.raises(UserError, match=why):
        Field((0, 0), (5, 0), phy=phy).channel.jam(constant(0, 0, 0, S))


# ---------------------------------------------------------------- now and then


def on_air(rows: list[tuple[Any, ...]]) -> list[tuple[Time, Time]]:
    """Return when frames that were received were on the air where they were."""
    return [(row[0] + US, row[0] + row[3] + US) for row in rows if row[5] == "received"]


def test_frames_get_through_between_pulses() -> None:
    field = Field((0, 0), (5, 0))
    field.channel.jam(pulsed(0, S, 10 * MS, 25 * MS))
    for number in range(300):
        field.send(number * 3 * MS, number % 2)
    field.kernel.run(S)
    arrived = on_air(field.rows())
    assert 200 < len(arrived) < 300
    assert all(begin % (25 * MS) >= 10 * MS and begin // (25 * MS) == (end - 1) // (25 * MS) for begin, end in arrived)


def test_frames_get_through_while_a_sweep_is_elsewhere() -> None:
    field = Field((0, 0), (5, 0))
    field.channel.jam(sweeping(0, S, MS))  # 22 of 79 channels are in the band
    for number in range(300):
        field.send(number * 3 * MS, number % 2)
    field.kernel.run(S)
    arrived = on_air(field.rows())
    assert 200 < len(arrived) <= 300
    assert all(begin % (79 * MS) >= 22 * MS and begin // (79 * MS) == (end - 1) // (79 * MS) for begin, end in arrived)


def test_nothing_is_scheduled_while_nobody_has_anything_to_send() -> None:
    field = Field((0, 0), (5, 0))
    field.channel.jam(pulsed(0, 10 * S, 1 * MS, 4 * MS))
    field.send(1 * S + 2 * MS, 0)
    field.kernel.run(10 * S)
    assert len(field.hosts[1].heard) == 1
    assert field.kernel.executed < 20


@pytest.mark.parametrize("during", [2350 * US, 2595 * US + 200])
def test_an_answer_to_one_who_has_died_meanwhile_is_still_jammed(during: Time) -> None:
    field = Field((0, 0), (15, 0), (7, 13), range_m=20.0)
    field.send(1 * MS, 0, 1)  # arrives at 2.281 ms, is answered 10 us later, for 304 us
    field.kernel.at(2280 * US + 500, partial(field.channel.power, 0, False), WORLD)
    for place, begin in (((7, 32), 2283 * US), ((34, 0), during), ((7, 32), during + 400)):  # at 2, at 1, at 2
        field.channel.jam(constant(*place, begin, begin + 100))
    field.send(2600 * US, 2)
    field.kernel.run(S)
    assert [(row[0], row[4]) for row in field.rows()] == [
        (1 * MS, "DATA"),
        (2291 * US, "ACK"),
        (2596 * US + EIFS, "DATA"),  # after an answer that it could not read
    ]


def test_who_is_switched_on_just_after_a_jammer_waits_from_then_on() -> None:
    field = Field((0, 0), (5, 0), range_m=20.0)
    field.channel.jam(constant(2, 2, 10 * MS, 100 * MS))
    field.kernel.at(50 * MS, partial(field.channel.power, 0, False), WORLD)
    field.kernel.at(100 * MS + 20 * US, partial(field.channel.power, 0, True), WORLD)
    field.send(100 * MS + 30 * US, 0)
    field.kernel.run(S)
    assert [row[0] for row in field.rows()] == [100 * MS + 20 * US + DIFS]


@pytest.mark.slow
@pytest.mark.parametrize("propagation", [None, FREE_SPACE])
def test_what_has_been_slept_through_is_made_up_for(propagation: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same frames at the same instants as when every change is looked at as it comes, in fewer events."""
    draw = np.random.default_rng(11)
    for _ in range(30):
        jammers = []
        for _ in range(int(draw.integers(1, 4))):
            begin, mode = int(draw.integers(0, 100 * MS)), int(draw.integers(0, 3))
            on = int(draw.integers(20 * US, 2 * MS))
            times = int(draw.integers(30 * US, MS)), on, on + int(draw.integers(10 * US, 3 * MS))
            place, power = draw.uniform(-30, 30, 2).tolist(), float(draw.uniform(-20, 20))
            jammers.append(Jammer(*place, power, ALL, mode, *times, begin, begin + int(draw.integers(1, 300 * MS))))
        traffic = [(int(draw.integers(0, 400 * MS)), int(draw.integers(3))) for _ in range(30)]
        places = draw.uniform(0, 20, (5, 3, 2))
        outages = [(int(draw.integers(0, 400 * MS)), int(draw.integers(3))) for _ in range(8)]
        runs = []
        for always in (False, True):
            monkeypatch.setattr(Stations, "matter", property(_always) if always else _MATTER)
            field = Field((0, 0), (5, 0), (0, 5), propagation=propagation, range_m=None if propagation else 25.0)
            for jammer in jammers:
                field.channel.jam(jammer)
            for number, (at, who) in enumerate(traffic):
                field.send(at, who, BROADCAST if number % 3 else (who + 1) % 3)
            for number, (at, who) in enumerate(outages):
                field.kernel.at(at, partial(field.channel.power, who, number % 2 == 1), WORLD)
            for tick, there in enumerate(places):
                field.kernel.at(tick * 100 * MS, partial(_move, field, there), WORLD)
            field.kernel.run(S)
            runs.append((field.rows(), field.kernel.executed))
        assert runs[0][0] == runs[1][0]
        assert runs[0][1] <= runs[1][1]


_MATTER = Stations.matter


def _always(stations: Stations) -> bool:
    return True


def _move(field: Field, places_m: Any) -> None:
    field.channel.advance(field.kernel.now)
    field.channel.moved(places_m)


# ---------------------------------------------------------------- powers


def test_the_levels_of_a_frame_change_with_the_jammers() -> None:
    ear, begin = Ear(LIMITS._replace(follows_mw=1e-10)), 1 * MS
    assert ear.disturb(4e-10, 500 * US) is False, "too little energy to be heard"
    frame, levels = ear.frame(1, begin), []
    ear.begins(frame, 4e-10, begin)
    for since, jammer_mw in ((0, 4e-10), (300 * US, 8e-10), (700 * US, 0.0)):
        assert ear.disturb(jammer_mw, begin + since) is False
        levels.append((since, 4e-10 / (LIMITS.noise_mw + jammer_mw)))
        assert ear.station["level"] == pytest.approx(levels[-1][1])
    ear.ends(frame, begin + FRAME.duration)
    assert ear.station["log_chance"] < -0.1
    assert ear.station["log_chance"] == pytest.approx(frame_log_success(DSSS, 1000, FRAME.octets, levels))


@pytest.mark.parametrize(("excess_db", "sends"), [(-0.1, True), (0.1, False)])
def test_a_jammer_keeps_the_medium_busy_from_the_threshold_of_energy_on(excess_db: float, sends: bool) -> None:
    # 10 m of free space take 60.2 dB; of 79 channels 21 and a half are in the band
    field = Field((0, 0), (1, 0), propagation=FREE_SPACE, energy_dbm=-62.0)
    power_dbm = -62.0 + excess_db + 60.2 - 10 * math.log10(21.5)
    field.channel.jam(constant(0, 10, 0, S, power_dbm))
    field.send(1 * MS, 0)
    field.kernel.run(900 * MS)
    assert bool(field.rows()) is sends


def test_a_jammer_that_is_too_weak_to_be_sensed_delays_nobody() -> None:
    runs = []
    for jammed in (False, True):
        field = Field((0, 0), (5, 0), propagation=FREE_SPACE)
        if jammed:
            weak = pulsed(0, S, 30 * US, 70 * US)._replace(x_m=1000.0)
            field.channel.jam(weak)
        for number in range(40):
            field.send(number * 5 * MS, 0, 1)
            field.send(number * 5 * MS, 0, 1)  # it waits for a back-off
        field.kernel.run(S)
        runs.append(field.rows())
    assert len(runs[0]) == 160
    assert runs[1] == runs[0]


FRAMES_SENT = 600


@pytest.mark.slow
@pytest.mark.parametrize(("channels", "in_band"), [(ALL, 21.5), ((10,), 1.0), ((21,), 0.5)])
def test_a_jammer_is_noise_with_as_much_of_its_power_as_falls_into_the_band(channels: Any, in_band: float) -> None:
    """802.11b, 1 Mb/s, -4 dB of signal to jammer and noise: some frames arrive and some do not."""
    distance_m = 500.0
    signal_mw, noise_mw = 10 ** ((15.0 - 40.2 - 20 * math.log10(distance_m)) / 10), 10 ** (noise_dbm(22e6, 7.0) / 10)
    jammer_mw = signal_mw * 10**0.4 - noise_mw  # S / (J + N) = -4 dB
    power_dbm = 10 * math.log10(jammer_mw / in_band) + 40.2 + 20 * math.log10(distance_m)
    field = Field((0, 0), (distance_m, 0), propagation=FREE_SPACE, detection_dbm=-90)
    end = FRAMES_SENT * 10 * MS
    field.channel.jam(constant(2 * distance_m, 0, 0, end, power_dbm, channels))
    for number in range(2 * FRAMES_SENT):
        field.send(number * 10 * MS, 0, BROADCAST, 500)
    field.kernel.run(2 * end + S)
    chance = math.exp(frame_log_success(DSSS, 1000, 536, [(0, 10**-0.4)]))
    assert 0.05 < chance < 0.95
    spread = math.sqrt(FRAMES_SENT * chance * (1 - chance))
    assert abs(field.heard_in(0, end)[1] - FRAMES_SENT * chance) < 4 * spread
    assert field.heard_in(end, 3 * end)[1] == FRAMES_SENT
