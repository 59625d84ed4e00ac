from pathlib import Path

import pandas as pd
import pyarrow.parquet as pq
import pytest

from cosim.errors import UserError
from cosim.export.sweeps import export_results
from cosim.results import AxisDescription, ReportSettings, RunStore, SweepDescription
from cosim.trace import Field

FIXED = {"experiment": "calls", "status": "done", "error": None, "wall_s": 0.1, "digest": "d"}
DESCRIPTION = SweepDescription(
    experiment="calls",
    source="sweep.yaml",
    axes={"radio": AxisDescription(path="radio", values=("near", "a, b"))},
    replicates=2,
    report=ReportSettings(),
    configurations=("n", "f"),
    code="new",
)


@pytest.fixture
def store(tmp_path: Path) -> RunStore:
    """Return a folder of results: two arms of two runs, and one of an older program."""
    store = RunStore(tmp_path / "r")
    heard = Field("heard", "float", "1", "payloads heard")
    keys = [
        {"configuration": name, "seed": seed, "code": code, "replicate": seed - 1, "radio": radio}
        for name, radio, code in (("f", "a, b", "new"), ("n", "near", "new"), ("n", "near", "old"))
        for seed in (2, 1)
    ]
    with store.writing():
        store.describe(DESCRIPTION)
        for number, key in enumerate(keys):
            store.append([FIXED | key | {"heard": number / 3}], [key | {"robot": number}], [heard], {})
    return store


@pytest.mark.parametrize("table", ["runs", "observations"])
@pytest.mark.parametrize("name", ["out.parquet", "new folder/OUT.CSV"])
def test_what_is_exported_is_read_as_it_was(tmp_path: Path, store: RunStore, table: str, name: str):
    read = pd.read_csv if name.endswith("CSV") else pd.read_parquet
    for everything, rows in ((False, 4), (True, 6)):
        assert export_results(store.folder, tmp_path / name, table, everything) == rows
        expected = store.read(table) if everything else store.present(table)
        assert len(expected) == rows
        pd.testing.assert_frame_equal(read(tmp_path / name)[expected.columns], expected, check_dtype=False)


def test_parquet_tells_units_and_meanings(tmp_path: Path, store: RunStore):
    export_results(store.folder, tmp_path / "out.parquet")
    fields = pq.read_schema(tmp_path / "out.parquet")
    assert fields.field("heard").metadata == {b"unit": b"1", b"meaning": b"payloads heard"}
    assert fields.field("wall_s").metadata[b"unit"] == b"s"
    assert pd.read_parquet(tmp_path / "out.parquet")["radio"].tolist() == ["near", "near", "a, b", "a, b"]


def test_other_endings_and_other_folders_are_refused(tmp_path: Path, store: RunStore):
    with pytest.raises(UserError, match=r"out\.xlsx: expected a file that ends in \.parquet or \.csv$"):
        export_results(store.folder, tmp_path / "out.xlsx")
    for everything in (False, True):
        with pytest.raises(UserError, match="holds no results, expected a folder that cosim sweep has written"):
            export_results(tmp_path / "nowhere", tmp_path / "out.csv", everything=everything)
    assert [path.name for path in tmp_path.iterdir()] == ["r"]
