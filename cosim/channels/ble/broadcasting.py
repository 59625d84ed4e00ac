"""Payloads for everyone: each is sent as an advertising set of its own, by extended advertising (Core v5.0, 4.4.2.3).

In each event an ADV_EXT_IND on all three primary channels says where and when an AUX_ADV_IND is, which carries the
payload, on a channel that is drawn; what is longer than a packet goes on in AUX_CHAIN_INDs. Whoever has heard one of
the three follows; whoever has the payload does not follow again, as AdvDataInfo tells.

The first event, too, comes after a random delay of at most 10 ms, as hosts often speak at one instant. An event waits
until the antenna is free for all of it and a little longer, at random, as the other end of a link may wait for the same
instant; 10 ms at most for events of links that are still to come: then it goes before them.
"""

from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

from cosim.channels.air.arbitration import Rank
from cosim.channels.ble.advertising import LONGEST_DELAY
from cosim.channels.ble.beacon import device_address
from cosim.channels.ble.bits.access import ADVERTISING_ADDRESS
from cosim.channels.ble.bits.crc import ADVERTISING_INIT
from cosim.channels.ble.bits.pdu import OFFSET_UNITS, AuxiliaryPhy, AuxPtr, DataInfo, Extended, encode_advertising
from cosim.channels.ble.channels import ADVERTISING, DATA_CHANNELS
from cosim.channels.ble.connections.exchange import Reception
from cosim.channels.ble.environment import Environment
from cosim.channels.ble.packets import Sent
from cosim.channels.ble.phy import CODED_S8, HEADER_OCTETS, LE_1M, LE_2M, T_IFS, T_MAFS, Phy
from cosim.channels.ble.settings import BroadcastSettings
from cosim.channels.ble.station import Station
from cosim.kernel import Handle
from cosim.machine import BROADCAST, Address, Outcome, Outgoing
from cosim.machine import Reception as Arrived
from cosim.randomness import Draws
from cosim.units import Time

MOST_DATA: Final = 1650
"""Octets of the longest advertising data."""
_DATA_OF_PDU: Final = 242
"""Octets of data in each auxiliary PDU: all that fits beside the longest extended header."""
_STRUCTURE: Final = bytes.fromhex("ffffff")
"""What begins a piece after its length: manufacturer specific data, of a company that is none."""
_OVERHEAD: Final = 1 + len(_STRUCTURE)
_PDUS: Final = -(-MOST_DATA // _DATA_OF_PDU)
LONGEST_BROADCAST: Final = MOST_DATA - _OVERHEAD * _PDUS
"""Octets of the longest payload for everyone."""
_CHANNEL: Final = 1
"""Purpose of the draws of channels."""
_WAIT: Final = 2
"""Purpose of the draws of waits."""
_LONGEST_WAIT: Final[Time] = LONGEST_DELAY // 8
"""Longest wait of an event after the antenna has become free."""
_AUXILIARY: Final[dict[str, tuple[Phy, AuxiliaryPhy]]] = {
    "1M": (LE_1M, AuxiliaryPhy.LE_1M),
    "2M": (LE_2M, AuxiliaryPhy.LE_2M),
    "coded": (CODED_S8, AuxiliaryPhy.CODED),
}


def pieces(payload: bytes) -> list[bytes]:
    """Return *payload* in pieces, each a structure of advertising data that fits into a PDU; at least one."""
    size = _DATA_OF_PDU - _OVERHEAD
    parts = [payload[at : at + size] for at in range(0, len(payload), size)] or [b""]
    return [bytes([len(_STRUCTURE) + len(part)]) + _STRUCTURE + part for part in parts]


def piece_of(data: bytes) -> bytes | None:
    """Return the part of a payload in the *data* of a PDU; None if they are not what ``pieces`` makes."""
    size, begin = len(data), data[1:_OVERHEAD]
    return data[_OVERHEAD:] if size and data[0] == size - 1 and begin == _STRUCTURE else None


class _Step(NamedTuple):
    """A packet of an event, *after* its beginning."""

    after: Time
    kind: str
    channel: int
    phy: Phy
    pdu: bytes
    length: int


class AdvertisingSet:
    """A payload that *station* sends to those of *stations* that hear it; *over* is called when all events are over."""

    def __init__(
        self,
        environment: Environment,
        station: Station,
        stations: Sequence[Station],
        outgoing: Outgoing,
        number: int,
        settings: BroadcastSettings,
        draws: Draws,
        over: "Callable[[AdvertisingSet], None]",
    ) -> None:
        """*number* counts the station's sets."""
        self.outgoing = outgoing
        self._kernel, self._ether, self._hosts, self._record = environment
        self._station, self._stations = station, stations
        self._info = DataInfo(number // 16 % 4096, number % 16)
        self._number = number
        self._settings = settings
        self._draws = draws
        self._over = over
        self._left = settings.events
        self._event = 0
        self._got: set[Address] = set()
        self._follow: set[Address] = set()
        self._steps: list[_Step] = []
        self._start: Time = 0
        self._next: Handle | None = None
        self._due: Time = 0
        self._tries = 0
        self._next = self._kernel.after(self._delay(), self._begin)

    def cancel(self) -> None:
        """Send nothing more: the device is off."""
        if self._next is not None:
            self._next.cancel()

    # ---------------------------------------------------------------- events

    def _begin(self) -> None:
        """Begin an event as soon as the antenna is free."""
        self._due = self._kernel.now + LONGEST_DELAY
        self._plan()
        self._try()

    def _delay(self) -> Time:
        """Return advDelay before the next event."""
        return self._draws.below(LONGEST_DELAY + 1, self._number << 8 | self._event)

    def _try(self) -> None:
        now, antenna = self._kernel.now, self._station.antenna
        end = now + self._duration
        again = [antenna.booked_until(now, end), self._station.beacon.taken_until(now, now + 1)]
        if now < self._due and (taken := antenna.taken_until(now, end)) is not None:
            again.append(min(taken, self._due))
        if not any(again):
            again = [antenna.refused_until(now, now, end, Rank.DATA)]
        waits = [each for each in again if each is not None]
        if waits:
            self._tries += 1
            late = self._draws.below(_LONGEST_WAIT, self._number << 8 | self._event, self._tries, _WAIT)
            self._next = self._kernel.at(max(waits) + 1 + late, self._try)
            return
        antenna.book(now, end, self, now)
        self._start, self._follow = now, set()
        if self._event == 0:
            self._hosts.payloads.begin(self.outgoing, now)
        self._put(0)

    def _put(self, turn: int) -> None:
        step = self._steps[turn]
        packet = Sent(
            self._start + step.after,
            self._station.address,
            BROADCAST,
            step.kind,
            step.channel,
            step.phy,
            len(step.pdu) - HEADER_OCTETS,
            step.length,
            ADVERTISING_ADDRESS,
            ADVERTISING_INIT,
            step.pdu,
            step.length > 0 and self._event > 0,
        )
        self._ether.send(packet)
        self._station.antenna.sends(packet)
        if packet.kind != "ADV_EXT_IND":
            for address in self._follow:
                self._stations[address].antenna.listens(packet.start, packet.end, packet.phy)
        self._next = self._kernel.at(packet.end, lambda: self._ended(turn, packet))

    def _ended(self, turn: int, packet: Sent) -> None:
        if self._record.wanted:
            self._record.sent(packet, True)
        if packet.kind == "ADV_EXT_IND":
            self._point(packet)
        else:
            self._carry(packet, last=turn == len(self._steps) - 1)
        if turn + 1 < len(self._steps):
            self._put(turn + 1)
            return
        self._left, self._event = self._left - 1, self._event + 1
        if self._left:
            rest = max(0, self._settings.interval - self._duration)  # an event may be longer than an interval
            self._next = self._kernel.after(rest + self._delay(), self._begin)
        else:
            self._next = None
            self._hosts.over(self._station.address, self.outgoing, Outcome.SENT)
            self._over(self)

    def _point(self, packet: Sent) -> None:
        """Have those who hear an ADV_EXT_IND follow."""
        begin, end = self._start + self._steps[len(ADVERTISING)].after, self._start + self._duration
        for listener in self._stations:
            if listener is self._station or listener.address in self._got | self._follow:
                continue
            if not listener.listens(packet.channel, packet.start, packet.end):
                continue
            judgement = self._ether.judge(packet, listener.address)
            if self._record.wanted:
                self._record.judged(packet, listener.address, judgement)
            now, antenna = self._kernel.now, listener.antenna
            free = judgement.reception is Reception.HEARD and antenna.taken_until(begin, end) is None
            if free and antenna.refused_until(now, begin, end, Rank.DATA) is None:
                self._follow.add(listener.address)
                antenna.book(begin, end, self, now)

    def _carry(self, packet: Sent, last: bool) -> None:
        """Have those who follow take a part of the payload, and at *last* all of it."""
        for address in sorted(self._follow):
            listener = self._stations[address]
            here = self._ether.was_on(address, packet.start)
            here = here and listener.antenna.booked_until(packet.start, packet.end, self) is None
            judgement = self._ether.judge(packet, address) if here else None
            if judgement is not None and self._record.wanted:
                self._record.judged(packet, address, judgement)
            if judgement is None or judgement.reception is not Reception.HEARD:
                self._follow.remove(address)
            elif last:
                self._got.add(address)
                arrived = Arrived(self._station.address, True, judgement.power_dbm)
                self._hosts.arrive((address, self.outgoing.payload, arrived))

    # ---------------------------------------------------------------- what is sent

    @property
    def _duration(self) -> Time:
        """Time from the start of an event to its end."""
        last = self._steps[-1]
        return last.after + last.phy.air_time(len(last.pdu) - HEADER_OCTETS)

    def _plan(self) -> None:
        """Lay down the packets of the next event."""
        parts = pieces(self.outgoing.payload)
        number = self._number << 8 | self._event
        channels = [self._draws.below(DATA_CHANNELS, number, turn, _CHANNEL) for turn in range(len(parts))]
        spacing = LE_1M.air_time(len(self._pointer(channels[0], T_MAFS)) - HEADER_OCTETS) + T_IFS
        first = len(ADVERTISING) * spacing - T_IFS + T_MAFS
        self._steps = [
            _Step(turn * spacing, "ADV_EXT_IND", channel, LE_1M, self._pointer(channels[0], first - turn * spacing), 0)
            for turn, channel in enumerate(ADVERTISING)
        ]
        at = first
        for turn, part in enumerate(parts):
            step = self._carrier(at, turn, part, channels)
            self._steps.append(step)
            at += self._to_next(len(step.pdu))

    def _pointer(self, channel: int, offset: Time) -> bytes:
        """Return an ADV_EXT_IND that points to the packet on *channel*, *offset* after its own beginning."""
        return encode_advertising(Extended(data_info=self._info, aux=self._aux(channel, offset, OFFSET_UNITS[0])))

    def _carrier(self, at: Time, turn: int, part: bytes, channels: list[int]) -> _Step:
        """Return the packet that carries a *part* of the payload, *at* that time of the event."""
        address = device_address(self._station.address) if turn == 0 else None
        pdu = Extended(advertiser=address, data_info=self._info, data=part)
        if turn + 1 < len(channels):
            aux = self._aux(channels[turn + 1], T_MAFS, OFFSET_UNITS[1])
            octets = len(encode_advertising(pdu._replace(aux=aux)))
            pdu = pdu._replace(aux=self._aux(channels[turn + 1], self._to_next(octets), OFFSET_UNITS[1]))
        kind = "AUX_CHAIN_IND" if turn else "AUX_ADV_IND"
        return _Step(at, kind, channels[turn], self._phy, encode_advertising(pdu), len(part) - _OVERHEAD)

    def _aux(self, channel: int, offset: Time, unit: Time) -> AuxPtr:
        return AuxPtr(channel, offset // unit * unit, _AUXILIARY[self._settings.phy][1])

    def _to_next(self, octets: int) -> Time:
        """Return the time from the start of an auxiliary packet, whose PDU has so many octets, to that of the next."""
        unit = OFFSET_UNITS[1]
        return -(-(self._phy.air_time(octets - HEADER_OCTETS) + T_MAFS) // unit) * unit

    @property
    def _phy(self) -> Phy:
        return _AUXILIARY[self._settings.phy][0]
