"""The drive of one robot: how it moves now, and its next motion towards an aim, by DWA (paper 004, section 6).

A motion is a row as :mod:`cosim.navigation.dwa` has it: place, heading, and how far the robot goes (its *way*) and
turns in one tick. An order acts from the next tick on; until then the robot keeps its motion, at whose end DWA starts.
"""

import math
from typing import Final

import numpy as np

import cosim.elementary as elementary
from cosim.arrays import Floats
from cosim.geometry.planning import Point
from cosim.machine import Drive
from cosim.navigation.dwa import (
    BODY_COLUMNS,
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
from cosim.navigation.localization.motion import Pose
from cosim.observation import Observation
from cosim.units import Time, to_seconds
from protocols.motion.floor import Aim, Floor
from protocols.motion.frames import Located, Shift, start, step
from protocols.motion.parameters import DrivingParameters
from protocols.motion.traffic import Traffic

_TURN_SEEN_RAD: Final = 0.02
"""Largest difference of a tick's turn from the commanded one at which the command counts, not what was seen."""
_TURN_ERROR_RAD: Final = 0.1
"""Largest difference in turn, in one tick, at which a command counts, not odometry that drifts."""
_WAY_ERROR_M: Final = 0.02
"""Largest difference in place, in one tick, at which a command counts, not odometry that drifts."""
_KEPT_SHARE: Final = 0.5
# ways are made of cells, and a robot cuts their corners
"""Share of the planned margin that is kept in any case."""
_CIRCLE_M: Final = 0.5
"""Distance of an aim below which a robot that does not face it turns on the spot."""
_ASKEW_RAD: Final = 0.25 * math.pi
"""Angle to such an aim from which on the robot turns on the spot."""
_NOTHING: Final = (0, 2)
_NOBODY: Final = (0, BODY_COLUMNS)


class Driver:
    """The motion of one robot, tick by tick; ways are in metres per tick, turns in rad per tick."""

    def __init__(
        self,
        floor: Floor,
        radius_m: float,
        speed_mps: float,
        acceleration_mps2: float,
        parameters: DrivingParameters,
        tick: Time,
    ) -> None:
        self.points: Floats = np.zeros(_NOTHING)
        """Scanned points of this tick, near by, of neither a wall nor a known body; shape (n, 2), m."""
        self._floor, self._own = floor, parameters
        self._tick, self._seconds = tick, to_seconds(tick)
        self._limits = _limits(radius_m, speed_mps, acceleration_mps2, parameters, self._seconds)
        self._stop_m = float(self._limits[1]) + stopping_m(self._limits[1] + self._limits[2], self._limits[2])
        self._motion = np.zeros(STATE)
        self.carried: Shift | None = None
        """Shift from the frame of the last tick to that of this one; None if the frame was not corrected."""
        self._odometry: Pose = (0.0, 0.0, 0.0)
        self._wanted = (math.nan, math.nan)
        self._asked: Time = -1

    # ------------------------------------------------------------ how it moves

    @property
    def here(self) -> Point:
        """Place of the robot."""
        return float(self._motion[0]), float(self._motion[1])

    @property
    def motion(self) -> Floats:
        """The robot's motion, as :mod:`cosim.navigation.dwa` has it; not to be changed."""
        return self._motion

    @property
    def wanted(self) -> tuple[float, float]:
        """Way and turn that were ordered last."""
        return self._wanted

    @property
    def stands(self) -> bool:
        """True if the robot stays where it is until the next tick."""
        return bool(self._motion[3] == 0.0)

    def reached(self, wanted: tuple[float, float], last: tuple[float, float]) -> tuple[float, float]:
        """Return the way and the turn that the robot reaches within a tick if *wanted* is ordered."""
        return towards(wanted[0], last[0], self._limits[2]), towards(wanted[1], last[1], self._limits[4])

    def speed_mps(self, way: float) -> float:
        """Return the speed at which a robot goes *way* in a tick."""
        return way / self._seconds

    def start_s(self, aim_m: Point, way_m: float) -> float:
        """Return the time, at most, in which the robot alone turns to an aim and then goes *way_m*, seconds."""
        _, _, change, turn_most, turn_change, *_ = self._limits.tolist()
        off = abs(
            math.remainder(
                elementary.atan2(aim_m[1] - self.here[1], aim_m[0] - self.here[0]) - self._motion[2], math.tau
            )
        )
        peak = min(turn_most, math.sqrt(off * turn_change))
        turning = off / peak + peak / turn_change if peak > 0.0 else 0.0
        return float(turning + math.sqrt(2.0 * way_m / change)) * self._seconds

    def order(self, way: float, turn: float) -> Drive | None:
        """Return the order for a way and a turn; None if it equals the last one."""
        if (way, turn) == self._wanted:
            return None
        self._wanted = way, turn
        return Drive(way / self._seconds, turn / self._seconds)

    def follow(self, observation: Observation, now: Time) -> None:
        """Note where the robot is, how it has moved in the last tick, and how it moves until the next."""
        x, y, heading, speed = observation[:4]
        motion, own = self._motion, self._limits
        way = speed * self._seconds
        self.carried = None
        if self._asked != now - self._tick:  # something else may have driven the robot since
            gone_x, gone_y = way * elementary.cos(heading), way * elementary.sin(heading)
            motion[:] = x, y, heading, way, 0.0, gone_x, gone_y
            self._wanted = math.nan, math.nan
        elif isinstance(observation, Located) and observation.odometry is not None:
            self._carry(observation, observation.odometry)
        else:
            was_x, was_y, was_heading, _, turn, _, _ = motion.tolist()
            seen = math.remainder(heading - was_heading, math.tau)
            # a body that was held turns less than it was ordered to
            if abs(math.remainder(seen - turn, math.tau)) > _TURN_SEEN_RAD:
                turn = min(max(seen, -own[3]), own[3])
            way, turn = self.reached(self._wanted, (way, turn))
            motion[:] = x, y, heading, way, turn, x - was_x, y - was_y
        if isinstance(observation, Located) and observation.odometry is not None:
            self._odometry = observation.odometry
        self._asked = now
        self.points = np.zeros(_NOTHING)

    def _carry(self, seen: Located, odometry: Pose) -> None:
        """Do what :meth:`follow` does where places are corrected: take the motion from the order, or from odometry."""
        was_x, was_y, was_heading, way, turn, _, _ = self._motion.tolist()
        ordered = *chord(0.0, way, turn), turn
        sensed = step(self._odometry, odometry)
        off_m, off_rad = math.dist(ordered[:2], sensed[:2]), abs(math.remainder(sensed[2] - turn, math.tau))
        # The order counts where both agree: odometry errs in heading at every tick, and by 0.02 rad in a tick a body
        # that stands 2 m off would seem to go 0.4 m/s.
        obeyed = not seen.blocked and off_m <= _WAY_ERROR_M and off_rad <= _TURN_ERROR_RAD
        gone = ordered if obeyed else sensed
        before = start(seen[:3], gone)
        self.carried = Shift.between((was_x, was_y, was_heading), before)
        most = self._limits[3]
        way, turn = self.reached(self._wanted, (way, turn if obeyed else min(max(gone[2], -most), most)))
        self._motion[:] = *seen[:3], way, turn, seen.x_m - before[0], seen.y_m - before[1]

    # ------------------------------------------------------------ what it does next

    def to(self, aim: Aim, observation: Observation, traffic: Traffic) -> tuple[float, float]:
        """Return way and turn of the tick after the next."""
        (x, y), own, motion, walls, bodies = self.here, self._limits, self._motion, self._walls(), traffic.bodies()
        self.points = unknown_points(walls, bodies, x, y, observation.ranges_m, self._reach_m, self._own.known_m)
        # how a robot moves that has just come into sight is not known before the next tick
        if traffic.surprises((x, y), 4.0 * own[0] + 3.0 * self._stop_m):
            return 0.0, 0.0
        most = self._most(motion, aim)
        if self._own.blind_corners and traffic.unseen_near(self.here):
            # the other robot comes at the same speed: each can use half of the gap
            gap = unseen_gap(walls, x, y, motion[2]) - own[0]
            most = min(most, max(braking_way(0.5 * gap, own[2]), own[2]))
        return self._choose(motion, aim, most, walls, self.points, bodies)

    def alone(self, motion: Floats, aim: Aim, points: Floats) -> tuple[float, float]:
        """Return what :meth:`to` would return for another *motion* from the same place, and without other robots."""
        return self._choose(motion, aim, self._most(motion, aim), self._walls(), points, np.zeros(_NOBODY))

    def _most(self, motion: Floats, aim: Aim) -> float:
        """Return the greatest way of the tick after the next by the *aim* alone, without obstacles."""
        own = self._limits
        dx, dy = chord(motion[2], motion[3], motion[4])
        off_x, off_y = aim.place_m[0] - motion[0] - dx, aim.place_m[1] - motion[1] - dy
        left_m = math.hypot(off_x, off_y)
        error = math.remainder(elementary.atan2(off_y, off_x) - motion[2] - motion[4], math.tau)
        if left_m < _CIRCLE_M and abs(error) > _ASKEW_RAD:
            return 0.0  # otherwise it would drive round a near aim for ever
        return float(min(own[1], braking_way(left_m, own[2]))) if aim.last else float(own[1])

    @property
    def _reach_m(self) -> float:
        """Distance within which walls and points can matter."""
        own = self._limits
        return float(own[0] + max(own[5], own[7], own[11]) + self._stop_m)

    def _walls(self) -> Floats:
        found: Floats = walls_near(self._floor.walls, *self.here, self._reach_m + 2.0 * self._limits[0])
        return found

    def _choose(
        self, motion: Floats, aim: Aim, most: float, walls: Floats, points: Floats, bodies: Floats
    ) -> tuple[float, float]:
        way, turn, _ = choose(self._limits, motion, walls, points, bodies, *aim.place_m, most)
        return float(way), float(turn)


def _limits(
    radius_m: float, speed_mps: float, acceleration_mps2: float, own: DrivingParameters, seconds: float
) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    row = np.empty(OWN)
    row[:] = (
        radius_m,
        speed_mps * seconds,
        acceleration_mps2 * (seconds * seconds),
        own.turn_radps * seconds,
        own.turn_acceleration_radps2 * (seconds * seconds),
        _KEPT_SHARE * own.margin_m,
        own.stray_m,
        own.clear_m,
        own.heading_weight,
        own.clearance_weight,
        own.speed_weight,
        own.arc_m if own.kind == "fox" else 0.0,
    )
    return row
