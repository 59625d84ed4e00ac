"""Payloads for everyone: extended advertising, event by event."""

from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from cosim.channels.ble.connections.exchange import Reception
from cosim.channels.ble.phy import CODED_S8, LE_1M, LE_2M, T_IFS, T_MAFS
from cosim.machine import Outcome, Outgoing
from cosim.units import MS, US
from tests.oracles.le_air import Packet
from tests.oracles.le_device import Device

if TYPE_CHECKING:
    from tests.oracles.le_channel import LeChannel

OVER, TIMER, START = range(3)
PHYS = {"1M": LE_1M, "2M": LE_2M, "coded": CODED_S8}
POINTER_OCTETS = 7
"""ADV_EXT_IND: length and mode, flags, ADI, AuxPtr."""
HEADER_OCTETS, ADDRESS_OCTETS, AUX_OCTETS, BEFORE_DATA = 4, 6, 3, 4
"""Length, mode, flags and ADI; the address in an AUX_ADV_IND; AuxPtr, in all but the last; the AD structure's head."""
MOST_DATA = 238
MOST_SETS = 16
STEP = 300 * US
LONGEST_PATIENCE, LONGEST_DELAY, LONGEST_WAIT = 10 * MS, 10 * MS, 1_250 * US


@dataclass(eq=False)
class Set:
    """An advertising set, and what has become of it."""

    device: Device
    number: int
    outgoing: Outgoing
    event: int = 0
    planned: int = 0
    """When its next event was to begin, not counting waits."""
    waits: int = 0
    """Number of waits, over all events."""
    having: set[int] = field(default_factory=set)
    followers: dict[int, bool] = field(default_factory=dict)
    """Who follows the event under way, and whether it has received everything so far."""

    @property
    def key(self) -> int:
        return 256 * self.number + self.event


class Sets:
    """The advertising sets of all devices."""

    def __init__(self, channel: "LeChannel") -> None:
        self.channel = channel
        size = len(channel.devices)
        self.draws = [channel.streams.draws("ble", "sets", address) for address in range(size)]
        self.counts = [0] * size
        self.active: list[list[Set]] = [[] for _ in range(size)]
        self.waiting: list[deque[Outgoing]] = [deque() for _ in range(size)]

    def send(self, device: Device, outgoing: Outgoing) -> None:
        """Queue a payload."""
        address = device.address
        self.waiting[address].append(outgoing)
        self.fill(address)

    def fill(self, address: int) -> None:
        """Let waiting sets begin as far as there is room."""
        while self.waiting[address] and len(self.active[address]) < MOST_SETS:
            each = Set(self.channel.devices[address], self.counts[address], self.waiting[address].popleft())
            self.counts[address] += 1
            self.active[address].append(each)
            self.plan(each, self.channel.now)

    def plan(self, each: Set, since: int) -> None:
        """Plan the next event, an advDelay after *since*."""
        each.planned = since + self.draws[each.device.address].below(LONGEST_DELAY + 1, each.key)
        self.channel.at(each.planned, START, self.attempt, each)

    def layout(self, each: Set) -> list[Packet]:
        """Return the packets of an event that begins now."""
        address, time = each.device.address, self.channel.now
        packets = []
        for index in (37, 38, 39):
            packets.append(Packet(address, time, LE_1M, POINTER_OCTETS, index))
            time = packets[-1].end + T_IFS
        time += T_MAFS - T_IFS
        left, phy = len(each.outgoing.payload), PHYS[self.channel.settings.broadcast.phy]
        for number in range(max(1, -(-left // MOST_DATA))):
            data, last = min(left, MOST_DATA), left <= MOST_DATA
            octets = (
                HEADER_OCTETS + BEFORE_DATA + data + (0 if number else ADDRESS_OCTETS) + (0 if last else AUX_OCTETS)
            )
            index = self.draws[address].below(37, each.key, number, 1)
            packets.append(Packet(address, time, phy, octets, index))
            time += -(-(phy.air_time(octets) + T_MAFS) // STEP) * STEP
            left -= data
        return packets

    def attempt(self, each: Set) -> None:
        """Begin an event, or wait."""
        device, now = each.device, self.channel.now
        if each not in self.active[device.address]:
            return
        packets = self.layout(each)
        end = packets[-1].end
        busy = device.taken(now, end) + device.advertises(now, now + 1)
        patience = each.planned + LONGEST_PATIENCE
        if now < patience:
            busy += [min(time, patience) for time in device.planned(now, end)]
        if busy:
            each.waits += 1
            more = self.draws[device.address].below(LONGEST_WAIT, each.key, each.waits, 2)
            self.channel.at(max(busy) + 1 + more, START, self.attempt, each)
            return
        device.take(now, end, each)
        each.followers = {}
        for place, packet in enumerate(packets):
            self.channel.at(packet.start, START, self.begin, each, packets, place)
        self.channel.at(end, OVER, self.over, each, max(end, now + self.channel.settings.broadcast.interval))

    def begin(self, each: Set, packets: list[Packet], place: int) -> None:
        """Put a packet on the air."""
        if each in self.active[each.device.address]:
            self.channel.air.put(packets[place])
            self.channel.at(packets[place].end, OVER, self.sent, each, packets, place)

    def sent(self, each: Set, packets: list[Packet], place: int) -> None:
        """Take what became of a packet that ends now."""
        packet, channel = packets[place], self.channel
        if place < 3:
            self.pointed(each, packet, packets[3].start, packets[-1].end)
            return
        for address, good in each.followers.items():
            receiver = channel.devices[address]
            whole = each.device.was_on(packet) and receiver.was_on(packet)
            whole = whole and not receiver.taken(packet.start, packet.end, each)
            each.followers[address] = good and whole and channel.air.reception(packet, address) is Reception.HEARD
        if place == len(packets) - 1:
            for address in sorted(address for address, good in each.followers.items() if good):
                each.having.add(address)
                channel.arrive(address, each.outgoing.payload, packet, broadcast=True)

    def pointed(self, each: Set, packet: Packet, begin: int, end: int) -> None:
        """Let those who hear an ADV_EXT_IND follow."""
        for receiver in self.channel.devices:
            address = receiver.address
            if address in each.having or address in each.followers or not self.channel.hears(receiver, packet):
                continue
            if not receiver.taken(begin, end) and not receiver.planned(begin, end):
                receiver.take(begin, end, each)
                each.followers[address] = True

    def over(self, each: Set, since: int) -> None:
        """Go on to the next event, planned an advDelay after *since*, or to the next set."""
        device = each.device
        if each not in self.active[device.address]:
            return
        each.event += 1
        if each.event < self.channel.settings.broadcast.events:
            self.plan(each, since)
            return
        self.active[device.address].remove(each)
        self.channel.over(device.address, each.outgoing, Outcome.SENT)
        self.fill(device.address)

    def flush(self, device: Device) -> None:
        """Take out the payloads that no set has been made for."""
        while self.waiting[device.address]:
            self.channel.over(device.address, self.waiting[device.address].popleft(), Outcome.FLUSHED)

    def vanish(self, device: Device) -> None:
        """Forget the sets of a device that is switched off."""
        self.active[device.address].clear()
        self.waiting[device.address].clear()
