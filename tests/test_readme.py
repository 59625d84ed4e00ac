"""The README is short, and complete; what its blocks say is executed in ``test_handbook.py``."""

import re

import yaml

from cosim import __version__
from tests.checkout import ROOT

README = (ROOT / "README.md").read_text(encoding="utf-8")


def block(language: str) -> str:
    text: str = re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)[0]
    return text


def test_the_examples_are_as_short_as_promised() -> None:
    assert len(block("yaml").splitlines()) <= 11
    assert len([line for line in block("python").splitlines() if line]) <= 10


def test_every_experiment_is_in_the_table() -> None:
    folders = sorted(path.parent.name for path in ROOT.glob("experiments/*/sweep.yaml"))
    assert folders
    for name in folders:
        assert f"[{name}](experiments/{name}/README.md)" in README


def test_the_version_is_the_same_wherever_it_stands() -> None:
    root = ROOT
    assert yaml.safe_load((root / "CITATION.cff").read_text(encoding="utf-8"))["version"] == __version__
    assert f"\n## {__version__}, " in (root / "CHANGELOG.md").read_text(encoding="utf-8")
    assert f"cosim_robots-{__version__}-py3" in README


def test_every_page_of_the_handbook_is_reached_from_the_readme() -> None:
    pages = {path.relative_to(ROOT).as_posix() for path in ROOT.glob("docs/guides/*.md") if path.stem != "index"}
    assert len(pages) >= 7
    assert not [page for page in pages if f"({page})" not in README]
