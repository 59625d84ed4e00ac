"""The Bluetooth layer: sets up the piconet (paper 003, section IV.B, Fig. 6) and reports its members upwards.

The initiating robot looks for its neighbours by inquiry, then pages one after the other and becomes the master; the
others scan. The calls on the way down are those of a Bluetooth host: a connection request of L2CAP becomes an HCI
command, that a procedure of the link manager, that a state of the link controller; from HCI on they happen in the
device, which is the channel's.

The paper appoints the initiator and does not treat its death. Here robots stand in for it in the order of their
numbers: each waits to be found for as many times the stagger as robots of the last team with a lower number may be
alive, then looks for others itself. So the first of the remaining robots forms the next team, and a robot that is not
found and finds no other goes on alone. Every wait has a deadline, also those for answers of the own device, as a host
does not learn that its radio is dead. A robot that works alone can be found and joins the team of the robot that pages
it.
"""

from collections.abc import Callable, Iterable
from enum import Enum, auto
from typing import Final

from cosim.machine import (
    Address,
    Connected,
    Disconnect,
    Discovered,
    Fate,
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
    next_state,
)
from cosim.units import Time
from protocols.pseudonet.parameters import TeamParameters, Timing

FULL_WAITS: Final = 2
"""Number of robots, possibly dead, for which the whole stagger is waited; for any others a quarter of it."""


class LinkState(Enum):
    """The state of a robot's radio in the set-up."""

    OFF = auto()
    SCANNING = auto()
    INQUIRING = auto()
    PAGING = auto()
    JOINED = auto()
    """A slave."""
    LEADING = auto()
    """The master, maybe without slaves."""
    CLOSING = auto()
    """About to leave all piconets, once the last messages are sent."""


class LinkInput(Enum):
    """The inputs of the set-up."""

    INITIATE = auto()
    WAIT = auto()
    ENOUGH = auto()
    TOO_FEW = auto()
    ALONE = auto()
    NEXT = auto()
    ALL_PAGED = auto()
    PAGED = auto()
    """Another robot has become the master of this one."""
    ASSIGNED = auto()
    """The coordinator has assigned this robot its slaves."""
    BREAK_UP = auto()


TABLE: Final = {
    **{(state, LinkInput.WAIT): ("scan", LinkState.SCANNING) for state in LinkState},
    **{(state, LinkInput.BREAK_UP): ("linger", LinkState.CLOSING) for state in LinkState},
    (LinkState.OFF, LinkInput.INITIATE): ("inquire", LinkState.INQUIRING),
    (LinkState.SCANNING, LinkInput.INITIATE): ("inquire", LinkState.INQUIRING),
    (LinkState.SCANNING, LinkInput.ALONE): ("ready", LinkState.LEADING),
    (LinkState.INQUIRING, LinkInput.TOO_FEW): ("inquire", LinkState.INQUIRING),
    (LinkState.INQUIRING, LinkInput.ENOUGH): ("page", LinkState.PAGING),
    (LinkState.INQUIRING, LinkInput.ALONE): ("ready", LinkState.LEADING),
    (LinkState.PAGING, LinkInput.NEXT): ("page", LinkState.PAGING),
    (LinkState.PAGING, LinkInput.ALL_PAGED): ("ready", LinkState.LEADING),
    (LinkState.OFF, LinkInput.PAGED): ("refuse", LinkState.OFF),
    (LinkState.SCANNING, LinkInput.PAGED): ("join", LinkState.JOINED),
    (LinkState.INQUIRING, LinkInput.PAGED): ("refuse", LinkState.INQUIRING),
    (LinkState.PAGING, LinkInput.PAGED): ("refuse", LinkState.PAGING),
    (LinkState.JOINED, LinkInput.PAGED): ("refuse", LinkState.JOINED),
    (LinkState.LEADING, LinkInput.PAGED): ("change_sides", LinkState.JOINED),
    (LinkState.CLOSING, LinkInput.PAGED): ("refuse", LinkState.CLOSING),
    (LinkState.JOINED, LinkInput.ASSIGNED): ("page", LinkState.PAGING),
}


class Bluetooth:
    """One robot's share of the set-up.

    *ready* is called on the master when paging is over, with its slaves; *taken* on a robot that has worked alone when
    another has become its master.
    """

    def __init__(
        self,
        me: Address,
        size: int,
        links: dict[Address, Role],
        times: Timing,
        parameters: TeamParameters,
        ready: Callable[[tuple[Address, ...], tuple[int, int], Time], None],
        taken: Callable[[Time], None],
    ) -> None:
        self.me = me
        self.state = LinkState.OFF
        self.out: list[Outgoing | LinkCommand] = []
        self.deadline: Time | None = None
        self.hop = (0, 0)
        self.inquiry_time: Time = 0
        self.page_time: Time = 0
        self.links = links
        """Own role in the link to each neighbour."""
        self.found: list[Address] = []
        self._others: tuple[Address, ...] = tuple(other for other in range(size) if other != me)
        """Other robots that may be alive."""
        self._times = times
        self._patience = times.stagger
        """Time for which a robot that was found waits to be called up."""
        self._inquiries = parameters.inquiries
        self._page_attempts = parameters.page_attempts
        self._ready = ready
        self._taken = taken
        self._left = False
        self._inquiries_left = 0
        self._found_before = 0
        self._since: Time = 0
        self._to_page: list[tuple[Address, int]] = []

    @property
    def _wanted(self) -> int:
        return len(self._others)

    @property
    def _rank(self) -> int:
        return sum(other < self.me for other in self._others)

    def start(self, now: Time) -> None:
        """Begin the set-up: look for the others, or wait to be found."""
        if self._wanted == 0:
            self._move(LinkInput.WAIT, now)
            self._move(LinkInput.ALONE, now)
        elif self._rank == 0:
            self._initiate(now)
        else:
            self._wait(now)

    def reform(self, dead: Iterable[Address], now: Time) -> None:
        """Leave all piconets and begin again without the robots that are known to be *dead*."""
        self._others = tuple(other for other in self._others if other not in set(dead))
        self._close(now)

    def _close(self, now: Time) -> None:
        for peer in sorted(self.links):
            self.out.append(Disconnect(peer))
        self.links.clear()
        self._wait(now + self._times.settle)

    def called_up(self, members: tuple[Address, ...]) -> None:
        """Process that this robot is in a team of *members*."""
        self._others = tuple(member for member in members if member != self.me)
        self.deadline = None

    def leave(self) -> None:
        """Stop scanning for good, as the task is done."""
        self.deadline = None
        if not self._left:
            self._left = True
            self.out.append(Scan(enabled=False))

    def link(self, event: LinkEvent, now: Time) -> None:
        """Process a link event."""
        match event:
            case Discovered(peer=peer) if peer not in self.found and self.state is LinkState.INQUIRING:
                self.found.append(peer)
            case InquiryComplete() if self.state is LinkState.INQUIRING:
                self._inquired(now)
            case Connected(peer=peer, role=Role.SLAVE):
                self._paged_by(peer, now)
            case Connected(peer=peer) if self.state is LinkState.PAGING and peer == self._to_page[0][0]:
                self.hop = (event.hop_address, event.hop_clock)
                self.links[peer] = Role.MASTER
                self._paged(now)
            case Connected(peer=peer):  # the answer to a page that was given up
                self.out.append(Disconnect(peer))
            case PageFailed(peer=peer) if self.state is LinkState.PAGING and peer == self._to_page[0][0]:
                self._page_failed(now)
            case Lost(peer=peer) if peer in self.links:
                self._lost(peer, now)

    def wake(self, now: Time) -> None:
        """Act on the deadline: no robot has come, or the device does not answer."""
        if self.deadline is None or now < self.deadline:
            return
        self.deadline = None
        match self.state:
            case LinkState.SCANNING if self._wanted == 0:
                self._move(LinkInput.ALONE, now)
            case LinkState.SCANNING:
                self._initiate(now)
            case LinkState.INQUIRING:
                self._inquired(now)
            case LinkState.PAGING:
                self._page_failed(now)
            case LinkState.CLOSING:
                self._close(now)
            case LinkState.JOINED | LinkState.LEADING:  # found, but never called up
                self.reform(tuple(self.links), now)

    # ------------------------------------------------------------ waiting and being found

    def _wait(self, now: Time) -> None:
        self._move(LinkInput.WAIT, now)
        waits, more = min(self._rank, FULL_WAITS), max(0, self._rank - FULL_WAITS)
        self.deadline = now + waits * self._times.stagger + more * self._times.stagger // 4

    def _paged_by(self, peer: Address, now: Time) -> None:
        if self._left or (self.state is LinkState.LEADING and self.links):
            self.out.append(Disconnect(peer))
            return
        self._move(LinkInput.PAGED, now, peer)

    def _lost(self, peer: Address, now: Time) -> None:
        del self.links[peer]
        if self.links or self._left:
            return
        if self.state is LinkState.LEADING:
            self.out.append(Scan(enabled=True))
        elif self.state is LinkState.JOINED and self.deadline is not None:
            self.reform((peer,), now)

    def _move(self, event: LinkInput, now: Time, peer: Address | None = None) -> None:
        action, self.state = next_state(TABLE, self.state, event)
        match action:
            case "scan":
                self.out.append(Scan(enabled=True))
            case "inquire":
                self._since = now
                self._inquiries_left -= 1
                self.deadline = now + self._times.inquiry + self._times.page
                self.out.append(Inquire(self._times.inquiry, self._wanted))
            case "page":
                self._since = now
                self.deadline = now + self._times.page
                self._page()
            case "ready":
                self.deadline = None
                if not self.links:
                    self.out.append(Scan(enabled=True))
                slaves = (peer for peer, role in self.links.items() if role is Role.MASTER)
                self._ready(tuple(sorted(slaves)), self.hop, now)
            case "join" | "change_sides" if peer is not None:
                if action == "change_sides":
                    self._taken(now)
                self.links[peer] = Role.SLAVE
                self.deadline = now + self._patience
                self.out.append(Scan(enabled=False))
            case "refuse" if peer is not None:
                self.out.append(Disconnect(peer))

    def fate(self, fate: Fate, now: Time) -> None:
        """Ignore fates: nothing that this layer sends has a token."""

    # ------------------------------------------------------------ looking for others

    def _page(self) -> None:
        self.out.append(Page(self._to_page[0][0]))

    def _initiate(self, now: Time) -> None:
        self.found = []
        self._found_before = 0
        self._inquiries_left = self._inquiries
        self.out.append(Scan(enabled=False))
        self._move(LinkInput.INITIATE, now)

    def _look_again(self) -> bool:
        """Return whether another inquiry is worth its time: robots are missing, and the last one found some."""
        fruitful = len(self.found) > self._found_before or not self.found
        self._found_before = len(self.found)
        return len(self.found) < self._wanted and self._inquiries_left > 0 and fruitful

    def _inquired(self, now: Time) -> None:
        self.inquiry_time += now - self._since
        if self._look_again():
            self._move(LinkInput.TOO_FEW, now)
            return
        self._to_page = [(peer, self._page_attempts) for peer in self.found]
        self._move(LinkInput.ENOUGH if self._to_page else LinkInput.ALONE, now)

    def _page_failed(self, now: Time) -> None:
        peer, attempts = self._to_page[0]
        if attempts > 1:  # try the others first: a robot that cannot be reached now may be later
            self._to_page.append((peer, attempts - 1))
        self._paged(now)

    def _paged(self, now: Time) -> None:
        self.page_time += now - self._since
        self._to_page.pop(0)
        self._move(LinkInput.NEXT if self._to_page else LinkInput.ALL_PAGED, now)
