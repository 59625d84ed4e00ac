"""The comparison with other simulators that ``make bench-peers`` prints and keeps: what is run, told and written."""

import importlib
import json
import sys
from itertools import chain

import pytest

from benchmarks.peers import __main__ as comparison
from benchmarks.peers import installation, waypoints
from benchmarks.peers.__main__ import BEGIN, COLUMNS, Measured, ProgramError, Row, measured, row
from benchmarks.peers.installation import Peer
from benchmarks.peers.pairs import COSIM, GRADYS, IRSIM, NS3, PAIRS, Pair, Program
from benchmarks.tables import END, README, written
from cosim.channels.adhoc.routing.aodv_settings import AodvSettings

OURS, THEIRS = Program(COSIM, "ours", ("--nodes=2",)), Program(NS3, "theirs", ("--nodes=2",))
PAIR = Pair("two nodes", OURS, THEIRS, "sent_frames", bound=0.5)
HERE = {NS3: Peer("3.37"), IRSIM: Peer("2"), GRADYS: Peer("1")}


def rounds(*seconds):
    """Return rounds in which ours and theirs took as many seconds; None where it was not measured."""
    return [
        {
            program: Measured(each, {"sent_frames": 7.0})
            for program, each in zip((OURS, THEIRS), pair, strict=True)
            if each
        }
        for pair in seconds
    ]


# ---------------------------------------------------------------- the table


def test_a_ratio_is_the_median_of_the_ratios_of_the_rounds_with_the_least_and_the_greatest():
    line = row(PAIR, rounds((1.0, 10.0), (3.0, 4.0), (4.0, 8.0)), {})
    # the ratios 0.1, 0.75, 0.5; the medians' ratio would be 3 / 8
    assert line == Row("two nodes", "3 s", "ns-3 8 s", "0.5 (0.1 to 0.75)", "at most 0.5", "7 : 7 sent frames")


def test_a_ratio_beyond_its_bound_is_marked():
    assert row(PAIR, rounds((5.1, 10.0)), {}).bound == "at most 0.5 EXCEEDED"
    assert row(PAIR._replace(bound=None), rounds((5.1, 10.0)), {}).bound == ""


def test_what_others_took_elsewhere_is_a_note_and_ours_has_a_bound_in_seconds():
    alone = Pair("robots", OURS, None, "sent_frames", bound_s=7.0, note="13.7 s elsewhere")
    assert row(alone, rounds((7.2, None)), {}) == Row(
        "robots", "7.2 s", "13.7 s elsewhere", "", "at most 7 s EXCEEDED", "7 sent frames"
    )


def test_a_program_that_is_missing_is_named_and_the_other_is_measured():
    missing = {THEIRS: "ns-3 is not here"}
    line = row(PAIR, rounds((3.0, None)), missing)
    assert line == Row("two nodes", "3 s", "ns-3 is not here", "", "", "7 sent frames")
    line = row(PAIR, rounds((None, 3.0)), {OURS: "ours failed"})
    assert line[1:5] == ("ours failed", "ns-3 3 s", "", "")


def test_the_table_replaces_what_stands_between_its_markers_and_nothing_else():
    page = f"before\n{BEGIN}\nold\n{END}\nafter\n"
    once = written(page, BEGIN, ["One."], [COLUMNS, Row(*"abcdef")])
    assert once == (
        f"before\n{BEGIN}\nOne.\n\n| {' | '.join(COLUMNS)} |\n| --- | --- | --- | --- | --- | --- |\n"
        f"| a | b | c | d | e | f |\n{END}\nafter\n"
    )
    assert written(once, BEGIN, ["One."], [COLUMNS, Row(*"abcdef")]) == once


@pytest.mark.parametrize(("page", "lacking"), [("nothing", BEGIN), (BEGIN, END)])
def test_a_page_without_markers_is_not_written(page: str, lacking: str):
    with pytest.raises(ValueError, match=lacking):
        written(page, BEGIN, [], [COLUMNS])


def test_the_page_has_a_table_of_all_pairs():
    page = README.read_text(encoding="utf-8")
    table = page.partition(BEGIN)[2].partition(END)[0]
    rows = [line.split(" | ")[0].removeprefix("| ") for line in table.splitlines() if line.startswith("|")]
    assert rows == [COLUMNS.name, "---", *(pair.name for pair in PAIRS)]


# ---------------------------------------------------------------- what is run


def test_a_program_of_two_pairs_runs_once_a_round_after_the_first_of_them():
    twin = PAIR._replace(ours=OURS._replace(options=()))
    ran = []
    comparison.round_of([PAIR, twin], {}, lambda program: ran.append(program) or Measured(1.0, {}))
    assert ran == [OURS, THEIRS, twin.ours]


def test_what_is_missing_is_not_run_and_what_fails_is_told_and_not_run_again(capsys):
    ran, missing = [], {OURS: "it is not here"}

    def measure(program):
        ran.append(program)
        raise ProgramError("Ouch")

    for _ in range(2):
        assert comparison.round_of([PAIR], missing, measure) == {}
    assert ran == [THEIRS]
    assert missing == {OURS: "it is not here", THEIRS: "theirs failed"}
    assert capsys.readouterr().err == "theirs failed: Ouch\n"


@pytest.fixture
def short(monkeypatch):
    """Compare one pair, of which ours takes a second a round, without running anything; return what was measured."""
    seen = []

    def measure(program, seed):
        seen.append((program, seed))
        return Measured(1.0 if program is OURS else 4.0, {"sent_frames": 7.0})

    monkeypatch.setattr(comparison, "PAIRS", (PAIR, PAIR._replace(name="others", ours=OURS._replace(options=()))))
    monkeypatch.setattr(comparison, "install", lambda: HERE)
    monkeypatch.setattr(comparison, "measured", measure)
    return seen


def test_programs_alternate_and_a_round_is_a_seed(short, capsys):
    assert comparison.main(["two", "--rounds", "2"]) == 0
    assert short == [(OURS, 1), (THEIRS, 1), (OURS, 2), (THEIRS, 2)]
    printed = capsys.readouterr()
    assert "median of 2 rounds, seeds 1 to 2" in printed.out
    assert "ns-3 3.37" in printed.out
    assert printed.out.splitlines()[-1].startswith("two nodes  1 s   ns-3 4 s  0.25 (0.25 to 0.25)")
    assert printed.err.count("round 2 of 2:    1.000 s  ours --nodes=2") == 1


def test_without_peers_it_says_why_measures_ours_and_ends_well(short, capsys, monkeypatch):
    monkeypatch.setattr(comparison, "install", lambda: HERE | {NS3: Peer(missing="there is no g++")})
    assert comparison.main(["two", "--rounds", "1"]) == 0
    assert [program for program, _ in short] == [OURS]
    printed = capsys.readouterr().out
    assert "ns-3 is not here: there is no g++." in printed
    assert printed.splitlines()[-1].startswith("two nodes  1 s   ns-3 is not here")


def test_a_program_that_fails_is_told_and_ends_it_with_1(short, capsys, monkeypatch):
    def measure(program, seed):
        raise ProgramError("Ouch")

    monkeypatch.setattr(comparison, "measured", measure)
    assert comparison.main(["two", "--rounds", "2"]) == 1
    assert capsys.readouterr().out.splitlines()[-1].startswith("two nodes  ours failed  theirs failed")


def test_the_table_is_kept_on_the_page_if_that_is_asked_for(short, tmp_path, monkeypatch):
    page = tmp_path / "README.md"
    page.write_text(f"{BEGIN}\n{END}\n")
    monkeypatch.setattr(comparison, "README", page)
    comparison.main(["--rounds", "1"])
    assert page.read_text() == f"{BEGIN}\n{END}\n"
    comparison.main(["--rounds", "1", "--write"])
    assert "| two nodes | 1 s | ns-3 4 s | 0.25 (0.25 to 0.25) | at most 0.5 | 7 : 7 sent frames |" in page.read_text()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["flight"], "no pair's name holds 'flight'"),
        (["two", "--write"], "--write writes all pairs"),
        (["--rounds", "0"], "--rounds 0: at least one"),
    ],
)
def test_a_wrong_command_is_told(short, capsys, words, said):
    with pytest.raises(SystemExit):
        comparison.main(words)
    assert said in capsys.readouterr().err
    assert short == []


# ---------------------------------------------------------------- programs


def python(monkeypatch, source: str) -> None:
    """Let every program be this *source*."""
    monkeypatch.setattr(comparison, "command", lambda program, seed: [sys.executable, "-c", source])


def test_the_time_of_a_program_is_what_it_says_or_else_that_of_its_process(monkeypatch):
    python(monkeypatch, """print('noise'); print('{"seconds": 0.001, "sent": 3}')""")
    assert measured(OURS, 1) == Measured(0.001, {"sent": 3})
    python(monkeypatch, """sum(range(3_000_000)); print('{"sent": 3}')""")
    seconds, did = measured(OURS, 1)
    assert seconds > 0.001
    assert did == {"sent": 3}


def test_a_program_that_fails_is_told_with_what_it_said(monkeypatch):
    python(monkeypatch, "raise ValueError('no such node')")
    with pytest.raises(ProgramError, match=r"Traceback(.|\n)*ValueError: no such node$"):
        measured(OURS, 1)


def test_programs_are_told_load_and_seed():
    pairs = [pair for pair in PAIRS if pair.theirs is not None]
    for program in chain.from_iterable((pair.ours, pair.theirs) for pair in pairs):
        line = installation.command(program, 3)
        assert line[-1] == "--seed=3"
        assert tuple(line[-1 - len(program.options) : -1]) == program.options


def test_equal_loads_are_given_to_both():
    for pair in PAIRS:
        if pair.theirs is not None:
            assert set(pair.theirs.options) <= set(pair.ours.options)


def test_what_cannot_be_installed_is_told_in_a_line_each(tmp_path, monkeypatch):
    pip = tmp_path / "python"
    pip.write_text("#!/bin/sh\necho 'WARNING: retrying' >&2\necho 'ERROR: No matching distribution' >&2\nexit 1\n")
    pip.chmod(0o755)
    monkeypatch.setattr(installation, "HOME", tmp_path)
    monkeypatch.setattr(installation, "PYTHON", pip)
    monkeypatch.setenv("PATH", str(tmp_path / "empty"))
    peers = installation.install()
    assert {name: peer.version for name, peer in peers.items()} == {NS3: "", IRSIM: "", GRADYS: ""}
    assert peers[NS3].missing == "Debian has its library as libns3-dev (there is no g++)"
    assert peers[IRSIM].missing == "pip cannot install ir-sim (ERROR: No matching distribution)"


def test_what_is_installed_is_not_installed_again(tmp_path, monkeypatch):
    asked = []

    def run(*line):
        asked.append(line[1])
        return dict(installation.PACKAGES.values())[line[2].split("'")[1]], ""

    monkeypatch.setattr(installation, "HOME", tmp_path)
    monkeypatch.setattr(installation, "PYTHON", tmp_path)
    monkeypatch.setattr(installation, "_run", run)
    monkeypatch.setattr(installation, "NS3_PROGRAMS", ())
    monkeypatch.setattr(installation, "_ns3", lambda: Peer("3.37"))
    assert installation.install()[IRSIM] == Peer("2.12.0")
    assert asked == ["-c", "-c"]


@pytest.mark.slow
@pytest.mark.parametrize("pair", PAIRS, ids=lambda pair: pair.name)
def test_our_programs_run_their_loads_and_tell_what_they_did(pair: Pair, capsys, monkeypatch):
    small = {"nodes": "5", "robots": "5", "seconds": "2", "side": "60"}
    load = dict(option.removeprefix("--").split("=") for option in pair.ours.options)
    if (
        load.get("routing") == "aodv"
        and "to" not in load
        and not waypoints.ONE_HOP.keys() <= AodvSettings.model_fields.keys()
    ):
        pytest.skip("AODV cannot keep payloads to all in one hop yet")
    options = [f"--{name}={small.get(name, value)}" for name, value in load.items()]
    monkeypatch.setattr(sys, "argv", [pair.ours.name, *options, "--seed=1"])
    importlib.import_module(f"benchmarks.peers.{pair.ours.name}").main()
    told = json.loads(capsys.readouterr().out)
    assert told[pair.did] > 0
    assert {"seconds", "setup_s"} < told.keys()
