"""LE devices: what each knows and what its antenna is doing, as plain lists."""

from collections import deque
from dataclasses import dataclass, field

from cosim.channels.ble.advertising import Advertiser
from cosim.channels.ble.channels import ADVERTISING
from cosim.channels.ble.connections.arq import Fragment
from cosim.channels.ble.connections.exchange import Side, exchange_time
from cosim.channels.ble.connections.link import Link
from cosim.channels.ble.scanning import ScanWindows
from cosim.channels.ble.settings import BleSettings, ScanSettings
from cosim.channels.clock import NativeClock
from cosim.machine import Inquire, Outgoing, Page
from cosim.randomness import Streams
from cosim.units import MS
from tests.oracles.le_air import Packet

KEPT = 100 * MS
"""Time for which it is kept what antennas have been doing."""


@dataclass(eq=False)
class Taking:
    """A time [begin, end) for which an antenna is taken by *owner*."""

    begin: int
    end: int
    owner: object


@dataclass(eq=False)
class Procedure:
    """An inquiry or a page under way."""

    command: Inquire | Page
    begin: int
    found: list[int] = field(default_factory=list)
    connecting: bool = False
    """True once a page has answered an advertisement."""
    limit: int = 1
    count: int = 1
    """How many advertisements come up to that which is asked for a name, and that number's upper limit."""
    row: int = 0
    """How many requests have been answered in a row, or failed if it is negative."""
    asked: int = 0
    """Requests that are over."""
    number: int = 0
    """How many inquiries the device has begun before."""


@dataclass(eq=False)
class Payload:
    """A payload for one, and the fragments that it was cut into."""

    outgoing: Outgoing
    fragments: list[Fragment] = field(default_factory=list)


@dataclass(eq=False)
class Session:
    """A link with its two devices, the central first, and which of its ends there are."""

    link: Link
    devices: "tuple[Device, Device]"
    part: int
    alive: list[bool]
    resting: bool = False
    """True if its polls are taken to be heard, whatever else there is."""
    on_air: Packet | None = None
    watched: list[int] = field(default_factory=lambda: [-1, -1])
    payloads: tuple[list[Payload], list[Payload]] = field(default_factory=lambda: ([], []))
    intervals: list[int] = field(default_factory=lambda: [0, 0])
    """What the hosts of both ends know of how long from one event to the next; 0: as at first."""

    def least(self) -> int:
        """Return how long a poll, an empty answer and the spaces behind both last."""
        down, up = self.link.central.phys
        return exchange_time(down, 0, up, 0)

    def planned(self, begin: int, end: int) -> list[int]:
        """Return the ends of the least exchanges, from all anchors, that overlap [begin, end)."""
        least, clock, anchors = self.least(), self.devices[0].clock, self.link.anchors
        event, found = max(0, anchors.first_from(clock, begin - least + 1)), []
        while (start := clock.at_local(anchors.at(event))) < end:
            found.append(start + least)
            event += 1
        return found

    def anchor_after(self, time: int) -> int:
        """Return the first anchor after *time*."""
        clock, anchors = self.devices[0].clock, self.link.anchors
        return clock.at_local(anchors.at(max(0, anchors.first_from(clock, time + 1))))


class Device:
    """The device at *address*."""

    def __init__(self, address: int, settings: BleSettings, streams: Streams) -> None:
        self.address = address
        self.stream = stream = streams("ble", "device", address)
        longest = settings.advertise.interval + settings.scan.interval + settings.listen.interval
        phase = int(stream.integers(longest))
        self.clock = NativeClock(phase, int(stream.integers(-settings.clock_ppm, settings.clock_ppm, endpoint=True)))
        self.scan, self.listen = self.windows(settings.scan), self.windows(settings.listen)
        self.first = phase + int(stream.integers(settings.advertise.interval))
        self.on, self.on_since, self.wanted = True, 0, True
        self.runs = 0
        """How often it has begun to advertise."""
        self.run: Advertiser | None = None
        self.events: list[list[int]] = []
        """Times [begin, end) of the events of connectable advertising that were sent."""
        self.requested = 0, 0
        """When the last request to connect to it is on the air, [begin, end)."""
        self.takings: list[Taking] = []
        self.procedure: Procedure | None = None
        self.askers: list[tuple[int, Device, Procedure]] = []
        """Who has asked for its name at this instant."""
        self.inquiries = 0
        """How many it has begun."""
        self.procedures: deque[Inquire | Page] = deque()
        self.links: dict[int, tuple[Session, Side]] = {}

    def windows(self, settings: ScanSettings) -> ScanWindows:
        """Draw the windows of a scan."""
        turn = int(self.stream.integers(3))
        offset = int(self.stream.integers(settings.interval))
        channels = ADVERTISING[turn:] + ADVERTISING[:turn]
        return ScanWindows(self.clock, offset, settings.interval, settings.window, channels)

    def take(self, begin: int, end: int, owner: object) -> None:
        """Note that *owner* takes the antenna for [begin, end)."""
        self.takings = [each for each in self.takings if each.end > begin - KEPT]
        self.takings.append(Taking(begin, end, owner))

    def taken(self, begin: int, end: int, but: object = None) -> list[int]:
        """Return the ends of what takes the antenna at any time of [begin, end)."""
        return [
            each.end
            for each in self.takings
            if each.begin < end and begin < each.end and (but is None or each.owner is not but)
        ]

    def planned(self, begin: int, end: int) -> list[int]:
        """Return the ends of what the antenna is planned for at any time of [begin, end)."""
        return [time for session, _ in self.links.values() for time in session.planned(begin, end)]

    def advertises(self, begin: int, end: int) -> list[int]:
        """Return the ends of the own connectable events of which any time is in [begin, end)."""
        return [each[1] for each in self.events if each[0] < end and begin < each[1]]

    def was_on(self, packet: Packet) -> bool:
        """Return whether it was on during all of *packet*, which ends now."""
        return self.on and self.on_since <= packet.start

    def listened(self, packet: Packet) -> bool:
        """Return whether all of *packet*, which ends now, lies in one window."""
        windows = self.listen if self.procedure is None else self.scan
        return windows.channel(packet.start) == packet.channel == windows.channel(packet.end - 1)
