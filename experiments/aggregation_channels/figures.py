"""Whether the claims of paper 002, whose messages arrive at once, hold over 802.11 and while it is jammed; and figures.

``fastest_jammed`` in published.csv is ``fastest`` for the network ``jammed``; the tests by such names are made at the
end of this file.
"""

from functools import partial
from pathlib import Path
from typing import Final

import pandas as pd
from matplotlib.figure import Figure

from cosim.report.comparison import Answer, less, mostly
from cosim.report.saving import save
from experiments.aggregation.strategies import NEEDED, OURS, SAID, TIME, Strategies

SHEET: Final = Strategies(Path(__file__).parent, "network")
"""The strategies by network."""
NETWORKS: Final = ("ideal", "adhoc", "jammed")
STRATEGIES: Final = (*OURS, "mito")
SLIGHT: Final = 1.1
"""Factor below which a network that makes searches longer costs next to nothing."""
IN_TIME: Final = 0.75
"""Share of the searches that a strategy must bring to an end to handle jamming."""
METRICS: Final = {
    TIME: "search time, min",
    "distance_m": "driven by all robots, m",
    "payload_bytes": "sent, bytes",
    "energy_j": "motion and radio, J",
}


def fastest(network: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether MI has a lower mean search time than SRP and than MRP."""
    return SHEET.fastest(network, runs)


def survives_adhoc(strategy: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether the messages' time costs little: less than ``SLIGHT`` times what searches take with none."""
    return less(runs, [("", SHEET.arm(strategy, "adhoc"), SHEET.arm(strategy, "ideal"))], TIME, SLIGHT, "min")


def handles_jamming(strategy: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether searches come to an end although the radio is jammed."""
    return mostly(runs, [("", SHEET.arm(strategy, "jammed"))], IN_TIME)


def says_more(metric: str, network: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether MI has more of *metric* than MRP."""
    return SHEET.has_less("mrp", "mi", metric, network, runs)


def needs_less(metric: str, network: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether MI has less of *metric* than MRP."""
    return SHEET.has_less("mi", "mrp", metric, network, runs)


def spares(network: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether MITO drives less after the task's end than MI."""
    return SHEET.has_less("mito", "mi", "distance_after_m", network, runs)


def draw(runs: pd.DataFrame, observations: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw search time and costs by network, a bar a strategy."""
    metrics = [metric for metric in METRICS if metric in runs]
    if runs.empty or not {"strategy", "network"} <= set(runs) or not metrics:
        return []
    figure = Figure(figsize=(4.0 * len(metrics) + 1.5, 4.0), layout="constrained")
    plots = figure.subplots(1, len(metrics), squeeze=False)[0]
    networks = [network for network in NETWORKS if network in set(runs["network"])]
    for plot, metric in zip(plots, metrics, strict=True):
        SHEET.mean_bars(plot, runs, metric, networks)
        plot.set_ylabel(METRICS[metric])
    handles, labels = plots[0].get_legend_handles_labels()
    figure.legend(handles, labels, fontsize="small", loc="outside right center")
    path = folder / "costs_by_network.png"
    save(figure, path)
    return [path]


# ---------------------------------------------------------------- the tests that published.csv names

globals().update({f"{t.__name__}_{network}": partial(t, network) for t in (fastest, spares) for network in NETWORKS})
globals().update({f"{t.__name__}_{s}": partial(t, s) for t in (survives_adhoc, handles_jamming) for s in STRATEGIES})
globals().update({f"says_more_{m}_{n}": partial(says_more, m, n) for m in SAID for n in NETWORKS})
globals().update({f"needs_less_{m}_{n}": partial(needs_less, m, n) for m in NEEDED for n in NETWORKS})
