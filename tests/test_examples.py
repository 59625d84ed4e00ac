"""The numbered examples run as they stand, and show what their comments promise."""

import re
from pathlib import Path

import pytest

from cosim.scenario import load
from cosim.simulation import simulate
from tests.checkout import ROOT

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
    assert numbers == [1, 2, 3, 4, 5]


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
