"""Where hosts go: a static rally point, reconvening points one after the other, or the middle of the searchers.

Hosts are to stay in reach of each other. Each keeps within half the long range of the place where all have started, so
that any two are in reach; a host among the ``strays`` heads for the far end of its region instead in any strategy.
(Paper 002, sections III.A to III.D; how ways are found is left open.)

MRP's host goes "to the next synch point on the way to the exit". The paper's floor has no exit, and the robots start in
its middle, so that the way leads to the far end of the region, or to the exit of a floor that names one; there the host
turns back, as searchers with posts near the start would otherwise be due again before they had reached them.
"""

import math
from collections.abc import Sequence
from typing import Final

from cosim.geometry.planning import Point
from cosim.geometry.polylines import cut, length_m, middle
from cosim.machine import Address
from cosim.units import Time
from protocols.aggregation.course import Course
from protocols.aggregation.parameters import Parameters
from protocols.aggregation.setup import Setup

REACH_SHARE: Final = 0.95
"""Share of half the long range within which hosts stay, as positions are not exact."""
SAMPLES: Final = 8
"""Number of instants at which the middle of the searchers is computed over the time that their tours take."""
WAY_POINTS: Final = 255
"""Largest number of points in a plan."""


class Strategy:
    """One host's choice of ways."""

    def __init__(self, parameters: Parameters, setup: Setup, host: Address) -> None:
        self._parameters = parameters
        self._setup = setup
        self._ground = setup.ground
        self._start_m = setup.starts_m[host]
        starts = setup.starts_m[: setup.hosts]
        self._centre_m = middle(starts)
        self._strays = host in parameters.strays
        self._reach_m = math.inf
        if setup.hosts > 1 and not self._strays:
            self._reach_m = REACH_SHARE * parameters.long_m / 2.0
        self._speed_mps = min(parameters.host_speed_mps, setup.speeds_mps[host])
        self._region = [self._ground.posts_m[post] for post in sorted(setup.regions[host])]

    def return_to_reach(self) -> None:
        """Keep within reach of the others from now on."""
        self._strays = False
        self._reach_m = REACH_SHARE * self._parameters.long_m / 2.0

    @property
    def rally_m(self) -> Point:
        """Rally point: the middle of the region, in reach of the other hosts; for a stray the far end of its region."""
        if self._strays:
            return self.far_m
        return self._standing(middle(self._region) if self._region else self._start_m)

    @property
    def far_m(self) -> Point:
        """End of the host's way: the floor's exit, or the farthest post of its region; in reach of the other hosts."""
        exit_m = self._setup.exit_m
        if self._parameters.way_out == "exit" and exit_m is not None:
            return self._standing(exit_m)
        farthest = max(self._region, key=lambda post: math.dist(post, self._centre_m), default=self._start_m)
        return self._standing(farthest)

    def course(self, here_m: Point, tours: Sequence[Sequence[int]], round_: int, now: Time) -> Course:
        """Return the way from *here_m*, to be left at *now*, while the searchers are on their *tours*."""
        match self._parameters.strategy:
            case "srp":
                return self.to(self.rally_m, here_m, now)
            case "mrp":
                return self._leg(here_m, round_, now)
            case _:
                return self._amid(here_m, tours, now)

    def to(self, goal_m: Point, here_m: Point, now: Time) -> Course:
        """Return the shortest way to a place at full speed; stand still if there is none."""
        way = self._ground.way(here_m, goal_m) or []
        return Course(now, self._speed_mps, (here_m, *way)[:WAY_POINTS])

    def _leg(self, here_m: Point, round_: int, now: Time) -> Course:
        """Return the way to the next reconvening point, as far as the host gets in a period.

        The points lie at equal distances on the way to the far end; there the host turns back.
        """
        route = [self._start_m, *(self._ground.way(self._start_m, self.rally_m) or [])]
        route += self._ground.way(route[-1], self.far_m) or []
        turns, legs = round_ + 1, self._parameters.rounds
        share = 1.0 - abs(1.0 - turns % (2 * legs) / legs)
        whole = self.to(cut(route, share * length_m(route))[-1], here_m, now)
        return whole._replace(way_m=cut(whole.way_m, self._speed_mps * self._parameters.reconvene_s))

    def _amid(self, here_m: Point, tours: Sequence[Sequence[int]], now: Time) -> Course:
        """Return a slow way through the middle of the searchers' future places, as long as the longest tour takes."""
        if self._strays:
            return self.to(self.far_m, here_m, now)
        walks = [[here_m, *(self._ground.posts_m[post] for post in tour)] for tour in tours if tour]
        if not walks:
            return self.to(self.rally_m, here_m, now)
        pace = min(self._setup.speeds_mps[self._setup.hosts :], default=self._speed_mps)
        takes_s = max(map(length_m, walks)) / pace
        way = [here_m]
        for part in range(1, SAMPLES + 1):
            amid = middle([cut(walk, pace * takes_s * part / SAMPLES)[-1] for walk in walks])
            way += self._ground.way(way[-1], self._standing(amid)) or []
        speed = min(self._speed_mps, max(length_m(way) / takes_s, 1e-3)) if takes_s > 0.0 else self._speed_mps
        return Course(now, speed, tuple(way)[:WAY_POINTS])

    def _standing(self, point_m: Point) -> Point:
        """Return the post nearest to a place that is in reach of the other hosts; the start if none is."""
        apart = math.dist(point_m, self._centre_m)
        if apart > self._reach_m:
            share = self._reach_m / apart
            cx, cy = self._centre_m
            point_m = cx + share * (point_m[0] - cx), cy + share * (point_m[1] - cy)
        near = [post for post in self._ground.posts_m if math.dist(post, self._centre_m) <= self._reach_m]
        return min(near, key=lambda post: math.dist(post, point_m), default=self._start_m)
