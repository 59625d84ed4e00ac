"""VFH+ of Ulrich and Borenstein: the free direction that is best for the goal, from a polar histogram of a scan.

I. Ulrich and J. Borenstein, "VFH+: Reliable Obstacle Avoidance for Fast Mobile Robots", Proc. IEEE Int. Conf. Robotics
and Automation, Leuven 1998, pp. 1572-1577. Sector k of n looks along k alpha, alpha = 2 pi / n. The four stages:

1. Primary histogram. What lies at the distance d and direction beta, nearer than the window's radius w, is enlarged by
   r, the robot's radius and a safety distance: it adds c^2 (a - b d^2) to the sectors within asin(r / d) of beta, where
   a - b w^2 = 1.
2. Binary histogram: a sector is blocked from above tau_high on until below tau_low.
3. Masked histogram, for robots with a least turning radius: blocked is also what lies beyond an obstacle that meets the
   robot, enlarged, on the turn that way.
4. Candidates: the middle of a narrow opening; of a wide one the directions s_max / 2 inside its borders, and the goal's
   if it lies between these. Chosen is the least of

       mu1 D(c, goal) + mu2 D(c, heading) + mu3 D(c, chosen before),    mu1 > mu2 + mu3.

The paper fills the window from a grid of past readings with certainties c. Here the cells are the readings of one scan,
c is 1 where a beam hits, distances are in metres. Where the paper is silent: an obstacle nearer than r blocks the half
plane on its side (asin 1). What lies beyond the goal by more than r is no obstacle, so that a robot reaches a goal in
front of a wall. Goal and heading are not rounded to sectors. A robot's heading is the direction of its last motion;
before it, and before the first choice, these terms are 0. Of equal candidates the one farther to the right is chosen,
so that two robots that meet head on pass each other.

A ring of n beams does not see what lies between two of them. A gap between two readings of a wall is closed where r is
more than half of it, pi w / n at most. A robot that is held by the end of a wall that no beam sees remembers for some
steps that there is an obstacle at its body, as if by a bumper (no part of VFH+).
"""

import math
from collections.abc import Sequence
from typing import Final, Self, TypeAlias

import numpy as np
from pydantic import Field, model_validator

import cosim.elementary as elementary
from cosim.arrays import Floats
from cosim.jit import njit
from cosim.navigation.status import STATUSES, STUCK, UNDERWAY, Status
from cosim.navigation.steering import Steer
from cosim.settings import Count, Gain, Metres, Settings, error_at

Vector: TypeAlias = tuple[float, float]

PRIMARY, BINARY, MASKED = range(3)
"""Rows of the histograms, shape (3, n)."""
NO_DIRECTION: Final = math.nan
"""Value for no direction."""

_CLOSED: Final = 1e-9
"""Share of a sector by which an interval of sectors may seem too short: they are closed."""
_TIE: Final = 1e-9
"""Difference below which costs are equal."""
_STILL: Final = 0.05
"""Share of a step below which a robot has not moved."""
_HELD_STEPS: Final = 3
"""Number of steps without motion after which a robot is held; a command may act a tick or two late."""

_new: Final = tuple.__new__  # what a named tuple's own constructor calls; a third faster


class VfhParameters(Settings):
    """Parameters of VFH+, for an office: doors of 0.9 to 1.2 m, scans of 32 beams that reach 1.5 m or more.

    With the default thresholds a single reading blocks its sectors when it comes nearer than 1 m, and frees them beyond
    1.2 m; a wall, hit by several beams whose sectors overlap, blocks from about 1.3 m on. More beams block sooner.
    """

    robot_radius_m: Metres = Field(default=0.25, gt=0, description="radius of the robot")
    safety_m: Metres = Field(
        default=0.1, ge=0, description="distance kept from obstacles; radius and this are less than half a door"
    )
    window_m: Metres = Field(
        default=1.5, gt=0, description="radius w of the active window: farther readings are ignored"
    )
    near_magnitude: Gain = Field(
        default=10.0, gt=1, description="a: magnitude of a reading at the robot's centre; it is 1 at the window's edge"
    )
    low_threshold: Gain = Field(default=4.0, ge=0, description="tau_low: a sector with less becomes free")
    high_threshold: Gain = Field(default=6.0, gt=0, description="tau_high: a sector with more becomes blocked")
    sectors: int = Field(default=72, ge=8, le=720, description="sectors of the polar histogram")
    wide_sectors: Count = Field(default=16, ge=1, description="s_max: openings with more sectors are wide")
    goal_weight: Gain = Field(default=5.0, ge=0, description="mu1: cost of a sector's difference from the goal")
    heading_weight: Gain = Field(default=2.0, ge=0, description="mu2: the same from the direction of motion")
    previous_weight: Gain = Field(default=2.0, ge=0, description="mu3: the same from the direction chosen before")
    turning_radius_m: Metres = Field(
        default=0.0, ge=0, description="least radius of a turn; 0: the robot drives in any direction at once"
    )
    arrival_m: Metres = Field(default=0.1, ge=0, description="a goal as near as this is reached")
    progress_m: Metres = Field(
        default=0.1, ge=0, description="who has come nearer to the goal than ever by more than this makes progress"
    )
    patience: Count = Field(default=50, ge=1, description="motion steps without progress after which a robot is stuck")
    bump_steps: Count = Field(
        default=30, ge=0, description="motion steps for which what has held the robot unseen counts as an obstacle"
    )

    @model_validator(mode="after")
    def _numbers_agree(self) -> Self:
        if not self.goal_weight > self.heading_weight + self.previous_weight:
            expected = f"is not > {self.heading_weight} + {self.previous_weight}, heading_weight + previous_weight"
            raise error_at(("goal_weight",), self.goal_weight, f"{expected}: the robot might never turn to the goal")
        if not self.low_threshold <= self.high_threshold < self.near_magnitude:
            expected = f"is not >= {self.low_threshold}, low_threshold, and < {self.near_magnitude}, near_magnitude"
            raise error_at(("high_threshold",), self.high_threshold, expected)
        if not self.reach_m < self.window_m:
            raise error_at(("window_m",), self.window_m, f"is not > {self.reach_m}, robot_radius_m + safety_m")
        if not self.wide_sectors < self.sectors:
            raise error_at(("wide_sectors",), self.wide_sectors, f"is not < {self.sectors}, sectors")
        return self

    @property
    def reach_m(self) -> float:
        """The radius r by which obstacles are enlarged."""
        return self.robot_radius_m + self.safety_m


# what VFH+ is told once, and what it remembers from step to step
_REACH, _WINDOW, _NEAR, _LOW, _HIGH, _WIDE, _GOAL, _ONWARD, _AGAIN, _TURN, _BODY = range(11)
_PROGRESS, _PATIENCE, _BUMP_STEPS, OWN_NUMBERS = range(11, 15)
_HEADING, _PREVIOUS, _NEAREST, _VAIN, _LAST_X, _LAST_Y, _ASKED, _STILL_STEPS = range(8)
_BUMP_LEFT, _BUMP_X, _BUMP_Y, MEMORY = range(8, 12)


def vfh_numbers(parameters: VfhParameters) -> Floats:
    """Return *parameters* as the kernels of this module take them, shape (OWN_NUMBERS,)."""
    own = parameters
    return np.array(
        (
            *(own.reach_m, own.window_m, own.near_magnitude, own.low_threshold, own.high_threshold, own.wide_sectors),
            *(own.goal_weight, own.heading_weight, own.previous_weight, own.turning_radius_m, own.robot_radius_m),
            *(own.progress_m, own.patience, own.bump_steps),
        ),
        np.float64,
    )


# ---------------------------------------------------------------- the four stages


@njit(cache=True)
def add_reading(distance_m: float, angle_rad: float, own: Floats, primary: Floats) -> None:
    """Add an obstacle to the *primary* histogram (n,): equations 2 to 6 of the paper, with c = 1.

    *own* are the :func:`vfh_numbers`. A reading at the edge of the window counts, one beyond it does not.
    """
    reach, window, near = own[_REACH], own[_WINDOW], own[_NEAR]
    if not distance_m <= window:  # also for NaN
        return
    magnitude = near - (near - 1.0) * (distance_m / window) ** 2
    half = elementary.asin(reach / distance_m) if distance_m > reach else 0.5 * math.pi
    sectors = primary.shape[0]
    per_rad = sectors / (2.0 * math.pi)
    first = math.ceil((angle_rad - half) * per_rad - _CLOSED)
    last = math.floor((angle_rad + half) * per_rad + _CLOSED)
    for k in range(first, last + 1):
        primary[k % sectors] += magnitude


@njit(cache=True)
def update_binary(primary: Floats, low: float, high: float, binary: Floats) -> None:
    """Block (1) the sectors of *binary* (n,) above *high*, free (0) those below *low*, leave the others: equation 7."""
    for k in range(primary.shape[0]):
        if primary[k] > high:
            binary[k] = 1.0
        elif primary[k] < low:
            binary[k] = 0.0


@njit(cache=True)
def turn_limit(distance_m: float, off_rad: float, own: Floats, limit_rad: float) -> float:
    """Return how far a robot can turn to one side if an obstacle lies *off_rad* >= 0 to that side of its heading.

    That is *off_rad* if the obstacle is nearer than *limit_rad* and nearer than r to the circle of the sharpest turn,
    else *limit_rad*: equations 8 and 9.
    """
    turn, reach = own[_TURN], own[_REACH]
    if off_rad < limit_rad and distance_m <= own[_WINDOW]:
        ahead, aside = distance_m * elementary.cos(off_rad), distance_m * elementary.sin(off_rad)
        if ahead * ahead + (aside - turn) * (aside - turn) < (turn + reach) * (turn + reach):
            return off_rad
    return limit_rad


@njit(cache=True)
def mask_histogram(binary: Floats, heading_rad: float, right_rad: float, left_rad: float, masked: Floats) -> None:
    """Write to *masked* (n,) what is blocked in *binary* or more than the limits right and left of the heading."""
    sectors = binary.shape[0]
    alpha = 2.0 * math.pi / sectors
    for k in range(sectors):
        off = _wrapped(k * alpha - heading_rad, 2.0 * math.pi)
        turnable = -off <= right_rad + _CLOSED if off < 0.0 else off <= left_rad + _CLOSED
        masked[k] = binary[k] if turnable else 1.0


@njit(cache=True)
def best_candidate(masked: Floats, goal: float, heading: float, previous: float, own: Floats) -> float:
    """Return the candidate direction of least cost, in sectors 0 <= c < n, or NO_DIRECTION if all are blocked.

    *goal*, *heading* and *previous* are directions in sectors, not rounded; those that there are not, NO_DIRECTION.
    If no sector of *masked* (n,) is blocked, the goal's direction is the one candidate.
    """
    sectors: int = masked.shape[0]
    wide = own[_WIDE]
    start = 0
    while start < sectors and masked[start] == 0.0:
        start += 1
    if start == sectors:
        return goal % sectors
    best: float = NO_DIRECTION
    least = math.inf
    right = start + 1
    for k in range(start + 1, start + sectors + 1):  # ends in the blocked sector that it starts from
        if masked[k % sectors] == 0.0:
            continue
        left = k - 1
        if right <= left:
            narrow = left - right <= wide
            middle = 0.5 * (left + right)
            first, last = (middle, middle) if narrow else (right + 0.5 * wide, left - 0.5 * wide)
            best, least = _better(best, least, first, goal, heading, previous, own, sectors)
            if not narrow:
                best, least = _better(best, least, last, goal, heading, previous, own, sectors)
                if (goal - first) % sectors <= last - first:
                    best, least = _better(best, least, goal, goal, heading, previous, own, sectors)
        right = k + 1
    return best % sectors


@njit(cache=True)
def _better(
    best: float, least: float, new: float, goal: float, heading: float, previous: float, own: Floats, sectors: int
) -> Vector:
    """Return the better of two candidates and its cost; of equal ones that farther to the right of the goal."""
    off = _wrapped(new - goal, sectors)
    cost = own[_GOAL] * abs(off)
    if not math.isnan(heading):
        cost += own[_ONWARD] * abs(_wrapped(new - heading, sectors))
    if not math.isnan(previous):
        cost += own[_AGAIN] * abs(_wrapped(new - previous, sectors))
    if cost < least - _TIE or (cost <= least + _TIE and off < _wrapped(best - goal, sectors)):
        return new, cost
    return best, least


@njit(cache=True)
def _wrapped(difference: float, turn: float) -> float:
    """Return a difference of directions as one from -turn / 2, included, to turn / 2."""
    return (difference + 0.5 * turn) % turn - 0.5 * turn


# ---------------------------------------------------------------- a step


@njit(cache=True)
def vfh_direction(
    ranges: Floats, own: Floats, memory: Floats, histograms: Floats, goal_rad: float, goal_m: float, x: float, y: float
) -> float:
    """Return the direction (radians) to go, or NO_DIRECTION where all are blocked, and remember it in *memory*.

    *ranges* (m,) is the scan, beam k along 2 pi k / m; the goal lies *goal_m* off at *goal_rad*. x and y (metres) say
    how a remembered bump lies. *memory* (MEMORY,) holds the heading and the direction chosen before, in radians.
    *histograms* (3, n) takes all three; of its old content the binary one is read, for the hysteresis.
    """
    primary, binary, masked = histograms[PRIMARY], histograms[BINARY], histograms[MASKED]
    primary[:] = 0.0
    farthest = min(own[_WINDOW], goal_m + own[_REACH])
    heading, turning = memory[_HEADING], own[_TURN] > 0.0 and not math.isnan(memory[_HEADING])
    right, left = math.pi, math.pi
    apart = 2.0 * math.pi / max(ranges.shape[0], 1)
    for k in range(ranges.shape[0] + 1):
        if k < ranges.shape[0]:
            distance, angle = ranges[k], k * apart
        elif memory[_BUMP_LEFT] > 0.0:
            distance = elementary.hypot(memory[_BUMP_X] - x, memory[_BUMP_Y] - y)
            angle = elementary.atan2(memory[_BUMP_Y] - y, memory[_BUMP_X] - x)
        else:
            break
        if not distance <= farthest:
            continue
        add_reading(distance, angle, own, primary)
        if turning:
            off = _wrapped(angle - heading, 2.0 * math.pi)
            if off <= 0.0:
                right = turn_limit(distance, -off, own, right)
            if off >= 0.0:
                left = turn_limit(distance, off, own, left)
    update_binary(primary, own[_LOW], own[_HIGH], binary)
    if turning:
        mask_histogram(binary, heading, right, left, masked)
    else:
        masked[:] = binary
    per_rad = primary.shape[0] / (2.0 * math.pi)
    previous = memory[_PREVIOUS] * per_rad
    best: float = best_candidate(masked, goal_rad * per_rad, heading * per_rad, previous, own) / per_rad
    if not math.isnan(best):
        memory[_PREVIOUS] = best
    return best


@njit(cache=True)
def _vfh_step(
    ranges: Floats,
    own: Floats,
    memory: Floats,
    histograms: Floats,
    x_m: float,
    y_m: float,
    goal_x: float,
    goal_y: float,
    step_m: float,
) -> tuple[float, float, int]:
    """Return the motion and the status: one call a robot and step."""
    to_x, to_y = goal_x - x_m, goal_y - y_m
    distance = elementary.hypot(to_x, to_y)
    if distance < memory[_NEAREST] - own[_PROGRESS]:
        memory[_NEAREST], memory[_VAIN] = distance, 0.0
    else:
        memory[_VAIN] += 1.0
    _note_motion(own, memory, x_m, y_m, step_m)
    direction = vfh_direction(ranges, own, memory, histograms, elementary.atan2(to_y, to_x), distance, x_m, y_m)
    if math.isnan(direction):
        memory[_ASKED] = 0.0
        return 0.0, 0.0, STUCK
    memory[_ASKED] = 1.0
    status = STUCK if memory[_VAIN] >= own[_PATIENCE] else UNDERWAY
    return elementary.cos(direction), elementary.sin(direction), status


@njit(cache=True)
def _note_motion(own: Floats, memory: Floats, x_m: float, y_m: float, step_m: float) -> None:
    """Take the heading from the motion since the last step; without motion, note what holds the robot."""
    way_x, way_y = x_m - memory[_LAST_X], y_m - memory[_LAST_Y]
    memory[_LAST_X], memory[_LAST_Y] = x_m, y_m
    memory[_BUMP_LEFT] = max(memory[_BUMP_LEFT] - 1.0, 0.0)
    if math.isnan(way_x) or elementary.hypot(way_x, way_y) > _STILL * step_m:
        memory[_STILL_STEPS] = 0.0
        if not math.isnan(way_x):
            memory[_HEADING] = elementary.atan2(way_y, way_x)
    elif memory[_ASKED] > 0.0:
        memory[_STILL_STEPS] += 1.0
        if memory[_STILL_STEPS] >= _HELD_STEPS:
            memory[_STILL_STEPS], memory[_BUMP_LEFT] = 0.0, own[_BUMP_STEPS]
            memory[_BUMP_X] = x_m + own[_BODY] * elementary.cos(memory[_PREVIOUS])
            memory[_BUMP_Y] = y_m + own[_BODY] * elementary.sin(memory[_PREVIOUS])


class Vfh:
    """VFH+ behind the convention of navigators, see :class:`cosim.navigation.steering.Navigator`.

    All steps have length 1; the caller chooses the speed.
    """

    def __init__(self, parameters: VfhParameters) -> None:
        self._arrival_m = parameters.arrival_m
        self._own = vfh_numbers(parameters)
        self._memory = np.zeros(MEMORY)
        self._memory[[_HEADING, _LAST_X, _LAST_Y]] = math.nan
        self.histograms: Floats = np.zeros((3, parameters.sectors))
        """Primary, binary and masked histogram of the last step, for plots; shape (3, sectors)."""
        self._ranges: Floats = np.zeros(0)
        self.restart()

    def steer(
        self,
        x_m: float,
        y_m: float,
        goal_m: Vector,
        ranges_m: Sequence[float] | Floats,
        sightings_m: Sequence[Vector] = (),
        step_m: float = 0.1,
    ) -> Steer:
        """Return the next step, see :meth:`Navigator.steer`; (0, 0) and STUCK while all directions are blocked.

        STUCK is also reported, with a step, after too many steps without progress. *sightings_m* are not used: a scan
        meets the bodies of other robots.
        """
        if math.hypot(goal_m[0] - x_m, goal_m[1] - y_m) <= self._arrival_m:
            return Steer(0.0, 0.0, Status.ARRIVED)
        if not isinstance(ranges_m, np.ndarray):
            if len(ranges_m) != len(self._ranges):
                self._ranges = np.zeros(len(ranges_m))
            self._ranges[:] = ranges_m
            ranges_m = self._ranges
        dx, dy, status = _vfh_step(
            ranges_m, self._own, self._memory, self.histograms, x_m, y_m, goal_m[0], goal_m[1], step_m
        )
        return _new(Steer, (dx, dy, STATUSES[status]))

    def restart(self) -> None:
        """Forget the progress and the direction chosen before: the goal is a new one. Obstacles are not forgotten."""
        self._memory[_NEAREST], self._memory[_VAIN] = math.inf, 0.0
        self._memory[_PREVIOUS] = math.nan
        self._memory[_ASKED] = self._memory[_STILL_STEPS] = 0.0
