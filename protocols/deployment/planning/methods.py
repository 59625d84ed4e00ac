"""The moves of a deployment: the three strategies of Fig. 3, for the planner and the executive alike.

All three have "the same basic form: for N stages, move some group of n robots to some set of m locations" (paper 004,
section 5), and all leave ``robots[i]`` at ``places_m[i]``. With k = N - 1, and counting from 0:

* group: at stage i the robots i..k drive to place i in parallel, so that N, N-1, ..., 1 robots move;
* wave: at stage i the robots k-i..k drive to the places 0..i in parallel, so that 1, 2, ..., N robots move;
* leap-frog: at stage i robot i drives to the places 0..i one after the other, so that one robot moves at a time.

Our own *direct* and *fixed* have one stage: robot i drives to place i.

Nothing here keeps robots out of each other's way; the executive's augmentation does.
"""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

from cosim.machine import Address
from protocols.deployment.tasks.plan import UNSTAGED, Deployment, Go, Place, Task


class Move(NamedTuple):
    """One robot's way to one place within a stage."""

    robot: Address
    place_m: Place
    final: bool
    """True if the robot ends up there."""


# ---------------------------------------------------------------- strategies


def stages(deployment: Deployment) -> list[list[Move]]:
    """Return the moves of each stage (Fig. 3): parallel for group and wave, one after the other for leap-frog."""
    size = len(deployment.robots)
    if deployment.strategy in UNSTAGED:
        return [[Move(*pair, final=True) for pair in zip(deployment.robots, deployment.places_m, strict=True)]]
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
    """Return *task* with the stages of its deployment as subtasks; leave other tasks, and expanded ones, as they are.

    Stages follow each other, with the labels ``stage-1``, ``stage-2``, ...; moves have the label ``robot-R``, or, if a
    robot makes several in its stage, ``robot-R-leg-1`` and so on.
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
    """Return *task* with the deployments at most *depth* levels below it expanded; None: all."""
    inner = None if depth is None else depth - 1
    if depth is not None and depth < 0:
        return task
    if isinstance(task.act, Deployment):
        return expanded(task)
    return task.model_copy(update={"subtasks": tuple(expanded_to(each, inner) for each in task.subtasks)})
