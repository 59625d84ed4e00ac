import importlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import yaml

from cosim.cluster import on_cluster
from cosim.errors import UserError
from cosim.experiment import Experiment, load_experiment
from cosim.processes import NO_LIMITS
from cosim.results import RunStore
from cosim.statistics.intervals import student
from cosim.statistics.stopping import looks
from cosim.sweep import Choice, Execution, Shard, run_sweep, run_until
from tests.checkout import DATA

ROBOTS: dict[str, Any] = {
    "name": "calls",
    "scenario": {"duration_s": 5, "protocol": {"use": "beacon:SPEC"}},
    "sweep": {"team.size": [2, 3], "protocol.parameters.calls": [1, 2]},
    "replicates": 2,
}
DELAYS = {
    "name": "delays",
    "run": "delays:metrics",
    "parameters": {"size": 1},
    "sweep": {"size": [2, 3]},
    "replicates": 3,
}


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Work in a folder that holds a user's own protocol and functions."""
    for name in ("beacon.py", "delays.py"):
        shutil.copy(DATA / name, tmp_path)
    for name in ("beacon", "delays"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path


def experiment(plain: dict[str, Any], *sets: str) -> Experiment:
    path = Path("sweep.yaml")
    path.write_text(yaml.safe_dump(plain, sort_keys=False))
    return load_experiment(path, sets)


def rows(folder: Path) -> pd.DataFrame:
    return RunStore(folder).present().drop(columns="wall_s")


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


def _command(*words: str) -> list[str]:
    return [sys.executable, "-m", "cosim.cli", *words]


def _wait_for(condition: Any, seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it never happened"
        time.sleep(0.02)


def _alive(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return False
    return state != "Z"


def _heed_interrupts() -> None:
    signal.signal(signal.SIGINT, signal.SIG_DFL)


SLOW = {"name": "slow", "run": "delays:slow", "parameters": {"wait_s": 0.3}, "replicates": 12}


@pytest.mark.slow
def test_a_killed_sweep_is_finished_by_the_same_command(tmp_path: Path):
    Path("sweep.yaml").write_text(yaml.safe_dump(SLOW))
    command = _command("sweep", "sweep.yaml", "--jobs", "2", "-o", "r")
    process = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    _wait_for(lambda: list((tmp_path / "r" / "runs").glob("part-*.parquet")))
    workers = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    process.kill()
    process.wait()
    kept = len(rows(tmp_path / "r"))
    assert 0 < kept < 12
    again = subprocess.run(command, capture_output=True, text=True, check=True)
    assert again.stdout == f"12 runs, {kept} of them were there already, in r\n"
    table = rows(tmp_path / "r")
    assert table["seed"].tolist() == list(range(1, 13))
    assert not [path for path in (tmp_path / "r").rglob("*") if path.name.endswith(".part")]
    _wait_for(lambda: not any(_alive(int(pid)) for pid in workers), 10)


@pytest.mark.slow
def test_an_interrupted_sweep_ends_with_130_and_keeps_what_is_finished(tmp_path: Path):
    Path("sweep.yaml").write_text(yaml.safe_dump(SLOW))
    command = _command("sweep", "sweep.yaml", "--jobs", "2", "-o", "r")
    # a shell that runs the tests in the background has them ignore SIGINT, and a process would inherit that
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, preexec_fn=_heed_interrupts)
    _wait_for(lambda: list((tmp_path / "r" / "runs").glob("part-*.parquet")))
    os.kill(process.pid, signal.SIGINT)
    _, complaint = process.communicate(timeout=60)
    assert process.returncode == 130
    assert complaint.strip() == "interrupted: what is finished is kept"
    assert 0 < len(rows(tmp_path / "r")) < 12


# ---------------------------------------------------------------- many machines


@pytest.fixture(scope="module")
def dask_address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Give the address of a Dask scheduler with two workers, all processes on loopback in a folder of their own."""
    distributed = pytest.importorskip("distributed", reason="sweeps on a cluster need the extra cluster")
    home = tmp_path_factory.mktemp("cluster")
    for name in ("beacon.py", "delays.py"):
        shutil.copy(DATA / name, home)
    told, words = home / "scheduler.json", ("--host", "127.0.0.1", "--no-dashboard", "--scheduler-file")
    alone = ("--no-nanny", "--nthreads", "1", "--local-directory", str(home))
    roles = [("dask_scheduler", "--port", "0"), ("dask_worker", *alone), ("dask_worker", *alone)]
    with (home / "log").open("w") as log:
        started = [
            subprocess.Popen(
                [sys.executable, "-m", f"distributed.cli.{role}", *words, str(told), *more], cwd=home, stderr=log
            )
            for role, *more in roles
        ]
    try:
        _wait_for(lambda: told.is_file() and told.read_text().endswith("}"))
        address = str(json.loads(told.read_text())["address"])
        with distributed.Client(address, set_as_default=False) as client:
            client.wait_for_workers(2, 60)
        yield address
    finally:
        for process in started:
            process.kill()
            process.wait()


@pytest.mark.slow
def test_the_workers_of_a_cluster_give_the_rows_of_one_process(tmp_path: Path, dask_address: str):
    Path("hall.yaml").write_text(yaml.safe_dump({"bounds_m": [0, 0, 9, 4]}))  # the workers stand in another folder
    robots = experiment(ROBOTS | {"scenario": {**ROBOTS["scenario"], "floorplan": {"map": "hall.yaml"}}})
    run_sweep(robots, tmp_path / "one", jobs=1)
    with on_cluster(dask_address) as engine:
        assert run_sweep(robots, tmp_path / "many", engine=engine).failures == ()
    pd.testing.assert_frame_equal(rows(tmp_path / "many"), rows(tmp_path / "one"))


@pytest.mark.slow
def test_an_interrupt_leaves_the_cluster_nothing_to_do(tmp_path: Path, dask_address: str):
    def interrupt(done: int, total: int, failed: int) -> None:
        if done == 2:
            raise KeyboardInterrupt

    slow = experiment(SLOW | {"replicates": 1000})
    with pytest.raises(KeyboardInterrupt), on_cluster(dask_address) as engine:
        run_sweep(slow, tmp_path / "r", engine=engine, progress=interrupt)
    assert len(rows(tmp_path / "r")) == 2
    distributed = pytest.importorskip("distributed")

    def idle() -> bool:
        try:
            with distributed.Client(dask_address, set_as_default=False) as client:
                return not any(client.processing().values())
        except AssertionError:  # distributed's own, while the scheduler is busy with what was cancelled
            return False

    _wait_for(idle)  # two workers would take 150 s


@pytest.mark.slow
def test_a_busy_scheduler_is_asked_again(monkeypatch: pytest.MonkeyPatch, dask_address: str):
    distributed = pytest.importorskip("distributed")
    client, fails = distributed.Client, [2]

    def asked(*given: Any, **named: Any) -> Any:
        fails[0] -= 1
        assert fails[0] < 0
        return client(*given, **named)

    monkeypatch.setattr(distributed, "Client", asked)
    with on_cluster(dask_address) as engine:
        assert len(list(engine(Execution({}, 1), [], 0, lambda: None, NO_LIMITS))) == 0
    fails[0] = 100
    with pytest.raises(UserError, match="the scheduler is too busy to answer"), on_cluster(dask_address):
        pass


@pytest.mark.slow
def test_a_worker_with_other_code_is_refused_by_name(tmp_path: Path, dask_address: str):
    source = tmp_path / "delays.py"
    source.write_text(source.read_text().replace("* 0.5", "* 0.25"))
    pattern = r"^a worker on \S+ has others than the sweep began with: delays$"
    with pytest.raises(UserError, match=pattern), on_cluster(dask_address) as engine:
        run_sweep(experiment(DELAYS), tmp_path / "r", engine=engine)
    assert len(rows(tmp_path / "r")) == 0


def test_what_a_cluster_needs_and_lacks_is_told(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("cosim.installed.find_spec", lambda name: None)
    told = r"^sweeps on a cluster need what is not installed here: pip install 'distributed>=2024.8'$"
    with pytest.raises(UserError, match=told), on_cluster("127.0.0.1:1"):
        pass


@pytest.mark.slow
def test_an_address_where_no_scheduler_answers_is_told(monkeypatch: pytest.MonkeyPatch):
    pytest.importorskip("distributed", reason="sweeps on a cluster need the extra cluster")
    monkeypatch.setattr("cosim.cluster.WAIT_S", 0.2)
    for address in ("127.0.0.1:1", "nothing://", ""):
        told = f"^--dask {address}: no Dask scheduler answers there: "
        with pytest.raises(UserError, match=told), on_cluster(address):
            pass


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
