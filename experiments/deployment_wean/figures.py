"""Paper 004, section 7: the claims on its typical scenario, as tests; ``time_adhoc`` is ``time`` for ``adhoc``."""

from functools import partial
from typing import Final

import pandas as pd

from cosim.report.comparison import NO_DATA, Answer, Arm, by_replicate, mostly
from cosim.statistics.intervals import estimate

IN_TIME: Final = 0.9
"""Share of the runs that must end deployed for a strategy to count as robust."""
NETWORKS: Final = ("ideal", "adhoc")
TOO_SOON: Final = "map in 60 s"
"""The call that cannot be carried out in the time that it gives."""
IN_GOOD_TIME: Final = "map in 600 s"
"""The same call with time enough, as its own runs show."""
TIME_S: Final = (180.0, 240.0)
"""Range of the paper's "about 3-4 minutes" for the whole deployment."""
WAY_M: Final = 50.0
"""The paper's "about 50 meters of travel" in the mean of the robots."""
ABOUT: Final = 0.1
"""Share by which a value may be off and still be about the paper's."""


def _arm(network: str, runs: pd.DataFrame, calls: str = "deploy") -> Arm:
    """Return the arm of a network; a sheet without the axis ``calls`` only deploys."""
    arm: Arm = {"network": network}
    return arm | ({"calls": calls} if calls != "deploy" or "calls" in runs else {})


def _interval(network: str, metric: str, runs: pd.DataFrame) -> tuple[float, float, str]:
    """Return the mean of a metric, half its 95 % interval (NaN for a single run), and both as text, "-" without runs.

    A run that never came to its end counts with its length, so the mean is a lower bound then.
    """
    values = by_replicate(runs, _arm(network, runs), metric)
    found = estimate(values)
    return found.mean, found.half, str(found)


def _lies(mean: float, half: float, low: float, high: float) -> bool | None:
    """Return whether an interval lies between two bounds, or outside; None if it does neither, or is none."""
    least, most = mean - half, mean + half
    if low <= least and most <= high:
        return True
    return False if most < low or high < least else None  # NaN is neither


def time(network: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether the mean time lies in the range that the paper gives, with its whole interval."""
    mean, half, words = _interval(network, "until_deployed_s", runs)
    if words == "-":
        return NO_DATA
    return f"{words} s, {mean / 60:.3g} min", _lies(mean, half, *TIME_S)


def way(network: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether the mean way of a robot lies about the 50 m, with its whole interval."""
    mean, half, words = _interval(network, "way_m", runs)
    if words == "-":
        return NO_DATA
    return f"{words} m", _lies(mean, half, (1 - ABOUT) * WAY_M, (1 + ABOUT) * WAY_M)


def deploys(network: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether the runs end deployed."""
    return mostly(runs, [("", _arm(network, runs))], IN_TIME, "deployed")


def four_to_b(network: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether all four robots move in the first stage of every run."""
    counts = by_replicate(runs, _arm(network, runs), "moving_1").dropna()
    return (f"4 in {int((counts == 4).sum())} of {len(counts)}", bool((counts == 4).all())) if len(counts) else NO_DATA


def ahead(network: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether the first leap-frogging robot has left the intersection before the group pair in every run."""
    leads_s = by_replicate(runs, _arm(network, runs), "leap_ahead_s").dropna()
    return (f"by {leads_s.min():.3g} s at least", bool((leads_s > 0).all())) if len(leads_s) else NO_DATA


def returns(network: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether the team has deployed, and then returned: both plays done, and at the end all hold their places.

    The places that count in the end are those of the last play, about base.
    """
    if not {"plans_done", "deployed"} <= set(runs):
        return NO_DATA
    both = runs.assign(returned=((runs["plans_done"] == 2) & (runs["deployed"] == 1)).astype(float))
    return mostly(both, [("", _arm(network, both, "return"))], IN_TIME, "returned")


def refuses(network: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether in every run the call is refused that gives too little time, and is not with time enough."""
    found = [by_replicate(runs, _arm(network, runs, calls), "refused") for calls in (TOO_SOON, IN_GOOD_TIME)]
    if any(each.empty for each in found):
        return NO_DATA
    words = ("60 s:", "600 s:")
    told = "; ".join(
        f"{word} {int((each == 1).sum())} of {len(each)} refused" for word, each in zip(words, found, strict=True)
    )
    return told, bool((found[0] == 1).all() and (found[1] == 0).all())


# ---------------------------------------------------------------- the tests that published.csv names

TESTS: Final = (time, way, deploys, four_to_b, ahead, returns, refuses)
globals().update({f"{t.__name__}_{n}": partial(t, n) for t in TESTS for n in NETWORKS})
