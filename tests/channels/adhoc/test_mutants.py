"""Errors in the kernels of the ad hoc radio are found by the oracle and the tests of its laws."""

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.checkout import ROOT
from tests.mutants import drawn_mutants, is_found
from tests.tiers import soak_count

PACKAGE = "cosim.channels.adhoc"
FOLDER = ROOT.joinpath(*PACKAGE.split("."))
KERNELS = ("advance", "agenda", "air", "dcf", "errors", "reception")
TESTS = (
    "test_dcf_equals_oracle.py",
    "test_phy_errors.py",
    "test_channel.py",
    "test_reception.py",
    "test_jamming_adhoc.py",
)
LIMIT_S = 900.0
HARMLESS: dict[str, str] = {}
"""Mutants of the present kernels that change nothing that can be seen, and why."""


@pytest.mark.soak
def test_drawn_errors_in_the_kernels_are_found(
    tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    count = soak_count(60)
    sources = {name: (FOLDER / f"{name}.py").read_text(encoding="utf-8") for name in KERNELS}
    tests = [*(f"tests/channels/adhoc/{name}" for name in TESTS), "-m", "not soak"]
    missed = []
    for mutant in drawn_mutants(sources, count, seed=1):
        if not is_found(mutant, PACKAGE, tests, tmp_path, LIMIT_S):
            missed.append(str(mutant))
            print(f"missed {mutant}")
    record_property("drawn errors in kernels", count)
    unexplained = [each for each in missed if each not in HARMLESS]
    assert not unexplained
    assert len(missed) <= 0.05 * count + 1
