"""What it costs to keep the table ``intervals``: ``python -m benchmarks.keeping``, which ``make bench`` runs too.

Each run is made without the table and with it, by turns, in one process, and its processor time is compared within
each round; the median of the rounds counts. A run with more than one interval a frame may cost more, if one row is
cheap. Nothing here asserts anything; a figure that misses what it was meant to keep is marked.
"""

import gc
from collections.abc import Callable
from statistics import median
from time import process_time
from typing import NamedTuple

import numpy as np

from benchmarks.peers import saturation
from cosim.experiment import scenario_named
from cosim.kernel import Kernel
from cosim.simulation import Simulation
from cosim.trace import INTERVALS, Table, Trace
from cosim.units import from_seconds

ROUNDS = 9
MOST_RATIO = 1.2
MOST_US = 0.3
"""Microseconds of a row, if there is more than one a frame."""


class Done(NamedTuple):
    """What a run took and did."""

    seconds: float
    rows: int
    frames: float


Run = Callable[[tuple[Table, ...]], Done]
"""Makes a run that keeps the given tables."""


def scenario(name: str, *sets: str) -> Run:
    """Return the run of the scenario or experiment *name*, with what *sets* change."""
    given = scenario_named(name, sets)

    def run(tables: tuple[Table, ...]) -> Done:
        simulation = Simulation(given, 1, tables)
        started = process_time()
        outcome = simulation.run()
        seconds = process_time() - started
        frames = sum(value for name, value in outcome.metrics.items() if name in ("frames", "frames_sent"))
        return Done(seconds, outcome.trace.count(INTERVALS.name) if tables else 0, frames)

    return run


def saturated(stations: int, seconds: float) -> Run:
    """Return the run of 802.11 *stations* that always have something to send."""

    def run(tables: tuple[Table, ...]) -> Done:
        kernel, trace = Kernel(), Trace(tables)
        channel, _ = saturation.saturated(kernel, trace, stations, seed=1)
        started = process_time()
        kernel.run(from_seconds(seconds))
        summary = channel.summary()
        taken = process_time() - started
        return Done(taken, trace.count(INTERVALS.name) if tables else 0, summary["frames_sent"])

    return run


OFFICE = "floorplan.map=office"
BLUETOOTH = "channel={kind: bluetooth}"
RUNS = {
    "Pseudonet, 4 robots, 10 minutes": scenario("pseudonet_coverage", OFFICE, "duration_s=600", BLUETOOTH),
    "scatternet, two piconets of 4, 10 minutes": scenario(
        "scatternet_coverage", "duration_s=600", "team.size=8", "protocol.parameters.piconet_size=4"
    ),
    "AODV, 8 robots, 10 minutes": scenario(
        "pseudonet_coverage",
        OFFICE,
        "duration_s=600",
        "team.size=8",
        "channel={kind: adhoc, range_m: 12, routing: {kind: aodv}}",
    ),
    "5 saturated stations, 60 s": saturated(5, 60.0),
    "20 saturated stations, 60 s": saturated(20, 60.0),
}


def main() -> None:
    """Measure and print."""
    print(f"median of {ROUNDS} rounds, each with and without the table, by processor time")
    for name, run in RUNS.items():
        for tables in (), (INTERVALS,):
            run(tables)  # compile, and warm up
        gc.collect()
        gc.freeze()
        rounds = [(run(()), run((INTERVALS,))) for _ in range(ROUNDS)]
        without, kept = (np.array([[done.seconds for done in both] for both in rounds])).T
        rows, frames = rounds[0][1].rows, rounds[0][1].frames
        ratio, row_us = median(kept / without), 1e6 * median(kept - without) / max(rows, 1)
        line = f"{name:44s} {rows:8d} rows {frames:10.0f} frames {ratio:8.2f} x  {row_us:8.2f} us a row"
        bound = f"  at most {MOST_RATIO} x" + (f", or {MOST_US} us a row" if rows > frames else "")
        missed = ratio > MOST_RATIO and not (rows > frames and row_us <= MOST_US)
        print(line + bound + (" EXCEEDED" if missed else ""))


if __name__ == "__main__":
    main()
