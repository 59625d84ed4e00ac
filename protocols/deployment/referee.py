"""The truth of a deployment: whether the places are held, since when, and how the robots have moved to get there.

A place is held when a living robot stands within ``HELD_M`` of it. A team is deployed when as many of its plan's places
are held at once as possible: all of them, or as many as robots of the plan are alive, or as are not covered by dead
bodies. This has to last, since robots may stand at such places between two stages that they only pass.

The referee judges the places of the last plan. A plan to the same places as the one before, as after two parts of a
team have met again, continues that one: time counts from the begin of the first of them.

Interference is the time for which robots are below their free speed because of another robot, in robot-seconds. Paper
004, section 5, augments its strategies "to reduce interference" and prints no measure of it. Ours compares, tick by
tick, the speed v to which a robot's order leads with the speed u that it would have if no other robot had been there
since it set off. This is the speed of its counterfactual twin (:mod:`protocols.deployment.driving.twin`), which is at
the same place at every tick, with the same walls, goal and limits of its drive, but sees no bodies, and has the speed
and the heading that it has come to by itself. So the time in which a robot that was stopped gets up to speed again
counts, while a corner, a narrow door or the end of the way does not. A robot that was never hindered goes as its twin
does: its shortfall is 0. The extra length of a detour round another robot does not count: it is driven freely.

There are two readings of "robot-seconds below the free speed":

* *lost* time, the sum of (1 - v / u) dt: on a given way the time that it took, less the time that it would have taken,
  since the sum of v / u dt is the sum of ds / u; a robot that stands loses a whole second per second, one at half its
  speed half a second;
* *hindered* time, the sum of dt where v is below u by more than ``SLIGHT`` of it, which is the literal meaning.

A robot that goes back, or aside to make way, gets no nearer to its goal, so it counts as standing (v <= 0). One that
does not want to move (it has arrived, or waits for its turn as ordered) has no free speed; this is no interference.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

import cosim.elementary as elementary
from cosim.arrays import Floats
from cosim.geometry.segments import clearance, segment_grid
from cosim.machine import Address, Event
from cosim.protocol import Death, Metric, Referee, Surroundings
from cosim.units import S, Time, to_seconds
from protocols.deployment.tasks.events import Driving, PlanBegun, TaskEnded, TaskStarted
from protocols.deployment.tasks.plan import Place

HELD_M: Final = 0.3
"""Distance within which a robot holds a place."""
REST_M: Final = 1e-3
"""Movement per tick below which a robot counts as standing, m."""
STOOD: Final = 5 * S  # over any channel the next order comes sooner
"""Time after which places that are held are not only passed."""
MOVED_M: Final = 0.1
"""Distance from which on a robot has moved in a stage."""
TOUCH_M: Final = 1e-4  # the simulator stops bodies at contact: they never overlap
"""Gap below which two bodies collide."""
MOST_STAGES: Final = 8
"""Number of stages that have a column."""
ADDED: Final = "~"
"""Mark in the names of tasks that the executive adds to a plan."""
SLIGHT: Final = 0.05
"""Share below the free speed up to which a speed counts as free in *hindered* time."""
STILL_MPS: Final = 1e-6
"""Speed of a twin up to which it wants to stand, or to turn on the spot: it cannot be hindered."""

REFEREE_METRICS: Final = (
    Metric("deployed", "1", "1 if at the end all places of the last plan are held that could be, else 0"),
    Metric(
        "deployment_s",
        "s",
        "from the last plan's begin (of several in a row to the same places the first's) until as many of its places "
        "as could be were held, for 5 s on end or to the end of the run; NaN if they never were",
    ),
    Metric("places_held", "1", "share of the last plan's places that are held at the end; NaN without a plan"),
    Metric("way_m", "m", "driven by each robot, in the mean"),
    Metric(
        "interference_s",
        "s",
        "robot-seconds lost: below the free speed because of another robot, as shares of it; NaN unless the parameter "
        "interference asks for it",
    ),
    Metric(
        "hindered_s",
        "s",
        "robot-seconds in which a robot was below its free speed because of another; NaN unless the parameter "
        "interference asks for it",
    ),
    Metric("under_way_s", "s", "robot-seconds in which robots were under way to a goal"),
    Metric("waited_s", "s", "robot-seconds in which robots waited for their turn, as ordered"),
    Metric(
        "unoccupied_s",
        "s",
        "place-seconds in which a place of the last plan that had been held was not, until all were",
    ),
    Metric("collisions", "1", "times that two bodies touched"),
    Metric("wall_contacts", "1", "times that a body touched a wall"),
    Metric("nearest_m", "m", "least gap between two bodies; NaN for a robot that is alone"),
    Metric("stages", "1", "stages (tasks right above drives) in which robots moved"),
    *(Metric(f"moving_{n}", "1", f"robots that moved in stage {n}") for n in range(1, MOST_STAGES + 1)),
)


def stage_of(task: str) -> str | None:
    """Return the name of a drive's stage: the task above it (in a strategy ``.../stage-N``).

    None for a drive that is not in the plan: a robot that has made way comes back (the name holds ``ADDED``).
    """
    return None if ADDED in task else task.rpartition("/")[0]


def shortfall(speed_mps: float, free_mps: float) -> float:
    """Return the share of its free speed that a robot lacks, 0 to 1; 0 if it would not move anyway."""
    if free_mps <= STILL_MPS:
        return 0.0
    return min(max(1.0 - max(speed_mps, 0.0) / free_mps, 0.0), 1.0)


class Shortfall:
    """The time that one robot has lost to others so far, in ticks of *tick* ns."""

    def __init__(self, tick: Time) -> None:
        self._tick_s = to_seconds(tick)
        self._lost = 0.0
        self._hindered = 0

    def note(self, speed_mps: float, free_mps: float) -> None:
        """Count a tick of a robot under way; *speed_mps*: its speed towards its goal, *free_mps*: its twin's."""
        lacking = shortfall(speed_mps, free_mps)
        self._lost += lacking
        self._hindered += lacking > SLIGHT

    @property
    def lost_s(self) -> float:
        """Lost time, s."""
        return self._lost * self._tick_s

    @property
    def hindered_s(self) -> float:
        """Hindered time, s."""
        return self._hindered * self._tick_s


@dataclass(frozen=True)
class Begun:
    """A plan whose execution has begun."""

    at: Time
    plan: PlanBegun


class Log:
    """The referee's log of robots' reports: plans that have begun, the drive of each robot, and its lost time."""

    def __init__(self, size: int, tick: Time) -> None:
        self.begun: list[Begun] = []
        self.tasks: list[str | None] = [None] * size
        """Task of each robot's present drive."""
        self._shortfalls = [Shortfall(tick) for _ in range(size)]
        self._under_way = [0] * size
        """Ticks in which each robot was under way to a goal."""
        self._waited = [0] * size
        """Ticks in which each robot waited for its turn, as ordered."""
        self._tick_s = to_seconds(tick)

    def note(self, robot: Address, event: Event, now: Time) -> None:
        """Take what *robot* reports."""
        match event:
            case PlanBegun(number=number):
                # a successor of the leader, for example, begins the same plan again: that changes nothing
                if all(each.plan.number != number for each in self.begun):
                    self.begun.append(Begun(now, event))
            case Driving(waits=True):
                self._waited[robot] += 1
            case Driving(task=task, under_way=under_way, speeds_mps=speeds_mps):
                self.tasks[robot] = task
                self._under_way[robot] += under_way
                if under_way and speeds_mps is not None:
                    self._shortfalls[robot].note(*speeds_mps)
            case TaskStarted() | TaskEnded():
                self.tasks[robot] = None

    def lost_s(self) -> float:
        """Return the robot-seconds that were lost to other robots."""
        return math.fsum(each.lost_s for each in self._shortfalls)

    def hindered_s(self) -> float:
        """Return the robot-seconds in which robots were slower than without others."""
        return math.fsum(each.hindered_s for each in self._shortfalls)

    def under_way_s(self) -> float:
        """Return the robot-seconds in which robots were under way to a goal."""
        return math.fsum(ticks * self._tick_s for ticks in self._under_way)

    def waited_s(self) -> float:
        """Return the robot-seconds in which robots waited for their turn."""
        return sum(self._waited) * self._tick_s


class DeploymentReferee(Referee):
    """Watches bodies, and takes robots' reports. It ends no run: the machines know when the play is over."""

    def __init__(self, interference: bool, surroundings: Surroundings) -> None:
        """Judge a run in *surroundings*; *interference*: robots report their speed without the others."""
        size = len(surroundings.starts_m)
        self._log = Log(size, surroundings.tick)
        self._interference = interference
        self._radii_m = np.array(surroundings.radii_m or (surroundings.radius_m,) * size)
        self._tick_s = to_seconds(surroundings.tick)
        self._contacts = Contacts(self._radii_m, surroundings.walls_m)
        self._places = np.array(surroundings.starts_m, dtype=float).reshape(size, 2)
        self._rests = np.ones(size, np.bool_)
        self._way_m = 0.0
        self._dead: dict[int, Death] = {}
        self._stages = Stages()
        self._aims = Aims()

    def look(self, x_m: Floats, y_m: Floats, now: Time) -> bool:
        """Note where the robots are, and how they have moved since the tick before."""
        places = np.stack((x_m, y_m), axis=1)
        moved = elementary.hypots(*(places - self._places).T)
        self._way_m += float(moved.sum())
        self._rests, self._places = moved < REST_M, places
        self._contacts.look(places)
        self._stages.look(self._log.tasks, places)
        if self._log.begun:
            last = self._log.begun[-1].plan
            self._aims.follow(self._log.begun)
            held = self._held_of(last)
            self._aims.look(held, self._all_of(last, held), self._tick_s, now)
        return False

    def note(self, robot: Address, event: Event, now: Time) -> None:
        """Take what *robot* reports."""
        self._log.note(robot, event, now)

    def died(self, death: Death) -> None:
        """Note that a robot no longer holds a place; its body stays in the way."""
        self._dead[death.robot] = death

    def _held_of(self, plan: PlanBegun) -> set[Place]:
        """Return the places of *plan* at which a living robot stands."""
        standing = [r for r, rests in enumerate(self._rests) if rests and r not in self._dead]
        if not standing or not plan.places_m:
            return set()
        places = np.array(plan.places_m)
        away = elementary.hypots(*(places[:, None, :] - self._places[standing][None, :, :]).transpose(2, 0, 1))
        return {plan.places_m[n] for n in np.flatnonzero((away <= HELD_M).any(axis=1))}

    def _all_of(self, plan: PlanBegun, held: set[Place]) -> bool:
        """Return whether places of *plan* are held, and no more of them could be."""
        alive = sum(robot not in self._dead for robot in plan.robots)
        free = sum(place in held or not self._covered(place) for place in set(plan.places_m))
        return bool(held) and len(held) >= min(alive, free)

    def _covered(self, place: Place) -> bool:
        """Return whether a dead body is so near that no robot can hold *place*."""
        least = float(self._radii_m.min())
        return any(math.dist((d.x_m, d.y_m), place) + HELD_M < d.radius_m + least for d in self._dead.values())

    def verdict(self, now: Time) -> dict[str, float]:
        """Return the metrics of ``REFEREE_METRICS``."""
        log, begun = self._log, [each.plan for each in self._log.begun]
        held = self._held_of(begun[-1]) if begun else set()
        return {
            "deployed": float(bool(begun) and self._all_of(begun[-1], held)),
            "deployment_s": self._aims.deployment_s,
            "places_held": len(held) / len(set(begun[-1].places_m)) if begun and begun[-1].places_m else math.nan,
            "way_m": self._way_m / len(self._radii_m),
            "interference_s": log.lost_s() if self._interference else math.nan,
            "hindered_s": log.hindered_s() if self._interference else math.nan,
            "under_way_s": log.under_way_s(),
            "waited_s": log.waited_s(),
            "unoccupied_s": self._aims.unoccupied_s,
            "collisions": float(self._contacts.collisions),
            "wall_contacts": float(self._contacts.wall_contacts),
            "nearest_m": self._contacts.nearest_m if self._contacts.nearest_m < math.inf else math.nan,
            **self._stages.verdict(),
        }


class Aims:
    """The places of the last plan, and since when they are held."""

    def __init__(self) -> None:
        self._places: set[Place] = set()
        self._plans = 0
        """Number of plans that had begun at the last look."""
        self._begun: Time = 0
        """Time at which the team set off to these places."""
        self._held: set[Place] = set()
        """Places that have been held at some time."""
        self._since: Time | None = None
        """Time since which all places that could be held are held; fixed once that has lasted."""
        self._lasted = False
        self.unoccupied_s = 0.0
        """Place-seconds in which places that had been held were not."""

    @property
    def deployment_s(self) -> float:
        """Time until all were held, s; NaN if they never were."""
        return math.nan if self._since is None else to_seconds(self._since - self._begun)

    def follow(self, plans: Sequence[Begun]) -> None:
        """Begin again for each new plan that has other places than the one before."""
        for plan in plans[self._plans :]:
            self._plans += 1
            if self._plans == 1 or set(plan.plan.places_m) != self._places:
                self._places, self._begun = set(plan.plan.places_m), plan.at
                self._held, self._since, self._lasted, self.unoccupied_s = set(), None, False, 0.0

    def look(self, held: set[Place], enough: bool, tick_s: float, now: Time) -> None:
        """Take the places that are held at a tick; *enough*: no more could be."""
        if self._lasted:
            return
        if enough:
            self._since = now if self._since is None else self._since
            self._lasted = now - self._since >= STOOD
        else:
            self._since = None
            self.unoccupied_s += len(self._held - held) * tick_s
        self._held |= held


class Contacts:
    """Counts how often bodies begin to touch each other, or a wall."""

    def __init__(self, radii_m: Floats, walls_m: Floats) -> None:
        self._radii_m = radii_m
        self._walls = segment_grid(walls_m)
        self._pairs = np.triu_indices(len(radii_m), 1)
        self._sums_m = radii_m[self._pairs[0]] + radii_m[self._pairs[1]]
        self._touched = np.zeros(len(self._sums_m), np.bool_)
        self._at_wall = np.zeros(len(radii_m), np.bool_)
        self.collisions = 0
        self.wall_contacts = 0
        self.nearest_m = math.inf
        """Least gap between two bodies so far."""

    def look(self, places: Floats) -> None:
        """Take the bodies' places at a tick, shape (n, 2)."""
        apart = places[self._pairs[0]] - places[self._pairs[1]]
        gaps = elementary.hypots(apart[:, 0], apart[:, 1]) - self._sums_m
        touch = gaps < TOUCH_M
        self.collisions += int(np.count_nonzero(touch & ~self._touched))
        self.nearest_m = min(self.nearest_m, float(gaps.min(initial=math.inf)))
        limit_m = float(self._radii_m.max()) + 2 * TOUCH_M
        at_wall = clearance(self._walls, places, limit_m) < self._radii_m + TOUCH_M
        self.wall_contacts += int(np.count_nonzero(at_wall & ~self._at_wall))
        self._touched, self._at_wall = touch, at_wall


class Stages:
    """Counts the robots that move in each stage, in the order in which the stages begin."""

    def __init__(self) -> None:
        self._moved: dict[str, set[int]] = {}
        self._began: dict[tuple[int, str], Place] = {}
        """Place of a robot when it was first seen at a drive of a stage."""

    def look(self, tasks: Sequence[str | None], places: Floats) -> None:
        """Take the task of the drive that each robot is at, and the bodies' places at a tick, shape (n, 2)."""
        for robot, task in enumerate(tasks):
            stage = None if task is None else stage_of(task)
            if stage is None:
                continue
            moved = self._moved.setdefault(stage, set())
            if robot not in moved:
                at = float(places[robot, 0]), float(places[robot, 1])
                if math.dist(self._began.setdefault((robot, stage), at), at) > MOVED_M:
                    moved.add(robot)

    def verdict(self) -> dict[str, float]:
        """Return the number of stages, and of the robots that moved in each; NaN for stages that did not occur."""
        counts = [float(len(robots)) for robots in self._moved.values() if robots]
        columns = [*counts[:MOST_STAGES], *[math.nan] * (MOST_STAGES - len(counts))]
        return {"stages": float(len(counts)), **{f"moving_{n}": value for n, value in enumerate(columns, start=1)}}
