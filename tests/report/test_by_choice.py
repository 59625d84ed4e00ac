"""The claims of an experiment, judged choice by choice: the command, its table and its picture."""

import shutil
import sys
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import yaml

from cosim.experiment import load_experiment
from cosim.report.by_choice import draw_verdicts, main
from cosim.report.kept import KeptVariation, keep_variations, kept_variations
from cosim.results import RunStore, SweepDescription
from tests.checkout import DATA
from tests.report.sheets import DELAYS

CLAIM = {"id": "short", "paper": "1", "section": "1", "claim": "it is short", "quantity": "delay_s", "where": ""}
DESCRIPTION: dict[str, Any] = {
    "experiment": "calls",
    "replicates": 3,
    "report": {"metrics": [], "x": None},
    "code": "k",
}


def results(folder: Path, axis: str, figures: str = "") -> Path:
    """Write runs with two values of *axis*, and beside their sweep.yaml a claim that one of them meets."""
    if figures:
        (folder / "figures.py").write_text(figures, encoding="utf-8")
    pd.DataFrame([CLAIM | {"unit": "s", "published": "2", "test": "at most"}]).to_csv(
        folder / "published.csv", index=False
    )
    rows = [
        {"experiment": "calls", "replicate": seed, "configuration": name, "seed": seed, "code": "k"}
        | {"status": "done", "error": None, "wall_s": 0.1, "digest": "d", axis: name, "delay_s": delay_s}
        for name, delay_s in (("near", 1.0), ("far", 3.0))
        for seed in range(1, 4)
    ]
    axes = {axis: {"path": axis, "values": ["near", "far"]}}
    store = RunStore(folder / "results")
    with store.writing():
        more = {"axes": axes, "configurations": ["near", "far"], "source": str(folder / "sweep.yaml")}
        store.describe(SweepDescription.model_validate(DESCRIPTION | more))
        store.append(rows, [], [], {})
    return folder / "results"


def test_each_choice_is_judged_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = results(tmp_path, "choice")
    main([str(folder)])
    table = pd.read_csv(folder / "claims_by_choice.csv", index_col=0)
    assert table.to_dict("index") == {"short": {"near": "holds", "far": "fails"}}
    assert (folder / "claims_by_choice.png").is_file()
    assert str(folder / "claims_by_choice.csv") in capsys.readouterr().out


def test_what_is_not_judged_is_not_drawn(tmp_path: Path) -> None:
    assert draw_verdicts(pd.DataFrame({"near": {"printed": "not comparable"}}), tmp_path) == []
    assert list(tmp_path.iterdir()) == []


def test_a_sweep_without_choices_is_refused_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = results(tmp_path, "radio")
    with pytest.raises(SystemExit) as ended:
        main([str(folder)])
    assert ended.value.code == 2
    assert capsys.readouterr().err == f"{folder}: the sweep has no axis choice\n"


def test_runs_by_which_a_claim_is_judged_may_be_chosen_by_the_experiment(tmp_path: Path) -> None:
    figures = (
        "def of_choice(runs, choice, claim):\n    assert claim == 'short'\n    return runs[runs['choice'] != choice]\n"
    )
    main([str(results(tmp_path, "choice", figures))])
    table = pd.read_csv(tmp_path / "results/claims_by_choice.csv", index_col=0)
    assert table.to_dict("index") == {"short": {"near": "fails", "far": "holds"}}


def whole(folder: Path, replicates: int) -> Path:
    """Write results of a sheet that is there, alternatives.yaml, as if it had been run; return their folder."""
    shutil.copy(DATA / "delays.py", folder)
    plain = DELAYS | {"sweep": {"choice": {"path": "size", "values": {"near": 2, "far": 6}}}}
    (folder / "alternatives.yaml").write_text(yaml.safe_dump(plain), encoding="utf-8")
    made, store = results(folder, "choice"), RunStore(folder / "results")
    arms = [arm.configuration for arm in load_experiment(folder / "alternatives.yaml").arms]
    told = store.description()
    runs = store.present().assign(
        configuration=lambda rows: rows["choice"].map(dict(zip(("near", "far"), arms, strict=True)))
    )
    shutil.rmtree(made)
    changes = {"source": str(folder / "alternatives.yaml"), "replicates": replicates}
    with store.writing():
        store.describe(told.model_copy(update=changes | {"configurations": tuple(arms), "codes": ("k", "k")}))
        store.append(runs[runs["replicate"] <= replicates].to_dict("records"), [], [], {})
    return made


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a user's own functions."""
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "delays", raising=False)
    return tmp_path


def test_verdicts_of_a_whole_sheet_are_kept_beside_those_of_others(folder: Path) -> None:
    made = whole(folder, 3)
    other = KeptVariation("zones", "x", "short", "open", "1", "2", "c")
    keep_variations(folder, "zones", [other])
    for _ in range(2):  # the second time in place of the first
        main([str(made), "--keep"])
    assert kept_variations(folder) == [
        KeptVariation("alternatives", "near", "short", "holds", "1 (0.439 to 1)", "3", "k"),
        KeptVariation("alternatives", "far", "short", "fails", "3", "3", "k"),
        other,
    ]


def test_a_verdict_that_another_choice_lends_is_kept_once(folder: Path) -> None:
    made = whole(folder, 3)
    lending = "def of_choice(runs, choice, claim):\n    return runs[runs['choice'] == 'near']\n"
    (folder / "figures.py").write_text(lending, encoding="utf-8")
    main([str(made), "--keep"])
    assert pd.read_csv(made / "claims_by_choice.csv", index_col=0).to_dict("index") == {
        "short": {"near": "holds", "far": "holds"}
    }
    assert [each.variation for each in kept_variations(folder)] == ["near"]


def test_a_verdict_that_own_runs_change_is_kept_though_others_are_lent(folder: Path) -> None:
    made = whole(folder, 3)
    (folder / "figures.py").write_text("def of_choice(runs, choice, claim):\n    return runs\n", encoding="utf-8")
    main([str(made), "--keep"])
    assert [each.variation for each in kept_variations(folder)] == ["near", "far"]


@pytest.mark.parametrize("replicates", [2, 4])  # fewer than the sheet asks for, and more than there are
def test_verdicts_of_a_part_of_a_sheet_are_not_kept(folder: Path, replicates: int, capsys: Any) -> None:
    made = whole(folder, replicates)
    with pytest.raises(SystemExit) as ended:
        main([str(made), "--keep"])
    assert ended.value.code == 2
    assert "--keep: keeps the verdicts of whole sheets, this is not all of " in capsys.readouterr().err
    assert not (folder / "variations.csv").exists()
