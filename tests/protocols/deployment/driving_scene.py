"""Movers that drive real bodies among walls, without radio: the loop of a run's world, and nothing else of it."""

import itertools
import math
from collections.abc import Callable, Sequence

import numpy as np

from cosim.geometry.segments import packed_walls, segment_grid
from cosim.geometry.segments import swept_clearance as clear_of_walls
from cosim.machine import Command
from cosim.randomness import Streams
from cosim.robots.body import BodySettings
from cosim.robots.motion import Fleet
from cosim.robots.senses import WORLD_FRAME, Senses, SenseSettings
from cosim.units import MS, S
from cosim.world.offices import OfficeSettings, office_walls
from protocols.deployment.driving.mover import Mover
from protocols.deployment.driving.yielding import in_the_way
from protocols.deployment.tasks.plan import Place
from protocols.motion.floor import Floor
from protocols.motion.parameters import DrivingParameters
from protocols.motion.traffic import Other

TICK = 100 * MS
SIGHT_M = 12.0


def body(**limits: float) -> BodySettings:
    return BodySettings(drive="differential", **limits)


def box(width: float, height: float) -> list[tuple[float, float, float, float]]:
    return [(0, 0, width, 0), (width, 0, width, height), (width, height, 0, height), (0, height, 0, 0)]


def line(*points: Place) -> list[tuple[float, float, float, float]]:
    """Return the walls along a row of points."""
    return [(*a, *b) for a, b in itertools.pairwise(points)]


class Scene:
    """A floor, bodies on it, and what drives each."""

    def __init__(
        self,
        walls: Sequence[tuple[float, float, float, float]],
        starts: Sequence[Place],
        bodies: Sequence[BodySettings] | None = None,
        parameters: DrivingParameters | None = None,
        headings: Sequence[float] | float = 0.0,
        senses: SenseSettings | None = None,
        floor: Floor | None = None,
    ) -> None:
        self.parameters = parameters or DrivingParameters()
        rows = np.array(walls, np.float64)
        low, high = rows.reshape(-1, 2).min(axis=0), rows.reshape(-1, 2).max(axis=0)
        self.floor = floor or Floor(rows, (*low.tolist(), *high.tolist()), None, self.parameters)
        self.bodies = list(bodies or [body()] * len(starts))
        self.grid = segment_grid(rows)
        self.fleet = Fleet(self.bodies, starts, self.grid, TICK, headings_rad=headings)
        self.radii = [each.radius_m for each in self.bodies]
        self.senses = Senses(
            senses or SenseSettings(),
            packed_walls(self.grid),
            self.radii,
            [WORLD_FRAME] * len(starts),
            SIGHT_M,
            TICK,
            Streams(1),
        )
        self.movers = [
            Mover(self.floor, me, each.radius_m, each.speed_mps, each.acceleration_mps2, self.parameters, TICK)
            for me, each in enumerate(self.bodies)
        ]
        self.now = 0
        self.commands: list[tuple[int, Command]] = []
        self.touched: set[int] = set()
        """Who has been stopped by a wall or by another body: DWA has failed."""
        self.least_gap_m = math.inf
        """Between two bodies, ever."""
        self.least_room_m = math.inf
        """Between a body and a wall, ever."""
        self.dead: set[int] = set()
        self.tells_goals = True
        self.asides: dict[int, tuple[int, Place, Place]] = {}
        """Who has been asked to step aside: by whom, from where, and where it is to come back to."""

    def tick(self) -> None:
        self.fleet.apply(self.commands)
        self.fleet.step()
        self.commands = []
        observations = self.senses.observe(self.fleet)
        self.judge()
        told = [self.told(me) for me in range(len(self.movers))]
        for me, mover in enumerate(self.movers):
            if me in self.dead:
                continue
            drive = mover.step(observations[me], [other for other in told if other.address != me], self.now)
            if drive is not None:
                self.commands.append((me, drive))
            if observations[me].blocked:
                self.touched.add(me)
        self.ask()
        self.now += TICK

    def ask(self) -> None:
        """Have those who stand in the way asked to step aside, and let them come back: as a robot's member does it."""
        for me, mover in enumerate(self.movers):
            asked = mover.blocked_by
            if asked is None or me in self.dead or asked in self.dead or mover.goal_m is None:
                continue
            other = self.movers[asked]
            if other.state in ("idle", "arrived"):
                here = self.place(me)
                stood = self.place(asked)
                self.asides[asked] = me, *self.asides.get(asked, (me, stood, other.goal_m or stood))[1:]
                other.retreat(here, self.floor.way(self.radii[me], here, mover.goal_m) or [])
        for asked, (me, stood, home) in list(self.asides.items()):
            goal = self.movers[me].goal_m
            way = self.floor.way(self.radii[me], self.place(me), goal) if goal is not None else None
            over = self.movers[me].state == "arrived" or me in self.dead
            if over or not in_the_way(stood, self.radii[asked], way or [], self.radii[me], 0.1):
                del self.asides[asked]
                self.movers[asked].go(home)

    def place(self, me: int) -> Place:
        x, y = self.fleet.positions_m[me].tolist()
        return x, y

    def told(self, me: int) -> Other:
        x, y = self.fleet.positions_m[me].tolist()
        heading, speed = self.fleet.observed[me, 2:4].tolist()
        each, mover = self.bodies[me], self.movers[me]
        goal = mover.goal_m if self.tells_goals else None
        idle = mover.state in ("idle", "arrived")
        return Other(me, x, y, each.radius_m, speed, heading, each.acceleration_mps2, goal, idle)

    def judge(self) -> None:
        places = self.fleet.positions_m
        for a, b in itertools.combinations(range(len(places)), 2):
            gap = math.dist(places[a], places[b]) - self.radii[a] - self.radii[b]
            self.least_gap_m = min(self.least_gap_m, gap)
        room = clear_of_walls(self.grid, places, places, 2.0) - np.array(self.radii)
        self.least_room_m = min(self.least_room_m, float(room.min()))

    def run(self, seconds: float, until: Callable[[], bool] | None = None) -> float:
        """Let time pass, until something is so; return when, in seconds."""
        end = self.now + round(seconds * S)
        while self.now < end and not (until and until()):
            self.tick()
        return self.now / S

    def all_there(self) -> bool:
        return all(mover.state in ("idle", "arrived") for me, mover in enumerate(self.movers) if me not in self.dead)


def random_office(seed: int, robots: int, sizes: bool = False, parameters: DrivingParameters | None = None) -> Scene:
    """Return an office with robots in it, at random places, each with a goal that is a way off all others'."""
    draw = np.random.default_rng(seed)
    settings = OfficeSettings(
        width_m=float(draw.uniform(12, 24)),
        depth_m=float(draw.uniform(8, 14)),
        rooms=int(draw.integers(3, 9)),
        corridor_m=float(draw.uniform(1.2, 2.4)),
        door_m=float(draw.uniform(0.8, 1.2)),
        seed=seed,
    )
    walls = office_walls(settings)
    floor = Floor(walls, (0.0, 0.0, settings.width_m, settings.depth_m), None, parameters or DrivingParameters())
    bodies = [
        body(
            radius_m=float(draw.uniform(0.15, 0.28)),
            speed_mps=float(draw.uniform(0.3, 0.8)),
            acceleration_mps2=float(draw.uniform(0.5, 1.5)),
        )
        if sizes
        else body()
        for _ in range(robots)
    ]
    places = [_places(draw, settings, floor, [each.radius_m for each in bodies]) for _ in range(2)]
    scene = Scene(walls, places[0], bodies, floor.parameters, draw.uniform(-3, 3, robots).tolist(), floor=floor)
    for mover, goal in zip(scene.movers, places[1], strict=True):
        mover.go(goal)
    return scene


def _places(draw: np.random.Generator, settings: OfficeSettings, floor: Floor, radii: Sequence[float]) -> list[Place]:
    found: list[Place] = []
    while len(found) < len(radii):
        place = float(draw.uniform(0, settings.width_m)), float(draw.uniform(0, settings.depth_m))
        if floor.free(radii[len(found)] + 0.05, place) and all(math.dist(place, other) > 1.2 for other in found):
            found.append(place)
    return found
