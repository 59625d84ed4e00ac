# %% [markdown]
"""
# What does Bluetooth cost a team?

A sweep, read with pandas. This notebook exists twice: `sizes.ipynb`, with what it has printed, and `sizes.py`, which is
the same as a script (jupytext's percent format). Run either in `examples/analysis`.
"""

# %%
import subprocess
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import pandas as pd
from scipy import stats

from cosim.results import RunStore

# %% [markdown]
# ## The runs
#
# Three team sizes, two channels, six replicates: 36 runs, a few seconds. What is there already is not made again.

# %%
RESULTS = Path("results/sizes")
subprocess.run([sys.executable, "-m", "cosim", "sweep", "sizes.yaml", "-o", RESULTS, "--jobs", "1"], check=True)
runs = RunStore(RESULTS).present()  # of the last sweep; pd.read_parquet(RESULTS / "runs") has all that are there
runs[["team_size", "channel", "replicate", "coverage", "time_to_cover_s", "setup_s"]].head()

# %% [markdown]
# Did any run fail, and did all cover the floor?

# %%
print(runs["status"].value_counts().to_string())
print("covered:", bool((runs["coverage"] == 1).all()))

# %% [markdown]
# ## Means, and pairs
#
# All arms of a replicate share its seed, and so the starting positions: the difference within a pair is free of that
# luck.

# %%
runs.groupby(["team_size", "channel"])["time_to_cover_s"].agg(["count", "mean", "std"]).round(1)

# %%
pairs = runs.pivot(index=["team_size", "replicate"], columns="channel", values="time_to_cover_s")
cost_s = (pairs["bluetooth"] - pairs["ideal"]).rename("cost_s")


def interval(values: pd.Series) -> pd.Series:
    """Return the mean and Student's 95 % confidence interval of it."""
    low, high = stats.t.interval(0.95, len(values) - 1, values.mean(), stats.sem(values))
    return pd.Series({"mean_s": values.mean(), "low_s": low, "high_s": high})


costs = cost_s.groupby("team_size").apply(interval).unstack()
print(costs.round(2).to_string())

# %% [markdown]
# ## Where the time goes
#
# Most of it is the set-up: inquiry and paging, before anyone moves. The rest is standing still for messages. The sum is
# a little more than the cost, since not every wait delays the end.

# %%
over_bluetooth = runs[runs["channel"] == "bluetooth"].groupby("team_size")[["setup_s", "radio_wait_s"]].mean()
print(over_bluetooth.assign(sum_s=over_bluetooth.sum(axis=1)).round(2).to_string())

# %%
figure, axes = plt.subplots(figsize=(5, 3), layout="constrained")
over_bluetooth.plot.bar(stacked=True, ax=axes, rot=0)
axes.errorbar(
    range(len(costs)),
    costs["mean_s"],
    yerr=[costs["mean_s"] - costs["low_s"], costs["high_s"] - costs["mean_s"]],
    fmt="ko",
    capsize=4,
    label="cost, 95 % interval",
)
axes.set(xlabel="robots", ylabel="seconds")
axes.legend()
figure.savefig(RESULTS / "cost.png", dpi=100)
