"""What a searcher is about, as a table: (errand, news) -> next errand. The table is the strategies' common protocol.

Which news there are depends on the strategy: only a finder of the mobile integrator meets its host, the mobile rally
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


class News(StrEnum):
    """What makes a searcher do something else."""

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
        (_S, News.FOUND): (None, _M),
        (_S, News.DONE): (None, _M),
        (_S, News.DUE): (None, _M),
        (_S, News.JOINED): (None, _S),
        (_M, News.TOLD): (None, _S),
        (_M, News.IDLE): (None, _W),
        (_M, News.FAILED): (None, _C),
        (_M, News.JOINED): (None, _M),
        (_W, News.WORK): (None, _S),
        (_W, News.ALONE): (None, _M),
        (_W, News.JOINED): (None, _W),
        (_C, News.JOINED): (None, _M),
        (_C, News.HEARD): (None, _M),
        (_C, News.FAILED): (None, _C),
        **{(errand, News.OVER): (None, Errand.STOP) for errand in Errand},
    }
)


def next_errand(errand: Errand, news: News) -> Errand:
    """Return what a searcher does after *news*; raise LocalProtocolError for news that cannot come then."""
    following: Errand = next_state(TABLE, errand, news)[1]
    return following
