"""Advertising events of a device for everyone: when they are, what is on the air in them, and who hears it.

The first event, too, comes after a random delay of at most 10 ms, as hosts often speak at one instant. An event waits
until the antenna is free for all of it and a little longer, at random, as the other end of a link may wait for the same
instant; 10 ms at most for events of links that are still to come: then it goes before them.
"""

from abc import ABC, abstractmethod
from collections.abc import Collection, Iterator, Sequence
from typing import Final, NamedTuple

from cosim.channels.air.arbitration import Rank
from cosim.channels.ble.advertising import LONGEST_DELAY
from cosim.channels.ble.beacon import device_address
from cosim.channels.ble.bits.access import ADVERTISING_ADDRESS
from cosim.channels.ble.bits.crc import ADVERTISING_INIT
from cosim.channels.ble.bits.pdu import AdvertisingType, Undirected, encode_advertising
from cosim.channels.ble.channels import ADVERTISING
from cosim.channels.ble.connections.exchange import Reception
from cosim.channels.ble.environment import Environment
from cosim.channels.ble.ether import Judgement
from cosim.channels.ble.packets import Sent
from cosim.channels.ble.phy import HEADER_OCTETS, LE_1M, T_IFS, Phy
from cosim.channels.ble.station import Station
from cosim.kernel import Handle
from cosim.machine import BROADCAST, Address
from cosim.randomness import Draws
from cosim.units import Time

_WAIT: Final = 2
"""Purpose of the draws of waits."""
_LONGEST_WAIT: Final[Time] = LONGEST_DELAY // 8
"""Longest wait of an event after the antenna has become free."""


class Speaker(NamedTuple):
    """A device that sends to everyone."""

    environment: Environment
    station: Station
    stations: Sequence[Station]
    """All of the run, by address."""
    draws: Draws


class Step(NamedTuple):
    """A packet of an event, *after* its beginning."""

    after: Time
    kind: str
    channel: int
    phy: Phy
    pdu: bytes
    length: int
    """Octets of users' payloads in it."""

    @property
    def ends(self) -> Time:
        """Time from the beginning of the event to the end of the packet."""
        return self.after + self.phy.air_time(len(self.pdu) - HEADER_OCTETS)


def nonconnectable(address: Address, data: bytes, length: int) -> list[Step]:
    """Return an event in which the device *address* sends *data*, with *length* octets of a user, as ADV_NONCONN_INDs.

    There is one on each primary channel, T_IFS after that before.
    """
    pdu = encode_advertising(Undirected(AdvertisingType.ADV_NONCONN_IND, device_address(address), data))
    spacing = LE_1M.air_time(len(pdu) - HEADER_OCTETS) + T_IFS
    return [
        Step(turn * spacing, "ADV_NONCONN_IND", channel, LE_1M, pdu, length) for turn, channel in enumerate(ADVERTISING)
    ]


class Events(ABC):
    """So many events, *count*, of *speaker*, *interval* and a random delay from one to the next."""

    def __init__(self, speaker: Speaker, number: int, count: int, interval: Time) -> None:
        """*number* counts what the speaker sends in events."""
        self.speaker = speaker
        self._kernel, self._ether, self._hosts, self._record = speaker.environment
        self._number = number
        self._count, self._interval = count, interval
        self._event = 0
        self._steps: list[Step] = []
        self._start: Time = 0
        self._due: Time = 0
        self._tries = 0
        self._next: Handle | None = self._kernel.after(self._delay(), self._begin)

    def cancel(self) -> None:
        """Send nothing more: the device is off."""
        if self._next is not None:
            self._next.cancel()

    # ---------------------------------------------------------------- what they are of

    @property
    def again(self) -> bool:
        """Whether what the event carries has been on the air before."""
        return self._event > 0

    @abstractmethod
    def plan(self) -> list[Step]:
        """Return the packets of the next event."""

    def begun(self) -> None:  # noqa: B027  # not all take notice
        """Take notice that an event begins."""

    def sent(self, packet: Sent) -> None:  # noqa: B027  # not all take notice
        """Take notice that *packet* begins."""

    @abstractmethod
    def ended(self, packet: Sent, last: bool) -> None:
        """Take notice that *packet* is over, the *last* of its event or not."""

    @abstractmethod
    def over(self) -> None:
        """Take notice that all events are over."""

    # ---------------------------------------------------------------- when they are

    @property
    def duration(self) -> Time:
        """Time from the start of an event to its end."""
        return self._steps[-1].ends

    def _begin(self) -> None:
        """Begin an event as soon as the antenna is free."""
        self._due = self._kernel.now + LONGEST_DELAY
        self._steps = self.plan()
        self._try()

    def _delay(self) -> Time:
        """Return advDelay before the next event."""
        return self.speaker.draws.below(LONGEST_DELAY + 1, self._number << 8 | self._event)

    def _try(self) -> None:
        now, station = self._kernel.now, self.speaker.station
        antenna, end = station.antenna, now + self.duration
        again = [antenna.booked_until(now, end), station.beacon.taken_until(now, now + 1)]
        if now < self._due and (taken := antenna.taken_until(now, end)) is not None:
            again.append(min(taken, self._due))
        waits = [each for each in again if each is not None]
        if not waits and (refused := antenna.refused_until(now, now, end, Rank.DATA)) is not None:
            waits = [refused]
        if waits:
            self._tries += 1
            late = self.speaker.draws.below(_LONGEST_WAIT, self._number << 8 | self._event, self._tries, _WAIT)
            self._next = self._kernel.at(max(waits) + 1 + late, self._try)
            return
        antenna.book(now, end, self, now)
        self._start = now
        self.begun()
        self._put(0)

    def _put(self, turn: int) -> None:
        step, station = self._steps[turn], self.speaker.station
        packet = Sent(
            self._start + step.after,
            station.address,
            BROADCAST,
            step.kind,
            step.channel,
            step.phy,
            len(step.pdu) - HEADER_OCTETS,
            step.length,
            ADVERTISING_ADDRESS,
            ADVERTISING_INIT,
            step.pdu,
            step.length > 0 and self.again,
        )
        self._ether.send(packet)
        station.antenna.sends(packet)
        self.sent(packet)
        self._next = self._kernel.at(packet.end, lambda: self._ended(turn, packet))

    def _ended(self, turn: int, packet: Sent) -> None:
        if self._record.wanted:
            self._record.sent(packet, True)
        last = turn == len(self._steps) - 1
        self.ended(packet, last)
        if not last:
            self._put(turn + 1)
            return
        self._event += 1
        if self._event < self._count:
            rest = max(0, self._interval - self.duration)  # an event may be longer than an interval
            self._next = self._kernel.after(rest + self._delay(), self._begin)
        else:
            self._next = None
            self.over()

    # ---------------------------------------------------------------- who hears them

    def heard_by(self, packet: Sent, but: Collection[Address] = ()) -> Iterator[tuple[Station, Judgement]]:
        """Yield who has listened to *packet*, which is over, and heard it, *but* some."""
        for listener in self.speaker.stations:
            if listener is self.speaker.station or listener.address in but:
                continue
            if listener.listens(packet.channel, packet.start, packet.end):
                judgement = self.speaker.environment.judged(packet, listener.address)
                if judgement.reception is Reception.HEARD:
                    yield listener, judgement
