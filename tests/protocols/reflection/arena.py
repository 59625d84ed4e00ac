"""A small world for machines of goal reflection: walls, discs, own frames, and frames that arrive some ticks later.

It owes nothing to cosim's simulation: bodies step one by one and stop at what they would touch.
"""

import math
from collections.abc import Sequence

import numpy as np

from cosim.geometry.segments import free_fraction, ray_casts, sees, segment_grid
from cosim.machine import BROADCAST, GoTo, Outgoing, Reception
from cosim.navigation.steering import Navigator
from cosim.observation import Observation, Seen, Sighting
from cosim.units import MS
from protocols.reflection.frames import Frame, encode
from protocols.reflection.guidance import HeadStraight
from protocols.reflection.machine import Reflection
from protocols.reflection.parameters import Parameters
from protocols.reflection.setup import Point, Pose, Setup, Task, into_frame

TICK = 100 * MS
STEP_M = 0.1
RADIUS_M = 0.2
BEAMS = 32


def out_of_frame(place: Point, frame: Pose) -> Point:
    """Return where in the world the place is that who has *frame* names so."""
    x, y, heading = frame
    cos, sin = math.cos(heading), math.sin(heading)
    return x + cos * place[0] - sin * place[1], y + sin * place[0] + cos * place[1]


class Arena:
    """Robots at *starts*, each with errands (its goals) and way points (in the world's frame)."""

    def __init__(
        self,
        starts: Sequence[Point],
        errands: Sequence[Sequence[Point]],
        patrols: Sequence[Sequence[Point]] = (),
        walls: Sequence[tuple[float, float, float, float]] = (),
        frames: Sequence[Pose] | None = None,
        delay: int = 0,
        sight_m: float = 15.0,
        solid: bool = True,
        navigators: Sequence[Navigator] = (),
        **parameters: object,
    ) -> None:
        size = len(starts)
        self.places = [tuple(start) for start in starts]
        self.frames = list(frames or [(0.0, 0.0, 0.0)] * size)
        self.grid = segment_grid(np.array(walls, float).reshape(-1, 4))
        self.parameters = Parameters.model_validate({"algorithm": "straight", "share_states": False, **parameters})
        padded = [tuple(row) for row in errands] + [()] * (size - len(errands))
        routes = [tuple(row) for row in patrols] + [()] * (size - len(patrols))
        tasks = []
        for robot, frame in enumerate(self.frames):
            own = tuple(tuple(into_frame(goal, frame) for goal in row) for row in padded)
            route = tuple(into_frame(point, frame) for point in routes[robot])
            tasks.append(Task(own[robot], route, own))
        self.setup = Setup(size, TICK, (STEP_M,) * size, RADIUS_M, tuple(tasks), tuple(padded))
        chosen = list(navigators) + [HeadStraight()] * (size - len(navigators))
        self.machines = [Reflection(self.parameters, self.setup, robot, chosen[robot], 0) for robot in range(size)]
        self.wanted: list[Point | None] = [None] * size
        self.blocked = [False] * size
        self.events: list[list[object]] = [[] for _ in starts]
        self.payloads: list[list[bytes]] = [[] for _ in starts]
        self.silent: set[int] = set()
        self.now = 0
        self._delay = delay
        self._sight_m = sight_m
        self._solid = solid
        self._air: list[tuple[int, int, bytes]] = []

    def sees(self, robot: int, points: Sequence[Point]) -> list[bool]:
        """Answer what *robot* sees of places in its own frame."""
        world = [out_of_frame(point, self.frames[robot]) for point in points]
        here = self.places[robot]
        clear = sees(self.grid, [here] * len(world), world) if world else []
        return [
            bool(free) and math.dist(here, point) <= self._sight_m for free, point in zip(clear, world, strict=True)
        ]

    def tick(self, count: int = 1) -> None:
        """Move, sense and decide, then pass on the frames that are due, *count* times."""
        for _ in range(count):
            for robot in range(len(self.places)):
                self._move(robot)
            for robot, machine in enumerate(self.machines):
                if robot not in self.silent:
                    machine.observe(self._observe(robot), self.now)
                    self._drain(robot)
            self._deliver()
            self.now += TICK

    def run(self, ticks: int, until: type | None = None, robot: int = 0) -> int:
        """Tick until *robot* reports an *until*, or for *ticks*; return how many ticks that took."""
        for count in range(ticks):
            self.tick()
            if until is not None and any(isinstance(event, until) for event in self.events[robot]):
                return count + 1
        return ticks

    def told(self, robot: int, kind: type) -> list[object]:
        """Return the events of one kind that *robot* has reported."""
        return [event for event in self.events[robot] if isinstance(event, kind)]

    def inject(self, robot: int, source: int, data: bytes) -> None:
        """Have *robot* receive *data*."""
        self.machines[robot].receive(data, Reception(source, True), self.now)
        self._drain(robot)

    def _observe(self, robot: int) -> Observation:
        here, frame = self.places[robot], self.frames[robot]
        sightings = []
        for other, there in enumerate(self.places):
            if other != robot and self.sees(robot, [into_frame(there, frame)])[0]:
                sightings.append(Sighting(other, *into_frame(there, frame)))
        visible = tuple(seen.address for seen in sightings)
        arena = self

        class Eye:
            def sees(self, points_m: Sequence[Point]) -> list[bool]:
                return arena.sees(robot, points_m)

            def ranges_m(self) -> np.ndarray:
                return np.array([arena._beam(robot, frame[2] + 2.0 * math.pi * k / BEAMS) for k in range(BEAMS)])

        picture = Seen(visible, tuple(sightings))
        return Observation(*into_frame(here, frame), 0.0, 0.0, True, self.blocked[robot], picture, Eye())

    def _beam(self, robot: int, angle: float) -> float:
        x, y = self.places[robot]
        dx, dy = math.cos(angle), math.sin(angle)
        reach = 20.0
        nearest = float(ray_casts(self.grid, [(x, y)], [angle], reach)[0])
        for other, (ox, oy) in enumerate(self.places):
            along, across = (ox - x) * dx + (oy - y) * dy, (oy - y) * dx - (ox - x) * dy
            if other != robot and along > 0.0 and abs(across) < RADIUS_M:
                nearest = min(nearest, along - math.sqrt(RADIUS_M**2 - across**2))
        return nearest if nearest < reach else math.inf

    def _move(self, robot: int) -> None:
        wanted = self.wanted[robot]
        self.blocked[robot] = False
        if wanted is None:
            return
        x, y = self.places[robot]
        dx, dy = wanted[0] - x, wanted[1] - y
        distance = math.hypot(dx, dy)
        if distance == 0.0:
            return
        share = min(STEP_M / distance, 1.0)
        dx, dy = share * dx, share * dy
        part = free_fraction(self.grid, x, y, dx, dy, RADIUS_M, 1e-7)
        while part > 1e-3 and self._touches(robot, (x + part * dx, y + part * dy)):
            part *= 0.5
        if part <= 1e-3 and self._touches(robot, (x + part * dx, y + part * dy)):
            part = 0.0
        self.blocked[robot] = part < 1.0
        self.places[robot] = x + part * dx, y + part * dy

    def _touches(self, robot: int, place: Point) -> bool:
        if not self._solid:
            return False
        here = self.places[robot]
        return any(
            math.dist(place, there) < 2.0 * RADIUS_M and math.dist(place, there) < math.dist(here, there)
            for other, there in enumerate(self.places)
            if other != robot
        )

    def _drain(self, robot: int) -> None:
        machine = self.machines[robot]
        self.events[robot] += machine.events()
        for item in machine.outbox():
            assert isinstance(item, Outgoing)
            assert item.destination == BROADCAST
            self.payloads[robot].append(item.payload)
            self._air.append((self.now + self._delay * TICK, robot, item.payload))
        for command in machine.commands():
            assert isinstance(command, GoTo)
            self.wanted[robot] = out_of_frame((command.x_m, command.y_m), self.frames[robot])

    def _deliver(self) -> None:
        due = [entry for entry in self._air if entry[0] <= self.now]
        self._air = [entry for entry in self._air if entry[0] > self.now]
        for _, source, data in due:
            for robot, machine in enumerate(self.machines):
                if robot not in self.silent:
                    machine.receive(data, Reception(source, True), self.now + 1)
                    self._drain(robot)


SCREEN = [(2.0, -1.0, 2.0, 9.0)]
"""A wall between the seeker and its goal; a helper below its end sees both."""
SEEKER, HELPER, GOAL = (0.0, 3.0), (2.0, -2.0), (4.0, 3.0)
GHOST = (3.0, 0.0)


def screen(**more: object) -> Arena:
    return Arena([SEEKER, HELPER], [[GOAL]], walls=SCREEN, **more)  # type: ignore[arg-type]


def advised() -> Arena:
    """A seeker, and a silent helper that has promised, where it stands, a way of 5 m, and then has gone elsewhere."""
    arena = Arena([(0.0, 0.0), GHOST], [[(20.0, 0.0)]], sight_m=6.0)
    arena.silent = {1}
    return arena


def advise(arena: Arena, length_m: float) -> None:
    """Have the helper promise, from where the seeker sees it now, a way of this length."""
    arena.inject(0, 1, encode(Frame(False, False, arena.now // MS, (), (), ((0, 2, length_m, 0),))))
