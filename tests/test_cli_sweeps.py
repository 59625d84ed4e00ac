"""The commands about sweeps and what they leave, as a user types them."""

import ast
import json
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from cosim.results import RunStore
from tests.sweeps import DELAYS, ROBOTS, SLOW, command, digest_of, rows, users_folder, wait_for, written

SWEEP = ("sweep", "sweep.yaml", "--jobs", "1", "-o", "r")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path) -> Iterator[Path]:
    with users_folder(tmp_path):
        yield tmp_path


def told(ended: Any, code: int = 0) -> str:
    """Return what a command has said on stdout, after it ended as it should."""
    assert (ended.code, ended.err) == (code, "")
    return str(ended.out)


def test_shards_in_folders_of_their_own_are_merged(cosim: Any):
    written(DELAYS)
    told(cosim("sweep", "sweep.yaml", "--jobs", "1", "-o", "whole"))
    for number, runs in ((1, 2), (2, 2), (3, 2)):
        out = told(cosim("sweep", "sweep.yaml", "--jobs", "1", "--shard", f"{number}/3"))
        of_shard = f"results/delays-shard-{number}-of-3"
        assert out == f"{runs} runs, 0 of them were there already, in {of_shard}\n"
    shards = [f"results/delays-shard-{number}-of-3" for number in (1, 2, 3)]
    out = told(cosim("results", "merge", "all", *shards))
    assert out == "6 rows added; all: 6 of 6 runs\n"
    assert digest_of(Path("all")) == digest_of(Path("whole"))


def test_the_plan_tells_what_is_there_and_what_is_to_do_and_makes_nothing(cosim: Any):
    written(DELAYS)
    plan = ("sweep", "sweep.yaml", "-o", "r", "--jobs", "2", "--plan")
    before = "6 runs in r: 0 are there, 6 to do; how long that takes is not known before some have been made\n"
    assert told(cosim(*plan)) == before
    assert not Path("r").exists()
    told(cosim("sweep", "sweep.yaml", "-o", "r", "--jobs", "1", "--replicates", "1"))
    middle = told(cosim(*plan))
    assert middle.startswith("6 runs in r: 2 are there, 4 to do, about ")
    assert middle.endswith(" s on 2 processes\n")
    plain = json.loads(told(cosim(*plan, "--json")))
    usual = RunStore(Path("r")).read()["wall_s"].mean()
    assert plain["hours"] == pytest.approx(4 * usual / 2 / 3600)
    assert (plain["runs"], plain["there"], plain["to_do"]) == (6, 2, 4)
    assert len(rows(Path("r"))) == 2
    told(cosim("sweep", "sweep.yaml", "-o", "r", "--jobs", "1"))
    assert told(cosim(*plan)) == "6 runs in r: 6 are there, 0 to do\n"


def test_older_code_is_accepted_by_how_its_digest_begins(cosim: Any, monkeypatch: pytest.MonkeyPatch):
    written(DELAYS)
    sweep = ("sweep", "sweep.yaml", "-o", "r", "--jobs", "1")
    told(cosim(*sweep))
    source = Path("delays.py")
    source.write_text(source.read_text().replace("* 0.5", "* 0.25"))
    monkeypatch.delitem(sys.modules, "delays")
    (code,) = set(RunStore(Path("r")).read()["code"])
    assert "6 to do" in told(cosim(*sweep, "--plan"))
    assert "0 to do" in told(cosim(*sweep, "--plan", "--accept-code", code[:8]))
    assert told(cosim(*sweep, "--accept-code", code[:8])) == "6 runs, 6 of them were there already, in r\n"
    assert set(rows(Path("r"))["code"]) == {code}
    assert told(cosim(*sweep)) == "6 runs, 0 of them were there already, in r\n"
    assert f"6 rows of other settings or code: {code[:12]}" in told(cosim("results", "ls", "r"))
    assert told(cosim("results", "prune", "r", "--dry-run")) == "6 rows of older settings or code are there\n"
    assert told(cosim("results", "prune", "r")) == "6 rows of older settings or code removed\n"
    assert len(RunStore(Path("r")).read()) == 6


@pytest.mark.slow
def test_the_status_is_told_from_another_process(cosim: Any):
    written(SLOW | {"replicates": 400})
    sweep = subprocess.Popen(command("sweep", "sweep.yaml", "--jobs", "2", "-o", "r"), stderr=subprocess.DEVNULL)
    try:
        wait_for(lambda: [*Path("r/runs").glob("*")] or sweep.poll() is not None)
        for _ in range(20):
            running = told(cosim("status", "r"))
            assert running.startswith("r: ")
            assert " of 400 runs; a sweep is running, " in running
            assert " left\n" in running
        ended = cosim("sweep", "sweep.yaml", "--jobs", "1", "-o", "r")
        assert (ended.code, ended.out) == (2, "")
        assert "r: another sweep is writing there, expected a folder of its own\n" in ended.err
    finally:
        sweep.kill()
        sweep.wait()
    found = json.loads(told(cosim("status", "r", "--json")))
    assert (found["running"], found["rate_hz"], found["runs"]) == (False, None, 400)
    assert 0 < found["there"] == len(rows(Path("r"))) < 400


def test_folders_are_listed_and_verified(cosim: Any):
    assert told(cosim("results", "ls")) == "no results there\n"
    written(DELAYS)
    for name in ("a", "b"):
        told(cosim("sweep", "sweep.yaml", "--jobs", "1", "-o", f"results/{name}"))
    listed = told(cosim("results", "ls")).splitlines()
    assert [line.partition(":")[0] for line in listed] == ["results/a", "results/b"]
    assert "6 of 6 runs" in listed[0]
    assert told(cosim("results", "ls", "results/b")).splitlines() == listed[1:]
    assert [each["there"] for each in json.loads(told(cosim("results", "ls", "--json")))] == [6, 6]
    fine = "results/a: all is as it was written\nresults/b: all is as it was written\n"
    assert told(cosim("results", "verify", "results/a", "results/b")) == fine
    (part,) = Path("results/b/runs").glob("*.parquet")
    data = bytearray(part.read_bytes())
    data[len(data) // 2] ^= 1
    part.write_bytes(data)
    out = told(cosim("results", "verify", "results/a", "results/b"), code=1)
    assert out == f"results/a: all is as it was written\n{part}: is not what was written there\n"


def test_a_sweep_with_failures_ends_with_one(cosim: Any):
    written(DELAYS | {"parameters": {"size": 1, "broken": 2}, "replicates": 1})
    ended = cosim("sweep", "sweep.yaml", "--jobs", "1", "-o", "r")
    assert (ended.code, ended.out) == (1, "2 runs, 0 of them were there already, in r\n")
    assert ended.err == "failed: size=2, seed 1: ZeroDivisionError: nobody is there\n"
    assert told(cosim("status", "r")) == "r: 2 of 2 runs, 1 failed\n"
    ended = cosim("sweep", "sweep.yaml", "--jobs", "1", "-o", "r", "--retry-failed", "--fail-fast")
    assert (ended.code, ended.out) == (2, "")
    assert ended.err.endswith(
        "size=2, seed 1: ZeroDivisionError: nobody is there; --fail-fast ends the sweep with it\n"
    )
    assert told(cosim("status", "r")) == "r: 2 of 2 runs, 1 failed\n"


TABLES = DELAYS | {
    "run": "delays:metrics",
    "parameters": {"size": 1, "label": "a"},
    "sweep": {"size": {"path": "size", "values": {"few": 2, "1": 1.0e-05}}, "label": ["1", "no", "a: b", "c d"]},
    "replicates": 2,
}


def repeated(cosim: Any, row: int, *more: str) -> str:
    """Return what the command that is printed for *row* of ``r`` prints."""
    words = shlex.split(told(cosim("results", "command", "r", str(row))))
    begin = {"cosim": [sys.executable, "-m", "cosim.cli"], "python": [sys.executable]}[words[0]]
    return subprocess.run([*begin, *words[1:], *more], capture_output=True, text=True, check=True).stdout


@pytest.mark.slow
@pytest.mark.parametrize("row", [3, 10])
def test_the_command_of_a_row_repeats_its_run_of_a_function(cosim: Any, row: int):
    written(TABLES)
    told(cosim(*SWEEP))
    found = rows(Path("r")).iloc[row]
    assert ast.literal_eval(repeated(cosim, row)) == {name: found[name] for name in ("delay_s", "rounds")}


@pytest.mark.slow
def test_the_command_of_a_row_repeats_its_run_of_robots(cosim: Any):
    network = {"values": {"usual": {}, "slow": {"channel.delay_s": 0.5, "duration_s": 4}}}
    written(ROBOTS | {"sweep": {**ROBOTS["sweep"], "network": network}})
    told(cosim(*SWEEP))
    for row, network in ((13, "usual"), (15, "slow")):
        found = rows(Path("r")).iloc[row]
        again = json.loads(repeated(cosim, row, "--json"))
        assert (found["network"], found["size"], found["calls"]) == (network, 3, 2)
        assert {name: again["metrics"][name] for name in ("heard", "watched_s")} == {
            name: found[name] for name in ("heard", "watched_s")
        }
        assert again["digest"] == found["digest"]


def test_the_command_of_a_row_whose_experiment_was_edited_is_refused(cosim: Any):
    written(DELAYS)
    told(cosim(*SWEEP))
    written(DELAYS | {"parameters": {"size": 1, "more": 1}})
    ended = cosim("results", "command", "r", "1")
    assert (ended.code, ended.out) == (2, "")
    assert ended.err.endswith("sweep.yaml: was edited since row 1 was made: it has no such arm any more\n")
    written(DELAYS | {"sweep": {"size": [2, 3], "other": [1, 2]}, "parameters": {"size": 1, "other": 1}})
    assert "was edited since row 1 was made" in cosim("results", "command", "r", "1").err


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (("sweep", "sweep.yaml", "--shard", "4/3"), "--shard: '4/3' is no shard, expected one such as 3/10"),
        (("sweep", "sweep.yaml", "--shard", "0/3"), "--shard: '0/3' is no shard"),
        (("sweep", "sweep.yaml", "--shard", "1"), "--shard: '1' is no shard"),
        (("sweep", "sweep.yaml", "--run-memory", "2XB"), "'2XB' is no amount of memory, expected one such as 500MB"),
        (("sweep", "sweep.yaml", "--run-memory", "-1"), "'-1' is no amount of memory"),
        (("sweep", "sweep.yaml", "--run-memory", "nan"), "'nan' is no amount of memory"),
        (("sweep", "sweep.yaml", "--run-timeout", "0"), "0.0 is not in the range x>0"),
        (("sweep", "sweep.yaml", "--jobs", "0"), "0 is not in the range x>=1"),
        (("sweep", "sweep.yaml", "--jobs", "1", "--dask", "x:1"), "--jobs: is for processes of this computer"),
        (("sweep", "sweep.yaml", "--accept-code", "ab", "-o", "no"), "--accept-code: 'ab' begins no digests of code"),
        (("sweep", "nowhere.yaml"), "nowhere.yaml"),
        (("status", "nowhere"), "nowhere: holds no results, expected a folder that cosim sweep has written"),
        (("results", "verify", "nowhere"), "nowhere: holds no results"),
        (("results", "verify"), "FOLDERS"),
        (("results", "prune", "nowhere"), "nowhere: holds no results"),
        (("results", "merge", "all", "nowhere"), "nowhere: holds no results"),
        (("results", "command", "nowhere", "0"), "nowhere: holds no results"),
        (("results", "command", "r", "2"), "r: has 2 rows, from 0, expected one of them, not 2"),
        (("results", "command", "r", "-1"), "-1"),
        (("export", "r", "out.txt"), "out.txt: expected a file that ends in .parquet or .csv"),
    ],
)
def test_wrong_input_is_one_line_and_writes_nothing(cosim: Any, words: tuple[str, ...], complaint: str):
    written(DELAYS | {"replicates": 1})
    told(cosim(*SWEEP))
    before = {path: path.read_bytes() for path in Path().rglob("*") if path.is_file() and path.suffix != ".pyc"}
    ended = cosim(*words)
    assert (ended.code, ended.out) == (2, "")
    assert complaint in ended.err
    assert "Traceback" not in ended.err
    assert ended.err.count("\n") == 1
    after = {path: path.read_bytes() for path in Path().rglob("*") if path.is_file() and path.suffix != ".pyc"}
    assert after == before
