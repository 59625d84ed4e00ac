"""Inquiries and pages of one device: one after the other, in the order in which its host has asked for them.

While a device inquires or pages it is in no piconet. A procedure starts when no slot pair is under way in any of its
piconets and no link of its own is due, so that links which have waited are served between two.
"""

from collections import deque
from collections.abc import Callable, Sequence
from typing import Protocol

from cosim.channels.bluetooth.clock import NativeClock
from cosim.channels.bluetooth.hopping import GIAC, NARROW
from cosim.channels.bluetooth.inquiry import CLOCK_RANGE, Inquiry, InquiryScanner, InquirySettings
from cosim.channels.bluetooth.paging import Page as PageProcedure
from cosim.channels.bluetooth.paging import PageScanner, PageSettings
from cosim.channels.bluetooth.piconet import Piconet
from cosim.channels.bluetooth.radio import Air
from cosim.kernel import Handle, Kernel
from cosim.machine import (
    Address,
    Connected,
    Discovered,
    Inquire,
    InquiryComplete,
    LinkEvent,
    Page,
    PageFailed,
    Role,
)
from cosim.units import TICK, Time


class Owner(Protocol):
    """What a procedure must know of a device, its own or another."""

    master_of: Piconet
    masters: dict[Address, Piconet]
    inquiry_scanner: InquiryScanner
    page_scanner: PageScanner

    def linked(self, master: Address) -> None:
        """Note that a link in the piconet of *master* has come up."""

    def procedure_changed(self) -> None:
        """Note that a procedure has begun or ended."""


class Procedures:
    """What the device at *address* is asked to do one after the other; *peers* holds all devices by address."""

    def __init__(
        self,
        kernel: Kernel,
        air: Air,
        address: Address,
        hop_address: int,
        clock: NativeClock,
        inquiry: InquirySettings,
        page: PageSettings,
        t_poll_slots: int,
        peers: Sequence[Owner],
        tell: Callable[[Address, LinkEvent], None],
        call: Callable[[Address, int, str, str], None],
    ) -> None:
        self.address = address
        self.inquiry_time: Time = 0
        """Time spent inquiring, without what is still under way."""
        self.paging_time: Time = 0
        self._kernel = kernel
        self._air = air
        self._hop_address = hop_address
        self._clock = clock
        self._inquiry = inquiry
        self._page = page
        self._t_poll = 2 * t_poll_slots
        self._peers = peers
        self._tell = tell
        self._call = call
        self._procedure: Inquiry | PageProcedure | None = None
        self._began: Time = 0
        self._waiting: deque[Inquire | Page] = deque()
        self._retry: Handle | None = None
        self._estimates: dict[Address, int] = {}  # ticks from the own clock to the other's, as an inquiry told once

    @property
    def busy(self) -> bool:
        """Whether one is under way."""
        return self._procedure is not None

    @property
    def idle(self) -> bool:
        """Whether none is under way, and none waits."""
        return self._procedure is None and not self._waiting

    @property
    def _owner(self) -> Owner:
        return self._peers[self.address]

    def request(self, command: Inquire | Page) -> None:
        """Inquire or page once the procedures asked for before are over."""
        self._waiting.append(command)
        if self._retry is None:
            self._begin()

    def cancel(self) -> None:
        """End what is under way and forget what waits; nothing is reported."""
        self._waiting.clear()
        if self._retry is not None:
            self._retry.cancel()
            self._retry = None
        if self._procedure is not None:
            self._procedure.cancel()
            self._end()

    def _begin(self) -> None:
        """Start the next procedure now, or when the piconets can be left alone."""
        self._retry = None
        if self.busy or not self._waiting:
            return
        while (refused := self._refusal(self._waiting[0])) is not None:
            self._waiting.popleft()
            self._tell(self.address, refused)
            if not self._waiting:
                return
        owner = self._owner
        pauses = [piconet.pair_ends() for piconet in owner.masters.values()]
        if owner.master_of.links.held():
            pauses.append(owner.master_of.next_pause())
        again = max((pause for pause in pauses if pause is not None), default=None)
        if again is not None:
            self._retry = self._kernel.at(again, self._begin)
            return
        owner.master_of.suspend()
        self._began = self._kernel.now
        command = self._waiting.popleft()
        self._procedure = self._inquire(command) if isinstance(command, Inquire) else self._page_to(command)
        owner.procedure_changed()

    def _refusal(self, command: Inquire | Page) -> LinkEvent | None:
        """Return the answer to a command that cannot be carried out in this state."""
        owner = self._owner
        if isinstance(command, Inquire):
            return InquiryComplete(()) if owner.masters or command.enough < 1 else None
        strange = command.peer == self.address or not 0 <= command.peer < len(self._peers)
        linked = owner.master_of.linked(command.peer) or command.peer in owner.masters
        full = owner.master_of.free_lt_addr() is None
        return PageFailed(command.peer) if strange or linked or full else None

    def _inquire(self, command: Inquire) -> Inquiry:
        ticks = max(1, -(-command.duration // (4 * TICK))) * 4
        self._call(self.address, 2, "lm.inquiry", "")
        self._call(self.address, 3, "lc.inquiry", f"{ticks // 2} slots, until {command.enough} are found")
        return Inquiry(
            self._kernel,
            self._air,
            self.address,
            self._clock,
            self._inquiry,
            ticks,
            command.enough,
            [peer.inquiry_scanner for peer in self._peers if peer is not self._owner],
            self._found,
            self._complete,
            GIAC | self._hop_address & NARROW,
        )

    def _page_to(self, command: Page) -> PageProcedure:
        peer = command.peer
        told = command.clock_offset
        lt_addr = self._owner.master_of.free_lt_addr() or 0  # not 0: a page without a free one is refused before
        self._call(self.address, 2, "lm.page", f"robot {peer}")
        self._call(self.address, 3, "lc.page", f"robot {peer}, LT_ADDR {lt_addr}, {self._page.mode}")
        return PageProcedure(
            self._kernel,
            self._air,
            self.address,
            self._hop_address,
            self._clock,
            self._page,
            self._peers[peer].page_scanner,
            self._estimates.get(peer, 0) if told is None else told & ~3,
            lt_addr,
            lambda poll_tick: self._connect(peer, poll_tick),
            lambda: self._page_failed(peer),
        )

    def _found(self, peer: Address, estimate: int) -> None:
        self._estimates[peer] = estimate
        self._tell(self.address, Discovered(peer, estimate))

    def _complete(self, found: tuple[Address, ...]) -> None:
        self._end()
        self._tell(self.address, InquiryComplete(found))
        self._begin()

    def _connect(self, peer: Address, poll_tick: int) -> None:
        owner = self._owner
        if peer not in owner.master_of.links.lt_addr:  # it has left while its answer was on the air
            self._page_failed(peer)
            return
        owner.master_of.admit(peer, poll_tick + self._t_poll)
        owner.linked(self.address)
        self._end()
        hop_clock = self._clock.tick(self._kernel.now) % CLOCK_RANGE
        self._tell(self.address, Connected(peer, Role.MASTER, self._hop_address % NARROW, hop_clock))
        self._begin()

    def _page_failed(self, peer: Address) -> None:
        self._end()
        self._tell(self.address, PageFailed(peer))
        self._begin()

    def _end(self) -> None:
        spent = self._kernel.now - self._began
        if isinstance(self._procedure, Inquiry):
            self.inquiry_time += spent
        else:
            self.paging_time += spent
        self._procedure = None
        self._owner.master_of.resume()
        self._owner.procedure_changed()
