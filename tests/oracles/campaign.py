"""Random cases for the oracles: where numbers come from, outages and noise near frames, planted faults.

A case is drawn from a ``Choice``, of hypothesis (which shrinks what it finds) or of a seeded generator
(which is quick).
"""

import ast
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from math import inf
from pathlib import Path
from types import ModuleType
from typing import Any, Protocol, TypeVar

import numpy as np
import pytest
from hypothesis import strategies as st

from tests.mutants import uncompiled
from tests.oracles.band_air import Jammer, Matrix, Radio
from tests.oracles.band_scene import Seen

Item = TypeVar("Item")
PACKAGE = "cosim.channels.bluetooth"


class Choice(Protocol):
    """A source of integers."""

    def integer(self, low: int, high: int) -> int:
        """Return an integer in [low, high]."""


class Seeded:
    """Integers of a seeded generator."""

    def __init__(self, *seed: int) -> None:
        self._random = np.random.default_rng(seed)

    def integer(self, low: int, high: int) -> int:
        return int(self._random.integers(low, high, endpoint=True))


class Drawn:
    """Integers of hypothesis."""

    def __init__(self, data: st.DataObject) -> None:
        self._data = data

    def integer(self, low: int, high: int) -> int:
        return self._data.draw(st.integers(low, high))


def pick(choice: Choice, items: Sequence[Item]) -> Item:
    return items[choice.integer(0, len(items) - 1)]


def chance(choice: Choice, one_in: int) -> bool:
    return choice.integer(1, one_in) == 1


def nudge(choice: Choice) -> int:
    """Return nothing, one nanosecond more or less, or a little."""
    return pick(choice, (-1, 0, 0, 1, choice.integer(-2_000, 2_000)))


@dataclass(frozen=True)
class Outages:
    """Who does not hear whom and when: rows (transmitter, receiver, from, until), the end not included."""

    rows: tuple[tuple[int, int, int, int], ...] = ()

    def reach(self, source: int, destination: int, time: int) -> bool:
        return not any(a == source and b == destination and s <= time < e for a, b, s, e in self.rows)

    def radio(self, size: int, noise: Sequence[Jammer] = ()) -> Radio:
        """Return the powers between *size* devices, all equal but for the outages; *noise* reaches everyone as well."""
        edges = sorted({0, *(edge for row in self.rows for edge in row[2:] if edge > 0)})
        return Radio(tuple((time, self._powers(size, len(noise), time)) for time in edges), jammers=tuple(noise))

    def _powers(self, size: int, strangers: int, time: int) -> Matrix:
        rows = [
            tuple(0.0 if source != to and self.reach(source, to, time) else -inf for to in range(size))
            for source in range(size)
        ]
        return (*rows, *(((0.0,) * size,) * strangers))


CLEAR = Outages()


def draw_outages(choice: Choice, frames: Sequence[Seen], lengths: Sequence[int] = (1_250_000,)) -> Outages:
    """Draw outages that begin or end within a nanosecond of the starts of *frames*."""
    rows = []
    for _ in range(choice.integer(1, 3)):
        frame = pick(choice, frames)
        length = pick(choice, (1, 2, *lengths, choice.integer(1, 3_000_000), choice.integer(1, 50_000_000)))
        begin = frame.start + pick(choice, (-1, 0, 1))
        if chance(choice, 3):
            begin -= length
        rows.append((frame.source, frame.destination, begin, begin + length))
    return Outages(tuple(rows))


def draw_noise(choice: Choice, frames: Sequence[Seen]) -> tuple[Jammer, ...]:
    """Draw jammers that just touch, or just miss, some of *frames* on their channels."""
    noise = []
    for _ in range(choice.integer(1, 3)):
        frame = pick(choice, frames)
        length = pick(choice, (68_000, 366_000, 2_870_000))
        edges = (-length, -length + 1, 0, 67_999, 68_000, 71_999, 72_000, frame.duration - 1, frame.duration)
        begin = frame.start + pick(choice, edges)
        if begin >= 0:
            noise.append(Jammer("constant", begin, begin + length, (frame.channel,)))
    return tuple(noise)


def plant(monkeypatch: pytest.MonkeyPatch, module: str, old: str, new: str) -> ModuleType:
    """Load *module* of the Bluetooth channel afresh with *old* replaced by *new* in its source, and all that import it.

    Return the one with the channel. Compiled functions of these modules become plain Python.
    """
    package: Any = import_module(PACKAGE)
    for name in _importers(module):
        original = import_module(f"{PACKAGE}.{name}")
        source = Path(str(original.__file__)).read_text(encoding="utf-8")
        if name == module:
            assert source.count(old) == 1, f"{name}.py has {source.count(old)} of {old!r}, to plant a fault at"
            source = source.replace(old, new)
        source = source.replace("from cosim.jit import COMPILES, njit\n", "COMPILES = False\n")
        loaded = ModuleType(original.__name__)
        monkeypatch.setitem(sys.modules, original.__name__, loaded)
        monkeypatch.setattr(package, name, loaded)
        code = compile(uncompiled(source), str(original.__file__), "exec")
        exec(code, loaded.__dict__)
    return sys.modules[f"{PACKAGE}.device"]


@cache
def _importers(module: str) -> list[str]:
    """Return *module* and all modules of its package that import it, at first hand or not, in an order to load them."""
    folder = Path(str(import_module(f"{PACKAGE}.device").__file__)).parent
    imports = {path.stem: _imports(path) for path in folder.glob("*.py")}
    order: list[str] = []

    def visit(name: str) -> None:
        if name not in order:
            for other in sorted(imports[name] & imports.keys()):
                visit(other)
            order.append(name)

    visit("device")
    concerned = {module}
    for name in order:
        if imports[name] & concerned:
            concerned.add(name)
    return [name for name in order if name in concerned]


def _imports(path: Path) -> set[str]:
    """Return the modules of the package that the file at *path* imports from, or imports."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module == PACKAGE:
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and node.module.startswith(f"{PACKAGE}."):
            found.add(node.module.removeprefix(f"{PACKAGE}."))
    return found
