"""The command ``cosim view``: it prints the address of its page, and ends as it is told, with nothing left."""

import json
import os
import signal
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from fnmatch import fnmatch
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import pytest
import yaml
from websockets.sync.client import connect

from cosim.cli import main
from cosim.web.pages import STATIC
from tests.web.console import PLAIN
from tests.web.served import until_closed

ROOT = Path(__file__).parents[2]


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    plain = PLAIN | {"protocol": {"use": "tests.web.console:SPEC", "parameters": {"patient": True}}}
    path = tmp_path / "consoles.yaml"
    path.write_text(yaml.safe_dump(plain))
    return path


@contextmanager
def viewing(*words: str | Path) -> Iterator[tuple[Any, str]]:
    """Run the command in a process of its own, and give that and the address that it has printed."""
    command = [sys.executable, "-m", "cosim.cli", "view", *map(str, words)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT)
    try:
        assert process.stdout is not None
        address = process.stdout.readline().strip()
        assert address.startswith("http://127.0.0.1:"), process.communicate(timeout=60)
        assert process.stdout.readline() == "Ctrl-C ends it\n"
        yield process, address
    finally:
        process.kill()
        process.communicate()


def scene(address: str) -> Any:
    base, _, query = address.partition("?")
    with connect(base.replace("http:", "ws:") + "socket" + (f"?{query}" if query else ""), proxy=None) as page:
        return json.loads(page.recv(timeout=30))


@pytest.mark.slow
def test_a_scenario_is_shown_live_until_it_is_interrupted(scenario: Path):
    with viewing(scenario, "--seed", "7", "--paused", "--token") as (process, address):
        assert "?token=" in address
        assert (scene(address)["live"], scene(address)["seed"]) == (True, 7)
        with urlopen(address, timeout=30) as answer:
            assert b"<canvas" in answer.read()
        with connect(address.replace("http:", "ws:").replace("/?", "/socket?"), proxy=None) as page:
            begun_s = time.monotonic()
            process.send_signal(signal.SIGINT)
            assert until_closed(page) == 1012
        out, err = process.communicate(timeout=30)
        assert (process.returncode, out, err) == (0, "", "")
        assert time.monotonic() - begun_s < 15


@pytest.mark.slow
def test_a_server_that_is_killed_takes_everything_with_it(scenario: Path):
    with viewing(scenario) as (process, address):
        with connect(address.replace("http:", "ws:") + "socket", proxy=None) as page:
            page.recv(timeout=30)
            process.kill()
            assert until_closed(page) is None  # without a word
        assert process.wait(30) == -signal.SIGKILL


@pytest.mark.slow
def test_a_recorded_run_is_shown_from_its_tables(scenario: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    trace = tmp_path / "tables"
    with pytest.raises(SystemExit):
        main(["run", str(scenario), "--trace", str(trace)])
    assert "tables in" in capsys.readouterr().out
    with viewing(trace) as (_, address):
        found = scene(address)
    assert (found["live"], found["name"], found["duration_s"]) == (False, "consoles", 9.9)
    with pytest.raises(SystemExit) as ended:
        main(["view", str(trace), "--seed", "3"])
    assert ended.value.code == 2
    assert "is a recorded run" in capsys.readouterr().err


def test_what_is_not_installed_is_named_in_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr("cosim.web.starting.find_spec", lambda name: None if name == "uvicorn" else name)
    with pytest.raises(SystemExit) as ended:
        main(["view", "pseudonet_coverage"])
    told = capsys.readouterr()
    assert (ended.value.code, told.out) == (2, "")
    assert told.err == "pages need uvicorn, not installed here: pip install 'cosim[web]'\n"


@pytest.mark.slow
def test_the_command_line_does_without_the_server_until_it_is_asked_for():
    """Who has not installed the extra can do everything else."""
    code = "import sys, cosim.cli; print(*sorted({'starlette', 'uvicorn', 'websockets'} & sys.modules.keys()))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=os.environ)
    assert done.stdout.strip() == ""


def test_what_a_browser_loads_is_part_of_the_package():
    packaged = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["package-data"]["cosim"]
    for path in STATIC.rglob("*"):
        name = path.relative_to(ROOT / "cosim").as_posix()
        assert path.is_dir() or any(fnmatch(name, pattern) for pattern in packaged), name
