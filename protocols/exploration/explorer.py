"""An explorer: marks its map, tells others of it, and goes where its behaviour, or a rival of it, leads."""

import math
from typing import Final, Protocol

import numpy as np

from cosim.arrays import Floats
from cosim.geometry.planning import Point
from cosim.machine import Address, Command, Drive, Event, LinkCommand, LinkEvent, Outgoing, Reception
from cosim.navigation.schemas import beam_directions
from cosim.observation import Observation
from cosim.units import S, Time
from protocols.exploration.events import Counters
from protocols.exploration.parameters import Parameters
from protocols.exploration.positioning import Given, Positioning, turned
from protocols.exploration.setup import Setup
from protocols.exploration.steering import Steering, without_lone
from protocols.mapping.belief import Belief
from protocols.mapping.sharing import Sharing
from protocols.wire import BadBytes

_ROUNDING: Final = 1e-9
_NOTHING: Final = np.empty(0, np.int32)
_NOBODY: Final = np.empty((0, 3))


class Leader(Protocol):
    """What decides where a robot goes."""

    @property
    def done(self) -> bool:
        """Whether nothing is left to explore."""

    @property
    def underway(self) -> bool:
        """Whether the robot is on a path out of a local minimum."""

    def lead(self, observation: Observation, gained: bool) -> float | None:
        """Return the desired heading; None to stand still. To be asked once a tick."""


class Explorer:
    """The machine of one robot."""

    def __init__(
        self,
        parameters: Parameters,
        setup: Setup,
        me: Address,
        belief: Belief,
        leader: Leader,
        sharing: Sharing | None,
        counters: Counters,
        events: list[Event],
        positioning: Positioning | None = None,
    ) -> None:
        """Explore with the map *belief*; tell others of it by *sharing*, if each has its own."""
        self.me = me
        self.belief = belief
        self.counters = counters
        self.setup = setup
        self._leader = leader
        self._sharing = sharing
        self._events = events
        self._false_returns = parameters.false_returns
        self._beams = beam_directions(setup.beams)
        self._steering = Steering(parameters.steering, self._beams, setup.radii_m[me], setup.speeds_mps[me])
        self._commands: list[Command] = []
        self._here: Point | None = None
        self._positioning = Given() if positioning is None else positioning
        self.place_m: Point | None = None
        """Where it takes itself to be on its map."""
        self._heading: float | None = None
        self._pace = 0.0
        self._gained = False
        self._driving = False
        self._rests = False
        """Whether it has done, and looks no more: two that see a cell otherwise would tell each other for ever."""

    # ------------------------------------------------------------ the contract of machines

    @property
    def finished(self) -> bool:
        """Whether nothing is left to explore, and all has been told."""
        return self._leader.done and (self._sharing is None or self._sharing.silent)

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        """Take a piece of another's map; robots with a map in common have nothing to tell each other."""
        if self._sharing is None:
            self._events.append(BadBytes(reception.source, len(data)))
            return
        told = self._sharing.receive(data, reception, now)
        if told is not None:
            self.belief.merge(*told)

    def link(self, event: LinkEvent, now: Time) -> None:
        """Take news about links, if maps are told over such."""
        if self._sharing is not None:
            self._sharing.link(event, now)

    def observe(self, observation: Observation, now: Time) -> None:
        """Mark what is seen, tell it, and go on."""
        self._count(observation)
        ranges_m = without_lone(observation.ranges_m) if self._false_returns else observation.ranges_m
        found, turned_rad, share = self._positioning.locate(observation, ranges_m, self._beams)
        here = self.place_m = found.x_m, found.y_m
        beams = self._beams if turned_rad == 0.0 else turned(self._beams, turned_rad)
        changed = _NOTHING if self._rests else self.belief.mark(here, ranges_m, beams, self._bodies(found, now))
        if self._sharing is not None:
            self._sharing.changed(changed, self.belief.occupied(changed).tolist())
            self._sharing.tick(*here, now, found.sightings)
        heading = self._lead(found, len(changed) > 0, share)
        if heading is not None and share > 0.0:
            order = self._steering.drive(heading - turned_rad, observation.heading_rad, ranges_m)
            slowed = order if share == 1.0 else Drive(share * order.speed_mps, share * order.turn_radps)
            self._commands.append(slowed)
        elif self._driving:
            self._commands.append(Drive(0.0, 0.0))
        self._driving = heading is not None and share > 0.0
        self._rests = heading is None and self._leader.done

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
        events = []
        if self._events:
            events = self._events.copy()
            self._events.clear()
        if self._sharing is not None and self._sharing.bad:
            events += self._sharing.bad
            self._sharing.bad = []
        return events

    # ------------------------------------------------------------ moving

    def _lead(self, found: Observation, gained: bool, share: float) -> float | None:
        """Return the desired heading. With a *share* of its speed the leader is asked as much less often.

        So it takes a robot that is slow, or waits, for no more stalled than another: its time is the robot's way.
        """
        self._pace += share
        self._gained |= gained
        if self._pace < 1.0 - _ROUNDING:
            self.counters.waited += share == 0.0
            return self._heading
        self._pace -= 1.0
        self._heading = self._leader.lead(found, self._gained)
        self._gained = False
        return self._heading

    def _bodies(self, observation: Observation, now: Time) -> Floats:
        """Return the places and radii of the others, as far as they are known: they are no obstacles of the map."""
        setup, visible = self.setup, observation.visible
        if setup.shared is not None:
            setup.places_m[self.me] = observation.x_m, observation.y_m
        if setup.size == 1:
            return _NOBODY
        bodies = [(x, y, setup.radii_m[other]) for other, x, y in observation.sightings]
        if setup.shared is not None:
            for other, (x, y) in setup.places_m.items():
                if other != self.me and other not in visible:
                    bodies.append((x, y, self._reach_m(other, setup.tick / S)))
        elif self._sharing is not None:
            for other, (x, y), age_s in self._sharing.places(now):
                if other != self.me and other not in visible:
                    bodies.append((x, y, self._reach_m(other, age_s)))
        return np.array(bodies) if bodies else _NOBODY

    def _reach_m(self, other: Address, age_s: float) -> float:
        """Return how far from where it was *age_s* ago the body of another may reach."""
        return self.setup.radii_m[other] + age_s * self.setup.speeds_mps[other]

    def _count(self, observation: Observation) -> None:
        counters, here = self.counters, (observation.x_m, observation.y_m)
        counters.ticks += 1
        counters.way_m += 0.0 if self._here is None else math.dist(here, self._here)
        counters.blocked += observation.blocked
        if self._leader.underway:
            counters.escape_steps += 1
        else:
            counters.steps += 1
        self._here = here
