"""The claims of Fig. 9b that no single number decides."""

import numpy as np
import pandas as pd

Answer = tuple[str, bool | None]


def _slots(runs: pd.DataFrame, strategy: str, n_bc: int = 1) -> "pd.Series[float]":
    rows = runs[(runs["strategy"] == strategy) & (runs["n_bc"] == n_bc)]
    return rows.groupby("team_size")["slots"].mean()


def _listed(values: "pd.Series[float]") -> str:
    return ", ".join(f"M={size} {value:g}" for size, value in values.items())


def against_ideal(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return the slots of an exchange by broadcast, N_BC = 1."""
    return _listed(_slots(runs, "broadcast")), None


def grows_linearly(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return the increments of the delay of one message by unicast: equal and positive, if it grows linearly."""
    slots = _slots(runs, "one_message_unicast")
    steps = np.diff(slots.to_numpy())
    return _listed(slots), bool(len(steps) > 1 and (steps == steps[0]).all() and steps[0] > 0)


def stays_constant(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return the delay of one message by broadcast."""
    slots = _slots(runs, "one_message_broadcast")
    return _listed(slots), bool(slots.nunique() == 1)


def smallest_team_that_gains(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return the smallest team for which a full exchange by broadcast takes fewer slots than by either unicast."""
    broadcast = _slots(runs, "broadcast")
    parts = []
    for rival in ("unicast", "unicast_piggyback"):
        gains = broadcast < _slots(runs, rival)
        parts.append(f"from M={gains.idxmax()} on against {rival}" if gains.any() else f"never against {rival}")
    return ", ".join(parts), None
