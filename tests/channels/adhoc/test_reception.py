"""Frames with powers: noise, interference that lasts for a part, capture, and when the medium is busy."""

import math
from typing import Any

import numpy as np
import pytest

from cosim.channels.adhoc.channel import AdhocChannel
from cosim.channels.adhoc.errors import frame_log_success
from cosim.channels.adhoc.phy import DSSS, noise_dbm
from cosim.channels.adhoc.reception import IGNORED, RIGHT, WRONG
from cosim.channels.adhoc.settings import AdhocSettings
from cosim.channels.adhoc.state import NONE
from cosim.channels.propagation import Barrier
from cosim.errors import UserError
from cosim.kernel import Kernel
from cosim.machine import BROADCAST, Address, LinkEvent, Outgoing, Reception
from cosim.randomness import Streams
from cosim.trace import FRAMES, Trace
from cosim.units import MS, US, S, Time
from tests.channels.adhoc.ear import FRAME, LIMITS, Ear

NOISE_MW, PREAMBLE = LIMITS.noise_mw, FRAME.preamble


def test_errors_add_up_over_levels_that_change_with_what_comes_and_goes() -> None:
    """Against the frame's chance by its levels, given as a list."""
    ear, begin = Ear(), 1 * MS
    first = ear.frame(1, begin)
    ear.begins(first, 4e-10, begin)
    assert not ear.follows
    ear, others_mw = Ear(LIMITS._replace(follows_mw=1e-10)), {300 * US: 1e-10, 500 * US: 3e-10, 900 * US: -1e-10}
    frames = {}
    first = ear.frame(1, begin)
    ear.begins(first, 4e-10, begin)
    levels, noise_mw = [(0, 4e-10 / NOISE_MW)], NOISE_MW
    for since, change_mw in others_mw.items():
        if change_mw > 0:
            frames[change_mw] = ear.frame(len(frames) + 2, begin + since)
            ear.begins(frames[change_mw], change_mw, begin + since)
        else:
            assert ear.ends(frames[-change_mw], begin + since) == IGNORED
        noise_mw += change_mw
        levels.append((since, 4e-10 / noise_mw))
        assert ear.station["level"] == pytest.approx(levels[-1][1])
    ear.ends(first, begin + FRAME.duration)
    expected = frame_log_success(DSSS, 1000, FRAME.octets, levels)
    assert -50 < expected < -1e-3
    assert ear.station["log_chance"] == pytest.approx(expected)


@pytest.mark.parametrize(
    ("after", "power_mw", "taken"),
    [(PREAMBLE - 1, 4.0e-7, 2), (PREAMBLE - 1, 3.9e-7, 1), (PREAMBLE, 4.0e-6, 1), (0, 4.0e-7, 2)],
)
def test_a_much_stronger_frame_takes_over_during_the_preamble(after: Time, power_mw: float, taken: Address) -> None:
    ear = Ear()
    first = ear.frame(1, 0)
    ear.begins(first, 1e-7, 0)
    second = ear.frame(2, after)
    ear.begins(second, power_mw, after)
    if taken == 2:
        assert ear.station["level"] == pytest.approx(power_mw / (NOISE_MW + 1e-7))
    outcomes = {1: ear.ends(first, 2 * MS), 2: ear.ends(second, 2 * MS + after)}
    assert outcomes[3 - taken] == IGNORED
    assert outcomes[taken] != IGNORED


def test_without_capture_the_first_stays() -> None:
    ear = Ear(LIMITS._replace(capture=math.inf))
    first = ear.frame(1, 0)
    ear.begins(first, 1e-7, 0)
    second = ear.frame(2, 10 * US)
    ear.begins(second, 1.0, 10 * US)
    assert ear.ends(second, 2 * MS) == IGNORED
    assert ear.ends(first, 2 * MS) == WRONG


def test_the_medium_is_busy_with_a_frame_that_is_followed_or_with_much_energy() -> None:
    ear = Ear()
    faint = ear.frame(1, 5)
    assert not ear.begins(faint, 0.9e-8, 5)
    assert not ear.energy
    weak = ear.frame(2, 7)
    assert ear.begins(weak, 1e-8, 7)
    assert ear.energy
    assert ear.station["energy_from"] == 7
    ear.ends(weak, 8)
    assert not ear.energy
    unheard = ear.frame(4, 9)
    assert not ear.begins(unheard, 1e-7, 9, deaf=True), "who sends follows nothing, and this is little energy"
    strong = ear.frame(3, 10)
    assert ear.begins(strong, 1e-6, 10, deaf=True)
    assert not ear.follows
    assert ear.energy


def test_what_an_own_frame_or_the_end_of_the_sender_has_cut_is_not_received() -> None:
    ear = Ear()
    first = ear.frame(1, 0)
    ear.begins(first, 1e-7, 0)
    ear.station["followed"] = NONE  # as an own frame does
    assert ear.ends(first, 2 * MS) == IGNORED
    for whole, outcome in ((False, WRONG), (True, RIGHT)):
        second = ear.frame(2, 3 * MS)
        ear.begins(second, 1e-7, 3 * MS)
        ear.network.frames[second]["whole"] = whole
        assert ear.ends(second, 5 * MS) == outcome


# ---------------------------------------------------------------- the channel


class Host:
    def __init__(self) -> None:
        self.heard: list[Address] = []
        self.rssi_dbm: list[float | None] = []

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        self.heard.append(reception.source)
        self.rssi_dbm.append(reception.rssi_dbm)

    def link(self, event: LinkEvent, now: Time) -> None:
        pass

    def drain(self, now: Time) -> None:
        pass


class Field:
    def __init__(self, *places_m: tuple[float, float], **settings: Any) -> None:
        self.kernel = Kernel()
        given = AdhocSettings(**({"propagation": {"model": "free_space"}} | settings))
        self.channel = AdhocChannel(given, self.kernel, Trace((FRAMES,)), len(places_m), Streams(3))
        self.hosts = [Host() for _ in places_m]
        for address, host in enumerate(self.hosts):
            self.channel.attach(address, host)
        self.channel.moved(np.array(places_m))

    def broadcast(self, source: Address, at: Time, length: int = 100) -> None:
        self.kernel.at(at, lambda: self.channel.send(source, Outgoing(BROADCAST, bytes(length))))


FRAMES_SENT = 600


@pytest.mark.slow
@pytest.mark.parametrize("ratio_db", [-4.5, -4.0, -3.75, -3.5])
def test_as_many_frames_arrive_as_the_noise_lets_through(ratio_db: float) -> None:
    """802.11b, 1 Mb/s: with this ratio of power to noise some frames arrive and some do not."""
    noise = noise_dbm(22e6, 7.0)
    # free space: 15 dBm - 40.2 dB - 20 log10 d = noise + ratio
    distance_m = 10 ** ((15.0 - 40.2 - noise - ratio_db) / 20)
    field = Field((0, 0), (distance_m, 0), detection_dbm=-120)
    for number in range(FRAMES_SENT):
        field.broadcast(0, number * 10 * MS, 500)
    field.kernel.run(FRAMES_SENT * 10 * MS + S)
    chance = math.exp(frame_log_success(DSSS, 1000, 536, [(0, 10 ** (ratio_db / 10))]))
    assert 0.05 < chance < 0.95
    spread = math.sqrt(FRAMES_SENT * chance * (1 - chance))
    assert abs(len(field.hosts[1].heard) - FRAMES_SENT * chance) < 4 * spread


def test_a_near_sender_is_heard_through_a_far_one_that_it_does_not_hear() -> None:
    law = {"model": "log_distance", "exponent": 3.0}
    field = Field((0, 0), (5, 0), (100, 0), propagation=law)
    field.broadcast(2, 1 * MS, 1000)  # hidden from 0, and not noticed by 1, where it is 38 dB weaker
    field.broadcast(0, 3 * MS, 100)
    field.kernel.run(S)
    assert field.channel.in_reach(0) == (1,)
    assert field.hosts[1].heard == [0]


@pytest.mark.parametrize("settings", [{}, {"propagation": None}, {"routing": {"kind": "flooding"}}])
def test_a_host_learns_how_strongly_a_payload_was_received_if_signals_fade(settings: dict[str, Any]) -> None:
    """15 dBm are sent; 40.2 dB are lost at 1 m, 20 dB more at ten times the distance. A router tells of no last hop."""
    field = Field((0, 0), (1, 0), (10, 0), power_dbm=15.0, **settings)
    field.broadcast(0, 1 * MS)
    field.broadcast(2, 100 * MS)  # while the first is over, and before the robots move
    field.kernel.run(S)
    field.channel.moved(np.array([(0, 0), (10, 0), (1, 0)]))
    field.broadcast(0, S)
    field.kernel.run(2 * S)
    near, far = 15.0 - 40.2, 15.0 - 60.2
    wanted = [[far], [near, 15.0 - 40.2 - 20 * math.log10(9), far], [far, near]]
    for host, powers_dbm in zip(field.hosts, wanted, strict=True):
        assert host.rssi_dbm == ([None] * len(powers_dbm) if settings else pytest.approx(powers_dbm))


def test_two_equally_strong_frames_of_ofdm_that_overlap_are_both_lost() -> None:
    field = Field((0, 0), (60, 0), (120, 0), detection_dbm=-62, phy="erp")
    field.broadcast(0, 1 * MS, 2000)
    field.broadcast(2, 2 * MS, 2000)  # 120 m are too far for it to notice
    field.kernel.run(S)
    assert field.hosts[1].heard == []


def test_a_barrier_takes_a_robot_out_of_reach_and_gives_it_back() -> None:
    field = Field((0, 0), (20, 0))
    assert field.channel.in_reach(0) == (1,)
    field.channel.obstruct([Barrier(10, -5, 10, 5, 60.0)])
    assert field.channel.in_reach(0) == ()
    field.channel.obstruct([])
    assert field.channel.in_reach(0) == (1,)
    with pytest.raises(UserError, match="notice no walls"):
        Field((0, 0), (20, 0), propagation=None).channel.obstruct([])
