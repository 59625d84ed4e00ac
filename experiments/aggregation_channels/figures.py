"""Whether the claims of paper 002, whose messages arrive at once, hold over 802.11 and while it is jammed; and figures.

``fastest_jammed`` in published.csv is ``fastest`` for the network ``jammed``; the tests by such names are made at the
end of this file.
"""

from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from cosim.experiment import axis_titles
from cosim.report.comparison import Answer, Arm, less, mostly, per_minute
from cosim.report.estimates import estimates
from cosim.report.saving import save

TIME: Final = "search_time_min"
"""A search that finds no end counts with the cap, as in the paper: a lower bound of what it would have taken."""
NAMES: Final = axis_titles(Path(__file__).parent)["strategy"]
"""Names of the strategies in figures and answers."""
OURS: Final = ("srp", "mrp", "mi")
"""The strategies that the paper compares with each other."""
UNITS: Final = {
    "distance_m": "m",
    "distance_after_m": "m",
    "payload_bytes": "bytes",
    "frames": "frames",
    "energy_j": "J",
}
"""Units of what strategies cost, by the task, in answers."""
BY_MINUTE: Final = ("payload_bytes", "frames", "distance_m", "energy_j")
"""Costs that are also asked by the minute: a strategy whose searches last longer has more of all of them."""
RATES: Final = {f"{metric}_per_min": f"{UNITS[metric]}/min" for metric in BY_MINUTE}
"""Units of costs by the minute."""
SAID: Final = ("payload_bytes", "frames", "payload_bytes_per_min", "frames_per_min")
"""Costs of communication."""
NEEDED: Final = ("distance_m", "energy_j", "distance_m_per_min", "energy_j_per_min")
"""Costs of travel, and of all."""
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


def _arm(strategy: str, network: str) -> Arm:
    return {"strategy": strategy, "network": network}


def fastest(network: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether MI has a lower mean search time than SRP and than MRP."""
    return less(
        runs,
        [(f"{NAMES[other]}:", _arm("mi", network), _arm(other, network)) for other in ("srp", "mrp")],
        TIME,
        unit="min",
    )


def survives_adhoc(strategy: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether the messages' time costs next to nothing: less than ``SLIGHT`` of the time with none."""
    return less(runs, [("", _arm(strategy, "adhoc"), _arm(strategy, "ideal"))], TIME, SLIGHT, "min")


def handles_jamming(strategy: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether searches come to an end although the radio is jammed."""
    return mostly(runs, [("", _arm(strategy, "jammed"))], IN_TIME)


def says_more(metric: str, network: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether MI has more of *metric* than MRP."""
    return _compared("mrp", "mi", metric, network, runs)


def needs_less(metric: str, network: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether MI has less of *metric* than MRP."""
    return _compared("mi", "mrp", metric, network, runs)


def _compared(strategy: str, than: str, metric: str, network: str, runs: pd.DataFrame) -> Answer:
    """Answer whether *strategy* has less of *metric*, by the task or by the minute, than another."""
    pair = f"{NAMES[strategy]} against {NAMES[than]}:", _arm(strategy, network), _arm(than, network)
    return less(per_minute(runs, BY_MINUTE), [pair], metric, unit=(UNITS | RATES)[metric])


def spares(network: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether MITO drives less after the task's end than MI."""
    return less(runs, [("MITO against MI:", _arm("mito", network), _arm("mi", network))], "distance_after_m", unit="m")


def draw(runs: pd.DataFrame, observations: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw search time and costs by network, a bar a strategy."""
    metrics = [metric for metric in METRICS if metric in runs]
    if runs.empty or not {"strategy", "network"} <= set(runs) or not metrics:
        return []
    figure = Figure(figsize=(4.0 * len(metrics) + 1.5, 4.0), layout="constrained")
    plots = figure.subplots(1, len(metrics), squeeze=False)[0]
    names = [name for name in NAMES if name in set(runs["strategy"])]
    networks = [network for network in NETWORKS if network in set(runs["network"])]
    width = 0.8 / len(names)
    for plot, metric in zip(plots, metrics, strict=True):
        for rank, name in enumerate(names):
            part = estimates(runs[runs["strategy"] == name], ["network"], [metric]).set_index("network")
            points = part.reindex(networks)[metric].dropna()
            at = np.array([networks.index(each) for each in points.index]) + width * (rank - (len(names) - 1) / 2)
            halves = np.nan_to_num([value.half for value in points])
            plot.bar(at, [value.mean for value in points], width, yerr=halves, capsize=2, label=NAMES[name])
        plot.set_xticks(range(len(networks)), networks)
        plot.set_ylabel(METRICS[metric])
        plot.grid(alpha=0.3, axis="y")
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
