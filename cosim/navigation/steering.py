"""One convention for all local navigation algorithms: what a robot perceives goes in, where it steps next comes out.

A navigator is a small object that holds its own memory and calls pure functions for the rest: ``PotentialField`` and
``AvoidPast`` here (motor schemas, see ``schemas`` and ``past``). It knows no simulator, no clock and no channel.

The defaults are those of MissionLab's demos (reference algorithms 5.2, 5.3), fitted to an office: robots with a radius
of 0.2 to 0.25 m that step 0.1 m, doors of 0.9 to 1.2 m. MissionLab's margin of 0.5 m reaches to the middle of a door of
1 m, and its jambs throw a robot from side to side; 0.3 m leaves a way free between them. With its sphere of 1.4 m or
more the walls beside a door turn away more robots that come aslant. Its marks of 1 m to each side count what lies
behind walls as visited no less than what is near, and its ceiling of 100 lets the past outweigh both goal and walls, so
that the robot stays at the walls: marks are smaller than the horizon here, and the push at most twice the attraction of
the goal.
"""

import math
from collections.abc import Sequence
from struct import Struct
from typing import Final, Literal, NamedTuple, Protocol

import numpy as np
from pydantic import Field, model_validator

import cosim.elementary as elementary
from cosim.arrays import Floats
from cosim.jit import njit
from cosim.navigation.past import Corner, Counts, avoid_past, empty_past
from cosim.navigation.schemas import Vector, avoid_robots, beam_directions, clipped, direction, noise, potential_field
from cosim.navigation.status import STATUSES, STUCK, UNDERWAY, Status
from cosim.randomness import Draws
from cosim.settings import Count, Gain, Metres, Rate, Settings, error_at

_STILL: Final = 0.05
"""Share of a step below which a robot has not moved."""
_HELD_STEPS: Final = 3
"""Number of steps without motion after which a robot is held; a command may act a tick or two late."""
_FREEING: Final = 1
"""Purpose of the draws for steps that free a robot."""

_new: Final = tuple.__new__  # what a named tuple's own constructor calls; a third faster


class Steer(NamedTuple):
    """Where to step next, in the robot's frame F_i."""

    dx: float
    dy: float
    status: Status
    """(dx, dy) is a unit vector, or (0, 0) to stay; of a navigator that chooses speeds it is the share of the greatest
    speed, its length at most 1."""


class Navigator(Protocol):
    """A local navigation algorithm: what the paper calls A."""

    def steer(
        self,
        x_m: float,
        y_m: float,
        goal_m: Vector,
        ranges_m: Sequence[float] | Floats,
        sightings_m: Sequence[Vector] = (),
        step_m: float = 0.1,
    ) -> Steer:
        """Return the next step of a robot at (x, y), all in F_i, metres; called once a motion step.

        *ranges_m* is the scan, beam k at the angle 2 pi k / n; *sightings_m* are the places of the robots in sight;
        *step_m* is the length of the next step, or what the greatest speed makes of it.
        """
        ...

    def restart(self) -> None:
        """Forget the way so far: the goal is a new one."""
        ...


class PotentialFieldParameters(Settings):
    """Gains and distances of the motor schemas. Distances from walls are from the robot's centre."""

    drive: Literal["step", "speed"] = Field(
        default="step", description="steps of one length, or speeds that shrink with the field (greatest at length 1)"
    )
    goal_gain: Gain = Field(default=1.0, ge=0, description="weight of the unit vector to the goal")
    avoid_gain: Gain = Field(default=1.0, ge=0, description="weight of the repulsion of what the scan hits")
    avoid_sphere_m: Metres = Field(default=0.8, gt=0, description="walls farther off than this do not repel")
    avoid_margin_m: Metres = Field(
        default=0.3, ge=0, description="nearer walls repel with all force: more than the radius, less than half a door"
    )
    robot_gain: Gain = Field(default=1.0, ge=0, description="weight of the repulsion of robots in sight")
    robot_sphere_m: Metres = Field(default=1.0, gt=0, description="robots farther off, centre to centre, do not repel")
    robot_margin_m: Metres = Field(default=0.5, ge=0, description="robots nearer than this repel with all force")
    noise_gain: Gain = Field(default=0.1, ge=0, description="weight of a unit vector of random direction")
    noise_persistence: Count = Field(default=10, ge=1, description="motion steps for which a random direction is held")
    arrival_m: Metres = Field(default=0.1, ge=0, description="a goal as near as this is reached")
    progress_m: Metres = Field(
        default=0.1, ge=0, description="who has come nearer to the goal than ever by more than this makes progress"
    )
    patience: Count = Field(default=50, ge=1, description="motion steps without progress after which a robot is stuck")

    @model_validator(mode="after")
    def _margins_lie_inside(self) -> "PotentialFieldParameters":
        if not self.avoid_margin_m < self.avoid_sphere_m:
            raise error_at(("avoid_margin_m",), self.avoid_margin_m, f"is not < {self.avoid_sphere_m}, avoid_sphere_m")
        if not self.robot_margin_m < self.robot_sphere_m:
            raise error_at(("robot_margin_m",), self.robot_margin_m, f"is not < {self.robot_sphere_m}, robot_sphere_m")
        return self


MOST_CELLS: Final = 4096
"""Cells on a side of the largest memory of visits, which takes 64 MB."""


class AvoidPastParameters(PotentialFieldParameters):
    """The potential field's parameters, and those of the memory of visits."""

    patience: Count = Field(
        default=1000, ge=1, description="motion steps without progress after which a robot is stuck"
    )
    past_gain: Gain = Field(default=1.0, ge=0, description="weight of the push away from where the robot has been")
    past_ceiling: Gain = Field(default=2.0, gt=0, description="greatest length of that push, before its gain")
    horizon_m: Metres = Field(default=0.5, gt=0, description="visits farther off, along x or y, do not push")
    mark_m: Metres = Field(default=0.3, ge=0, description="how far around the robot, along x and y, ground is visited")
    cells_per_m: Rate = Field(default=10.0, gt=0, description="cells of the memory per metre")
    side_m: Metres = Field(default=30.0, gt=0, description="side of the square that is remembered, around the robot")

    @model_validator(mode="after")
    def _windows_fit(self) -> "AvoidPastParameters":
        if self.horizon_cells < 1:
            raise error_at(("horizon_m",), self.horizon_m, f"is less than a cell, of {1.0 / self.cells_per_m} m")
        if self.side_cells > MOST_CELLS:
            raise error_at(("side_m",), self.side_m, f"makes {self.side_cells} cells a side, at most {MOST_CELLS}")
        if not 2 * max(self.horizon_cells, self.mark_cells) < self.side_cells:
            raise error_at(("side_m",), self.side_m, "is not > twice horizon_m and twice mark_m")
        return self

    @property
    def horizon_cells(self) -> int:
        """The horizon in whole cells."""
        return round(self.horizon_m * self.cells_per_m)

    @property
    def mark_cells(self) -> int:
        """The reach of a mark in whole cells."""
        return round(self.mark_m * self.cells_per_m)

    @property
    def side_cells(self) -> int:
        """The side of the map in whole cells."""
        return round(self.side_m * self.cells_per_m)


# a navigator's numbers for its kernel: what it is told once, and what it remembers from step to step
_GOAL_GAIN, _AVOID_GAIN, _SPHERE, _MARGIN, _SPEEDS, _PROGRESS, _PATIENCE, _OWN_NUMBERS = range(8)
_NEAREST, _VAIN, _LAST_X, _LAST_Y, _ASKED, _STILL_STEPS, _MEMORY = range(7)
_HELD: Final = -1
"""Value in place of a status where the robot is held and its step is drawn."""


@njit(cache=True)
def _field_step(
    ranges: Floats,
    beams: Floats,
    own: Floats,
    memory: Floats,
    x_m: float,
    y_m: float,
    goal_x: float,
    goal_y: float,
    step_m: float,
    urge_x: float,
    urge_y: float,
) -> tuple[float, float, int]:
    """Return the motion along the potential field, added to an urge, and the status: one call a robot and step."""
    to_x, to_y = goal_x - x_m, goal_y - y_m
    distance = elementary.hypot(to_x, to_y)
    if distance < memory[_NEAREST] - own[_PROGRESS]:
        memory[_NEAREST], memory[_VAIN] = distance, 0.0
    else:
        memory[_VAIN] += 1.0
    if _is_held(memory, x_m, y_m, step_m):
        return 0.0, 0.0, _HELD
    goal_and_walls = own[: _MARGIN + 1]
    sum_x, sum_y = potential_field(ranges, beams, goal_and_walls, to_x, to_y, urge_x, urge_y)
    dx, dy = clipped(sum_x, sum_y) if own[_SPEEDS] > 0.0 else direction(sum_x, sum_y)
    memory[_ASKED] = max(abs(dx), abs(dy))
    return dx, dy, STUCK if memory[_VAIN] >= own[_PATIENCE] else UNDERWAY


@njit(cache=True)
def _past_step(
    ranges: Floats,
    beams: Floats,
    own: Floats,
    memory: Floats,
    visits: Counts,
    corner: Corner,
    past: Floats,
    x_m: float,
    y_m: float,
    goal_x: float,
    goal_y: float,
    step_m: float,
    urge_x: float,
    urge_y: float,
) -> tuple[float, float, int]:
    """Do what :func:`_field_step` does, with the push away from the past added to the urge."""
    push_x, push_y = avoid_past(visits, corner, past, x_m, y_m)
    urge_x, urge_y = urge_x + push_x, urge_y + push_y
    return _field_step(ranges, beams, own, memory, x_m, y_m, goal_x, goal_y, step_m, urge_x, urge_y)


@njit(cache=True)
def _is_held(memory: Floats, x_m: float, y_m: float, step_m: float) -> bool:
    """Return whether the robot has not moved for a few steps, although the field would have it move.

    A ring of beams does not see a wall's end that lies between two of them: the body is stopped by what does not repel
    it. A step in a random direction frees it.
    """
    last_x, last_y = memory[_LAST_X], memory[_LAST_Y]
    memory[_LAST_X], memory[_LAST_Y] = x_m, y_m
    least = _STILL * step_m * memory[_ASKED]
    if least == 0.0 or abs(x_m - last_x) > least or abs(y_m - last_y) > least:
        memory[_STILL_STEPS] = 0.0
        return False
    memory[_STILL_STEPS] += 1.0
    return bool(memory[_STILL_STEPS] >= _HELD_STEPS)


class _Ring:
    """Takes scans in, as tuples of any length or as arrays, in the form in which a kernel reads them fastest."""

    def __init__(self) -> None:
        self._size(0)

    def _size(self, count: int) -> None:
        self.beams = beam_directions(count)
        self._ranges: Floats = np.zeros(count)
        self._bytes = self._ranges.data
        self._pack = Struct(f"{count}d").pack_into

    def take(self, ranges_m: Sequence[float] | Floats) -> Floats:
        """Return the scan as an array that is good until the next call; ``beams`` fits it from then on."""
        if len(ranges_m) != len(self.beams):
            self._size(len(ranges_m))
        if isinstance(ranges_m, np.ndarray):
            return ranges_m
        self._pack(self._bytes, 0, *ranges_m)  # a third faster than to assign the slice
        return self._ranges


class PotentialField:
    """The paper's algorithm 1: the sum of motor schemas, without memory but for progress and the number of the step."""

    def __init__(self, parameters: PotentialFieldParameters, draws: Draws) -> None:
        """Take the noise from *draws*: step n's depends on n, counted over all goals, and on nothing else."""
        own = parameters
        self._arrival_m = own.arrival_m
        self._patience = own.patience
        self._robots = own.robot_gain, own.robot_sphere_m, own.robot_margin_m
        self._noise_gain = own.noise_gain
        self._noise_persistence = own.noise_persistence
        self._numbers = np.empty(_OWN_NUMBERS)
        self._numbers[: _MARGIN + 1] = own.goal_gain, own.avoid_gain, own.avoid_sphere_m, own.avoid_margin_m
        self._numbers[_SPEEDS:] = own.drive == "speed", own.progress_m, own.patience
        self._memory = np.zeros(_MEMORY)
        self._memory[_NEAREST] = math.inf
        self._draws = draws
        self._ring = _Ring()
        self._steps = 0
        self._noise: Vector = (0.0, 0.0)

    def steer(
        self,
        x_m: float,
        y_m: float,
        goal_m: Vector,
        ranges_m: Sequence[float] | Floats,
        sightings_m: Sequence[Vector] = (),
        step_m: float = 0.1,
    ) -> Steer:
        """Return the next step along the field, see :meth:`Navigator.steer`; stay where the goal is reached."""
        if math.hypot(goal_m[0] - x_m, goal_m[1] - y_m) <= self._arrival_m:
            return Steer(0.0, 0.0, Status.ARRIVED)
        urge_x, urge_y = self._urge(x_m, y_m, sightings_m)
        dx, dy, status = self._motion(ranges_m, x_m, y_m, *goal_m, step_m, urge_x, urge_y)
        if status == _HELD:
            dx, dy = noise(self._draws, self._steps, 1, _FREEING)
            self._memory[_ASKED] = max(abs(dx), abs(dy))
            status = STUCK if self._memory[_VAIN] >= self._patience else UNDERWAY
        return _new(Steer, (dx, dy, STATUSES[status]))

    def restart(self) -> None:
        """Forget the progress: the goal is a new one."""
        self._memory[_NEAREST], self._memory[_VAIN] = math.inf, 0.0

    def _motion(self, ranges_m: Sequence[float] | Floats, *numbers: float) -> tuple[float, float, int]:
        """Return the motion and the status, or _HELD; *numbers* are those that ``_field_step`` takes."""
        ring = self._ring
        ranges = ring.take(ranges_m)
        motion: tuple[float, float, int] = _field_step(ranges, ring.beams, self._numbers, self._memory, *numbers)
        return motion

    def _urge(self, x_m: float, y_m: float, sightings_m: Sequence[Vector]) -> Vector:
        """Return the weighted sum of all schemas that need neither the goal nor the scan nor a memory."""
        if self._steps % self._noise_persistence == 0:
            x, y = noise(self._draws, self._steps, self._noise_persistence)
            self._noise = self._noise_gain * x, self._noise_gain * y
        self._steps += 1
        if not sightings_m:
            return self._noise
        gain, sphere_m, margin_m = self._robots
        x, y = avoid_robots(x_m, y_m, sightings_m, sphere_m, margin_m)
        return self._noise[0] + gain * x, self._noise[1] + gain * y


class AvoidPast(PotentialField):
    """The paper's algorithm 2: the potential field, and a push away from where the robot has been on its way so far."""

    def __init__(self, parameters: AvoidPastParameters, draws: Draws) -> None:
        super().__init__(parameters, draws)
        own = parameters
        self._past = empty_past(
            own.side_cells, own.cells_per_m, own.horizon_cells, own.mark_cells, own.past_ceiling, own.past_gain
        )

    def restart(self) -> None:
        """Forget the progress and the ground visited: the goal is a new one."""
        super().restart()
        self._past.visits.fill(0)

    def _motion(self, ranges_m: Sequence[float] | Floats, *numbers: float) -> tuple[float, float, int]:
        ring = self._ring
        ranges = ring.take(ranges_m)
        motion: tuple[float, float, int] = _past_step(
            ranges, ring.beams, self._numbers, self._memory, *self._past, *numbers
        )
        return motion
