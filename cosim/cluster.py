"""Runs on the workers of a Dask cluster: one that is there, by its address, or one that a batch system starts for us.

Runs go in batches that take about a second, and no more batches are under way than keep the workers busy: a scheduler
that holds a hundred thousand tasks is slow, and a result lives for as long as somebody refers to it. What is finished
comes back here and is written here; workers need no common file system, and may die: Dask makes their batches again.
"""

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from time import perf_counter
from typing import Any, Final

from cosim.documents import read_yaml
from cosim.errors import UserError
from cosim.installed import check_libraries
from cosim.processes import NO_LIMITS, Limits, Pool
from cosim.sweep import Asked, Engine, Execution, Finished, lost

NEEDS: Final = ("distributed>=2024.8",)
"""The extra ``cluster`` of pyproject.toml."""
BATCH_SYSTEM_NEEDS: Final = (*NEEDS, "dask_jobqueue>=0.9")
"""The extra ``slurm`` of pyproject.toml."""
WAIT_S: Final = 10.0
"""Patience with a scheduler that does not answer, and with one that has no worker."""
BATCH_SYSTEM_WAIT_S: Final = 3600.0
"""Patience with a batch system that has started no worker yet."""
TRIES: Final = 5
"""How often one tries to be a client of a scheduler that is busy."""
BATCH_S: Final = 1.0
"""Time that a batch is to take."""
LIMITED_BATCH_S: Final = 30.0
"""The same if runs have limits: each batch then starts a process of its own, which takes a second."""
MOST: Final = 1000
"""Runs of a batch at most."""
AHEAD: Final = 3
"""Batches under way for each worker: one that it makes, and what it and the scheduler hold ready."""
BATCH_SYSTEMS: Final = {
    "slurm": "dask_jobqueue:SLURMCluster",
    "pbs": "dask_jobqueue:PBSCluster",
    "sge": "dask_jobqueue:SGECluster",
    "lsf": "dask_jobqueue:LSFCluster",
    "htcondor": "dask_jobqueue:HTCondorCluster",
    "local": "dask_jobqueue.local:LocalCluster",  # no batch system: what others would submit runs here
}
"""The clusters of dask-jobqueue, by what stands before the colon of ``--dask slurm:FILE``."""


@contextmanager
def on_cluster(address: str) -> Iterator[Engine]:
    """Give the engine that makes runs on the Dask cluster at *address*, or on one started as ``slurm:FILE`` says.

    Raise UserError if an extra is not installed, nobody answers or there is no worker; the engine raises
    ChildProcessError if the scheduler goes.
    """
    check_libraries("sweeps on a cluster", NEEDS)
    system, colon, file = address.partition(":")
    started = system in BATCH_SYSTEMS and colon and not file.startswith("//")
    with _started(system, Path(file)) if started else _client_of(address) as client:
        try:
            client.wait_for_workers(1, BATCH_SYSTEM_WAIT_S if started else WAIT_S)
        except TimeoutError:
            raise UserError(f"--dask {address}: the scheduler has no worker, expected one at least") from None
        yield _engine(client, address)


def _client_of(address: str) -> Any:
    """Return a client of the Dask scheduler at *address*; raise UserError if nobody answers there."""
    from distributed import Client
    from distributed.comm import resolve_address

    try:
        resolve_address(address)  # a client that never had an address does not close
        for _ in range(TRIES):
            # a client takes it for a fault of its own if a busy scheduler's second message comes along with the first
            with suppress(AssertionError):
                return Client(address, timeout=WAIT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise UserError(f"--dask {address}: no Dask scheduler answers there: {error}") from None
    raise UserError(f"--dask {address}: the scheduler is too busy to answer")


@contextmanager
def _started(system: str, file: Path) -> Iterator[Any]:
    """Start a cluster of the batch *system* as *file* says, and give a client of it.

    *file* is YAML: what dask-jobqueue's cluster takes (cores, memory, walltime, queue, ...), and ``jobs``, a number of
    jobs, or ``adapt``, a mapping such as ``{minimum: 1, maximum: 20}``.
    """
    check_libraries(f"sweeps by {system}", BATCH_SYSTEM_NEEDS)
    from importlib import import_module

    from distributed import Client

    settings = dict(read_yaml(file))
    jobs, adapt = settings.pop("jobs", None), settings.pop("adapt", None)
    if (jobs is None) == (adapt is None):
        raise UserError(f"{file}: expected either jobs, a number, or adapt, such as {{minimum: 1, maximum: 20}}")
    module, name = BATCH_SYSTEMS[system].split(":")
    try:
        cluster = getattr(import_module(module), name)(**settings)
    except (TypeError, ValueError) as error:
        raise UserError(f"{file}: is nothing that {name} takes: {error}") from None
    with cluster, Client(cluster, set_as_default=False) as client:
        if jobs is not None:
            cluster.scale(jobs=jobs)
        else:
            cluster.adapt(**adapt)
        yield client


def _engine(client: Any, address: str) -> Engine:
    def run(
        execution: Execution, todo: Iterable[Asked], count: int, begin: Callable[[], str | None], limits: Limits
    ) -> Iterator[Finished]:
        try:
            yield from _Window(client, execution.anywhere(), begin, limits).run(iter(todo), count)
        except CancelledError:
            raise ChildProcessError(f"--dask {address}: the scheduler has gone") from None

    return run


@dataclass(frozen=True)
class Made:
    """What a worker answers to a batch: why it is *refused*, if it is, the *runs*, and the time that they took."""

    refused: str | None
    runs: list[Finished]
    wall_s: float


class _Window:
    """The batches that are under way."""

    def __init__(self, client: Any, execution: Execution, begin: Callable[[], str | None], limits: Limits) -> None:
        self._client = client
        self._execution = execution
        self._begin = begin
        self._limits = limits
        self._batch_s = BATCH_S if limits == NO_LIMITS else LIMITED_BATCH_S
        self._run_s = self._batch_s  # what a run takes, as measured
        self._under_way: dict[Any, Sequence[Asked]] = {}

    def run(self, todo: Iterator[Asked], left: int) -> Iterator[Finished]:
        """Yield what becomes of each of *todo*, of which there are about *left*."""
        from distributed import KilledWorker, as_completed

        again = deque[Sequence[Asked]]()
        done = as_completed(loop=self._client.loop, with_results=True, raise_errors=False)
        try:
            while True:
                workers = max(1, len(self._client.scheduler_info(n_workers=-1)["workers"]))
                while len(self._under_way) < AHEAD * workers:
                    size = max(1, min(MOST, int(self._batch_s / self._run_s), left // (2 * workers)))
                    batch = again.popleft() if again else list(islice(todo, size))
                    if not batch:
                        break
                    left -= len(batch)
                    self._submit(batch, done)
                if not self._under_way:
                    return
                future, answer = next(done)
                batch = self._under_way.pop(future)
                # the future's status tells of now: that of a batch which is here is "lost" once its worker has died
                if isinstance(answer, Made):
                    yield from self._taken(batch, answer)
                elif isinstance(answer, CancelledError):
                    raise answer
                elif isinstance(error := answer[1], KilledWorker):
                    if len(batch) == 1:
                        yield lost(batch[0], f"the workers that computed it died, at last {error.last_worker.address}")
                    again.extend([asked] for asked in batch if len(batch) > 1)
                else:
                    raise error
        finally:
            with suppress(Exception):  # the scheduler may be what has gone
                self._client.cancel(list(self._under_way))

    def _submit(self, batch: Sequence[Asked], done: Any) -> None:
        future = self._client.submit(
            make_batch, self._execution.of(batch), batch, self._begin, self._limits, pure=False
        )
        self._under_way[future] = batch
        done.add(future)

    def _taken(self, batch: Sequence[Asked], made: Made) -> Iterator[Finished]:
        if made.refused is not None:
            raise UserError(made.refused)
        self._run_s += (max(made.wall_s / len(batch), 1e-6) - self._run_s) * min(1.0, len(batch) / 8)
        yield from made.runs


def make_batch(execution: Execution, batch: Sequence[Asked], begin: Callable[[], str | None], limits: Limits) -> Made:
    """Make the runs of *batch*."""
    refused = begin()
    if refused is not None:
        return Made(refused, [], 0.0)
    began = perf_counter()
    if limits == NO_LIMITS:
        made = list(map(execution, batch))
    else:
        with Pool(1, execution, lost, None, limits) as pool:
            made = list(pool.run(batch, len(batch)))
    return Made(None, made, perf_counter() - began)
