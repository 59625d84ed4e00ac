"""What a command costs from its start to its end: the processor time of a process of its own, the system's included."""

import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from resource import RUSAGE_CHILDREN, getrusage
from tempfile import TemporaryDirectory

README = Path(__file__).parents[1] / "README.md"


def command(*words: str, first: bool = False) -> Callable[[int], float]:
    """Return what runs the command line with *words* beside the README's scenario, four.yaml, and returns seconds.

    With *first* its kernels are compiled, as nothing has been kept from an earlier run.
    """

    def seconds(_: int) -> float:
        with TemporaryDirectory() as folder:
            environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": ""}  # compiling our sources is not what is measured
            if first:
                environment["NUMBA_CACHE_DIR"] = folder
            found = re.search(r"```yaml\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
            assert found is not None
            (Path(folder) / "four.yaml").write_text(found[1], encoding="utf-8")
            before = _used()
            line = [sys.executable, "-m", "cosim.cli", *words]
            subprocess.run(line, cwd=folder, env=environment, stdout=subprocess.DEVNULL, check=True)
            return _used() - before

    return seconds


def _used() -> float:
    """Return the seconds of processor time of all child processes that have ended."""
    usage = getrusage(RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime
