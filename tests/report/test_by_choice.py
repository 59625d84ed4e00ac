"""The claims of an experiment, judged choice by choice: the command, its table and its picture."""

from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from cosim.report.by_choice import main
from cosim.results import RunStore, SweepDescription

CLAIM = {"id": "short", "paper": "1", "section": "1", "claim": "it is short", "quantity": "delay_s", "where": ""}
DESCRIPTION: dict[str, Any] = {
    "experiment": "calls",
    "replicates": 3,
    "report": {"metrics": [], "x": None},
    "code": "k",
}


def results(folder: Path, axis: str) -> Path:
    """Write runs with two values of *axis*, and beside their sweep.yaml a claim that one of them meets."""
    pd.DataFrame([CLAIM | {"unit": "s", "published": "2", "test": "at most"}]).to_csv(
        folder / "published.csv", index=False
    )
    rows = [
        {"experiment": "calls", "replicate": seed, "configuration": name, "seed": seed, "code": "k"}
        | {"status": "done", "error": None, "wall_s": 0.1, "digest": "d", axis: name, "delay_s": delay_s}
        for name, delay_s in (("near", 1.0), ("far", 3.0))
        for seed in range(3)
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


def test_a_sweep_without_choices_is_refused_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = results(tmp_path, "radio")
    with pytest.raises(SystemExit) as ended:
        main([str(folder)])
    assert ended.value.code == 2
    assert capsys.readouterr().err == f"{folder}: the sweep has no axis choice\n"
