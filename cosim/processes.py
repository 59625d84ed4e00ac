"""Work on several processes of our own, which are given batches, replaced if they die, ended if they take too much.

A worker is ``python -c`` with a pipe: a subprocess rather than one of ``multiprocessing``, which does not let a daemon
(what a Dask worker is) have children. It ends when its pipe does, so also when the parent is killed. What it is to
compute goes by name and must be importable: what is defined in a script's ``__main__`` is not.
"""

import gc
import json
import os
import pickle
import queue
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import islice
from multiprocessing import Pipe, connection
from multiprocessing.connection import Connection
from time import monotonic
from typing import Any, Final, Generic, NamedTuple, TypeVar

from cosim.errors import UserError

Asked = TypeVar("Asked")
Made = TypeVar("Made")

BATCH_S: Final = 0.2
"""Time that a batch is to take: longer, and the end of a sweep waits for the last one; shorter, and pipes cost more."""
MOST: Final = 256
"""Items of a batch at most."""
_DIED: Final = "the processes that computed it died (killed, or out of memory)"
"""What is said of an item that is given up."""
LIVES: Final = 5
"""Number of workers that die of an item before it is given up."""
LOOK_S: Final = 0.1
"""How often one looks how much memory the workers take, if that is limited."""
_BEGIN: Final = (
    "import json, signal, sys; signal.signal(signal.SIGINT, signal.SIG_IGN); "  # an interrupt is left to the parent
    "sys.path[:] = json.loads(sys.argv[1]); from cosim.processes import serve; serve(int(sys.argv[2]))"
)
ONE_THREAD: Final = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Variables by which libraries take one thread: as many workers as processors need no more."""


class Limits(NamedTuple):
    """What one item may take; more ends the process that computes it."""

    time_s: float | None = None
    memory_bytes: int | None = None


NO_LIMITS: Final = Limits()


@dataclass
class _Worker(Generic[Asked]):
    """A process, and what it has been given."""

    process: "subprocess.Popen[bytes]"
    pipe: Connection
    given: deque[Asked] = field(default_factory=deque)
    """What it has not answered yet, in order."""
    since_s: float = 0.0
    """When it began with the first of these."""
    ready: bool = False


class Pool(Generic[Asked, Made]):
    """Workers that compute *function* of whatever they are given.

    *begin* is called in each worker before anything else: what it returns, if not None, refuses the worker, and that
    is raised as a UserError. *lost* returns what stands for an item that could not be computed: (item, why).
    """

    def __init__(
        self,
        workers: int,
        function: Callable[[Asked], Made],
        lost: Callable[[Asked, str], Made],
        begin: Callable[[], str | None] | None = None,
        limits: Limits = NO_LIMITS,
    ) -> None:
        self._first = pickle.dumps((function, begin, limits != NO_LIMITS))
        self._lost = lost
        self._limits = limits
        self._deaths: dict[Any, int] = {}
        self._item_s = BATCH_S  # what an item takes, as measured
        self._wanted = workers
        self._workers: list[_Worker[Asked]] = []

    def __enter__(self) -> "Pool[Asked, Made]":
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self.close(now=kind is not None)

    def close(self, now: bool = True) -> None:
        """End all workers: *now*, or as soon as they have nothing to do."""
        for worker in self._workers:
            if now or not worker.ready:
                worker.process.kill()
            worker.pipe.close()
            worker.process.wait()
        self._workers.clear()

    def run(self, todo: Iterable[Asked], count: int) -> Iterator[Made]:
        """Yield what is made of each of *todo*, which are about *count*, as it is made.

        Raise UserError if a worker is refused, ChildProcessError if workers die before they have begun.
        """
        todo, again, left = iter(todo), deque[Asked](), count
        unready = 0  # workers that have died one after the other before they had begun
        while True:
            while len(self._workers) < min(self._wanted, max(1, count)):
                self._workers.append(self._start())
            for worker in self._workers:
                while worker.ready and (batch := self._next(worker, again, todo, left)):
                    left -= len(batch)
                    self._give(worker, batch)
            busy = [worker for worker in self._workers if worker.given or not worker.ready]
            idle = len(busy) < len(self._workers) or not self._workers
            if idle and not any(worker.given for worker in busy):
                return  # the idle one was offered what is left: there is nothing
            for worker in self._heard(busy):
                try:
                    message = worker.pipe.recv_bytes()
                except (EOFError, OSError):
                    unready += not worker.ready
                    if unready >= LIVES:
                        raise ChildProcessError("worker processes die before they have begun") from None
                    yield from self._buried(worker, again, _DIED)
                else:
                    unready = 0
                    yield from self._answers(worker, message)
            for worker, why in self._over():
                yield from self._buried(worker, again, why, at_once=True)

    # ------------------------------------------------------------ giving

    def _start(self) -> _Worker[Asked]:
        ours, theirs = Pipe()
        path = json.dumps([os.path.abspath(place) for place in sys.path])  # in this order; PYTHONPATH comes before all
        environment = os.environ | {name: os.environ.get(name, "1") for name in ONE_THREAD}
        command = [sys.executable, "-c", _BEGIN, path, str(theirs.fileno())]
        process = subprocess.Popen(command, pass_fds=(theirs.fileno(),), env=environment, stdin=subprocess.DEVNULL)
        theirs.close()
        with suppress(OSError):  # it has died already: its pipe says so
            ours.send_bytes(self._first)
        return _Worker(process, ours)

    def _next(self, worker: _Worker[Asked], again: deque[Asked], todo: Iterator[Asked], left: int) -> list[Asked]:
        """Return what *worker* is to be given next; nothing if it has enough, or there is nothing left."""
        size = max(1, min(MOST, int(BATCH_S / self._item_s), left // (2 * self._wanted)))
        # a batch of short items waits for the worker, which never waits for the parent; a long item would wait for it
        # while other workers have nothing to do
        ahead = size if self._item_s < BATCH_S else 0
        if len(worker.given) > ahead:
            return []
        if again:  # alone: if it is what killed a worker, it is known then
            return [] if worker.given else [again.popleft()]
        return list(islice(todo, size))

    def _give(self, worker: _Worker[Asked], batch: list[Asked]) -> None:
        if not worker.given:
            worker.since_s = monotonic()
        worker.given.extend(batch)
        with suppress(OSError):  # as above
            worker.pipe.send_bytes(pickle.dumps(batch))

    # ------------------------------------------------------------ hearing

    def _heard(self, busy: list[_Worker[Asked]]) -> list[_Worker[Asked]]:
        """Wait until one of *busy* answers or has died, or has used up its time; return those that did."""
        patience: float | None = None
        if self._limits.time_s is not None:
            ends = [worker.since_s + self._limits.time_s for worker in busy if worker.given]
            patience = max(0.0, min(ends, default=monotonic() + 1) - monotonic())
        if self._limits.memory_bytes is not None:
            patience = min(LOOK_S, LOOK_S if patience is None else patience)
        heard = connection.wait([worker.pipe for worker in busy], patience)
        return [worker for worker in busy if worker.pipe in heard]

    def _answers(self, worker: _Worker[Asked], message: bytes) -> Iterator[Made]:
        kind, answer = pickle.loads(message)
        if kind == "refused":
            raise UserError(answer)
        if kind == "raised":
            raise answer
        if kind == "ready":
            worker.ready = True
            return
        now = monotonic()
        taken_s = (now - worker.since_s) / len(answer)
        self._item_s += (taken_s - self._item_s) * min(1.0, len(answer) / 8)
        worker.since_s = now
        for _ in answer:
            self._deaths.pop(worker.given.popleft(), None)
        yield from answer

    def _over(self) -> list[tuple[_Worker[Asked], str]]:
        """Return the workers whose item takes more than it may, each with a sentence that says so."""
        found = []
        for worker in self._workers:
            if not worker.given or worker.pipe.poll():  # it has answered meanwhile: writing rows may have taken long
                continue
            time_s, most = self._limits
            if time_s is not None and monotonic() >= worker.since_s + time_s:
                found.append((worker, f"TimeoutError: took more than {time_s:g} s"))
            elif most is not None and (taken := _resident_bytes(worker.process.pid)) > most:
                told = f"MemoryError: took {taken / 1e6:.0f} MB, more than {most / 1e6:.0f} MB"
                found.append((worker, told))
        return found

    def _buried(self, worker: _Worker[Asked], again: deque[Asked], why: str, at_once: bool = False) -> Iterator[Made]:
        """End *worker*, give others what it had, and yield what stands for its item if that is lost."""
        worker.process.kill()
        worker.process.wait()
        worker.pipe.close()
        self._workers.remove(worker)
        if worker.given:
            item = worker.given[0]
            self._deaths[item] = self._deaths.get(item, 0) + 1
            if at_once or self._deaths[item] >= LIVES:
                del self._deaths[item]
                yield self._lost(worker.given.popleft(), why)
        again.extend(worker.given)


def in_processes(workers: int, function: Callable[[Asked], Made], todo: Sequence[Asked]) -> Iterator[Made]:
    """Yield what *function* returns for each of *todo*, as it is finished by one of as many new processes as *workers*.

    They end with the caller, and at once if it is interrupted. Raise what *function* raises, ChildProcessError if an
    item kills all processes that compute it.
    """

    def lost(item: Asked, why: str) -> Made:
        raise ChildProcessError(f"{item}: {why}")

    with Pool(workers, function, lost) as pool:
        yield from pool.run(todo, len(todo))


def _resident_bytes(pid: int) -> int:
    """Return how much memory the process *pid* holds (Linux: /proc/PID/statm); 0 if it has just ended."""
    try:
        with open(f"/proc/{pid}/statm", encoding="ascii") as file:
            return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, IndexError):
        return 0


# ---------------------------------------------------------------- in the worker


def serve(number: int) -> None:
    """Compute what comes by the pipe with the file descriptor *number*, until it ends: what a worker does."""
    pipe = Connection(number)
    try:
        function, begin, singly = pickle.loads(pipe.recv_bytes())
        refused = begin() if begin is not None else None
    except EOFError:
        return
    pipe.send_bytes(pickle.dumps(("ready", None) if refused is None else ("refused", refused)))
    gc.freeze()  # what imports have made is not looked through again whenever garbage is collected (5 %)
    batches: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(pipe, batches), daemon=True).start()
    while True:
        answers: list[Any] = []
        since_s = monotonic()
        batch = pickle.loads(batches.get())
        for place, item in enumerate(batch, start=1):
            try:
                answers.append(function(item))
            except BaseException as error:  # noqa: BLE001  # raised again in the parent
                pipe.send_bytes(pickle.dumps(("raised", error)))
                return
            if singly or place == len(batch) or monotonic() - since_s > BATCH_S / 2:
                pipe.send_bytes(pickle.dumps(("made", answers)))
                answers, since_s = [], monotonic()


def _listen(pipe: Connection, batches: "queue.SimpleQueue[bytes]") -> None:
    """Hand on what comes by *pipe*, and end this process when nothing more can come: the parent may be gone."""
    while True:
        try:
            batches.put(pipe.recv_bytes())
        except (EOFError, OSError):
            os._exit(0)
