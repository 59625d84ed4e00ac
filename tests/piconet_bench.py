"""A connected piconet without pages: links come up by hand, and all that happens is written down."""

from collections.abc import Iterable

import numpy as np

from cosim.channels.base import Arrival
from cosim.channels.bluetooth.clock import NativeClock
from cosim.channels.bluetooth.frames import FrameLog
from cosim.channels.bluetooth.piconet import Piconet, PiconetSettings
from cosim.channels.bluetooth.radio import Air, Frame, Heard
from cosim.kernel import WORLD, Kernel
from cosim.machine import Address, LinkEvent, Lost, Outcome, Outgoing
from cosim.machine import Fate as FateEvent
from cosim.units import SLOT, Time

PAIR = 2 * SLOT
MASTER = 0
WORD = 0x2A96EF25


class Bench:
    """A piconet of a master, 0, and slaves 1 to *size*, with LT_ADDR = address, and all that comes out of it."""

    def __init__(
        self,
        size: int = 1,
        clock: NativeClock | None = None,
        first_due: int = 80,
        idle: bool = True,
        **settings: object,
    ) -> None:
        self.kernel = Kernel()
        self.clock = clock or NativeClock(0)
        self.frames: list[tuple[Frame, Heard]] = []
        self.arrivals: list[tuple[Time, Address, bytes]] = []
        self.news: list[tuple[Time, Address, LinkEvent]] = []
        self.deliveries = 0
        self.deaf: set[tuple[Address, Address]] = set()
        self.air = Air(size + 1, lambda frame, fate: self.frames.append((frame, fate.heard)))
        log = FrameLog(self.air, MASTER, self.clock, wanted=True, idle_wanted=idle)
        self.piconet = Piconet(
            self.kernel,
            self.air,
            MASTER,
            WORD,
            self.clock,
            PiconetSettings(**settings),  # type: ignore[arg-type]
            log,
            self.deliver,
        )
        for slave in range(1, size + 1):
            self.piconet.add_slave(slave, slave, first_due)

    def outage(self, start: Time, end: Time, *ways: tuple[Address, Address]) -> None:
        """Nothing goes the *ways* (transmitter, receiver) from *start* until just before *end*."""
        self.kernel.at(start, lambda: self.change(self.deaf | set(ways)), WORLD)
        self.kernel.at(end, lambda: self.change(self.deaf - set(ways)), WORLD)

    def change(self, deaf: set[tuple[Address, Address]]) -> None:
        self.deaf = deaf
        powers = np.zeros_like(self.air.band.medium.power_dbm)
        np.fill_diagonal(powers, -np.inf)
        for transmitter, receiver in deaf:
            powers[transmitter, receiver] = -np.inf
        self.air.set_powers(powers, self.kernel.now)

    def deliver(self, arrivals: Iterable[Arrival], news: Iterable[tuple[Address, LinkEvent]]) -> None:
        self.deliveries += 1
        self.arrivals += [(self.kernel.now, receiver, data) for receiver, data, _ in arrivals]
        self.news += [(self.kernel.now, address, event) for address, event in news]

    def send(
        self, at: Time, source: Address, destination: Address, payload: bytes = b"x", token: int | None = None
    ) -> None:
        self.kernel.at(at, lambda: self.piconet.send(source, Outgoing(destination, payload, token)))

    def run(self, until: Time) -> None:
        self.kernel.run(until)
        self.piconet.advance(until)
        self.frames.sort(key=lambda item: item[0].start)

    def on_air(self, *kinds: str) -> list[tuple[int, str, int]]:
        """Return (master's tick, type, LT_ADDR) of the frames of these types, or of all."""
        return [
            (self.clock.tick(frame.start), frame.kind, frame.lt_addr)
            for frame, _ in self.frames
            if not kinds or frame.kind in kinds
        ]

    def fates(self) -> list[tuple[Time, Address, int, Outcome]]:
        return [(time, address, e.token, e.outcome) for time, address, e in self.news if isinstance(e, FateEvent)]

    def lost(self) -> list[tuple[Time, Address, Address]]:
        return [(time, address, e.peer) for time, address, e in self.news if isinstance(e, Lost)]
