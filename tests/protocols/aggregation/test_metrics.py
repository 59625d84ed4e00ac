"""The metrics: cases computed by hand, and whole runs against what the simulator and the trace say of them."""

import math
from itertools import accumulate, pairwise
from typing import Any

import pytest

from cosim.units import MS, S
from protocols.aggregation.frames import encode, stamp
from protocols.aggregation.messages import Finding, Heartbeat, Hello, Receipt, Report
from protocols.aggregation.spec import SPEC
from tests.protocols.aggregation.team_scene import TARGETS_M, TICK, Alone, Run, Team, run

STARTS_M = [(9.5, 9.0), (10.5, 9.0), (9.5, 10.4), (10.0, 10.4)]
"""Two hosts; searcher 2 is led by host 0, 3 by host 1."""


def measured(team: Team) -> dict[str, float]:
    metrics = SPEC.measure(team.machines)
    assert metrics.keys() | {"hosts_alive"} == {metric.name for metric in SPEC.metrics}  # that one is the referee's
    return metrics


def walked(machine: Any, steps_m: list[float]) -> None:
    """Have a robot drive so far in each tick, from the start on."""
    machine.counters.ways_m.clear()
    machine.counters.place_m = None
    for tick, x_m in enumerate(accumulate(steps_m)):
        machine.counters.moved((x_m, 0.0), tick * TICK)


# ---------------------------------------------------------------- by hand


def hand_made() -> Team:
    """Return a team after 10 s: hosts know all at 4 s and 6.05 s, searchers stop at 5 s and 8 s.

    Robot k drives k + 1 cm in each of the 100 ticks.
    """
    team = Team(STARTS_M, targets=TARGETS_M, motion_j_per_m=20.0)
    for robot, machine in enumerate(team.machines):
        machine.counters.failures.clear()
        walked(machine, [0.0] + [0.01 * (robot + 1)] * 100)
    team.machines[0].counters.known_at = 4 * S
    team.machines[1].counters.known_at = 6 * S + 50 * MS
    team.machines[2].counters.stopped_at = 5 * S
    team.machines[3].counters.stopped_at = 8 * S
    return team


def test_times_are_those_of_the_last_host_the_first_host_and_the_last_searcher() -> None:
    metrics = measured(hand_made())
    assert metrics["search_time_min"] == pytest.approx(6.05 / 60.0)
    assert metrics["first_known_min"] == pytest.approx(4.0 / 60.0)
    assert metrics["stop_time_min"] == pytest.approx(8.0 / 60.0)
    assert metrics["completed"] == 1.0


def test_the_way_after_the_end_is_that_since_the_first_tick_after_it() -> None:
    """From 6.1 s to 10 s are 39 ticks, of 1 + 2 + 3 + 4 cm together."""
    assert measured(hand_made())["distance_after_m"] == pytest.approx(39 * 0.10)
    team = hand_made()
    team.machines[1].counters.known_at = 6 * S
    assert measured(team)["distance_after_m"] == pytest.approx(40 * 0.10)


def test_energy_is_that_of_the_way_and_of_the_radios() -> None:
    team = hand_made()
    for machine in team.machines:
        machine.counters.radio_j = 0.25
    metrics = measured(team)
    assert metrics["motion_j"] == pytest.approx(20.0 * 100 * 0.10)
    assert metrics["radio_j"] == pytest.approx(1.0)
    assert metrics["energy_j"] == pytest.approx(201.0)


def test_a_search_that_is_not_over_counts_as_long_as_the_run_was() -> None:
    team = hand_made()
    team.machines[1].counters.known_at = team.machines[3].counters.stopped_at = None
    metrics = measured(team)
    assert metrics["completed"] == 0.0
    assert metrics["search_time_min"] == metrics["stop_time_min"] == pytest.approx(10.0 / 60.0)
    assert metrics["first_known_min"] == pytest.approx(4.0 / 60.0)
    assert metrics["distance_after_m"] == pytest.approx(0.0)


def test_the_dead_are_not_waited_for_but_their_way_counts() -> None:
    """Host 1 and searcher 3 die at 3 s; host 0 knows all at 4 s: 60 ticks of 1 + 3 cm follow."""
    team = hand_made()
    for robot in (1, 3):
        walked(team.machines[robot], [0.0] + [0.01 * (robot + 1)] * 30)
        team.machines[robot].counters.known_at = team.machines[robot].counters.stopped_at = None
    metrics = measured(team)
    assert metrics["completed"] == 1.0
    assert metrics["search_time_min"] == pytest.approx(4.0 / 60.0)
    assert metrics["stop_time_min"] == pytest.approx(5.0 / 60.0)
    assert metrics["distance_after_m"] == pytest.approx(60 * 0.04)
    assert metrics["motion_j"] == pytest.approx(20.0 * (100 * 0.04 + 30 * 0.06))


def test_who_dies_after_the_end_has_driven_until_then() -> None:
    """Searcher 3 dies at 8 s: 19 ticks of 4 cm after 6.1 s, and 39 of 6 cm."""
    team = hand_made()
    walked(team.machines[3], [0.0] + [0.04] * 80)
    assert measured(team)["distance_after_m"] == pytest.approx(19 * 0.04 + 39 * 0.06)


def test_suspicions_of_the_dead_are_timed_and_those_of_the_living_counted() -> None:
    team = Team([*STARTS_M, (10.5, 10.4)], hosts=3, targets=TARGETS_M)
    for machine in team.machines:
        machine.counters.failures.clear()
        walked(machine, [0.0] * 101)
    walked(team.machines[2], [0.0] * 31)  # dies at 3 s
    team.machines[0].counters.failures += [(1, 2 * S), (2, 1 * S), (2, 5 * S + 500 * MS)]
    team.machines[1].counters.failures += [(2, 7 * S)]
    team.machines[3].counters.failures += [(0, 3 * S), (2, 2 * S), (2, 6 * S)]  # a searcher
    metrics = measured(team)
    assert metrics["detection_time_s"] == pytest.approx((2.5 + 4.0) / 2.0)
    assert metrics["false_suspicions"] == 2.0
    assert metrics["false_failures"] == 2.0
    team.machines[0].counters.failures.clear()
    team.machines[1].counters.failures.clear()
    assert math.isnan(measured(team)["detection_time_s"])


def test_posts_and_targets_are_those_that_living_hosts_know() -> None:
    team = hand_made()
    posts = len(team.setup.ground.posts_m)
    team.machines[0].findings.visit({0, 1, 2})
    team.machines[1].findings.visit({2, 3})
    team.machines[2].findings.visit({4})
    team.machines[0].counters.reported, team.machines[1].counters.reported = 3, 2
    metrics = measured(team)
    assert metrics["share_visited"] == pytest.approx(4 / posts)
    assert metrics["targets_reported"] == 5.0
    walked(team.machines[1], [0.0] * 50)
    assert measured(team)["share_visited"] == pytest.approx(3 / posts)


def test_the_radios_energy_is_that_of_feeney_and_nilsson() -> None:
    """INFOCOM 2001, table 1: J a frame and a byte to send to one, to all, to receive as the one, as one of all."""
    host = Alone(0, STARTS_M)
    counters = host.machine.counters
    assert counters.radio_j == 0.0
    beat = Heartbeat(1, stamp(0), 10.5, 9.0, 0, 1, 0, 0, False, False, False, ())
    host.hears(1, beat, broadcast=True)
    assert counters.radio_j == pytest.approx(56e-6 + 0.5e-6 * len(encode(1, beat)))
    before = counters.radio_j
    report = Report(7, 0, (Finding(0, 3.0, 3.0),), b"\x01")
    (said,) = host.hears(2, report)
    assert said.message == Receipt(7)
    received = 356e-6 + 0.5e-6 * len(encode(2, report))
    sent = 454e-6 + 1.9e-6 * len(encode(0, Receipt(7)))
    assert counters.radio_j - before == pytest.approx(received + sent)
    before, frames = counters.radio_j, counters.frames
    said_all = host.passes(0.6)
    assert said_all
    assert all(each.destination == -1 for each in said_all)
    octets = [len(encode(0, each.message)) for each in said_all]
    assert counters.radio_j - before == pytest.approx(sum(266e-6 + 1.9e-6 * each for each in octets))
    assert counters.frames - frames == len(said_all)


def test_coming_into_contact_is_counted_once_for_each_time() -> None:
    searcher = Alone(2, STARTS_M)
    beat = Heartbeat(1, stamp(0), 9.5, 9.0, 0, 1, 0, 0, False, False, False, ())
    for number, pause_s in enumerate((1.0, 1.0, 4.0, 1.0, 3.0)):
        searcher.passes(pause_s)
        searcher.hears(0, beat._replace(number=number, stamp_ms=stamp(searcher.now)))
        searcher.hears(2, Hello(0, 0.0, 0.0, 0, 0))
    assert searcher.machine.counters.contacts == 2


# ---------------------------------------------------------------- whole runs


def after_m(search: Run, end_s: float) -> float:
    """Return the way of all robots from the first tick at or after an instant on, by their true places."""
    first = math.ceil(end_s * 10 - 1e-9)
    ticks = search.places_m[first:]
    return sum(math.dist(a, b) for before, after in pairwise(ticks) for a, b in zip(before, after, strict=True))


@pytest.mark.slow
@pytest.mark.parametrize("strategy", ["srp", "mi", "random"])
def test_a_runs_metrics_agree_with_its_trace_and_with_the_simulators(strategy: str) -> None:
    search = run(strategy)
    metrics = search.outcome.metrics
    known_s = [search.times_s("AllKnown", host)[0] for host in (0, 1)]
    assert metrics["search_time_min"] * 60.0 == pytest.approx(max(known_s))
    assert metrics["first_known_min"] * 60.0 == pytest.approx(min(known_s))
    stops_s = [row["s"] for row in search.told("ErrandChanged") if row["errand"] == "stop"]
    assert metrics["stop_time_min"] * 60.0 == pytest.approx(max(stops_s))
    assert metrics["distance_after_m"] == pytest.approx(after_m(search, max(known_s)), abs=1e-6)
    assert metrics["motion_j"] == pytest.approx(20.0 * metrics["distance_m"], rel=1e-9)
    assert metrics["frames"] == metrics["frames_sent"]
    assert metrics["payload_bytes"] == metrics["radio_0_payload_bytes"] + metrics["radio_1_payload_bytes"]
    assert metrics["joins"] == len(search.told("Joined"))
    assert metrics["targets_reported"] >= len(TARGETS_M)


def test_rejoining_is_timed_from_the_death_of_the_first_host() -> None:
    """Host 0 dies at 3 s: searcher 2, which it has led, is with another at 7.5 s; searcher 3 changes for itself."""
    team = hand_made()
    assert math.isnan(measured(team)["rejoin_time_s"])
    walked(team.machines[0], [0.0] * 31)
    team.machines[2].counters.joins += [1 * S, 7 * S + 500 * MS, 9 * S]
    team.machines[3].counters.joins += [8 * S]
    metrics = measured(team)
    assert metrics["rejoin_time_s"] == pytest.approx(4.5)
    assert metrics["joins"] == 4.0


@pytest.mark.slow
@pytest.mark.parametrize("timeout_s", [2.5, 6.0])
def test_the_time_to_detect_a_dead_host_is_what_the_trace_says(timeout_s: float) -> None:
    search = run(
        "srp", faults=[{"kind": "kill", "robot": 0, "at_s": 9.03}], detector={"kind": "fixed", "timeout_s": timeout_s}
    )
    ((suspected_s),) = search.times_s("HostSuspected", 1)
    metrics = search.outcome.metrics
    assert metrics["detection_time_s"] == pytest.approx(suspected_s - 9.0, abs=1e-6)  # its last tick
    assert timeout_s - 1.0 < metrics["detection_time_s"] <= timeout_s + 0.1
    assert metrics["false_suspicions"] == 0.0


# ---------------------------------------------------------------- faults that touch the counting


@pytest.mark.slow
@pytest.mark.parametrize("robot", [1, 3])
def test_the_metrics_do_not_go_by_a_clock_that_has_been_set(robot: int) -> None:
    """The trace tells true instants. A clock that is set back would make no difference: the other robot is the last."""
    search = run("mi", camera_m=4.0, faults=[{"kind": "clock_step", "robot": robot, "at_s": 6.0, "by_s": 500.0}])
    metrics = search.outcome.metrics
    known_s = [search.times_s("AllKnown", host)[0] for host in (0, 1)]
    stops_s = [row["s"] for row in search.told("ErrandChanged") if row["errand"] == "stop"]
    assert min(*known_s, *stops_s) > 6.0
    assert metrics["completed"] == 1.0
    assert metrics["share_visited"] > 0.0
    assert metrics["search_time_min"] * 60.0 == pytest.approx(max(known_s), abs=TICK / S)
    assert metrics["stop_time_min"] * 60.0 == pytest.approx(max(stops_s), abs=TICK / S)
    assert metrics["distance_after_m"] == pytest.approx(after_m(search, metrics["search_time_min"] * 60.0), abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("robot", [0, 2])
def test_what_a_robot_did_before_a_reboot_counts(robot: int) -> None:
    search = run("mi", camera_m=4.0, faults=[{"kind": "crash", "robot": robot, "at_s": 7.0, "for_s": 9.0}])
    metrics = search.outcome.metrics
    assert metrics["frames"] == metrics["frames_sent"]
    assert metrics["payload_bytes"] == metrics["radio_0_payload_bytes"] + metrics["radio_1_payload_bytes"]
    down_m = search.way_m(robot, 6.9, 16.0)  # nobody counts from the last tick before the crash to the first after it
    assert metrics["motion_j"] == pytest.approx(20.0 * (metrics["distance_m"] - down_m), rel=1e-6)
    assert down_m < 0.01 * metrics["distance_m"]


@pytest.mark.slow
def test_a_host_that_was_down_was_suspected_with_right() -> None:
    """It is down for longer than the time-out of 5 s, and boots again: no death, and no mistake."""
    search = run("mi", camera_m=4.0, faults=[{"kind": "crash", "robot": 0, "at_s": 7.0, "for_s": 9.0}])
    ((suspected_s),) = search.times_s("HostSuspected", 1)
    assert 7.0 < suspected_s < 16.0
    assert search.outcome.metrics["false_suspicions"] == 0.0
    assert math.isnan(search.outcome.metrics["detection_time_s"])


@pytest.mark.slow
def test_a_host_that_could_not_speak_for_a_while_was_suspected_wrongly() -> None:
    search = run("mi", camera_m=4.0, faults=[{"kind": "radio_off", "robot": 0, "at_s": 7.0, "for_s": 9.0}])
    assert search.told("HostSuspected", 1)
    assert search.outcome.metrics["false_suspicions"] == len(search.told("HostSuspected"))
