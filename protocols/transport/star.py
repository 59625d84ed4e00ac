"""A piconet of a team that knows its members beforehand: one is the master, and keeps links to all who are near.

Radios such as Bluetooth's carry nothing without a link, and have their slaves talk to the master alone. Here robot 0 is
the master: it pages the others by their addresses, which needs no inquiry, and pages those again that it has lost. As
long as it pages its piconet is suspended, and a page of who is out of reach takes seconds: so it waits ever longer from
one page of a robot to the next, unless that is likely to be near. The others let themselves be paged. What a slave says
the master says again, so that all hear it. Nobody stands in for a master that is dead.
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
"""Who was heard last from within this share of the greatest distance over which any was heard is likely to be near."""


class LinkParameters(Settings):
    """How robot 0 keeps a piconet of all, for radios that carry nothing without a link."""

    patience_s: Seconds = Field(default=6.0, gt=0, description="s, the host waits no longer for the end of a page")
    page_s: Seconds = Field(
        default=5.0, gt=0, description="s from one page in vain to the next, of a robot that is likely to be near"
    )
    page_most_s: Seconds = Field(
        default=60.0, gt=0, description="s, the longest wait for any other, which doubles with each page in vain"
    )

    @model_validator(mode="after")
    def _waits_grow(self) -> "LinkParameters":
        if not self.page_s <= self.page_most_s:
            raise error_at(("page_s",), self.page_s, f"is not <= {self.page_most_s}, page_most_s")
        return self


class Piconet:
    """One robot's part in it."""

    def __init__(self, me: Address, size: int, patience: Time, least: Time, most: Time) -> None:
        """Be in a team of *size*; wait for the answer to a page for so long, and from *least* to *most* for the next.

        *patience* is longer than any page lasts: a host is not told that its own radio is dead.
        """
        self.me = me
        self.linked: set[Address] = set()
        self._patience = patience
        self._least = least
        self._most = most
        self._tried: dict[Address, Time] = {}
        """When each that has no link was paged last, or lost."""
        self._waits = dict.fromkeys((other for other in range(size) if other != me), least)
        """How long each is left alone after that."""
        self._paging: tuple[Address, Time] | None = None
        """Who is being paged, and since when."""
        self._reach_m = 0.0
        self._out: list[LinkCommand] = [Scan(enabled=me != MASTER)]

    @property
    def audience(self) -> Address | None:
        """To whom a payload is sent that is meant for all; None without a link."""
        if not self.linked:
            return None
        return BROADCAST if self.me == MASTER else MASTER

    def relays(self, sender: Address, reception: Reception) -> bool:
        """Return whether to say again what *sender* has said: to the master alone, and there are others to hear it."""
        direct = reception.source == sender and not reception.broadcast
        return self.me == MASTER and direct and not self.linked <= {sender}

    def heard(self, away_m: float) -> None:
        """Note that a robot so far away was heard."""
        self._reach_m = max(self._reach_m, away_m)

    def tick(self, here: Point, places_m: Mapping[Address, Point], seen: Collection[Address], now: Time) -> None:
        """Page who is due, if any: *places_m* is where the others were last, *seen* are those in sight."""
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
        """Return whether a robot without a link has been left alone for long enough; clocks may have been set back."""
        if peer not in self._tried:
            return True
        return not 0 <= now - self._tried[peer] < (self._least if near else self._waits[peer])

    def link(self, event: LinkEvent, now: Time) -> None:
        """Take news about links."""
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
        """Return the link commands that are to be carried out, once."""
        out, self._out = self._out, []
        return out


def piconet_of(me: Address, size: int, parameters: LinkParameters) -> Piconet:
    """Return the part of robot *me* in the piconet of a team of *size*."""
    times = parameters.patience_s, parameters.page_s, parameters.page_most_s
    return Piconet(me, size, *map(from_seconds, times))
