"""What all tests share: no deadlines, and long campaigns say at the end how many cases they have compared."""

from collections import Counter

import pytest
from hypothesis import settings

settings.register_profile("cosim", deadline=None)  # a first call compiles its kernel
settings.load_profile("cosim")


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print the sums of the numbers that passed tests have recorded as properties, by name."""
    counts: Counter[str] = Counter()
    for report in terminalreporter.getreports("passed"):
        counts.update({name: value for name, value in report.user_properties if isinstance(value, int)})
    for name, count in sorted(counts.items()):
        terminalreporter.write_line(f"{count:,} {name}")
