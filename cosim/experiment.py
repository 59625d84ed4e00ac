"""An experiment: a scenario, axes that vary it, replicates; from ``experiments/NAME/sweep.yaml`` or a user's file::

    scenario: {...}                     or the name of a scenario file beside this one
    sweep:
      team.size: [2, 4, 8]              the column is called by the last part of the path: size
      floor:                            an axis with a name of its own, and names for its values
        path: floorplan.map
        values: {storey: ../floors/storey.yaml, office: office}
      network:                          without a path: each value is several settings, by their paths
        values: {usual: {}, slow: {channel.latency_s: 0.5, protocol.parameters.period_s: 2}}
      speed: {path: body.max_speed_mps, low: 0.1, high: 0.8}    for designs that draw: with log, evenly by its logarithm
    design: {kind: latin hypercube, points: 64}    by default the product of all axes
    replicates: 10
    quick: {replicates: 2, points: 8, sweep: {size: [2, 4]}, set: {duration_s: 60}}

A design is the product; ``one at a time``: the first values of all axes, and each other value of each axis with them;
or points that are drawn by the seed of the experiment: ``latin hypercube`` and ``sobol``; ``saltelli`` and ``morris``,
from which ``cosim sensitivity`` tells which axis matters (``cosim.statistics.designs``). Of an axis with ``values``
each is drawn as often. Whole numbers are drawn if low, high and the setting itself are whole.

What is no run of robots names a function instead of a scenario: ``run: module:function`` and ``parameters: {...}``.
It is marked with ``experiment_function``, is called with (parameters, seed) and returns metrics as a dict, or
observations as a list of dicts. If there are settings called ``Parameters`` in its module, the parameters of every arm
are validated with them, and hold all their defaults, as a scenario does; a tuple of ``cosim.trace.Field`` called
``COLUMNS`` there gives what it returns types, units and meanings.
"""

import itertools
import json
import sys
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, Literal, NamedTuple, Self, TypeAlias, TypeVar

from pydantic import Field, field_validator, model_validator

from cosim.documents import (
    Assignment,
    Place,
    assign,
    in_turn,
    is_file,
    nearest,
    parse_assignment,
    parse_place,
    read_yaml,
    show_place,
    validated,
)
from cosim.errors import UserError
from cosim.installed import find_named, installed_folders
from cosim.results import FIXED, ReportSettings
from cosim.scenario import Scenario, build, digest, dump, given_here, load
from cosim.settings import Count, Energy, FreeSettings, Int64, PlainData, Seed, Settings, error_at
from cosim.statistics.designs import BALANCED, SAMPLED, Span, is_balanced, points

Label: TypeAlias = str | int | float | bool
Function = TypeVar("Function", bound=Callable[..., Any])

MOST_POINTS = 2**14
"""Most points of a design: each is an arm, or several."""
_MARK = "experiment_function"
"""The attribute of functions that a sweep.yaml may name."""
_NO_SETTINGS = "expected, by name, mappings of settings' paths to values"


class AxisSettings(Settings):
    """One axis of a sweep."""

    path: str | None = Field(
        default=None,
        description="the setting that the axis changes; if not given, each value is several, by their paths",
    )
    values: PlainData = Field(default=None, description="a list of values, or a mapping of names to values")
    low: Int64 | Energy | None = Field(default=None, description="the least, for a design that draws")
    high: Int64 | Energy | None = Field(default=None, description="the greatest; both are instead of values")
    log: bool = Field(default=False, description="True: drawn evenly by the logarithm")
    titles: PlainData = Field(
        default_factory=dict, description="what a figures.py calls them, by value or name, if not by that"
    )

    @field_validator("values")
    @classmethod
    def _named(cls, values: Any) -> Any:
        if values is not None and (not isinstance(values, list | dict) or not values):
            raise ValueError("is not a list of values, or a mapping of names to values")
        if isinstance(values, list) and not all(isinstance(value, Label) for value in values):
            raise ValueError("holds values that need names: expected a mapping of names to values")
        return values

    @field_validator("titles")
    @classmethod
    def _texts(cls, titles: Any) -> dict[Label, str]:
        if not (isinstance(titles, dict) and all(isinstance(title, str) for title in titles.values())):
            raise ValueError("is not a mapping of values, or of their names, to texts")
        return titles

    @model_validator(mode="after")
    def _spans(self) -> Self:
        if (self.low is None) != (self.high is None) or (self.low is None) == (self.values is None):
            raise ValueError("expected either values, or low and high")
        if self.log and self.low is None:
            raise error_at(("log",), self.log, "is for low and high: values are as they are")
        if self.low is not None and self.high is not None:
            if not self.low < self.high:
                raise error_at(("high",), self.high, f"is not > {self.low}, which is low")
            if self.log and not self.low > 0:
                raise error_at(("low",), self.low, "is not > 0, and has no logarithm")
        return self

    @model_validator(mode="after")
    def _entitles_values(self) -> Self:
        for label, title in self.titles.items():
            if label not in (self.values or ()):
                told = f"is the title of {label}, which is no value{nearest(str(label), map(str, self.values or ()))}"
                raise error_at(("titles",), title, told)
        return self

    @model_validator(mode="after")
    def _changes_something(self) -> Self:
        if self.path is None and not (isinstance(self.values, dict) and all(map(_are_settings, self.values.values()))):
            raise error_at(("values",), self.values, f"{_NO_SETTINGS}; or path, of one setting")
        return self


def _are_settings(value: Any) -> bool:
    return isinstance(value, dict) and all(isinstance(path, str) and parse_place(path) for path in value)


class DesignSettings(Settings):
    """Which combinations of the axes are run."""

    kind: Literal["product", "one at a time", "latin hypercube", "sobol", "saltelli", "morris"] = Field(
        default="product", description="all, or how those that are run are chosen"
    )
    points: Count | None = Field(
        default=None, ge=1, le=MOST_POINTS, description="how many are drawn; trajectories of morris"
    )

    @model_validator(mode="after")
    def _counts(self) -> Self:
        drawn = self.kind in SAMPLED
        if drawn and self.points is None:
            raise ValueError(f"{self.kind}: expected points, how many to draw")
        if not drawn and self.points is not None:
            raise error_at(("points",), self.points, f"is not for {self.kind}, which takes all values of the axes")
        if self.kind in BALANCED and self.points is not None and not is_balanced(self.points):
            below = 1 << (self.points.bit_length() - 1)
            told = f"is not a power of two, and {self.kind} loses its balance: expected {below} or {2 * below}"
            raise error_at(("points",), self.points, told)
        return self


class QuickSettings(Settings):
    """How the experiment is cut down for a first look."""

    replicates: Count = Field(default=2, ge=1, description="runs of each arm")
    points: Count | None = Field(default=None, ge=1, le=MOST_POINTS, description="how many points a design draws")
    sweep: dict[str, PlainData] = Field(
        default_factory=dict, description="other values for some axes, by their columns"
    )
    set: dict[str, PlainData] = Field(default_factory=dict, description="other settings, by their paths")


class ExperimentSettings(Settings):
    """A sweep.yaml."""

    name: str | None = Field(default=None, min_length=1, description="by default that of the folder")
    about: str = Field(default="", description="one sentence")
    scenario: dict[str, PlainData] | str | None = Field(
        default=None, description="settings, or the name of a file with them"
    )
    run: str | None = Field(default=None, description="module:function, for what is no run of robots")
    parameters: dict[str, PlainData] = Field(default_factory=dict, description="of the function")
    seed: Seed | None = Field(default=None, ge=0, description="of the function's first replicate, by default 1")
    sweep: dict[str, AxisSettings] = Field(default_factory=dict, description="the axes")
    design: DesignSettings = Field(default_factory=DesignSettings, description="which combinations of them are run")
    replicates: Count = Field(default=10, ge=1, description="runs of each arm; all arms see the same seeds")
    quick: QuickSettings = Field(default_factory=QuickSettings, description="what --quick cuts down")
    report: ReportSettings = Field(default_factory=ReportSettings, description="what the report shows")

    @property
    def first_seed(self) -> int:
        """Seed of the function's first replicate."""
        return 1 if self.seed is None else self.seed

    @field_validator("sweep", mode="before")
    @classmethod
    def _short_form(cls, sweep: Any) -> Any:
        if not isinstance(sweep, Mapping):
            return sweep
        return {
            name: {"path": name, "values": axis} if isinstance(axis, list) else axis for name, axis in sweep.items()
        }

    @field_validator("design", mode="before")
    @classmethod
    def _kind_alone(cls, design: Any) -> Any:
        return {"kind": design} if isinstance(design, str) else design

    @model_validator(mode="after")
    def _runs_something(self) -> Self:
        if (self.scenario is None) == (self.run is None):
            raise ValueError("expected either scenario or run")
        for name in ("parameters", "seed"):
            if self.scenario is not None and getattr(self, name) not in (None, {}):
                told = "is for a function that run names, expected in scenario: there is a scenario"
                raise error_at((name,), getattr(self, name), told)
        if self.design.kind in SAMPLED and not self.sweep:
            raise error_at(("design",), self.design.kind, "expected a sweep, of axes to draw from")
        return self


class Axis(NamedTuple):
    """An axis by the name of its column, the path of its setting, if it is one, and its labelled values.

    Of a design that draws, the values are those of its points, in their order, as often as they were drawn.
    """

    name: str
    path: str | None
    values: tuple[tuple[Label, Any], ...]
    span: Span | None = None
    """What its values are to be drawn from, if it has none yet."""

    def changes(self, label: Label, value: Any, source: str) -> list[Assignment]:
        """Return what *value*, called *label*, changes; errors name *source*."""
        told = f"{source} with {self.path or self.name}={label}"
        settings = value if self.path is None else {self.path: value}
        # a copy: an axis below this one writes into it
        return [Assignment(parse_place(path), deepcopy(each), told) for path, each in settings.items()]


@dataclass(frozen=True)
class Arm:
    """One combination of the axes' values, whatever the design."""

    labels: dict[str, Label]
    scenario: Scenario | None
    run: str | None
    parameters: dict[str, Any]
    configuration: str


@dataclass(frozen=True)
class Experiment:
    """An experiment that is ready to run: every arm of it has been validated."""

    name: str
    source: Path
    settings: ExperimentSettings
    base: dict[str, Any]
    """The scenario's dump, or the function's parameters, before any axis."""
    axes: tuple[Axis, ...]
    arms: tuple[Arm, ...]
    replicates: int
    seed: int
    given: tuple[str, ...] = ()
    """What ``--quick`` and ``--set`` have changed, as ``path=value``."""


# ---------------------------------------------------------------- finding


def experiment_folders() -> dict[str, Path]:
    """Return the folders of the installed experiments by name."""
    folders = installed_folders("cosim.experiments")
    return {name: folder for name, folder in folders.items() if (folder / "sweep.yaml").is_file()}


def find_experiment(text: str) -> Path:
    """Return the sweep.yaml that *text* means: a path of it, its folder, or the name of an installed experiment."""
    path = Path(text)
    if is_file(path):
        return path
    if is_file(path / "sweep.yaml"):
        return path / "sweep.yaml"
    folders = experiment_folders()
    if text in folders:
        return folders[text] / "sweep.yaml"
    raise UserError(f"{text}: is neither a file nor an experiment{nearest(text, folders)}")


def scenario_named(text: str, sets: Sequence[str] = ()) -> Scenario:
    """Return the scenario that *text* means, a YAML file or the name of an experiment, with the settings *sets*."""
    path = find_experiment(text)
    return base_scenario(path, sets) if is_experiment(read_yaml(path)) else load(path, sets)


def find_beside(text: str, name: str | None) -> Path:
    """Return the file *name* of the experiment that *text* means, if it has one; else what ``find_experiment`` does."""
    path = find_experiment(text)
    if name is None or path == Path(text):  # whoever names a file means that file
        return path
    beside = path.with_name(name)
    return beside if beside.is_file() else path


def axis_titles(folder: Path) -> dict[str, dict[Any, str]]:
    """Return what figures call the values of each axis of the sweep.yaml in *folder*, by the column of the axis.

    Values without a title are called by their names. Both are in the order of the sweep.
    """
    path = folder / "sweep.yaml"
    settings = validated(ExperimentSettings, read_yaml(path), str(path))
    columns = _columns(settings.sweep, str(path))
    return {
        columns[key]: {label: axis.titles.get(label, str(label)) for label in axis.values or ()}
        for key, axis in settings.sweep.items()
    }


def named(labels: Mapping[str, Any]) -> str:
    """Return the values of an arm's axes as a text."""
    return ", ".join(f"{name}={label}" for name, label in labels.items())


def is_experiment(plain: Mapping[str, Any]) -> bool:
    """Return whether a document is a sweep.yaml rather than a scenario."""
    return bool({"sweep", "run", "replicates", "scenario"} & plain.keys())


def experiment_function(function: Function) -> Function:
    """Mark *function*, (parameters, seed) -> metrics or observations, as one that ``run:`` of a sweep.yaml may name.

    Without it a document could have any function of any library called.
    """
    setattr(function, _MARK, True)
    return function


def find_function(name: str, source: str) -> Callable[[dict[str, Any], int], Any]:
    """Return the function that ``run: module:function`` names; raise UserError if it is not there, or not marked.

    The module is imported, unless it is one of Python's own, and nothing of it is called.
    """
    module, _, function = name.partition(":")
    if not all(part.isidentifier() for part in (*module.split("."), function)):
        raise UserError(f"{source}: run: {name!r} is not module:function")
    if module.partition(".")[0] in sys.stdlib_module_names:
        raise UserError(f"{source}: run: {name!r} is of Python's own library, expected a function of an experiment")
    try:
        found: Callable[[dict[str, Any], int], Any] = find_named(name)
    except ImportError as error:
        raise UserError(f"{source}: run: {name!r} is not module:function: {error}") from None
    if getattr(found, _MARK, None) is not True:
        raise UserError(f"{source}: run: {name!r} is not marked with @experiment_function of cosim.experiment")
    return found


# ---------------------------------------------------------------- reading


def load_experiment(
    path: str | Path, sets: Iterable[str] = (), quick: bool = False, replicates: int | None = None
) -> Experiment:
    """Return the experiment in the file *path*, cut down if *quick*, changed by *sets*.

    A path in *sets* that is an axis's, or the name of its column, leaves only the given value on that axis. Raise
    UserError for whatever is wrong.
    """
    path, sets = Path(path), tuple(sets)
    settings = validated(ExperimentSettings, read_yaml(path), str(path))
    columns = _columns(settings.sweep, str(path))
    _refuse_unknown_axes(settings, columns.values(), quick, str(path))
    given = _given(sets, settings, columns)
    axes = _axes(settings, str(path), columns, settings.quick.sweep if quick else {}, given)
    fixed = given.settings
    if quick:
        changes = settings.quick.set.items()
        fixed = [*(Assignment(parse_place(key), value, f"{path}: quick.set.{key}") for key, value in changes), *fixed]
    base, folder, source = _base(settings, path, fixed)
    seed = base["seed"] if settings.scenario is not None else settings.first_seed
    axes, rows = _combined(_design(settings, str(path), quick), axes, base, seed, str(path))
    arms = tuple(_arm(settings, base, folder, source, axes, values) for values in rows)
    wanted = replicates or (settings.quick.replicates if quick else settings.replicates)
    name = settings.name or path.resolve().parent.name
    short = [f"{key}={json.dumps(value)}" for key, value in settings.quick.set.items()] if quick else []
    return Experiment(name, path, settings, base, axes, arms, wanted, seed, (*short, *sets))


def base_scenario(path: str | Path, sets: Iterable[str] = ()) -> Scenario:
    """Return the scenario of the experiment in the file *path* as it is before its axes."""
    path = Path(path)
    settings = validated(ExperimentSettings, read_yaml(path), str(path))
    if settings.scenario is None:
        name = next((name for name, at in experiment_folders().items() if at / "sweep.yaml" == path), path)
        raise UserError(f"{name}: is no run of robots but of {settings.run}: cosim sweep {name} makes it")
    given = _given(sets, settings, _columns(settings.sweep, str(path)))
    base, folder, source = _base(settings, path, given.settings)
    return build(base, source, folder)


class _Given(NamedTuple):
    """What ``--set`` gives: settings, and the values that are left on axes of several settings, by their columns."""

    settings: list[Assignment]
    several: dict[str, Any]


def _given(sets: Iterable[str], settings: ExperimentSettings, columns: Mapping[str, str]) -> _Given:
    """Return *sets* parsed; an axis may go by its column, and a value of it by its name."""
    known = settings.parameters if settings.run is not None else Scenario.model_fields
    axes: dict[Place, AxisSettings] = {(columns[key],): axis for key, axis in settings.sweep.items()}
    axes |= {parse_place(axis.path): axis for axis in settings.sweep.values() if axis.path is not None}
    given = _Given([], {})
    for item in map(parse_assignment, sets):
        axis = axes.get(item.place)
        if axis is None or (show_place(item.place) in known and axis.path != show_place(item.place)):
            given.settings.append(given_here(item))  # a setting goes by its own name
        elif axis.path is None:
            value = axis.values[item.value] if _names(axis, item.value) else item.value
            if not _are_settings(value):
                names = ", ".join(map(str, axis.values))
                raise UserError(f"{item.source}: expected one of {names}, or settings by their paths")
            given.several[show_place(item.place)] = value
            given.settings.extend(Assignment(parse_place(path), each, item.source) for path, each in value.items())
        else:
            item = item._replace(place=parse_place(axis.path))
            by_name = _names(axis, item.value)
            given.settings.append(item._replace(value=axis.values[item.value]) if by_name else given_here(item))
    return given


def _names(axis: AxisSettings, value: Any) -> bool:
    return isinstance(axis.values, dict) and isinstance(value, Label) and value in axis.values


def _parameters(run: str, parameters: dict[str, Any], source: str, assignments: Sequence[Assignment]) -> dict[str, Any]:
    """Return *parameters* with *assignments* made, and with their defaults if there is a model beside the function.

    That is the settings called ``Parameters``. Raise UserError if these refuse them.
    """
    model = getattr(import_module(run.partition(":")[0]), "Parameters", None)
    if not (isinstance(model, type) and issubclass(model, Settings)):
        model = FreeSettings
    found = dump(validated(model, parameters, source))
    for group in in_turn(assignments):
        found = dump(validated(model, assign(found, group), source, group))
    return found


def _base(settings: ExperimentSettings, path: Path, given: Sequence[Assignment]) -> tuple[dict[str, Any], Path, str]:
    if settings.run is not None:
        find_function(settings.run, str(path))
        source = f"{path}: parameters"
        return _parameters(settings.run, settings.parameters, source, given), path.parent, source
    if isinstance(settings.scenario, str):
        file = path.parent / settings.scenario
        return dump(build(read_yaml(file), str(file), file.parent, given)), file.parent, str(file)
    source = f"{path}: scenario"
    return dump(build(dict(settings.scenario or {}), source, path.parent, given)), path.parent, source


def _arm(
    settings: ExperimentSettings,
    base: dict[str, Any],
    folder: Path,
    source: str,
    axes: Sequence[Axis],
    values: Sequence[tuple[Label, Any]],
) -> Arm:
    labels = {axis.name: label for axis, (label, _) in zip(axes, values, strict=True)}
    changes = [
        change
        for axis, (label, value) in zip(axes, values, strict=True)
        for change in axis.changes(label, value, source)
    ]
    if settings.run is not None:
        parameters = _parameters(settings.run, base, source, changes)
        return Arm(labels, None, settings.run, parameters, digest([settings.run, parameters]))
    scenario = build(base, source, folder, changes)
    return Arm(labels, scenario, None, {}, digest([dump(scenario), scenario.map_digests()]))


def _design(settings: ExperimentSettings, source: str, quick: bool) -> DesignSettings:
    design = settings.design
    if not quick or settings.quick.points is None:
        return design
    plain = {"kind": design.kind, "points": settings.quick.points}
    return validated(DesignSettings, plain, f"{source}: quick")


def _combined(
    design: DesignSettings, axes: Sequence[Axis], base: Mapping[str, Any], seed: int, source: str
) -> tuple[tuple[Axis, ...], Iterable[tuple[tuple[Label, Any], ...]]]:
    """Return *axes* with the values that *design* gives them, and the combinations that are run, each once."""
    if design.kind in SAMPLED:
        drawn = points(design.kind, design.points or 0, len(axes), seed)
        rows = [tuple(_picked(axis, base, place) for axis, place in zip(axes, row, strict=True)) for row in drawn]
        axes = tuple(axis._replace(values=tuple(row[at] for row in rows)) for at, axis in enumerate(axes))
        return axes, {tuple(label for label, _ in row): row for row in rows}.values()
    for axis in axes:
        if axis.span is not None:
            raise UserError(f"{source}: sweep.{axis.name}: low and high are for a design that draws, not {design.kind}")
    if design.kind == "product":
        return tuple(axes), itertools.product(*(axis.values for axis in axes))
    first = tuple(axis.values[0] for axis in axes)
    others = [(*first[:at], value, *first[at + 1 :]) for at, axis in enumerate(axes) for value in axis.values[1:]]
    return tuple(axes), [first, *others]


def _picked(axis: Axis, base: Mapping[str, Any], place: float) -> tuple[Label, Any]:
    """Return the labelled value of *axis* at *place*, of [0, 1]."""
    if axis.span is None:
        return axis.values[min(int(place * len(axis.values)), len(axis.values) - 1)]
    value = axis.span._replace(whole=axis.span.whole and _is_whole(base, parse_place(axis.path or ""))).at(place)
    return value, value


def _is_whole(plain: Any, place: Place) -> bool:
    """Return whether the setting at *place* in *plain* is a whole number."""
    for step in place:
        inside = isinstance(plain, Mapping) and step in plain
        inside = inside or (isinstance(plain, list) and isinstance(step, int) and step < len(plain))
        if not inside:
            return False
        plain = plain[step]
    return isinstance(plain, int) and not isinstance(plain, bool)


def _refuse_unknown_axes(settings: ExperimentSettings, known: Collection[str], quick: bool, source: str) -> None:
    """Raise UserError if the report, or what cuts axes down if *quick*, names an axis that is none."""
    named = [(f"report.{key}: {name}", name) for key in ("x", "panel") if (name := getattr(settings.report, key))]
    named += [(f"quick.sweep.{name}", name) for name in settings.quick.sweep if quick]
    for place, name in named:
        if name not in known:
            raise UserError(f"{source}: {place}: there is no such axis{nearest(name, known)}")


def _axes(
    settings: ExperimentSettings,
    source: str,
    names: Mapping[str, str],
    quick: Mapping[str, Any],
    given: _Given,
) -> tuple[Axis, ...]:
    axes = []
    for key, axis in settings.sweep.items():
        name, place = names[key], parse_place(axis.path or "")
        if axis.path is not None and (not place or axis.path == "seed"):
            raise UserError(
                f"{source}: sweep.{key}.path: {axis.path!r} is not the path of a setting that can be an axis"
            )
        chosen = quick.get(name, axis.values)
        if isinstance(chosen, list) and isinstance(axis.values, dict):  # names of the full list
            chosen = {label: axis.values.get(label, label) for label in chosen}
        pairs = list(chosen.items()) if isinstance(chosen, dict) else [(value, value) for value in chosen or ()]
        if axis.path is None and not all(_are_settings(value) for _, value in pairs):
            raise UserError(f"{source}: quick.sweep.{name}: {_NO_SETTINGS}, or the names of such")
        one = [item.value for item in given.settings if axis.path is not None and item.place == place]
        left = [given.several[name]] if name in given.several else one
        pairs = [(_label(value, axis), value) for value in left[-1:]] or pairs
        axes.append(Axis(name, axis.path, tuple(pairs), None if pairs else _span(axis)))
    return tuple(axes)


def _span(axis: AxisSettings) -> Span:
    assert axis.low is not None
    assert axis.high is not None
    whole = isinstance(axis.low, int) and isinstance(axis.high, int)
    return Span(axis.low, axis.high, axis.log, whole)


def _label(value: Any, axis: AxisSettings) -> Label:
    """Return what *value* is called on *axis*: its name there, if it has one."""
    named = axis.values.items() if isinstance(axis.values, dict) else ()
    found: Label = next((label for label, other in named if other == value), value)
    return found if isinstance(found, Label) else str(found)


def _columns(sweep: Mapping[str, AxisSettings], source: str) -> dict[str, str]:
    """Return the column of every axis: its own name, or the last parts of its path that no other column has."""
    reserved = {field.name for field in FIXED}
    columns: dict[str, str] = {}
    for key in sweep:
        parts = [str(step) for step in parse_place(key)] or [key]
        names = ["_".join(parts[-count:]) for count in range(1, len(parts) + 1)]
        free = [name for name in names if name not in reserved and name not in columns.values()]
        if not free:
            raise UserError(f"{source}: sweep.{key}: the column {names[-1]} is taken, expected another name")
        columns[key] = free[0]
    return columns
