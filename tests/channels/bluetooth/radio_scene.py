"""An air between a few devices, on which tests put frames by hand."""

import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from cosim.channels.bluetooth.radio import Air, Fate, Frame, Heard, Interference
from cosim.machine import Address
from cosim.units import MS, US, Time

DM1_AIR, DM5_AIR, ID_AIR = 366 * US, 2871 * US, 68 * US
"""Air times with a full payload (Core v1.2, Vol 2 Part B, section 6.5)."""
ACCESS_END, HEADER_END = 72 * US, 126 * US
BEGIN = 10 * MS
RECEIVED = Fate(Heard.RECEIVED)
HAIR_DB = 1e-9
NEVER = -math.inf


def equal_powers_dbm(size: int, silent: Iterable[tuple[Address, Address]] = ()) -> np.ndarray[Any, Any]:
    """Return 0 dBm from each device to each other, and nothing the *silent* ways (transmitter, receiver)."""
    powers = np.zeros((size, size))
    np.fill_diagonal(powers, NEVER)
    for way in silent:
        powers[way] = NEVER
    return powers


class Scene:
    """An air between some devices; device 0 receives what device 1 sends from BEGIN on, on channel 40."""

    def __init__(self, size: int = 6, interference: Interference = "neighbouring", **settings: Any) -> None:
        self.air = Air(size, None, interference, **settings)
        self.powers = equal_powers_dbm(size)

    def power(self, source: Address, power_dbm: float, receiver: Address = 0) -> None:
        self.powers[source, receiver] = power_dbm
        self.air.set_powers(self.powers, 0)

    def put(self, source: Address, start: Time, duration: Time = DM1_AIR, channel: int = 40) -> Frame:
        frame = Frame(start, duration, "DM1", source, 0, channel)
        self.air.put(frame)
        return frame

    def judge(self, frame: Frame, receiver: Address = 0, bits: int = 160) -> Fate:
        return self.air.judge(frame, receiver, self.air.carrier(frame.source, receiver), bits)
