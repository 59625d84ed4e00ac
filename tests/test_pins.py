"""Pins: runs that compute something else than they did are noticed, with the second and the kind of what differs."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from cosim.errors import LocalProtocolError, UserError
from cosim.pins import Case, Fact, Pins, cases_in, check_pins, difference, made_elsewhere, made_with, pin_of, read_pins
from cosim.scenario import load
from tests.checkout import ROOT

OURS = ROOT / "tests" / "pins.csv"
LONGEST_RUN_S = 60
SCENARIO = """\
duration_s: 3
floorplan: {map: walls, bounds_m: [0, 0, 9, 9]}
team: {size: 2, starts: [[2, 2], [6, 6]]}
channel: {kind: ideal, delay_s: 0.001, jitter_s: 0.01}
protocol: {use: monitoring, parameters: {period_s: 0.5}}
"""
SWEEP = """\
scenario: scenario.yaml
sweep: {channel.delay_s: [0.001, 0.002]}
replicates: 2
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "scenario.yaml").write_text(SCENARIO)
    (tmp_path / "sweep.yaml").write_text(SWEEP)
    monkeypatch.chdir(tmp_path)
    return tmp_path


Command = Callable[..., Any]


# ---------------------------------------------------------------- our own


def our_scenarios() -> list[str]:
    return sorted({case.scenario for case in read_pins(OURS).runs})


@pytest.mark.slow
@pytest.mark.parametrize("scenario", our_scenarios())
def test_what_runs_compute_is_what_they_computed_when_they_were_pinned(scenario: str) -> None:
    pins = read_pins(OURS)
    elsewhere = made_elsewhere(pins)
    if elsewhere:
        pytest.skip(f"pins were made with {elsewhere}; here the last bits of results may differ")
    chosen = Pins(pins.made_with, {case: pin for case, pin in pins.runs.items() if case.scenario == scenario})
    differing = [f"{finding.case}: {finding.text}" for finding in check_pins(chosen, OURS.parent) if not finding.same]
    assert not differing, "\n".join(differing)


def test_more_than_a_hundred_runs_of_all_protocols_are_pinned() -> None:
    pins = read_pins(OURS)
    assert len(pins.runs) >= 100
    every = cases_in([str(path) for path in sorted((ROOT / "tests" / "pins").glob("*.yaml"))], OURS.parent)
    assert {*every} == {*pins.runs}
    protocols = {path.parent.name for path in ROOT.glob("protocols/*/spec.py")}
    used = {load_use(ROOT / "tests" / scenario) for scenario in our_scenarios()}
    assert used == protocols
    ends = [int(pin[Fact("timing", "end")][1]) for pin in pins.runs.values()]
    assert max(ends) <= LONGEST_RUN_S * 10**9


def load_use(path: Path) -> str:
    found = re.search(r"use: (\w+)", path.read_text(encoding="utf-8"))
    assert found is not None
    return found[1]


# ---------------------------------------------------------------- the command


def test_the_same_code_gives_the_same_pins(folder: Path, cosim: Command) -> None:
    made = cosim("pin", "scenario.yaml", "sweep.yaml", "-o", "kept/pins.csv")
    assert (made.code, made.out) == (0, "5 runs in kept/pins.csv\n")
    pins = read_pins(folder / "kept" / "pins.csv")
    assert [str(case) for case in pins.runs] == [
        "../scenario.yaml, seed 1",
        "../sweep.yaml, delay_s=0.001, seed 1",
        "../sweep.yaml, delay_s=0.001, seed 2",
        "../sweep.yaml, delay_s=0.002, seed 1",
        "../sweep.yaml, delay_s=0.002, seed 2",
    ]
    assert pins.made_with == made_with()
    checked = cosim("pin", "--check", "kept/pins.csv")
    assert checked.code == 0
    assert checked.out.splitlines()[0] == "../scenario.yaml, seed 1: same"
    assert checked.out.endswith("5 of 5 runs are the same\n")


def test_labels_of_several_lines_are_kept(folder: Path, cosim: Command) -> None:
    (folder / "sweep.yaml").write_text(
        SWEEP.replace(
            "channel.delay_s: [0.001, 0.002]", r'late: {path: channel.delay_s, values: {"a\nb, \"c\"": 0.001}}'
        )
    )
    cosim("pin", "sweep.yaml", "-o", "pins.csv")
    assert {case.arm for case in read_pins(folder / "pins.csv").runs} == {'late=a\nb, "c"'}


def test_a_field_that_is_too_long_is_told_by_its_line(folder: Path, cosim: Command) -> None:
    cosim("pin", "scenario.yaml", "-o", "pins.csv")
    with (folder / "pins.csv").open("a") as file:
        file.write(f"{'x' * 200_000},,1,digest,,,,0\n")
    checked = cosim("pin", "--check", "pins.csv")
    assert checked.code == 2
    assert re.fullmatch(r".*pins\.csv: line \d+: is no row of a file of pins\n", checked.err)


def test_a_place_that_cannot_be_written_is_told_before_any_run(
    folder: Path, cosim: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / "kept").write_text("a file")
    monkeypatch.setattr("cosim.pins.pin_of", lambda *_: pytest.fail("a run was made"))
    made = cosim("pin", "scenario.yaml", "-o", "kept/pins.csv")
    assert made.code != 0
    assert "kept" in made.err


def test_each_seed_is_a_run(folder: Path, cosim: Command) -> None:
    cosim("pin", "scenario.yaml", "--seed", "3", "--seed", "4", "-o", "pins.csv")
    pins = read_pins(folder / "pins.csv")
    assert [case.seed for case in pins.runs] == [3, 4]
    one, other = pins.runs.values()
    assert one != other


def test_what_is_pinned_of_a_run(folder: Path) -> None:
    pin = pin_of(load("scenario.yaml"), 1)
    assert re.fullmatch("[0-9a-f]{64}", pin[Fact("digest")][1])
    assert pin[Fact("metric", "distance_m")] == (None, "0.0")
    assert Fact("metric", "kernel_events") not in pin  # how it went, not what came out
    assert pin[Fact("timing", "first_link")] == (None, "")  # an ideal channel has none
    assert pin[Fact("timing", "end")] == (None, "3000000000")
    assert [pin[Fact("rows", "poses", second)][0] for second in (0, 1, 2)] == [20, 20, 20]
    heard = [pin[Fact("rows", "messages", second)][0] for second in (0, 1, 2)]
    assert sum(heard) == pytest.approx(12, abs=2)  # two robots, six periods


def test_the_first_link_of_a_piconet_is_timed(folder: Path) -> None:
    scenario = load("scenario.yaml", ["channel={kind: bluetooth}", "protocol={use: gathering}", "duration_s=20"])
    pin = pin_of(scenario, 1)
    linked, heard = (int(pin[Fact("timing", name)][1]) for name in ("first_link", "first_message"))
    assert 1e9 < linked < heard < 20e9  # an inquiry and a page come before


def test_another_behaviour_is_told_with_its_first_second_and_its_kinds(folder: Path, cosim: Command) -> None:
    cosim("pin", "scenario.yaml", "-o", "pins.csv")
    fault = "faults: [{kind: kill, robot: 1, at_s: 1.7}]\n"
    (folder / "scenario.yaml").write_text(SCENARIO + fault)
    checked = cosim("pin", "--check", "pins.csv")
    assert checked.code == 1
    line = checked.out.splitlines()[0]
    assert line.startswith("scenario.yaml, seed 1: second 1 is the first that differs: ")
    assert "Killed (1, pinned 0)" in line
    assert "metrics: " in line
    assert "robots_killed 1.0, pinned 0.0" in line
    assert checked.out.endswith("0 of 1 runs are the same\n")


def test_rows_that_are_as_many_but_others_are_noticed(folder: Path, cosim: Command) -> None:
    cosim("pin", "scenario.yaml", "-o", "pins.csv")
    (folder / "scenario.yaml").write_text(SCENARIO.replace("[6, 6]", "[6, 7]"))
    checked = cosim("pin", "--check", "pins.csv", "--json")
    assert checked.code == 1
    assert "second 0 is the first that differs: poses (20, other ones)" in checked.out


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({Fact("digest"): (None, "x")}, "digest"),
        ({Fact("timing", "end"): (None, "5")}, "timings: end 5, pinned 3"),
        ({Fact("metric", "new"): (None, "1.0")}, "metrics: new 1.0, pinned not there"),
        ({Fact("rows", "poses", 7): (2, "ab")}, "second 7 is the first that differs: poses (2, pinned 0)"),
        ({}, ""),
    ],
)
def test_every_fact_counts(change: dict[Fact, Any], said: str) -> None:
    pinned = {Fact("digest"): (None, "a"), Fact("timing", "end"): (None, "3"), Fact("rows", "poses", 1): (1, "c")}
    assert difference(pinned, {**pinned, **change}) == said


def test_with_other_versions_nothing_fails(folder: Path, cosim: Command) -> None:
    cosim("pin", "scenario.yaml", "-o", "pins.csv")
    path = folder / "pins.csv"
    path.write_text(path.read_text().replace("made with,numpy,,,", "made with,numpy,,,0."))
    assert cosim("pin", "--check", "pins.csv").code == 0
    (folder / "scenario.yaml").write_text(SCENARIO.replace("duration_s: 3", "duration_s: 2"))
    checked = cosim("pin", "--check", "pins.csv")
    assert checked.code == 0
    assert "0 of 1 runs are the same" in checked.out
    assert re.match(r"made with numpy 0\.[\d.]+ \(here [\d.]+\): so what differs is no failure", checked.err)


def test_a_run_that_breaks_now_is_told(folder: Path, cosim: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    cosim("pin", "scenario.yaml", "sweep.yaml", "-o", "pins.csv")

    def broken(*_: Any) -> None:
        raise LocalProtocolError("robot 0 has no radio 7")

    with monkeypatch.context() as patch:
        patch.setattr("cosim.pins.Simulation", broken)
        checked = cosim("pin", "--check", "pins.csv")
    assert checked.code == 1
    assert checked.out.startswith("scenario.yaml, seed 1: cannot be run: robot 0 has no radio 7\n")
    (folder / "sweep.yaml").write_text(SWEEP.replace("0.002", "0.004"))
    (folder / "scenario.yaml").unlink()
    checked = cosim("pin", "--check", "pins.csv")
    assert checked.out.startswith("scenario.yaml, seed 1: cannot be run: scenario.yaml: ")


def test_an_arm_that_is_gone_is_told(folder: Path) -> None:
    pins = Pins(made_with(), {Case("sweep.yaml", "delay_s=7", 1): {}})
    (finding,) = check_pins(pins, folder)
    assert finding.text == "cannot be run: sweep.yaml: has no arm 'delay_s=7'"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("pin",), "pin: expected SCENARIOS and -o FILE, or --check FILE"),
        (("pin", "scenario.yaml"), "pin: expected SCENARIOS and -o FILE, or --check FILE"),
        (("pin", "-o", "x.csv"), "pin: expected SCENARIOS and -o FILE, or --check FILE"),
        (("pin", "--check", "x.csv", "-o", "y.csv"), "--check: the runs are those of the file"),
        (("pin", "--check", "nowhere.csv"), "nowhere.csv: "),
        (("pin", "--check", "scenario.yaml"), "scenario.yaml: line 1: expected the columns scenario,arm,seed,"),
        (("pin", "sweep.yaml", "--seed", "1", "-o", "x.csv"), "--seed: sweep.yaml is an experiment, whose replicates"),
        (("pin", "inquiry_time", "-o", "x.csv"), "is no run of robots but of experiments.inquiry_time.discovery:"),
        (("pin", "nowhere.yaml", "-o", "x.csv"), "nowhere.yaml: is neither a file nor an experiment"),
    ],
)
def test_what_cannot_be_pinned_is_refused_in_one_line(
    folder: Path, cosim: Command, words: tuple[str, ...], said: str
) -> None:
    refused = cosim(*words)
    assert refused.code == 2
    assert said in refused.err
    assert refused.err.count("\n") == 1
    assert not (folder / "x.csv").exists()


@pytest.mark.parametrize("row", ["a,b", "a,,x,digest,,,,1", "a,,1,rows,poses,x,1,1", "a,,1,rows,poses,1,x,1"])
def test_a_row_that_is_none_is_refused_with_its_number(folder: Path, row: str) -> None:
    (folder / "pins.csv").write_text(f"scenario,arm,seed,what,name,second,count,value\n{row}\n")
    with pytest.raises(UserError, match=r"pins\.csv: line 2: is no row of a file of pins"):
        read_pins(folder / "pins.csv")
