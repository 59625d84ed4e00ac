"""Paper 004's claims that do not depend on how messages travel, as tests; ``deploys_adhoc`` is ``deploys``."""

from functools import partial
from typing import Final

import pandas as pd

from cosim.report.comparison import NO_DATA, Answer, Arm, mostly

IN_TIME: Final = 0.9
"""Share of the runs that must end deployed for a strategy to count as robust."""
NETWORKS: Final = ("ideal", "lossy", "adhoc", "adhoc_near", "bluetooth")
EXECUTIVES: Final = ("central", "distributed")
KILLED: Final = ("none", "robot", "host")


def deploys(network: str, killed: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether with every executive that was run the runs end deployed; killed: *killed*."""
    if not {"deployed", "executive"} <= set(runs):
        return NO_DATA
    made = [each for each in EXECUTIVES if each in set(runs["executive"])]
    arms: list[tuple[str, Arm]] = [(each, {"network": network, "executive": each, "killed": killed}) for each in made]
    return mostly(runs, arms, IN_TIME, "deployed")


# ---------------------------------------------------------------- the tests that published.csv names

globals().update({f"deploys_{n}": partial(deploys, n, "none") for n in NETWORKS})
globals().update({f"deploys_{n}_{k}": partial(deploys, n, k) for n in NETWORKS for k in KILLED[1:]})
