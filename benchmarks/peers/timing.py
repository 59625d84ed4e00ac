"""How a program of ours measures itself: the processor time of its run, after a short one that compiles and loads."""

import json
from collections.abc import Callable
from time import process_time

Work = Callable[[], dict[str, float]]
"""What is timed; it returns what was done, by name."""


def tell(warm_up: Work, prepare: Callable[[], Work]) -> None:
    """Do *warm_up*, then what *prepare* sets up, and print what that took and did as a line of JSON.

    ``setup_s`` is what setting up has taken, ``seconds`` the run: both of processor time.
    """
    warm_up()
    begun = process_time()
    work = prepare()
    started = process_time()
    done = work()
    ended = process_time()
    print(json.dumps({"seconds": ended - started, "setup_s": started - begun, **done}))
