"""The floors of the exploration experiments: squares of 40 m x 40 m (paper 001, section 4.1), ours but for the size.

    python -P -m experiments.exploration_teams.floors experiments/floors

writes ``explore_empty.yaml``, ``explore_corridor.yaml``, ``explore_office.yaml``, and ``explore_office_thick.yaml``,
the same office with walls that have a thickness: a beam meets their ends. Doors stand off the middle of
their walls, in another place from room to room, so that no robot sees far through several.
"""

import sys
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml

from cosim.world.offices import thick_walls

SIDE_M: Final = 40.0
WALL_M: Final = 0.1
"""Thickness of walls that have one: a cell of the robots' maps."""
OFF: Final = (-0.3, 0.2, 0.35, -0.15, 0.0)
"""Distances of the doors from the middles of their walls, in lengths of the wall, one after the other."""
ABOUT: Final = {
    "empty": "nothing but the outer walls",
    "corridor": "a corridor of 3 m from end to end, four rooms of 10 m x 18.5 m on each side, doors of 1.2 m",
    "office": "two corridors of 2.5 m, joined by a third, 24 rooms of 6 m to 7 m by 7.5 m to 10 m, doors of 1 m",
    "office_thick": "explore_office with walls of 0.1 m, which stand astride its lines",
}
Wall = list[float]


def _row(edges: Sequence[float], front: float, back: float, door_m: float, first: int) -> list[Wall]:
    """Return the walls of rooms side by side between *edges*: those between them, and, with doors, that at *front*."""
    found = []
    for room, (left, right) in enumerate(pairwise(edges)):
        door = (left + right) / 2 + OFF[(first + room) % len(OFF)] * (right - left)
        found += [[left, front, door - door_m / 2, front], [door + door_m / 2, front, right, front]]
        if 0 < left < SIDE_M:
            found.append([left, front, left, back])
        if right < SIDE_M and room == len(edges) - 2:
            found.append([right, front, right, back])
    return found


def corridor() -> list[Wall]:
    """Return the walls of the floor with one corridor."""
    edges = [0.0, 10.0, 20.0, 30.0, 40.0]
    return _row(edges, 18.5, 0.0, 1.2, 0) + _row(edges, 21.5, SIDE_M, 1.2, 2)


def office() -> list[Wall]:
    """Return the walls of the office: rows of six rooms along two corridors, the inner rows parted by the third."""
    whole = [0.0, 6.0, 13.0, 20.0, 27.0, 34.0, 40.0]
    halves = [0.0, 6.25, 12.5, 18.75], [21.25, 27.5, 33.75, 40.0]
    walls = _row(whole, 7.5, 0.0, 1.0, 0) + _row(whole, 32.5, SIDE_M, 1.0, 3)
    for rank, half in enumerate(halves):
        walls += _row(half, 10.0, 20.0, 1.0, 1 + rank) + _row(half, 30.0, 20.0, 1.0, 4 + rank)
        walls.append([half[0], 20.0, half[-1], 20.0])
    return walls


def floor(name: str) -> dict[str, Any]:
    """Return the floor *name* as its ``.yaml`` has it."""
    extent = {"name": f"explore_{name}", "bounds_m": [0.0, 0.0, SIDE_M, SIDE_M]}
    if name == "office_thick":
        return extent | {"polygons": _rounded(thick_walls(np.array(office()), WALL_M))}
    walls = {"empty": list, "corridor": corridor, "office": office}[name]()
    return extent | {"walls": _rounded(walls)}


def _rounded(rows: Any) -> Any:
    """Return lists of lists of numbers with the numbers in whole millimetres."""
    return [_rounded(row) for row in rows] if isinstance(rows, list | tuple) else round(rows, 3)


def text(name: str) -> str:
    """Return the file of the floor *name*."""
    head = f"# 40 m x 40 m, {ABOUT[name]};\n# written by experiments/exploration_teams/floors.py\n"
    return head + yaml.safe_dump(floor(name), sort_keys=False, default_flow_style=None, width=120)


def main(words: Sequence[str]) -> None:
    """Write all floors into the folder that the first word names."""
    for name in ABOUT:
        path = Path(words[0]) / f"explore_{name}.yaml"
        path.write_text(text(name), encoding="utf-8")
        print(path)


if __name__ == "__main__":
    main(sys.argv[1:])
