"""Who hides whom among packages of one name: ours, which extend their paths, and the user's."""

import sys
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from cosim.errors import UserError
from cosim.installed import find_named, hiding, installed_folders, loaded

EXTENDS = "from pkgutil import extend_path\n\n__path__ = extend_path(__path__, __name__)\n"


@pytest.fixture
def ours(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return where cosim is installed: a folder that Python looks in, with a package ``gadgets`` and a module in it."""
    package = tmp_path / "site" / "gadgets"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text(EXTENDS)
    (package / "lever.py").write_text("SPEC = 'ours'\n")
    monkeypatch.setattr("cosim.installed.OURS", tmp_path / "site")
    monkeypatch.setattr(sys, "path", [str(tmp_path / "site"), *sys.path])
    monkeypatch.setattr(sys, "modules", dict(sys.modules))
    return package


@pytest.fixture
def hers(ours: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder of the same name where the user stands, which is not looked in yet."""
    package = tmp_path / "home" / "gadgets"
    package.mkdir(parents=True)
    (package / "mine.py").write_text("SPEC = 'hers'\n")
    monkeypatch.chdir(package.parent)
    return package


def first(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let Python look in *folder* first, as it does for a script that stands there."""
    monkeypatch.setattr(sys, "path", [str(folder), *sys.path])


def last(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let Python look in *folder* last, as the command line does."""
    monkeypatch.setattr(sys, "path", [*sys.path, str(folder)])


@pytest.mark.parametrize("look", [first, last])
def test_a_folder_without_a_root_extends_ours(look, ours: Path, hers: Path, monkeypatch: pytest.MonkeyPatch):
    look(hers.parent, monkeypatch)
    assert find_named("gadgets.mine:SPEC") == "hers"
    assert find_named("gadgets.lever:SPEC") == "ours"
    with pytest.raises(ImportError, match=r"No module named 'gadgets\.wheel'"):
        find_named("gadgets.wheel:SPEC")


def test_a_root_of_hers_does_no_harm_where_ours_is_found_first(ours: Path, hers: Path, monkeypatch: pytest.MonkeyPatch):
    (hers / "__init__.py").write_text("SPEC = 'hidden'\n")
    last(hers.parent, monkeypatch)
    assert find_named("gadgets.mine:SPEC") == "hers"
    assert find_named("gadgets.lever:SPEC") == "ours"
    with pytest.raises(ImportError) as raised:
        find_named("gadgets:SPEC")
    assert str(raised.value) == f"cosim's own gadgets/__init__.py hides {hers / '__init__.py'}: rename the second"


def test_what_her_root_hides_is_told_with_the_way_out(ours: Path, hers: Path, monkeypatch: pytest.MonkeyPatch):
    (hers / "__init__.py").touch()
    first(hers.parent, monkeypatch)
    told = (
        f"{hers / '__init__.py'} hides cosim's own gadgets/__init__.py: "
        "rename the first, or delete it if it is an empty __init__.py, or start python with -P"
    )
    assert find_named("gadgets.mine:SPEC") == "hers"
    with pytest.raises(ImportError) as raised:
        find_named("gadgets.lever:SPEC")
    assert str(raised.value) == told
    with pytest.raises(ImportError) as raised:
        loaded(EntryPoint("lever", "gadgets.lever:SPEC", "cosim.gadgets"))
    assert str(raised.value) == told
    with pytest.raises(ImportError, match=r"No module named 'gadgets\.wheel'"):  # which nobody hides
        find_named("gadgets.wheel:SPEC")


def test_what_is_ours_is_not_taken_for_hers_of_the_same_name(ours: Path, hers: Path, monkeypatch: pytest.MonkeyPatch):
    (hers / "lever.py").write_text("SPEC = 'hers'\n")
    last(hers.parent, monkeypatch)
    with pytest.raises(ImportError) as raised:
        find_named("gadgets.lever:SPEC")
    assert str(raised.value) == f"cosim's own gadgets/lever.py hides {hers / 'lever.py'}: rename the second"
    assert loaded(EntryPoint("lever", "gadgets.lever:SPEC", "cosim.gadgets")) == "ours"


def test_a_module_above_which_a_folder_of_ours_stands_is_told(ours: Path, hers: Path, monkeypatch: pytest.MonkeyPatch):
    for folder, module in ((ours, "__init__"), (hers, "own")):
        (folder / "cranes").mkdir()
        (folder / "cranes" / f"{module}.py").touch()
    last(hers.parent, monkeypatch)
    with pytest.raises(ImportError) as raised:
        find_named("gadgets.cranes.own:SPEC")
    assert str(raised.value) == f"cosim's own gadgets/cranes/__init__.py hides {hers / 'cranes'}: rename the second"


def test_a_module_of_hers_hides_our_package(ours: Path, hers: Path, monkeypatch: pytest.MonkeyPatch):
    module = hers.parent / "gadgets.py"
    module.touch()
    first(hers.parent, monkeypatch)
    monkeypatch.setattr("cosim.installed.entry_points", lambda group: [EntryPoint("levers", "gadgets.levers", group)])
    (ours / "levers").mkdir()
    (ours / "levers" / "__init__.py").touch()
    hidden = hiding("gadgets.levers")
    assert hidden == (module, ours / "__init__.py")
    with pytest.raises(UserError) as raised:
        installed_folders("cosim.levers")
    assert str(raised.value) == str(hidden)


def test_folders_of_entry_points_are_found(ours: Path, monkeypatch: pytest.MonkeyPatch):
    points = [EntryPoint(name, f"gadgets.{name}", "cosim.levers") for name in ("winch", "missing", "crane")]
    monkeypatch.setattr("cosim.installed.entry_points", lambda group: points)
    for name in ("winch", "crane"):
        (ours / name).mkdir()
    assert list(installed_folders("cosim.levers").items()) == [("crane", ours / "crane"), ("winch", ours / "winch")]
