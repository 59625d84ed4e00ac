"""An exploration, and how true its maps are while they grow.

A cell that a wall touches may be held for empty or occupied: from the wall's other side both are true. Any other cell
of a map is wrong if it is held for occupied, or for empty though no robot can see it (the far side of a wall). Who
draws a room twice, or beyond the walls, has wrong cells in both.

Pose errors are those of where a robot marks its map against where it is; the frame of the map is that of the floor, as
robots start from a known place.
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
from pydantic import Field

from cosim.experiment import experiment_function
from cosim.geometry.segments import clearance, segment_grid
from cosim.protocol import Surroundings
from cosim.scenario import Scenario
from cosim.settings import Settings
from cosim.simulation import Simulation
from cosim.trace import Field as Column
from cosim.trace import Trace
from cosim.units import from_seconds, to_seconds
from experiments.exploration.exploring import ENDED, ended
from protocols.exploration.explorer import Explorer
from protocols.exploration.referee import coverable_cells
from protocols.mapping.belief import Frame

FOLDER: Final = Path(__file__).parent
"""The folder from which a scenario's paths count."""
LOOK_S: Final = 1.0
"""Interval between comparisons of poses, s."""
MAP_S: Final = 20.0
"""Interval between comparisons of maps, s."""
TIMES_S: Final = tuple(range(100, 2000, 100))
"""Times at which map errors are recorded, s."""
TOUCHED: Final = 0.75
"""Distance from a cell's centre, in cells, below which a wall touches it: along an edge, or at a corner."""
FARTHEST_M: Final = 5.0
"""Range within which walls are looked for from an occupied cell."""
_TOLD: Final = (
    ("time_50_s", "s", "until half of what can be seen had been; NaN if it never was"),
    ("coverage", "1", "share of the cells that can be seen that were"),
    ("waited_share", "1", "share of the ticks in which robots waited to be localised again"),
    ("way_m", "m", "driven by all robots, as they are told"),
    ("stalls", "1", "times that robots were caught in local minima"),
    ("given_up", "1", "frontier cells that robots gave up"),
    ("blocked_ticks", "1", "ticks in which a wall or a body held a robot up"),
    ("simulated_s", "s", "until all robots had finished, or time was over"),
)
COLUMNS: Final = (
    *(Column(name, "float", unit, meaning) for name, unit, meaning in _TOLD),
    *ENDED,
    Column("waits", "float", "1", "times that a robot began to wait to be localised again"),
    Column("waits_localised", "float", "1", "share of the waits that are over that ended with that; NaN without any"),
    Column("map_error", "float", "1", "share of the cells of the final map that are wrong, mean of the robots"),
    Column("map_error_95", "float", "1", "the same when 95 % had been seen, or at the end if it never was"),
    Column("wall_off_m", "float", "m", "from the occupied cells of the final map to the nearest wall, mean"),
    Column("map_known", "float", "1", "share of the cells that can be seen that are empty on the final map"),
    Column("pose_error_m", "float", "m", "from where a robot takes itself to be to where it is, mean over time"),
    Column("pose_error_rms_m", "float", "m", "root of the mean over time of its square"),
    Column("pose_error_p95_m", "float", "m", "what the pose error is below in 95 % of the time"),
    *(Column(f"map_error_{s}_s", "float", "1", f"map error after {s} s, or at the end") for s in TIMES_S),
    *(Column(f"pose_error_{s}_s", "float", "m", f"mean pose error of the 100 s to {s} s") for s in TIMES_S),
)
Evidence: TypeAlias = np.ndarray[Any, np.dtype[np.int8]]


class Parameters(Settings):
    """An exploration."""

    scenario: Scenario = Field(description="the run")


class Compared(NamedTuple):
    """A map against the truth; shares of the known, and of the coverable cells."""

    wrong: float
    off_m: float
    known: float


class Truth:
    """What is where on a floor, cell by cell of the maps' frame."""

    def __init__(self, frame: Frame, surroundings: Surroundings) -> None:
        cells = np.arange(frame.nx * frame.ny)
        centres = np.stack((cells % frame.nx + 0.5, cells // frame.nx + 0.5), axis=1) * frame.cell_m + frame.origin_m
        self._wall_off_m = clearance(segment_grid(surroundings.walls_m), centres, FARTHEST_M)
        touched = self._wall_off_m <= TOUCHED * frame.cell_m
        seen = coverable_cells(frame, surroundings)
        self._free = seen & ~touched
        self._never_occupied = ~touched
        self._never_empty = ~touched & ~seen

    def compare(self, evidence: Evidence) -> Compared:
        """Return how true a map (ny, nx) is; NaN where it has no cell to ask."""
        flat = evidence.reshape(-1)
        occupied, empty = flat > 0, flat < 0
        wrong = int(np.count_nonzero(occupied & self._never_occupied | empty & self._never_empty))
        known = int(np.count_nonzero(flat))
        off = self._wall_off_m[occupied]
        return Compared(
            wrong / known if known else math.nan,
            float(off.mean()) if len(off) else math.nan,
            np.count_nonzero(empty & self._free) / max(int(np.count_nonzero(self._free)), 1),
        )


class Watch:
    """Looks at the robots of a run, and at their maps, while it goes on."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._truth = Truth(explorers(simulation)[0].setup.frame, _surroundings(simulation))
        self.times_s: list[float] = []
        self.pose_errors_m: list[float] = []
        self.map_times_s: list[float] = []
        self.map_errors: list[float] = []
        simulation.kernel.every(from_seconds(LOOK_S), self._look)
        simulation.kernel.every(from_seconds(MAP_S), self._look_at_maps)

    def compared(self) -> list[Compared]:
        """Return how true each robot's map is now; one that all have is looked at once."""
        maps = {id(each.belief): each.belief for each in explorers(self._simulation)}
        return [self._truth.compare(belief.evidence) for belief in maps.values()]

    def _look(self) -> None:
        self.times_s.append(to_seconds(self._simulation.kernel.now))
        self.pose_errors_m.append(pose_error_m(self._simulation))

    def _look_at_maps(self) -> None:
        self.map_times_s.append(to_seconds(self._simulation.kernel.now))
        self.map_errors.append(float(np.mean([each.wrong for each in self.compared()])))


def pose_error_m(simulation: Simulation) -> float:
    """Return how far robots are from where they take themselves to be, the mean, metres."""
    fleet = simulation.fleet
    places = zip(explorers(simulation), fleet.x_m.tolist(), fleet.y_m.tolist(), strict=True)
    return float(
        np.mean([math.hypot(r.place_m[0] - x, r.place_m[1] - y) for r, x, y in places if r.place_m is not None])
    )


def root_mean_square(values: Sequence[float]) -> float:
    """Return the root of the mean of the squares of *values*."""
    found = np.array(values)
    return math.sqrt(float((found * found).mean()))


def explorers(simulation: Simulation) -> list[Explorer]:
    """Return the machines of the robots."""
    return [machine for machine in simulation.machines if isinstance(machine, Explorer)]


def _surroundings(simulation: Simulation) -> Surroundings:
    """Return what decides which cells can be seen."""
    setup, floor = explorers(simulation)[0].setup, simulation.floorplan
    return Surroundings(
        starts_m=setup.starts_m,
        radius_m=max(setup.radii_m),
        speed_mps=min(setup.speeds_mps),
        acceleration_mps2=math.nan,
        tick=setup.tick,
        walls_m=floor.walls_m,
        bounds_m=floor.bounds_m,
        forbidden=floor.forbidden,
        radii_m=setup.radii_m,
        scan_range_m=setup.range_m,
        beams=setup.beams,
    )


@experiment_function
def measure(parameters: Mapping[str, Any], seed: int) -> dict[str, float]:
    """Make the run and return ``COLUMNS``. Raise UserError for a run that cannot be set up."""
    return made(Parameters.model_validate(parameters).scenario, seed)[0]


def made(given: Scenario, seed: int) -> tuple[dict[str, float], Watch, Trace]:
    """Make the run of a scenario; return ``COLUMNS``, what was watched, and the trace."""
    scenario = given.placed(FOLDER)
    simulation = Simulation(scenario, seed)
    watch = Watch(simulation)
    outcome = simulation.run()
    metrics = outcome.metrics
    never = math.isnan(metrics["time_95_s"])
    final = watch.compared()
    watch.map_times_s.append(metrics["simulated_s"])
    watch.map_errors.append(float(np.mean([each.wrong for each in final])))
    until = math.inf if never else metrics["time_95_s"]
    errors_m = np.array(watch.pose_errors_m)
    found = {
        **{name: metrics[name] for name, *_ in _TOLD},
        **ended(metrics, scenario.duration_s),
        **waits(outcome.trace),
        "map_error": watch.map_errors[-1],
        "map_error_95": at(watch.map_times_s, watch.map_errors, until),
        "wall_off_m": float(np.mean([each.off_m for each in final])),
        "map_known": float(np.mean([each.known for each in final])),
        "pose_error_m": float(errors_m.mean()),
        "pose_error_rms_m": root_mean_square(watch.pose_errors_m),
        "pose_error_p95_m": float(np.quantile(errors_m, 0.95)),
        **{f"map_error_{s}_s": at(watch.map_times_s, watch.map_errors, s) for s in TIMES_S},
        **{f"pose_error_{s}_s": mean_until(watch.times_s, watch.pose_errors_m, s) for s in TIMES_S},
    }
    return found, watch, outcome.trace


def waits(trace: Trace) -> dict[str, float]:
    """Return how often robots waited, and how that ended."""
    events = trace.columns("events")
    rows = list(zip(events["event"], events["why"], strict=True))
    ends = [why == "localised" for event, why in rows if event == "Resumed"]
    return {
        "waits": float(sum(event == "Waiting" for event, _ in rows)),
        "waits_localised": float(np.mean(ends)) if ends else math.nan,
    }


def at(times_s: Sequence[float], values: Sequence[float], time_s: float) -> float:
    """Return the first of *values* that was noted at *time_s* or later; the last if none was."""
    nth = int(np.searchsorted(times_s, time_s))
    return values[min(nth, len(values) - 1)]


def mean_until(times_s: Sequence[float], values: Sequence[float], time_s: float) -> float:
    """Return the mean of *values* from the 100 s until *time_s*; NaN if there are none."""
    first, last = np.searchsorted(times_s, (time_s - TIMES_S[0], time_s), side="right")
    return float(np.mean(values[first:last])) if last > first else math.nan
