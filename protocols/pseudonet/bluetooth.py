"""The Bluetooth room: sets up the piconet (paper 003, section IV.B, Fig. 6) and tells the room above who is in it.

The initiating robot looks for its neighbours by inquiry, then pages one after the other and becomes the master; the
others scan. The calls on the way down are those of a Bluetooth host: a connection request of L2CAP becomes an HCI
command, that a procedure of the link manager, that a state of the link controller; from HCI on they happen in the
device, which is the channel's.
"""

from collections.abc import Callable
from enum import Enum, auto
from typing import Final

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
    next_state,
)
from cosim.units import Time


class Setup(Enum):
    """Where a robot's radio is in the set-up."""

    OFF = auto()
    INQUIRING = auto()
    PAGING = auto()
    SCANNING = auto()
    CONNECTED = auto()


class Input(Enum):
    """What moves the set-up on."""

    INITIATE = auto()
    WAIT = auto()
    ENOUGH = auto()
    TOO_FEW = auto()
    ALONE = auto()
    NEXT = auto()
    ALL_PAGED = auto()
    JOINED = auto()


TABLE: Final = {
    (Setup.OFF, Input.INITIATE): ("inquire", Setup.INQUIRING),
    (Setup.OFF, Input.WAIT): ("scan", Setup.SCANNING),
    (Setup.INQUIRING, Input.TOO_FEW): ("inquire", Setup.INQUIRING),
    (Setup.INQUIRING, Input.ENOUGH): ("page", Setup.PAGING),
    (Setup.INQUIRING, Input.ALONE): ("ready", Setup.CONNECTED),
    (Setup.PAGING, Input.NEXT): ("page", Setup.PAGING),
    (Setup.PAGING, Input.ALL_PAGED): ("ready", Setup.CONNECTED),
    (Setup.SCANNING, Input.JOINED): ("joined", Setup.CONNECTED),
    (Setup.CONNECTED, Input.JOINED): ("joined", Setup.CONNECTED),
}


class Bluetooth:
    """One robot's share of the set-up. *ready* is called on the master when paging is over, with its slaves."""

    def __init__(
        self,
        size: int,
        inquiry: tuple[Time, int],
        page_attempts: int,
        ready: Callable[[tuple[Address, ...], tuple[int, int], Time], None],
    ) -> None:
        self.state = Setup.OFF
        self.out: list[Outgoing | LinkCommand] = []
        self.hop = (0, 0)
        self.inquiry_time: Time = 0
        self.page_time: Time = 0
        self.found: list[Address] = []
        self.slaves: list[Address] = []
        self._wanted = size - 1
        self._inquiry_length, self._inquiries_left = inquiry
        self._page_attempts = page_attempts
        self._ready = ready
        self._since: Time = 0
        self._to_page: list[tuple[Address, int]] = []

    def start(self, initiate: bool, now: Time) -> None:
        """Begin the set-up, as the initiating robot or as one that waits to be found."""
        self._move(Input.INITIATE if initiate else Input.WAIT, now)

    def link(self, event: LinkEvent, now: Time) -> None:
        """Take news about links."""
        match event:
            case Discovered(peer=peer) if peer not in self.found:
                self.found.append(peer)
            case InquiryComplete() if self.state is Setup.INQUIRING:
                self._inquired(now)
            case Connected(peer=peer, role=Role.MASTER) if self.state is Setup.PAGING:
                self.hop = (event.hop_address, event.hop_clock)
                self.slaves.append(peer)
                self._paged(now)
            case PageFailed(peer=peer) if self.state is Setup.PAGING:
                self._page_failed(peer, now)
            case Connected(role=Role.SLAVE) if self.state in (Setup.SCANNING, Setup.CONNECTED):
                self._move(Input.JOINED, now)
            case Lost(peer=peer) if peer in self.slaves:
                self.slaves.remove(peer)

    def _move(self, event: Input, now: Time) -> None:
        action, self.state = next_state(TABLE, self.state, event)
        match action:
            case "inquire":
                self._since = now
                self._inquiries_left -= 1
                self.out.append(Inquire(self._inquiry_length, self._wanted))
            case "scan":
                self.out.append(Scan(enabled=True))
            case "page":
                self._since = now
                self.out.append(Page(self._to_page[0][0]))
            case "ready":
                self._ready(tuple(sorted(self.slaves)), self.hop, now)

    def _inquired(self, now: Time) -> None:
        self.inquiry_time += now - self._since
        if len(self.found) < self._wanted and self._inquiries_left > 0:
            self._move(Input.TOO_FEW, now)
            return
        self._to_page = [(peer, self._page_attempts) for peer in self.found]
        self._move(Input.ENOUGH if self._to_page else Input.ALONE, now)

    def _page_failed(self, peer: Address, now: Time) -> None:
        attempts = self._to_page[0][1] - 1
        if attempts > 0:  # try the others first: a robot that cannot be reached now may be later
            self._to_page.append((peer, attempts))
        self._paged(now)

    def _paged(self, now: Time) -> None:
        self.page_time += now - self._since
        self._to_page.pop(0)
        self._go_on(now)

    def _go_on(self, now: Time) -> None:
        self._move(Input.NEXT if self._to_page else Input.ALL_PAGED, now)
