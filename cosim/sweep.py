"""A sweep: all arms and replicates of an experiment on several processes, every finished run kept, resumed by itself.

The seed of a run comes from its replicate, never from its arm: all arms see the same worlds (common random numbers),
and differences between arms are paired. What a row holds does not depend on how many processes there were, or where.
"""

import json
import math
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from socket import gethostname
from time import monotonic, perf_counter
from typing import Any, Final, NamedTuple, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel

from cosim.channels.kinds import ChannelSettings
from cosim.columns import kind_of
from cosim.documents import assignment
from cosim.errors import UserError
from cosim.experiment import Arm, Experiment, find_function, load_experiment, named
from cosim.installed import installed_folders, installed_names, module_of
from cosim.processes import NO_LIMITS, Limits, Pool
from cosim.protocol import Metric
from cosim.results import (
    SEVERAL,
    AxisDescription,
    Row,
    RunStore,
    SweepDescription,
    metric_fields,
    provenance,
)
from cosim.scenario import Scenario, digest
from cosim.simulation import Simulation, simulate
from cosim.sources import Origin, closure, differing, origin
from cosim.statistics.stopping import decide
from cosim.trace import Field
from cosim.upkeep import told_time

Progress: TypeAlias = Callable[[int, int, int], None]
"""Told (runs that are finished, runs in all, how many of the finished failed)."""
Asked: TypeAlias = tuple[int, int]
"""A run: (number of its arm, replicate)."""

BATCH_S: Final = 1.0
"""Runs shorter than this are written together, as soon as one finishes this long after the last writing."""
BATCH_RUNS: Final = 1000
"""So many finished runs are written even earlier: they would fill the memory."""

_SET_UP: Final[Any] = {"floorplan": True, "team": True, "channel": True, "protocol": {"use": True}}
"""What of a scenario decides whether its runs can be set up, and which metrics they have."""
_PROTOCOLS, _CHANNELS, _MAPS = "cosim.protocols", "cosim.channels", "cosim.maps"
"""Groups of entry points."""


class Shard(NamedTuple):
    """One of several equal parts of a sweep, each of which is made on a computer of its own."""

    number: int
    """From 1."""
    of: int

    @classmethod
    def parse(cls, text: str) -> "Shard":
        """Return the shard that *text*, such as 3/10, means; raise UserError if it means none."""
        number, slash, of = text.partition("/")
        if not (slash and number.isdecimal() and of.isdecimal() and 1 <= int(number) <= int(of)):
            raise UserError(f"--shard: {text!r} is no shard, expected one such as 3/10: the third of ten")
        return cls(int(number), int(of))


WHOLE: Final = Shard(1, 1)


@dataclass(frozen=True)
class Choice:
    """How a sweep is made, none of which decides what a run computes."""

    shard: Shard = WHOLE
    accepted: tuple[str, ...] = ()
    """Digests of older code whose rows count as well."""
    retry_failed: bool = False
    """True if runs that failed are made again."""
    fail_fast: bool = False
    """True if the sweep ends with the first run that fails."""
    limits: Limits = NO_LIMITS


@dataclass
class Finished:
    """What became of a run."""

    arm: int
    replicate: int
    wall_s: float
    error: str | None = None
    digest: str | None = None
    metrics: dict[str, float] = field(default_factory=dict)
    observations: list[Row] = field(default_factory=list)


class Summary(NamedTuple):
    """What a sweep came to."""

    folder: Path
    runs: int
    resumed: int
    """How many of the runs were there already."""
    failures: tuple[str, ...]
    """The errors of the runs that failed, each with its arm."""
    lacking: int = 0
    """Of a sweep that goes on until means are precise: how many are not, with all replicates that it may have."""


# ---------------------------------------------------------------- one run


class Execution:
    """What makes runs of *arms*, by number, of an experiment whose first replicate has the seed *first_seed*."""

    def __init__(self, arms: Mapping[int, Arm], first_seed: int) -> None:
        self.arms = arms
        self.first_seed = first_seed

    def __call__(self, asked: Asked) -> Finished:
        """Make one run; whatever goes wrong in it becomes its error, and the sweep goes on."""
        number, replicate = asked
        arm, seed = self.arms[number], self.first_seed + replicate
        started = perf_counter()
        finished = Finished(number, replicate, 0.0)
        try:
            if arm.scenario is not None:
                outcome = simulate(arm.scenario, seed)
                finished.digest, finished.metrics = outcome.digest, dict(outcome.metrics)
            else:
                _call(arm, seed, finished)
        except (Exception, SystemExit) as error:  # noqa: BLE001  # it is the run's row; other runs go on
            text = " ".join(f"{type(error).__name__}: {error}".split())
            finished = Finished(number, replicate, 0.0, error=text)
        finished.wall_s = perf_counter() - started
        return finished

    def anywhere(self) -> "Execution":
        """Return it with the folders of its maps in full: a process elsewhere stands in another one."""
        return Execution({number: _placed(arm) for number, arm in self.arms.items()}, self.first_seed)

    def of(self, asked: Iterable[Asked]) -> "Execution":
        """Return it with no more arms than *asked* needs."""
        return Execution({number: self.arms[number] for number, _ in asked}, self.first_seed)


def _call(arm: Arm, seed: int, finished: Finished) -> None:
    """Call the function of *arm*, and put its answer into *finished*."""
    assert arm.run is not None
    answer = find_function(arm.run, "sweep.yaml")(arm.parameters, seed)
    finished.digest = digest(answer)
    if isinstance(answer, dict):
        finished.metrics = {name: float(value) for name, value in answer.items()}
    else:
        finished.observations = list(answer)


def _placed(arm: Arm) -> Arm:
    return arm if arm.scenario is None else replace(arm, scenario=arm.scenario.placed(arm.scenario.folder.resolve()))


def lost(asked: Asked, why: str) -> Finished:
    """Return what stands for a run that ended its process, or was ended."""
    return Finished(*asked, 0.0, error=why)


# ---------------------------------------------------------------- engines


class Engine(Protocol):
    """What makes runs somewhere: on processes of our own, or on a cluster."""

    def __call__(
        self,
        execution: Execution,
        todo: Iterable[Asked],
        count: int,
        begin: Callable[[], str | None],
        limits: Limits,
    ) -> Iterator[Finished]:
        """Yield what becomes of each of *todo*, about *count* runs, in any order.

        *begin* is called first wherever runs are made: what it returns, if not None, refuses that process.
        """


def own_processes(jobs: int | None = None) -> Engine:
    """Return the engine that makes runs on *jobs* new processes, one for each processor by default.

    One run at a time without limits is made in this process.
    """

    def run(
        execution: Execution, todo: Iterable[Asked], count: int, begin: Callable[[], str | None], limits: Limits
    ) -> Iterator[Finished]:
        workers = min(jobs or os.cpu_count() or 1, count)
        if workers <= 1 and limits == NO_LIMITS:
            yield from map(execution, todo)
            return
        with Pool(workers, execution.anywhere(), lost, begin, limits) as pool:
            yield from pool.run(todo, count)

    return run


# ---------------------------------------------------------------- all of them


def default_folder(experiment: Experiment, quick: bool, shard: Shard = WHOLE) -> Path:
    """Return where results go if the user does not say: a quick sweep does not mix with a full one, nor do shards."""
    of = "" if shard == WHOLE else f"-shard-{shard.number}-of-{shard.of}"
    return Path("results") / f"{experiment.name}{'-quick' if quick else ''}{of}"


def check_set_up(experiment: Experiment) -> list[Field]:
    """Set up a run on every floor with every team, over every channel and with every protocol of *experiment*.

    Return the columns of the metrics that they declare. Raise UserError for one that cannot be set up.
    """
    different: dict[str, Arm] = {}
    for arm in experiment.arms:
        if arm.scenario is not None:
            plain = arm.scenario.model_dump(mode="json", include=_SET_UP)
            different.setdefault(digest([plain["floorplan"], plain["team"], str(arm.scenario.folder)]), arm)
            different.setdefault(digest([plain["channel"], plain["protocol"]["use"]]), arm)
    metrics: dict[str, Metric] = {}
    for arm in {arm.configuration: arm for arm in different.values()}.values():
        assert arm.scenario is not None
        try:
            declared = Simulation(arm.scenario, experiment.seed).metric_columns
        except UserError as error:
            raise UserError(f"{experiment.source} with {named(arm.labels)}: {error}") from None
        for metric in declared:
            metrics.setdefault(metric.name, metric)
    return metric_fields(metrics.values())


def run_sweep(
    experiment: Experiment,
    folder: str | Path,
    jobs: int | None = None,
    engine: Engine | None = None,
    progress: Progress = lambda done, total, failed: None,
    choice: Choice = Choice(),  # it is frozen
) -> Summary:
    """Make the runs of *experiment* that *folder* does not hold yet, on *jobs* processes of our own, or on *engine*.

    An interrupt leaves what is finished in *folder*, as does an OSError (a full disk, a dead worker process), which is
    raised. Raise UserError if a worker has other code or libraries than this process, or, if *choice* wants that, with
    the first run that fails.
    """
    folder = Path(folder)
    columns = check_set_up(experiment)
    origins = origins_of(experiment)
    told = description_of(experiment, origins, choice.accepted)
    store = RunStore(folder)
    with store.writing():
        axes = _axis_fields(experiment)
        store.declare([*axes, *columns], axes)
        store.describe(told)
        if choice.retry_failed:
            store.drop_failed(told)
        wanted = _wanted(told, choice.shard)
        todo = wanted & ~store.done(told)
        count, total = int(todo.sum()), int(wanted.sum())
        finished = (engine or own_processes(jobs))(
            Execution(dict(enumerate(experiment.arms)), experiment.seed),
            ((int(arm), int(replicate)) for replicate, arm in np.argwhere(todo.T)),
            count,
            Refusal(origins),
            choice.limits,
        )
        counted = _Count(total - count, total, 0, progress)
        _fill(_Batch(store, experiment, told), finished, counted, choice.fail_fast)
    return Summary(folder, total, total - count, _failures(store, told, wanted))


class Planned(NamedTuple):
    """What a sweep would do."""

    folder: Path
    runs: int
    there: int
    to_do: int
    hours: float | None
    """Time that it is expected to take; None if no such run has been made yet."""
    jobs: int

    def text(self) -> str:
        """Return it as a line."""
        told = f"{self.runs} runs in {self.folder}: {self.there} are there, {self.to_do} to do"
        if not self.to_do:
            return told
        if self.hours is None:
            return f"{told}; how long that takes is not known before some have been made"
        return f"{told}, about {told_time(self.hours * 3600)} on {self.jobs} processes"


def planned(experiment: Experiment, folder: Path, jobs: int | None, choice: Choice) -> Planned:
    """Return what a sweep of *experiment* into *folder* would do; make nothing."""
    told = description_of(experiment, origins_of(experiment), choice.accepted)
    store = RunStore(folder)
    wanted = _wanted(told, choice.shard)
    todo = wanted & ~store.done(told)
    known = store.seconds_of_runs(told)
    workers = jobs or os.cpu_count() or 1
    usual = float(np.mean(list(known.values()))) if known else None
    hours = None
    if usual is not None:
        needed = (count * known.get(arm, usual) for arm, count in enumerate(todo.sum(axis=1)))
        hours = float(sum(needed)) / workers / 3600
    count, total = int(todo.sum()), int(wanted.sum())
    return Planned(folder, total, total - count, count, hours, workers)


def command_of(store: RunStore, row: int) -> list[str]:
    """Return the words of the command that repeats the run in *row* of what ``store.present()`` returns.

    Raise UserError if there is no such row, or if its experiment was edited since.
    """
    told = store.description()
    runs = store.present_rows("runs")
    if row >= len(runs):
        raise UserError(f"{store.folder}: has {len(runs)} rows, from 0, expected one of them, not {row}")
    asked = runs.slice(row, 1).to_pylist()[0]
    arm, sets = _arm_and_sets(told, asked["configuration"], f"row {row}")
    if arm.run is None:
        options = [word for each in sets for word in ("--set", each)]
        return ["cosim", "run", told.source, *options, "--seed", str(asked["seed"])]
    module, _, function = arm.run.partition(":")
    return ["python", "-c", f"from {module} import {function}; print({function}({arm.parameters!r}, {asked['seed']}))"]


def arm_of(told: SweepDescription, configuration: str) -> Arm:
    """Return the arm of the sweep that has the *configuration* of a run, for the run to be made again.

    Raise UserError if the experiment was edited since.
    """
    return _arm_and_sets(told, configuration, "the run")[0]


def _arm_and_sets(told: SweepDescription, configuration: str, what: str) -> tuple[Arm, list[str]]:
    labels = told.labels[told.configurations.index(configuration)]
    values = zip(told.axes.items(), labels, strict=True)
    sets = [*told.given, *(assignment(axis.path or name, value) for (name, axis), value in values)]
    arm = load_experiment(told.source, sets).arms[0]
    if arm.configuration != configuration:
        raise UserError(f"{told.source}: was edited since {what} was made: it has no such arm any more")
    return arm, sets


def run_until(
    experiment: Experiment,
    folder: str | Path,
    wanted: Mapping[str, float],
    jobs: int | None = None,
    engine: Engine | None = None,
    progress: Progress = lambda done, total, failed: None,
    choice: Choice = Choice(),  # it is frozen
) -> Summary:
    """Do what ``run_sweep`` does, in rounds, until the mean of each metric *wanted* is as precise as that, in all arms.

    *wanted* gives the relative error of each; ``cosim.statistics.stopping`` says when to look. There are never more
    replicates than *experiment* has. Raise UserError for a metric that no run has, or beside a shard.
    """
    if choice.shard != WHOLE:
        raise UserError("--shard: knows nothing of the other shards, and --until-ci looks at all runs")
    most, store = experiment.replicates, RunStore(Path(folder))
    whole = description_of(experiment, origins_of(experiment), choice.accepted)
    while True:
        samples = {
            (arm, metric): by_replicate
            for metric in wanted
            for arm, by_replicate in store.values(whole, metric).items()
        }
        known = {metric for (_, metric), values in samples.items() if not all(map(math.isnan, values.values()))}
        if missing := sorted(wanted.keys() - known) if any(samples.values()) else []:
            raise UserError(f"--until-ci: no run has a value of {missing[0]}")
        decision = decide(samples, {key: wanted[key[1]] for key in samples}, most)
        rounds = replace(experiment, replicates=decision.replicates)
        summary = run_sweep(rounds, folder, jobs, engine, progress, choice)
        choice = replace(choice, retry_failed=False)  # once
        if decision.stop:
            return summary._replace(lacking=decision.lacking)


@dataclass
class _Count:
    """How far a sweep is."""

    done: int
    total: int
    failed: int
    progress: Progress

    def add(self, failed: bool) -> None:
        self.done += 1
        self.failed += failed
        self.progress(self.done, self.total, self.failed)


def _wanted(told: SweepDescription, shard: Shard) -> "npt.NDArray[np.bool_]":
    """Return which runs the sweep *told* makes in *shard*: (arms, replicates); of arms with the same settings one.

    Runs are dealt out replicate by replicate: a sweep that is cut short has seen every arm.
    """
    arms = len(told.configurations)
    first_of = {each: arm for arm, each in reversed(list(enumerate(told.configurations)))}
    first = np.array([first_of[each] == arm for arm, each in enumerate(told.configurations)])
    number = np.arange(arms * told.replicates).reshape(told.replicates, arms).T
    wanted: npt.NDArray[np.bool_] = first[:, None] & (number % shard.of == shard.number - 1)
    return wanted


def _fill(batch: "_Batch", finished: Iterator[Finished], count: _Count, fail_fast: bool) -> None:
    try:
        with closing(finished):  # type: ignore[type-var]  # a full disk must end the worker processes too
            for each in finished:
                batch.add(each)
                count.add(each.error is not None)
                if fail_fast and each.error is not None:
                    raise UserError(f"{batch.named(each)}: {each.error}; --fail-fast ends the sweep with it")
    finally:  # also when interrupted: what is finished is kept
        batch.flush()


class _Batch:
    """Finished runs on their way to the disk."""

    def __init__(self, store: RunStore, experiment: Experiment, told: SweepDescription) -> None:
        self._store = store
        self._experiment = experiment
        self._told = told
        self._axes = _axis_fields(experiment)
        self._metadata = {"experiment": experiment.name, "scenario": json.dumps(experiment.base)} | provenance()
        self._declared: dict[str, tuple[Field, ...]] = {}
        self._waiting: list[Finished] = []
        self._written = monotonic()

    def add(self, finished: Finished) -> None:
        """Take a finished run, and write the batch if it has waited long enough."""
        self._waiting.append(finished)
        waited_s = max(finished.wall_s, monotonic() - self._written)
        if waited_s >= BATCH_S or len(self._waiting) >= BATCH_RUNS:
            self.flush()

    def flush(self) -> None:
        """Write what is waiting."""
        if not self._waiting:
            return
        waiting, self._waiting = self._waiting, []
        declared = {column.name: column for each in waiting for column in self._columns(each)}
        runs = [self._run(each) for each in waiting]
        seen = [self._blank(each) | self._key(each) | row for each in waiting for row in each.observations]
        self._store.append(runs, seen, [*self._axes, *declared.values()], self._metadata)
        self._written = monotonic()

    def named(self, finished: Finished) -> str:
        """Return which run *finished* is."""
        return _named_run(self._experiment.arms[finished.arm].labels, self._experiment.seed + finished.replicate)

    def _columns(self, finished: Finished) -> tuple[Field, ...]:
        """Return the columns that the function of *finished* declares, if a function has made it."""
        run = self._experiment.arms[finished.arm].run
        if run is None or finished.error is not None:
            return ()
        if run not in self._declared:
            module = find_function(run, "sweep.yaml").__module__
            declared = getattr(sys.modules.get(module), "COLUMNS", ())
            self._declared[run] = tuple(each._replace(optional=True) for each in declared)  # a run that failed has none
        columns = self._declared[run]
        return tuple(each._replace(kind="float") for each in columns) if finished.metrics else columns

    def _blank(self, finished: Finished) -> Row:
        """Return what is declared of a run's metrics or observations, without values: it has all of these columns."""
        return {column.name: None for column in self._columns(finished)}

    def _key(self, finished: Finished) -> Row:
        arm = self._experiment.arms[finished.arm]
        key = {
            "configuration": arm.configuration,
            "seed": self._experiment.seed + finished.replicate,
            "code": self._told.codes[finished.arm],
            "replicate": finished.replicate,
        }
        return key | arm.labels

    def _run(self, finished: Finished) -> Row:
        fixed = {
            "experiment": self._experiment.name,
            "libraries": self._told.libraries[self._told.codes[finished.arm]],
            "status": "failed" if finished.error else "done",
            "error": finished.error,
            "wall_s": finished.wall_s,
            "digest": finished.digest,
        }
        blank = self._blank(finished) if finished.metrics else {}
        return blank | fixed | self._key(finished) | finished.metrics


def _axis_fields(experiment: Experiment) -> list[Field]:
    return [
        Field(axis.name, kind_of(label for label, _ in axis.values), "", axis.path or SEVERAL, optional=True)
        for axis in experiment.axes
    ]


def _failures(store: RunStore, told: SweepDescription, wanted: "npt.NDArray[np.bool_]") -> tuple[str, ...]:
    """Return a line for each run of the sweep that failed, in the order of the arms."""
    found = []
    arms = {configuration: arm for arm, configuration in reversed(list(enumerate(told.configurations)))}
    for row in store.failed(told):
        arm, replicate = arms[row["configuration"]], row["seed"] - told.seed
        if 0 <= replicate < told.replicates and wanted[arm, replicate]:
            labels = dict(zip(told.axes, told.labels[arm], strict=True))
            found.append((arm, replicate, f"{_named_run(labels, row['seed'])}: {row['error']}"))
    return tuple(line for _, _, line in sorted(found))


def _named_run(labels: Mapping[str, Any], seed: int) -> str:
    return ", ".join(filter(None, [named(labels), f"seed {seed}"]))


def description_of(experiment: Experiment, origins: "Origins", accepted: Sequence[str] = ()) -> SweepDescription:
    """Return what the sweep.json of *experiment* tells."""
    return SweepDescription(
        experiment=experiment.name,
        about=experiment.settings.about,
        source=str(experiment.source.resolve()),
        axes={
            axis.name: AxisDescription(path=axis.path, values=tuple(label for label, _ in axis.values))
            for axis in experiment.axes
        },
        replicates=experiment.replicates,
        report=experiment.settings.report,
        given=experiment.given,
        seed=experiment.seed,
        configurations=tuple(arm.configuration for arm in experiment.arms),
        labels=tuple(tuple(arm.labels.values()) for arm in experiment.arms),
        codes=tuple(each.code for each in origins.by_arm),
        libraries={each.code: each.libraries for each in origins.by_arm},
        accepted=tuple(accepted),
    )


# ---------------------------------------------------------------- where results come from


class Roots(NamedTuple):
    """Where the sources of a run begin: modules, and folders of data that it may read."""

    modules: frozenset[str]
    folders: tuple[Path, ...] = ()


class Origins(NamedTuple):
    """What decides the runs of an experiment beside their settings."""

    by_arm: tuple[Origin, ...]
    by_roots: dict[Roots, Origin]


def origins_of(experiment: Experiment) -> Origins:
    """Return what decides the runs of each arm of *experiment*."""
    functions = {arm.run.partition(":")[0] for arm in experiment.arms if arm.run is not None}
    of_functions = {module: _roots_of_function(module) for module in functions}
    roots = [
        _roots(arm.scenario) if arm.scenario is not None else of_functions[(arm.run or "").partition(":")[0]]
        for arm in experiment.arms
    ]
    found = {each: origin(*each) for each in dict.fromkeys(roots)}
    return Origins(tuple(found[each] for each in roots), found)


def _roots(scenario: Scenario) -> Roots:
    """Return where the sources of the runs of *scenario* begin: its protocol and channels no import names."""
    kinds = {module_of(_CHANNELS, kind) for kind in _kinds(scenario.channel)}
    return Roots(frozenset({"cosim.simulation", module_of(_PROTOCOLS, scenario.protocol.use), *kinds}))


def _roots_of_function(module: str) -> Roots:
    """Return where the sources of a function in *module* begin.

    If it can make runs of robots, it may choose any protocol and channel that is installed, and any of the maps.
    """
    if "cosim.scenario" not in closure([module]):
        return Roots(frozenset({module}))
    entries = {module_of(group, name) for group in (_PROTOCOLS, _CHANNELS) for name in installed_names(group)}
    return Roots(frozenset({module, *entries}), tuple(installed_folders(_MAPS).values()))


def _kinds(value: Any) -> Iterator[str]:
    """Yield the kinds of the channels in *value*: a channel may consist of others."""
    if isinstance(value, ChannelSettings):
        yield value.kind
    if isinstance(value, BaseModel):
        value = [getattr(value, name) for name in type(value).model_fields]
    for each in value if isinstance(value, list | tuple) else ():
        yield from _kinds(each)


class Refusal:
    """What refuses a process that has other code or libraries than this one: see ``Engine``."""

    def __init__(self, origins: Origins) -> None:
        self.expected = tuple(origins.by_roots.items())
        self._key = tuple(each.code for each in origins.by_roots.values())

    def __hash__(self) -> int:
        return hash(self._key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Refusal) and self._key == other._key

    def __call__(self) -> str | None:
        """Return why no runs are to be made in the process that asks; None if they may be."""
        return _refused(self)


@lru_cache(maxsize=1)  # a worker asks before each batch
def _refused(refusal: Refusal) -> str | None:
    for roots, ours in refusal.expected:
        theirs = origin(*roots)
        if theirs.code != ours.code:
            told = ", ".join(differing(ours, theirs)) or "the order of its parts"
            return f"a worker on {gethostname()} has others than the sweep began with: {told}"
    return None
