"""What a robot tells: whom it sees where, the goals that it knows, and what it can promise (rules 1 to 4)."""

import math
from collections.abc import Mapping

from cosim.machine import Address
from cosim.units import MS, Time
from protocols.reflection.frames import CLOCK_MS, FAR_M, pack
from protocols.reflection.goals import GoalBook
from protocols.reflection.promises import Ways
from protocols.reflection.setup import Point


def compose(
    flags: int,
    here_m: Point,
    sightings: Mapping[Address, Point],
    goals: tuple[GoalBook, Ways] | None,
    start: Time,
    now: Time,
) -> bytes:
    """Return the frame of a robot at *here_m*, which sees *sightings*, metres in its own frame.

    *goals* are those that it knows and its ways to them, None if it keeps them to itself; times count from *start*.
    """
    x, y = here_m
    flat: list[float] = []
    for peer, (seen_x, seen_y) in sightings.items():
        flat += peer, math.atan2(seen_y - y, seen_x - x)
    terms, pledges = (0, 0) if goals is None else _collect(*goals, x, y, start, flat)
    return pack(flags, (now - start) // MS % CLOCK_MS, len(sightings), terms, pledges, flat)


def _collect(book: GoalBook, ways: Ways, x: float, y: float, start: Time, flat: list[float]) -> tuple[int, int]:
    """Add all goals that may be passed on, and what is left of the ways to others' goals; return how many each."""
    terms = 0
    pledges: list[float] = []
    xs, ys, of, me = book.x_m, book.y_m, ways.of, book.me
    for owner in book.known:
        identifier = book.told_as(owner)
        along, across = xs[owner] - x, ys[owner] - y
        if identifier and -FAR_M < along < FAR_M and -FAR_M < across < FAR_M:
            flat += owner, identifier, along, across
            terms += 1
        way = of[owner]
        if way is not None and owner != me:
            length = way.rest_m + math.hypot(way.x_m - x, way.y_m - y)
            if length < FAR_M:
                pledges += owner, book.identifiers[owner], length, (way.seen - start) // MS % CLOCK_MS
    flat += pledges
    return terms, len(pledges) // 4
