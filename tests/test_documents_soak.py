"""Every document of the repository, spoilt by seeded mutations: none gives a traceback, hangs, or takes the memory.

What is valid is validated once more as printed, and runs two seconds in which bodies stay on the floor. One case, that
of seed 7, is replayed by ``python -m tests.document_judge 7 8``, and its files are written by ``tests.document_cases``.
"""

import json
import os
import re
import subprocess
import sys
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cosim.scenario import Scenario
from cosim.simulation import Simulation
from tests import document_judge
from tests.document_cases import FLOOR, PLAIN, ROOT, Document, drawn
from tests.document_judge import Verdict, judged, run
from tests.tiers import soak_count

CASES = 20_000
SILENCE_S = 300.0
"""Wall time after which a case that does not answer is taken to hang: it does so in a loop that no signal ends."""
PROCESSES = 2
JUDGE = [sys.executable, "-m", "tests.document_judge"]


@pytest.mark.soak
def test_spoilt_documents_are_refused_in_a_line_or_run(record_property: Callable[[str, object], None]) -> None:
    count = soak_count(CASES)
    edges = [count * each // PROCESSES for each in range(PROCESSES + 1)]
    with ThreadPoolExecutor(PROCESSES) as pool:
        parts = pool.map(verdicts, edges, edges[1:])
        found = [verdict for part in parts for verdict in part]
    assert [verdict.seed for verdict in found] == list(range(count))
    record_property("spoilt documents", count)
    record_property("spoilt documents that were valid, and ran", sum(verdict.ran for verdict in found))
    record_property("distinct refusals of spoilt documents", len({normalised(each.told) for each in found} - {""}))
    wrong = [described(verdict) for verdict in found if verdict.wrong]
    assert not wrong, f"{len(wrong)} of {count} cases\n\n" + "\n\n".join(wrong[:10])


def verdicts(first: int, last: int) -> list[Verdict]:
    """Return what becomes of the cases from *first* to before *last*, in processes of which one may end or hang."""
    found: list[Verdict] = []
    while first + len(found) < last:
        found += _judged_elsewhere(first + len(found), last)
    return found


def _judged_elsewhere(first: int, last: int) -> Iterator[Verdict]:
    """Yield the verdicts of one process, with one of our own on the case at which it ends or hangs."""
    command = [*JUDGE, str(first), str(last)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])}
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment
    ) as child:
        assert child.stdout is not None
        said = ""
        while first < last:
            alarm = threading.Timer(SILENCE_S, child.kill)
            alarm.start()
            line = child.stdout.readline()
            alarm.cancel()
            if line.startswith('{"seed"'):
                yield Verdict(**json.loads(line))
                first += 1
            elif line:
                said += line
            else:
                yield Verdict(first, f"the process ended, exit {child.wait()}: {said[-500:]}", "", False)
                return


def normalised(told: str) -> str:
    """Return a refusal without its values: all of one kind are one."""
    return re.sub(r"[\d.e+-]*\d[\d.e+-]*", "N", re.sub(r"'[^']*'|\"[^\"]*\"", "Q", told))


def described(verdict: Verdict) -> str:
    document = drawn(verdict.seed)
    text = document.files[document.spoilt][:1500].decode(errors="backslashreplace")
    return f"seed {verdict.seed}, {document.name}, {document.spoilt}: {verdict.wrong}\n{text}"


# ---------------------------------------------------------------- the judge is judged


def refusing(text: str, code: int = 2) -> Callable[..., int]:
    def guarded(arguments: Any) -> int:
        print(text, file=sys.stderr)
        return code

    return guarded


def raising(arguments: Any) -> int:
    raise KeyError("x")


def endless(arguments: Any) -> int:
    while True:
        pass


def greedy(arguments: Any) -> int:
    return len(bytearray(2 << 30))


def printing(text: str, more: str = "") -> Callable[..., int]:
    """Return a command that finds everything valid and prints *text*, or else what it was given and *more*."""

    def guarded(arguments: Any) -> int:
        print(text or Path(arguments[1]).read_text() + more)
        return 0

    return guarded


def writing(at_command: str, code: int) -> Callable[..., int]:
    def guarded(arguments: Any) -> int:
        if arguments[0] == at_command:
            (Path(arguments[1]).parent / "more").touch()
        print("is refused", file=sys.stderr)
        return code

    return guarded


@pytest.mark.slow
@pytest.mark.parametrize(
    ("guarded", "wrong"),
    [
        (refusing("a line"), ""),
        (refusing("x" * 301), "a refusal of 301 letters, 1 lines"),
        (refusing("a\nb"), "a refusal of 3 letters, 2 lines"),
        (refusing(""), "a refusal of 0 letters, 1 lines"),
        (refusing("a line", 1), "exit 1, a line"),
        (refusing("a warning", 0), "exit 0, a warning"),
        (raising, "KeyError: 'x'"),
        (endless, "more than 0.1 s of processor time"),
        (greedy, "MemoryError"),
        (printing("duration_s: 3\nprotocol: {use: monitoring}"), "what is printed is another scenario"),
        (printing("[]"), "holds [], expected a mapping"),
        (printing("", "#"), ""),
        (writing("run", 2), "validate refuses, run: exit 2, files: True"),
    ],
)
def test_the_judge_sees_what_a_command_does_wrong(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, guarded: Callable[..., int], wrong: str
) -> None:
    text = b"duration_s: 5\nfloorplan: {map: walls, bounds_m: [0, 0, 9, 9]}\nprotocol: {use: monitoring}\n"
    plain = Document("plain", "scenario.yaml", "scenario.yaml", {"scenario.yaml": text})
    monkeypatch.setattr(document_judge, "drawn", lambda seed: plain)
    monkeypatch.setattr(document_judge, "_guarded", guarded)
    monkeypatch.setattr(document_judge, "CASE_S", 0.1 if guarded is endless else 10.0)
    verdict = judged(0, tmp_path / "case")
    assert wrong in verdict.wrong
    assert bool(wrong) == bool(verdict.wrong)


@pytest.mark.parametrize(
    ("moved", "wrong"),
    [
        ({}, ""),
        ({"x_m": [float("nan"), 6.0]}, "a pose that is not finite"),
        ({"x_m": [-0.1, 6.0]}, "a body is off the floor"),
        ({"x_m": [4.9, 8.0]}, "bodies [0] are inside a wall"),
        ({"x_m": [7.0, 7.3]}, "bodies overlap"),
    ],
)
def test_the_judge_sees_bodies_where_they_cannot_be(moved: dict[str, list[float]], wrong: str) -> None:
    scene = PLAIN | {"floorplan": FLOOR | {"walls": [[5, 0, 5, 9]]}}
    scene["team"] = {"starts": [[2, 2], [8, 2]], "size": 2, "body": {"radius_m": 0.2}}
    simulation = Simulation(Scenario.model_validate(scene), 1)
    fleet = SimpleNamespace(x_m=np.array([2.0, 8.0]), y_m=np.array([2.0, 2.0]), radii_m=np.array([0.2, 0.2]))
    vars(fleet).update({name: np.array(value) for name, value in moved.items()}, observed=np.zeros(2))
    simulation_like: Any = SimpleNamespace(fleet=fleet, floorplan=simulation.floorplan)
    assert document_judge.misplaced(simulation_like, document_judge.tree(simulation.floorplan)) == wrong


def test_the_judge_sees_a_metric_that_is_not_finite(monkeypatch: pytest.MonkeyPatch) -> None:
    simulation = Simulation(Scenario.model_validate(PLAIN | {"floorplan": FLOOR}), 1)
    assert run(simulation) == ""
    simulation = Simulation(Scenario.model_validate(PLAIN | {"floorplan": FLOOR}), 1)
    monkeypatch.setattr(simulation, "outcome", lambda: SimpleNamespace(metrics={"a": 1.0, "b": float("inf")}))
    assert run(simulation) == "metrics ['b'] are not finite"


@pytest.mark.slow
def test_a_process_that_ends_or_hangs_is_a_case_that_fails_and_the_rest_is_judged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    script = tmp_path / "judge.py"
    script.write_text(
        "import sys, time\n"
        "for seed in range(int(sys.argv[1]), int(sys.argv[2])):\n"
        "    if seed == 2: sys.exit(3)\n"
        "    if seed == 4: time.sleep(60)\n"
        '    print(\'{"seed": %d, "wrong": "", "told": "", "ran": true}\' % seed, flush=True)\n'
    )
    monkeypatch.setattr("tests.test_documents_soak.JUDGE", [sys.executable, str(script)])
    monkeypatch.setattr("tests.test_documents_soak.SILENCE_S", 1.0)
    found = verdicts(0, 6)
    assert [verdict.seed for verdict in found] == list(range(6))
    assert [verdict.seed for verdict in found if verdict.wrong] == [2, 4]


def test_refusals_that_differ_in_values_are_one() -> None:
    assert normalised("a.yaml: team.size: -1.5e+9 is not >= 1") == normalised("a.yaml: team.size: 7 is not >= 12")
    assert normalised("x: 'abc' is not \"d\"") == normalised("x: 'e' is not 'f'") != normalised("y: 'e' is not 'f'")


@pytest.mark.slow
def test_a_seed_gives_the_same_document_and_every_kind_comes() -> None:
    assert drawn(5) == drawn(5) != drawn(6)
    kinds = Counter(drawn(seed).spoilt for seed in range(150))
    assert {*kinds} >= {"scenario.yaml", "floor.yaml", "library.yaml", "map.yaml", "a.map"}
