"""One run: a scenario and a seed in, metrics, a trace and its digest out.

The world's tick is the only place where the control loop closes. Its order (design: ARGoS, one phase order a tick):
advance lazy channel models, apply the commands given since the last tick, move and collide, mark gains stale, sense,
observe. Everything else happens between ticks, when frames arrive or deadlines come.
"""

import gc
import hashlib
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Final

from cosim.beliefs import Beliefs
from cosim.channels.base import WHY_UNSENT, Channel
from cosim.channels.kinds import ChannelSettings, ChannelSite, channel_spec
from cosim.channels.radios import RadiosSettings, with_radio
from cosim.errors import LocalProtocolError, UserError
from cosim.faults.course import Faults, Victims
from cosim.faults.events import events_of
from cosim.faults.settings import FrozenSettings, MovedSettings
from cosim.kernel import DELIVER, WORLD, Kernel
from cosim.machine import OPERATOR, Address, Command, GoTo, Machine, Reception
from cosim.node import Node, Notices, Said
from cosim.observation import Observation
from cosim.present import Present
from cosim.protocol import Metric, ProtocolSpec, Referee, Surroundings
from cosim.randomness import Streams
from cosim.robots.motion import Fleet
from cosim.robots.pictures import Sightlines, pictures
from cosim.robots.placement import checked_starts, misfit
from cosim.robots.senses import WORLD_FRAME, Frame, Senses
from cosim.robots.trajectories import Paths, load_paths
from cosim.scenario import Scenario, TeamSettings
from cosim.series import MetricSeries
from cosim.trace import ENERGY, POSES, Table, Trace, events_table
from cosim.units import Time, to_seconds
from cosim.world.floorplan import Floorplan, load_floorplan

METRICS: Final = (
    Metric("simulated_s", "s", "simulated time at which the run ended"),
    Metric("distance_m", "m", "driven by all robots together"),
    Metric("kernel_events", "1", "events that the kernel executed"),
    Metric("robots_killed", "1", "robots that a fault has killed"),
    Metric("payloads_unsent", "1", "payloads that were never on the air: no link, no route, too long, or no room"),
)
NO_OUTCOME: Final = {"kernel_events", "payloads_unsent"}
"""Metrics that say how a run went, not what came out of it: its digest does not depend on them."""
TOLD_SHARE: Final = 0.01
"""If more of the payloads than this share were never on the air, the person who has started the run is told."""
MOST_NAMED: Final = 3
"""The most senders that are named with that."""

OBJECTS_A_ROBOT: Final = 20
"""How many objects for each robot may come to be before Python looks for garbage that only the collector can free."""


@dataclass(frozen=True)
class Outcome:
    """What came out of a run."""

    metrics: dict[str, float]
    digest: str
    """Hash of the metrics and of the protocol's events: equal for equal scenario and seed, wherever it runs."""
    trace: Trace
    simulated_s: float
    metric_columns: tuple[Metric, ...]
    notices: tuple[str, ...] = ()
    """What whoever has started the run is to be told of it, a line each: first of payloads, then in order of time."""


def simulate(scenario: Scenario, seed: int, tables: Sequence[Table] = ()) -> Outcome:
    """Run *scenario* with *seed*, keeping *tables* in the trace besides the protocol's events.

    Raise UserError for input that cannot be set up.
    """
    return Simulation(scenario, seed, tables).run()


class Simulation:
    """One run while it is set up and executed."""

    def __init__(
        self,
        scenario: Scenario,
        seed: int,
        tables: Sequence[Table] = (),
        trace: Callable[[Sequence[Table]], Trace] = Trace,
    ) -> None:
        """Set up a run that keeps *tables* besides the protocol's events in what *trace* makes for them."""
        self.scenario = scenario
        self.spec: ProtocolSpec = scenario.protocol.spec
        self.kernel = Kernel()
        if isinstance(scenario.channel, RadiosSettings):
            tables = with_radio(tables)
        self.trace = trace((events_table((*self.spec.events, *events_of(scenario.faults))), *tables))
        self.floorplan: Floorplan = load_floorplan(scenario.floorplan, scenario.folder)
        streams = Streams(seed)
        parameters = scenario.protocol.parameters
        self._paths = self._followed()
        surroundings = self._surroundings(parameters, streams)
        setup = self.spec.prepare(parameters, surroundings)
        bodies, walls = scenario.team.bodies, self.floorplan.grid
        self.fleet = Fleet(bodies, surroundings.starts_m, walls, scenario.tick, paths=self._paths)
        self.senses = self._senses(surroundings, streams)
        self.channel = make_channel(scenario.channel, scenario.team, self.kernel, self.trace, streams, self.floorplan)
        self.referee: Referee = self.spec.referee(parameters, setup, surroundings)
        self.machines: list[Machine] = [
            self.spec.make(parameters, setup, robot, streams("machine", robot), self.kernel.now)
            for robot in range(scenario.team.size)
        ]
        self._cable: list[Said] = []
        self._notices = Notices(self.spec.notices)
        # a referee without ears for events, as those written before there were any, is told none
        listeners = (self._notices, self.referee) if hasattr(self.referee, "note") else (self._notices,)
        self.nodes = [
            Node(robot, machine, self.kernel, self.channel, self.trace, self._cable, listeners)
            for robot, machine in enumerate(self.machines)
        ]
        for node in self.nodes:
            self.channel.attach(node.address, node)

        def boot(robot: Address, boots: int, now: Time) -> Machine:
            stream = streams("machine", robot, "boot", boots)
            before, machine = self.machines[robot], self.spec.make(parameters, setup, robot, stream, now)
            if self.spec.succeed is not None:
                self.spec.succeed(before, machine, self.kernel.now)
            self.machines[robot] = machine
            return machine

        victims = Victims(self.nodes, self.channel, self.fleet, self.senses, self.floorplan, boot)
        self.faults = Faults(scenario.faults, self.kernel, victims, self.trace, streams)
        self.faults.schedule(scenario.duration)
        self._series = MetricSeries(self.trace, self.spec, self.referee, self.faults.energy_j)
        self.over = False
        """Nothing more happens: all machines have finished, the referee has ended the run, or its time is over."""
        self.attended = False
        """Somebody sits at a console: the run goes on when all machines have finished, or its time is over."""
        self._distance_m = 0.0
        self._poses_wanted = self.trace.wants(POSES)
        self._beliefs = Beliefs(self.trace, self.spec.believes, self.senses, surroundings.frames)

    def run(self) -> Outcome:
        """Execute the run: until all machines have finished, the referee ends it, or its time is over."""
        self.begin()
        self.advance(self.scenario.duration)
        return self.outcome()

    def begin(self) -> None:
        """Have the kernel begin with the first tick as soon as it runs: for those who run it themselves."""
        self.channel.moved(self.fleet.positions_m)
        self.kernel.at(0, self._first_tick, WORLD)

    def advance(self, until: Time) -> bool:
        """Execute the part of the run before *until*, after ``begin``, and return whether the run is over.

        The parts of a run together are what ``run`` does at once.
        """
        if not self.over:
            with _rarely_collecting(OBJECTS_A_ROBOT * len(self.nodes)):
                self.kernel.run(until if self.attended else min(until, self.scenario.duration))
            self.over = self.over or (self.kernel.now >= self.scenario.duration and not self.attended)
        return self.over

    @property
    def present(self) -> Present:
        """What has begun and is not over now."""
        now, channel = self.kernel.now, self.channel
        under_way = [*channel.under_way(now), *self.faults.under_way(now)]
        return Present(now, under_way, channel.held(now), channel.flying(now))

    def operate(self, robot: Address, payload: bytes) -> None:
        """Hand *payload* to the machine of *robot* by the cable of its console, as soon as the run goes on.

        Raise LocalProtocolError for a robot that the team does not have.
        """
        if not 0 <= robot < len(self.nodes):
            raise LocalProtocolError(f"robot {robot} has no console: the team has robots 0 to {len(self.nodes) - 1}")
        node = self.nodes[robot]

        def deliver() -> None:
            now = self.kernel.now
            node.receive(payload, Reception(OPERATOR, False), now)
            node.drain(now)

        self.kernel.after(1, deliver, DELIVER)

    def said(self) -> list[Said]:
        """Drain what machines have told the operators at their consoles, in the order in which they did."""
        drained = self._cable.copy()
        self._cable.clear()
        return drained

    def _surroundings(self, parameters: Any, streams: Streams) -> Surroundings:
        scenario, floor = self.scenario, self.floorplan
        kinds = [(channel_spec(each.kind), each) for each in scenario.radios]
        bodies = scenario.team.bodies
        radii_m = tuple(body.radius_m for body in bodies)
        speeds_mps = tuple(body.speed_mps for body in bodies)
        accelerations_mps2 = tuple(body.acceleration_mps2 for body in bodies)
        surroundings = Surroundings(
            starts_m=(),
            radius_m=max(radii_m),
            speed_mps=min(speeds_mps),
            acceleration_mps2=min(accelerations_mps2),
            tick=scenario.tick,
            walls_m=floor.walls_m,
            bounds_m=floor.bounds_m,
            forbidden=floor.forbidden,
            radii_m=radii_m,
            speeds_mps=speeds_mps,
            accelerations_mps2=accelerations_mps2,
            places_m=floor.places_m,
            scan_range_m=scenario.team.senses.beam_range_m,
            beams=scenario.team.senses.beams,
            radios=scenario.team.carried,
            links=tuple(kind.links(settings) for kind, settings in kinds),
            payload_bytes=tuple(kind.payload_bytes(settings) for kind, settings in kinds),
            shares=tuple(kind.shares(settings) for kind, settings in kinds),
            odometry_errs=scenario.team.senses.drifts,
            fits=lambda place_m, radius_m: misfit(place_m, radius_m, floor) is None,
        )
        starts, giver = scenario.team.starts, "team.starts"
        if starts is None:
            starts = tuple(self.spec.place(parameters, surroundings, scenario.team.size, streams("placement")))
            giver = f"protocol {self.spec.name}: place()"
            if len(starts) != scenario.team.size:
                raise LocalProtocolError(f"{giver} returns {len(starts)} starts, expected {scenario.team.size}")
        guided = {} if self._paths is None else self._paths.starts_m
        starts = tuple(guided.get(robot, start) for robot, start in enumerate(starts))
        checked_starts(starts, radii_m, floor, giver, guided)
        return surroundings._replace(
            starts_m=tuple(starts), frames=_frames(scenario, starts, streams), seed=streams.seed
        )

    def _followed(self) -> Paths | None:
        """Return the paths that robots follow, if there are any; raise UserError for a fault that would keep them."""
        scenario, name = self.scenario, self.scenario.team.trajectories
        if name is None:
            return None
        paths = load_paths(name, scenario.folder, range(scenario.team.size), self.floorplan.bounds_m)
        for number, fault in enumerate(scenario.faults):
            if isinstance(fault, FrozenSettings | MovedSettings) and fault.robot in paths.starts_m:
                raise UserError(f"faults[{number}].robot: {fault.robot} follows a path, and is never {fault.kind}")
        return paths

    def _senses(self, surroundings: Surroundings, streams: Streams) -> Senses | None:
        team = self.scenario.team
        if not self.spec.needs_view and team.senses.frames == "world":
            return None
        range_m = team.sight_range_m or float("inf")
        bodies = surroundings.radii_m, surroundings.frames
        return Senses(team.senses, self.floorplan.packed, *bodies, range_m, self.scenario.tick, streams)

    def _first_tick(self) -> None:
        for node in self.nodes:
            node.drain(0)
        self._ticks = self.kernel.every(self.scenario.tick, self._tick, WORLD)
        self._sense(0)

    def _tick(self) -> None:
        now = self.kernel.now
        self.channel.advance(now)
        self._apply()
        self._distance_m += self.fleet.step()
        self.channel.moved(self.fleet.positions_m)
        self._sense(now)

    def _sense(self, now: Time) -> None:
        if self._poses_wanted:
            for robot, (x, y, heading, *_) in enumerate(self.fleet.observed.tolist()):
                self.trace.row(POSES, now, robot, x, y, heading)
        for node, observation in zip(self.nodes, self._observations(), strict=True):
            node.observe(observation, now)
        if self._beliefs.wanted:
            self._beliefs.note(self.machines, [node.alive for node in self.nodes], now)
        for death in self.faults.deaths():
            self.referee.died(death)
        over = self.referee.look(self.fleet.x_m, self.fleet.y_m, now)
        self._series.look(now)
        if over or not self._anybody_busy():
            self._ticks.cancel()
            self.over = True
            self.kernel.stop()

    def _anybody_busy(self) -> bool:
        if self.attended:
            return True
        for node in self.nodes:  # asked every tick: an expression takes three times as long
            if node.alive and not node.machine.finished:
                return True
        return self.faults.reboots_pending

    def _observations(self) -> list[Observation]:
        if self.senses is not None:
            return self.senses.observe(self.fleet)
        if not self.spec.needs_sight:
            return self.fleet.observations()
        range_m = self.scenario.team.sight_range_m or float("inf")
        seen = Sightlines(self.floorplan.packed, self.fleet.positions_m, range_m, self.faults.blind)
        return self.fleet.observations(pictures(seen, len(self.fleet)))

    def _apply(self) -> None:
        """Have the bodies carry out what their machines have commanded since the last tick, each in its own frame."""
        orders: list[tuple[Address, Command]] = []
        for node in self.nodes:
            if node.motion:
                for command in node.motion:
                    if isinstance(command, GoTo) and self.senses is not None:
                        command = self.senses.in_world(node.address, command)
                    orders.append((node.address, command))
                node.motion.clear()
        if orders:
            self.fleet.apply(orders)

    @property
    def metric_columns(self) -> tuple[Metric, ...]:
        """The metrics of the run, which are known before it."""
        return (*METRICS, *self.spec.metrics, *self.channel.columns, *self.faults.columns)

    def outcome(self) -> Outcome:
        """Return the metrics, the trace and the digest of the run up to now; to be asked once, at its end."""
        now = self.kernel.now
        simulated_s = to_seconds(now)
        self.channel.advance(now)
        self.channel.close(now)
        self.faults.close(now)
        for death in self.faults.deaths(run_is_over=True):
            self.referee.died(death)
        verdict = self.referee.verdict(now)
        self._series.note(verdict, now)
        metrics = {
            "simulated_s": simulated_s,
            "distance_m": self._distance_m,
            "kernel_events": float(self.kernel.executed),
            "robots_killed": float(self.faults.killed),
            "payloads_unsent": float(sum(self.channel.unsent.values())),
            **_own_metrics(self.spec, self.spec.measure(self.machines), verdict),
        }
        summary, spent = self.channel.summary(), self.faults.summary()
        twice = sorted(metrics.keys() & (summary | spent).keys())
        if twice:
            other = "its channel" if twice[0] in summary else "a battery"
            raise LocalProtocolError(f"{self.spec.name} and {other} both have a metric {twice[0]}")
        undeclared = sorted(summary.keys() - {metric.name for metric in self.channel.columns})
        if undeclared:
            kind = self.scenario.channel.kind
            raise LocalProtocolError(f"channel {kind}: summary returns {undeclared[0]!r}, which is none of its metrics")
        metrics |= summary | spent
        self._note_energy(now)
        spared = NO_OUTCOME | self.channel.uses | spent.keys()
        counted = {name: value for name, value in metrics.items() if name not in spared}
        content = repr(sorted(counted.items())) + self.trace.digest(["events"])  # the same whatever else is kept
        digest = hashlib.sha256(content.encode()).hexdigest()
        notices = (*self._unsent(), *self._notices.texts)
        return Outcome(metrics, digest, self.trace, simulated_s, self.metric_columns, notices)

    def _note_energy(self, now: Time) -> None:
        """Write what radios and batteries have used."""
        if not self.trace.wants(ENERGY):
            return
        used_j = self.faults.used_j()
        for robot in range(len(self.nodes)):
            for part, joules in used_j.get(robot, {}).items():
                self.trace.row(ENERGY, now, robot, -1, part, "", None, joules)
            for radio in self.channel.carried(robot):
                accounts = self.channel.parts[radio].accounts
                for row in () if accounts is None else accounts.rows(robot, now):
                    self.trace.row(ENERGY, now, robot, radio, *row)

    def _unsent(self) -> list[str]:
        """Return a line for each reason why payloads were never on the air, if that has happened often."""
        unsent, sent = self.channel.unsent, sum(node.payloads for node in self.nodes)
        if sum(unsent.values()) <= TOLD_SHARE * sent:
            return []
        lines = []
        for why in sorted({why for _, why in unsent}):
            count = {robot: number for (robot, reason), number in sorted(unsent.items()) if reason is why}
            most = sorted(count, key=lambda robot: -count[robot])[:MOST_NAMED]
            senders = ", ".join(f"robot {robot}: {count[robot]}" for robot in most)
            rest = "" if len(most) == len(count) else f" and {len(count) - len(most)} more"
            share = f"{sum(count.values())} of {sent} payloads were never on the air ({senders}{rest})"
            lines.append(f"{share}: {WHY_UNSENT[why]}")
        return lines


@contextmanager
def _rarely_collecting(objects: int) -> Iterator[None]:
    """Let at least so many *objects* come to be before Python's collector of cycles looks at them.

    It begins with the 700th by default, where a tick of thousands of robots makes more observations than that, which
    are gone at the next without it: a quarter of such a run was spent on looking at them.
    """
    young, *older = gc.get_threshold()
    gc.set_threshold(max(young, objects) if young else 0, *older)
    try:
        yield
    finally:
        gc.set_threshold(young, *older)


def _own_metrics(spec: ProtocolSpec, measured: dict[str, float], judged: dict[str, float]) -> dict[str, float]:
    """Return what the machines and the referee have counted.

    Raise LocalProtocolError unless these are the metrics of *spec*, each once and each a number or NaN.
    """
    declared = {metric.name for metric in spec.metrics}
    for teller, metrics in (("measure", measured), ("the referee", judged)):
        for name, value in metrics.items():
            if name not in declared:
                raise LocalProtocolError(f"{spec.name}: {teller} returns {name!r}, which is no metric of the spec")
            if not isinstance(value, int | float) or math.isinf(value):
                raise LocalProtocolError(f"{spec.name}: {teller} returns {name} = {value!r}, expected a number or NaN")
    for name in sorted(declared):
        if (name in measured) + (name in judged) != 1:
            tellers = "both measure and the referee return" if name in measured else "neither of them returns"
            raise LocalProtocolError(f"{spec.name}, measure and the referee: {tellers} the metric {name}")
    return measured | judged


def _frames(scenario: Scenario, starts: Sequence[tuple[float, float]], streams: Streams) -> tuple[Frame, ...]:
    """Return each robot's own frame: the world, or where it starts, turned by any angle."""
    if scenario.team.senses.frames == "world":
        return (WORLD_FRAME,) * len(starts)
    turns = frame_turns(scenario, streams)
    return tuple((x, y, turn) for (x, y), turn in zip(starts, turns, strict=True))


def frame_turns(scenario: Scenario, streams: Streams) -> list[float]:
    """Return the angle (rad) by which each robot's own frame is turned against the world's in the beginning."""
    if scenario.team.senses.frames == "world":
        return [0.0] * scenario.team.size
    return [float(streams("frame", robot).uniform(-math.pi, math.pi)) for robot in range(scenario.team.size)]


def make_channel(
    settings: ChannelSettings, team: TeamSettings, kernel: Kernel, trace: Trace, streams: Streams, floor: Floorplan
) -> Channel:
    """Return the channel of one run, of the kind that *settings* are of."""
    site = ChannelSite(
        kernel=kernel,
        trace=trace,
        streams=streams,
        size=team.size,
        walls=floor.grid,
        wall_loss_db=floor.wall_loss_db,
        packed=floor.packed,
        carried=team.carried,
        powers_dbm=team.powers_dbm,
        reaches_m=team.reaches_m,
        power_classes=team.power_classes,
    )
    return channel_spec(settings.kind).make(settings, site)
