"""The tree of plays: read from files, checked as a whole, searched by path.

A library is a folder of YAML files, each a play or a folder of plays
(:class:`protocols.deployment.planning.play.Play`), named by its file; or it is one such file that is a folder. An error
names the file, the place in it, the value, and what was expected.
"""

import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, TypeAlias

from cosim.errors import UserError
from protocols.deployment.planning.binding import STRATEGIES, near
from protocols.deployment.planning.play import (
    LABEL,
    DeployStep,
    NetStep,
    Parameter,
    Play,
    PlayStep,
    RobotsParameter,
    Step,
    labels,
)
from protocols.deployment.tasks.constraints import BASE, Constraint, named_by, quantities_of

BUILT_IN: Final = Path(__file__).parent / "plays"
"""Folder of our own plays."""

Reader: TypeAlias = Callable[[Path], Play]
"""Reads and validates one file; raises UserError."""
Fault: TypeAlias = tuple[str, str]
"""A place in a play, and what is wrong there."""


class Playbook:
    """All plays by their paths, such as ``deploy/leap-frog``; of two plays at one path the later counts."""

    def __init__(self, root: Play, sources: Mapping[str, str] | None = None) -> None:
        """Take a folder of plays; *sources*: the file of each play directly in it. Raise UserError for a wrong one."""
        self.root = root
        self._plays = dict(_walk(root, ""))
        for path, play in self._plays.items():
            source = (sources or {}).get(path.partition("/")[0], "plays")
            for place, text in self._faults(path, play):
                inner = path.partition("/")[2].replace("/", ".plays.")
                at = ".".join(filter(None, ["plays." + inner if inner else "", place]))
                raise UserError(f"{source}: {at + ': ' if at else ''}{text}")

    @classmethod
    def read(cls, paths: Iterable[Path], reader: Reader) -> "Playbook":
        """Return the plays of folders of files, or of single files that are folders of plays; raise UserError."""
        plays, sources = dict[str, Play](), dict[str, str]()
        for path in paths:
            if os.path.isdir(path):  # Path.is_dir raises for a name that is too long
                read = {_label_of(file): (reader(file), str(file)) for file in sorted(path.glob("*.yaml"))}
            else:
                folder = reader(path)
                if folder.tasks:
                    raise UserError(f"{path}: is a play, expected a folder: plays by their names")
                read = {name: (play, f"{path}: plays.{name}") for name, play in folder.plays.items()}
            plays |= {name: play for name, (play, _) in read.items()}
            sources |= {name: source for name, (_, source) in read.items()}
        return cls(Play(plays=plays), sources)

    # ------------------------------------------------------------ searching

    def find(self, path: str) -> tuple[str, tuple[str, ...]]:
        """Return the path of the play or folder with which *path* begins, and the labels of its tasks that follow.

        Raise UserError if there is none.
        """
        parts = path.strip("/").split("/")
        for count in range(len(parts), 0, -1):
            known = "/".join(parts[:count])
            if known in self._plays and (count == len(parts) or self._plays[known].tasks):
                return known, tuple(parts[count:])
        raise UserError(f"play: there is no {path!r}{near(path, self._plays)}")

    def play(self, path: str) -> Play:
        """Return the play at *path*; raise UserError if there is none."""
        if path not in self._plays:
            raise UserError(f"play: there is no {path!r}{near(path, self._plays)}")
        return self._plays[path]

    def below(self, path: str) -> list[str]:
        """Return the paths of the plays at *path* and below that are no folders."""
        return [
            each for each, play in self._plays.items() if play.tasks and (each == path or each.startswith(f"{path}/"))
        ]

    def tree(self) -> list[dict[str, Any]]:
        """Return the tree as JSON, for people to choose from: plays, their parameters and their tasks."""
        return [_branch(name, name, play) for name, play in self.root.plays.items()]

    # ------------------------------------------------------------ checking

    def _faults(self, path: str, play: Play) -> Iterator[Fault]:
        if bool(play.plays) == bool(play.tasks):
            yield "", f"{path} has {'both' if play.plays else 'neither'} tasks and plays, expected one of them"
        if play.plays and (play.parameters or play.constraints):
            yield "parameters", "a folder has none, expected only about and plays"
        for name, parameter in play.parameters.items():
            yield from self._parameter_faults(play, name, parameter)
        yield from self._net_faults(play, play, "", (path,))

    def _parameter_faults(self, play: Play, name: str, parameter: Parameter) -> Iterator[Fault]:
        if name == BASE or name in STRATEGIES:
            yield f"parameters.{name}", f"{name!r} has a meaning of its own, expected another name"
        several, _, number = name.rpartition("-")
        if parameter.kind == "robot" and number.isdecimal() and several in _of_kind(play, "robots"):
            text = f"{name!r} is what one of the robots {several} is called, expected another name"
            yield f"parameters.{name}", text
        if isinstance(parameter, RobotsParameter) and parameter.as_many_as is not None:
            places = _of_kind(play, "places")
            if parameter.as_many_as not in places:
                text = f"{parameter.as_many_as!r} is no parameter of kind places{near(parameter.as_many_as, places)}"
                yield f"parameters.{name}.as_many_as", text

    def _net_faults(self, play: Play, net: Play | NetStep, at: str, within: tuple[str, ...]) -> Iterator[Fault]:
        names = labels(net.tasks)
        for number, (label, step) in enumerate(zip(names, net.tasks, strict=True)):
            here = f"{at}tasks[{number}]"
            if names.index(label) < number:
                yield f"{here}.label", f"{label!r} is the label of another task of the net, expected one of its own"
            if step.ends_with is not None and step.ends_with not in set(names) - {label}:
                others = [name for name in names if name != label]
                yield (
                    f"{here}.ends_with",
                    f"{step.ends_with!r} is no other task of the net{near(step.ends_with, others)}",
                )
            yield from ((f"{here}.{place}", text) for place, text in self._step_faults(play, step, within))
            if isinstance(step, NetStep):
                yield from self._net_faults(play, step, f"{here}.", within)
        for number, constraint in enumerate(net.constraints):
            here = f"{at}constraints[{number}]"
            yield from ((f"{here}.{place}", text) for place, text in _constraint_faults(play, constraint, names))

    def _step_faults(self, play: Play, step: Step, within: tuple[str, ...]) -> Iterator[Fault]:
        for key, name in _values(step, step.names_robots):
            known = [*_of_kind(play, "robot"), *(_of_kind(play, "robots") if key.startswith("robots") else [])]
            if name not in known:
                yield key, f"{name!r} is no parameter that is a robot{near(name, known)}"
        for key, name in _values(step, ("time_out_s", *step.names_numbers)):
            if isinstance(name, str) and name not in _of_kind(play, "number"):
                yield key, f"{name!r} is no parameter that is a number{near(name, _of_kind(play, 'number'))}"
        for key, place in _values(step, step.names_places):
            if isinstance(place, str) and place in play.parameters and play.parameters[place].kind not in _PLACES:
                yield key, f"{place!r} is a parameter of kind {play.parameters[place].kind}, expected a place"
        strategies = [*STRATEGIES, *_of_kind(play, "strategy")]
        if isinstance(step, DeployStep) and step.strategy not in strategies:
            yield "strategy", f"{step.strategy!r} is no strategy{near(step.strategy, strategies)}"
        if isinstance(step, PlayStep):
            yield from self._inner_faults(step, within)

    def _inner_faults(self, step: PlayStep, within: tuple[str, ...]) -> Iterator[Fault]:
        """Yield the faults of a task that is another play; *within*: the plays of which it is a task."""
        inner = self._plays.get(step.play)
        if inner is None or not inner.tasks:
            plays = [path for path, play in self._plays.items() if play.tasks]
            yield "play", f"{step.play!r} is no play{near(step.play, plays)}"
            return
        if step.play in within:
            yield "play", f"{step.play!r} is a task of itself: {' > '.join((*within, step.play))}"
            return
        for name in step.given:
            if name not in inner.parameters:
                yield f"given.{name}", f"{step.play} has no parameter {name!r}{near(name, inner.parameters)}"
        for step_below in _plays_in(inner.tasks):
            yield from self._inner_faults(step_below, (*within, step.play))


_PLACES: Final = ("place", "places")


def _label_of(file: Path) -> str:
    if not re.fullmatch(LABEL, file.stem):
        raise UserError(f"{file}: {file.stem!r} is no name of a play, expected a-z, 0-9, _ and - only")
    return file.stem


def _walk(folder: Play, path: str) -> Iterator[tuple[str, Play]]:
    for name, play in folder.plays.items():
        yield path + name, play
        yield from _walk(play, f"{path}{name}/")


def _of_kind(play: Play, kind: str) -> list[str]:
    return [name for name, parameter in play.parameters.items() if parameter.kind == kind]


def _plays_in(tasks: Sequence[Step]) -> Iterator[PlayStep]:
    for step in tasks:
        if isinstance(step, PlayStep):
            yield step
        elif isinstance(step, NetStep):
            yield from _plays_in(step.tasks)


def named_in(net: Play | NetStep | Step) -> set[str]:
    """Return all names that a net or a task mentions: of parameters, of places, of strategies."""
    if not isinstance(net, Play | NetStep):
        keys = *net.names_robots, *net.names_places, "time_out_s", *net.names_numbers
        found = [each for _, each in _values(net, keys)]
        found += [net.strategy] if isinstance(net, DeployStep) else []
        for value in net.given.values() if isinstance(net, PlayStep) else ():
            found += value if isinstance(value, list) else [value]
        return {name for name in found if isinstance(name, str)}
    quantities = {value for each in net.constraints for value in quantities_of(each).values()}
    names = {name for name in quantities if isinstance(name, str)}
    return names.union(*(named_in(step) for step in net.tasks))


def _values(step: Step, keys: Sequence[str]) -> Iterator[tuple[str, Any]]:
    """Yield what the fields *keys* of *step* hold, name by name, each with its place in the file."""
    for key in keys:
        value = getattr(step, key)
        if isinstance(value, tuple) and not (value and isinstance(value[0], float | int)):  # several, and no (x, y)
            yield from ((f"{key}[{number}]", each) for number, each in enumerate(value))
        elif value is not None:
            yield key, value


def _constraint_faults(play: Play, constraint: Constraint, names: Sequence[str]) -> Iterator[Fault]:
    for key, task in named_by(constraint).items():
        label = task.partition("/")[0]
        if task and label not in names:
            yield key, f"{label!r} is no task of the net{near(label, names)}"
    for key, quantity in quantities_of(constraint).items():
        if isinstance(quantity, str) and quantity not in _of_kind(play, "number"):
            yield key, f"{quantity!r} is no parameter that is a number{near(quantity, _of_kind(play, 'number'))}"


def _branch(name: str, path: str, play: Play) -> dict[str, Any]:
    """Return one play, or one folder, as JSON."""
    branch: dict[str, Any] = {"name": name, "path": path, "about": play.about}
    if play.plays:
        return branch | {"plays": [_branch(each, f"{path}/{each}", inner) for each, inner in play.plays.items()]}
    parameters = {key: each.model_dump(mode="json", exclude_none=True) for key, each in play.parameters.items()}
    return branch | {"parameters": parameters, "tasks": _twigs(path, play.tasks)}


def _twigs(path: str, tasks: Sequence[Step]) -> list[dict[str, Any]]:
    twigs = list[dict[str, Any]]()
    for label, step in zip(labels(tasks), tasks, strict=True):
        twig: dict[str, Any] = {"name": label, "path": f"{path}/{label}", "kind": step.kind}
        if isinstance(step, NetStep):
            twig["tasks"] = _twigs(twig["path"], step.tasks)
        twigs.append(twig)
    return twigs
