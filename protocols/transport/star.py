"""A piconet of a team whose members are known beforehand; robot 0 is the master for good.

Radios such as Bluetooth's carry nothing without a link, and their slaves talk to the master alone. Here robot 0 is the
master: it pages the others by their addresses, which needs no inquiry, and pages again those that it has lost; the
others scan. A page suspends the piconet, and one of a robot out of reach takes seconds. So the master waits ever longer
from one page of a robot to the next, unless that robot is likely to be near. The master relays what a slave sends, so
that all receive it. No robot replaces a master that is dead; ``protocols.transport.links`` has such a takeover.
"""

import math
from collections.abc import Collection, Mapping
from typing import Final

from pydantic import Field, model_validator

from cosim.geometry.planning import Point
from cosim.machine import (
    BROADCAST,
    Address,
    Connected,
    Disconnect,
    LinkCommand,
    LinkEvent,
    Lost,
    Page,
    PageFailed,
    Reception,
    Role,
    Scan,
)
from cosim.settings import Seconds, Settings, error_at
from cosim.units import Time, from_seconds

MASTER: Final[Address] = 0
MOST_ROBOTS: Final = 8
"""A master and seven active slaves."""
NEAR_SHARE: Final = 0.5
"""Share of the greatest distance of a robot that was heard, within which robots are likely to be in reach."""


class PiconetParameters(Settings):
    """How robot 0 keeps a piconet of all, for radios that carry nothing without a link."""

    patience_s: Seconds = Field(
        default=6.0,
        gt=0,
        description="s, the longest that robot 0 waits for the end of a page; longer than any page lasts",
    )
    page_s: Seconds = Field(
        default=5.0, gt=0, description="s from a page in vain to the next one, of a robot that is likely to be near"
    )
    page_most_s: Seconds = Field(
        default=60.0,
        gt=0,
        description="s, the longest such wait for any other robot, which doubles with each page in vain",
    )

    @model_validator(mode="after")
    def _waits_grow(self) -> "PiconetParameters":
        if not self.page_s <= self.page_most_s:
            raise error_at(("page_s",), self.page_s, f"is not <= {self.page_most_s}, page_most_s")
        return self


class Piconet:
    """One robot's part in the piconet."""

    def __init__(self, me: Address, size: int, parameters: PiconetParameters) -> None:
        """Be robot *me* in a team of *size*."""
        self.me = me
        self.linked: set[Address] = set()
        self._patience = from_seconds(parameters.patience_s)  # as a radio that is dead does not answer its host
        self._least = from_seconds(parameters.page_s)
        self._most = from_seconds(parameters.page_most_s)
        self._tried: dict[Address, Time] = {}
        """When each robot without a link was paged last, or lost."""
        self._waits = dict.fromkeys((other for other in range(size) if other != me), self._least)
        """How long each is not paged after that."""
        self._paging: tuple[Address, Time] | None = None
        """The robot that is being paged, and since when."""
        self._reach_m = 0.0
        self._out: list[LinkCommand] = [Scan(enabled=me != MASTER)]

    @property
    def audience(self) -> Address | None:
        """Destination of what is meant for all; None without a link."""
        if not self.linked:
            return None
        return BROADCAST if self.me == MASTER else MASTER

    def relays(self, sender: Address, reception: Reception) -> bool:
        """Return whether to relay a payload: *sender* has sent it to this master alone, and there are other slaves."""
        direct = reception.source == sender and not reception.broadcast
        return self.me == MASTER and direct and not self.linked <= {sender}

    def heard(self, away_m: float) -> None:
        """Note that a robot was heard from a distance of *away_m*."""
        self._reach_m = max(self._reach_m, away_m)

    def tick(self, here: Point, places_m: Mapping[Address, Point], seen: Collection[Address], now: Time) -> None:
        """Page a robot that is due, if any: *places_m* is where the others were last, *seen* are those in sight."""
        if self.me != MASTER:
            return
        if self._paging is not None:
            peer, since = self._paging
            if 0 <= now - since < self._patience:
                return
            self._failed(peer, now)
        near = {*seen, *(other for other, place in places_m.items() if self._near(here, place))}
        due = [peer for peer in self._waits if peer not in self.linked and self._due(peer, peer in near, now)]
        if due:
            peer = min(due, key=lambda peer: (peer in self._tried, self._tried.get(peer, 0), peer))
            self._paging = peer, now
            self._tried[peer] = now
            self._out.append(Page(peer))

    def _near(self, here: Point, place_m: Point) -> bool:
        return math.dist(here, place_m) <= NEAR_SHARE * self._reach_m

    def _due(self, peer: Address, near: bool, now: Time) -> bool:
        """Return whether it is time to page a robot without a link; the clock may have been set back."""
        if peer not in self._tried:
            return True
        return not 0 <= now - self._tried[peer] < (self._least if near else self._waits[peer])

    def link(self, event: LinkEvent, now: Time) -> None:
        """Take an event of a link."""
        match event:
            case Connected(peer=peer, role=role):
                self._connected(peer, role)
            case PageFailed(peer=peer) if self._paging is not None and self._paging[0] == peer:
                self._failed(peer, now)
            case Lost(peer=peer) if peer in self.linked:
                self.linked.discard(peer)
                self._tried[peer] = now
                self._waits[peer] = self._least

    def _connected(self, peer: Address, role: Role) -> None:
        wanted = Role.SLAVE if peer == MASTER else Role.MASTER
        if peer not in self._waits or role is not wanted or MASTER not in (peer, self.me):
            self._out.append(Disconnect(peer))
            return
        self.linked.add(peer)
        if self._paging is not None and self._paging[0] == peer:
            self._paging = None

    def _failed(self, peer: Address, now: Time) -> None:
        self._paging = None
        self._tried[peer] = now
        self._waits[peer] = min(2 * self._waits[peer], self._most)

    def drain(self) -> list[LinkCommand]:
        """Return the link commands, once."""
        out, self._out = self._out, []
        return out
