"""Sweeps on a Dask cluster: the same rows, whatever becomes of its workers."""

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from time import sleep
from typing import Any

import pandas as pd
import pytest
import yaml

from cosim.cluster import on_cluster
from cosim.errors import UserError
from cosim.processes import NO_LIMITS, Limits
from cosim.sweep import Choice, Execution, run_sweep
from tests.checkout import DATA
from tests.sweeps import DELAYS, ROBOTS, SLOW, digest_of, experiment, rows, users_folder, wait_for


@pytest.fixture(autouse=True)
def folder(tmp_path: Path) -> Iterator[Path]:
    with users_folder(tmp_path):
        yield tmp_path


@pytest.fixture(scope="module")
def dask_address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Give the address of a Dask scheduler with two workers, all processes on loopback in a folder of their own."""
    distributed = pytest.importorskip("distributed", reason="sweeps on a cluster need the extra cluster")
    home = tmp_path_factory.mktemp("cluster")
    for name in ("beacon.py", "delays.py"):
        shutil.copy(DATA / name, home)
    told, words = home / "scheduler.json", ("--host", "127.0.0.1", "--no-dashboard", "--scheduler-file")
    alone = ("--nthreads", "1", "--local-directory", str(home))
    roles = [("dask_scheduler", "--port", "0"), ("dask_worker", *alone), ("dask_worker", *alone)]
    with (home / "log").open("w") as log:
        started = [
            subprocess.Popen(
                [sys.executable, "-m", f"distributed.cli.{role}", *words, str(told), *more], cwd=home, stderr=log
            )
            for role, *more in roles
        ]
    try:
        wait_for(lambda: told.is_file() and told.read_text().endswith("}"))
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

    wait_for(idle)  # two workers would take 150 s


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


@pytest.mark.slow
def test_workers_that_are_killed_are_replaced_and_their_runs_made_again(tmp_path: Path, dask_address: str):
    distributed = pytest.importorskip("distributed")
    killed = []

    def kill(done: int, total: int, failed: int) -> None:
        if done in (8, 30):
            with distributed.Client(dask_address, set_as_default=False) as client:
                client.wait_for_workers(2, 60)  # the one that was killed before is back
                sleep(0.5)  # batches that it has made are here, not looked at yet
                pid = sorted(client.run(os.getpid).values())[0]
                os.kill(pid, signal.SIGKILL)
                wait_for(lambda: pid not in client.run(os.getpid, on_error="ignore").values())
            killed.append(pid)

    quick = experiment(SLOW | {"parameters": {"wait_s": 0.05}, "replicates": 60})
    run_sweep(quick, tmp_path / "one", jobs=1)
    with on_cluster(dask_address) as engine:
        assert run_sweep(quick, tmp_path / "many", engine=engine, progress=kill).failures == ()
    assert len(set(killed)) == 2
    assert digest_of(tmp_path / "many") == digest_of(tmp_path / "one")


@pytest.mark.slow
def test_limits_hold_on_a_cluster_and_are_no_part_of_the_key(tmp_path: Path, dask_address: str):
    plain = SLOW | {"replicates": 2, "sweep": {"wait_s": [0.01, 60]}}
    with on_cluster(dask_address) as engine:
        summary = run_sweep(experiment(plain), tmp_path / "r", engine=engine, choice=Choice(limits=Limits(1.0)))
    told = "TimeoutError: took more than 1 s"
    assert summary.failures == (f"wait_s=60, seed 1: {told}", f"wait_s=60, seed 2: {told}")
    assert rows(tmp_path / "r")["status"].tolist() == ["done"] * 2 + ["failed"] * 2
    assert run_sweep(experiment(plain), tmp_path / "r", jobs=1).resumed == 4
