"""Boustrophedon coverage: sweep cells without obstacles inside, each mown column by column, up and down in turn.

The decomposition is Choset's ("Coverage of known spaces: the boustrophedon cellular decomposition", Autonomous
Robots 9, 2000), on a grid: a column of cells is a slice; its maximal runs of cells that can be driven through are the
slice's segments. From one slice to the next a sweep cell goes on as long as its segment meets exactly one segment, and
that one only it. Where the connectivity changes (a segment splits, or two merge, at an obstacle, or a segment begins or
ends) sweep cells end and new ones begin. The adjacency graph of the sweep cells is walked depth first.
"""

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import numpy.typing as npt

from cosim.geometry.grids import NORTH, WEST, Cell, CoverageGrid
from protocols.pseudonet.plans.tours import Tour, drive_costs, nearest, split

if TYPE_CHECKING:
    import networkx as nx

Segment: TypeAlias = list[Cell]
"""Cells of one column, from south to north, each a step from the last."""
SweepCell: TypeAlias = list[Segment]
"""One segment of each of several successive columns, from west to east."""


def boustrophedon(grid: CoverageGrid, cells: npt.ArrayLike, team: int) -> tuple[Tour, ...]:
    """Return *team* tours of nearly equal cost that together hold each of *cells* exactly once.

    Sweep cells are made of *cells* only; the drives between them lead over the whole grid. Parts that no drive connects
    come into different tours if the team is large enough.
    """
    order = list(_mow(grid, *sweep_cells(grid, cells)))
    return split(order, drive_costs(grid, order), team)


def sweep_cells(grid: CoverageGrid, cells: npt.ArrayLike) -> tuple[list[SweepCell], "nx.Graph[int]"]:
    """Return the sweep cells of *cells*, numbered from west to east and south to north, and their adjacency graph."""
    import networkx as nx  # it takes longer to load than other algorithms take to plan

    segments = list(_segments(grid, set(np.asarray(cells, np.int64).tolist())))
    links = _links(grid, segments)
    degree_west = [0] * len(segments)
    degree_east = [0] * len(segments)
    west_of: dict[int, int] = {}
    for west, east in links:
        degree_east[west] += 1
        degree_west[east] += 1
        west_of[east] = west
    sweeps: list[SweepCell] = []
    home: list[int] = []
    for number, segment in enumerate(segments):
        if degree_west[number] == 1 and degree_east[west_of[number]] == 1:
            home.append(home[west_of[number]])
            sweeps[home[number]].append(segment)
        else:
            home.append(len(sweeps))
            sweeps.append([segment])
    graph: nx.Graph[int] = nx.Graph()
    graph.add_nodes_from(range(len(sweeps)))
    graph.add_edges_from((home[west], home[east]) for west, east in links if home[west] != home[east])
    return sweeps, graph


def _segments(grid: CoverageGrid, wanted: set[Cell]) -> Iterator[Segment]:
    north = grid.steps[:, NORTH].tolist()
    segment: Segment = []
    for cell in sorted(wanted, key=lambda cell: (cell % grid.nx, cell)):
        if segment and north[segment[-1]] != cell:
            yield segment
            segment = []
        segment.append(cell)
    if segment:
        yield segment


def _links(grid: CoverageGrid, segments: list[Segment]) -> list[tuple[int, int]]:
    """Return the pairs (western segment, eastern segment) between which there is a step, in order."""
    of = {cell: number for number, segment in enumerate(segments) for cell in segment}
    west = grid.steps[:, WEST].tolist()
    return sorted({(of[west[cell]], number) for cell, number in of.items() if west[cell] in of})


def _mow(grid: CoverageGrid, sweeps: list[SweepCell], graph: "nx.Graph[int]") -> Iterator[Cell]:
    """Yield all cells, sweep cell by sweep cell, depth first; the nearest corner of a neighbour is entered first."""
    corner_of = {cell: number for number, sweep in enumerate(sweeps) for cell in _corners(sweep)}
    left = dict.fromkeys(range(len(sweeps)))
    branch: list[int] = []
    here: Cell | None = None
    while left:
        while branch and left.keys().isdisjoint(graph[branch[-1]]):
            branch.pop()
        ahead = [number for number in graph[branch[-1]] if number in left] if branch else [next(iter(left))]
        corners = [cell for number in ahead for cell in _corners(sweeps[number])]
        entry = None if here is None else nearest(grid, here, corners)
        entry = corners[0] if entry is None else entry
        branch.append(corner_of[entry])
        del left[branch[-1]]
        for cell in _sweep(sweeps[branch[-1]], entry):
            yield cell
            here = cell


def _corners(columns: SweepCell) -> tuple[Cell, Cell, Cell, Cell]:
    return columns[0][0], columns[0][-1], columns[-1][0], columns[-1][-1]


def _sweep(columns: SweepCell, entry: Cell) -> Iterator[Cell]:
    """Yield the cells of *columns* up and down in turn, from *entry*, an end of the first or of the last column."""
    if entry not in (columns[0][0], columns[0][-1]):
        columns = columns[::-1]
    upward = entry == columns[0][0]
    for column in columns:
        ordered: Iterable[Cell] = column if upward else reversed(column)
        yield from ordered
        upward = not upward
