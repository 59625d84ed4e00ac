"""Looking for devices that advertise: scanning and initiating, from one advertisement to the next that may be heard.

Which packet of which device would be heard next follows from arithmetic, so that nothing happens in between, and
nothing at all once all devices in reach are known.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

from cosim.channels.ble.advertising import Advertiser
from cosim.channels.ble.beacon import LATER
from cosim.channels.ble.connections.exchange import Reception
from cosim.channels.ble.environment import Environment
from cosim.channels.ble.packets import Sent
from cosim.channels.ble.scanning import HeardPdu, next_heard
from cosim.channels.ble.station import Station
from cosim.kernel import Handle
from cosim.machine import Address
from cosim.units import Time


class _Candidate(NamedTuple):
    """An advertisement that may be heard."""

    end: Time
    peer: Station
    pdu: HeardPdu
    advertiser: Advertiser


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
        sent = peer.beacon.sends(advertiser, advertiser.event_from(pdu.start))
        if sent and self._station.is_free(pdu.start, pdu.end):
            judgement = self._ether.judge(packet, self._station.address)
            if self._record.wanted:
                self._record.sent(packet, True)
                self._record.judged(packet, self._station.address, judgement)
            if judgement.reception is Reception.HEARD:
                self._heard(peer, packet)
        if self._next is not None:  # it has not been ended
            self._consider(peer)
            self._wait()

    def end(self) -> None:
        """End the search."""
        if self._next is not None:
            self._next.cancel()
        self._next, self._peers, self._candidates = None, (), {}
