"""Errors in the kernels of the ad hoc radio are planted as they are meant to be, and found."""

import ast
from pathlib import Path

import pytest

from tests.channels.adhoc.kernel_mutants import HARMLESS, KERNELS, PACKAGE, drawn
from tests.checkout import ROOT
from tests.mutants import is_found, mutants

SOURCE = '''
@njit(cache=True)
def least(a: int, b: int) -> int:
    """Return the lesser."""
    if a < b and not b == 0:
        return a
    return min(a, b + 1)


def plain(a: int) -> int:
    """Return more."""
    return a + 1
'''


def test_each_place_of_a_kernel_is_changed_once_a_way_and_nothing_else_is() -> None:
    found = {(mutant.line, mutant.after) for mutant in mutants("least", SOURCE)}
    assert {after for line, after in found if line == 5} >= {"(a <= b)", "(b == 0)", "(b != 0)", "1"}
    assert "(a < b or not b == 0)" in {after for line, after in found if line == 5}
    assert {after for line, after in found if line == 7} == {"max(a, b + 1)", "(b - 1)", "2"}
    assert max(line for line, _ in found) == 7


def test_drawn_errors_are_sources_and_all_different() -> None:
    errors = drawn(200, 7)
    assert len({error.source for error in errors}) == 200
    for error in errors:
        ast.parse(error.source)


def test_each_error_that_is_called_harmless_can_be_drawn() -> None:
    folder = ROOT.joinpath(*PACKAGE.split("."))
    every = {each.text for name in KERNELS for each in mutants(name, (folder / f"{name}.py").read_text("utf-8"))}
    assert set(HARMLESS) <= every


@pytest.mark.slow
def test_a_planted_error_is_found_and_the_kernels_as_they_are_pass(tmp_path: Path) -> None:
    quick = ("tests/channels/adhoc/test_channel.py", "-m", "not soak")  # what it fails there takes seconds
    source = ROOT.joinpath("cosim/channels/adhoc/dcf.py").read_text(encoding="utf-8")
    error = next(each for each in mutants("dcf", source) if each.before == "packet.short += 1" and each.after == "pass")
    assert is_found(error, PACKAGE, quick, tmp_path, 300.0)
    assert not is_found(error._replace(source=source), PACKAGE, quick, tmp_path, 300.0)
