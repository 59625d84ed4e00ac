"""Robots whose radios are weaker, or stronger, than those of the rest: who hears whom, what is acknowledged, errors."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from cosim.errors import UserError
from cosim.kernel import WORLD, Kernel
from cosim.machine import (
    BROADCAST,
    Address,
    Connected,
    Disconnect,
    Discovered,
    Fate,
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
    Sniff,
    SwitchRole,
)
from cosim.randomness import Streams
from cosim.scenario import Scenario, build
from cosim.simulation import Simulation, make_channel
from cosim.trace import FRAMES, Trace
from cosim.units import MS, S, Time
from cosim.world.floorplan import load_floorplan
from tests.faults.fault_scene import scenario

ADHOC, IDEAL = {"kind": "adhoc", "range_m": 50.0}, {"kind": "ideal", "range_m": 50.0}
FADING = {"kind": "adhoc", "propagation": {"model": "log_distance", "exponent": 3.0}}
NARROW = pytest.mark.parametrize("channel", [ADHOC, IDEAL], ids=["adhoc", "ideal"])
WEAK, OTHERS = {"size": 1, "reach_m": 5.0}, {"size": 2}
INQUIRY, SNIFF = Inquire(S, 9), Sniff(0, 100, 0, 2)
PLACES_M = ((0.0, 0.0), (5.0, 0.0), (30.0, 0.0))


class Host:
    def __init__(self) -> None:
        self.heard: list[tuple[Address, bytes]] = []
        self.events: list[LinkEvent] = []

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        self.heard.append((reception.source, data))

    def link(self, event: LinkEvent, now: Time) -> None:
        self.events.append(event)

    def drain(self, now: Time) -> None:
        pass


class Field:
    """Robots of a scenario's team, wherever they are, and the channel between them."""

    def __init__(self, team: dict[str, Any], channel: dict[str, Any], *places_m: tuple[float, float]) -> None:
        made = scenario(channel=channel, size=len(places_m), team=team)
        self.kernel, self.trace = Kernel(), Trace((FRAMES,))
        floor = load_floorplan(made.floorplan, Path())
        self.channel = make_channel(made.channel, made.team, self.kernel, self.trace, Streams(3), floor)
        self.hosts = [Host() for _ in places_m]
        for address, host in enumerate(self.hosts):
            self.channel.attach(address, host)
        self.channel.moved(np.array(places_m))

    def send(self, at: Time, source: Address, destination: Address, data: bytes = b"hi", token: int | None = 7) -> None:
        self.kernel.at(at, lambda: self.channel.send(source, Outgoing(destination, data, token)), WORLD)

    def told(self, source: Address, command: LinkCommand) -> tuple[list[LinkEvent], ...]:
        """Return what all hosts are told when *source* commands that."""
        for host in self.hosts:
            host.events.clear()
        self.channel.command(source, command)
        self.kernel.run(self.kernel.now + S)
        return tuple(list(host.events) for host in self.hosts)

    def frames(self) -> list[tuple[Address, Address, str, str]]:
        columns = self.trace.columns("frames")
        return list(zip(*(columns[name] for name in ("source", "destination", "kind", "outcome")), strict=True))


def field(channel: dict[str, Any], places_m: Sequence[tuple[float, float]] = PLACES_M) -> Field:
    """Return robots of which the first one is weak."""
    return Field({"groups": [WEAK, {"size": len(places_m) - 1}]}, channel, *places_m)


# ---------------------------------------------------------------- reaches


@NARROW
def test_a_robot_with_a_short_reach_is_heard_as_far_as_that_and_hears_from_far(channel: dict[str, Any]) -> None:
    air = field(channel)
    assert [air.channel.in_reach(robot) for robot in range(3)] == [(1,), (0, 2), (0, 1)]
    for robot in range(3):
        air.send((1 + 10 * robot) * MS, robot, BROADCAST, bytes([robot]))
    air.kernel.run(S)
    assert [[source for source, _ in host.heard] for host in air.hosts] == [[1, 2], [0, 2], [1]]
    air.channel.moved(np.array([(0.0, 0.0), (5.001, 0.0), (30.0, 0.0)]))
    assert air.channel.in_reach(0) == ()


@NARROW
def test_a_robot_with_a_long_reach_is_heard_beyond_the_channels_range(channel: dict[str, Any]) -> None:
    air = Field({"groups": [{"reach_m": 80.0}, {}]}, channel, (0, 0), (80, 0))
    assert [air.channel.in_reach(robot) for robot in range(2)] == [(1,), ()]


@pytest.mark.parametrize("kind", ["adhoc", "ideal"])
def test_a_reach_limits_a_robot_on_a_channel_without_a_range(kind: str) -> None:
    air = field({"kind": kind}, ((0, 0), (5, 0), (9000, 0)))
    assert [air.channel.in_reach(robot) for robot in range(3)] == [(1,), (0, 2), (0, 1)]
    air.send(MS, 0, BROADCAST)
    air.kernel.run(S)
    received = [(source, receiver) for source, receiver, _, outcome in air.frames() if outcome == "received"]
    assert received == [(0, 1)]


@pytest.mark.parametrize("retries", [7, 3])
def test_a_weak_robot_receives_from_far_but_its_acknowledgements_do_not_come_back(retries: int) -> None:
    air = field(ADHOC | {"short_retries": retries})
    air.send(MS, 2, 0)
    air.kernel.run(S)
    assert air.hosts[0].heard == [(2, b"hi")], "once, however often it is sent"
    assert air.hosts[2].events == [Fate(7, Outcome.UNACKNOWLEDGED)]
    assert air.frames() == [(2, 0, "DATA", "received"), (0, 2, "ACK", "out_of_range")] * retries
    assert air.channel.summary() == {"frames_sent": 2.0 * retries, "payloads_dropped": 1.0}


def test_what_a_weak_robot_sends_to_who_is_far_is_tried_to_the_limit_and_near_it_is_acknowledged() -> None:
    air = field(ADHOC)
    air.send(MS, 0, 2, token=1)
    air.send(500 * MS, 0, 1, token=2)
    air.send(600 * MS, 1, 0, token=3)
    air.kernel.run(S)
    assert [host.heard for host in air.hosts] == [[(1, b"hi")], [(0, b"hi")], []]
    assert air.hosts[0].events == [Fate(1, Outcome.UNACKNOWLEDGED), Fate(2, Outcome.DELIVERED)]
    assert air.hosts[1].events == [Fate(3, Outcome.DELIVERED)]
    expected = [(0, 2, "DATA", "out_of_range")] * 7
    for one, other in ((0, 1), (1, 0)):
        expected += [(one, other, "DATA", "received"), (other, one, "ACK", "received")]
    assert air.frames() == expected


@pytest.mark.parametrize("jitter_s", [0.0, 0.01])
def test_an_ideal_sender_learns_of_an_arrival_only_from_who_reaches_it(jitter_s: float) -> None:
    air = field(IDEAL | {"jitter_s": jitter_s})
    for token, (source, destination) in enumerate([(2, 0), (0, 2), (1, 0), (0, 1), (2, BROADCAST)]):
        air.send((1 + 200 * token) * MS, source, destination, bytes([token]), token)
    air.kernel.run(S)
    assert [host.heard for host in air.hosts] == [
        [(2, b"\0"), (1, b"\2"), (2, b"\4")],
        [(0, b"\3"), (2, b"\4")],
        [],
    ]
    assert air.hosts[2].events == [Fate(0, Outcome.UNACKNOWLEDGED), Fate(4, Outcome.SENT)]
    assert air.hosts[0].events == [Fate(1, Outcome.NO_LINK), Fate(3, Outcome.DELIVERED)]
    assert air.hosts[1].events == [Fate(2, Outcome.DELIVERED)]


def test_who_is_not_heard_does_not_keep_others_from_sending() -> None:
    """A weak robot's frame is noticed near it only: a far one sends meanwhile, and spoils it between them."""
    air = field(ADHOC)
    air.send(MS, 0, BROADCAST, bytes(1000))
    air.send(2 * MS, 2, BROADCAST, bytes(1000))
    air.kernel.run(S)
    assert [len(host.heard) for host in air.hosts] == [0, 0, 0]
    air.channel.moved(np.array([(0.0, 0.0), (5.0, 0.0), (4.0, 3.0)]))  # 5 m: it waits
    air.send(S + MS, 0, BROADCAST, bytes(1000))
    air.send(S + 2 * MS, 2, BROADCAST, bytes(1000))
    air.kernel.run(2 * S)
    assert [len(host.heard) for host in air.hosts] == [1, 2, 1]


@NARROW
def test_reaches_like_the_channels_range_change_nothing(channel: dict[str, Any]) -> None:
    def run(team: dict[str, Any]) -> Simulation:
        made = scenario(channel=channel | {"range_m": 4.5}, size=5, team=team, far_m=2.0, meet=True, tokens=True)
        ran = Simulation(made, 1, [FRAMES])
        ran.run()
        return ran

    plain, alike, weaker = run({}), run({"reach_m": 4.5}), run({"reach_m": 4.5, "groups": [WEAK | {"size": 5}]})
    assert plain.trace.count("frames") > 300
    assert plain.trace.digest(["frames"]) == alike.trace.digest(["frames"]) != weaker.trace.digest(["frames"])


# ---------------------------------------------------------------- links


@pytest.mark.parametrize("channel", [ADHOC, IDEAL, FADING], ids=["adhoc", "ideal", "fading"])
def test_links_are_between_robots_that_hear_each_other(channel: dict[str, Any]) -> None:
    """With -20 dBm, exponent 3 and -82 dBm to be detected one is heard as far as 5.3 m, with 15 dBm 78 m."""
    group = {"power_dbm": -20.0} if channel is FADING else {"reach_m": 5.3}
    air = Field({"groups": [group, OTHERS]}, channel, *PLACES_M)
    assert [air.channel.in_reach(robot) for robot in range(3)] == [(1,), (0, 2), (0, 1)]
    assert air.told(2, INQUIRY) == ([], [], [Discovered(1), InquiryComplete((1,))])
    assert air.told(0, INQUIRY) == ([Discovered(1), InquiryComplete((1,))], [], [])
    assert air.told(2, Page(0)) == ([], [], [PageFailed(0)])
    assert air.told(0, Page(2)) == ([PageFailed(2)], [], [])
    assert air.told(2, SNIFF) == ([], [], [ModeChanged(0, Mode.NONE)])
    assert air.told(2, SwitchRole(0)) == ([], [], [ModeChanged(0, Mode.NONE)])
    assert air.told(1, Page(0)) == ([Connected(1, Role.SLAVE)], [Connected(0, Role.MASTER)], [])
    assert air.told(1, SwitchRole(0)) == ([RoleChanged(1, Role.MASTER)], [RoleChanged(0, Role.SLAVE)], [])
    assert air.told(2, Disconnect(0)) == ([], [], [])
    assert air.told(1, Page(0)) == ([Connected(1, Role.SLAVE)], [Connected(0, Role.MASTER)], [])
    air.channel.moved(np.array([(0.0, 0.0), (5.5, 0.0), (30.0, 0.0)]))
    assert air.told(2, INQUIRY)[:2] == ([Lost(1)], [Lost(0)])


# ---------------------------------------------------------------- powers


def reach_of(power_dbm: float) -> float:
    """Invert power - (40.2 dB + 30 dB log10 d) = -82 dBm, from which on frames are noticed; 12 dB above the noise."""
    loss_db = power_dbm + 82.0
    return float(10 ** ((loss_db - 40.2) / 30))


@pytest.mark.parametrize("power_dbm", [None, 5.0, 0.0, -10.0])
def test_a_frame_is_noticed_as_far_as_the_law_says_for_the_senders_power(power_dbm: float | None) -> None:
    far_m, weak_m = reach_of(15.0), reach_of(15.0 if power_dbm is None else power_dbm)
    for share, heard in ((0.999, True), (1.001, False)):
        air = Field({"groups": [{"power_dbm": power_dbm}, {}]}, FADING, (0, 0), (share * weak_m, 0))
        air.send(MS, 0, BROADCAST)
        air.kernel.run(S)
        assert (len(air.hosts[1].heard) == 1) is heard
        air = Field({"groups": [{"power_dbm": power_dbm}, {}]}, FADING, (0, 0), (share * far_m, 0))
        air.send(MS, 1, BROADCAST)
        air.kernel.run(S)
        assert (len(air.hosts[0].heard) == 1) is heard


def test_the_teams_power_is_that_of_groups_without_and_goes_before_the_channels() -> None:
    team = {"power_dbm": 5.0, "groups": [{}, {"power_dbm": 0.0}]}
    for distance_m, expected in ((0.99 * reach_of(0.0), [(1,), (0,)]), (0.99 * reach_of(5.0), [(1,), ()])):
        air = Field(team, FADING, (0, 0), (distance_m, 0))
        assert [air.channel.in_reach(robot) for robot in range(2)] == expected
    assert Field(team, FADING, (0, 0), (1.01 * reach_of(5.0), 0)).channel.in_reach(0) == ()


@pytest.mark.slow
def test_ten_db_less_of_power_and_of_path_loss_let_the_same_frames_through_the_noise() -> None:
    """What noise spoils depends on the power that arrives, here 3.9 dB below the noise, where some frames get through.

    Free space: 15 dBm - 40.2 dB - 20 log10 d = noise - 3.9 dB.
    """
    law = {"kind": "adhoc", "propagation": {"model": "free_space"}, "detection_dbm": -120.0}
    noise_dbm = -174.0 + 10 * np.log10(22e6) + 7.0
    distance_m = 10 ** ((15.0 - 40.2 - noise_dbm + 3.9) / 20)

    def arrived(team: dict[str, Any], at_m: float) -> list[bytes]:
        air = Field(team, law, (0, 0), (at_m, 0))
        for number in range(200):
            air.send(number * 10 * MS, 0, BROADCAST, number.to_bytes(500, "big"))
        air.kernel.run(4 * S)
        return [data for _, data in air.hosts[1].heard]

    plain = arrived({}, distance_m)
    assert 20 < len(plain) < 180
    assert arrived({"groups": [{"power_dbm": 5.0}, {}]}, distance_m / 10**0.5) == plain
    assert arrived({"groups": [{}, {"power_dbm": 5.0}]}, distance_m) == plain, "the receiver's power does not matter"
    assert arrived({"groups": [{"power_dbm": 5.0}, {}]}, distance_m) == []


def test_a_robot_of_little_power_receives_but_is_never_acknowledged() -> None:
    air = Field({"groups": [{"power_dbm": -20.0}, {}]}, FADING, (0, 0), (30, 0))
    air.send(MS, 1, 0)
    air.kernel.run(S)
    assert air.hosts[0].heard == [(1, b"hi")]
    assert air.hosts[1].events == [Fate(7, Outcome.UNACKNOWLEDGED)]
    data, acks = ([row for row in air.frames() if row[2] == kind] for kind in ("DATA", "ACK"))
    assert data == [(1, 0, "DATA", "received")] * 7
    assert [outcome == "received" for *_, outcome in acks] == [False] * 7


# ---------------------------------------------------------------- several radios

MIXED = """
duration_s: 1.0
protocol: {use: "tests.faults.fault_scene:SPEC"}
floorplan: {map: walls, bounds_m: [0, 0, 60, 10]}
channel:
  kind: radios
  radios:
    - {kind: adhoc, range_m: 50, host_jitter_s: 0.05}
    - {kind: adhoc, propagation: {model: log_distance, exponent: 3.0}}
    - {kind: ideal, range_m: 50}
    - {kind: bluetooth, range_m: 50}
team:
  radios: [0, 1, 2, 3]
  starts: [[1, 5], [5, 5], [31, 5]]
  groups: [{reach_m: 5, power_dbm: -20}, {size: 1, reach_m: 27}, {power_dbm: -20}]
"""


def test_each_radio_of_a_robot_takes_of_its_group_what_it_can_use() -> None:
    run = Simulation(build(yaml.safe_load(MIXED), "mixed.yaml", Path()), 1)
    run.run()
    reached = [[part.in_reach(robot) for robot in range(3)] for part in run.channel.parts]
    assert reached[0] == reached[2] == [(1,), (0, 2), (0, 1)]
    assert reached[1] == [(1,), (0, 2), ()]
    assert reached[3] == [(1, 2), (0, 2), (0, 1)]
    # they call by radio 0 at every tick
    heard = [{source for _, source in machine.heard} for machine in run.machines]  # type: ignore[attr-defined]
    assert heard == [{1, 2}, {0, 2}, {1}]


# ---------------------------------------------------------------- routes

ONE_WAY_M = ((0.0, 0.0), (8.0, 0.0), (10.0, 10.0), (20.0, 0.0))
"""0 and 3 reach each other over 1, which 3 does not hear, or over 2."""


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["flooding", "aodv", "olsr"])
@pytest.mark.parametrize("ends", [(0, 3), (3, 0)])
def test_payloads_find_a_way_round_a_robot_that_is_not_heard(kind: str, ends: tuple[Address, Address]) -> None:
    hello = {"use_hello": True} if kind == "aodv" else {}
    channel = {"kind": "adhoc", "range_m": 15.0, "routing": {"kind": kind, **hello}}
    air = Field({"groups": [{}, {"reach_m": 10.0}, {"size": 2}]}, channel, *ONE_WAY_M)
    assert [air.channel.in_reach(robot) for robot in range(4)] == [(1, 2), (0,), (0, 1, 3), (1, 2)]
    source, destination = ends
    for number in range(30):  # so seldom that routes have been forgotten
        air.send(10 * (number + 3) * S, source, destination, bytes([number]), number)
        air.send(10 * (number + 3) * S + 300 * MS, source, 1, b"for who hears", 100 + number)
    air.kernel.run(350 * S)
    arrived = [data[0] for sender, data in air.hosts[destination].heard if sender == source]
    assert len(arrived) == len(set(arrived)), "none twice"
    if kind == "flooding":  # 2 does not hear 1: now and then both pass on at once, and 0 gets neither
        assert len(arrived) > 20
    else:
        assert arrived == list(range(30))
    fates = [event.token for event in air.hosts[source].events if isinstance(event, Fate)]
    assert sorted(fates) == [*range(30), *range(100, 130)], "each is told once what has become of it"
    if (kind, source) == ("aodv", 3):
        assert (1, 3, "DATA", "out_of_range") in air.frames(), "1 has passed a request on, and a reply in vain"


# ---------------------------------------------------------------- settings

RADIOS = {"kind": "radios", "radios": [ADHOC, FADING, {"kind": "bluetooth"}]}


@pytest.mark.parametrize(
    ("channel", "team", "said"),
    [
        (FADING, {"groups": [{}, {"reach_m": 5}]}, "team.groups[1].reach_m: 5.0 is given, but their radios are not"),
        (FADING, {"reach_m": 5}, "team.reach_m: 5.0 is given, but their radios are not ideal, or adhoc without prop"),
        ({"kind": "bluetooth"}, {"groups": [{"reach_m": 5}]}, "team.groups[0].reach_m: 5.0 is given, but"),
        ({"kind": "bluetooth"}, {"groups": [{"power_dbm": 5}]}, "team.groups[0].power_dbm: 5.0 is given, but"),
        ({"kind": "bluetooth", "propagation": {}}, {"power_dbm": 5}, "team.power_dbm: 5.0 is given, but"),
        ({"kind": "optical"}, {"groups": [{"reach_m": 5}]}, "team.groups[0].reach_m: 5.0 is given, but"),
        (
            ADHOC,
            {"groups": [{"power_dbm": 0}]},
            "team.groups[0].power_dbm: 0.0 is given, but their radios are not adho",
        ),
        (IDEAL, {"power_dbm": 5}, "team.power_dbm: 5.0 is given, but their radios are not adhoc with propagation"),
        (RADIOS, {"groups": [{"reach_m": 5, "radios": [1, 2]}]}, "team.groups[0].reach_m: 5.0 is given, but"),
        (RADIOS, {"groups": [{"radios": [1]}, {"power_dbm": 5}]}, "team.groups[1].power_dbm: 5.0 is given, but"),
        (RADIOS, {"radios": [2], "power_dbm": 5}, "team.power_dbm: 5.0 is given, but"),
        (RADIOS, {"radios": [3], "power_dbm": 5}, "team.radios: [3] names radio 3"),
        (ADHOC, {"groups": [{"reach_m": 0}]}, "team.groups[0].reach_m: 0 is not > 0"),
        (ADHOC, {"reach_m": -1}, "team.reach_m: -1 is not > 0"),
        (FADING, {"groups": [{"power_dbm": float("nan")}]}, "team.groups[0].power_dbm: nan is not a finite number"),
    ],
)
def test_what_no_radio_can_use_is_refused_where_it_stands(channel: Any, team: Any, said: str) -> None:
    plain = {"duration_s": 1.0, "protocol": {"use": "tests.faults.fault_scene:SPEC"}, "channel": channel, "team": team}
    with pytest.raises(UserError, match=f"^depot.yaml: {re.escape(said)}"):
        build(plain, "depot.yaml", Path())


def test_groups_have_their_own_powers_and_reaches_or_the_teams() -> None:
    team = {"power_dbm": 5.0, "reach_m": 30.0, "groups": [{"power_dbm": 0.0}, {"size": 2}, {"reach_m": 3.0}]}
    made = scenario(channel=RADIOS, size=4, team=team | {"radios": [0, 1]})
    assert made.team.powers_dbm == (0.0, 5.0, 5.0, 5.0)
    assert made.team.reaches_m == (30.0, 30.0, 30.0, 3.0)
    assert Scenario.model_validate(made.model_dump()) == made
    plain = scenario(size=2).team
    assert (plain.powers_dbm, plain.reaches_m) == ((None,) * 2,) * 2
