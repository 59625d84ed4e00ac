"""What robots and their radios are doing at an instant: the intervals that it is in.

Links are such intervals. A trace that tells of none of them has news of links, from which they follow as hosts know it.
"""

from collections.abc import Callable, Hashable, Iterable
from functools import lru_cache
from typing import Final, NamedTuple, Protocol

import numpy as np

from cosim.intervals import LINKED, Interval, link_of
from cosim.trace import INTERVALS, StoredTable, TableFile, link_told
from cosim.units import Time, to_seconds
from cosim.web.rows import Row
from cosim.web.spans import FiledSpans, Spans

_NO_LINK: Final = ("", -1)
_ROWS: Final = 4096
"""Number of rows that are kept in memory,"""
_GROUPS: Final = 8
"""and of groups of the times of rows."""
_CONNECTED: Final = ("Connected", "RoleChanged")


class Activity(Protocol):
    """The intervals of a run."""

    def at(self, time: Time) -> tuple[Hashable, Callable[[], list[Row]]]:
        """Return what differs if other intervals do that *time* is in, and a function that returns these.

        They are rows of state, robot, radio, start in s, detail, and of links what the robot is in it, and which robot
        is at the other end; nothing and -1 of others.
        """


class StoredActivity:
    """The intervals of a recorded run."""

    def __init__(self, intervals: TableFile | None, links: StoredTable | None, end: Time) -> None:
        """Take the tables ``intervals`` and ``links``; None for what the run has not kept.

        *end*: the last instant of which the run tells anything else, ns; what ends no sooner has lasted to the end.
        """
        self._table = intervals
        self._row = lru_cache(_ROWS)(self._read_row)
        self._spans_of = lru_cache(_GROUPS)(self._read_spans)
        self.states: set[str] = set()
        """The states that robots are ever in."""
        self._spans = FiledSpans(() if intervals is None else intervals.ends, self._spans_of)
        self._until_end = self._spans.last >= end
        known = bool(self.states & LINKED.keys())
        self._news = [] if known or links is None else sorted(linked(links), key=lambda each: each.start)
        starts, ends = ([each[at] for each in self._news] for at in (0, 2))
        self._news_spans = Spans(np.array(starts, dtype=np.int64), np.array(ends, dtype=np.int64))
        self.states |= {each.state for each in self._news}

    def at(self, time: Time) -> tuple[Hashable, Callable[[], list[Row]]]:
        """Return the intervals that *time* is in; at the end of the run those that have lasted until then."""
        numbers = self._spans.at(min(time, self._spans.last - 1) if self._until_end else time).tolist()
        of_news = self._news_spans.at(time).tolist()

        def rows() -> list[Row]:
            return [*map(self._row, numbers), *(row_of(self._news[number]) for number in of_news)]

        return (tuple(numbers), tuple(of_news)), rows

    def _read_spans(self, at: int) -> Spans:
        assert self._table is not None
        columns = self._table.group(at, ("start_ns", "end_ns", "state"))
        self.states |= set(columns["state"][1])
        return Spans(columns["start_ns"], columns["end_ns"])

    def _read_row(self, number: int) -> Row:
        assert self._table is not None
        row = self._table.row(number)
        return row_of(Interval(*(row[field.name] for field in INTERVALS.fields)))


class PresentActivity:
    """What robots are doing now, in a run under way."""

    def __init__(self) -> None:
        self._rows: list[Row] = []
        self._version = 0

    def put(self, intervals: Iterable[Interval]) -> None:
        """Say what they do."""
        rows = sorted(map(row_of, intervals))
        if rows != self._rows:
            self._rows = rows
            self._version += 1

    def at(self, time: Time) -> tuple[Hashable, Callable[[], list[Row]]]:
        """Return it."""
        rows = self._rows
        return self._version, lambda: rows


class News(NamedTuple):
    """A row of the table ``links``."""

    time: Time
    robot: int
    event: str
    peer: int
    detail: str


class Links:
    """The links of robots by the news that their hosts have of them."""

    def __init__(self) -> None:
        self._open: dict[tuple[int, int, int], Interval] = {}
        """By robot, the robot at the other end, and radio."""

    def take(self, news: News) -> Interval | None:
        """Take the next news; return the link that has ended by it, if one has."""
        role, radio = link_told(news.detail)
        end = news.robot, news.peer, radio
        if news.event != "Lost" and news.event not in _CONNECTED:
            return None
        ended = self._open.pop(end, None)
        if news.event in _CONNECTED and role in LINKED:
            self._open[end] = Interval(
                news.time, news.robot, news.time, radio, role, f"{LINKED[role].other}={news.peer}"
            )
        return None if ended is None else ended._replace(end=news.time)

    def under_way(self) -> list[Interval]:
        """Return the links that have not ended."""
        return list(self._open.values())


def linked(table: StoredTable) -> list[Interval]:
    """Return the links of a run by its table ``links``; those that have not ended have no end in time."""
    columns = [table.column(name) for name in ("time_ns", "source", "event", "peer", "detail")]
    chosen = np.isin(columns[2].astype(str), ["Lost", *_CONNECTED])
    links = Links()
    ended = [links.take(News(*row)) for row in zip(*(column[chosen].tolist() for column in columns), strict=True)]
    forever = np.iinfo(np.int64).max
    return [each for each in ended if each is not None] + [each._replace(end=forever) for each in links.under_way()]


def row_of(interval: Interval) -> Row:
    """Return *interval* as a page gets it."""
    _, robot, _, radio, state, detail = interval
    return [state, robot, radio, to_seconds(interval.start), detail, *(link_of(state, detail) or _NO_LINK)]
