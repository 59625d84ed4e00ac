"""The routes of one robot as intervals: a row as long as an entry of its routing table stays the same."""

from collections.abc import Mapping
from typing import Final

from cosim.intervals import Intervals
from cosim.machine import Address
from cosim.units import Time

ROUTE: Final = "route"


class RouteWatch:
    """Who is told of the routes of *robot*, and writes them down."""

    def __init__(self, robot: Address, intervals: Intervals) -> None:
        self._robot = robot
        self._intervals = intervals
        self._details: dict[Address, str] = {}
        """The routes there are, by destination, as the table tells them."""

    def take(self, destination: Address, next_hop: Address, hops: int, now: Time) -> None:
        """Note that there is this route to *destination* from *now* on, and no other."""
        detail = f"to={destination} next={next_hop} hops={hops}"
        if self._details.get(destination) != detail:
            self.end(destination, now)
            self._details[destination] = detail
            self._intervals.begin(self._robot, ROUTE, now, detail)

    def take_all(self, ways: Mapping[Address, tuple[Address, int]], now: Time) -> None:
        """Note that there are these routes from *now* on, by destination: next hop and hops of each."""
        for destination in self._details.keys() - ways.keys():
            self.end(destination, now)
        for destination, (next_hop, hops) in ways.items():
            self.take(destination, next_hop, hops, now)

    def end(self, destination: Address, at: Time) -> None:
        """Note that the route to *destination*, if there was one, was over *at* that instant."""
        detail = self._details.pop(destination, None)
        if detail is not None:
            self._intervals.end(self._robot, ROUTE, at, detail)
