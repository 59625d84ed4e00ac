"""One deployment under way: who is to end up where, and which place everybody has reached."""

from collections.abc import Collection, Sequence

from cosim.machine import Address
from protocols.deployment.executing.progress_casting import Casting
from protocols.deployment.executing.recovery import Length, reassigned
from protocols.deployment.planning.methods import expanded
from protocols.deployment.planning.parameters import ExecutiveParameters
from protocols.deployment.planning.staging import NOWHERE, Stager
from protocols.deployment.tasks.crew import Crew
from protocols.deployment.tasks.plan import UNSTAGED, Deployment, Go, Place, Staging, Strategy, Task
from protocols.deployment.tasks.ways import Ways


class Deploying:
    """What the executive keeps of a :class:`Deployment` from its start to its end.

    Its stages are made anew, under another number, as often as its robots or its strategy change.
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
        """Its robots and those that were drafted, living or lost."""
        self.posts = {robot: number for number, robot in enumerate(task.act.robots)}
        """The number of the place at which each of its living robots is to end up."""
        self.reached = dict.fromkeys(task.act.robots, NOWHERE)
        """The number of the place that each robot has come to last."""
        self.stands_m: dict[Address, Place] = {}
        """Where those stand that have arrived, and were not sent on since."""
        self._number = self._rounds = 0
        self._goals: dict[str, int] = {}
        """The number of the place that a task leads to."""

    @property
    def leaping(self) -> bool:
        """Whether robots that are deployed make room for others."""
        return self.strategy == "leap_frog" and self.act.augmented

    @property
    def cast(self) -> tuple[Address, ...]:
        """Whose each of the places was in the beginning; spare ones that were drafted stand in for the lost."""
        spares = iter([robot for robot in self.posts if robot not in self.act.robots])
        return tuple(robot if robot in self.posts else next(spares, robot) for robot in self.act.robots)

    def switch(self, strategy: Strategy) -> bool:
        """Go on by another strategy, if this is by one; return whether that is so."""
        staged = self.act.strategy not in UNSTAGED
        if staged:
            self.strategy = strategy
        return staged

    @property
    def fixed(self) -> bool:
        """Whether nobody takes the place of one who is lost."""
        return self.act.strategy == "fixed"

    def post_m(self, robot: Address) -> Place:
        """Return where a living robot of it is to end up."""
        return self.act.places_m[self.posts[robot]]

    def posted(self, robot: Address) -> bool:
        """Return whether a robot has come to where it is to end up, and was not sent on since."""
        return robot in self.posts and not self._off(robot)

    def ahead_m(self, robot: Address) -> list[Place]:
        """Return the places that a robot in leap-frog has still to pass, and its post."""
        return list(self.act.places_m[self.reached[robot] + 1 : self.posts[robot] + 1])

    # ------------------------------------------------------------ stages

    def tasks(self, casting: Casting) -> Sequence[Task]:
        """Return the stages that are left for the robots that are left; for the first time, as they were planned."""
        self._man(casting)
        stager = self._stager
        self._number += 1
        as_planned = self.posts == {robot: number for number, robot in enumerate(self.act.robots)}
        if self._number == 1 and self.strategy == self.act.strategy and as_planned:
            planned = expanded(self._task).subtasks
            self._note(planned)
            return [_augmented(each, stager) for each in planned]
        tasks = stager.tasks(f"{self._task.name}~{self._number}", self.posts, self._passed())
        self._note(tasks, exact=False)
        return tasks

    def once_more(self, lost: Collection[Address]) -> list[Task]:
        """Return what those have still to drive who are not at their places though all stages have ended.

        First to their own places, which were in others' way perhaps; then, if there are any, to other empty ones.
        """
        away = [robot for robot in self.posts if self._off(robot) and robot not in lost]
        if not away or self._rounds == self._parameters.rounds:
            return []
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

    def _man(self, casting: Casting) -> None:
        """Give the places to the robots that are left, and to spare ones for as long as there are any."""
        if self.fixed:
            self._settle(casting)
            return
        size = len(self.act.places_m)
        living = [robot for robot in self._team if robot not in casting.lost]
        while len(living) < size and (spare := casting.draft(self.act.places_m[0])) is not None:
            self._team.append(spare)
            self.reached[spare] = NOWHERE
            living.append(spare)
        living = living[:size]
        if set(living) != set(self.posts) or (self.strategy == "direct" and self._number == 0):
            living.sort(key=lambda robot: self.posts.get(robot, size))
            self.posts = reassigned(
                self.strategy, living, self.reached, casting.stands_m, self.act.places_m, self._length, casting.covered
            )

    def _settle(self, casting: Casting) -> None:
        """Leave each its own place, but where a lost robot's body stands on that: it takes one that is open."""
        self.posts = {robot: post for robot, post in self.posts.items() if robot not in casting.lost}
        for robot, post in self.posts.items():
            if casting.covered(robot, self.act.places_m[post]):
                free = set(range(len(self.act.places_m))) - set(self.posts.values())
                open_ = [post for post in sorted(free) if not casting.covered(robot, self.act.places_m[post])]
                self.posts[robot] = open_[0] if open_ else post

    def _passed(self) -> dict[Address, int]:
        """Return the places that robots have reached; one that is not at its very post has come to that before it."""
        return {
            robot: min(self.reached[robot], post - 1)
            if self._off(robot) and self.reached[robot] == post
            else self.reached[robot]
            for robot, post in self.posts.items()
        }

    def _off(self, robot: Address) -> bool:
        return self.stands_m.get(robot) != self.post_m(robot)

    def _note(self, tasks: Sequence[Task], exact: bool = True) -> None:
        """Note where drives lead to; in stages that were made here their names say it, as places are augmented."""
        for task in (inner for each in tasks for inner in each.walk()):
            if not isinstance(task.act, Go):
                continue
            if not exact:
                self._goals[task.name] = int(task.name.rpartition("-")[2]) - 1
            elif task.act.place_m in self.act.places_m:
                self._goals[task.name] = self.act.places_m.index(task.act.place_m)

    # ------------------------------------------------------------ what happens

    def left(self, robot: Address) -> None:
        """Note that a robot has been sent somewhere."""
        self.stands_m.pop(robot, None)

    def arrived(self, name: str, robot: Address, place_m: Place, final: bool) -> None:
        """Note that a robot has done a drive, to a place of this deployment or of one within it.

        Who only passes, so that the drive was not *final*, has come as near as those let it that stand there.
        """
        if robot not in self.reached:
            return
        if final:
            self.stands_m[robot] = place_m
        if name in self._goals:
            self.reached[robot] = self._goals[name]
        elif place_m in self.act.places_m:
            self.reached[robot] = self.act.places_m.index(place_m)

    def misses(self, robot: Address) -> bool:
        """Return whether a robot that was heard again could fill an empty place."""
        return robot in self._team and robot not in self.posts and len(self.posts) < len(self.act.places_m)

    def verdict(self, lost: Collection[Address]) -> tuple[str, bool]:
        """Return why it has failed now that its stages have ended (empty: it has not), and if for want of robots."""
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
