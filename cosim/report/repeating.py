"""The command that makes a sweep again, found by trying: it would make the same runs, setting by setting."""

import os
import shlex
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from cosim.documents import Place, show_place
from cosim.errors import UserError
from cosim.experiment import Experiment, experiment_folders, load_experiment
from cosim.results import SweepDescription


def sweep_command(sweep: SweepDescription, base: Mapping[str, Any] | None, folder: Path) -> str | None:
    """Return the command of *sweep* into *folder*; *base* is its scenario before the axes, if that is known.

    Return None if no command makes these runs: the experiment's files have changed since, or are not there.
    """
    installed = experiment_folders().get(sweep.experiment)
    places = {sweep.experiment: installed / "sweep.yaml"} if installed else {}
    found: list[list[str]] = []
    for name, path in (places | {os.path.relpath(sweep.source): Path(sweep.source)}).items():
        for quick in (False, True):
            words = _words(sweep, base, path, quick)
            if words is not None:
                found.append(["cosim", "sweep", name, *words, *_place(sweep, folder, quick)])
        if found:
            shortest = min(found, key=len)
            return shlex.join(shortest)
    return None


def _words(sweep: SweepDescription, base: Mapping[str, Any] | None, path: Path, quick: bool) -> list[str] | None:
    """Return the options with which the experiment in *path* is *sweep*; None if there are none."""
    try:
        plain = load_experiment(path, (), quick)
        sets = [*_changed(plain.base, base or plain.base), *_left(plain, sweep)]
        found = load_experiment(path, sets, quick, sweep.replicates) if sets else plain
    except UserError:
        return None
    if tuple(arm.configuration for arm in found.arms) != sweep.configurations:
        return None
    words = ["--quick"] if quick else []
    words += ["--replicates", str(sweep.replicates)] if plain.replicates != sweep.replicates else []
    return [*words, *(word for each in sets for word in ("--set", each))]


def _changed(ours: Any, theirs: Any, place: Place = ()) -> Iterator[str]:
    """Yield the assignments PATH=VALUE that make *theirs* of *ours*."""
    if ours == theirs:
        return
    if isinstance(ours, Mapping) and isinstance(theirs, Mapping) and ours.keys() == theirs.keys():
        for key in ours:
            yield from _changed(ours[key], theirs[key], (*place, key))
    elif place:
        yield f"{show_place(place)}={_flow(theirs)}"


def _left(plain: Experiment, sweep: SweepDescription) -> Sequence[str]:
    """Return the assignments that leave one value on axes of which *sweep* has one only."""
    return [
        f"{axis.name}={_flow(sweep.axes[axis.name].values[0])}"
        for axis in plain.axes
        if axis.name in sweep.axes and len(sweep.axes[axis.name].values) == 1 and len(axis.values) > 1
    ]


def _flow(value: Any) -> str:
    return yaml.safe_dump(value, default_flow_style=True, width=10**9).removesuffix("...\n").strip()


def _place(sweep: SweepDescription, folder: Path, quick: bool) -> list[str]:
    usual = Path("results") / (f"{sweep.experiment}-quick" if quick else sweep.experiment)
    return [] if folder == usual else ["-o", str(folder)]
