"""A sweep: all arms and replicates of an experiment on several processes, every finished run kept, resumed by itself.

The seed of a run comes from its replicate, never from its arm: all arms see the same worlds (common random numbers),
and differences between arms are paired. What a row holds does not depend on how many processes there were.
"""

import gc
import json
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, ProcessPoolExecutor, as_completed
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import monotonic, perf_counter
from typing import Any, Final, NamedTuple, TypeAlias, TypeVar

from cosim.columns import kind_of
from cosim.errors import UserError
from cosim.experiment import Arm, Experiment, find_function, named
from cosim.installed import check_libraries
from cosim.protocol import Metric
from cosim.results import (
    PACKAGES,
    SEVERAL,
    AxisDescription,
    Row,
    RunStore,
    SweepDescription,
    code_digest,
    metric_fields,
    provenance,
    versions,
)
from cosim.scenario import digest
from cosim.simulation import Simulation, simulate
from cosim.trace import Field

Progress: TypeAlias = Callable[[int, int], None]
"""Told (runs that are finished, runs in all)."""

Asked = TypeVar("Asked")
Made = TypeVar("Made")

BATCH_S = 1.0
"""Runs shorter than this are written together, as soon as one finishes this long after the last writing."""

_SET_UP: Final[Any] = {"floorplan": True, "team": True, "channel": True, "protocol": {"use": True}}
"""What of a scenario decides whether its runs can be set up, and which metrics they have."""

CLUSTER_NEEDS = ("distributed>=2024.8",)
"""The extra ``cluster`` of pyproject.toml."""
CLUSTER_WAIT_S = 10.0
"""Patience with a Dask scheduler that does not answer, and with one that has no worker."""
CLUSTER_TRIES = 5
"""How often one tries to be a client of a scheduler that is busy."""


class Task(NamedTuple):
    """One run that is to be made."""

    arm: Arm
    replicate: int
    seed: int


@dataclass
class Finished:
    """What became of a task."""

    task: Task
    wall_s: float
    error: str | None = None
    digest: str | None = None
    metrics: dict[str, float] = field(default_factory=dict)
    columns: tuple[Field, ...] = ()
    """Unit and meaning of its metrics or observations, as far as they are declared."""
    observations: list[Row] = field(default_factory=list)


class Summary(NamedTuple):
    """What a sweep came to."""

    folder: Path
    runs: int
    resumed: int
    """How many of the runs were there already."""
    failures: tuple[str, ...]
    """The errors of the runs that failed, each with its arm."""


# ---------------------------------------------------------------- one run


def execute(task: Task) -> Finished:
    """Make one run; whatever goes wrong in it becomes its error, and the sweep goes on."""
    started = perf_counter()
    try:
        result = _simulated(task) if task.arm.scenario is not None else _called(task)
    except Exception as error:  # noqa: BLE001  # the error is recorded in the run's row; other runs go on
        text = " ".join(f"{type(error).__name__}: {error}".split())
        result = Finished(task, 0.0, error=text)
    result.wall_s = perf_counter() - started
    return result


def _simulated(task: Task) -> Finished:
    assert task.arm.scenario is not None
    outcome = simulate(task.arm.scenario, task.seed)
    columns = tuple(metric_fields(outcome.metric_columns))
    return Finished(task, 0.0, None, outcome.digest, dict(outcome.metrics), columns)


def _called(task: Task) -> Finished:
    assert task.arm.run is not None
    function = find_function(task.arm.run, "sweep.yaml")
    answer = function(task.arm.parameters, task.seed)
    declared = getattr(sys.modules.get(function.__module__), "COLUMNS", ())
    columns = tuple(field._replace(optional=True) for field in declared)  # a run that failed has none
    if isinstance(answer, dict):
        metrics = {name: float(value) for name, value in answer.items()}
        columns = tuple(field._replace(kind="float") for field in columns)
        return Finished(task, 0.0, None, digest(answer), metrics, columns)
    return Finished(task, 0.0, None, digest(answer), columns=columns, observations=list(answer))


# ---------------------------------------------------------------- all of them


def default_folder(experiment: Experiment, quick: bool) -> Path:
    """Return where results go if the user does not say: a quick sweep does not mix with a full one."""
    return Path("results") / (f"{experiment.name}-quick" if quick else experiment.name)


def tasks(experiment: Experiment) -> list[Task]:
    """Return all runs of *experiment*, replicate by replicate: a sweep that is cut short has seen every arm."""
    return [
        Task(arm, replicate, experiment.seed + replicate)
        for replicate in range(experiment.replicates)
        for arm in experiment.arms
    ]


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
    executor: Executor | None = None,
    progress: Progress = lambda done, total: None,
) -> Summary:
    """Make the runs of *experiment* that *folder* does not hold yet, on *executor* or on *jobs* processes of our own.

    With one job everything happens in this process. An interrupt leaves what is finished in *folder*, as does an
    OSError (a full disk, a dead worker process), which is raised.
    """
    folder = Path(folder)
    metrics = check_set_up(experiment)
    code = code_digest(_packages(experiment))
    every = tasks(experiment)
    store = RunStore(folder)
    with store.writing():
        axes = _axis_fields(experiment)
        store.declare([*axes, *metrics], axes)
        store.describe(_description(experiment, code))
        done = store.done()
        todo = [task for task in every if (task.arm.configuration, task.seed, code) not in done]
        resumed = len(every) - len(todo)
        _fill(_Batch(store, experiment, code), todo, jobs, executor, lambda n: progress(resumed + n, len(every)))
    return Summary(folder, len(every), resumed, _failures(store, experiment))


def _fill(
    batch: "_Batch",
    todo: Sequence[Task],
    jobs: int | None,
    executor: Executor | None,
    progress: Callable[[int], None],
) -> None:
    try:
        with closing(_finished(todo, jobs, executor)) as results:  # a full disk must end the worker processes too
            for count, finished in enumerate(results, start=1):
                batch.add(finished)
                progress(count)
    finally:  # also when interrupted: what is finished is kept
        batch.flush()


class _Batch:
    """Finished runs on their way to the disk."""

    def __init__(self, store: RunStore, experiment: Experiment, code: str) -> None:
        self._store = store
        self._experiment = experiment
        self._code = code
        self._axes = _axis_fields(experiment)
        self._metadata = {"experiment": experiment.name, "scenario": json.dumps(experiment.base)} | provenance()
        self._waiting: list[Finished] = []
        self._written = monotonic()

    def add(self, finished: Finished) -> None:
        """Take a finished run, and write the batch if it has waited long enough."""
        self._waiting.append(finished)
        if max(finished.wall_s, monotonic() - self._written) >= BATCH_S:
            self.flush()

    def flush(self) -> None:
        """Write what is waiting."""
        if not self._waiting:
            return
        waiting, self._waiting = self._waiting, []
        columns = {column.name: column for finished in waiting for column in finished.columns}
        runs = [self._run(finished) for finished in waiting]
        seen = [_blank(finished) | self._key(finished) | row for finished in waiting for row in finished.observations]
        self._store.append(runs, seen, [*self._axes, *columns.values()], self._metadata)
        self._written = monotonic()

    def _key(self, finished: Finished) -> Row:
        arm, replicate, seed = finished.task
        key = {"configuration": arm.configuration, "seed": seed, "code": self._code, "replicate": replicate}
        return key | arm.labels

    def _run(self, finished: Finished) -> Row:
        fixed = {
            "experiment": self._experiment.name,
            "status": "failed" if finished.error else "done",
            "error": finished.error,
            "wall_s": finished.wall_s,
            "digest": finished.digest,
        }
        blank = _blank(finished) if finished.metrics else {}
        return blank | fixed | self._key(finished) | finished.metrics


def _blank(finished: Finished) -> Row:
    """Return what is declared of a run's metrics or observations, without values: it has all of these columns."""
    return {field.name: None for field in finished.columns}


def _axis_fields(experiment: Experiment) -> list[Field]:
    return [
        Field(axis.name, kind_of(label for label, _ in axis.values), "", axis.path or SEVERAL, optional=True)
        for axis in experiment.axes
    ]


def _failures(store: RunStore, experiment: Experiment) -> tuple[str, ...]:
    rows = store.present().query("status == 'failed'").to_dict("records")
    names = [axis.name for axis in experiment.axes]
    return tuple(f"{named({n: row[n] for n in names})}, seed {row['seed']}: {row['error']}" for row in rows)


def _description(experiment: Experiment, code: str) -> SweepDescription:
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
        configurations=tuple(arm.configuration for arm in experiment.arms),
        code=code,
    )


def _packages(experiment: Experiment) -> set[str]:
    """Return the packages whose sources decide the results: ours, and those of a user's protocol or function."""
    modules = {arm.scenario.protocol.spec.parameters.__module__ for arm in experiment.arms if arm.scenario is not None}
    modules |= {arm.run for arm in experiment.arms if arm.run is not None}
    return {*PACKAGES, *map(_package, modules)} - {"__main__"}


def _package(module: str) -> str:
    """Return the package that *module* belongs to; a user's own below ``protocols`` is none of ours."""
    top, *below = module.partition(":")[0].split(".")
    return ".".join((top, *below[:1])) if top in PACKAGES else top


# ---------------------------------------------------------------- processes


def _finished(todo: Sequence[Task], jobs: int | None, executor: Executor | None) -> Generator[Finished, None, None]:
    workers = min(jobs or os.cpu_count() or 1, len(todo))
    if executor is not None:
        yield from _from(executor, execute, [_anywhere(task) for task in todo])
    elif workers <= 1:
        yield from map(execute, todo)
    else:
        yield from in_processes(workers, execute, todo)


def in_processes(workers: int, function: Callable[[Asked], Made], todo: Sequence[Asked]) -> Generator[Made, None, None]:
    """Yield what *function* returns for each of *todo*, as it is finished by one of as many new processes as *workers*.

    They end with the caller, and at once if it is interrupted. Raise ChildProcessError if one of them dies.
    """
    strangers = set(multiprocessing.active_children())
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(workers, mp_context=context, initializer=_begin_worker)
    try:
        yield from _from(
            pool, function, todo, cancel=False
        )  # that is left to the pool: it fails over futures others cancelled
    except BaseException:  # the runs under way would keep us waiting
        pool.shutdown(wait=False, cancel_futures=True)
        for child in set(multiprocessing.active_children()) - strangers:
            child.terminate()
        raise
    pool.shutdown()


def _from(
    executor: Executor, function: Callable[[Asked], Made], todo: Sequence[Asked], cancel: bool = True
) -> Generator[Made, None, None]:
    futures: list[Future[Made]] = [executor.submit(function, each) for each in todo]
    try:
        for future in as_completed(futures):
            yield future.result()
    except BrokenExecutor:
        raise ChildProcessError("a worker process died (killed, or out of memory)") from None
    finally:
        for future in futures if cancel else ():
            future.cancel()


def _anywhere(task: Task) -> Task:
    """Return *task* with the folder of its maps in full: a process elsewhere stands in another one."""
    scenario = task.arm.scenario
    if scenario is None:
        return task
    return task._replace(arm=replace(task.arm, scenario=scenario.placed(scenario.folder.resolve())))


def _begin_worker() -> None:
    """Set a worker up: what its imports have made is not looked through again whenever garbage is collected (5 %)."""
    gc.freeze()
    _die_with_parent()


def _die_with_parent() -> None:
    """Leave interrupts to the parent, and end when it is gone: a worker cannot see that its queue is dead."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


# ---------------------------------------------------------------- many machines


@contextmanager
def cluster(address: str, experiment: Experiment) -> Iterator[Executor]:
    """Give an executor on the workers of the Dask scheduler at *address*, for the runs of *experiment*.

    Raise UserError if the extra is not installed, nobody answers, there is no worker, or one of them has other code or
    libraries than this process; ChildProcessError if the cluster loses a run.
    """
    check_libraries("sweeps on a cluster", CLUSTER_NEEDS)
    from distributed import KilledWorker

    with _client_of(address) as client:
        try:
            client.wait_for_workers(1, CLUSTER_WAIT_S)
        except TimeoutError:
            raise UserError(f"--dask {address}: the scheduler has no worker, expected one at least") from None
        packages = sorted(_packages(experiment))
        ours = _makings(packages)
        for worker, theirs in client.run(_makings, packages, on_error="return").items():
            _check_worker(f"--dask {address}: worker {worker}", ours, theirs)
        try:
            yield client.get_executor(pure=False)
        except KilledWorker as error:
            raise ChildProcessError(
                f"--dask {address}: several workers died in a run, at last {error.last_worker.address}"
            ) from None
        except CancelledError:
            raise ChildProcessError(f"--dask {address}: the scheduler has gone") from None


def _client_of(address: str) -> Any:
    """Return a client of the Dask scheduler at *address*; raise UserError if nobody answers there."""
    from distributed import Client
    from distributed.comm import resolve_address

    try:
        resolve_address(address)  # a client that never had an address does not close
        for _ in range(CLUSTER_TRIES):
            # a client takes it for a fault of its own if a busy scheduler's second message comes along with the first
            with suppress(AssertionError):
                return Client(address, timeout=CLUSTER_WAIT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise UserError(f"--dask {address}: no Dask scheduler answers there: {error}") from None
    raise UserError(f"--dask {address}: the scheduler is too busy to answer")


def _makings(packages: Sequence[str]) -> dict[str, str]:
    """Return what beside the settings decides results here: versions of libraries, digests of the sources."""
    return versions() | {f"the sources of {name}": code_digest([name]) for name in packages}


def _check_worker(worker: str, ours: Mapping[str, str], theirs: Mapping[str, str] | BaseException) -> None:
    if isinstance(theirs, BaseException):
        raise UserError(f"{worker}: cosim cannot be used there: {type(theirs).__name__}: {theirs}")
    other = [name for name, value in ours.items() if theirs.get(name) != value]
    if other:
        raise UserError(f"{worker}: has others than this computer: {', '.join(other)}; expected the same installation")
