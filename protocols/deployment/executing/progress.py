"""How far a plan has come: a function of the plan, of its start, and of the facts so far.

Nothing here depends on when a fact was received, only on when it became true. What the robots are to do follows from
the leaves that run; the executive makes orders of it.
"""

import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from functools import partial
from typing import NamedTuple

from cosim.machine import Address
from cosim.units import Time
from protocols.deployment.executing.recovery import Length, reassigned, substitute
from protocols.deployment.executing.timetable import Breach, Timetable
from protocols.deployment.executing.tree import Node, State, TaskTree, claims
from protocols.deployment.planning.augmenting import ExecutiveParameters
from protocols.deployment.planning.methods import expanded
from protocols.deployment.planning.staging import NOWHERE, Stager
from protocols.deployment.tasks.crew import Crew, Ways
from protocols.deployment.tasks.facts import Ended, Fact, Heard, Record, Switched, Terminated
from protocols.deployment.tasks.orders import Result
from protocols.deployment.tasks.plan import (
    UNSTAGED,
    Deployment,
    Edge,
    Explore,
    Go,
    Place,
    RobotAct,
    Staging,
    Strategy,
    Task,
)

# ---------------------------------------------------------------- roster
# Which robot plays which part of a plan under way, which robots are lost, and where they stand.


class Roster:
    """The robots of a crew and their parts in a plan under way: who is lost, who is spare, who stands in for whom."""

    def __init__(self, record: Record, crew: Crew, length: Length, draft: bool) -> None:
        self._crew, self._length = crew, length
        self._reserve = set(crew.robots) - set(record.plan.robots) if draft else set[Address]()
        """Spare robots: those that the plan makes no use of, and that have not taken over a part yet."""
        self._roles: dict[Address, Address] = {}
        """Robot that has taken over from a lost one, outside deployments."""
        self.lost: set[Address] = set()
        self._bodies_m: dict[Address, Place] = {}
        """Last known places of lost robots."""
        self.stands_m: dict[Address, Place] = dict.fromkeys(crew.robots, crew.base_m) | record.starts_m
        """Place at which each robot has arrived last by an order."""

    def role(self, robot: Address) -> Address:
        """Return the robot that plays the part of *robot* now."""
        while robot in self._roles:  # a substitute can be lost in turn
            robot = self._roles[robot]
        return robot

    def lose(self, robot: Address, place_m: Place | None) -> None:
        """Note that a robot is lost, and where its body stands, if that is known."""
        self.lost.add(robot)
        if place_m is not None:  # the body may cover a place that another robot is to take
            self._bodies_m[robot] = place_m

    def find(self, robot: Address) -> None:
        """Note that a robot is no longer lost."""
        self.lost.discard(robot)
        self._bodies_m.pop(robot, None)

    def covered(self, robot: Address, place_m: Place) -> bool:
        """Return whether a lost robot's body covers a place for *robot*."""
        radius_m = self._crew.radius_m(robot)
        return any(
            math.dist(place_m, body_m) < radius_m + self._crew.radius_m(other)
            for other, body_m in self._bodies_m.items()
        )

    def draft(self, place_m: Place) -> Address | None:
        """Take the spare robot that has the shortest way to a place, and return it; None if there is none."""
        return self._take([Task(name="draft", act=Go(robot=0, place_m=place_m))])

    def replace(self, robot: Address, leaves: Iterable[Task]) -> bool:
        """Give the part of *robot*, whose *leaves* are left, to a spare robot; return whether there was one."""
        spare = self._take(leaves)
        if spare is not None:
            self._roles[robot] = spare
        return spare is not None

    def _take(self, leaves: Iterable[Task]) -> Address | None:
        spare = substitute(leaves, self._reserve - self.lost, self.stands_m, self._crew, self._length)
        self._reserve.discard(-1 if spare is None else spare)
        return spare


# ---------------------------------------------------------------- one deployment
# One deployment under way: where each robot is to end up, and which place it has reached.


class Deploying:
    """The state of a :class:`Deployment` from its start to its end.

    Its stages are made again, under another number, whenever its robots or its strategy change.
    """

    def __init__(
        self,
        crew: Crew,
        ways: Ways,
        parameters: ExecutiveParameters,
        length: Length,
        task: Task,
        strategy: Strategy | None,
    ) -> None:
        assert isinstance(task.act, Deployment)
        self._crew, self._ways, self._parameters, self._length = crew, ways, parameters, length
        self._task, self.act = task, task.act
        self.strategy: Staging = task.act.strategy
        if strategy is not None:
            self.switch(strategy)
        self._team = list(task.act.robots)
        """Robots of the deployment and those that were drafted, living or lost."""
        self.posts = {robot: number for number, robot in enumerate(task.act.robots)}
        """Number of the place at which each living robot is to end up."""
        self.reached = dict.fromkeys(task.act.robots, NOWHERE)
        """Number of the place that each robot has come to last."""
        self.stands_m: dict[Address, Place] = {}
        """Places of the robots that have arrived and were not sent on since."""
        self._number = self._rounds = 0
        self._goals: dict[str, int] = {}
        """Number of the place that a task leads to."""

    @property
    def leaping(self) -> bool:
        """True if deployed robots make room for others."""
        return self.strategy == "leap_frog" and self.act.augmented

    @property
    def cast(self) -> tuple[Address, ...]:
        """Robots in the order of the places as planned; drafted ones stand in for lost ones."""
        spares = iter([robot for robot in self.posts if robot not in self.act.robots])
        return tuple(robot if robot in self.posts else next(spares, robot) for robot in self.act.robots)

    def switch(self, strategy: Strategy) -> bool:
        """Go on by another strategy, if this deployment has stages; return whether it has."""
        staged = self.act.strategy not in UNSTAGED
        if staged:
            self.strategy = strategy
        return staged

    @property
    def fixed(self) -> bool:
        """True if no robot takes the place of a lost one."""
        return self.act.strategy == "fixed"

    def post_m(self, robot: Address) -> Place:
        """Return the place at which a living robot is to end up."""
        return self.act.places_m[self.posts[robot]]

    def posted(self, robot: Address) -> bool:
        """Return whether a robot has come to its place, and was not sent on since."""
        return robot in self.posts and not self._off(robot)

    def ahead_m(self, robot: Address) -> list[Place]:
        """Return the places that a robot in leap-frog has still to pass, and its post."""
        return list(self.act.places_m[self.reached[robot] + 1 : self.posts[robot] + 1])

    # ------------------------------------------------------------ stages

    def tasks(self, roster: Roster) -> Sequence[Task]:
        """Return the stages that are left for the robots that are left."""
        self._man(roster)
        stager = self._stager
        self._number += 1
        as_planned = self.posts == {robot: number for number, robot in enumerate(self.act.robots)}
        # the first time the stages are those of the plan, with their names and constraints
        if self._number == 1 and self.strategy == self.act.strategy and as_planned:
            planned = expanded(self._task).subtasks
            self._note(planned)
            return [_augmented(each, stager) for each in planned]
        tasks = stager.tasks(f"{self._task.name}~{self._number}", self.posts, self._passed())
        self._note(tasks, exact=False)
        return tasks

    def once_more(self, lost: Collection[Address]) -> list[Task]:
        """Return another stage for the robots that are not at their places though all stages have ended.

        The first time they drive to their own places, then to other empty ones, if there are any.
        """
        away = [robot for robot in self.posts if self._off(robot) and robot not in lost]
        if not away or self._rounds == self._parameters.rounds:
            return []
        # the first time their way to their own places may only have been blocked by robots under way
        if self._rounds:
            empty = sorted(set(range(len(self.act.places_m))) - set(self.posts.values()))
            self.posts |= dict(zip(away, empty, strict=False))
        self._rounds, self._number = self._rounds + 1, self._number + 1
        task = self._stager.directly(f"{self._task.name}~{self._number}", self.posts, away)
        self._note([task], exact=False)
        return [task]

    @property
    def _stager(self) -> Stager:
        return Stager(self.act.places_m, self.strategy, self.act.augmented, self._crew, self._ways, self._parameters)

    def _man(self, roster: Roster) -> None:
        """Give the places to the robots that are left, and to spare robots while there are any."""
        if self.fixed:
            self._settle(roster)
            return
        size = len(self.act.places_m)
        living = [robot for robot in self._team if robot not in roster.lost]
        while len(living) < size and (spare := roster.draft(self.act.places_m[0])) is not None:
            self._team.append(spare)
            self.reached[spare] = NOWHERE
            living.append(spare)
        living = living[:size]
        # robots keep their posts as long as they are the same; only direct drives are assigned by cost from the start
        if set(living) != set(self.posts) or (self.strategy == "direct" and self._number == 0):
            living.sort(key=lambda robot: self.posts.get(robot, size))
            self.posts = reassigned(
                self.strategy, living, self.reached, roster.stands_m, self.act.places_m, self._length, roster.covered
            )

    def _settle(self, roster: Roster) -> None:
        """Leave each robot its own place; if a lost robot's body covers that, give it an open one."""
        self.posts = {robot: post for robot, post in self.posts.items() if robot not in roster.lost}
        for robot, post in self.posts.items():
            if roster.covered(robot, self.act.places_m[post]):
                free = set(range(len(self.act.places_m))) - set(self.posts.values())
                open_ = [post for post in sorted(free) if not roster.covered(robot, self.act.places_m[post])]
                self.posts[robot] = open_[0] if open_ else post

    def _passed(self) -> dict[Address, int]:
        """Return the places that robots have reached."""
        # a robot that was near its post, but is not at it, counts as having reached the place before
        return {
            robot: min(self.reached[robot], post - 1)
            if self._off(robot) and self.reached[robot] == post
            else self.reached[robot]
            for robot, post in self.posts.items()
        }

    def _off(self, robot: Address) -> bool:
        return self.stands_m.get(robot) != self.post_m(robot)

    def _note(self, tasks: Sequence[Task], exact: bool = True) -> None:
        """Note where drives lead to; *exact*: their places are those of the deployment."""
        for task in (inner for each in tasks for inner in each.walk()):
            if not isinstance(task.act, Go):
                continue
            if not exact:  # augmented places differ, but the names of our stages end in the place's number
                self._goals[task.name] = int(task.name.rpartition("-")[2]) - 1
            elif task.act.place_m in self.act.places_m:
                self._goals[task.name] = self.act.places_m.index(task.act.place_m)

    # ------------------------------------------------------------ what happens

    def left(self, robot: Address) -> None:
        """Note that a robot has been sent somewhere."""
        self.stands_m.pop(robot, None)

    def arrived(self, name: str, robot: Address, place_m: Place, final: bool) -> None:
        """Note that a robot has done a drive, to a place of this deployment or of one within it."""
        if robot not in self.reached:
            return
        if final:  # otherwise it only passes, and has come as near as the robots let it that stand there
            self.stands_m[robot] = place_m
        if name in self._goals:
            self.reached[robot] = self._goals[name]
        elif place_m in self.act.places_m:
            self.reached[robot] = self.act.places_m.index(place_m)

    def misses(self, robot: Address) -> bool:
        """Return whether a robot that was heard again could fill an empty place."""
        return robot in self._team and robot not in self.posts and len(self.posts) < len(self.act.places_m)

    def verdict(self, lost: Collection[Address]) -> tuple[str, bool]:
        """Return why the deployment has failed at its end (empty: it has not), and whether for want of robots."""
        if not self.posts or set(self.posts) <= set(lost):
            return "nobody is left to do it", True
        away = [robot for robot in self.posts if self._off(robot)]
        return (f"robot {away[0]} has not come to its place" if away else ""), False


def _augmented(task: Task, stager: Stager) -> Task:
    """Return a task of the plan with the drives of its stages augmented."""
    acts = [each.act for each in task.subtasks]
    goes = [act for act in acts if isinstance(act, Go)]
    if goes and len(goes) == len(acts):
        staged = zip(task.subtasks, stager.staged(goes), strict=True)
        subtasks = tuple(each.model_copy(update={"act": go}) for each, go in staged)
    else:
        subtasks = tuple(_augmented(each, stager) for each in task.subtasks)
    return task.model_copy(update={"subtasks": subtasks})


class End(NamedTuple):
    """How a task has ended."""

    task: str
    state: State
    why: str
    at: Time
    robot: Address | None
    """Robot that did it, if it was one robot's."""


class Progress:
    """A plan under way, in the time of its facts; the director of its task tree."""

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
        self.roster = Roster(record, crew, length, parameters.draft)
        """Which robot plays which part; not to be changed."""
        self._taken = 0
        self.deployments: dict[str, Deploying] = {}
        """Deployments that have begun, by name."""
        self.lost = self.roster.lost
        """Robots that are taken for lost."""
        self.heard: dict[tuple[str, Address], Ended] = {}
        """Reports, by the task's name and the robot."""
        self.ends: list[End] = []
        """Tasks in the order in which they ended; to be cleared by the executive."""
        self.time = start
        """Last instant at which anything happened, ns."""
        self.tree = TaskTree(plan.root, self)
        self._settle()
        self._wake = self._next()

    # ------------------------------------------------------------ time and facts

    def run(self, facts: Sequence[Fact], now: Time) -> None:
        """Run to *now* with all *facts* in their order; skip those that were taken before."""
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
        """Return when something happens without a fact; None if never."""
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
        """Do everything that follows at this instant."""
        # one end can start, end or break other tasks at the same instant
        while not self.tree.over:
            self._conclude()  # a report of this instant counts, even if time runs out now
            self.tree.advance(self.time)
            if self._conclude():
                continue
            known = len(self.breaches())
            self._windows.check(self.time)
            if len(self.breaches()) == known and not self._loosen():
                return

    def _conclude(self) -> bool:
        """End the leaves that all their robots have reported, done ones first; return whether there was one."""
        found = False
        for leaf, report in self._reported():
            if report.result is Result.DONE:
                self.tree.finish(leaf)
                found = True
        for leaf, report in self._reported():
            if leaf.over:  # a failure before it in the list has ended it
                continue
            found = True
            if report.result is Result.FAILED:
                self.tree.fail(leaf, self.time, report.why or "its robot has failed")
            else:
                self.tree.terminate(leaf, self.time, report.why)
        return found

    def _reported(self) -> list[tuple[Node, Ended]]:
        """Return the leaves that all their robots have reported, each with the report that counts."""
        found = list[tuple[Node, Ended]]()
        for leaf in self.tree.running():
            robots = () if leaf.reached else self.robots(leaf) or ()
            reports = [self.heard[leaf.name, robot] for robot in robots if (leaf.name, robot) in self.heard]
            if reports and len(reports) == len(robots):
                found.append((leaf, min(reports, key=lambda report: report.surer)))
        return found

    def _loosen(self) -> bool:
        """Give up a window for which everything would wait for ever; return whether there was one."""
        # a robot at work, or a wait, still makes something happen
        if any(claims(leaf.task) and not leaf.reached for leaf in self.tree.running()):
            return False
        if self.tree.wake_at(self.time) is not None:
            return False
        return any(self._windows.loosen(node.task.name, edge, self.time) for node, edge in list(self.tree.held()))

    # ------------------------------------------------------------ what the tree asks

    @property
    def tries(self) -> int:
        """Number of times that a drive of a deployment is begun before it is passed over."""
        return self._tries

    def opens(self, node: Node, edge: Edge, now: Time) -> Time | None:
        """Return when a task's windows let it start or end; None if not known yet."""
        return self._windows.opens(node.task.name, edge, now)

    def robots(self, node: Node) -> frozenset[Address] | None:
        """Return the robots that do a leaf; None if all that could are lost."""
        living = frozenset(self.roster.role(robot) for robot in claims(node.task)) - self.lost
        return living if living or not claims(node.task) else None

    def expand(self, node: Node, now: Time) -> Sequence[Task]:
        """Return the stages of a deployment that begins, or begins again."""
        assert isinstance(node.task.act, Deployment)
        deploying = self.deployments.get(node.task.name)
        if deploying is None:
            deploying = self.deployments[node.task.name] = self._deploying(node.task, self._strategy)
        return deploying.tasks(self.roster)

    def once_more(self, node: Node) -> Sequence[Task]:
        """Return the tasks that are still to be done for a deployment whose stages have ended."""
        deploying = self.deployments.get(node.task.name)
        return deploying.once_more(self.lost) if deploying else ()

    def verdict(self, node: Node) -> tuple[str, bool]:
        """Return why a deployment has failed at its end (empty: it has not), and whether for want of robots."""
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
        """Note the end of a task, and the place of its robot."""
        self._windows.closed(node.task.name, now)
        robots = sorted(self.robots(node) or ()) if not node.children else ()
        self.ends.append(End(node.task.name, node.state, node.why, now, robots[0] if robots else None))
        if node.state is State.DONE and isinstance(node.task.act, Go) and robots:
            act = node.task.act
            self.roster.stands_m[robots[0]] = act.place_m
            for deploying in self.deployments.values():
                deploying.arrived(node.task.name, robots[0], act.place_m, act.final)

    # ------------------------------------------------------------ what robots are to do

    def errands(self) -> dict[Address, tuple[str, RobotAct]]:
        """Return the task's name and the act of each robot that is to do something."""
        errands = dict[Address, tuple[str, RobotAct]]()
        for leaf in self.tree.running():
            act = leaf.task.act
            # a leaf that only waits for its window has nothing left to do
            if leaf.reached or not isinstance(act, RobotAct):
                continue
            robots = self.robots(leaf) or frozenset()
            for robot in sorted(robots):
                # substitutes stand in for lost robots, also in the act
                changed = {"robots": tuple(sorted(robots))} if isinstance(act, Explore) else {"robot": robot}
                errands[robot] = leaf.name, act.model_copy(update=changed)
        return errands

    # ------------------------------------------------------------ robots that come and go

    def misses(self, robot: Address) -> bool:
        """Return whether a part of *robot* was left undone when it was lost, and no other robot has taken it over."""
        if any(deploying.misses(robot) for deploying in self.deployments.values()):
            return True
        left = any(node.lost and robot in claims(node.task) for node in self.tree.root.walk())
        return left and self.roster.role(robot) == robot

    def _under_way(self) -> Iterator[tuple[Deploying, Node]]:
        """Yield the deployments that have begun and not ended, outer ones first."""
        for name, deploying in list(self.deployments.items()):
            node = self.tree.get(name)
            if node is not None and node.state is State.RUNNING:
                yield deploying, node

    def _deploy_again(self, deploying: Deploying, node: Node) -> None:
        self.tree.graft(node, deploying.tasks(self.roster), self.time)

    def _found(self, robot: Address) -> None:
        self.roster.find(robot)
        for deploying, node in self._under_way():
            if deploying.misses(robot) and not deploying.fixed:
                self._deploy_again(deploying, node)

    def _lose(self, robot: Address, place_m: Place | None) -> None:
        """Give the posts and roles of a robot that fell silent to others; *place_m*: where it was last."""
        if robot in self.lost:
            return
        self.roster.lose(robot, place_m)
        for deploying, node in self._under_way():
            if robot in deploying.posts:
                self._deploy_again(deploying, node)
        left = _leaves(self.tree.root)
        leaves = [leaf for leaf in left if robot in {self.roster.role(each) for each in claims(leaf.task)}]
        # the other explorers go on without it
        alone = [leaf for leaf in leaves if not isinstance(leaf.task.act, Explore)]
        if alone:
            self.roster.replace(robot, [leaf.task for leaf in alone])
        for leaf in leaves:
            if leaf.state is State.RUNNING and self.robots(leaf) is None:
                self.tree.fail(leaf, self.time, f"robot {robot} is lost", lost=True)
            elif leaf.state is State.RUNNING and leaf in alone:
                self.tree.renew(leaf, self.time)


def _leaves(root: Node) -> list[Node]:
    """Return the leaves that have not ended, without those of deployments."""
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
