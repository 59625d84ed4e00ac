"""The IDs of a train, from its row in the table ``intervals``: for who draws a train slot by slot.

A row of the states ``inquiry`` and ``page`` stands for up to thousands of IDs, and tells all that they follow from: the
train (A or B), the word of which they carry the access code, the sender's clock (``phase_ns``, ``ppm``) and, for a
page, by how many ticks the sender takes the other's clock to be ahead (``estimate``).
"""

from collections.abc import Iterable
from typing import Literal, cast

import numpy as np

from cosim.arrays import Int64s
from cosim.channels.bluetooth.clock import MILLION, NativeClock
from cosim.channels.bluetooth.hopping import page_channel
from cosim.channels.bluetooth.scanning import IdTrain
from cosim.intervals import Interval
from cosim.units import TICK, Time


def train_words(ids: IdTrain, word: int) -> str:
    """Return what the detail of a row of *ids* tells beside the train; *word* is the one whose code they carry."""
    clock = ids.clock
    return f" word={word:#x} phase_ns={clock.phase} ppm={clock.ppm} estimate={ids.estimate}"


def sent_ids(
    row: Interval, start: Time, end: Time, silences: Iterable[tuple[Time, Time]] = ()
) -> tuple[Int64s, Int64s]:
    """Return (starts in ns, RF channels) of the IDs of the train *row* that start in [*start*, *end*), in order.

    An inquirer sends none while it receives an answer: at no instant after the start of such an FHS and before its end,
    which are the *silences*. Raise ValueError for a row that is not of a train.
    """
    words = dict(word.split("=", 1) for word in row.detail.split())
    if row.state not in ("inquiry", "page"):
        raise ValueError(f"a row of {row.state!r} is no train of IDs, expected one of 'inquiry' or 'page'")
    train = cast(Literal["A", "B"], words["train"])
    clock = NativeClock(int(words["phase_ns"]), int(words["ppm"]))
    start, end = max(start, row.start), min(end, row.end)
    ticks = np.arange(clock.tick(start - 1) + 1, clock.tick(end - 1) + 1, dtype=np.int64)
    ticks = ticks[ticks & 2 == 0]
    starts = _starts(clock, ticks)
    for silent, again in silences:
        heard = (starts <= silent) | (starts >= again)
        ticks, starts = ticks[heard], starts[heard]
    return starts, page_channel(int(words["word"], 0), ticks + int(words["estimate"]), train)


def _starts(clock: NativeClock, ticks: Int64s) -> Int64s:
    """Return the instants at which *ticks* begin, as ``clock.start_of`` has them."""
    rate = MILLION + clock.ppm
    elapsed = ticks * TICK - clock.phase
    turns = elapsed // rate
    return turns * MILLION - (turns * rate - elapsed) * MILLION // rate
