"""Whether gains by search are better than those of an informed trial, search by search, and how the searches went."""

from functools import partial
from pathlib import Path
from typing import Final

import pandas as pd
from matplotlib.figure import Figure

from cosim.report.comparison import Answer, Pair, less, less_censored
from cosim.report.saving import save
from experiments.gain_tuning.tuning import EVALUATION, GAINS, SEARCH, TRIAL, TUNED

TIME: Final = "until_95_s"
"""The time until 95 % had been seen; of a run that never came so far the longest, a lower bound."""
SLIGHT: Final = 1.1
"""Factor below which a longer exploration costs little."""
PAIR: Final[Pair] = ("", {"gains": TUNED}, {"gains": TRIAL})


def _evaluated(observations: pd.DataFrame) -> pd.DataFrame:
    """Return what came out in the offices that no search has seen; empty if there is nothing."""
    return observations[observations["stage"] == EVALUATION] if "stage" in observations else observations


def _less(metric: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether the tuned gains have less of *metric* than the trial's."""
    return less(_evaluated(observations), [PAIR], metric)


def no_slower(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether robots with the tuned gains take hardly longer; open where runs that were cut could decide it."""
    return less_censored(_evaluated(observations), [PAIR], TIME, SLIGHT)


better: Final = partial(_less, "cost_s")
touches_less: Final = partial(_less, "blocked_ticks")


def tables(runs: pd.DataFrame, observations: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Return the gains that each search has found, beside those of the trial."""
    if "stage" not in observations:
        return {}
    seen = _evaluated(observations)
    columns = [*GAINS, "cost_s", "until_95_s", "reached", "blocked_ticks"]
    return {"gains": seen.groupby(["gains", "replicate"])[columns].mean().reset_index()}


def draw(runs: pd.DataFrame, observations: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw the least cost so far by candidate: a thin line for each search, and the mean of all."""
    if "stage" not in observations:
        return []
    tried = observations[observations["stage"] == SEARCH]
    figure = Figure(figsize=(6.4, 4.0), layout="constrained")
    plot = figure.subplots()
    least = tried.pivot(index="number", columns="replicate", values="cost_s").sort_index().cummin()
    plot.step(least.index + 1, least, where="post", color="tab:blue", linewidth=0.8, alpha=0.5)
    plot.step(least.index + 1, least.mean(axis="columns"), where="post", color="black", linewidth=2)
    plot.legend(plot.lines[-2:], ["a search", f"mean of {least.shape[1]}"], loc="lower right")
    plot.set(xlabel="candidates tried", ylabel="least cost on the training offices, s")
    plot.set_ylim(bottom=0)
    plot.grid(alpha=0.3)
    path = folder / "search.png"
    save(figure, path)
    return [path]
