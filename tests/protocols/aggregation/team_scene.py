"""Search teams in tests: whole runs on a small floor, teams whose frames are passed by hand, and machines alone.

The floor is 20 m x 20 m: four rooms of 10 m x 10 m, with an opening of 4 m, or of 2 m, between neighbours.
"""

import heapq
import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cosim.machine import BROADCAST, Drive, GoTo, Machine, Outgoing, Reception
from cosim.observation import NOBODY, Observation, Seen, Sighting
from cosim.protocol import Surroundings
from cosim.randomness import Streams
from cosim.scenario import Scenario, build
from cosim.simulation import Outcome, Simulation
from cosim.units import MS, S, Time, to_seconds
from protocols.aggregation.frames import decode, encode
from protocols.aggregation.messages import Message
from protocols.aggregation.parameters import Parameters
from protocols.aggregation.setup import Setup
from protocols.aggregation.spec import SPEC

Point = tuple[float, float]
USE = "protocols.aggregation.spec:SPEC"
STRATEGIES = ("srp", "mrp", "mi", "mito", "random")
BOUNDS_M = (0.0, 0.0, 20.0, 20.0)
WALLS_M = [[10, 0, 10, 8], [10, 12, 10, 20], [0, 10, 4, 10], [6, 10, 14, 10], [16, 10, 20, 10]]
TARGETS_M = ((3.0, 3.0), (17.0, 3.0), (3.0, 17.0), (17.0, 17.0))
RADIUS_M, TICK = 0.2, 100 * MS
SHORT_M, LONG_M = 6.0, 60.0
"""Reach of the radios."""
SMALL: dict[str, Any] = {
    "targets": TARGETS_M,
    "camera_m": 6.0,
    "short_m": SHORT_M,
    "long_m": LONG_M,
    "host_speed_mps": 1.0,
    "cell_m": 0.25,
    "reconvene_s": 20.0,
    "sync_s": 20.0,
    "suspect_s": 4.0,
    "timeout_s_per_m2": 0.12,
    "lost_s": 60.0,
}
"""Parameters for this floor: with four targets a time-out of 12 s, enough for the way across and no shorter."""


# ---------------------------------------------------------------- whole runs


def ideal_radios(short_m: float = SHORT_M, long_m: float = LONG_M, **flaws: float) -> dict[str, Any]:
    """Return a channel of two radios with a reach, and with what other *flaws* the ideal channel knows."""
    return {"kind": "radios", "radios": [{"kind": "ideal", "range_m": reach, **flaws} for reach in (short_m, long_m)]}


def scenario(
    strategy: str = "mi",
    hosts: int = 2,
    searchers: int = 3,
    faults: Sequence[object] = (),
    channel: dict[str, Any] | None = None,
    duration_s: float = 1500.0,
    starts: Sequence[Point] | None = None,
    host_mps: float = 1.0,
    searcher_mps: float = 2.0,
    **parameters: Any,
) -> Scenario:
    """Return a search of the floor for the four targets."""
    groups = [
        {"size": hosts, "body": {"speed_mps": host_mps, "radius_m": RADIUS_M}, "radios": [0, 1]},
        {"size": searchers, "body": {"speed_mps": searcher_mps, "radius_m": RADIUS_M}, "radios": [0]},
    ]
    plain = {
        "duration_s": duration_s,
        "floorplan": {"map": "walls", "bounds_m": list(BOUNDS_M), "walls": WALLS_M},
        "team": {"groups": groups, "starts": starts},
        "channel": ideal_radios() if channel is None else channel,
        "faults": list(faults),
        "protocol": {"use": USE, "parameters": {"strategy": strategy, "hosts": hosts, **SMALL, **parameters}},
    }
    return build(plain, "small", Path())


class Run:
    """A whole run: its outcome, its machines, where everybody was at each tick, and what was noted."""

    def __init__(self, what: Scenario, seed: int = 1) -> None:
        simulation = Simulation(what, seed)
        self.places_m: list[list[Point]] = []
        sense = simulation._sense

        def watched(now: Time) -> None:
            self.places_m.append([(float(x), float(y)) for x, y in simulation.fleet.positions_m])
            sense(now)

        simulation._sense = watched  # type: ignore[method-assign]
        self.outcome: Outcome = simulation.run()
        self.machines: list[Any] = [*simulation.machines]
        self.setup: Setup = self.machines[0].setup
        self.duration_s = what.duration_s
        columns = self.outcome.trace.columns("events")
        self.rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
        for row in self.rows:
            row["s"] = to_seconds(row["time_ns"])

    def told(self, event: str, source: int | None = None) -> list[dict[str, Any]]:
        """Return the events of one kind, of one robot or of all; ``s`` is when they happened."""
        return [row for row in self.rows if row["event"] == event and source in (None, row["source"])]

    def times_s(self, event: str, source: int | None = None) -> list[float]:
        """Return when they happened."""
        return [row["s"] for row in self.told(event, source)]

    def way_m(self, robot: int, begin_s: float = 0.0, end_s: float = math.inf) -> float:
        """Return how far a robot has gone in a span."""
        places = [places[robot] for k, places in enumerate(self.places_m) if begin_s <= k / 10 <= end_s]
        return sum(math.dist(a, b) for a, b in pairwise(places))

    def place_m(self, robot: int, at_s: float) -> Point:
        """Return where a robot was at a tick."""
        return self.places_m[round(at_s * 10)][robot]

    @property
    def ended(self) -> bool:
        """Whether the run has ended by itself, with all targets known to all living hosts."""
        metrics = self.outcome.metrics
        return metrics["completed"] == 1.0 and self.outcome.simulated_s < self.duration_s

    def teams(self, dead: Sequence[int] = ()) -> dict[int, list[int]]:
        """Return in which hosts' lists each searcher is at the end, but for the *dead*."""
        hosts = [host for host in self.machines[: self.setup.hosts] if host.me not in dead]
        searchers = (robot for robot in range(self.setup.hosts, self.setup.size) if robot not in dead)
        return {each: [host.me for host in hosts if each in host.team.roster.members] for each in searchers}


def run(strategy: str = "mi", seed: int = 1, **options: Any) -> Run:
    """Run a search of the floor."""
    return Run(scenario(strategy, **options), seed)


# ---------------------------------------------------------------- machines without a simulator


def prepared(
    starts_m: Sequence[Point],
    strategy: str = "mi",
    hosts: int = 2,
    speeds_mps: Sequence[float] = (),
    beams: int = 0,
    **changes: Any,
) -> tuple[Parameters, Setup]:
    """Return parameters and knowledge of a team that starts at *starts_m* on the floor, with scanners of 8 m."""
    parameters = Parameters.model_validate({"strategy": strategy, "hosts": hosts, **SMALL, **changes})
    surroundings = Surroundings(
        starts_m=tuple(starts_m),
        radius_m=RADIUS_M,
        speed_mps=1.0,
        acceleration_mps2=1.0,
        tick=TICK,
        walls_m=np.array(WALLS_M, float),
        bounds_m=BOUNDS_M,
        forbidden=lambda points: np.zeros(len(points), bool),
        radii_m=(RADIUS_M,) * len(starts_m),
        speeds_mps=tuple(speeds_mps) or (1.0,) * hosts + (2.0,) * (len(starts_m) - hosts),
        scan_range_m=8.0,
        beams=beams,
    )
    return parameters, SPEC.prepare(parameters, surroundings)


class Sight:
    """A camera in the empty."""

    def __init__(self, range_m: float) -> None:
        self._range_m = range_m
        self.here: Point = (0.0, 0.0)

    def sees(self, points_m: Sequence[Point]) -> list[bool]:
        return [math.dist(point, self.here) <= self._range_m for point in points_m]

    def detects(self, marks_m: Sequence[Point], range_m: float) -> list[Point | None]:
        return [mark if math.dist(mark, self.here) <= min(range_m, self._range_m) else None for mark in marks_m]

    def ranges_m(self) -> Any:
        return np.full(72, math.inf)


class Said(NamedTuple):
    """What a machine has sent."""

    destination: int
    radio: int
    message: Message


class Alone:
    """One machine, with the world around it played by hand: time stands still unless it is told to go on."""

    def __init__(
        self, me: int, starts_m: Sequence[Point], start: Time = 0, made: Machine | None = None, **changes: Any
    ) -> None:
        """Make robot *me* at *start* and have it observe its start; *changes* as for ``prepared``."""
        self.parameters, self.setup = prepared(starts_m, **changes)
        self.me, self.now = me, start
        stream = Streams(1)("machine", me)
        self.machine: Any = made or SPEC.make(self.parameters, self.setup, me, stream, start)
        self.here: Point = starts_m[me]
        self.noted: list[Any] = []
        self.orders: list[Point] = []
        self.looks()

    def looks(self, here: Point | None = None, seen: Sequence[tuple[int, float, float]] = ()) -> list[Said]:
        """Have it observe that it is *here*, and that it sees robots; return what it says."""
        self.here = here or self.here
        view = Sight(self.parameters.camera_m)
        view.here = self.here
        sightings = tuple(Sighting(*each) for each in seen)
        visible = tuple(each.address for each in sightings)
        self.machine.observe(Observation(*self.here, 0.0, 0.0, True, False, Seen(visible, sightings), view), self.now)
        return self._left()

    def hears(self, sender: int, message: Message, broadcast: bool = False, radio: int = 0) -> list[Said]:
        """Have it receive a message; return what it says to that."""
        self.machine.receive(encode(sender, message), Reception(sender, broadcast, radio=radio), self.now)
        return self._left()

    def passes(self, seconds: float, walks: bool = False) -> list[Said]:
        """Let time pass, with a tick each 100 ms and what deadlines there are; it goes where it wants if it *walks*."""
        said: list[Said] = []
        end = self.now + round(seconds * S)
        while self.now < end:
            tick = self.now // TICK * TICK + TICK
            deadline = self.machine.wake_at()
            self.now = min(end, tick, max(deadline, self.now + 1) if deadline is not None else end)
            if deadline is not None and deadline <= self.now:
                self.machine.wake(self.now)
                said += self._left()
            if self.now == tick:
                said += self.looks(self._next() if walks else None)
        return said

    def goal_m(self) -> Point | None:
        """Return where it was sent last."""
        return self.orders[-1] if self.orders else None

    def _next(self) -> Point:
        goal = self.goal_m() or self.here
        return _toward(self.here, goal, self.setup.speeds_mps[self.me] * 0.1)

    def _left(self) -> list[Said]:
        self.noted += self.machine.events()
        self.orders += [_order(command, self.here) for command in self.machine.commands()]
        return [Said(item.destination, item.radio, decode(item.payload)[1]) for item in self.machine.outbox()]


def _order(command: GoTo | Drive, here: Point) -> Point:
    """Return where a robot is sent: who is told to stand is sent to where it is."""
    if isinstance(command, GoTo):
        return command.x_m, command.y_m
    assert command.speed_mps == 0.0  # nobody is in anybody's way here
    return here


def _toward(here: Point, goal: Point, step_m: float) -> Point:
    apart = math.dist(here, goal)
    if apart <= step_m:
        return goal
    share = step_m / apart
    return here[0] + share * (goal[0] - here[0]), here[1] + share * (goal[1] - here[1])


class Flight(NamedTuple):
    """A message on the way, as those are asked who decide about its fate."""

    at: Time
    source: int
    receiver: int
    radio: int
    message: Message


class Team:
    """A team whose bodies go where they want, through walls and each other, and whose frames a test can lose or delay.

    *lost* and *delay* are asked about each flight; both can be changed at any time, like *down* (machines that neither
    act nor hear), *held* (bodies that stay where they are put), and the places.
    """

    def __init__(self, starts_m: Sequence[Point], **changes: Any) -> None:
        self.parameters, self.setup = prepared(starts_m, **changes)
        self.places_m: list[Point] = list(starts_m)
        self.machines: list[Any] = [self._made(robot, 0) for robot in range(len(starts_m))]
        self.now: Time = 0
        self.lost: Callable[[Flight], bool] = lambda flight: False
        self.delay: Callable[[Flight], Time] = lambda flight: MS
        self.down: set[int] = set()
        self.held: set[int] = set()
        self.flights: list[Flight] = []
        """All that has been sent and was in reach, lost or not."""
        self.events: list[tuple[Time, int, Any]] = []
        self._goals: list[Point | None] = [None] * len(starts_m)
        self._under_way: list[tuple[Time, int, bytes, Flight]] = []
        self._tick()

    def reboot(self, robot: int) -> None:
        """Have a robot begin anew."""
        self.machines[robot] = self._made(robot, self.now)
        self.down.discard(robot)

    def run(self, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
        """Let time pass, at most until a condition holds after a tick."""
        end = self.now + round(seconds * S)
        while self.now < end:
            tick = self.now // TICK * TICK + TICK
            instants = [tick, *(flight[0] for flight in self._under_way[:1])]
            deadlines = {robot: self.machines[robot].wake_at() for robot in self._up()}
            instants += [max(at, self.now) for at in deadlines.values() if at is not None]
            self.now = min(instants)
            if self.now == tick:
                self._tick()
                if until():
                    return
            while self._under_way and self._under_way[0][0] <= self.now:
                _, _, data, flight = heapq.heappop(self._under_way)
                self._deliver(data, flight)
            for robot in self._up():
                at = self.machines[robot].wake_at()
                if at is not None and at <= self.now:
                    self.machines[robot].wake(self.now)
                    self._drain(robot)

    def said(self, kind: type, source: int | None = None, receiver: int | None = None) -> list[Flight]:
        """Return the flights of one kind of message."""
        return [
            flight
            for flight in self.flights
            if isinstance(flight.message, kind)
            and source in (None, flight.source)
            and receiver in (None, flight.receiver)
        ]

    def noted(self, kind: type, robot: int | None = None) -> list[Any]:
        """Return the events of one kind."""
        return [event for _, source, event in self.events if isinstance(event, kind) and robot in (None, source)]

    def members(self, host: int) -> set[int]:
        """Return whom a host lists."""
        return set(self.machines[host].team.roster.members)

    def _made(self, robot: int, start: Time) -> Machine:
        stream = Streams(1)("machine", robot, start)
        return SPEC.make(self.parameters, self.setup, robot, stream, start)

    def _up(self) -> list[int]:
        return [robot for robot in range(len(self.machines)) if robot not in self.down]

    def _tick(self) -> None:
        for robot in self._up():
            goal = self._goals[robot]
            if goal is not None and robot not in self.held:
                step_m = self.setup.speeds_mps[robot] * to_seconds(TICK)
                self.places_m[robot] = _toward(self.places_m[robot], goal, step_m)
        for robot in self._up():
            view = Sight(self.parameters.camera_m)
            view.here = self.places_m[robot]
            self.machines[robot].observe(Observation(*view.here, 0.0, 0.0, True, False, NOBODY, view), self.now)
            self._drain(robot)

    def _drain(self, robot: int) -> None:
        machine = self.machines[robot]
        self.events += [(self.now, robot, event) for event in machine.events()]
        for item in machine.outbox():
            self._send(robot, item)
        for command in machine.commands():
            self._goals[robot] = _order(command, self.places_m[robot])

    def _send(self, source: int, item: Outgoing) -> None:
        everybody = range(self.setup.hosts) if item.radio else range(self.setup.size)
        reach_m = self.parameters.long_m if item.radio else self.parameters.short_m
        for receiver in everybody if item.destination == BROADCAST else (item.destination,):
            apart_m = math.dist(self.places_m[source], self.places_m[receiver])
            if receiver == source or receiver in self.down or apart_m > reach_m:
                continue
            flight = Flight(self.now, source, receiver, item.radio, decode(item.payload)[1])
            self.flights.append(flight)
            if not self.lost(flight):
                arrival = self.now + self.delay(flight)
                heapq.heappush(self._under_way, (arrival, len(self.flights), item.payload, flight))

    def _deliver(self, data: bytes, flight: Flight) -> None:
        if flight.receiver not in self.down:
            reception = Reception(flight.source, False, radio=flight.radio)
            self.machines[flight.receiver].receive(data, reception, self.now)
            self._drain(flight.receiver)
