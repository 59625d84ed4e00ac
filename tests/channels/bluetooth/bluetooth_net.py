"""Several piconets with devices in common that divide their time, and what their frames must keep to."""

from collections import defaultdict
from itertools import pairwise
from typing import Any

from cosim.machine import (
    Address,
    Fate,
    Lost,
    Outcome,
    Page,
    Scan,
    Share,
)
from cosim.units import MS, S, Time
from tests.channels.bluetooth.bluetooth_world import World

SUPERVISION = 2 * S
LONGEST = 5
"""Slots of the longest packet type in use."""
PERIOD = 64


class Net(World):
    """Piconets whose links are paged in the order of *links*, (master, slave); devices with links scan for the next."""

    def __init__(self, size: int, links: list[tuple[Address, Address]], **settings: Any) -> None:
        quick = {
            "supervision_s": SUPERVISION / S,
            "t_poll_slots": 40,
            "page": {"mode": "R0"},
            "page_scan": {"interval_s": 0.01125},
            "idle_frames": True,
            "interference": "none",
        }
        super().__init__(size, **(quick | settings))
        self.masters = {master for master, _ in links}
        for master, slave in links:
            self.command(slave, Scan(True))
            self.command(master, Page(slave))
            begin = self.kernel.now
            while (master, slave) not in self.up():
                self.kernel.run(self.kernel.now + 5 * MS)
                assert self.kernel.now < begin + 6 * S
            # who waits for another link leaves the first one alone meanwhile
            for device in range(size):
                self.divide(device)

    def divide(self, device: Address) -> None:
        """Let *device*, if it has several piconets, be in each during its part, on the clock of 0."""
        piconets = sorted(self.piconets(device))
        if len(piconets) > 1:
            self.command(device, Share(PERIOD, tuple((master, *self.part(master)) for master in piconets), 0))

    def part(self, master: Address) -> tuple[int, int]:
        """Return (first slot, slots) of a piconet's part: equal ones, in order of the masters."""
        length = PERIOD // len(self.masters)
        return sorted(self.masters).index(master) * length, length

    def piconets(self, device: Address) -> set[Address]:
        own = {device} if self.channel.devices[device].master_of.members() else set()
        return own | set(self.channel.devices[device].masters)

    def up(self) -> set[tuple[Address, Address]]:
        """Return the links (master, slave) that both sides take to be up."""
        devices = self.channel.devices
        return {(m.address, s) for m in devices for s in m.master_of.members() if m.address in devices[s].masters}

    def run_for(self, duration: Time) -> list[dict[str, Any]]:
        """Let *duration* pass and return the frames that began in it."""
        begin = self.kernel.now
        self.kernel.run(begin + duration)
        self.channel.air.advance(self.kernel.now)
        return [frame for frame in self.frames() if frame["time_ns"] >= begin]

    def position(self, time: Time) -> int:
        """Return the ticks that the period of all shares has lasted by *time*."""
        return self.channel.devices[0].identity.clock.tick(time) % (2 * PERIOD)

    def outcomes(self, device: Address) -> list[tuple[int, Outcome]]:
        return [(event.token, event.outcome) for event in self.hosts[device].got(Fate) if isinstance(event, Fate)]

    def peers_lost(self, device: Address) -> list[Address]:
        return [event.peer for event in self.hosts[device].got(Lost) if isinstance(event, Lost)]


SLAVE_SLAVE = [(0, 1), (0, 2), (3, 4), (3, 2)]
"""Two piconets joined by device 2, a slave in both."""
MASTER_SLAVE = [(0, 1), (0, 2), (2, 3), (2, 4)]
"""Device 2 is the master of its own piconet and a slave in that of 0."""
RING = [(0, 1), (2, 3), (4, 5), (0, 2), (2, 4), (4, 0)]
"""Three masters, each a slave of the one before it."""
TOPOLOGIES = {"slave_slave": (5, SLAVE_SLAVE), "master_slave": (5, MASTER_SLAVE), "ring": (6, RING)}


def taking_part(frames: list[dict[str, Any]]) -> dict[Address, list[tuple[Time, Time]]]:
    """Return when each device sends or hears a frame; a broadcast is sent once, to all."""
    busy: dict[Address, set[tuple[Time, Time]]] = defaultdict(set)
    for frame in frames:
        span = frame["time_ns"], frame["time_ns"] + frame["duration_ns"]
        busy[frame["source"]].add(span)
        if frame["outcome"] == "received":
            busy[frame["destination"]].add(span)
    return {device: sorted(spans) for device, spans in busy.items()}


def check_one_at_a_time(frames: list[dict[str, Any]]) -> None:
    for device, spans in taking_part(frames).items():
        for (_, end), (start, _) in pairwise(spans):
            assert end <= start, f"device {device} takes part in two frames at {start}"


def check_parts(net: Net, frames: list[dict[str, Any]], shared: set[Address]) -> int:
    """Check that who has divided its time sends and hears in its parts only; return how many frames say so."""
    said = 0
    for frame in frames:
        heard = frame["outcome"] == "received"
        for device in shared & {frame["source"], frame["destination"]}:
            if device == frame["destination"] and not heard:
                continue
            other = frame["destination"] if device == frame["source"] else frame["source"]
            master = device if (device, other) in net.up() else other
            first, length = net.part(master)
            last = net.position(frame["time_ns"] + frame["duration_ns"] - 1)
            assert 2 * first <= net.position(frame["time_ns"]) <= last < 2 * (first + length), (device, frame)
            said += 1
    return said
