"""Bluetooth as a channel: one device for each robot, all on one air, and the commands of their hosts.

The powers between devices change only when robots move or a radio is switched. All piconets are advanced to that
instant first, so that what they compute later than it happens is computed with the powers of its time.
"""

from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from typing import Final

import numpy as np

import cosim.elementary as elementary
from cosim.channels.air.arbitration import Arbitration, Rank
from cosim.channels.air.shared import SharedAir
from cosim.channels.base import Arrival, Channel, Flying, Positions
from cosim.channels.bluetooth.bits.powers import POWER_DBM
from cosim.channels.bluetooth.controller import Controller
from cosim.channels.bluetooth.hopping import NARROW
from cosim.channels.bluetooth.inquiry import CLOCK_RANGE, InquiryScanner
from cosim.channels.bluetooth.packets import ACL
from cosim.channels.bluetooth.paging import PageScanner
from cosim.channels.bluetooth.piconet import Piconet
from cosim.channels.bluetooth.radio import Air, Fate, Frame, Identity, Radio
from cosim.channels.bluetooth.reporting.metering import Meter, Parked
from cosim.channels.bluetooth.reporting.seats import Seats
from cosim.channels.bluetooth.reporting.tenancy import Tenancy
from cosim.channels.bluetooth.settings import BluetoothSettings
from cosim.channels.bluetooth.transport import Transport
from cosim.channels.clock import NativeClock
from cosim.channels.courses import Courses
from cosim.channels.energy import Accounts, Uses
from cosim.channels.jamming import Jammer
from cosim.channels.propagation import Barrier
from cosim.channels.reach import Disc, Fading, Floor, reach_of
from cosim.errors import LocalProtocolError, UserError
from cosim.intervals import Interval
from cosim.kernel import WAKE, Kernel
from cosim.machine import (
    BROADCAST,
    Address,
    Disconnect,
    Flush,
    Hold,
    Inquire,
    LinkCommand,
    LinkEvent,
    Outgoing,
    Page,
    Park,
    Scan,
    Share,
    Sniff,
    SwitchRole,
    Unpark,
)
from cosim.protocol import Metric
from cosim.randomness import Streams
from cosim.trace import CALLS, FRAMES, RECEPTIONS, TRANSMISSIONS, Trace
from cosim.units import TICK, Time, to_seconds

CALL_DEPTH: Final = 4
"""Depth of the topmost call of Bluetooth in the table of calls: four layers of a protocol lie above it."""


class BluetoothChannel(Channel):
    """All devices of a run. Their draws depend only on the streams "bluetooth", purpose, address."""

    metrics = (
        Metric("radio_inquiry_s", "s", "time that all devices together have spent in inquiry"),
        Metric(
            "radio_paging_s", "s", "time that all devices together have spent in paging, up to each link or failure"
        ),
        Metric("frames_sent", "1", "packets with payload, retransmissions included"),
        Metric("idle_polls", "1", "polls of idle slaves, computed in bulk"),
        *(Metric(f"frames_{kind.lower()}", "1", f"{kind} packets sent") for kind in (*ACL, "POLL", "NULL")),
    )

    def __init__(
        self,
        settings: BluetoothSettings,
        kernel: Kernel,
        trace: Trace,
        size: int,
        streams: Streams,
        floor: Floor | None = None,
        power_classes: Sequence[int | None] = (),
        shared: SharedAir | None = None,
    ) -> None:
        """*floor* is needed where signals fade; *power_classes* are the robots' own, None for that of the settings.

        *shared* is None if no radios of other kinds are heard.
        """
        super().__init__(kernel, trace, size)
        self.settings = settings
        self._on = np.ones(size, dtype=np.bool_)
        self._all_on = True
        powers_dbm = [POWER_DBM[own or settings.power_class] for own in power_classes or [None] * size]
        self._shared = shared
        self._reach: Disc | Fading
        if shared is None:
            shadowing = streams.draws("bluetooth", "shadowing")
            self._reach = reach_of(settings.range_m, settings.propagation, powers_dbm, floor, shadowing)
        else:
            self._reach = Fading(np.array(powers_dbm), shared.propagation)
        self._calls_wanted = trace.wants(CALLS)
        self._switched_off: list[Time] = [-1] * size  # when each was last
        wanted = {table: trace.wants(table) for table in (FRAMES, TRANSMISSIONS, RECEPTIONS)}
        # 0 without a law of propagation
        self._noise_mw = elementary.exp10(settings.noise_dbm / 10.0) if wanted[RECEPTIONS] else 0.0
        self._idle_wanted = settings.idle_frames and any(wanted.values())
        self.air = Air(
            size,
            self._record if wanted[FRAMES] else None,
            settings.interference,
            settings.noise_dbm,
            streams.draws("bluetooth", "errors").key,
            self._record_sent if wanted[TRANSMISSIONS] else None,
            self._record_arrived if wanted[RECEPTIONS] else None,
            None if shared is None else partial(Tenancy, shared, kernel, np.array(powers_dbm)),
        )
        if shared is not None and shared.arbitration is not None:
            self._arbitrate(shared.arbitration)
        self._transport = (
            None
            if settings.host_bps is None
            else Transport(
                kernel, size, settings.host_bps, settings.receive_payloads, partial(self._deliver, events=())
            )
        )
        self._courses = self._metered(powers_dbm) if settings.energy else Courses(self.intervals)
        self._jammers: list[Jammer] = []
        self._events: list[tuple[Address, LinkEvent]] = []
        self.devices: list[Controller] = []
        for address in range(size):
            self.devices.append(self._device(address, streams))
        for device in self.devices:
            self._equip(device, streams)

    def _metered(self, powers_dbm: Sequence[float]) -> Courses:
        """Count what radios use; return courses that tell the meter of what devices do."""
        self._meter = Meter(self.air, lambda now: courses.tell(now), self._parked)
        courses = Courses(self.intervals, self._meter.listened)
        self.air.meter = self._meter
        self.accounts = Accounts("states", self._uses, powers_dbm)
        return courses

    def _parked(self) -> Iterator[Parked]:
        for device in self.devices:
            yield from device.master_of.parking.listeners()

    def _uses(self, address: Address, now: Time) -> Uses:
        self.air.advance(now)
        return self._meter.uses(address, now)

    def _arbitrate(self, arbitration: Arbitration) -> None:
        """Have devices ask before they send, if their robots have other radios in the air."""
        tenancy = self.air.tenancy
        assert tenancy is not None
        supervision = self.settings.piconet.supervision
        seats = Seats(arbitration, tenancy.number, self.kernel, self.size, supervision, self.intervals)
        if seats.taken:
            seats.planned = self._planned_until
            self.air.seats = seats
            tenancy.arbitrate(seats)

    def _planned_until(self, address: Address, start: Time, end: Time, rank: Rank) -> Time | None:
        """Return the end of what a device is to do in its piconets in [start, end) that is more than *rank*."""
        device = self.devices[address]
        piconets = device.master_of, *device.masters.values()
        ends = [piconet.planned_until(address, start, end, rank) for piconet in piconets]
        return max((each for each in ends if each is not None), default=None)

    # ------------------------------------------------------------ hosts' payloads and commands

    def send(self, source: Address, outgoing: Outgoing) -> None:
        """Queue a payload at the device of *source*; nothing happens if that is off."""
        device = self.devices[source]
        if device.powered:
            if self._calls_wanted:
                receiver = "all" if outgoing.destination == BROADCAST else outgoing.destination
                detail = f"{len(outgoing.payload)} bytes to {receiver}"
                for depth, name in enumerate(("l2cap.data_request", "hci.acl_data", "lc.transmit")):
                    self._call(source, depth, name, detail)
            why = device.send(outgoing)
            if why is not None:
                self.note_unsent(source, outgoing.destination, len(outgoing.payload), why)

    def command(self, source: Address, command: LinkCommand) -> None:
        """Carry out a link command; answers come as link events. Nothing happens if the device is off."""
        device = self.devices[source]
        if not device.powered:
            return
        match command:
            case Inquire():
                self._call(source, 1, "hci.inquiry", f"{to_seconds(command.duration)} s")
                device.request(command)
            case Page():
                self._call(source, 0, "l2cap.connection_request", f"robot {command.peer}")
                self._call(source, 1, "hci.create_connection", f"robot {command.peer}")
                device.request(command)
            case Scan():
                device.want_scan(command.enabled)
            case Disconnect():
                device.piconet(command.peer).close(source, command.peer)
            case Flush():
                device.piconet(command.destination).flush(source, command.destination)
            case Share():
                if not 0 <= command.reference < self.size:
                    raise LocalProtocolError(
                        f"robot {source} counts its time on the clock of {command.reference}, which is no robot"
                    )
                device.share(command)
            case Hold() | Sniff() | Park() | Unpark() | SwitchRole():
                device.command(command)

    # ------------------------------------------------------------ reach

    def in_reach(self, address: Address) -> tuple[Address, ...]:
        """Return the other devices that are on and notice this one's frames, if it is on."""
        return tuple(
            other
            for other in range(self.size)
            if other != address and self.air.reaches(self.air.carrier(address, other))
        )

    def moved(self, positions_m: Positions) -> None:
        """Take the robots' new positions."""
        if self._reach.moved(positions_m) or self._jammers:
            self._update_powers()

    def power(self, address: Address, on: bool) -> None:
        """Switch the radio at *address* on or off. Its host gets no event; the others find out by supervision."""
        device = self.devices[address]
        if on == device.powered:
            return
        if not on:
            self._switched_off[address] = self.kernel.now
            device.switch_off()
            if self._transport is not None:
                self._transport.clear(address)
        if self.accounts is not None:
            self._meter.switch(address, self.kernel.now, on)
        self._on[address] = on
        self._all_on = bool(self._on.all())
        self._update_powers()
        if on:
            self.intervals.end(address, "off", self.kernel.now)
            device.switch_on()
        else:
            self.intervals.begin(address, "off", self.kernel.now)

    def jam(self, jammer: Jammer) -> None:
        """Put *jammer* on the air as well, at its times."""
        self._jammers.append(jammer)
        self.air.set_jammers(self._jammers, self.kernel.now)
        self._update_powers()

    def obstruct(self, barriers: Sequence[Barrier]) -> None:
        """Put *barriers*, and no others, in the way of signals from now on; raise UserError if signals do not fade."""
        if isinstance(self._reach, Disc):
            raise UserError("radios without propagation notice no walls")
        self._reach.obstruct(barriers)
        if self._shared is not None:
            self._shared.obstruct(barriers)
        self._update_powers()

    def advance(self, now: Time) -> None:
        """Record, or tell the air, idle frames up to *now* if they are wanted; powers change in ``moved`` only."""
        tenancy = self.air.tenancy
        if self._idle_wanted or (tenancy is not None and not tenancy.alone):
            self.air.advance(now)

    def under_way(self, now: Time) -> list[Interval]:
        """Return what its radios are doing *now*, and write what is over: devices skip ahead."""
        return [*self._courses.under_way(now), *super().under_way(now)]

    def flying(self, now: Time) -> list[Flying]:
        """Return the frames that are on the air *now*: those that are rows when they end, and IDs if they are heard."""
        return [
            Flying(start, source, start + duration, kind, destination, length, channel, lt_addr)
            for start, duration, kind, source, destination, channel, lt_addr, length in self.air.flying(now)
        ]

    def close(self, now: Time) -> None:
        """Write what is not over: the run is."""
        self._courses.close(now)
        super().close(now)

    def _update_powers(self) -> None:
        powers = self._reach.power_dbm()
        if not self._all_on:
            powers[~(self._on & self._on[:, None])] = -np.inf
        self.air.set_powers(powers, self.kernel.now)
        if self._jammers:
            self.air.set_jam_powers(self._reach.jam_dbm(self._jammers), self.kernel.now)

    # ------------------------------------------------------------ records

    def summary(self) -> dict[str, float]:
        """Return the time spent in procedures, summed over devices, and the frames of all piconets by type."""
        totals = {
            "radio_inquiry_s": to_seconds(sum(device.inquiry_time for device in self.devices)),
            "radio_paging_s": to_seconds(sum(device.paging_time for device in self.devices)),
            "frames_sent": 0.0,
            "idle_polls": 0.0,
        } | {f"frames_{kind.lower()}": 0.0 for kind in (*ACL, "POLL", "NULL")}
        for device in self.devices:
            for kind, count in device.master_of.counts().items():
                totals["idle_polls" if kind == "idle" else f"frames_{kind.lower()}"] += count
                totals["frames_sent"] += count if kind in ACL else 0
        return totals | self._used()

    def _record(self, frame: Frame, fate: Fate) -> None:
        start, duration, kind, source, destination, channel, lt_addr, length = frame
        outcome = fate.heard.value, fate.part.value
        self.trace.row(FRAMES, start, source, destination, duration, kind, channel, lt_addr, length, *outcome)

    def _record_sent(self, frame: Frame, body: bytes, again: bool) -> None:
        start, duration, kind, source, destination, channel, lt_addr, length = frame
        whole = not start <= self._switched_off[source] < start + duration
        of_frame = duration, channel, lt_addr, length
        self.trace.put(
            TRANSMISSIONS, start, source, kind, destination, 0, 0, again, False, whole, body.hex(), *of_frame
        )

    def _record_arrived(self, frame: Frame, fate: Fate, power_dbm: float, met_mw: float) -> None:
        start, _, _, source, receiver, _, _, _ = frame
        against_mw = self._noise_mw + met_mw
        sinr_db = power_dbm - 10.0 * elementary.log10(against_mw) if against_mw > 0.0 and fate.judged else None
        power = power_dbm if self._noise_mw > 0.0 and power_dbm > float("-inf") else None
        self.trace.put(RECEPTIONS, start, source, receiver, power, sinr_db, fate.heard.value, fate.part.value)

    def _call(self, address: Address, depth: int, name: str, detail: str) -> None:
        self.trace.row(CALLS, self.kernel.now, address, CALL_DEPTH + depth, "bluetooth", name, detail)

    # ------------------------------------------------------------ events for hosts

    def _report(self, address: Address, event: LinkEvent) -> None:
        """Report *event* in a new event at this instant, with all others of this instant."""
        if not self._events:
            self.kernel.at(self.kernel.now, self._pass_on, WAKE)
        self._events.append((address, event))

    def _pass_on(self) -> None:
        events, self._events = self._events, []
        self._deliver((), events)

    def _deliver(self, arrivals: Iterable[Arrival], events: Iterable[tuple[Address, LinkEvent]]) -> None:
        if not self._all_on:
            arrivals = [arrival for arrival in arrivals if self._on[arrival[0]]]
            events = [item for item in events if self._on[item[0]]]
        self.deliver(arrivals, events)

    def _lost(self, master: Address, side: Address, peer: Address) -> None:
        self.devices[side].lost(master)

    # ------------------------------------------------------------ making devices

    def _device(self, address: Address, streams: Streams) -> Controller:
        stream = streams("bluetooth", "device", address)
        spread = self.settings.clock_ppm
        phase = int(stream.integers(CLOCK_RANGE * TICK))
        clock = NativeClock(phase, int(stream.integers(-spread, spread + 1)))
        narrow = NARROW if self.settings.channels == 23 else 0
        identity = Identity(address, int(stream.integers(1 << 32)) | narrow, clock)
        radio = Radio(self.kernel, self.air, identity, self._courses, self.payloads)
        return Controller(radio, self.settings, self.devices, self._report, self._call)

    def _equip(self, device: Controller, streams: Streams) -> None:
        """Make the piconet and the scanners; page scan windows lie half an interval behind inquiry scan windows."""
        settings, radio = self.settings, device.radio
        inquiry_interval = settings.inquiry_scan.interval_ticks
        page_interval = settings.page_scan.interval_ticks
        offset = int(streams("bluetooth", "windows", device.address).integers(inquiry_interval))
        draws = streams.draws("bluetooth", "backoff", device.address)
        page_offset = (offset + inquiry_interval // 2) % page_interval
        inquiry_scanner = InquiryScanner(radio, settings.inquiry_scan, offset, draws)
        page_scanner = PageScanner(radio, settings.page_scan, page_offset, device.became_slave)
        on_lost = partial(self._lost, device.address)
        piconet = Piconet(radio, settings.piconet, self._deliver, on_lost, self._transport)
        device.equip(piconet, inquiry_scanner, page_scanner)
