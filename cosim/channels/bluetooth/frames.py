"""The frames of one connected piconet, counted by type and, if anybody asks, recorded with channel and outcome."""

from collections import Counter

import numpy as np

from cosim.channels.bluetooth.clock import NativeClock
from cosim.channels.bluetooth.hopping import basic_channel
from cosim.channels.bluetooth.packets import HEADER_AIR
from cosim.channels.bluetooth.polling import State
from cosim.channels.bluetooth.radio import Air, Frame, Heard
from cosim.machine import Address
from cosim.units import Time


class FrameLog:
    """What is on the air of one piconet. Channels are computed for recorded frames only.

    *wanted*: record the frames of transactions that a payload takes part in; *idle_wanted*: idle POLL and NULL as well.
    """

    def __init__(
        self, air: Air, clock: NativeClock, hop_address: int, wanted: bool = False, idle_wanted: bool = False
    ) -> None:
        self.wanted = wanted or idle_wanted
        self.idle_wanted = idle_wanted
        self.payloads: Counter[str] = Counter()
        """Frames with user data by packet type, retransmissions and repetitions included."""
        self._air = air
        self._clock = clock
        self._hop_address = hop_address

    def record(
        self,
        tick: int,
        kind: str,
        duration: Time,
        ends: tuple[Address, Address],
        heard: Heard,
        lt_addr: int,
        length: int,
    ) -> None:
        """Record the frame that starts at the master's *tick*; *ends* are its transmitter and receiver."""
        channel = basic_channel(self._hop_address, tick)
        frame = Frame(self._clock.time_of(tick), duration, kind, *ends, channel, lt_addr, length)
        self._air.record(frame, heard)

    def record_idle(
        self,
        polls: State,
        master: Address,
        slaves: dict[int, Address],
        heard_down: dict[int, Heard],
        heard_up: dict[int, Heard],
    ) -> None:
        """Record idle polls, rows (tick, LT_ADDR) of *polls*, and the answers of those who heard them."""
        ticks = polls[:, 0]
        channels = np.stack(
            (basic_channel(self._hop_address, ticks), basic_channel(self._hop_address, ticks + 2)), axis=1
        )
        for (tick, k), (down, up) in zip(polls.tolist(), channels.tolist(), strict=True):
            slave = slaves[k]
            start = self._clock.time_of(tick)
            self._air.record(Frame(start, HEADER_AIR, "POLL", master, slave, down, k), heard_down[k])
            if heard_down[k] is Heard.RECEIVED:
                start = self._clock.time_of(tick + 2)
                self._air.record(Frame(start, HEADER_AIR, "NULL", slave, master, up, k), heard_up[k])
