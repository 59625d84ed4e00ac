"""Connectable advertising, event by event."""

from typing import TYPE_CHECKING

from cosim.channels.ble.advertising import REQUEST_ROOM, Advertiser, Event
from cosim.channels.ble.phy import LE_1M
from cosim.units import US
from tests.oracles.le_air import Packet
from tests.oracles.le_device import Device

if TYPE_CHECKING:
    from tests.oracles.le_channel import LeChannel

OVER, TIMER, START = range(3)


def name_octets(device: Device) -> int:
    """Return how long the structure with the name ``robot N`` is."""
    return 2 + len(f"robot {device.address}")


class Advertising:
    """The connectable advertising of all devices."""

    def __init__(self, channel: "LeChannel") -> None:
        self.channel = channel
        self.active: bool = channel.settings.scan.active

    def octets(self, device: Device) -> int:
        """Return the payload of an ADV_IND: address, flags, and the name unless that is asked for."""
        return 6 + 3 + (0 if self.active else name_octets(device))

    def room(self, device: Device) -> int:
        """Return the time behind an ADV_IND: for a CONNECT_IND, and for a SCAN_REQ and its answer if they come."""
        asked = LE_1M.air_time(6 + 6) + LE_1M.air_time(6 + name_octets(device)) + 3 * 150 * US
        return max(asked, REQUEST_ROOM) if self.active else REQUEST_ROOM

    def begin(self, device: Device, local: int | None = None) -> None:
        """Let *device* begin anew, at once or at a *local* time."""
        channel = self.channel
        delays = channel.streams.draws("ble", "delay", device.address, device.runs)
        device.runs += 1
        first = device.clock.local(channel.now) if local is None else local
        if device.clock.at_local(first) < channel.now:  # that local time began a nanosecond ago
            first += 1
        air, interval = LE_1M.air_time(self.octets(device)), channel.settings.advertise.interval
        device.run = run = Advertiser(device.clock, first, interval, air, delays, self.room(device))
        event = Event(0, first)
        channel.at(max(channel.now, run.start(event, 0)), START, self.event, device, run, event)

    def stop(self, device: Device) -> None:
        """Let *device* send no more packets."""
        device.run = None
        for event in device.events:
            event[1] = min(event[1], self.channel.now)

    def want(self, device: Device, enabled: bool) -> None:
        """Let *device* be found, or not."""
        if enabled and not device.wanted:
            self.begin(device)
        elif not enabled and device.wanted:
            self.stop(device)
        device.wanted = enabled

    def event(self, device: Device, run: Advertiser, event: Event) -> None:
        """Begin an event, if the antenna is free for it."""
        channel, now = self.channel, self.channel.now
        if device.run is not run:
            return
        end = run.start(event, 2) + run.air_time + self.room(device)
        if not device.taken(now, end) and not device.planned(now, end):
            device.events = [each for each in device.events[-9:] if each[0] < each[1]]
            device.events.append([now, end])
            for pdu, index in enumerate(run.channels):
                channel.at(max(now, run.start(event, pdu)), START, self.send, device, run, index)
        following = run.after(event)
        channel.at(run.start(following, 0), START, self.event, device, run, following)

    def send(self, device: Device, run: Advertiser, index: int) -> None:
        """Put an ADV_IND on the air, unless a request to connect is on it."""
        begin, end = device.requested
        if device.run is run and not begin <= self.channel.now < end:
            packet = Packet(device.address, self.channel.now, LE_1M, self.octets(device), index)
            self.channel.air.put(packet)
            self.channel.at(packet.end, OVER, self.sent, device, packet)

    def sent(self, device: Device, packet: Packet) -> None:
        """Let all who hear an ADV_IND at its end know."""
        for receiver in self.channel.devices:
            if self.channel.hears(receiver, packet):
                self.channel.procedures.heard(receiver, device, packet)
