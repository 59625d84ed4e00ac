"""Routes for the planner: lengths, the costs of roles, and places at which no robot can stand."""

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations, pairwise
from typing import Final, Literal

import cosim.elementary as elementary
from cosim.machine import Address
from protocols.deployment.planning.binding import Role
from protocols.deployment.planning.casting import shown
from protocols.deployment.planning.roles import Prices, unfit
from protocols.deployment.planning.timing import Leg, drive_s
from protocols.deployment.tasks.crew import Body, Ways
from protocols.deployment.tasks.plan import Go, Place, Task

RINGS_M: Final = (0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0)
"""Distances at which a place is sought instead of one at which no robot can stand."""
DIRECTIONS: Final = 12
"""Number of directions in which it is sought."""
NEARLY: Final = 1e-3
"""Share by which costs may differ for the order of departure to decide an assignment."""


class Routes:
    """The ways of one call; each length is computed once."""

    def __init__(self, ways: Ways) -> None:
        self.ways = ways
        self._lengths: dict[tuple[float, Place, Place], float | None] = {}
        self._free: dict[tuple[float, Place], bool] = {}

    def length_m(self, radius_m: float, a: Place, b: Place) -> float | None:
        """Return the length of the way from *a* to *b*; None if there is none."""
        key = radius_m, a, b
        if key not in self._lengths:
            self._lengths[key] = 0.0 if a == b else self.ways.length_m(radius_m, a, b)
        return self._lengths[key]

    def free(self, radius_m: float, at: Place) -> bool:
        """Return whether a disc can stand at *at*."""
        key = radius_m, at
        if key not in self._free:
            self._free[key] = self.ways.free(radius_m, at)
        return self._free[key]

    def way(self, radius_m: float, a: Place, b: Place) -> list[Place] | None:
        """Return the corners of the way from *a* to *b*."""
        return self.ways.way(radius_m, a, b)

    def leg_m(self, places_m: Sequence[Place], radius_m: float) -> float | str:
        """Return the length of a drive over *places_m*, or why there is none."""
        total_m = 0.0
        for a, b in pairwise(places_m):
            if not self.free(radius_m, b):
                return f"no room for it at {shown(b)}"
            length_m = self.length_m(radius_m, a, b)
            if length_m is None:
                return f"no way for it from {shown(a)} to {shown(b)}"
            total_m += length_m
        return total_m


def errands(leaves: Sequence[Task]) -> dict[Address, list[Place]]:
    """Return the places that each robot drives to, in order; *leaves* in the order in which they can start."""
    places: dict[Address, list[Place]] = {}
    for leaf in leaves:
        if isinstance(leaf.act, Go):
            places.setdefault(leaf.act.robot, []).extend((*leaf.act.via_m, leaf.act.place_m))
    return places


def prices(
    roles: Mapping[str, Role],
    places_m: Mapping[str, Sequence[Place]],
    bodies: Mapping[Address, Body],
    starts_m: Mapping[Address, Place],
    routes: Routes,
    cost: Literal["length", "time"],
) -> Prices:
    """Return the route cost (m or s) of each robot in each role, or why it cannot play it.

    *places_m*: the places to which each role drives, in order; *bodies*: the robots that may play roles.
    """
    found: dict[tuple[str, Address], float | str] = {}
    for name, role in roles.items():
        for robot, body in bodies.items():
            found[name, robot] = _price(role, places_m.get(name, ()), robot, body, starts_m[robot], routes, cost)
    return found


def _price(
    role: Role,
    places_m: Sequence[Place],
    robot: Address,
    body: Body,
    start_m: Place,
    routes: Routes,
    cost: Literal["length", "time"],
) -> float | str:
    if role.fixed is not None and robot != role.fixed:
        return f"{role.name} is to be robot {role.fixed}"
    why = unfit(role.needs, robot, body)
    if why is not None:
        return why
    price = 0.0
    for a, b in pairwise((start_m, *places_m)):
        length_m = routes.leg_m((a, b), body.radius_m)
        if isinstance(length_m, str):
            return f"robot {robot}, {2.0 * body.radius_m:g} m wide: {length_m}"
        price += length_m if cost == "length" else drive_s(length_m, body)
    return price


def departures(leaves: Sequence[Task], base_m: Place, radius_m: float, routes: Routes) -> dict[Address, int]:
    """Return the rank of each robot in the order of departure, from 0; *leaves* in the order in which they can start.

    Of robots that set out together, the one that goes farther goes ahead.
    """
    stages = list(dict.fromkeys(leaf.name.rpartition("/")[0] for leaf in leaves))
    first: dict[Address, tuple[int, Place]] = {}
    for leaf in leaves:
        if isinstance(leaf.act, Go):
            first.setdefault(leaf.act.robot, (stages.index(leaf.name.rpartition("/")[0]), leaf.act.place_m))

    def key(robot: Address) -> tuple[int, float, float]:
        stage, place = first[robot]
        ways = (base_m, place), (base_m, *everywhere[robot])
        lengths_m = [length for each in ways for length in [routes.leg_m(each, radius_m)]]
        to_first_m, in_all_m = (0.0 if isinstance(length, str) else length for length in lengths_m)
        return stage, -to_first_m, -in_all_m

    everywhere = errands(leaves)
    return {robot: rank for rank, robot in enumerate(sorted(first, key=key))}


def by_departure(
    prices: Prices,
    ranks: Mapping[str, int],
    first_m: Mapping[str, Place],
    starts_m: Mapping[Address, Place],
    bodies: Mapping[Address, Body],
    routes: Routes,
) -> Prices:
    """Return *prices* changed a little, so that of nearly equal assignments robots in front set out first.

    *ranks*: the order in which roles set out; *first_m*: their first places. A price changes by less than ``NEARLY`` of
    the way to that place.
    """
    # in a corridor the sum of the ways is the same for all assignments, but in some of them robots have to pass others
    found = dict(prices)
    for (role, robot), price in prices.items():
        if not isinstance(price, str) and role in ranks:
            way_m = routes.leg_m((starts_m[robot], first_m[role]), bodies[robot].radius_m)
            if not isinstance(way_m, str):
                found[role, robot] = price - NEARLY * way_m * ranks[role] / len(ranks)
    return found


def barred(
    places_m: Sequence[Place], bodies: Sequence[Body], base_m: Place, starts_m: Sequence[Place], routes: Routes
) -> Iterator[tuple[Place, Place | None]]:
    """Yield the places that none of *bodies* can get to, each with the nearest one found that all can get to."""
    for place in dict.fromkeys(places_m):
        if any(_reached(place, body, (start,), routes) for body in bodies for start in starts_m):
            continue
        around = (
            (place[0] + ring_m * elementary.cos(angle), place[1] + ring_m * elementary.sin(angle))
            for ring_m in RINGS_M
            for angle in (2.0 * math.pi * step / DIRECTIONS for step in range(DIRECTIONS))
        )
        rounded = ((round(x, 2), round(y, 2)) for x, y in around)
        everyone = (base_m, *starts_m)
        yield place, next((at for at in rounded if all(_reached(at, body, everyone, routes) for body in bodies)), None)


def _reached(place: Place, body: Body, starts_m: Sequence[Place], routes: Routes) -> bool:
    return all(not isinstance(routes.leg_m((start, place), body.radius_m), str) for start in starts_m)


def crowded(leaves: Sequence[Task], bodies: Sequence[Body]) -> Iterator[str]:
    """Yield the pairs of robots whose last places overlap, in words; *leaves* in the order in which they can start."""
    last = {leaf.act.robot: leaf.act for leaf in leaves if isinstance(leaf.act, Go)}
    for a, b in combinations(sorted(robot for robot, go in last.items() if go.final), 2):
        a_m, b_m = last[a].place_m, last[b].place_m
        if math.dist(a_m, b_m) < bodies[a].radius_m + bodies[b].radius_m:
            yield f"robot {a} at {shown(a_m)} and robot {b} at {shown(b_m)} would overlap"


def missing_ways(legs: Sequence[Leg], bodies: Sequence[Body], routes: Routes) -> Iterator[str]:
    """Yield the reasons why robots cannot make the drives for which they were chosen."""
    for leg in legs:
        length_m = routes.leg_m(leg.places_m, bodies[leg.robot].radius_m)
        if isinstance(length_m, str):
            yield f"{leg.task}: robot {leg.robot}: {length_m}"
