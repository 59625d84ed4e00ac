"""Robots as beacons for each other: they stay in sight while all explore, or move by turns (paper 001, section 5.2).

The paper names two patterns and prints neither: "modifications may be made to affect speed and pose such that
visibility is maintained", and the "leapfrogging or bounding-overwatch pattern" of the Millibots. Ours:

- An attractive schema beside the paper's three: from a distance of equilibrium on a robot is drawn to its guards with
  gain / d^2 (Reif and Wang, 1999: the attractive term of equation 1, with sigma 2 as in equations 3 to 5; with equal
  exponents terms have no equilibrium, so ranges give it, as they do there).
- The guards of a robot are the nearest robots with lower numbers. So no two robots wait for each other: robot 0 has no
  guards and goes where its schemas lead it. When it has no robot in sight it returns to where it had one, and waits.
- A robot that does not have all its guards in sight within ``keep_m`` stops exploring, and following paths out of local
  minima, and drives by a planned way to the nearest place from which it should see them within ``near_m``. With no
  frontier within ``keep_m`` of a guard it does the same, and stands there. If its guard has stood for a while, which
  may be at a corner, it comes beside it, so that the guard can go on.
- leapfrog: robots with even and odd numbers move in turn, for a slot each, counted in ticks from the start of the run;
  the robots that stand are the beacons of those that move, and guards are of the other half.

A robot that for some time has seen no new cell, and no progress of its guard, does without the others for as long: they
may be dead, or may have finished.
"""

import math
from collections.abc import Mapping
from typing import Final, Protocol

import numpy as np

import cosim.elementary as elementary
from cosim.geometry.astar import lookouts, nearest
from cosim.geometry.grids import Cell
from cosim.geometry.planning import Point
from cosim.machine import Address
from cosim.navigation.frontier_fields import Vector
from cosim.observation import Observation
from cosim.units import S, Time
from protocols.exploration.escaping import Escape
from protocols.exploration.parameters import BeaconParameters

_AHEAD_CELLS: Final = 5
"""Look-ahead along a planned way."""
_PLAN_S: Final = 2.0
"""Interval between plans."""
_WAY_M: Final = 1.0
"""Distance that counts as progress."""
_STANDS_M: Final = 0.5
"""Movement within which a guard counts as standing."""
_STANDS_S: Final = 5.0
"""Time after which a guard that has not moved farther counts as standing."""
_BESIDE_M: Final = 1.0
"""Distance to which a robot comes beside another."""
_SURE: Final = 0.9
"""Share of the wanted distance that is planned for; halved whenever the other is not seen from there."""
_LEAST: Final = 0.2
"""Share below which it is halved no more."""


class Explores(Protocol):
    """What a robot does when its beacons let it."""

    pull: Vector
    """Force of whatever else attracts it."""

    @property
    def done(self) -> bool:
        """True if nothing is left to explore."""

    @property
    def underway(self) -> bool:
        """True if it is on a path out of a local minimum."""

    @property
    def way(self) -> list[Cell]:
        """The cells of the path that it follows, from here on; empty if it follows none."""

    def lead(self, observation: Observation, gained: bool) -> float | None:
        """Return the desired heading; None to stand still."""


def attraction(here_m: Point, others_m: list[Point], near_m: float, gain: float) -> Vector:
    """Return the force towards *others_m*: gain / d^2 for each that is farther than *near_m*."""
    x, y = 0.0, 0.0
    for other in others_m:
        dx, dy = other[0] - here_m[0], other[1] - here_m[1]
        away = math.hypot(dx, dy)
        if away > near_m:
            x += gain * dx / (away * away * away)
            y += gain * dy / (away * away * away)
    return x, y


def moves(me: Address, tick: int, slot_ticks: int) -> bool:
    """Return whether robot *me* may move at a tick of the run: even numbers begin."""
    return (tick // slot_ticks) % 2 == me % 2


class Rejoining:
    """Ways to places from which others can be seen."""

    def __init__(self, escape: Escape, plan_ticks: int) -> None:
        """Plan as *escape* does, again after so many ticks."""
        self._belief = escape.belief
        self._escape = escape
        self._every = plan_ticks
        self._age = 0
        self._share = _SURE
        self._way: list[Cell] = []

    @property
    def way(self) -> list[Cell]:
        """The cells of the way that is left."""
        return list(self._way)

    def end(self) -> None:
        """Forget the way."""
        self._way, self._age, self._share = [], 0, _SURE

    def heading(self, here_m: Point, other_m: Point, near_m: float) -> float | None:
        """Return the heading to the nearest place from which *other_m* is in sight within *near_m*, by the map.

        None at the place. A robot that goes on asking there, since it sees no robot, is led nearer.
        """
        if self._age % self._every == 0:
            self._share *= 1.0 if self._way or not self._age or self._share < _LEAST else 0.5
            self._way = self._plan(here_m, other_m, self._share * near_m / self._belief.frame.cell_m)
        self._age += 1
        frame = self._belief.frame
        while self._way and math.dist(frame.centre_m(self._way[0]), here_m) < _AHEAD_CELLS * frame.cell_m:
            if len(self._way) == 1 and math.dist(frame.centre_m(self._way[0]), here_m) > frame.cell_m:
                break
            del self._way[0]
        if not self._way:
            return None
        x, y = frame.centre_m(self._way[0])
        return elementary.atan2(y - here_m[1], x - here_m[0])

    def _plan(self, here_m: Point, other_m: Point, reach: float) -> list[Cell]:
        frame, ground, entry = self._belief.frame, self._escape.ground(), self._escape.entry(here_m)
        target = np.zeros(ground.passable.shape, np.bool_)
        target.flat[frame.cell_at(other_m)] = True
        watch = lookouts(ground.passable, ground.clear, target, reach)
        if not entry or not watch.any():
            return []
        way = nearest(ground.passable, ground.extra, entry[-1], watch, self._escape.cost)
        return [] if way is None else entry[:-1] + [int(cell) for cell in way]


class Tethered:
    """What leads a robot that stays in sight of others."""

    def __init__(
        self,
        parameters: BeaconParameters,
        explores: Explores,
        me: Address,
        size: int,
        escape: Escape,
        places_m: Mapping[Address, Point],
        start: Time,
        tick: Time,
    ) -> None:
        """Let *explores* lead *me*, one of so many, as long as beacons allow it.

        *places_m* holds where the others have reported to be; a robot in sight is where it is seen.
        """
        self._own = parameters
        self._explores = explores
        self._belief = escape.belief
        self._me = me
        self._least = min(parameters.least, size - 1)
        self._reported_m = places_m
        self._seen_m: dict[Address, Point] = {}
        """Where the others were when they were last seen or heard of."""
        self._tick = start // tick - 1
        self._slot = max(round(parameters.slot_s * S / tick), 1)
        self._patience = round(parameters.patience_s * S / tick)
        self._rejoining = Rejoining(escape, max(round(_PLAN_S * S / tick), 1))
        self._rejoins = False
        self._stands = round(_STANDS_S * S / tick)
        self._stood: tuple[Address, Point, int] | None = None
        """Its first guard, about where that is, and since which tick."""
        self._held = 0
        """Ticks without progress, though there might have been some."""
        self._free = 0
        """Ticks for which it still does without the others."""
        self._mark_m: Point | None = None
        """Where the first of its guards, or robot 0 itself, made progress last."""
        self._linked_m: Point | None = None
        """Where it had a beacon in reach last."""

    @property
    def done(self) -> bool:
        """True if nothing is left to explore."""
        return self._explores.done

    @property
    def underway(self) -> bool:
        """True if the robot is on a path out of a local minimum."""
        return self._explores.underway

    @property
    def way(self) -> list[Cell]:
        """The cells of the path that it follows, back to the others if it rejoins them."""
        return self._rejoining.way if self._rejoins else self._explores.way

    def lead(self, observation: Observation, gained: bool) -> float | None:
        """Return the desired heading; None to stand still."""
        self._tick += 1
        here = observation.x_m, observation.y_m
        self._seen_m |= {other: place for other, place in self._reported_m.items() if other != self._me}
        self._seen_m |= {other: (x, y) for other, x, y in observation.sightings}
        leapfrogs = self._own.pattern == "leapfrog"
        if leapfrogs and not moves(self._me, self._tick, self._slot):
            self._rejoins = False
            self._rejoining.end()
            return None
        beacons = [other for other in self._seen_m if not leapfrogs or (other - self._me) % 2]
        reach = [
            other for other in beacons if other in observation.visible and self._away(here, other) <= self._own.keep_m
        ]
        guards = self._guards(here, [other for other in beacons if other < self._me])
        if self._does_without(here, guards, gained) or self._explores.done:
            return self._explore(observation, gained, [])
        if guards:
            return self._guarded(observation, gained, guards, reach)
        return self._ahead(observation, gained, len(reach) >= min(self._least, len(beacons)))

    def _away(self, here: Point, other: Address) -> float:
        return math.dist(here, self._seen_m[other])

    def _guards(self, here: Point, others: list[Address]) -> list[Address]:
        """Return the robots of *others* that this one stays in sight of, the nearest first."""
        return sorted(others, key=lambda other: self._away(here, other))[: self._least]

    def _does_without(self, here: Point, guards: list[Address], gained: bool) -> bool:
        """Note whether there is progress; return whether the robot has waited for it too long."""
        if self._free:
            self._free -= 1
            return True
        at = self._seen_m[min(guards)] if guards else here
        if gained or self._mark_m is None or math.dist(at, self._mark_m) > _WAY_M:
            self._mark_m, self._held = at, 0
            return False
        self._held += 1
        if self._held > self._patience:
            self._held, self._free = 0, self._patience
        return self._free > 0

    def _explore(self, observation: Observation, gained: bool, guards: list[Address]) -> float | None:
        here, own = (observation.x_m, observation.y_m), self._own
        self._rejoins = False
        self._explores.pull = attraction(here, [self._seen_m[guard] for guard in guards], own.near_m, own.gain)
        return self._explores.lead(observation, gained)

    def _ahead(self, observation: Observation, gained: bool, linked: bool) -> float | None:
        """Lead a robot without guards, robot 0: it waits for those that stay in its sight."""
        here = observation.x_m, observation.y_m
        if linked:
            self._linked_m = here
            return self._explore(observation, gained, [])
        if self._linked_m is None:
            return None
        x, y = self._linked_m
        back = math.hypot(x - here[0], y - here[1]) > self._belief.frame.cell_m
        return elementary.atan2(y - here[1], x - here[0]) if back else None

    def _guarded(
        self, observation: Observation, gained: bool, guards: list[Address], reach: list[Address]
    ) -> float | None:
        """Lead a robot with guards: to them if it has lost one or there is nothing to explore, else freely."""
        here = observation.x_m, observation.y_m
        lost = [guard for guard in guards if guard not in reach]
        idle, called = not self._frontier_near(self._seen_m[guards[0]]), self._called(guards[0])
        near_m = _BESIDE_M if called else self._own.near_m
        far = [guard for guard in guards if guard in lost or self._away(here, guard) > near_m]
        if called and not far:
            self._stood = None
        self._rejoins = bool(lost) or ((self._rejoins or idle or called) and bool(far))
        if self._rejoins:
            return self._rejoining.heading(here, self._seen_m[far[0]], near_m)
        self._rejoining.end()
        return None if idle else self._explore(observation, gained, guards)

    def _called(self, guard: Address) -> bool:
        """Return whether *guard* has stood for long, and waits."""
        at = self._seen_m[guard]
        if self._stood is None or self._stood[0] != guard or math.dist(at, self._stood[1]) > _STANDS_M:
            self._stood = guard, at, self._tick
        return self._tick - self._stood[2] >= self._stands

    def _frontier_near(self, place_m: Point) -> bool:
        """Return whether any frontier is within ``keep_m`` of a place, along both axes."""
        frame = self._belief.frame
        iy, ix = divmod(frame.cell_at(place_m), frame.nx)
        reach = math.floor(self._own.keep_m / frame.cell_m)
        about = self._belief.frontier[max(iy - reach, 0) : iy + reach + 1, max(ix - reach, 0) : ix + reach + 1]
        return bool(about.any())
