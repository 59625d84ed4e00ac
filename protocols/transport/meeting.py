"""Links on meeting, for radios that carry nothing without one: who sees another robot looks for it and pages it.

A robot with goals inquires for as long as it sees somebody of a higher number that it has no link to, and pages whom it
has found; explorers have the lowest numbers. It becomes the master, and a slave of somebody neither looks for others
nor is found by them: piconets form round explorers, and no device is in two of them (so a helper serves one explorer at
a time). Links are kept as long as the radio keeps them. The paper knows nothing of this: its messages need a line of
sight and nothing else.
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

MOST_SLAVES = 7


class Meeting:
    """One robot's links."""

    def __init__(
        self, me: Address, looks: bool, inquiry: Time, patience: Time, out: list[Outgoing | LinkCommand]
    ) -> None:
        """Be one that *looks* for others, or is found; *out* is where to command.

        An inquiry lasts for *inquiry* at most, and *patience* longer the device is waited for.
        """
        self.me = me
        self._looks = looks
        self.linked: set[Address] = set()
        self.slave = False
        self._inquiry = inquiry
        self._patience = patience
        self._out = out
        self._busy_until: Time | None = None
        """The device inquires or pages, and until when its answer is waited for."""
        self._found: list[Address] = []

    def look(self, in_sight: Collection[Address], now: Time) -> None:
        """Look for whom this robot sees and has no link to, unless it is doing so; to be called at each tick."""
        if self._busy_until is not None:
            if now < self._busy_until:
                return
            self._free()
        if not self._looks or self.slave or len(self.linked) >= MOST_SLAVES:
            return
        missing = [peer for peer in in_sight if peer > self.me and peer not in self.linked]
        if missing:
            self._busy_until = now + self._inquiry + self._patience
            self._found = []
            self._out += Scan(enabled=False), Inquire(self._inquiry, len(missing))

    def link(self, event: LinkEvent, now: Time) -> None:
        """Take news about links."""
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
        """Page the next one that was found, if there is one."""
        while self._found and len(self.linked) < MOST_SLAVES:
            peer = self._found.pop(0)
            if peer not in self.linked and peer != self.me:
                self._busy_until = now + self._patience
                self._out.append(Page(peer))
                return
        self._free()

    def _free(self) -> None:
        """Be found again by others, unless this robot has slaves."""
        self._busy_until = None
        if not self.linked:
            self._out.append(Scan(enabled=True))
