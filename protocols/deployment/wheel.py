"""One robot's wheel: how it moves now, and what DWA has it do next to get to an aim (paper 004, section 6)."""

import math
from typing import Final

import numpy as np

from cosim.machine import Drive
from cosim.navigation.dwa import (
    OWN,
    STATE,
    braking_way,
    choose,
    chord,
    stopping_m,
    towards,
    unknown_points,
    unseen_gap,
    walls_near,
)
from cosim.observation import Observation
from cosim.units import Time, to_seconds
from protocols.deployment.driving_parameters import DrivingParameters
from protocols.deployment.floor import Aim, Floor
from protocols.deployment.plan import Place
from protocols.deployment.traffic import Traffic

_TURN_SEEN_RAD: Final = 0.02
"""By so much the turn of a tick may differ from what was commanded before what was seen counts instead."""
_KEPT_SHARE: Final = 0.5
"""This share of the margin by which ways are planned is kept in any case: ways are cells, and their corners are cut."""
_CIRCLE_M: Final = 0.5
_ASKEW_RAD: Final = 0.25 * math.pi
"""Who is so near to what it aims at, and so far from facing it, turns on the spot."""


class Wheel:
    """The motion of one robot, tick by tick."""

    def __init__(
        self,
        floor: Floor,
        radius_m: float,
        speed_mps: float,
        acceleration_mps2: float,
        parameters: DrivingParameters,
        tick: Time,
    ) -> None:
        self._floor, self._own = floor, parameters
        self._tick, self._seconds = tick, to_seconds(tick)
        self._limits = _limits(radius_m, speed_mps, acceleration_mps2, parameters, self._seconds)
        self._motion = np.zeros(STATE)
        self._wanted = (math.nan, math.nan)
        self._asked: Time = -1

    @property
    def here(self) -> Place:
        """Where it is."""
        return float(self._motion[0]), float(self._motion[1])

    @property
    def stands(self) -> bool:
        """Whether it stays where it is until the next tick."""
        return bool(self._motion[3] == 0.0)

    def order(self, way: float, turn: float) -> Drive | None:
        """Return the order for a way and a turn per tick; None if it is the last one still."""
        if (way, turn) == self._wanted:
            return None
        self._wanted = way, turn
        return Drive(way / self._seconds, turn / self._seconds)

    def follow(self, observation: Observation, now: Time) -> None:
        """Note where it is, how it has moved in the last tick, and how it moves until the next."""
        x, y, heading, speed = observation[:4]
        motion, own = self._motion, self._limits
        way = speed * self._seconds
        if self._asked != now - self._tick:  # somebody else may have driven it since
            gone_x, gone_y = way * math.cos(heading), way * math.sin(heading)
            motion[:] = x, y, heading, way, 0.0, gone_x, gone_y
            self._wanted = math.nan, math.nan
        else:
            was_x, was_y, was_heading, _, turn, _, _ = motion.tolist()
            seen = math.remainder(heading - was_heading, math.tau)
            if abs(math.remainder(seen - turn, math.tau)) > _TURN_SEEN_RAD:
                turn = min(max(seen, -own[3]), own[3])
            way, turn = towards(self._wanted[0], way, own[2]), towards(self._wanted[1], turn, own[4])
            motion[:] = x, y, heading, way, turn, x - was_x, y - was_y
        self._asked = now

    def to(self, aim: Aim, observation: Observation, traffic: Traffic) -> tuple[float, float]:
        """Return way and turn of the tick after the next."""
        own, motion = self._limits, self._motion
        most = own[1]
        dx, dy = chord(motion[2], motion[3], motion[4])
        off_x, off_y = aim.place_m[0] - motion[0] - dx, aim.place_m[1] - motion[1] - dy
        left_m = math.hypot(off_x, off_y)
        error = math.remainder(math.atan2(off_y, off_x) - motion[2] - motion[4], math.tau)
        if left_m < _CIRCLE_M and abs(error) > _ASKEW_RAD:
            most = 0.0  # it would drive round a near aim for ever
        elif aim.last:
            most = min(most, braking_way(left_m, own[2]))
        x, y = self.here
        stop_m = own[1] + stopping_m(own[1] + own[2], own[2])
        if traffic.surprises((x, y), 4.0 * own[0] + 3.0 * stop_m):
            return 0.0, 0.0
        reach = own[0] + max(own[5], own[7]) + stop_m
        walls = walls_near(self._floor.walls, x, y, reach + 2.0 * own[0])
        bodies = traffic.bodies()
        ranges = observation.ranges_m
        points = unknown_points(walls, bodies, x, y, ranges, reach, self._own.known_m)
        if self._own.blind_corners and traffic.somebody_unseen(self.here):
            gap = unseen_gap(walls, x, y, motion[2]) - own[0]
            most = min(most, max(braking_way(0.5 * gap, own[2]), own[2]))
        way, turn, _ = choose(own, motion, walls, points, bodies, aim.place_m[0], aim.place_m[1], most)
        return float(way), float(turn)


def _limits(
    radius_m: float, speed_mps: float, acceleration_mps2: float, own: DrivingParameters, seconds: float
) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    row = np.empty(OWN)
    row[:] = (
        radius_m,
        speed_mps * seconds,
        acceleration_mps2 * seconds**2,
        own.turn_radps * seconds,
        own.turn_acceleration_radps2 * seconds**2,
        _KEPT_SHARE * own.margin_m,
        own.stray_m,
        own.clear_m,
        own.heading_weight,
        own.clearance_weight,
        own.speed_weight,
    )
    return row
