"""How robots drive by the two kinds of DWA's soft constraints: ``python -m benchmarks.driving``.

Robots drive to goals on the drawn floors with a corridor, from one room to another, and in offices drawn at random
whose corridors are 1.2 to 2.4 m wide. They have real bodies and no radio: the scenes are those of the movers' tests. A
seed gives the same starts and goals to all kinds. Who has not arrived after five minutes has failed. ``--write`` keeps
the table in the handbook.
"""

import argparse
import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from statistics import median
from typing import NamedTuple

import numpy as np

from benchmarks.tables import aligned, written
from benchmarks.workloads import FLOORS
from cosim.world.floorplan import FloorplanSettings, load_floorplan
from protocols.motion.parameters import DrivingParameters
from tests.protocols.deployment.driving_scene import Scene, random_office

SEEDS = 30
LIMIT_S = 300.0
PAGE = Path(__file__).parents[1] / "docs" / "guides" / "tasks.md"
BEGIN = "<!-- written by python -m benchmarks.driving --write -->"
KINDS = {
    "progress": DrivingParameters(),
    "fox": DrivingParameters(kind="fox"),
    "fox, arc_m 3": DrivingParameters(kind="fox", arc_m=3.0),
}
HEAD = ("scene", "kind", "arrived", "time, s", "times that of progress", "least room, m", "its median, m", "touches")


class Drive(NamedTuple):
    """What became of one scene: the time until all had arrived, or infinity, and the least distance from a wall."""

    seconds: float
    arrived: int
    room_m: float
    touches: int


def on_floor(name: str, robots: int) -> Callable[[int, DrivingParameters], Scene]:
    """Return what makes the scene of a seed: *robots* in rooms of a drawn floor, each with another room as its goal."""
    plan = load_floorplan(FloorplanSettings(map=f"{name}.yaml"), FLOORS)
    rooms, walls = plan.places_m["rooms"], [tuple(wall) for wall in plan.walls_m.tolist()]

    def scene(seed: int, parameters: DrivingParameters) -> Scene:
        draw = np.random.default_rng(seed)
        drawn = [rooms[k] for k in draw.permutation(len(rooms))[: 2 * robots]]
        headings = draw.uniform(-math.pi, math.pi, robots).tolist()
        made = Scene(walls, drawn[:robots], parameters=parameters, headings=headings)
        for mover, goal in zip(made.movers, drawn[robots:], strict=True):
            mover.go(goal)
        return made

    return scene


def in_office(seed: int, parameters: DrivingParameters) -> Scene:
    """Return three robots in an office drawn at random."""
    return random_office(seed, 3, parameters=parameters)


SCENES = {
    "corridor, one robot": on_floor("corridor", 1),
    "corridor_middle, one robot": on_floor("corridor_middle", 1),
    "corridor_wide, one robot": on_floor("corridor_wide", 1),
    "corridor, three robots": on_floor("corridor", 3),
    "offices, three robots": in_office,
}


def driven(scene: Scene) -> Drive:
    """Have the robots of a scene drive until all have arrived, or time is up."""
    seconds = scene.run(LIMIT_S, scene.all_there)
    arrived = sum(mover.state == "arrived" for mover in scene.movers)
    done = seconds if arrived == len(scene.movers) else math.inf
    return Drive(done, arrived, scene.least_room_m, len(scene.touched))


def rows(name: str, seeds: Sequence[int]) -> Iterator[Sequence[str]]:
    """Drive a scene by all kinds, and yield a row of the table for each."""
    first: list[Drive] = []
    for kind, parameters in KINDS.items():
        scenes = [SCENES[name](seed, parameters) for seed in seeds]
        drives = [driven(scene) for scene in scenes]
        first = first or drives
        ratios = [a.seconds / b.seconds for a, b in zip(drives, first, strict=True) if max(a, b).seconds < math.inf]
        times = [drive.seconds for drive in drives if drive.seconds < math.inf]
        yield (
            name,
            kind,
            f"{sum(drive.arrived for drive in drives)} of {sum(len(scene.movers) for scene in scenes)}",
            f"{median(times):.1f}" if times else "",
            f"{median(ratios):.3f} ({min(ratios):.2f} to {max(ratios):.2f})" if ratios else "",
            f"{min(drive.room_m for drive in drives):.3f}",
            f"{median(drive.room_m for drive in drives):.3f}",
            f"{sum(drive.touches for drive in drives)}",
        )


def main() -> None:
    """Drive all scenes, print the table, and keep it if that is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("words", nargs="*", help="only scenes whose names have one of these words")
    parser.add_argument("--seeds", type=int, default=SEEDS, help="how many")
    parser.add_argument("--write", action="store_true", help=f"keep the table in {PAGE.name}")
    asked = parser.parse_args()
    named = [name for name in SCENES if not asked.words or any(word in name for word in asked.words)]
    table: list[Sequence[str]] = [HEAD]
    for name in named:
        table += rows(name, range(asked.seeds))
        print(name, "done", flush=True)
    print(*aligned(table), sep="\n")
    if asked.write:
        said = [f"Seeds 0 to {asked.seeds - 1}; times are medians over the seeds in which all robots arrived."]
        PAGE.write_text(written(PAGE.read_text(encoding="utf-8"), BEGIN, said, table), encoding="utf-8")


if __name__ == "__main__":
    main()
