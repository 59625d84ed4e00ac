"""Monitoring: heartbeats on the wire, whom a machine suspects and when, and what becomes of that in whole runs."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.errors import UserError, WireError
from cosim.machine import BROADCAST, Address, Machine, Outgoing, Reception
from cosim.protocol import Surroundings
from cosim.scenario import build
from cosim.simulation import Outcome, simulate
from cosim.testing import check_machine
from cosim.trace import MESSAGES
from cosim.units import MS, S, Time, from_seconds
from protocols import wire
from protocols.detection.accrual import PhiSettings
from protocols.detection.detectors import make_detector
from protocols.detection.quality import Transition, watch
from protocols.monitoring.heartbeats import Heartbeat, decode, encode
from protocols.monitoring.machine import BadHeartbeat, Monitor, Parameters, Suspected, Trusted
from protocols.monitoring.spec import SPEC, measure, place, prepare

DETECTORS: dict[str, dict[str, Any]] = {
    "fixed": {"kind": "fixed", "timeout_s": 1.3},
    "nfd_s": {"kind": "nfd_s", "shift_s": 0.4},
    "nfd_e": {"kind": "nfd_e", "margin_s": 0.3, "window": 8},
    "phi_akka": {"kind": "phi_akka", "threshold": 2.0, "acceptable_pause_s": 0.1},
    "phi_normal": {"kind": "phi_normal", "threshold": 2.0, "acceptable_pause_s": 0.1},
}


def parameters(detector: str = "nfd_s", **more: Any) -> Parameters:
    return Parameters.model_validate({"detector": DETECTORS[detector]} | more)


def machine(me: Address = 0, size: int = 3, start: Time = 0, **more: Any) -> Monitor:
    return Monitor(parameters(**more), size, me, start)


def tell(target: Monitor, heartbeat: Heartbeat, now: Time) -> None:
    target.receive(encode(heartbeat), Reception(heartbeat.source, True), now)


def driven(target: Monitor, until: Time) -> list[tuple[Time, Any]]:
    """Wake *target* whenever it wants before *until*; return what it has left, with the time."""
    left: list[tuple[Time, Any]] = []
    while (due := target.wake_at()) is not None and due < until:
        target.wake(due)
        left += [(due, item) for item in (*target.events(), *target.outbox())]
    return left


# ---------------------------------------------------------------- the wire


def test_a_heartbeat_has_these_bytes():
    assert encode(Heartbeat(3, 1_000_000_007, 5)).hex() == "0003000000007735940e0000000566f9"


def test_a_number_of_more_than_33_bits_has_a_longer_frame():
    # 16 + 63 + 63 bits, 2 of padding: 7 * 4 is the number's end
    data = encode(Heartbeat(3, 1_000_000_007, 2**33 + 7))
    assert (len(encode(Heartbeat(3, 1_000_000_007, 2**33 - 1))), len(data)) == (16, 20)
    assert int.from_bytes(data[:-2]) >> 2 & 2**63 - 1 == 2**33 + 7
    assert decode(data) == (3, 1_000_000_007, 2**33 + 7)


def test_a_long_frame_of_a_short_number_is_none():
    layout = (("source", 16), ("begun_ns", 63), ("number", 63))
    with pytest.raises(WireError, match="a long frame for a short number"):
        decode(wire.pack(layout, {"source": 1, "begun_ns": 2, "number": 3}))


@given(source=st.integers(0, 2**16 - 1), begun=st.integers(0, 2**63 - 1), number=st.integers(0, 2**63 - 1))
def test_heartbeats_come_back_equal(source: int, begun: int, number: int):
    assert decode(encode(Heartbeat(source, begun, number))) == (source, begun, number)


@given(bit=st.integers(0, 127))
def test_a_flipped_bit_is_noticed(bit: int):
    data = (int.from_bytes(encode(Heartbeat(1, 2, 3))) ^ 1 << bit).to_bytes(16)
    with pytest.raises(WireError):
        decode(data)


# ---------------------------------------------------------------- the machine


@pytest.mark.slow
@pytest.mark.parametrize(
    ("detector", "more"),
    [
        *((detector, {}) for detector in DETECTORS),
        ("nfd_s", {"senders": 1, "spread": False}),
        ("nfd_e", {"period_s": 0.35}),
    ],
)
def test_the_machine_keeps_the_laws_of_machines(detector: str, more: dict[str, Any]):
    def make(me: Address, start: Time) -> Machine:
        return SPEC.make(parameters(detector, **more), 3, me, None, start)

    check_machine(make, duration=4 * S)


@pytest.mark.parametrize(("spread", "phase"), [(True, 500 * MS), (False, 0)])
def test_heartbeats_are_sent_at_equal_intervals_and_spread_over_the_team(spread: bool, phase: Time):
    sent = driven(machine(me=1, size=2, start=7 * S, spread=spread), 10 * S)
    beats = [(time, item) for time, item in sent if isinstance(item, Outgoing)]
    begun = 7 * S + phase
    assert (
        beats
        == [(begun + number * S, Outgoing(BROADCAST, encode(Heartbeat(1, begun, number)))) for number in range(3)][
            : len(beats)
        ]
    )
    assert len(beats) == 3


def test_only_the_senders_send_and_are_watched():
    watcher = machine(me=2, senders=1)
    assert not any(isinstance(item, Outgoing) for _, item in driven(watcher, 10 * S))
    assert set(watcher.watches) == {0}
    assert set(machine(me=0, senders=1).watches) == set()


@pytest.mark.parametrize(
    ("detector", "at_s"), [("fixed", 1.3), ("nfd_s", 0.4), ("nfd_e", 1.3), ("phi_akka", None), ("phi_normal", None)]
)
def test_who_is_never_heard_is_suspected(detector: str, at_s: float | None):
    left = driven(machine(me=1, size=2, senders=1, detector=detector), 10 * S)
    [(time, event)] = left
    assert event == Suspected(0)
    if at_s is not None:
        assert time == from_seconds(at_s)
    assert time < 2 * S


def test_a_heartbeat_puts_the_suspicion_off_and_takes_it_back():
    watcher = machine(me=1, size=2, senders=1)  # NFD-S with a shift of 0.4 s
    tell(watcher, Heartbeat(0, 0, 0), 20 * MS)
    assert driven(watcher, 3 * S) == [(1400 * MS, Suspected(0))]
    tell(watcher, Heartbeat(0, 0, 1), 3 * S)  # it comes too late to change anything
    assert watcher.events() == []
    tell(watcher, Heartbeat(0, 0, 3), 3 * S + 1)
    assert watcher.events() == [Trusted(0)]
    assert driven(watcher, 10 * S) == [(4400 * MS, Suspected(0))]
    assert watcher.heard == 3


def test_a_later_life_is_watched_anew_and_an_earlier_one_is_over():
    watcher = machine(me=1, size=2, senders=1)
    tell(watcher, Heartbeat(0, 0, 0), 20 * MS)
    driven(watcher, 5 * S)
    begun = 5 * S + 123
    tell(watcher, Heartbeat(0, begun, 0), 5 * S + 200)
    assert watcher.events() == [Trusted(0)]
    tell(watcher, Heartbeat(0, 0, 90), 5 * S + 300)  # of the first life, from the depths of the network
    assert driven(watcher, 10 * S) == [(begun + 1400 * MS, Suspected(0))]
    found = measure([watcher])
    assert found["mistakes"] == 0.0  # the first life was over indeed
    assert found["suspicions_standing"] == 1.0
    assert found["suspected_at_s"] == pytest.approx(6.4 + 123e-9)
    assert found["watched_s"] == pytest.approx(1.4 + 1.4 - 77e-9)


def test_a_life_that_ended_unnoticed_was_watched_until_the_next_was_heard_of():
    watcher = machine(me=1, size=2, senders=1)
    tell(watcher, Heartbeat(0, 0, 0), 20 * MS)
    tell(watcher, Heartbeat(0, 500 * MS, 0), 600 * MS)
    assert watcher.events() == []
    assert driven(watcher, 20 * S) == [(1900 * MS, Suspected(0))]
    watcher.wake(20 * S)
    assert measure([watcher])["watched_s"] == pytest.approx(0.6 + 1.3)


def test_own_and_foreign_frames_and_noise_change_nothing():
    watcher = machine(me=1, size=3, senders=2)
    due = watcher.wake_at()
    tell(watcher, Heartbeat(1, 0, 9), 5)
    assert watcher.events() == []
    tell(watcher, Heartbeat(2, 0, 9), 6)
    watcher.receive(b"noise", Reception(0, True), 7)
    unwatched, noise = watcher.events()
    assert unwatched == BadHeartbeat(2, 16, "robot 2 is not watched")
    assert noise == BadHeartbeat(0, 5, "5 bytes where 16 were expected")
    assert (watcher.heard, watcher.wake_at()) == (0, due)


def test_after_a_clock_was_set_forward_only_the_last_heartbeat_is_sent():
    sender = machine(me=0, size=1)
    sender.wake(0)
    sender.outbox()
    sender.wake(1_000_000 * S + 5)
    assert sender.outbox() == [Outgoing(BROADCAST, encode(Heartbeat(0, 0, 1_000_000)))]
    assert sender.wake_at() == 1_000_001 * S
    assert sender.sent == 2


# ---------------------------------------------------------------- whole runs


def run(detector: str = "nfd_s", seed: int = 1, messages: bool = False, **more: Any) -> Outcome:
    settings = {
        "duration_s": 40.0,
        "team": {"size": 3},
        "floorplan": {"map": "walls", "bounds_m": [0, 0, 10, 10]},
        "channel": {"kind": "ideal"},
        "protocol": {"use": "protocols.monitoring.spec:SPEC", "parameters": {"detector": DETECTORS[detector]}},
    }
    return simulate(build(settings | more, "test", Path()), seed, [MESSAGES] if messages else [])


@pytest.mark.slow
@pytest.mark.parametrize("detector", DETECTORS)
def test_in_a_run_suspicions_begin_and_end_when_the_detector_says_so(detector: str):
    """Opinions of the machines, at their deadlines, equal those found from what arrived when."""
    channel = {"kind": "ideal", "loss": 0.3, "jitter_s": 0.3}
    outcome = run(detector, channel=channel, messages=True, duration_s=100.0)
    messages, events = outcome.trace.columns("messages"), outcome.trace.columns("events")
    settings = parameters(detector).detector
    compared = 0
    for me in range(3):
        for peer in (robot for robot in range(3) if robot != me):
            rows = zip(*(messages[name] for name in ("time_ns", "source", "sender", "payload")), strict=True)
            arrivals = [
                (decode(bytes.fromhex(payload)).number, time)
                for time, receiver, sender, payload in rows
                if (receiver, sender) == (me, peer)
            ]
            if isinstance(settings, PhiSettings):
                arrivals = [(-1, 0), *arrivals]
            expected = watch(make_detector(settings, S, 0, peer * (S // 3)), arrivals, 100 * S)
            told = zip(*(events[name] for name in ("time_ns", "source", "event", "peer")), strict=True)
            found = [
                Transition(time, event == "Suspected") for time, who, event, about in told if (who, about) == (me, peer)
            ]
            assert found == expected
            compared += len(found)
    assert compared > 60


@pytest.mark.parametrize("at_s", [20.0, 20.3, 20.999])
def test_a_robot_that_is_killed_is_suspected_by_all_within_the_bound(at_s: float):
    found = run(faults=[{"kind": "kill", "robot": 1, "at_s": at_s}]).metrics
    assert found["died_at_s"] == at_s
    assert found["suspicions_standing"] == 2.0
    last = math.ceil(at_s - 1 / 3) - 1 + 1 / 3  # robot 1 sends a third of a second later than robot 0
    assert found["suspected_at_s"] == pytest.approx(last + 1.4, abs=1e-6)
    assert 0.4 < found["suspected_at_s"] - at_s <= 1.4
    assert (found["mistakes"], found["accuracy"]) == (0.0, 1.0)


def test_a_robot_that_boots_again_is_trusted_again_and_nobody_was_wrong():
    faults = [{"kind": "crash", "robot": 1, "at_s": 10.5, "for_s": 5.0}]
    outcome = run(faults=faults)
    found, events = outcome.metrics, outcome.trace.columns("events")
    kinds = [kind for kind, peer in zip(events["event"], events["peer"], strict=True) if peer == 1]
    assert kinds == ["Suspected", "Suspected", "Trusted", "Trusted"]
    assert (found["mistakes"], found["suspicions_standing"]) == (0.0, 0.0)
    assert math.isnan(found["suspected_at_s"])


def test_a_radio_that_is_off_for_a_while_is_a_mistake_of_all():
    faults = [{"kind": "radio_off", "robot": 1, "at_s": 10.5, "for_s": 5.0}]
    found = run(faults=faults).metrics
    # robot 1 sends at 10.33 and 15.33, which is lost, and 16.33 s; it hears robot 0 from 16 s on, robot 2 from 15.67 s
    assert found["mistakes"] == 4.0
    others = 16 + 1 / 3 - (10 + 1 / 3 + 1.4)
    own = (16 - (10 + 1.4)) + (15 + 2 / 3 - (9 + 2 / 3 + 1.4))
    assert found["mean_mistake_s"] == pytest.approx((2 * others + own) / 4, abs=1e-5)
    assert found["accuracy"] == pytest.approx(1 - (2 * others + own) / found["watched_s"], abs=1e-6)
    assert found["mistake_rate_per_s"] == pytest.approx(4 / found["watched_s"])
    assert found["watched_s"] == pytest.approx(6 * 40, abs=6 * 0.4)


def test_clocks_may_jump_either_way():
    for by_s in (-8.0, 8.0):
        found = run("nfd_e", faults=[{"kind": "clock_step", "robot": 1, "at_s": 20.5, "by_s": by_s}]).metrics
        assert found["heartbeats_sent"] > 100
        assert found["watched_s"] > 0


def test_losses_are_as_the_channel_says():
    found = run(channel={"kind": "ideal", "loss": 0.25}, duration_s=400.0).metrics
    assert found["heartbeats_sent"] == 1200
    assert found["heartbeats_heard"] / 2400 == pytest.approx(0.75, abs=4 * math.sqrt(0.25 * 0.75 / 2400))


# ---------------------------------------------------------------- what a scenario can say


def surroundings(size: int, **more: Any) -> Surroundings:
    return Surroundings(
        starts_m=((0.0, 0.0),) * size,
        radius_m=0.25,
        speed_mps=1.0,
        acceleration_mps2=1.0,
        tick=100 * MS,
        walls_m=np.empty((0, 4)),
        bounds_m=(0.0, 0.0, 10.0, 4.0),
        forbidden=lambda points: np.zeros(len(points), bool),
        **more,
    )


def test_robots_start_apart_from_each_other_in_the_middle():
    starts = place(Parameters(), surroundings(5), 5, np.random.default_rng(1))
    assert len(starts) == 5
    assert np.mean(starts[:3], axis=0)[0] == pytest.approx(5.0)
    assert min(math.dist(a, b) for n, a in enumerate(starts) for b in starts[:n]) == pytest.approx(1.0)


def test_what_cannot_be_is_refused():
    full = surroundings(2, fits=lambda place_m, radius_m: False)
    with pytest.raises(UserError, match="not free"):
        place(Parameters(), full, 2, np.random.default_rng(1))
    with pytest.raises(UserError, match="senders: 3 is not <= 2"):
        prepare(Parameters(senders=3), surroundings(2))


def test_nobody_to_watch_is_no_accuracy():
    found = measure([machine(size=1)])
    assert math.isnan(found["accuracy"])
    assert math.isnan(found["mistake_rate_per_s"])
    assert set(found) | {"died_at_s"} == {metric.name for metric in SPEC.metrics}
