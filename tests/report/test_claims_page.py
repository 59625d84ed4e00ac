"""docs/claims.md says what published.csv and what is kept beside it say: each claim in one line, and counts."""

import csv
import re
from pathlib import Path

import pytest

from cosim.errors import UserError
from cosim.experiment import experiment_folders
from cosim.report.claims_page import WORDS, page
from cosim.report.kept import KINDS, kept_chance, kept_variations, kept_verdicts, known_causes
from tests.checkout import EXPERIMENTS, ROOT
from tests.report.sheets import written

DOCUMENT = ROOT / "docs" / "claims.md"
SHEETS = [path.parent for path in EXPERIMENTS.glob("**/sweep.yaml")]
OURS = {"_".join(folder.relative_to(EXPERIMENTS).parts): folder for folder in SHEETS}
VERDICTS = "id,verdict,ours,replicates,code\nfirst,fails,5,3,c\nsecond,holds,3.5,3,c\n"
VARIATIONS = "sheet,variation,id,verdict,ours,replicates,code\n"
CHANCE = "id,verdict,turned,other,draws\n"
DECIDES = "id,decides,left\nfirst,reading,asked of all rounds\n"
LONG = f"alpha,000,VI,{'a word ' * 40}the case at the end,delay_s,,s,3.5,in the interval\n"


def table(path: Path) -> list[dict[str, str]]:
    """Return the rows of a CSV."""
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """An experiment with four claims, of which two verdicts are kept, and what decides one of them."""
    written(tmp_path / "sound")
    (tmp_path / "sound/verdicts.csv").write_text(VERDICTS, encoding="utf-8")
    (tmp_path / "sound/decides.csv").write_text(DECIDES, encoding="utf-8")
    return tmp_path / "sound"


def line(text: str, id_: str) -> list[str]:
    """Return the cells of the only line about the claim *id_*."""
    (found,) = [each for each in text.splitlines() if f"`{id_}`" in each]
    return [cell.strip() for cell in found.strip("|").split("|")]


def test_the_document_is_the_one_that_the_experiments_make() -> None:
    made = page({name: folder for name, folder in experiment_folders().items() if name in OURS})
    assert DOCUMENT.read_text(encoding="utf-8") == made, (
        "make it anew: python -P -m cosim.report.claims_page > docs/claims.md"
    )


def test_every_claim_of_every_experiment_has_a_line_and_is_counted() -> None:
    claims = [
        row
        for folder in OURS.values()
        if (folder / "published.csv").is_file()
        for row in table(folder / "published.csv")
    ]
    text = DOCUMENT.read_text(encoding="utf-8")
    assert sorted(re.findall(r"^\| .*?`(\w+)`\) \|", text, re.MULTILINE)) == sorted(row["id"] for row in claims)
    (counted,) = re.findall(r"^\| all \|(.*)\|$", text.partition("\nWhat decides")[0], re.MULTILINE)
    *parts, total = [int(cell or 0) for cell in map(str.strip, counted.split("|"))]
    assert sum(parts) == total == len(claims)


def test_what_is_known_of_claims_is_of_claims_that_there_are() -> None:
    for folder in OURS.values():
        ids = {row["id"] for row in table(folder / "published.csv")} if (folder / "published.csv").is_file() else set()
        assert known_causes(folder).keys() <= ids
        assert {row.id for row in kept_variations(folder)} <= ids
        whole = kept_verdicts(folder)
        for row in kept_chance(folder):  # of the same runs
            assert row.verdict == whole[row.id].verdict
        assert all(len(cause.left) <= 140 for cause in known_causes(folder).values())
        held = {id_ for id_, kept in kept_verdicts(folder).items() if kept.verdict == "holds"}
        assert (
            not held & known_causes(folder).keys() or folder.name == "reflection_noise"
        )  # one holds for a wrong reason


def test_a_claim_is_a_line_with_its_verdict_and_what_decides_it(folder: Path) -> None:
    text = page({"sound": folder})
    assert line(text, "first") == [
        *("two rounds, for each of two (V; `first`)", "4 rounds", "5", "fails", "*reading*: asked of all rounds"),
    ]
    assert line(text, "second") == ["it takes longer (V; `second`)", "3.5 s", "3.5", "holds", ""]
    assert line(text, "fourth")[2:] == ["", "not run whole", ""]
    assert "\n1 holds, 1 fails, 1 not run whole, of 3 replicates; " in text.partition("## Paper 003")[2]


def test_counts_are_by_source_and_in_all(folder: Path) -> None:
    head = page({"sound": folder}).partition("## Counts\n")[2].partition("\n## ")[0]
    lines = [[cell.strip() for cell in each.strip("|").split("|")] for each in head.splitlines() if "|" in each]
    assert lines[0] == ["source", *WORDS, "claims"]
    assert lines[2:5] == [
        ["paper 003", "1", "1", "", "", "", "1", "3"],
        ["Peterson 2006", "", "", "", "", "", "1", "1"],
        ["all", "1", "1", "", "", "", "2", "4"],
    ]
    assert lines[5] == ["source", *KINDS, "not known", "claims"]
    assert lines[7:] == [["paper 003", "", "1", "", "", "", "1"], ["all", "", "1", "", "", "", "1"]]


def test_a_failing_claim_of_which_nothing_is_known_says_so(folder: Path) -> None:
    (folder / "decides.csv").unlink()
    assert line(page({"sound": folder}), "first")[-1] == "not known"


def test_verdicts_by_other_choices_stand_together(folder: Path) -> None:
    words = ["holds"] * 5 + ["fails", "fails"]
    rows = "".join(f"alternatives,c{at},first,{word},1,2,c\n" for at, word in enumerate(words))
    (folder / "variations.csv").write_text(VARIATIONS + rows, encoding="utf-8")
    text = page({"sound": folder})
    assert line(text, "first")[4] == "holds with 5 of 7; fails: c5, c6"
    assert line(text, "second")[4] == ""


def test_a_choice_with_a_comma_is_quoted_among_others(folder: Path) -> None:
    rows = 'alternatives,near,first,holds,1,2,c\nalternatives,"near, slow",first,holds,1,2,c\n'
    (folder / "variations.csv").write_text(VARIATIONS + rows, encoding="utf-8")
    assert line(page({"sound": folder}), "first")[4] == 'holds: near, "near, slow"'


def test_where_nothing_is_judged_the_page_shows_what_came_out_by_choice(folder: Path) -> None:
    rows = "zones,near,first,not comparable,4 ± 1,5,k\nzones,far,first,not comparable,9 ± 2,5,k\n"
    (folder / "variations.csv").write_text(VARIATIONS + rows, encoding="utf-8")
    assert line(page({"sound": folder}), "first")[4] == "not comparable: near (4 ± 1), far (9 ± 2)"


def test_what_chance_would_turn_is_added_up_by_experiment(folder: Path) -> None:
    assert "How many verdicts chance would turn" not in page({"sound": folder})
    (folder / "chance.csv").write_text(CHANCE + "first,fails,0.25,open,8\nsecond,holds,0.5,fails,8\n", encoding="utf-8")
    written(folder.parent / "other")
    written(folder.parent / "third")
    (folder.parent / "third/chance.csv").write_text(CHANCE + "fourth,open,0,,8\n", encoding="utf-8")
    text = page({"sound": folder, "third": folder.parent / "third", "other": folder.parent / "other"})
    section = text.partition("\n## How many verdicts chance would turn\n")[2].partition("\n## ")[0]
    lines = [[cell.strip() for cell in each.strip("|").split("|")] for each in section.splitlines() if "|" in each]
    assert lines[0] == ["experiment", "rows judged", "expected to turn", "share"]
    assert lines[2:] == [
        ["sound", "2", "0.8", "37.5 %"],  # 0.75 of two
        ["third", "1", "0.0", "0.0 %"],
        ["all", "3", "0.8", "25.0 %"],
    ]


def test_a_long_claim_keeps_its_beginning_and_its_end_and_a_line_stays_a_line(folder: Path) -> None:
    claim = LONG.replace("a word", "a | word", 1)
    written(folder, claim)
    cell = line(page({"sound": folder}), "alpha")[0]
    assert re.fullmatch(r"a / word .* … .*the case at the end \(VI; `alpha`\)", cell)
    assert len(cell) < 180


@pytest.mark.parametrize(
    ("name", "text", "told"),
    [
        ("decides.csv", "id,decides,left\nfirst,luck,x\n", "first: decides: 'luck' is none of input, reading"),
        ("decides.csv", "id,left\nfirst,x\n", "expected the columns id, decides, left"),
        ("variations.csv", VARIATIONS + "a,b,first\n", "line 2: expected 7 cells"),
    ],
)
def test_a_file_in_another_form_is_told(folder: Path, name: str, text: str, told: str) -> None:
    (folder / name).write_text(text, encoding="utf-8")
    with pytest.raises(UserError, match=re.escape(f"{folder / name}: {told}")):
        page({"sound": folder})
