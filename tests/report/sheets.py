"""Experiments of a user's own, made of one function, for the tests of pages."""

from pathlib import Path
from typing import Any

import yaml

from cosim.experiment import load_experiment
from cosim.sweep import run_sweep

HEADER = "id,paper,section,claim,quantity,where,unit,published,test\n"
CLAIMS = (
    'first,003,V,"two rounds, for each of two",rounds,size == 2,rounds,4,within 1 %\n'
    "second,003,V,it takes longer,delay_s,size == 3,s,3.5,in the interval\n"
    "third,Peterson 2006,IEEE,nobody waits,delay_s,size == 9,s,1,within 1 %\n"
    "fourth,003,VI,the one is slower,,,,slower,slower\n"
)
FIGURES = """
def slower(runs, seen):
    means = runs.groupby("size")["delay_s"].mean()
    if not {2, 3} <= set(means.index):
        return "-", None
    return f"{means[3]:g} against {means[2]:g}", bool(means[3] > means[2])
"""
README = """# delays

How *long* does it take? See [the others](../others/README.md), and [them](https://example.org/).

    cosim sweep delays

| a | b |
|---|---|
| 1 | 2 |

## Choices

None that matters.
"""
DELAYS: dict[str, Any] = {
    "about": "how long a function takes that only counts",
    "run": "delays:metrics",
    "parameters": {"size": 1, "broken": 0},
    "sweep": {"size": [2, 3]},
    "replicates": 3,
    "quick": {"replicates": 2},
}


def written(folder: Path, claims: str = CLAIMS, **changes: Any) -> Path:
    """Write an experiment into *folder* and return its sweep.yaml."""
    folder.mkdir(exist_ok=True)
    (folder / "published.csv").write_text(HEADER + claims, encoding="utf-8")
    (folder / "figures.py").write_text(FIGURES, encoding="utf-8")
    (folder / "README.md").write_text(README, encoding="utf-8")
    path = folder / "sweep.yaml"
    path.write_text(yaml.safe_dump(DELAYS | changes, sort_keys=False), encoding="utf-8")
    return path


def swept(source: Path, folder: Path, *sets: str, quick: bool = False, replicates: int | None = None) -> Path:
    """Make the runs of the sweep.yaml *source* into *folder*; return that."""
    run_sweep(load_experiment(source, sets, quick, replicates), folder, jobs=1)
    return folder
