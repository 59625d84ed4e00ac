"""The cache of compiled kernels notices every edit, in whichever file."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from cosim import jit

SOURCES = {
    "kernels.py": "from cosim.jit import njit\nfrom cosim.callee import g\n\n"
    "@njit(cache=True)\ndef f(x):\n    return g(x)\n",
    "callee.py": "from cosim.jit import njit\nfrom cosim.constants import ONE\n\n"
    "@njit(cache=True)\ndef g(x):\n    return x + ONE\n",
    "constants.py": "from cosim.origin import BASE\n\nONE = BASE\n",
    "origin.py": "BASE = 1\n",
    "cli.py": "from cosim.kernels import f\n",
}


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A package ``cosim`` with our jit.py and kernels of its own."""
    folder = tmp_path / "cosim"
    folder.mkdir()
    (folder / "__init__.py").touch()
    shutil.copy(str(jit.__file__), folder / "jit.py")
    for name, source in SOURCES.items():
        (folder / name).write_text(source)
    return folder


def edit(path: Path, old: str, new: str) -> None:
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("kernels.py", "g(x)", "g(x + 1)"),
        ("callee.py", "+ ONE", "- ONE"),
        ("constants.py", "ONE = BASE", "ONE = BASE + 1"),
        ("origin.py", "1", "2"),
        ("jit.py", "njit", "njit "),
    ],
)
def test_the_digest_changes_with_all_that_a_kernel_depends_on(package: Path, name: str, old: str, new: str):
    before = jit.kernel_digest((package,))
    edit(package / name, old, new)
    assert jit.kernel_digest((package,)) != before


def test_the_digest_changes_when_a_file_of_kernels_moves(package: Path):
    before = jit.kernel_digest((package,))
    (package / "kernels.py").rename(package / "moved.py")
    assert jit.kernel_digest((package,)) != before


def test_the_digest_stays_when_nothing_that_kernels_need_changes(package: Path):
    before = jit.kernel_digest((package,))
    edit(package / "cli.py", "import f", "import f as kernel")
    assert jit.kernel_digest((package,)) == before
    assert jit.kernel_digest((package, package.parent / "protocols")) == before  # there is no such package


def result(package: Path) -> int:
    """Return f(1) as a new process computes it, one that inherits all that we have in the environment."""
    environment = {**os.environ, "XDG_CACHE_HOME": str(package.parent / "cache")}
    environment.pop("NUMBA_CACHE_DIR", None)
    code = "from cosim.kernels import f; import cosim.jit; print(cosim.jit.__file__, f(1))"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=package.parent, env=environment, capture_output=True, text=True, check=True
    )
    file, value = done.stdout.split()
    assert Path(file) == package / "jit.py"
    return int(value)


def cache_files(package: Path) -> int:
    return len(list((package.parent / "cache").rglob("*.nbc")))


@pytest.mark.slow
def test_an_edited_callee_or_constant_in_another_file_is_compiled_anew(package: Path):
    assert result(package) == 2
    first = cache_files(package)
    assert first > 0
    edit(package / "callee.py", "x + ONE", "x + 10 * ONE")
    assert result(package) == 11
    edit(package / "origin.py", "BASE = 1", "BASE = 3")
    assert result(package) == 31
    compiled = cache_files(package)
    assert compiled > first
    edit(package / "cli.py", "import f", "import f as kernel")
    assert result(package) == 31
    assert cache_files(package) == compiled


TOLD = """
from cosim.jit import before_compiling
from cosim.kernels import f
with before_compiling(lambda: print("compiling")):
    print(f(1), f(1.0))
"""


@pytest.mark.slow
def test_compiling_is_told_once_and_not_when_the_cache_has_it(package: Path):
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(package.parent / "cache")}
    for expected in ("compiling\n2 2.0\n", "2 2.0\n"):
        done = subprocess.run(
            [sys.executable, "-c", TOLD],
            cwd=package.parent,
            env=environment,
            capture_output=True,
            text=True,
            check=True,
        )
        assert done.stdout == expected


@pytest.mark.parametrize("variable", ["XDG_CACHE_HOME", "NUMBA_CACHE_DIR"])
def test_the_cache_lies_where_the_environment_says(variable: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setenv(variable, str(tmp_path / "there"))
    assert jit._cache_home() == tmp_path / "there" / "cosim"
    assert (tmp_path / "there" / "cosim").is_dir()


def test_without_a_home_to_write_to_the_cache_is_temporary(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    (tmp_path / "file").touch()
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    monkeypatch.setattr(jit.tempfile, "gettempdir", lambda: str(tmp_path / "temporary"))
    assert jit._cache_home() == tmp_path / "temporary" / "cosim"
