"""The truth of an exploration: what the team's sensors have covered, and what they could.

A cell is covered when a beam from a true place passes it: as the robots' own maps are marked, but with true places and
without noise. To be covered is what can be: cells whose centre is free and in sight, within the sensors' range, from
some cell that a robot's centre can reach (a flood fill from the starts).
"""

import math
from typing import Any, Final

import numpy as np

from cosim.geometry.grids import coverage_grid
from cosim.geometry.marking import CERTAIN
from cosim.geometry.segments import ray_casts, sees, segment_grid
from cosim.machine import Death, Surroundings
from cosim.navigation.schemas import beam_directions
from cosim.units import Time, to_seconds
from protocols.exploration.belief import Belief, Frame
from protocols.exploration.knowledge import Knowledge

Floats = np.ndarray[Any, np.dtype[np.float64]]

LOOK_TICKS: Final = 2
"""So often the truth is looked at."""
SHARES: Final = (0.5, 0.95, 0.99)
"""Of what can be covered: how long it takes."""


class CoverageReferee:
    """Marks a map of its own from the true places. It ends no run: robots find out for themselves that all is done."""

    def __init__(self, knowledge: Knowledge, surroundings: Surroundings) -> None:
        self._knowledge = knowledge
        self._surroundings = surroundings
        self._walls = segment_grid(surroundings.walls_m)
        self._seen = Belief(knowledge.frame, CERTAIN, knowledge.range_m)
        self._beams = beam_directions(knowledge.beams)
        self._angles = 2.0 * math.pi * np.arange(knowledge.beams) / knowledge.beams
        self._covered: list[tuple[Time, int]] = []
        self._count = 0
        self._times = np.zeros(self._seen.evidence.size, np.uint16)
        """How many robots have covered each cell."""
        self._own = [np.zeros(self._seen.evidence.size, np.bool_) for _ in range(knowledge.size)]
        self._dead: set[int] = set()
        self._looks = 0

    def look(self, x_m: Floats, y_m: Floats, now: Time) -> bool:
        """Mark what is seen from the true places."""
        self._looks += 1
        if self._looks % LOOK_TICKS != 1 and LOOK_TICKS > 1:
            return False
        nobody = np.empty((0, 3))
        for robot in range(self._knowledge.size):
            if robot in self._dead:
                continue
            place = float(x_m[robot]), float(y_m[robot])
            origins = np.broadcast_to(np.array(place), (len(self._angles), 2))
            ranges_m = ray_casts(self._walls, origins, self._angles, self._knowledge.range_m)
            ranges_m[ranges_m >= self._knowledge.range_m] = math.inf
            self._count += len(self._seen.mark(place, ranges_m, self._beams, nobody))
        self._covered.append((now, int((self._seen.evidence < 0).sum()) if self._looks % 20 == 1 else self._count))
        return False

    def died(self, death: Death) -> None:
        """Note that a robot sees nothing any more."""
        self._dead.add(death.robot)

    def verdict(self, now: Time) -> dict[str, float]:
        """Return when how much was covered."""
        covered = self._seen.evidence < 0
        missing = self._missing(covered)
        whole = int(covered.sum()) + missing
        times = np.array([to_seconds(at) for at, _ in self._covered])
        counts = np.array([count for _, count in self._covered])
        found = {
            f"time_{round(100 * share)}_s": next(iter(times[counts >= share * whole]), math.nan) for share in SHARES
        }
        return {**found, "coverage": covered.sum() / whole if whole else math.nan, "cells_missed": float(missing)}

    def _missing(self, covered: np.ndarray[Any, np.dtype[np.bool_]]) -> int:
        """Return how many cells nobody has covered that could be."""
        knowledge, surroundings = self._knowledge, self._surroundings
        frame: Frame = knowledge.frame
        grid = coverage_grid(
            (frame.origin_m[0], frame.origin_m[1], frame.origin_m[0] + frame.nx * frame.cell_m,
             frame.origin_m[1] + frame.ny * frame.cell_m),
            frame.cell_m,
            min(knowledge.radii_m),
            surroundings.walls_m,
            surroundings.forbidden,
            np.array(knowledge.starts_m),
        )  # fmt: skip
        centres = grid.centres_m()
        poses = centres[grid.reachable]
        left = np.flatnonzero(~covered.reshape(-1) & (self._seen.evidence.reshape(-1) == 0))
        left = left[~surroundings.forbidden(centres[left])]
        missed = 0
        for cell in left:
            near = poses[np.hypot(*(poses - centres[cell]).T) <= knowledge.range_m]
            missed += bool(len(near)) and bool(
                sees(self._walls, np.broadcast_to(centres[cell], near.shape), near).any()
            )
        return missed
