"""Pins: what runs compute, kept in a CSV file that is committed, so that a change of behaviour is noticed.

    cosim pin SCENARIO... -o pins.csv     makes the runs and writes the file
    cosim pin --check pins.csv            makes them again and says, run by run, whether they are the same

A scenario is a run for each seed; an experiment with a scenario is a run for each arm and replicate. The rows of a run:

    what      name                        second  count  value
    digest                                               SHA-256 of the rows of all tables
    metric    its name                                   its value
    timing    first_link, first_message                  ns; empty if there was none
              or end
    rows      a table, or a type of event    12      3   hash of these rows of that simulated second

The rows of the file that name no scenario tell with which NumPy, numba, scipy and shapely it was made, and on what kind
of machine. With these a run is the same on every supported Python and processor of that kind: what decides
anything is + - * / and sqrt in a stated order (:mod:`cosim.elementary`). With others the last bits may differ.
"""

import csv
import hashlib
import io
import os
import platform
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeAlias

from cosim.documents import is_file, read_text, read_yaml
from cosim.errors import LocalProtocolError, UserError
from cosim.experiment import Experiment, find_experiment, is_experiment, load_experiment, named
from cosim.results import versions
from cosim.scenario import Scenario, load
from cosim.simulation import NO_OUTCOME, Simulation
from cosim.trace import CALLS, FRAMES, LINKS, MESSAGES, POSES, UNSENT, Trace, drafted
from cosim.units import S, Time

COLUMNS: Final = ("scenario", "arm", "seed", "what", "name", "second", "count", "value")
"""The columns of a file of pins."""
_HASH: Final = 8
"""Hexadecimal digits of the hash of a second's rows."""


class Case(NamedTuple):
    """A run that is pinned: which file, which arm of it if it is an experiment, and the seed."""

    scenario: str
    """Path of the file, relative to the folder of the pins; or the name of an installed experiment."""
    arm: str
    seed: int

    def __str__(self) -> str:
        return ", ".join(filter(None, (self.scenario, self.arm, f"seed {self.seed}")))


class Fact(NamedTuple):
    """A row of a run, without its value: see the module's table."""

    what: str
    name: str = ""
    second: int | None = None


Value: TypeAlias = tuple[int | None, str]
"""Count and value of a row."""
Pin: TypeAlias = dict[Fact, Value]
"""All rows of a run."""
Told: TypeAlias = Callable[[int, int], None]
"""(runs that are made, all runs): what shows progress."""
PINNED: Final = (POSES, FRAMES, MESSAGES, LINKS, UNSENT, CALLS)
"""The tables of cosim whose rows are pinned, beside the protocol's events. What others tell follows from the same."""


# ---------------------------------------------------------------- making pins


def pin_of(scenario: Scenario, seed: int) -> Pin:
    """Run *scenario* with *seed*, these tables on, and return what is pinned of it."""
    simulation = Simulation(scenario, seed, PINNED)
    outcome = simulation.run()
    trace = outcome.trace
    pin: Pin = {Fact("digest"): (None, trace.digest())}
    for name, value in sorted(outcome.metrics.items()):
        if name not in NO_OUTCOME:
            pin[Fact("metric", name)] = None, repr(float(value))
    links = trace.columns(LINKS.name)
    connected = [time for time, event in zip(links["time_ns"], links["event"], strict=True) if event == "Connected"]
    timings = {
        "first_link": min(connected, default=None),
        "first_message": min(trace.columns(MESSAGES.name)["time_ns"], default=None),
        "end": simulation.kernel.now,
    }
    for name, time in timings.items():
        pin[Fact("timing", name)] = None, "" if time is None else str(time)
    pin.update(_seconds(trace))
    return pin


def _seconds(trace: Trace) -> Iterator[tuple[Fact, Value]]:
    """Yield number and hash of the rows of each simulated second, by table, and those of events by their type."""
    for table in sorted(trace.tables):
        kinds: dict[tuple[int, str], list[tuple[Time, int, tuple[Any, ...]]]] = defaultdict(list)
        columns = trace.columns(table)
        for row in zip(*columns.values(), strict=True):
            kind = row[2] if table == "events" else table
            kinds[row[0] // S, kind].append((*row[:2], row))
        for (second, kind), rows in sorted(kinds.items()):
            rows.sort(key=lambda row: row[:2])  # as for the digest: the order of different sources has no meaning
            content = hashlib.sha256(repr([row for _, _, row in rows]).encode())
            yield Fact("rows", kind, second), (len(rows), content.hexdigest()[:_HASH])


def made_with() -> dict[str, str]:
    """Return what the last bits of results may depend on."""
    known = versions()
    return {
        **{name: known[name] for name in ("numpy", "numba", "scipy", "shapely")},
        "machine": f"{platform.system()} {platform.machine()}",
    }


# ---------------------------------------------------------------- which runs


def cases_in(texts: Iterable[str], folder: Path, seeds: Sequence[int] = ()) -> list[Case]:
    """Return the runs of the scenarios and experiments that *texts* name, for pins that are kept in *folder*.

    *seeds* take the place of a scenario's own; an experiment's replicates have theirs. Raise UserError for what is
    neither a scenario nor an experiment with one.
    """
    cases: list[Case] = []
    for text in texts:
        path = find_experiment(text)
        name = Path(os.path.relpath(path, folder)).as_posix() if Path(text).exists() else text
        if not is_experiment(read_yaml(path)):
            cases += [Case(name, "", seed) for seed in seeds or (load(path).seed,)]
        elif seeds:
            raise UserError(f"--seed: {text} is an experiment, whose replicates have seeds of their own")
        else:
            experiment = load_experiment(path)
            firsts = range(experiment.seed, experiment.seed + experiment.replicates)
            cases += [Case(name, arm, seed) for arm in _arms(experiment) for seed in firsts]
    return cases


def _arms(experiment: Experiment) -> dict[str, Scenario]:
    """Return the scenarios of *experiment* by the labels of their arms; raise UserError for one that has none."""
    scenarios = {}
    for arm in experiment.arms:
        if arm.scenario is None:
            raise UserError(f"{experiment.source}: is no run of robots but of {arm.run}")
        scenarios[named(arm.labels)] = arm.scenario
    return scenarios


class _Scenarios:
    """The scenarios of pinned runs; each file is read once."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._read: dict[str, dict[str, Scenario]] = {}

    def of(self, case: Case) -> Scenario:
        """Return the scenario of *case*; raise UserError if it is not there any more, or wrong."""
        if case.scenario not in self._read:
            beside = Path(os.path.normpath(self._folder / case.scenario))  # the folder need not be there yet
            path = beside if is_file(beside) else find_experiment(case.scenario)
            arms = _arms(load_experiment(path)) if is_experiment(read_yaml(path)) else {"": load(path)}
            self._read[case.scenario] = arms
        if case.arm not in self._read[case.scenario]:
            raise UserError(f"{case.scenario}: has no arm {case.arm!r}")
        return self._read[case.scenario][case.arm]


# ---------------------------------------------------------------- the file


def write_pins(path: Path, cases: Sequence[Case], told: Told = lambda done, total: None) -> None:
    """Make the runs *cases* and write their pins to *path*, whole. Raise UserError for a run that cannot be set up."""
    scenarios = _Scenarios(path.parent)
    path.parent.mkdir(parents=True, exist_ok=True)
    # begun before the runs: what cannot be written is to fail at once
    with drafted(path) as draft, draft.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows(("", "", "", "made with", name, "", "", version) for name, version in made_with().items())
        for number, case in enumerate(cases):
            told(number, len(cases))
            try:
                pin = pin_of(scenarios.of(case), case.seed)
            except UserError as error:
                raise UserError(f"{case}: {error}") from None
            writer.writerows((*case, *fact, *value) for fact, value in pin.items())


class Pins(NamedTuple):
    """What a file of pins holds."""

    made_with: dict[str, str]
    runs: dict[Case, Pin]


def read_pins(path: Path) -> Pins:
    """Return the pins in the file *path*; raise UserError, one line, if it is no such file."""
    lines = csv.reader(io.StringIO(read_text(path), newline=""))
    found = Pins({}, {})
    try:
        header = tuple(next(lines, ()))
        for scenario, arm, seed, what, name, second, count, value in lines if header == COLUMNS else ():
            if what == "made with":
                found.made_with[name] = value
                continue
            fact = Fact(what, name, int(second) if second else None)
            pin = found.runs.setdefault(Case(scenario, arm, int(seed)), {})
            pin[fact] = int(count) if count else None, value
    except (ValueError, csv.Error):
        raise UserError(f"{path}: line {lines.line_num}: is no row of a file of pins") from None
    if header != COLUMNS:
        raise UserError(f"{path}: line 1: expected the columns {','.join(COLUMNS)}, as cosim pin -o writes them")
    return found


# ---------------------------------------------------------------- comparing


class Finding(NamedTuple):
    """How a run is now, compared with its pin."""

    case: Case
    same: bool
    text: str
    """``same``, or what differs."""


def check_pins(pins: Pins, folder: Path, told: Told = lambda done, total: None) -> Iterator[Finding]:
    """Make the runs of *pins*, which are kept in *folder*, again, and yield how each is now."""
    scenarios = _Scenarios(folder)
    for number, (case, pinned) in enumerate(pins.runs.items()):
        told(number, len(pins.runs))
        try:
            text = difference(pinned, pin_of(scenarios.of(case), case.seed))
        except (UserError, LocalProtocolError) as error:
            text = f"cannot be run: {error}"
        yield Finding(case, not text, text or "same")


def difference(pinned: Pin, now: Pin) -> str:
    """Return what differs between two pins of a run: first in time, then by name; nothing if they are equal."""
    differing = [fact for fact in {**pinned, **now} if pinned.get(fact) != now.get(fact)]
    seconds = [fact.second for fact in differing if fact.second is not None]
    parts = []
    if seconds:
        first = min(seconds)
        kinds = [_count(fact, pinned, now) for fact in sorted(differing) if fact.second == first]
        parts.append(f"second {first} is the first that differs: {', '.join(kinds)}")
    for what in ("timing", "metric"):
        values = [
            f"{fact.name} {now.get(fact, (0, 'not there'))[1]}, pinned {pinned.get(fact, (0, 'not there'))[1]}"
            for fact in differing
            if fact.what == what
        ]
        parts += [f"{what}s: {'; '.join(values)}"] if values else []
    return "; ".join(parts) or ("digest" if differing else "")


def _count(fact: Fact, pinned: Pin, now: Pin) -> str:
    """Return how many rows of a kind there are in a second, and were."""
    count, before = (pin.get(fact, (0, ""))[0] for pin in (now, pinned))
    return f"{fact.name} ({count}, other ones)" if count == before else f"{fact.name} ({count}, pinned {before})"


def made_elsewhere(pins: Pins) -> str:
    """Return which versions *pins* were made with that are others here; nothing if none are."""
    here = made_with()
    return ", ".join(
        f"{name} {pins.made_with.get(name, 'unknown')} (here {version})"
        for name, version in here.items()
        if pins.made_with.get(name) != version
    )
