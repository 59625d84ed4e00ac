"""Live runs: outcomes, who is refused, and how they end. What they take in time is measured in the soak alone."""

import json
import os
import pickle
import re
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from statistics import median
from struct import Struct
from typing import Any

import pytest

from cosim.channels.ideal import IdealSettings
from cosim.errors import LocalProtocolError, UserError
from cosim.live.apart import check_apart
from cosim.live.handing import handed
from cosim.live.robot import bound_socket
from cosim.live.team import live
from cosim.scenario import Scenario, build
from cosim.simulation import Outcome, simulate
from cosim.units import to_seconds
from tests.tiers import SOAK_SHARE

TIMEOUT_S = 0.5
MONITORING = {"period_s": 0.2, "detector": {"kind": "fixed", "timeout_s": TIMEOUT_S}}
BOUND_S = TIMEOUT_S
"""A robot that dies was heard before: it is suspected no later than the time-out after its death."""
EXPLORING = {"algorithm": "schemas", "map": "messages", "steering": {"speed_mps": 0.3}}
EXPLORERS = {
    "size": 3,
    "senses": {"beams": 90, "beam_range_m": 2.5},
    "body": {"radius_m": 0.25, "speed_mps": 0.6, "drive": "differential"},
}
PATIENCE_S = 60
"""How long a test waits for what takes a few seconds on an idle machine."""


def plain(use: str, parameters: Any, duration_s: float = 2.5, **settings: Any) -> dict[str, Any]:
    return {
        "duration_s": duration_s,
        "floorplan": {"map": "walls", "bounds_m": [0, 0, 12, 12]},
        "team": {"size": 3},
        "protocol": {"use": use, "parameters": parameters},
    } | settings


def scenario(use: str, parameters: Any, **settings: Any) -> Scenario:
    return build(plain(use, parameters, **settings), "test", Path())


def monitoring(**settings: Any) -> dict[str, Any]:
    """Return a run in which a busy machine does not lead to suspicions: the time-out is longer than any delay."""
    return plain("monitoring", MONITORING | {"detector": {"kind": "fixed", "timeout_s": 1.0}}, **settings)


class Run:
    """``cosim live`` as a process of its own, and what it has said."""

    def __init__(self, settings: dict[str, Any], folder: Path) -> None:
        path = folder / "run.yaml"
        path.write_text(json.dumps(settings))
        words = [sys.executable, "-m", "cosim", "live", str(path), "--udp", "--json"]
        self.process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.robots: dict[int, tuple[int, int]] = {}
        """Process and port of each robot, once it has begun."""
        self._timer = threading.Timer(PATIENCE_S, self.process.kill)
        self._timer.start()

    def begun(self) -> None:
        assert self.process.stderr is not None
        for line in self.process.stderr:
            if found := re.fullmatch(r"robot (\d+): process (\d+), UDP 127.0.0.1:(\d+)\n", line):
                self.robots[int(found[1])] = int(found[2]), int(found[3])
            if "Ctrl-C ends all" in line:
                return
        raise AssertionError("it has not begun")

    def ended(self) -> tuple[int, Any, str]:
        """Wait for its end, and return its code, its metrics and what it has said since."""
        out, said = self.process.communicate()
        return self.process.returncode, json.loads(out)["metrics"] if out else None, said

    def close(self) -> None:
        self._timer.cancel()
        self.process.kill()
        self.process.communicate()


@pytest.fixture
def started(tmp_path: Path) -> Iterator[Any]:
    runs: list[Run] = []

    def start(settings: dict[str, Any]) -> Run:
        runs.append(Run(settings, tmp_path))
        runs[-1].begun()
        return runs[-1]

    yield start
    for run in runs:
        run.close()


def is_gone(pid: int) -> bool:
    """Whether there is no such process, or none that does anything."""
    with suppress(OSError):
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    return True


def in_the_end(holds: Callable[[], bool]) -> bool:
    """Whether *holds* comes true while one waits."""
    waited = threading.Event()
    return any(holds() or waited.wait(0.01) for _ in range(100 * PATIENCE_S))


# ---------------------------------------------------------------- outcomes


@pytest.mark.slow
def test_monitors_that_are_processes_notice_that_one_is_killed(started: Any) -> None:
    run = started(monitoring(faults=[{"kind": "kill", "robot": 2, "at_s": 0.53}]))
    assert sorted(run.robots) == [0, 1, 2]
    code, metrics, said = run.ended()
    assert code == 0
    assert f"process {run.robots[2][0]} is killed" in said
    assert metrics["robots_killed"] == 1
    assert metrics["died_at_s"] == 0.53
    assert metrics["suspicions_standing"] >= 2
    assert metrics["suspected_at_s"] > 0.53
    assert metrics["heartbeats_heard"] > 0
    assert metrics["simulated_s"] == 2.5
    assert all(is_gone(pid) for pid, _ in run.robots.values())


@pytest.mark.slow
def test_a_process_that_somebody_kills_is_a_robot_that_dies(started: Any) -> None:
    run = started(monitoring())
    os.kill(run.robots[1][0], signal.SIGKILL)
    code, metrics, said = run.ended()
    assert code == 0
    assert re.search(r"^robot 1 at [\d.]+ s: its process has ended$", said, re.MULTILINE)
    assert metrics["robots_killed"] == 1
    assert metrics["suspicions_standing"] >= 2


@pytest.mark.slow
def test_explorers_that_are_processes_explore(started: Any) -> None:
    run = started(plain("exploration", EXPLORING, 2.0, team=EXPLORERS))
    code, metrics, _ = run.ended()
    assert code == 0
    assert metrics["frames"] > 0
    assert metrics["distance_m"] > 0.1
    assert metrics["coverage"] > 0.02
    assert metrics["robots_killed"] == 0


@pytest.mark.slow
def test_links_are_the_ideal_channels(started: Any) -> None:
    parameters = {"message_octets": 4, "transport": {"links": {"beat_s": 0.5}}}
    run = started(plain("agents", parameters, 1.5, channel={"kind": "bluetooth"}))
    code, metrics, _ = run.ended()
    assert code == 0
    assert metrics["frames_sent"] > 0, "a master that has slaves lets itself be heard"


# ---------------------------------------------------------------- ends


@pytest.mark.slow
def test_no_robot_holds_the_teams_end_of_a_pipe(started: Any) -> None:
    run = started(monitoring(duration_s=PATIENCE_S))
    pids = [pid for pid, _ in run.robots.values()]
    assert pids
    assert in_the_end(lambda: all(sockets_of(pid) == 2 for pid in pids)), "more than its own end, and UDP"


def sockets_of(pid: int) -> int:
    """Return how many sockets a process has open."""
    found = 0
    for each in Path(f"/proc/{pid}/fd").iterdir():
        with suppress(FileNotFoundError):  # opened for a moment
            found += str(each.readlink()).startswith("socket:")
    return found


@pytest.mark.slow
@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_whatever_ends_it_no_process_is_left(how: signal.Signals, started: Any) -> None:
    run = started(monitoring(duration_s=PATIENCE_S))
    run.process.send_signal(how)
    code, metrics, _ = run.ended()
    assert code == (130 if how == signal.SIGINT else -signal.SIGKILL)
    assert metrics is None
    assert in_the_end(lambda: all(is_gone(pid) for pid, _ in run.robots.values())), "a robot is left"


class Broken:
    """A machine whose deadline is a mistake."""

    def __init__(self, machine: Any, mistake: type[Exception]) -> None:
        self._machine = machine
        self._mistake = mistake

    def __getattr__(self, name: str) -> Any:
        return getattr(self._machine, name)

    def wake(self, now: int) -> None:
        raise self._mistake("one heartbeat too many")


@pytest.mark.slow
@pytest.mark.parametrize("mistake", [ZeroDivisionError, EOFError, BrokenPipeError])  # pipes of its own may break, too
def test_what_a_machine_fails_of_is_told_and_the_others_end(
    mistake: type[Exception], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cosim.live.team.check_apart", lambda scenario, seed: None)
    started = scenario("monitoring", MONITORING, duration_s=PATIENCE_S)
    make = started.protocol.spec.make
    monkeypatch.setitem(
        started.protocol.spec.__dict__,
        "make",
        lambda *given: Broken(make(*given), mistake) if given[2] == 1 else make(*given),
    )
    said: list[str] = []
    with pytest.raises(LocalProtocolError, match=r"(?s)^robot 1: its machine has failed.*one heartbeat too many"):
        live(started, 1, said.append)
    pids = [int(found[1]) for line in said if (found := re.search(r"process (\d+),", line))]
    assert len(pids) == 3
    assert all(map(is_gone, pids))


# ---------------------------------------------------------------- who is refused


@pytest.mark.slow
def test_machines_that_share_state_are_refused_in_one_sentence() -> None:
    shared = scenario("exploration", EXPLORING | {"map": "shared"}, team=EXPLORERS, duration_s=60)
    told = "^protocol.use: the machines of exploration share state, and live each is a process of its own$"
    with pytest.raises(UserError, match=told):
        live(shared, 1, print)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("use", "parameters", "settings"),
    [
        ("monitoring", MONITORING, {}),
        ("exploration", EXPLORING, {"team": EXPLORERS}),
        ("agents", {"message_octets": 4, "transport": {"links": {}}}, {}),
        ("reflection", {"algorithm": "potential_field", "targets": [[[10, 10]]]}, {}),
        ("pseudonet", {"algorithm": "spanning_tree"}, {"floorplan": {"map": "walls", "bounds_m": [0, 0, 4, 4]}}),
    ],
)
def test_machines_that_only_remember_what_each_would_compute_are_not(use: str, parameters: Any, settings: Any) -> None:
    check_apart(scenario(use, parameters, duration_s=20, channel=IdealSettings().model_dump(), **settings), 1)


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"team": {"size": 65}}, "team.size: 65 is not <= 64, the most processes that are started"),
        (
            {"faults": [{"kind": "crash", "robot": 0, "at_s": 1, "for_s": 1}]},
            r"faults\[0\].kind: 'crash' does not happen live, expected kill and the like",
        ),
        ({"channel": {"kind": "ideal", "loss": 0.5}}, "channel.loss: 0.5 is not 0: UDP has its own"),
        ({"channel": {"kind": "ideal", "jitter_s": 0.5}}, "channel.jitter_s: 0.5 is not 0: UDP has its own"),
        ({"channel": {"kind": "radios", "radios": [{"kind": "ideal"}]}}, "channel.kind: 'radios' has several"),
    ],
)
def test_a_scenario_that_cannot_be_live_is_refused(settings: dict[str, Any], told: str) -> None:
    with pytest.raises(UserError, match=f"^{told}"):
        live(scenario("monitoring", MONITORING, **settings), 1, print)


def test_sockets_are_of_the_loopback_interface_only() -> None:
    with bound_socket() as one:
        assert one.getsockname()[0] == "127.0.0.1"
        assert one.family == socket.AF_INET
        assert one.type & socket.SOCK_DGRAM


class Keeps:
    """A machine that keeps what comes along, and what does not."""

    def __init__(self) -> None:
        self.count = 7
        self.nested = lambda: self.count
        self.memory = memoryview(b"abc")
        self.packs = Struct(">d").pack
        self.rounds = round


def test_what_cannot_go_from_process_to_process_stays_behind_and_says_so() -> None:
    there: Any = pickle.loads(handed(Keeps()))  # type: ignore[arg-type]
    assert there.count == 7
    assert there.rounds is round
    for left in (there.nested, there.memory, there.packs):
        with pytest.raises(LocalProtocolError, match="has left in its process"):
            left()


# ---------------------------------------------------------------- times

KILLS = 20


def detections_s(outcome: Outcome, died_s: float) -> list[float]:
    """Return how long after the death each of the two others has begun the suspicion that stood."""
    columns = outcome.trace.columns("events")
    since: dict[int, float] = {}
    for time, source, name in zip(columns["time_ns"], columns["source"], columns["event"], strict=True):
        if name == "Suspected":
            since[source] = to_seconds(time) - died_s
    assert len(since) == 2
    return list(since.values())


@pytest.mark.soak
def test_a_robot_that_is_killed_is_detected_as_soon_as_over_the_ideal_channel() -> None:
    if SOAK_SHARE < 1:
        pytest.skip("a part of it tells nothing, and it wants a machine that has nothing else to do")
    ours: list[float] = []
    ideal: list[float] = []
    for kill in range(KILLS):
        wanted_s = round(1.505 + 0.21 * kill % 0.2, 3)
        faults = [{"kind": "kill", "robot": kill % 3, "at_s": wanted_s}]
        run = scenario("monitoring", MONITORING, duration_s=2.5, faults=faults)
        ideal += detections_s(simulate(run, 1), wanted_s)
        said: list[str] = []
        outcome = live(run, 1, said.append)
        (died,) = [
            found for line in said if (found := re.match(r"robot (\d) at ([\d.]+) s: process .* is killed", line))
        ]
        assert int(died[1]) == kill % 3
        ours += detections_s(outcome, float(died[2]))
    print(f"ideal {min(ideal):.4f} {median(ideal):.4f} {max(ideal):.4f} s")
    print(f"live  {min(ours):.4f} {median(ours):.4f} {max(ours):.4f} s")
    assert max(ours) <= BOUND_S + 0.05
    assert abs(median(ours) / median(ideal) - 1.0) <= 0.1
