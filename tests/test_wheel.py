"""The wheel in a clean environment: every command, typed where a user has folders of her own that have our names.

The libraries are those of the environment that runs the tests: a .pth file names its folder, whose own .pth files, and
so an editable install, are not read then. Kernels are not compiled: a new folder would have them compiled anew.
"""

import json
import os
import shutil
import signal
import subprocess
import sys
import sysconfig
from pathlib import Path
from subprocess import CompletedProcess
from typing import Any, NamedTuple
from urllib.request import urlopen
from venv import EnvBuilder
from zipfile import ZipFile

import pytest

from cosim import __version__
from tests.checkout import ROOT

PACKAGES = ("cosim", "protocols", "experiments")
ROOM = "duration_s: 2\nteam: {size: 2}\nprotocol: {use: %s}\n"
TINY = """\
name: tiny
scenario: {duration_s: 5, protocol: {use: "protocols.mine:SPEC"}}
sweep: {team.size: [2, 3]}
replicates: 2
"""
OWN = "from pathlib import Path\nfrom cosim.scenario import load\nimport protocols.mine\nload(Path('ours.yaml'))\n"
AFTER_ANOTHER = """\
import io, json, sys
from contextlib import redirect_stdout
import cosim
from cosim.cli import main
said = []
for words in json.loads(sys.argv[1]):
    with redirect_stdout(io.StringIO()) as out:
        try:
            main(words)
        except SystemExit as ended:
            assert not ended.code, words
    said.append(out.getvalue())
print(json.dumps([*said, cosim.__file__]))
"""
"""Runs commands in one process, which is started once, and prints what each has printed, and where cosim is."""


class Installed(NamedTuple):
    """The wheel, installed."""

    wheel: Path
    bin: Path

    def run(self, folder: Path, *words: str) -> CompletedProcess[str]:
        """Run a program of the environment in *folder*."""
        return subprocess.run(
            [self.bin / words[0], *words[1:]],
            cwd=folder,
            env=environment(),
            capture_output=True,
            text=True,
            timeout=120,
        )

    def done(self, folder: Path, *words: str) -> str:
        """Run it, and return what it prints; it must end well and say nothing else."""
        ended = self.run(folder, *words)
        assert (ended.returncode, ended.stderr) == (0, ""), ended
        return ended.stdout


def environment() -> dict[str, str]:
    """Return the environment of a process that sees nothing of this checkout."""
    ours = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "COV_", "VIRTUAL_ENV"))}
    return ours | {"NUMBA_DISABLE_JIT": "1"}


def pip(*words: str | Path) -> None:
    """Run the pip of the environment that runs the tests."""
    command = [sys.executable, "-m", "pip", "--disable-pip-version-check", *words]
    ended = subprocess.run(command, env=environment(), capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stdout + ended.stderr


@pytest.fixture(scope="session")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Installed:
    """Build the wheel from a copy of the sources, which leaves nothing among them, and install it without libraries."""
    folder = tmp_path_factory.mktemp("wheel")
    source = folder / "source"
    for package in PACKAGES:
        shutil.copytree(ROOT / package, source / package, ignore=shutil.ignore_patterns("__pycache__", ".*"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    pip("wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", folder, source)
    (wheel,) = folder.glob("*.whl")
    EnvBuilder(symlinks=True).create(folder / "venv")
    bin_folder = folder / "venv" / "bin"
    pip("--python", bin_folder / "python", "install", "--no-deps", "--no-index", "--no-compile", wheel)
    (site,) = (folder / "venv").glob("lib/python*/site-packages")
    (site / "libraries.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return Installed(wheel, bin_folder)


@pytest.fixture(params=["", "__init__.py"], ids=["folders", "packages"])
def home(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """Return a user's folder, with folders in it that have our names, or packages."""
    for name in ("protocols", "experiments", "tests"):
        (tmp_path / name).mkdir()
        if request.param:
            (tmp_path / name / request.param).touch()
    shutil.copy(ROOT / "tests" / "data" / "beacon.py", tmp_path / "protocols" / "mine.py")
    (tmp_path / "mine.yaml").write_text(ROOM % '"protocols.mine:SPEC"')
    (tmp_path / "ours.yaml").write_text(ROOM % "gathering")
    (tmp_path / "sweep.yaml").write_text(TINY)
    (tmp_path / "own.py").write_text(OWN)
    return tmp_path


def page_of(installed: Installed, folder: Path, *words: str) -> bytes:
    """Return the page that a command shows, which is then interrupted, and ends well."""
    streams: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen([installed.bin / "cosim", *words], cwd=folder, env=environment(), **streams) as process:
        try:
            address = process.stdout.readline().strip()
            assert address.startswith("http://127.0.0.1:"), process.communicate(timeout=60)
            assert process.stdout.readline() == "Ctrl-C ends it\n"
            with urlopen(address, timeout=60) as answer:
                page: bytes = answer.read()
            process.send_signal(signal.SIGINT)
            assert (*process.communicate(timeout=60), process.returncode) == ("", "", 0)
        finally:
            process.kill()
    return page


@pytest.mark.slow
def test_the_wheel_holds_all_files_and_no_others(installed: Installed) -> None:
    with ZipFile(installed.wheel) as archive:
        held = {name for name in archive.namelist() if ".dist-info/" not in name}
    source = installed.wheel.parent / "source"
    wanted = {path for package in PACKAGES for path in (source / package).rglob("*") if path.is_file()}
    assert held == {path.relative_to(source).as_posix() for path in wanted}
    assert installed.wheel.name.startswith(f"cosim_robots-{__version__}-py3-")


@pytest.mark.slow
def test_an_editable_install_is_a_folder_to_look_in_as_the_wheels_is(installed: Installed) -> None:
    """One by a finder of its own comes after all folders: a user's folder would hide ours, with or without a root."""
    source = installed.wheel.parent / "source"
    build = "import sys; from setuptools.build_meta import build_editable; build_editable(sys.argv[1])"
    words = [sys.executable, "-P", "-c", build, installed.bin]
    subprocess.run(words, cwd=source, env=environment(), capture_output=True, check=True)
    (built,) = installed.bin.glob("*.whl")
    with ZipFile(built) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith(".pth"))
        assert archive.read(name).decode().split() == [str(source)]


@pytest.mark.slow
def test_every_command_runs_beside_a_users_folders_of_our_names(installed: Installed, home: Path) -> None:
    (site,) = installed.bin.parent.glob("lib/python*/site-packages")
    assert "heard " in installed.done(home, "cosim", "run", "mine.yaml")
    told = json.loads(installed.done(home, "python", "-m", "cosim", "run", "ours.yaml", "--json"))
    assert told["parameters"]["protocol"]["use"] == "gathering"
    sweep = ("sweep", "sweep.yaml", "--jobs", "2")
    assert installed.done(home, "cosim", *sweep) == "4 runs, 0 of them were there already, in results/tiny\n"
    commands = (
        ("--version",),
        ("--help",),
        ("validate", "mine.yaml"),
        ("list", "--json"),
        sweep,
        ("report", "results/tiny"),
    )
    version, told_help, valid, names, again, reported, loaded = json.loads(
        installed.done(home, "python", "-P", "-c", AFTER_ANOTHER, json.dumps(commands))
    )
    assert Path(loaded) == site / "cosim" / "__init__.py"
    assert version == f"cosim, version {__version__}\n"
    assert "playbook" in told_help
    assert "floorplan:" in valid
    listed = json.loads(names)
    assert {"deployment_wean", "pseudonet_coverage"} <= listed["experiments"].keys()
    assert str(site / "experiments" / "floors" / "wean.yaml") in listed["maps"]
    assert not [about for about in listed["protocols"].values() if "is not a protocol" in about]
    assert again == "4 runs, 4 of them were there already, in results/tiny\n"
    assert "figure: results/tiny/" in reported


@pytest.mark.slow
@pytest.mark.parametrize("home", ["__init__.py"], indirect=True, ids=["packages"])
def test_pages_are_shown_beside_a_users_packages_of_our_names(installed: Installed, home: Path) -> None:
    assert b"<canvas" in page_of(installed, home, "view", "mine.yaml")
    assert b'id="plays"' in page_of(installed, home, "playbook", "deployment_wean")


@pytest.mark.slow
def test_a_script_of_the_users_is_told_who_hides_whom(installed: Installed, home: Path) -> None:
    ended = installed.run(home, "python", "own.py")
    if not (home / "protocols" / "__init__.py").exists():
        assert (ended.returncode, ended.stderr) == (0, "")
        return
    assert ended.returncode == 1
    hidden = f"{home / 'protocols' / '__init__.py'} hides cosim's own protocols/__init__.py: "
    line = ended.stderr.splitlines()[-1]
    assert line.startswith(f"cosim.errors.UserError: ours.yaml: protocol.use: 'gathering' is not a protocol: {hidden}")
    (home / "protocols" / "__init__.py").unlink()  # the way out that it names
    assert installed.done(home, "python", "own.py") == ""
