"""The algorithms that the paper's behaviour is compared with: robots choose a frontier and go there by a planned way.

:mod:`protocols.exploration.targets` chooses the targets. A robot keeps its target until it has reached it, as
Yamauchi's does. It scans on its way, which his does not: so it also leaves a target that is no longer a frontier, but
no sooner than ``plan_s`` after the choice (Burgard et al. choose again when a target is reached or a time has passed).
A target that is still a frontier although the robot has reached it is left out for good (Yamauchi's list of visited
frontiers). A robot without progress for ``patience_s`` goes round the robots that stand near, to the frontier that is
nearest then; if there are none it gives the frontier up for itself (Yamauchi's list of inaccessible frontiers). Of two
robots that drive close to each other the one with the higher number waits.
"""

import math
from typing import Final

import numpy as np

import cosim.elementary as elementary
from cosim.arrays import Floats, Int32s
from cosim.geometry.astar import astar
from cosim.geometry.grids import Cell
from cosim.geometry.planning import Point
from cosim.machine import Address, Event
from cosim.observation import Observation
from protocols.exploration.events import Counters, Explored, FrontierGivenUp, PathLaid
from protocols.exploration.targets import Targets

_AHEAD_CELLS: Final = 5
"""Look-ahead along the planned way."""
_ARRIVED_CELLS: Final = 3
"""Distance from its target at which a robot has reached it."""
_LOOK_M: Final = 1.0
"""Distance about a target reached in vain within which frontiers are left out, metres."""
_NEAR_M: Final = 1.5
"""Distance, edge to edge, within which robots may stand in each other's way, metres."""
_CLOSE_M: Final = 0.3
"""Distance, edge to edge, at which a robot waits for a moving one with a lower number ahead, metres."""
_STILL_M: Final = 1e-3
"""Movement per tick below which a robot counts as standing, metres."""


class Rival:
    """What leads one robot."""

    def __init__(
        self,
        targets: Targets,
        counters: Counters,
        events: list[Event],
        me: Address,
        plan_ticks: int,
        patience_ticks: int,
    ) -> None:
        """Lead *me* to its *targets*."""
        self.belief = targets.belief
        self.underway = False
        self._targets = targets
        self._counters = counters
        self._events = events
        self._me = me
        self._every = plan_ticks
        self._patience = patience_ticks
        self._round = 0
        self._since = plan_ticks
        """Ticks since a target was chosen, or none was found."""
        self._way: list[Cell] = []
        self._goal: Cell | None = None
        self._left = math.inf
        """Shortest length that was left of its way."""
        self._barren = 0
        """Ticks in which that has not become shorter."""
        self._done_at: int | None = None
        self._seen_m: dict[Address, Point] = {}
        """Where the others in sight were a tick ago."""
        self._named = np.zeros(self.belief.evidence.shape, np.bool_)
        """Frontiers to which no way leads."""

    @property
    def done(self) -> bool:
        """True if no way leads to any frontier."""
        return self._done_at == self.belief.version

    @property
    def way(self) -> list[Cell]:
        """The cells of the way that is left; empty if it has no target."""
        return list(self._way)

    def lead(self, observation: Observation, gained: bool) -> float | None:
        """Return the heading to a place ahead on the way; None to stand still."""
        if self.done:
            return None
        here = observation.x_m, observation.y_m
        self._since += 1
        moving = self._moving(observation)
        if self._goal is None and self._since < self._every:
            return None
        if self._targets.round > self._round:
            self._take_over(here)
        if self._barren >= self._patience:
            self._stuck(here, observation)
        elif self._due(here, observation):
            self._choose(here)
        heading = self._heading(here)
        return None if heading is None or self._gives_way(here, heading, moving) else heading

    def _heading(self, here: Point) -> float | None:
        """Return the heading to a place ahead on the way, and note how much of the way is left."""
        frame = self.belief.frame
        while len(self._way) > 1 and math.dist(frame.centre_m(self._way[0]), here) < _AHEAD_CELLS * frame.cell_m:
            del self._way[0]
        if not self._way:
            return None
        x, y = frame.centre_m(self._way[0])
        left = len(self._way) + math.dist((x, y), here) / frame.cell_m
        self._barren += 1
        if left < self._left - 1.0:
            self._left, self._barren = left, 0
        return elementary.atan2(y - here[1], x - here[0])

    def _moving(self, observation: Observation) -> list[tuple[Address, Point]]:
        """Return the robots in sight that have moved since the last tick, and where they are."""
        before, self._seen_m = self._seen_m, {other: (x, y) for other, x, y in observation.sightings}
        return [
            (other, place_m)
            for other, place_m in self._seen_m.items()
            if other in before and math.dist(before[other], place_m) > _STILL_M
        ]

    def _gives_way(self, here: Point, heading: float, moving: list[tuple[Address, Point]]) -> bool:
        """Return whether a robot with a lower number drives close in front."""
        radii_m = self._targets.radii_m
        for other, (x, y) in moving:
            reach_m = radii_m[self._me] + radii_m[other] + _CLOSE_M
            ahead = (x - here[0]) * elementary.cos(heading) + (y - here[1]) * elementary.sin(heading)
            if other < self._me and ahead > 0.0 and math.dist((x, y), here) <= reach_m:
                return True
        return False

    # ------------------------------------------------------------ targets

    def _due(self, here: Point, observation: Observation) -> bool:
        """Return whether it is time for another target; leave out a target that was reached in vain."""
        goal, targets, frame = self._goal, self._targets, self.belief.frame
        if goal is None or not self._way:
            return True
        if math.dist(frame.centre_m(goal), here) > _ARRIVED_CELLS * frame.cell_m:
            return self._since >= self._every and not targets.open(goal)
        if targets.open(goal):
            if len(self._about(here, observation)) and self._barren < self._patience // 2:
                return False  # another robot may hide it
            self._give_up(targets.in_vain(here, _LOOK_M), "nothing new is seen there")
            targets.bar(self._me, np.array([goal], np.int32))
        return True

    def _choose(self, here: Point) -> None:
        goal = self._targets.choose(self._me, here)
        self._round = self._targets.round
        self._set_out(here, goal)
        if goal is None:
            self._finish()

    def _take_over(self, here: Point) -> None:
        """Take the target that another robot's choice has for this one."""
        self._round = self._targets.round
        goal = self._targets.goals.get(self._me)
        if goal is not None and goal != self._goal and self._barren < self._patience:
            self._set_out(here, goal)

    def _set_out(self, here: Point, goal: Cell | None) -> None:
        terrain, radius_m = self._targets.terrain, self._targets.radii_m[self._me]
        self._since = 0
        way: list[Cell] = []
        entry = [] if goal is None else terrain.entry(here, radius_m)
        if goal is not None and entry:
            found = astar(terrain.passable(radius_m), terrain.extra(), entry[-1], goal, terrain.reading)
            way = [] if found is None else entry[:-1] + [int(cell) for cell in found]
        self._follow(way)

    def _follow(self, way: list[Cell]) -> None:
        self._way = way
        self._goal = way[-1] if way else None
        self._left, self._barren = math.inf, 0
        if way:
            x_m, y_m = self.belief.frame.centre_m(way[-1])
            self._events.append(PathLaid(x_m, y_m, len(way), False))

    # ------------------------------------------------------------ what cannot be reached

    def _about(self, here: Point, observation: Observation) -> Floats:
        """Return the places and radii of the robots in sight that are near, (n, 3)."""
        radii_m = self._targets.radii_m
        reach_m = _NEAR_M + radii_m[self._me]
        near = [
            (x, y, radii_m[other])
            for other, x, y in observation.sightings
            if math.dist((x, y), here) <= reach_m + radii_m[other]
        ]
        return np.array(near, np.float64).reshape(-1, 3)

    def _stuck(self, here: Point, observation: Observation) -> None:
        """Go round the robots that stand near, or give the target up."""
        bodies = self._about(here, observation)
        self._since = 0
        if len(bodies):
            way = self._targets.way_to_nearest(self._me, here, self._targets.groups(), bodies)
            self._follow([] if way is None else way)
            return
        if self._goal is not None:
            cells = self._beside(self._goal)
            self._targets.bar(self._me, cells)
            self._give_up(cells, "no way is made there")
        self._choose(here)

    def _beside(self, goal: Cell) -> Int32s:
        """Return the cells of frontiers that are near to *goal*."""
        nx, groups = self.belief.frame.nx, self._targets.groups()
        cells = np.concatenate([np.array([goal], np.int32), *groups])
        away = elementary.hypots(cells % nx - goal % nx, cells // nx - goal // nx)
        return np.unique(cells[away <= _AHEAD_CELLS])

    def _give_up(self, cells: Int32s, why: str) -> None:
        self._counters.given_up += len(cells)
        self._events += [FrontierGivenUp(*self.belief.frame.centre_m(cell), why) for cell in cells]

    def _finish(self) -> None:
        """Give up the frontiers to which no way leads."""
        self._done_at = self.belief.version
        groups = self._targets.groups()
        cells = np.concatenate(groups) if groups else np.empty(0, np.int32)
        new = cells[~self._named.flat[cells]]
        self._named.flat[new] = True
        self._give_up(new, "no way leads there")
        self._events.append(Explored())
