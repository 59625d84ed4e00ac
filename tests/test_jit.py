"""The caches of compiled kernels notice every edit, in whichever file, and no edit makes others forget."""

import ast
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import cosim.arrays
from cosim import caches, jit

SOURCES = {
    "kernels.py": "from cosim.jit import njit\nfrom cosim.callee import g\n\n"
    "@njit(cache=True)\ndef f(x):\n    return g(x)\n",
    "callee.py": "from cosim.jit import njit\nfrom cosim.constants import ONE\n\n"
    "@njit(cache=True)\ndef g(x):\n    return x + ONE\n",
    "constants.py": "from cosim.origin import BASE\n\nONE = BASE\n",
    "origin.py": "BASE = 1\n",
    "cli.py": "from cosim.kernels import f\n",
    "others.py": "from cosim.jit import njit\n\n@njit(cache=True)\ndef h(x):\n    return x * 2\n",
}


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A package ``cosim`` with our jit.py and kernels of its own."""
    folder = tmp_path / "cosim"
    folder.mkdir()
    (folder / "__init__.py").touch()
    for module in (caches, jit):
        shutil.copy(str(module.__file__), folder)
    for name, source in SOURCES.items():
        (folder / name).write_text(source)
    return folder


def edit(path: Path, old: str, new: str) -> None:
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))


@pytest.fixture
def digest(package: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[], str]:
    """Return what gives the digest of the sources of cosim.kernels, as a new process reads them."""
    monkeypatch.setattr(caches, "_ROOT", package.parent)

    def found() -> str:
        caches._text.cache_clear()
        caches._imported.cache_clear()
        return caches.sources_digest("cosim.kernels", package / "kernels.py")

    return found


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
def test_the_digest_changes_with_all_that_a_kernel_depends_on(
    package: Path, digest: Callable[[], str], name: str, old: str, new: str
):
    before = digest()
    edit(package / name, old, new)
    assert digest() != before


@pytest.mark.parametrize(("name", "old", "new"), [("cli.py", "import f", "import f as k"), ("others.py", "2", "3")])
def test_the_digest_stays_when_nothing_that_a_module_needs_changes(
    package: Path, digest: Callable[[], str], name: str, old: str, new: str
):
    before = digest()
    edit(package / name, old, new)
    assert digest() == before


def test_modules_count_that_lie_beside_a_users_own_and_those_in_brackets(package: Path, digest: Callable[[], str]):
    mine = package.parent / "elsewhere" / "mine.py"
    mine.parent.mkdir()
    mine.write_text("import beside\nfrom cosim import (\n    callee,\n    jit,\n)\nimport numpy\n")
    (mine.parent / "beside.py").write_text("ONE = 1\n")
    digests = set()
    for changed in (mine, mine.parent / "beside.py", package / "callee.py", package / "origin.py"):
        changed.write_text(changed.read_text() + "# changed\n")
        digest()  # reads files anew
        digests.add(caches.sources_digest("mine", mine))
    assert len(digests) == 4


def test_of_a_module_the_folders_are_kept_that_were_used_last(tmp_path: Path):
    folders = [tmp_path / f"cosim.kernels-{number}" for number in range(caches.MOST_VERSIONS + 3)]
    other = tmp_path / "cosim.kernels.more-1"
    caches.begin(other)
    for age, folder in enumerate(folders):
        caches.begin(folder)
        os.utime(folder, (age, age))
    os.utime(other, (0, 0))
    caches.begin(tmp_path / "cosim.kernels-new")
    assert [folder for folder in folders if folder.exists()] == folders[4:]
    assert other.exists()


COMPILED = """
import cosim.jit
from numba.core import event
from cosim.kernels import f
from cosim.others import h
with event.install_recorder("numba:compile") as recorder:
    value = f(1), h(1)
print(cosim.jit.__file__, *value, *{e.data["dispatcher"].py_func.__name__ for _, e in recorder.buffer if e.is_start})
"""
"""Prints where cosim is, two values, and which functions were compiled for them."""


def result(package: Path) -> tuple[int, int, set[str]]:
    """Return f(1) and h(1), and what was compiled, in a new process that inherits all of our environment."""
    environment = {**os.environ, "XDG_CACHE_HOME": str(package.parent / "cache")}
    environment.pop("NUMBA_CACHE_DIR", None)
    done = subprocess.run(
        [sys.executable, "-c", COMPILED],
        cwd=package.parent,
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    file, one, two, *compiled = done.stdout.split()
    assert Path(file) == package / "jit.py"
    return int(one), int(two), {*compiled} & {"f", "g", "h"}


@pytest.mark.slow
def test_an_edit_compiles_what_depends_on_it_and_nothing_else(package: Path):
    assert result(package) == (2, 2, {"f", "g", "h"})
    assert result(package) == (2, 2, set())
    edit(package / "callee.py", "x + ONE", "x + 10 * ONE")
    assert result(package) == (11, 2, {"f", "g"})
    edit(package / "origin.py", "BASE = 1", "BASE = 3")
    assert result(package) == (31, 2, {"f", "g"})
    edit(package / "kernels.py", "g(x)", "g(x) + 1")
    assert result(package) == (32, 2, {"f"})
    edit(package / "others.py", "x * 2", "x * 3")
    assert result(package) == (32, 3, {"h"})
    edit(package / "others.py", "x * 3", "x * 2")  # what was compiled before the last edits is still there
    edit(package / "kernels.py", "g(x) + 1", "g(x)")
    assert result(package) == (31, 2, set())


@pytest.mark.slow
def test_a_kernel_can_be_called_from_python_before_and_after_others_call_it(package: Path):
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(package.parent / "cache")}
    code = "from cosim.callee import g; from cosim.kernels import f; print(f(1), g(1), g(1.5), f(1.5), f(g(2)))"
    for _ in range(2):
        done = subprocess.run(
            [sys.executable, "-c", code],
            cwd=package.parent,
            env=environment,
            capture_output=True,
            text=True,
            check=True,
        )
        assert done.stdout == "2 2 2.5 2.5 4\n"


@pytest.mark.slow
def test_processes_that_compile_at_once_do_not_spoil_the_cache(package: Path):
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(package.parent / "cache")}
    code = "from cosim.kernels import f; import sys; print(f(1) if sys.argv[1] == '0' else f(1.5))"
    for _ in range(2):
        lines = [[sys.executable, "-c", code, str(number % 2)] for number in range(4)]
        running = [
            subprocess.Popen(line, cwd=package.parent, env=environment, stdout=subprocess.PIPE, text=True)
            for line in lines
        ]
        assert [process.communicate()[0] for process in running] == ["2\n", "2.5\n"] * 2
    assert not [*package.parent.rglob("*.new")]


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


@pytest.fixture
def home_is_sought() -> Iterator[None]:
    """Look for the place of the caches anew, and again after the test."""
    caches._home.cache_clear()
    yield
    caches._home.cache_clear()


@pytest.mark.usefixtures("home_is_sought")
@pytest.mark.parametrize("variable", ["XDG_CACHE_HOME", "NUMBA_CACHE_DIR"])
def test_the_cache_lies_where_the_environment_says(variable: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setenv(variable, str(tmp_path / "there"))
    assert caches._home() == tmp_path / "there" / "cosim"
    assert (tmp_path / "there" / "cosim").is_dir()


@pytest.mark.usefixtures("home_is_sought")
def test_without_a_home_to_write_to_the_cache_is_temporary(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    (tmp_path / "file").touch()
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    monkeypatch.setattr(caches.tempfile, "gettempdir", lambda: str(tmp_path / "temporary"))
    assert caches._home() == tmp_path / "temporary" / "cosim"


# ---------------------------------------------------------------- kernels that only borrow


def kernels() -> list[tuple[ast.FunctionDef, bool]]:
    """Return all kernels of the project, and whether each only borrows arrays."""
    root = Path(cosim.__file__).parents[1]
    files = [path for top in ("cosim", "protocols", "experiments") for path in sorted((root / top).rglob("*.py"))]
    found = []
    for path in files:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef):
                made = [ast.unparse(each) for each in node.decorator_list]
                found += [(node, "borrows=True" in each) for each in made if each.startswith("njit(")]
    return found


def test_no_kernel_that_only_borrows_is_handed_an_array_of_its_own():
    # it does not count who holds an array, so that one would never be released
    known = kernels()
    arrays = {name for name in vars(cosim.arrays) if not name.startswith("_")} - {"Words"}  # philox's are a tuple
    makers = {each.name for each, borrows in known if not borrows and arrays & names(each.returns)}
    assert {"crossed_weights", "sections"} <= makers
    takers = {
        f"{kernel.name} calls {', '.join(sorted(called))}"
        for kernel, borrows in known
        if borrows and (called := makers & names(kernel))
    }
    assert not takers


def names(node: ast.AST | None) -> set[str]:
    return set() if node is None else {each.id for each in ast.walk(node) if isinstance(each, ast.Name)}
