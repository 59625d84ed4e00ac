"""What the commands load: each only what it needs, so that it begins at once."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.test_readme import block

LOADED = """
import sys
from cosim.cli import main
try:
    main(sys.argv[1:])
finally:
    print(*sys.modules, file=sys.stderr)
"""
"""Runs the command line, and names all modules that are loaded at its end."""


def loaded(*words: str, folder: Path | None = None) -> set[str]:
    """Return the modules and packages that a process in *folder* has loaded at the end of a command."""
    line = [sys.executable, "-c", LOADED, *words]
    done = subprocess.run(line, cwd=folder, capture_output=True, text=True, check=True)
    assert done.stdout
    return set(done.stderr.split())


@pytest.mark.parametrize("words", [("--help",), ("run", "--help"), ("playbook", "--help"), ("--version",)])
def test_help_loads_nothing_that_takes_long(words: tuple[str, ...]):
    modules = loaded(*words)
    assert {"cosim", "click"} <= modules
    assert not [name for name in modules if name.endswith(".spec")]
    assert not modules & {"numpy", "numba", "pandas", "scipy", "pydantic", "pyarrow", "matplotlib", "rich", "yaml"}


@pytest.mark.slow
@pytest.mark.parametrize("words", [("validate", "four.yaml"), ("run", "four.yaml", "--set", "duration_s=1")])
def test_a_run_loads_neither_what_writes_tables_nor_what_others_compute_with(tmp_path: Path, words: tuple[str, ...]):
    (tmp_path / "four.yaml").write_text(block("yaml"), encoding="utf-8")
    modules = loaded(*words, folder=tmp_path)
    assert {"cosim.simulation", "protocols.pseudonet.spec", "numba"} <= modules
    assert not modules & {"pandas", "pyarrow", "matplotlib", "networkx", "rich", "starlette"}
    assert not modules & {"scipy.linalg", "scipy.special", "scipy.optimize", "scipy.ndimage", "scipy.sparse"}
