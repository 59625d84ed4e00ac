"""The targets of a team by one map, for the algorithms that choose frontiers.

Frontiers are Yamauchi's: adjacent empty cells beside the unknown, about as many as a robot is large, or more
(B. Yamauchi, "A frontier-based approach for autonomous exploration", Proc. IEEE CIRA 1997, pp. 146-151). That cells are
adjacent also diagonally is our reading; the schemas have another definition (:mod:`cosim.geometry.marking`). Cells that
a robot has reached, or that are in sight from there, and that are frontiers all the same, are left out. A target is a
cell of one:

- ``nearest``: the cell of the cheapest way; robots share maps and do not coordinate (B. Yamauchi, "Frontier-based
  exploration using multiple robots", Agents 1998).
- ``utility``: every cell of a frontier is a target of its own, as in Burgard et al.
- ``assignment``: frontiers are assigned to robots; a robot's target is the cell of its frontier with the cheapest way.
  A robot that is left over goes to the nearest.

Yamauchi's robots go to a frontier's centroid, and scan where they arrive. Here a robot scans all the time, and the
centroid of what is left moves with every scan, so the cheapest cell takes its place.
For the last two algorithms all targets are chosen together, whenever a robot needs one. Robots that share a map share
targets; else each robot works out what all should do, from the places that it knows of, and does its own part.

- :func:`by_utility`: W. Burgard, M. Moors, C. Stachniss and F. E. Schneider, "Coordinated multi-robot exploration",
  IEEE Trans. Robotics 21(3), 2005: the robot and frontier with the greatest utility less cost are taken out again and
  again, and the utility of frontiers near by falls. Costs count in shares of the greatest one that is finite.
- :func:`by_assignment`: the assignment of the least sum of costs (Kuhn, 1955; Jonker and Volgenant, 1987).
"""

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
from scipy import ndimage
from scipy.optimize import linear_sum_assignment

import cosim.elementary as elementary
from cosim.arrays import Bools, Floats, Int32s
from cosim.geometry.astar import in_sight, nearest
from cosim.geometry.grids import Cell
from cosim.geometry.planning import Point
from cosim.machine import Address
from protocols.exploration.parameters import RivalParameters
from protocols.exploration.terrain import Terrain
from protocols.mapping.belief import Evidence


class Targets:
    """The targets of a team, by one map."""

    def __init__(
        self,
        algorithm: str,
        parameters: RivalParameters,
        terrain: Terrain,
        radii_m: Sequence[float],
        range_m: float,
        places_m: Mapping[Address, Point],
    ) -> None:
        """Choose by the map of *terrain* for robots of *radii_m* at *places_m*, where known; scans reach *range_m*."""
        self.belief = terrain.belief
        self.terrain = terrain
        self.radii_m = radii_m
        self.places_m = places_m
        self.together = algorithm != "nearest"
        self.goals: dict[Address, Cell] = {}
        """Targets that were chosen last."""
        self.round = 0
        """Number of times that targets have been chosen together."""
        self._algorithm = algorithm
        self._own = parameters
        self._range = range_m / terrain.belief.frame.cell_m
        self._vain: Bools = np.zeros(terrain.belief.evidence.shape, np.bool_)
        self._barred: dict[Address, Bools] = {}

    # ------------------------------------------------------------ frontiers

    def groups(self) -> list[Int32s]:
        """Return the cells of all frontiers, without those that are vain."""
        frontiers = yamauchi_frontiers(self.belief.evidence, self._own.least_cells)
        groups = [cells[~self._vain.flat[cells]] for cells in frontiers]
        return [group for group in groups if len(group)]

    def open(self, cell: Cell) -> bool:
        """Return whether a cell still belongs to a frontier."""
        nx = self.belief.frame.nx
        iy, ix = divmod(cell, nx)
        around = self.belief.evidence[max(iy - 1, 0) : iy + 2, max(ix - 1, 0) : ix + 2]
        return bool(around.size and self.belief.evidence[iy, ix] < 0 and (around == 0).any()) and not self._vain[iy, ix]

    def in_vain(self, here_m: Point, reach_m: float) -> Int32s:
        """Leave out, for all robots, the frontier cells in sight of a place within *reach_m*; return them."""
        frame = self.belief.frame
        mask = np.zeros(self._vain.shape, np.bool_)
        for group in self.groups():
            mask.flat[group] = True
        cells = np.flatnonzero(mask)
        rows, columns = np.divmod(cells, frame.nx)
        (left, low), size = frame.origin_m, frame.cell_m
        far = (
            elementary.hypots(left + (columns + 0.5) * size - here_m[0], low + (rows + 0.5) * size - here_m[1])
            > reach_m
        )
        mask.flat[cells[far]] = False
        seen = in_sight(self.terrain.clear(), frame.cell_at(here_m), mask)
        self._vain |= seen
        return np.flatnonzero(seen).astype(np.int32)

    def bar(self, me: Address, cells: Int32s) -> None:
        """Leave out *cells* for one robot, which has not reached them."""
        self._barred.setdefault(me, np.zeros(self._vain.shape, np.bool_)).flat[cells] = True

    # ------------------------------------------------------------ choices

    def choose(self, me: Address, here_m: Point) -> Cell | None:
        """Choose a target for *me*, or for the whole team; return that of *me*, None if no way leads to any."""
        groups = self.groups()
        if not groups:
            return None
        if not self.together:
            way = self.way_to_nearest(me, here_m, groups)
            return None if way is None else way[-1]
        team = {**self.places_m, me: here_m}
        robots = sorted(team)
        cells = np.concatenate(groups)
        costs = np.array([self._costs(robot, team[robot], cells) for robot in robots])
        choice = self._by_cells(costs, cells) if self._algorithm == "utility" else self._by_groups(costs, groups)
        self.goals = {robot: int(cells[at]) for robot, at in zip(robots, choice, strict=True) if at is not None}
        self.round += 1
        return self.goals.get(me)

    def way_to_nearest(
        self, me: Address, here_m: Point, groups: list[Int32s], bodies_m: Floats | None = None
    ) -> list[Cell] | None:
        """Return the cheapest way to a cell of *groups*, round *bodies_m* (n, 3), places and radii, if given."""
        terrain, radius_m = self.terrain, self.radii_m[me]
        ends = np.zeros(self._vain.shape, np.bool_)
        for group in groups:
            ends.flat[group] = True
        if me in self._barred:
            ends &= ~self._barred[me]
        entry, passable = terrain.entry(here_m, radius_m), terrain.passable(radius_m)
        if not entry:
            return None
        if bodies_m is not None:
            room = ~self._covered(bodies_m, radius_m)
            passable, ends = passable & room, ends & room
        way = nearest(passable, terrain.extra(), entry[-1], ends, terrain.reading)
        return None if way is None else entry[:-1] + [int(cell) for cell in way]

    def _covered(self, bodies_m: Floats, radius_m: float) -> Bools:
        """Return where a robot would touch one of *bodies_m*."""
        frame = self.belief.frame
        rows, columns = np.ogrid[: frame.ny, : frame.nx]
        (left, low), size = frame.origin_m, frame.cell_m
        covered = np.zeros(self._vain.shape, np.bool_)
        for x_m, y_m, other_m in bodies_m:
            off_x, off_y = left + (columns + 0.5) * size - x_m, low + (rows + 0.5) * size - y_m
            covered |= off_x * off_x + off_y * off_y < (radius_m + other_m + 0.5 * size) ** 2
        return covered

    def _costs(self, robot: Address, place_m: Point, cells: Int32s) -> Floats:
        """Return what it costs a robot to reach each of *cells*, inf where no way leads."""
        ends = np.zeros(self._vain.shape, np.bool_)
        ends.flat[cells] = True
        costs = self.terrain.costs(place_m, self.radii_m[robot], ends).flat[cells]
        if robot in self._barred:
            costs[self._barred[robot].flat[cells]] = math.inf
        return costs

    def _by_cells(self, costs: Floats, cells: Int32s) -> list[int | None]:
        nx = self.belief.frame.nx
        places = np.stack((cells % nx, cells // nx), axis=1).astype(np.float64)
        return by_utility(costs, places, self._range, self._own.cost_weight)

    def _by_groups(self, costs: Floats, groups: list[Int32s]) -> list[int | None]:
        """Return the number of a cell for each robot: that of its group with the cheapest way."""
        starts = np.cumsum([0] + [len(group) for group in groups])
        of_group = np.stack([costs[:, a:b].min(axis=1) for a, b in pairwise(starts.tolist())], axis=1)
        choice: list[int | None] = []
        for robot, group in enumerate(by_assignment(of_group)):
            own = of_group[robot]
            taken = int(own.argmin()) if group is None else group
            a, b = starts[taken], starts[taken + 1]
            choice.append(int(a + costs[robot, a:b].argmin()) if np.isfinite(own[taken]) else None)
        return choice


# ---------------------------------------------------------------- who goes where


def yamauchi_frontiers(evidence: Evidence, least_cells: int) -> list[Int32s]:
    """Return the cells, ascending, of each frontier of at least *least_cells* in *evidence* (ny, nx).

    Frontiers are in the order of their lowest cells, which are numbered ``iy * nx + ix``. What lies beyond the grid is
    not unknown: no frontier is there.
    """
    unknown = np.pad(evidence == 0, 1)
    rows = unknown[:-2] | unknown[1:-1] | unknown[2:]
    beside = rows[:, :-2] | rows[:, 1:-1] | rows[:, 2:]
    group, _ = ndimage.label((evidence < 0) & beside, structure=np.ones((3, 3), np.int8))
    cells = np.flatnonzero(group).astype(np.int32)
    of_cell = group.ravel()[cells]
    order = np.argsort(of_cell, kind="stable")
    starts = np.flatnonzero(np.diff(of_cell[order])) + 1
    return [part for part in np.split(cells[order], starts) if len(part) >= max(least_cells, 1)]


def by_utility(costs: Floats, places: Floats, reach: float, weight: float) -> list[int | None]:
    """Return the frontier to which each robot goes, None where no way leads to any.

    *costs* (robots, frontiers), inf where no way leads; *places* (frontiers, 2) as *reach*, the scanner's range.
    Utilities begin at 1. One falls by max(0, 1 - away / reach) when a frontier at the distance *away* is taken, which
    is the chance that it is seen from there. Source: Burgard et al., 2005, Algorithm 1.
    """
    can: Bools = np.isfinite(costs)
    share = np.where(can, costs, 0.0) / max(float(costs[can].max(initial=0.0)), 1.0)
    utility, left = np.ones(costs.shape[1]), np.asarray(can.any(axis=1))
    chosen: list[int | None] = [None] * len(costs)
    while left.any():
        gain = np.where(can & left[:, None], utility - weight * share, -math.inf)
        row, frontier = divmod(int(gain.argmax()), costs.shape[1])
        chosen[row] = frontier
        left[row] = False
        away = elementary.hypots(*(places - places[frontier]).T)
        utility = utility - np.clip(1.0 - away / reach, 0.0, None)
    return chosen


def by_assignment(costs: Floats) -> list[int | None]:
    """Return the frontier to which each robot goes, each to another: of the largest assignments the cheapest.

    *costs* (robots, frontiers), inf where no way leads; None for a robot that is left over.
    """
    can: Bools = np.isfinite(costs)
    forbidden = 2.0 * len(costs) * (float(costs[can].max(initial=0.0)) + 1.0)
    chosen: list[int | None] = [None] * len(costs)
    for row, frontier in zip(*linear_sum_assignment(np.where(can, costs, forbidden)), strict=True):
        if can[row, frontier]:
            chosen[row] = int(frontier)
    return chosen
