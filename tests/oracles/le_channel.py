"""The channel ``ble``, slow and plain: a heap of all that happens, nothing skipped, nothing computed ahead.

Written from docs/ble_readings.md and the Core Specification v5.0, Vol 6 Part B. Every advertising event of every
device, every poll and every answer happens, one after the other. Links, advertisers' events, windows and errors are
those of the pure layers, which have oracles of their own.
"""

import heapq
from collections.abc import Callable, Sequence
from itertools import count
from typing import Any

from cosim.channels.ble.connections.exchange import Reception as Heard
from cosim.channels.ble.settings import BleSettings
from cosim.machine import (
    BROADCAST,
    Disconnect,
    Fate,
    Flush,
    Inquire,
    LinkCommand,
    LinkEvent,
    Outcome,
    Outgoing,
    Page,
    Reception,
    Scan,
    Sniff,
)
from cosim.randomness import Streams
from tests.oracles.le_advertising import Advertising
from tests.oracles.le_air import Air, Packet
from tests.oracles.le_device import Device
from tests.oracles.le_links import Links
from tests.oracles.le_procedures import Procedures
from tests.oracles.le_sets import Sets

OVER, TIMER, START = range(3)
"""Phases of an instant: packets end, then timers run out, then packets begin."""
News = tuple[int, int, Any]
"""(time, address, a link event or (payload, how it arrived))"""


class LeChannel:
    """A channel of *size* devices with *settings*."""

    def __init__(self, size: int, seed: int, settings: BleSettings) -> None:
        self.now, self.settings = 0, settings
        self.streams = Streams(seed)
        self.news: list[News] = []
        self.air = Air(settings, size, self.streams)
        self.devices = [Device(address, settings, self.streams) for address in range(size)]
        self._queue: list[tuple[int, int, int, Callable[..., None], tuple[Any, ...]]] = []
        self._numbers = count()
        self.advertising, self.procedures = Advertising(self), Procedures(self)
        self.links, self.sets = Links(self), Sets(self)
        for device in self.devices:
            self.advertising.begin(device, device.first)

    # ---------------------------------------------------------------- time

    def at(self, time: int, phase: int, call: Callable[..., None], *arguments: Any) -> None:
        """Call at *time*."""
        assert time >= self.now
        heapq.heappush(self._queue, (time, phase, next(self._numbers), call, arguments))

    def until(self, time: int) -> None:
        """Let everything happen before *time*."""
        while self._queue and self._queue[0][0] < time:
            self.now, _, _, call, arguments = heapq.heappop(self._queue)
            call(*arguments)
        self.now = time

    # ---------------------------------------------------------------- what hosts do

    def do(self, address: int, command: LinkCommand) -> None:
        """Carry out *command*."""
        device = self.devices[address]
        if not device.on:
            return
        match command:
            case Inquire() | Page():
                self.procedures.ask(device, command)
            case Scan(enabled):
                self.advertising.want(device, enabled)
            case Disconnect(peer):
                self.links.close(device, peer)
            case Sniff(peer, slots):
                self.links.sniff(device, peer, slots)
            case Flush(destination):
                if destination == BROADCAST:
                    self.sets.flush(device)
                else:
                    self.links.flush(device, destination)

    def send(self, address: int, outgoing: Outgoing) -> None:
        """Take a payload."""
        device = self.devices[address]
        if not device.on:
            return
        if outgoing.destination == BROADCAST:
            self.sets.send(device, outgoing)
        else:
            self.links.hand_in(device, outgoing)

    def move(self, places_m: Sequence[tuple[float, float]]) -> None:
        """Put devices in other places."""
        self.air.places = list(places_m)
        self.links.reconsider()

    def power(self, address: int, on: bool) -> None:
        """Switch a device."""
        device = self.devices[address]
        if device.on == on:
            return
        device.on, device.on_since = on, self.now
        if on:
            if device.wanted:
                self.advertising.begin(device)
            return
        self.advertising.stop(device)
        device.procedure = None
        device.procedures.clear()
        self.links.vanish(device)
        self.sets.vanish(device)

    # ---------------------------------------------------------------- what reaches hosts

    def report(self, address: int, event: LinkEvent) -> None:
        self.news.append((self.now, address, event))

    def arrive(self, receiver: int, payload: bytes, packet: Packet, broadcast: bool) -> None:
        reception = Reception(packet.source, broadcast, self.air.rssi_dbm(packet, receiver))
        self.news.append((self.now, receiver, (payload, reception)))

    def over(self, source: int, outgoing: Outgoing, outcome: Outcome) -> None:
        """Report what became of a payload."""
        if outgoing.token is not None:
            self.report(source, Fate(outgoing.token, outcome))

    # ---------------------------------------------------------------- packets of advertising

    def hears(self, receiver: Device, packet: Packet) -> bool:
        """Return whether *receiver* hears a packet of advertising, which ends now."""
        return (
            receiver.address != packet.source
            and self.devices[packet.source].was_on(packet)
            and receiver.was_on(packet)
            and not receiver.taken(packet.start, packet.end)
            and not receiver.planned(packet.start, packet.end)
            and not receiver.advertises(packet.start, packet.end)
            and receiver.listened(packet)
            and self.air.reception(packet, receiver.address) is Heard.HEARD
        )
