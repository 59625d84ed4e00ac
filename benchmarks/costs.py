"""How many kernel events and calls of our functions a frame, a robot-tick and an inquiry take: a guard without a clock.

    python -m benchmarks.costs            prints them beside what was kept
    python -m benchmarks.costs --write    keeps them, in tests/data/costs.csv

Both numbers are the same in every run on one Python: a call is what the interpreter tells ``sys.setprofile`` of a
function in ``cosim`` or ``protocols``, so that other libraries' versions do not matter; a kernel that is compiled is no
call. Other Pythons count comprehensions otherwise. ``tests/test_costs.py`` fails if one has grown by a tenth.
"""

import argparse
import csv
import gc
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import CodeType, FrameType
from typing import Any, NamedTuple

import cosim
import protocols
from benchmarks import workloads
from benchmarks.peers import arena, waypoints
from benchmarks.peers.waypoints import Load
from cosim.kernel import Kernel

PYTHON = (3, 11)
"""The Python whose counts are kept."""
KEPT = Path(__file__).parents[1] / "tests" / "data" / "costs.csv"
RENEW = "python -m benchmarks.costs --write"
TOLERATED = 0.1
OURS = tuple(f"{Path(package.__file__).parent}/" for package in (cosim, protocols) if package.__file__)


class Cost(NamedTuple):
    """What one of what is measured takes."""

    events: float
    """Of the kernel."""
    calls: float
    """Of Python functions of ours."""


def frames(load: Load) -> Callable[[int], workloads.Work]:
    """Return the work of a network of robots under a *load*, per payload that a machine received."""

    def prepare(seed: int) -> workloads.Work:
        run = waypoints.simulation(load, seed)
        return lambda: run()["received"]

    return prepare


def avoiding(seed: int) -> workloads.Work:
    """Ten seconds of 50 robots with 24 beams, per robot and tick."""
    robots, seconds = 50, 10
    run = arena.simulation(robots, 24, 0.1, seconds, seed)

    def work() -> float:
        run()
        return robots * seconds * 10

    return work


MEASURES: Mapping[str, Callable[[int], workloads.Work]] = {
    "frame over 802.11b, to all": frames(Load(30, 150, 20)),
    "frame over 802.11b, to one over AODV with hellos": frames(Load(9, 100, 60, routing="aodv", to="first")),
    "frame over a disc": frames(Load(30, 150, 20, channel="disc")),
    "frame over Bluetooth, of the exchange of states": workloads.exchanged_states,
    "frame over Bluetooth, broadcast": workloads.broadcasts,
    "robot-tick of robots that drive": workloads.robot_ticks,
    "robot-tick of robots with 24 beams": avoiding,
    "inquiry of 10.24 s with 7 scanners": workloads.inquiries,
}


def cost(prepare: Callable[[int], workloads.Work]) -> Cost:
    """Count what one of what *prepare* sets up takes, once it has been done before: kernels and modules are loaded."""
    prepare(1)()
    work = prepare(1)
    kernels = [each for each in gc.get_objects() if isinstance(each, Kernel)]
    before = sum(kernel.executed for kernel in kernels)
    count, calls = counted(work)
    return Cost((sum(kernel.executed for kernel in kernels) - before) / count, calls / count)


def counted(work: workloads.Work) -> tuple[float, int]:
    """Do *work*, and return what it returns, and how many calls of our functions it has made."""
    calls: dict[CodeType, int] = {}

    def note(frame: FrameType, event: str, argument: Any) -> None:
        if event == "call":
            calls[frame.f_code] = calls.get(frame.f_code, 0) + 1

    before = sys.getprofile()
    sys.setprofile(note)
    try:
        count = work()
    finally:
        sys.setprofile(before)
    return count, sum(number for code, number in calls.items() if code.co_filename.startswith(OURS))


def kept() -> dict[str, Cost]:
    """Return the costs of the file, by what is measured."""
    with KEPT.open(encoding="utf-8", newline="") as file:
        return {row["measure"]: Cost(float(row["events"]), float(row["calls"])) for row in csv.DictReader(file)}


def changes(name: str, now: Cost, before: Cost | None) -> list[str]:
    """Return a line for each number of the measure *name* that is farther from *before* than is tolerated."""
    if before is None:
        return [f"{name}: nothing was kept, now {now.events:.4g} events and {now.calls:.4g} calls: {RENEW}"]
    lines = []
    for what, old, new in zip(("kernel events", "Python calls"), before, now, strict=True):
        if new > old * (1 + TOLERATED):
            lines.append(f"{name}: {what} were {old:.4g}, now {new:.4g}: too many; if that is meant: {RENEW}")
        elif new < old / (1 + TOLERATED):
            lines.append(f"{name}: {what} were {old:.4g}, now {new:.4g}: fewer; keep that: {RENEW}")
    return lines


def main(arguments: Sequence[str] | None = None) -> None:
    """Count, print, and keep if that is asked for."""
    parser = argparse.ArgumentParser("python -m benchmarks.costs", description=__doc__)
    parser.add_argument("--write", action="store_true", help=f"keep the numbers in {KEPT.name}")
    given = parser.parse_args(arguments)
    if sys.version_info[:2] != PYTHON:
        parser.error(f"counts are kept of Python {'.'.join(map(str, PYTHON))}, and this is another")
    old = kept() if KEPT.exists() else {}
    found = {name: cost(prepare) for name, prepare in MEASURES.items()}
    for name, now in found.items():
        before = old.get(name)
        were = "" if before is None else f"   kept: {before.events:.4g} events, {before.calls:.4g} calls"
        print(f"{name:50s} {now.events:9.4g} events {now.calls:9.4g} calls{were}")
    if given.write:
        with KEPT.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(("measure", "events", "calls"))
            writer.writerows((name, f"{now.events:.4g}", f"{now.calls:.4g}") for name, now in found.items())


if __name__ == "__main__":
    main()
