"""Links on meeting, for radios that carry nothing without one: a robot that sees another finds it and pages it.

A robot with goals inquires as long as it sees a robot of a higher number to which it has no link, and pages those that
it has found; explorers have the lowest numbers. It becomes the master. A slave neither inquires nor scans, so piconets
form round explorers, and no device is in two of them (a helper serves one explorer at a time). Links are kept as long
as the radio keeps them. The paper (000) has none of this: its messages need a line of sight and nothing else.

``protocols.transport.links`` is for teams that form one piconet of known members, whose master remembers whom it has
paged in vain and pages them again. Here nothing is remembered: robots out of sight are not looked for.
"""

from collections.abc import Collection

from cosim.machine import (
    Address,
    Connected,
    Discovered,
    Inquire,
    InquiryComplete,
    LinkCommand,
    LinkEvent,
    Lost,
    Outgoing,
    Page,
    PageFailed,
    Role,
    Scan,
)
from cosim.units import Time
from protocols.transport.links import MOST_ROBOTS


class Meeting:
    """One robot's links."""

    def __init__(
        self,
        me: Address,
        looks: bool,
        inquiry: Time,
        patience: Time,
        out: list[Outgoing | LinkCommand],
        most: int = MOST_ROBOTS,
    ) -> None:
        """Be a robot that *looks* for others, or is found by them; *out* takes the link commands.

        An inquiry lasts for *inquiry* at most; the device's answer is waited for *patience* longer. A piconet has at
        *most* so many robots.
        """
        self.me = me
        self._looks = looks
        self.linked: set[Address] = set()
        self.slave = False
        self._inquiry = inquiry
        self._patience = patience
        self._most_slaves = most - 1
        self._out = out
        self._busy_until: Time | None = None
        """Until when the answer of the device, which inquires or pages, is waited for; None if it does neither."""
        self._found: list[Address] = []

    def look(self, in_sight: Collection[Address], now: Time) -> None:
        """Inquire for robots in sight without a link, unless an inquiry or a page runs; to be called at each tick."""
        if self._busy_until is not None:
            if now < self._busy_until:
                return
            self._free()
        if not self._looks or self.slave or len(self.linked) >= self._most_slaves:
            return
        missing = [peer for peer in in_sight if peer > self.me and peer not in self.linked]
        if missing:
            self._busy_until = now + self._inquiry + self._patience
            self._found = []
            self._out += Scan(enabled=False), Inquire(self._inquiry, len(missing))

    def link(self, event: LinkEvent, now: Time) -> None:
        """Take an event of a link."""
        match event:
            case Discovered(peer=peer) if peer not in self._found:
                self._found.append(peer)
            case InquiryComplete() if self._busy_until is not None:
                self._page(now)
            case Connected(peer=peer, role=role):
                self.linked.add(peer)
                self._connected(role, now)
            case PageFailed() if self._busy_until is not None:
                self._page(now)
            case Lost(peer=peer):
                self._lost(peer)

    def _connected(self, role: Role, now: Time) -> None:
        if role is Role.SLAVE:
            self.slave = True
            self._busy_until = None
            self._out.append(Scan(enabled=False))
        elif self._busy_until is not None:
            self._page(now)

    def _lost(self, peer: Address) -> None:
        self.linked.discard(peer)
        if not self.linked:
            self.slave = False
            if self._busy_until is None:
                self._out.append(Scan(enabled=True))

    def _page(self, now: Time) -> None:
        """Page the next robot that was found, if there is one."""
        while self._found and len(self.linked) < self._most_slaves:
            peer = self._found.pop(0)
            if peer not in self.linked and peer != self.me:
                self._busy_until = now + self._patience
                self._out.append(Page(peer))
                return
        self._free()

    def _free(self) -> None:
        """Scan again, unless this robot has slaves."""
        self._busy_until = None
        if not self.linked:
            self._out.append(Scan(enabled=True))
