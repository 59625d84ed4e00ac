"""Connectable advertising of one device, by which it is found and connected: it follows from arithmetic.

An event is not sent if anything else takes the antenna during it. What its packets are asked for while it goes on takes
no longer than the time that is between them anyway.
"""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import Final

from cosim.channels.air.arbitration import Rank
from cosim.channels.ble.advertising import REQUEST_ROOM, SCAN_REQUEST, Advertiser, Event
from cosim.channels.ble.antenna import Antenna
from cosim.channels.ble.bits.access import ADVERTISING_ADDRESS
from cosim.channels.ble.bits.crc import ADVERTISING_INIT
from cosim.channels.ble.bits.pdu import AdvertisingType, DeviceAddress, Undirected, encode_advertising
from cosim.channels.ble.packets import LOOKBACK, Sent
from cosim.channels.ble.phy import HEADER_OCTETS, LE_1M, T_IFS
from cosim.channels.clock import NativeClock
from cosim.kernel import Kernel
from cosim.machine import BROADCAST, Address
from cosim.randomness import Draws
from cosim.units import Time

_FLAGS: Final = bytes.fromhex("020106")
"""AD structure: generally discoverable, no BR/EDR."""
_COMPLETE_NAME: Final = 0x09
_COMPANY: Final = 0xC05100000000
"""What device addresses begin with: random static ones have two set bits at the top."""


def device_address(address: Address) -> DeviceAddress:
    """Return the address on the air of the robot *address*."""
    return DeviceAddress(_COMPANY | address, random=True)


def advertisement(address: Address, named: bool = True) -> bytes:
    """Return the ADV_IND, header and payload, that the robot *address* sends: its flags and, if *named*, its name."""
    data = _FLAGS + (_name(address) if named else b"")
    return encode_advertising(Undirected(AdvertisingType.ADV_IND, device_address(address), data, algorithm_2=True))


def scan_response(address: Address) -> bytes:
    """Return the SCAN_RSP, header and payload, that the robot *address* sends: its name."""
    return encode_advertising(Undirected(AdvertisingType.SCAN_RSP, device_address(address), _name(address)))


def _name(address: Address) -> bytes:
    name = f"robot {address}".encode()
    return bytes([1 + len(name), _COMPLETE_NAME]) + name


class Beacon:
    """The advertising of the device *address*; *draws* makes the stream of advDelay of the n-th time that it begins."""

    def __init__(
        self,
        address: Address,
        clock: NativeClock,
        interval: Time,
        antenna: Antenna,
        draws: Callable[[int], Draws],
        asked: bool = False,
    ) -> None:
        """*asked*: whether it leaves its name to a scan response, and the time for that between its packets."""
        self.pdu = advertisement(address, named=not asked)
        self.response = scan_response(address)
        """What it answers a SCAN_REQ with."""
        answer = LE_1M.air_time(len(self.response) - HEADER_OCTETS)
        self._gap = max(REQUEST_ROOM, T_IFS + SCAN_REQUEST + T_IFS + answer + T_IFS) if asked else REQUEST_ROOM
        self.advertiser: Advertiser | None = None
        """None while it does not advertise."""
        self.since: Time = 0
        """When it began to advertise last."""
        self.written: Time = -1
        """Start of the last packet of it that tables have: several may hear the same."""
        self._address, self._clock, self._interval = address, clock, interval
        self._antenna = antenna
        self._draws = draws
        self._begun = 0
        self._due: tuple[Time, Time] = (0, 0)
        """An instant, and the first after it at which a packet is due."""
        self._left_out: deque[Time] = deque(maxlen=_KEPT)
        """Begins of the last events that it has left out, as another radio of the robot had the air."""
        self._requested: tuple[Time, Time] = (0, 0)
        """From when to when the last request to connect to it is on the air."""
        self._ended: list[tuple[Advertiser, Time]] = []  # (advertiser, when it stopped)
        self.changed: Callable[[Time], None] = lambda now: None
        """Called with the instant at which it begins or ends."""

    def begin(self, now: Time, after: Time) -> None:
        """Advertise from now on, first *after* a while of its own clock."""
        if self.advertiser is None:
            first, air_time = self._clock.local(now) + after, LE_1M.air_time(len(self.pdu) - HEADER_OCTETS)
            first += self._clock.at_local(first) < now  # a local time may last two ns: it is to begin now or later
            draws = self._draws(self._begun)
            self.advertiser = Advertiser(self._clock, first, self._interval, air_time, draws, self._gap)
            self.since, self._begun = now, self._begun + 1
            self._due = 0, 0
            self.changed(now)

    def end(self, now: Time) -> None:
        """Do not advertise any more: what is on the air goes to its end, and nothing begins."""
        if self.advertiser is not None:
            self._ended = [item for item in self._ended if item[1] > now - LOOKBACK]
            self._ended.append((self.advertiser, now))
            self.advertiser = None
            self.changed(now)

    @property
    def runs(self) -> list[tuple[Advertiser, Time, Time]]:
        """Its advertisers of late, each with the instants since when and up to when it begins packets."""
        runs = [(advertiser, 0, over) for advertiser, over in self._ended]
        return runs if self.advertiser is None else [*runs, (self.advertiser, self.since, LATER)]

    def packet(self, channel: int, start: Time) -> Sent:
        """Return its packet on *channel* that begins at *start*."""
        octets = len(self.pdu) - HEADER_OCTETS
        of_link_layer = ADVERTISING_ADDRESS, ADVERTISING_INIT, self.pdu
        return Sent(start, self._address, BROADCAST, "ADV_IND", channel, LE_1M, octets, 0, *of_link_layer)

    def sends(self, advertiser: Advertiser, event: Event) -> bool:
        """Return whether it sends *event*: nothing else takes the antenna, for all that is known as it begins."""
        begin, end = self.span(advertiser, event)
        return begin not in self._left_out and self._antenna.taken_until(begin, end, begin) is None

    def request(self, start: Time, end: Time) -> None:
        """Hear a request to connect in [start, end): no packet begins meanwhile.

        There is room for a request between its packets, but not for a sender's clock that is slower than its own.
        """
        self._requested = start, end

    def hears(self, start: Time) -> bool:
        """Return whether a packet that is due at *start* is not sent, as a request to connect is on the air."""
        return self._requested[0] <= start < self._requested[1]

    def leave_out(self, begin: Time) -> None:
        """Do not send the event that begins now, at *begin*."""
        self._left_out.append(begin)

    def span(self, advertiser: Advertiser, event: Event) -> tuple[Time, Time]:
        """Return from when to when *event* lasts, with the time for the last request."""
        last = len(advertiser.channels) - 1
        begin = advertiser.start(event, 0)
        return begin, advertiser.start(event, last) + advertiser.air_time + advertiser.gap

    def _events(self, since: Time, until: Time) -> Iterator[tuple[Advertiser, Event, Time]]:
        """Yield its events of which a packet begins in [since, until), with the instant at which it stops to send."""
        spans = [(advertiser, over) for advertiser, over in self._ended if over > since]
        if self.advertiser is not None and self.begins_after(since - 1) < until:
            spans.append((self.advertiser, until))
        for advertiser, over in spans:
            event = advertiser.event_from(since)
            begin = advertiser.start(event, 0)
            while begin < min(until, over):
                yield advertiser, event, over
                event = advertiser.after(event)
                begin = advertiser.start(event, 0)

    def taken_until(self, start: Time, end: Time) -> Time | None:
        """Return the end of the event that it sends in [start, end), or in part of that; None if it sends none."""
        found = None
        for advertiser, event, over in self._events(start - _LONGEST_EVENT, end):
            begin, ends = self.span(advertiser, event)
            ends = ends if advertiser is self.advertiser else min(ends, over)
            if begin < min(end, over) and ends > start and self.sends(advertiser, event):
                found = ends
        return found

    def begins_after(self, time: Time) -> Time:
        """Return the first instant after *time* at which a packet of it is due, even if the antenna may be taken."""
        if self.advertiser is None:
            return LATER
        asked, due = self._due
        if not asked <= time < due:
            event, turn = self.advertiser.event_from(time + 1), 0
            while (due := self.advertiser.start(event, turn)) <= time:  # its last PDU begins later than that
                turn += 1
            self._due = time, due
        return due

    def packets(self, since: Time, until: Time) -> Iterator[Sent]:
        """Yield what it sends in [since, until)."""
        for advertiser, event, over in self._events(since, until):
            if self.sends(advertiser, event):
                for turn, channel in enumerate(advertiser.channels):
                    start = advertiser.start(event, turn)
                    if since <= start < min(until, over) and not self.hears(start):
                        yield self.packet(channel, start)


class Asking:
    """Asks for the air for each event of a *beacon* as it begins, where another radio of the robot may have it."""

    def __init__(self, kernel: Kernel, beacon: Beacon, antenna: Antenna) -> None:
        self._kernel, self._beacon, self._antenna = kernel, beacon, antenna

    def begin(self) -> None:
        """Ask for the events of the advertising that begins now."""
        advertiser = self._beacon.advertiser
        if advertiser is not None and self._antenna.seat is not None:
            self._wait(advertiser, advertiser.event_from(self._kernel.now))

    def _wait(self, advertiser: Advertiser, event: Event) -> None:
        self._kernel.at(advertiser.start(event, 0), lambda: self._ask(advertiser, event))

    def _ask(self, advertiser: Advertiser, event: Event) -> None:
        if self._beacon.advertiser is not advertiser:
            return
        begin, end = self._beacon.span(advertiser, event)
        if self._beacon.sends(advertiser, event):
            if self._antenna.refused_until(begin, begin, end, Rank.EMPTY) is None:
                self._antenna.advertises = begin, end
            else:
                self._beacon.leave_out(begin)
        self._wait(advertiser, advertiser.after(event))


class Beacons:
    """The beacons of all devices: most are asked for times at which none of them sends."""

    def __init__(self, beacons: Sequence[Beacon]) -> None:
        self._beacons = beacons
        self._changed: Time = 0
        """When one of them began or ended last."""
        self._due: tuple[Time, Time] = (0, 0)
        """An instant, and the first after it at which a packet of one of them is due."""
        for beacon in beacons:
            beacon.changed = self._change

    def _change(self, now: Time) -> None:
        self._changed, self._due = now, (0, 0)

    def begins_after(self, time: Time) -> Time:
        """Return the first instant after *time* at which a packet is due, even if the antenna may be taken."""
        asked, due = self._due
        if not asked <= time < due:
            due = min(beacon.begins_after(time) for beacon in self._beacons)
            self._due = time, due
        return due

    def packets(self, since: Time, until: Time) -> Iterator[Sent]:
        """Yield what they send in [since, until), device by device."""
        if since < self._changed or self.begins_after(since - 1) < until:
            for beacon in self._beacons:
                yield from beacon.packets(since, until)


_KEPT: Final = 64
"""Number of events, of 20 ms at least, that anybody may ask for yet."""
LATER: Final[Time] = 1 << 61
"""An instant that no run reaches."""
_LONGEST_EVENT: Final = 3 * (LE_1M.air_time(37) + LE_1M.air_time(34) + 150_000)
"""Longest duration of an event."""
