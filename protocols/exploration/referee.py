"""The truth of an exploration: what the team's scanners have covered, when, and how many robots have.

A cell is covered when a beam from a true place passes it: as the robots' own maps are marked, but without noise. What
counts are the cells that can be covered at all (:func:`protocols.exploration.truth.coverable_cells`).
"""

import math
from collections.abc import Sequence
from functools import cached_property
from typing import Final

import numpy as np

from cosim.arrays import Bools, Floats
from cosim.geometry.marking import Weights
from cosim.geometry.segments import ray_casts, segment_grid
from cosim.navigation.schemas import beam_directions
from cosim.protocol import Death, Referee, Surroundings
from cosim.units import Time, to_seconds
from protocols.exploration.setup import Setup
from protocols.exploration.truth import coverable_cells, first_in_way_m
from protocols.mapping.belief import Belief

LOOK_TICKS: Final = 2
"""So often the truth is looked at."""
SHARES: Final = (0.5, 0.95, 0.99)
"""Of what can be covered: how long it takes."""
_PASSED: Final = Weights(1, 127, 127)
"""What a beam passes is empty, also if another has hit it: the far side of a wall may be in the same cell."""
_ROUNDING: Final = 1e-9


class CoverageReferee(Referee):
    """Watches what each robot's beams pass. It ends no run: robots find out for themselves that all is done."""

    def __init__(self, setup: Setup, surroundings: Surroundings) -> None:
        self._surroundings = surroundings
        self._frame = setup.frame
        self._range_m = setup.range_m
        self._radii_m = np.array(setup.radii_m)
        self._walls = segment_grid(surroundings.walls_m)
        self._beams = beam_directions(setup.beams)
        self._angles = 2.0 * math.pi * np.arange(setup.beams) / setup.beams
        self._maps = [Belief(setup.frame, _PASSED, setup.range_m) for _ in range(setup.size)]
        cells = setup.frame.nx * setup.frame.ny
        self._covered = np.zeros((setup.size, cells), np.bool_)
        """What each robot has covered."""
        self._since = np.full(cells, -1, np.int64)
        """When a robot covered a cell first."""
        self._dead: set[int] = set()
        self._looks = 0

    def look(self, x_m: Floats, y_m: Floats, now: Time) -> bool:
        """Note what is covered from the true places."""
        self._looks += 1
        if (self._looks - 1) % LOOK_TICKS == 0:
            bodies = np.stack((x_m, y_m, self._radii_m), axis=1)
            for robot in range(len(bodies)):
                if robot not in self._dead:
                    self._cover(robot, bodies, now)
        return False

    def _cover(self, robot: int, bodies: Floats, now: Time) -> None:
        place = float(bodies[robot, 0]), float(bodies[robot, 1])
        away = np.hypot(bodies[:, 0] - place[0], bodies[:, 1] - place[1]) - bodies[:, 2]
        near = away <= self._range_m
        near[robot] = False
        others = bodies[near]
        origins = np.broadcast_to(np.array(place), (len(self._angles), 2))
        ranges_m = ray_casts(self._walls, origins, self._angles, self._range_m)
        ranges_m = first_in_way_m(ranges_m, self._beams, place, others)
        known, covered = self._maps[robot], self._covered[robot]
        changed = known.mark(place, ranges_m, self._beams, others)
        covered[changed[~known.occupied(changed)]] = True
        self._since[changed[covered[changed] & (self._since[changed] < 0)]] = now

    def died(self, death: Death) -> None:
        """Note that a robot sees nothing any more; its body stays in the way."""
        self._dead.add(death.robot)

    def coverage(self) -> float:
        """Return the share of what can be covered that has been by now; NaN if nothing can be."""
        whole = np.count_nonzero(self._wanted)
        return float(np.count_nonzero(self._since[self._wanted] >= 0) / whole) if whole else math.nan

    def times_s(self, shares: Sequence[float]) -> list[float]:
        """Return when each of *shares* of what can be covered had been; NaN for what never was."""
        since = self._since[self._wanted]
        ordered = np.sort(since[since >= 0])
        return [when_s(ordered, share * len(since)) for share in shares]

    def verdict(self, now: Time) -> dict[str, float]:
        """Return how much of what can be covered was, when, and how much of that by two robots or more."""
        wanted = self._wanted
        covered = int(np.count_nonzero(self._since[wanted] >= 0))
        twice = int(np.count_nonzero(self._covered[:, wanted].sum(axis=0) > 1))
        return {
            **{
                f"time_{round(100 * share)}_s": time_s
                for share, time_s in zip(SHARES, self.times_s(SHARES), strict=True)
            },
            "coverage": self.coverage(),
            "cells_missed": float(np.count_nonzero(wanted) - covered),
            "covered_twice": twice / covered if covered else math.nan,
        }

    @cached_property
    def _wanted(self) -> Bools:
        """What can be covered, flat; only found out if somebody asks."""
        return coverable_cells(self._frame, self._surroundings)


def when_s(since: "np.ndarray[tuple[int, ...], np.dtype[np.int64]]", cells: float) -> float:
    """Return when so many cells were covered, given when each was, in order; NaN if so many never were."""
    nth = max(math.ceil(cells - _ROUNDING), 1)
    return to_seconds(int(since[nth - 1])) if nth <= len(since) else math.nan
