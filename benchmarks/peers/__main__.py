"""What we need of the processor time that other simulators need for the same work: ``make bench-peers``.

In every round each pair's two programs run one after the other with the seed of the round. A ratio is our time by
theirs in one round; the median of all rounds counts, and stands beside what it was meant to be at most. README.md in
the folder above tells what the pairs are and what is timed.
"""

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from datetime import date
from functools import partial
from pathlib import Path
from resource import RUSAGE_CHILDREN, getrusage
from statistics import median
from typing import NamedTuple

from benchmarks.__main__ import told
from benchmarks.peers.installation import Peer, command, install
from benchmarks.peers.pairs import PAIRS, Pair, Program
from benchmarks.tables import README, aligned, machine, versions, written

ROUNDS = 7
ROOT = Path(__file__).parents[2]
BEGIN = "<!-- written by python -m benchmarks.peers --write -->"


class Measured(NamedTuple):
    """What a program took in a round."""

    seconds: float
    """Of processor time, the system's included."""
    did: Mapping[str, float]
    """What it tells of its work, by name."""


class ProgramError(Exception):
    """A program has failed; the message is what it said."""


def measured(program: Program, seed: int) -> Measured:
    """Run *program*; its time is that of its process, unless it says itself what its run took. Raise ProgramError."""
    before = getrusage(RUSAGE_CHILDREN)
    ended = subprocess.run(command(program, seed), cwd=ROOT, capture_output=True, text=True)
    after = getrusage(RUSAGE_CHILDREN)
    if ended.returncode:
        raise ProgramError(ended.stderr.strip() or f"exit {ended.returncode}")
    did = json.loads(ended.stdout.splitlines()[-1])
    process = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Measured(did.pop("seconds", process), did)


Round = Mapping[Program, Measured]


def round_of(pairs: Sequence[Pair], missing: dict[Program, str], measure: Callable[[Program], Measured]) -> Round:
    """Measure the programs of *pairs* that are not *missing*, each once, also those that belong to several pairs.

    What fails is missing from then on.
    """
    results: dict[Program, Measured] = {}
    for pair in pairs:
        for program in (pair.ours, pair.theirs):
            if program is None or program in results or program in missing:
                continue
            try:
                results[program] = measure(program)
            except ProgramError as wrong:
                print(f"{program.name} failed: {wrong}", file=sys.stderr)
                missing[program] = f"{program.name} failed"
    return results


class Row(NamedTuple):
    """A line of the table, as it is read."""

    name: str
    ours: str
    theirs: str
    ratio: str
    bound: str
    work: str


COLUMNS = Row("work", "ours", "theirs", "ratio (least to greatest)", "bound", "done, ours : theirs")


def row(pair: Pair, rounds: Sequence[Round], missing: Mapping[Program, str]) -> Row:
    """Return the line of *pair*: medians of all rounds, or why a program is *missing*."""
    ours = [each[pair.ours] for each in rounds if pair.ours in each]
    theirs = [each[pair.theirs] for each in rounds if pair.theirs in each]
    ratios = [
        each[pair.ours].seconds / each[pair.theirs].seconds
        for each in rounds
        if pair.ours in each and pair.theirs in each
    ]
    bound = told(pair.bound, median(ratios)) if ratios else ""
    if pair.bound_s is not None and ours:
        bound = told(pair.bound_s, _seconds(ours), " s")
    their_seconds = pair.note
    if pair.theirs is not None:
        their_seconds = missing.get(pair.theirs) or f"{pair.theirs.simulator} {_seconds(theirs):.3g} s"
    done = [f"{median(each.did[pair.did] for each in some):.3g}" for some in (ours, theirs) if some]
    return Row(
        pair.name,
        missing.get(pair.ours) or f"{_seconds(ours):.3g} s",
        their_seconds,
        f"{median(ratios):.3g} ({min(ratios):.3g} to {max(ratios):.3g})" if ratios else "",
        bound.strip(),
        f"{' : '.join(done)} {pair.did.replace('_', ' ')}",
    )


def _seconds(some: Sequence[Measured]) -> float:
    return median(each.seconds for each in some)


def conditions(rounds: int, peers: Mapping[str, Peer], load: float) -> Iterator[str]:
    """Return how the table came about, a sentence each; *load* is what else ran on the machine when it began."""
    yield f"{date.today()}, median of {rounds} rounds, seeds 1 to {rounds}."
    yield f"{machine(load)} before the first round."
    theirs = "".join(f", {name} {peer.version}" for name, peer in peers.items() if not peer.missing)
    yield f"{versions()}{theirs}."
    yield from (f"{name} is not here: {peer.missing}." for name, peer in peers.items() if peer.missing)


def compare(pairs: Sequence[Pair], rounds: int, write: bool) -> bool:
    """Measure *pairs*, print them, and return whether all that is here has worked."""
    load, peers = os.getloadavg()[0], install()
    others = [pair.theirs for pair in pairs if pair.theirs is not None]
    missing = {each: f"{each.simulator} is not here" for each in others if peers[each.simulator].missing}
    absent = len(missing)

    def measure(program: Program, seed: int) -> Measured:
        result = measured(program, seed)
        words = " ".join((program.name, *program.options))
        print(f"round {seed} of {rounds}: {result.seconds:8.3f} s  {words}", file=sys.stderr)
        return result

    results = [round_of(pairs, missing, partial(measure, seed=seed)) for seed in range(1, rounds + 1)]
    said, rows = [*conditions(rounds, peers, load)], [row(pair, results, missing) for pair in pairs]
    print(*said, sep="\n")
    print(*aligned([COLUMNS, *rows]), sep="\n")
    if write:
        page = README.read_text(encoding="utf-8")
        README.write_text(written(page, BEGIN, said, [COLUMNS, *rows]), encoding="utf-8")
    return len(missing) == absent


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print; return 1 if a program that is here has failed."""
    parser = argparse.ArgumentParser("python -m benchmarks.peers", description=__doc__)
    parser.add_argument("words", nargs="*", help="measure only pairs whose names hold one of these; all by default")
    parser.add_argument("--rounds", type=int, default=ROUNDS, help=f"how often, {ROUNDS} by default")
    parser.add_argument("--write", action="store_true", help="put the table of all pairs into benchmarks/README.md too")
    given = parser.parse_args(arguments)
    pairs = [pair for pair in PAIRS if not given.words or any(word in pair.name for word in given.words)]
    if not pairs:
        parser.error(f"no pair's name holds {' or '.join(map(repr, given.words))}")
    if given.words and given.write:
        parser.error("--write writes all pairs: give no words with it")
    if given.rounds < 1:
        parser.error(f"--rounds {given.rounds}: at least one is wanted")
    return int(not compare(pairs, given.rounds, given.write))


if __name__ == "__main__":
    sys.exit(main())
