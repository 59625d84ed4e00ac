"""Where a host will be, by the way that it has announced (paper 002, section V), and where to meet it.

A host goes along way points at constant speed. A robot that knows the way knows the host's place at any time, as long
as the host keeps to it. Equation 3 of the paper cannot be meant as it is printed: it measures t from the start on every
leg and compares it with the duration of a single leg. Meant is

    x(t) = x_i + v (t - T_i) cos theta_i,  y(t) = y_i + v (t - T_i) sin theta_i   for T_i <= t < T_(i+1),

T_i being the sum of the durations of the legs before, and the goal after the last. Equation 2 needs atan2.

Durations are rounded to whole ns: at the end of a way of 255 points at 1 m/s that is less than 0.13 um.
"""

from collections.abc import Callable
from math import dist
from typing import Final, NamedTuple

import cosim.elementary as elementary
from cosim.errors import LocalProtocolError
from cosim.geometry.planning import Point
from cosim.geometry.polylines import length_m
from cosim.machine import Address
from cosim.units import S, Time, from_seconds
from protocols.aggregation.frames import instant, stamp
from protocols.aggregation.messages import Plan

FOREVER: Final[Time] = 1 << 62
"""Duration, 146 years, from which on a way has no end."""


class Course(NamedTuple):
    """A way at constant speed: the first point is left at *departed*, the last is held for good."""

    departed: Time
    speed_mps: float
    """Not negative; at 0 the host stands at the first point."""
    way_m: tuple[Point, ...]
    """At least one point: the starting point, way points, the goal."""

    @property
    def length_m(self) -> float:
        """The length of the way, metres."""
        return length_m(self.way_m)

    def place(self, at: Time) -> Point:
        """Return the host's place at the instant *at*; paper 002, equations 1 to 3, see above."""
        leg, spent, takes = self._leg(at)
        x, y = self.way_m[leg]
        if not takes:
            return x, y
        to_x, to_y = self.way_m[leg + 1]
        part = spent / takes  # = v (t - T_i) / length, so that part * (x_(i+1) - x_i) = v (t - T_i) cos theta_i
        return x + part * (to_x - x), y + part * (to_y - y)

    def heading(self, at: Time) -> float | None:
        """Return the host's direction of motion at the instant *at*, radians; None while it stands (equation 2)."""
        leg, _, takes = self._leg(at)
        if not takes or at < self.departed:
            return None
        (x, y), (to_x, to_y) = self.way_m[leg : leg + 2]
        return elementary.atan2(to_y - y, to_x - x)

    def ends_at(self) -> Time | None:
        """Return the instant at which the host reaches the goal; None if it stands before the goal for ever."""
        takes = sum(self._takes(leg) for leg in range(len(self.way_m) - 1))
        return self.departed + takes if takes < FOREVER else None

    def _leg(self, at: Time) -> tuple[int, Time, Time]:
        """Return the host's leg, the time spent on it and its duration; both times are 0 at the goal and at rest."""
        rest = max(at - self.departed, 0)
        for leg in range(len(self.way_m) - 1):
            takes = self._takes(leg)
            if rest < takes:
                return (leg, rest, takes) if takes < FOREVER else (leg, 0, 0)
            rest -= takes
        return len(self.way_m) - 1, 0, 0

    def _takes(self, leg: int) -> Time:
        """Return the duration of a leg (equation 1)."""
        leg_m = dist(*self.way_m[leg : leg + 2])
        if not leg_m:
            return 0
        # a quotient of FOREVER and more, infinity included, must not reach round()
        return round(leg_m / self.speed_mps * S) if leg_m * S < self.speed_mps * FOREVER else FOREVER


def interception(
    course: Course,
    now: Time,
    here_m: Point,
    speed_mps: float,
    way_m: Callable[[Point], float | None],
    rounds: int = 1,
) -> Point:
    """Return the place to head for at *speed_mps* from *here_m* to meet a host on *course* (paper 002, section V).

    The paper's one round: how long would it take to where the host is now, and where will the host be then? Each
    further round asks the same of the point found before; the points come closer to the true meeting point from round
    to round if the host is the slower one. No round: where the host is now.

    *way_m* returns the length of the planned way from here to a point, metres, or None where there is none: then the
    straight line has to do. Raises :exc:`LocalProtocolError` if *speed_mps* is not positive.
    """
    if not speed_mps > 0.0:
        raise LocalProtocolError(f"nobody is met at {speed_mps} m/s")
    point = course.place(now)
    for _ in range(rounds):
        planned_m = way_m(point)
        gone_m = dist(here_m, point) if planned_m is None else planned_m
        point = course.place(now + from_seconds(gone_m / speed_mps))
    return point


def course_of(plan: Plan, now: Time) -> Course:
    """Return the course of *plan*; its stamp means the instant nearest to *now*."""
    return Course(instant(plan.departed_ms, now), plan.speed_mps, plan.way_m)


def plan_of(course: Course, host: Address, version: int) -> Plan:
    """Return the plan that announces *course* of *host*, at most 255 points.

    What ``course_of`` makes of it departs up to 1 ms earlier, since stamps are whole ms, and its numbers have been
    through the single floats of the wire: on ways of 12 points within 250 m that moves the host by at most 0.05 mm
    (measured over 200 ways). A host that has to know exactly what the others believe keeps ``course_of`` of the plan.
    """
    return Plan(host, version, stamp(course.departed), course.speed_mps, course.way_m)
