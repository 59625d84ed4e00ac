"""Stations that are no robots: pairs of them at fixed places, of which one sends to the other all the time.

They are what is on the air beside a team: somebody's laptop and printer, headset and telephone. A pair makes a link as
robots do, by scanning and paging, makes it again when it is lost, and sends while it has one. Nothing of it reaches a
robot but the disturbance.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from pydantic import Field

from cosim.channels.base import Channel, Endpoint, Positions
from cosim.kernel import WAKE, Handle, Kernel
from cosim.machine import Address, Connected, LinkEvent, Lost, Outgoing, Page, PageFailed, Reception, Scan
from cosim.protocol import Metric
from cosim.randomness import Streams
from cosim.settings import Count, Metres, Seconds, Settings
from cosim.units import S, Time, from_seconds

AGAIN: Final[Time] = S
"""Time after which a pair without a link tries once more."""
METRICS: Final = (
    Metric("background_sent", "1", "payloads of stations that are no robots"),
    Metric("background_received", "1", "those of them that have arrived"),
)


class PairSettings(Settings):
    """Two stations, of which the first sends to the second; the times between its payloads are exponential."""

    radio: Count = Field(ge=0, description="which of the radios they have; one that no robot has")
    places_m: tuple[tuple[Metres, Metres], tuple[Metres, Metres]] = Field(description="m, where they are")
    payload_bytes: Count = Field(ge=1, description="bytes of a payload")
    interval_s: Seconds = Field(ge=1e-5, description="s, mean time from one payload to the next")


class Station(NamedTuple):
    """A station: where it is, m, and which radio it has."""

    place_m: tuple[float, float]
    radio: int


def stations_of(pairs: Sequence[PairSettings]) -> tuple[Station, ...]:
    """Return the stations of all *pairs*, in the order of their addresses, which come after those of the robots."""
    return tuple(Station(place_m, pair.radio) for pair in pairs for place_m in pair.places_m)


def called(address: Address, robots: int) -> str:
    """Return what people call who has *address* beside so many *robots*: robot 2, or station 0."""
    return f"robot {address}" if address < robots else f"station {address - robots}"


class _Sender(Endpoint):
    """The host of the first station of a pair: keeps a link to the second, and sends payloads by it."""

    def __init__(self, kernel: Kernel, channel: Channel, pair: PairSettings, own: Address, streams: Streams) -> None:
        self.sent = 0
        self._kernel = kernel
        self._channel = channel
        self._own, self._peer = own, own + 1
        self._payload = bytes(pair.payload_bytes)
        self._mean: Time = from_seconds(pair.interval_s)
        self._random = streams("background", own)
        self._next: Handle | None = None
        """The next payload; None while there is no link."""
        kernel.at(kernel.now, self._page, WAKE)

    def link(self, event: LinkEvent, now: Time) -> bool:
        """Begin to send once there is a link, and see to it that there is one."""
        match event:
            case Connected():
                self._channel.command(self._own, Scan(False))
                self._wait()
            case Lost(peer=peer) | PageFailed(peer=peer) if peer == self._peer:  # not one that was off all the time
                if self._next is not None:
                    self._next.cancel()
                    self._next = None
                self._kernel.after(AGAIN, self._page, WAKE)
        return False

    def _page(self) -> None:
        self._channel.command(self._own, Page(self._peer))

    def _wait(self) -> None:
        gap = max(1, round(self._random.exponential(self._mean)))
        self._next = self._kernel.after(gap, self._send, WAKE)

    def _send(self) -> None:
        self._wait()
        self.sent += 1
        self._channel.send(self._own, Outgoing(self._peer, self._payload))


class _Receiver(Endpoint):
    """The host of the second: can be found while it has no link, and counts what arrives."""

    def __init__(self, channel: Channel, own: Address) -> None:
        self.received = 0
        self._channel = channel
        self._own = own

    def receive(self, data: bytes, reception: Reception, now: Time) -> bool:
        """Count a payload."""
        self.received += 1
        return False

    def link(self, event: LinkEvent, now: Time) -> bool:
        """Scan while there is no link."""
        if isinstance(event, Connected | Lost) and event.peer == self._own - 1:
            self._channel.command(self._own, Scan(isinstance(event, Lost)))
        return False


class Background:
    """All pairs of a run: their stations have the addresses after those of the *robots*."""

    def __init__(self, pairs: Sequence[PairSettings], robots: int) -> None:
        stations = stations_of(pairs)
        self.carried = tuple((station.radio,) for station in stations)
        """Which radios each station has."""
        self._pairs = tuple(pairs)
        self._robots = robots
        self._places_m: Positions = np.array([station.place_m for station in stations]).reshape(-1, 2)
        self._hosts: list[tuple[int, _Sender, _Receiver]] = []

    @property
    def radios(self) -> frozenset[int]:
        """The radios that stations have."""
        return frozenset(pair.radio for pair in self._pairs)

    def begin(self, kernel: Kernel, channels: Sequence[Channel], streams: Streams) -> None:
        """Have all pairs make their links and send, by the *channels* of their radios."""
        for number, pair in enumerate(self._pairs):
            channel, own = channels[pair.radio], self._robots + 2 * number
            sender, receiver = _Sender(kernel, channel, pair, own, streams), _Receiver(channel, own + 1)
            channel.attach(own, sender)
            channel.attach(own + 1, receiver)
            self._hosts.append((pair.radio, sender, receiver))

    def among(self, positions_m: Positions) -> Positions:
        """Return the robots' *positions_m* and the stations' places, in the order of their addresses."""
        return np.vstack((positions_m, self._places_m)) if self._pairs else positions_m

    def counts(self, radio: int) -> dict[str, float]:
        """Return the values of METRICS for the stations that have *radio*."""
        hosts = [each for each in self._hosts if each[0] == radio]
        sent, received = sum(each[1].sent for each in hosts), sum(each[2].received for each in hosts)
        return {"background_sent": float(sent), "background_received": float(received)}
