"""The page of an experiment: all in one file, whatever names and errors hold, and what it says follows the rows."""

import re
import shutil
import sys
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from cosim.report.experiment_page import experiment_page
from cosim.report.markup import Html, first_section, identifier, joined, markdown, tag
from cosim.report.repeating import sweep_command
from cosim.report.sweep_report import report
from cosim.results import RunStore
from tests.checkout import DATA
from tests.report.sheets import swept, written

HOSTILE = "<script>alert('x')</script>"


class Read(HTMLParser):
    """The elements, the ids, the addresses and the text of a page; a fault for each end that is none."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.names: list[str] = []
        self.ids: list[str] = []
        self.addresses: list[str] = []
        self.faults: list[str] = []
        self.text = ""
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.names.append(tag)
        given = dict(attrs)
        self.ids += [str(given["id"])] if "id" in given else []
        self.addresses += [str(given[name]) for name in ("href", "src", "xlink:href") if name in given]
        if tag not in ("meta", "br", "img"):
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        if not self.open or self.open.pop() != tag:
            self.faults.append(tag)

    def handle_data(self, data: str) -> None:
        self.text += data


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Work in a folder that holds a user's own functions."""
    shutil.copy(DATA / "delays.py", tmp_path)
    monkeypatch.delitem(sys.modules, "delays", raising=False)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path


def paged(results: Path) -> str:
    return experiment_page(results, report(results))


def section(page: str, id_: str) -> str:
    found = re.search(rf'<section aria-labelledby="{id_}">.*?</section>', page, re.DOTALL)
    assert found, id_
    return found[0]


def words(page: str) -> list[str]:
    """Return the verdicts of the claims on *page*, in their order."""
    return re.findall(r'class="verdict[ a-z]*"><span[^>]*>.</span> ([a-z ]+)</span></td>', page)


@pytest.mark.slow
def test_a_page_is_whole_and_needs_nothing_else():
    page = paged(swept(written(Path("delays")), Path("r")))
    read = Read(page)
    assert (read.faults, read.open) == ([], [])
    assert len(set(read.ids)) == len(read.ids)
    assert "script" not in read.names
    assert "link" not in read.names
    abroad = [each for each in read.addresses if not each.startswith(("#", "data:"))]
    assert abroad == ["https://example.org/"]  # a link to follow, nothing to load
    assert {each[1:] for each in read.addresses if each.startswith("#")} <= set(read.ids)
    assert "default-src &#x27;none&#x27;" in page


@pytest.mark.slow
def test_a_page_tells_the_question_the_claims_the_settings_and_how_to_repeat_it():
    page = paged(swept(written(Path("delays")), Path("r"), quick=True))
    assert "How long a function takes that only counts." in page
    question = section(page, "question")
    assert "How <em>long</em> does it take?" in question
    assert "None that matters" not in question
    assert "<a>the others</a>" in question  # it stands beside the README, not beside this page
    assert words(section(page, "claims")) == ["holds", "holds", "no data", "holds"]
    claims = section(page, "claims")
    assert "4 rounds" in claims
    assert "3 ± 6.4" in claims  # 2.5 and 3.5: t(0.975, 1) = 12.706, times sqrt(0.5) / sqrt(2)
    assert re.search("4 to 4,? .*within 1 % of 4", claims)
    assert "0 of 1 claims in the interval fail" in claims
    assert "Peterson 2006, IEEE" in claims
    figures = section(page, "figures")
    assert figures.count("<svg ") == 2
    assert 'href="data:text/csv;base64,' in figures
    repeat = section(page, "repeat")
    assert "cosim sweep delays/sweep.yaml --quick -o r\ncosim report r -o report.html" in repeat
    assert "1 to 2, the same for every arm" in repeat
    assert RunStore(Path("r")).description().code in repeat
    assert "<dt>pandas</dt>" not in repeat
    assert re.search(r"<dt>numpy</dt><dd>[0-9.]+</dd>", repeat)
    assert "broken: 0" in section(page, "parameters")


def altered(results: Path, change: Any) -> None:
    """Write the runs in *results* anew, as *change* makes them."""
    store = RunStore(results)
    rows = change(store.present()).to_dict("records")
    shutil.rmtree(results / "runs")
    with store.writing():
        store.append(rows, [], [], {})


@pytest.mark.slow
def test_verdicts_turn_with_the_rows():
    results = swept(written(Path("delays")), Path("r"))
    assert words(paged(results)) == ["holds", "holds", "no data", "holds"]
    altered(results, lambda rows: rows.assign(rounds=rows["rounds"] + 0.1 * (rows["size"] == 2)))
    assert words(paged(results)) == ["fails", "holds", "no data", "holds"]
    altered(results, lambda rows: rows.assign(rounds=rows["rounds"] - 0.1 * (rows["size"] == 2)))
    altered(results, lambda rows: rows.assign(delay_s=rows["delay_s"] - 10.0 * (rows["size"] == 3)))
    assert words(paged(results)) == ["holds", "fails", "no data", "fails"]
    altered(results, lambda rows: rows[rows["replicate"] == 0])
    assert words(paged(results)) == ["open", "open", "no data", "fails"]  # a single run has no interval
    altered(results, lambda rows: rows[rows["size"] == 2])
    assert words(paged(results)) == ["open", "no data", "no data", "no data"]


@pytest.mark.slow
def test_names_errors_and_words_of_all_kinds_stay_text():
    claims = f'"{HOSTILE}","{HOSTILE}","{HOSTILE}","{HOSTILE}",delay_s,,"{HOSTILE}",3,at least\n'
    axis = {"path": "size", "values": {HOSTILE: 2, "plain": 3}}
    source = written(Path("delays"), claims, name=HOSTILE, about=HOSTILE, sweep={"size": axis}, replicates=4)
    Path("delays/README.md").write_text(f"# a\n\n{HOSTILE} `{HOSTILE}` [x](javascript:alert(1))\n\n    {HOSTILE}\n")
    Path("delays/figures.py").write_text(
        f"import pandas\nname = {HOSTILE!r}\n"
        "def tables(runs, seen):\n    return {name: pandas.DataFrame({name: [name]})}\n"
    )
    results = swept(source, Path("r"))
    altered(
        results, lambda rows: rows.assign(error=HOSTILE, status=rows["status"].where(rows["replicate"] > 0, "failed"))
    )
    page = paged(results)
    read = Read(page)
    assert "script" not in read.names
    assert read.faults == []
    assert "alert('x')" in section(page, "failures").replace("&#x27;", "'")
    assert not [each for each in read.addresses if each.startswith("javascript")]
    assert read.text.count(HOSTILE) >= 12


@pytest.mark.slow
def test_runs_that_failed_are_told_with_their_errors():
    page = paged(swept(written(Path("delays")), Path("r"), "broken=3"))
    failures = section(page, "failures")
    assert "3 of 6 runs" in failures
    assert failures.count("ZeroDivisionError: nobody is there") == 3
    assert "6 runs: 2 arms, 3 replicates; 3 failed" in page


@pytest.mark.slow
def test_a_sweep_that_is_not_at_its_end_says_so():
    results = swept(written(Path("delays")), Path("r"))
    altered(results, lambda rows: rows[rows["replicate"] == 0])
    assert "2 of 6 runs: 2 arms, 3 replicates" in paged(results)


@pytest.mark.slow
def test_the_command_report_writes_the_page_beside_what_it_prints(cosim: Any):
    swept(written(Path("delays")), Path("r"))
    plain = cosim("report", "r")
    ended = cosim("report", "r", "-o", "pages/delays.html")
    assert (ended.code, ended.out) == (0, plain.out)
    assert Path("pages/delays.html").read_text(encoding="utf-8") == paged(Path("r"))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("design", "told"),
    [
        ("product", "every combination of the axes"),
        ("one at a time", "4 arms, not all 6 combinations"),
        ({"kind": "latin hypercube", "points": 5}, "5 points of a design, the same seeds"),
        ({"kind": "saltelli", "points": 2}, "points of a design of the kind saltelli"),
    ],
)
def test_a_page_tells_which_combinations_were_run(design: Any, told: str):
    axes: dict[str, Any] = {"size": [2, 3, 4], "broken": [90, 91]}
    if isinstance(design, dict):
        axes = {name: {"path": name, "low": 2, "high": 200} for name in axes}
    results = swept(written(Path("delays"), sweep=axes, design=design), Path("r"), replicates=1)
    page = paged(results)
    assert told in section(page, "parameters").replace("&#x27;", "'")
    assert "cosim sweep delays/sweep.yaml --replicates 1 -o r" in section(page, "repeat")


# ---------------------------------------------------------------- the command


@pytest.mark.parametrize(
    ("sets", "quick", "replicates", "told"),
    [
        ((), False, None, ""),
        ((), True, None, "--quick "),
        ((), False, 5, "--replicates 5 "),
        (("broken=7",), False, None, "--set broken=7 "),
        (("size=3",), True, 4, "--replicates 4 --set size=3 "),
    ],
)
def test_the_command_on_a_page_makes_the_same_runs(
    sets: tuple[str, ...], quick: bool, replicates: int | None, told: str
):
    results = swept(written(Path("delays")), Path("r"), *sets, quick=quick, replicates=replicates)
    sweep = RunStore(results).description()
    base = {"size": 1, "broken": 7 if "broken=7" in sets else 0}
    assert sweep_command(sweep, base, results) == f"cosim sweep delays/sweep.yaml {told}-o r"


@pytest.mark.slow
def test_there_is_no_command_for_an_experiment_that_has_changed():
    source = written(Path("delays"))
    results = swept(source, Path("r"))
    written(Path("delays"), sweep={"size": [2, 4]})
    assert sweep_command(RunStore(results).description(), None, results) is None
    assert "No command makes these runs" in paged(results)


# ---------------------------------------------------------------- markup


def test_only_what_is_markup_already_is_put_in_as_it_is():
    assert tag("b", "<", Html("<i>"), 3, title='"') == '<b title="&quot;">&lt;<i>3</b>'
    assert joined(["&", Html("<br>")], " ") == "&amp; <br>"
    assert tag("td", class_="x", data_label="y", hidden=True, id=None) == '<td class="x" data-label="y" hidden></td>'


def test_an_identifier_is_one_word_and_none_is_two_things():
    assert identifier("claim", "a b/c") == "claim-a_20b_2Fc"
    assert "'" not in identifier("claim", HOSTILE)


@pytest.mark.parametrize(
    ("text", "first"),
    [
        ("# a\n\nb\n\n## c\n\nd\n", "\nb\n\n"),
        ("a\n\n# b\nc\n", "a\n\n"),
        ("# a\n```\n# no heading\n```\nb\n# c\n", "```\n# no heading\n```\nb\n"),
        ("# a\n# b\nc\n", "c\n"),
        ("", ""),
    ],
)
def test_the_first_section_ends_at_the_next_heading(text: str, first: str):
    assert first_section(text) == first


def test_markdown_has_no_markup_of_its_own_and_loads_nothing():
    assert "<img" not in markdown("![x](https://example.org/x.png)")
    assert "&lt;b&gt;" in markdown("<b>x</b>")
