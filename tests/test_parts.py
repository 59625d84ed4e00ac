"""What is kept survives: lost power, damage of any file, and killed writers; and no row is ever read as another."""

import hashlib
import os
import random
import shutil
import stat
import subprocess
import sys
from collections.abc import Callable, Iterator
from itertools import product
from pathlib import Path
from typing import Any

import pytest

from cosim.columns import table_of
from cosim.errors import UserError
from cosim.experiment import Experiment
from cosim.parts import MINUTE_S, Key, Parts
from cosim.results import FIXED, OBSERVATION_FIXED, ReportSettings, RunStore, SweepDescription
from cosim.sweep import Choice, run_sweep
from cosim.trace import Field
from cosim.upkeep import content
from tests.sweeps import OBSERVED, digest_of, experiment, users_folder
from tests.tiers import soak_count

Row = dict[str, Any]


def run(seed: int, **more: Any) -> Row:
    key = {"configuration": "c", "seed": seed, "code": "k", "replicate": seed - 1}
    fixed = {"experiment": "calls", "status": "done", "error": None, "wall_s": 0.5, "digest": f"d{seed}"}
    return key | fixed | {"libraries": "numpy 1", "heard": 1.5 * seed} | more


def seen(seed: int, *robots: int) -> list[Row]:
    key = {"configuration": "c", "seed": seed, "code": "k", "replicate": seed - 1}
    return [key | {"robot": robot, "slots": 10 * seed + robot} for robot in robots]


HEARD = Field("heard", "float", "1", "payloads heard", optional=True)
COLUMNS = {
    "runs": [*FIXED, HEARD],
    "observations": [*OBSERVATION_FIXED, *(Field(name, "int", "", "", optional=True) for name in ("robot", "slots"))],
}


def added(parts: Parts, seed: int, robots: int = 0, **more: Any) -> Path:
    tables = {"runs": table_of([run(seed, **more)], COLUMNS["runs"], {})}
    if robots:
        tables["observations"] = table_of(seen(seed, *range(robots)), COLUMNS["observations"], {})
    return parts.add(tables)


@pytest.fixture
def parts(tmp_path: Path) -> Parts:
    for table in ("runs", "observations"):
        (tmp_path / table).mkdir()
    return Parts(tmp_path)


def seeds(parts: Parts, table: str = "runs") -> list[int]:
    return [seed for each in parts.tables(table) for seed in each["seed"].to_pylist()]


# ---------------------------------------------------------------- merging


def test_parts_of_a_minute_are_merged_into_one_as_old_as_the_last(parts: Parts):
    for seed, written in ((1, 0.0), (2, 10.0), (3, 59.0), (4, 60.0), (5, 119.0), (6, 120.0)):
        os.utime(added(parts, seed, robots=seed % 2), (written, written))
    parts.merge_minutes(COLUMNS, before_s=2 * MINUTE_S)
    assert [each.stat().st_mtime for each in parts.whole()] == [120.0, 59.0, 119.0]
    assert seeds(parts) == [6, 1, 2, 3, 4, 5]
    assert seeds(parts, "observations") == [1, 3, 5]
    assert parts.damaged() == []


def test_a_minute_that_has_not_ended_is_left_alone(parts: Parts):
    for seed, written in ((1, 60.0), (2, 61.0)):
        os.utime(added(parts, seed), (written, written))
    parts.merge_minutes(COLUMNS, before_s=119.0)
    assert len(parts.whole()) == 2
    parts.merge_minutes(COLUMNS, before_s=120.0)
    assert len(parts.whole()) == 1


def test_a_minute_with_many_runs_is_merged_into_parts_that_fit_into_memory(
    parts: Parts, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("cosim.parts.MOST_ROWS", 3)
    for seed in range(1, 8):
        os.utime(added(parts, seed, robots=seed), (0, 0))
    parts.merge_minutes(COLUMNS)
    assert [each["seed"].to_pylist() for each in parts.tables("runs")] == [[7], [1, 2, 3], [4, 5, 6]]
    assert sorted(seeds(parts, "observations")) == [seed for seed in range(1, 8) for _ in range(seed)]
    before = parts.whole()
    parts.merge_minutes(COLUMNS)
    assert parts.whole() == before  # nothing is written twice


def test_parts_that_tell_different_origins_are_not_merged(parts: Parts):
    for seed, commit in ((1, "a"), (2, "b"), (3, "a")):
        part = parts.add({"runs": table_of([run(seed)], COLUMNS["runs"], {"commit": commit})})
        os.utime(part, (0, 0))
    parts.merge_minutes(COLUMNS)
    told = {parts.schema(part).metadata[b"commit"]: [key[1] for key in parts.keys(part)] for part in parts.whole()}
    assert told == {b"a": [1, 3], b"b": [2]}


THREADS = """
import os, sys
from pathlib import Path
import pyarrow.parquet
from cosim.parts import Parts
before = os.listdir("/proc/self/task")
parts = Parts(Path(sys.argv[1]))
for part in parts.files("runs"):
    assert parts.read(part).num_rows == 1 and len(parts.schema(part))
print(len(os.listdir("/proc/self/task")) - len(before))
"""


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="no such list of threads")
def test_reading_parts_starts_no_thread_that_could_abort_a_process_that_ends(parts: Parts):
    added(parts, 1)
    command = [sys.executable, "-c", THREADS, str(parts.folder)]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout == "0\n"


def test_what_a_writer_killed_while_merging_left_twice_is_read_once_and_cleared_away(
    parts: Parts, monkeypatch: pytest.MonkeyPatch
):
    old = [added(parts, seed, robots=2) for seed in (1, 2)]
    with monkeypatch.context() as patch:
        patch.setattr(Parts, "remove", lambda *_: None)  # killed before it
        parts.merge(old, COLUMNS)
    assert len(parts.whole()) == 3
    assert (seeds(parts), seeds(parts, "observations")) == ([1, 2], [1, 1, 2, 2])
    parts.tidy()
    assert len(parts.whole()) == 1
    assert (seeds(parts), seeds(parts, "observations")) == ([1, 2], [1, 1, 2, 2])
    assert parts.damaged() == []


def test_rows_are_dropped_by_their_keys(parts: Parts):
    merged = [added(parts, seed, robots=1) for seed in (1, 2, 3)]
    parts.merge(merged, COLUMNS)
    added(parts, 4, robots=1)
    keys: set[Key] = {("c", 2, "k"), ("c", 4, "k")}
    parts.drop(keys, COLUMNS)
    assert (seeds(parts), seeds(parts, "observations")) == ([1, 3], [1, 3])
    assert parts.damaged() == []


def test_each_row_of_another_folder_is_taken_once(parts: Parts, tmp_path: Path):
    other = Parts(tmp_path / "other")
    for table in ("runs", "observations"):
        (tmp_path / "other" / table).mkdir(parents=True)
    added(parts, 1, robots=1)
    other.merge([added(other, seed, robots=seed) for seed in (1, 2)], COLUMNS)
    added(other, 3)
    there: set[Key] = {("c", 1, "k")}
    for _ in range(2):
        parts.take(other, COLUMNS, there)
        assert sorted(seed for _, seed, _ in there) == [1, 2, 3]
    assert (seeds(parts), seeds(parts, "observations")) == ([1, 2, 3], [1, 2, 2])


# ---------------------------------------------------------------- reading while another process merges


class Meanwhile:
    """Lets another process act at an instant of a read: before or after it looks into the folder or a file."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, at: int, act: Callable[[], None]) -> None:
        self.acted = False
        self._left, self._act = at, act
        for name in ("files", "read", "schema"):
            monkeypatch.setattr(Parts, name, self._around(getattr(Parts, name)))

    def _around(self, look: Callable[..., Any]) -> Callable[..., Any]:
        def looking(*given: Any, **named: Any) -> Any:
            self._pass()
            found = look(*given, **named)
            self._pass()
            return found

        return looking

    def _pass(self) -> None:
        if self._left == 0 and not self.acted:
            self.acted = True
            self._act()
        self._left -= 1


@pytest.mark.parametrize("seeds", [(1, 2, 3), (2, 3)])  # of the run with seed 1 nothing was observed
@pytest.mark.parametrize("table", ["runs", "observations"])
def test_who_reads_while_parts_are_merged_misses_nothing(
    table: str, seeds: tuple[int, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    expected = {"runs": [*seeds], "observations": [2, 3, 3]}[table]
    for instant in range(100):
        folder = tmp_path / f"{instant}"
        for each in ("runs", "observations"):
            (folder / each).mkdir(parents=True)
        parts, other = Parts(folder), Parts(folder)
        merged = [added(parts, seed, robots=seed - 1) for seed in seeds]
        with monkeypatch.context() as patch:
            meanwhile = Meanwhile(patch, instant, lambda: other.merge(merged, COLUMNS))  # noqa: B023  # called within
            found = RunStore(folder).rows(table)
        assert sorted(found["seed"].to_pylist()) == expected, instant
        if not meanwhile.acted:
            break
    assert instant > 10  # instants at which it was done


@pytest.mark.parametrize("table", ["runs", "observations"])
def test_who_asks_for_columns_while_parts_are_merged_misses_none(
    table: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    for instant in range(100):
        folder = tmp_path / f"{instant}"
        for each in ("runs", "observations"):
            (folder / each).mkdir(parents=True)
        parts, other = Parts(folder), Parts(folder)
        merged = [added(parts, seed, robots=seed) for seed in (1, 2, 3)]
        with monkeypatch.context() as patch:
            meanwhile = Meanwhile(patch, instant, lambda: other.merge(merged, COLUMNS))  # noqa: B023  # called within
            found = RunStore(folder).columns_of(table)
        assert [field.name for field in found] == [field.name for field in COLUMNS[table]], instant
        if not meanwhile.acted:
            break
    assert instant > 5  # instants at which it was done


def test_in_the_middle_of_a_merge_a_run_counts_once(parts: Parts, monkeypatch: pytest.MonkeyPatch):
    """Its row is in the new part and still in an old one."""
    store = RunStore(parts.folder)
    store.describe(described(2))
    old = [added(parts, seed, **FAILED) for seed in (1, 2, 3)]  # the last one is of no replicate
    monkeypatch.setattr(Parts, "remove", lambda *_: None)
    parts.merge(old, COLUMNS)
    assert len(parts.whole()) == 4
    assert [row["seed"] for row in store.failed(described(2))] == [1, 2]
    told = content(store)
    assert (told.status.there, told.status.failed, list(told.others.values())) == (2, 2, [1])


def test_a_folder_that_something_empties_is_told_of(parts: Parts, monkeypatch: pytest.MonkeyPatch):
    def gone(*_: Any) -> None:
        raise FileNotFoundError(2, "No such file or directory")

    added(parts, 1)
    monkeypatch.setattr(Parts, "read", gone)
    with pytest.raises(UserError, match=r"parts went while they were read, 5 times; is something removing them\?$"):
        RunStore(parts.folder).rows("runs")


# ---------------------------------------------------------------- the manifest


def test_sha256sum_reads_the_manifest(parts: Parts):
    added(parts, 1, robots=1)
    added(parts, 2)
    lines = (parts.folder / "SHA256SUMS").read_text().splitlines()
    assert len(lines) == 3
    for line in lines:
        digest, _, path = line.partition("  ")
        assert hashlib.sha256((parts.folder / path).read_bytes()).hexdigest() == digest


@pytest.mark.parametrize("tail", ["0123abc", "no sense\n", f"{'0' * 64}  runs/part-00000-aa"])
def test_a_manifest_that_was_cut_short_is_written_anew(parts: Parts, tail: str):
    added(parts, 1, robots=1)
    manifest = parts.folder / "SHA256SUMS"
    with manifest.open("a") as file:
        file.write(tail)
    parts.tidy()
    added(parts, 2)
    assert parts.damaged() == []
    assert len(manifest.read_text().splitlines()) == 3


def test_damage_is_told_by_name_and_kind(parts: Parts):
    first, second, third, fourth = (added(parts, seed, robots=1) for seed in (1, 2, 3, 4))
    first.write_bytes(first.read_bytes()[:-1])
    second.unlink()
    (parts.folder / "observations" / third.name).unlink()
    observed, lines = parts.folder / "observations" / fourth.name, parts.folder / "SHA256SUMS"
    kept = [line for line in lines.read_text().splitlines(keepends=True) if f"observations/{observed.name}" not in line]
    lines.write_text("".join(kept))
    orphan = f"{parts.folder / 'observations' / second.name}: its runs are gone"
    assert sorted(parts.damaged()) == sorted(
        [
            f"{first}: is not what was written there",
            orphan,
            f"{second}: is gone",
            f"{third}: its observations are gone",
            f"{parts.folder / 'observations' / third.name}: is gone",
            f"{observed}: is not listed in SHA256SUMS",
        ]
    )


# ---------------------------------------------------------------- lost power


class Disk:
    """What a disk may hold of a folder if the power fails, at any time while it is written.

    Of a file: its bytes as of the last fsync (none, if there was none), or all that was written. Of a folder: its
    entries as of its last fsync, or all. Everything else is not promised to a program, and so not built here.
    """

    def __init__(self, folder: Path, apart: Path, patch: pytest.MonkeyPatch) -> None:
        self._folder = folder
        self._apart = apart  # links there keep numbers of files from being given again
        apart.mkdir()
        self._contents: dict[int, bytes] = {}
        self._entries: dict[str, dict[str, int]] = {}
        self.kept: frozenset[int] = frozenset()
        """What the program has been told is kept."""
        self.gone: frozenset[int] = frozenset()
        """What the program has been told is dropped."""
        self.states: dict[frozenset[tuple[str, bytes]], tuple[frozenset[int], frozenset[int]]] = {}
        """What may be found there, as files by their paths, and what must be found in it, and what must not."""
        for place, name in ((Path, "replace"), (Path, "unlink"), (Path, "mkdir"), (os, "fsync")):
            patch.setattr(place, name, self._watched(getattr(place, name)))

    def _watched(self, function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*given: Any, **named: Any) -> Any:
            self.look()
            answer = function(*given, **named)
            if function.__name__ == "fsync":
                self._synced(os.fstat(given[0]))
            self.look()
            return answer

        return call

    def _live(self) -> dict[str, dict[str, int]]:
        found: dict[str, dict[str, int]] = {}
        for name in (".", "runs", "observations"):
            if (self._folder / name).is_dir():
                here = [each for each in os.scandir(self._folder / name) if each.name != ".lock"]
                found[name] = {each.name: each.inode() for each in here}
                for each in here:
                    if each.is_file() and not (self._apart / str(each.inode())).exists():
                        os.link(each.path, self._apart / str(each.inode()))
        return found

    def _synced(self, status: os.stat_result) -> None:
        live = self._live()
        if stat.S_ISDIR(status.st_mode):
            for name in live:
                if (self._folder / name).stat().st_ino == status.st_ino:
                    self._entries[name] = live[name]
        else:
            self._contents[status.st_ino] = (self._apart / str(status.st_ino)).read_bytes()

    def look(self) -> None:
        """Note all that the disk may hold now."""
        live = self._live()
        for chosen in product((False, True), repeat=len(live)):
            entries = {
                name: here if all_of else self._entries.get(name, {})
                for (name, here), all_of in zip(live.items(), chosen, strict=True)
            }
            for all_bytes in (False, True):
                state = frozenset(self._state(entries, all_bytes))
                kept, gone = self.states.get(state, (frozenset[int](), frozenset[int]()))
                self.states[state] = (kept | self.kept, gone | self.gone)

    def _state(self, entries: dict[str, dict[str, int]], all_bytes: bool) -> Iterator[tuple[str, bytes]]:
        for folder, names in entries.items():
            if folder != "." and folder not in entries["."]:
                continue
            for name, number in names.items():
                path = self._apart / str(number)
                if path.exists():  # no folder
                    yield f"{folder}/{name}", path.read_bytes() if all_bytes else self._contents.get(number, b"")


def described(replicates: int) -> SweepDescription:
    return SweepDescription(
        experiment="calls",
        source="sweep.yaml",
        axes={},
        replicates=replicates,
        report=ReportSettings(),
        configurations=("c",),
        labels=((),),
        codes=("k",),
    )


DESCRIBED = described(6)
FAILED = {"status": "failed", "error": "E: it broke", "digest": None, "heard": None}
WHOLE: dict[int, Row] = {seed: run(seed) | ({"late": 0.5} if seed > 3 else {}) for seed in range(1, 7)}
ROBOTS = {1: 2, 2: 0, 3: 1, 4: 1, 5: 0, 6: 2}


def batch(*numbers: int) -> tuple[list[Row], list[Row], list[Field], dict[str, str]]:
    observed = [row for seed in numbers for row in seen(seed, *range(ROBOTS[seed]))]
    return [WHOLE[seed] for seed in numbers], observed, [HEARD], {"commit": "abc"}


def sweep_with_all_that_happens(folder: Path, disk: Disk) -> None:
    """Add parts, a column, merge them, drop what failed, make it again, begin twice."""
    store = RunStore(folder)
    with store.writing():
        store.declare([HEARD])
        store.describe(described(3))
        store.append(*batch(1))
        disk.kept = frozenset({1})
        failed = [run(seed) | FAILED for seed in (2, 3)]
        store.append(failed, [], [HEARD], {"commit": "abc"})
        disk.kept = frozenset({1, 2, 3})
    with store.writing():
        store.declare([HEARD])
        store.describe(DESCRIBED)
        disk.kept = frozenset({1})
        store.drop_failed(DESCRIBED)
        disk.gone = frozenset({2, 3})
        store.append(*batch(2, 3))
        disk.kept = frozenset({1, 2, 3})
        store.append(*batch(4, 5))  # with a column more
        disk.kept = frozenset({1, 2, 3, 4, 5})


def put(state: frozenset[tuple[str, bytes]], folder: Path) -> None:
    for path, data in state:
        at = folder / path
        at.parent.mkdir(parents=True, exist_ok=True)
        at.write_bytes(data)


def told(store: RunStore, table: str) -> list[Row]:
    """Return the rows of *table* that say something: what is empty left out."""
    return [{name: value for name, value in row.items() if value is not None} for row in store.rows(table).to_pylist()]


def full(row: Row) -> Row:
    return {name: value for name, value in row.items() if value is not None}


POSSIBLE = [full(row) for row in WHOLE.values()] + [full(run(seed) | FAILED) for seed in (2, 3)]


def check_after_lost_power(state: frozenset[tuple[str, bytes]], kept: frozenset[int], gone: frozenset[int]) -> None:
    folder = Path("after")
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    put(state, folder)
    store = RunStore(folder)
    found = told(store, "runs")
    assert all(row in POSSIBLE for row in found)  # no row is wrong
    there = {row["seed"] for row in found}
    assert kept <= there  # nothing is lost that was kept
    assert len(there) == len(found)
    assert not [row for row in found if row["status"] == "failed" and row["seed"] in gone]
    for seed in there:
        observed = [row for row in told(store, "observations") if row["seed"] == seed]
        if [row for row in found if row["seed"] == seed and row["status"] == "done"]:
            assert observed == seen(seed, *range(ROBOTS[seed]))
    with store.writing():  # the next sweep makes the whole
        store.declare([HEARD])
        store.describe(DESCRIBED)
        store.drop_failed(DESCRIBED)
        missing = [seed for seed in WHOLE if not store.done(DESCRIBED)[0, seed - 1]]
        if missing:
            store.append(*batch(*missing))
    assert store.parts.damaged() == []
    assert sorted(told(store, "runs"), key=lambda row: row["seed"]) == [full(row) for row in WHOLE.values()]
    assert len(told(store, "observations")) == sum(ROBOTS.values())


@pytest.mark.slow
def test_lost_power_leaves_no_wrong_row_and_loses_nothing_that_was_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, record_property: Callable[[str, int], None]
):
    monkeypatch.chdir(tmp_path)
    Path("r").mkdir()
    with monkeypatch.context() as patch:
        disk = Disk(Path("r").resolve(), tmp_path / "apart", patch)
        sweep_with_all_that_happens(Path("r"), disk)
    assert len(disk.states) > 50
    for state, (kept, gone) in disk.states.items():
        check_after_lost_power(state, kept, gone)
    record_property("states after lost power", len(disk.states))


# ---------------------------------------------------------------- damage


def damages(folder: Path, count: int) -> Iterator[Callable[[Path], str]]:
    """Yield what damages a copy of *folder*, of each file some: a flipped bit, fewer bytes, none, no file."""
    chance = random.Random(7)
    files = sorted(path.relative_to(folder) for path in folder.rglob("*") if path.is_file() and path.name != ".lock")
    for number in range(count):
        file, kind = files[number % len(files)], chance.choice(["flip"] * 7 + ["cut"] * 2 + ["remove"])
        place = chance.random()

        def damage(copy: Path, file: Path = file, kind: str = kind, place: float = place) -> str:
            path = copy / file
            data = bytearray(path.read_bytes())
            bit = int(8 * len(data) * place)
            if kind == "remove":
                path.unlink()
            elif kind == "cut":
                path.write_bytes(data[: bit // 8])
            else:
                data[bit // 8] ^= 1 << bit % 8
                path.write_bytes(data)
            return f"{kind} {file} at bit {bit}"

        yield damage


def refused(made: Callable[[], Any]) -> bool:
    """Return whether *made* is refused with one line."""
    try:
        made()
    except UserError as error:
        told = str(error)
    else:
        return False
    assert "\n" not in told
    return True


@pytest.mark.parametrize("count", [pytest.param(40, marks=pytest.mark.slow), pytest.param(300, marks=pytest.mark.soak)])
def test_damage_is_refused_or_made_good_and_never_read_as_another_result(
    tmp_path: Path, count: int, record_property: Callable[[str, int], None]
):
    count = soak_count(count) if count > 40 else count
    with users_folder(tmp_path):
        asked = experiment(OBSERVED)
        run_sweep(experiment(OBSERVED | {"replicates": 2}), Path("r"), jobs=1)
        run_sweep(asked, Path("r"), jobs=1)
        os.utime(next(Path("r/runs").iterdir()), (0, 0))  # two parts stay two
        whole = digest_of(Path("r"))
        lines = set(whole.splitlines())
        kinds = {"refused": 0, "made good": 0, "harmless": 0}
        for damage in damages(Path("r"), count):
            shutil.rmtree("copy", ignore_errors=True)
            shutil.copytree("r", "copy")
            what = damage(Path("copy"))
            kinds[after_damage(asked, Path("copy"), whole, lines, what)] += 1
    assert sum(kinds.values()) == count
    for kind, number in kinds.items():
        record_property(f"damaged folders: {kind}", number)


def after_damage(asked: Experiment, copy: Path, whole: str, lines: set[str], what: str) -> str:
    """Return what became of the damaged folder *copy*: it may be refused, made good by a sweep, or be harmless."""
    read: list[str] = []
    not_read = refused(lambda: read.append(digest_of(copy)))
    if read:
        assert set(read[0].splitlines()) <= lines, what
    if refused(lambda: run_sweep(asked, copy, jobs=1, choice=Choice())):
        assert not_read, what
        return "refused"
    if refused(lambda: read.append(digest_of(copy))):  # the sweep has not looked at the observations that are there
        return "refused"
    assert read[-1] == whole, what
    return "harmless" if read[0] == whole else "made good"
