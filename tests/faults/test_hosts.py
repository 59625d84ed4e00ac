"""Faults of hosts: crashes and reboots, clocks that jump, batteries; and faults of any kind that come with a rate."""

from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError
from scipy import stats

from cosim.errors import UserError
from cosim.faults import course
from cosim.faults.instants import Agenda, Happening, spans
from cosim.faults.settings import KillSettings, RadioOffSettings
from cosim.kernel import WORLD
from cosim.machine import Discovered, Inquire, Lost, Page, Role, RoleChanged, Scan, SwitchRole
from cosim.randomness import Streams
from cosim.scenario import build, load
from cosim.simulation import Simulation, simulate
from cosim.trace import POSES
from cosim.units import MS, S, Time
from tests.faults.fault_scene import TICK, Driver, executed, kill, radio_off, rows, scenario


def crash(robot: int, at_s: float, until_s: float | None = None, **more: Any) -> dict[str, Any]:
    return {"kind": "crash", "robot": robot, "at_s": at_s, "until_s": until_s, **more}


def clock_step(robot: int, at_s: float, by_s: float, **more: Any) -> dict[str, Any]:
    return {"kind": "clock_step", "robot": robot, "at_s": at_s, "by_s": by_s, **more}


def battery(robot: int, capacity_j: float, **more: Any) -> dict[str, Any]:
    return {"kind": "battery", "robot": robot, "capacity_j": capacity_j, **more}


def observed_at(machine: Any) -> list[Time]:
    return [now for now, _ in machine.observed]


# ---------------------------------------------------------------- crash and reboot


def test_a_robot_that_has_crashed_is_silent_until_it_boots_as_a_new_machine():
    run = executed(crash(1, 0.25, 0.55), duration_s=1.0)
    machine, other = run.machines[1], run.machines[0]
    assert observed_at(machine) == [tick * TICK for tick in range(6, 10)]
    assert {now for now, source in other.heard if source == 1} == {
        tick * TICK + 1_000 for tick in (0, 1, 2, 6, 7, 8, 9)
    }
    assert min(now for now, _ in machine.heard) == 6 * TICK + 1_000
    assert other.news == [(250 * MS, Lost(1))]
    assert run.channel.in_reach(0) == (1,)
    assert rows(run) == [(250 * MS, 1, "Crashed"), (550 * MS, 1, "Rebooted")]
    assert run.outcome.metrics["robots_killed"] == 0.0


def test_the_new_machine_begins_at_the_boot_with_a_stream_of_its_own():
    run = executed(crash(1, 0.25, 0.55), crash(1, 0.6, 0.75), duration_s=1.0)
    streams = Streams(1)
    wanted = [streams("machine", 0).bit_generator.state, streams("machine", 1, "boot", 2).bit_generator.state]
    assert [machine.stream.bit_generator.state for machine in run.machines] == wanted
    assert [machine.start for machine in run.machines] == [0, 750 * MS]


def test_what_it_was_told_before_is_forgotten_and_the_body_brakes():
    # the order comes in the tick in which it crashes; the new machine gives its own at once
    run = executed(crash(0, 0.07, 0.95), far_m=5.0, order_s=0.05, duration_s=2.0)
    x = run.referee.path(0)[:, 0]
    assert (x[:11] == 1.0).all()
    assert x[11] == pytest.approx(1.01)
    run = executed(crash(0, 2.0, 3.0), far_m=5.0, duration_s=4.0)
    ways = np.diff(run.referee.path(0)[:, 0])
    assert ways[19:25] == pytest.approx([0.05, 0.04, 0.03, 0.02, 0.01, 0.0], abs=1e-9)
    assert (ways[24:31] == 0).all()  # it boots before tick 30 and gives its order after it
    assert ways[31] == pytest.approx(0.01)


def test_a_deadline_of_the_machine_before_wakes_nobody():
    # the first machine would be woken at 0.5 s; the second has a deadline of its own, in the past, and is woken at once
    run = executed(crash(0, 0.2, 0.3), order_s=0.5, duration_s=1.0)
    assert run.machines[0].woken == [500 * MS]
    run = executed(crash(0, 0.2, 0.7), order_s=0.5, duration_s=1.0)
    assert run.machines[0].woken == [700 * MS]


def test_what_a_new_machine_has_to_say_at_once_is_sent_at_its_boot():
    run = executed(crash(1, 0.25, 0.55), duration_s=0.58, greet=True, order_s=9.0)
    assert [now for now, source in run.machines[0].heard if source == 1][-1] == 550 * MS + 1_000


def between_ticks(*faults: dict[str, Any], acts: dict[Time, tuple[int, Any]], **changes: Any) -> Any:
    """Return a run, executed, in which radios are given commands: at an instant (robot, command)."""
    run = Simulation(scenario(*faults, duration_s=1.0, **changes), 1)
    for now, (robot, command) in acts.items():
        run.kernel.at(now, partial(run.channel.command, robot, command))
    run.run()
    return run


def test_who_has_booted_can_be_found_also_if_it_could_not_be_before_the_crash():
    acts = {50 * MS: (1, Scan(False)), 150 * MS: (0, Inquire(S, 1)), 650 * MS: (0, Inquire(S, 1))}
    run = between_ticks(crash(1, 0.25, 0.55), acts=acts)
    found = [(now, event) for now, event in run.machines[0].news if isinstance(event, Discovered)]
    assert found == [(650 * MS, Discovered(1))]
    # an outage of the radio is no boot
    run = between_ticks(radio_off(1, 0.25, 0.55), acts=acts)
    assert not [event for _, event in run.machines[0].news if isinstance(event, Discovered)]


def test_who_has_booted_can_be_found_by_each_of_its_radios():
    acts = {
        50 * MS: (1, Scan(False)),
        60 * MS: (1, Scan(False, 1)),
        600 * MS: (0, Inquire(S, 1)),
        610 * MS: (0, Inquire(S, 1, 1)),
        850 * MS: (0, Inquire(S, 1, 1)),
    }
    outage = {"kind": "radio_off", "robot": 1, "at_s": 0.1, "until_s": 0.8, "radio": 1}
    radios = {"channel": {"kind": "radios", "radios": [{"kind": "ideal"}] * 2}, "team": {"radios": [0, 1]}}
    found = [(600 * MS, Discovered(1)), (610 * MS, Discovered(1, radio=1)), (850 * MS, Discovered(1, radio=1))]
    for faults, heard in (((), found), ((outage,), [found[0], found[2]])):
        run = between_ticks(crash(1, 0.25, 0.55), *faults, acts=acts, **radios)
        assert [(now, event) for now, event in run.machines[0].news if isinstance(event, Discovered)] == heard


def test_a_link_of_the_machine_before_is_none_of_the_new_ones():
    acts = {50 * MS: (0, Page(1)), 650 * MS: (0, SwitchRole(1))}
    assert between_ticks(acts=acts).machines[0].news[-1] == (650 * MS, RoleChanged(1, Role.SLAVE))
    run = between_ticks(crash(1, 0.25, 0.55), acts=acts)
    assert run.machines[0].news[-1] == (650 * MS, RoleChanged(1, Role.PEER))  # no page has given them roles


def test_the_referee_hears_of_no_death_and_the_run_waits_for_the_boot():
    run = executed(crash(0, 1.0, 2.0), crash(1, 1.0, 2.5), finish_s=1.5, duration_s=6.0)
    assert run.referee.deaths == []
    assert run.outcome.simulated_s == 2.5
    assert executed(crash(1, 1.0, 9.0), finish_s=1.5, duration_s=6.0).outcome.simulated_s == 6.0


def test_who_is_killed_while_it_is_down_is_dead():
    run = executed(crash(1, 1.0, 3.0), kill(1, 2.0), duration_s=4.0, finish_s=2.5)
    assert [event for _, _, event in rows(run)] == ["Crashed", "Killed"]
    assert [(death.robot, death.at) for _, death in run.referee.deaths] == [(1, 2 * S)]
    assert run.outcome.simulated_s == 2.5


def test_crashes_that_overlap_end_with_the_last():
    run = executed(crash(1, 0.15, 0.35), crash(1, 0.25, 0.55), duration_s=0.8)
    assert rows(run) == [(150 * MS, 1, "Crashed"), (550 * MS, 1, "Rebooted")]


def test_a_radio_that_is_off_when_its_host_boots_comes_on_when_its_outage_ends():
    for outage in [(0.15, 0.65), (0.35, 0.65)]:
        run = executed(crash(1, 0.25, 0.45), radio_off(1, *outage), duration_s=1.0)
        heard = [now // TICK for now, source in run.machines[0].heard if source == 1]
        assert heard == [tick for tick in range(10) if tick * 0.1 < min(0.25, outage[0]) or tick >= 7]
        assert observed_at(run.machines[1]) == [tick * TICK for tick in range(5, 10)]
    run = executed(crash(1, 0.25, 0.65), radio_off(1, 0.35, 0.45), duration_s=1.0)
    heard = [now // TICK for now, source in run.machines[0].heard if source == 1]
    assert heard == [0, 1, 2, 7, 8, 9]


def test_a_radio_whose_outage_ends_while_its_host_is_down_stays_off_until_that_boots():
    run = Simulation(scenario(crash(1, 0.25, 0.65), radio_off(1, 0.35, 0.45), duration_s=0.8), 1)
    reached: list[tuple[int, ...]] = []
    for now in (0.2, 0.3, 0.4, 0.5, 0.7):
        run.kernel.at(round(now * S), lambda: reached.append(run.channel.in_reach(0)))
    run.run()
    assert reached == [(1,), (), (), (), (1,)]
    assert [event for *_, event in rows(run)] == ["Crashed", "RadioOff", "RadioOn", "Rebooted"]


def test_a_new_machine_learns_nothing_of_what_the_one_before_has_sent_or_linked():
    slow = {"channel": {"kind": "ideal", "delay_s": 0.3}}
    run = executed(crash(1, 0.25, 0.45), duration_s=1.0, tokens=True, **slow)
    fates = [now for now, event in run.machines[1].news if type(event).__name__ == "Fate"]
    assert fates == [tick * TICK + 300 * MS for tick in (5, 6)]


def test_pseudonet_goes_on_with_a_robot_that_has_booted_again(tmp_path: Any):
    (tmp_path / "team.yaml").write_text(PSEUDONET)
    for kind in ("ideal", "bluetooth"):
        made = load(tmp_path / "team.yaml", [f"channel.kind={kind}"])
        events = simulate(made, 1).trace.columns("events")
        at = [time for time, source, event in zip(*list(events.values())[:3], strict=True) if source == 1]
        assert max(at) > 20 * S


PSEUDONET = """
duration_s: 60
floorplan: {map: walls, bounds_m: [0, 0, 6, 6]}
team: {size: 3}
protocol: {use: pseudonet}
faults: [{kind: crash, robot: 1, at_s: 12, for_s: 3}, {kind: crash, robot: 0, at_s: 30, for_s: 5}]
"""


# ---------------------------------------------------------------- clocks


@pytest.mark.parametrize(("by_s", "offset"), [(2.5, 2_500 * MS), (-0.1, -100 * MS), (1e-9, 1), (-9.0, -250 * MS)])
def test_a_clock_that_has_jumped_is_what_its_machine_goes_by(by_s: float, offset: Time):
    run = executed(clock_step(1, 0.25, by_s), duration_s=0.6)
    assert observed_at(run.machines[1]) == [tick * TICK + offset * (tick > 2) for tick in range(6)]
    assert observed_at(run.machines[0]) == [tick * TICK for tick in range(6)]
    heard = [now for now, _ in run.machines[1].heard]
    assert heard == [tick * TICK + 1_000 + offset * (tick > 2) for tick in range(6)]
    assert rows(run) == [(250 * MS, 1, "ClockStepped")]
    assert run.trace.columns("events")["by_ns"] == [offset]


def test_news_of_links_comes_by_that_clock():
    run = executed(clock_step(0, 0.1, 5.0), kill(1, 0.25), duration_s=0.6)
    assert run.machines[0].news == [(5_250 * MS, Lost(1))]


@pytest.mark.parametrize(
    ("by_s", "woken", "starts"),
    [(0.0625, 500 * MS, 5), (-0.25, 500 * MS, 8), (0.5, 700 * MS, 3), (0.3, 500 * MS, 3)],
)
def test_a_deadline_is_met_when_its_machines_clock_says_so_or_at_once(by_s: float, woken: Time, starts: int):
    # told to go at 0.5 s by its clock, which jumps at 0.2 s; it moves from the next tick on
    run = executed(clock_step(0, 0.2, by_s), far_m=1.0, order_s=0.5, duration_s=2.0)
    assert run.machines[0].woken == [woken]
    x = run.referee.path(0)[:, 0]
    assert (x[: starts + 1] == 1.0).all()
    assert x[starts + 1] > 1.0


@pytest.mark.parametrize("protocol", ["monitoring", "gathering"])
def test_a_clock_that_is_set_forward_again_and_again_stops_at_the_latest_that_it_can_read(protocol: str):
    plain = {
        "duration_s": 5,
        "floorplan": {"map": "walls", "bounds_m": [0, 0, 10, 10]},
        "team": {"size": 2},
        "protocol": {"use": protocol, "parameters": {"period_s": 0.1} if protocol == "monitoring" else {}},
        "faults": [clock_step(0, 1, 1e9, rate_per_s=5.0), clock_step(1, 2, 1e9)],
    }
    simulation = Simulation(build(plain, "steps", Path()), 1)
    simulation.run()
    assert simulation.nodes[0].clock_offset == pytest.approx(4e18, abs=5e9)
    assert simulation.nodes[1].clock_offset == 10**18


def test_steps_add_up_and_a_boot_does_not_set_the_clock():
    steps = [clock_step(0, 0.15, 1.0), clock_step(0, 0.25, 0.5), crash(0, 0.3, 0.4)]
    run = executed(*steps, duration_s=0.6)
    assert run.machines[0].start == 1_900 * MS
    assert observed_at(run.machines[0]) == [1_900 * MS, 2_000 * MS]


def test_steps_of_a_running_machine_add_up_and_a_deadline_is_looked_at_at_once():
    run = executed(clock_step(0, 0.15, 1.0), clock_step(0, 0.25, 0.5), duration_s=0.4)
    assert observed_at(run.machines[0]) == [0, 100 * MS, 1_200 * MS, 1_800 * MS]
    assert executed(clock_step(0, 0.22, 0.3), order_s=0.5, duration_s=1.0).machines[0].woken == [520 * MS]


def test_nothing_more_happens_to_the_dead():
    hand = {"kind": "moved", "robot": 1, "at_s": 0.5, "to_m": [15.0, 15.0]}
    assert rows(executed(kill(1, 0.2), hand, clock_step(1, 0.3, 1.0), duration_s=1.0)) == [(200 * MS, 1, "Killed")]


def test_a_step_while_the_host_is_down_counts_when_it_boots():
    run = executed(crash(0, 0.1, 0.4), clock_step(0, 0.2, 1.0), duration_s=0.6)
    assert run.machines[0].start == 1_400 * MS
    assert observed_at(run.machines[0]) == [1_400 * MS, 1_500 * MS]


def test_a_host_that_is_down_is_asked_nothing(monkeypatch: pytest.MonkeyPatch):
    run = Simulation(scenario(crash(0, 0.15, 0.4), clock_step(0, 0.2, 1.0), duration_s=0.6), 1)
    asked: list[Time] = []

    def noted(ask: Callable[[Driver], Any]) -> Callable[[Driver], Any]:
        def note(machine: Driver) -> Any:
            if machine.me == 0:
                asked.append(run.kernel.now)
            return ask(machine)

        return note

    for name in ("wake_at", "outbox", "commands"):
        monkeypatch.setattr(Driver, name, noted(getattr(Driver, name)))
    run.run()
    assert [now for now in asked if 150 * MS <= now < 400 * MS] == []
    assert {100 * MS, 400 * MS} < {*asked}


def test_a_machine_with_another_clock_can_finish():
    assert executed(clock_step(0, 0.5, 2.0), kill(1, 0.1), finish_s=3.0).outcome.simulated_s == 1.0


# ---------------------------------------------------------------- batteries


def test_a_battery_lasts_as_long_as_the_host_can_draw_its_power():
    run = executed(battery(1, 3.0, idle_w=2.0, radio_w=1.0), duration_s=3.0)
    assert rows(run) == [(1 * S, 1, "BatteryEmpty"), (1 * S, 1, "Killed")]
    assert run.outcome.metrics["robots_killed"] == 1.0
    assert [death.at for _, death in run.referee.deaths] == [1 * S]
    assert rows(executed(battery(1, 3.0 + 1e-6, idle_w=2.0, radio_w=1.0)))[0][0] == 1_100 * MS


def test_a_radio_that_is_off_takes_nothing_and_a_host_that_is_down_neither():
    run = executed(battery(1, 3.0, idle_w=2.0, radio_w=1.0), radio_off(1, 0.0, 0.5), duration_s=3.0)
    assert rows(run)[-1] == (1_200 * MS, 1, "Killed")  # 5 x 0.2 + 6.67 x 0.3 J
    run = executed(battery(1, 0.9, idle_w=1.0, radio_w=9.0), radio_off(1, 0.05, 0.55), duration_s=3.0)
    assert rows(run)[-1] == (500 * MS, 1, "Killed")  # 0.5 J before the outage, 1 W in it
    run = executed(battery(1, 3.0, idle_w=2.0, radio_w=1.0), crash(1, 0.0, 0.5), duration_s=3.0)
    assert rows(run)[-1] == (1_500 * MS, 1, "Killed")


def test_driving_takes_so_much_a_metre():
    run = executed(battery(0, 2.0, drive_j_per_m=2.0), far_m=5.0, duration_s=6.0)
    ((_, death),) = run.referee.deaths
    path = run.referee.path(0)[:, 0]
    at = death.at // TICK
    assert path[at - 1] < 2.0 <= path[at] + 1e-9  # a metre from its start
    assert death.x_m > path[at]  # it brakes
    assert rows(executed(battery(1, 2.0, drive_j_per_m=2.0), far_m=0.9, duration_s=6.0)) == []


def test_the_way_that_a_robot_is_moved_by_hand_takes_nothing():
    hand = {"kind": "moved", "robot": 0, "at_s": 0.5, "to_m": [15.0, 15.0]}
    assert [event for *_, event in rows(executed(battery(0, 2.0, drive_j_per_m=2.0), hand))] == ["Carried"]


# ---------------------------------------------------------------- rates


def test_gaps_are_exponential_from_a_stream_of_their_own():
    fault = KillSettings(robot=0, at_s=5.0, rate_per_s=4.0)
    starts = [start for start, _ in spans(fault, Streams(3)("fault", 0), 1000 * S)]
    gaps = np.diff([5 * S, *starts]) / S
    assert stats.kstest(gaps, stats.expon(scale=0.25).cdf).pvalue > 0.01
    assert abs(len(starts) - 3980) < 4 * np.sqrt(3980)
    assert starts[-1] < 1000 * S
    assert starts == [start for start, _ in spans(fault, Streams(3)("fault", 0), 1000 * S)]
    assert starts[:9] == [start for start, _ in spans(fault, Streams(3)("fault", 0), starts[9])]


def test_each_lasts_as_long_as_is_said_and_has_no_end_after_the_run():
    fault = RadioOffSettings(robot=0, at_s=0.0, rate_per_s=1.0, for_s=2.0)
    happening = list(spans(fault, Streams(3)("fault", 0), 100 * S))
    assert {end - start for start, end in happening if end is not None} == {2 * S}
    assert [end is None for start, end in happening] == [start >= 98 * S for start, _ in happening]
    once = RadioOffSettings(robot=0, at_s=1.0, for_s=2.0)
    assert list(spans(once, Streams(3)("fault", 0), 100 * S)) == [(1 * S, 3 * S)]
    assert list(spans(once, Streams(3)("fault", 0), 3 * S)) == [(1 * S, None)]
    for_ever = RadioOffSettings(robot=0, at_s=1.0)
    assert list(spans(for_ever, Streams(3)("fault", 0), 100 * S)) == [(1 * S, None)]


def test_two_faults_that_are_alike_happen_at_times_of_their_own():
    fault = {"kind": "radio_off", "at_s": 0.0, "rate_per_s": 2.0, "for_s": 0.05}
    run = executed({**fault, "robot": 0}, {**fault, "robot": 1}, duration_s=6.0)
    times = [{now for now, source, event in rows(run) if source == robot} for robot in (0, 1)]
    assert all(len(of_one) > 5 for of_one in times)
    assert not times[0] & times[1]
    other = simulate(scenario({**fault, "robot": 0}, {**fault, "robot": 1}, duration_s=6.0), 2)
    assert not {*other.trace.columns("events")["time_ns"]} & (times[0] | times[1])


def test_who_is_killed_with_a_rate_dies_once():
    run = executed({"kind": "kill", "robot": 1, "at_s": 1.0, "rate_per_s": 5.0}, duration_s=6.0)
    ((at, _, _),) = rows(run)
    assert at > 1 * S
    assert run.outcome.metrics["robots_killed"] == 1.0


def test_rates_of_many_kinds_at_once_leave_a_run_that_can_be_repeated():
    each = {"at_s": 0.0, "rate_per_s": 1.0}
    faults: list[dict[str, Any]] = [
        {"kind": kind, "robot": robot, **each, "for_s": 0.4}
        for kind in ("crash", "radio_off", "camera_off", "frozen")
        for robot in (0, 1, 2)
    ]
    faults += [{"kind": "clock_step", "robot": robot, **each, "by_s": -0.3} for robot in (0, 1)]
    faults += [{"kind": "moved", "robot": robot, **each} for robot in (1, 2)]
    made = scenario(*faults, kill(2, 9.0), size=3, far_m=3.0, duration_s=12.0)
    one, other = simulate(made, 1), simulate(made, 1)
    assert one.digest == other.digest != simulate(made, 2).digest
    assert {*one.trace.columns("events")["event"]} >= {"Crashed", "Rebooted", "Carried", "ClockStepped", "Thawed"}


def every_kind_with_a_rate(seed: int) -> list[dict[str, Any]]:
    """Return faults of all hosts and bodies, many of which happen at one instant: at a tick, or several in one."""
    random = np.random.default_rng(seed)
    faults: list[dict[str, Any]] = []
    for kind in ("crash", "radio_off", "camera_off", "frozen", "moved", "moved", "clock_step", "kill"):
        fault = {"kind": kind, "robot": int(random.integers(3)), "at_s": float(random.choice([0.0, 0.3, 1.0]))}
        if kind != "kill":
            fault["rate_per_s"] = float(random.choice([0.7, 3.0, 25.0]))
        faults.append(fault | ({"by_s": 0.4} if kind == "clock_step" else {}))
        if kind in ("crash", "radio_off", "camera_off", "frozen"):
            faults[-1]["for_s"] = float(random.choice([0.1, 0.25]))
            faults.append({**faults[-1], "robot": (fault["robot"] + 1) % 3, "at_s": 0.5, "rate_per_s": None})
    return [*faults, battery(0, 3.0, idle_w=1.0, drive_j_per_m=0.5)]


@pytest.mark.parametrize("seed", range(4))
def test_drawing_instants_as_they_come_is_the_same_as_drawing_all_of_them_before_the_run(
    monkeypatch: pytest.MonkeyPatch, seed: int
):
    class AtOnce(Agenda):
        """All that will happen is entered into the kernel before the run, in the phase in which robots move."""

        def enter(self, number: int, happenings: Iterable[Happening]) -> None:
            for happening in happenings:
                for time, act in happening:
                    self._kernel.at(time, act, WORLD)

    made = scenario(*every_kind_with_a_rate(seed), size=3, far_m=3.0, duration_s=4.0)
    lazy = simulate(made, seed, [POSES])
    monkeypatch.setattr(course, "Agenda", AtOnce)
    at_once = simulate(made, seed, [POSES])
    assert lazy.digest == at_once.digest
    assert lazy.metrics == at_once.metrics
    assert [lazy.trace.columns(table) for table in ("events", "poses")] == [
        at_once.trace.columns(table) for table in ("events", "poses")
    ]


def test_a_rate_costs_nothing_before_its_instants_come():
    always = {"at_s": 0.0, "rate_per_s": 1000.0}
    faults = [{"kind": "frozen", "robot": 0, **always, "for_s": 0.01}, {"kind": "moved", "robot": 1, **always}]
    simulation = Simulation(scenario(*faults, duration_s=1e9), 1)
    simulation.begin()
    assert not simulation.advance(S // 10)
    frozen = [event for event in simulation.trace.columns("events")["event"] if event == "Frozen"]
    assert 0 < len(frozen) < 200


def test_a_jammer_that_begins_too_often_is_refused():
    often = {"kind": "jammer", "x_m": 1.0, "y_m": 1.0, "at_s": 0.0, "rate_per_s": 10.0, "for_s": 0.01}
    made = scenario(often, duration_s=1e9, channel={"kind": "bluetooth"})
    with pytest.raises(UserError, match=r"^faults\[0\]: a jammer with rate_per_s 10 begins more than 10000 times$"):
        Simulation(made, 1)


# ---------------------------------------------------------------- what cannot happen


@pytest.mark.parametrize(
    ("fault", "expected"),
    [
        (crash(0, 1.0), "is no end, nor is until_s given: say when it boots again, or have it killed"),
        (crash(0, 1.0, rate_per_s=0.1), "is no end, nor is until_s given"),
        (crash(0, 1.0, 2.0, for_s=1.0), "is given beside until_s"),
        (
            crash(0, 1.0, 2.0, rate_per_s=1.0),
            "is given beside rate_per_s, with which only for_s says how long it lasts",
        ),
        (clock_step(0, 1.0, 1e-10), "is not a step, of 1e-9 s at least"),
        (clock_step(0, 1.0, 1e10), "less than or equal to 1000000000"),
        (clock_step(0, 1.0, -1e10), "greater than or equal to -1000000000"),
        ({"kind": "kill", "robot": 0, "at_s": 1.0, "rate_per_s": 1e6}, "less than or equal to 1000"),
        (battery(0, 1.0), "is not > 0, nor is idle_w or radio_w: nothing uses the battery"),
        ({"kind": "moved", "robot": 0, "at_s": 60.0}, "is not < 6, the run's duration_s"),
        ({"kind": "frozen", "robot": 2, "at_s": 0.0}, "is not one of the robots 0 to 1"),
        ({"kind": "wall", "from_m": [1, 1], "to_m": [1, 1], "loss_db": 3}, "is the other end as well: no line"),
        ({"kind": "kill", "robot": 0, "at_s": 1.0, "rate_per_s": 0.0}, "greater than 0"),
    ],
)
def test_a_fault_that_cannot_happen_is_refused(fault: dict[str, Any], expected: str):
    with pytest.raises(ValidationError, match=expected):
        scenario(fault)


def test_a_robot_has_one_battery():
    with pytest.raises(ValidationError, match="has a battery already"):
        scenario(battery(0, 1.0, idle_w=1.0), battery(1, 1.0, idle_w=1.0), battery(0, 2.0, radio_w=1.0))


def test_a_scenario_without_a_fault_has_no_column_for_it():
    plain = simulate(scenario(kill(1, 0.1), duration_s=0.2), 1).trace.columns("events")
    assert {"to_x_m", "by_ns"} & plain.keys() == set()
