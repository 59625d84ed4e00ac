"""What things cost, in multiples of a bare SimPy timeout measured in the same run: ``make bench``.

The unit is one timeout of one process with integer delays. Every figure is the median of seven rounds; in each of them
the unit is measured before and after it, so that a machine that changes its speed changes both. Nothing here asserts
anything: a bound is what the figure was meant to keep, and a median beyond it is marked.
"""

import argparse
import gc
from collections.abc import Callable, Sequence
from statistics import median
from time import process_time
from typing import NamedTuple

import simpy

from benchmarks import aggregation, exploration, learning, low_energy, reflection, shared_air, start, workloads
from benchmarks.peers import arena

ROUNDS = 7
TIMEOUTS = 200_000


class Figure(NamedTuple):
    """A row of the table."""

    name: str
    prepare: Callable[[int], workloads.Work] | None = None
    """Sets up the work of a round from its seed."""
    seconds: Callable[[int], float] | None = None
    """In its place: does the work itself, and returns what one of what is measured takes."""
    bound: float | None = None
    """How many timeouts it was meant to cost at most."""
    bound_s: float | None = None
    """How many seconds it was meant to take at most, for what a user waits for."""
    against: tuple[Callable[[int], workloads.Work], ...] = ()
    """Works whose sum is the unit in place of the timeout."""


def bare_timeouts(seed: int) -> workloads.Work:
    """One process that waits, and waits again."""
    environment = simpy.Environment()

    def clock() -> simpy.events.ProcessGenerator:
        for _ in range(TIMEOUTS):
            yield environment.timeout(312_500)

    environment.process(clock())

    def work() -> float:
        environment.run()
        return TIMEOUTS

    return work


OVER_ADHOC = ("run", "four.yaml", "--set", "channel.kind=adhoc")
UNIT = Figure("bare SimPy timeout (the unit)", bare_timeouts)
IDLE = shared_air.stations(piconet=True, saturated=False, air="apart")
SATURATED = shared_air.stations(piconet=False, saturated=True, air="apart")
FIGURES = (
    UNIT,
    Figure("cosim --help, the whole process", seconds=start.command("--help"), bound_s=0.2),
    Figure("cosim validate four.yaml", seconds=start.command("validate", "four.yaml"), bound_s=1.0),
    Figure("cosim run four.yaml, kernels compiled", seconds=start.command("run", "four.yaml"), bound_s=1.7),
    Figure("first cosim run four.yaml", seconds=start.command("run", "four.yaml", first=True), bound_s=14.0),
    Figure("the same over 802.11", seconds=start.command(*OVER_ADHOC, first=True), bound_s=14.0),
    Figure("robot-tick: 8 robots that drive among the walls of the storey", workloads.robot_ticks),
    Figure(
        "idle hour of a connected piconet whose 8 robots drive, T_poll 40 slots, in all",
        workloads.idle_hours,
        bound=90e3,
    ),
    Figure("the same where signals fade, from a minute of it", workloads.idle_fading_hours, bound=1.2e6),
    Figure("delivered frame of the exchange of 17-byte states, run and machines included", workloads.exchanged_states),
    Figure("idle hour of three LE links, 50 ms, whose 4 robots drive, in all", low_energy.idle_hours, bound=90e3),
    Figure("the same where signals fade, from a minute of it (LE)", low_energy.idle_fading_hours, bound=1.2e6),
    Figure("10 s of scanning for the names of 7 LE advertisers, 100 ms", low_energy.scans, bound=1000),
    Figure("inquiry of 10.24 s with 7 scanners", workloads.inquiries, bound=1200),
    Figure("delivered broadcast: one packet to one of 7 slaves", workloads.broadcasts),
    Figure("delivered Pseudonet message, machines included (8 robots)", workloads.pseudonet_messages, bound=40),
    Figure(
        "minute of that exchange with 802.11 that is silent in one air, against apart",
        shared_air.exchanges("shared"),
        bound=1.1,
        against=(shared_air.exchanges("apart"),),
    ),
    Figure(
        "saturated 802.11 and an idle piconet in one air, against both alone",
        shared_air.stations(piconet=True, saturated=True, air="shared"),
        bound=2.0,
        against=(IDLE, SATURATED),
    ),
    Figure("agent-step of 8 agents over Bluetooth, all silent", learning.agent_steps(0), bound_s=83e-6),
    Figure("the same, each with a message of 16 bytes", learning.agent_steps(16), bound_s=200e-6),
    *(
        Figure(f"robot-step of goal reflection, teams of 1 to 4: {algorithm}", reflection.robot_steps(algorithm))
        for algorithm in ("potential_field", "avoid_past", "visbug")
    ),
    *(
        Figure(f"search with 9 robots, its first 10 minutes at 10 ticks a second: {strategy}", work)
        for strategy in ("srp", "mrp", "mi", "mito", "random")
        for work in (aggregation.searches(strategy, 600),)
    ),
    Figure("search with 9 robots to its end: mi", aggregation.searches("mi")),
    Figure("search with 100 robots in 20 sub-teams, a minute", aggregation.crowds, bound=2.5e6),
    Figure("set-up of a thousand robots in an arena", seconds=arena.set_up, bound_s=0.5),
    Figure("set-up of explorers on 150 m x 150 m, and its truth", seconds=exploration.large_floor, bound_s=3.0),
    Figure("scan of 360 beams marked into the map of an explorer", exploration.marked_scans, bound=40),
    Figure("step of an explorer by motor schemas, beyond marking", seconds=exploration.schema_steps, bound=20),
    Figure("tick of an explorer by motor schemas, marking and planning included", exploration.explorer_steps),
    Figure("fields of frontiers and obstacles at one place", exploration.frontier_fields),
    Figure("A* on the office floor, 402 x 402 cells, between random places", exploration.searches, bound=10_000),
    Figure("the longest of 50 of them", seconds=exploration.hardest_search),
    Figure("minute of 4 explorers on the floor with a corridor, ticks of 100 ms", exploration.minutes),
    Figure("update of Monte Carlo localisation, known start, 8 m laser", exploration.localization_updates),
    Figure("update of SLAM with 10 particles, 2.5 m scanner", exploration.slam_updates),
)


def seconds_each(figure: Figure, seed: int) -> float:
    """Return the seconds of processor time of one of what *figure* measures."""
    if figure.seconds is not None:
        return figure.seconds(seed)
    assert figure.prepare is not None
    work = figure.prepare(seed)
    started = process_time()
    count = work()
    return (process_time() - started) / count


class Measured(NamedTuple):
    """What one of what a figure measures took in a round."""

    seconds: float
    ratio: float
    """In multiples of the bare timeout."""


def measured(figure: Figure, seed: int) -> Measured:
    """Measure a figure between two measurements of its unit."""
    units = [Figure("", work) for work in figure.against] or [FIGURES[0]]
    before = sum(seconds_each(unit, seed) for unit in units)
    seconds = seconds_each(figure, seed)
    after = sum(seconds_each(unit, seed) for unit in units)
    return Measured(seconds, 2.0 * seconds / (before + after))


def chosen(words: Sequence[str]) -> list[Figure]:
    """Return the figures whose names hold any of *words*; all without words."""
    return [figure for figure in FIGURES if not words or any(word in figure.name for word in words)]


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser("python -m benchmarks", description=__doc__)
    parser.add_argument("words", nargs="*", help="measure only figures whose names hold one of these; all by default")
    words = parser.parse_args(arguments).words
    figures = chosen(words)
    if not figures:
        parser.error(f"no figure's name holds {' or '.join(map(repr, words))}")
    for figure in (FIGURES[0], *figures):
        seconds_each(figure, 0)  # compile, and warm up
    gc.collect()
    gc.freeze()  # as the workers of a sweep do
    rounds = [[measured(figure, seed) for figure in figures] for seed in range(1, ROUNDS + 1)]
    print(f"median of {ROUNDS} rounds; x = multiples of the bare timeout, or of what is named after 'against'")
    for column, figure in enumerate(figures):
        each = median(row[column].seconds for row in rounds)
        ratios = [row[column].ratio for row in rounds]
        spread = f"({min(ratios):.2f} to {max(ratios):.2f})"
        line = f"{figure.name:80s} {each * 1e6:13.3f} us {median(ratios):11.2f} x  {spread}"
        print(line + told(figure.bound, median(ratios)) + told(figure.bound_s, each, " s"))


def told(bound: float | None, value: float, unit: str = "") -> str:
    """Return what stands beside a figure of *value* that has a *bound*, both in timeouts or another *unit*."""
    if bound is None:
        return ""
    return f"  at most {bound:g}{unit}" + (" EXCEEDED" if value > bound else "")


if __name__ == "__main__":
    main()
