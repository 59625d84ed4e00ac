"""Plans are tailored: what a call adds to a play before it is executed (paper 004, section 4)."""

from collections.abc import Callable, Collection, Mapping

from cosim.errors import UserError
from protocols.deployment.planning.binding import near
from protocols.deployment.planning.methods import expanded
from protocols.deployment.tasks.plan import Deployment, Go, Place, Strategy, Task


def rewritten(task: Task, change: Callable[[Task], Task]) -> Task:
    """Return *task* with *change* made to it and to all below it, the lowest first."""
    if task.subtasks:
        task = task.model_copy(update={"subtasks": tuple(rewritten(each, change) for each in task.subtasks)})
    return change(task)


def deployed_by(root: Task, strategy: Strategy | None, augmented: bool | None) -> Task:
    """Return *root* with all deployments by that strategy, and augmented or not; None: as they are."""
    update: dict[str, object] = {} if strategy is None else {"strategy": strategy}
    update |= {} if augmented is None else {"augmented": augmented}

    def change(task: Task) -> Task:
        if update and isinstance(task.act, Deployment):
            return task.model_copy(update={"act": task.act.model_copy(update=update)})
        return task

    return rewritten(root, change)


def timed_out(root: Task, time_outs_s: Mapping[str, float]) -> Task:
    """Return *root* with other time-outs, by the tasks' names."""

    def change(task: Task) -> Task:
        return task.model_copy(update={"time_out_s": time_outs_s[task.name]}) if task.name in time_outs_s else task

    return rewritten(root, change) if time_outs_s else root


def revealed(root: Task, names: Collection[str]) -> Task:
    """Return *root* with those deployments expanded that have tasks of these *names*; raise UserError for no task."""

    def change(task: Task) -> Task:
        return expanded(task) if any(name.startswith(f"{task.name}/") for name in names) else task

    root = rewritten(root, change)
    known = {task.name for task in root.walk()}
    for name in names:
        if name and name not in known:
            raise UserError(f"there is no task {name!r} in {root.name}{near(name, known)}")
    return root


def led(root: Task, via_m: Mapping[str, tuple[Place, ...]]) -> Task:
    """Return *root* with waypoints for drives, by the tasks' names; raise UserError for what is no drive."""

    def change(task: Task) -> Task:
        if task.name not in via_m:
            return task
        if not isinstance(task.act, Go):
            raise UserError(f"via: {task.name} is no drive of one robot, expected the name of one")
        return task.model_copy(update={"act": task.act.model_copy(update={"via_m": via_m[task.name]})})

    return rewritten(root, change) if via_m else root
