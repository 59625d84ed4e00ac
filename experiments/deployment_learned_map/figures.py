"""Paper 004's claims on deploying by a map just made, as tests; ``deploys_adhoc`` is ``deploys`` for ``adhoc``."""

from functools import partial
from typing import Final

import pandas as pd

from cosim.report.comparison import NO_DATA, Answer, Arm, mostly

IN_TIME: Final = 0.9
"""Share of the runs that must end deployed for a strategy to count as robust."""
NETWORKS: Final = ("ideal", "adhoc")
EXPLORERS: Final = (2, 4)


def _share(metric: str, network: str, runs: pd.DataFrame) -> Answer:
    """Answer whether *metric*, 1 or 0, is 1 with every number of explorers, by the map that they learn."""
    if not {metric, "explorers"} <= set(runs):
        return NO_DATA
    sizes = [size for size in EXPLORERS if size in set(runs["explorers"])]
    arms: list[tuple[str, Arm]] = [
        (f"{size} exploring", {"map": "learned", "network": network, "explorers": size}) for size in sizes
    ]
    return mostly(runs, arms, IN_TIME, metric)


def returns(network: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether robots explore, and come back to base by the map that they have made."""
    back = runs.assign(back=runs["returned_s"].notna().astype(float)) if "returned_s" in runs else runs
    return _share("back", network, back)


def deploys(network: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether the runs end deployed."""
    return _share("deployed", network, runs)


# ---------------------------------------------------------------- the tests that published.csv names

globals().update({f"{t.__name__}_{n}": partial(t, n) for t in (returns, deploys) for n in NETWORKS})
