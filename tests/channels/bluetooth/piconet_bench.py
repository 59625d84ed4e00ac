"""A connected piconet without pages: links come up by hand, and all that happens is written down."""

from collections.abc import Iterable

import numpy as np

from cosim.channels.base import Arrival
from cosim.channels.bluetooth.piconet import Piconet
from cosim.channels.bluetooth.radio import Air, Frame, Heard, Identity, Radio
from cosim.channels.bluetooth.state import PiconetSettings
from cosim.channels.clock import NativeClock
from cosim.channels.jamming import Jammer
from cosim.kernel import WORLD, Kernel
from cosim.machine import (
    Address,
    Fate,
    LinkEvent,
    Lost,
    Mode,
    ModeChanged,
    ModeCommand,
    Outcome,
    Outgoing,
)
from cosim.units import SLOT, Time
from tests.channels.bluetooth.radio_scene import equal_powers_dbm

PAIR = 2 * SLOT
MASTER = 0
WORD = 0x2A96EF25


class Bench:
    """A piconet of a master, 0, and slaves 1 to *size*, with LT_ADDR = address, and all that comes out of it.

    There may be more *devices* on the air, master included, for slaves that join later.
    """

    def __init__(
        self,
        size: int = 1,
        clock: NativeClock | None = None,
        first_due: int = 80,
        idle: bool = True,
        devices: int | None = None,
        **settings: object,
    ) -> None:
        self.kernel = Kernel()
        self.clock = clock or NativeClock(0)
        self.frames: list[tuple[Frame, Heard]] = []
        self.arrivals: list[tuple[Time, Address, bytes]] = []
        self.news: list[tuple[Time, Address, LinkEvent]] = []
        self.deliveries = 0
        self.deaf: set[tuple[Address, Address]] = set()
        self.devices = devices or size + 1
        self.air = Air(self.devices, lambda frame, fate: self.frames.append((frame, fate.heard)))
        self.piconet = Piconet(
            Radio(self.kernel, self.air, Identity(MASTER, WORD, self.clock)),
            PiconetSettings(idle_frames=idle, **settings),  # type: ignore[arg-type]
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
        self.air.set_powers(equal_powers_dbm(self.devices, deaf), self.kernel.now)

    def jam(self, jammer: Jammer) -> None:
        """Have everybody receive *jammer* as strongly as each other."""
        self.air.set_jammers([jammer], self.kernel.now)
        self.air.set_jam_powers(np.zeros((1, self.devices)), self.kernel.now)

    def ask(self, at: Time, side: Address, command: ModeCommand) -> None:
        """Have the host of *side* ask for another mode of a link."""
        self.kernel.at(at, lambda: self.piconet.modes.command(side, command))

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
        return [(time, address, e.token, e.outcome) for time, address, e in self.news if isinstance(e, Fate)]

    def modes(self) -> list[tuple[Time, Address, Address, Mode]]:
        """Return (time, host, peer, mode) of what hosts have learnt of the modes of their links."""
        return [(time, host, e.peer, e.mode) for time, host, e in self.news if isinstance(e, ModeChanged)]

    def lost(self) -> list[tuple[Time, Address, Address]]:
        return [(time, address, e.peer) for time, address, e in self.news if isinstance(e, Lost)]
