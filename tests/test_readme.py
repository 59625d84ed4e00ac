"""The README's scenario and Python lines are run as they stand."""

import re
import runpy
from pathlib import Path

import pytest
import yaml

from cosim import __version__
from cosim.scenario import Scenario
from cosim.simulation import simulate
from tests.checkout import ROOT

README = (ROOT / "README.md").read_text(encoding="utf-8")


def block(language: str) -> str:
    found = re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)
    assert len(found) == 1
    text: str = found[0]
    return text


@pytest.mark.slow
def test_the_python_lines_run_on_the_scenario_and_cover_the_floor(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "four.yaml").write_text(block("yaml"), encoding="utf-8")
    script = tmp_path / "script.py"
    script.write_text(block("python"), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(script))
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert [row[:2] for row in rows] == [["ideal", "1.0"], ["bluetooth", "1.0"]]
    assert float(rows[0][3]) < float(rows[1][3])  # the radio costs time


@pytest.mark.slow
def test_the_lines_on_learning_play_an_episode(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pettingzoo")
    (lines,) = re.findall(r"```\n(from cosim.env.*?)```", README, re.DOTALL)
    script = tmp_path / "script.py"
    script.write_text(lines, encoding="utf-8")
    monkeypatch.chdir(ROOT)
    left = runpy.run_path(str(script))
    assert left["infos"]["robot_0"]["time_s"] == 59.9
    assert all(left["truncations"].values())


def test_the_examples_are_as_short_as_promised() -> None:
    assert len(block("yaml").splitlines()) <= 11
    assert len([line for line in block("python").splitlines() if line]) <= 10


def test_the_lines_on_radio_and_faults_are_a_scenario() -> None:
    one_radio, two_radios = re.findall(r"```\n(channel:.*?)```", README, re.DOTALL)
    given = yaml.safe_load(block("yaml")) | yaml.safe_load(one_radio)
    made = Scenario.model_validate(given)
    assert [fault.kind for fault in made.faults] == ["kill", "jammer"]
    assert made.model_dump()["channel"]["propagation"]["exponent"] == 3.0
    made = Scenario.model_validate(yaml.safe_load(block("yaml")) | yaml.safe_load(two_radios))
    assert made.team.carried == ((0, 1),) * 3 + ((0,),) * 6


def test_the_exploration_is_a_scenario() -> None:
    (scout,) = re.findall(r"```\n(name: scout.*?)```", README, re.DOTALL)
    made = Scenario.model_validate(yaml.safe_load(scout))
    assert made.protocol.spec.name == "exploration"
    parameters = made.protocol.parameters.model_dump()
    assert (parameters["algorithm"], parameters["map"]) == ("schemas", "messages")
    assert made.team.senses.beam_range_m == 2.5


@pytest.mark.slow
def test_the_deployment_is_begun_and_one_with_places_that_the_floor_does_not_have_is_refused_in_words() -> None:
    (text,) = re.findall(r"```\n(name: three_places.*?)```", README, re.DOTALL)
    plain = yaml.safe_load(text)
    plain["floorplan"]["map"] = str(ROOT / plain["floorplan"]["map"])
    outcome = simulate(Scenario.model_validate(plain | {"duration_s": 10}), 1)
    assert outcome.notices == ()
    assert outcome.metrics["orders"] > 0
    assert outcome.metrics["distance_m"] > 1
    plain["protocol"]["parameters"]["calls"][0]["call"]["places"] = ["B", "Z"]
    outcome = simulate(Scenario.model_validate(plain), 1)
    (told,) = outcome.notices
    assert told.startswith("robot 0 at ")
    assert " s: deploy/leap-frog is refused: 'Z' is not a place" in told


def test_every_experiment_is_in_the_table() -> None:
    folders = sorted(path.parent.name for path in ROOT.glob("experiments/*/sweep.yaml"))
    assert folders
    for name in folders:
        assert f"[{name}](experiments/{name}/README.md)" in README


def test_the_version_is_the_same_wherever_it_stands() -> None:
    root = ROOT
    assert yaml.safe_load((root / "CITATION.cff").read_text(encoding="utf-8"))["version"] == __version__
    assert f"\n## {__version__}, " in (root / "CHANGELOG.md").read_text(encoding="utf-8")
    assert f"cosim_robots-{__version__}-py3" in README
