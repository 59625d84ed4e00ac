"""One Bluetooth device: what its host asks of it, one thing at a time, and whether it may be found and paged meanwhile.

A device is the master of its own piconet and a slave in others', as far as it has links; it inquires or pages, one
procedure after the other in the order of the commands. It scans when it has no link and no procedure under way; with
links only if its host has asked for it since the last one came up. While a master inquires or pages its piconet is
suspended, and a procedure starts only when no link is due, so that links which have waited are served between two.

A device is in one piconet at a time (``attendance``): during a procedure in none; else as its host has divided its
time; else in that of its latest link.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from cosim.channels.bluetooth.attendance import Attendance
from cosim.channels.bluetooth.clock import NativeClock
from cosim.channels.bluetooth.hopping import NARROW
from cosim.channels.bluetooth.inquiry import CLOCK_RANGE, InquiryScanner, InquirySettings
from cosim.channels.bluetooth.paging import PageScanner, PageSettings
from cosim.channels.bluetooth.piconet import Piconet
from cosim.channels.bluetooth.procedures import Procedures
from cosim.channels.bluetooth.queues import News
from cosim.channels.bluetooth.radio import Air
from cosim.channels.bluetooth.roles import switch_roles
from cosim.kernel import Kernel
from cosim.machine import (
    Address,
    Connected,
    Inquire,
    LinkEvent,
    Mode,
    ModeChanged,
    ModeCommand,
    Outcome,
    Outgoing,
    Page,
    Role,
    Share,
    SwitchRole,
)
from cosim.units import Time


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
        self.master_of: Piconet
        self.masters: dict[Address, Piconet] = {}
        """The piconets in which it is a slave, by their masters."""
        self.inquiry_scanner: InquiryScanner
        self.page_scanner: PageScanner
        self._kernel = kernel
        self._peers = peers
        self._tell = tell
        self._scan_wanted = True
        self._insists = False
        self._attendance = Attendance(self.address, lambda address: peers[address].identity.clock)
        self._procedures = Procedures(
            kernel,
            air,
            identity.address,
            identity.hop_address,
            identity.clock,
            inquiry,
            page,
            t_poll_slots,
            peers,
            tell,
            call,
        )

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
        if not self.masters or self.master_of.links.slaves or self.master_of.links.audience():
            return self.master_of
        return next(iter(self.masters.values()))

    def send(self, outgoing: Outgoing) -> Outcome | None:
        """Queue a payload, or report and return why it cannot be."""
        return self.piconet(outgoing.destination).send(self.address, outgoing)

    def command(self, command: ModeCommand | SwitchRole) -> None:
        """Change a link's mode or roles; the answer comes as a new event."""
        peer = command.peer
        if not isinstance(command, SwitchRole):
            self.piconet(peer).modes.command(self.address, command)
        elif 0 <= peer < len(self._peers):
            switch_roles(self._kernel, self, self._peers[peer], self._pass_on)
        else:
            self._tell(self.address, ModeChanged(peer, Mode.NONE))

    def _pass_on(self, news: News) -> None:
        for address, event in news:
            self._tell(address, event)

    def became_slave(self, master: Address, lt_addr: int) -> None:
        """Join the piconet of *master*, whose POLL has just been received."""
        self.master_of.close(self.address, master)  # who pages its former master has left it
        pager = self._peers[master]
        self.masters[master] = pager.master_of
        pager.master_of.join(self.address, lt_addr)
        self.linked(master)
        hop_clock = pager.identity.clock.tick(self._kernel.now) % CLOCK_RANGE
        self._tell(self.address, Connected(master, Role.SLAVE, pager.identity.hop_address % NARROW, hop_clock))

    def lost(self, master: Address) -> None:
        """Note that a link of this device in the piconet of *master* is down on this side."""
        self.left(master)
        self._update_presence()
        self.update_scan()

    def left(self, master: Address) -> None:
        """Note the same, before another link comes up at this instant."""
        self.masters.pop(master, None)
        self._attendance.keep({*self.masters, *([self.address] if self.master_of.links.audience() else [])})

    def linked(self, master: Address) -> None:
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
        busy = self._procedures.busy
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
        free = not self._procedures.busy and (not self._attendance.linked or self._insists)
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
        self._procedures.cancel()
        self._attendance.share(None)
        for piconet in (self.master_of, *self.masters.values()):
            piconet.vanish(self.address)
        self.update_scan()

    def switch_on(self) -> None:
        """Start anew, idle, and scanning if that was wanted last."""
        self.powered = True
        self.update_scan()

    # ------------------------------------------------------------ procedures

    @property
    def inquiry_time(self) -> Time:
        """Time spent inquiring, without what is still under way."""
        return self._procedures.inquiry_time

    @property
    def paging_time(self) -> Time:
        """Time spent paging, without what is still under way."""
        return self._procedures.paging_time

    def request(self, command: Inquire | Page) -> None:
        """Inquire or page once the procedures asked for before are over."""
        self._procedures.request(command)

    @property
    def idle(self) -> bool:
        """Whether no procedure is under way, or waits."""
        return self._procedures.idle

    def procedure_changed(self) -> None:
        """Note that a procedure has begun or ended."""
        self._update_presence()
        self.update_scan()
