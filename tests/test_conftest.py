"""What the test run says at its end."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

SUITE = """
import gc

import pytest

@pytest.mark.parametrize("number", range(3))
def test_needs_a_program(number):
    pytest.skip("there is no tshark here (Debian: apt-get install tshark)")

def test_counts(record_property):
    record_property("cases", 1200)

def test_garbage_is_looked_for_but_not_among_what_was_collected():
    assert gc.isenabled()
    assert gc.get_freeze_count() > 10_000
"""


@pytest.mark.slow
def test_the_end_names_what_was_skipped_and_what_would_run_it(tmp_path: Path) -> None:
    shutil.copy(Path(__file__).with_name("conftest.py"), tmp_path)
    (tmp_path / "test_some.py").write_text(SUITE)
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "."]
    out = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True).stdout
    assert "3 skipped, there is no tshark here (Debian: apt-get install tshark): test_some.py (3)" in out
    assert "1,200 cases" in out
    assert "2 passed, 3 skipped" in out
