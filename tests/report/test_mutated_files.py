"""Files beside results as people and accidents leave them: a report reads them or says in one line what is wrong."""

import json
import random
import warnings
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from cosim.errors import UserError
from cosim.report import sweep_report
from cosim.report.claims import judge, published_claims
from cosim.report.sweep_report import report
from cosim.results import ReportSettings, RunStore, SweepDescription
from tests.tiers import soak_count

PLAIN_RUNS: list[dict[str, Any]] = [
    {"seed": seed, "size": size, "radio": radio, "status": "done", "found": found, "delay_s": size * seed / 2}
    for size in (2, 4)
    for radio, found in (("near", True), ("far", False))
    for seed in (1, 2, 3)
]
RUNS = pd.DataFrame(PLAIN_RUNS)
COLUMNS = ("id", "paper", "section", "claim", "quantity", "where", "unit", "published", "test")
CLAIMS = (
    ("a", "003", "V", "it is so", "delay_s", "size == 4 and radio == 'near'", "s", "4", "within 5 %"),
    ("b", "003", "V, VI", 'it is "so"', "delay_s <= 2.5", "", "1", "0.5", "in the interval"),
    ("c", "003", "V", "it is so", "delay_s / size", "found", "", "1e-3", "at least"),
    ("d", "003", "V", "it is so", "", "", "", "", "linear"),
)
TEXT = "\n".join(
    ",".join('"' + cell.replace('"', '""') + '"' if set(cell) & set('",') else cell for cell in row)
    for row in (COLUMNS, *CLAIMS)
)
DESCRIPTION = SweepDescription(
    experiment="calls",
    source="nowhere/sweep.yaml",
    axes={"size": {"path": "team.size", "values": (2, 4)}},  # type: ignore[dict-item]
    replicates=3,
    report=ReportSettings(metrics=("delay_s",), x="size"),
    configurations=("c", "d"),
    code="k",
).model_dump(mode="json")

WORDS = (
    *("", "nan", "inf", "-1", "1e999", "0", "1", "True", "None", "x", "size", "radio", "found", "seed", "delay_s"),
    *("(((", ")", "lambda: 1", "size if size else 1", "import os", "size = 3", "@sys", "[size]", "'", '"', "\\", "\0"),
    *("size.sum()", "radio.str", "size.head(1)", "index", "size +", "~radio", "not found", "size @ size", "5 % 0"),
    *("delay_s\nsize", "é", "²", "😀", "x" * 5000, "within %", "within 1..2 %", "within 1e5 %"),
    *(
        "pd",
        "tables",
        "__file__",
        "__class__",
        "linear",
        "equal",
        "at most",
        "a\r\nb",
        "{}",
        "1_000",
        "0x10",
        "size**99",
    ),
)
PLAIN: tuple[Any, ...] = (
    None,
    True,
    -1,
    0,
    2**70,
    0.5,
    1e308,
    "",
    "x",
    "x" * 5000,
    "\ud800",
    "\0",
    [],
    {},
    [[]],
    {"x": 1},
)


def mutated_text(rng: random.Random) -> bytes:
    """Return published.csv with some cells replaced, or some bytes changed."""
    rows = [list(row) for row in (COLUMNS, *CLAIMS)]
    for _ in range(rng.randint(1, 3)):
        row = rng.randrange(1 if rng.random() < 0.9 else 0, len(rows))
        rows[row][rng.randrange(len(COLUMNS))] = rng.choice(WORDS)
    text = "\n".join(",".join('"' + cell.replace('"', '""') + '"' for cell in row) for row in rows)
    data = bytearray((text if rng.random() < 0.8 else TEXT).encode())
    for _ in range(rng.randint(1, 8) if rng.random() < 0.3 else 0):
        at = rng.randrange(len(data))
        data[at : at + rng.choice((0, 1, 5))] = rng.choice((b"", b",", b'"', b"\n", b"\xff", b"\0", b"(", b"=", b"9"))
    return bytes(data)


def linear(runs: pd.DataFrame, observations: pd.DataFrame) -> tuple[str, bool | None]:
    """Answer a claim."""
    return ("-", None) if runs.empty else ("yes", True)


def judged(rng: random.Random, folder: Path) -> None:
    """Hold a mutated published.csv against some runs."""
    (folder / "published.csv").write_bytes(mutated_text(rng))
    figures: Any = type("figures", (), {"linear": staticmethod(linear), "pd": pd, "__file__": "figures.py"})
    for claim in published_claims(folder):
        judge(claim, RUNS, RUNS.head(0), figures)


def mutated_plain(plain: Any, rng: random.Random) -> Any:
    """Return *plain* with a value, a key or an item changed somewhere in it."""
    if isinstance(plain, dict | list) and plain and rng.random() < 0.8:
        copy = plain.copy()
        key = rng.choice(list(plain)) if isinstance(plain, dict) else rng.randrange(len(plain))
        match rng.randrange(8):
            case 0:
                del copy[key]
            case 1 if isinstance(copy, dict):
                copy[rng.choice(("x", "", "seed", "x" * 60))] = copy.pop(key)
            case _:
                copy[key] = mutated_plain(plain[key], rng)
        return copy
    return rng.choice(PLAIN)


def reported(rng: random.Random, folder: Path) -> None:
    """Report on the runs in *folder* by a mutated sweep.json."""
    text = json.dumps(mutated_plain(DESCRIPTION, rng)).encode()
    if rng.random() < 0.2:
        text = text[: rng.randrange(len(text))] + rng.choice((b"", b"\xff", b"}", b"NaN"))
    (folder / "sweep.json").write_bytes(text)
    report(folder)


@pytest.fixture
def results(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder of results, of which no figures are drawn: that takes long, and sweep.json only names them."""
    monkeypatch.setattr(sweep_report, "draw", lambda frame, axes, metric, *_: tmp_path / f"{metric}.png")
    store = RunStore(tmp_path)
    fixed = {"experiment": "calls", "code": "k", "error": None, "wall_s": 0.1, "digest": "d"}
    rows = [row | fixed | {"replicate": row["seed"] - 1, "configuration": "cd"[row["size"] == 4]} for row in PLAIN_RUNS]
    with store.writing():
        store.append(rows, [], [], {})
    return tmp_path


def try_all(kind: Callable[[random.Random, Path], None], count: int, folder: Path) -> Counter[str]:
    """Try *count* mutations of a *kind*, and return how often each refusal was met; an empty one: it was read."""
    met: Counter[str] = Counter()
    for seed in range(count):
        text = ""
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # of arithmetic with what is infinite
                kind(random.Random(seed), folder)
        except UserError as error:
            text = str(error).removeprefix(str(folder))
            assert "\n" not in text, seed
            assert len(text) <= 300, (seed, text)
        met[text] += 1
    return met


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "count"), [(judged, 60), (reported, 60)])
def test_a_mutated_file_is_read_or_refused_in_one_line(
    kind: Callable[[random.Random, Path], None], count: int, results: Path
):
    met = try_all(kind, count, results)
    assert met[""] > 0
    assert len(met) > 10


@pytest.mark.soak
@pytest.mark.parametrize("kind", [judged, reported])
def test_many_mutated_files_are_read_or_refused_in_one_line(
    kind: Callable[[random.Random, Path], None], results: Path, record_property: Callable[[str, Any], None]
):
    met = try_all(kind, soak_count(10_000), results)
    record_property(f"mutated files that were {kind.__name__}", sum(met.values()))
    record_property(f"of them refused, {kind.__name__}", sum(met.values()) - met[""])
