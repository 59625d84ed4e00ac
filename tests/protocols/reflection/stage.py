"""A stage for real machines of goal reflection: a script says who is where, who sees what, and when frames arrive.

Sight is the script's, not geometry's: any robot may see any other, any goal and any ghost, or lose them, at any tick.
Every frame crosses as bytes. The stage keeps an eye on where each promise comes from: a *tale* is the row of tellings
that a way is based on, from the robot that saw the goal to the one that told it last.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cosim.machine import Outgoing, Reception
from cosim.observation import Observation, Seen, Sighting
from cosim.units import MS, Time
from protocols.reflection.frames import decode
from protocols.reflection.goals import goal_number
from protocols.reflection.machine import Reflection
from protocols.reflection.parameters import Parameters
from protocols.reflection.promises import Way
from protocols.reflection.setup import Point, Pose, Setup, Task, into_frame
from protocols.reflection.spec import SPEC
from tests.protocols.reflection.arena import out_of_frame

TICK = 100 * MS
STEP_M = 1.0


class Telling(NamedTuple):
    """A robot has told that a goal is so far away, when it was at a place."""

    robot: int
    length_m: float
    place: Point
    time: Time


class Tale(NamedTuple):
    """What a way is based on."""

    goal: Point
    """Where, in the world, the robot took the goal to be that saw it."""
    tellings: tuple[Telling, ...]


class Flight(NamedTuple):
    """A frame on its way, and what its pledges are based on, by owner."""

    due: int
    source: int
    payload: bytes
    tales: dict[int, Tale]


class Hop(NamedTuple):
    """A promise that was told: by whom, for whose goal, with which number, how long, last seen when, based on what."""

    robot: int
    owner: int
    number: int
    length_m: float
    seen_ms: int
    tale: Tale


class Taking(NamedTuple):
    """A promise that was taken: by whom, based on what, how long from there, and what it was taken for, if anything."""

    robot: int
    tale: Tale
    length_m: float
    before_m: float | None


class Stage:
    """Machines at *places* in their *frames*; robot k is to reach *goals*[k] in turn."""

    def __init__(
        self, places: Sequence[Point], frames: Sequence[Pose], goals: Sequence[Sequence[Point]], **parameters: object
    ) -> None:
        size = len(places)
        self.goals = [tuple(row) for row in goals] + [()] * (size - len(goals))
        self.frames = list(frames)
        self.places = list(places)
        plain = {"algorithm": "straight", "share_states": True, **parameters}
        self.parameters = Parameters.model_validate(plain)
        tasks = tuple(
            Task(tuple(into_frame(goal, frame) for goal in row), (), ())
            for row, frame in zip(self.goals, self.frames, strict=True)
        )
        setup = Setup(size, TICK, (STEP_M,) * size, 0.2, tasks, tuple(self.goals))
        self.machines: list[Reflection] = [
            SPEC.make(self.parameters, setup, robot, np.random.default_rng(robot), 0)  # type: ignore[misc]
            for robot in range(size)
        ]
        self.ticks = 0
        self.payloads: list[list[bytes]] = [[] for _ in places]
        self.events: list[list[object]] = [[] for _ in places]
        self.told: list[Hop] = []
        """What was told at the last tick."""
        self.last_sight: dict[tuple[int, int], Time] = {}
        """When anybody saw the goal of an owner with a number last."""
        self.taken: list[Taking] = []
        """Promises that were taken at the last tick."""
        self.history: list[Taking] = []
        """All that were taken before."""
        self._tales: dict[int, tuple[Way, Tale]] = {}
        self._air: list[Flight] = []

    @property
    def now(self) -> Time:
        return self.ticks * TICK

    def tick(
        self,
        sees: Sequence[Sequence[int]],
        goals_seen: Sequence[int],
        ghosts_seen: Sequence[bool],
        delays: Sequence[int | None],
    ) -> None:
        """Observe all: robot k sees the robots *sees*[k], and the goals of the owners whose bits *goals_seen*[k] has.

        *ghosts_seen*[k] is whether it sees ghosts. Its frame arrives *delays*[k] ticks later, or (None) never.
        """
        self.told = []
        self.history += self.taken
        self.taken = []
        for robot, machine in enumerate(self.machines):
            machine.observe(self._observe(robot, sees[robot], goals_seen[robot], ghosts_seen[robot]), self.now)
            self._drain(robot, delays[robot])
        due = [flight for flight in self._air if flight.due <= self.ticks]
        self._air = [flight for flight in self._air if flight.due > self.ticks]
        for flight in due if self.ticks % 2 else reversed(due):
            for robot in range(len(self.machines)):
                if robot != flight.source:
                    self._receive(robot, flight)
        self.ticks += 1

    def _observe(self, robot: int, sees: Sequence[int], goals_seen: int, ghosts_seen: bool) -> Observation:
        frame, stage = self.frames[robot], self
        sightings = tuple(Sighting(other, *into_frame(self.places[other], frame)) for other in sees)

        class Eye:
            def sees(self, points_m: Sequence[Point]) -> list[bool]:
                book = stage.machines[robot].book
                goals = {owner: (book.x_m[owner], book.y_m[owner]) for owner in book.known}
                shown = {place for owner, place in goals.items() if goals_seen >> owner & 1}
                for owner, place in goals.items():
                    if place in shown:
                        stage.last_sight[owner, book.number(owner)] = stage.now
                hidden = set(goals.values()) - shown
                return [point in shown or (ghosts_seen and point not in hidden) for point in points_m]

            def ranges_m(self) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
                return np.full(16, 99.0)

        here = into_frame(self.places[robot], frame)
        return Observation(*here, 0.0, 0.0, True, False, Seen(tuple(sees), sightings), Eye())

    def _drain(self, robot: int, delay: int | None) -> None:
        machine, size = self.machines[robot], len(self.machines)
        for owner, way in enumerate(machine.ways.of):
            if way is not None and way.direct:
                self._tale(robot, owner)
        self.events[robot] += machine.events()
        machine.commands()
        for item in machine.outbox():
            assert isinstance(item, Outgoing)
            self.payloads[robot].append(item.payload)
            tales = {}
            for owner, identifier, length, seen_ms in decode(item.payload).pledges:
                telling = Telling(robot, length, self.places[robot], self.now)
                tale = self._tale(robot, owner)
                tales[owner] = tale._replace(tellings=(*tale.tellings, telling))
                self.told.append(Hop(robot, owner, goal_number(identifier, size), length, seen_ms, tales[owner]))
            if delay is not None:
                self._air.append(Flight(self.ticks + delay, robot, item.payload, tales))

    def _receive(self, robot: int, flight: Flight) -> None:
        machine = self.machines[robot]
        before = [(way, machine.book.number(owner)) for owner, way in enumerate(machine.ways.of)]
        machine.receive(flight.payload, Reception(flight.source, True), self.now + 1)
        self.events[robot] += machine.events()
        here = into_frame(self.places[robot], self.frames[robot])
        for owner, ((one, number), way) in enumerate(zip(before, machine.ways.of, strict=True)):
            if way is not None and way is not one:
                tale = flight.tales[owner]
                self._tales[id(way)] = way, tale
                same_goal = number == machine.book.number(owner)
                before_m = one.length(*here) if one is not None and same_goal else None
                self.taken.append(Taking(robot, tale, way.length(*here), before_m))

    def _tale(self, robot: int, owner: int) -> Tale:
        """Return what the way of a robot to an owner's goal is based on: no telling if it has seen the goal itself."""
        machine = self.machines[robot]
        way = machine.ways.of[owner]
        assert way is not None
        if way.direct:
            goal = out_of_frame((machine.book.x_m[owner], machine.book.y_m[owner]), self.frames[robot])
            self._tales[id(way)] = way, Tale(goal, ())
        return self._tales[id(way)][1]
