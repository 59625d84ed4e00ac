"""Workers of our own: what they compute does not depend on them, on their deaths, or on the limits of others' work."""

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from cosim.errors import UserError
from cosim.processes import LIVES, NO_LIMITS, Limits, Pool, in_processes
from tests.checkout import DATA

SQUARES = [number * number for number in range(40)]


@pytest.fixture(autouse=True)
def labour(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Work in a folder with the functions that workers compute, and give these."""
    shutil.copy(DATA / "labour.py", tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "labour", raising=False)
    import labour  # type: ignore[import-not-found]  # copied there

    return labour


def lost(item: int, why: str) -> tuple[int, str]:
    return item, why


def made(
    function: Callable[[int], Any],
    count: int = 8,
    workers: int = 2,
    begin: Callable[[], str | None] | None = None,
    limits: Limits = NO_LIMITS,
) -> list[Any]:
    with Pool[int, Any](workers, function, lost, begin, limits) as pool:
        return list(pool.run(range(count), count))


def split(answers: list[Any]) -> tuple[list[int], list[tuple[int, str]]]:
    """Return the squares among *answers*, sorted, and what stands for items that are lost."""
    return sorted(each for each in answers if isinstance(each, int)), [each for each in answers if type(each) is tuple]


WITHOUT_3 = [number * number for number in range(8) if number != 3]


@pytest.mark.parametrize("workers", [1, 2])
def test_each_item_is_computed_once_by_whatever_number_of_workers(labour: Any, workers: int):
    answers = made(labour.numbered, 40, workers)
    assert sorted(number for number, _ in answers) == list(range(40))
    pids = {pid for _, pid in answers}
    assert len(pids) == workers
    assert os.getpid() not in pids


def test_long_items_wait_for_no_worker_while_another_is_idle(labour: Any):
    assert made(labour.side_by_side, 2, begin=labour.one_begins_late) == [True, True]


def test_nothing_to_do_starts_no_process(labour: Any, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(subprocess, "Popen", None)
    assert made(labour.square, 0, 0) == []


def test_what_a_killed_worker_had_is_made_again(labour: Any):
    assert sorted(made(labour.deadly_once)) == SQUARES[:8]
    assert Path("killed").exists()


@pytest.mark.slow
def test_an_item_that_kills_every_process_is_lost_and_the_others_go_on(labour: Any):
    started: list[Any] = []
    before = subprocess.Popen.__init__

    def counted(process: Any, *given: Any, **named: Any) -> None:
        started.append(process)
        before(process, *given, **named)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(subprocess.Popen, "__init__", counted)
        squares, gone = split(made(labour.deadly))
    assert squares == WITHOUT_3
    assert gone == [(3, "the processes that computed it died (killed, or out of memory)")]
    # LIVES of them died of it; an item before it, in the same batch, may have been blamed for the first of these
    assert LIVES + 1 <= len(started) <= LIVES + 4


@pytest.mark.slow
def test_an_item_that_takes_too_long_ends_its_process_and_no_other_item(labour: Any):
    squares, gone = split(made(labour.endless, limits=Limits(time_s=0.5)))
    assert squares == WITHOUT_3
    assert gone == [(3, "TimeoutError: took more than 0.5 s")]


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="/proc tells how much memory a process holds")
def test_an_item_that_takes_too_much_memory_ends_its_process_and_no_other_item(labour: Any):
    squares, gone = split(made(labour.greedy, limits=Limits(memory_bytes=200_000_000)))
    assert squares == WITHOUT_3
    ((item, why),) = gone
    assert item == 3
    assert why.startswith("MemoryError: took ")
    assert why.endswith(" MB, more than 200 MB")


@pytest.mark.slow
def test_an_answer_that_waits_to_be_heard_is_not_too_late(labour: Any):
    with Pool[int, Any](2, labour.a_twentieth, lost, None, Limits(time_s=0.6)) as pool:
        answers = []
        for answer in pool.run(range(4), 4):
            time.sleep(0.7)  # rows are written meanwhile: it takes as long as the disk wants
            answers.append(answer)
    assert sorted(answers) == SQUARES[:4]


def test_an_error_is_raised_as_it_is_whatever_its_kind(labour: Any):
    with pytest.raises(FileNotFoundError, match="no such thing"):
        list(in_processes(1, labour.broken, range(8)))


@pytest.mark.slow
def test_an_item_that_cannot_be_computed_is_an_error_where_nothing_can_stand_for_it(labour: Any):
    with pytest.raises(ChildProcessError, match=r"^3: the processes that computed it died"):
        list(in_processes(1, labour.deadly, range(8)))


@pytest.mark.slow
def test_workers_that_die_before_they_begin_are_not_started_for_ever(labour: Any):
    with pytest.raises(ChildProcessError, match=r"^worker processes die before they have begun$"):
        made(labour.square, workers=1, begin=labour.dies_at_once)


def test_a_worker_that_dies_before_it_is_spoken_to_is_replaced(labour: Any, monkeypatch: pytest.MonkeyPatch):
    before, deaths = subprocess.Popen.__init__, []

    def killed(process: Any, *given: Any, **named: Any) -> None:
        before(process, *given, **named)
        if not deaths:
            deaths.append(process)
            process.kill()
            process.wait()

    monkeypatch.setattr(subprocess.Popen, "__init__", killed)
    assert sorted(made(labour.square)) == SQUARES[:8]
    assert deaths


def test_a_worker_may_refuse(labour: Any):
    with pytest.raises(UserError, match=r"^it is Monday$"):
        made(labour.square, begin=labour.refuses)


def children(pid: int) -> list[int]:
    return [int(each) for each in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="/proc tells the children of a process")
def test_workers_end_with_a_parent_that_is_killed(labour: Any):
    script = "import labour; from cosim.processes import in_processes; list(in_processes(2, labour.endless, [3, 3]))"
    parent = subprocess.Popen([sys.executable, "-c", script])
    end = time.monotonic() + 60
    while len(workers := children(parent.pid)) < 2:
        assert time.monotonic() < end
        time.sleep(0.01)
    os.kill(parent.pid, signal.SIGKILL)
    parent.wait()
    while any(map(alive, workers)):
        assert time.monotonic() < end
        time.sleep(0.01)
