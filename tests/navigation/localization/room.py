"""A room for tests of localisation: its plan, its map, and scans by plain geometry."""

import numpy as np

from cosim.navigation.localization.likelihood import known_map

CELL_M = 0.1
ORIGIN_M = (-1.0, 2.0)


def room():
    """Return a walled room of 6 m x 4 m, without a symmetry: which cells are occupied."""
    occupied = np.zeros((40, 60), bool)
    occupied[[0, -1], :] = occupied[:, [0, -1]] = True
    occupied[20:, 25:27] = True  # a wall from the north, and a thick pillar
    occupied[8:13, 40:46] = True
    return occupied


def room_map(radius_m=0.2):
    occupied = room()
    return known_map(occupied, ~occupied, ORIGIN_M, CELL_M, radius_m)


def squares(occupied):
    """Return lower left and upper right corners (k, 2) of the occupied cells in metres."""
    iy, ix = np.nonzero(occupied)
    low = np.stack((ix, iy), axis=1) * CELL_M + ORIGIN_M
    return low, low + CELL_M


def slab_ranges(occupied, x, y, ways, limit_m):
    """Return the ranges along unit vectors (n, 2) by the slab method: where a ray enters each occupied square."""
    low, high = squares(occupied)
    with np.errstate(divide="ignore"):
        a, b = (low - (x, y)) / ways[:, np.newaxis], (high - (x, y)) / ways[:, np.newaxis]
    enters, leaves = np.minimum(a, b).max(axis=2), np.maximum(a, b).min(axis=2)
    met = np.where((enters < leaves) & (leaves > 0), np.maximum(enters, 0.0), limit_m)
    return np.minimum(met.min(axis=1), limit_m)


def scan(pose, beams=60, range_m=8.0, turned=0.0):
    """Return the ranges of beams that look along 2 pi k / n, from the heading plus an angle."""
    angles = pose[2] + turned + 2 * np.pi * np.arange(beams) / beams
    return slab_ranges(room(), *pose[:2], np.stack((np.cos(angles), np.sin(angles)), axis=1), range_m)
