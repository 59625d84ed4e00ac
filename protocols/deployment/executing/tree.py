"""Running task trees: serial and parallel tasks, time-outs, exception handlers, and subtrees that end by one command.

After the Task Description Language (Simmons and Apfelbaum 1998; paper 004, section 5). A task waits, runs, and ends as
done, failed or terminated; ``TABLE`` holds all its transitions. A tree is advanced from instant to instant, and depends
only on its inputs and their times, so it can be run again with inputs that have become known later.

* A task starts when its parent runs, its elder sibling (in a serial parent) has ended, its windows are open, and its
  robots have nothing else to do. A parent ends with its last subtask.
* Its ``on_failure`` says what the failure of a task means to its parent: ``skip``, nothing; ``retry``, nothing the
  first time: the task is done again, as ``NAME~2``; ``fail``, the parent fails and terminates its other subtasks.
* A task that was terminated counts as done. One that failed for want of robots (*lost*) is passed over, unless all
  subtasks of its parent have: then the parent has failed for want of robots too.
"""

from collections.abc import Callable, Iterator, Sequence
from enum import StrEnum
from typing import Final, Protocol

from cosim.machine import Address, next_state
from cosim.units import Time, from_seconds
from protocols.deployment.tasks.orders import Result
from protocols.deployment.tasks.plan import Deployment, Edge, Task, Wait, actors


class State(StrEnum):
    """State of a task."""

    WAITING = "waiting"
    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"
    TERMINATED = "terminated"


class Input(StrEnum):
    """Input of a task."""

    BEGIN = "begin"
    FINISH = "finish"
    FAIL = "fail"
    TERMINATE = "terminate"
    RENEW = "renew"


ENDED: Final = frozenset({State.DONE, State.FAILED, State.TERMINATED})

TABLE: Final = {
    (State.WAITING, Input.BEGIN): ("begin", State.RUNNING),
    (State.WAITING, Input.FAIL): ("drop", State.FAILED),
    (State.WAITING, Input.TERMINATE): ("drop", State.TERMINATED),
    (State.WAITING, Input.RENEW): ("renew", State.WAITING),
    (State.RUNNING, Input.FINISH): ("close", State.DONE),
    (State.RUNNING, Input.FAIL): ("close", State.FAILED),
    (State.RUNNING, Input.TERMINATE): ("close", State.TERMINATED),
    (State.RUNNING, Input.RENEW): ("renew", State.WAITING),
    (State.DONE, Input.TERMINATE): ("ignore", State.DONE),
    (State.DONE, Input.RENEW): ("renew", State.WAITING),
    (State.FAILED, Input.TERMINATE): ("ignore", State.FAILED),
    (State.FAILED, Input.RENEW): ("renew", State.WAITING),
    (State.TERMINATED, Input.TERMINATE): ("ignore", State.TERMINATED),
    (State.TERMINATED, Input.RENEW): ("renew", State.WAITING),
}
"""(state, input) -> (action, next state); any other pair is our own misuse."""


class Node:
    """A task of the tree, and its state."""

    __slots__ = (
        "attempt",
        "began",
        "children",
        "ended",
        "lost",
        "parent",
        "reached",
        "state",
        "task",
        "tried",
        "tries",
        "why",
    )

    def __init__(self, task: Task, parent: "Node | None", tries: int) -> None:
        self.task = task
        self.parent = parent
        self.children: list[Node] = []
        self.state = State.WAITING
        self.tries = tries
        """Number of times that it may be begun; 0: as its ``on_failure`` says."""
        self.attempt = 1
        """Number of times that it has been begun in all, the present one included."""
        self.tried = 1
        """Number of times since its parent began."""
        self.began: Time | None = None
        self.ended: Time | None = None
        self.reached = False
        """True if its work is done; its end may wait for a window."""
        self.lost = False
        """True if it has failed for want of robots."""
        self.why = ""

    @property
    def name(self) -> str:
        """Name in orders and reports: ``NAME``, and ``NAME~2`` when it is done again."""
        return self.task.name if self.attempt == 1 else f"{self.task.name}~{self.attempt}"

    @property
    def over(self) -> bool:
        """True if it has ended."""
        return self.state in ENDED

    @property
    def passed(self) -> bool:
        """True if it has ended and lets the next one start."""
        return self.over and not self.again

    @property
    def again(self) -> bool:
        """True if it has failed and is to be done again."""
        most = self.tries or (2 if self.task.on_failure == "retry" else 1)
        return self.state is State.FAILED and not self.lost and self.tried < most

    @property
    def spoils(self) -> bool:
        """True if its failure is its parent's."""
        return self.state is State.FAILED and not (self.lost or self.tries or self.task.on_failure == "skip")

    def walk(self) -> Iterator["Node"]:
        """Yield this node and all below it, parents first."""
        yield self
        for child in self.children:
            yield from child.walk()


class Director(Protocol):
    """The questions that a tree asks about its tasks, and the changes that it reports."""

    @property
    def tries(self) -> int:
        """Number of times that a leaf of a deployment is begun before it is passed over."""

    def opens(self, node: Node, edge: Edge, now: Time) -> Time | None:
        """Return when *node* may start or end; None if not known yet."""

    def robots(self, node: Node) -> frozenset[Address] | None:
        """Return the robots that a leaf needs; None if no robot can do it any more."""

    def expand(self, node: Node, now: Time) -> Sequence[Task]:
        """Return the subtasks of a deployment that begins."""

    def once_more(self, node: Node) -> Sequence[Task]:
        """Return the subtasks that a task which has reached its end still needs; if none, it ends."""

    def verdict(self, node: Node) -> tuple[str, bool]:
        """Return why a task has failed at its end (empty: it has not), and whether for want of robots."""

    def began(self, node: Node, now: Time) -> None:
        """Note that a task begins."""

    def ended(self, node: Node, now: Time) -> None:
        """Note that a task has ended, and is not done again; one that was dropped has never begun."""


class TaskTree:
    """All tasks of a plan, from its start on; times are those of the inputs, and never decrease."""

    def __init__(self, root: Task, director: Director) -> None:
        self._director = director
        self._nodes: dict[str, Node] = {}
        self._act: dict[str, Callable[[Node, Time], None]] = {
            "begin": self._begin,
            "close": self._close,
            "drop": self._close,
            "renew": self._renew,
            "ignore": lambda node, now: None,
        }
        self.results: dict[str, Result] = {}
        """Results of tasks that have ended, those that have left the tree included."""
        self.root = self._grow(root, None, 0)

    def _grow(self, task: Task, parent: Node | None, tries: int) -> Node:
        node = self._nodes[task.name] = Node(task, parent, tries if task.leaf else 0)
        node.children = [self._grow(each, node, tries) for each in task.subtasks]
        return node

    # ------------------------------------------------------------ what there is

    @property
    def over(self) -> bool:
        """True if the whole tree has ended."""
        return self.root.over

    def get(self, name: str) -> Node | None:
        """Return the node of a task by its name; None without one."""
        return self._nodes.get(name)

    def running(self) -> list[Node]:
        """Return the leaves that run, in the tree's order."""
        return [node for node in self.root.walk() if node.state is State.RUNNING and not node.children]

    def held(self) -> Iterator[tuple[Node, Edge]]:
        """Yield the tasks that only wait for their windows to start, or to end."""
        for node in self.root.walk():
            if node.state is State.WAITING and self._ready(node):
                yield node, "start"
            elif node.state is State.RUNNING and self._reached(node):
                yield node, "end"

    def states(self) -> dict[str, str]:
        """Return the state of every task by its name."""
        return {node.task.name: node.state.value for node in self.root.walk()}

    def wake_at(self, now: Time) -> Time | None:
        """Return when something happens without an input: a wait or a time-out ends, or a window opens."""
        return min((at for node in self.root.walk() if (at := self._due(node, now)) is not None), default=None)

    def _due(self, node: Node, now: Time) -> Time | None:
        if node.state is State.WAITING:
            opens = self._director.opens(node, "start", now) if self._ready(node) else None
            return opens if opens is not None and opens > now else None
        if node.state is not State.RUNNING:
            return None
        opens = self._director.opens(node, "end", now) if self._reached(node) else None
        closing = opens if opens is not None and opens > now else None
        times = [at for at in (self._deadline(node), self._waits_until(node), closing) if at is not None and at > now]
        return min(times, default=None)

    @staticmethod
    def _deadline(node: Node) -> Time | None:
        if node.task.time_out_s is None or node.began is None:
            return None
        return node.began + from_seconds(node.task.time_out_s)

    @staticmethod
    def _waits_until(node: Node) -> Time | None:
        if not isinstance(node.task.act, Wait) or node.began is None or node.reached:
            return None
        return node.began + from_seconds(node.task.act.seconds)

    # ------------------------------------------------------------ what happens

    def advance(self, now: Time) -> None:
        """Do everything that is due at *now*, until nothing more is."""
        while self._step(self.root, now):
            pass

    def finish(self, node: Node) -> None:
        """Note that a leaf's work is done: it ends when the tree is advanced and its window is open."""
        node.reached = True

    def fail(self, node: Node, now: Time, why: str, lost: bool = False) -> None:
        """End a task as failed, with what that means to its parent."""
        node.lost, node.why = lost, why
        self._apply(node, Input.FAIL, now)

    def terminate(self, node: Node, now: Time, why: str) -> None:
        """End a task and all below it by a command."""
        if not node.over:
            node.why = why
        self._apply(node, Input.TERMINATE, now)

    def renew(self, node: Node, now: Time) -> None:
        """Begin a leaf again, under another name: another robot is to do it."""
        self._apply(node, Input.RENEW, now)

    def graft(self, node: Node, subtasks: Sequence[Task], now: Time) -> None:
        """Replace the subtasks of *node* by *subtasks*, and terminate those that were under way."""
        kept = {each.name for task in subtasks for each in task.walk()}
        for child in node.children:
            for each in child.walk():
                self._nodes.pop(each.task.name, None)
                # a task that stays, under its name, has not ended
                if not each.over and each.task.name not in kept:
                    self._apply(each, Input.TERMINATE, now)
        node.children = [self._grow(each, node, self._director.tries) for each in subtasks]

    # ------------------------------------------------------------ the rules

    def _step(self, node: Node, now: Time) -> bool:
        """Do the first thing that is due in a subtree; return whether there was one."""
        if node.over:
            return False
        if node.state is State.WAITING:
            return self._ready(node) and self._start(node, now)
        if any(self._step(child, now) for child in node.children):
            return True
        deadline, waits = self._deadline(node), self._waits_until(node)
        if waits is not None and waits <= now:
            node.reached = True
        # before the time-out: a task that is done at its deadline is done
        if self._reached(node) and self._open(node, "end", now):
            self._conclude(node, now)
            return True
        if deadline is not None and deadline <= now:
            self.fail(node, now, f"not ended {node.task.time_out_s:g} s after its start")
            return True
        return False

    def _open(self, node: Node, edge: Edge, now: Time) -> bool:
        opens = self._director.opens(node, edge, now)
        return opens is not None and opens <= now

    def _reached(self, node: Node) -> bool:
        if node.children:
            return all(child.passed for child in node.children)
        return node.reached or node.task.act is None or isinstance(node.task.act, Deployment)

    def _ready(self, node: Node) -> bool:
        """Return whether a task may start, its windows aside."""
        parent = node.parent
        if parent is None:
            return True
        if parent.state is not State.RUNNING:
            return False
        if parent.task.order == "serial":
            elder = next((each for each in parent.children if not each.passed), node)
            if elder is not node:
                return False
        return self._free(node)

    def _free(self, node: Node) -> bool:
        """Return whether all robots of a leaf have nothing else to do."""
        needed = frozenset() if node.children else self._director.robots(node)
        if not needed:
            return True
        busy = (other for other in self.running() if not other.reached)
        return not any(needed & (self._director.robots(other) or frozenset()) for other in busy)

    def _start(self, node: Node, now: Time) -> bool:
        ender = self._nodes.get(node.task.ends_with or "")
        if ender is not None and ender.passed:
            self.terminate(node, now, f"{ender.task.name} has ended")
        elif not self._open(node, "start", now):
            return False
        elif not node.children and self._director.robots(node) is None:
            self.fail(node, now, "nobody is left to do it", lost=True)
        else:
            self._apply(node, Input.BEGIN, now)
        return True

    def _conclude(self, node: Node, now: Time) -> None:
        """End a task that has reached its end, unless it needs more subtasks."""
        more = self._director.once_more(node)
        if more:
            self.graft(node, more, now)
            return
        why, lost = self._director.verdict(node)
        if node.children and all(child.lost for child in node.children):
            why, lost = "nobody is left to do it", True
        if why:
            self.fail(node, now, why, lost)
        else:
            self._apply(node, Input.FINISH, now)

    def _apply(self, node: Node, happens: Input, now: Time) -> None:
        action, node.state = next_state(TABLE, node.state, happens)
        self._act[action](node, now)

    def _begin(self, node: Node, now: Time) -> None:
        node.began = now
        self._director.began(node, now)
        if isinstance(node.task.act, Deployment):
            self.graft(node, self._director.expand(node, now), now)

    def _renew(self, node: Node, now: Time) -> None:
        node.attempt, node.tried = node.attempt + 1, 1
        node.began, node.ended, node.reached, node.lost, node.why = None, None, False, False, ""
        for child in node.children:
            self._apply(child, Input.RENEW, now)

    def _close(self, node: Node, now: Time) -> None:
        node.ended = now
        for child in node.children:
            if not child.over:
                self.terminate(child, now, f"{node.task.name} has ended")
        if node.again:
            # a renewal for another robot starts the count again, this one does not
            tried = node.tried
            self._apply(node, Input.RENEW, now)
            node.tried = tried + 1
            return
        self.results[node.task.name] = Result(node.state.value)
        self._director.ended(node, now)
        for other in [other for other in self._nodes.values() if other.task.ends_with == node.task.name]:
            self.terminate(other, now, f"{node.task.name} has ended")
        if node.spoils and node.parent is not None and node.parent.state is State.RUNNING:
            self.fail(node.parent, now, f"{node.task.name}: {node.why}")


def claims(task: Task) -> frozenset[Address]:
    """Return the robots that a leaf keeps busy; none for a deployment, whose stages do that."""
    return frozenset() if isinstance(task.act, Deployment) else frozenset(actors(task.act))
