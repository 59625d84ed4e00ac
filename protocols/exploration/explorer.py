"""An explorer: marks its map, is driven by schemas, and plans its way out of local minima (paper 001, section 3.8)."""

import math
from typing import Final

import numpy as np

from cosim.machine import Address, Command, Drive, Event, LinkCommand, LinkEvent, Outgoing, Reception
from cosim.navigation.frontier_fields import sum_of_frontiers, sum_of_obstacles
from cosim.navigation.schemas import Floats, beam_directions
from cosim.observation import Observation
from cosim.units import S, Time, from_seconds
from protocols.exploration.belief import Belief
from protocols.exploration.escaping import Escape, Overlay
from protocols.exploration.journal import Explored, FrontierGivenUp, PathLaid, PathLeft, Stalled
from protocols.exploration.knowledge import Knowledge
from protocols.exploration.parameters import Parameters
from protocols.exploration.records import Records
from protocols.exploration.sharing import Sharing
from protocols.exploration.stalling import Stalling
from protocols.exploration.steering import Steering

_NOTHING: Final = 1e-9
"""A sum of forces that is smaller is zero."""
_TRIES: Final = 3
"""A frontier that has been planned to so often and is still there is given up."""
_LOOK_TICKS: Final = 5
"""So often a robot on a path looks whether a frontier is in sight."""


class Explorer:
    """The machine of one robot."""

    def __init__(
        self,
        parameters: Parameters,
        knowledge: Knowledge,
        me: Address,
        belief: Belief,
        sharing: Sharing | None,
        records: Records,
    ) -> None:
        """Explore with the map *belief*; tell others of it by *sharing*, if each has its own."""
        self.me = me
        self.belief = belief
        self.records = records
        self.knowledge = knowledge
        self._own = parameters
        self._schemas = parameters.schemas
        self._sharing = sharing
        self._overlay = Overlay(belief)
        self._escape = Escape(parameters.escape, belief, knowledge.radii_m[me], knowledge.range_m)
        tick_s = knowledge.tick / from_seconds(1.0)
        escape = parameters.escape
        patience = math.inf if escape.patience_s is None else escape.patience_s / tick_s
        self._stalling = Stalling(round(escape.period_s / tick_s), escape.box_m, patience)
        self._steering = Steering(
            parameters.steering, beam_directions(knowledge.beams), knowledge.radii_m[me], knowledge.speeds_mps[me]
        )
        self._beams = beam_directions(knowledge.beams)
        self._commands: list[Command] = []
        self._events: list[Event] = []
        self._done_at: int | None = None
        """The map's version when nothing was left to explore."""
        self._tries: dict[int, int] = {}
        self._goal = -1
        self._here: tuple[float, float] | None = None
        self._driving = False

    # ------------------------------------------------------------ the contract of machines

    @property
    def finished(self) -> bool:
        """Whether nothing is left to explore, and all has been told."""
        return self._done_at == self.belief.version and (self._sharing is None or self._sharing.silent)

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        """Take a piece of another's map."""
        told = None if self._sharing is None else self._sharing.receive(data, reception, now)
        if told is not None:
            self.belief.merge(*told)

    def link(self, event: LinkEvent, now: Time) -> None:
        """Take no notice: maps are told to whom it may concern."""

    def observe(self, observation: Observation, now: Time) -> None:
        """Do the nine steps of the combined algorithm."""
        here = observation.x_m, observation.y_m
        self._count(observation, here)
        self._here = here
        ranges_m = observation.ranges_m
        changed = self.belief.mark(here, ranges_m, self._beams, self._bodies(observation, now))
        if self._sharing is not None:
            self._sharing.changed(changed, self.belief.occupied(changed).tolist())
            self._sharing.tick(*here, now)
        if self._done_at == self.belief.version:
            self._halt()
            return
        self._stalling.note(here, self._follow(here) or len(changed) > 0)
        heading = self._heading(here, observation)
        if heading is None or self._stalling.stalled:
            self._stall("no force" if heading is None else "no way made", here)
            heading = self._heading(here, observation)
        if heading is None or (self._done_at is not None and self._done_at == self.belief.version):
            self._halt()
            return
        self._commands.append(self._steering.drive(heading, observation.heading_rad, ranges_m))
        self._driving = True

    def wake(self, now: Time) -> None:
        """Do nothing: there are no deadlines."""

    def wake_at(self) -> Time | None:
        """Return None."""
        return None

    def outbox(self) -> list[Outgoing | LinkCommand]:
        """Drain messages."""
        return [] if self._sharing is None else self._sharing.drain()

    def commands(self) -> list[Command]:
        """Drain motion commands."""
        commands, self._commands = self._commands, []
        return commands

    def events(self) -> list[Event]:
        """Drain rows for the trace."""
        events, self._events = self._events, []
        if self._sharing is not None and self._sharing.bad:
            events += self._sharing.bad
            self._sharing.bad = []
        return events

    # ------------------------------------------------------------ moving

    def _bodies(self, observation: Observation, now: Time) -> Floats:
        """Return the places and radii of the others, as far as they are known: they are no obstacles of the map."""
        knowledge = self.knowledge
        bodies = [(x, y, knowledge.radii_m[other]) for other, x, y in observation.sightings]
        if knowledge.shared is not None:
            knowledge.places_m[self.me] = observation.x_m, observation.y_m
            told = [(other, place, knowledge.tick / S) for other, place in knowledge.places_m.items()]
        elif self._sharing is not None:
            told = self._sharing.places(now)
        for other, (x, y), age_s in told:
            if other != self.me and other not in observation.visible:
                slack_m = age_s * knowledge.speeds_mps[other]
                bodies.append((x, y, knowledge.radii_m[other] + slack_m))
        return np.array(bodies, np.float64).reshape(-1, 3)

    def _count(self, observation: Observation, here: tuple[float, float]) -> None:
        records = self.records
        records.way_m += 0.0 if self._here is None else math.dist(here, self._here)
        records.blocked += observation.blocked
        records.escape_steps += self._overlay.underway
        records.steps += not self._overlay.underway

    def _heading(self, here: tuple[float, float], observation: Observation) -> float | None:
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

    def _follow(self, here: tuple[float, float]) -> bool:
        """Take back what of the path has been walked, or all of it if a frontier is in sight (step 2).

        Return whether any has been walked.
        """
        overlay = self._overlay
        if not overlay.underway:
            return False
        walked = overlay.pass_by(here, self._schemas.obstacle_m)
        looks = (self.records.steps + self.records.escape_steps) % _LOOK_TICKS == 0
        if overlay.underway and looks and self._escape.sees(here, overlay.frontiers()):
            overlay.clear()
            self._events.append(PathLeft("frontier in sight"))
            self._stalling.begin()
        elif not overlay.underway:
            self._events.append(PathLeft("walked"))
            self._stalling.begin()
        return walked

    def _stall(self, why: str, here: tuple[float, float]) -> None:
        """Lay a path to the nearest frontier (step 8); give up frontiers to which none leads."""
        self.records.stalls += 1
        self._events.append(Stalled(why))
        self._stalling.begin()
        if not self._own.escape.enabled:
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

    def _near(self, goal: int, frontiers: "np.ndarray[tuple[int, ...], np.dtype[np.uint8]]") -> list[int]:
        """Return the goal itself if it is a frontier, else those frontiers that it was to look at."""
        frame = self.belief.frame
        if frontiers[goal // frame.nx, goal % frame.nx]:
            return [goal]
        cells = np.flatnonzero(frontiers[:, : frame.nx])
        away = np.hypot(cells % frame.nx - goal % frame.nx, cells // frame.nx - goal // frame.nx)
        reach = self.knowledge.range_m / frame.cell_m
        return [int(cell) for cell in cells[away <= reach]] or [int(cells[np.argmin(away)])]

    def _give_up(self, cells: list[int], why: str) -> None:
        self._overlay.give_up(cells)
        self.records.given_up += len(cells)
        self._events += [FrontierGivenUp(*self.belief.frame.centre_m(cell), why) for cell in cells]

    def _halt(self) -> None:
        if self._driving:
            self._commands.append(Drive(0.0, 0.0))
        self._driving = False
