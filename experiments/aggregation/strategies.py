"""The strategies of paper 002 beside each other under a condition: one axis of a sheet, such as its faults."""

from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd

from cosim.experiment import axis_titles
from cosim.report.comparison import Answer, Arm, less, per_minute
from cosim.report.estimates import estimates

TIME: Final = "search_time_min"
"""The column of search times; one without an end counts with the cap, as in the paper: it would have taken longer."""
OURS: Final = ("srp", "mrp", "mi")
"""The strategies that the paper compares with each other."""
BY_MINUTE: Final = ("payload_bytes", "frames", "distance_m", "energy_j")
"""Costs that are also asked by the minute: a strategy whose searches last longer has more of all of them."""
_BY_TASK: Final = {
    "distance_m": "m",
    "distance_after_m": "m",
    "payload_bytes": "bytes",
    "frames": "frames",
    "energy_j": "J",
}
UNITS: Final = _BY_TASK | {f"{metric}_per_min": f"{_BY_TASK[metric]}/min" for metric in BY_MINUTE}
"""Units of what strategies cost, by the task and by the minute, in answers."""
SAID: Final = ("payload_bytes", "frames", "payload_bytes_per_min", "frames_per_min")
"""Costs of communication."""
NEEDED: Final = ("distance_m", "energy_j", "distance_m_per_min", "energy_j_per_min")
"""Costs of travel, and of all."""


class Strategies:
    """The arms of the sheet in *folder*, whose axes are ``strategy`` and *condition*."""

    def __init__(self, folder: Path, condition: str) -> None:
        self.condition = condition
        self.names: dict[str, str] = axis_titles(folder)["strategy"]
        """Names of the strategies in figures and answers."""

    def arm(self, strategy: str, condition: Any) -> Arm:
        """Return the arm of a strategy under one condition."""
        return {"strategy": strategy, self.condition: condition}

    def pair(self, strategy: str, than: str, condition: Any) -> tuple[str, Arm, Arm]:
        """Return two strategies to be compared under one condition, by their names."""
        words = f"{self.names[strategy]} against {self.names[than]}:"
        return words, self.arm(strategy, condition), self.arm(than, condition)

    def fastest(self, condition: Any, runs: pd.DataFrame) -> Answer:
        """Answer whether MI has a lower mean search time than SRP and than MRP."""
        mine = self.arm("mi", condition)
        others = [(f"{self.names[other]}:", mine, self.arm(other, condition)) for other in ("srp", "mrp")]
        return less(runs, others, TIME, unit="min")

    def has_less(self, strategy: str, than: str, metric: str, condition: Any, runs: pd.DataFrame) -> Answer:
        """Answer whether *strategy* has less of *metric*, by the task or by the minute, than another."""
        return less(per_minute(runs, BY_MINUTE), [self.pair(strategy, than, condition)], metric, unit=UNITS[metric])

    def mean_bars(self, plot: Any, runs: pd.DataFrame, metric: str, conditions: list[Any]) -> None:
        """Draw the mean of *metric* with its 95 % interval by condition, a bar a strategy."""
        cells = estimates(runs, ["strategy", self.condition], [metric])
        found = cells.pivot(index=self.condition, columns="strategy", values=metric)
        means = found.map(lambda each: each.mean, na_action="ignore")
        halves = found.map(lambda each: np.nan_to_num(each.half), na_action="ignore")
        self.bars(plot, means.reindex(conditions), halves.reindex(conditions))

    def bars(self, plot: Any, heights: pd.DataFrame, halves: pd.DataFrame | None = None) -> None:
        """Draw *heights*, a row a condition and a column a strategy, a bar a strategy; *halves* are of their errors."""
        names = [name for name in self.names if name in heights]
        width = 0.8 / len(names)
        for rank, name in enumerate(names):
            places = np.arange(len(heights)) + width * (rank - (len(names) - 1) / 2)
            errors = None if halves is None else halves[name].to_numpy(dtype=float)
            drawn = heights[name].to_numpy(dtype=float)
            plot.bar(places, drawn, width, yerr=errors, capsize=2, label=self.names[name])
        plot.set_xticks(range(len(heights)), [str(each).replace("_", " ") for each in heights.index])
        plot.grid(alpha=0.3, axis="y")
