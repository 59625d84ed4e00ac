"""Gains by search with held-up ticks as a constraint: what it costs to break it, and the sheet that declares it."""

import pandas as pd
import pytest

from cosim.experiment import load_experiment
from cosim.report.claims import published_claims
from experiments.gain_tuning import tuning
from experiments.gain_tuning.constrained import figures
from tests.checkout import EXPERIMENTS

SHEET = EXPERIMENTS / "gain_tuning" / "constrained" / "sweep.yaml"


def test_gains_that_break_the_constraint_cost_more_than_any_and_the_more_the_more_they_do(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The trial comes first, is slow, and is held up in 2 ticks; the others in more, as many, or fewer."""
    ticks, costs = iter([2.0, 7.0, 2.0, 0.0, 3.0, *[9.0] * 99]), iter([299.0, 10.0, 90.0, 120.0, 5.0, *[1.0] * 99])
    monkeypatch.setattr(tuning, "explore", lambda *_: {"cost_s": next(costs), "blocked_ticks": next(ticks)})
    sets = ["popsize=1", "generations=0", "scenario.duration_s=150"]
    rows = tuning.search(tuning.Parameters.model_validate(load_experiment(SHEET, sets).base), 8999)
    assert [row["cost_s"] for row in rows][:5] == [299.0, 305.0, 90.0, 120.0, 301.0]


def test_the_sheet_is_that_of_gain_tuning_but_for_what_its_readme_says() -> None:
    usual, own = load_experiment(SHEET.parents[1] / "sweep.yaml"), load_experiment(SHEET)
    changes = {"training": 12, "contact_s": 0.0, "constrained": True, "scenario": own.base["scenario"]}
    assert own.base == usual.base | changes
    assert own.base["scenario"] | {"name": "gain_tuning"} == usual.base["scenario"]
    assert (own.replicates, own.seed > usual.seed + usual.replicates) == (20, True)
    for claim in published_claims(SHEET.parent):
        assert getattr(figures, claim.test)(pd.DataFrame(), pd.DataFrame()) == ("-", None)
