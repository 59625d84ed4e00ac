"""Numba, with a cache that notices every edit: the one place from which the project's kernels take ``njit``.

Numba's own cache looks at the file of the compiled function only. It notices neither an edited callee in another file
nor an edited constant, which is compiled in. So the cache directory is named by a digest of all sources that hold
kernels and of all that those import: an edit of any of them starts an empty cache. Kernels of other packages are
cached there too, and start anew with ours.
"""

import hashlib
import os
import re
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, Final, TypeVar

import numba
from numba.core import event, types

__all__ = ["COMPILES", "before_compiling", "cache_folder", "njit"]

if "scipy.linalg" not in sys.modules:
    # numba's arithmetic of arrays, which the first kernel loads, looks for a BLAS and loads all of scipy.linalg for
    # that (0.3 s): it is not to look now, but when a kernel wants one, which none of ours does
    sys.modules["scipy.linalg"] = None  # type: ignore[assignment]
    from numba.np import arraymath

    del sys.modules["scipy.linalg"]
    arraymath._HAVE_BLAS = True


COMPILES: Final = not numba.config.DISABLE_JIT  # type: ignore[attr-defined]
"""False if the environment's NUMBA_DISABLE_JIT has kernels run as plain Python."""
Kernel = TypeVar("Kernel", bound=Callable[..., Any])


def njit(**options: Any) -> Callable[[Kernel], Kernel]:
    """Return a decorator that compiles a kernel on its first call, as numba's own with these *options* does.

    But a kernel that another one calls with a constant is compiled for the type of the constant, not once more for its
    value: that cost a seventh of all compiling, and no kernel asks for it.
    """
    compiled = numba.njit(**options)
    unliteral: Callable[[Any], Any] = types.unliteral

    def decorate(function: Kernel) -> Kernel:
        kernel: Any = compiled(function)
        if kernel is function:  # NUMBA_DISABLE_JIT: what is not compiled calls plain functions
            return function
        resolve = kernel.get_call_template

        def resolve_types(args: Sequence[Any], named: Mapping[str, Any]) -> Any:
            plain = {name: unliteral(each) for name, each in named.items()}
            return resolve([unliteral(each) for each in args], plain)

        kernel.get_call_template = resolve_types
        compiled_as: Kernel = kernel
        return compiled_as

    return decorate


ROOTS = (Path(__file__).parent, Path(__file__).parent.parent / "protocols")

_IMPORT = re.compile(r"^\s*(?:from|import) ([\w.]+)", re.MULTILINE)


def kernel_digest(roots: tuple[Path, ...] = ROOTS) -> str:
    """Return a digest of every Python file of the packages at *roots* that a kernel can depend on."""
    sources = {
        ".".join((root.name, *path.relative_to(root).with_suffix("").parts)): path.read_text(encoding="utf-8")
        for root in roots
        for path in root.rglob("*.py")
    }
    digest = hashlib.sha256()
    for name in sorted(_with_imports({name for name, source in sources.items() if "njit" in source}, sources)):
        digest.update(f"{name}\0{sources[name]}\0".encode())
    return digest.hexdigest()[:16]


def _with_imports(names: set[str], sources: dict[str, str]) -> set[str]:
    """Return the modules *names* and all of *sources* that they import, directly or not."""
    found: set[str] = set()
    while names:
        found |= names
        imported = {other for name in names for other in _IMPORT.findall(sources[name])}
        packages = {other + "." for other in imported}
        names = {n for n in sources if n in imported or any(map(n.startswith, packages))} - found
    return found


class _Compiling(event.Listener):
    """Listener of numba's that calls *tell* when the first compilation starts."""

    def __init__(self, tell: Callable[[], None]) -> None:
        self._tell: Callable[[], None] | None = tell

    def on_start(self, _: object) -> None:
        tell, self._tell = self._tell, None
        if tell is not None:
            tell()

    def on_end(self, _: object) -> None:
        pass


def before_compiling(tell: Callable[[], None]) -> AbstractContextManager[object]:
    """Return a context in which *tell* is called once, before the first kernel that the cache does not hold."""
    context: AbstractContextManager[object] = event.install_listener("numba:compile", _Compiling(tell))
    return context


def _cache_home() -> Path:
    """Return where caches live: where numba's own variable says, or in the user's folder for such things."""
    home = os.environ.get("NUMBA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    path = Path(home) / "cosim"
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError:  # no home that can be written to: compile once a boot instead of once
        return Path(tempfile.gettempdir()) / "cosim"
    return path


# not by the environment variable: a child process would inherit the name of its parent's sources
numba.config.CACHE_DIR = str(_cache_home() / kernel_digest())  # type: ignore[attr-defined]


def cache_folder() -> Path:
    """Return where the kernels of these sources are cached."""
    return Path(numba.config.CACHE_DIR)  # type: ignore[attr-defined]
