"""A picture like Figs 6 and 10 of paper 000: one short run from above, with the ghosts that the seeker headed for.

    python -P -m experiments.reflection_tables.trajectories PICTURE.png [--seed N] [--set PATH=VALUE ...]

The settings are those of the experiment, with three targets; ``--set`` changes them as with ``cosim run``.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure

from cosim.experiment import base_scenario
from cosim.report.drawing import tracks
from cosim.scenario import Scenario
from cosim.simulation import Simulation
from cosim.trace import POSES, Trace
from protocols.reflection.events import PromiseTaken
from protocols.reflection.setup import targets

SHORT: Final = ("protocol.parameters.target_count=3", "duration_s=1800")
SEEKER: Final = 0


def main(words: Sequence[str] | None = None) -> None:
    """Draw the run that the words of the command line ask for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("picture", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--set", dest="sets", action="append", default=[], metavar="PATH=VALUE")
    given = parser.parse_args(words)
    scenario = base_scenario(Path(__file__).parent / "sweep.yaml", [*SHORT, *given.sets])
    picture(scenario, given.seed, given.picture)
    print(given.picture)


def picture(scenario: Scenario, seed: int, path: Path) -> None:
    """Run *scenario* with *seed* and draw it into the file *path*."""
    simulation = Simulation(scenario, seed, (POSES,))
    outcome = simulation.run()
    poses = tracks(outcome.trace)
    figure = Figure(figsize=(10.0, 7.2), layout="constrained")
    plot = figure.subplots()
    for x_1, y_1, x_2, y_2 in simulation.floorplan.walls_m:
        plot.plot([x_1, x_2], [y_1, y_2], color="0.15", linewidth=2.0)
    for robot in reversed(poses):
        _way(plot, robot, poses[robot])
    _targets(plot, simulation, seed)
    _ghosts(plot, outcome.trace, poses)
    reached, steps = outcome.metrics["targets_reached"], outcome.metrics["motion_steps"]
    plot.set(xlabel="m", ylabel="m", aspect="equal", title=f"{reached:g} targets reached in {steps:g} motion steps")
    figure.legend(*_once(plot), loc="outside lower center", ncols=4, fontsize="small")
    figure.savefig(path, dpi=120)


def promised(trace: Trace) -> list[tuple[int, int]]:
    """Return (time in ns, helper) of each promise of another robot that the seeker has followed."""
    events = trace.columns("events")
    rows = zip(events["time_ns"], events["source"], events["event"], events["helper"], strict=True)
    return [
        (at, helper)
        for at, robot, event, helper in rows
        if robot == SEEKER and event == PromiseTaken.__name__ and helper != SEEKER
    ]


def _at(way: np.ndarray[Any, np.dtype[np.float64]], time: int) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return where a robot was at *time*, x and y in m."""
    last = int(np.searchsorted(way[:, 0], time, side="right")) - 1
    place: np.ndarray[Any, np.dtype[np.float64]] = way[max(last, 0), 1:]
    return place


def _way(plot: Any, robot: int, way: np.ndarray[Any, np.dtype[np.float64]]) -> None:
    seeks = robot == SEEKER
    name = "R1, the seeker" if seeks else f"R{robot + 1}, patrolling"
    style = {"linewidth": 1.6, "alpha": 1.0} if seeks else {"linewidth": 0.9, "alpha": 0.45}
    plot.plot(way[:, 1], way[:, 2], color=f"C{robot}", label=name, **style)
    plot.plot(*way[0, 1:], marker="s", color=f"C{robot}", markersize=6)


def _targets(plot: Any, simulation: Simulation, seed: int) -> None:
    parameters: Any = simulation.scenario.protocol.parameters
    rooms = parameters.rooms or simulation.floorplan.places_m["rooms"]
    for number, place in enumerate(targets(parameters.model_copy(update={"rooms": rooms}), seed)[SEEKER], start=1):
        plot.plot(*place, "*", color="black", markersize=13, label="targets, in their order")
        plot.annotate(str(number), place, textcoords="offset points", xytext=(8 * number, 6))


def _ghosts(plot: Any, trace: Trace, poses: dict[int, np.ndarray[Any, np.dtype[np.float64]]]) -> None:
    """Draw where a helper was when the seeker turned to its promise, and from where the seeker did."""
    for time, helper in promised(trace):
        ghost, seeker = _at(poses[helper], time), _at(poses[SEEKER], time)
        plot.plot(*zip(seeker, ghost, strict=True), ":", color=f"C{helper}", linewidth=1.0)
        plot.plot(
            *ghost, "o", markersize=10, markerfacecolor="none", color=f"C{helper}", label=f"ghosts of R{helper + 1}"
        )


def _once(plot: Any) -> tuple[list[Any], list[str]]:
    """Return what goes into the legend, every label once."""
    handles = dict(zip(*reversed(plot.get_legend_handles_labels()), strict=True))
    return list(handles.values()), list(handles)


if __name__ == "__main__":
    main()
