"""Several radios a robot: who hears whom by which, what robots do not have, faults of one radio, and settings."""

from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cosim.channels.adhoc.channel import AdhocChannel
from cosim.channels.adhoc.settings import AdhocSettings
from cosim.channels.base import Channel
from cosim.channels.bluetooth.device import BluetoothChannel
from cosim.channels.bluetooth.settings import BluetoothSettings
from cosim.channels.ideal import IdealChannel, IdealSettings
from cosim.channels.radios import RadiosChannel, RadioStreams, RadioTrace, with_radio
from cosim.errors import LocalProtocolError, UserError
from cosim.kernel import WORLD, Kernel
from cosim.machine import (
    BROADCAST,
    Address,
    Connected,
    Disconnect,
    Discovered,
    Fate,
    Flush,
    Hold,
    Inquire,
    InquiryComplete,
    LinkCommand,
    LinkEvent,
    Lost,
    Mode,
    ModeChanged,
    Outcome,
    Outgoing,
    Page,
    PageFailed,
    Reception,
    Role,
    RoleChanged,
    Scan,
    SwitchRole,
)
from cosim.node import Node
from cosim.randomness import Streams
from cosim.scenario import Scenario, build
from cosim.simulation import Simulation
from cosim.trace import FRAMES, INTERVALS, POSES, RECEPTIONS, TRANSMISSIONS, Table, Trace
from cosim.units import MS, S, Time
from tests.faults.fault_scene import rows, scenario

SHORT, LONG = {"kind": "adhoc", "range_m": 20.0}, {"kind": "adhoc", "range_m": 100.0}
PLACES_M = np.array([(0.0, 0.0), (10.0, 0.0), (50.0, 0.0), (90.0, 0.0)])
BOTH, FIRST = (0, 1), (0,)


class Host:
    def __init__(self) -> None:
        self.heard: list[tuple[int, Address, bytes]] = []
        """(radio, source, payload)"""
        self.events: list[LinkEvent] = []

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        self.heard.append((reception.radio, reception.source, data))

    def link(self, event: LinkEvent, now: Time) -> None:
        self.events.append(event)

    def drain(self, now: Time) -> None:
        pass


class Field:
    """Robots with radios on a plane."""

    def __init__(
        self,
        carried: Sequence[Sequence[int]],
        settings: Iterable[dict[str, Any]] = (SHORT, LONG),
        tables: Iterable[Table] = (FRAMES, INTERVALS, TRANSMISSIONS, RECEPTIONS),
    ) -> None:
        self.kernel = Kernel()
        self.trace = Trace(with_radio(tables))
        self.parts = [self._part(each, radio, len(carried)) for radio, each in enumerate(settings)]
        self.channel = RadiosChannel(self.kernel, self.trace, self.parts, carried)
        self.hosts = [Host() for _ in carried]
        for address, host in enumerate(self.hosts):
            self.channel.attach(address, host)
        self.channel.moved(PLACES_M[: len(carried)])

    def _part(self, settings: dict[str, Any], radio: int, size: int) -> Channel:
        trace, streams = RadioTrace(self.trace, radio), RadioStreams(Streams(5), radio)
        if settings["kind"] == "adhoc":
            return AdhocChannel(AdhocSettings(**settings), self.kernel, trace, size, streams)
        if settings["kind"] == "bluetooth":
            return BluetoothChannel(BluetoothSettings(**settings), self.kernel, trace, size, streams)
        return IdealChannel(IdealSettings(**settings), self.kernel, trace, size, streams)

    def send(self, at: Time, source: Address, outgoing: Outgoing) -> None:
        self.kernel.at(at, lambda: self.channel.send(source, outgoing), WORLD)

    def frames(self, radio: int) -> list[tuple[Any, ...]]:
        return [row for row in zip(*self.trace.columns("frames").values(), strict=True) if row[-1] == radio]


def test_each_radio_reaches_those_who_have_it_and_are_in_its_range() -> None:
    field = Field((BOTH, BOTH, BOTH, FIRST))
    field.send(MS, 0, Outgoing(BROADCAST, b"near", 1, 0))
    field.send(MS, 0, Outgoing(BROADCAST, b"far", 2, 1))
    field.kernel.run(S)
    assert sorted(field.hosts[1].heard) == [(0, 0, b"near"), (1, 0, b"far")]
    assert field.hosts[2].heard == [(1, 0, b"far")]
    assert field.hosts[3].heard == [], "90 m away, but without radio 1"
    assert sorted(field.hosts[0].events, key=repr) == [
        Fate(1, Outcome.SENT),
        Fate(2, Outcome.SENT, 1),
    ]
    assert {radio: {row[3] for row in field.frames(radio)} for radio in BOTH} == {
        0: {(192 + 8 * 40) * 1000},
        1: {(192 + 8 * 39) * 1000},
    }


def test_what_a_bluetooth_radio_does_stands_under_its_number() -> None:
    bluetooth = {"kind": "bluetooth"}
    field = Field((BOTH, BOTH, FIRST), [SHORT, bluetooth])
    part = field.channel.parts[1]
    field.kernel.at(0, lambda: part.command(0, Inquire(10 * S, 1)), WORLD)
    field.kernel.run(11 * S)
    looked = field.channel.under_way(field.kernel.now)
    assert {(row.robot, row.state) for row in looked if row.radio == 1} == set()
    field.channel.close(field.kernel.now)
    rows = [row for row in zip(*field.trace.columns("intervals").values(), strict=True) if row[3] == 1]
    assert {row[4] for row in rows if row[1] == 0} >= {"inquiry", "inquiry_scan", "page_scan"}
    assert not any(row[1] == 2 for row in rows)
    for name in ("transmissions", "receptions"):
        assert set(field.trace.columns(name)["radio"]) == {1}


def test_a_payload_to_one_robot_goes_by_the_radio_that_is_named_and_so_does_its_acknowledgement() -> None:
    field = Field((BOTH, BOTH, BOTH, FIRST))
    field.send(MS, 0, Outgoing(2, b"far", 1, 1))
    field.send(MS, 0, Outgoing(2, b"near", 2, 0))
    field.send(MS, 0, Outgoing(3, b"none", 3, 1))
    field.kernel.run(S)
    assert field.hosts[2].heard == [(1, 0, b"far")]
    assert field.hosts[3].heard == []
    outcomes = {event.token: event.outcome for event in field.hosts[0].events if isinstance(event, Fate)}
    assert outcomes == {1: Outcome.DELIVERED, 2: Outcome.UNACKNOWLEDGED, 3: Outcome.UNACKNOWLEDGED}
    assert [row[1] for row in field.frames(1) if row[4] == "ACK"] == [2]


def test_the_two_radios_of_a_robot_are_on_the_air_at_once() -> None:
    field = Field((BOTH, BOTH))
    for number in range(20):
        field.send(number * 2 * MS, 0, Outgoing(BROADCAST, bytes(100), None, number % 2))
        field.send(number * 2 * MS, 1, Outgoing(BROADCAST, bytes(100), None, 1 - number % 2))
    field.kernel.run(S)
    assert {row[8] for radio in BOTH for row in field.frames(radio)} == {"received"}
    assert [row[0] for row in field.frames(0)] == [row[0] for row in field.frames(1)]


def traffic(field: Field, radio: int) -> None:
    for number in range(60):
        field.send(number * MS, number % 3, Outgoing((number + 1) % 3, bytes(50), number, radio))


def test_radio_0_is_what_it_is_alone_whatever_the_others_do_and_they_draw_for_themselves() -> None:
    alone, beside = Field((FIRST, FIRST, FIRST), [LONG]), Field((BOTH, BOTH, BOTH), [LONG, LONG])
    traffic(alone, 0)
    traffic(beside, 0)
    traffic(beside, 1)
    alone.kernel.run(S)
    beside.kernel.run(S)
    assert len(alone.frames(0)) > 120
    assert beside.frames(0) == alone.frames(0)
    same_but_draws = [row[:-1] for row in beside.frames(1)]
    assert same_but_draws != [row[:-1] for row in beside.frames(0)]
    plain = AdhocChannel(AdhocSettings(**LONG), Kernel(), Trace((FRAMES,)), 3, Streams(5))
    assert plain._draws.key == beside.parts[0]._draws.key != beside.parts[1]._draws.key  # type: ignore[attr-defined]


@pytest.mark.parametrize("radio", [1, 2, -1])
def test_a_payload_by_a_radio_that_the_robot_does_not_have_is_our_own_misuse(radio: int) -> None:
    field = Field((BOTH, FIRST))
    with pytest.raises(LocalProtocolError, match=f"robot 1 has no radio {radio}"):
        field.channel.send(1, Outgoing(BROADCAST, b"", None, radio))


class Talker:
    finished = False

    def __init__(self, *out: Outgoing | LinkCommand) -> None:
        self.out = [*out]

    def outbox(self) -> list[Outgoing | LinkCommand]:
        self.out, drained = [], self.out
        return drained

    def events(self) -> list[Any]:
        return []

    commands = events

    def wake_at(self) -> None:
        return None


def test_a_plain_channel_has_radio_0_only() -> None:
    kernel, trace = Kernel(), Trace()
    channel = IdealChannel(IdealSettings(), kernel, trace, 2)
    Node(0, Talker(Outgoing(BROADCAST, b"")), kernel, channel, trace).drain(0)  # type: ignore[arg-type]
    with pytest.raises(LocalProtocolError, match=r"robot 1 at .*: the robot has no radio 1"):
        Node(1, Talker(Outgoing(BROADCAST, b"", None, 1)), kernel, channel, trace).drain(0)  # type: ignore[arg-type]
    assert channel.parts == (channel,)
    assert channel.sent == 1


def test_in_reach_is_who_hears_one_by_any_radio_that_both_have() -> None:
    field = Field((BOTH, BOTH, BOTH, FIRST))
    assert [field.channel.in_reach(robot) for robot in range(4)] == [(1, 2), (0, 2), (0, 1), ()]
    field.channel.power(1, False)
    assert [field.channel.in_reach(robot) for robot in range(4)] == [(2,), (), (0,), ()]


@pytest.mark.parametrize("kind", ["ideal", "bluetooth", "adhoc"])
def test_a_radio_that_a_robot_does_not_have_is_never_switched_on(kind: str) -> None:
    field = Field((BOTH, FIRST, BOTH), [{"kind": "ideal"}, {"kind": kind}])
    field.channel.power(1, False)
    field.channel.power(1, True)
    assert field.parts[0].in_reach(1) == (0, 2)
    assert field.parts[1].in_reach(1) == ()
    assert field.parts[1].in_reach(0) == (2,)


@pytest.mark.parametrize("radio", BOTH)
def test_each_radio_has_links_of_its_own_and_its_news_names_it(radio: int) -> None:
    field = Field((BOTH, BOTH, (1 - radio,)), [{"kind": "ideal"}, {"kind": "ideal"}])
    commands = Inquire(S, 9, radio), Page(1, radio=radio), Hold(1, 8, radio), SwitchRole(1, radio), Page(2, radio=radio)
    for number, command in enumerate(commands):
        field.kernel.at((number + 1) * MS, partial(field.channel.command, 0, command), WORLD)
    field.kernel.run(S)
    assert field.hosts[0].events == [
        Discovered(1, 0, radio),
        InquiryComplete((1,), radio),
        Connected(1, Role.MASTER, radio=radio),
        ModeChanged(1, Mode.ACTIVE, radio),
        RoleChanged(1, Role.SLAVE, radio),
        PageFailed(2, radio),
    ]
    assert field.hosts[1].events == [Connected(0, Role.SLAVE, radio=radio), RoleChanged(0, Role.MASTER, radio)]
    assert field.hosts[2].events == [], "it does not have that radio"


def test_what_is_lost_is_a_link_of_that_radio_and_told_once() -> None:
    field = Field((BOTH, BOTH, FIRST, (1,)), [{"kind": "ideal"}, {"kind": "ideal"}])
    field.kernel.at(MS, partial(field.channel.command, 0, Page(1, radio=1)), WORLD)
    field.kernel.at(3 * MS, partial(field.channel.power, 1, False), WORLD)
    field.kernel.at(5 * MS, partial(field.channel.power, 1, True), WORLD)
    field.kernel.at(7 * MS, partial(field.channel.power, 1, False), WORLD)
    field.kernel.run(S)
    made = Connected(1, Role.MASTER, radio=1)
    assert field.hosts[0].events == [made, Lost(1), Lost(1, 1), Lost(1)], "by radio 1 there was a link, once"
    assert field.hosts[2].events == [Lost(1), Lost(1)], "an ideal radio 0 loses whoever is off"
    assert field.hosts[3].events == []


def test_two_bluetooth_radios_make_a_link_each_and_carry_payloads_over_their_own() -> None:
    field = Field((BOTH, BOTH, BOTH), [{"kind": "bluetooth"}, {"kind": "bluetooth"}])
    for at, command in ((0, Page(1, radio=1)), (0, Page(2)), (20 * S, Disconnect(1, 1))):
        field.kernel.at(at, partial(field.channel.command, 0, command), WORLD)
    for token, (destination, radio) in enumerate(((1, 1), (2, 0), (1, 0), (2, 1))):
        field.send(15 * S, 0, Outgoing(destination, b"x", token, radio))
    field.kernel.run(30 * S)
    assert [(event.peer, event.radio) for event in field.hosts[0].events if isinstance(event, Connected)] in (
        [(1, 1), (2, 0)],
        [(2, 0), (1, 1)],
    )
    assert sorted((event for event in field.hosts[0].events if isinstance(event, Fate)), key=repr) == [
        Fate(0, Outcome.DELIVERED, 1),
        Fate(1, Outcome.DELIVERED, 0),
        Fate(2, Outcome.NO_LINK, 0),
        Fate(3, Outcome.NO_LINK, 1),
    ]
    assert (field.hosts[1].heard, field.hosts[2].heard) == ([(1, 0, b"x")], [(0, 0, b"x")])
    assert [event for event in field.hosts[1].events if isinstance(event, Lost)] == [Lost(0, 1)]


@pytest.mark.parametrize("command", [Scan(True, 1), Page(0, radio=1), Inquire(S, 1, 2), Flush(BROADCAST, -1)])
def test_a_command_for_a_radio_that_the_robot_does_not_have_is_our_own_misuse(command: LinkCommand) -> None:
    field = Field((BOTH, FIRST))
    with pytest.raises(LocalProtocolError, match=f"^robot 1 has no radio {command.radio}$"):
        field.channel.command(1, command)
    kernel, trace = Kernel(), Trace()
    node = Node(1, Talker(command), kernel, IdealChannel(IdealSettings(), kernel, trace, 2), trace)  # type: ignore[arg-type]
    with pytest.raises(LocalProtocolError, match=rf"robot 1 at .*: the robot has no radio {command.radio}$"):
        node.drain(0)


def test_a_link_command_leaves_the_other_radios_alone() -> None:
    field = Field((BOTH, BOTH), [{"kind": "ideal"}, {"kind": "bluetooth"}])
    field.kernel.at(MS, lambda: field.channel.command(0, Inquire(100 * MS, 9)), WORLD)
    field.kernel.run(S)
    assert field.hosts[0].events == [Discovered(1), InquiryComplete((1,))]
    assert field.channel.summary()["radio_1_radio_inquiry_s"] == 0.0


def test_counts_are_summed_up_and_told_by_radio() -> None:
    field = Field((BOTH, BOTH), [{"kind": "ideal"}, LONG])
    for radio, length in ((0, 10), (0, 20), (1, 5)):
        field.send(MS, 0, Outgoing(1, bytes(length), None, radio))
    field.kernel.run(S)
    counted = field.channel.summary()
    assert counted == {
        "frames_sent": 4.0,
        "payloads_dropped": 0.0,
        "radio_0_frames_sent": 2.0,
        "radio_0_payload_bytes": 30.0,
        "radio_1_frames_sent": 2.0,
        "radio_1_payloads_dropped": 0.0,
        "radio_1_payload_bytes": 5.0,
    }
    assert [metric.name for metric in field.channel.columns] == list(counted)


# ---------------------------------------------------------------- in a run

TWO = {"kind": "radios", "radios": [SHORT, LONG]}


def test_a_run_with_one_of_several_radios_is_the_run_with_a_plain_one() -> None:
    channels: tuple[Any, ...] = ({"kind": "adhoc"}, {"kind": "radios", "radios": [{"kind": "adhoc"}, LONG]})
    runs = [
        Simulation(scenario(size=3, far_m=2.0, duration_s=3.0, channel=each), 4, [FRAMES, POSES]) for each in channels
    ]
    plain, several = (run.run() for run in runs)
    assert plain.trace.count("frames") > 100
    assert plain.trace.digest(["events", "poses"]) == several.trace.digest(["events", "poses"])
    columns = several.trace.columns("frames")
    assert set(columns.pop("radio")) == {0}
    assert columns == plain.trace.columns("frames")
    assert [machine.heard for machine in runs[0].machines] == [machine.heard for machine in runs[1].machines]  # type: ignore[attr-defined]
    assert several.metrics["radio_0_frames_sent"] == several.metrics["frames_sent"] == plain.metrics["frames_sent"]
    assert {column.name for column in several.metric_columns} == several.metrics.keys()


def with_radios(*faults: dict[str, Any], radios: Any = BOTH, channel: Any = TWO) -> Scenario:
    return scenario(*faults, size=3, channel=channel, duration_s=1.0, team={"radios": list(radios)})


def reach_of_radios(*faults: dict[str, Any], radios: Any = BOTH, channel: Any = TWO) -> list[tuple[int, ...]]:
    """Return by which radios robot 0 reaches others, just after each tick."""
    run = Simulation(with_radios(*faults, radios=radios, channel=channel), 1)
    found: list[tuple[int, ...]] = []
    parts = run.channel.parts
    for tick in range(8):
        run.kernel.at(
            tick * 100 * MS + 1,
            lambda: found.append(tuple(radio for radio, part in enumerate(parts) if part.in_reach(0))),
        )
    run.run()
    return found


def off(at_s: float, until_s: float | None, radio: int | None = None) -> dict[str, Any]:
    return {"kind": "radio_off", "robot": 0, "at_s": at_s, "until_s": until_s, "radio": radio}


def test_a_fault_switches_off_one_radio_or_all() -> None:
    assert reach_of_radios(off(0.15, 0.45, 1)) == [BOTH] * 2 + [(0,)] * 3 + [BOTH] * 3
    assert reach_of_radios(off(0.15, 0.45, 0)) == [BOTH] * 2 + [(1,)] * 3 + [BOTH] * 3
    assert reach_of_radios(off(0.15, 0.45)) == [BOTH] * 2 + [()] * 3 + [BOTH] * 3


def test_faults_of_one_radio_and_of_all_overlap() -> None:
    assert reach_of_radios(off(0.15, 0.45, 1), off(0.25, 0.65)) == [BOTH] * 2 + [(0,)] + [()] * 4 + [BOTH]
    assert reach_of_radios(off(0.15, 0.65, 1), off(0.25, 0.45)) == [BOTH] * 2 + [(0,)] + [()] * 2 + [(0,)] * 2 + [BOTH]
    crash = {"kind": "crash", "robot": 0, "at_s": 0.25, "until_s": 0.45}
    assert reach_of_radios(off(0.15, 0.65, 1), crash) == [BOTH] * 2 + [(0,)] + [()] * 2 + [(0,)] * 2 + [BOTH]
    assert reach_of_radios(crash, radios=FIRST) == [(0,)] * 3 + [()] * 2 + [(0,)] * 3


def test_the_trace_says_which_radio_a_fault_has_switched() -> None:
    run = Simulation(with_radios(off(0.15, 0.45, 1), off(0.55, None)), 1)
    run.run()
    assert [row[2] for row in rows(run)] == ["RadioOff", "RadioOn", "RadioOff"]
    assert run.trace.columns("events")["radio"] == [1, 1, -1]


FADING = {"kind": "adhoc", "propagation": {"model": "free_space"}}


def wall(radio: int | None) -> dict[str, Any]:
    line = {"from_m": [2.0, 0.0], "to_m": [2.0, 20.0], "loss_db": 200.0}
    return {"kind": "wall", "at_s": 0.15, "until_s": 0.45, "radio": radio, **line}


@pytest.mark.parametrize(("radio", "left"), [(None, (2,)), (0, (1, 2)), (1, (0, 2))])
def test_a_wall_weakens_the_radio_that_it_names_or_all_that_notice_walls(radio: int | None, left: Any) -> None:
    channel = {"kind": "radios", "radios": [FADING, FADING, SHORT]}
    found = reach_of_radios(wall(radio), radios=(0, 1, 2), channel=channel)
    assert found == [(0, 1, 2)] * 2 + [left] * 3 + [(0, 1, 2)] * 3


def jammer(radio: int | None) -> dict[str, Any]:
    return {"kind": "jammer", "x_m": 3.0, "y_m": 5.0, "at_s": 0.0, "radio": radio}


@pytest.mark.parametrize(("radio", "silent"), [(None, {0, 1}), (0, {0}), (1, {1})])
def test_a_jammer_disturbs_the_radio_that_it_names_or_all_that_can_be(radio: int | None, silent: set[int]) -> None:
    channel = {"kind": "radios", "radios": [SHORT, SHORT, {"kind": "ideal"}]}
    run = Simulation(with_radios(jammer(radio), radios=(0, 1, 2), channel=channel), 1)
    for each in range(3):
        run.kernel.at(50 * MS, lambda each=each: run.channel.send(0, Outgoing(BROADCAST, b"", None, each)), WORLD)
    run.run()
    counted = run.channel.summary()
    assert {each for each in range(3) if counted[f"radio_{each}_frames_sent"] == 0} == silent


def test_faults_that_no_radio_would_notice_are_refused() -> None:
    ideal = {"kind": "radios", "radios": [{"kind": "ideal"}, SHORT]}
    with pytest.raises(UserError, match=r"faults\[0\]: a jammer needs a channel that can be jammed"):
        Simulation(with_radios(jammer(0), channel=ideal), 1)
    with pytest.raises(UserError, match=r"faults\[0\]: a wall needs a channel whose signals fade"):
        Simulation(with_radios(wall(None), channel=ideal), 1)
    with pytest.raises(UserError, match=r"faults\[0\]: radios without propagation notice no walls"):
        Simulation(with_radios(wall(1), channel=ideal), 1)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"team": {"radios": [0, 0]}}, r"team\.radios: \[0, 0\] names a radio twice"),
        ({"team": {"radios": [-1]}}, r"team\.radios\[0\]: -1 is not >= 0"),
        ({"team": {"groups": [{}, {"radios": [0, 2]}]}}, r"team\.groups\[1\]\.radios: .* radio 2, .* radios 0 to 1"),
        ({"team": {"radios": [1]}, "channel": {"kind": "ideal"}}, r"team\.radios: \[1\] names radio 1"),
        ({"channel": {"kind": "radios", "radios": []}}, r"channel\.radios: \[\]"),
        (
            {"channel": {"kind": "radios", "air": "shared", "radios": [{"kind": "ble"}]}},
            r"channel\.radios\[0\]\.propagation: is missing: a shared air needs a law, such as \{model: free_space\}",
        ),
        (
            {"channel": {"kind": "radios", "radios": [{"kind": "ble", "connection": {"interval_s": 5}}]}},
            r"channel\.radios\[0\]\.connection: connection interval: 5000 ms is not a multiple of 1\.25 ms from",
        ),
        (
            {"channel": {"kind": "radios", "radios": [TWO]}},
            r"channel\.radios\[0\]\.kind: 'radios' is not a channel for one radio",
        ),
        ({"channel": {"kind": "radios", "radios": [{**SHORT, "range_m": -1}]}}, r"channel\.radios\[0\]\.range_m: -1"),
        ({"faults": [off(0.1, None, 2)]}, r"faults\[0\]\.radio: 2 is none of the radios of robot 0: 0"),
        ({"faults": [off(0.1, None, 1)]}, r"faults\[0\]\.radio: 1 is none of the radios of robot 0: 0"),
        ({"faults": [jammer(2)]}, r"faults\[0\]\.radio: 2 is none of the radios of the channel: 0, 1"),
    ],
)
def test_a_scenario_that_names_radios_that_are_not_there_is_refused_with_the_path(changes: Any, said: str) -> None:
    plain = {"duration_s": 1.0, "protocol": {"use": "tests.faults.fault_scene:SPEC"}, "channel": TWO}
    build(plain, "depot.yaml", Path())
    with pytest.raises(UserError, match=f"^depot.yaml: {said}"):
        build(plain | changes, "depot.yaml", Path())


def test_robots_have_the_radios_of_their_group_or_else_the_teams() -> None:
    team = {"groups": [{"size": 2, "radios": [0, 1]}, {"size": 1}, {"size": 1, "radios": [1]}]}
    floor = {"map": "walls", "bounds_m": [0, 0, 20, 20]}
    use = {"use": "tests.faults.fault_scene:SPEC"}
    plain = {"duration_s": 1.0, "protocol": use, "channel": TWO, "team": team, "floorplan": floor}
    assert build(plain, "depot.yaml", Path()).team.carried == (BOTH, BOTH, FIRST, (1,))
    assert Simulation(build(plain, "depot.yaml", Path()), 1).channel.carried(3) == (1,)


LACKING = {"radios": [1]}


@pytest.mark.parametrize(
    ("team", "said"),
    [
        (LACKING, r"team\.radios: \[1\] lacks radio 0, by which the robots of gathering send"),
        ({"groups": [{"size": 2}, LACKING]}, r"team\.groups\[1\]\.radios: \[1\] lacks radio 0"),
        (LACKING | {"groups": [{"radios": [0]}, {}]}, r"team\.radios: \[1\] lacks radio 0"),
    ],
)
def test_robots_without_the_radio_of_their_protocol_are_refused(team: Any, said: str) -> None:
    plain = {"duration_s": 1.0, "protocol": {"use": "gathering"}, "channel": TWO, "team": team}
    with pytest.raises(UserError, match=f"^depot.yaml: {said}"):
        build(plain, "depot.yaml", Path())
    build(plain | {"team": LACKING | {"groups": [{"radios": [0, 1]}]}}, "depot.yaml", Path())


def test_rows_that_come_in_bulk_have_the_number_of_their_radio_and_what_is_under_way_too() -> None:
    field = Field((BOTH, BOTH, FIRST), tables=(TRANSMISSIONS, RECEPTIONS, INTERVALS))
    for radio in BOTH:
        field.send(MS, 0, Outgoing(1, b"to one", 1, radio))
    field.kernel.run(MS + 600_000)
    under_way = {(each.robot, each.radio, each.state) for each in field.channel.under_way(field.kernel.now)}
    assert under_way >= {(0, 0, "awaits_ack"), (0, 1, "awaits_ack")}
    field.kernel.run(S)
    field.channel.close(S)
    for name in ("transmissions", "receptions"):
        columns = field.trace.columns(name)
        rows = list(zip(columns["source"], columns["radio"], strict=True))
        assert rows.count((0, 0)) > 0
        assert rows.count((0, 1)) > 0
    columns = field.trace.columns("intervals")
    rows = set(zip(columns["robot"], columns["radio"], columns["state"], strict=True))
    assert {(0, 0, "backoff"), (0, 1, "backoff")} <= rows
    assert not any((robot, radio) == (2, 1) for robot, radio, _ in rows)  # it has no such radio
