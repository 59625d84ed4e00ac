"""How a deployment is made of moves: the three strategies of Fig. 3, for the planner and the executive alike.

All three have "the same basic form: for N stages, move some group of n robots to some set of m locations" (paper 004,
section 5), and all leave ``robots[i]`` at ``places_m[i]``. With k = N - 1, and counting from 0:

* group: at stage i the robots i..k drive to place i at once, so that N, N-1, ..., 1 robots move;
* wave: at stage i the robots k-i..k drive to the places 0..i at once, so that 1, 2, ..., N robots move;
* leap-frog: at stage i robot i drives to the places 0..i one after the other, so that always one robot moves.

Nothing here keeps robots out of each other's way: that is the executive's augmentation.
"""

from collections.abc import Collection, Iterable, Iterator
from typing import Final, NamedTuple

from cosim.machine import Address
from protocols.deployment.plan import Deployment, Go, Place, Plan, Strategy, Task

CLEARING: Final = "clear"
"""Label of the moves that a switch puts before the new strategy."""
SWITCH: Final = "switch"
"""Label, with a number, of what is left to do by the new strategy."""


class Move(NamedTuple):
    """One robot's way to one place within a stage."""

    robot: Address
    place_m: Place
    final: bool
    """Whether the robot ends up there."""


# ---------------------------------------------------------------- strategies


def stages(deployment: Deployment) -> list[list[Move]]:
    """Return the moves of each stage (Fig. 3): at once for group and wave, one after the other for leap-frog."""
    size = len(deployment.robots)
    strategy = {"group": _group, "wave": _wave, "leap_frog": _leap_frog}[deployment.strategy]
    return [
        [
            Move(deployment.robots[robot], deployment.places_m[place], robot == place)
            for robot, place in strategy(at, size)
        ]
        for at in range(size)
    ]


def _group(stage: int, size: int) -> Iterator[tuple[int, int]]:
    return ((robot, stage) for robot in range(stage, size))


def _wave(stage: int, size: int) -> Iterator[tuple[int, int]]:
    return ((size - 1 - stage + place, place) for place in range(stage + 1))


def _leap_frog(stage: int, size: int) -> Iterator[tuple[int, int]]:
    return ((stage, place) for place in range(stage + 1))


def expanded(task: Task) -> Task:
    """Return *task* with the stages of its deployment as subtasks; any other task, or one that has some, as it is.

    Stages follow each other. They are called ``stage-1``, ``stage-2``, ...; moves ``robot-R``, or, of a robot that
    makes several in its stage, ``robot-R-leg-1`` and so on.
    """
    if not isinstance(task.act, Deployment) or task.subtasks:
        return task
    leaping = task.act.strategy == "leap_frog"
    subtasks = tuple(
        _stage(f"{task.name}/stage-{number}", f"stage-{number}", moves, leaping)
        for number, moves in enumerate(stages(task.act), start=1)
    )
    return task.model_copy(update={"order": "serial", "subtasks": subtasks})


def _stage(name: str, label: str, moves: Iterable[Move], leaping: bool) -> Task:
    subtasks = tuple(
        _go(name, f"robot-{move.robot}-leg-{leg}" if leaping else f"robot-{move.robot}", move)
        for leg, move in enumerate(moves, start=1)
    )
    return Task(name=name, label=label, order="serial" if leaping else "parallel", subtasks=subtasks)


def _go(parent: str, label: str, move: Move) -> Task:
    act = Go(robot=move.robot, place_m=move.place_m, final=move.final)
    return Task(name=f"{parent}/{label}", label=label, act=act)


def expanded_to(task: Task, depth: int | None = None) -> Task:
    """Return *task* with the deployments in it expanded that stand at most *depth* levels below it; None: all."""
    inner = None if depth is None else depth - 1
    if depth is not None and depth < 0:
        return task
    if isinstance(task.act, Deployment):
        return expanded(task)
    return task.model_copy(update={"subtasks": tuple(expanded_to(each, inner) for each in task.subtasks)})


# ---------------------------------------------------------------- switching


def switched(plan: Plan, strategy: Strategy, finished: Collection[str] = (), within: str | None = None) -> Plan:
    """Return *plan* with what is left of its deployments done by *strategy*; every robot keeps its final place.

    *finished*: names of the tasks that were done, which stay in the plan as they are; what was not done leaves it, and
    constraints on it with it. *within*: only in that task and below it. The rest is one unexpanded deployment,
    ``switch-N``. Before it, robots that stand where another is to end up (in a wave, or in the middle of a leap) drive
    on to their own places: the new strategy might otherwise wait for ever for a place to become free.
    """
    root = _switched(plan.root, strategy, frozenset(finished), within)
    names = {""} | {task.name for task in root.walk()}
    constraints = tuple(each for each in plan.constraints if {each.earlier.task, each.later.task} <= names)
    return Plan(
        number=plan.number, play=plan.play, robots=plan.robots, root=_mended(root, names), constraints=constraints
    )


def _mended(task: Task, names: Collection[str]) -> Task:
    """Return *task* without references to tasks that have left the plan."""
    ends_with = task.ends_with if task.ends_with in names else None
    subtasks = tuple(_mended(each, names) for each in task.subtasks)
    return task.model_copy(update={"ends_with": ends_with, "subtasks": subtasks})


def _switched(task: Task, strategy: Strategy, finished: frozenset[str], within: str | None) -> Task:
    if task.name in finished:
        return task
    here = within is None or task.name == within
    if here and isinstance(task.act, Deployment):
        return _resumed(task, task.act, strategy, finished)
    inner = None if here else within
    return task.model_copy(
        update={"subtasks": tuple(_switched(each, strategy, finished, inner) for each in task.subtasks)}
    )


def _resumed(task: Task, deployment: Deployment, strategy: Strategy, finished: frozenset[str]) -> Task:
    """Return the *task* of a *deployment* with what was done of it, and the rest by *strategy*."""
    done = tuple(kept for each in task.subtasks if (kept := _kept(each, finished)) is not None)
    act = deployment.model_copy(update={"strategy": strategy})
    if not done:
        return task.model_copy(update={"act": act, "subtasks": ()})
    deployed, in_the_way = _standing(done, act)
    ends = [(robot, place) for robot, place in zip(act.robots, act.places_m, strict=True) if robot not in deployed]
    clearing = [Move(robot, place, True) for robot, place in ends if robot in in_the_way]
    rest = [(robot, place) for robot, place in ends if robot not in in_the_way]
    number = 1 + max((int(each.label.rpartition("-")[2]) for each in done if _switching(each)), default=0)
    subtasks = list(done)
    if clearing:
        label = f"{CLEARING}-{number}"
        subtasks.append(_stage(f"{task.name}/{label}", label, clearing, leaping=False))
    if rest:
        label = f"{SWITCH}-{number}"
        inner = act.model_copy(update={"robots": tuple(r for r, _ in rest), "places_m": tuple(p for _, p in rest)})
        subtasks.append(Task(name=f"{task.name}/{label}", label=label, act=inner))
    return task.model_copy(update={"act": act, "order": "serial", "subtasks": tuple(subtasks)})


def _switching(task: Task) -> bool:
    return task.label.rpartition("-")[0] in {SWITCH, CLEARING}


def _standing(done: Iterable[Task], act: Deployment) -> tuple[set[Address], set[Address]]:
    """Return the robots that are deployed, by what was *done*, and those that stand in another's way meanwhile.

    A robot in the middle of its leap stands at a deployed robot's place, one of a wave where one is yet to come.
    """
    last = dict[Address, tuple[Go, bool]]()
    for stage in (task for each in done for task in each.walk()):
        moves = [task.act for task in stage.subtasks if isinstance(task.act, Go)]
        last |= {move.robot: (move, stage.order == "serial") for move in moves}
    deployed = {robot for robot, (move, _) in last.items() if move.final}
    awaited = {place for robot, place in zip(act.robots, act.places_m, strict=True) if robot not in deployed}
    in_the_way = {
        robot for robot, (move, leaping) in last.items() if not move.final and (leaping or move.place_m in awaited)
    }
    return deployed, in_the_way


def _kept(task: Task, finished: frozenset[str]) -> Task | None:
    """Return what was done of *task*: nothing, all, or a task of those subtasks that were."""
    if task.name in finished:
        return task
    subtasks = tuple(kept for each in task.subtasks if (kept := _kept(each, finished)) is not None)
    return task.model_copy(update={"subtasks": subtasks}) if subtasks else None
