"""Tables that programs print and keep on the page of benchmarks, and the machine on which they came about."""

import os
from collections.abc import Iterator, Sequence
from importlib.metadata import version
from pathlib import Path
from platform import machine as architecture
from platform import python_version

from llvmlite.binding import get_host_cpu_name

README = Path(__file__).parent / "README.md"
END = "<!-- to here -->"


def machine(load: float) -> str:
    """Return the beginning of a sentence on this machine; *load* is what else ran on it when the measuring began."""
    return f"{architecture()} {get_host_cpu_name()}, {os.cpu_count()} processors, load average {load:.1f}"


def versions() -> str:
    """Return the versions that matter most to how long a run takes."""
    return ", ".join((f"Python {python_version()}", *(f"{name} {version(name)}" for name in ("numpy", "numba"))))


def aligned(rows: Sequence[Sequence[str]]) -> Iterator[str]:
    """Return *rows*, of which the first is the head, as lines to be printed."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for each in rows:
        yield "  ".join(cell.ljust(width) for cell, width in zip(each, widths, strict=True)).rstrip()


def written(text: str, begin: str, said: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return the page *text* with what is *said* and a table of *rows* in place of what *begin* and END enclose.

    The first of *rows* is the head. Raise ValueError if the page lacks a marker.
    """
    before, found, rest = text.partition(begin)
    _, end, after = rest.partition(END)
    if not found or not end:
        raise ValueError(f"{README.name} lacks the line {END if found else begin}")
    table = [rows[0], ["---"] * len(rows[0]), *rows[1:]]
    lines = [begin, *said, "", *(f"| {' | '.join(each)} |" for each in table), END]
    return before + "\n".join(lines) + after
