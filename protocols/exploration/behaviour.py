"""The paper's behaviour: motor schemas, and a path out of local minima (paper 001, sections 3.3 to 3.8).

What the paper leaves open, and our reading of it:

- "Once the robot is within sensor range of a frontier (not necessarily the goal of its current path), the generated
  path is then removed" (3.7). But a robot often stalls with a frontier in sight, and would remove its path at once. So
  a frontier ends one path at most, and none that was laid while it was in sight.
- How an exploration ends. A frontier that is in line of sight within the sensors' range of where three paths have
  ended, and is a frontier all the same, is *vain*: all that share the map leave it out. The robot ignores a frontier to
  which no way leads, nor to a place from which it can be seen, and one that it has not reached by three paths; before
  it finishes it tries those once more. A robot without any frontier left has finished, as long as the map stays the
  same.
- A robot that stalls on its path follows the next one alone: there may be many frontiers behind walls, and the place to
  look from may be as near to a wall as its body fits, where obstacles would repel it. So only obstacles that it almost
  touches repel it then.
- A robot counts as caught when the box of its movement during a period has become too small (section 3.5). Beyond the
  paper, it also does when it has learnt nothing for long: drawn to a frontier that it cannot see, it may circle.
"""

import math
from typing import Final

import numpy as np

import cosim.elementary as elementary
from cosim.arrays import Floats
from cosim.geometry.grids import Cell
from cosim.geometry.planning import Point
from cosim.jit import njit
from cosim.machine import Event
from cosim.navigation.frontier_fields import Vector
from cosim.observation import Observation
from cosim.units import S
from protocols.exploration.escaping import Escape
from protocols.exploration.events import Counters, Explored, PathLaid, PathLeft, Stalled
from protocols.exploration.forces import Forces, attract, forces
from protocols.exploration.information import Attraction
from protocols.exploration.overlay import Exclusions, Overlay
from protocols.exploration.parameters import Parameters
from protocols.exploration.terrain import Terrain

_NOTHING: Final = 1e-9
"""Sum of forces below which it counts as zero."""
_TRIES: Final = 3
"""Failed paths in a row after which a frontier is postponed."""
_LOOK_TICKS: Final = 5
"""Interval between looks for a frontier in sight, on a path."""
_WALKED: Final = "walked"
_AT_LOOKOUT_CELLS: Final = 1.0
"""Distance from a lookout at which a robot looks."""


class Behaviour:
    """What leads one robot."""

    def __init__(
        self,
        parameters: Parameters,
        terrain: Terrain,
        counters: Counters,
        events: list[Event],
        radius_m: float,
        range_m: float,
        tick: int,
    ) -> None:
        """Lead a body of *radius_m*, whose sensors reach *range_m*, by the map of *terrain*."""
        belief = terrain.belief
        self.belief = belief
        self.pull: Vector = 0.0, 0.0
        """Force of whatever else attracts it."""
        self._schemas = parameters.schemas
        self._counters = counters
        self._events = events
        self._overlay = Overlay(belief, range_m / belief.frame.cell_m)
        escape = parameters.escape
        self._escape = Escape(escape, terrain, radius_m, range_m) if escape.enabled else None
        self._exclusions = Exclusions(belief, self._overlay, counters, events)
        patience = math.inf if escape.patience_s is None else escape.patience_s * S / tick
        self._period = round(escape.period_s * S / tick)
        self._stalling = Stalling(self._period, escape.box_m, patience)
        self._touching_m = radius_m + belief.frame.cell_m
        self._grid = *belief.frame.origin_m, belief.frame.cell_m
        self._scratch = np.zeros_like(belief.frontier)
        schemas, weight = parameters.schemas, parameters.schemas.information
        self._attraction = Attraction(belief, schemas.frontier_m, range_m, weight) if weight else None
        self._ticks = 0
        self._failed = 0
        """Paths in a row on which it has stalled."""
        self._caught = False
        """True if it was caught at the last tick; without an escape it counts as caught once, however long it lasts."""
        self._done_at: tuple[int, int] | None = None
        """The map's version and the tick when nothing was left to explore."""
        self._stale = False
        """True if the map has changed since, and there are frontiers to which no way led."""

    @property
    def done(self) -> bool:
        """True if nothing is left to explore that has not been given up, by the map as it is."""
        return self._done_at is not None and self._done_at[0] == self.belief.version and not self._stale

    @property
    def underway(self) -> bool:
        """True if the robot is on a path out of a local minimum."""
        return self._overlay.underway

    @property
    def way(self) -> list[Cell]:
        """The cells of the path that it follows, from here on; empty if it follows none."""
        return self._overlay.way

    def lead(self, observation: Observation, gained: bool) -> float | None:
        """Return the desired heading; None to stand still. *gained*: cells have become known in this tick.

        Steps 2 to 9 of the combined algorithm (3.8).
        """
        here = observation.x_m, observation.y_m
        self._ticks += 1
        if self._done_at is not None and not self._resumes(self._done_at, here):
            return None
        walked = self._follow(here, observation)
        self._stalling.note(here, walked or gained)
        heading = self._heading(here, observation)
        why = "no force" if heading is None else "no way made" if self._stalling.stalled else None
        if why is None:
            self._caught = False
            return heading
        if not self._caught:
            self._stall(why, here)
            return None if self.done else self._heading(here, observation)
        if self._ticks % self._period == 0 and not self._overlay.any_frontier():
            self._finish()
        return heading

    # ------------------------------------------------------------ steps 4 to 7

    def _heading(self, here: Point, observation: Observation) -> float | None:
        """Return the direction of the sum of all schemas, or None if it is zero (equation 2)."""
        schemas, robots = self._schemas, self._from_robots(here, observation)
        alone = self._failed > 0 and self._overlay.underway
        fx, fy, ox, oy = self._fields(here, alone)
        fx, fy = schemas.frontier_gain * fx, schemas.frontier_gain * fy
        ox, oy = -schemas.obstacle_gain * ox, -schemas.obstacle_gain * oy
        x, y = fx + ox + robots[0] + self.pull[0], fy + oy + robots[1] + self.pull[1]
        if x * x + y * y <= _NOTHING * _NOTHING:
            return None
        self._counters.drawn(fx * fx + fy * fy, ox * ox + oy * oy, robots[0] * robots[0] + robots[1] * robots[1])
        return elementary.atan2(y, x)

    def _fields(self, here: Point, alone: bool) -> Forces:
        """Return the sums over frontiers and path, and over obstacles, with gain 1.

        With the path *alone*, sum only over that and obstacles that the body would touch if it came half a cell nearer.
        """
        schemas, overlay, belief = self._schemas, self._overlay, self.belief
        left, low, size = self._grid
        fields = forces(
            belief.frontier,
            overlay.ignored,
            belief.vain,
            overlay.path,
            overlay.underway,
            alone,
            belief.evidence,
            left,
            low,
            size,
            here[0],
            here[1],
            schemas.frontier_m,
            min(schemas.obstacle_m, self._touching_m) if alone else schemas.obstacle_m,
            schemas.in_sight,
        )
        if self._attraction is None or alone:
            return fields
        layers, scratch = (belief.frontier, overlay.ignored, belief.vain, overlay.path), self._scratch
        attract(*layers, alone, left, low, size, *here, schemas.frontier_m, scratch)
        return (*self._attraction.to(here, scratch), *fields[2:])

    def _from_robots(self, here: Point, observation: Observation) -> Vector:
        """Return the force of the robots in sight (equation 5)."""
        rx = ry = 0.0
        for _, at_x, at_y in observation.sightings:
            dx, dy = at_x - here[0], at_y - here[1]
            away = math.sqrt(dx * dx + dy * dy)
            if _NOTHING < away <= self._schemas.robot_m:
                strength = self._schemas.robot_gain / (away * away * away)
                rx -= strength * dx
                ry -= strength * dy
        return rx, ry

    # ------------------------------------------------------------ steps 2 and 8

    def _follow(self, here: Point, observation: Observation) -> bool:
        """Remove what has been walked of the path, or all of it if a new frontier is in sight (step 2).

        Return whether any has been walked.
        """
        overlay = self._overlay
        if not overlay.underway:
            return False
        walked = overlay.pass_by(here, self._schemas.obstacle_m)
        why = self._why_leave(here)
        if why is not None:
            self._leave(why)
        if why == _WALKED:
            self._exclusions.look(here, bool(observation.sightings))
        return walked

    def _why_leave(self, here: Point) -> str | None:
        overlay = self._overlay
        if not overlay.underway:
            return _WALKED
        if self._ticks % _LOOK_TICKS:
            return None
        new = overlay.new_in_sight(here)
        overlay.note(new)
        return "frontier in sight" if len(new) else None

    def _leave(self, why: str) -> None:
        self._overlay.clear()
        self._events.append(PathLeft(why))
        self._stalling.begin()
        self._failed = 0

    def _stall(self, why: str, here: Point) -> None:
        """Lay a path to the nearest frontier (step 8), or find that nothing is left."""
        self._counters.stalls += 1
        self._events.append(Stalled(why))
        if self._escape is None:
            self._caught = True
            if not self._overlay.any_frontier():
                self._finish()
            return
        self._stalling.begin()
        if self._overlay.underway:
            self._overlay.clear()
            self._events.append(PathLeft("stalled"))
            self._failed += 1
            if self._failed == _TRIES:
                self._exclusions.postpone()
                self._failed = 0
        self._plan(self._escape, here)

    def _plan(self, escape: Escape, here: Point) -> None:
        """Lay a path to the nearest frontier; give up those to which none leads."""
        overlay, exclusions = self._overlay, self._exclusions
        while overlay.any_frontier() or exclusions.take_up():
            way = escape.way(here, overlay.frontiers(), exclusions.tried, exclusions.looked)
            if way is not None:
                lookout_m = _AT_LOOKOUT_CELLS * self.belief.frame.cell_m
                overlay.note(overlay.new_in_sight(here))
                overlay.lay(way.cells[1:] or way.cells, lookout_m if way.lookout else None)
                x_m, y_m = self.belief.frame.centre_m(way.cells[-1])
                self._events.append(PathLaid(x_m, y_m, len(way.cells), way.in_sight))
                return
            if not escape.entry(here):
                return  # by its map it cannot stand where it stands: that says nothing about frontiers
            exclusions.ignore("no way leads there")
        self._finish()

    # ------------------------------------------------------------ the end

    def _finish(self) -> None:
        self._done_at = self.belief.version, self._ticks
        self._events.append(Explored())

    def _resumes(self, done_at: tuple[int, int], here: Point) -> bool:
        """Return whether a robot that has finished goes on: others have reported frontiers, or ways there."""
        version, tick = done_at
        if version != self.belief.version:
            self._done_at = self.belief.version, tick
            self._stale = self._escape is not None and self._overlay.any_ignored()
        if self._overlay.any_frontier():
            self._done_at, self._stale = None, False
            return True
        if self._escape is None or not self._stale or self._ticks - tick < self._period:
            return False
        self._done_at, self._stale = None, False
        self._exclusions.reconsider()
        self._plan(self._escape, here)
        return not self.done


# ---------------------------------------------------------------- whether it is caught


@njit(cache=True)
def longer_side(places: Floats, row: int, x: float, y: float) -> float:
    """Set a *row* of *places* (n, 2) to (x, y); return the longer side of the box about all of them."""
    places[row, 0], places[row, 1] = x, y
    low_x = low_y = math.inf
    high_x = high_y = -math.inf
    for k in range(places.shape[0]):
        low_x, high_x = min(low_x, places[k, 0]), max(high_x, places[k, 0])
        low_y, high_y = min(low_y, places[k, 1]), max(high_y, places[k, 1])
    return max(high_x - low_x, high_y - low_y)


class Stalling:
    """A robot's places during the last *ticks*, and the time since it gained anything."""

    def __init__(self, ticks: int, box_m: float, patience_ticks: float) -> None:
        self._box_m = box_m
        self._patience = patience_ticks
        self._barren = 0
        self._ticks = max(1, ticks)
        self._places = np.zeros((self._ticks, 2))
        self._side_m = 0.0
        """Longer side of the box about the places noted."""
        self._noted = 0

    def note(self, place_m: Point, gain: bool) -> None:
        """Note where the robot is at a tick, and whether it has learnt of a cell or got on along its path."""
        self._barren = 0 if gain else self._barren + 1
        self._side_m = longer_side(self._places, self._noted % self._ticks, *place_m)
        self._noted += 1

    def begin(self) -> None:
        """Forget all places, as something else is tried from now on."""
        self._noted = 0
        self._barren = 0

    @property
    def stalled(self) -> bool:
        """True if the box of a whole period is too small, or nothing was gained for too long."""
        return self._barren > self._patience or (self._noted >= self._ticks and self._side_m < self._box_m)
