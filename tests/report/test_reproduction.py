"""Reproduction: every claim is in the index, an experiment that fails does not end others, what differs is told."""

import csv
import json
import re
import shutil
import sys
from pathlib import Path
from typing import Any

import pytest

from cosim.experiment import experiment_folders
from cosim.report.claims import published_claims
from cosim.report.kept import kept_verdicts
from cosim.report.page import VERDICTS
from cosim.report.reproduction import Reproduction
from tests.checkout import DATA, EXPERIMENTS
from tests.report.sheets import CLAIMS, written


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Work in a folder that holds a user's own functions."""
    shutil.copy(DATA / "delays.py", tmp_path)
    monkeypatch.delitem(sys.modules, "delays", raising=False)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path


def index(folder: Path) -> list[dict[str, str]]:
    with (folder / "index.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize(("error", "logged"), [(ZeroDivisionError("of ours"), True), (OSError("disk full"), False)])
def test_where_a_fault_of_ours_is_is_logged(
    error: Exception, logged: bool, folder: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
):
    def fails(*words: object, **named: object) -> None:
        raise error

    written(folder / "sound")
    monkeypatch.setattr("cosim.report.reproduction.run_sweep", fails)
    found = Reproduction([str(folder / "sound")], folder / "out", quick=True, jobs=1)
    assert found.make("sound", lambda *_: None).error == f"{type(error).__name__}: {error}"
    assert [", in fails\n" in told for told in caplog.messages] == [True] * logged


def test_every_row_of_every_published_csv_is_in_the_index(tmp_path: Path):
    there, names = [], {folder.resolve(): name for name, folder in experiment_folders().items()}
    for path in EXPERIMENTS.glob("**/published.csv"):
        with path.open(encoding="utf-8", newline="") as file:
            name = names[path.parent.resolve()]
            there += [(name, row["paper"], row["section"], row["id"], row["claim"]) for row in csv.DictReader(file)]
    assert len(there) > 800
    found = Reproduction((), tmp_path, True, 1)
    found.write_index()
    columns = ("experiment", "paper", "section", "id", "claim")
    rows = index(tmp_path)
    assert sorted(tuple(row[column] for column in columns) for row in rows) == sorted(there)
    assert {(row["verdict"], row["reason"]) for row in rows} == {("no data", "was not run")}
    page = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert page.count('role="row" id=') == len(there)
    ids = re.findall(r' id="([^"]*)"', page)
    assert len(set(ids)) == len(ids)


@pytest.mark.slow
def test_an_experiment_that_fails_is_told_and_does_not_end_the_others(cosim: Any, folder: Path):
    written(folder / "sound")
    written(folder / "broken", sweep={"size": {"path": "nothing.such", "values": [1, 2]}})
    written(folder / "crashing", parameters={"size": 1, "broken": 3})
    written(folder / "blocked")
    (folder / "out").mkdir()
    (folder / "out/blocked").write_text("no folder", encoding="utf-8")
    ended = cosim("reproduce", "broken", "blocked", "crashing", "sound", "--quick", "--jobs", "1", "-o", "out")
    assert ended.code == 1
    lines = ended.err.splitlines()
    assert "nothing.such" in next(line for line in lines if line.startswith("broken: "))
    assert "blocked: NotADirectoryError: " in ended.err
    assert "crashing: 4 runs, 2 of them failed; 1 holds, 3 no data" in lines
    assert "sound: 4 runs, 0 of them failed; 3 holds, 1 no data" in lines
    assert ended.out == "    4 holds\n   12 no data\nindex: out/index.html\n"
    assert len(index(folder / "out")) == 4 * len(CLAIMS.splitlines())
    page = (folder / "out/index.html").read_text(encoding="utf-8")
    links = set(re.findall(r'href="([a-z]+\.html)', page))
    assert links == {"sound.html", "crashing.html"}
    assert all((folder / "out" / link).is_file() for link in links)
    anchors = re.findall(r'href="sound\.html#([^"]+)"', page)
    sound = (folder / "out/sound.html").read_text(encoding="utf-8")
    assert len(anchors) == 4
    assert all(f' id="{anchor}"' in sound for anchor in anchors)


@pytest.mark.slow
def test_it_goes_on_where_it_was_and_prints_all_as_data(cosim: Any, folder: Path):
    written(folder / "sound")
    assert cosim("reproduce", "sound", "--quick", "--jobs", "1", "-o", "out").code == 0
    before = sorted((folder / "out/sound/runs").iterdir())
    ended = cosim("reproduce", "sound", "--quick", "--jobs", "1", "-o", "out", "--json")
    assert ended.code == 0
    assert sorted((folder / "out/sound/runs").iterdir()) == before
    plain = json.loads(ended.out)
    assert plain["experiments"] == [{"name": "sound", "runs": 4, "failed": 0, "error": ""}]
    assert [row["verdict"] for row in plain["claims"]] == ["holds", "holds", "holds", "no data"]


@pytest.mark.slow
def test_a_quick_verdict_other_than_that_kept_of_the_whole_sheet_is_listed(cosim: Any, folder: Path):
    written(folder / "sound")
    assert cosim("reproduce", "sound", "--keep", "--jobs", "1", "-o", "whole").code == 0
    kept = (folder / "sound/verdicts.csv").read_text(encoding="utf-8").splitlines()
    assert kept[0] == "id,verdict,ours,replicates,code"
    assert [line.split(",")[:2] for line in kept[1:]] == [
        ["first", "holds"],
        ["second", "holds"],
        ["third", "no data"],
        ["fourth", "holds"],
    ]
    other = "\n".join(kept).replace("first,holds", "first,fails").replace("second,holds", "second,open")
    (folder / "sound/verdicts.csv").write_text(other.replace("third,no data", "third,fails"), encoding="utf-8")
    ended = cosim("reproduce", "sound", "--quick", "--jobs", "1", "-o", "quick", "--json")
    assert json.loads(ended.out)["disagreeing"] == ["sound: first", "sound: second"]
    page = (folder / "quick/index.html").read_text(encoding="utf-8")
    assert "Of these, 3 are decided here, and 2 otherwise than there." in page
    assert re.findall('id="other-sound-([a-z]+)"', page) == ["first", "second"]


def test_what_is_wrong_with_the_words_is_told_before_anything_runs(cosim: Any, folder: Path):
    written(folder / "sound")
    assert cosim("reproduce", "sound", "nothing").err.startswith("nothing: is neither a file nor an experiment")
    ended = cosim("reproduce", "sound", "--quick", "--keep")
    assert (ended.code, ended.err) == (2, "--keep: keeps the verdicts of whole sheets, expected no --quick beside it\n")
    assert not (folder / "results").exists()


@pytest.mark.parametrize("text", ["gain_tuning_constrained", str(EXPERIMENTS / "gain_tuning" / "constrained")])
def test_an_experiment_in_the_folder_of_another_has_the_name_that_it_is_installed_by(text: str, tmp_path: Path):
    assert [*Reproduction([text], tmp_path, True, 1).tried] == ["gain_tuning_constrained"]


def test_experiments_whose_folders_have_one_name_are_refused(cosim: Any, folder: Path):
    for place in ("a", "b"):
        (folder / place).mkdir()
        written(folder / place / "sound")
    ended = cosim("reproduce", "a/sound", "b/sound")
    assert ended.code == 2
    assert "expected experiments in folders of different names" in ended.err


def test_verdicts_that_are_kept_are_of_claims_that_there_are():
    kept = {at: kept_verdicts(at) for at in experiment_folders().values()}
    assert sum(map(len, kept.values())) >= 163
    for at, verdicts in kept.items():
        assert verdicts.keys() <= {claim.id for claim in published_claims(at)}
        assert {each.verdict for each in verdicts.values()} <= set(VERDICTS)


def test_kept_verdicts_in_another_form_are_told(folder: Path):
    written(folder / "sound")
    (folder / "sound/verdicts.csv").write_text("id,word\nfirst,holds\n", encoding="utf-8")
    found = Reproduction(("sound",), folder / "out", True, 1)
    assert "verdicts.csv: expected the columns id, verdict, ours" in found.tried["sound"].error
