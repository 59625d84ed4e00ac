"""One run: one order of phases a tick, when commands act, how it ends, and that the seed decides everything."""

import gc
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from pydantic import Field

from cosim.channels.ideal import IdealChannel, IdealSettings
from cosim.errors import LocalProtocolError, UserError
from cosim.machine import BROADCAST, Address, Command, Event, GoTo, LinkEvent, Outgoing, Reception
from cosim.machine import Outcome as Fated
from cosim.observation import Observation
from cosim.protocol import Metric, ProtocolSpec, Surroundings, anywhere
from cosim.scenario import Scenario
from cosim.settings import Settings
from cosim.simulation import METRICS, Outcome, Simulation, simulate
from cosim.trace import POSES, UNSENT
from cosim.units import MS, S, Time, to_seconds
from tests.checkout import DATA

TICK = 100 * MS


class Parameters(Settings):
    """Parameters of the walkers."""

    goal_m: tuple[float, float] | None = None
    order_s: float | None = Field(
        default=None, description="s, when the order to go comes; from the start if not given"
    )
    finish_s: float | None = None
    over_s: float | None = None


@dataclass(frozen=True)
class Drawn:
    """What a machine has drawn."""

    number: int


class Walker:
    """Goes to its goal when it is told to, calls out at every observation, and notes what it sees and hears."""

    def __init__(self, parameters: Parameters, setup: Any, me: Address, stream: np.random.Generator, start: Time):
        self.parameters, self.setup, self.me = parameters, setup, me
        self.seen: list[tuple[Time, Observation]] = []
        self.heard: list[tuple[Time, bytes]] = []
        self.order: Time | None = None if parameters.order_s is None else start + round(parameters.order_s * S)
        self.motion: list[Command] = []
        if parameters.goal_m is not None and self.order is None:
            self.motion.append(GoTo(*parameters.goal_m))
        self.out: list[Outgoing] = []
        self.notes: list[Event] = [Drawn(int(stream.integers(2**40)))]
        self.now = start

    @property
    def finished(self) -> bool:
        end = self.parameters.finish_s
        return end is not None and self.now >= round(end * S)

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        self.heard.append((now, data))

    def link(self, event: LinkEvent, now: Time) -> None:
        raise AssertionError("nobody asked")

    def observe(self, observation: Observation, now: Time) -> None:
        self.now = now
        self.seen.append((now, observation))
        self.out.append(Outgoing(BROADCAST, bytes([self.me, len(self.seen)])))

    def wake(self, now: Time) -> None:
        assert self.parameters.goal_m is not None
        self.order = None
        self.motion.append(GoTo(*self.parameters.goal_m))

    def wake_at(self) -> Time | None:
        return self.order

    def outbox(self) -> list[Any]:
        self.out, drained = [], self.out
        return list(drained)

    def commands(self) -> list[Command]:
        self.motion, drained = [], self.motion
        return drained

    def events(self) -> list[Event]:
        self.notes, drained = [], self.notes
        return drained


class Judge:
    """Ends the run when the parameters say so."""

    def __init__(self, parameters: Parameters, setup: Surroundings, surroundings: Surroundings) -> None:
        self.over_s = parameters.over_s
        self.looks: list[Time] = []

    def look(self, x_m: Any, y_m: Any, now: Time) -> bool:
        self.looks.append(now)
        return self.over_s is not None and now >= self.over_s * S

    def verdict(self, now: Time) -> dict[str, float]:
        return {"judged_s": to_seconds(now)}


SPEC = ProtocolSpec(
    name="walkers",
    parameters=Parameters,
    place=lambda parameters, surroundings, size, stream: [
        (2.0 * robot + stream.random(), 5.0) for robot in range(size)
    ],
    prepare=lambda parameters, surroundings: surroundings,
    make=Walker,
    referee=Judge,
    metrics=(Metric("heard", "1", "payloads heard"), Metric("judged_s", "s", "simulated time")),
    measure=lambda machines: {"heard": float(sum(len(machine.heard) for machine in machines))},
    events=(Drawn,),
)
SIGHTED = replace(SPEC, needs_sight=True)


@pytest.fixture(autouse=True)
def walkers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make this file the module that a user's scenario names."""
    monkeypatch.setitem(sys.modules, "walkers", sys.modules[__name__])


def scenario(size: int = 2, use: str = "walkers:SPEC", duration_s: float = 2.0, **parameters: Any) -> Scenario:
    plain = {
        "duration_s": duration_s,
        "floorplan": {"map": "walls", "bounds_m": [-1, -1, 11, 11], "walls": [[-1, 4, 11, 4]]},
        "team": {"size": size, "body": {"radius_m": 0.2, "speed_mps": 0.5, "acceleration_mps2": 1000.0}},
        "protocol": {"use": use, "parameters": parameters},
    }
    return Scenario.model_validate(plain)


def with_starts(plain: Scenario, starts: Sequence[tuple[float, float]]) -> Scenario:
    return plain.model_copy(update={"team": plain.team.model_copy(update={"starts": tuple(starts)})})


# ---------------------------------------------------------------- what is wrong with a protocol, and what a run tells


def changed(monkeypatch: pytest.MonkeyPatch, size: int = 2, duration_s: float = 2.0, **changes: Any) -> dict[str, Any]:
    """Return a scenario of walkers whose spec has *changes*."""
    monkeypatch.setattr(sys.modules[__name__], "CHANGED", replace(SPEC, **changes), raising=False)
    return scenario(size, "walkers:CHANGED", duration_s).model_dump()


def run_with(monkeypatch: pytest.MonkeyPatch, duration_s: float = 2.0, **changes: Any) -> Outcome:
    """Run walkers whose spec has *changes*."""
    return simulate(Scenario.model_validate(changed(monkeypatch, duration_s=duration_s, **changes)), 1)


@pytest.mark.parametrize(
    ("measured", "wrong"),
    [
        ({"heard": 1.0, "herd": 2.0}, "walkers: measure returns 'herd', which is no metric of the spec"),
        ({"heard": 1.0, "simulated_s": 2.0}, "measure returns 'simulated_s', which is no metric"),
        ({}, "neither of them returns the metric heard"),
        ({"heard": 1.0, "judged_s": 2.0}, "both measure and the referee return the metric judged_s"),
        ({"heard": float("inf")}, "measure returns heard = inf, expected a number or NaN"),
        ({"heard": "12"}, "measure returns heard = '12', expected a number or NaN"),
        ({"heard": None}, "heard = None, expected a number"),
    ],
)
def test_metrics_that_are_not_those_of_the_spec_stop_the_run(
    monkeypatch: pytest.MonkeyPatch, measured: dict[str, Any], wrong: str
):
    with pytest.raises(LocalProtocolError, match=wrong):
        run_with(monkeypatch, measure=lambda machines: measured)


def test_a_metric_may_be_nan(monkeypatch: pytest.MonkeyPatch):
    assert np.isnan(run_with(monkeypatch, measure=lambda machines: {"heard": float("nan")}).metrics["heard"])


def test_an_event_that_the_spec_does_not_name_stops_the_run(monkeypatch: pytest.MonkeyPatch):
    @dataclass(frozen=True)
    class Same:
        number: int

    with pytest.raises(LocalProtocolError, match=r"robot 0 at 0\.000000 s: Drawn is not among the event types"):
        run_with(monkeypatch, events=(Same,))


@pytest.mark.parametrize(
    ("starts", "error", "wrong"),
    [
        (
            [(0.0, 5.0), (1.0, 3.9)],
            UserError,
            r"^protocol walkers: place\(\)\[1\]: \(1, 3.9\) is inside a wall: .* 0.1 m",
        ),
        ([(0.0, 5.0), (0.1, 5.0)], UserError, r"is 0.1 m from protocol walkers: place\(\)\[0\]"),
        ([(0.0, 5.0)], LocalProtocolError, r"place\(\) returns 1 starts, expected 2"),
    ],
)
def test_starts_that_do_not_fit_are_those_of_who_gave_them(
    monkeypatch: pytest.MonkeyPatch, starts: list[tuple[float, float]], error: type[Exception], wrong: str
):
    with pytest.raises(error, match=wrong):
        run_with(monkeypatch, place=lambda *_: starts)


def test_a_protocol_is_told_where_a_body_fits_also_beside_thin_walls():
    told: Surroundings = Simulation(scenario(), 1).machines[0].setup  # type: ignore[attr-defined]
    assert told.fits((1.0, 4.2), 0.2)
    assert not told.fits((1.0, 4.1), 0.2)
    assert not told.forbidden(np.array([(1.0, 4.1)]))[0]
    assert not told.fits((12.0, 1.0), 0.2)


def test_robots_may_start_anywhere_that_they_fit(monkeypatch: pytest.MonkeyPatch):
    plain = changed(monkeypatch, size=40, duration_s=0.1, place=anywhere)
    assert len(Simulation(Scenario.model_validate(plain), 1).machines) == 40  # it checks the starts
    narrow = plain | {"floorplan": {"map": "walls", "bounds_m": [0, 0, 0.5, 0.5]}}
    with pytest.raises(UserError, match="found no place for robot 1"):
        Simulation(Scenario.model_validate(narrow), 1)


def test_what_a_person_is_to_be_told_is_told_in_words(monkeypatch: pytest.MonkeyPatch):
    assert run_with(monkeypatch).notices == ()
    told = run_with(monkeypatch, notices=(Drawn,)).notices
    assert [line.partition("(")[0] for line in told] == [f"robot {robot} at 0.0 s: Drawn" for robot in (0, 1)]


class Stubborn(Walker):
    """Sends to the next robot, now and then to all."""

    def observe(self, observation: Observation, now: Time) -> None:
        super().observe(observation, now)
        all_or_one = BROADCAST if len(self.seen) % 2 else (self.me + 1) % 2
        self.out = [Outgoing(all_or_one, b"hello")]


NEAR = {"kind": "ideal", "range_m": 1}


@pytest.mark.parametrize(
    ("channel", "unsent"),
    [
        ({"kind": "ideal"}, 0),
        (NEAR, 20),
        ({"kind": "optical", "range_m": 1}, 20),
        ({"kind": "adhoc", "range_m": 1}, 0),  # its radio tries
        ({"kind": "bluetooth"}, 40),
        ({"kind": "radios", "radios": [NEAR, {"kind": "ideal"}]}, 20),
    ],
)
def test_payloads_that_are_never_on_the_air_are_counted_and_told(
    monkeypatch: pytest.MonkeyPatch, channel: dict[str, Any], unsent: int
):
    plain = changed(monkeypatch, make=Stubborn) | {"channel": channel}
    run = Simulation(Scenario.model_validate(plain), 1, (UNSENT,))
    outcome = run.run()
    assert outcome.metrics["payloads_unsent"] == unsent
    assert [field.name for field in run.trace.tables["unsent"].fields][5:] == ["radio"] * (channel["kind"] == "radios")
    columns = run.trace.columns("unsent")
    assert set(columns["outcome"]) == ({"no_link"} if unsent else set())
    assert sorted(columns["source"]) == [0] * (unsent // 2) + [1] * (unsent // 2)
    each = f"robot 0: {unsent // 2}, robot 1: {unsent // 2}"
    head = f"{unsent} of 40 payloads were never on the air ({each}): not in reach, or no link"
    assert [line.startswith(head) for line in outcome.notices] == [True] * bool(unsent)


def test_the_digest_does_not_depend_on_what_was_never_sent(monkeypatch: pytest.MonkeyPatch):
    quiet = run_with(monkeypatch, measure=lambda machines: {"heard": 0.0})
    monkeypatch.setattr(IdealChannel, "unsent", Counter({(0, Fated.NO_LINK): 9}))
    counting = run_with(monkeypatch, measure=lambda machines: {"heard": 0.0})
    assert (quiet.metrics["payloads_unsent"], counting.metrics["payloads_unsent"]) == (0.0, 9.0)
    assert quiet.digest == counting.digest


def test_a_few_payloads_that_are_never_on_the_air_are_not_told(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(IdealChannel, "unsent", Counter({(0, Fated.NO_LINK): 4}))
    assert run_with(monkeypatch, duration_s=20.0).notices == ()  # of 400
    monkeypatch.setattr(IdealChannel, "unsent", Counter({(0, Fated.NO_LINK): 4, (1, Fated.TOO_LONG): 2}))
    told = run_with(monkeypatch, duration_s=20.0).notices
    assert [line.partition(" (")[0] for line in told] == [
        "4 of 400 payloads were never on the air",
        "2 of 400 payloads were never on the air",
    ]


# ---------------------------------------------------------------- the tick


def test_a_tick_has_one_order_of_phases(monkeypatch: pytest.MonkeyPatch):
    run = Simulation(scenario(goal_m=(1.0, 1.0), order_s=0.15), 1)
    log: list[tuple[Time, str]] = []

    def spy(target: Any, name: str) -> None:
        inner = getattr(target, name)

        def noted(*given: Any) -> Any:
            log.append((run.kernel.now, name))
            return inner(*given)

        monkeypatch.setattr(target, name, noted)

    for name in ("advance", "moved"):
        spy(run.channel, name)
    for name in ("apply", "step", "observations"):
        spy(run.fleet, name)
    for node in run.nodes:
        spy(node, "observe")
        spy(node, "drain")
    spy(run.referee, "look")
    run.kernel.at(2 * TICK, lambda: log.append((2 * TICK, "delivery")))
    run.run()
    sensing = ["observations", "observe", "drain", "observe", "drain", "look"]
    names = [[name for time, name in log if time == tick * TICK] for tick in range(4)]
    assert names[0] == ["moved", "drain", "drain", *sensing]
    assert names[1] == ["advance", "step", "moved", *sensing]
    assert names[2] == ["advance", "apply", "step", "moved", *sensing, "delivery"]  # all orders at once
    assert names[3] == ["advance", "step", "moved", *sensing]  # a command is applied once
    assert {time for time, name in log if name != "drain"} == set(range(0, 2 * S + 1, TICK))


def moving_since(outcome: Simulation, robot: int = 0) -> Time:
    """Return the last tick at which the robot still stood where it started."""
    seen = outcome.machines[robot].seen  # type: ignore[attr-defined]
    start = seen[0][1]
    return max(time for time, at in seen if (at.x_m, at.y_m) == (start.x_m, start.y_m))


@pytest.mark.parametrize(
    ("order_s", "acts_at"),
    [(None, TICK), (0.0, TICK), (0.05, TICK), (0.199_999_999, 2 * TICK), (0.2, 3 * TICK), (0.25, 3 * TICK)],
)
def test_commands_given_since_a_tick_act_at_the_next(order_s: float | None, acts_at: Time):
    run = Simulation(scenario(size=1, goal_m=(9.0, 5.0), order_s=order_s), 1)
    run.run()
    assert moving_since(run) == acts_at


def test_what_a_machine_sends_when_it_observes_arrives_between_the_ticks():
    run = Simulation(scenario(duration_s=0.25), 1)
    run.run()
    delay = 1_000
    assert run.machines[0].heard == [(k * TICK + delay, bytes([1, k + 1])) for k in range(3)]  # type: ignore[attr-defined]


def test_a_robot_is_told_whom_it_sees_if_its_protocol_asks():
    starts = [(1.0, 5.0), (3.0, 5.0), (5.0, 1.0)]  # the third is behind the wall
    for use, expected in [("walkers:SIGHTED", [(1,), (0,), ()]), ("walkers:SPEC", [(), (), ()])]:
        run = Simulation(with_starts(scenario(size=3, use=use), starts), 1)
        run.run()
        assert [machine.seen[-1][1].visible for machine in run.machines] == expected  # type: ignore[attr-defined]


# ---------------------------------------------------------------- mixed teams


SLOW_AND_WIDE = {"size": 2, "body": {"radius_m": 0.4, "speed_mps": 0.2, "acceleration_mps2": 3.0}}


def mixed(**changes: Any) -> Scenario:
    plain = scenario(goal_m=(9.0, 9.0), **changes).model_dump()
    plain["team"] |= {"groups": [{"size": 1, "power_class": 1}, SLOW_AND_WIDE]}
    del plain["team"]["size"]
    return Scenario.model_validate(plain)


def test_every_robot_of_a_mixed_team_has_the_body_of_its_group():
    run = Simulation(mixed(), 1)
    run.run()
    assert run.fleet.radii_m.tolist() == [0.2, 0.4, 0.4]
    assert [machine.seen[-1][1].speed_mps for machine in run.machines] == pytest.approx([0.5, 0.2, 0.2])  # type: ignore[attr-defined]


def test_a_protocol_is_told_of_every_body_of_a_mixed_team_and_of_the_extremes():
    told: Surroundings = Simulation(mixed(), 1).machines[0].setup  # type: ignore[attr-defined]
    assert (told.radius_m, told.speed_mps, told.acceleration_mps2) == (0.4, 0.2, 3.0)
    assert told.radii_m == (0.2, 0.4, 0.4)
    assert told.speeds_mps == (0.5, 0.2, 0.2)
    assert told.accelerations_mps2 == (1000.0, 3.0, 3.0)


def test_a_protocol_is_told_what_the_range_scanners_are_like():
    plain = mixed().model_dump()
    plain["team"]["senses"] |= {"beams": 90, "beam_range_m": 3.5}
    told: Surroundings = Simulation(Scenario.model_validate(plain), 1).machines[0].setup  # type: ignore[attr-defined]
    assert (told.scan_range_m, told.beams) == (3.5, 90)


def test_starts_must_leave_room_for_the_bodies_that_stand_there():
    def starting(*places: tuple[float, float]) -> Scenario:
        return with_starts(mixed(), places)

    Simulation(starting((1, 4.25), (3, 5), (5, 5)), 1)  # the narrow robot beside the wall
    with pytest.raises(UserError, match=r"team\.starts\[1\]: \(1, 4\.25\) is inside a wall"):
        Simulation(starting((3, 5), (1, 4.25), (5, 5)), 1)


def test_the_radios_are_told_their_power_classes_and_walls(monkeypatch: pytest.MonkeyPatch):
    told: list[Any] = []

    class Radio(IdealChannel):
        def __init__(self, settings: Any, kernel: Any, trace: Any, size: int, streams: Any, floor: Any, *rest: Any):
            told.extend((floor, rest[0]))
            super().__init__(IdealSettings(), kernel, trace, size)

    monkeypatch.setattr("cosim.channels.bluetooth.device.BluetoothChannel", Radio)
    plain = mixed().model_dump() | {"channel": {"kind": "bluetooth"}}
    run = Simulation(Scenario.model_validate(plain), 1)
    (grid, losses), classes = told
    assert classes == (1, None, None)
    assert grid is run.floorplan.grid
    assert losses is run.floorplan.wall_loss_db


# ---------------------------------------------------------------- the end


def test_a_run_ends_at_its_duration_before_anything_of_that_instant():
    outcome = simulate(scenario(), 1, [POSES])
    assert outcome.simulated_s == outcome.metrics["simulated_s"] == 2.0
    assert max(outcome.trace.columns("poses")["time_ns"]) == 2 * S - TICK


def test_a_run_ends_at_the_tick_when_all_machines_have_finished():
    run = Simulation(scenario(finish_s=0.75), 1)
    assert run.run().simulated_s == 0.8
    assert run.referee.looks == list(range(0, 8 * TICK + 1, TICK))  # type: ignore[attr-defined]


def test_a_run_goes_on_while_one_machine_has_not_finished():
    run = Simulation(scenario(finish_s=0.75), 1)
    run.machines[1].parameters = Parameters(finish_s=1.0)  # type: ignore[attr-defined]
    assert run.run().simulated_s == 1.0


def test_a_dead_machine_need_not_finish():
    run = Simulation(scenario(finish_s=0.75), 1)
    run.machines[1].parameters = Parameters()  # type: ignore[attr-defined]
    run.nodes[1].kill()
    assert run.run().simulated_s == 0.8


def test_the_referee_ends_a_run():
    assert simulate(scenario(over_s=0.5), 1).simulated_s == 0.5


@pytest.mark.parametrize(("before", "during"), [(700, 4000), (5000, 5000), (0, 0)])
def test_what_a_tick_makes_of_objects_does_not_call_the_collector_that_a_user_has_set(
    before: int, during: int, monkeypatch: pytest.MonkeyPatch
):
    kept, seen = gc.get_threshold(), []
    monkeypatch.setattr("cosim.simulation.OBJECTS_A_ROBOT", 2000)
    run = Simulation(scenario(), 1)
    run.kernel.at(S, lambda: seen.append(gc.get_threshold()))
    run.kernel.at(S + 1, lambda: 1 // 0)
    try:
        gc.set_threshold(before, *kept[1:])
        with pytest.raises(ZeroDivisionError):
            run.run()
        assert gc.get_threshold() == (before, *kept[1:])
    finally:
        gc.set_threshold(*kept)
    assert seen == [(during, *kept[1:])]


# ---------------------------------------------------------------- what comes out


def test_same_scenario_and_seed_give_the_same_digest_and_another_seed_another():
    plain = scenario(goal_m=(9.0, 9.0))
    digest = simulate(plain, 3).digest
    assert simulate(plain, 3).digest == digest
    assert simulate(plain, 4).digest != digest
    assert simulate(scenario(goal_m=(9.0, 8.0)), 3).digest != digest


def test_the_digest_covers_metrics_and_events():
    still = with_starts(scenario(), [(1.0, 5.0), (3.0, 5.0)])
    one, other = simulate(still, 3), simulate(still, 4)
    assert one.metrics == other.metrics
    assert one.trace.columns("events")["number"] != other.trace.columns("events")["number"]
    assert one.digest != other.digest
    longer = simulate(still.model_copy(update={"duration_s": 3.0}), 3)
    assert longer.trace.digest() == one.trace.digest()
    assert longer.digest != one.digest


def test_the_digest_does_not_depend_on_what_else_is_kept():
    assert simulate(scenario(), 3, [POSES]).digest == simulate(scenario(), 3).digest


@pytest.mark.slow
def test_another_process_finds_the_same_digest():
    folder = DATA
    code = (
        "from cosim.scenario import Scenario; from cosim.simulation import simulate;"
        "plain = {'duration_s': 5, 'protocol': {'use': 'beacon:SPEC'}};"
        "print(simulate(Scenario.model_validate(plain), 3).digest)"
    )
    digests = set()
    for seed in ("1", "2"):
        environment = {**os.environ, "PYTHONPATH": str(folder), "PYTHONHASHSEED": seed}
        command = [sys.executable, "-c", code]
        digests.add(subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout)
    assert len(digests) == 1
    assert len(digests.pop().strip()) == 64


def test_poses_are_a_row_a_robot_and_tick():
    starts = [(1.0, 5.0), (3.0, 6.0)]
    outcome = simulate(with_starts(scenario(duration_s=0.5, goal_m=(1.0, 9.0)), starts), 1, [POSES])
    poses = outcome.trace.columns("poses")
    assert poses["time_ns"] == [tick * TICK for tick in range(5) for _ in range(2)]
    assert poses["source"] == [0, 1] * 5
    assert list(zip(poses["x_m"], poses["y_m"], strict=True))[:4] == starts * 2
    # 0.5 m/s: at tick 1 the command acts, from then on 5 cm a tick, straight up
    assert poses["y_m"][::2] == pytest.approx([5.0, 5.0, 5.05, 5.1, 5.15])
    assert poses["x_m"][::2] == pytest.approx([1.0] * 5)


def test_the_distance_is_that_of_all_robots():
    starts = [(1.0, 5.0), (3.0, 5.0)]
    outcome = simulate(with_starts(scenario(duration_s=0.45, goal_m=(9.0, 5.0)), starts), 1)
    assert outcome.metrics["distance_m"] == pytest.approx(2 * 3 * 0.05)


def test_metrics_come_from_the_run_the_machines_the_referee_and_the_channel():
    outcome: Outcome = simulate(scenario(duration_s=0.5), 1)
    assert outcome.metrics["judged_s"] == 0.5
    assert outcome.metrics["heard"] == outcome.metrics["frames_sent"] == 10.0  # 2 robots, 5 ticks
    assert outcome.metrics["kernel_events"] == 5 + 5  # ticks and deliveries
    assert [metric.name for metric in outcome.metric_columns] == [
        *(metric.name for metric in METRICS),
        "heard",
        "judged_s",
        "frames_sent",
    ]
    assert set(outcome.metrics) == {metric.name for metric in outcome.metric_columns}


def test_events_of_the_machines_are_kept_from_the_first_instant():
    events = simulate(scenario(), 1).trace.columns("events")
    assert events["time_ns"] == [0, 0]
    assert events["event"] == ["Drawn", "Drawn"]
    assert len(set(events["number"])) == 2  # a stream each


def test_starts_that_do_not_fit_are_the_users_mistake():
    with pytest.raises(UserError, match=r"team\.starts\[1\]"):
        simulate(with_starts(scenario(), [(1.0, 5.0), (1.0, 4.0)]), 1)
