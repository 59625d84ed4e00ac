"""What folders of results tell of themselves, and what merging and pruning leave."""

import os
import time
from pathlib import Path
from typing import Any

import pytest

from cosim.errors import UserError
from cosim.results import ReportSettings, RunStore, SweepDescription
from cosim.upkeep import LATELY_S, code_of, content, damaged, merge, prune, status, told_time


def run(seed: int, configuration: str = "c", code: str = "k", status: str = "done") -> dict[str, Any]:
    key = {"configuration": configuration, "seed": seed, "code": code, "replicate": seed - 1}
    return key | {"experiment": "calls", "libraries": "numpy 1", "status": status, "error": None, "wall_s": 0.5}


def described(*configurations: str, **more: Any) -> SweepDescription:
    arms = configurations or ("c",)
    plain = {"experiment": "calls", "source": "sweep.yaml", "axes": {}, "replicates": 4, "report": ReportSettings()}
    told = {"configurations": arms, "codes": ("k",) * len(arms), "labels": ((),) * len(arms)}
    return SweepDescription.model_validate(plain | told | {"libraries": {"k": "numpy 1"}} | more)


def filled(folder: Path, rows: list[dict[str, Any]], told: SweepDescription | None = None) -> RunStore:
    store = RunStore(folder)
    with store.writing():
        store.append(rows, [], [], {})
        store.describe(told or described())
    return store


def seeds(store: RunStore) -> list[int]:
    return sorted(store.read()["seed"].tolist())


@pytest.mark.parametrize(
    ("seconds", "told"),
    [
        (0.3, "0.3 s"),
        (40, "40 s"),
        (119, "120 s"),
        (720, "12 min"),
        (6600, "110 min"),
        (19_800, "5.5 h"),
        (172_800, "2 days"),
        (1e6, "12 days"),
        (1e7, "120 days"),
    ],
)
def test_times_are_told_as_a_person_says_them(seconds: float, told: str):
    assert told_time(seconds) == told


def test_the_status_counts_the_runs_of_the_last_sweep(tmp_path: Path):
    rows = [run(1), run(2, status="failed"), run(3, code="older"), run(9, status="failed"), run(1, "b")]
    store = filled(tmp_path, rows)
    found = status(store)
    assert (found.there, found.runs, found.failed, found.running, found.rate_hz) == (2, 4, 1, False, None)
    assert found.text() == f"{tmp_path}: 2 of 4 runs, 1 failed"


def test_the_status_of_a_running_sweep_tells_its_rate_and_what_is_left(tmp_path: Path):
    store = filled(tmp_path, [run(1)], described(replicates=10))
    now = time.time()
    (old,) = store.parts.whole()
    os.utime(old, (now - LATELY_S - 60, now - LATELY_S - 60))
    with store.writing():
        store.append([run(2), run(3), run(4)], [], [], {})
        found = status(RunStore(tmp_path))
    assert found.running
    assert found.rate_hz == pytest.approx(3 / LATELY_S, rel=0.05)
    assert found.text().startswith(f"{tmp_path}: 4 of 10 runs; a sweep is running, 0.01 runs/s, about 10 min left")
    with store.writing():
        for part in store.parts.whole():
            os.utime(part, (now + 60, now + 60))  # a file server's clock
        assert status(RunStore(tmp_path)).rate_hz == 4.0


def test_the_content_tells_what_other_codes_have_made(tmp_path: Path):
    store = filled(tmp_path, [run(1), run(2, code="older"), run(3, code="older"), run(1, "b")])
    found = content(store)
    assert found.others == {("older", "numpy 1"): 2, ("k", "numpy 1"): 1}
    assert found.files == 1
    assert found.text().splitlines()[1:] == [
        "    2 rows of other settings or code: older numpy 1",
        "    1 rows of other settings or code: k numpy 1",
    ]


def test_what_does_not_belong_to_the_last_sweep_is_pruned(tmp_path: Path):
    store = filled(tmp_path, [run(1), run(2, code="older"), run(1, "b"), run(7)])
    assert prune(store, dry_run=True) == 3
    assert len(store.read()) == 4
    assert prune(store) == 3
    assert store.read()["seed"].tolist() == [1]
    assert damaged(store) == []
    assert prune(store) == 0


def test_a_row_of_accepted_code_is_not_pruned(tmp_path: Path):
    store = filled(tmp_path, [run(1, code="older"), run(2, code="older"), run(2)], described(accepted=("older",)))
    assert prune(store) == 1
    assert sorted(store.read()[["seed", "code"]].to_numpy().tolist()) == [[1, "older"], [2, "k"]]


def test_folders_of_one_sweep_are_merged_and_merging_again_adds_nothing(tmp_path: Path):
    stores = [filled(tmp_path / name, [run(each) for each in some]) for name, some in (("a", (1, 2)), ("b", (2, 3)))]
    into = RunStore(tmp_path / "all")
    assert merge(into, stores) == 3
    assert merge(into, stores) == 0
    assert seeds(into) == [1, 2, 3]
    assert damaged(into) == []
    assert status(into).there == 3


def test_more_replicates_on_one_computer_are_kept(tmp_path: Path):
    stores = [filled(tmp_path / "a", [run(1)]), filled(tmp_path / "b", [run(6)], described(replicates=6))]
    merge(RunStore(tmp_path / "all"), stores)
    assert status(RunStore(tmp_path / "all")).runs == 6


@pytest.mark.parametrize(
    ("other", "told"),
    [
        (described("b"), "b: is another sweep than {a}: other settings or arms"),
        (described(experiment="other"), "b: is another sweep than {a}: other settings or arms"),
        (described(seed=2), "b: is another sweep than {a}: it begins with another seed"),
        (
            described(codes=("new",), libraries={"new": "numpy 2"}),
            "b: was made by other code, or with other libraries (numpy 2)",
        ),
    ],
)
def test_folders_of_other_sweeps_are_not_merged(tmp_path: Path, other: SweepDescription, told: str):
    stores = [filled(tmp_path / "a", [run(1)]), filled(tmp_path / "b", [run(2)], other)]
    with pytest.raises(UserError) as raised:
        merge(RunStore(tmp_path / "all"), stores)
    assert str(raised.value) == f"{tmp_path}/{told.format(a=tmp_path / 'a')}"
    assert not (tmp_path / "all").exists()


def test_a_folder_that_holds_another_sweep_is_not_merged_into(tmp_path: Path):
    stores = [filled(tmp_path / "a", [run(1)])]
    into = filled(tmp_path / "all", [run(1, "b")], described("b"))
    with pytest.raises(UserError, match=r"all: holds another sweep, expected a folder of its own$"):
        merge(into, stores)


def test_codes_go_by_how_they_begin(tmp_path: Path):
    store = filled(tmp_path, [run(1, code="abc1"), run(2, code="abd2")])
    assert code_of(store, "abc") == "abc1"
    for start, count in (("ab", "2"), ("x", "no")):
        with pytest.raises(UserError, match=f"^--accept-code: '{start}' begins {count} digests of code, expected one"):
            code_of(store, start)


def test_a_folder_that_is_being_written_is_not_verified(tmp_path: Path):
    store = filled(tmp_path, [run(1)])
    with store.writing(), pytest.raises(UserError, match=r"a sweep is writing there: verify it when that has ended$"):
        damaged(RunStore(tmp_path))
    assert damaged(store) == []


def test_what_another_process_merges_meanwhile_is_looked_for_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    store = filled(tmp_path, [run(1)])
    read, failed = type(store.parts).read, []

    def reading(*given: Any) -> Any:
        if not failed:
            failed.append(1)
            raise FileNotFoundError(2, "No such file or directory")
        return read(*given)

    monkeypatch.setattr(type(store.parts), "read", reading)
    assert status(store).there == 1
    assert failed
