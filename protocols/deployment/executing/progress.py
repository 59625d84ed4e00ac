"""How far a plan has come: a function of the plan, when it was begun, and the facts so far.

Nothing here depends on when a fact was heard, only on when it became true. What a progress wants of the robots follows
from the leaves that run; to make orders of that is the executive's business.
"""

from collections.abc import Iterator, Sequence
from functools import partial
from typing import NamedTuple

from cosim.machine import Address
from cosim.units import Time
from protocols.deployment.executing.progress_casting import Casting
from protocols.deployment.executing.progress_deploying import Deploying
from protocols.deployment.executing.recovery import Length
from protocols.deployment.executing.timetable import Breach, Timetable
from protocols.deployment.executing.tree import Edge, Node, State, TaskTree, claims
from protocols.deployment.planning.parameters import ExecutiveParameters
from protocols.deployment.tasks.crew import Crew
from protocols.deployment.tasks.facts import Ended, Fact, Heard, Record, Switched, Terminated
from protocols.deployment.tasks.orders import Result
from protocols.deployment.tasks.plan import Deployment, Explore, Go, Photo, Place, Strategy, Task
from protocols.deployment.tasks.ways import Ways


class End(NamedTuple):
    """How a task has ended."""

    task: str
    state: State
    why: str
    at: Time
    robot: Address | None
    """Whose it was, if it was one robot's."""


class Progress:
    """A plan under way, in the time of its facts. It is the director of its task tree."""

    def __init__(
        self,
        record: Record,
        crew: Crew,
        ways: Ways,
        parameters: ExecutiveParameters,
        length: Length,
    ) -> None:
        plan, start = record.plan, record.start
        self._tries = parameters.tries
        self._deploying = partial(Deploying, crew, ways, parameters, length)
        self._windows = Timetable(plan, start)
        self._strategy: Strategy | None = None
        self.casting = Casting(record, crew, length, parameters.draft)
        """Who does what: to look at."""
        self._taken = 0
        self.deployments: dict[str, Deploying] = {}
        """Those that have begun, by name."""
        self.lost = self.casting.lost
        """Robots that are taken for lost."""
        self.heard: dict[tuple[str, Address], Ended] = {}
        """What robots have reported, by the task's name and theirs."""
        self.ends: list[End] = []
        """Tasks in the order in which they ended, until somebody clears it."""
        self.time = start
        """ns, of the last instant at which anything happened."""
        self.tree = TaskTree(plan.root, self)
        self._settle()
        self._wake = self._next()

    # ------------------------------------------------------------ time and facts

    def run(self, facts: Sequence[Fact], now: Time) -> None:
        """Go on to *now* with *facts*, all in their order; those that were taken before are known."""
        while (due := self._due(facts)) is not None and due <= now:
            self.time = max(due, self.time)
            while self._taken < len(facts) and facts[self._taken].at <= self.time:
                self._take(facts[self._taken])
                self._taken += 1
            self._settle()
            self._wake = self._next()

    def _due(self, facts: Sequence[Fact]) -> Time | None:
        fact = facts[self._taken].at if self._taken < len(facts) else None
        return self._wake if fact is None else fact if self._wake is None else min(fact, self._wake)

    def wake_at(self) -> Time | None:
        """Return when something happens by itself."""
        return self._wake

    def _next(self) -> Time | None:
        if self.tree.over:
            return None
        times = self.tree.wake_at(self.time), self._windows.wake_at(self.time)
        return min((at for at in times if at is not None), default=None)

    def breaches(self) -> list[Breach]:
        """Return all windows that have broken so far."""
        return self._windows.breaches()

    def _take(self, fact: Fact) -> None:
        match fact:
            case Ended():
                self.heard[fact.task, fact.robot] = fact
            case Heard(robot=robot, again=True):
                self._found(robot)
            case Heard(robot=robot, place_m=place_m):
                self._lose(robot, place_m)
            case Switched(strategy=strategy):
                self._strategy = strategy
                for deploying, node in self._under_way():
                    if deploying.switch(strategy):
                        self._deploy_again(deploying, node)
            case Terminated(task=task):
                if (wanted := self.tree.get(task)) is not None and not wanted.over:
                    self.tree.terminate(wanted, self.time, "as was ordered")

    def _settle(self) -> None:
        """Do all that follows at this instant."""
        while not self.tree.over:
            self._conclude()  # before anything runs out of time at this instant
            self.tree.advance(self.time)
            if self._conclude():
                continue
            known = len(self.breaches())
            self._windows.check(self.time)
            if len(self.breaches()) == known and not self._loosen():
                return

    def _conclude(self) -> bool:
        """End the leaves of which all is heard, those that are done before others; return whether there was one."""
        found = False
        for leaf, report in self._reported():
            if report.result is Result.DONE:
                self.tree.finish(leaf)
                found = True
        for leaf, report in self._reported():
            if leaf.over:  # one that failed before it in the list has ended it
                continue
            found = True
            if report.result is Result.FAILED:
                self.tree.fail(leaf, self.time, report.why or "its robot has failed")
            else:
                self.tree.terminate(leaf, self.time, report.why)
        return found

    def _reported(self) -> list[tuple[Node, Ended]]:
        """Return the leaves of which all is heard, each with the report that counts."""
        found = list[tuple[Node, Ended]]()
        for leaf in self.tree.running():
            robots = () if leaf.reached else self.robots(leaf) or ()
            reports = [self.heard[leaf.name, robot] for robot in robots if (leaf.name, robot) in self.heard]
            if reports and len(reports) == len(robots):
                found.append((leaf, min(reports, key=lambda report: report.surer)))
        return found

    def _loosen(self) -> bool:
        """Give up a window for which everything would wait for ever; return whether there was one."""
        if any(claims(leaf.task) and not leaf.reached for leaf in self.tree.running()):
            return False
        if self.tree.wake_at(self.time) is not None:
            return False
        return any(self._windows.loosen(node.task.name, edge, self.time) for node, edge in list(self.tree.held()))

    # ------------------------------------------------------------ what the tree asks

    @property
    def tries(self) -> int:
        """Return how often a drive of a deployment is begun before it is passed over."""
        return self._tries

    def opens(self, node: Node, edge: Edge, now: Time) -> Time | None:
        """Return when a task's windows let it start or end."""
        return self._windows.opens(node.task.name, edge, now)

    def robots(self, node: Node) -> frozenset[Address] | None:
        """Return who does a leaf; None: those who could are lost."""
        living = frozenset(self.casting.role(robot) for robot in claims(node.task)) - self.lost
        return living if living or not claims(node.task) else None

    def expand(self, node: Node, now: Time) -> Sequence[Task]:
        """Return the stages of a deployment that begins, or begins again."""
        assert isinstance(node.task.act, Deployment)
        deploying = self.deployments.get(node.task.name)
        if deploying is None:
            deploying = self.deployments[node.task.name] = self._deploying(node.task, self._strategy)
        return deploying.tasks(self.casting)

    def once_more(self, node: Node) -> Sequence[Task]:
        """Return what is still to be done for a deployment whose stages have ended."""
        deploying = self.deployments.get(node.task.name)
        return deploying.once_more(self.lost) if deploying else ()

    def verdict(self, node: Node) -> tuple[str, bool]:
        """Return why a deployment whose stages have ended has failed, if it has."""
        deploying = self.deployments.get(node.task.name)
        return deploying.verdict(self.lost) if deploying else ("", False)

    def began(self, node: Node, now: Time) -> None:
        """Note the start of a task."""
        self._windows.happened(node.task.name, "start", now)
        if isinstance(node.task.act, Go):
            for robot in self.robots(node) or ():
                for deploying in self.deployments.values():
                    deploying.left(robot)

    def ended(self, node: Node, now: Time) -> None:
        """Note the end of a task, and where it has left its robot."""
        self._windows.closed(node.task.name, now)
        robots = sorted(self.robots(node) or ()) if not node.children else ()
        self.ends.append(End(node.task.name, node.state, node.why, now, robots[0] if robots else None))
        if node.state is State.DONE and isinstance(node.task.act, Go) and robots:
            act = node.task.act
            self.casting.stands_m[robots[0]] = act.place_m
            for deploying in self.deployments.values():
                deploying.arrived(node.task.name, robots[0], act.place_m, act.final)

    # ------------------------------------------------------------ what is wanted

    def errands(self) -> dict[Address, tuple[str, Go | Photo | Explore]]:
        """Return what every robot is to be at, with the task's name."""
        errands = dict[Address, tuple[str, Go | Photo | Explore]]()
        for leaf in self.tree.running():
            act = leaf.task.act
            if leaf.reached or not isinstance(act, Go | Photo | Explore):
                continue
            robots = self.robots(leaf) or frozenset()
            for robot in sorted(robots):
                changed = {"robots": tuple(sorted(robots))} if isinstance(act, Explore) else {"robot": robot}
                errands[robot] = leaf.name, act.model_copy(update=changed)
        return errands

    # ------------------------------------------------------------ robots that come and go

    def misses(self, robot: Address) -> bool:
        """Return whether what *robot* was to do was left, as it was lost, and nobody has done it in its place."""
        if any(deploying.misses(robot) for deploying in self.deployments.values()):
            return True
        left = any(node.lost and robot in claims(node.task) for node in self.tree.root.walk())
        return left and self.casting.role(robot) == robot

    def _under_way(self) -> Iterator[tuple[Deploying, Node]]:
        """Yield the deployments that have begun and not ended, outer ones first."""
        for name, deploying in list(self.deployments.items()):
            node = self.tree.get(name)
            if node is not None and node.state is State.RUNNING:
                yield deploying, node

    def _deploy_again(self, deploying: Deploying, node: Node) -> None:
        self.tree.graft(node, deploying.tasks(self.casting), self.time)

    def _found(self, robot: Address) -> None:
        self.casting.find(robot)
        for deploying, node in self._under_way():
            if deploying.misses(robot) and not deploying.fixed:
                self._deploy_again(deploying, node)

    def _lose(self, robot: Address, place_m: Place | None) -> None:
        """Give the posts and roles of a robot that fell silent, at a place, to others."""
        if robot in self.lost:
            return
        self.casting.lose(robot, place_m)
        for deploying, node in self._under_way():
            if robot in deploying.posts:
                self._deploy_again(deploying, node)
        left = _leaves(self.tree.root)
        leaves = [leaf for leaf in left if robot in {self.casting.role(each) for each in claims(leaf.task)}]
        alone = [leaf for leaf in leaves if not isinstance(leaf.task.act, Explore)]
        if alone:
            self.casting.recast(robot, [leaf.task for leaf in alone])
        for leaf in leaves:
            if leaf.state is State.RUNNING and self.robots(leaf) is None:
                self.tree.fail(leaf, self.time, f"robot {robot} is lost", lost=True)
            elif leaf.state is State.RUNNING and leaf in alone:
                self.tree.renew(leaf, self.time)


def _leaves(root: Node) -> list[Node]:
    """Return the leaves that have not ended, those of deployments left out."""
    leaves = list[Node]()
    pending = [root]
    while pending:
        node = pending.pop()
        if node.over or isinstance(node.task.act, Deployment):
            continue
        pending += reversed(node.children)
        if not node.children:
            leaves.append(node)
    return leaves
