import fcntl
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from cosim.columns import kind_of
from cosim.errors import UserError
from cosim.parts import Key
from cosim.results import AxisDescription, ReportSettings, RunStore, SweepDescription, provenance
from cosim.trace import Field


def run_row(seed: int, **more: Any) -> dict[str, Any]:
    row = {"experiment": "calls", "replicate": seed - 1, "configuration": "c", "seed": seed, "code": "k"}
    return row | {"status": "done", "error": None, "wall_s": 0.5, "digest": "d"} | more


def keys_in(store: RunStore) -> set[Key]:
    return {key for part in store.parts.whole() for key in store.parts.keys(part)}


def key(seed: int) -> dict[str, Any]:
    return {"configuration": "c", "seed": seed, "code": "k", "replicate": seed - 1}


def described(*configurations: str, **more: Any) -> SweepDescription:
    plain = {"experiment": "calls", "source": "sweep.yaml", "axes": {}, "replicates": 10, "report": ReportSettings()}
    arms = {"configurations": configurations or ("c",)}
    count = len(arms["configurations"])
    return SweepDescription.model_validate(plain | arms | {"codes": ("k",) * count, "labels": ((),) * count} | more)


DESCRIPTION = described()


def test_what_is_appended_is_read_and_done(tmp_path: Path):
    store = RunStore(tmp_path / "calls")
    with store.writing():
        store.append([run_row(1, size=2, heard=3.0), run_row(2, size=4, heard=None)], [], [], {})
        store.append([run_row(3, size=2, heard=1.5)], [key(3) | {"robot": 0}, key(3) | {"robot": 1}], [], {})
    assert store.read()["heard"].fillna(-1).tolist() == [3.0, -1, 1.5]
    assert store.read("observations")["robot"].tolist() == [0, 1]
    assert keys_in(store) == {("c", 1, "k"), ("c", 2, "k"), ("c", 3, "k")}


def test_a_batch_is_one_row_group_with_units_and_metadata(tmp_path: Path):
    store = RunStore(tmp_path)
    field = Field("heard", "float", "1", "payloads heard", optional=True)
    with store.writing():
        store.append([run_row(seed, heard=1.0) for seed in (1, 2, 3)], [], [field], {"commit": "abc"})
    (part,) = (tmp_path / "runs").glob("*.parquet")
    assert pq.ParquetFile(part).num_row_groups == 1
    assert pq.read_schema(part).metadata[b"commit"] == b"abc"
    assert store.units()["heard"] == ("1", "payloads heard")
    assert store.units()["wall_s"][0] == "s"


def test_columns_that_come_later_are_empty_before(tmp_path: Path):
    store = RunStore(tmp_path)
    with store.writing():
        store.append([run_row(1, error="E: broken", status="failed", digest=None)], [], [], {})
        store.append([run_row(2, heard=2.0)], [], [], {})
    frame = store.read()
    assert frame["heard"].isna().tolist() == [True, False]
    assert frame["error"].tolist()[0] == "E: broken"


def test_the_present_sweep_is_what_was_described_last(tmp_path: Path):
    store = RunStore(tmp_path)
    with store.writing():
        store.append(
            [run_row(2), run_row(1), run_row(3), run_row(2, code="old"), run_row(1, configuration="b")], [], [], {}
        )
        store.describe(described("b", "c", replicates=2))
    rows = store.present()[["configuration", "seed"]].to_numpy().tolist()
    assert rows == [["b", 1], ["c", 1], ["c", 2]]


def test_the_folder_of_an_older_program_is_read_as_it_was_described(tmp_path: Path):
    store = RunStore(tmp_path)
    with store.writing():
        store.append([run_row(seed, size=2, replicate=seed - 7) for seed in (8, 7)], [], [], {})
    older = {"experiment": "calls", "source": "sweep.yaml", "axes": {"size": {"path": "size", "values": [2]}}}
    older |= {"replicates": 2, "report": {}, "configurations": ["c"], "code": "k"}
    (tmp_path / "sweep.json").write_text(json.dumps(older))
    assert store.present()[["size", "seed", "replicate"]].to_numpy().tolist() == [[2, 7, 0], [2, 8, 1]]


def test_a_full_disk_leaves_no_half_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    store = RunStore(tmp_path)

    def full(path: Path, data: bytes) -> None:
        path.write_text("PAR1 half")
        raise OSError(28, "No space left on device")

    with store.writing():
        store.append([run_row(1)], [], [], {})
        monkeypatch.setattr(Path, "write_bytes", full)
        with pytest.raises(OSError, match="No space left"):
            store.append([run_row(2)], [key(2) | {"robot": 0}], [], {})
    assert keys_in(store) == {("c", 1, "k")}
    assert sorted(path.suffix for path in tmp_path.rglob("*") if path.is_file()) == [
        "",
        "",
        ".parquet",
    ]  # .lock, SHA256SUMS, one part


def test_a_full_disk_leaves_no_draft_of_the_description(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    store = RunStore(tmp_path)

    def full(path: Path, text: str, encoding: str) -> None:
        path.write_bytes(text[:5].encode())
        raise OSError(28, "No space left on device")

    with store.writing():
        store.describe(DESCRIPTION)
        monkeypatch.setattr(Path, "write_text", full)
        with pytest.raises(OSError, match="No space left"):
            store.describe(DESCRIPTION.model_copy(update={"replicates": 11}))
        assert not list(tmp_path.rglob("*.part"))
    assert store.description() == DESCRIPTION


def test_the_lock_is_no_program(tmp_path: Path):
    with RunStore(tmp_path).writing():
        assert (tmp_path / ".lock").stat().st_mode & 0o777 & ~0o644 == 0


@pytest.mark.parametrize("damaged", [b"", b"PAR1 half", b"PAR1" + bytes(range(100)) + b"\x40\0\0\0PAR1"])
@pytest.mark.parametrize("table", ["runs", "observations"])
def test_a_damaged_part_is_told(tmp_path: Path, table: str, damaged: bytes):
    store = RunStore(tmp_path)
    with store.writing():
        store.append([run_row(1)], [key(1) | {"robot": 0}], [], {})
    (part,) = (tmp_path / table).glob("*.parquet")
    part.write_bytes(damaged)
    runs = tmp_path / "runs" / part.name
    which = "it" if table == "runs" else "the file of that name in runs"
    for read in (
        (lambda: store.done(DESCRIPTION), store.units, store.read) if table == "runs" else (lambda: store.read(table),)
    ):
        with pytest.raises(UserError) as raised:
            read()
        assert str(raised.value) == f"{part}: is not a whole Parquet file; delete {which} and sweep again"
    runs.unlink()
    with store.writing():
        assert (keys_in(store), len(store.read(table))) == (set(), 0)
        store.append([run_row(1)], [key(1) | {"robot": 0}], [], {})
    assert len(store.read(table)) == 1


@pytest.mark.slow
@pytest.mark.parametrize("table", ["runs", "observations"])
def test_no_bit_of_a_part_flips_unseen(tmp_path: Path, table: str):
    store = RunStore(tmp_path)
    with store.writing():
        store.append([run_row(1, heard=2.5)], [key(1) | {"robot": 0}], [], {"commit": "abc"})
    (part,) = (tmp_path / table).glob("*.parquet")
    whole = part.read_bytes()
    bits = np.random.default_rng(5).permutation(8 * len(whole))[:300].tolist()
    for bit in bits:
        flipped = bytearray(whole)
        flipped[bit // 8] ^= 1 << bit % 8
        part.write_bytes(flipped)
        with pytest.raises(UserError, match="is not a whole Parquet file"):
            store.read(table)
    part.write_bytes(whole)
    assert len(store.read(table)) == 1


def test_parts_of_an_older_program_are_read_whose_names_tell_nothing_of_their_bytes(tmp_path: Path):
    store = RunStore(tmp_path)
    with store.writing():
        store.append([run_row(1)], [key(1) | {"robot": 0}], [], {})
    for table in ("runs", "observations"):
        (part,) = (tmp_path / table).glob("*.parquet")
        part.rename(part.with_name("part-00000-1f0c9a2b.parquet"))
    with store.writing():
        assert keys_in(store) == {("c", 1, "k")}
    assert len(store.read("observations")) == 1


@pytest.mark.parametrize("instead", ["nothing", "a folder", "a link that leads nowhere"])
def test_observations_that_are_gone_are_made_again_with_their_runs(tmp_path: Path, instead: str):
    store = RunStore(tmp_path)
    with store.writing():
        store.append([run_row(1)], [], [], {"commit": "the first"})
        store.append([run_row(2)], [key(2) | {"robot": 0}], [], {"commit": "the second"})
    (part,) = (tmp_path / "observations").glob("*.parquet")
    part.unlink()
    if instead == "a folder":
        part.mkdir()
    elif instead != "nothing":
        part.symlink_to(tmp_path / "nowhere")
    assert keys_in(store) == {("c", 1, "k")}
    assert store.read()["seed"].tolist() == [1]
    with store.writing():
        store.append([run_row(2)], [key(2) | {"robot": 7}], [], {})
    assert store.read()["seed"].tolist() == [1, 2]
    assert store.read("observations")["robot"].tolist() == [7]


def test_columns_that_were_of_another_kind_in_an_older_sweep_do_not_disturb_the_present_one(tmp_path: Path):
    store = RunStore(tmp_path)
    with store.writing():
        store.append([run_row(1, size=2, code="old")], [], [], {})
        store.append([run_row(1, size="two")], [], [], {})
        store.describe(DESCRIPTION)
    assert store.present()["size"].tolist() == ["two"]
    assert store.read()["size"].tolist() == ["2", "two"]
    with store.writing():
        store.describe(described(codes=("old",), labels=((2,),), axes={"size": AxisDescription(path="", values=(2,))}))
    assert store.present()["size"].tolist() == [2]


def test_a_sweep_that_begins_with_another_seed_shows_its_own_runs(tmp_path: Path):
    store = RunStore(tmp_path)
    with store.writing():
        store.append([run_row(seed) for seed in (1, 2)] + [run_row(3) | {"replicate": 1}], [], [], {})
        store.describe(described(seed=2, replicates=2))
    assert store.done(described(seed=2, replicates=2)).all()
    assert store.present()[["seed", "replicate"]].to_numpy().tolist() == [[2, 0], [3, 1]]


@pytest.mark.slow
def test_no_bit_of_a_description_flips_unseen(tmp_path: Path):
    store = RunStore(tmp_path)
    axes = {"radio": AxisDescription(path="r", values=(2, 4))}
    told = described("b", "c", labels=((2,), (4,)), axes=axes, seed=3)
    with store.writing():
        store.describe(told)
    whole = (tmp_path / "sweep.json").read_bytes()
    refused = 0
    for bit in range(0, 8 * len(whole), 23):
        flipped = bytearray(whole)
        flipped[bit // 8] ^= 1 << bit % 8
        (tmp_path / "sweep.json").write_bytes(flipped)
        try:
            found = store.description()
        except UserError:
            refused += 1
        else:
            assert found == told  # a space more or less
    assert refused > len(whole) / 4


def test_values_that_no_sweep_has_are_told(tmp_path: Path):
    store = RunStore(tmp_path)
    with store.writing():
        store.append([run_row(1, size=2)], [], [], {})
        store.describe(described(labels=((None,),), axes={"radio": AxisDescription(path="r", values=(None,))}))
    with pytest.raises(UserError, match=r"sweep\.json: axes\.radio\.values: are no values of an axis$"):
        store.present()


def test_parts_in_which_other_things_go_by_the_fixed_names_are_told(tmp_path: Path):
    store = RunStore(tmp_path)
    with store.writing():
        store.append([run_row(1)], [], [], {})
        store.describe(DESCRIPTION)
    (part,) = (tmp_path / "runs").glob("*.parquet")
    table = pq.read_table(part)
    place = table.column_names.index("seed")
    pq.write_table(table.set_column(place, "seed", pa.array(["first"])), part.with_name("part-00000-1f0c9a2b.parquet"))
    part.unlink()
    for use in (store.read, declaring(store)):
        with pytest.raises(UserError, match="runs: the parts do not fit together, expected a folder for each sweep: "):
            use()


def declaring(store: RunStore) -> Callable[[], None]:
    def declare() -> None:
        with store.writing():
            store.declare()

    return declare


@pytest.mark.parametrize(
    ("plain", "told"),
    [
        ("{", "holds no results, expected a folder that cosim sweep has written"),
        ("[" * 100_000, "holds no results, expected a folder that cosim sweep has written"),
        ("[]", "sweep.json: [] is not a mapping of settings"),
        (
            "{}",
            "sweep.json: experiment: is missing (and 6 more: source, axes, replicates, report, configurations, codes)",
        ),
    ],
)
def test_another_sweep_json_is_told(tmp_path: Path, plain: str, told: str):
    (tmp_path / "sweep.json").write_text(plain)
    with pytest.raises(UserError) as raised:
        RunStore(tmp_path).present()
    assert str(raised.value).endswith(told)


def test_a_disk_that_fails_is_no_damaged_part(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    store = RunStore(tmp_path)
    with store.writing():
        store.append([run_row(1)], [], [], {})

    def fail(*_: Any, **__: Any) -> None:
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(Path, "read_bytes", fail)
    with pytest.raises(OSError, match="Input/output error"):
        store.read()


def test_what_a_killed_writer_left_is_ignored_and_cleared_away(tmp_path: Path):
    store = RunStore(tmp_path)
    with store.writing():
        store.append([run_row(1)], [key(1) | {"robot": 0}], [], {})
    draft = tmp_path / "runs" / ".part-00001-aa.parquet.xyz.part"
    orphan = tmp_path / "observations" / "part-00001-aa.parquet"
    draft.write_bytes(b"PAR1 half")
    orphan.write_bytes((next((tmp_path / "observations").glob("*.parquet"))).read_bytes())
    assert len(store.read()) == 1
    assert len(store.read("observations")) == 1
    with store.writing():
        assert not draft.exists()
        assert not orphan.exists()
    assert len(store.read("observations")) == 1


def test_two_writers_do_not_share_a_folder(tmp_path: Path):
    lock = os.open(tmp_path / ".lock", os.O_CREAT | os.O_RDWR)
    fcntl.flock(lock, fcntl.LOCK_EX)
    with pytest.raises(UserError, match="another sweep is writing there"), RunStore(tmp_path).writing():
        pass
    os.close(lock)
    with RunStore(tmp_path).writing():
        pass


def test_a_folder_without_results_is_told(tmp_path: Path):
    with pytest.raises(UserError, match="holds no results, expected a folder that cosim sweep has written"):
        RunStore(tmp_path).description()
    assert list(RunStore(tmp_path).read()["seed"]) == []


@pytest.mark.parametrize(
    ("values", "kind"),
    [
        ([1, 2], "int"),
        ([1, 2.5], "float"),
        ([True, False], "bool"),
        ([1, "a"], "str"),
        ([1, True], "str"),
        ([None], "null"),
        ([None, np.float64(1.5), 2], "float"),
        ([np.int64(1), np.bool_(True)], "str"),
    ],
)
def test_a_column_holds_all_of_its_values(values: list[Any], kind: str):
    assert kind_of(values) == kind


def test_provenance_names_versions():
    assert provenance()["version.simpy"].startswith("4.")
