"""What all tests share: no deadlines, the command line, a browser; at the end, what was compared, and skipped."""

import gc
from collections import Counter, defaultdict
from collections.abc import Generator, Iterator
from typing import Any, NamedTuple

import pytest
from hypothesis import settings

settings.register_profile("cosim", deadline=None)  # a first call compiles its kernel
settings.load_profile("cosim")


class Ended(NamedTuple):
    """How a command has ended."""

    code: int
    out: str
    err: str


@pytest.fixture
def cosim(capsys: pytest.CaptureFixture[str]) -> Any:
    """Return a function that runs the command line in this process."""
    from cosim.cli import main

    def run(*words: str) -> Ended:
        with pytest.raises(SystemExit) as ended:
            main(words)
        assert isinstance(ended.value.code, int)
        captured = capsys.readouterr()
        return Ended(ended.value.code, captured.out, captured.err)

    return run


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """Run the one browser of all tests of pages."""
    from tests.web.browser import chromium

    with chromium() as browser:
        yield browser


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Collect tests without collecting garbage, and never look for any among what stays to the end.

    The collector would go through all modules and tests again and again: that took two thirds of the time of
    collecting, and a quarter of that of the tests themselves.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the tests that wait for browsers and for whole commands: others use the processors meanwhile.

    The whole soak may take hours; CI's share of it has the limit that all tests have.
    """
    from tests.tiers import SOAK_SHARE

    if SOAK_SHARE == 1:
        for item in items:
            if item.get_closest_marker("soak"):
                item.add_marker(pytest.mark.timeout(0))
    items.sort(key=lambda item: not (item.path.parent.name in ("web", "page") or item.path.name == "test_wheel.py"))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print the sums of the numbers that passed tests have recorded as properties, by name."""
    counts: Counter[str] = Counter()
    for report in terminalreporter.getreports("passed"):
        counts.update({name: value for name, value in report.user_properties if isinstance(value, int)})
    for name, count in sorted(counts.items()):
        terminalreporter.write_line(f"{count:,} {name}")
    skipped: defaultdict[str, Counter[str]] = defaultdict(Counter)
    for report in terminalreporter.getreports("skipped"):
        reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
        skipped[reason.removeprefix("Skipped: ")][report.nodeid.partition("::")[0]] += 1
    for reason, files in sorted(skipped.items()):
        names = ", ".join(f"{name} ({count})" for name, count in sorted(files.items()))
        terminalreporter.write_line(f"{files.total()} skipped, {reason}: {names}")
