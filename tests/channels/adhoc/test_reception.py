"""Frames with powers: noise, interference that lasts for a part, capture, and when the medium is busy."""

import math
from typing import Any

import numpy as np
import pytest

from cosim.channels.adhoc.channel import AdhocChannel
from cosim.channels.adhoc.errors import frame_log_success, noise_dbm
from cosim.channels.adhoc.mac import DATA, Form, Frame
from cosim.channels.adhoc.phy import DSSS
from cosim.channels.adhoc.reception import Levels, Limits, SinrReceiver
from cosim.channels.adhoc.settings import AdhocSettings
from cosim.channels.propagation import Barrier
from cosim.errors import UserError
from cosim.kernel import Kernel
from cosim.machine import BROADCAST, Address, LinkEvent, Outgoing, Reception
from cosim.randomness import Streams
from cosim.trace import FRAMES, Trace
from cosim.units import MS, US, S, Time

NOISE_MW, PREAMBLE = 1e-9, 192 * US
LIMITS = Limits(NOISE_MW, 1e-8, 1e-6, 4.0)


def frame(source: Address, duration: Time = 2_000 * US) -> Frame:
    return Frame(DATA, source, BROADCAST, Form(duration, 100, 1000, PREAMBLE), 0, 0)


class Ear:
    """A receiver that receives everything, and shows at which levels."""

    def __init__(self, limits: Limits = LIMITS) -> None:
        self.heard: list[tuple[Address, Levels]] = []
        self.receiver = SinrReceiver(limits, self._judge)

    def _judge(self, frame: Frame, levels: Levels) -> bool:
        self.heard.append((frame.source, levels))
        return True


def test_levels_change_with_what_comes_and_goes() -> None:
    ear, first, second, third = Ear(), frame(1), frame(2), frame(3)
    ear.receiver.begins(first, 4e-7, False, 1 * MS)
    ear.receiver.begins(second, 1e-7, False, 1 * MS + 300 * US)
    ear.receiver.begins(third, 3e-7, False, 1 * MS + 500 * US)
    assert ear.receiver.ends(second, True, 1 * MS + 900 * US) is None
    assert ear.receiver.ends(third, True, 1 * MS + 1_000 * US) is None
    assert ear.receiver.ends(first, True, 3 * MS) is True
    ((source, levels),) = ear.heard
    assert source == 1
    assert [since for since, _ in levels] == [0, 300 * US, 500 * US, 900 * US, 1_000 * US]
    expected = [4e-7 / (NOISE_MW + others) for others in (0, 1e-7, 4e-7, 3e-7, 0)]
    assert [ratio for _, ratio in levels] == pytest.approx(expected)


@pytest.mark.parametrize(
    ("after", "power_mw", "taken"),
    [(PREAMBLE - 1, 4.0e-7, 2), (PREAMBLE - 1, 3.9e-7, 1), (PREAMBLE, 4.0e-6, 1), (0, 4.0e-7, 2)],
)
def test_a_much_stronger_frame_takes_over_during_the_preamble(after: Time, power_mw: float, taken: Address) -> None:
    ear, first, second = Ear(), frame(1), frame(2)
    ear.receiver.begins(first, 1e-7, False, 0)
    ear.receiver.begins(second, power_mw, False, after)
    outcomes = {1: ear.receiver.ends(first, True, 2 * MS), 2: ear.receiver.ends(second, True, 2 * MS + after)}
    assert outcomes == {taken: True, 3 - taken: None}
    if taken == 2:
        assert ear.heard[0][1][0] == (0, pytest.approx(power_mw / (NOISE_MW + 1e-7)))


def test_without_capture_the_first_stays() -> None:
    ear, first, second = Ear(LIMITS._replace(capture=math.inf)), frame(1), frame(2)
    ear.receiver.begins(first, 1e-7, False, 0)
    ear.receiver.begins(second, 1.0, False, 10 * US)
    assert ear.receiver.ends(second, True, 2 * MS) is None
    assert ear.receiver.ends(first, True, 2 * MS) is True


def test_the_medium_is_busy_with_a_frame_that_is_followed_or_with_much_energy() -> None:
    receiver = Ear().receiver
    faint, weak, strong, deaf = frame(1), frame(2), frame(3), frame(4)
    assert not receiver.begins(faint, 0.9e-8, False, 5)
    assert not receiver.energy
    assert receiver.begins(weak, 1e-8, False, 7)
    assert receiver.energy
    assert receiver.energy_from == 7
    receiver.ends(weak, True, 8)
    assert not receiver.energy
    assert not receiver.begins(deaf, 1e-7, True, 9), "who sends follows nothing, and this is little energy"
    assert receiver.begins(strong, 1e-6, True, 10)
    assert not receiver.follows
    assert receiver.energy


def test_what_an_own_frame_or_the_end_of_the_sender_has_cut_is_not_received() -> None:
    ear, first, second = Ear(), frame(1), frame(2)
    ear.receiver.begins(first, 1e-7, False, 0)
    ear.receiver.drop()
    assert ear.receiver.ends(first, True, 2 * MS) is None
    ear.receiver.begins(second, 1e-7, False, 3 * MS)
    assert ear.receiver.ends(second, False, 5 * MS) is False


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
