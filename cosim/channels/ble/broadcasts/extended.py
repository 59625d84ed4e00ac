"""Payloads for everyone by extended advertising: each is an advertising set of its own (Core v5.0, 4.4.2.3).

In each event an ADV_EXT_IND on all three primary channels says where and when an AUX_ADV_IND is, which carries the
payload, on a channel that is drawn; what is longer than a packet goes on in AUX_CHAIN_INDs. Whoever has heard one of
the three follows; whoever has the payload does not follow again, as AdvDataInfo tells.
"""

from typing import Final

from cosim.channels.air.arbitration import Rank
from cosim.channels.ble.beacon import device_address
from cosim.channels.ble.bits.pdu import OFFSET_UNITS, AuxiliaryPhy, AuxPtr, DataInfo, Extended, encode_advertising
from cosim.channels.ble.broadcasts.events import Step
from cosim.channels.ble.broadcasts.sets import PayloadSet
from cosim.channels.ble.broadcasts.structures import OVERHEAD, structure
from cosim.channels.ble.channels import ADVERTISING, DATA_CHANNELS
from cosim.channels.ble.connections.exchange import Reception
from cosim.channels.ble.packets import Sent
from cosim.channels.ble.phy import CODED_S8, HEADER_OCTETS, LE_1M, LE_2M, T_IFS, T_MAFS, Phy
from cosim.machine import Address
from cosim.units import Time

MOST_DATA: Final = 1650
"""Octets of the longest advertising data."""
_DATA_OF_PDU: Final = 242
"""Octets of data in each auxiliary PDU: all that fits beside the longest extended header."""
_PDUS: Final = -(-MOST_DATA // _DATA_OF_PDU)
LONGEST_BROADCAST: Final = MOST_DATA - OVERHEAD * _PDUS
"""Octets of the longest payload for everyone."""
_CHANNEL: Final = 1
"""Purpose of the draws of channels."""
_AUXILIARY: Final[dict[str, tuple[Phy, AuxiliaryPhy]]] = {
    "1M": (LE_1M, AuxiliaryPhy.LE_1M),
    "2M": (LE_2M, AuxiliaryPhy.LE_2M),
    "coded": (CODED_S8, AuxiliaryPhy.CODED),
}


def pieces(payload: bytes) -> list[bytes]:
    """Return *payload* in pieces, each a structure of advertising data that fits into a PDU; at least one."""
    size = _DATA_OF_PDU - OVERHEAD
    return [structure(payload[at : at + size]) for at in range(0, len(payload), size)] or [structure(b"")]


class ExtendedSet(PayloadSet):
    """A payload by extended advertising."""

    _follow: set[Address]
    """Who follows in the event under way."""

    def begun(self) -> None:
        """Have nobody follow yet."""
        super().begun()
        self._follow = set()

    def sent(self, packet: Sent) -> None:
        """Have those who follow listen to an auxiliary *packet*."""
        if packet.kind != "ADV_EXT_IND":
            for address in self._follow:
                self.speaker.stations[address].antenna.listens(packet.start, packet.end, packet.phy)

    def ended(self, packet: Sent, last: bool) -> None:
        """Have those who hear an ADV_EXT_IND follow, and those who follow take what they hear."""
        if packet.kind == "ADV_EXT_IND":
            self._point(packet)
        else:
            self._carry(packet, last)

    def _point(self, packet: Sent) -> None:
        """Have those who hear an ADV_EXT_IND follow."""
        begin, end = self._start + self._steps[len(ADVERTISING)].after, self._start + self.duration
        for listener, _ in self.heard_by(packet, self._got | self._follow):
            now, antenna = self._kernel.now, listener.antenna
            free = antenna.taken_until(begin, end) is None
            if free and antenna.refused_until(now, begin, end, Rank.DATA) is None:
                self._follow.add(listener.address)
                antenna.book(begin, end, self, now)

    def _carry(self, packet: Sent, last: bool) -> None:
        """Have those who follow take a part of the payload, and at *last* all of it."""
        for address in sorted(self._follow):
            listener = self.speaker.stations[address]
            here = self._ether.was_on(address, packet.start)
            here = here and listener.antenna.booked_until(packet.start, packet.end, self) is None
            judgement = self.speaker.environment.judged(packet, address) if here else None
            if judgement is None or judgement.reception is not Reception.HEARD:
                self._follow.remove(address)
            elif last:
                self.arrive(address, judgement)

    # ---------------------------------------------------------------- what is sent

    def plan(self) -> list[Step]:
        """Return the packets of the next event."""
        parts = pieces(self.outgoing.payload)
        number = self._number << 8 | self._event
        draws = self.speaker.draws
        channels = [draws.below(DATA_CHANNELS, number, turn, _CHANNEL) for turn in range(len(parts))]
        spacing = LE_1M.air_time(len(self._pointer(channels[0], T_MAFS)) - HEADER_OCTETS) + T_IFS
        first = len(ADVERTISING) * spacing - T_IFS + T_MAFS
        steps = [
            Step(turn * spacing, "ADV_EXT_IND", channel, LE_1M, self._pointer(channels[0], first - turn * spacing), 0)
            for turn, channel in enumerate(ADVERTISING)
        ]
        at = first
        for turn, part in enumerate(parts):
            step = self._carrier(at, turn, part, channels)
            steps.append(step)
            at += self._to_next(len(step.pdu))
        return steps

    @property
    def _info(self) -> DataInfo:
        return DataInfo(self._number // 16 % 4096, self._number % 16)

    @property
    def _phy(self) -> Phy:
        return _AUXILIARY[self._settings.phy][0]

    def _pointer(self, channel: int, offset: Time) -> bytes:
        """Return an ADV_EXT_IND that points to the packet on *channel*, *offset* after its own beginning."""
        return encode_advertising(Extended(data_info=self._info, aux=self._aux(channel, offset, OFFSET_UNITS[0])))

    def _carrier(self, at: Time, turn: int, part: bytes, channels: list[int]) -> Step:
        """Return the packet that carries a *part* of the payload, *at* that time of the event."""
        address = device_address(self.speaker.station.address) if turn == 0 else None
        pdu = Extended(advertiser=address, data_info=self._info, data=part)
        if turn + 1 < len(channels):
            aux = self._aux(channels[turn + 1], T_MAFS, OFFSET_UNITS[1])
            octets = len(encode_advertising(pdu._replace(aux=aux)))
            pdu = pdu._replace(aux=self._aux(channels[turn + 1], self._to_next(octets), OFFSET_UNITS[1]))
        kind = "AUX_CHAIN_IND" if turn else "AUX_ADV_IND"
        return Step(at, kind, channels[turn], self._phy, encode_advertising(pdu), len(part) - OVERHEAD)

    def _aux(self, channel: int, offset: Time, unit: Time) -> AuxPtr:
        return AuxPtr(channel, offset // unit * unit, _AUXILIARY[self._settings.phy][1])

    def _to_next(self, octets: int) -> Time:
        """Return the time from the start of an auxiliary packet, whose PDU has so many octets, to that of the next."""
        unit = OFFSET_UNITS[1]
        return -(-(self._phy.air_time(octets - HEADER_OCTETS) + T_MAFS) // unit) * unit
