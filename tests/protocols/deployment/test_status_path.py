"""What a status goes through, from the bytes to the replica: the six files that docs/architecture.md names."""

import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

import pytest

from cosim.machine import Reception
from cosim.scenario import load
from cosim.simulation import simulate
from cosim.units import Time
from protocols.deployment.messages import status
from protocols.deployment.runner import Runner
from protocols.transport.frames import Publication, decode
from tests.checkout import FLOORS, ROOT

LEADERS_OWN = ("protocols/deployment/executing/", "protocols/deployment/tasks/", "protocols/deployment/team/ledger.py")
"""What a leader asks besides in mid-play: whether a robot is to make room for another, and what the other lacks."""


@contextmanager
def traced() -> Iterator[set[str]]:
    """Yield a set that takes the files of ours in which functions are called."""
    files = set[str]()

    def note(frame: FrameType, event: str, _: object) -> None:
        path = Path(frame.f_code.co_filename)
        if event == "call" and any(path.is_relative_to(ROOT / package) for package in ("cosim", "protocols")):
            files.add(path.relative_to(ROOT).as_posix())

    before = sys.getprofile()
    sys.setprofile(note)
    try:
        yield files
    finally:
        sys.setprofile(before)


def named() -> list[str]:
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    return re.findall(r"^\d\. `([\w/.]+)`", page.partition("## A status,")[2], re.MULTILINE)


def test_a_status_goes_through_the_six_files_that_the_page_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "four.yaml"
    path.write_text(f"""
duration_s: 8
floorplan: {{map: {FLOORS / "wean.yaml"}}}
team:
  size: 4
  body: {{radius_m: 0.33, speed_mps: 0.5, acceleration_mps2: 0.3, drive: differential}}
  senses: {{beams: 180, beam_range_m: 8}}
channel: {{kind: adhoc, range_m: 100}}
protocol:
  use: deployment
  parameters:
    base_m: [3, 34]
    calls: [{{at_s: 3, call: {{play: deploy/wave, places: [B, C, E, F]}}}}]
""")
    seen: list[tuple[Time, bool, set[str]]] = []
    receive = Runner.receive

    def watched(robot: Runner, data: bytes, reception: Reception, now: Time) -> None:
        body = decode(data).body
        decode.cache_clear()  # a frame that another robot has understood is not read again
        with traced() as files:
            receive(robot, data, reception, now)
        if isinstance(body, Publication) and body.topic == status.TOPIC:
            seen.append((now, robot.host.leads, files))

    monkeypatch.setattr(Runner, "receive", watched)
    metrics = simulate(load(path), 1).metrics
    assert metrics["orders"] >= 1
    six = set(named())
    assert len(six) == 6
    started = 2_000_000_000  # by then each has heard its leader say that it leads
    followers = [files for now, leads, files in seen if not leads and now > started]
    assert len(followers) > 50
    assert all(files == six for files in followers)
    leaders = [files - six for _, leads, files in seen if leads]
    assert len(leaders) > 20
    assert all(path.startswith(LEADERS_OWN) for files in leaders for path in files)
