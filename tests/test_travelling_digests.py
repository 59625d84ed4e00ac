"""Digests travel: runs are the same on each Python found, and without what this processor can do beyond others."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.checkout import ROOT
from tests.tiers import SOAK_SHARE

PLANTED = """
import math, sys
import numba, numpy as np
x = np.random.default_rng(1).uniform(-3.0, 3.0, 20_000)
@numba.njit(fastmath=True)
def fused(x):
    total = 0.0
    for each in x:
        total = total * each + 0.1
        if abs(total) > 9.0:
            total = 0.0
    return total
print({
    "python": lambda: sum(x.tolist()),
    "numpy": lambda: np.exp(x).tobytes().hex()[:200_000],
    "numba": lambda: fused(x),
    "glibc": lambda: [math.sin(each) for each in x.tolist()],
    "openblas": lambda: x @ x,
}[sys.argv[1]]())
"""
"""Prints an expression whose last bits a switch changes."""

CHECK = """
import sys
from pathlib import Path
from cosim.pins import check_pins, read_pins
path = Path(sys.argv[1])
pins = read_pins(path)
chosen = dict(list(pins.runs.items())[:: int(sys.argv[2])])
found = [f"{each.case}: {each.text}" for each in check_pins(pins._replace(runs=chosen), path.parent) if not each.same]
print(*found, sep="\\n", end="")
"""


def wide_vectors() -> str:
    """Return the features of processors for which this NumPy has code of its own, those that are missing here not."""
    code = (
        "import numpy._core._multiarray_umath as m;"
        "print(*(name for name in m.__cpu_dispatch__ if m.__cpu_features__.get(name)))"
    )
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip()


SWITCHES = {
    "numpy": lambda: {"NPY_DISABLE_CPU_FEATURES": wide_vectors()},
    "numba": lambda: {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""},
    "glibc": lambda: {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4"},
    "openblas": lambda: {"OPENBLAS_CORETYPE": "Prescott"},
}


def printed(python: str, environment: dict[str, str], code: str, *words: str) -> str:
    """Return what a process prints; one with another processor for numba keeps kernels of its own by itself."""
    every = {**os.environ, "PYTHONPATH": str(ROOT), **environment}
    done = subprocess.run([python, "-c", code, *words], capture_output=True, text=True, cwd=ROOT, env=every)
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


def other_pythons() -> list[str]:
    """Return interpreters with the project's requirements: those that COSIM_PYTHONS names, or those of make pythons."""
    named = [Path(name) for name in os.environ.get("COSIM_PYTHONS", "").split(os.pathsep) if name]
    return [str(python) for python in named or sorted(ROOT.glob(".venv-*/bin/python")) if python.exists()]


FEW = 97
SHARES = [FEW, *(pytest.param(each, marks=pytest.mark.soak) for each in [max(1, round(1 / SOAK_SHARE))] if each < FEW)]
"""Of how many pins one is run: a few in CI, all in the soak, or the part of them that it is to be if that is more."""


@pytest.mark.slow
@pytest.mark.parametrize("share", SHARES)
@pytest.mark.parametrize("switch", SWITCHES)
def test_runs_are_the_same_without_what_this_processor_can_do(switch: str, share: int) -> None:
    environment = SWITCHES[switch]()
    if printed(sys.executable, {}, PLANTED, switch) == printed(sys.executable, environment, PLANTED, switch):
        pytest.skip(f"the switch for {switch} changes nothing here")
    assert printed(sys.executable, environment, CHECK, "tests/pins.csv", str(share)) == ""


@pytest.mark.slow
@pytest.mark.parametrize("share", SHARES)
def test_runs_are_the_same_on_each_python(share: int) -> None:
    others = other_pythons()
    if not others:
        pytest.skip("make pythons has set up no other Python, and COSIM_PYTHONS names none")
    sums = {printed(python, {}, PLANTED, "python") for python in (sys.executable, *others)}
    for python in others:
        assert printed(python, {}, CHECK, "tests/pins.csv", str(share)) == "", python
    if len(sums) == 1:
        pytest.skip("all these Pythons add floats alike")
