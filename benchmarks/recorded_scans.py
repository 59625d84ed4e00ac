"""Grid SLAM on recorded scans, beside a published scan matcher: ``python -m benchmarks.recorded_scans --karto PYTHON``.

One drive of exploration_localization's explorer with true positions is recorded. Each seed draws the errors of odometry
and scans along it anew, and all that is compared estimates from them where the robot is. PYTHON is an interpreter that
has the package karto-scanmatcher 1.0.0; without it Karto is left out. ``--write`` keeps the table in the experiment's
README, which says what is compared.
"""

import argparse
import json
import math
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from statistics import median
from types import SimpleNamespace
from typing import Any, NamedTuple, TypeAlias, cast

import numpy as np

from benchmarks.tables import aligned, written
from benchmarks.workloads import FLOORS
from cosim.arrays import Floats
from cosim.documents import read_yaml
from cosim.geometry.segments import SegmentGrid, packed_walls, segment_grid
from cosim.navigation.localization.motion import Pose, odometry_motion
from cosim.navigation.schemas import beam_directions
from cosim.navigation.slam import MapGrid, Slam, SlamParameters, carried
from cosim.randomness import Draws, Streams
from cosim.robots.motion import Fleet
from cosim.robots.senses import WORLD_FRAME, Senses, SenseSettings
from cosim.scenario import build
from cosim.simulation import Simulation
from cosim.units import S, from_seconds
from cosim.world.floorplan import FloorplanSettings, load_floorplan
from protocols.mapping.belief import frame_of

FIRST_SEED = 900301
SEEDS = 5
LONGEST_S = 300.0
KEY_WAY_M = 0.2
KEY_TURN_RAD = math.radians(10.0)
"""Karto's mapper takes a scan after so much way or turn."""
RANGES_M = (2.5, 8.0)
KARTO = {
    "Karto, package": {},
    "Karto, mapper": {
        "distance_variance_penalty": 0.3**2,
        "angle_variance_penalty": math.radians(20.0) ** 2,
        "minimum_distance_penalty": 0.5,
        "use_response_expansion": False,
    },
}
"""Settings of the matcher other than the package's: the second has those of OpenKarto's own mapper (Mapper.cpp)."""
HEAD = ("scans reach", "compared", "rms, m", "greatest, m", "nearer than odometry")
PEER = Path(__file__).parent / "peers" / "karto_scans.py"
SHEET = FLOORS.parent / "exploration_localization" / "sweep.yaml"
PAGE = SHEET.parent / "README.md"
BEGIN = "<!-- written by python -m benchmarks.recorded_scans --write -->"


Errors: TypeAlias = dict[str, tuple[float, float]]
"""Root mean square and greatest error of the place (m), by what is compared."""


class Recording(NamedTuple):
    """What a robot has sensed on a drive, tick by tick."""

    true: Floats
    """Shape (n, 3): x_m, y_m, heading_rad."""
    told: Floats
    """Shape (n, 3): the same by odometry, which begins at the true pose."""
    ranges_m: Floats
    """Shape (n, beams): along the beams of :func:`cosim.navigation.schemas.beam_directions`, in odometry's frame."""


class Floor(NamedTuple):
    """Walls, and the map that a filter makes of them."""

    walls: SegmentGrid
    grid: MapGrid


def sheet() -> dict[str, Any]:
    """Return the scenario of the experiment."""
    scenario: dict[str, Any] = read_yaml(SHEET)["parameters"]["scenario"]
    return scenario


def floor(shift_m: float = 0.0) -> Floor:
    """Return the experiment's floor, and the grid of its robots' maps, shifted by so much in x and y."""
    plan = load_floorplan(FloorplanSettings(map=sheet()["floorplan"]["map"]), SHEET.parent)
    margin_m = sheet()["protocol"]["parameters"]["positioning"]["margin_m"]
    low_x, low_y, high_x, high_y = plan.bounds_m
    frame = frame_of((low_x - margin_m, low_y - margin_m, high_x + margin_m, high_y + margin_m), 0.1)
    x_m, y_m = frame.origin_m
    grid = MapGrid((frame.ny, frame.nx), (x_m + shift_m, y_m + shift_m), frame.cell_m)
    return Floor(segment_grid(plan.walls_m), grid)


def drive(seed: int, longest_s: float = LONGEST_S) -> Floats:
    """Return the poses (n, 3), tick by tick, of an exploration with true positions."""
    plain = sheet()
    plain["team"]["senses"] |= {"odometry_slip": 0.0, "odometry_turn_rad": 0.0}
    plain["protocol"]["parameters"]["positioning"] = {"kind": "given"}
    simulation = Simulation(build(plain, SHEET.name, SHEET.parent), seed)
    machine: Any = simulation.machines[0]
    observe, poses = machine.observe, []

    def record(observation: Any, now: int) -> None:
        poses.append((observation.x_m, observation.y_m, observation.heading_rad))
        observe(observation, now)

    machine.observe = record
    simulation.begin()
    simulation.kernel.run(from_seconds(longest_s))
    return np.array(poses)


def recorded(true: Floats, walls: SegmentGrid, senses: SenseSettings, seed: int) -> Recording:
    """Return what a robot with *senses* records along the poses *true* (n, 3), ticks of 100 ms apart."""
    reader = Senses(senses, packed_walls(walls), [0.25], [WORLD_FRAME], 1.0, S // 10, Streams(seed))
    observed = np.zeros((1, 6))
    told, ranges_m = np.empty_like(true), np.empty((len(true), senses.beams))
    for tick, pose in enumerate(true):
        observed[0, :3] = pose
        (seen,) = reader.observe(cast(Fleet, SimpleNamespace(observed=observed)))
        told[tick], ranges_m[tick] = (seen.x_m, seen.y_m, seen.heading_rad), seen.ranges_m
    return Recording(true, told, ranges_m)


def by_filter(recording: Recording, grid: MapGrid, parameters: SlamParameters, seed: int) -> Floats:
    """Return where a filter finds the robot (n, 3), tick by tick."""
    beams = beam_directions(recording.ranges_m.shape[1])
    slam = Slam(grid, _pose(recording.true[0]), beams, Draws(seed, "slam"), parameters)
    return np.array(
        [slam.observe(_pose(told), ranges)[:3] for told, ranges in zip(recording.told, recording.ranges_m, strict=True)]
    )


def keys(told: Floats) -> list[int]:
    """Return at which of the ticks of odometry *told* (n, 3) Karto takes a scan."""
    taken = [0]
    for tick in range(1, len(told)):
        before, now = _pose(told[taken[-1]]), _pose(told[tick])
        turn = abs(math.remainder(now[2] - before[2], math.tau))
        if odometry_motion(before, now).way_m >= KEY_WAY_M or turn >= KEY_TURN_RAD:
            taken.append(tick)
    return taken


def by_karto(recording: Recording, range_m: float, settings: Mapping[str, object], python: str) -> Floats:
    """Return where Karto's matcher finds the robot (n, 3), tick by tick.

    Raise CalledProcessError if its program fails.
    """
    taken = keys(recording.told)
    # beams are told in odometry's frame: that is the body whose pose is asked for
    scans = [((*recording.told[k, :2].tolist(), 0.0), recording.ranges_m[k].tolist()) for k in taken]
    given = json.dumps({"range_m": range_m, "settings": settings, "scans": scans})
    said = subprocess.run([python, str(PEER)], input=given, capture_output=True, text=True, check=True).stdout
    return carried_on(recording.told, taken, json.loads(said))


def carried_on(told: Floats, taken: Sequence[int], found: Sequence[Sequence[float]]) -> Floats:
    """Return poses (n, 3) of all ticks of odometry *told* (n, 3): the last one *found*, as odometry carries it on.

    What is found at the ticks *taken* is where odometry's place is on the map, and how its frame is turned.
    """
    poses = np.empty_like(told)
    for (x, y, turned), first, end in zip(found, taken, [*taken[1:], len(told)], strict=True):
        before = _pose(told[first])
        for tick in range(first, end):
            poses[tick] = carried((x, y, turned + before[2]), before, _pose(told[tick]))
    return poses


def errors_m(found: Floats, true: Floats) -> tuple[float, float]:
    """Return the root mean square and the greatest of the distances between places of poses (n, 3)."""
    squares = ((found[:, :2] - true[:, :2]) ** 2).sum(axis=1)
    return math.sqrt(squares.mean()), math.sqrt(squares.max())


def _pose(row: Floats) -> Pose:
    x, y, heading = row.tolist()
    return x, y, heading


# ---------------------------------------------------------------- the table


def compared(true: Floats, here: Floor, range_m: float, seed: int, karto: str | None) -> Errors:
    """Return the errors of all that is compared, by name, with scans that reach *range_m*, of a *seed*."""
    senses = SenseSettings.model_validate(sheet()["team"]["senses"] | {"beam_range_m": range_m})
    recording = recorded(true, here.walls, senses, seed)
    own = sheet()["protocol"]["parameters"]["positioning"]["filter"] | {"range_m": range_m}
    same = {"odometry_slip": senses.odometry_slip, "odometry_turn_rad": senses.odometry_turn_rad}
    alphas = SlamParameters(**own | {"odometry": "alphas"})
    of_senses = SlamParameters(**own | same | {"odometry": "senses"})
    found = {
        "odometry": recording.told,
        "filter, alphas": by_filter(recording, here.grid, alphas, seed),
        "filter, senses": by_filter(recording, here.grid, of_senses, seed),
    }
    if karto is not None:
        found |= {name: by_karto(recording, range_m, settings, karto) for name, settings in KARTO.items()}
    return {name: errors_m(poses, true) for name, poses in found.items()}


def rows(range_m: float, told: Sequence[Errors]) -> Iterator[Sequence[str]]:
    """Yield the rows of the table for the errors *told*, an item a seed."""
    for name in told[0]:
        rms, most = zip(*(each[name] for each in told), strict=True)
        nearer = sum(each[name][0] < each["odometry"][0] for each in told)
        share = "" if name == "odometry" else f"{nearer} of {len(told)}"
        yield f"{range_m:g} m", name, *(spread(each) for each in (rms, most)), share


def spread(values: Sequence[float]) -> str:
    """Return the median of *values*, the least and the greatest."""
    return f"{median(values):.2f} ({min(values):.2f} to {max(values):.2f})"


def main() -> None:
    """Compare, print the table, and keep it if that is asked for."""
    parser = argparse.ArgumentParser("python -m benchmarks.recorded_scans", description=__doc__)
    parser.add_argument("--seeds", type=int, default=SEEDS, help="how many")
    parser.add_argument("--longest", type=float, default=LONGEST_S, help="s, the longest drive")
    parser.add_argument("--shift", type=float, default=0.0, help="m, by which the cells of filters' maps are shifted")
    parser.add_argument("--karto", help="a Python that has karto-scanmatcher")
    parser.add_argument("--write", action="store_true", help=f"keep the table in {PAGE.parent.name}/{PAGE.name}")
    asked = parser.parse_args()
    here, true = floor(asked.shift), drive(FIRST_SEED, asked.longest)
    way_m = float(np.hypot(*np.diff(true[:, :2], axis=0).T).sum())
    seeds = range(FIRST_SEED, FIRST_SEED + asked.seeds)
    said = (
        f"Seeds {seeds[0]} to {seeds[-1]}, {len(true)} ticks, {way_m:.0f} m; medians of the seeds, least and greatest."
    )
    table: list[Sequence[str]] = [HEAD]
    for range_m in RANGES_M:
        told = []
        for seed in seeds:
            told.append(compared(true, here, range_m, seed, asked.karto))
            each = (f"{name} {rms:.3f} {most:.3f}" for name, (rms, most) in told[-1].items())
            print(f"{range_m:g} m", seed, *each, sep="; ", flush=True)
        table += rows(range_m, told)
    print(said, *aligned(table), sep="\n")
    if asked.write:
        PAGE.write_text(written(PAGE.read_text(encoding="utf-8"), BEGIN, [said], table), encoding="utf-8")


if __name__ == "__main__":
    main()
