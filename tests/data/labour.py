"""What the tests of processes have workers compute: it must be importable, and goes by name."""

import os
import signal
import time
from pathlib import Path


def square(number):
    return number * number


def numbered(number):
    """Return *number* and the process that was asked."""
    time.sleep(0.01)
    return number, os.getpid()


def deadly(number):
    """Kill the process that is asked for 3; others return their squares."""
    if number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return number * number


def deadly_once(number):
    """Kill the first process that is asked for 3."""
    if number == 3 and not Path("killed").exists():
        Path("killed").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number * number


def endless(number):
    """Never come to an end with 3."""
    while number == 3:
        time.sleep(0.01)
    return number * number


def greedy(number):
    """Take ever more memory for 3, slowly enough to be seen."""
    taken = []
    while number == 3:
        taken.append(bytearray(os.urandom(1)) * 2_000_000)
        time.sleep(0.002)
    return number * number


def a_twentieth(number):
    time.sleep(0.05)
    return number * number


def broken(number):
    if number == 3:
        raise FileNotFoundError("no such thing")
    return number * number


def dies_at_once():
    os._exit(1)


def refuses():
    return "it is Monday"


def one_begins_late():
    """Make all processes but the first begin half a second later."""
    try:
        Path("first").touch(exist_ok=False)
    except FileExistsError:
        time.sleep(0.5)


def side_by_side(number):
    """Return whether the other of two items has begun before this one ends."""
    Path(f"begun {number}").touch()
    for _ in range(500):
        if Path(f"begun {1 - number}").exists():
            return True
        time.sleep(0.01)
    return False
