"""What the paper's behaviour is compared with: algorithms that choose a frontier, and go there by the planned way.

- ``nearest``: the frontier of the cheapest way; robots share maps and do not coordinate (Yamauchi, "Frontier-based
  exploration using multiple robots", Agents 1998).
- ``utility``: Burgard, Moors, Stachniss and Schneider, "Coordinated multi-robot exploration", IEEE Trans. Robotics
  21(3), 2005: again and again the robot and frontier with the greatest utility less cost are taken out, and the utility
  of frontiers near by falls. Costs count in shares of the greatest one that is finite.
- ``assignment``: the assignment of the least sum of costs (Kuhn, 1955; Jonker and Volgenant, 1987).

For the last two each robot works out what all should do, from the places that it knows of, and does its own part: who
has the same map and the same places comes to the same end. Frontiers are Yamauchi's.
"""

import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment

from cosim.geometry.astar import astar, clearance_cost, costs_from, passable_cells
from cosim.geometry.frontiers import Frontier, yamauchi_frontiers
from cosim.geometry.grids import Cell
from cosim.geometry.planning import Bools, Point, Singles
from cosim.machine import Address, Event
from cosim.navigation.schemas import Floats
from cosim.observation import Observation
from protocols.exploration.belief import Belief
from protocols.exploration.journal import Explored, FrontierGivenUp, PathLaid
from protocols.exploration.parameters import EscapeParameters, RivalParameters
from protocols.exploration.records import Records

_AHEAD_CELLS: Final = 5
"""So far along its way a robot heads."""
_PATIENCE: Final = 3
"""So many times of planning it stays at a frontier without a new cell before it gives it up."""
_SLACK_CELLS: Final = 0.5
"""So much wider than its body it plans."""


def away_cells(cells: npt.NDArray[np.integer[Any]], nx: int) -> Floats:
    """Return how far *cells* (n,), numbered ``iy * nx + ix``, are from each other: (n, n), in cells."""
    return np.asarray(np.hypot(*(np.subtract.outer(part, part) for part in (cells % nx, cells // nx))))


def by_utility(costs: Floats, away: Floats, reach: float, weight: float) -> list[int | None]:
    """Return to which frontier each robot goes, None where no way leads to any.

    *costs* (robots, frontiers), inf where no way leads; *away* (frontiers, frontiers) as *reach*, the scanner's range.
    Utilities begin at 1. One falls by max(0, 1 - away / reach) when a frontier so far away is taken: the chance that
    it is seen from there. Source: Burgard et al., 2005, Algorithm 1.
    """
    seen = np.clip(1.0 - away / reach, 0.0, None)
    can: Bools = np.isfinite(costs)
    share = np.where(can, costs, 0.0) / max(float(costs[can].max(initial=0.0)), 1.0)
    utility, left = np.ones(costs.shape[1]), np.asarray([row.any() for row in can])
    chosen: list[int | None] = [None] * len(costs)
    while left.any():
        gain = np.where(can & left[:, None], utility - weight * share, -math.inf)
        row, group = divmod(int(gain.argmax()), costs.shape[1])
        chosen[row] = group
        left[row] = False
        utility = utility - seen[group]
    return chosen


def by_assignment(costs: Floats) -> list[int | None]:
    """Return to which frontier each robot goes, each to another: of the most that can go, those of the least sum.

    *costs* (robots, frontiers), inf where no way leads; None for a robot that is left over.
    """
    can: Bools = np.isfinite(costs)
    forbidden = 2.0 * len(costs) * (float(costs[can].max(initial=0.0)) + 1.0)
    chosen: list[int | None] = [None] * len(costs)
    for row, group in zip(*linear_sum_assignment(np.where(can, costs, forbidden)), strict=True):
        if can[row, group]:
            chosen[row] = int(group)
    return chosen


class Rival:
    """What leads one robot."""

    def __init__(
        self,
        algorithm: str,
        parameters: RivalParameters,
        planning: EscapeParameters,
        belief: Belief,
        records: Records,
        events: list[Event],
        me: Address,
        radius_m: float,
        range_m: float,
        places_m: Mapping[Address, Point],
        plan_ticks: int,
    ) -> None:
        """Lead *me*, of *radius_m*, by the map *belief* and the *places_m* of the others, as far as they are known."""
        self.belief = belief
        self.underway = False
        self._algorithm = algorithm
        self._own = parameters
        self._planning = planning
        self._records = records
        self._events = events
        self._me = me
        self._radius = radius_m / belief.frame.cell_m + _SLACK_CELLS
        self._range = range_m / belief.frame.cell_m
        self._places_m = places_m
        self._every = plan_ticks
        self._ticks = 0
        self._way: list[Cell] = []
        self._done_at: int | None = None
        self._named: set[Cell] = set()
        """Frontiers to which no way leads."""
        self._dull: set[Cell] = set()
        """Frontiers that it has come to, and nothing new was to be seen."""
        self._goal: Cell | None = None
        self._barren = 0
        """Ticks at the goal in which no cell came to be known."""

    @property
    def done(self) -> bool:
        """Whether no way leads to any frontier."""
        return self._done_at == self.belief.version

    def lead(self, observation: Observation, gained: bool) -> float | None:
        """Return the heading to a place ahead on the way; None to stand still."""
        if self.done:
            return None
        here = observation.x_m, observation.y_m
        frame = self.belief.frame
        self._wait(here, gained)
        if self._ticks % self._every == 0 or not self._way:
            self._plan(here)
        self._ticks += 1
        while len(self._way) > 1 and math.dist(frame.centre_m(self._way[0]), here) < _AHEAD_CELLS * frame.cell_m:
            del self._way[0]
        if not self._way:
            return None
        x, y = frame.centre_m(self._way[0])
        return math.atan2(y - here[1], x - here[0])

    def _wait(self, here: Point, gained: bool) -> None:
        """Give the goal up after a time at it in which nothing came to be known."""
        frame, goal = self.belief.frame, self._goal
        there = goal is not None and math.dist(frame.centre_m(goal), here) < _AHEAD_CELLS * frame.cell_m
        self._barren = self._barren + 1 if there and not gained else 0
        if goal is not None and self._barren > _PATIENCE * self._every:
            self._dull.add(goal)
            self._records.given_up += 1
            self._events.append(FrontierGivenUp(*frame.centre_m(goal), "nothing new is seen there"))
            self._way, self._goal, self._barren = [], None, 0

    def _plan(self, here: Point) -> None:
        """Choose a frontier, and plan the way there."""
        belief, own = self.belief, self._planning
        frame = belief.frame
        passable = passable_cells(belief.evidence, self._radius)
        extra = clearance_cost(belief.evidence > 0, max(own.clearance_m / frame.cell_m, 1.0), own.clearance_cost)
        found = yamauchi_frontiers(belief.evidence, self._own.least_cells)
        groups = [group for group in found if group.centroid not in self._dull]
        team = {**self._places_m, self._me: here}
        costs = self._costs(passable, extra, team, groups)
        mine = sorted(team).index(self._me)
        chosen = self._choice(costs, mine, groups)
        if chosen is None:
            self._finish(groups)
            return
        way = astar(passable, extra, frame.cell_at(here), groups[chosen].centroid, own.cost)
        self._way = [] if way is None else [int(cell) for cell in way]
        self._goal = groups[chosen].centroid
        x_m, y_m = frame.centre_m(self._goal)
        self._events.append(PathLaid(x_m, y_m, len(self._way), False))

    def _costs(self, passable: Bools, extra: Singles, team: Mapping[Address, Point], groups: list[Frontier]) -> Floats:
        """Return what it costs each of *team*, in the order of their numbers, to come to each of *groups*."""
        cells = [group.centroid for group in groups]
        ends = np.zeros(passable.shape, np.bool_)
        ends.flat[cells] = True
        whose = sorted(team) if self._algorithm != "nearest" else [self._me]
        rows = {
            robot: costs_from(passable, extra, self.belief.frame.cell_at(team[robot]), ends, self._planning.cost).flat[
                cells
            ]
            for robot in whose
        }
        nothing = np.full(len(cells), math.inf)
        return np.array([rows.get(robot, nothing) for robot in sorted(team)]).reshape(len(team), len(cells))

    def _choice(self, costs: Floats, mine: int, groups: list[Frontier]) -> int | None:
        """Return which of *groups* this robot goes to; None if no way leads to any."""
        own = costs[mine]
        if not np.isfinite(own).any():
            return None
        nearest = int(own.argmin())
        if self._algorithm == "nearest":
            return nearest
        if self._algorithm == "utility":
            cells = np.array([group.centroid for group in groups])
            chosen = by_utility(costs, away_cells(cells, self.belief.frame.nx), self._range, self._own.cost_weight)[
                mine
            ]
        else:
            chosen = by_assignment(costs)[mine]
        return nearest if chosen is None else chosen

    def _finish(self, groups: list[Frontier]) -> None:
        """Give up what no way leads to."""
        self._way, self._goal = [], None
        self._done_at = self.belief.version
        for group in groups:
            if group.centroid not in self._named:
                self._named.add(group.centroid)
                self._records.given_up += len(group.cells)
                place_m = self.belief.frame.centre_m(group.centroid)
                self._events.append(FrontierGivenUp(*place_m, "no way leads there"))
        self._events.append(Explored())
