"""Faults: who dies when, where the body rests, what the referee is told; radios that go off; what cannot happen."""

import shutil
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cosim.channels.ideal import IdealChannel
from cosim.channels.jamming import PULSED, SWEEPING, Jammer
from cosim.errors import UserError
from cosim.machine import Address, Lost
from cosim.protocol import Death
from cosim.scenario import Scenario, build, dump
from cosim.simulation import Simulation, simulate
from cosim.trace import FRAMES
from cosim.units import MS, S, Time
from tests.checkout import DATA
from tests.faults.fault_scene import RADIUS_M, TICK, executed, kill, radio_off, rows, scenario

# ---------------------------------------------------------------- death


def test_a_dead_robot_neither_observes_nor_hears_nor_speaks_from_that_instant_on():
    run = executed(kill(1, 0.123_456_789), duration_s=1.0)
    dead, other = run.machines[1], run.machines[0]
    assert [now for now, _ in dead.observed] == [0, TICK]  # type: ignore[attr-defined]
    assert max(now for now, _ in dead.heard) < 123_456_789  # type: ignore[attr-defined]
    assert {now for now, source in other.heard if source == 1} == {1_000, TICK + 1_000}  # type: ignore[attr-defined]
    assert other.news == [(123_456_789, Lost(1))]  # type: ignore[attr-defined]
    assert rows(run) == [(123_456_789, 1, "Killed")]
    assert run.outcome.metrics["robots_killed"] == 1.0  # type: ignore[attr-defined]


def test_what_is_on_its_way_does_not_reach_the_dead():
    run = executed(kill(1, 0.100_000_5), duration_s=0.3)  # between sending and arrival
    assert [now for now, _ in run.machines[1].heard] == [1_000]  # type: ignore[attr-defined]


def test_a_death_at_a_tick_comes_before_the_tick():
    run = executed(kill(1, 0.3), kill(0, 0.0), duration_s=1.0)
    assert [now for now, _ in run.machines[1].observed] == [0, TICK, 2 * TICK]  # type: ignore[attr-defined]
    assert run.machines[0].observed == []  # type: ignore[attr-defined]


def test_what_the_dead_wanted_to_do_next_is_not_done():
    run = executed(
        kill(0, 0.07), far_m=5.0, order_s=0.05, duration_s=1.0
    )  # told between two ticks, dead before the next
    path = run.referee.path(0)  # type: ignore[attr-defined]
    assert (path == path[0]).all()
    assert (run.referee.path(1)[-1] != path[0]).any()  # type: ignore[attr-defined]


@pytest.mark.parametrize("at_s", [2.0, 2.000_000_001, 2.05, 2.099_999_999])
def test_the_body_keeps_its_velocity_until_the_next_tick_then_brakes_under_its_limit_and_rests(at_s: float):
    run = executed(kill(0, at_s), far_m=9.0, duration_s=6.0)
    x = run.referee.path(0)[:, 0]  # type: ignore[attr-defined]
    alive = executed(far_m=9.0, duration_s=6.0).referee.path(0)[:, 0]  # type: ignore[attr-defined]
    brakes = 20 if at_s == 2.0 else 21  # the tick from which on it is slower
    assert (x[: brakes + 1] == alive[: brakes + 1]).all()
    ways = np.diff(x)
    # 0.05 m a tick at 0.5 m/s; 1 m/s^2 takes off 0.01 m a tick
    assert ways[brakes - 1 : brakes + 5] == pytest.approx([0.05, 0.04, 0.03, 0.02, 0.01, 0.0], abs=1e-9)
    assert (ways[brakes + 5 :] == 0).all()


def test_a_robot_that_follows_never_enters_the_body_that_stops():
    # drives in touch behind the other: with a stop in the midst of a tick it would be inside of it
    starts = [[1.4, 5.0], [1.0, 5.0]]
    for at_s in (2.0, 2.01, 2.05, 2.09):
        run = executed(kill(0, at_s), far_m=9.0, duration_s=6.0, team={"starts": starts})
        apart = np.diff([run.referee.path(1)[:, 0], run.referee.path(0)[:, 0]], axis=0)  # type: ignore[attr-defined]
        assert apart.min() >= 2 * RADIUS_M - 1e-8
        assert apart[0, -1] == pytest.approx(2 * RADIUS_M, abs=1e-6)  # and stands before it for ever


def test_the_body_of_the_dead_is_in_the_way_of_the_living():
    run = executed(kill(1, 0.0), far_m=9.0, duration_s=12.0)
    assert run.referee.path(0)[-1, 0] == pytest.approx(3.0 - 2 * RADIUS_M, abs=1e-6)  # type: ignore[attr-defined]
    assert (run.referee.path(1) == [3.0, 5.0]).all()  # type: ignore[attr-defined]


# ---------------------------------------------------------------- what the referee is told


def test_the_referee_is_told_once_when_the_body_has_come_to_rest_before_it_looks():
    run = executed(kill(0, 2.05), far_m=9.0)
    ((looks, death),) = run.referee.deaths  # type: ignore[attr-defined]
    path = run.referee.path(0)  # type: ignore[attr-defined]
    rest = 25  # brakes from tick 21 on, four ticks
    assert looks == rest  # looked at ticks 0 to 24, not yet at this one
    assert death == Death(0, 2_050 * MS, *path[-1].tolist(), RADIUS_M)
    assert (path[rest:] == path[-1]).all()
    assert (path[rest - 1] != path[-1]).any()


def test_a_robot_that_stands_when_it_dies_rests_at_the_next_tick():
    for at_s, looks in [(0.0, 0), (0.3, 3), (0.31, 4)]:
        run = executed(kill(1, at_s))
        assert run.referee.deaths == [(looks, Death(1, round(at_s * S), 3.0, 5.0, RADIUS_M))]  # type: ignore[attr-defined]


def test_a_run_that_ends_before_the_body_rests_tells_its_referee_all_the_same():
    run = executed(kill(0, 2.05), far_m=9.0, duration_s=2.25)
    ((looks, death),) = run.referee.deaths  # type: ignore[attr-defined]
    assert looks == 23
    assert (death.x_m, death.y_m) == tuple(run.referee.path(0)[-1].tolist())  # type: ignore[attr-defined]
    assert run.outcome.metrics["deaths_told"] == 1.0  # type: ignore[attr-defined]


def test_a_referee_that_knows_of_no_deaths_judges_runs_without_any():
    assert executed(radio_off(0, 1.0), use="tests.faults.fault_scene:OLD").outcome.simulated_s == 6.0  # type: ignore[attr-defined]
    with pytest.raises(AttributeError, match="died"):
        executed(kill(0, 1.0), use="tests.faults.fault_scene:OLD")


# ---------------------------------------------------------------- the end of the run


def test_the_run_ends_when_all_living_machines_have_finished():
    assert executed(finish_s=3.0).outcome.simulated_s == 3.0  # type: ignore[attr-defined]
    assert executed(kill(1, 1.0), finish_s=3.0).outcome.simulated_s == 3.0  # type: ignore[attr-defined]


def test_with_nobody_alive_the_run_ends_at_the_next_tick():
    run = executed(kill(0, 1.0), kill(1, 1.01), far_m=9.0)
    assert run.outcome.simulated_s == 1.1  # type: ignore[attr-defined]
    assert len(run.referee.deaths) == 2  # type: ignore[attr-defined]


# ---------------------------------------------------------------- radios


def heard_from(run: Simulation, robot: Address, source: Address) -> list[int]:
    """Return the ticks of whose calls *robot* has heard that of *source*."""
    heard = run.machines[robot].heard  # type: ignore[attr-defined]
    return [now // TICK for now, sender in heard if sender == source]


def test_a_radio_is_off_from_an_instant_until_another():
    run = executed(radio_off(1, 0.25, 0.5), duration_s=0.8)
    assert heard_from(run, 0, 1) == heard_from(run, 1, 0) == [0, 1, 2, 5, 6, 7]
    assert len(run.machines[1].observed) == 8  # type: ignore[attr-defined]
    assert rows(run) == [(250 * MS, 1, "RadioOff"), (500 * MS, 1, "RadioOn")]


def test_a_radio_without_an_end_of_its_outage_stays_off():
    assert heard_from(executed(radio_off(1, 0.25), duration_s=0.8), 0, 1) == [0, 1, 2]


def test_outages_that_overlap_end_with_the_last():
    for first, second in [((0.15, 0.35), (0.25, 0.55)), ((0.15, 0.55), (0.25, 0.35)), ((0.15, 0.35), (0.35, 0.55))]:
        run = executed(radio_off(1, *first), radio_off(1, *second), duration_s=0.8)
        assert heard_from(run, 0, 1) == [0, 1, 6, 7]


def test_the_radio_of_the_dead_stays_off():
    run = executed(radio_off(1, 0.15, 0.35), kill(1, 0.25), duration_s=0.8)
    assert run.channel.in_reach(0) == ()
    assert [event for _, _, event in rows(run)] == ["RadioOff", "Killed"]


# ---------------------------------------------------------------- digests


def test_faults_are_part_of_the_digest():
    digests = [
        simulate(scenario(*faults), 1).digest
        for faults in ([], [kill(1, 5.95)], [kill(1, 5.95)], [kill(0, 5.95)], [kill(1, 5.96)], [radio_off(1, 5.95)])
    ]
    assert digests[1] == digests[2]
    assert len(set(digests)) == 5


def test_a_fault_is_no_other_run_for_those_who_draw():
    assert (
        simulate(scenario(kill(1, 5.95)), 1, [FRAMES]).trace.columns("frames")["time_ns"][:50]
        == (simulate(scenario(), 1, [FRAMES]).trace.columns("frames")["time_ns"][:50])
    )


# ---------------------------------------------------------------- jammers


JAMMER = {"kind": "jammer", "x_m": 1.0, "y_m": 2.0}


def test_a_channel_that_has_a_radio_is_told_of_jammers_before_anything_runs(monkeypatch: pytest.MonkeyPatch):
    told: list[tuple[Time, Jammer]] = []
    monkeypatch.setattr(IdealChannel, "jam", lambda self, jammer: told.append((self.kernel.now, jammer)), raising=False)
    pulsed = {
        **JAMMER,
        "mode": "pulsed",
        "on_s": 0.002,
        "period_s": 0.01,
        "channels": [7, 3],
        "until_s": 4.5,
        "at_s": 1,
    }
    executed(kill(0, 1.0), pulsed, {**JAMMER, "mode": "sweeping", "dwell_s": 0.000625, "power_dbm": 4.0})
    assert told == [
        (0, Jammer(1.0, 2.0, 20.0, (7, 3), PULSED, MS, 2 * MS, 10 * MS, S, 4_500 * MS)),
        (0, Jammer(1.0, 2.0, 4.0, tuple(range(79)), SWEEPING, 625_000, 10 * MS, 100 * MS, 0, 6 * S)),
    ]


def test_a_channel_without_a_radio_has_nothing_to_jam():
    with pytest.raises(
        UserError, match=r"^faults\[1\]: a jammer needs a channel that can be jammed: bluetooth, ble or"
    ):
        Simulation(scenario(kill(0, 1.0), JAMMER), 1)


# ---------------------------------------------------------------- what cannot happen


@pytest.fixture
def depot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copy(DATA / "beacon.py", tmp_path)
    monkeypatch.delitem(sys.modules, "beacon", raising=False)
    monkeypatch.syspath_prepend(tmp_path)


def complaint(*faults: Any) -> str:
    plain = {"duration_s": 60, "protocol": {"use": "beacon:SPEC"}, "faults": list(faults)}
    with pytest.raises(UserError) as raised:
        build(plain, "depot.yaml", Path())
    return str(raised.value).removeprefix("depot.yaml: ")


@pytest.mark.usefixtures("depot")
@pytest.mark.parametrize(
    ("fault", "expected"),
    [
        (kill(4, 1), "faults[1].robot: 4 is not one of the robots 0 to 3"),
        (kill(-1, 1), "faults[1].robot: -1 is not >= 0"),
        (kill(1, 60), "faults[1].at_s: 60.0 is not < 60, the run's duration_s"),
        (kill(1, -1), "faults[1].at_s: -1 is not >= 0"),
        (kill(0, 2), "faults[1].robot: 0 dies twice"),
        ({"kind": "kill", "at_s": 2}, "faults[1].robot: is missing"),
        ({"robot": 1, "at_s": 2}, "faults[1].kind: is missing, in {'robot': 1, 'at_s': 2}"),
        ({"kind": "smoke"}, "faults[1].kind: 'smoke' is not one of 'kill', 'crash', 'radio_off', 'camera_off',"),
        (radio_off(1, 6, 6), "faults[1].until_s: 6 is not > 6, its at_s"),
        (radio_off(7, 6), "faults[1].robot: 7 is not one of the robots 0 to 3"),
        ({**JAMMER, "at_s": 80}, "faults[1].at_s: 80.0 is not < 60, the run's duration_s"),
        ({**JAMMER, "at_s": 8, "until_s": 7}, "faults[1].until_s: 7 is not > 8, its at_s"),
        ({**JAMMER, "channels": [78, 79]}, "faults[1].channels[1]: 79 is not <= 78"),
        ({**JAMMER, "channels": [7, 8, 7]}, "faults[1].channels: [7, 8, 7] names a channel twice"),
        ({**JAMMER, "on_s": 0.2}, "faults[1].period_s: 0.1 is not >= 0.2, the length of a pulse"),
        ({**JAMMER, "mode": "loud"}, "faults[1].mode: 'loud' is not 'constant', 'sweeping' or 'pulsed'"),
        ({**JAMMER, "z_m": 1}, "faults[1].z_m: 1 is not expected here: there is no such key, did you mean"),
        (3, "faults[1]: 3 is not a mapping of settings"),
    ],
)
def test_a_fault_that_cannot_happen_is_told_with_its_place(fault: Any, expected: str):
    assert complaint(kill(0, 1), fault).startswith(expected)


@pytest.mark.usefixtures("depot")
def test_faults_survive_their_dump():
    faults = [kill(0, 1), radio_off(1, 2, 3), JAMMER]
    plain = {"duration_s": 60, "protocol": {"use": "beacon:SPEC"}, "faults": faults}
    one = build(plain, "depot.yaml", Path())
    assert Scenario.model_validate(dump(one)) == one
    assert [fault.kind for fault in one.faults] == ["kill", "radio_off", "jammer"]
