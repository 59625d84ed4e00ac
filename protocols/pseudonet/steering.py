"""Driving from cell to cell: where the robot is going, and whether it gets there."""

from enum import Enum, auto
from typing import Final

from cosim.geometry.grids import Cell
from cosim.machine import Command, GoTo
from cosim.observation import Observation
from protocols.pseudonet.setup import Setup

ARRIVAL_TOLERANCE_M: Final = 1e-6
PATIENCE_TICKS: Final = 30
"""World ticks that a robot pushes against something before it drives back to the cell that it came from."""


class Progress(Enum):
    """What an observation says about the drive."""

    NONE = auto()
    ARRIVED = auto()
    TURNED_BACK = auto()
    """Something that the team does not know of stands in the way: the robot drives back."""
    STUCK = auto()
    """The way back, or to the middle of its cell, is obstructed as well: the robot stays where it is."""


class Steering:
    """One robot's drive to its next cell."""

    def __init__(self, setup: Setup) -> None:
        self.motion: list[Command] = []
        self._grid = setup.grid
        self._goal: tuple[float, float] | None = None
        self._cell: Cell = -1
        self._origin: Cell = -1
        self._pushed = 0

    @property
    def under_way(self) -> bool:
        """Whether the robot has not arrived yet."""
        return self._goal is not None

    def centred(self, cell: Cell, observation: Observation) -> bool:
        """Return whether the robot stands in the middle of *cell*."""
        x_m, y_m = self._grid.centre_m(cell)
        return max(abs(observation.x_m - x_m), abs(observation.y_m - y_m)) < ARRIVAL_TOLERANCE_M

    def go(self, cell: Cell, origin: Cell) -> None:
        """Drive to *cell*, and back to *origin* if that cannot be done."""
        self._cell = cell
        self._origin = origin
        self._pushed = 0
        self._goal = self._grid.centre_m(cell)
        self.motion.append(GoTo(*self._goal))

    def observe(self, observation: Observation) -> Progress:
        """Notice that the robot has arrived, or that something keeps it from arriving."""
        if self._goal is None:
            return Progress.NONE
        if observation.arrived and self.centred(self._cell, observation):
            self._goal = None
            return Progress.ARRIVED
        if observation.blocked:
            self._pushed += 1
        if self._pushed <= PATIENCE_TICKS:
            return Progress.NONE
        if self._origin != self._cell:
            self.go(self._origin, self._origin)
            return Progress.TURNED_BACK
        self._goal = None
        self.motion.append(GoTo(observation.x_m, observation.y_m))
        return Progress.STUCK
