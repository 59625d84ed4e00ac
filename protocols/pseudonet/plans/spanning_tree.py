"""Spanning-tree coverage: a closed walk around a tree of mega-cells of two by two cells.

Gabriely and Rimon ("Spanning-tree based coverage of continuous areas by a mobile robot", Annals of Mathematics and
Artificial Intelligence 31, 2001) span a tree over mega-cells and drive around it: a Hamiltonian cycle if all mega-cells
are whole. Hazon and Kaminka (MSTC, ICRA 2005) cut the cycle into one piece for each robot.

Here the walk is kept as its set of directed steps, in which each cell is left as often as it is entered, so that every
connected set is one closed walk (Euler). A whole mega-cell begins as its counter-clockwise round of four steps; a
partial one as steps to and fro along what is connected in it, where two parts that a wall separates are two walks.
Two walks are joined across a border between mega-cells in one of two ways:

    side by side   steps a1 -> a2 and b2 -> b1 along the border give way to a1 -> b1 and b2 -> a2: no step more
    to and fro     a -> b and b -> a are added: two steps more, the detour of partial mega-cells

Kruskal's algorithm, with the joins that cost nothing first, gives the tree with the shortest walk around it.
"""

from collections.abc import Iterator
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from cosim.errors import LocalProtocolError
from cosim.geometry.grids import EAST, NORTH, SOUTH, WEST, Cell, CoverageGrid
from protocols.pseudonet.plans.tours import Tour, drive_costs, split

Step: TypeAlias = tuple[Cell, Cell]


def spanning_tree(grid: CoverageGrid, cells: npt.ArrayLike, team: int) -> tuple[Tour, ...]:
    """Return *team* tours of nearly equal cost that together hold each of *cells* exactly once.

    The tours are the first visits of the closed walk around the whole reachable floor, so that what is left of it is
    covered in the order of the first plan. Raise LocalProtocolError if a cell is not reachable.
    """
    wanted = set(np.asarray(cells, np.int64).tolist())
    order = [cell for walk in closed_walks(grid) for cell in dict.fromkeys(walk) if cell in wanted]
    if len(order) < len(wanted):
        raise LocalProtocolError(f"cells {sorted(wanted.difference(order))} cannot be reached")
    return split(order, drive_costs(grid, order), team)


def closed_walks(grid: CoverageGrid) -> tuple[Tour, ...]:
    """Return a closed walk over each connected part of the reachable cells.

    Successive cells are one step apart, and so are the last and the first, unless the walk has one cell only.
    """
    walk, joined = _rounds(grid)
    free, costly = _joins(grid, walk)
    for (a1, a2), (b1, b2) in free:
        if _join(joined, a1, b1):
            walk -= {(a1, a2), (b2, b1)}
            walk |= {(a1, b1), (b2, a2)}
    for a, b in costly:
        if _join(joined, a, b):
            walk |= {(a, b), (b, a)}
    return tuple(_circuits(_reachable(grid), walk))


def _reachable(grid: CoverageGrid) -> list[Cell]:
    return np.flatnonzero(grid.reachable).tolist()


def _rounds(grid: CoverageGrid) -> tuple[set[Step], dict[Cell, Cell]]:
    """Return the walks inside the mega-cells, and which cells they connect: a union-find forest of parents."""
    steps, corners, cells = grid.steps.tolist(), _corners(grid), _reachable(grid)
    walk: set[Step] = set()
    joined = {cell: cell for cell in cells}
    for corner in {corners[cell] for cell in cells}:
        ring = (corner, corner + 1, corner + grid.nx + 1, corner + grid.nx)
        ahead = zip(ring, (EAST, NORTH, WEST, SOUTH), ring[1:] + ring[:1], strict=True)
        # on the eastern edge of an odd grid corner + 1 is a cell of the next row
        inner = {(a, b) for a, way, b in ahead if a in joined and corners[a] == corner and steps[a][way] == b}
        walk |= inner if len(inner) == 4 else inner | {(b, a) for a, b in inner}
        for a, b in inner:
            _join(joined, a, b)
    return walk, joined


def _join(joined: dict[Cell, Cell], a: Cell, b: Cell) -> bool:
    """Join the trees of *a* and *b* in a union-find forest; return whether they were two."""
    roots = []
    for cell in (a, b):
        while joined[cell] != cell:
            joined[cell] = cell = joined[joined[cell]]
        roots.append(cell)
    joined[roots[0]] = roots[1]
    return roots[0] != roots[1]


def _corners(grid: CoverageGrid) -> list[Cell]:
    """Return the south-western cell of the mega-cell that holds each cell."""
    iy, ix = np.divmod(np.arange(grid.nx * grid.ny), grid.nx)
    corners: list[Cell] = ((iy - iy % 2) * grid.nx + ix - ix % 2).tolist()
    return corners


def _joins(grid: CoverageGrid, walk: set[Step]) -> tuple[list[tuple[Step, Step]], list[Step]]:
    """Return the joins side by side, ((a1, a2), (b1, b2)), and those to and fro, (a, b), in order of cells.

    A round leads north along a mega-cell's eastern border and west along its northern one; the steps along a border
    belong to one join only, so that no join takes away another's steps.
    """
    steps, corners = grid.steps.tolist(), _corners(grid)
    free: list[tuple[Step, Step]] = []
    costly: list[Step] = []
    for a1 in _reachable(grid):
        for across, along in ((EAST, NORTH), (NORTH, WEST)):
            b1 = steps[a1][across]
            if b1 < 0 or corners[a1] == corners[b1]:
                continue
            costly.append((a1, b1))
            a2, b2 = steps[a1][along], steps[b1][along]
            if (a1, a2) in walk and (b2, b1) in walk and steps[a2][across] == b2:
                free.append(((a1, a2), (b1, b2)))
    return free, costly


def _circuits(cells: list[Cell], walk: set[Step]) -> Iterator[Tour]:
    """Yield one closed walk for each connected set of steps (Hierholzer), from its lowest cell."""
    onward: dict[Cell, list[Cell]] = {cell: [] for cell in cells}
    for a, b in sorted(walk, reverse=True):
        onward[a].append(b)
    visited: set[Cell] = set()
    for cell in cells:
        if cell in visited:
            continue
        path, circuit = [cell], []
        while path:
            if onward[path[-1]]:
                path.append(onward[path[-1]].pop())
            else:
                circuit.append(path.pop())
        visited.update(circuit)
        circuit.reverse()
        yield tuple(circuit[:-1] or circuit)
