"""Folders of what was computed from sources, which are never taken for what other sources would give.

A folder is named by a module and a digest of the module and of all that it imports of ours or of its own, directly or
not: an edit of any of these begins another folder, an edit of anything else none. Of each module the few folders that
were used last are kept: as many versions of a source as one goes back and forth between.
"""

import hashlib
import os
import re
import shutil
import tempfile
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Final

__all__ = ["begin", "cache_folder", "kernels_digest", "sources_digest"]

MOST_VERSIONS: Final = 8
"""Folders of a module that are kept."""
_ROOT: Final = Path(__file__).parents[1]
_OURS: Final = ("cosim", "protocols", "experiments")
_LIBRARIES: Final = ("site-packages", "dist-packages")
_IMPORT: Final = re.compile(r"^\s*(?:from ([\w.]+) import (\([^)]*\)|.*)|import ([\w.]+))", re.MULTILINE)


def sources_digest(module: str, path: Path) -> str:
    """Return a digest of the file *path* of *module* and of all modules that it imports, directly or not.

    Those count that are ours, or that lie beside it: of another's libraries versions count, and these are the user's.
    """
    home = path.parents[module.count(".") + (path.name == "__init__.py")]
    found: dict[str, Path] = {}
    new = {module: path}
    while new:
        found |= new
        imported = {name for source in new.values() for name in _imported(source)} - found.keys()
        new = {name: source for name in imported if (source := _source(name, home, module)) is not None}
    digest = hashlib.sha256()
    for name in sorted(found):
        digest.update(f"{name}\0{_text(found[name])}\0".encode())
    return digest.hexdigest()[:16]


def kernels_digest() -> str:
    """Return a digest of all sources of ours: it changes whenever one of our kernels may."""
    digest = hashlib.sha256()
    for path in sorted(path for package in _OURS for path in (_ROOT / package).rglob("*.py")):
        digest.update(f"{path.relative_to(_ROOT)}\0{_text(path)}\0".encode())
    return digest.hexdigest()[:16]


def _source(name: str, home: Path, module: str) -> Path | None:
    """Return the file of the module *name* if it counts for *module*, whose packages lie in *home*; None if not."""
    first = name.partition(".")[0]
    for root in dict.fromkeys((_ROOT, home)):
        if first in _OURS or first == module.partition(".")[0] or (root == home and root.name not in _LIBRARIES):
            place = root.joinpath(*name.split("."))
            for path in (place.with_name(f"{place.name}.py"), place / "__init__.py"):
                if path.is_file():
                    return path
    return None


@cache
def _imported(path: Path) -> frozenset[str]:
    """Return the names of all that may be modules among what the source *path* imports anywhere."""
    found = set()
    for origin, names, whole in _IMPORT.findall(_text(path)):
        found |= {whole} if whole else {origin, *(f"{origin}.{name}" for name in re.findall(r"\w+", names))}
    return frozenset(found)


@cache
def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8")


def cache_folder(module: str, digest: str) -> Path:
    """Return the folder, which may not exist yet, for what was computed from *module* when *digest* was its own."""
    folder = _home() / f"{module}-{digest}"
    with suppress(OSError):  # it does not exist, or may only be read
        os.utime(folder)
    return folder


def begin(folder: Path) -> None:
    """Make a folder of :func:`cache_folder`; of its module's, forget those that were not used for longest."""
    if folder.is_dir():
        return
    folder.mkdir(parents=True, exist_ok=True)
    module = folder.name.rpartition("-")[0]
    others = [path for path in folder.parent.glob(f"{module}-*") if path.name.rpartition("-")[0] == module]
    for old in sorted(others, key=_used, reverse=True)[MOST_VERSIONS:]:
        shutil.rmtree(old, ignore_errors=True)


def _used(folder: Path) -> float:
    """Return when *folder* was used last; another process may have removed it."""
    try:
        return folder.stat().st_mtime
    except OSError:
        return 0.0


@cache
def _home() -> Path:
    """Return where the folders lie: where numba's own variable says, or in the user's folder for such things."""
    home = os.environ.get("NUMBA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    path = Path(home) / "cosim"
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError:  # no home that can be written to: compile once a boot instead of once
        return Path(tempfile.gettempdir()) / "cosim"
    return path
