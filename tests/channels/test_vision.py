"""The optical channel: who is in sight gets it, after the time that it takes."""

from typing import Any

import numpy as np
import pytest

from cosim.channels.vision import OpticalChannel, OpticalSettings
from cosim.geometry.segments import packed_walls, segment_grid
from cosim.kernel import WORLD, Kernel
from cosim.machine import (
    BROADCAST,
    Connected,
    Discovered,
    Fate,
    Inquire,
    Lost,
    Outcome,
    Outgoing,
    Page,
    Reception,
)
from cosim.scenario import Scenario
from cosim.simulation import simulate
from cosim.trace import FRAMES, Trace
from cosim.units import MS, US, S, Time

WALL = [[2.0, -1.0, 2.0, 1.0]]


class Host:
    def __init__(self) -> None:
        self.received: list[tuple[Time, int, bytes, bool]] = []
        self.events: list[Any] = []

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        self.received.append((now, reception.source, data, reception.broadcast))

    def link(self, event: Any, now: Time) -> None:
        self.events.append(event)

    def drain(self, now: Time) -> None:
        pass


class Field:
    """Robots at *places* on a floor with *walls*."""

    def __init__(self, *places: tuple[float, float], walls: Any = (), **settings: Any) -> None:
        self.kernel, self.trace = Kernel(), Trace((FRAMES,))
        grid = packed_walls(segment_grid(np.array(walls, dtype=float).reshape(-1, 4)))
        self.channel = OpticalChannel(OpticalSettings(**settings), self.kernel, self.trace, len(places), grid)
        self.hosts = [Host() for _ in places]
        for address, host in enumerate(self.hosts):
            self.channel.attach(address, host)
        self.channel.moved(np.array(places, dtype=float))

    def move_at(self, time: Time, *places: tuple[float, float]) -> None:
        self.kernel.at(time, lambda: self.channel.moved(np.array(places, dtype=float)), WORLD)

    def send(self, source: int, destination: int, length: int = 10, token: int | None = None) -> None:
        self.channel.send(source, Outgoing(destination, bytes(length), token))

    def who_got(self) -> list[int]:
        return [address for address, host in enumerate(self.hosts) if host.received]


def test_a_broadcast_reaches_those_in_sight_and_range_and_nobody_else() -> None:
    field = Field((0, 0), (1, 0), (4, 0), (0, 3), (0, 3.2), walls=WALL, range_m=3.1)
    field.send(0, BROADCAST)
    field.kernel.run(1 * S)
    assert field.who_got() == [1, 3]
    assert field.channel.in_reach(0) == (1, 3)
    assert field.channel.in_reach(4) == (3,)


def test_without_a_rate_everything_arrives_after_the_latency() -> None:
    field = Field((0, 0), (1, 0), latency_s=2e-6)
    for _ in range(3):
        field.send(0, 1)
    field.kernel.run(1 * S)
    assert [time for time, *_ in field.hosts[1].received] == [2 * US] * 3


def test_a_sender_sends_one_payload_after_the_other_at_its_rate_and_senders_do_not_wait_for_each_other() -> None:
    field = Field((0, 0), (1, 0), (0, 1), rate_bps=8_000, latency_s=0.04)
    field.send(0, 1, 100)
    field.send(0, BROADCAST, 50)
    field.send(1, 2, 10)
    field.kernel.run(1 * S)
    assert [time for time, *_ in field.hosts[1].received] == [140 * MS, 190 * MS]
    assert [(time, source) for time, source, *_ in field.hosts[2].received] == [(50 * MS, 1), (190 * MS, 0)]


def test_who_is_not_in_sight_at_the_beginning_or_at_the_arrival_gets_nothing() -> None:
    field = Field((0, 0), (1, 0), (4, 0), walls=WALL, rate_bps=8_000)
    field.send(0, BROADCAST, 100)  # until 100 ms
    field.move_at(50 * MS, (0, 0), (4, 0), (1, 0))
    field.kernel.run(1 * S)
    assert field.who_got() == []
    assert field.channel.summary() == {"frames_sent": 1.0, "frames_missed": 1.0}


def test_the_audience_of_a_payload_that_waits_is_looked_up_when_it_begins() -> None:
    field = Field((0, 0), (1, 0), (4, 0), walls=WALL, rate_bps=8_000)
    field.send(0, BROADCAST, 100)
    field.send(0, BROADCAST, 10)
    field.move_at(50 * MS, (0, 0), (4, 0), (1, 0))
    field.kernel.run(1 * S)
    assert [(address, len(host.received)) for address, host in enumerate(field.hosts)] == [(0, 0), (1, 0), (2, 1)]


def test_senders_learn_what_became_of_a_payload() -> None:
    field = Field((0, 0), (1, 0), (4, 0), walls=WALL, rate_bps=8_000)
    field.send(0, 1, 100, token=1)
    field.send(0, 2, 100, token=2)
    field.send(0, BROADCAST, 100, token=3)
    field.send(0, 1, 100, token=4)
    field.move_at(250 * MS, (0, 0), (4, 0), (1, 0))
    field.kernel.run(1 * S)
    assert field.hosts[0].events == [
        Fate(2, Outcome.NO_LINK),
        Fate(1, Outcome.DELIVERED),
        Fate(3, Outcome.SENT),
        Fate(4, Outcome.NO_LINK),
    ]


def test_links_are_lines_of_sight_and_end_with_them() -> None:
    field = Field((0, 0), (1, 0), (4, 0), walls=WALL)
    field.channel.command(0, Inquire(1 * S, 3))
    field.kernel.run(1 * MS)
    field.channel.command(0, Page(1))
    field.channel.command(0, Page(2))
    field.move_at(100 * MS, (0, 0), (4, 0), (1, 0))
    field.kernel.run(1 * S)
    kinds = [type(event).__name__ for event in field.hosts[0].events]
    assert kinds == ["Discovered", "InquiryComplete", "Connected", "PageFailed", "Lost"]
    assert [event.peer for event in field.hosts[0].events if isinstance(event, Discovered)] == [1]
    assert [type(event) for event in field.hosts[1].events] == [Connected, Lost]


def test_every_frame_is_recorded_for_everybody_in_sight_with_what_became_of_it() -> None:
    field = Field((0, 0), (1, 0), (0, 1), walls=WALL, rate_bps=8_000)
    field.send(0, BROADCAST, 100)
    field.move_at(50 * MS, (0, 0), (4, 0), (0, 1))
    field.kernel.run(1 * S)
    columns = field.trace.columns("frames")
    rows = zip(columns["destination"], columns["outcome"], columns["duration_ns"], strict=True)
    assert sorted(rows) == [(1, "out_of_range", 100 * MS + US), (2, "received", 100 * MS + US)]


def test_a_device_that_is_off_neither_sends_nor_receives() -> None:
    field = Field((0, 0), (1, 0), (0, 1), rate_bps=8_000)
    field.send(0, BROADCAST, 100)
    field.send(0, BROADCAST, 100)
    field.channel.power(2, False)
    field.kernel.at(50 * MS, lambda: field.channel.power(0, False))
    field.kernel.run(1 * S)
    assert field.who_got() == []
    assert field.channel.summary() == {"frames_sent": 1.0, "frames_missed": 2.0}


@pytest.mark.parametrize("on_again_ms", [16, 22, 40])
def test_who_is_switched_off_has_not_sent_what_is_not_at_its_end(on_again_ms: int) -> None:
    field = Field((0, 0), (1, 0), (0, 1), rate_bps=8_000, latency_s=0.005)
    field.send(0, BROADCAST, token=1)  # until 10 ms
    field.send(0, BROADCAST, token=2)  # until 20 ms
    field.send(1, 2, 18)
    field.kernel.at(12 * MS, lambda: field.channel.power(0, False))
    field.kernel.at(on_again_ms * MS, lambda: field.channel.power(0, True))
    field.kernel.run(1 * S)
    assert [(time, source) for time, source, *_ in field.hosts[1].received] == [(15 * MS, 0)]
    assert [(time, source) for time, source, *_ in field.hosts[2].received] == [(15 * MS, 0), (23 * MS, 1)]
    assert not [event for event in field.hosts[0].events if isinstance(event, Fate)], "what is off is told nothing"
    assert field.channel.summary() == {"frames_sent": 3.0, "frames_missed": 2.0}
    columns = field.trace.columns("frames")
    rows = zip(columns["time_ns"], columns["destination"], columns["outcome"], columns["duration_ns"], strict=True)
    assert sorted(rows) == [
        (0, 1, "received", 15 * MS),
        (0, 2, "received", 15 * MS),
        (0, 2, "received", 23 * MS),
        (10 * MS, 1, "out_of_range", 2 * MS),
        (10 * MS, 2, "out_of_range", 2 * MS),
    ]


def test_what_is_sent_to_its_end_arrives_whatever_becomes_of_its_sender_but_not_behind_walls() -> None:
    field = Field((0, 0), (1, 0), (1, 1), (0, 1), walls=WALL, rate_bps=8_000, latency_s=0.04)
    field.send(0, BROADCAST, token=1)
    field.kernel.at(10 * MS, lambda: field.channel.power(0, False))
    field.kernel.at(20 * MS, lambda: field.channel.power(3, False))
    field.move_at(30 * MS, (0, 0), (1, 0), (4, 0), (0, 1))
    field.kernel.run(1 * S)
    assert field.who_got() == [1]
    assert field.channel.summary() == {"frames_sent": 1.0, "frames_missed": 2.0}
    assert field.hosts[0].events == []


@pytest.mark.slow
def test_coverage_over_it_equals_that_over_the_ideal_channel_where_everybody_sees_everybody() -> None:
    def run(kind: str) -> dict[str, float]:
        scenario = Scenario.model_validate(
            {
                "duration_s": 2000,
                "floorplan": {"map": "walls", "bounds_m": [0, 0, 6, 5]},
                "team": {"size": 4},
                "channel": {"kind": kind},
                "protocol": {"use": "pseudonet", "parameters": {}},
            }
        )
        return simulate(scenario, 3).metrics

    ideal, optical = run("ideal"), run("optical")
    assert optical["coverage"] == 1.0
    assert {name: optical[name] for name in ideal} == ideal


def test_what_waits_at_a_device_that_is_switched_off_is_lost_also_when_it_is_on_again() -> None:
    field = Field((0.0, 0.0), (1.0, 0.0), rate_bps=8_000, latency_s=0.001)
    for payload in (b"a" * 10, b"b" * 10, b"c" * 10):  # 10 ms each
        field.channel.send(0, Outgoing(1, payload))
    field.kernel.at(15 * MS, lambda: field.channel.power(0, False))
    field.kernel.at(16 * MS, lambda: field.channel.power(0, True))
    field.kernel.at(17 * MS, lambda: field.channel.send(0, Outgoing(1, b"d" * 10)))
    field.kernel.run(S)
    assert [data[:1] for _, _, data, _ in field.hosts[1].received] == [b"a", b"d"]
    assert field.hosts[1].received[-1][0] == 28 * MS
