"""The handbook: its blocks do what it says, and it builds without a warning and names no machine."""

import importlib
import os
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

import click
import pytest

from cosim.cli import commands
from cosim.experiment import experiment_folders
from cosim.report.claims import published_claims
from cosim.report.kept import kept_verdicts
from cosim.report.page import VERDICTS
from tests.checkout import ROOT
from tests.fresh import blocks
from tests.handbook import EXECUTED, PAGES_READ, PageError, Reader, furnish, left_out, title
from tests.oracles.faults_band import BAND_FAULTS
from tests.oracles.faults_rooms import ROOM_FAULTS

MOST_LEFT_OUT = 10


def read(path: Path) -> str:
    """Return the text of a page."""
    return path.read_text(encoding="utf-8")


LANGUAGES = EXECUTED | {"text", "indented", "{toctree}", "{eval-rst}"}
WITH_BLOCKS = [
    path
    for path in PAGES_READ
    if {block.language for block in blocks(path.read_text("utf-8"))} & {*EXECUTED, "indented"}
]


@pytest.fixture
def desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder in which the reader stands, and which is left as it was: modules and paths included."""
    furnish(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    for name, module in list(sys.modules.items()):  # what other tests have loaded of the examples is not the reader's
        if (getattr(module, "__file__", None) or "").startswith(str(ROOT / "examples")):
            monkeypatch.delitem(sys.modules, name)
    known = set(sys.modules)
    yield tmp_path
    for name in set(sys.modules) - known:
        if str(getattr(sys.modules[name], "__file__", "")).startswith(str(tmp_path)):
            del sys.modules[name]


@pytest.mark.slow
@pytest.mark.parametrize("path", WITH_BLOCKS, ids=title)
def test_every_block_does_what_the_page_says(path: Path, desk: Path) -> None:
    Reader(path, desk).follow()


def test_at_most_ten_blocks_are_not_executed() -> None:
    found = [reason for path in PAGES_READ for reason in left_out(path)]
    assert len(found) <= MOST_LEFT_OUT, "\n".join(found)


def test_every_block_says_what_it_is() -> None:
    for path in PAGES_READ:
        for block in blocks(path.read_text(encoding="utf-8")):
            assert block.language in LANGUAGES, f"{title(path)}:{block.line}: {block.language!r}"


@pytest.mark.slow
def test_every_command_and_every_setting_is_in_the_reference(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("sphinx")
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    pages = importlib.import_module("from_code").PAGES
    used = re.findall(r"^<!-- from the code: (\w+) -->$", "".join(map(read, PAGES_READ)), re.MULTILINE)
    assert sorted(used) == sorted(pages)
    for name in commands.list_commands(click.Context(commands)):
        assert f"## `cosim {name}`\n" in pages["command_line"]()
    settings = [pages[name]() for name in ("scenario", "channels", "protocols", "experiment")]
    assert "| `stop_ratio` | number, > 0, ≤ 1 | `1.0` |  |" in settings[2]
    for text in settings:
        assert not re.findall(r"^.*\|  \|$", text, re.MULTILINE), "a setting without a meaning: give it a description"
        links = re.findall(r"\(#([\w-]+)\)", text)
        titles = {title.lower().replace(" ", "-") for title in re.findall(r"^##+ (.*)$", text, re.MULTILINE)}
        assert set(links) <= titles


@pytest.mark.slow
def test_the_site_builds_without_a_warning_and_names_no_machine(tmp_path: Path) -> None:
    pytest.importorskip("sphinx")
    words = [sys.executable, "-m", "sphinx", "-W", "-n", "--keep-going", "-q", "-d", tmp_path / "read"]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    built = subprocess.run(
        [*words, ROOT / "docs", tmp_path / "site"], env=environment, capture_output=True, text=True, check=False
    )
    assert (built.returncode, built.stderr) == (0, "")
    pages = sorted((tmp_path / "site").rglob("*.html"))
    assert {"index.html", "tutorial.html", "validation.html", "tables.html"} <= {path.name for path in pages}
    for page in pages:
        text = page.read_text(encoding="utf-8")
        for name in (str(ROOT), str(Path.home()), sys.prefix, "pypi.org", "pythonhosted"):
            assert name not in text, f"{page.name} names {name}"
    settings = "".join(
        (tmp_path / "site" / "reference" / f"{name}.html").read_text() for name in ("scenario", "protocols")
    )
    assert settings.count("<tr") > 400
    assert "from the code:" not in settings


def test_the_page_on_validation_has_the_numbers_of_cases_and_verdicts() -> None:
    page = (ROOT / "docs" / "validation.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)` \| ([\d |]+) \| \w", page, re.MULTILINE)
    told = {name: [int(number or 0) for number in map(str.strip, cells.split("|"))] for name, cells in rows}
    expected = {}
    for name, folder in experiment_folders().items():
        if claims := published_claims(folder):
            verdicts = Counter(kept.verdict for kept in kept_verdicts(folder).values())
            expected[name] = [len(claims), *(verdicts[word] for word in VERDICTS if word != "no data")]
    assert told == expected
    for name, counts in re.findall(r"\| (\d+), 10 000 \| `(\S+)`", page):
        assert f"\nDEFAULT = {name}\n" in (ROOT / counts).read_text(encoding="utf-8")
    assert f"| {len(BAND_FAULTS) + len(ROOM_FAULTS)} errors planted in" in page


@pytest.mark.parametrize(
    ("page", "why"),
    [
        ("```python\nprint(1)\n```\n\n```text\n2\n```\n", "it prints\n1\n"),
        ("```python\nraise ValueError('no')\n```\n", "no"),
        ("```console\n$ echo a\nb\n```\n", "it prints\na\n"),
        ("```console\n$ false\n```\n", "false: exit code 1"),
        ("```yaml\nduration_s: -1\nprotocol: {use: monitoring}\n```\n", "greater than 0"),
        ("```console\n$ cosim validate examples/1_coverage.yaml --set team.size=none\n```\n", "exit code 2"),
    ],
)
def test_a_block_that_does_something_else_is_noticed(page: str, why: str, desk: Path) -> None:
    path = desk / "page.md"
    path.write_text(page, encoding="utf-8")
    with pytest.raises(PageError, match=re.escape(why)):
        Reader(path, desk).follow()
