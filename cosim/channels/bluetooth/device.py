"""Bluetooth as a channel: one device for each robot, on one air, and what hosts ask of them.

Reach is a disc: two devices that are on hear each other up to ``range_m``, everything within, or nothing. It changes
only when a robot crosses the edge of another's disc or a radio is switched; piconets are advanced to that instant with
the old reach first, so that what they compute late is what would have happened.
"""

from collections.abc import Iterable
from typing import Any, Final, Literal

import numpy as np
from pydantic import Field

from cosim.channels.base import Arrival, Channel, Positions
from cosim.channels.bluetooth.clock import NativeClock
from cosim.channels.bluetooth.controller import Controller, Identity
from cosim.channels.bluetooth.frames import FrameLog
from cosim.channels.bluetooth.inquiry import CLOCK_RANGE, InquiryScanner, InquiryScanSettings, InquirySettings
from cosim.channels.bluetooth.packets import ACL, AclName
from cosim.channels.bluetooth.paging import PageScanner, PageSettings
from cosim.channels.bluetooth.piconet import Piconet, PiconetSettings
from cosim.channels.bluetooth.radio import Air, Frame, Heard
from cosim.channels.bluetooth.scanning import ScanSettings
from cosim.jit import njit
from cosim.kernel import WAKE, Kernel
from cosim.machine import (
    BROADCAST,
    Address,
    Disconnect,
    Flush,
    Inquire,
    LinkCommand,
    LinkEvent,
    Metric,
    Outgoing,
    Page,
    Scan,
    Share,
)
from cosim.randomness import Streams
from cosim.settings import Settings
from cosim.trace import CALLS, FRAMES, Trace
from cosim.units import TICK, Time, from_seconds, to_seconds

CALL_DEPTH: Final = 4
"""Depth of the topmost call of this room in the table of calls: four rooms of a protocol lie above it."""


class BluetoothSettings(Settings):
    """Parameters of the Bluetooth channel."""

    kind: Literal["bluetooth"] = "bluetooth"
    range_m: float | None = Field(default=None, gt=0, description="m, reach of a radio; without limit if not given")
    packet_types: tuple[AclName, ...] = Field(
        default=("DM1", "DH1", "DM3", "DH3", "DM5", "DH5"), min_length=1, description="packets that carry payloads"
    )
    n_bc: int = Field(default=1, ge=1, description="how often a broadcast is sent")
    t_poll_slots: int = Field(
        default=40, ge=16, multiple_of=2, description="slots of 625 us until an idle slave is polled again"
    )
    supervision_s: float = Field(default=20.0, gt=0, description="s without a frame until a link is taken for lost")
    clock_ppm: int = Field(default=20, ge=0, le=250, description="native clocks drift by up to so many ppm")
    inquiry: InquirySettings = Field(default_factory=InquirySettings, description="how devices look for others")
    inquiry_scan: InquiryScanSettings = Field(
        default_factory=InquiryScanSettings, description="how devices let themselves be found"
    )
    page: PageSettings = Field(default_factory=PageSettings, description="how devices ask for a link")
    page_scan: ScanSettings = Field(default_factory=ScanSettings, description="how devices let themselves be paged")
    idle_frames: bool = Field(default=False, description="whether recorded frames include idle POLL and NULL")


@njit(cache=True)
def _reach_differs(positions_m: Positions, range_m: float, near: np.ndarray[Any, np.dtype[np.bool_]]) -> bool:
    """Return whether any pair of *positions_m* is nearer than, or beyond, *range_m* otherwise than *near* says."""
    for a in range(len(positions_m)):
        for b in range(a):
            x, y = positions_m[a, 0] - positions_m[b, 0], positions_m[a, 1] - positions_m[b, 1]
            if (x * x + y * y <= range_m * range_m) != near[a, b]:
                return True
    return False


class BluetoothChannel(Channel):
    """All devices of a run. What they draw depends on the streams "bluetooth", purpose, address only."""

    metrics = (
        Metric("radio_inquiry_s", "s", "time that all devices together have spent in inquiry"),
        Metric(
            "radio_paging_s", "s", "time that all devices together have spent in paging, up to each link or failure"
        ),
        Metric("frames_sent", "1", "packets with payload, retransmissions included"),
        Metric("idle_polls", "1", "polls of idle slaves, computed in bulk"),
        *(Metric(f"frames_{kind.lower()}", "1", f"{kind} packets sent") for kind in (*ACL, "POLL", "NULL")),
    )

    def __init__(self, settings: BluetoothSettings, kernel: Kernel, trace: Trace, size: int, streams: Streams) -> None:
        super().__init__(kernel, trace, size)
        self.settings = settings
        self._near = np.ones((size, size), dtype=np.bool_)
        self._on = np.ones(size, dtype=np.bool_)
        self._reach_rows: list[list[bool]] = []
        self._update_reach()
        self._calls_wanted = trace.wants(CALLS)
        self._idle_wanted = settings.idle_frames and trace.wants(FRAMES)
        self._range_m = settings.range_m
        self._air = Air(self.hears, self._record if trace.wants(FRAMES) else None)
        self._news: list[tuple[Address, LinkEvent]] = []
        self.devices: list[Controller] = []
        for address in range(size):
            self.devices.append(self._device(address, streams))
        for device in self.devices:
            self._equip(device, streams)

    # ------------------------------------------------------------ what hosts ask

    def send(self, source: Address, outgoing: Outgoing) -> None:
        """Queue a payload at the device of *source*; nothing happens if that is off."""
        device = self.devices[source]
        if device.powered:
            if self._calls_wanted:
                receiver = "all" if outgoing.destination == BROADCAST else outgoing.destination
                detail = f"{len(outgoing.payload)} bytes to {receiver}"
                for depth, name in enumerate(("l2cap.data_request", "hci.acl_data", "lc.transmit")):
                    self._call(source, depth, name, detail)
            device.send(outgoing)

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
                device.piconet().close(source, command.peer)
            case Flush():
                device.piconet().flush(source, command.destination)
            case Share():
                pass  # TODO

    # ------------------------------------------------------------ reach

    def hears(self, transmitter: Address, receiver: Address, at: Time) -> bool:
        """Return whether *receiver* is in reach of *transmitter* now."""
        return self._reach_rows[transmitter][receiver]

    def in_reach(self, address: Address) -> tuple[Address, ...]:
        """Return the other devices that are on and within range, if this one is on."""
        return tuple(other for other, near in enumerate(self._reach_rows[address]) if near)

    def moved(self, positions_m: Positions) -> None:
        """Take the robots' new positions; nothing changes unless somebody has come into reach or left it."""
        range_m = self._range_m
        if range_m is None or not _reach_differs(positions_m, range_m, self._near):
            return
        self._reach_changes()
        offsets = positions_m[:, None, :] - positions_m[None, :, :]
        self._near = (offsets**2).sum(axis=2) <= range_m * range_m
        self._update_reach()

    def power(self, address: Address, on: bool) -> None:
        """Switch the radio at *address* on or off. Its host is told nothing; others find out by supervision."""
        device = self.devices[address]
        if on == device.powered:
            return
        if not on:
            device.switch_off()
        self._reach_changes()
        self._on[address] = on
        self._update_reach()
        if on:
            device.switch_on()

    def advance(self, now: Time) -> None:
        """Record idle frames up to *now* if they are wanted; nothing else needs it, for reach changes in ``moved``."""
        if self._idle_wanted:
            for device in self.devices:
                device.master_of.advance(now)

    def _reach_changes(self) -> None:
        """Advance all piconets to now with the reach that was; they ask for the new one when they need it."""
        for device in self.devices:
            device.master_of.reach_changed(self.kernel.now)

    def _update_reach(self) -> None:
        reach = self._near & self._on & self._on[:, None]
        np.fill_diagonal(reach, False)
        self._reach_rows = reach.tolist()

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
        return totals

    def _record(self, frame: Frame, heard: Heard) -> None:
        start, duration, kind, source, destination, channel, lt_addr, length = frame
        self.trace.row(FRAMES, start, source, destination, duration, kind, channel, lt_addr, length, heard.value)

    def _call(self, address: Address, depth: int, name: str, detail: str) -> None:
        self.trace.row(CALLS, self.kernel.now, address, CALL_DEPTH + depth, "bluetooth", name, detail)

    # ------------------------------------------------------------ news

    def _tell(self, address: Address, event: LinkEvent) -> None:
        """Report *event* in a new event at this instant, with all others of this instant."""
        if not self._news:
            self.kernel.at(self.kernel.now, self._pass_on, WAKE)
        self._news.append((address, event))

    def _pass_on(self) -> None:
        news, self._news = self._news, []
        self._deliver((), news)

    def _deliver(self, arrivals: Iterable[Arrival], news: Iterable[tuple[Address, LinkEvent]]) -> None:
        if not self._on.all():
            arrivals = [arrival for arrival in arrivals if self._on[arrival[0]]]
            news = [item for item in news if self._on[item[0]]]
        self.deliver(arrivals, news)

    def _lost(self, side: Address, peer: Address) -> None:
        self.devices[side].lost(peer)

    # ------------------------------------------------------------ making devices

    def _device(self, address: Address, streams: Streams) -> Controller:
        stream = streams("bluetooth", "device", address)
        spread = self.settings.clock_ppm
        phase = int(stream.integers(CLOCK_RANGE * TICK))
        clock = NativeClock(phase, int(stream.integers(-spread, spread + 1)))
        identity = Identity(address, int(stream.integers(1 << 32)), clock)
        return Controller(
            self.kernel,
            self._air,
            identity,
            self.settings.inquiry,
            self.settings.page,
            self.settings.t_poll_slots,
            self.devices,
            self._tell,
            self._call,
        )

    def _equip(self, device: Controller, streams: Streams) -> None:
        """Make the piconet and the scanners; page scan windows lie half an interval behind inquiry scan windows."""
        settings, identity = self.settings, device.identity
        inquiry_interval = settings.inquiry_scan.interval_ticks
        page_interval = settings.page_scan.interval_ticks
        offset = int(streams("bluetooth", "windows", device.address).integers(inquiry_interval))
        draws = streams.draws("bluetooth", "backoff", device.address)
        inquiry_scanner = InquiryScanner(
            self.kernel, self._air, device.address, identity.clock, settings.inquiry_scan, offset, draws
        )
        page_scanner = PageScanner(
            self.kernel,
            self._air,
            device.address,
            identity.hop_address,
            identity.clock,
            settings.page_scan,
            (offset + inquiry_interval // 2) % page_interval,
            device.became_slave,
        )
        device.equip(self._piconet(identity), inquiry_scanner, page_scanner)

    def _piconet(self, identity: Identity) -> Piconet:
        settings = self.settings
        piconet = PiconetSettings(
            tuple(ACL[name] for name in settings.packet_types),
            settings.n_bc,
            settings.t_poll_slots,
            from_seconds(settings.supervision_s),
        )
        wanted = self.trace.wants(FRAMES)
        frames = FrameLog(self._air, identity.clock, identity.hop_address, wanted, self._idle_wanted)
        return Piconet(
            self.kernel, identity.address, identity.clock, piconet, self.hears, frames, self._deliver, self._lost
        )
