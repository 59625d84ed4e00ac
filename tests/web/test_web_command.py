"""The commands that show a page: each prints the address of it, and ends as it is told, with nothing left."""

import json
import signal
import sys
import time
import tomllib
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import pytest
import yaml
from websockets.sync.client import connect

from cosim import cli
from cosim.cli import WEB_NEEDS, _pages, main
from cosim.cluster import BATCH_SYSTEM_NEEDS, NEEDS
from cosim.env import GYM_NEEDS
from cosim.web.server import STATIC, Session
from protocols.deployment.operator.page import PAGE as PLAYBOOK
from tests.web.commanded import ROOT, Commanded, commanded
from tests.web.console import PLAIN
from tests.web.served import Served, next_of, until_closed


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
    assert told.err == "pages need what is not installed here: pip install 'uvicorn>=0.52.1'\n"


def test_what_is_needed_is_the_extra():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    assert list(WEB_NEEDS) == extras["web"]
    assert list(NEEDS) == extras["cluster"]
    assert list(BATCH_SYSTEM_NEEDS) == [each.replace("dask-jobqueue", "dask_jobqueue") for each in extras["slurm"]]
    assert list(GYM_NEEDS) == extras["gym"]


@pytest.mark.parametrize("folder", [STATIC, PLAYBOOK.html.parent])
def test_what_a_browser_loads_is_part_of_its_package(folder: Path):
    package = folder.relative_to(ROOT).parts[0]
    packaged = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["package-data"][package]
    inside = {path for pattern in packaged for path in (ROOT / package).glob(pattern)}
    assert [path for path in folder.rglob("*") if path.is_file() and path not in inside] == []


# ---------------------------------------------------------------- pages of protocols of one's own

OWN = """
from dataclasses import replace
from pathlib import Path
from cosim.page import WebPage
from tests.web.console import SPEC

PAGE = WebPage("Talk to robots.", "Run SCENARIO and talk.", Path(__file__).parent / "talk" / "talk.html")
SPEC = replace(SPEC, page=PAGE)
"""


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Install a protocol with a page, a page that is missing, and what is no page; return a scenario of the first."""
    (tmp_path / "own.py").write_text(OWN)
    (tmp_path / "talk").mkdir()
    for name in ("talk.html", "talk.js"):
        (tmp_path / "talk" / name).write_text(f"this is {name}")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "own", raising=False)
    points = [("talk", "own:PAGE"), ("lost", "nowhere:PAGE"), ("odd", "own:SPEC")]
    made = {name: EntryPoint(name, value, "cosim.pages") for name, value in points}
    monkeypatch.setattr("cosim.cli._pages", lambda: _pages() | made)
    path = tmp_path / "own.yaml"
    path.write_text(yaml.safe_dump(PLAIN | {"protocol": {"use": "own:SPEC", "parameters": {"patient": True}}}))
    return path


def test_installed_pages_are_commands_and_a_broken_one_hides_no_other(own: Path, cosim: Any):
    ended = cosim("--help")
    assert (ended.code, ended.err) == (0, "")
    lines = [" ".join(line.split()) for line in ended.out.splitlines()]
    commands = [line for line in lines[lines.index("Commands:") + 1 :] if line]
    assert {"talk Talk to robots.", "playbook Call plays of a run from a page."} <= {*commands}
    names = sorted([*cli.commands.commands, "lost", "odd", "playbook", "talk"])
    assert [command.split()[0] for command in commands] == names
    assert "Run SCENARIO and talk." in cosim("talk", "--help").out
    assert cosim("lost", "--seed", "3") == (2, "", "lost: No module named 'nowhere'\n")
    assert cosim("odd", str(own)) == (2, "", "odd: own:SPEC is no cosim.page.WebPage\n")


@pytest.mark.parametrize("command", ["talk", "playbook"])
def test_the_page_that_a_protocol_brings_is_shown_with_all_in_its_folder(
    own: Path, command: str, cosim: Any, monkeypatch: pytest.MonkeyPatch
):
    told = []

    def serve(session: Session, page: Path, *more: Any) -> None:
        served = Served(session, page=page)
        told.extend(served.get(path)[1] for path in ("/", "/page/talk.js"))
        told.append(session.scene["attended"])
        served.stop()

    monkeypatch.setattr("cosim.web.server.serve", serve)
    assert cosim(command, str(own), "--paused") == (0, "", "")
    assert told == ["this is talk.html", "this is talk.js", True]
