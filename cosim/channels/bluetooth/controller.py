"""One Bluetooth device: what its host asks of it, one thing at a time, and whether it may be found and paged meanwhile.

A device is the master of its own piconet and a slave in others', as far as it has links; it inquires or pages, one
procedure after the other in the order of the commands. It scans when it has no link and no procedure under way; with
links only if its host has asked for it since the last one came up. While a master inquires or pages its piconet is
suspended, and a procedure starts only when no link is due, so that links which have waited are served between two.

A device is in one piconet at a time (``attendance``): during a procedure in none; else as its host has divided its
time; else in that of its latest link.
"""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from cosim.channels.bluetooth.attendance import Attendance
from cosim.channels.bluetooth.clock import NativeClock
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
    Outgoing,
    Page,
    PageFailed,
    Role,
    Share,
)
from cosim.units import TICK, Time


@dataclass(frozen=True, slots=True)
class Identity:
    """What tells one device from another."""

    address: Address
    hop_address: int
    """The 32-bit UAP/LAP word."""
    clock: NativeClock


class Controller:
    """The link controller of one device. *peers* holds all devices by address, this one included, before it is used."""

    def __init__(
        self,
        kernel: Kernel,
        air: Air,
        identity: Identity,
        inquiry: InquirySettings,
        page: PageSettings,
        t_poll_slots: int,
        peers: "Sequence[Controller]",
        tell: Callable[[Address, LinkEvent], None],
        call: Callable[[Address, int, str, str], None],
    ) -> None:
        self.identity = identity
        self.address = identity.address
        self.powered = True
        self.inquiry_time: Time = 0
        """Time spent inquiring, without what is still under way."""
        self.paging_time: Time = 0
        self.master_of: Piconet
        self.masters: dict[Address, Piconet] = {}
        """The piconets in which it is a slave, by their masters."""
        self.inquiry_scanner: InquiryScanner
        self.page_scanner: PageScanner
        self._kernel = kernel
        self._air = air
        self._inquiry = inquiry
        self._page = page
        self._t_poll = 2 * t_poll_slots
        self._peers = peers
        self._tell = tell
        self._call = call
        self._scan_wanted = True
        self._insists = False
        self._attendance = Attendance(self.address, lambda address: peers[address].identity.clock)
        self._procedure: Inquiry | PageProcedure | None = None
        self._began: Time = 0
        self._waiting: deque[Inquire | Page] = deque()
        self._retry: Handle | None = None
        self._estimates: dict[Address, int] = {}  # ticks from the own clock to the other's

    def equip(self, piconet: Piconet, inquiry_scanner: InquiryScanner, page_scanner: PageScanner) -> None:
        """Give the device its piconet, in which it is the master, and its scanners; it scans from now on."""
        self.master_of = piconet
        self.inquiry_scanner = inquiry_scanner
        self.page_scanner = page_scanner
        self.update_scan()

    # ------------------------------------------------------------ payloads and links

    def piconet(self, peer: Address) -> Piconet:
        """Return the piconet in which payloads for *peer* go; a broadcast in the own one, if it has slaves."""
        if peer in self.masters:
            return self.masters[peer]
        if not self.masters or self.master_of.links.slaves:
            return self.master_of
        return next(iter(self.masters.values()))

    def send(self, outgoing: Outgoing) -> None:
        """Queue a payload, or report that there is no link."""
        self.piconet(outgoing.destination).send(self.address, outgoing)

    def became_slave(self, master: Address, lt_addr: int) -> None:
        """Join the piconet of *master*, whose POLL has just been received."""
        pager = self._peers[master]
        self.masters[master] = pager.master_of
        pager.master_of.join(self.address, lt_addr)
        self._linked(master)
        self._tell(self.address, self._connected(master, Role.SLAVE, pager.identity))

    def lost(self, master: Address) -> None:
        """Note that a link of this device in the piconet of *master* is down on this side."""
        self.masters.pop(master, None)
        self._attendance.keep({*self.masters, *([self.address] if self._members() else [])})
        self._update_presence()
        self.update_scan()

    def _members(self) -> bool:
        return bool(self.master_of.links.held())

    def _linked(self, master: Address) -> None:
        """Note that a link in the piconet of *master* has come up."""
        self._attendance.enter(master)
        self._insists = False
        self._update_presence()
        self.update_scan()

    def share(self, share: Share) -> None:
        """Divide the time among piconets from now on."""
        self._attendance.share(share)
        self._update_presence()

    def _update_presence(self) -> None:
        """Tell the piconets when this device is there."""
        busy = self._procedure is not None
        for master, piconet in (*self.masters.items(), (self.address, self.master_of)):
            piconet.set_presence(self.address, self._attendance.presence(master, busy))

    # ------------------------------------------------------------ scanning and power

    def want_scan(self, enabled: bool) -> None:
        """Scan whenever nothing stands against it, or not at all."""
        self._scan_wanted = enabled
        self._insists = enabled and self._attendance.linked
        self.update_scan()

    def update_scan(self) -> None:
        """Scan if that is wanted and the device is on, without a procedure and, unless the host insists, links."""
        free = self._procedure is None and (not self._attendance.linked or self._insists)
        scan = self.powered and self._scan_wanted and free
        if scan == self.inquiry_scanner.enabled == self.page_scanner.enabled:
            return
        for scanner in (self.inquiry_scanner, self.page_scanner):
            if scan and not scanner.enabled:
                scanner.enable(self._kernel.now)
            elif not scan and scanner.enabled:
                scanner.disable()

    def switch_off(self) -> None:
        """Forget everything but the device's identity; nobody is told."""
        self.powered = False
        self._waiting.clear()
        if self._retry is not None:
            self._retry.cancel()
            self._retry = None
        if self._procedure is not None:
            self._procedure.cancel()
            self._end()
        self._attendance.share(None)
        for piconet in (self.master_of, *self.masters.values()):
            piconet.vanish(self.address)
        self.update_scan()

    def switch_on(self) -> None:
        """Start anew, idle, and scanning if that was wanted last."""
        self.powered = True
        self.update_scan()

    # ------------------------------------------------------------ procedures

    def request(self, command: Inquire | Page) -> None:
        """Inquire or page once the procedures asked for before are over."""
        self._waiting.append(command)
        if self._retry is None:
            self._begin()

    def _begin(self) -> None:
        """Start the next procedure now, or when the piconet can be left alone."""
        self._retry = None
        if self._procedure is not None or not self._waiting:
            return
        while (refused := self._refusal(self._waiting[0])) is not None:
            self._waiting.popleft()
            self._tell(self.address, refused)
            if not self._waiting:
                return
        pauses = [piconet.pair_ends() for piconet in self.masters.values()]
        if self._members():
            pauses.append(self.master_of.next_pause())
        again = max((pause for pause in pauses if pause is not None), default=None)
        if again is not None:
            self._retry = self._kernel.at(again, self._begin)
            return
        self.master_of.suspend()
        self._began = self._kernel.now
        command = self._waiting.popleft()
        self._procedure = self._inquire(command) if isinstance(command, Inquire) else self._page_to(command)
        self._update_presence()
        self.update_scan()

    def _refusal(self, command: Inquire | Page) -> LinkEvent | None:
        """Return the answer to a command that cannot be carried out in this state."""
        if isinstance(command, Inquire):
            return InquiryComplete(()) if self.masters or command.enough < 1 else None
        strange = command.peer == self.address or not 0 <= command.peer < len(self._peers)
        linked = command.peer in self.master_of.links.lt_addr or command.peer in self.masters
        full = self.master_of.free_lt_addr() is None
        return PageFailed(command.peer) if strange or linked or full else None

    def _inquire(self, command: Inquire) -> Inquiry:
        ticks = max(1, -(-command.duration // (4 * TICK))) * 4
        self._call(self.address, 2, "lm.inquiry", "")
        self._call(self.address, 3, "lc.inquiry", f"{ticks // 2} slots, until {command.enough} are found")
        return Inquiry(
            self._kernel,
            self._air,
            self.address,
            self.identity.clock,
            self._inquiry,
            ticks,
            command.enough,
            [peer.inquiry_scanner for peer in self._peers if peer is not self],
            self._found,
            self._complete,
        )

    def _page_to(self, command: Page) -> PageProcedure:
        peer = command.peer
        told = command.clock_offset
        lt_addr = self.master_of.free_lt_addr() or 0  # not 0: a page without a free one is refused before
        self._call(self.address, 2, "lm.page", f"robot {peer}")
        self._call(self.address, 3, "lc.page", f"robot {peer}, LT_ADDR {lt_addr}, {self._page.mode}")
        return PageProcedure(
            self._kernel,
            self._air,
            self.address,
            self.identity.hop_address,
            self.identity.clock,
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
        if peer not in self.master_of.links.lt_addr:  # it has left while its answer was on the air
            self._page_failed(peer)
            return
        self.master_of.admit(peer, poll_tick + self._t_poll)
        self._linked(self.address)
        self._end()
        self._tell(self.address, self._connected(peer, Role.MASTER, self.identity))
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
        self.master_of.resume()
        self._update_presence()
        self.update_scan()

    def _connected(self, peer: Address, role: Role, master: Identity) -> Connected:
        hop_clock = master.clock.tick(self._kernel.now) % CLOCK_RANGE
        return Connected(peer, role, master.hop_address, hop_clock)
