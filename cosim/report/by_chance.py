"""How many verdicts chance would turn: an experiment's claims, judged anew of replicates that are drawn again.

    cosim sweep aggregation_search
    python -P -m cosim.report.by_chance results/aggregation_search

It reads the results of a sweep.yaml and draws as many replicates as there are, with replacement, again and again: the
bootstrap (Efron and Tibshirani, An Introduction to the Bootstrap, chapter 6). A draw is one of numbers of replicates,
for all arms, for runs and observations alike, as tests pair arms by replicate. One that is drawn twice counts as two.
Every claim of the published.csv beside the sweep is judged of every draw. The share of draws whose verdict is another
than that of the runs as they are tells how much of it is luck. Claims that are not comparable, or have no data, are
left out: no run decides them. With ``--keep`` the shares of a whole sheet go into chance.csv beside the published.csv,
from where ``cosim.report.claims_page`` takes them.

Other sweeps would turn somewhat more or others: the mean of n drawn replicates has a variance that is smaller than that
of n fresh ones by (n - 1) / n, which is 4/5 for five; and draws vary about what these runs found, not about the truth.
"""

import argparse
import sys
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

from cosim.errors import UserError
from cosim.randomness import Streams
from cosim.report.claims import judge, published_claims, source_folder
from cosim.report.figures_module import load_figures
from cosim.report.kept import KeptChance, check_whole, keep_chance
from cosim.results import RunStore, SweepDescription

DRAWS: Final = 200
"""How many draws are judged if nobody asks for another number: a share of a half has a standard error of 3.5 %."""
UNMOVED: Final = ("not comparable", "no data")
"""Verdicts that no run decides."""


class Redrawn:
    """The rows of a table of *sweep*, and what they are when replicates are drawn again."""

    def __init__(self, rows: pd.DataFrame, sweep: SweepDescription) -> None:
        self.rows = rows
        axes = [axis for axis in sweep.axes if axis in rows]
        self._arms = rows.groupby(["configuration", *axes], sort=False, dropna=False).ngroup().to_numpy()
        self._places = rows.groupby("replicate").indices
        self._first_seed = sweep.seed

    def drawn(self, replicates: Iterable[int]) -> pd.DataFrame:
        """Return the rows of *replicates*, which are numbered anew from 0, and with seeds of their own.

        Arms are in the order in which they were, and replicates in that of their new numbers.
        """
        none = np.array([], dtype=int)
        chosen = [self._places.get(number, none) for number in replicates]
        places, numbers = np.concatenate(chosen), np.repeat(np.arange(len(chosen)), [len(each) for each in chosen])
        order = np.lexsort((numbers, self._arms[places]))  # stable: rows of one run stay in their order
        numbers = numbers[order]
        rows = self.rows.iloc[places[order]].reset_index(drop=True)
        return rows.assign(replicate=numbers, seed=self._first_seed + numbers)


@dataclass
class Turned:
    """How often the verdict on a claim is another one."""

    id: str
    verdict: str
    """of the runs as they are"""
    draws: int
    others: Counter[str] = field(default_factory=Counter)
    """In how many draws it is which other one."""

    @property
    def share(self) -> float:
        """The share of draws in which it is another one."""
        return self.others.total() / self.draws

    @property
    def other(self) -> str:
        """The most frequent other one; empty if there is none."""
        return self.others.most_common(1)[0][0] if self.others else ""


def turned(sweep: SweepDescription, runs: pd.DataFrame, seen: pd.DataFrame, draws: int = DRAWS) -> list[Turned]:
    """Return how often the verdicts on the claims about *sweep* turn, by its *runs* and its observations, *seen*.

    Failed runs are left out. Raise UserError if a claim cannot be judged.
    """
    source = source_folder(sweep)
    figures, claims = load_figures(source), published_claims(source)
    good, also = Redrawn(runs[runs["status"] == "done"], sweep), Redrawn(seen, sweep)
    words = [judge(claim, good.rows, also.rows, figures).verdict for claim in claims]
    moving = [
        (claim, Turned(claim.id, word, draws)) for claim, word in zip(claims, words, strict=True) if word not in UNMOVED
    ]
    replicates = np.unique(runs["replicate"])
    rng = Streams(0)("chance", len(replicates))
    for number in range(draws if moving else 0):
        picks = rng.choice(replicates, len(replicates)).tolist()
        drawn = good.drawn(picks), also.drawn(picks)
        for claim, found in moving:
            word = judge(claim, *drawn, figures).verdict
            if word != found.verdict:
                found.others[word] += 1
        _tell(number + 1, draws)
    return [found for _, found in moving]


def _tell(done: int, draws: int) -> None:
    """Say on a terminal how far it is."""
    if sys.stderr.isatty():
        print(f"\r{done} of {draws} draws", end="\n" if done == draws else "", file=sys.stderr, flush=True)


def text(found: Sequence[Turned]) -> str:
    """Return those claims that chance turns as a table, and how many verdicts it turns on average."""
    rows = [(each.id, each.verdict, f"{each.share:.3f}", each.other) for each in found if each.share]
    table = pd.DataFrame(rows, columns=["claim", "verdict", "turned", "most often"]).to_string(index=False)
    expected = sum(each.share for each in found)
    share = f" ({expected / len(found):.1%})" if found else ""
    total = f"chance turns {expected:.1f} of {len(found)} verdicts on average{share}"
    return "\n\n".join([table, total] if rows else [total])


def main(words: Sequence[str] | None = None) -> None:
    """Print, and keep, how often verdicts turn on the results that the words of the command line name."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("results", type=Path)
    parser.add_argument("--keep", action="store_true", help="keep the shares beside the published.csv, in chance.csv")
    parser.add_argument("--draws", type=_count, default=DRAWS, help=f"how many draws to judge, by default {DRAWS}")
    given = parser.parse_args(words)
    folder: Path = given.results
    try:
        store = RunStore(folder)
        sweep, runs = store.description(), store.present()
        source = source_folder(sweep)
        if not published_claims(source):
            raise UserError(f"{folder}: the sweep has no claims: expected one of a sweep.yaml with a published.csv")
        if given.keep:
            check_whole(folder, sweep, len(runs))
        found = turned(sweep, runs, store.present("observations"), given.draws)
        written = [keep_chance(source, map(_kept, found))] if given.keep and source else []
    except UserError as error:
        parser.exit(2, f"{error}\n")
    print(text(found), *written, sep="\n")


def _count(word: str) -> int:
    count = int(word)
    if count < 1:
        raise argparse.ArgumentTypeError(f"{count} is not > 0")
    return count


def _kept(found: Turned) -> KeptChance:
    return KeptChance(found.id, found.verdict, f"{found.share:.4g}", found.other, str(found.draws))


if __name__ == "__main__":
    main()
