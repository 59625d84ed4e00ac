"""How time and memory grow with the number of nodes at equal density: ``python -m benchmarks.growth``.

Robots walk to random points and send a payload a second each, where signals fade (``peers/waypoints.py``, without a
router); the square grows with their number. Each size runs in a process of its own.
"""

import argparse
import json
import math
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from datetime import date
from pathlib import Path
from statistics import median
from typing import NamedTuple

from benchmarks.tables import README, aligned, machine, versions, written

SIZES = (100, 500, 2000, 5000)
UNIT = 500
"""The size with whose time others are compared."""
UNIT_SIDE_M = 1118.0
"""The side of its square."""
SECONDS, NEGLECT_DB = 60.0, 10.0
ROOT = Path(__file__).parents[1]
FIGURE = ROOT / "docs" / "growth.svg"
BEGIN = "<!-- written by python -m benchmarks.growth --write -->"


class Size(NamedTuple):
    """What a number of nodes took."""

    nodes: int
    setup_s: float
    run_s: float
    """Of processor time, as ``setup_s``."""
    memory_mb: float
    """The most that the process held."""


class Row(NamedTuple):
    """A line of the table, as it is read."""

    nodes: str
    setup: str
    run: str
    memory: str
    times: str


COLUMNS = Row("nodes", "set-up, s", "run, s", "peak memory, MB", f"run, times that of {UNIT} nodes")


def side_m(nodes: int) -> float:
    """Return the side of the square on which *nodes* are as dense as UNIT on theirs."""
    return UNIT_SIDE_M * math.sqrt(nodes / UNIT)


def command(nodes: int) -> list[str]:
    """Return the command that simulates *nodes* and tells what that took."""
    load = {"nodes": nodes, "side": side_m(nodes), "seconds": SECONDS, "neglect": NEGLECT_DB}
    return [sys.executable, "-m", "benchmarks.peers.waypoints", *(f"--{name}={value}" for name, value in load.items())]


def measured(nodes: int) -> Size:
    """Simulate *nodes* in a process of its own. Raise CalledProcessError if it fails."""
    ended = subprocess.run(command(nodes), cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True)
    did = json.loads(ended.stdout.splitlines()[-1])
    return Size(nodes, did["setup_s"], did["seconds"], did["memory_mb"])


def medians(rounds: Sequence[Sequence[Size]]) -> list[Size]:
    """Return the medians of all *rounds*, in each of which all sizes have been simulated once."""
    return [
        Size(each[0].nodes, *(median(values) for values in zip(*(one[1:] for one in each), strict=True)))
        for each in zip(*rounds, strict=True)
    ]


def rows(rounds: Sequence[Sequence[Size]]) -> Iterator[Row]:
    """Return the lines of the table."""
    units_s = [each.run_s for sizes in rounds for each in sizes if each.nodes == UNIT]
    for at, each in enumerate(medians(rounds)):
        times = sorted(sizes[at].run_s / unit_s for sizes, unit_s in zip(rounds, units_s, strict=True))
        said = f"{median(times):.3g} ({times[0]:.3g} to {times[-1]:.3g})" if each.nodes != UNIT else "1"
        yield Row(f"{each.nodes}", f"{each.setup_s:.2f}", f"{each.run_s:.2f}", f"{each.memory_mb:.0f}", said)


def conditions(load: float, rounds: int) -> Iterator[str]:
    """Return how the table came about, a sentence each; *load* is what else ran on the machine when it began."""
    yield f"{date.today()}, {SECONDS:g} s each, seed 1, neglect_db {NEGLECT_DB:g}; medians of {rounds} rounds of all."
    yield f"{machine(load)} before the first run."
    yield f"{versions()}."


def draw(sizes: Sequence[Size], path: Path) -> None:
    """Draw time and memory over the number of nodes into the file *path*, beside what is in proportion to it."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 3.6), layout="constrained")
    nodes = [each.nodes for each in sizes]
    unit = next(each for each in sizes if each.nodes == UNIT)
    curves = (
        (f"processor time of {SECONDS:g} s, s", [each.run_s for each in sizes], unit.run_s),
        ("peak memory, MB", [each.memory_mb for each in sizes], unit.memory_mb),
    )
    for plot, (label, values, at_unit) in zip(figure.subplots(1, 2), curves, strict=True):
        plot.plot(nodes, values, marker="o", color="C0", label="measured")
        plot.plot(
            nodes, [at_unit * each / UNIT for each in nodes], "--", color="C1", linewidth=1, label="in proportion"
        )
        plot.set(xscale="log", yscale="log", xlabel="nodes", ylabel=label)
        plot.set_xticks(nodes, [str(each) for each in nodes])
        plot.minorticks_off()
        plot.grid(alpha=0.3)
        plot.legend(fontsize="small")
    with mpl.rc_context({"svg.hashsalt": "growth"}):
        figure.savefig(path, metadata={"Date": None})


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print all sizes."""
    parser = argparse.ArgumentParser("python -m benchmarks.growth", description=__doc__)
    parser.add_argument(
        "--write", action="store_true", help="keep the table in benchmarks/README.md and the figure in docs"
    )
    parser.add_argument("--rounds", type=int, default=7, metavar="N", help="rounds of which medians are printed (7)")
    given = parser.parse_args(arguments)
    load = os.getloadavg()[0]
    rounds = [[measured(nodes) for nodes in SIZES] for _ in range(given.rounds)]
    said, table = [*conditions(load, given.rounds)], [COLUMNS, *rows(rounds)]
    print(*said, *aligned(table), sep="\n")
    if given.write:
        page = README.read_text(encoding="utf-8")
        README.write_text(written(page, BEGIN, said, table), encoding="utf-8")
        draw(medians(rounds), FIGURE)


if __name__ == "__main__":
    main()
