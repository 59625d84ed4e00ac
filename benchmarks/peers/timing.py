"""How a program of ours measures itself: the processor time of its run, after a short one that compiles and loads."""

import json
from collections.abc import Callable
from resource import RUSAGE_SELF, getrusage
from time import process_time

Work = Callable[[], dict[str, float]]
"""What is timed; it returns what was done, by name."""
KIB = 1024
"""Octets of the unit in which Linux tells memory."""


def tell(warm_up: Work, prepare: Callable[[], Work]) -> None:
    """Do *warm_up*, then what *prepare* sets up, and print what that took and did as a line of JSON.

    ``setup_s`` is what setting up has taken, ``seconds`` the run, both of processor time; ``memory_mb`` the most that
    the process has held, in MB of 1e6 octets.
    """
    warm_up()
    begun = process_time()
    work = prepare()
    started = process_time()
    done = work()
    ended = process_time()
    memory_mb = getrusage(RUSAGE_SELF).ru_maxrss * KIB / 1e6
    print(json.dumps({"seconds": ended - started, "setup_s": started - begun, "memory_mb": memory_mb, **done}))
