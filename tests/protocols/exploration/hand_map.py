"""Maps that are drawn by hand: ``#`` is occupied, ``.`` empty, ``?`` unknown; the first line is the highest row."""

import numpy as np

from cosim.geometry.marking import CERTAIN, frontier_grid
from cosim.observation import Observation, Seen, Sighting
from protocols.mapping.belief import Belief, Frame

SIGNS = {"#": 127, ".": -1, "?": 0}
CELL_M = 0.5
ORIGIN_M = (-1.0, 2.0)


def drawn(picture: str, range_m: float = 2.5) -> Belief:
    """Return the map of a *picture*, with cells of half a metre."""
    rows = [line.strip() for line in reversed(picture.split())]
    belief = Belief(Frame(ORIGIN_M, CELL_M, len(rows[0]), len(rows)), CERTAIN, range_m)
    belief.evidence[:] = [[SIGNS[sign] for sign in row] for row in rows]
    renew(belief)
    return belief


def renew(belief: Belief) -> None:
    """Find the frontiers of a map that was changed by hand."""
    belief.frontier[:] = frontier_grid(belief.evidence, False)
    belief.version += 1


def at(ix: float, iy: float) -> tuple[float, float]:
    """Return the centre of a cell."""
    return ORIGIN_M[0] + (ix + 0.5) * CELL_M, ORIGIN_M[1] + (iy + 0.5) * CELL_M


def observed(place_m: tuple[float, float], *others: tuple[float, float]) -> Observation:
    """Return what a robot senses at a place that sees others at theirs, and has no scanner."""
    seen = tuple(Sighting(k + 1, *other) for k, other in enumerate(others))
    return Observation(*place_m, 0.0, 0.3, True, False, Seen(tuple(each.address for each in seen), seen))


def path_of(grid: np.ndarray, belief: Belief) -> list[tuple[int, int]]:
    """Return the cells (ix, iy) that are not 0 in a grid, by columns."""
    return sorted((int(ix), int(iy)) for iy, ix in np.argwhere(grid[:, : belief.frame.nx]))
