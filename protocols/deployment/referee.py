"""The truth of a deployment: whether the places are held, when, and how the robots have moved to get there.

A place is held when a living robot stands within ``HELD_M`` of it. A team is deployed when so many of its plan's places
are held at once as can be: all of them, or as many as robots of the plan are alive, or as dead bodies do not cover; and
when that lasts, for robots that stand at such places between two stages only pass them.

What is judged are the places of the last plan. A plan to the same places as the one before, as after two parts of a
team have met again, goes on with that: time counts from the begin of the first of them.
"""

import math
from collections.abc import Sequence
from typing import Any, Final, Protocol

import numpy as np

from cosim.arrays import Floats
from cosim.geometry.segments import clearance, segment_grid
from cosim.protocol import Death, Metric, Referee, Surroundings
from cosim.units import S, Time, to_seconds
from protocols.deployment.standing import Begun, Board, stage_of
from protocols.deployment.tasks.plan import Place

HELD_M: Final = 0.3
"""As near to a place as this a robot holds it."""
REST_M: Final = 1e-3
"""A robot that moved less than this in a tick stands."""
STOOD: Final = 5 * S
"""Places that are held for so long on end are not only passed: the next order, over any channel, comes before that."""
MOVED_M: Final = 0.1
"""A robot that has come as far as this in a stage has moved in it."""
TOUCH_M: Final = 1e-4
"""As near as this is a collision: the simulator stops bodies at contact, they never overlap."""
MOST_STAGES: Final = 8
"""So many stages have a column."""

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
    Metric("interference_s", "s", "robot-seconds lost: below the free speed because of another robot, as shares of it"),
    Metric("hindered_s", "s", "robot-seconds in which a robot was below its free speed because of another"),
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


class Judged(Protocol):
    """What the referee wants of a run's knowledge."""

    @property
    def board(self) -> Board:
        """What the robots say of themselves."""


class DeploymentReferee(Referee):
    """Watches bodies, and reads the board beside them. It ends no run: the machines know when the play is over."""

    def __init__(self, parameters: Any, setup: Judged, surroundings: Surroundings) -> None:
        size = len(surroundings.starts_m)
        self._board = setup.board
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
        """Note where the robots are, and what they have done since the tick before."""
        places = np.stack((x_m, y_m), axis=1)
        moved = np.hypot(*(places - self._places).T)
        self._way_m += float(moved.sum())
        self._rests, self._places = moved < REST_M, places
        self._contacts.look(places)
        self._stages.look(self._board, places)
        if self._board.begun:
            last = self._board.begun[-1]
            self._aims.follow(self._board.begun)
            held = self._held_of(last)
            self._aims.look(held, self._all_of(last, held), self._tick_s, now)
        return False

    def died(self, death: Death) -> None:
        """Note that a robot holds nothing any more; its body stays in the way."""
        self._dead[death.robot] = death

    def _held_of(self, plan: Begun) -> set[Place]:
        """Return the places of *plan* at which a living robot stands."""
        standing = [r for r, rests in enumerate(self._rests) if rests and r not in self._dead]
        if not standing or not plan.places_m:
            return set()
        places = np.array(plan.places_m)
        away = np.hypot(*(places[:, None, :] - self._places[standing][None, :, :]).transpose(2, 0, 1))
        return {plan.places_m[n] for n in np.flatnonzero((away <= HELD_M).any(axis=1))}

    def _all_of(self, plan: Begun, held: set[Place]) -> bool:
        """Return whether there are places of *plan* that are held, and no more could be."""
        alive = sum(robot not in self._dead for robot in plan.robots)
        free = sum(place in held or not self._covered(place) for place in set(plan.places_m))
        return bool(held) and len(held) >= min(alive, free)

    def _covered(self, place: Place) -> bool:
        """Return whether a dead body is so near that nobody can hold *place*."""
        least = float(self._radii_m.min())
        return any(math.dist((d.x_m, d.y_m), place) + HELD_M < d.radius_m + least for d in self._dead.values())

    def verdict(self, now: Time) -> dict[str, float]:
        """Return the metrics of ``REFEREE_METRICS``."""
        begun = self._board.begun
        held = self._held_of(begun[-1]) if begun else set()
        return {
            "deployed": float(bool(begun) and self._all_of(begun[-1], held)),
            "deployment_s": self._aims.deployment_s,
            "places_held": len(held) / len(set(begun[-1].places_m)) if begun and begun[-1].places_m else math.nan,
            "way_m": self._way_m / len(self._radii_m),
            "interference_s": self._board.lost_s(),
            "hindered_s": self._board.hindered_s(),
            "under_way_s": self._board.under_way_s(),
            "waited_s": self._board.waited_s(),
            "unoccupied_s": self._aims.unoccupied_s,
            "collisions": float(self._contacts.collisions),
            "wall_contacts": float(self._contacts.wall_contacts),
            "nearest_m": self._contacts.nearest_m if self._contacts.nearest_m < math.inf else math.nan,
            **self._stages.verdict(),
        }


class Aims:
    """How the places of the last plan have come to be held."""

    def __init__(self) -> None:
        self._places: set[Place] = set()
        self._plans = 0
        """So many plans had begun when it was looked last."""
        self._begun: Time = 0
        """When the team set off to these places."""
        self._held: set[Place] = set()
        """Those that have been held at some time."""
        self._since: Time | None = None
        """Since when all have been held that could be; once that has lasted, it stays as it is."""
        self._lasted = False
        self.unoccupied_s = 0.0
        """Place-seconds in which those that had been held were not."""

    @property
    def deployment_s(self) -> float:
        """Seconds until all were held; NaN if they have not been."""
        return math.nan if self._since is None else to_seconds(self._since - self._begun)

    def follow(self, plans: Sequence[Begun]) -> None:
        """Begin anew for each of the plans that have begun since, if it is to other places than the one before."""
        for plan in plans[self._plans :]:
            self._plans += 1
            if self._plans == 1 or set(plan.places_m) != self._places:
                self._places, self._begun = set(plan.places_m), plan.at
                self._held, self._since, self._lasted, self.unoccupied_s = set(), None, False, 0.0

    def look(self, held: set[Place], enough: bool, tick_s: float, now: Time) -> None:
        """Take which places are held at a tick, and whether more could be."""
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
        gaps = np.hypot(apart[:, 0], apart[:, 1]) - self._sums_m
        touch = gaps < TOUCH_M
        self.collisions += int(np.count_nonzero(touch & ~self._touched))
        self.nearest_m = min(self.nearest_m, float(gaps.min(initial=math.inf)))
        limit_m = float(self._radii_m.max()) + 2 * TOUCH_M
        at_wall = clearance(self._walls, places, limit_m) < self._radii_m + TOUCH_M
        self.wall_contacts += int(np.count_nonzero(at_wall & ~self._at_wall))
        self._touched, self._at_wall = touch, at_wall


class Stages:
    """Counts who moves in each stage, in the order in which the stages begin."""

    def __init__(self) -> None:
        self._moved: dict[str, set[int]] = {}
        self._began: dict[tuple[int, str], Place] = {}
        """Where a robot was as it was first seen at a drive of a stage."""

    def look(self, board: Board, places: Floats) -> None:
        """Take who is at which drive, and the bodies' places at a tick, shape (n, 2)."""
        for robot, task in board.driving():
            stage = stage_of(task)
            if stage is None:
                continue
            moved = self._moved.setdefault(stage, set())
            if robot not in moved:
                at = float(places[robot, 0]), float(places[robot, 1])
                if math.dist(self._began.setdefault((robot, stage), at), at) > MOVED_M:
                    moved.add(robot)

    def verdict(self) -> dict[str, float]:
        """Return how many stages there were, and how many robots moved in each; NaN for those there were not."""
        counts = [float(len(robots)) for robots in self._moved.values() if robots]
        columns = [*counts[:MOST_STAGES], *[math.nan] * (MOST_STAGES - len(counts))]
        return {"stages": float(len(counts)), **{f"moving_{n}": value for n, value in enumerate(columns, start=1)}}
