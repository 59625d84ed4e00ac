"""What a searcher is about, as a table: (errand, turn) -> next errand. The table is the strategies' common protocol.

Which turns things take depends on the strategy: only a finder of the mobile integrator meets its host, the mobile rally
point calls all of them when its period is over, a time-out calls those that have been alone for long.
"""

from enum import StrEnum
from types import MappingProxyType
from typing import Final

from cosim.machine import next_state


class Errand(StrEnum):
    """What a searcher does."""

    SEARCH = "search"
    """Visit the posts of its tour, or stroll."""
    MEET = "meet"
    """Get into radio contact with its host, and report."""
    WAIT = "wait"
    """Stay in contact, until there is something to do."""
    CHANGE = "change"
    """Find another host, and join its sub-team."""
    STOP = "stop"
    """The task is over."""


class Turn(StrEnum):
    """What happens to a searcher that makes it do something else."""

    FOUND = "found"
    """It has found a target that its host does not know, and is to tell it at once."""
    DONE = "done"
    """Its tour is finished."""
    DUE = "due"
    """The time to meet has come: the period's end, or the time-out."""
    TOLD = "told"
    """The host knows all that it has to tell, and there is work left."""
    IDLE = "idle"
    """The same, but there is nothing to do before the host says so."""
    WORK = "work"
    """There is something to do again."""
    ALONE = "alone"
    """Out of contact while it should wait."""
    FAILED = "failed"
    """Its host has failed, as far as it can tell."""
    JOINED = "joined"
    """Another host has confirmed."""
    HEARD = "heard"
    """The host that it had given up is there after all."""
    OVER = "over"
    """A host says that all targets are known."""


_S, _M, _W, _C = Errand.SEARCH, Errand.MEET, Errand.WAIT, Errand.CHANGE

TABLE: Final = MappingProxyType(
    {
        (_S, Turn.FOUND): (None, _M),
        (_S, Turn.DONE): (None, _M),
        (_S, Turn.DUE): (None, _M),
        (_S, Turn.JOINED): (None, _S),
        (_M, Turn.TOLD): (None, _S),
        (_M, Turn.IDLE): (None, _W),
        (_M, Turn.FAILED): (None, _C),
        (_M, Turn.JOINED): (None, _M),
        (_W, Turn.WORK): (None, _S),
        (_W, Turn.ALONE): (None, _M),
        (_W, Turn.JOINED): (None, _W),
        (_C, Turn.JOINED): (None, _M),
        (_C, Turn.HEARD): (None, _M),
        (_C, Turn.FAILED): (None, _C),
        **{(errand, Turn.OVER): (None, Errand.STOP) for errand in Errand},
    }
)


def next_errand(errand: Errand, turn: Turn) -> Errand:
    """Return what a searcher does after a *turn*; raise LocalProtocolError for one that things cannot take then."""
    following: Errand = next_state(TABLE, errand, turn)[1]
    return following
