"""Bluetooth Low Energy as a channel: one device for each robot, all on one air, and the commands of their hosts.

Inquire is scanning, Page is initiating, Scan is connectable advertising. A payload for one robot goes over the link to
it; one for everyone goes to all that listen, links or not.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from cosim.channels.air.shared import SharedAir
from cosim.channels.base import Channel, Flying, Positions
from cosim.channels.ble.beacon import Beacons
from cosim.channels.ble.device import Device, Site
from cosim.channels.ble.environment import Environment
from cosim.channels.ble.ether import Ether
from cosim.channels.ble.hosts import Hosts, Record
from cosim.channels.ble.metering import Meter
from cosim.channels.ble.packets import Sent
from cosim.channels.ble.phy import LE_1M
from cosim.channels.ble.session import Session
from cosim.channels.ble.settings import LINK_PHYS, BleSettings
from cosim.channels.energy import IDLE, RECEIVE, SLEEP, TRANSMIT, Accounts, Use
from cosim.channels.jamming import Jammer
from cosim.channels.propagation import Barrier
from cosim.channels.reach import Disc, Fading, Floor, reach_of
from cosim.errors import UserError
from cosim.kernel import Kernel
from cosim.machine import (
    BROADCAST,
    Address,
    Disconnect,
    Flush,
    Hold,
    Inquire,
    LinkCommand,
    Mode,
    ModeChanged,
    Outgoing,
    Page,
    Park,
    Role,
    RoleChanged,
    Scan,
    Share,
    Sniff,
    SwitchRole,
    Unpark,
)
from cosim.protocol import Metric
from cosim.randomness import Streams
from cosim.trace import Trace
from cosim.units import SLOT, Time


class BleChannel(Channel):
    """All devices of a run. Their draws depend only on the streams "ble", purpose, address."""

    metrics = (
        Metric("frames_sent", "1", "packets on the air that carry something of hosts, each time that they are sent"),
    )

    def __init__(
        self,
        settings: BleSettings,
        kernel: Kernel,
        trace: Trace,
        size: int,
        streams: Streams,
        floor: Floor | None = None,
        powers_dbm: Sequence[float | None] = (),
        air: SharedAir | None = None,
    ) -> None:
        """*floor* is needed where signals fade; *powers_dbm* are the robots' own, None for that of the settings.

        *air* is None if no radios of other kinds are heard.
        """
        super().__init__(kernel, trace, size)
        self.settings = settings
        sent_dbm = [settings.power_dbm if own is None else own for own in powers_dbm or [None] * size]
        self._air = air
        self._reach: Disc | Fading
        if air is None:
            shadowing = streams.draws("ble", "shadowing")
            self._reach = reach_of(settings.range_m, settings.propagation, sent_dbm, floor, shadowing)
        else:
            self._reach = Fading(np.array(sent_dbm, dtype=np.float64), air.propagation)
        self._ether = Ether(settings, kernel, self._reach, sent_dbm, streams.draws("ble", "errors"), air)
        self._record = Record(trace)
        self._hosts = Hosts(kernel, self.deliver, self.note_unsent, self.payloads, self.intervals)
        self.devices: list[Device] = []
        self._sessions: list[Session] = []
        environment = Environment(kernel, self._ether, self._hosts, self._record)
        site = Site(environment, settings, self.devices, [], self._sessions, streams, self._may_rest, self._changed)
        for address in range(size):
            self.devices.append(Device(site, address))
        self._ether.tenancy.reconsider = self._changed
        if settings.interference == "band":
            tenancy, beacons = self._ether.tenancy, Beacons([device.station.beacon for device in self.devices])
            tenancy.lazies += [beacons.packets, self._resting]
            tenancy.nexts.append(beacons.begins_after)
        self._meters: list[Meter] = []
        if settings.energy is not None:
            self._meter(settings.energy, sent_dbm)
        for device in self.devices:
            if air is not None and air.arbitration is not None:
                device.arbitrate(air.arbitration, self.intervals)
            device.start(first=True)

    def _meter(self, energy: str, sent_dbm: Sequence[float]) -> None:
        """Count what radios use; raise UserError if the part that *energy* names has no current for one of them."""
        self.accounts = Accounts(energy, lambda address, now: self._meters[address].uses(now), sent_dbm)
        phys = {LE_1M, LINK_PHYS[self.settings.connection.phy], LINK_PHYS[self.settings.broadcast.phy]}
        names = sorted(phy.name for phy in phys)
        on_phys = (Use(state, name) for name in names for state in (RECEIVE, TRANSMIT))
        self.accounts.check((Use(SLEEP), Use(IDLE, LE_1M.name), *on_phys))
        for device in self.devices:
            meter = device.station.antenna.meter = Meter(device.station)
            self._meters.append(meter)

    # ---------------------------------------------------------------- hosts' payloads and commands

    def send(self, source: Address, outgoing: Outgoing) -> None:
        """Queue a payload at the device of *source*; nothing happens if that is off."""
        if self._ether.on[source]:
            device = self.devices[source]
            (device.broadcast if outgoing.destination == BROADCAST else device.send)(outgoing)

    def command(self, source: Address, command: LinkCommand) -> None:
        """Carry out a link command; answers come as link events. Nothing happens if the device is off."""
        if not self._ether.on[source]:
            return
        device = self.devices[source]
        match command:
            case Inquire() | Page():
                device.request(command)
            case Scan():
                device.want_scan(command.enabled)
            case Disconnect():
                if command.peer in device.links:
                    device.links[command.peer].close(source)
            case Flush():
                if command.destination == BROADCAST:
                    device.flush_broadcasts()
                elif command.destination in device.links:
                    device.links[command.destination].flush(source)
            case Sniff(peer=peer) if peer in device.links:
                device.links[peer].sniff(source, command.interval_slots * SLOT)
            case Hold() | Sniff() | Park() | Unpark():
                mode = device.links[command.peer].mode(source) if command.peer in device.links else Mode.NONE
                self._hosts.report(source, ModeChanged(command.peer, mode))
            case SwitchRole(peer=peer):
                session = device.links.get(peer)
                if session is None:
                    self._hosts.report(source, ModeChanged(peer, Mode.NONE))
                else:
                    role = Role.MASTER if session.central == source else Role.SLAVE
                    self._hosts.report(source, RoleChanged(peer, role))
            case Share():
                pass  # a device is in all of its piconets: their events are at other times

    # ---------------------------------------------------------------- reach

    def in_reach(self, address: Address) -> tuple[Address, ...]:
        """Return all other devices that receive *address* with their sensitivity, if all are on."""
        return tuple(a for a in range(self.size) if a != address and self._ether.hears(address, a))

    def moved(self, positions_m: Positions) -> None:
        """Take the robots' new positions."""
        if self._ether.moved(positions_m):
            self._changed()

    def power(self, address: Address, on: bool) -> None:
        """Switch the radio at *address* on or off. Its host gets no event; the others find out by supervision."""
        if on == bool(self._ether.on[address]):
            return
        if on:
            self._ether.switch(address, True)
            self._switch_meter(address, True)
            self.intervals.end(address, "off", self.kernel.now)
            self.devices[address].start()
        else:
            self.devices[address].switch_off()
            self._ether.switch(address, False)
            self._switch_meter(address, False)
            self.intervals.begin(address, "off", self.kernel.now)
        self._changed()

    def _switch_meter(self, address: Address, on: bool) -> None:
        if self._meters:
            self._meters[address].switch(self.kernel.now, on)

    def obstruct(self, barriers: Sequence[Barrier]) -> None:
        """Put *barriers*, and no others, in the way of signals from now on; raise UserError if signals do not fade."""
        if isinstance(self._reach, Disc):
            raise UserError("radios without propagation notice no walls")
        self._reach.obstruct(barriers)
        if self._air is not None:
            self._air.obstruct(barriers)
        self._ether.changed()
        self._changed()

    def jam(self, jammer: Jammer) -> None:
        """Put *jammer* on the air as well, at its times; raise UserError if nothing disturbs these radios."""
        if self.settings.interference == "none":
            raise UserError("a jammer disturbs nothing where channel.interference is none")
        self._ether.tenancy.jam(jammer)
        self._changed()

    def _changed(self) -> None:
        """Have scans and links take notice of who is in reach, or on the air, now."""
        for device in self.devices:
            if device.search is not None:
                device.search.refresh()
        for session in list(self._sessions):
            session.reconsider()
        if self._air is not None:
            self._air.reconsider()

    def _may_rest(self, session: Session) -> bool:
        """Return whether no other link, and no table, keeps *session* from resting."""
        if (
            not self._ether.tenancy.alone
            or self._ether.tenancy.jammed
            or (self._record.wanted and self.settings.idle_frames)
        ):
            return False
        others = [other for other in self._sessions if other.central != session.central]
        if not others:
            return True
        central, peripheral = (terminal.address for terminal in session.terminals)
        meets = any(terminal.address in (central, peripheral) for other in others for terminal in other.terminals)
        return not meets and (
            self.settings.interference == "none"
            or not any(
                self._ether.notices(terminal.address, end)
                for other in others
                for terminal in other.terminals
                for end in (central, peripheral)
            )
        )

    def _resting(self, since: Time, until: Time) -> Iterator[Sent]:
        for session in self._sessions:
            yield from session.packets(since, until)

    # ---------------------------------------------------------------- records

    def flying(self, now: Time) -> list[Flying]:
        """Return the packets that are on the air *now*."""
        return [
            Flying(
                packet.start,
                packet.source,
                packet.end,
                packet.kind,
                packet.destination,
                packet.length,
                packet.centre_mhz - 2402,
            )
            for packet in self._ether.on_air(now)
            if packet.start <= now
        ]

    def summary(self) -> dict[str, float]:
        """Return the number of packets with something of hosts in them."""
        return {"frames_sent": float(self._ether.sent), **self._used()}
