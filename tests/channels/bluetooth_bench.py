"""A piconet bench with more devices than slaves, for those that join later."""

import numpy as np

from cosim.channels.bluetooth.clock import NativeClock
from cosim.channels.bluetooth.frames import FrameLog
from cosim.channels.bluetooth.piconet import Piconet, PiconetSettings
from cosim.channels.bluetooth.radio import Air
from cosim.channels.jamming import Jammer
from cosim.kernel import Kernel
from tests.piconet_bench import MASTER, WORD, Bench


class RoomyBench(Bench):
    """*devices* on the air, master included, of which those from 1 to *size* are slaves from the beginning on."""

    def __init__(
        self, size: int, devices: int, clock: NativeClock | None = None, first_due: int = 80, **settings: object
    ) -> None:
        self.kernel = Kernel()
        self.clock = clock or NativeClock(0)
        self.frames, self.arrivals, self.news, self.deaf, self.deliveries = [], [], [], set(), 0
        self.air = Air(devices, lambda frame, fate: self.frames.append((frame, fate.heard)))
        log = FrameLog(self.air, MASTER, self.clock, wanted=True, idle_wanted=True)
        wishes = PiconetSettings(**settings)  # type: ignore[arg-type]
        self.piconet = Piconet(self.kernel, self.air, MASTER, WORD, self.clock, wishes, log, self.deliver)
        for slave in range(1, size + 1):
            self.piconet.add_slave(slave, slave, first_due)

    def jam(self, jammer: Jammer) -> None:
        """Have everybody receive *jammer* as strongly as each other."""
        self.air.set_jammers([jammer], self.kernel.now)
        self.air.set_jam_powers(np.zeros((1, len(self.air.band.medium.cursor))), self.kernel.now)
