"""Where results come from: the sources that decide a run, and the versions of the libraries that compute it.

What decides a run is the static closure of imports of the modules that it begins in: whatever they import anywhere, in
functions too, and what these import, as far as it is ours or the user's own. Of each module the syntax tree counts,
without docstrings: a comment, a docstring or a line break changes no result, and so not the digest. The data files that
lie in the packages of these modules, such as plays and floors, count by their bytes. Of all other libraries that are
imported the versions count.
"""

import ast
import hashlib
import importlib.util
import json
import os
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, packages_distributions, version
from pathlib import Path
from types import ModuleType
from typing import Any, Final, NamedTuple
from weakref import WeakKeyDictionary

from cosim.caches import begin, cache_folder, sources_digest
from cosim.errors import UserError

DATA: Final = frozenset(
    f".{ending}"
    for ending in ["yaml", "yml", "json", "toml", "csv", "txt", "npy", "npz", "map", "pgm", "ppm", "png", "parquet"]
)
"""Endings of the data files of a package that may decide a run."""
NOT_DATA: Final = frozenset({"published.csv", "sweep.yaml", "verdicts.csv", "variations.csv", "decides.csv"})
"""Files with such an ending that no run reads: what a paper printed and became of it, what a sweep is (settings are in
the key)."""
NOT_COMPUTING: Final = frozenset(
    ["click", "matplotlib", "PIL", "pyarrow", "pytest", "rich", "starlette", "uvicorn", "yaml"]
)
"""Top-level modules of libraries that only read, write or show what others compute."""
_INSTALLED: Final = ("site-packages", "dist-packages")


class Origin(NamedTuple):
    """What decides a run beside its settings."""

    code: str
    """SHA-256 of the syntax trees, of the data files and of ``libraries``."""
    libraries: str
    """Names and versions of the libraries that compute, such as ``numba 0.68.1, numpy 2.4.6``."""
    parts: tuple[tuple[str, str], ...]
    """The digest of each module and of each data file by its name, sorted."""


def origin(modules: Iterable[str], folders: Iterable[Path] = ()) -> Origin:
    """Return what decides a run that begins in *modules*, all data files in *folders* included.

    Raise UserError for a module that was edited after this process had loaded it: what it computes is the old one's.
    """
    sources, libraries = _closure(frozenset(modules))
    parts = {name: _read(path).digest for name, path in sources.items()}
    for name in parts.keys() & sys.modules.keys():
        if _loaded.setdefault(sys.modules[name], parts[name]) != parts[name]:
            raise UserError(f"{sources[name]}: was edited after this process had loaded it: start it anew")
    for name, path in (
        *_data_files(sources),
        *((f"{folder.name}/{at.relative_to(folder).as_posix()}", at) for folder in folders for at in _files(folder)),
    ):
        parts[name] = hashlib.sha256(path.read_bytes()).hexdigest()
    listed = tuple(sorted(parts.items()))
    _keep_digests()
    text = "".join(f"{name}\0{digest}\0" for name, digest in listed)
    return Origin(hashlib.sha256(f"{text}{libraries}".encode()).hexdigest(), libraries, listed)


def differing(ours: Origin, theirs: Origin) -> list[str]:
    """Return the names of the modules, data files and libraries that are not the same in both."""
    mine = dict(ours.parts) | dict.fromkeys(ours.libraries.split(", "), "")
    yours = dict(theirs.parts) | dict.fromkeys(theirs.libraries.split(", "), "")
    return sorted(name for name in mine.keys() | yours.keys() if mine.get(name) != yours.get(name))


# ---------------------------------------------------------------- imports


def closure(modules: Iterable[str]) -> dict[str, Path]:
    """Return the files of *modules* and of all that they import of ours or of the user's own, by module name."""
    return _closure(frozenset(modules))[0]


def _closure(modules: frozenset[str]) -> tuple[dict[str, Path], str]:
    """Return what ``closure`` does, and the versions of the libraries that these import."""
    for kept in (_place, _is_own):  # what is found where may have changed since
        kept.cache_clear()
    own = frozenset(name.partition(".")[0] for name in modules)
    found: dict[str, Path] = {}
    foreign: set[str] = set()
    new = {name for module in modules for name in _with_parents(module)}
    while new:
        sources = {name: path for name in new if (path := _source(name, own)) is not None}
        foreign |= {first for name in new - sources.keys() if not _is_own(first := name.partition(".")[0], own)}
        found |= sources
        imported = {name for called, path in sources.items() for name in _imported(called, path)}
        new = {each for name in imported for each in _with_parents(name)} - found.keys()
        new = {name for name in new if _is_own(name.partition(".")[0], own) or name not in foreign}
    computing = foreign - NOT_COMPUTING - sys.stdlib_module_names
    return found, ", ".join(sorted(filter(None, map(_library, computing))))


def _with_parents(module: str) -> list[str]:
    """Return the packages that *module* lies in, and itself: importing it runs all of them."""
    parts = module.split(".")
    return [".".join(parts[: count + 1]) for count in range(len(parts))]


def _source(name: str, own: frozenset[str]) -> Path | None:
    """Return the file of the module *name*, if it is ours or the user's own; None if it is not, or no module."""
    first, *below = name.split(".")
    if not _is_own(first, own):
        return None
    origin, places = _place(first)
    if not below:
        return origin
    for place in places:
        at = os.path.join(place, *below)  # plain text: a thousand names are looked up for every sweep
        for path in (os.path.join(at, "__init__.py"), f"{at}.py"):
            if os.path.isfile(path):
                return Path(path)
    return None


@cache
def _is_own(first: str, own: frozenset[str]) -> bool:
    """Return whether the top-level module *first* is ours or the user's own: not Python's, and not installed."""
    if first in own:
        return True
    if first in sys.stdlib_module_names:
        return False
    origin, places = _place(first)
    paths = [path for path in (origin, *places) if path is not None]
    return bool(paths) and not any(name in path.parts for path in paths for name in _INSTALLED)


@cache
def _place(first: str) -> tuple[Path | None, tuple[Path, ...]]:
    """Return the file of the top-level module *first*, if it has one, and the folders of its modules, if it has any."""
    loaded = sys.modules.get(first)
    spec = getattr(loaded, "__spec__", None)
    if spec is None:
        with suppress(ImportError, ValueError):
            spec = importlib.util.find_spec(first)
    if spec is None:
        return None, ()
    places = getattr(loaded, "__path__", None) or spec.submodule_search_locations or ()  # ours extend their paths
    has_source = spec.origin is not None and spec.origin.endswith(".py")
    return (Path(spec.origin) if has_source and spec.origin else None), tuple(map(Path, places))


def _imported(module: str, path: Path) -> Iterator[str]:
    """Yield the names of all that may be modules among what *module*, in the file *path*, imports."""
    package = module if path.name == "__init__.py" else module.rpartition(".")[0]
    for origin, level, names in _read(path).imports:
        base = origin
        if level:
            above = package.split(".")[: len(package.split(".")) - level + 1]
            base = ".".join([*above, *filter(None, [origin])])
        yield base
        yield from (f"{base}.{name}" for name in names)


@cache
def _library(first: str) -> str:
    """Return name and version of the library that the top-level module *first* belongs to; empty if unknown."""
    with suppress(PackageNotFoundError):
        return f"{first} {version(first)}"
    for name in packages_distributions().get(first, ()):
        return f"{name} {version(name)}"
    return ""


# ---------------------------------------------------------------- one file


class _Source(NamedTuple):
    """What counts of a source file."""

    digest: str
    """Of its syntax tree, without docstrings."""
    imports: tuple[tuple[str, int, tuple[str, ...]], ...]
    """The module, the number of leading dots, and the names of each import."""


# the digest of the source of each module that this process has loaded, when it was first asked for
_loaded: "WeakKeyDictionary[ModuleType, str]" = WeakKeyDictionary()
_known: dict[str, _Source] = {}  # by the SHA-256 of a file: reading 150 syntax trees takes a second
_new: set[str] = set()


def _read(path: Path) -> _Source:
    content = path.read_bytes()
    name = hashlib.sha256(content).hexdigest()
    if not _known:
        _known.update(_kept_digests())
    if name not in _known:
        _known[name] = _parsed(content)
        _new.add(name)
    return _known[name]


def _parsed(content: bytes) -> _Source:
    tree = ast.parse(content)
    imports: list[tuple[str, int, tuple[str, ...]]] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            imports += [(alias.name, 0, ()) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            imports.append((node.module or "", node.level, tuple(alias.name for alias in node.names)))
        elif isinstance(body := getattr(node, "body", None), list):
            body[:] = [each for each in body if not _is_text(each)]
    return _Source(hashlib.sha256(_dumped(tree).encode()).hexdigest(), tuple(dict.fromkeys(imports)))


def _dumped(node: Any) -> str:
    """Return *node* of a syntax tree as a text that is the same on all Pythons: later ones have more empty fields."""
    if isinstance(node, ast.AST):
        fields = (f"{name}={_dumped(value)}" for name, value in ast.iter_fields(node) if value not in (None, []))
        return f"{type(node).__name__}({','.join(fields)})"
    if isinstance(node, list):
        return f"[{','.join(map(_dumped, node))}]"
    return repr(node)


def _is_text(node: ast.stmt) -> bool:
    """Return whether *node* is a docstring: also one of a constant or of a field."""
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def _kept() -> Path:
    """Return the file that keeps what was read."""
    return cache_folder(__name__, sources_digest(__name__, Path(__file__))) / "digests.json"


def _kept_digests() -> dict[str, _Source]:
    try:
        plain = json.loads(_kept().read_text(encoding="utf-8"))
        return {
            name: _Source(digest, tuple((origin, level, tuple(names)) for origin, level, names in imports))
            for name, (digest, imports) in plain.items()
        }
    except (OSError, ValueError, TypeError, AttributeError):  # none yet, or another program's
        return {}


def _keep_digests() -> None:
    if not _new:
        return
    with suppress(OSError):  # the next process reads the trees again
        begin(_kept().parent)
        draft = _kept().with_suffix(f".{os.getpid()}")
        draft.write_text(json.dumps(_known), encoding="utf-8")
        draft.replace(_kept())
    _new.clear()


# ---------------------------------------------------------------- data


def _data_files(sources: Mapping[str, Path]) -> Iterator[tuple[str, Path]]:
    """Yield the data files in the packages that *sources* lie in, each with a name of its own."""
    packages = {name if path.name == "__init__.py" else name.rpartition(".")[0]: path for name, path in sources.items()}
    for package, path in packages.items():
        for at in _files(path.parent) if package else ():
            yield f"{package}/{at.relative_to(path.parent).as_posix()}", at


def _files(folder: Path) -> Iterator[Path]:
    """Yield the data files in *folder*, and in those folders in it that are no packages."""
    for path in sorted(folder.iterdir()):
        if path.name.startswith((".", "__pycache__")):
            continue
        if path.is_dir():
            if not any(path.glob("*.py")):
                yield from _files(path)
        elif path.suffix in DATA and path.name not in NOT_DATA:
            yield path
