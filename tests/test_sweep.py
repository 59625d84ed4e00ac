import importlib
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import yaml

from cosim.errors import UserError
from cosim.experiment import Experiment
from cosim.processes import Limits
from cosim.results import RunStore
from cosim.statistics.intervals import student
from cosim.statistics.stopping import looks
from cosim.sweep import Asked, Choice, Execution, Finished, Shard, run_sweep, run_until
from cosim.upkeep import merge
from tests.sweeps import (
    DELAYS,
    OBSERVED,
    ROBOTS,
    SLOW,
    alive,
    children,
    command,
    digest_of,
    experiment,
    rows,
    users_folder,
    wait_for,
)
from tests.tiers import soak_count


@pytest.fixture(autouse=True)
def folder(tmp_path: Path) -> Iterator[Path]:
    with users_folder(tmp_path):
        yield tmp_path


def test_all_arms_of_a_replicate_share_its_seed(tmp_path: Path):
    done = []
    run_sweep(experiment(ROBOTS, "seed=7"), tmp_path / "r", jobs=1, progress=lambda *_: done.append(1))
    table = rows(tmp_path / "r")
    assert table.groupby("seed")["calls"].count().to_dict() == {7: 4, 8: 4}
    assert (table["seed"] - table["replicate"]).eq(7).all()


def test_a_sweep_of_robots_fills_the_table_of_runs(tmp_path: Path):
    summary = run_sweep(experiment(ROBOTS), tmp_path / "r", jobs=1)
    assert (summary.runs, summary.resumed, summary.failures) == (8, 0, ())
    table = rows(tmp_path / "r")
    assert table[["size", "calls", "replicate"]].to_numpy().tolist() == [
        [size, calls, replicate] for size in (2, 3) for calls in (1, 2) for replicate in (0, 1)
    ]
    # on the ideal channel every call reaches everyone else
    assert table["heard"].tolist() == [size * (size - 1) * calls for size in (2, 3) for calls in (1, 2) for _ in (0, 1)]
    assert table["digest"].nunique() == 8
    assert set(table["status"]) == {"done"}


def test_the_same_sweep_again_has_nothing_to_do(tmp_path: Path):
    run_sweep(experiment(DELAYS), tmp_path / "r", jobs=1)
    before = sorted((tmp_path / "r" / "runs").iterdir())
    summary = run_sweep(experiment(DELAYS), tmp_path / "r", jobs=1)
    assert (summary.runs, summary.resumed) == (6, 6)
    assert sorted((tmp_path / "r" / "runs").iterdir()) == before


def test_more_replicates_and_arms_only_add_what_is_missing(tmp_path: Path):
    run_sweep(experiment(DELAYS), tmp_path / "r", jobs=1)
    summary = run_sweep(experiment(DELAYS | {"sweep": {"size": [2, 3, 4]}, "replicates": 4}), tmp_path / "r", jobs=1)
    assert (summary.runs, summary.resumed) == (12, 6)
    assert rows(tmp_path / "r")["delay_s"].tolist() == [s * 0.5 + seed for s in (2, 3, 4) for seed in (1, 2, 3, 4)]


def edit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, old: str, new: str) -> None:
    source = tmp_path / "delays.py"
    source.write_text(source.read_text().replace(old, new))
    monkeypatch.delitem(sys.modules, "delays")  # as in a new process
    importlib.invalidate_caches()


def test_edited_code_is_run_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    run_sweep(experiment(DELAYS), tmp_path / "r", jobs=1)
    edit(tmp_path, monkeypatch, "* 0.5", "* 0.25")
    assert run_sweep(experiment(DELAYS), tmp_path / "r", jobs=1).resumed == 0
    assert rows(tmp_path / "r")["delay_s"].tolist() == [s * 0.25 + seed for s in (2, 3) for seed in (1, 2, 3)]
    assert len(RunStore(tmp_path / "r").read()) == 12


def test_comments_and_docstrings_are_no_other_code(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    run_sweep(experiment(DELAYS), tmp_path / "r", jobs=1)
    edit(tmp_path, monkeypatch, '"""Return metrics; the seed and the parameters decide them."""', '"""Return."""  # !')
    assert run_sweep(experiment(DELAYS), tmp_path / "r", jobs=1).resumed == 6


def test_what_older_code_has_made_is_kept_if_it_is_accepted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    run_sweep(experiment(DELAYS | {"replicates": 2}), tmp_path / "r", jobs=1)
    (old,) = set(RunStore(tmp_path / "r").read()["code"])
    edit(tmp_path, monkeypatch, "* 0.5", "* 0.25")
    summary = run_sweep(experiment(DELAYS), tmp_path / "r", jobs=1, choice=Choice(accepted=(old,)))
    assert (summary.runs, summary.resumed) == (6, 4)
    assert rows(tmp_path / "r")["delay_s"].tolist() == [2, 3, 3.5, 2.5, 3.5, 3.75]
    assert rows(tmp_path / "r")["code"].eq(old).tolist() == [True, True, False] * 2
    # what the present code has made comes before what is accepted
    assert run_sweep(experiment(DELAYS), tmp_path / "r", jobs=1).resumed == 2
    run_sweep(experiment(DELAYS), tmp_path / "r", jobs=1, choice=Choice(accepted=(old,)))
    assert not rows(tmp_path / "r")["code"].eq(old).any()


def test_a_process_that_has_loaded_what_was_edited_since_makes_no_runs(tmp_path: Path):
    run_sweep(experiment(DELAYS), tmp_path / "r", jobs=1)
    source = tmp_path / "delays.py"
    source.write_text(source.read_text().replace("* 0.5", "* 0.25"))
    with pytest.raises(UserError, match=r"delays\.py: was edited after this process had loaded it: start it anew$"):
        run_sweep(experiment(DELAYS), tmp_path / "r", jobs=1)


def test_a_failed_run_is_a_row_and_the_sweep_goes_on(tmp_path: Path):
    plain = DELAYS | {"parameters": {"size": 1, "broken": 2}}
    summary = run_sweep(experiment(plain), tmp_path / "r", jobs=1)
    assert summary.failures[0] == "size=2, seed 1: ZeroDivisionError: nobody is there"
    assert len(summary.failures) == 3
    table = rows(tmp_path / "r")
    assert table["status"].tolist() == ["failed"] * 3 + ["done"] * 3
    assert table["delay_s"].isna().tolist() == [True] * 3 + [False] * 3


def test_observations_go_to_a_table_of_their_own(tmp_path: Path):
    run_sweep(experiment(DELAYS | {"run": "delays:observations"}), tmp_path / "r", jobs=1)
    seen = RunStore(tmp_path / "r").present("observations")
    assert seen["slots"].tolist() == [
        2 * robot + seed for size in (2, 3) for seed in (1, 2, 3) for robot in range(size)
    ]
    assert seen["size"].tolist() == [2] * 6 + [3] * 9


def test_values_of_several_kinds_share_a_column(tmp_path: Path):
    plain = DELAYS | {"sweep": {"size": {"path": "size", "values": {"two": 2, 3: 3}}}}
    run_sweep(experiment(plain), tmp_path / "r", jobs=1)
    assert rows(tmp_path / "r")["size"].tolist() == ["two"] * 3 + ["3"] * 3


@pytest.mark.slow
def test_the_number_of_jobs_changes_no_row(tmp_path: Path):
    run_sweep(experiment(ROBOTS), tmp_path / "one", jobs=1)
    summary = run_sweep(experiment(ROBOTS), tmp_path / "two", jobs=2)
    assert summary.failures == ()
    pd.testing.assert_frame_equal(rows(tmp_path / "two"), rows(tmp_path / "one"))
    assert digest_of(tmp_path / "two") == digest_of(tmp_path / "one")


def test_progress_counts_what_was_there(tmp_path: Path):
    told: list[tuple[int, int, int]] = []
    run_sweep(experiment(DELAYS | {"replicates": 1}), tmp_path / "r", jobs=1)
    run_sweep(experiment(DELAYS | {"replicates": 2}), tmp_path / "r", jobs=1, progress=lambda *now: told.append(now))
    assert told == [(3, 4, 0), (4, 4, 0)]


def test_an_interrupt_keeps_what_is_finished(tmp_path: Path):
    def interrupt(done: int, total: int, failed: int) -> None:
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_sweep(experiment(DELAYS), tmp_path / "r", jobs=1, progress=interrupt)
    assert len(rows(tmp_path / "r")) == 2
    assert run_sweep(experiment(DELAYS), tmp_path / "r", jobs=1).resumed == 2


def test_a_full_disk_ends_the_sweep_and_keeps_what_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    run_sweep(experiment(DELAYS | {"replicates": 1}), tmp_path / "r", jobs=1)

    def full(path: Path, data: bytes) -> None:
        path.write_text("PAR1 half")
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_bytes", full)
        with pytest.raises(OSError, match="No space left"):
            run_sweep(experiment(DELAYS), tmp_path / "r", jobs=1)
    assert not list((tmp_path / "r").rglob("*.part"))
    assert len(rows(tmp_path / "r")) == 2
    assert run_sweep(experiment(DELAYS), tmp_path / "r", jobs=1).resumed == 2
    assert len(rows(tmp_path / "r")) == 6


def test_input_that_cannot_be_set_up_writes_nothing(tmp_path: Path):
    with pytest.raises(
        UserError, match=r"^sweep\.yaml with size=2, calls=1: floorplan\.map: 'nowhere\.yaml' is neither"
    ):
        run_sweep(experiment(ROBOTS, "floorplan.map=nowhere.yaml"), tmp_path / "r", jobs=1)
    assert not (tmp_path / "r").exists()


def test_the_guard_takes_errors_but_no_interrupts(monkeypatch: pytest.MonkeyPatch):
    asked = experiment(ROBOTS, "protocol.parameters.fail_at_size=2")
    execution = Execution(dict(enumerate(asked.arms)), asked.seed)
    assert execution((0, 0)).error == "RuntimeError: the beacons have broken down"

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("cosim.sweep.simulate", interrupt)
    with pytest.raises(KeyboardInterrupt):
        execution((0, 0))


def _heed_interrupts() -> None:
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@pytest.mark.parametrize("kills", [pytest.param(4, marks=pytest.mark.slow), pytest.param(50, marks=pytest.mark.soak)])
def test_kills_of_a_sweep_and_of_its_workers_change_no_row(
    tmp_path: Path, kills: int, record_property: Callable[[str, int], None]
):
    kills = kills if kills < 10 else soak_count(kills)
    quick = SLOW | {"parameters": {"wait_s": 0.02}, "replicates": 300 * kills, "run": "delays:slowly_observed"}
    run_sweep(experiment(quick), tmp_path / "whole", engine=at_once)
    chance, counts, workers = random.Random(25), {"parent": 0, "worker": 0}, set[int]()
    process = started()
    while sum(counts.values()) < kills:
        if chance.random() < 0.5 or not any(counts.values()):  # otherwise, workers may not have begun yet
            known = {*Path("r/runs").glob("*")}
            wait_for(lambda known=known: {*Path("r/runs").glob("*")} - known)
        time.sleep(chance.uniform(0, 0.5))
        assert process.poll() is None, "it was to be killed before it ended"
        there = children(process.pid)
        workers |= {*there}
        if chance.random() < 0.5:
            process.kill()
            process.wait()
            process = started()
            counts["parent"] += 1
        elif there:
            os.kill(chance.choice(there), signal.SIGKILL)
            counts["worker"] += 1
    workers |= {*children(process.pid)}
    process.kill()
    process.wait()
    wait_for(lambda: not any(map(alive, workers)))
    assert len(rows(tmp_path / "r")) > 0
    assert not [path for path in RunStore(tmp_path / "r").parts.damaged() if "is not what" in path]
    summary = run_sweep(experiment(quick), tmp_path / "r", engine=at_once)
    assert summary.failures == ()
    assert digest_of(tmp_path / "r") == digest_of(tmp_path / "whole")
    assert RunStore(tmp_path / "r").parts.damaged() == []
    for who, count in counts.items():
        record_property(f"kills of a {who}", count)


def started() -> "subprocess.Popen[bytes]":
    """Start the sweep, and wait until its workers are there."""
    words = command("sweep", "sweep.yaml", "--jobs", "2", "-o", "r")
    process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    wait_for(lambda: len(children(process.pid)) == 2 or process.poll() is not None)
    return process


def at_once(execution: Execution, todo: Iterable[Asked], *_: Any) -> Iterator[Finished]:
    """Make runs in this process, and do not sleep: the oracle of those that were killed."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("time.sleep", lambda seconds: None)
        yield from map(execution, todo)


@pytest.mark.slow
def test_an_interrupted_sweep_ends_with_130_and_keeps_what_is_finished(tmp_path: Path):
    Path("sweep.yaml").write_text(yaml.safe_dump(SLOW))
    words = command("sweep", "sweep.yaml", "--jobs", "2", "-o", "r")
    # a shell that runs the tests in the background has them ignore SIGINT, and a process would inherit that
    process = subprocess.Popen(words, stderr=subprocess.PIPE, text=True, preexec_fn=_heed_interrupts)
    wait_for(lambda: list((tmp_path / "r" / "runs").glob("part-*.parquet")))
    os.kill(process.pid, signal.SIGINT)
    _, complaint = process.communicate(timeout=60)
    assert process.returncode == 130
    assert complaint.strip() == "interrupted: what is finished is kept"
    assert 0 < len(rows(tmp_path / "r")) < 12


# ---------------------------------------------------------------- limits, failures, shards


@pytest.mark.slow
def test_limits_hold_with_one_process_and_are_no_part_of_the_key(tmp_path: Path):
    plain = SLOW | {"replicates": 1, "sweep": {"wait_s": [0.01, 60]}}
    summary = run_sweep(experiment(plain), tmp_path / "r", jobs=1, choice=Choice(limits=Limits(0.5)))
    assert summary.failures == ("wait_s=60, seed 1: TimeoutError: took more than 0.5 s",)
    again = run_sweep(experiment(plain), tmp_path / "r", jobs=1)
    assert (again.resumed, again.failures) == (2, summary.failures)


def test_a_run_that_leaves_its_process_is_a_row(tmp_path: Path):
    summary = run_sweep(experiment(SLOW | {"run": "delays:leaving", "replicates": 3}), tmp_path / "r", jobs=1)
    assert summary.failures == ("seed 1: SystemExit: as a script does",)
    assert rows(tmp_path / "r")["status"].tolist() == ["failed", "done", "done"]


BREAKS_ONCE = """
from pathlib import Path
from cosim.experiment import experiment_function

@experiment_function
def breaks(parameters, seed):
    if seed > 1 and not Path("mended").exists():
        raise RuntimeError("not yet")
    return {"delay_s": float(seed)}
"""


@pytest.fixture
def breaking(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    (tmp_path / "breaking.py").write_text(BREAKS_ONCE)
    monkeypatch.delitem(sys.modules, "breaking", raising=False)
    return {"name": "breaking", "run": "breaking:breaks", "replicates": 3}


def test_runs_that_failed_are_made_again_if_one_asks(tmp_path: Path, breaking: dict[str, Any]):
    assert len(run_sweep(experiment(breaking), tmp_path / "r", jobs=1).failures) == 2
    Path("mended").touch()
    assert len(run_sweep(experiment(breaking), tmp_path / "r", jobs=1).failures) == 2
    summary = run_sweep(experiment(breaking), tmp_path / "r", jobs=1, choice=Choice(retry_failed=True))
    assert (summary.resumed, summary.failures) == (1, ())
    assert rows(tmp_path / "r")["delay_s"].tolist() == [1, 2, 3]
    assert len(RunStore(tmp_path / "r").read()) == 3


def test_a_sweep_ends_with_the_first_failure_if_one_asks(tmp_path: Path, breaking: dict[str, Any]):
    told = r"^seed 2: RuntimeError: not yet; --fail-fast ends the sweep with it$"
    with pytest.raises(UserError, match=told):
        run_sweep(experiment(breaking), tmp_path / "r", jobs=1, choice=Choice(fail_fast=True))
    assert rows(tmp_path / "r")["status"].tolist() == ["done", "failed"]


@pytest.mark.parametrize("plain", [OBSERVED, DELAYS, ROBOTS | {"replicates": 4}], ids=lambda plain: plain["name"])
@pytest.mark.parametrize("of", [2, 3])
def test_shards_that_are_merged_are_the_whole_sweep(tmp_path: Path, plain: dict[str, Any], of: int):
    run_sweep(experiment(plain), tmp_path / "whole", jobs=1)
    runs = 0
    for number in range(1, of + 1):
        folder = tmp_path / f"shard{number}"
        runs += run_sweep(experiment(plain), folder, jobs=1, choice=Choice(Shard(number, of))).runs
    assert runs == len(rows(tmp_path / "whole"))
    shards = [RunStore(tmp_path / f"shard{number}") for number in range(1, of + 1)]
    assert merge(RunStore(tmp_path / "merged"), shards) == runs
    assert digest_of(tmp_path / "merged") == digest_of(tmp_path / "whole")
    assert run_sweep(experiment(plain), tmp_path / "merged", jobs=1).resumed == runs


# ---------------------------------------------------------------- until means are precise


NOISY = """
from cosim.experiment import experiment_function


@experiment_function
def metrics(parameters, seed):
    return {"delay_s": 1 + parameters["spread"] * (seed * 7919 % 101 / 101 - 0.5), "rounds": 1}
"""


def noisy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, spread: float, most: int) -> Experiment:
    (tmp_path / "noisy.py").write_text(NOISY)
    monkeypatch.delitem(sys.modules, "noisy", raising=False)
    plain = {"run": "noisy:metrics", "parameters": {"spread": 0.0}, "sweep": {"spread": [0.1, spread]}}
    return experiment(plain | {"name": "noisy", "replicates": most})


def test_a_sweep_ends_when_all_means_are_precise_and_not_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    asked = noisy(tmp_path, monkeypatch, 1.0, 300)
    summary = run_until(asked, tmp_path / "r", {"delay_s": 0.05}, jobs=1)
    table = rows(tmp_path / "r")
    count = len(table) // 2
    assert 10 < count < 300
    assert (summary.runs, summary.lacking) == (2 * count, 0)

    def precise(number: int) -> bool:
        values = table[table["spread"] == 1.0]["delay_s"].head(number)
        half = student(number - 1) * values.std() / number**0.5
        return bool(half / values.mean() <= 0.05 / 1.05)

    assert precise(count)
    assert not any(precise(each) for each in looks(10, 300) if each < count)


def test_a_resumed_sweep_ends_at_the_same_number(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    asked = noisy(tmp_path, monkeypatch, 1.0, 300)
    run_until(asked, tmp_path / "once", {"delay_s": 0.05}, jobs=1)

    def interrupt(done: int, total: int, failed: int) -> None:
        if done == 25:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_until(asked, tmp_path / "r", {"delay_s": 0.05}, jobs=1, progress=interrupt)
    run_sweep(replace(asked, replicates=200), tmp_path / "r", jobs=1)  # more than will be needed
    run_until(asked, tmp_path / "r", {"delay_s": 0.05}, jobs=1)
    pd.testing.assert_frame_equal(rows(tmp_path / "r"), rows(tmp_path / "once"))


def test_a_sweep_that_may_not_have_enough_replicates_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    summary = run_until(noisy(tmp_path, monkeypatch, 1.0, 12), tmp_path / "r", {"delay_s": 0.001}, jobs=1)
    assert (summary.runs, summary.lacking) == (24, 2)
    with pytest.raises(UserError, match=r"^--until-ci: no run has a value of nothing$"):
        run_until(noisy(tmp_path, monkeypatch, 1.0, 12), tmp_path / "r", {"nothing": 0.1}, jobs=1)
    with pytest.raises(UserError, match=r"--until-ci looks at all runs$"):
        run_until(noisy(tmp_path, monkeypatch, 1.0, 12), tmp_path / "r", {}, choice=Choice(Shard(1, 2)))
