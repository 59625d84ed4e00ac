"""Judge how cosim takes spoilt documents: ``python -m tests.document_judge FIRST LAST`` prints a line of JSON a case.

It holds the seed, what is wrong (if anything is), and what the user was told. A case is validated as by ``cosim
validate``, in this process, with a limit of processor time and of memory; what is valid then runs two simulated
seconds, or as far as it gets in a little time. LAST is not judged any more.
"""

import contextlib
import io
import json
import math
import os
import resource
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely
from numba.core import event as numba_event

from cosim.cli import _guarded
from cosim.documents import read_yaml
from cosim.errors import UserError
from cosim.experiment import Experiment, is_experiment, load_experiment
from cosim.scenario import dump, load
from cosim.simulation import METRICS, Simulation
from cosim.units import S
from cosim.world.floorplan import Floorplan
from tests.document_cases import drawn, write

LETTERS = 300
"""How long a refusal may be."""
CASE_S = 10.0
"""Processor time that a case may take."""
RUN_S = 1.0
"""Processor time after which a run is cut short; a tick that has begun is waited for."""
MEMORY = 1 << 30
"""Bytes that a case may take beside what there is before it."""
TOUCH_M = 1e-4
"""How far a body may seem to be inside of a wall, or of another."""


class Verdict(NamedTuple):
    """What became of a case."""

    seed: int
    wrong: str
    """Nothing if all is as it should be."""
    told: str
    """How it was refused; nothing if it was not."""
    ran: bool


class OutOfTimeError(BaseException):
    """A case takes too long; nothing in cosim catches it."""


class _Pause(numba_event.Listener):  # type: ignore[misc]
    """A clock of processor time that stands still while a kernel is compiled, which happens once."""

    def __init__(self) -> None:
        self._left_s: list[float] = []

    def on_start(self, event: Any) -> None:
        self._left_s.append(signal.setitimer(signal.ITIMER_PROF, 0.0)[0])

    def on_end(self, event: Any) -> None:
        signal.setitimer(signal.ITIMER_PROF, self._left_s.pop())


@contextlib.contextmanager
def limits() -> Iterator[None]:
    """Raise OutOfTimeError or MemoryError in what goes on for too long, or takes too much memory."""

    def ring(*_: Any) -> None:
        raise OutOfTimeError

    with open("/proc/self/statm", encoding="ascii") as pages:
        taken = int(pages.read().split()[0]) * resource.getpagesize()
    signal.signal(signal.SIGPROF, ring)
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (taken + MEMORY, before[1]))
    signal.setitimer(signal.ITIMER_PROF, CASE_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        resource.setrlimit(resource.RLIMIT_AS, before)


def told_by(*arguments: str) -> tuple[int, str, str]:
    """Return the exit code of the command, what it prints, and what it complains of."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = _guarded(arguments)
    return code, out.getvalue(), err.getvalue()


def misbehaviour(folder: Path, entry: str) -> tuple[str, str, bool]:
    """Return what is wrong with how cosim takes the document *entry* in *folder*, its refusal, and whether it ran."""
    before = sorted(folder.iterdir())
    path = folder / entry
    code, out, err = told_by("validate", str(path))
    told = err.removesuffix("\n").replace(str(folder), "")
    if code == 2:
        if "\n" in told or not told or len(told) > LETTERS:
            return f"a refusal of {len(told)} letters, {told.count(chr(10)) + 1} lines", told, False
        if _is_experiment(path):  # of which run takes the scenario before its axes
            return "", told, False
        code, _, again = told_by("run", str(path), "--trace", str(folder / "tables"))
        written = sorted(folder.iterdir()) != before
        agrees = code == 2 and not written
        return ("" if agrees else f"validate refuses, run: exit {code}, files: {written}: {again[:300]}"), told, False
    if code != 0 or err:
        return f"exit {code}, {err[:500]}", told, False
    if sorted(folder.iterdir()) != before:
        return "validate has written something", "", False
    (folder / "again.yaml").write_text(out, encoding="utf-8")
    if _is_experiment(path):
        one, other = (load_experiment(folder / name) for name in (entry, "again.yaml"))
        alike = one.base == other.base and _about(one) == _about(other)
        return ("" if alike else "what is printed is another experiment"), "", False
    scenario = load(path)
    if dump(scenario) != dump(load(folder / "again.yaml")):
        return "what is printed is another scenario", "", False
    return run(Simulation(scenario, scenario.seed)), "", True


def _about(experiment: Experiment) -> dict[str, Any]:
    """Return the settings of *experiment* without those of its runs, which are printed with their defaults."""
    return {key: value for key, value in dump(experiment.settings).items() if key not in ("scenario", "parameters")}


def _is_experiment(path: Path) -> bool:
    try:
        return is_experiment(read_yaml(path))
    except UserError:
        return False


def run(simulation: Simulation) -> str:
    """Return what is wrong with the first two seconds of a run, or with as much of them as there is time for."""
    started = time.process_time()
    walls = tree(simulation.floorplan)
    simulation.begin()
    over = False
    while not over and simulation.kernel.now < 2 * S and time.process_time() < started + RUN_S:
        over = simulation.advance(min(simulation.kernel.now + max(simulation.scenario.tick, S // 10), 2 * S))
        wrong = misplaced(simulation, walls)
        if wrong:
            return f"{wrong} at {simulation.kernel.now} ns"
    metrics = simulation.outcome().metrics
    known = {metric.name for metric in METRICS}  # of the others, NaN says that there is no such value
    odd = [name for name, value in metrics.items() if math.isinf(value) or (math.isnan(value) and name in known)]
    return f"metrics {odd} are not finite" if odd else ""


def tree(floor: Floorplan) -> shapely.STRtree:
    """Return the walls of *floor* in an index of shapely's."""
    return shapely.STRtree(shapely.linestrings(floor.walls_m.reshape(-1, 2, 2)))


def misplaced(simulation: Simulation, walls: shapely.STRtree) -> str:
    """Return what is wrong with where bodies are."""
    fleet, floor = simulation.fleet, simulation.floorplan
    where = np.stack((fleet.x_m, fleet.y_m), axis=1)
    if not (np.isfinite(where).all() and np.isfinite(fleet.observed).all()):
        return "a pose that is not finite"
    x_min, y_min, x_max, y_max = floor.bounds_m
    if ((where < (x_min, y_min)) | (where > (x_max, y_max))).any():
        return "a body is off the floor"
    radii = np.asarray(fleet.radii_m)
    (robots, _), apart = walls.query_nearest(shapely.points(where), return_distance=True)
    if (apart < radii[robots] - TOUCH_M).any():
        return f"bodies {robots[apart < radii[robots] - TOUCH_M].tolist()} are inside a wall"
    if len(where) <= 200:
        gaps = np.hypot(*(where[:, None] - where[None]).transpose(2, 0, 1)) - radii - radii[:, None]
        np.fill_diagonal(gaps, 1.0)
        if (gaps < -TOUCH_M).any():
            return "bodies overlap"
    return ""


def judged(seed: int, folder: Path) -> Verdict:
    """Return what becomes of the document of *seed*, whose files are written into *folder*."""
    document = drawn(seed)
    write(document, folder)
    try:
        with limits():
            return Verdict(seed, *misbehaviour(folder, document.entry))
    except OutOfTimeError as error:
        where = "".join(traceback.format_tb(error.__traceback__)[-4:])
        return Verdict(seed, f"more than {CASE_S:g} s of processor time: {where}", "", False)
    except (Exception, SystemExit) as error:  # noqa: BLE001  # whatever it is, it is a traceback
        return Verdict(seed, "".join(traceback.format_exception(error)[-4:])[-1500:], "", False)


if __name__ == "__main__":
    numba_event.register("numba:compile", _Pause())
    with tempfile.TemporaryDirectory() as place:
        os.chdir(place)
        for number in range(int(sys.argv[1]), int(sys.argv[2])):
            print(json.dumps(judged(number, Path(place) / str(number))._asdict()), flush=True)
