"""One exploration from above: the map as it grows, and the ways of the robots.

    python -P -m experiments.exploration_teams.growing PICTURE.png [--seed N] [--set PATH=VALUE ...]

The run is that of the experiment; ``--set`` chooses as with ``cosim sweep``: ``map=office``, ``robots=8``,
``algorithm=utility``, ``scenario.floorplan.map=my.yaml``, ``scenario.protocol.parameters.escape.enabled=false``.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from cosim.arrays import Bytes, Floats
from cosim.experiment import load_experiment
from cosim.geometry.marking import states
from cosim.report.drawing import tracks
from cosim.report.saving import save
from cosim.scenario import Scenario
from cosim.simulation import Simulation
from cosim.trace import POSES
from cosim.units import S, Time, to_seconds

USUAL: Final = ("map=office", "robots=4", "algorithm=schemas")
"""Choices that are drawn by default."""
SHARES: Final = (0.25, 0.5, 0.75, 0.99)
"""Shares of what can be seen at which the map is drawn; also at the end."""
EVERY: Final[Time] = 5 * S
"""Interval between checks of that share."""
COLOURS: Final = ListedColormap(["0.75", "white", "black"])
"""Colours of unknown, empty and occupied cells."""


class Picture(NamedTuple):
    """The map at one time of a run."""

    time: Time
    coverage: float
    cells: Bytes
    """Shape (ny, nx): unknown, empty or occupied, as :mod:`cosim.geometry.marking` has it."""


class Exploration(NamedTuple):
    """A run as it was watched."""

    pictures: list[Picture]
    ways: dict[int, Floats]
    """For each robot a table (ticks, 3): time in ns, x and y in m."""
    extent_m: tuple[float, float, float, float]
    """Extent of the pictures: left, right, low, high."""
    walls_m: Floats


def main(words: Sequence[str] | None = None) -> None:
    """Draw the run that the words of the command line ask for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("picture", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--set", dest="sets", action="append", default=[], metavar="PATH=VALUE")
    given = parser.parse_args(words)
    draw_growth(watch(chosen(given.sets), given.seed), given.picture)
    print(given.picture)


def chosen(sets: Sequence[str]) -> Scenario:
    """Return the scenario of the experiment's run that *sets* choose; raise UserError for what cannot be chosen."""
    experiment = load_experiment(Path(__file__).parent / "sweep.yaml", [*USUAL, *sets])
    return Scenario.model_validate(experiment.arms[0].parameters["scenario"]).placed(experiment.source.parent)


def watch(scenario: Scenario, seed: int, shares: Sequence[float] = SHARES) -> Exploration:
    """Run *scenario* with *seed* until the last of *shares* has been seen, or to its end.

    If each robot has a map of its own, that of robot 0 is watched.
    """
    simulation = Simulation(scenario, seed, (POSES,))
    referee: Any = simulation.referee
    machine: Any = simulation.machines[0]
    frame = machine.belief.frame
    pictures: list[Picture] = []
    wanted = list(shares)
    kernel = simulation.kernel
    simulation.begin()
    while wanted and kernel.now < scenario.duration:
        until = min(kernel.now + EVERY, scenario.duration)
        kernel.run(until)
        over = kernel.now < until or until == scenario.duration  # the robots have ended the run, or the clock has
        coverage = referee.coverage()
        if coverage >= wanted[0] or over:
            pictures.append(Picture(kernel.now, coverage, states(machine.belief.evidence)))
            wanted = [] if over else [share for share in wanted if share > coverage]
    (left, low), size = frame.origin_m, frame.cell_m
    extent_m = left, left + frame.nx * size, low, low + frame.ny * size
    return Exploration(pictures, tracks(simulation.trace), extent_m, simulation.floorplan.walls_m)


def draw_growth(run: Exploration, path: Path) -> None:
    """Draw the maps of *run*, with the robots' ways until then, into the file *path*."""
    left, right, low, high = run.extent_m
    count = len(run.pictures)
    figure = Figure(figsize=(4.2 * count, 4.2 * (high - low) / (right - left) + 0.9), layout="constrained")
    plots = figure.subplots(1, count, squeeze=False, sharey=True)[0]
    for plot, picture in zip(plots, run.pictures, strict=True):
        plot.imshow(
            picture.cells, cmap=COLOURS, vmin=0, vmax=2, origin="lower", extent=run.extent_m, interpolation="nearest"
        )
        for robot, way in run.ways.items():
            _way(plot, robot, way[way[:, 0] <= picture.time])
        plot.set_title(f"{to_seconds(picture.time):.0f} s: {100 * picture.coverage:.0f} % seen")
        plot.set_xlabel("m")
    plots[0].set_ylabel("m")
    figure.legend(*plots[0].get_legend_handles_labels(), loc="outside lower center", ncols=len(run.ways))
    save(figure, path)


def draw_ways(run: Exploration, path: Path) -> None:
    """Draw the floor of *run* and all that each robot drove into the file *path*."""
    left, right, low, high = run.extent_m
    figure = Figure(figsize=(8.4, 6.6 * (high - low) / (right - left) + 0.6), layout="constrained")
    plot = figure.subplots()
    for x_1, y_1, x_2, y_2 in run.walls_m:
        plot.plot([x_1, x_2], [y_1, y_2], color="0.15", linewidth=1.6)
    for robot, way in run.ways.items():
        _way(plot, robot, way)
    last = run.pictures[-1]
    plot.set(xlabel="m", ylabel="m", aspect="equal")
    plot.set_title(f"ways of {len(run.ways)} robots until {100 * last.coverage:.0f} % had been seen")
    plot.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    save(figure, path)


def _way(plot: Any, robot: int, way: Floats) -> None:
    plot.plot(way[:, 1], way[:, 2], color=f"C{robot}", linewidth=0.9, label=f"robot {robot}")
    plot.plot(*way[0, 1:], marker="s", color=f"C{robot}", markersize=5)
    plot.plot(*way[-1, 1:], marker="o", color=f"C{robot}", markersize=5, markeredgecolor="black")


if __name__ == "__main__":
    main()
