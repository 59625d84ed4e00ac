"""An explorer: it marks its map, shares it with the others, and goes where its behaviour, or a rival of it, leads.

An :class:`Explorer` is made of parameters, setup, a robot's number, a stream and the time at which it starts. Another
protocol that has robots explore makes one in the same way, asks :meth:`Explorer.wish` which way it would go instead of
calling ``observe``, and drives by itself.
"""

import math
from typing import Final, NamedTuple, Protocol

import numpy as np

from cosim.arrays import Floats, Int32s
from cosim.geometry.grids import Cell
from cosim.geometry.planning import Point
from cosim.machine import Address, Drains, Drive, LinkCommand, LinkEvent, Outgoing, Reception, drained
from cosim.navigation.schemas import beam_directions
from cosim.observation import Observation
from cosim.protocol import Belief, CellMap
from cosim.units import S, Time, from_seconds
from protocols.exploration.beacons import Tethered
from protocols.exploration.behaviour import Behaviour
from protocols.exploration.escaping import Escape
from protocols.exploration.events import Counters
from protocols.exploration.parameters import Parameters
from protocols.exploration.positioning import Filtered, Given, Positioning, turned
from protocols.exploration.rivals import Rival
from protocols.exploration.setup import Setup, WorldModel
from protocols.exploration.steering import Steering, without_lone
from protocols.mapping.sharing import Sharing
from protocols.wire import BadBytes

_ROUNDING: Final = 1e-9
_NOTHING: Final = np.empty(0, np.int32)
_NO_BODIES: Final = np.empty((0, 3))


class Leader(Protocol):
    """What decides where a robot goes."""

    @property
    def done(self) -> bool:
        """True if nothing is left to explore."""

    @property
    def underway(self) -> bool:
        """True if the robot is on a path out of a local minimum."""

    @property
    def way(self) -> list[Cell]:
        """The cells of the path that it follows, from here on; empty if it follows none."""

    def lead(self, observation: Observation, gained: bool) -> float | None:
        """Return the desired heading; None to stand still. To be called once a tick."""


class Wish(NamedTuple):
    """Which way an explorer would go."""

    heading_rad: float | None
    """In the frame in which the robot senses its heading; None to stand."""
    share: float
    """Share of its speed with which it may go; 0 is to wait."""
    ranges_m: Floats
    """The scan, without what it takes for false returns."""


class Explorer(Drains):
    """The machine of one robot."""

    def __init__(
        self, parameters: Parameters, setup: Setup, me: Address, stream: np.random.Generator | None, start: Time
    ) -> None:
        """Explore from *start* on, with the common world model of *setup*, or else with its own, and share that.

        *stream* is only drawn from if the parameters ask for a filter.
        """
        super().__init__()
        self.me = me
        self.counters = Counters()
        self.setup = setup
        self.sharing: Sharing | None = None
        """How it sends and receives pieces of maps; None if all have one in common."""
        if setup.common is None:
            own, cells = parameters.sharing, setup.frame.nx * setup.frame.ny
            self.sharing = Sharing(own, me, setup.size, cells, self.counters, start, not parameters.counted)
            model = WorldModel(parameters, setup.frame, setup.radii_m, setup.range_m, self.sharing.places_m)
        else:
            model = setup.common
        self.belief = model.belief
        self.leader = self._leader(parameters, model, start)
        self.positioning = self._positioning(parameters, stream)
        self.place_m: Point | None = None
        """Where the robot believes that it is on its map."""
        self._false_returns = parameters.false_returns
        self._beams = beam_directions(setup.beams)
        self._steering = Steering(parameters.steering, self._beams, setup.radii_m[me], setup.speeds_mps[me])
        self._here: Point | None = None
        self._heading: float | None = None
        self._pace = 0.0
        self._gained = False
        self._driving = False
        # Two robots that see a cell differently would report it to each other for ever.
        self._rests = False
        """True if it has finished, and marks nothing more."""

    def _leader(self, parameters: Parameters, model: WorldModel, start: Time) -> Leader:
        setup, me, terrain = self.setup, self.me, model.terrain
        if model.targets is not None:
            spans_s = parameters.rivals.plan_s, parameters.rivals.patience_s
            plan, patience = (max(1, round(from_seconds(span_s) / setup.tick)) for span_s in spans_s)
            return Rival(model.targets, self.counters, self._events, me, plan, patience)
        radius_m, range_m, tick = setup.radii_m[me], setup.range_m, setup.tick
        behaviour = Behaviour(parameters, terrain, self.counters, self._events, radius_m, range_m, tick)
        if parameters.beacons.pattern == "free":
            return behaviour
        escape = Escape(parameters.escape, terrain, radius_m, range_m)
        return Tethered(parameters.beacons, behaviour, me, setup.size, escape, model.places_m, start, tick)

    def _positioning(self, parameters: Parameters, stream: np.random.Generator | None) -> Positioning:
        """Return a robot's filter, or what takes the observed pose as it is."""
        own, setup = parameters.positioning, self.setup
        if own.kind == "given":
            return Given()
        assert stream is not None
        return Filtered(own, setup.frame, setup.range_m, setup.radii_m, setup.tick, stream, self._events.append)

    # ------------------------------------------------------------ the contract of machines

    @property
    def finished(self) -> bool:
        """True if nothing is left to explore, and all has been sent."""
        return self.leader.done and (self.sharing is None or self.sharing.silent)

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        """Take a piece of another's map; robots with a map in common have nothing to send each other."""
        if self.sharing is None:
            self._events.append(BadBytes(reception.source, len(data)))
            return
        update = self.sharing.receive(data, reception, now)
        self._events += drained(self.sharing.bad)
        if update is not None:
            self.belief.merge(*update)

    def link(self, event: LinkEvent, now: Time) -> None:
        """Take an event of a link, if maps are sent over links."""
        if self.sharing is not None:
            self.sharing.link(event, now)

    def observe(self, observation: Observation, now: Time) -> None:
        """Mark what is seen, share it, and go on."""
        heading_rad, share, ranges_m = self.wish(observation, now)
        if heading_rad is not None and share > 0.0:
            order = self._steering.drive(heading_rad, observation.heading_rad, ranges_m)
            slowed = order if share == 1.0 else Drive(share * order.speed_mps, share * order.turn_radps)
            self._commands.append(slowed)
        elif self._driving:
            self._commands.append(Drive(0.0, 0.0))
        self._driving = heading_rad is not None and share > 0.0

    def wake(self, now: Time) -> None:
        """Do nothing: there are no deadlines."""

    def wake_at(self) -> Time | None:
        """Return None."""
        return None

    def outbox(self) -> list[Outgoing | LinkCommand]:
        """Drain what sharing has to send."""
        return [] if self.sharing is None else self.sharing.drain()

    def believed(self) -> Belief:
        """Return what it believes, for who looks on; robots that have a map in common believe the same of the floor."""
        belief, frame = self.belief, self.belief.frame
        known = CellMap(belief.evidence, frame.origin_m, frame.cell_m, belief.version, self.setup.common is not None)
        way = [frame.centre_m(cell) for cell in self.leader.way]
        return Belief(known, way, way[-1] if way else None, self.positioning.estimate)

    # ------------------------------------------------------------ looking

    def wish(self, observation: Observation, now: Time) -> Wish:
        """Mark what is seen, share it, and return which way to go; to be called once a tick."""
        self._count(observation)
        ranges_m = without_lone(observation.ranges_m) if self._false_returns else observation.ranges_m
        found, turned_rad, share = self.positioning.locate(observation, ranges_m, self._beams)
        here = self.place_m = found.x_m, found.y_m
        beams = self._beams if turned_rad == 0.0 else turned(self._beams, turned_rad)
        changed = _NOTHING if self._rests else self.belief.mark(here, ranges_m, beams, self._bodies(found, now))
        self._note_changed(changed)
        self.share(found, now)
        heading = self._lead(found, len(changed) > 0, share)
        self._rests = heading is None and self.leader.done
        return Wish(None if heading is None else heading - turned_rad, share, ranges_m)

    def look_about(self, observation: Observation, now: Time) -> None:
        """Mark what is seen where the robot is told to be, without going anywhere."""
        here = observation.x_m, observation.y_m
        self._note_changed(self.belief.mark(here, observation.ranges_m, self._beams, self._bodies(observation, now)))

    def share(self, found: Observation, now: Time) -> None:
        """Send what is new of the map, and ask for what is lacking, if it is time; *found* is in the map's frame."""
        if self.sharing is not None:
            self.sharing.tick(found.x_m, found.y_m, now, found.sightings)

    def _note_changed(self, cells: Int32s) -> None:
        if self.sharing is not None:
            self.sharing.changed(cells, self.belief.occupied(cells).tolist())

    def _lead(self, found: Observation, gained: bool, share: float) -> float | None:
        """Return the desired heading. With a *share* of its speed the leader is asked proportionally less often."""
        # A robot that is slow, or waits, is no more stalled than another: the leader's time is the robot's way.
        self._pace += share
        self._gained |= gained
        if self._pace < 1.0 - _ROUNDING:
            self.counters.waited += share == 0.0
            return self._heading
        self._pace -= 1.0
        self._heading = self.leader.lead(found, self._gained)
        self._gained = False
        return self._heading

    def _bodies(self, observation: Observation, now: Time) -> Floats:
        """Return the places and radii of the others, as far as they are known, so that the map leaves them out."""
        setup, visible = self.setup, observation.visible
        if setup.common is not None:
            setup.common.places_m[self.me] = observation.x_m, observation.y_m
        if setup.size == 1:
            return _NO_BODIES
        bodies = [(x, y, setup.radii_m[other]) for other, x, y in observation.sightings]
        if setup.common is not None:
            for other, (x, y) in setup.common.places_m.items():
                if other != self.me and other not in visible:
                    bodies.append((x, y, self._reach_m(other, setup.tick / S)))
        elif self.sharing is not None:
            for other, (x, y), age_s in self.sharing.places(now):
                if other != self.me and other not in visible:
                    bodies.append((x, y, self._reach_m(other, age_s)))
        return np.array(bodies) if bodies else _NO_BODIES

    def _reach_m(self, other: Address, age_s: float) -> float:
        """Return how far the body of another robot may reach from where it was *age_s* ago."""
        return self.setup.radii_m[other] + age_s * self.setup.speeds_mps[other]

    def _count(self, observation: Observation) -> None:
        counters, here = self.counters, (observation.x_m, observation.y_m)
        counters.ticks += 1
        counters.way_m += 0.0 if self._here is None else math.dist(here, self._here)
        counters.blocked += observation.blocked
        if self.leader.underway:
            counters.escape_steps += 1
        else:
            counters.steps += 1
        self._here = here
