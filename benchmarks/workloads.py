"""The work that ``make bench`` measures; each function sets up and returns what is to be timed."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import experiments
from benchmarks.exchange import LANES
from cosim.channels.bluetooth.device import BluetoothChannel
from cosim.channels.bluetooth.settings import BluetoothSettings
from cosim.kernel import WORLD, Kernel
from cosim.machine import (
    BROADCAST,
    Connected,
    GoTo,
    Inquire,
    InquiryComplete,
    LinkEvent,
    Outgoing,
    Page,
    Reception,
    Role,
    Scan,
)
from cosim.node import Node
from cosim.randomness import Streams
from cosim.robots.body import BodySettings
from cosim.robots.motion import Fleet
from cosim.scenario import Scenario
from cosim.simulation import Simulation
from cosim.trace import Trace
from cosim.units import MS, S, Time
from cosim.world.floorplan import FloorplanSettings, load_floorplan

Work = Callable[[], float]
"""What is timed; it returns how many of the measured things it has done."""
FLOORS = Path(next(iter(experiments.__path__))) / "floors"
TICK: Time = 100 * MS


class Host:
    """An endpoint that takes everything and wants nothing."""

    def __init__(self) -> None:
        self.connected: list[int] = []
        self.received = 0
        self.inquiries = 0

    def receive(self, data: bytes, reception: Reception, now: Time) -> bool:
        self.received += 1
        return False

    def link(self, event: LinkEvent, now: Time) -> None:
        if isinstance(event, Connected) and event.role is Role.MASTER:
            self.connected.append(event.peer)
        self.inquiries += isinstance(event, InquiryComplete)

    def drain(self, now: Time) -> None:
        pass


class Counter(Host):
    """Passes everything on to a node, and counts the payloads."""

    def __init__(self, node: Node) -> None:
        super().__init__()
        self._node = node
        self.link = node.link  # type: ignore[assignment,method-assign]
        self.drain = node.drain  # type: ignore[method-assign]

    def receive(self, data: bytes, reception: Reception, now: Time) -> bool:
        self.received += 1
        return self._node.receive(data, reception, now)


class Traffic:
    """Robots that drive from wall to wall on the storey."""

    def __init__(self, seed: int) -> None:
        floor = load_floorplan(FloorplanSettings(map="storey.yaml"), FLOORS)
        self.stream = np.random.default_rng(seed)
        x_min, y_min, x_max, y_max = floor.bounds_m
        self._bounds = (x_min, y_min), (x_max, y_max)
        grid = [(x_min + (x_max - x_min) * (i + 0.5) / 8, (y_min + y_max) / 2) for i in range(8)]
        self.fleet = Fleet([BodySettings(drive="grid")] * 8, grid, floor.grid, TICK)
        self._goals()

    def _goals(self) -> None:
        goals = self.stream.uniform(*self._bounds, size=(8, 2)).tolist()
        self.fleet.apply((robot, GoTo(*goal)) for robot, goal in enumerate(goals))

    def tick(self) -> None:
        if self.stream.random() < 0.02:
            self._goals()
        self.fleet.step()


def robot_ticks(seed: int) -> Work:
    """Ticks of the world with robots that drive and observe."""
    traffic, kernel, ticks = Traffic(seed), Kernel(), 2_000

    def tick() -> None:
        traffic.tick()
        traffic.fleet.observations()

    kernel.every(TICK, tick, WORLD)

    def work() -> float:
        kernel.run(ticks * TICK)
        return ticks * 8

    return work


def _piconet(seed: int, floor: Any = None, **settings: object) -> tuple[Kernel, BluetoothChannel, list[Host]]:
    """Return a connected piconet of eight devices in reach of each other."""
    kernel = Kernel()
    plain = BluetoothSettings.model_validate(settings)
    channel = BluetoothChannel(plain, kernel, Trace(), 8, Streams(seed), floor)
    channel.moved(np.array([begin for begin, _ in LANES]))
    hosts = [Host() for _ in range(8)]
    for address, host in enumerate(hosts):
        channel.attach(address, host)
        if address:
            channel.command(address, Scan(enabled=True))
    for peer in range(1, 8):
        channel.command(0, Page(peer))
        while len(hosts[0].connected) < peer:
            kernel.run(kernel.now + S)
    return kernel, channel, hosts


class Shuttles:
    """*size* robots that drive to and fro without end, each in its lane."""

    def __init__(self, size: int = 8) -> None:
        floor = load_floorplan(FloorplanSettings(map="storey.yaml"), FLOORS)
        self.floor = floor.grid, floor.wall_loss_db
        self.fleet = Fleet([BodySettings(drive="grid")] * size, [begin for begin, _ in LANES[:size]], floor.grid, TICK)
        self._ticks = 0

    def tick(self) -> None:
        if self._ticks % 97 == 0:  # 4.5 m at 0.5 m/s and 1 m/s2 take 95 ticks
            end = (self._ticks // 97 + 1) % 2
            self.fleet.apply(
                (robot, GoTo(*lane[end])) for robot, lane in enumerate(LANES[: len(self.fleet.positions_m)])
            )
        self._ticks += 1
        self.fleet.step()


def idle_hours(seed: int, seconds: int = 3600, **settings: object) -> Work:
    """*seconds* of a connected piconet in which nobody says anything while its robots drive, ten world ticks each."""
    shuttles = Shuttles()
    kernel, channel, _ = _piconet(seed, shuttles.floor, **settings)

    def tick() -> None:
        channel.advance(kernel.now)
        shuttles.tick()
        channel.moved(shuttles.fleet.positions_m)

    kernel.every(TICK, tick, WORLD)

    def work() -> float:
        kernel.run(kernel.now + seconds * S)
        channel.summary()  # what has been put off until somebody looks is part of the cost
        return seconds / 3600

    return work


def idle_fading_hours(seed: int) -> Work:
    """A minute of it where signals fade with distance and walls, so that every tick changes all gains."""
    return idle_hours(seed, 60, propagation={}, power_class=1)


def exchanged_states(seed: int) -> Work:
    """A whole run: eight robots drive, observe, and tell each other their states once a second; per frame delivered."""
    scenario = Scenario.model_validate(
        {
            "name": "exchange",
            "duration_s": 3600,
            "floorplan": {"map": "storey.yaml"},
            "team": {"size": 8, "body": {"drive": "grid"}},
            "channel": {"kind": "bluetooth"},
            "protocol": {"use": "benchmarks.exchange:SPEC"},
        }
    ).placed(FLOORS)
    simulation, seconds = Simulation(scenario, seed), 120
    kernel, machines = simulation.kernel, simulation.machines
    simulation.begin()
    while machines[0].linked < 7:  # type: ignore[attr-defined]
        kernel.run(kernel.now + S)

    def received() -> int:
        return sum(machine.received for machine in machines)  # type: ignore[attr-defined]

    def work() -> float:
        before = received()
        kernel.run(kernel.now + seconds * S)
        return received() - before

    return work


def inquiries(seed: int) -> Work:
    """Inquiries of 10.24 s that never have enough."""
    kernel = Kernel()
    channel = BluetoothChannel(BluetoothSettings(), kernel, Trace(), 8, Streams(seed))
    host = Host()
    for address in range(8):
        channel.attach(address, host if not address else Host())
        if address:
            channel.command(address, Scan(enabled=True))
    count = 10

    def work() -> float:
        for done in range(count):
            channel.command(0, Inquire(10 * S + 240 * MS, 8))
            while host.inquiries <= done:
                kernel.run(kernel.now + S)
        return count

    return work


def broadcasts(seed: int) -> Work:
    """Broadcasts of 9 bytes, one every ten milliseconds, counted once for each slave that gets them."""
    kernel, channel, hosts = _piconet(seed)
    count = 2_000
    left = [count]

    def send() -> None:
        channel.send(0, Outgoing(BROADCAST, bytes(9)))
        left[0] -= 1
        if left[0]:
            kernel.after(10 * MS, send)

    kernel.after(10 * MS, send)
    before = sum(host.received for host in hosts)

    def work() -> float:
        kernel.run(kernel.now + (count + 10) * 10 * MS)
        return sum(host.received for host in hosts) - before

    return work


def pseudonet_messages(seed: int) -> Work:
    """A whole coverage run of eight robots over Bluetooth, per payload that reached a machine."""
    counters: list[Counter] = []
    scenario = Scenario.model_validate(
        {
            "name": "bench",
            "duration_s": 90,
            "floorplan": {"map": "storey.yaml"},
            "team": {"size": 8, "body": {"drive": "grid"}},
            "channel": {"kind": "bluetooth"},
            "protocol": {"use": "pseudonet", "parameters": {"algorithm": "spanning_tree"}},
        }
    ).placed(FLOORS)
    simulation = Simulation(scenario, seed)
    for node in simulation.nodes:
        simulation.channel.attach(node.address, counter := Counter(node))
        counters.append(counter)

    def work() -> float:
        simulation.run()
        return sum(counter.received for counter in counters)

    return work
