"""Looking for devices that advertise: scanning and initiating, from one advertisement to the next that may be heard.

Who scans actively asks for scan responses, not too often: scanners that ask at once would never be answered.

Which packet of which device would be heard next follows from arithmetic, so that nothing happens in between, and
nothing at all once all devices in reach are known.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

from cosim.channels.air.arbitration import Rank
from cosim.channels.ble.advertising import Advertiser
from cosim.channels.ble.beacon import LATER, device_address
from cosim.channels.ble.bits.pdu import AdvertisingType, Directed, encode_advertising
from cosim.channels.ble.connections.exchange import Reception
from cosim.channels.ble.environment import Environment
from cosim.channels.ble.packets import Sent
from cosim.channels.ble.phy import HEADER_OCTETS, LE_1M, T_IFS
from cosim.channels.ble.scanning import Backoff, HeardPdu, next_heard
from cosim.channels.ble.station import Station
from cosim.kernel import Handle
from cosim.machine import Address
from cosim.randomness import Draws
from cosim.units import Time


class _Candidate(NamedTuple):
    """An advertisement that may be heard."""

    end: Time
    peer: Station
    pdu: HeardPdu
    advertiser: Advertiser


class Requests:
    """The requests of *station* for the scan responses of devices whose advertisements it has heard, until it is ended.

    *answered* is called with (station, packet) at the end of a scan response that was heard.
    """

    def __init__(
        self,
        environment: Environment,
        station: Station,
        draws: Draws,
        answered: Callable[[Station, Sent], None],
    ) -> None:
        """*draws* is the stream of its back-off."""
        self._environment = environment
        self._kernel, self._ether, _, self._record = environment
        self._station = station
        self._backoff = Backoff(draws)
        self._answered = answered
        self._over = False

    def heard(self, peer: Station, packet: Sent) -> None:
        """Take an advertisement of *peer* that has just been heard: ask, unless the back-off lets it pass."""
        own, other = device_address(self._station.address), device_address(peer.address)
        pdu = encode_advertising(Directed(AdvertisingType.SCAN_REQ, own, other))
        request = self._packet("SCAN_REQ", packet.end + T_IFS, self._station, peer, packet, pdu)
        response = self._packet("SCAN_RSP", request.end + T_IFS, peer, self._station, packet, peer.beacon.response)
        antenna = self._station.antenna
        if antenna.taken_until(request.start, response.end) is not None:
            return
        now = self._kernel.now
        if antenna.refused_until(now, now, response.end, Rank.EMPTY) is not None or not self._backoff.asks():
            return
        antenna.book(packet.end, response.end, self, self._kernel.now)
        antenna.listens(packet.end, request.start, LE_1M)
        antenna.sends(request)
        antenna.listens(request.end, response.start + LE_1M.lead, LE_1M)
        peer.antenna.listens(request.start, request.end, LE_1M)
        self._ether.send(request)
        self._kernel.at(request.end, lambda: self._requested(peer, request, response))

    def _packet(self, kind: str, start: Time, source: Station, to: Station, asked: Sent, pdu: bytes) -> Sent:
        octets = len(pdu) - HEADER_OCTETS
        of_link_layer = asked.access_address, asked.crc_init, pdu
        return Sent(start, source.address, to.address, kind, asked.channel, LE_1M, octets, 0, *of_link_layer)

    def _requested(self, peer: Station, request: Sent, response: Sent) -> None:
        """Have *peer* answer a *request* that it has heard."""
        here = self._ether.was_on(peer.address, request.start) and peer.beacon.advertiser is not None
        here = here and peer.antenna.booked_until(request.start, response.end) is None
        if self._heard(request, peer) and here:
            peer.ask(self._kernel, self._station.address, partial(self._answer, peer, response))
        else:
            self._backoff.asked(False)

    def _answer(self, peer: Station, response: Sent, answers: bool) -> None:
        """Have *peer* send its *response* if it *answers*, and not somebody else."""
        if not answers:
            self._backoff.asked(False)
            return
        now = self._kernel.now
        peer.antenna.book(now, response.end, self, now)  # whatever else it hears comes too late
        peer.antenna.listens(now, response.start, LE_1M)
        peer.antenna.sends(response)
        self._station.antenna.listens(response.start, response.end, LE_1M)
        self._ether.send(response)
        self._kernel.at(response.end, lambda: self._responded(peer, response))

    def _responded(self, peer: Station, response: Sent) -> None:
        heard = self._heard(response, self._station) and self._ether.was_on(self._station.address, response.start)
        self._backoff.asked(heard)
        if heard and not self._over:
            self._answered(peer, response)

    def _heard(self, packet: Sent, receiver: Station) -> bool:
        if self._record.wanted:
            self._record.sent(packet, self._ether.was_on(packet.source, packet.start))
        return self._environment.judged(packet, receiver.address).reception is Reception.HEARD

    def end(self) -> None:
        """Ask for nothing more: an answer that is on its way comes too late."""
        self._over = True


class Search:
    """The search of *station* for those of *peers* that are *wanted*, in its windows, until it is ended.

    *heard* is called with (station, packet) at the end of an advertisement that was heard.
    """

    def __init__(
        self,
        environment: Environment,
        station: Station,
        peers: Sequence[Station],
        wanted: Callable[[Address], bool],
        heard: Callable[[Station, Sent], None],
    ) -> None:
        self._environment = environment
        self._kernel, self._ether, _, self._record = environment
        self._station, self._peers = station, peers
        self._wanted, self._heard = wanted, heard
        self._began = self._kernel.now
        self._next: Handle | None = None
        self._since: dict[Address, Time] = {}  # from when on packets of a peer have not been looked at
        self._candidates: dict[Address, _Candidate] = {}
        self.refresh()

    def refresh(self) -> None:
        """Find the next advertisement anew: robots have moved, or begun or ceased to advertise."""
        self._candidates = {}
        for peer in self._peers:
            self._consider(peer)
        self._wait()

    def _consider(self, peer: Station) -> None:
        """Find the next advertisement of *peer* that may be heard, if there will be any."""
        self._candidates.pop(peer.address, None)
        if (candidate := self._candidate(peer)) is not None:
            self._candidates[peer.address] = candidate

    def _wait(self) -> None:
        """Wait for the first of the advertisements that may be heard."""
        if self._next is not None:
            self._next.cancel()
            self._next = None
        if self._candidates:
            first = min(self._candidates.values(), key=lambda candidate: (candidate.end, candidate.peer.address))
            self._next = self._kernel.at(first.end, lambda: self._look(first))

    def _candidate(self, peer: Station) -> "_Candidate | None":
        if not self._wanted(peer.address) or not self._ether.notices(peer.address, self._station.address):
            return None
        looked, found = max(self._since.get(peer.address, 0), self._began), []
        for advertiser, begun, over in peer.beacon.runs:
            under_way = self._kernel.now - advertiser.air_time + 1  # it has begun and is not over
            until = min(LATER, over + advertiser.air_time)
            pdu = next_heard(advertiser, self._station.windows, max(looked, begun, under_way), until)
            if pdu is not None and pdu.start < over:
                found.append(_Candidate(pdu.end, peer, pdu, advertiser))
        return min(found, key=lambda candidate: candidate.end, default=None)

    def _look(self, candidate: "_Candidate") -> None:
        _, peer, pdu, advertiser = candidate
        self._since[peer.address] = pdu.start + 1
        packet = peer.beacon.packet(pdu.channel, pdu.start)
        sent = peer.beacon.sends(advertiser, advertiser.event_from(pdu.start)) and not peer.beacon.hears(pdu.start)
        if sent and self._station.is_free(pdu.start, pdu.end):
            if self._record.wanted and peer.beacon.written < packet.start:
                peer.beacon.written = packet.start
                self._record.sent(packet, True)
            if self._environment.judged(packet, self._station.address).reception is Reception.HEARD:
                self._heard(peer, packet)
        if self._next is not None:  # it has not been ended
            self._consider(peer)
            self._wait()

    def end(self) -> None:
        """End the search."""
        if self._next is not None:
            self._next.cancel()
        self._next, self._peers, self._candidates = None, (), {}
