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
from typing import Final

import numpy as np
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
_SLACK_CELLS: Final = 0.5
"""So much wider than its body it plans."""


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
        """Frontiers that have been given up by name."""

    @property
    def done(self) -> bool:
        """Whether no way leads to any frontier."""
        return self._done_at == self.belief.version

    def lead(self, observation: Observation, gained: bool) -> float | None:
        """Return the heading to a place ahead on the way; None to stand still."""
        if self.done:
            return None
        here = observation.x_m, observation.y_m
        if self._ticks % self._every == 0 or not self._way:
            self._plan(here)
        self._ticks += 1
        frame = self.belief.frame
        while self._way and math.dist(frame.centre_m(self._way[0]), here) < _AHEAD_CELLS * frame.cell_m:
            del self._way[0]
        if not self._way:
            return None
        x, y = frame.centre_m(self._way[0])
        return math.atan2(y - here[1], x - here[0])

    def _plan(self, here: Point) -> None:
        """Choose a frontier, and plan the way there."""
        belief, own = self.belief, self._planning
        frame = belief.frame
        passable = passable_cells(belief.evidence, self._radius)
        extra = clearance_cost(belief.evidence > 0, max(own.clearance_m / frame.cell_m, 1.0), own.clearance_cost)
        groups = yamauchi_frontiers(belief.evidence, self._own.least_cells)
        team = {**self._places_m, self._me: here}
        costs = self._costs(passable, extra, team, groups)
        mine = sorted(team).index(self._me)
        chosen = self._choice(costs, mine, groups)
        if chosen is None:
            self._finish(groups)
            return
        way = astar(passable, extra, frame.cell_at(here), groups[chosen].centroid, own.cost)
        self._way = [] if way is None else [int(cell) for cell in way]
        x_m, y_m = frame.centre_m(groups[chosen].centroid)
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
        chosen = self._utility(costs, mine, groups) if self._algorithm == "utility" else self._assigned(costs, mine)
        return nearest if chosen is None else chosen

    def _utility(self, costs: Floats, mine: int, groups: list[Frontier]) -> int | None:
        frame = self.belief.frame
        cells = np.array([group.centroid for group in groups])
        away = np.hypot(*(np.subtract.outer(part, part) for part in (cells % frame.nx, cells // frame.nx)))
        seen = np.clip(1.0 - away / self._range, 0.0, None)  # P, the probability that one is seen from the other
        finite = costs[np.isfinite(costs)]
        share = costs / max(float(finite.max()), 1.0)
        utility, left = np.ones(len(cells)), set(range(len(costs)))
        while left:
            rows = sorted(left)
            gain = utility[None] - self._own.cost_weight * share[rows]
            row, group = divmod(int(gain.argmax()), len(cells))
            if not np.isfinite(gain[row, group]):
                return None
            if rows[row] == mine:
                return group
            left.remove(rows[row])
            utility = utility - seen[group]
        return None

    def _assigned(self, costs: Floats, mine: int) -> int | None:
        finite = costs[np.isfinite(costs)]
        rows, columns = linear_sum_assignment(np.where(np.isfinite(costs), costs, 1e3 * (finite.max() + 1.0)))
        found = dict(zip(rows.tolist(), columns.tolist(), strict=True)).get(mine)
        return found if found is not None and np.isfinite(costs[mine, found]) else None

    def _finish(self, groups: list[Frontier]) -> None:
        """Give up what no way leads to."""
        self._way = []
        self._done_at = self.belief.version
        for group in groups:
            if group.centroid not in self._named:
                self._named.add(group.centroid)
                self._records.given_up += len(group.cells)
                place_m = self.belief.frame.centre_m(group.centroid)
                self._events.append(FrontierGivenUp(*place_m, "no way leads there"))
        self._events.append(Explored())
