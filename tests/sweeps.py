"""What tests of sweeps share: experiments in a folder of a user's own, what they leave, and processes to wait for."""

import json
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import yaml

from cosim.experiment import Experiment, load_experiment
from cosim.results import RunStore
from tests.checkout import DATA

ROBOTS: dict[str, Any] = {
    "name": "calls",
    "scenario": {"duration_s": 5, "protocol": {"use": "beacon:SPEC"}},
    "sweep": {"team.size": [2, 3], "protocol.parameters.calls": [1, 2]},
    "replicates": 2,
}
DELAYS: dict[str, Any] = {
    "name": "delays",
    "run": "delays:metrics",
    "parameters": {"size": 1},
    "sweep": {"size": [2, 3]},
    "replicates": 3,
}
SLOW: dict[str, Any] = {"name": "slow", "run": "delays:slow", "parameters": {"wait_s": 0.3}, "replicates": 12}
OBSERVED: dict[str, Any] = DELAYS | {"run": "delays:observations"}


@contextmanager
def users_folder(folder: Path) -> Iterator[Path]:
    """Work in *folder*, which holds a user's own protocol and functions."""
    with pytest.MonkeyPatch.context() as patch:
        for name in ("beacon.py", "delays.py"):
            shutil.copy(DATA / name, folder)
        for name in ("beacon", "delays"):
            patch.delitem(sys.modules, name, raising=False)
        patch.chdir(folder)
        patch.syspath_prepend(folder)
        yield folder


def written(plain: dict[str, Any]) -> Path:
    """Write the experiment *plain* to a sweep.yaml where we stand."""
    path = Path("sweep.yaml")
    path.write_text(yaml.safe_dump(plain, sort_keys=False))
    return path


def experiment(plain: dict[str, Any], *sets: str) -> Experiment:
    return load_experiment(written(plain), sets)


def rows(folder: Path, table: str = "runs") -> pd.DataFrame:
    """Return what the last sweep into *folder* has made, but for how long it took."""
    return RunStore(folder).present(table).drop(columns="wall_s", errors="ignore")


def digest_of(folder: Path) -> str:
    """Return the rows of both tables as one text, a line each, sorted: what they have, but for how long they took."""
    store = RunStore(folder)
    found = []
    for table in ("runs", "observations"):
        for row in store.present_rows(table).to_pylist():
            had = {name: value for name, value in row.items() if value is not None and name != "wall_s"}
            found.append(f"{table} {json.dumps(had, sort_keys=True)}")
    return "\n".join(sorted(found))


def command(*words: str) -> list[str]:
    return [sys.executable, "-m", "cosim.cli", *words]


def wait_for(condition: Callable[[], Any], seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it never happened"
        time.sleep(0.02)


def children(pid: int) -> list[int]:
    try:
        return [int(each) for each in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    except (FileNotFoundError, ProcessLookupError):
        return []


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False
