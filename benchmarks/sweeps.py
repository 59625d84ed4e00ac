"""What sweeps cost beside their runs: ``python -m benchmarks.sweeps``, which ``make bench`` runs too.

Each figure is measured in processes of their own, from the first run that is finished to the last, by the clock:
starting processes is no part of it. The median of three rounds counts, but of memory, which is measured once: 100,000
runs that do nothing take about a minute. Nothing here asserts anything; a figure that misses what it was meant to keep
is marked.
"""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from resource import RUSAGE_SELF, getrusage
from statistics import median
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any, NamedTuple

import click
import yaml

from cosim.experiment import experiment_function, load_experiment
from cosim.sweep import Engine, run_sweep

ROUNDS = 3
BUSY_S = 0.05
BUSY_RUNS = 200
IDLE_RUNS = 4000
FEW, MANY = 1_000, 100_000
DASK = "dask"


@experiment_function
def busy(parameters: dict[str, Any], seed: int) -> dict[str, float]:
    end = perf_counter() + parameters["wait_s"]
    while perf_counter() < end:
        pass
    return {"done": float(seed)}


class Swept(NamedTuple):
    """A sweep, as the process tells that made it."""

    seconds: float
    """From the first run that was finished to the last."""
    peak_bytes: int
    """The most memory that the process held; its workers are others."""


def sweep(runs: int, wait_s: float, jobs: str) -> Swept:
    """Make a sweep in this process, on so many processes or on two workers of Dask."""
    with TemporaryDirectory() as folder:
        plain = {"run": "benchmarks.sweeps:busy", "parameters": {"wait_s": wait_s}, "replicates": runs, "name": "busy"}
        path = Path(folder) / "sweep.yaml"
        path.write_text(yaml.safe_dump(plain), encoding="utf-8")
        experiment, ticks = load_experiment(path), []

        def progress(done: int, total: int, failed: int) -> None:
            if not ticks:
                ticks.append(perf_counter())

        def made(engine: Engine | None) -> None:
            of_ours = None if jobs == DASK else int(jobs)
            run_sweep(experiment, Path(folder) / "results", of_ours, engine, progress)

        if jobs == DASK:
            _on_two_dask_workers(made)
        else:
            made(None)
        peak_bytes = getrusage(RUSAGE_SELF).ru_maxrss * 1024
        return Swept(perf_counter() - ticks[0], peak_bytes)


def _on_two_dask_workers(made: Callable[[Engine], None]) -> None:
    from distributed import LocalCluster

    from cosim.cluster import on_cluster

    with (
        LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
        on_cluster(cluster.scheduler_address) as engine,
    ):
        made(engine)


def swept(*sweeps: tuple[int, float, str]) -> list[Swept]:
    """Make sweeps of (runs, seconds of a run, jobs), each in a process of its own, all at once."""
    command = [sys.executable, "-m", "benchmarks.sweeps", "--sweep"]
    started = [
        subprocess.Popen([*command, json.dumps(each)], stdout=subprocess.PIPE, text=True, cwd=Path(__file__).parents[1])
        for each in sweeps
    ]
    return [Swept(*json.loads(process.communicate()[0])) for process in started]


# ---------------------------------------------------------------- figures


def of_two_processes() -> float:
    """Return how fast two workers are, as a share of two sweeps of one process each."""
    (together,) = swept((2 * BUSY_RUNS, BUSY_S, "2"))
    apart = swept((BUSY_RUNS, BUSY_S, "1"), (BUSY_RUNS, BUSY_S, "1"))
    return max(each.seconds for each in apart) / together.seconds


def overhead_ms(jobs: str) -> Callable[[], float]:
    """Return what measures the milliseconds that a run takes which does nothing."""

    def measure() -> float:
        (found,) = swept((IDLE_RUNS, 0.0, jobs))
        return 1e3 * found.seconds / (IDLE_RUNS - 1)

    return measure


def growth_mb() -> float:
    """Return by how many MB the parent is larger after many runs than after few."""
    few, many = (swept((runs, 0.0, "2"))[0].peak_bytes for runs in (FEW, MANY))
    return (many - few) / 1e6


class Figure(NamedTuple):
    """A row of the table."""

    name: str
    measure: Callable[[], float]
    unit: str
    bound: float
    rounds: int = ROUNDS
    at_least: bool = False

    def text(self) -> str:
        """Measure it, and return its line."""
        found = [self.measure() for _ in range(self.rounds)]
        value = median(found)
        missed = value < self.bound if self.at_least else value > self.bound
        spread = f" ({min(found):.3g} to {max(found):.3g})" if self.rounds > 1 else ""
        bound = f"at {'least' if self.at_least else 'most'} {self.bound:g}{' MISSED' if missed else ''}"
        return f"{self.name:90s} {value:8.3g} {self.unit}{spread}  {bound}"


FIGURES = (
    Figure("runs of 50 ms: two workers, of two sweeps of one process", of_two_processes, "times", 0.93, at_least=True),
    Figure("a run that does nothing, on two processes", overhead_ms("2"), "ms", 0.5),
    Figure("a run that does nothing, on two workers of Dask", overhead_ms(DASK), "ms", 1.0),
    Figure("growth of the parent from 1,000 to 100,000 runs that do nothing (takes a minute)", growth_mb, "MB", 20, 1),
)


@click.command()
@click.argument("words", nargs=-1)
@click.option("--sweep", "asked", hidden=True)
def main(words: tuple[str, ...], asked: str | None) -> None:
    """Print the figures whose names hold one of WORDS; all without any."""
    if asked is not None:
        print(json.dumps(sweep(*json.loads(asked))))
        return
    for figure in FIGURES:
        if not words or any(word in figure.name for word in words):
            print(figure.text(), flush=True)


if __name__ == "__main__":
    main()
