"""A command that shows a page, in a process of its own: real, and bounded in all that is waited for."""

import os
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).parents[2]
LONG_S = 120.0
"""Until then it has said where its page is, or never will."""
COMMAND = (sys.executable, "-m", "cosim.cli")


class Commanded(NamedTuple):
    process: Any
    address: str
    """Of its page, as it has printed it."""
    before: list[str]
    """What it has printed before that."""

    @property
    def socket(self) -> str:
        """The address of the page's WebSocket."""
        base, _, query = self.address.partition("?")
        return base.replace("http:", "ws:") + "socket" + (f"?{query}" if query else "")


@contextmanager
def commanded(
    *words: str | Path, command: Sequence[str] = COMMAND, long_s: float = LONG_S, **environment: str
) -> Iterator[Commanded]:
    """Run ``cosim`` with *words* in a process, and a session, of its own; in the end it is killed.

    *environment*: variables that are other than here.

    A command that does not say where its page is within *long_s* is killed then, and what it has said fails the test.
    """
    arguments = [*command, *map(str, words)]
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    around = os.environ | environment
    process: Any = subprocess.Popen(arguments, cwd=ROOT, env=around, start_new_session=True, **streams)
    late = threading.Timer(long_s, process.kill)
    late.start()
    try:
        said: list[str] = []
        while not (said and said[-1].startswith("http://127.0.0.1:")):
            said.append(process.stdout.readline())
            assert said[-1], (said, process.communicate(timeout=60))
        assert process.stdout.readline() == "Ctrl-C ends it\n", process.communicate(timeout=60)
        late.cancel()
        *before, address = map(str.strip, said)
        yield Commanded(process, address, before)
    finally:
        late.cancel()
        late.join()
        process.kill()
        process.communicate()
