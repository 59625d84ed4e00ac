"""How many verdicts chance would turn: shares that can be written down, and what is drawn together."""

import math
import sys
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from cosim.report.by_chance import Redrawn, Turned, main, turned
from cosim.report.kept import KeptChance, kept_chance
from cosim.results import RunStore, SweepDescription
from tests.checkout import DATA
from tests.report.sheets import swept, written

DRAWS = 200
CLAIMS = (  # of two seeds, 1 and 2: (name, row, share of the four draws that turn it, into what)
    ("first", 'first,003,V,all are of seed 1,delay_s,,s,2,"equal"', 1 / 4, "holds"),
    ("differ", "differ,003,V,they differ,,,,,differ", 1 / 2, "fails"),
    ("mean", "mean,003,V,on average,delay_s,,s,2.5,in the interval", 1 / 2, "fails"),
    ("sure", "sure,003,V,rounds are what they are,rounds,,1,4,equal", 0, ""),
    ("none", "none,003,V,nobody waits,delay_s,size == 9,s,1,at most", None, ""),
    ("theirs", "theirs,003,V,it is another thing,delay_s,,s,1,not comparable: of mules", None, ""),
)
FIGURES = """
from cosim.report.comparison import less

def differ(runs, seen):
    return "-".join(map(str, runs["delay_s"])), runs["delay_s"].nunique() == len(runs)

def shorter(runs, seen):
    return less(runs, [("all", {"size": 2}, {"size": 3})], "delay_s")

def alike(runs, seen):
    of_runs, of_rows = ({*zip(table["replicate"], table["seed"], table["drawn"])} for table in (runs, seen))
    return len(of_runs), of_runs == of_rows
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder in which results may be, where functions of a user's own are found."""
    monkeypatch.syspath_prepend(str(DATA))
    monkeypatch.delitem(sys.modules, "delays", raising=False)
    return tmp_path


def sheet(folder: Path, *claims: str, **changes: Any) -> Path:
    """Write an experiment with *claims* into *folder*; return its sweep.yaml."""
    source = written(folder / "delays_of", "\n".join([*claims, ""]), **changes)
    (source.parent / "figures.py").write_text(FIGURES, encoding="utf-8")
    return source


def shares(results: Path, draws: int = DRAWS) -> dict[str, Turned]:
    """Return what is turned of the claims about *results*."""
    store = RunStore(results)
    found = turned(store.description(), store.present(), store.present("observations"), draws)
    return {each.id: each for each in found}


def two_seeds(folder: Path) -> Path:
    """Return the results of one arm with two replicates, of 2 s and 3 s, whose claims are CLAIMS."""
    source = sheet(folder, *(row for _, row, *_ in CLAIMS), sweep={"size": [2]}, replicates=2)
    return swept(source, folder / "results")


@pytest.mark.slow
def test_shares_are_those_of_equally_likely_draws(folder: Path) -> None:
    """Two replicates have four draws: both alike in two of them, each then with an interval of no width."""
    found = shares(two_seeds(folder))
    assert list(found) == [name for name, _, share, _ in CLAIMS if share is not None]
    for name, _, share, other in CLAIMS:
        if share is not None:
            error = math.sqrt(share * (1 - share) / DRAWS)
            assert abs(found[name].share - share) <= 4 * error
            assert (found[name].other, {*found[name].others}) == (other, {other} - {""})


@pytest.mark.slow
def test_arms_of_a_replicate_stay_together(folder: Path) -> None:
    """The one is always half a second shorter, though seeds differ by whole seconds."""
    source = sheet(folder, "shorter,003,V,it is shorter,,,,,shorter", sweep={"size": [2, 3]}, replicates=4)
    found = shares(swept(source, folder / "results"), 40)["shorter"]
    assert (found.verdict, found.share) == ("holds", 0)


def table(rows: list[tuple[str, int, int]]) -> pd.DataFrame:
    """Return rows of (configuration, replicate, drawn), done, of seeds from 5 on; a size an arm."""
    frame = pd.DataFrame(rows, columns=["configuration", "replicate", "drawn"])
    return frame.assign(seed=5 + frame["replicate"], size=frame["configuration"].map({"a": 1, "b": 2}), status="done")


def told(folder: Path, *claims: str) -> SweepDescription:
    """Return what a sweep of two arms and three replicates was, of which there are *claims*."""
    plain = {"experiment": "x", "replicates": 3, "report": {}, "seed": 5, "code": "k", "configurations": ["a", "b"]}
    axes = {"size": {"path": "size", "values": [1, 2]}}
    return SweepDescription.model_validate(plain | {"axes": axes, "source": str(sheet(folder, *claims))})


RUNS = [("a", 0, 10), ("a", 1, 11), ("a", 2, 12), ("b", 0, 20), ("b", 2, 22)]


def test_a_replicate_drawn_twice_counts_as_two(folder: Path) -> None:
    found = Redrawn(table(RUNS), told(folder)).drawn([2, 1, 2])
    columns = ["configuration", "size", "replicate", "seed", "drawn"]
    assert found[columns].to_numpy().tolist() == [
        ["a", 1, 0, 5, 12],
        ["a", 1, 1, 6, 11],
        ["a", 1, 2, 7, 12],
        ["b", 2, 0, 5, 22],  # there is no run of it with replicate 1
        ["b", 2, 2, 7, 22],
    ]


def test_replicates_drawn_in_order_are_the_runs_as_they_are(folder: Path) -> None:
    rows = table(RUNS)
    pd.testing.assert_frame_equal(Redrawn(rows, told(folder)).drawn([0, 1, 2]), rows)


def test_runs_and_observations_are_drawn_together(folder: Path) -> None:
    sweep = told(folder, "alike,003,V,they are alike,,,,,alike")
    runs = table([("a", number, number) for number in range(3)])
    seen = pd.concat([runs, runs], ignore_index=True).sort_values("replicate", kind="stable", ignore_index=True)
    (found,) = turned(sweep, runs, seen.drop(columns="status"), 50)
    assert (found.verdict, found.share) == ("holds", 0)


@pytest.mark.slow
def test_what_chance_turns_is_printed(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    results = two_seeds(folder)
    main([str(results), "--draws", "40"])
    found = shares(results, 40)
    out = capsys.readouterr().out
    lines = [line.split() for line in out.partition("\n\n")[0].splitlines()]
    assert lines[1:] == [
        [name, found[name].verdict, f"{found[name].share:.3f}", other] for name, _, share, other in CLAIMS if share
    ]
    expected = sum(each.share for each in found.values())
    total = f"chance turns {expected:.1f} of 4 verdicts on average ({expected / 4:.1%})"
    assert out.endswith(f"\n\n{total}\n")


@pytest.mark.slow
def test_shares_of_a_whole_sheet_are_kept_beside_its_claims(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    results = two_seeds(folder)
    for _ in range(2):
        main([str(results), "--draws", "40", "--keep"])
    found = shares(results, 40)
    assert kept_chance(folder / "delays_of") == [
        KeptChance(name, found[name].verdict, str(round(found[name].share, 4)).removesuffix(".0"), other, "40")
        for name, _, share, other in CLAIMS
        if share is not None
    ]
    assert str(folder / "delays_of/chance.csv") in capsys.readouterr().out


@pytest.mark.parametrize("changes", [{"sweep": {"size": [3]}}, {"replicates": 3}])  # since the runs were made
def test_shares_of_a_part_of_a_sheet_are_not_kept(folder: Path, changes: dict[str, Any], capsys: Any) -> None:
    results = two_seeds(folder)
    sheet(folder, CLAIMS[0][1], **{"sweep": {"size": [2]}, "replicates": 2} | changes)
    with pytest.raises(SystemExit) as ended:
        main([str(results), "--keep"])
    assert ended.value.code == 2
    assert "--keep: keeps the verdicts of whole sheets, this is not all of " in capsys.readouterr().err
    assert not (folder / "delays_of/chance.csv").exists()


def test_a_sweep_without_claims_is_refused_in_one_line(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    results = swept(sheet(folder, sweep={"size": [2]}, replicates=2), folder / "results")
    with pytest.raises(SystemExit) as ended:
        main([str(results)])
    assert ended.value.code == 2
    assert capsys.readouterr().err.startswith(f"{results}: the sweep has no claims")
