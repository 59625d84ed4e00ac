"""What is found by name: entry points of packages that are installed, and modules that stand where the user stands.

The packages ``protocols`` and ``experiments`` are ours, and users have folders called so. Ours extend their paths, so
that both are found. But a script of the user's, or ``python -m``, looks in the user's folder first: there a package
with an ``__init__.py`` hides ours. And on the command line, which looks there last, what stands in such a folder may
have the name of something of ours. Then an error says which file hides which.
"""

import shlex
import sys
from collections.abc import Iterable
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path
from pkgutil import get_importer
from typing import Any, NamedTuple, TypeVar

from cosim.errors import UserError

T = TypeVar("T")
OURS = Path(__file__).parents[1]
"""The folder that cosim is installed in."""


class Hiding(NamedTuple):
    """Two files, or folders, of one name, of which Python finds the first."""

    first: Path
    second: Path

    def __str__(self) -> str:
        """Return one line with the way out."""
        told = f"{_shown(self.first)} hides {_shown(self.second)}"
        if self.second.is_relative_to(OURS) and not self.first.is_relative_to(OURS):
            return f"{told}: rename the first, or delete it if it is an empty __init__.py, or start python with -P"
        return f"{told}: rename the second"


def _shown(path: Path) -> str:
    return f"cosim's own {path.relative_to(OURS)}" if path.is_relative_to(OURS) else str(path)


def find_named(text: str) -> Any:
    """Return what ``module:name`` means.

    Raise ImportError, in one line, if it is not there, or if it hides a module of that name in the working directory:
    then who says so means the other.
    """
    module, _, name = text.partition(":")
    try:
        found = getattr(import_module(module), name)
    except (ImportError, AttributeError, ValueError) as error:
        raise ImportError(str(hiding(module) or error)) from None
    hidden = hiding(module)
    if hidden is not None and hidden.second.is_relative_to(Path.cwd()) and not hidden.second.is_relative_to(OURS):
        raise ImportError(str(hidden))
    return found


def loaded(point: EntryPoint) -> Any:
    """Return what *point* names; raise ImportError, in one line, if it is not there."""
    try:
        return point.load()
    except (ImportError, AttributeError) as error:
        raise ImportError(str(hiding(point.module) or error)) from None


@cache  # reading the metadata of all packages takes longer than validating a scenario
def _points(group: str) -> dict[str, EntryPoint]:
    return {point.name: point for point in entry_points(group=group)}


def installed_names(group: str) -> list[str]:
    """Return the names of the entry points of *group*, sorted; load none of them."""
    return sorted(_points(group))


def module_of(group: str, name: str) -> str:
    """Return the module that *name*, an entry point of *group* or ``module:name``, leads to; load nothing."""
    return name.partition(":")[0] if ":" in name else _points(group)[name].module


def find_installed(group: str, name: str, kind: type[T], what: str) -> T:
    """Return the *kind* that *name* leads to: an entry point of *group*, or ``module:name``. *what* it is called.

    Raise ValueError, which does not repeat *name*, if it leads nowhere, or to something else.
    """
    named = isinstance(name, str)
    if not named or (":" not in name and name not in _points(group)):
        raise ValueError(f"is not a {what}: expected one of {', '.join(installed_names(group))}, or module:name")
    try:
        found = find_named(name) if ":" in name else loaded(_points(group)[name])
    except ImportError as error:
        raise ValueError(f"is not a {what}: {error}") from None
    if not isinstance(found, kind):
        raise ValueError(f"is not a {what}: a {type(found).__name__}, expected a {kind.__name__}")
    return found


def installed_folders(group: str) -> dict[str, Path]:
    """Return the folders of the packages that the entry points of *group* name, by these, sorted.

    Raise UserError if the user's own folder hides one.
    """
    found = {}
    for point in sorted(entry_points(group=group), key=lambda point: point.name):
        try:
            spec = find_spec(point.value)
        except ModuleNotFoundError:  # what stands above it is no package
            spec = None
        for location in (spec.submodule_search_locations or ()) if spec else ():
            found[point.name] = Path(location)
        if spec is None and (hidden := hiding(point.value)) is not None:
            raise UserError(str(hidden))
    return found


def check_libraries(user: str, requirements: Iterable[str]) -> None:
    """Raise UserError, with the way to get them, if libraries that *user* needs are not installed.

    *requirements* are those of an extra of pyproject.toml, such as ``uvicorn>=0.52.1``.
    """
    missing = [each for each in requirements if find_spec(each.partition(">=")[0]) is None]
    if missing:
        raise UserError(f"{user} need what is not installed here: pip install {shlex.join(missing)}")


def hiding(module: str) -> Hiding | None:
    """Return what hides another module of the dotted name *module*, or a package above it; None if nothing does."""
    parts = module.split(".")
    places: Iterable[str] = sys.path
    for depth, name in enumerate(parts, start=1):
        offers = _offers(name, places)
        if not offers:
            return None
        package = sys.modules.get(".".join(parts[:depth]))
        first = Path(getattr(package, "__file__", None) or offers[0])
        places = getattr(package, "__path__", [str(_folder(first))])
        searched = {Path(place) for place in places} if depth < len(parts) else set()
        for other in offers:
            if other != first and _folder(other) not in searched and _holds(_folder(other), parts[depth:]):
                return Hiding(first, other)
    return None


def _offers(name: str, places: Iterable[str]) -> list[Path]:
    """Return the files and the folders without an ``__init__.py`` that are called *name*, as Python prefers them."""
    regular, folders = [], []
    for place in dict.fromkeys(places):
        finder = get_importer(place)
        spec = finder.find_spec(name) if finder is not None and hasattr(finder, "find_spec") else None
        if spec is not None and spec.origin is not None:
            regular.append(Path(spec.origin))
        elif spec is not None:
            folders += [Path(location) for location in spec.submodule_search_locations or ()]
    return regular + folders


def _holds(folder: Path, parts: list[str]) -> bool:
    """Return whether the module called *parts* stands in *folder*."""
    for name in parts:
        offers = _offers(name, [str(folder)])
        if not offers:
            return False
        folder = _folder(offers[0])
    return True


def _folder(offer: Path) -> Path:
    """Return the folder that *offer* has its modules in, if it is a package."""
    return offer.parent if offer.name == "__init__.py" else offer
