"""The floors of aggregation_scaling: squares of alike rooms, any number of them along a side.

    python -P -m experiments.aggregation_scaling.floors experiments/floors

writes ``rooms_50.yaml``, ``rooms_100.yaml`` and so on, the floors that the sweep uses. Rooms are 25 m x 25 m, with a
door of 2 m in every wall between two of them. Doors stand off the middle of their walls, in another place from wall to
wall, so that no robot sees far through several.
"""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import yaml

ROOM_M: Final = 25.0
DOOR_M: Final = 2.0
SIDES_M: Final = (50, 100, 150, 200)
"""Sides of the sweep's floors."""
OFF_M: Final = (-7.0, 4.0, 8.0, -3.0)
"""Distances of the doors from the middles of their walls, one after the other."""
Wall = list[float]


def walls(count: int) -> list[Wall]:
    """Return the walls between *count* x *count* rooms, x1, y1, x2, y2 in metres, with gaps for the doors."""
    found = []
    for line in range(1, count):
        for room in range(count):
            for upright in (True, False):
                low, high = room * ROOM_M, (room + 1) * ROOM_M
                door = (low + high) / 2.0 + OFF_M[(line + 2 * room + upright) % len(OFF_M)]
                for a, b in ((low, door - DOOR_M / 2.0), (door + DOOR_M / 2.0, high)):
                    at = line * ROOM_M
                    found.append([at, a, at, b] if upright else [a, at, b, at])
    return found


def floor(side_m: float) -> dict[str, Any]:
    """Return the floor of *side_m* x *side_m* metres, a whole even number of rooms, as its ``.yaml`` has it.

    All start in the room that lies north-east of the middle, at whose middle is the place ``start``; the exit is in the
    middle of the last room to the east of that.
    """
    count = round(side_m / ROOM_M)
    if count * ROOM_M != side_m or count % 2:
        raise ValueError(f"{side_m} m is no even number of rooms of {ROOM_M:g} m")
    lows = [(column * ROOM_M, row * ROOM_M) for row in range(count) for column in range(count)]
    half = ROOM_M / 2.0
    start = side_m / 2.0 + half
    return {
        "name": f"rooms_{side_m:g}",
        "bounds_m": [0.0, 0.0, float(side_m), float(side_m)],
        "walls": walls(count),
        "places": {
            "rooms": [[x + half, y + half] for x, y in lows],
            "room_corners": [corner for x, y in lows for corner in ([x, y], [x + ROOM_M, y + ROOM_M])],
            "start": [[start, start]],
            "exit": [[side_m - half, start]],
        },
    }


def text(side_m: float) -> str:
    """Return the file of the floor of *side_m*."""
    head = f"# {side_m:g} m x {side_m:g} m, rooms of 25 m; written by experiments/aggregation_scaling/floors.py\n"
    return head + yaml.safe_dump(floor(side_m), sort_keys=False, default_flow_style=None, width=120)


def main(words: Sequence[str]) -> None:
    """Write all floors of the sweep into the folder that the first word names."""
    for side_m in SIDES_M:
        path = Path(words[0]) / f"rooms_{side_m}.yaml"
        path.write_text(text(side_m), encoding="utf-8")
        print(path)


if __name__ == "__main__":
    main(sys.argv[1:])
