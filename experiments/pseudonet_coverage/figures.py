"""What Bluetooth costs against the ideal channel, and the answers to the paper's claims that no number decides."""

import pandas as pd
from scipy import stats

PAIRED = ["algorithm", "team_size", "floor", "replicate"]
COSTS = ["time_to_cover_s", "coverage", "steps", "radio_wait_s", "setup_s"]
OVERHEAD = ["messages_help", "messages_answer", "messages_trap", "messages_stop"]


def tables(runs: pd.DataFrame, observations: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Return the paired differences Bluetooth - ideal: both channels of a replicate see the same world."""
    present = [column for column in COSTS if column in runs]
    sides = {name: part.set_index(PAIRED)[present] for name, part in runs.groupby("channel")}
    if not {"ideal", "bluetooth"} <= sides.keys():
        return {}
    differences = (sides["bluetooth"] - sides["ideal"]).dropna(how="all").reset_index()
    rows = []
    for key, part in differences.groupby(PAIRED[:-1], sort=False):
        rows.append(dict(zip(PAIRED, key, strict=False)) | {column: _interval(part[column]) for column in present})
    return {
        "what Bluetooth costs: mean of the paired differences to the ideal channel ± half of the 95 %": pd.DataFrame(
            rows
        )
    }


def _interval(values: "pd.Series[float]") -> str:
    known = values.dropna()
    if len(known) < 2:
        return f"{known.mean():+.4g}" if len(known) else "-"
    half = stats.t.ppf(0.975, len(known) - 1) * known.std(ddof=1) / len(known) ** 0.5
    return f"{known.mean():+.4g} ± {half:.2g}"


def overhead(runs: pd.DataFrame, observations: pd.DataFrame) -> tuple[str, bool | None]:
    """Return the mean number of messages other than state that each algorithm sends in a run."""
    sums = runs.assign(overhead=runs[OVERHEAD].sum(axis=1)).groupby("algorithm", sort=False)["overhead"].mean()
    return ", ".join(f"{algorithm} {value:.4g}" for algorithm, value in sums.items()), None


def exchange_time(runs: pd.DataFrame, observations: pd.DataFrame) -> tuple[str, bool | None]:
    """Return the mean duration of an exchange over Bluetooth by team size."""
    means = runs[runs["channel"] == "bluetooth"].groupby("team_size")["exchange_s"].mean()
    return ", ".join(f"M={size} {value:.4g}" for size, value in means.items()), None
