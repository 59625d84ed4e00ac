"""The examples run as they stand, and show what their comments promise."""

import ast
import importlib
import json
import re
import runpy
import shlex
import shutil
from itertools import pairwise
from pathlib import Path
from types import ModuleType
from typing import Any

import matplotlib
import numpy as np
import pytest

from cosim.machine import Address
from cosim.scenario import load
from cosim.simulation import simulate
from cosim.testing import check_machine
from cosim.units import S, Time
from tests.checkout import ROOT
from tests.tiers import two_tiers

EXAMPLES = ROOT / "examples"


def run(name: str, *sets: str) -> dict[str, float]:
    path = EXAMPLES / f"{name}.yaml"
    scenario = load(path, sets)
    metrics = simulate(scenario, scenario.seed).metrics
    if not sets:
        told = path.read_text(encoding="utf-8").partition("Look at:")[2].partition("\nname:")[0]
        named = set(re.findall(r"\b[a-z]+(?:_[a-z]+)+\b", told))
        assert named
        assert named <= metrics.keys()
    return metrics


def test_the_examples_are_numbered_from_one() -> None:
    numbers = sorted(int(path.name.split("_")[0]) for path in EXAMPLES.glob("*.yaml"))
    assert numbers == [1, 2, 3, 4, 5, 6]


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.yaml")), ids=lambda path: path.stem)
def test_the_commands_of_an_example_are_about_itself(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    commands = re.findall(r"^#   (cosim .*)$", text, re.MULTILINE)
    assert commands
    assert all(f"examples/{path.name}" in command for command in commands)


@pytest.mark.slow
def test_messages_at_once_cover_the_office_without_waiting() -> None:
    metrics = run("1_coverage")
    assert metrics["coverage"] == 1
    assert metrics["radio_wait_s"] < 0.01


@pytest.mark.slow
def test_bluetooth_takes_seconds_and_repeats_what_was_lost() -> None:
    ideal, lossy = run("2_bluetooth", "channel.kind=ideal"), run("2_bluetooth")
    assert lossy["coverage"] == 1
    assert lossy["setup_s"] > 1 > ideal["setup_s"]
    assert lossy["radio_wait_s"] > 1 > ideal["radio_wait_s"]
    assert lossy["time_to_cover_s"] > ideal["time_to_cover_s"]


@pytest.mark.slow
def test_the_others_notice_who_was_killed() -> None:
    metrics = run("3_walls_and_faults")
    assert metrics["robots_killed"] == 1
    assert metrics["died_at_s"] == 20
    assert 20 < metrics["suspected_at_s"] < 40
    assert metrics["payloads_forwarded"] > 0


@pytest.mark.slow
def test_the_searchers_of_a_dead_host_join_the_other() -> None:
    metrics = run("4_two_radios")
    assert metrics["hosts_alive"] == 1
    assert metrics["joins"] == 2
    assert metrics["completed"] == 1


@pytest.mark.slow
def test_both_plays_are_done_though_the_host_fails() -> None:
    metrics = run("5_deployment")
    assert metrics["plans_done"] == 2
    assert metrics["refused"] == 0
    assert metrics["successions"] >= 1
    assert metrics["collisions"] == 0


def test_robots_on_given_paths_are_taken_for_dead_while_out_of_reach() -> None:
    metrics = run("6_trajectories")
    assert metrics["distance_m"] == pytest.approx(110)  # robot 0 stands, 1 goes 35 m and back, 2 four sides of 10 m
    assert metrics["mistakes"] == 4  # between robot 1 and the others, both ways
    assert metrics["suspicions_standing"] == 0
    assert metrics["accuracy"] < 1


# ---------------------------------------------------------------- a protocol of one's own

ELECTION = EXAMPLES / "election"
SCENARIO = (ELECTION / "election.yaml").read_text(encoding="utf-8")
COMMANDS = [shlex.split(line) for line in re.findall(r"^#   cosim run (.*)$", SCENARIO, re.MULTILINE)]
SEEDS = range(1, 21)
CODE_LINES = 120


@pytest.fixture
def election(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The module of the example, found as the command line finds it where its author stands."""
    monkeypatch.syspath_prepend(str(ELECTION))
    return importlib.import_module("leader_election")


def elected(sets: list[str], seed: int) -> dict[str, float]:
    return simulate(load(ELECTION / "election.yaml", sets), seed).metrics


@pytest.mark.slow
@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
@pytest.mark.parametrize("seed", two_tiers(SEEDS, 2))
def test_five_robots_elect_one_leader_and_another_when_it_dies(
    words: list[str], seed: int, election: ModuleType
) -> None:
    sets = [word for option, word in pairwise(words) if option == "--set"]
    metrics = elected(sets, seed)
    assert metrics["leaders"] == 1
    assert 15 < metrics["agreed_s"] < 60, "robot 0 dies at 15 s"
    assert metrics["payloads_unsent"] == 0
    before = elected([*sets, "faults=[]"], seed)
    assert before["leaders"] == 1
    assert before["agreed_s"] < 15


def test_the_commands_are_for_three_channels(election: ModuleType) -> None:
    assert {words[0] for words in COMMANDS} == {"election.yaml"}
    assert [" ".join(words[2:3]) for words in COMMANDS] == ["", "channel.kind=adhoc", "channel.kind=bluetooth"]


@pytest.mark.slow
def test_a_robot_that_boots_again_leads_again(election: ModuleType) -> None:
    metrics = elected(["faults=[{kind: crash, robot: 0, at_s: 20, for_s: 10}]"], 1)
    assert metrics["leaders"] == 1
    assert 30 < metrics["agreed_s"] < 32


@pytest.mark.slow
def test_over_bluetooth_without_links_each_follows_itself(election: ModuleType) -> None:
    metrics = elected(["channel.kind=bluetooth"], 1)
    assert metrics["leaders"] == 4
    assert np.isnan(metrics["agreed_s"])


@pytest.mark.slow
@pytest.mark.parametrize("links", [None, {}])
@pytest.mark.parametrize("kind", ["fixed", "nfd_s", "nfd_e", "phi_akka"])
def test_the_elector_keeps_the_laws_of_machines(links: Any, kind: str, election: ModuleType) -> None:
    parameters = election.Parameters.model_validate({"transport": {"links": links}, "detector": {"kind": kind}})

    def make(me: Address, start: Time) -> Any:
        return election.SPEC.make(parameters, 3, me, np.random.default_rng(1), start)

    check_machine(make, duration=20 * S, events=election.SPEC.events)


def test_the_protocol_is_short() -> None:
    source = (ELECTION / "leader_election.py").read_text(encoding="utf-8")
    lines = {number for number, line in enumerate(source.splitlines(), 1) if line.strip() and line.strip()[0] != "#"}
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            lines -= {*range(node.lineno, (node.end_lineno or node.lineno) + 1)}
    assert 80 < len(lines) <= CODE_LINES


# ---------------------------------------------------------------- a policy of one's own

AGENTS = EXAMPLES / "agents"
POLICY = (AGENTS / "together.yaml").read_text(encoding="utf-8")
PLAYED = [shlex.split(line) for line in re.findall(r"^#   python (.*)$", POLICY, re.MULTILINE)]


@pytest.mark.slow
@pytest.mark.parametrize("words", PLAYED, ids=" ".join)
def test_robots_that_tell_where_they_are_come_together(words: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pettingzoo")
    monkeypatch.syspath_prepend(str(AGENTS))
    together = importlib.import_module("together")
    assert words[0] == "examples/agents/together.py"
    for seed in (1, 2):
        told = together.play(words[1:], seed)
        assert told["apart_m"] > 2.5 > 2.0 > told["together_m"]
        assert (told["began_s"] > 1.0) == ("channel.kind=bluetooth" in words)


def test_robots_that_hear_nothing_stay_where_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pettingzoo")
    monkeypatch.syspath_prepend(str(AGENTS))
    together = importlib.import_module("together")
    told = together.play(["duration_s=5", "channel.loss=1.0"], 1)
    assert told["together_m"] == told["apart_m"]


# ---------------------------------------------------------------- a notebook

ANALYSIS = EXAMPLES / "analysis"


def cells_of(script: str) -> list[tuple[str, str]]:
    """Return kind and text of the cells of a script in jupytext's percent format."""
    cells = []
    for part in re.split(r"^# %%", script, flags=re.MULTILINE)[1:]:
        title, _, body = part.partition("\n")
        text = body.strip()
        if "markdown" in title:
            text = re.sub(r"^# ?", "", text.strip('"').strip(), flags=re.MULTILINE)
            cells.append(("markdown", text))
        else:
            cells.append(("code", text))
    return cells


def test_the_notebook_is_the_script() -> None:
    notebook = json.loads((ANALYSIS / "sizes.ipynb").read_text(encoding="utf-8"))
    held = [(cell["cell_type"], "".join(cell["source"]).strip()) for cell in notebook["cells"]]
    plain = [(kind, re.sub(r"^#+ ", "", text)) for kind, text in held]
    script = cells_of((ANALYSIS / "sizes.py").read_text(encoding="utf-8"))
    assert [(kind, re.sub(r"^#+ ", "", text)) for kind, text in script] == plain


@pytest.mark.slow
def test_the_notebook_prints_what_it_shows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(ANALYSIS, tmp_path / "analysis", ignore=shutil.ignore_patterns("results", "__pycache__"))
    monkeypatch.chdir(tmp_path / "analysis")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setenv("PYTHONUNBUFFERED", "1")
    matplotlib.use("agg")
    notebook = json.loads(Path("sizes.ipynb").read_text(encoding="utf-8"))
    outputs = [output for cell in notebook["cells"] for output in cell.get("outputs", ())]
    shown = "".join("".join(output["text"]) for output in outputs if output["output_type"] == "stream")
    runpy.run_path("sizes.py")
    assert capfd.readouterr().out == shown
    assert Path("results/sizes/cost.png").stat().st_size > 0
