"""A world for navigators without a simulator: walls, one body that cannot enter them, and a ring of ranges."""

import math
from itertools import pairwise

import numpy as np

from cosim.geometry.segments import free_fraction, ray_casts, segment_grid
from cosim.navigation.status import Status

STEP_M = 0.1


class SmallWorld:
    """Walls as rows x1, y1, x2, y2, seen by *beams* out to *sight_m*, and a body of *radius_m* that they stop."""

    def __init__(self, walls, radius_m=0.2, beams=32, sight_m=5.0):
        self.grid = segment_grid(walls)
        self.radius_m = radius_m
        self.angles = 2 * np.pi * np.arange(beams) / beams
        self.sight_m = sight_m

    def scan(self, x, y):
        """Return the ranges as a machine gets them: a tuple, inf where nothing is within sight."""
        ranges = ray_casts(self.grid, np.tile((x, y), (len(self.angles), 1)), self.angles, self.sight_m)
        return tuple(math.inf if r >= self.sight_m else r for r in ranges.tolist())

    def move(self, x, y, dx, dy):
        """Return where the body ends that sets out to go (dx, dy): short of a wall in its way."""
        part = free_fraction(self.grid, x, y, dx, dy, self.radius_m, 1e-9)
        return x + part * dx, y + part * dy

    def run(self, navigator, start, goal, steps, until=Status.ARRIVED):
        """Return the places passed (n, 2) and the last status, after *steps* steps or when the status is *until*."""
        x, y = start
        places = [(x, y)]
        for _ in range(steps):
            steer = navigator.steer(x, y, goal, self.scan(x, y), (), STEP_M)
            if steer.status is until:
                break
            x, y = self.move(x, y, STEP_M * steer.dx, STEP_M * steer.dy)
            places.append((x, y))
        return np.array(places), steer.status


def outline(*corners):
    """Return the walls along the open chain of *corners*."""
    return [(*a, *b) for a, b in pairwise(corners)]


def post(x, y, radius, sides=64):
    """Return a round post as walls, symmetric about both axes through its middle."""
    angles = 2 * np.pi * (np.arange(sides + 1) + 0.5) / sides
    return outline(*((x + radius * math.cos(a), y + radius * math.sin(a)) for a in angles.tolist()))
