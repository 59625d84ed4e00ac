"""What the commands of the command line share: options, what is said while one waits, JSON.

What is shown while something is under way goes to stderr, and only if that is a terminal.
"""

from __future__ import annotations

import gc
import json
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import click

from cosim.errors import UserError

SETS = click.option("--set", "sets", multiple=True, metavar="PATH=VALUE", help="Change a setting; may be repeated.")
SEED = click.IntRange(0, 2**62)
JSON = click.option("--json", "as_json", is_flag=True, help="Print JSON for programs.")
COMPILING = "compiling kernels, once: it may take half a minute (cosim warm compiles all beforehand)"
"""What is said on a terminal before the first kernel is compiled."""


def set_up_is_done() -> None:
    """Look for garbage from now on, but not in what is there."""
    gc.freeze()
    gc.enable()


@contextmanager
def told_of_compiling() -> Iterator[None]:
    """Say on a terminal, once, that kernels are being compiled: those that no cache holds, seconds each."""
    if not sys.stderr.isatty():
        yield
        return
    from cosim.jit import before_compiling

    with before_compiling(lambda: print(COMPILING, file=sys.stderr)):
        yield


def as_plain_json(plain: Any) -> str:
    """Return *plain* as JSON, which knows no NaN: null stands for it."""
    from cosim.web.messages import finite

    return json.dumps(finite(plain), indent=2, default=str, allow_nan=False)


@contextmanager
def waiting(text: str) -> Iterator[None]:
    """Show on a terminal that something is under way; its length is not known."""
    if not sys.stderr.isatty():
        yield
        return
    from rich.console import Console

    with Console(stderr=True).status(text):
        yield


@contextmanager
def bar(name: str) -> Iterator[Any]:
    """Give a function (done, total, failed) that moves a bar on a terminal and is silent elsewhere."""
    if not sys.stderr.isatty():
        yield lambda done, total, failed=0: None
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn(name),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[told]}"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(name, total=None, told="")

        def move(done: int, total: int, failed: int = 0) -> None:
            speed = progress.tasks[0].speed
            told = [f"{speed:.3g}/s"] if speed else []
            told += [f"{failed} failed"] if failed else []
            progress.update(task, completed=done, total=total, told=", ".join(told))

        yield move


@contextmanager
def naming(source: str, sets: Sequence[str]) -> Iterator[None]:
    """Put *source*, or that of *sets* which is to blame, before errors that show only when a run is set up."""
    try:
        yield
    except UserError as error:
        place, _, rest = str(error).partition(": ")
        blamed = next((text for text in reversed(sets) if text.partition("=")[0].strip() == place), None)
        raise UserError(f"--set {blamed}: {rest}" if blamed else f"{source}: {error}") from None
