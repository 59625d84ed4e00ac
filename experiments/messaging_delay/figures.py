"""The claims of Fig. 9b that no single number decides; ``-`` answers where a strategy was not run."""

import numpy as np
import pandas as pd

Answer = tuple[str, bool | None]


def _slots(runs: pd.DataFrame, strategy: str, n_bc: int = 1) -> "pd.Series[float]":
    """Return the mean slots by team size; empty if there are no such runs."""
    if not {"strategy", "n_bc", "team_size", "slots"} <= set(runs):
        return pd.Series(dtype=float)
    rows = runs[(runs["strategy"] == strategy) & (runs["n_bc"] == n_bc)]
    return rows.groupby("team_size")["slots"].mean()


def _listed(values: "pd.Series[float]") -> str:
    return ", ".join(f"M={size} {value:g}" for size, value in values.items()) or "-"


def against_ideal(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return the slots of an exchange by broadcast, N_BC = 1."""
    return _listed(_slots(runs, "broadcast")), None


def grows_linearly(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return the delay of one message by unicast: every robot more adds the same, if it grows linearly."""
    slots = _slots(runs, "one_message_unicast")
    steps = np.diff(slots.to_numpy()) / np.diff(slots.index.to_numpy(dtype=float))
    return _listed(slots), bool((steps == steps[0]).all() and steps[0] > 0) if len(steps) > 1 else None


def stays_constant(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return the delay of one message by broadcast."""
    slots = _slots(runs, "one_message_broadcast")
    return _listed(slots), bool(slots.nunique() == 1) if len(slots) > 1 else None


def smallest_team_that_gains(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return by N_BC the smallest team whose full exchange takes fewer slots by broadcast than by either unicast."""
    answers = []
    for n_bc in sorted(runs["n_bc"].unique()) if "n_bc" in runs else ():
        parts = []
        for rival in ("unicast", "unicast_piggyback"):
            both = pd.concat([_slots(runs, "broadcast", n_bc), _slots(runs, rival, n_bc)], axis=1, join="inner")
            gains = both[both.iloc[:, 0] < both.iloc[:, 1]].index
            if len(both):
                parts.append(f"from M={gains[0]} on against {rival}" if len(gains) else f"never against {rival}")
        answers += [f"N_BC {n_bc}: {', '.join(parts)}"] if parts else []
    return "; ".join(answers) or "-", None
