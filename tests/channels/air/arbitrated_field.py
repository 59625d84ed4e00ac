"""Robots with radios of two kinds that an arbiter keeps apart, and what was on the air, told anew from what is written.

What follows from arithmetic is in no table, or need not be: what is told to the air is written down as it is told.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from cosim.channels.air.band import Emission
from cosim.machine import Page
from cosim.trace import INTERVALS, RECEPTIONS, TRANSMISSIONS
from cosim.units import MS, US
from tests.channels.air.shared_field import SharedField

OTHER, WIFI = 0, 1  # numbers of radios
DELAY = US  # of the propagation of 802.11


class Sent(NamedTuple):
    """Something on the air."""

    start: int
    end: int
    robot: int
    radio: int


class Field(SharedField):
    """Robots of which some have both radios: Low Energy and 802.11, unless *other* or *wifi* name another kind.

    What is told to the air is kept: 802.11 tells it in another way, but has all its frames in a table.
    """

    def __init__(
        self,
        places: Sequence[tuple[float, float]],
        carried: Sequence[Sequence[int]] | None = None,
        other: dict[str, Any] | None = None,
        wifi: dict[str, Any] | None = None,
        **settings: Any,
    ) -> None:
        wifi = {"channel": 6, "rate_mbps": 11, **(wifi or {})} if wifi is None or "kind" not in wifi else wifi
        radios = [{"kind": "ble", **(other or {})}, {"kind": "adhoc", **wifi}]
        tables = TRANSMISSIONS, RECEPTIONS, INTERVALS
        super().__init__(radios, places, carried, tables, **{"arbitration": True, **settings})
        self.size = len(places)
        self.told: list[Emission] = []
        air = self.channel._air
        assert air is not None
        tell = air.tell

        def noted(emission: Emission) -> None:
            self.told.append(emission)
            tell(emission)

        air.tell = noted  # type: ignore[method-assign]
        self.air = air

    def link(self, central: int, *peripherals: int) -> None:
        self.at(MS, central, *(Page(peer) for peer in peripherals))

    def sent(self) -> list[Sent]:
        """Return all that has been on the air, in order."""
        told = {Sent(each.start, each.end, each.sender, each.tenant) for each in self.told}
        frames = [row for row in self.rows("transmissions") if row["radio"] == WIFI]
        return sorted(
            told.union(Sent(row["time_ns"], row["time_ns"] + row["duration_ns"], row["source"], WIFI) for row in frames)
        )

    def received(self) -> list[Sent]:
        """Return what has been received, each as its receiver did."""
        ends = {
            (row["time_ns"], row["source"], row["radio"]): row["time_ns"] + row["duration_ns"]
            for row in self.rows("transmissions")
        }
        heard = []
        for row in self.rows("receptions"):
            if row["outcome"] == "received":
                late = DELAY if row["radio"] == WIFI else 0
                start = row["time_ns"]
                end = ends[start, row["source"], row["radio"]]
                heard.append(Sent(start + late, end + late, row["receiver"], row["radio"]))
        return heard

    def deferred(self, radio: int) -> list[dict[str, Any]]:
        return [row for row in self.rows("intervals") if row["state"] == "deferred" and row["radio"] == radio]

    def got(self, robot: int, radio: int) -> int:
        return sum(each[1] == radio for each in self.hosts[robot].heard)


def at_once(sent: list[Sent]) -> int:
    """Return how often both radios of a robot are on the air at once."""
    clashes = 0
    for robot in {each.robot for each in sent}:
        own = [each for each in sent if each.robot == robot]
        ends = {OTHER: 0, WIFI: 0}
        for each in own:
            clashes += ends[1 - each.radio] > each.start
            ends[each.radio] = max(ends[each.radio], each.end)
    return clashes


def across(received: list[Sent], sent: list[Sent]) -> int:
    """Return how many receptions meet what the other radio of the receiver sends."""
    found = 0
    for robot in {each.robot for each in sent}:
        for radio in (OTHER, WIFI):
            own = [each for each in sent if each.robot == robot and each.radio == 1 - radio]
            starts, ends = np.array([each.start for each in own]), np.array([each.end for each in own])
            for each in received:
                if (each.robot, each.radio) == (robot, radio):
                    found += bool(np.any((starts < each.end) & (ends > each.start)))
    return found
