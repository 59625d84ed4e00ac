"""What the commands load: each only what it needs, so that it begins at once."""

import subprocess
import sys

import pytest

LOADED = """
import sys
from cosim.cli import main
try:
    main(sys.argv[1:])
finally:
    print(*sys.modules, file=sys.stderr)
"""
"""Runs the command line, and names all modules that are loaded at its end."""


def loaded(*words: str) -> set[str]:
    """Return the modules that a process of its own has loaded at the end of a command, by their first names."""
    done = subprocess.run([sys.executable, "-c", LOADED, *words], capture_output=True, text=True, check=True)
    assert done.stdout
    return {name.partition(".")[0] for name in done.stderr.split()}


@pytest.mark.parametrize("words", [("--help",), ("run", "--help"), ("--version",)])
def test_help_loads_nothing_that_takes_long(words: tuple[str, ...]):
    modules = loaded(*words)
    assert {"cosim", "click"} <= modules
    assert not modules & {"numpy", "numba", "pandas", "scipy", "pydantic", "pyarrow", "matplotlib", "rich", "yaml"}
