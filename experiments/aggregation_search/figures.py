"""The claims of paper 002, sections III and VII.A, as one-sided tests, and Figure 2: search time by case and strategy.

``fastest_failed`` in published.csv is ``fastest`` for the case ``failed``; the tests by such names are made at the end
of this file. Whatever is compared is compared in one case.
"""

from functools import partial
from pathlib import Path
from typing import Any, Final

import pandas as pd
from matplotlib.figure import Figure

from cosim.arrays import Floats
from cosim.report.comparison import (
    NO_DATA,
    Answer,
    against,
    bootstrap_limits,
    by_replicate,
    confidence_limits,
    less,
    mostly,
    paired,
    spread_of_means,
)
from cosim.report.saving import save
from cosim.statistics.intervals import estimate
from experiments.aggregation.strategies import NEEDED, OURS, SAID, TIME, Strategies

SHEET: Final = Strategies(Path(__file__).parent, "case")
"""The strategies by fault."""
CASES: Final = ("normal", "out_of_range", "failed")
FAULTS: Final = CASES[1:]
STRATEGIES: Final = ("srp", "mrp", "mi", "mito")
WRITTEN_OFF: Final = 1.5
"""Factor of the time if a lost host and its searchers are removed (section VI.A): two thirds do all work."""
IN_TIME: Final = 0.9
"""Share of the searches that must come to an end in time for a strategy to be robust."""
MUCH: Final = 10.0
"""Factor of "usually consumes much more power than communication": an order of magnitude."""
COSTS: Final = {
    "distance_m": "driven, m",
    "distance_after_m": "after the end, m",
    "payload_bytes": "sent, bytes",
    "motion_j": "motion, J",
    "radio_j": "radio, J",
}


def fastest(case: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether MI has a lower mean search time than SRP and than MRP."""
    return SHEET.fastest(case, runs)


def consistent(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether SRP's means over the three cases lie closer together, in minutes, than MRP's and than MI's."""
    return _least(runs, list(CASES), spread_of_means)


def varies_least(case: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether SRP's search time varies less between target configurations than MRP's and than MI's."""
    return _least(runs, [case], _deviation)


def _deviation(samples: Floats) -> Floats:
    found: Floats = samples.std(axis=1, ddof=1)[:, 0]
    return found


def _least(runs: pd.DataFrame, cases: list[str], statistic: Any) -> Answer:
    """Answer whether *statistic* of the searches in *cases* is smaller for SRP than for MRP and than for MI."""
    table = paired(runs, [SHEET.arm(strategy, case) for strategy in OURS for case in cases], TIME)
    if len(table) < 2:
        return NO_DATA if table.empty else ("one replicate", None)
    size = len(cases)
    parts = {strategy: slice(size * rank, size * (rank + 1)) for rank, strategy in enumerate(OURS)}
    own = {strategy: bootstrap_limits(table.iloc[:, part], statistic) for strategy, part in parts.items()}

    def lead(other: str, samples: Floats) -> Floats:
        found: Floats = statistic(samples[..., parts[other]]) - statistic(samples[..., parts["srp"]])
        return found

    leads = [bootstrap_limits(table, partial(lead, other)) for other in ("mrp", "mi")]
    words = "; ".join(f"{SHEET.names[strategy]} {found.text('min')}" for strategy, found in own.items())
    return words, all(each.exceeds(0) for each in leads)


def slower_than_srp(strategy: str, case: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether a strategy has a higher mean search time than SRP."""
    return less(runs, [SHEET.pair("srp", strategy, case)], TIME, unit="min")


def faster_than_srp(strategy: str, case: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether a strategy has a lower mean search time than SRP."""
    return less(runs, [("", SHEET.arm(strategy, case), SHEET.arm("srp", case))], TIME, unit="min")


def rejoins_later(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether the searchers of a failed host take longer to join another team with MRP than with SRP."""
    return less(runs, [SHEET.pair("srp", "mrp", "failed")], "rejoin_time_s", unit="s")


def faster_than_random(strategy: str, case: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether a strategy has a lower mean search time than random search."""
    return less(runs, [("", SHEET.arm(strategy, case), SHEET.arm("random", case))], TIME, unit="min")


def robust(strategy: str, case: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether a fault costs less time than writing the sub-team off would, and searches still come to an end."""
    arm, normal = SHEET.arm(strategy, case), SHEET.arm(strategy, "normal")
    slower, bearable = less(runs, [("", arm, normal)], TIME, WRITTEN_OFF, "min")
    ends, in_time = mostly(runs, [("", arm)], IN_TIME)
    if "-" in (slower, ends):
        return NO_DATA
    holds = None if bearable is None or in_time is None else bearable and in_time
    return f"{slower}; completed {ends}", holds


def says_more(metric: str, case: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether MI has more of *metric* than MRP."""
    return SHEET.has_less("mrp", "mi", metric, case, runs)


def needs_less(metric: str, case: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether MI has less of *metric* than MRP."""
    return SHEET.has_less("mi", "mrp", metric, case, runs)


def spares(metric: str, case: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether MITO has less of *metric* than MI."""
    return SHEET.has_less("mito", "mi", metric, case, runs)


def motion_dominates(strategy: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether motion takes more than ``MUCH`` times the energy of the radios, all well."""
    arm = SHEET.arm(strategy, "normal")
    motion, radio = (by_replicate(runs, arm, metric) for metric in ("motion_j", "radio_j"))
    both = pd.concat([motion, radio], axis=1, join="inner", keys=range(2)).dropna()
    if both.empty:
        return NO_DATA
    return against(both, "J"), confidence_limits(both[0] - MUCH * both[1]).exceeds(0)


# ---------------------------------------------------------------- tables and figures


def tables(runs: pd.DataFrame, observations: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Return Figure 2 as a table, with the share of searches that came to an end, and what each strategy costs."""
    if runs.empty or not {"strategy", "case", "completed", TIME} <= set(runs):
        return {}
    times, costs = [], []
    for key, part in runs.groupby(["strategy", "case"], sort=False):
        strategy, case = map(str, key)
        row = {"strategy": SHEET.names.get(strategy, strategy), "case": case}
        spread = {"variance, min^2": f"{part[TIME].var():.4g}"}
        ends = {"completed, %": f"{100 * part['completed'].mean():.3g}"}
        times.append(row | {"search time, min": str(estimate(part[TIME]))} | spread | ends)
        costs.append(row | {label: str(estimate(part[metric])) for metric, label in COSTS.items() if metric in part})
    made = {"Figure 2: mean ± half of the 95 % confidence interval, variance": pd.DataFrame(times)}
    return made | {"what it costs, all robots: mean ± half of the 95 % confidence interval": pd.DataFrame(costs)}


def draw(runs: pd.DataFrame, observations: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw Figure 2: mean search time and its variance between configurations, by case, a bar a strategy."""
    if runs.empty or not {"strategy", "case", TIME} <= set(runs):
        return []
    figure = Figure(figsize=(11.0, 4.2), layout="constrained")
    means, spreads = figure.subplots(1, 2)
    cases = [case for case in CASES if case in set(runs["case"])]
    SHEET.mean_bars(means, runs, TIME, cases)
    SHEET.bars(spreads, runs.groupby(["case", "strategy"])[TIME].var().unstack().reindex(cases))
    means.set_ylabel("search time, min (mean, 95 % interval)")
    spreads.set_ylabel("variance between configurations, min$^2$")
    handles, labels = means.get_legend_handles_labels()
    figure.legend(handles, labels, fontsize="small", loc="outside right center")
    path = folder / "search_time_by_case.png"
    save(figure, path)
    return [path]


# ---------------------------------------------------------------- the tests that published.csv names

globals().update({f"{t.__name__}_{case}": partial(t, case) for t in (fastest, varies_least) for case in CASES})
globals().update(
    {f"{t.__name__}_mrp_{c}": partial(t, "mrp", c) for t in (slower_than_srp, faster_than_srp) for c in CASES}
)
globals().update({f"faster_than_random_{s}_{c}": partial(faster_than_random, s, c) for s in STRATEGIES for c in CASES})
globals().update({f"robust_{s}_{case}": partial(robust, s, case) for s in STRATEGIES for case in FAULTS})
globals().update({f"says_more_{m}_{c}": partial(says_more, m, c) for m in SAID for c in CASES})
globals().update({f"needs_less_{m}_{c}": partial(needs_less, m, c) for m in NEEDED for c in CASES})
globals().update({f"spares_{m}_{c}": partial(spares, m, c) for m in ("distance_after_m", "energy_j") for c in CASES})
globals().update(
    {f"motion_dominates_{strategy}": partial(motion_dominates, strategy) for strategy in (*STRATEGIES, "random")}
)
