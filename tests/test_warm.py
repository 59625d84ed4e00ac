import json
import os
import subprocess
import sys
from collections.abc import Sequence
from itertools import pairwise, product
from pathlib import Path

import pytest

from cosim.cli import main
from cosim.scenario import protocol_names
from cosim.warm import CHANNELS, ShortRun, Warmed, compile_for, short_runs

FILLS = """
import sys
from cosim.warm import ShortRun, warm

if __name__ == "__main__":
    print(*(each.kernels for each in warm([ShortRun("monitoring", "ideal")])))
"""
RUNS = """
from cosim.jit import counted_compilations
from cosim.cli import main

with counted_compilations() as count:
    try:
        main(["run", "heartbeats.yaml"])
    finally:
        print(count.kernels)
"""
HEARTBEATS = (
    "{duration_s: 5, floorplan: {map: office}, team: {size: 3}, channel: {kind: ideal}, protocol: {use: monitoring}}"
)


def test_every_protocol_is_run_over_every_channel_once_and_neighbours_differ_in_both():
    runs = short_runs()
    assert sorted(runs) == sorted(ShortRun(*each) for each in product(protocol_names(), CHANNELS))
    assert all(one.channel != other.channel for one, other in pairwise(runs))
    assert all(one.protocol != other.protocol for one, other in pairwise(runs[: len(CHANNELS)]))


@pytest.mark.slow
def test_warm_fills_an_empty_cache_so_that_neither_a_run_nor_warm_compiles_again(tmp_path: Path):
    (tmp_path / "fills.py").write_text(FILLS)
    (tmp_path / "heartbeats.yaml").write_text(HEARTBEATS)
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}

    def last(*words: str) -> int:
        line = [sys.executable, *words]
        done = subprocess.run(line, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True)
        return int(done.stdout.split()[-1])

    assert last("fills.py") > 10
    assert last("-c", RUNS) == 0
    assert last("fills.py") == 0


def test_a_protocol_that_needs_more_than_its_defaults_is_left_out():
    warmed = compile_for(ShortRun("reflection", "ideal"))
    assert "protocol.parameters.rooms" in warmed.refused


def told(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], finished: Sequence[Warmed], *words: str
) -> str:
    """Return what ``cosim warm`` prints when the short runs end like *finished*."""
    monkeypatch.setattr("cosim.warm.warm", lambda runs: iter(finished))
    with pytest.raises(SystemExit) as ended:
        main(["warm", *words])
    assert ended.value.code == 0
    return capsys.readouterr().out


def test_warm_tells_what_it_has_compiled_and_what_is_left_out(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    some = Warmed(ShortRun("a", "ideal"), 12, 3.04)
    left = [Warmed(ShortRun("b", channel), 0, 0.1, "parameters.x: is missing") for channel in ("ideal", "adhoc")]
    lines = told(monkeypatch, capsys, [some, *left]).splitlines()
    assert lines[:2] == ["  12 kernels in  3.0 s: a, ideal", "left out: b: parameters.x: is missing"]
    assert lines[2].startswith("12 kernels compiled: ")
    assert len(lines) == 3
    assert told(monkeypatch, capsys, left[:0]).startswith("nothing to compile: ")
    found = json.loads(told(monkeypatch, capsys, [some], "--json"))
    assert found["kernels"] == 12
    assert found["runs"] == [{"protocol": "a", "channel": "ideal", "kernels": 12, "wall_s": 3.04, "refused": ""}]
