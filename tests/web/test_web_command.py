"""The commands that show a page: each prints the address of it, and ends as it is told, with nothing left."""

import json
import signal
import sys
import time
import tomllib
from fnmatch import fnmatch
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import pytest
import yaml
from websockets.sync.client import connect

from cosim.cli import main
from cosim.sweep import CLUSTER_NEEDS
from cosim.web.pages import STATIC
from cosim.web.starting import NEEDED
from tests.web.commanded import ROOT, Commanded, commanded
from tests.web.console import PLAIN
from tests.web.served import next_of, until_closed


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    plain = PLAIN | {"protocol": {"use": "tests.web.console:SPEC", "parameters": {"patient": True}}}
    path = tmp_path / "consoles.yaml"
    path.write_text(yaml.safe_dump(plain))
    return path


LAZY = "import sys, cosim.cli; print(*({'starlette', 'uvicorn', 'websockets'} & sys.modules.keys())); cosim.cli.main()"
"""The command, which first prints what it has loaded of the server already."""


def scene(shown: Commanded) -> Any:
    with connect(shown.socket, proxy=None) as page:
        return json.loads(page.recv(timeout=30))


def interrupted(shown: Commanded) -> None:
    """Interrupt the command: it tells its page, and ends soon, in silence, and well."""
    with connect(shown.socket, proxy=None) as page:
        begun_s = time.monotonic()
        shown.process.send_signal(signal.SIGINT)
        assert until_closed(page) == 1012
    out, err = shown.process.communicate(timeout=30)
    assert (shown.process.returncode, out, err) == (0, "", "")
    assert time.monotonic() - begun_s < 15


@pytest.mark.slow
def test_a_scenario_is_shown_live_until_it_is_interrupted(scenario: Path):
    with commanded("view", scenario, "--seed", "7", "--paused", "--token") as shown:
        assert "?token=" in shown.address
        told = scene(shown)
        assert (told["live"], told["attended"], told["seed"]) == (True, False, 7)
        with urlopen(shown.address, timeout=30) as answer:
            assert b"<canvas" in answer.read()
        interrupted(shown)


@pytest.mark.slow
def test_a_playbook_is_shown_live_until_it_is_interrupted(scenario: Path):
    with commanded("playbook", scenario, "--speed", "5", "--seed", "3", "--paused") as shown:
        told = scene(shown)
        assert (told["live"], told["attended"], told["seed"]) == (True, True, 3)
        with urlopen(shown.address, timeout=30) as answer:
            assert b'id="plays"' in answer.read()
        with connect(shown.socket, proxy=None) as page:
            now = next_of(page, "now")
        assert (now["speed"], now["state"]) == (5, "paused")
        interrupted(shown)


@pytest.mark.slow
def test_a_recorded_run_is_shown_from_its_tables(scenario: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """Until then the command line has done without the server: who has not installed the extra can do all else."""
    trace = tmp_path / "tables"
    with pytest.raises(SystemExit):
        main(["run", str(scenario), "--trace", str(trace)])
    assert "tables in" in capsys.readouterr().out
    with commanded("view", trace, command=(sys.executable, "-c", LAZY)) as shown:
        found = scene(shown)
    assert shown.before == [""]
    assert (found["live"], found["name"], found["duration_s"]) == (False, "consoles", 9.9)
    with pytest.raises(SystemExit) as ended:
        main(["view", str(trace), "--seed", "3"])
    assert ended.value.code == 2
    assert "is a recorded run" in capsys.readouterr().err


def test_a_command_that_says_nothing_is_not_waited_for():
    silent = (sys.executable, "-S", "-c", "input()")
    with pytest.raises(AssertionError), commanded(command=silent, long_s=0.2):
        pass


def test_what_is_not_installed_is_named_in_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr("cosim.installed.find_spec", lambda name: None if name == "uvicorn" else name)
    with pytest.raises(SystemExit) as ended:
        main(["view", "pseudonet_coverage"])
    told = capsys.readouterr()
    assert (ended.value.code, told.out) == (2, "")
    assert told.err == "pages need what is not installed here: pip install 'uvicorn>=0.54'\n"


def test_what_is_needed_is_the_extra():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    assert list(NEEDED) == extras["web"]
    assert list(CLUSTER_NEEDS) == extras["cluster"]


def test_what_a_browser_loads_is_part_of_the_package():
    packaged = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["package-data"]["cosim"]
    for path in STATIC.rglob("*"):
        name = path.relative_to(ROOT / "cosim").as_posix()
        assert path.is_dir() or any(fnmatch(name, pattern) for pattern in packaged), name
