"""What decides a run: statements, data and libraries that it can reach, and nothing that it cannot."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from cosim import sources
from cosim.errors import UserError
from cosim.experiment import load_experiment
from cosim.sources import Origin, closure, differing, origin
from cosim.sweep import origins_of
from tests.checkout import ROOT

MODULE = '''"""A module."""

import math

LENGTH_M = 3.0
"""A length."""


def area():
    """Return an area."""
    from mine.inner import times  # when it is needed

    return times(LENGTH_M)
'''
PACKAGE = {
    "mine/__init__.py": "",
    "mine/start.py": MODULE,
    "mine/inner.py": "from . import deeper\nfrom .below.leaf import *\n\ndef times(x):\n    return deeper.FACTOR * x\n",
    "mine/deeper.py": "FACTOR = 2\ntry:\n    import not_there_at_all\nexcept ImportError:\n    pass\n",
    "mine/below/__init__.py": "ABOVE = 1\n",
    "mine/below/leaf.py": "LEAF = 1\n",
    "mine/strange.py": "OTHER = 1\n",
    "mine/plays/first.yaml": "steps: 3\n",
    "mine/sweep.yaml": "replicates: 3\n",
    "mine/published.csv": "a,b\n",
    "mine/README.md": "It is mine.\n",
    "mine/apart/__init__.py": "",
    "mine/apart/table.csv": "1,2\n",
}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Have a package of the user's own."""
    for name, text in PACKAGE.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path


def code() -> str:
    return origin(["mine.start"]).code


def test_the_closure_follows_imports_in_functions_relative_ones_and_packages(folder: Path):
    names = {"mine", "mine.start", "mine.inner", "mine.deeper", "mine.below", "mine.below.leaf"}
    assert closure(["mine.start"]).keys() == names


@pytest.mark.parametrize(
    ("file", "old", "new"),
    [
        ("mine/start.py", '"""A module."""', '"""Another text."""'),
        ("mine/start.py", '"""A module."""\n', ""),
        ("mine/start.py", '"""Return an area."""', '"""Return the area.\n\n    In m^2.\n    """'),
        ("mine/start.py", '"""A length."""\n', '"""The length, in m."""\n'),
        ("mine/start.py", "  # when it is needed", ""),
        ("mine/start.py", "LENGTH_M = 3.0", "LENGTH_M    =    (3.0)  # m"),
        ("mine/inner.py", "\n\n", "\n\n\n\n"),
        ("mine/strange.py", "OTHER = 1", "OTHER = 2"),
        ("mine/sweep.yaml", "3", "30"),
        ("mine/published.csv", "a", "c"),
        ("mine/README.md", "mine", "yours"),
        ("mine/apart/table.csv", "1", "3"),
    ],
)
def test_what_changes_no_result_changes_no_code(folder: Path, file: str, old: str, new: str):
    before = code()
    text = (folder / file).read_text()
    assert old in text
    (folder / file).write_text(text.replace(old, new))
    assert code() == before


@pytest.mark.parametrize(
    ("file", "old", "new", "part"),
    [
        ("mine/start.py", "3.0", "3.5", "mine.start"),
        ("mine/start.py", "import math", "import cmath", "mine.start"),
        ("mine/start.py", "times(LENGTH_M)", "times(times(LENGTH_M))", "mine.start"),
        ("mine/inner.py", "FACTOR * x", "FACTOR - x", "mine.inner"),
        ("mine/deeper.py", "FACTOR = 2", "FACTOR = 2.0", "mine.deeper"),
        ("mine/below/__init__.py", "1", "2", "mine.below"),
        ("mine/below/leaf.py", "LEAF = 1", "LEAF = '1'", "mine.below.leaf"),
        ("mine/plays/first.yaml", "3", "4", "mine/plays/first.yaml"),
    ],
)
def test_what_may_change_a_result_changes_the_code_and_is_named(folder: Path, file: str, old: str, new: str, part: str):
    before = origin(["mine.start"])
    text = (folder / file).read_text()
    assert old in text
    (folder / file).write_text(text.replace(old, new))
    after = origin(["mine.start"])
    assert after.code != before.code
    assert differing(before, after) == [part]


def test_data_that_are_added_count_and_those_that_are_given(folder: Path):
    before = origin(["mine.start"])
    (folder / "mine" / "plays" / "second.yaml").write_text("steps: 1\n")
    after = origin(["mine.start"])
    assert differing(before, after) == ["mine/plays/second.yaml"]
    with_folder = origin(["mine.start"], [folder / "mine" / "apart"])
    assert differing(after, with_folder) == ["apart/table.csv"]


def test_versions_of_the_libraries_that_compute_count(folder: Path, monkeypatch: pytest.MonkeyPatch):
    (folder / "mine" / "deeper.py").write_text("import numpy\nimport click\n\nFACTOR = 2\n")
    versions = {"numpy": "1.2.3", "click": "8.0"}
    monkeypatch.setattr(sources, "version", versions.__getitem__)
    sources._library.cache_clear()
    before = origin(["mine.start"])
    assert before.libraries == "numpy 1.2.3"
    versions["click"] = "9.0"  # it only reads what a user types
    sources._library.cache_clear()
    assert origin(["mine.start"]).code == before.code
    versions["numpy"] = "1.2.4"
    sources._library.cache_clear()
    after = origin(["mine.start"])
    assert after.code != before.code
    assert differing(before, after) == ["numpy 1.2.3", "numpy 1.2.4"]
    monkeypatch.undo()
    sources._library.cache_clear()


def test_what_this_process_has_loaded_in_another_state_is_refused(folder: Path):
    import mine.start  # type: ignore[import-not-found]  # noqa: F401

    code()
    (folder / "mine" / "start.py").write_text(MODULE.replace("3.0", "4.0"))
    try:
        with pytest.raises(UserError, match=r"start\.py: was edited after this process had loaded it: start it anew$"):
            code()
    finally:
        for name in [name for name in sys.modules if name.partition(".")[0] == "mine"]:
            del sys.modules[name]


def test_what_was_read_once_is_known_to_the_next_process(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    kept = tmp_path / "cache" / "digests.json"
    monkeypatch.setattr(sources, "_kept", lambda: kept)
    monkeypatch.setattr(sources, "_known", {})
    before = code()
    monkeypatch.setattr(sources, "_known", {})
    with monkeypatch.context() as patch:
        patch.setattr(sources, "_parsed", None)
        assert code() == before
    for damaged in ("", "[1]", '{"a": 3}', '{"a": ["b"]}'):
        kept.write_text(damaged)
        monkeypatch.setattr(sources, "_known", {})
        assert code() == before


# ---------------------------------------------------------------- our own tree

SCRIPT = """
import json, sys
from pathlib import Path
from cosim.sources import differing, origin

roots, edits = json.load(sys.stdin)
before = {name: origin(modules, map(Path, folders)) for name, (modules, folders) in roots.items()}
found = []
for name, file, old, new in edits:
    path = Path(file)
    text = path.read_text()
    assert old in text, (file, old)
    path.write_text(text.replace(old, new, 1))
    modules, folders = roots[name]
    found.append(differing(before[name], origin(modules, map(Path, folders))))
    path.write_text(text)
print(json.dumps(found))
"""
SCENARIO = {"duration_s": 5, "team": {"size": 2}}
EDITS: dict[str, tuple[str, str, str, str, list[str]]] = {
    # what: (the experiment, file, old, new, what differs)
    "the protocol that the scenario names": (
        "robots", "protocols/deployment/__init__.py", '"""', 'CHANGED = 1\n"""', ["protocols.deployment"],
    ),
    "a play of it": (
        "robots", "protocols/deployment/planning/plays/deploy.yaml", "\n", "\n# changed\n",
        ["protocols.deployment.planning/plays/deploy.yaml"],
    ),
    "a docstring of it": ("robots", "protocols/deployment/__init__.py", '"""', '"""Changed. ', []),
    "another protocol": ("robots", "protocols/monitoring/spec.py", "SPEC = ", "CHANGED = SPEC = ", []),
    "the channel that the scenario uses": (
        "robots", "cosim/channels/adhoc/dcf.py", "", "CHANGED = 1\n", ["cosim.channels.adhoc.dcf"],
    ),
    "another channel": ("robots", "cosim/channels/bluetooth/device.py", "", "CHANGED = 1\n", []),
    "the simulation": (
        "robots", "cosim/simulation.py", "", "CHANGED = 1\n", ["cosim.simulation"],
    ),
    "a page": ("robots", "cosim/web/server.py", "", "CHANGED = 1\n", []),
    "the command line": ("robots", "cosim/cli_sweeps.py", "", "CHANGED = 1\n", []),
    "a channel that a function may choose": (
        "function", "cosim/channels/bluetooth/device.py", "", "CHANGED = 1\n",
        ["cosim.channels.bluetooth.device"],
    ),
    "a floor that a function may choose": (
        "function", "experiments/floors/storey.yaml", "\n", "\n# changed\n", ["floors/storey.yaml"],
    ),
    "the sweep.yaml of a function": ("function", "experiments/inquiry_time/sweep.yaml", "replicates", "replikates", []),
    "a page again": ("function", "cosim/web/server.py", "", "CHANGED = 1\n", []),
}  # fmt: skip


@pytest.mark.slow
def test_what_of_our_own_decides_a_run_and_what_does_not(tmp_path: Path):
    sweep = {
        "scenario": SCENARIO | {"protocol": {"use": "deployment"}, "channel": {"kind": "adhoc"}},
        "replicates": 1,
    }
    (tmp_path / "sweep.yaml").write_text(json.dumps(sweep))
    copied = tmp_path / "copy"
    for name in ("cosim", "protocols", "experiments"):
        shutil.copytree(ROOT / name, copied / name, ignore=shutil.ignore_patterns("__pycache__", "static"))
    roots = {}
    for name, path in (("robots", tmp_path), ("function", ROOT / "experiments" / "inquiry_time")):
        (found,) = origins_of(load_experiment(path / "sweep.yaml")).by_roots
        folders = [str(copied / folder.relative_to(ROOT)) for folder in found.folders]
        roots[name] = (sorted(found.modules), folders)
    edits = [edit[:4] for edit in EDITS.values()]
    command = [sys.executable, "-P", "-c", f"import sys; sys.path.insert(0, {str(copied)!r})\n{SCRIPT}"]
    asked = json.dumps([roots, edits])
    ended = subprocess.run(command, input=asked, cwd=copied, stdout=subprocess.PIPE, text=True, check=True)
    differences = dict(zip(EDITS, json.loads(ended.stdout), strict=True))
    assert differences == {what: edit[4] for what, edit in EDITS.items()}


def test_origins_are_compared_by_the_names_of_their_parts():
    def made(libraries: str, **parts: str) -> Origin:
        return Origin("", libraries, tuple(parts.items()))

    ours, theirs = made("numpy 1, scipy 2", a="1", b="2"), made("numpy 1, scipy 3", a="1", b="3", c="4")
    assert differing(ours, ours) == []
    assert differing(ours, theirs) == ["b", "c", "scipy 2", "scipy 3"]
