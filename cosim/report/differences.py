"""What differs between two sweeps, or between two arms of one: ``cosim compare``.

Runs of one seed see the same worlds, so that the differences are paired seed by seed where both sides have the seed:
the interval is that of the mean difference (``cosim.statistics.intervals.paired``), never two intervals side by side.
Sides without a common seed are compared as independent samples. What a run counts more than once counts with its mean.
``comparison`` has the tests of published claims about arms.
"""

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeAlias

import pandas as pd

from cosim.documents import nearest
from cosim.errors import UserError
from cosim.experiment import named
from cosim.parts import Parts
from cosim.report.figures_module import shortened
from cosim.results import FIXED, OBSERVATION_FIXED, RunStore, SweepDescription
from cosim.statistics.digits import digits
from cosim.statistics.intervals import CONFIDENCE, Estimate, bootstrapped, paired, unpaired

Changes: TypeAlias = dict[str, tuple[Any, Any]]
"""What both sides have instead of each other, by name."""
NONE: Final = "-"
"""What a side has that has nothing of a name."""
_NO_METRICS: Final = {field.name for field in (*FIXED, *OBSERVATION_FIXED)}
_SCENARIO: Final = "scenario"
"""The metadata of a part that hold the settings before any axis, as JSON; the others tell of code and libraries."""


class Effect(NamedTuple):
    """How one metric differs in one arm: the mean of both sides, and of the second less the first."""

    arm: str
    metric: str
    first: float
    second: float
    effect: Estimate
    correlation: float
    """Of both sides over the seeds, NaN if they are not paired or one is constant."""
    seeds: int
    """How many seeds both have; 0 if they are not paired."""

    @property
    def is_apart(self) -> bool:
        """True if the interval leaves 0 out."""
        return self.effect.low > 0 or self.effect.high < 0

    def row(self) -> dict[str, Any]:
        """Return the effect as a row of the table."""
        relative = 100 * self.effect.mean / abs(self.first) if self.first else math.nan
        interval = f"{digits(self.effect.low, 3)} to {digits(self.effect.high, 3)}" if self.effect.known else NONE
        return {
            "arm": self.arm or NONE,
            "metric": self.metric,
            "A": digits(self.first, 4),
            "B": digits(self.second, 4),
            "B - A": digits(self.effect.mean, 4),
            "95 % interval": interval + (" *" if self.is_apart else ""),
            "%": NONE if math.isnan(relative) else digits(relative, 3),
            "correlation": NONE if math.isnan(self.correlation) else f"{self.correlation:.2f}",
            "seeds": self.seeds or "not paired",
        }


@dataclass
class Comparison:
    """What differs between two sides: means, settings, code, and what only one of them has."""

    first: str
    second: str
    effects: list[Effect] = field(default_factory=list)
    compared: int = 0
    """Means of both sides that were compared; those without an effect have the same value for every common seed."""
    settings: Changes = field(default_factory=dict)
    code: Changes = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def text(self) -> str:
        """Return the comparison for a terminal."""
        parts = [f"A: {self.first}\nB: {self.second}", self._summary()]
        if self.effects:
            parts.append(pd.DataFrame([each.row() for each in self.effects]).to_string(index=False))
        for title, changes in (("settings", self.settings), ("code and libraries", self.code)):
            if changes:
                rows = [f"  {name}: {shortened(a)} | {shortened(b)}" for name, (a, b) in changes.items()]
                parts.append("\n".join([f"{title} that differ, A | B", *rows]))
        parts += ["\n".join(self.notes)] if self.notes else []
        return "\n\n".join(parts)

    def _summary(self) -> str:
        if not self.effects:
            rest = [name for name, found in (("settings", self.settings), ("code", self.code)) if not found]
            also = f"; {' and '.join(rest)} are the same too" if rest else ""
            return f"nothing differs in {self.compared} means: every value of a common seed is the same{also}"
        apart = sum(each.is_apart for each in self.effects)
        return (
            f"of {self.compared} means {len(self.effects)} differ; the interval (*) of {apart} leaves 0 out, "
            f"which chance alone does in {(1 - CONFIDENCE) * len(self.effects):.2g} if nothing differs but by chance"
        )

    def plain(self) -> dict[str, Any]:
        """Return the comparison as plain data."""
        return {
            "first": self.first,
            "second": self.second,
            "compared": self.compared,
            "effects": [
                each._asdict() | {"effect": each.effect._asdict(), "is_apart": each.is_apart} for each in self.effects
            ],
            "settings": {name: list(both) for name, both in self.settings.items()},
            "code": {name: list(both) for name, both in self.code.items()},
            "notes": self.notes,
        }


@dataclass
class _Side:
    """Runs and observations of one side, and where they come from."""

    name: str
    told: SweepDescription
    metadata: dict[str, str]
    tables: tuple[pd.DataFrame, pd.DataFrame]
    labels: dict[str, str] = field(default_factory=dict)
    """The values of axes that make the arm, if the side is one."""

    @property
    def axes(self) -> list[str]:
        return [axis for axis in self.told.axes if axis not in self.labels]

    def settings(self) -> dict[str, Any]:
        """Return the settings before any axis by their paths, and the axes' values of an arm."""
        return dict(_leaves(json.loads(self.metadata.get(_SCENARIO, "{}")))) | self.labels

    def code(self) -> dict[str, str]:
        rest = {name: value for name, value in self.metadata.items() if name not in (_SCENARIO, "experiment")}
        return {"digest of the sources": self.told.code} | rest


def compare(first: Path, second: Path | None = None, arms: Sequence[str] = (), bootstrap: bool = False) -> Comparison:
    """Compare the last sweeps into two folders, or two *arms* of one: ``axis=value``, or several with commas between.

    With *bootstrap* the intervals are those of the BCa bootstrap. Raise UserError for what cannot be compared.
    """
    if second is not None and arms:
        raise UserError("--arm is for two arms of one folder, expected either two folders or one with two --arm")
    if second is None:
        if len(arms) != 2:
            raise UserError(f"{first}: expected another folder to compare with, or two --arm axis=value")
        whole = _side(first)
        return _compared(_arm(whole, arms[0]), _arm(whole, arms[1]), bootstrap)
    return _compared(_side(first), _side(second), bootstrap)


def _side(folder: Path) -> _Side:
    store = RunStore(folder)
    runs = store.present()
    done = runs[runs["status"] == "done"]
    told = store.description()
    return _Side(
        str(folder), told, _metadata(folder, {*told.codes, *told.accepted}), (done, store.present("observations"))
    )


def _metadata(folder: Path, codes: set[str]) -> dict[str, str]:
    """Return what the newest part of the runs that one of *codes* has made tells of its making."""
    parts = Parts(folder)
    return parts.steady(lambda: _metadata_of(parts, codes))


def _metadata_of(parts: Parts, codes: set[str]) -> dict[str, str]:
    for part in reversed(parts.whole_of("runs")):
        table = parts.read(part)
        if codes.intersection(table["code"].to_pylist()):
            metadata = table.schema.metadata or {}
            return {key.decode(): value.decode() for key, value in metadata.items() if not key.startswith(b"ARROW")}
    return {}


def _arm(whole: _Side, text: str) -> _Side:
    """Return the arm of *whole* that *text* names; raise UserError if there is none."""
    labels = dict(each.partition("=")[::2] for each in text.split(","))
    for axis in labels:
        if axis not in whole.told.axes:
            raise UserError(f"--arm {text}: there is no axis {axis}{nearest(axis, whole.told.axes)}")
    tables = [frame[_matches(frame, labels)] for frame in whole.tables]
    if all(table.empty for table in tables):
        raise UserError(f"--arm {text}: {whole.name} has no runs of it")
    return _Side(f"{whole.name} with {named(labels)}", whole.told, whole.metadata, (tables[0], tables[1]), labels)


def _matches(frame: pd.DataFrame, labels: Mapping[str, str]) -> "pd.Series[bool]":
    chosen = pd.Series(True, index=frame.index)
    for axis, label in labels.items():
        chosen &= frame[axis].astype(str) == label if axis in frame else False
    return chosen


def _leaves(plain: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the values in *plain* by their paths."""
    if isinstance(plain, dict) and plain:
        for key, inner in plain.items():
            yield from _leaves(inner, f"{path}.{key}" if path else str(key))
    elif isinstance(plain, list) and any(isinstance(each, dict | list) for each in plain):
        for number, inner in enumerate(plain):
            yield from _leaves(inner, f"{path}[{number}]")
    else:
        yield path, plain


# ---------------------------------------------------------------- two sides


def _compared(one: _Side, other: _Side, bootstrap: bool) -> Comparison:
    made = Comparison(one.name, other.name)
    made.settings, made.code = _changes(one.settings(), other.settings()), _changes(one.code(), other.code())
    keys = [axis for axis in one.axes if axis in other.axes and _share_values(one, other, axis)]
    for axis in {*one.axes, *other.axes} - {*keys}:
        made.settings[f"sweep.{axis}"] = (_values(one, axis), _values(other, axis))
    seeds = [{seed for table in side.tables for seed in table["seed"]} for side in (one, other)]
    if seeds[0] != seeds[1]:
        common = len(seeds[0] & seeds[1])
        made.notes.append(f"A has {len(seeds[0])} seeds, B {len(seeds[1])}; {common} of them are common")
    for ours, theirs in zip(one.tables, other.tables, strict=True):
        _compare_tables(made, ours, theirs, keys, bootstrap, strangers={*one.told.axes, *other.told.axes})
    if not made.compared:
        raise UserError(f"{one.name} and {other.name} have no arm and metric in common")
    return made


def _changes(one: Mapping[str, Any], other: Mapping[str, Any]) -> Changes:
    names = dict.fromkeys([*one, *other])
    return {name: (one.get(name, NONE), other.get(name, NONE)) for name in names if one.get(name) != other.get(name)}


def _share_values(one: _Side, other: _Side, axis: str) -> bool:
    return bool({*one.told.axes[axis].values} & {*other.told.axes[axis].values})


def _values(side: _Side, axis: str) -> str:
    return ", ".join(map(str, side.told.axes[axis].values)) if axis in side.axes else NONE


def _compare_tables(
    made: Comparison, one: pd.DataFrame, other: pd.DataFrame, keys: Sequence[str], bootstrap: bool, strangers: set[str]
) -> None:
    """Add to *made* the effects of all metrics in both tables, by the arms that the columns *keys* tell apart."""
    ours, theirs = (_metrics(each, strangers) for each in (one, other))
    alone = [name for name in dict.fromkeys([*ours, *theirs]) if (name in ours) != (name in theirs)]
    if alone and not one.empty and not other.empty:
        made.notes.append(f"only one of them has {', '.join(alone)}")
    metrics = [name for name in ours if name in theirs]
    arms, others = _by_arm(one, keys), _by_arm(other, keys)
    missing = [_called(keys, arm) for arm in dict.fromkeys([*arms, *others]) if (arm in arms) != (arm in others)]
    if missing:
        made.notes.append(f"only one of them has runs of {'; '.join(missing[:10])}{' ...' if missing[10:] else ''}")
    common = [arm for arm in arms if arm in others]
    made.compared += len(common) * len(metrics)
    for arm in common:
        samples = [table[arm].groupby("seed")[metrics].mean() for table in (arms, others)]
        if samples[0].equals(samples[1]):
            continue
        effects = (_effect(_called(keys, arm), name, samples[0][name], samples[1][name], bootstrap) for name in metrics)
        made.effects += [effect for effect in effects if effect]


def _metrics(frame: pd.DataFrame, strangers: Iterable[str]) -> list[str]:
    without = {*strangers, *_NO_METRICS}
    return [str(column) for column in frame.select_dtypes(["number", "bool"]).columns if column not in without]


def _by_arm(frame: pd.DataFrame, keys: Sequence[str]) -> dict[tuple[Any, ...], pd.DataFrame]:
    if frame.empty:
        return {}
    return dict(iter(frame.groupby(list(keys), sort=False))) if keys else {(): frame}


def _called(keys: Sequence[str], arm: Sequence[Any]) -> str:
    return named(dict(zip(keys, arm, strict=True)))


def _effect(
    arm: str, metric: str, one: "pd.Series[float]", other: "pd.Series[float]", bootstrap: bool
) -> Effect | None:
    """Return how *other* differs from *one*, values by seed; None if those of common seeds are the same."""
    common = pd.concat([one, other], axis=1, join="inner", keys=["first", "second"])
    if len(common) and common["first"].equals(common["second"].rename("first")):
        return None
    both = common.dropna()
    if both.empty:
        return Effect(arm, metric, one.mean(), other.mean(), unpaired(one, other), math.nan, 0)
    first, second = both.iloc[:, 0].to_numpy(dtype=float), both.iloc[:, 1].to_numpy(dtype=float)
    found = paired(first, second)
    mean = bootstrapped(second - first) if bootstrap else found.mean
    return Effect(arm, metric, float(first.mean()), float(second.mean()), mean, found.correlation, len(both))
