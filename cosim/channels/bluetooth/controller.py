"""One Bluetooth device: its procedures, one at a time, its links in several piconets, and when it scans.

A device is the master of its own piconet and a slave in others', as far as it has links. It inquires or pages, one
procedure after the other in the order of the commands. It scans when it has no link and no procedure under way; with
links it scans only if its host has asked for it since the last one came up. While a master inquires or pages, its
piconet is suspended. A procedure starts only when no slot pair is under way in any of its piconets and no link of its
own is due, so that links which have waited are served between two procedures.

A device is in one piconet at a time: during a procedure in none, else as its host has divided its time, else in that of
its latest link.

Role switch (Core v1.2, Vol 2 Part B, section 8.6.5): master and slave of a link change places. The new master's address
and clock give the hop sequence from then on, so the link moves to its piconet; payloads for the other move with it,
with their sequence bits, so that nothing is lost or delivered twice. What the old master had to broadcast is flushed: a
slave does not broadcast. A link is turned round only if neither device has another, so that no third one has to follow,
between two slot pairs, and only if both hear each other and the link is active. The air time of the link manager's
messages and of the slot adjustment (LMP, FHS) is neglected.
"""

from collections import deque
from collections.abc import Callable, Collection, Sequence

from cosim.channels.bluetooth.hopping import NARROW
from cosim.channels.bluetooth.inquiry import CLOCK_RANGE, Inquiry, InquiryScanner
from cosim.channels.bluetooth.links import ALWAYS, Presence
from cosim.channels.bluetooth.paging import Page as PageProcedure
from cosim.channels.bluetooth.paging import PageScanner
from cosim.channels.bluetooth.piconet import Piconet
from cosim.channels.bluetooth.queues import LinkEvents
from cosim.channels.bluetooth.radio import Radio
from cosim.channels.bluetooth.settings import BluetoothSettings
from cosim.channels.clock import NativeClock
from cosim.errors import LocalProtocolError
from cosim.kernel import Handle
from cosim.machine import (
    Address,
    Connected,
    Discovered,
    Inquire,
    InquiryComplete,
    LinkEvent,
    Mode,
    ModeChanged,
    ModeCommand,
    Outcome,
    Outgoing,
    Page,
    PageFailed,
    Role,
    RoleChanged,
    Share,
    SwitchRole,
)
from cosim.units import TICK, Time

AWAY = Presence(here=False)
ELSEWHERE = Presence(period=1, length=0)
"""Presence of a device that has divided its time without a part for that piconet, which its master knows."""


class Attendance:
    """The presence of the device *address*: as its host has divided its time, else in the piconet of its latest link.

    *clock_of* returns the native clock of any device; parts of the time are counted on the clock that they refer to.
    """

    def __init__(self, address: Address, clock_of: Callable[[Address], NativeClock]) -> None:
        self._address = address
        self._clock_of = clock_of
        self._latest: list[Address] = []  # masters of its piconets, in the order in which links came up
        self._share: Share | None = None

    @property
    def linked(self) -> bool:
        """True if the device has any link."""
        return bool(self._latest)

    def enter(self, master: Address) -> None:
        """Note that a link in the piconet of *master* has come up."""
        self._latest = [*(other for other in self._latest if other != master), master]

    def keep(self, masters: Collection[Address]) -> None:
        """Note that the device still has links in the piconets of *masters* only."""
        self._latest = [master for master in self._latest if master in masters]

    def share(self, share: Share | None) -> None:
        """Divide the time as the host asks for; do not divide it for None, or no parts.

        Raise LocalProtocolError for parts that overlap within the period, which may begin in the midst of one.
        """
        if share is not None:
            _check(share)
        self._share = share if share is not None and share.parts else None

    def presence(self, master: Address, busy: bool) -> Presence:
        """Return when the device is in the piconet of *master*; *busy* with a procedure it is in no other's."""
        if busy and master != self._address:  # its own piconet is suspended then
            return self._planned(master)._replace(here=False)
        return self._planned(master)

    def _planned(self, master: Address) -> Presence:
        if self._share is None:
            return ALWAYS if not self._latest or self._latest[-1] == master else AWAY
        for part_of, first, count in self._share.parts:
            if part_of == master:
                clock = self._clock_of(self._share.reference)
                return Presence(True, 2 * self._share.period_slots, 2 * first, 2 * count, clock)
        return ELSEWHERE


def _check(share: Share) -> None:
    parts = sorted((first, count) for _, first, count in share.parts)
    later = [first for first, _ in parts[1:]] + [first + share.period_slots for first, _ in parts[:1]]
    for (first, count), following in zip(parts, later, strict=True):
        if not 0 <= first < share.period_slots or count < 1 or first + count > following:
            raise LocalProtocolError(f"parts {share.parts} overlap, or leave the period of {share.period_slots} slots")


class Controller:
    """The link controller of one device. *peers* holds all devices by address, this one included, before it is used."""

    def __init__(
        self,
        radio: Radio,
        settings: BluetoothSettings,
        peers: "Sequence[Controller]",
        report: Callable[[Address, LinkEvent], None],
        call: Callable[[Address, int, str, str], None],
    ) -> None:
        """*report* takes an event for a host; *call* takes (address, depth, name, detail) of a call."""
        self.radio = radio
        self.identity = radio.identity
        self.address = radio.identity.address
        self.powered = True
        self.master_of: Piconet
        self.masters: dict[Address, Piconet] = {}
        """The piconets in which it is a slave, by their masters."""
        self.inquiry_scanner: InquiryScanner
        self.page_scanner: PageScanner
        self.inquiry_time: Time = 0
        """Time spent inquiring, without what is still under way."""
        self.paging_time: Time = 0
        """Time spent paging, without what is still under way."""
        self._kernel = radio.kernel
        self._settings = settings
        self._peers = peers
        self._report = report
        self._call = call
        self._scan_wanted = True
        self._insists = False
        self._attendance = Attendance(self.address, lambda address: peers[address].identity.clock)
        self._procedure: Inquiry | PageProcedure | None = None
        """The inquiry or page that is under way."""
        self._began: Time = 0
        self._waiting: deque[Inquire | Page] = deque()
        self._retry: Handle | None = None
        self._estimates: dict[Address, int] = {}
        """Ticks from the own clock to that of each device that an inquiry has found."""

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
            self._switch_roles(self._peers[peer])
        else:
            self._report(self.address, ModeChanged(peer, Mode.NONE))

    def became_slave(self, master: Address, lt_addr: int) -> None:
        """Join the piconet of *master*, whose POLL has just been received."""
        self.master_of.close(self.address, master)  # a device that pages its former master has left it
        pager = self._peers[master]
        self.masters[master] = pager.master_of
        pager.master_of.join(self.address, lt_addr)
        self.linked(master)
        hop_clock = pager.identity.clock.tick(self._kernel.now) % CLOCK_RANGE
        self._report(self.address, Connected(master, Role.SLAVE, pager.identity.hop_address % NARROW, hop_clock))

    def lost(self, master: Address) -> None:
        """Note that a link of this device in the piconet of *master* is down on this side."""
        self.left(master)
        self._update_presence()
        self.update_scan()

    def left(self, master: Address) -> None:
        """Note that the link in the piconet of *master* is gone, before another one comes up at this instant."""
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
        """Inform the piconets of when this device is there."""
        busy = self._procedure is not None
        for master, piconet in (*self.masters.items(), (self.address, self.master_of)):
            piconet.set_presence(self.address, self._attendance.presence(master, busy))

    # ------------------------------------------------------------ scanning and power

    def want_scan(self, enabled: bool) -> None:
        """Scan whenever the device is free to, or not at all."""
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
        """Forget everything but the device's identity, and report nothing."""
        self.powered = False
        self._cancel_procedures()
        self._attendance.share(None)
        for piconet in (self.master_of, *self.masters.values()):
            piconet.vanish(self.address)
        self.update_scan()

    def switch_on(self) -> None:
        """Start again, idle, and scanning if that was wanted last."""
        self.powered = True
        self.update_scan()

    # ------------------------------------------------------------ procedures

    @property
    def idle(self) -> bool:
        """True if no procedure is under way, and none waits."""
        return self._procedure is None and not self._waiting

    def request(self, command: Inquire | Page) -> None:
        """Inquire or page once the procedures asked for before are over."""
        self._waiting.append(command)
        if self._retry is None:
            self._begin_next()

    def _cancel_procedures(self) -> None:
        """End what is under way and forget what waits; nothing is reported."""
        self._waiting.clear()
        if self._retry is not None:
            self._retry.cancel()
            self._retry = None
        if self._procedure is not None:
            self._procedure.cancel()
            self._end_procedure()

    def _begin_next(self) -> None:
        """Start the next procedure now, or when the piconets can be left alone."""
        self._retry = None
        if self._procedure is not None or not self._waiting:
            return
        while (refused := self._refusal(self._waiting[0])) is not None:
            self._waiting.popleft()
            self._report(self.address, refused)
            if not self._waiting:
                return
        pauses = [piconet.pair_ends() for piconet in self.masters.values()]
        if self.master_of.links.held():
            pauses.append(self.master_of.next_pause())
        again = max((pause for pause in pauses if pause is not None), default=None)
        if again is not None:
            self._retry = self._kernel.at(again, self._begin_next)
            return
        self.master_of.suspend()
        self._began = self._kernel.now
        command = self._waiting.popleft()
        self._procedure = self._inquire(command) if isinstance(command, Inquire) else self._page_to(command)
        self._procedure_changed()

    def _refusal(self, command: Inquire | Page) -> LinkEvent | None:
        """Return the answer to a command that cannot be carried out in this state."""
        if isinstance(command, Inquire):
            return InquiryComplete(()) if self.masters or command.enough < 1 else None
        strange = command.peer == self.address or not 0 <= command.peer < len(self._peers)
        linked = self.master_of.linked(command.peer) or command.peer in self.masters
        full = self.master_of.free_lt_addr() is None
        return PageFailed(command.peer) if strange or linked or full else None

    def _inquire(self, command: Inquire) -> Inquiry:
        ticks = max(1, -(-command.duration // (4 * TICK))) * 4
        self._call(self.address, 2, "lm.inquiry", "")
        self._call(self.address, 3, "lc.inquiry", f"{ticks // 2} slots, until {command.enough} are found")
        return Inquiry(
            self.radio,
            self._settings.inquiry,
            ticks,
            command.enough,
            [peer.inquiry_scanner for peer in self._peers if peer is not self],
            self._discovered,
            self._inquiry_complete,
        )

    def _page_to(self, command: Page) -> PageProcedure:
        peer = command.peer
        offset = command.clock_offset
        lt_addr = self.master_of.free_lt_addr() or 0  # not 0: a page without a free one is refused before
        self._call(self.address, 2, "lm.page", f"robot {peer}")
        self._call(self.address, 3, "lc.page", f"robot {peer}, LT_ADDR {lt_addr}, {self._settings.page.mode}")
        return PageProcedure(
            self.radio,
            self._settings.page,
            self._peers[peer].page_scanner,
            self._estimates.get(peer, 0) if offset is None else offset & ~3,
            lt_addr,
            lambda poll_tick: self._page_answered(peer, poll_tick),
            lambda: self._page_failed(peer),
        )

    def _discovered(self, peer: Address, estimate: int) -> None:
        self._estimates[peer] = estimate
        self._report(self.address, Discovered(peer, estimate))

    def _inquiry_complete(self, found: tuple[Address, ...]) -> None:
        self._end_procedure()
        self._report(self.address, InquiryComplete(found))
        self._begin_next()

    def _page_answered(self, peer: Address, poll_tick: int) -> None:
        if peer not in self.master_of.links.lt_addr:  # it has left while its answer was on the air
            self._page_failed(peer)
            return
        self.master_of.admit(peer, poll_tick + 2 * self._settings.t_poll_slots)
        self.linked(self.address)
        self._end_procedure()
        hop_clock = self.identity.clock.tick(self._kernel.now) % CLOCK_RANGE
        self._report(self.address, Connected(peer, Role.MASTER, self.identity.hop_address % NARROW, hop_clock))
        self._begin_next()

    def _page_failed(self, peer: Address) -> None:
        self._end_procedure()
        self._report(self.address, PageFailed(peer))
        self._begin_next()

    def _end_procedure(self) -> None:
        spent = self._kernel.now - self._began
        if isinstance(self._procedure, Inquiry):
            self.inquiry_time += spent
        else:
            self.paging_time += spent
        self._procedure = None
        self.master_of.resume()
        self._procedure_changed()

    def _procedure_changed(self) -> None:
        """Note that a procedure has begun or ended."""
        self._update_presence()
        self.update_scan()

    # ------------------------------------------------------------ role switch

    def _switch_roles(self, other: "Controller") -> None:
        """Turn the link to another device round as this one's host asks for.

        Wait for the end of the slot pair under way, and check only then whether the switch is possible.
        """
        if self.address not in other.masters and other.address not in self.masters:
            self._report(self.address, ModeChanged(other.address, Mode.NONE))
            return
        master, slave = (other, self) if other.address in self.masters else (self, other)
        boundary = master.master_of.boundary()
        if boundary > self._kernel.now:
            self._kernel.at(boundary, lambda: self._switch_roles(other))
            return
        if not _may_switch(master, slave):
            self._report(self.address, RoleChanged(other.address, Role.MASTER if self is master else Role.SLAVE))
            return
        events: LinkEvents = master.master_of.hand_over(slave.address, slave.master_of)
        slave.left(master.address)
        master.left(master.address)
        master.masters[slave.address] = slave.master_of
        for device in (slave, master):
            device.linked(slave.address)
        events.append((slave.address, RoleChanged(master.address, Role.MASTER)))
        events.append((master.address, RoleChanged(slave.address, Role.SLAVE)))
        for address, event in events:
            self._report(address, event)


def _may_switch(master: Controller, slave: Controller) -> bool:
    """Return whether the link is active and heard on both sides, and both devices are idle and have no other link."""
    modes = master.master_of.modes
    alone = not master.masters and modes.members() == [slave.address]
    alone = alone and list(slave.masters) == [master.address] and not slave.master_of.modes.members()
    active = modes.mode(slave.address) is Mode.ACTIVE and modes.both_hear(slave.address)
    return alone and active and master.idle and slave.idle
