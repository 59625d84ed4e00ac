"""Numba, with a cache that notices every edit: the one place from which the project's kernels take ``njit``.

Numba's own cache looks at the file of the compiled function only, not at callees in other files. So the cache
directory is named by a digest of all sources that hold kernels: an edit of any of them starts an empty cache.
It must be set before numba is loaded, hence this module.
"""

import hashlib
import os
import tempfile
from pathlib import Path

ROOTS = (Path(__file__).parent, Path(__file__).parent.parent / "protocols")


def kernel_digest(roots: tuple[Path, ...] = ROOTS) -> str:
    """Return a digest of every Python file below *roots* that compiles something."""
    digest = hashlib.sha256()
    for root in roots:
        for path in sorted(root.rglob("*.py")):
            source = path.read_bytes()
            if b"njit" in source:
                digest.update(path.relative_to(root).as_posix().encode() + b"\0" + source)
    return digest.hexdigest()[:16]


def _cache_home() -> Path:
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    path = Path(home) / "cosim"
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError:  # no home that can be written to: compile once a boot instead of once
        return Path(tempfile.gettempdir()) / "cosim"
    return path


os.environ.setdefault("NUMBA_CACHE_DIR", str(_cache_home() / kernel_digest()))

from numba import njit  # noqa: E402  # the directory must be named first

__all__ = ["njit"]
