"""How a grid filter goes astray: the runs of a sweep whose pose error is large are made again, watched and classified.

    python -P -m experiments.exploration_localization.astray results/exploration_localization_alternatives [--jobs N]

What is classified is the rise of the error: from where it was last at most ``FROM_M`` to where it is more than
``ASTRAY_M`` first. README tells the kinds, which were found by hand in nine runs of a trial; the bounds were set by
those, of which eight come out as they did by hand. astray.csv, a row a run, goes into the folder of the results.
"""

import argparse
import math
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import pandas as pd

from cosim.errors import UserError
from cosim.experiment import Arm
from cosim.results import RunStore
from cosim.robots.table import HEADING
from cosim.scenario import Scenario
from cosim.simulation import Simulation
from cosim.sweep import arm_of
from cosim.units import from_seconds
from experiments.exploration_localization.mapping import (
    FOLDER,
    LOOK_S,
    Parameters,
    explorers,
    pose_error_m,
    root_mean_square,
)

ASTRAY_M: Final = 0.3
"""Pose error above which a robot has gone astray: the mean square's root over a run, and at the end of the rise."""
FROM_M: Final = 0.15
"""Pose error at the beginning of the rise."""
KNOWN_CELLS: Final = 10
"""Cells that become known in a second, fewer than which the robot is on known ground."""
TURNED_RAD: Final = 0.025
"""Mean error of the heading, during a rise on new ground, above which the heading is what was lost."""
TURNED, CREPT, DRIFTED = "heading lost", "walls creep", "drift"


class Rise(NamedTuple):
    """How the error of a run rose, second by second: numbers over the rise."""

    from_s: float
    until_s: float
    turned_rad: float
    """Mean of the heading's absolute error."""
    on_known: float
    """Share of the error's growth on known ground."""

    @property
    def kind(self) -> str:
        """What kind of rise it is."""
        if self.on_known > 0.5:
            return CREPT
        return TURNED if self.turned_rad > TURNED_RAD else DRIFTED


class Looks(NamedTuple):
    """What was seen of a robot once a second."""

    errors_m: list[float]
    headings_rad: list[float]
    """Errors of the heading."""
    known: list[int]
    """How many cells of its map are known."""


def rise(looks: Looks) -> Rise:
    """Return how the error rose, which comes above ``ASTRAY_M``."""
    errors = np.array(looks.errors_m)
    last = int(np.flatnonzero(errors > ASTRAY_M)[0])
    low = np.flatnonzero(errors[:last] <= FROM_M)
    first = int(low[-1]) if len(low) else 0
    growth = np.clip(np.diff(errors[first : last + 1]), 0.0, None)
    known = np.diff(looks.known[first : last + 1]) < KNOWN_CELLS
    turned = np.abs(looks.headings_rad[first : last + 1])
    return Rise(first * LOOK_S, last * LOOK_S, float(turned.mean()), float(growth[known].sum() / growth.sum()))


def watched(scenario: Scenario, seed: int) -> Looks:
    """Make the run of one robot, and return what was seen of it."""
    simulation = Simulation(scenario.placed(FOLDER), seed)
    (robot,) = explorers(simulation)
    looks = Looks([], [], [])

    def look() -> None:
        found, heading_rad = robot.positioning.estimate, float(simulation.fleet.observed[0, HEADING])
        looks.errors_m.append(pose_error_m(simulation))
        looks.headings_rad.append(0.0 if found is None else math.remainder(found.heading_rad - heading_rad, math.tau))
        looks.known.append(int(np.count_nonzero(robot.belief.evidence)))

    simulation.kernel.every(from_seconds(LOOK_S), look)
    simulation.run()
    return looks


def _again(arm: Arm, seed: int, rms_m: float) -> Rise:
    looks = watched(Parameters.model_validate(arm.parameters).scenario, seed)
    if root_mean_square(looks.errors_m) != rms_m:
        raise UserError(f"seed {seed} of {arm.labels}: errs otherwise than it did: the code was changed since")
    return rise(looks)


def classified(folder: Path, jobs: int) -> pd.DataFrame:
    """Return a row for each run in *folder* that went astray: its arm, its seed, how its error rose, and the kind.

    Raise UserError if a run that is made again is another one.
    """
    store = RunStore(folder)
    sweep, runs = store.description(), store.present()
    astray = runs[(runs["status"] == "done") & (runs["pose_error_rms_m"] > ASTRAY_M)]
    astray = astray.sort_values([*sweep.axes, "seed"]).reset_index(drop=True)
    arms = {each: arm_of(sweep, each) for each in astray["configuration"].unique()}
    asked = [astray["configuration"].map(arms), astray["seed"], astray["pose_error_rms_m"]]
    with ProcessPoolExecutor(jobs) as pool:
        found = list(pool.map(_again, *(each.tolist() for each in asked)))
    told = pd.DataFrame([each._asdict() | {"kind": each.kind} for each in found])
    return astray[[*sweep.axes, "seed", "pose_error_rms_m"]].join(told)


def main(words: Sequence[str] | None = None) -> None:
    """Print and write what kinds the runs are of that the words of the command line name."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("results", type=Path)
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    given = parser.parse_args(words)
    try:
        found = classified(given.results, given.jobs)
    except UserError as error:
        parser.exit(2, f"{error}\n")
    path = given.results / "astray.csv"
    found.to_csv(path, index=False)
    print(found.to_string(index=False))
    axes = list(found.columns[: found.columns.get_loc("seed")])
    print(f"\n{found.groupby([*axes, 'kind']).size().to_string()}\n\n{path}")


if __name__ == "__main__":
    main()
