"""Task trees: what ends when, and how, against a closed form; and what the commands do."""

import heapq
import itertools
from collections.abc import Callable, Sequence

import pytest
from hypothesis import strategies as st

from cosim.errors import LocalProtocolError
from cosim.machine import Address, next_state
from cosim.units import S, Time
from protocols.deployment.executing.tree import TABLE, Edge, Input, Node, State, TaskTree, claims
from protocols.deployment.tasks.orders import Result
from protocols.deployment.tasks.plan import Go, Task, Wait
from tests.tiers import tiers


class Open:
    """Says yes to everything."""

    tries = 2

    def __init__(self) -> None:
        self.log: list[tuple[Time, str, str]] = []

    def opens(self, node: Node, edge: Edge, now: Time) -> Time | None:
        return now

    def robots(self, node: Node) -> frozenset[Address] | None:
        return claims(node.task)

    def expand(self, node: Node, now: Time) -> Sequence[Task]:
        return ()

    def once_more(self, node: Node) -> Sequence[Task]:
        return ()

    def verdict(self, node: Node) -> tuple[str, bool]:
        return "", False

    def began(self, node: Node, now: Time) -> None:
        self.log.append((now, "began", node.name))

    def ended(self, node: Node, now: Time) -> None:
        self.log.append((now, node.state.value, node.task.name))


def go(name: str, robot: int = 0, lasts_s: int = 1, fails_before_s: int = 0, **changes: object) -> Task:
    """A drive that lasts so long, and fails if it begins before some time: the place says both."""
    return Task(name=name, act=Go(robot=robot, place_m=(float(lasts_s), float(fails_before_s))), **changes)  # type: ignore[arg-type]


def wait(name: str, seconds: float, **changes: object) -> Task:
    return Task(name=name, act=Wait(seconds=seconds), **changes)  # type: ignore[arg-type]


def serial(name: str, *subtasks: Task, **changes: object) -> Task:
    return Task(name=name, subtasks=subtasks, **changes)  # type: ignore[arg-type]


def parallel(name: str, *subtasks: Task, **changes: object) -> Task:
    return Task(name=name, order="parallel", subtasks=subtasks, **changes)  # type: ignore[arg-type]


class Play:
    """Runs a tree whose drives do what their places say, until it is over; *calls* are made at their times."""

    def __init__(self, root: Task, *calls: tuple[float, Callable[[TaskTree, Time], None]]) -> None:
        self.director = Open()
        self.tree = TaskTree(root, self.director)
        self.now: Time = 0
        self._queue: list[tuple[Time, int, Callable[[], None]]] = []
        self._count = itertools.count()
        self._begun: set[str] = set()
        for at_s, call in calls:
            self._at(round(at_s * S), lambda call=call: call(self.tree, self.now))
        self._run()

    def _at(self, at: Time, call: Callable[[], None]) -> None:
        heapq.heappush(self._queue, (at, next(self._count), call))

    def _run(self) -> None:
        self._advance()
        while not self.tree.over:
            times = [
                at for at in (self.tree.wake_at(self.now), self._queue[0][0] if self._queue else None) if at is not None
            ]
            self.now = min(times)
            while self._queue and self._queue[0][0] <= self.now:
                heapq.heappop(self._queue)[2]()
            self._advance()

    def _advance(self) -> None:
        self.tree.advance(self.now)
        for leaf in self.tree.running():
            if isinstance(leaf.task.act, Go) and leaf.name not in self._begun:
                self._begun.add(leaf.name)
                lasts_s, fails_before_s = leaf.task.act.place_m
                fails = self.now < fails_before_s * S
                self._at(
                    self.now + round(lasts_s * S),
                    lambda leaf=leaf, name=leaf.name, fails=fails: self._end(leaf, name, fails),
                )

    def _end(self, leaf: Node, name: str, fails: bool) -> None:
        if leaf.state is State.RUNNING and leaf.name == name:
            if fails:
                self.tree.fail(leaf, self.now, "stuck")
            else:
                self.tree.finish(leaf)

    @property
    def end_s(self) -> float:
        return self.now / S

    def at_s(self, what: str, name: str) -> float:
        """When something happened to a task for the last time."""
        return max(at for at, happened, task in self.director.log if (happened, task) == (what, name)) / S


# ---------------------------------------------------------------- the closed form


def outcome(task: Task, start_s: float) -> tuple[float, bool]:
    """Return when a task that starts at *start_s* ends, and whether it fails: without looking at any state."""
    if isinstance(task.act, Wait):
        end_s, fails = start_s + task.act.seconds, False
    elif isinstance(task.act, Go):
        end_s, fails = start_s + task.act.place_m[0], start_s < task.act.place_m[1]
    elif task.order == "serial":
        end_s, fails = start_s, False
        for each in task.subtasks:
            if not fails:
                end_s, fails = passed(each, end_s)
    else:
        ends = [passed(each, start_s) for each in task.subtasks]
        failures = [at_s for at_s, failed in ends if failed]
        end_s, fails = (min(failures), True) if failures else (max(at_s for at_s, _ in ends), False)
    if task.time_out_s is not None and end_s > start_s + task.time_out_s:
        return start_s + task.time_out_s, True
    return end_s, fails


def passed(task: Task, start_s: float) -> tuple[float, bool]:
    """Return when a task lets its parent go on, and whether that fails by it."""
    end_s, fails = outcome(task, start_s)
    if fails and task.on_failure == "retry":
        end_s, fails = outcome(task, end_s)
    return end_s, fails and task.on_failure != "skip"


@st.composite
def trees(draw: st.DrawFn, name: str = "root", depth: int = 3, robots: "itertools.count[int] | None" = None) -> Task:
    robots = robots or itertools.count()
    changes: dict[str, object] = {"on_failure": draw(st.sampled_from(["fail", "skip", "retry"]))}
    if draw(st.integers(0, 2)) == 0:
        changes["time_out_s"] = float(draw(st.integers(1, 15)))
    if depth == 0 or draw(st.integers(0, 3)) == 0:
        if draw(st.booleans()):
            return wait(name, draw(st.integers(0, 6)), **changes)
        return go(name, next(robots), draw(st.integers(1, 6)), draw(st.sampled_from([0, 0, 5, 10, 99])), **changes)
    size = draw(st.integers(1, 3))
    subtasks = [draw(trees(f"{name}/{number}", depth - 1, robots)) for number in range(size)]
    return (serial if draw(st.booleans()) else parallel)(name, *subtasks, **changes)


@tiers(75, 300, trees())
def test_a_tree_ends_when_and_how_the_closed_form_says(root: Task):
    play = Play(root)
    end_s, fails = outcome(root, 0.0) if root.on_failure != "retry" else passed(root, 0.0)
    assert (play.end_s, play.tree.root.state) == (end_s, State.FAILED if fails else State.DONE)
    assert all(node.over for node in play.tree.root.walk())


# ---------------------------------------------------------------- the table


@pytest.mark.parametrize("state", State)
@pytest.mark.parametrize("happens", Input)
def test_every_state_takes_an_input_or_says_that_it_may_not_come(state: State, happens: Input):
    if (state, happens) in TABLE:
        _, then = next_state(TABLE, state, happens)
        assert (
            then
            is {
                Input.BEGIN: State.RUNNING,
                Input.FINISH: State.DONE,
                Input.FAIL: State.FAILED,
                Input.RENEW: State.WAITING,
                Input.TERMINATE: state if state in {State.DONE, State.FAILED} else State.TERMINATED,
            }[happens]
        )
    else:
        with pytest.raises(LocalProtocolError):
            next_state(TABLE, state, happens)


def test_what_has_ended_does_not_end_again():
    ended = {State.DONE, State.FAILED, State.TERMINATED}
    assert not {(state, happens) for state, happens in TABLE if state in ended} - set(
        itertools.product(ended, (Input.TERMINATE, Input.RENEW))
    )


# ---------------------------------------------------------------- the rules one by one


def test_serial_tasks_follow_each_other_and_parallel_ones_start_together():
    play = Play(serial("root", go("a", lasts_s=3), parallel("b", go("b1", 1, 5), go("b2", 2, 2)), go("c")))
    assert [play.at_s("began", name) for name in ("a", "b1", "b2", "c")] == [0.0, 3.0, 3.0, 8.0]
    assert play.end_s == 9.0


def test_one_robot_does_one_thing_after_the_other_even_in_parallel():
    play = Play(parallel("root", go("a", 0, 3), go("b", 0, 3), go("c", 1, 3)))
    assert [play.at_s("began", name) for name in "abc"] == [0.0, 3.0, 0.0]


def test_a_retry_has_a_name_of_its_own():
    play = Play(serial("root", go("a", lasts_s=2, fails_before_s=1, on_failure="retry")))
    assert (2 * S, "began", "a~2") in play.director.log
    assert play.tree.results["a"] is Result.DONE


def test_a_retry_of_the_parent_gives_its_subtasks_all_their_tries_again():
    inner = go("a", lasts_s=2, fails_before_s=5, on_failure="retry")  # fails at 2, 4, 6; is done at 8
    play = Play(serial("root", serial("b", inner, on_failure="retry")))
    assert (play.end_s, play.tree.root.state) == (8.0, State.DONE)


def test_a_failure_terminates_the_siblings_and_what_is_below_them():
    play = Play(parallel("root", go("a", 0, 2, 1), serial("b", go("b1", 1, 9), go("b2", 1, 9))))
    assert play.end_s == 2.0
    assert [play.tree.results[name].value for name in ("root", "a", "b", "b1", "b2")] == ["failed", "failed"] + 3 * [
        "terminated"
    ]


def test_a_task_ends_with_another_however_that_ends():
    for fails_before_s in (0, 1):
        guard = wait("guard", 99, ends_with="a")
        play = Play(parallel("root", go("a", 0, 2, fails_before_s, on_failure="skip"), guard))
        assert play.end_s == 2.0
        assert play.tree.results["guard"] is Result.TERMINATED
        assert play.tree.root.state is State.DONE


def test_a_task_whose_ender_has_ended_does_not_begin():
    play = Play(serial("root", go("a"), serial("b", wait("c", 9, ends_with="a")), go("d")))
    assert play.end_s == 2.0
    assert (S, "began", "c") not in play.director.log


def test_work_that_is_done_at_the_very_time_out_is_done():
    assert Play(serial("root", go("a", lasts_s=5), time_out_s=5)).tree.root.state is State.DONE
    assert Play(serial("root", wait("a", 5), time_out_s=5)).tree.root.state is State.DONE
    assert Play(serial("root", wait("a", 5.001), time_out_s=5)).tree.root.state is State.FAILED


def test_one_command_ends_a_whole_subtree_and_the_play_goes_on_behind_it():
    def command(tree: TaskTree, now: Time) -> None:
        node = tree.get("b")
        assert node is not None
        tree.terminate(node, now, "enough")

    play = Play(
        serial("root", parallel("b", go("b1", 1, 50), serial("b2", go("b3", 2, 50), go("b4"))), go("c")), (4, command)
    )
    assert play.end_s == 5.0
    assert play.tree.root.state is State.DONE
    assert {play.tree.results[name] for name in ("b", "b1", "b2", "b3", "b4")} == {Result.TERMINATED}


def test_an_empty_task_is_done_at_once():
    assert Play(Task(name="root")).end_s == 0.0


def test_a_task_that_is_done_once_more_still_ends_with_what_has_ended():
    again = serial("b", wait("c", 9, ends_with="a"), go("d", 0, 2, fails_before_s=2), on_failure="retry")
    play = Play(serial("root", go("a", 1, 1), again))
    assert play.end_s == 5.0  # d at 1 s, in vain, and at 3 s
    assert play.tree.results["c"] is Result.TERMINATED
