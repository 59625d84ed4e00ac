"""The process that holds bodies, world and judge of a live run, and those of its robots.

It advances a simulation to what the wall clock shows, whenever an event of it is due or a machine has reported. In it a
machine is represented by a :class:`Remote`, which passes on what it is told, and leaves what has been reported. A robot
whose process ends, whoever has ended it, is dead.
"""

import multiprocessing
import pickle
import socket
import time
import warnings
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from select import select
from typing import Any, Final

from cosim.channels.ideal import IdealSettings
from cosim.channels.radios import RadiosSettings
from cosim.errors import LocalProtocolError, UserError
from cosim.faults.events import Killed, events_of
from cosim.kernel import DELIVER, FAULT
from cosim.live.apart import check_apart
from cosim.live.loopback import LoopbackSettings
from cosim.live.robot import (
    HOST,
    Answer,
    Begin,
    End,
    Failed,
    Handed,
    Host,
    News,
    Report,
    Sensed,
    Told,
    Typed,
    bound_socket,
)
from cosim.machine import OPERATOR, Address, Drains, LinkEvent, Machine, Reception
from cosim.node import Node
from cosim.observation import Observation, Seen
from cosim.scenario import Scenario
from cosim.simulation import Outcome, Simulation
from cosim.trace import Table, Trace, events_table
from cosim.units import MS, S, Time, to_seconds

MOST_ROBOTS: Final = 64
"""The most processes that are started."""
LEAD: Final[Time] = 50 * MS
"""From when all robots are told when the run begins, until it does."""
PATIENCE_S: Final = 0.05
"""The longest wait of the team's process."""
HANDING_S: Final = 5.0
"""How long robots may take to hand back their machines."""
UNHELD: Final = ("crash", "clock_step", "wall", "jammer")
"""Faults that a process, its clock, or its copy of the floor cannot have."""

Tell = Callable[[str], None]
"""Takes what a person is told meanwhile, a line."""


def live(scenario: Scenario, seed: int, tell: Tell) -> Outcome:
    """Make a run of *scenario* on the wall clock, with a process for each machine, and return its outcome.

    Raise UserError for a scenario that cannot be live, and LocalProtocolError if a machine fails.
    """
    ideal = _ideal(scenario)
    check_apart(scenario.model_copy(update={"channel": ideal}), seed)
    loopback = scenario.model_copy(update={"channel": LoopbackSettings(ideal=ideal)})
    simulation = Simulation(loopback, seed, trace=partial(_mortal, scenario))
    team = Team(simulation, tell)
    try:
        team.play()
        return simulation.outcome()
    finally:
        team.end()


def _ideal(scenario: Scenario) -> IdealSettings:
    """Return the ideal channel whose links *scenario* has live; raise UserError for one that cannot be."""
    if scenario.team.size > MOST_ROBOTS:
        raise UserError(f"team.size: {scenario.team.size} is not <= {MOST_ROBOTS}, the most processes that are started")
    for number, fault in enumerate(scenario.faults):
        if fault.kind in UNHELD:
            raise UserError(f"faults[{number}].kind: {fault.kind!r} does not happen live, expected kill and the like")
    channel = scenario.channel
    if isinstance(channel, RadiosSettings):
        raise UserError("channel.kind: 'radios' has several, and UDP is one")
    if isinstance(channel, IdealSettings) and (channel.loss or channel.jitter_s):
        flaw = "loss" if channel.loss else "jitter_s"
        raise UserError(f"channel.{flaw}: {getattr(channel, flaw):g} is not 0: UDP has its own")
    range_m = channel.range_m if isinstance(channel, IdealSettings) else None
    return IdealSettings(range_m=range_m)


def _mortal(scenario: Scenario, tables: Sequence[Table]) -> Trace:
    """Return the trace of a run with these *tables*, the first that of events, in which every robot can be killed."""
    events = dict.fromkeys((*scenario.protocol.spec.events, *events_of(scenario.faults), Killed))
    return Trace((events_table(tuple(events)), *tables[1:]))


class Remote(Drains):
    """What stands in the simulation for a machine that is a process."""

    def __init__(self, robot: Address, simulation: Simulation, pipe: Connection, finished: bool) -> None:
        super().__init__()
        self.finished = finished
        self.missed = 0
        """Number of ticks of which it has not been told, as its process did not keep up."""
        self._robot = robot
        self._simulation = simulation
        self._pipe = pipe
        self.gone = False
        """True if its process has ended."""
        self._waiting: deque[Told] = deque()
        self._tick = -1

    def receive(self, data: bytes, reception: Reception, now: Time) -> bool:
        """Pass on what was typed at the console."""
        assert reception.source == OPERATOR, "payloads go by UDP"
        self._tell(Typed(data))
        return False

    def link(self, event: LinkEvent, now: Time) -> None:
        """Pass on news."""
        self._tell(News(event))

    def observe(self, observation: Observation, now: Time) -> bool:
        """Pass on what the robot senses, unless its process still has to take what it was told before."""
        self._tick = now // self._simulation.scenario.tick
        if self.flush():
            self._tell(self._sensed(observation))
        else:
            self.missed += not self.gone
        return False

    def wake(self, now: Time) -> None:
        """Do nothing: the process minds its deadlines."""

    def wake_at(self) -> Time | None:
        """Return None: the process minds its deadlines."""
        return None

    def take(self, report: Report) -> None:
        """Leave what the process has reported in the queues."""
        self.finished = report.finished
        self._events += report.events
        self._outbox += report.items
        self._commands += report.commands

    def flush(self) -> bool:
        """Pass on what could not be passed on before; return whether that is all."""
        while self._room() and self._waiting:
            self._put(self._waiting.popleft())
        return not self._waiting and self._room()

    def _tell(self, told: Told) -> None:
        self._waiting.append(told)
        self.flush()

    def _room(self) -> bool:
        return not self.gone and bool(select([], [self._pipe], [], 0)[1])

    def _put(self, told: Told) -> None:
        try:
            self._pipe.send(told)
        except (BrokenPipeError, ConnectionResetError):  # the team finds that by itself, and says so
            self.gone = True

    def _sensed(self, observation: Observation) -> Sensed:
        senses, spec = self._simulation.senses, self._simulation.spec
        seen = Seen()
        if spec.needs_sight or spec.needs_view:
            seen = Seen(observation.visible, observation.sightings)
        poses = None if senses is None or observation.view is None else senses.poses
        peers = self._simulation.channel.in_reach(self._robot)
        return Sensed(tuple(observation[:6]), seen, poses, self._tick, peers)


class Team:
    """The processes of a run's machines, and the simulation of all else."""

    def __init__(self, simulation: Simulation, tell: Tell) -> None:
        """Start a process for each machine of *simulation*, which has not begun."""
        self._simulation = simulation
        self._tell = tell
        self._begun_ns = 0
        self._pipes: dict[Address, Connection] = {}
        self._processes: list[BaseProcess] = []
        self._remotes: list[Remote] = []
        sockets = [bound_socket() for _ in simulation.nodes]
        self._ports = [each.getsockname()[1] for each in sockets]
        try:
            for node in simulation.nodes:
                self._start(node, sockets)
        except BaseException:
            self.end()
            raise
        finally:
            for each in sockets:
                each.close()

    def _start(self, node: Node, sockets: list[socket.socket]) -> None:
        simulation, robot = self._simulation, node.address
        machine: Machine = simulation.machines[robot]
        ours, theirs = multiprocessing.Pipe()
        radios = simulation.channel.carried(robot)

        def drive() -> None:
            # a robot that held the team's ends would wait for ever to write to a team that is gone
            for each in (*self._pipes.values(), ours):
                each.close()
            Host(robot, machine, simulation.senses, radios, sockets, theirs).run()

        process = multiprocessing.get_context("fork").Process(target=drive, daemon=True)
        with warnings.catch_warnings():  # of threads of libraries, which wait in no lock that a machine needs
            warnings.simplefilter("ignore", DeprecationWarning)
            process.start()
        theirs.close()
        self._pipes[robot] = ours
        self._processes.append(process)
        remote = Remote(robot, simulation, ours, machine.finished)
        self._remotes.append(remote)
        node.machine = remote

    def play(self) -> None:
        """Make the run, and take back the machines of those who live; what the dead have counted is lost."""
        simulation = self._simulation
        simulation.begin()
        self._begun_ns = time.monotonic_ns() + LEAD
        for robot, pipe in self._pipes.items():
            pipe.send(Begin(self._begun_ns, simulation.channel.in_reach(robot)))
        for robot, (process, port) in enumerate(zip(self._processes, self._ports, strict=True)):
            self._tell(f"robot {robot}: process {process.pid}, UDP {HOST}:{port}")
        self._tell(f"for at most {simulation.scenario.duration_s:g} s; Ctrl-C ends all")
        while not simulation.advance(self._now()):
            self._bury()
            for remote in self._remotes:
                remote.flush()
            self._listen()
        self._bury()
        self._take_back()
        for robot, remote in enumerate(self._remotes):
            if remote.missed:
                self._tell(f"robot {robot} has not kept up: it was not told of {remote.missed} ticks")

    def end(self) -> None:
        """End all processes."""
        for process in self._processes:
            if process.is_alive():
                process.kill()
            process.join()
        for pipe in self._pipes.values():
            pipe.close()
        self._pipes.clear()

    def _now(self) -> Time:
        return max(0, min(time.monotonic_ns() - self._begun_ns, self._simulation.scenario.duration))

    def _bury(self) -> None:
        """End the processes of robots that a fault has killed."""
        for node, process in zip(self._simulation.nodes, self._processes, strict=True):
            if not node.alive and not self._remotes[node.address].gone:
                process.kill()
                self._remotes[node.address].gone = True
                self._tell(f"robot {node.address} at {to_seconds(self._now()):.3f} s: process {process.pid} is killed")

    def _listen(self) -> None:
        """Wait until the simulation has to go on, and take what robots report meanwhile."""
        due, _ = self._simulation.kernel.peek()
        left_s = (min(due, self._simulation.scenario.duration) - self._now()) / S
        ready: list[Any] = wait(list(self._pipes.values()), min(max(left_s, 0.0), PATIENCE_S))
        for robot, pipe in list(self._pipes.items()):
            if pipe in ready:
                self._read(robot, pipe)

    def _read(self, robot: Address, pipe: Connection) -> None:
        try:
            while pipe.poll():
                self._heard(robot, pipe.recv())
        except (EOFError, ConnectionResetError):
            self._remotes[robot].gone = True
            del self._pipes[robot]
            pipe.close()
            if self._simulation.nodes[robot].alive:
                self._tell(f"robot {robot} at {to_seconds(self._now()):.3f} s: its process has ended")
                self._at(self._now(), partial(self._simulation.faults.kill, robot), FAULT)

    def _heard(self, robot: Address, answer: Answer) -> None:
        match answer:
            case Report():
                self._at(answer.at, partial(self._act, robot, answer), DELIVER)
            case Handed(machine):
                self._simulation.machines[robot] = pickle.loads(machine)
            case Failed(why):
                raise LocalProtocolError(why)

    def _act(self, robot: Address, report: Report) -> None:
        node = self._simulation.nodes[robot]
        if node.alive:
            self._remotes[robot].take(report)
            node.drain(self._simulation.kernel.now)

    def _at(self, then: Time, callback: Callable[[], None], priority: int) -> None:
        """Have the simulation call *callback* at *then*, or at once if it is beyond that."""
        kernel = self._simulation.kernel
        kernel.at(max(then, kernel.now + 1), callback, priority)

    def _take_back(self) -> None:
        """Have the living hand back their machines."""
        until_ns = time.monotonic_ns() + round(HANDING_S * S)
        alive = {node.address for node in self._simulation.nodes if node.alive}
        asked = {robot: pipe for robot, pipe in self._pipes.items() if robot in alive}
        for robot, pipe in asked.items():
            self._remotes[robot].flush()
            try:
                pipe.send(End())
            except OSError:  # it has ended in the last moment
                continue
            while pipe.poll(max(0.0, (until_ns - time.monotonic_ns()) / S)):
                try:
                    answer = pipe.recv()
                except (EOFError, ConnectionResetError):
                    break
                if not isinstance(answer, Report):
                    self._heard(robot, answer)
                    break
