"""The runs by which a claim of paper 000's experiments is judged for a choice of their alternatives.yaml."""

from typing import Final

import pandas as pd

from experiments.reflection.tables import LEAST, SIZES

AXES: Final = ("choice", "floor", "algorithm", "team")
AS_IN_THE_TABLES: Final = "as in the tables"
MANY: Final = "whole"
EVERY_TEAM: Final = ("fewer", "closer")
"""Beginnings of the ids of claims that need the teams between the smallest and the whole one."""


def of_choice(runs: pd.DataFrame, choice: str, claim: str) -> pd.DataFrame:
    """Return the runs by which *claim* is judged for *choice*; none, if those of all teams are needed.

    They are the runs of *choice*, and where it does not concern an arm, those of the arm as it is without it.

    That is as in the tables; for a choice called ``doors twice as wide, Cr 15`` it is ``doors twice as wide``.
    """
    if "team" in runs and claim.startswith(EVERY_TEAM):
        return runs.iloc[:0]
    without = choice.rpartition(", ")[0] or AS_IN_THE_TABLES
    key = [axis for axis in (*AXES[1:], "err_max", "explorers", "helpers", "replicate") if axis in runs]
    own, usual = (runs[(runs["choice"] == name) & runs["steps"].notna()].set_index(key) for name in (choice, without))
    found = pd.concat([own, usual[~usual.index.isin(own.index)]]).reset_index()
    if {"given_up", "targets"} <= set(found):
        found["targets_given_up"] = found["given_up"] * found["targets"]
        found["motion_steps"] = found["steps"] * found["targets"]
    if "team" in found:
        found["robots"] = [
            SIZES[-1] if team == MANY else LEAST[name]
            for team, name in zip(found["team"], found["algorithm"], strict=True)
        ]
    return found
