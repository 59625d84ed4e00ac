"""The paper's behaviour: motor schemas, and a path out of local minima (paper 001, sections 3.3 to 3.8)."""

import math
from typing import Final

import numpy as np

from cosim.geometry.planning import Point
from cosim.machine import Event
from cosim.navigation.frontier_fields import sum_of_frontiers, sum_of_obstacles
from cosim.observation import Observation
from cosim.units import S
from protocols.exploration.belief import Belief, Bytes
from protocols.exploration.escaping import Escape, Overlay
from protocols.exploration.journal import Explored, FrontierGivenUp, PathLaid, PathLeft, Stalled
from protocols.exploration.parameters import Parameters
from protocols.exploration.records import Records
from protocols.exploration.stalling import Stalling

_NOTHING: Final = 1e-9
"""A sum of forces that is smaller is zero."""
_TRIES: Final = 3
"""A frontier that has been planned to so often and is still there is given up."""
_LOOK_TICKS: Final = 5
"""So often a robot on a path looks whether a frontier is in sight."""


class Behaviour:
    """What leads one robot."""

    def __init__(
        self,
        parameters: Parameters,
        belief: Belief,
        records: Records,
        events: list[Event],
        radius_m: float,
        range_m: float,
        tick: int,
    ) -> None:
        """Lead a body of *radius_m*, whose sensors reach *range_m*, by the map *belief*."""
        self.belief = belief
        self._schemas = parameters.schemas
        self._escape_enabled = parameters.escape.enabled
        self._records = records
        self._events = events
        self._overlay = Overlay(belief)
        self._escape = Escape(parameters.escape, belief, radius_m, range_m)
        self._reach = range_m / belief.frame.cell_m
        escape = parameters.escape
        patience = math.inf if escape.patience_s is None else escape.patience_s * S / tick
        self._stalling = Stalling(round(escape.period_s * S / tick), escape.box_m, patience)
        self._tries: dict[int, int] = {}
        self._ticks = 0
        self._stands = False
        """Whether no force drew it at the last tick, and there is no way out."""
        self._done_at: int | None = None
        """The map's version when nothing was left to explore."""

    @property
    def done(self) -> bool:
        """Whether nothing is left to explore that has not been given up."""
        return self._done_at == self.belief.version

    @property
    def underway(self) -> bool:
        """Whether the robot is on a path out of a local minimum."""
        return self._overlay.underway

    def lead(self, observation: Observation, gained: bool) -> float | None:
        """Return the desired heading; None to stand still. *gained*: cells have come to be known in this tick.

        Steps 2 to 9 of the combined algorithm (3.8).
        """
        if self.done:
            return None
        here = observation.x_m, observation.y_m
        self._ticks += 1
        self._stalling.note(here, self._follow(here) or gained)
        heading = self._heading(here, observation)
        if (heading is None and not self._stands) or self._stalling.stalled:
            self._stall("no force" if heading is None else "no way made", here)
            heading = None if self.done else self._heading(here, observation)
        self._stands = heading is None and not self._escape_enabled
        return heading

    def _heading(self, here: Point, observation: Observation) -> float | None:
        """Return where the sum of all schemas points, or None if it is zero (equation 2)."""
        schemas, frame = self._schemas, self.belief.frame
        (left, low), size = frame.origin_m, frame.cell_m
        fx, fy = sum_of_frontiers(self._overlay.attracting(), left, low, size, *here, schemas.frontier_m)
        ox, oy = sum_of_obstacles(self.belief.evidence, left, low, size, *here, schemas.obstacle_m, schemas.in_sight)
        x = schemas.frontier_gain * fx - schemas.obstacle_gain * ox
        y = schemas.frontier_gain * fy - schemas.obstacle_gain * oy
        for _, at_x, at_y in observation.sightings:
            dx, dy = at_x - here[0], at_y - here[1]
            away = math.hypot(dx, dy)
            if _NOTHING < away <= schemas.robot_m:
                x -= schemas.robot_gain * dx / away**3
                y -= schemas.robot_gain * dy / away**3
        return math.atan2(y, x) if math.hypot(x, y) > _NOTHING else None

    def _follow(self, here: Point) -> bool:
        """Take back what of the path has been walked, or all of it if a frontier is in sight (step 2).

        Return whether any has been walked.
        """
        overlay = self._overlay
        if not overlay.underway:
            return False
        walked = overlay.pass_by(here, self._schemas.obstacle_m)
        why = self._why_leave(here)
        if why is not None:
            overlay.clear()
            self._events.append(PathLeft(why))
            self._stalling.begin()
        return walked

    def _why_leave(self, here: Point) -> str | None:
        if not self._overlay.underway:
            return "walked"
        looks = self._ticks % _LOOK_TICKS == 0
        return "frontier in sight" if looks and self._escape.sees(here, self._overlay.frontiers()) else None

    def _stall(self, why: str, here: Point) -> None:
        """Lay a path to the nearest frontier (step 8); give up frontiers to which none leads."""
        self._records.stalls += 1
        self._events.append(Stalled(why))
        self._stalling.begin()
        if not self._escape_enabled:
            return
        overlay = self._overlay
        overlay.clear()
        while True:
            frontiers = overlay.frontiers()
            if not frontiers.any():
                self._done_at = self.belief.version
                self._events.append(Explored())
                return
            found = self._escape.way(here, frontiers)
            if found is None:
                self._give_up(np.flatnonzero(frontiers[:, : self.belief.frame.nx]).tolist(), "no way leads there")
                continue
            cells, in_sight = found
            goal = cells[-1]
            self._tries[goal] = self._tries.get(goal, 0) + 1
            if self._tries[goal] <= _TRIES:
                x_m, y_m = self.belief.frame.centre_m(goal)
                overlay.lay(cells)
                overlay.pass_by(here, 0.0)
                self._events.append(PathLaid(x_m, y_m, len(cells), in_sight))
                return
            self._give_up(self._near(goal, frontiers), "tried too often")

    def _near(self, goal: int, frontiers: Bytes) -> list[int]:
        """Return the goal itself if it is a frontier, else those frontiers that it was to look at."""
        frame = self.belief.frame
        if frontiers[goal // frame.nx, goal % frame.nx]:
            return [goal]
        cells = np.flatnonzero(frontiers[:, : frame.nx])
        away = np.hypot(cells % frame.nx - goal % frame.nx, cells // frame.nx - goal // frame.nx)
        return [int(cell) for cell in cells[away <= self._reach]] or [int(cells[np.argmin(away)])]

    def _give_up(self, cells: list[int], why: str) -> None:
        self._overlay.give_up(cells)
        self._records.given_up += len(cells)
        self._events += [FrontierGivenUp(*self.belief.frame.centre_m(cell), why) for cell in cells]
