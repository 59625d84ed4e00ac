"""One LE device: its procedures, one at a time, its links, its advertising, and what it sends to everyone.

A device can be central of some links and peripheral of others at once. It advertises as long as its host wants it to be
found, also with links, and begins anew when a link has come up. It scans during a procedure; else it listens to
payloads for everyone. All of this is done by one antenna.
"""

from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Final, NamedTuple

import numpy as np

from cosim.channels.air.arbitration import Arbitration, Rank
from cosim.channels.ble.antenna import Antenna
from cosim.channels.ble.beacon import Asking, Beacon, device_address
from cosim.channels.ble.bits.access import draw
from cosim.channels.ble.bits.control import PHY_1M, PHY_2M, PHY_CODED, Lengths
from cosim.channels.ble.bits.l2cap import MOST_TIME, MOST_TIME_CODED
from cosim.channels.ble.bits.pdu import CLOCK_ACCURACIES_PPM, ConnectInd, LLData, encode_advertising
from cosim.channels.ble.broadcasts.events import Speaker
from cosim.channels.ble.broadcasts.ways import WAYS
from cosim.channels.ble.channels import ADVERTISING
from cosim.channels.ble.connections.anchors import WINDOW_DELAYS
from cosim.channels.ble.connections.channel_map import ALL_CHANNELS
from cosim.channels.ble.connections.exchange import Reception, Side
from cosim.channels.ble.connections.link import Link
from cosim.channels.ble.connections.parameters import INTERVAL_UNIT
from cosim.channels.ble.discovery import Requests, Search
from cosim.channels.ble.environment import Environment
from cosim.channels.ble.packets import Sent
from cosim.channels.ble.phy import HEADER_OCTETS, LE_1M, T_IFS
from cosim.channels.ble.scanning import ScanWindows
from cosim.channels.ble.selection import HOP_INCREMENTS
from cosim.channels.ble.session import Limits, Session, Terminal
from cosim.channels.ble.settings import LINK_PHYS, BleSettings, ScanSettings
from cosim.channels.ble.station import Station
from cosim.channels.clock import NativeClock
from cosim.intervals import Intervals
from cosim.kernel import Handle
from cosim.machine import (
    Address,
    Connected,
    Discovered,
    Inquire,
    InquiryComplete,
    Outcome,
    Outgoing,
    Page,
    PageFailed,
    Role,
)
from cosim.randomness import Streams
from cosim.units import Time, from_seconds

_BITS: Final = {"1M": PHY_1M, "2M": PHY_2M, "coded": PHY_CODED}
"""Bits of the PHYs to which links can change."""
_DELAY: Final = WINDOW_DELAYS["legacy"]


class Site(NamedTuple):
    """What all devices of a run share."""

    environment: Environment
    settings: BleSettings
    devices: "list[Device]"
    """All of them, by address."""
    stations: list[Station]
    """What others meet of them, by address."""
    sessions: list[Session]
    """All links that an end is left of."""
    streams: Streams
    may_rest: Callable[[Session], bool]
    """Whether no other link keeps one from resting."""
    changed: Callable[[], None]
    """Called when a device begins or ceases to advertise, or a link has come up or is gone."""


class Device:
    """The device *address*."""

    def __init__(self, site: Site, address: Address) -> None:
        self.address = address
        self.links: dict[Address, Session] = {}
        """Its links, by the device at the other end."""
        self.search: Search | None = None
        """The scan of the procedure under way."""
        self._site = site
        self._kernel, self._ether, self._hosts, self._record = site.environment
        stream = site.streams("ble", "device", address)
        settings = site.settings
        phase = int(stream.integers(settings.advertise.interval + settings.scan.interval + settings.listen.interval))
        spread = settings.clock_ppm
        self.clock = NativeClock(phase, int(stream.integers(-spread, spread + 1)))
        self._stream = stream
        antenna = Antenna()
        delays = partial(site.streams.draws, "ble", "delay", address)
        beacon = Beacon(address, self.clock, settings.advertise.interval, antenna, delays, settings.scan.active)
        self._scan = _windows(self.clock, settings.scan, stream)
        self._listen = _windows(self.clock, settings.listen, stream)
        self.station = Station(address, self._ether, antenna, beacon, self._listen)
        self._asking = Asking(self._kernel, beacon, antenna)
        site.stations.append(self.station)
        self._way = WAYS[settings.broadcast.by]
        draws = site.streams.draws("ble", "sets", address)
        speaker = Speaker(site.environment, self.station, site.stations, draws)
        self._broadcasts = self._way.make(speaker, settings.broadcast)
        self._findable = True
        self._procedures: deque[Inquire | Page] = deque()
        self._procedure: Inquire | Page | None = None
        self._end: Handle | None = None
        self._found: list[Address] = []
        self._inquiries = 0
        """Number of active ones."""
        self._requests: Requests | None = None
        """What it asks for while it inquires actively."""

    def start(self, first: bool = False) -> None:
        """Be switched on: advertise if that is wanted."""
        interval = self._site.settings.advertise.interval
        if first:
            self._advertise(int(self._stream.integers(interval)))
        else:
            self._advertise()

    def arbitrate(self, arbitration: Arbitration, intervals: Intervals) -> None:
        """Ask before it sends, if the robot has other radios in the air."""
        antenna = self.station.antenna
        uses = partial(antenna.used_until, self.address)
        antenna.seat = arbitration.seat(self.address, self._ether.tenancy.number, uses, intervals)

    # ---------------------------------------------------------------- payloads

    def send(self, outgoing: Outgoing) -> None:
        """Send a payload over a link."""
        session = self.links.get(outgoing.destination)
        if session is None:
            self._hosts.over(self.address, outgoing, Outcome.NO_LINK)
        else:
            session.send(self.address, outgoing)

    def broadcast(self, outgoing: Outgoing) -> None:
        """Send a payload to everyone who listens."""
        limit = self._site.settings.queue_payloads
        if len(outgoing.payload) > self._way.longest:
            self._hosts.over(self.address, outgoing, Outcome.TOO_LONG)
        elif limit is not None and self._broadcasts.held >= limit:
            self._hosts.over(self.address, outgoing, Outcome.QUEUE_FULL)
        else:
            now, payloads = self._kernel.now, self._hosts.payloads
            payloads.accept(outgoing, self.address, outgoing.destination, len(outgoing.payload), now)
            self._broadcasts.send(outgoing)

    def flush_broadcasts(self) -> None:
        """Take out of the queue the payloads for everyone that have not been on the air."""
        for outgoing in self._broadcasts.flush():
            self._hosts.over(self.address, outgoing, Outcome.FLUSHED)

    # ---------------------------------------------------------------- advertising

    def want_scan(self, enabled: bool) -> None:
        """Let itself be found and connected, or not."""
        self._findable = enabled
        if enabled:
            self._advertise()
        else:
            self._conceal()

    def _advertise(self, after: Time = 0) -> None:
        if self._findable and self._ether.on[self.address] and self.station.beacon.advertiser is None:
            self.station.antenna.settle(self._kernel.now)
            self.station.beacon.begin(self._kernel.now, after)
            self._asking.begin()
            self._site.changed()

    def _conceal(self) -> None:
        self.station.antenna.settle(self._kernel.now)
        self.station.beacon.end(self._kernel.now)
        self._site.changed()

    # ---------------------------------------------------------------- procedures

    def request(self, command: Inquire | Page) -> None:
        """Inquire or page once the procedures asked for before are over."""
        self._procedures.append(command)
        self._begin_next()

    def _begin_next(self) -> None:
        while self._procedure is None and self._procedures:
            command = self._procedures.popleft()
            if isinstance(command, Inquire):
                self._inquire(command)
            else:
                self._page(command)

    def _inquire(self, command: Inquire) -> None:
        if command.enough < 1 or command.duration < 1:
            self._hosts.report(self.address, InquiryComplete(()))
            return
        self._found = []
        heard = self._discovered
        if self._site.settings.scan.active:
            draws = self._site.streams.draws("ble", "backoff", self.address, self._inquiries)
            self._requests = Requests(self._site.environment, self.station, draws, self._named)
            self._inquiries += 1
            heard = self._requests.heard
        self._begin(command, command.duration, lambda peer: peer not in self._found, heard)

    def _page(self, command: Page) -> None:
        peer = command.peer
        strange = peer == self.address or not 0 <= peer < len(self._site.devices)
        if strange or peer in self.links or self._part() is None:
            self._hosts.report(self.address, PageFailed(peer))
            return
        duration = from_seconds(self._site.settings.page_s)
        self._begin(command, duration, lambda other: other == peer, self._connect)

    def _begin(
        self,
        command: Inquire | Page,
        duration: Time,
        wanted: Callable[[Address], bool],
        heard: Callable[[Station, Sent], None],
    ) -> None:
        site = self._site
        self._procedure = command
        self._end = self._kernel.after(duration, self._time_out)
        self._hosts.intervals.begin(self.address, self._state, self._kernel.now, self._detail)
        self._listen_in(self._scan)
        peers = [station for station in site.stations if station is not self.station]
        self.search = Search(site.environment, self.station, peers, wanted, heard)

    @property
    def _state(self) -> str:
        return "scanning" if isinstance(self._procedure, Inquire) else "initiating"

    @property
    def _detail(self) -> str:
        return f"peer={self._procedure.peer}" if isinstance(self._procedure, Page) else ""

    def _over(self) -> None:
        """End the procedure under way."""
        if self.search is not None:
            self.search.end()
        if self._requests is not None:
            self._requests.end()
        if self._end is not None:
            self._end.cancel()
        if self._procedure is not None:
            self._hosts.intervals.end(self.address, self._state, self._kernel.now, self._detail)
        self.search = self._requests = self._end = self._procedure = None
        self._listen_in(self._listen)

    def _listen_in(self, windows: ScanWindows) -> None:
        self.station.antenna.settle(self._kernel.now)
        self.station.windows = windows

    def _time_out(self) -> None:
        command = self._procedure
        self._over()
        if isinstance(command, Page):
            self._hosts.report(self.address, PageFailed(command.peer))
        else:
            self._hosts.report(self.address, InquiryComplete(tuple(self._found)))
        self._begin_next()

    def _discovered(self, peer: Station, packet: Sent) -> None:
        command = self._procedure
        assert isinstance(command, Inquire)
        self._found.append(peer.address)
        self._hosts.report(self.address, Discovered(peer.address))
        if len(self._found) >= command.enough:
            self._time_out()

    def _named(self, peer: Station, response: Sent) -> None:
        """Take the scan response of *peer*, whose advertisements have been waited for up to now."""
        self._discovered(peer, response)
        if self.search is not None:
            self.search.refresh()

    # ---------------------------------------------------------------- initiating

    def _part(self) -> int | None:
        """Return a free part of the interval, of which each link that it is the central of has one."""
        connection = self._site.settings.connection
        taken = {session.part for session in self.links.values() if session.central == self.address}
        return next((part for part in range(connection.parts) if part not in taken), None)

    def _connect(self, peer: Station, packet: Sent) -> None:
        """Send a CONNECT_IND to *peer*, whose advertisement has just been heard, if the antenna is free for it."""
        part, start = self._part(), packet.end + T_IFS
        assert part is not None  # it was free as the procedure began, and only that makes links as central
        ll_data, first = self._ll_data(part, start)
        pdu = encode_advertising(ConnectInd(device_address(self.address), device_address(peer.address), ll_data, True))
        octets = len(pdu) - HEADER_OCTETS
        of_link_layer = packet.access_address, packet.crc_init, pdu
        request = Sent(
            start, self.address, peer.address, "CONNECT_IND", packet.channel, LE_1M, octets, 0, *of_link_layer
        )
        antenna, now = self.station.antenna, self._kernel.now
        if antenna.taken_until(start, request.end) is not None:
            return
        if antenna.refused_until(now, now, request.end, Rank.DATA) is not None:
            return
        self.station.antenna.book(start, request.end, self, self._kernel.now)
        self._ether.send(request)
        self.station.antenna.listens(packet.end, start, LE_1M)
        self.station.antenna.sends(request)
        peer.antenna.listens(start, request.end, LE_1M)
        peer.beacon.request(start, request.end)
        self._procedure_stops()
        self._kernel.at(request.end, lambda: self._requested(peer, request, ll_data, first, part))

    def _procedure_stops(self) -> None:
        """Look for nothing more: the request is on its way, and that makes the link."""
        assert self.search is not None
        assert self._end is not None
        self.search.end()
        self._end.cancel()

    def _ll_data(self, part: int, start: Time) -> tuple[LLData, Time]:
        """Return what a CONNECT_IND from *start* on proposes, and when its first event is after its window begins.

        Events begin at the same time of each interval of the central's clock, in *part* of it.
        """
        connection, parameters = self._site.settings.connection, self._site.settings.connection.parameters
        opens = self.clock.local(start + LE_1M.air_time(34)) + _DELAY
        phase = part * (parameters.interval // connection.parts)
        wait = (phase - opens) % parameters.interval
        offset = wait // INTERVAL_UNIT * INTERVAL_UNIT
        ll_data = LLData(
            access_address=draw(self._stream),
            crc_init=int(self._stream.integers(1 << 24)),
            window_size=INTERVAL_UNIT,
            window_offset=offset,
            interval=parameters.interval,
            latency=parameters.latency,
            timeout=parameters.timeout,
            channel_map=ALL_CHANNELS,
            hop=int(self._stream.integers(HOP_INCREMENTS.start, HOP_INCREMENTS.stop)),
            sca=self._site.settings.sca,
        )
        return ll_data, wait - offset

    def _requested(self, peer: Station, request: Sent, ll_data: LLData, first: Time, part: int) -> None:
        """Have a link as central, and *peer* one as peripheral if it has heard the *request*."""
        site = self._site
        if not self._ether.was_on(self.address, request.start):
            return
        here = self._ether.was_on(peer.address, request.start) and peer.beacon.advertiser is not None
        here = here and peer.antenna.booked_until(request.start, request.end) is None
        if self._record.wanted:
            self._record.sent(request, True)
        judgement = site.environment.judged(request, peer.address)
        heard = here and judgement.reception is Reception.HEARD and self.address not in site.devices[peer.address].links
        self._over()
        session = self._session(peer, ll_data, first, part, heard)
        self._join(peer.address, session, Role.MASTER, ll_data.access_address)
        if heard:
            site.devices[peer.address].join_as_peripheral(self.address, session, ll_data.access_address)
        session.begin()
        self._begin_next()

    def _session(self, peer: Station, ll_data: LLData, first: Time, part: int, heard: bool) -> Session:
        site, connection = self._site, self._site.settings.connection
        ppm = CLOCK_ACCURACIES_PPM[site.settings.sca]
        clocks = self.clock, site.devices[peer.address].clock
        link = Link(ll_data, self._kernel.now, clocks, ppm, start=first)
        phy, bits = LINK_PHYS[connection.phy], _BITS[connection.phy]
        limits = Limits(
            connection.mtu_octets,
            site.settings.queue_payloads,
            connection.interval // connection.parts,
            phy,
            connection.adaptation,
        )
        terminals = Terminal(self.address, self.station.antenna), Terminal(peer.address, peer.antenna, gone=not heard)
        for end in link.ends:
            end.likes = bits
        if connection.octets > 27:
            time = MOST_TIME_CODED if bits == PHY_CODED else MOST_TIME
            lengths = Lengths(False, connection.octets, time, connection.octets, time)
            link.peripheral.lengths = lengths
            link.request_lengths(Side.CENTRAL, lengths)
        if bits != PHY_1M:
            link.request_phys(Side.CENTRAL, bits)
        return Session(site.environment, link, part, terminals, limits, self._left, site.may_rest)

    def join_as_peripheral(self, central: Address, session: Session, access_address: int) -> None:
        """Have a link in which this device is the peripheral; its advertising begins anew."""
        if isinstance(self._procedure, Page) and self._procedure.peer == central:
            self._over()
            self._hosts.report(self.address, PageFailed(central))
        self._conceal()
        self._join(central, session, Role.SLAVE, access_address)
        self._advertise()
        self._begin_next()

    def _join(self, peer: Address, session: Session, role: Role, access_address: int) -> None:
        self.links[peer] = session
        if role is Role.MASTER:
            self._site.sessions.append(session)
        state = "central" if role is Role.MASTER else "peripheral"
        self._hosts.intervals.begin(self.address, state, self._kernel.now, f"peer={peer}")
        self._hosts.report(self.address, Connected(peer, role, access_address))
        self._site.changed()

    def _left(self, address: Address, peer: Address) -> None:
        """Note that the link of the device *address* to *peer* is over for it."""
        site = self._site
        device = site.devices[address]
        session = device.links.pop(peer, None)
        if session is not None:
            state = "central" if session.central == address else "peripheral"
            self._hosts.intervals.end(address, state, self._kernel.now, f"peer={peer}")
            if all(terminal.gone for terminal in session.terminals):
                site.sessions.remove(session)

    # ---------------------------------------------------------------- power

    def switch_off(self) -> None:
        """Forget all that is under way; of what links hold is reported that it is flushed, and nothing else."""
        self._conceal()
        self._procedures.clear()
        self._over()
        self._broadcasts.cancel()
        for session in list(self.links.values()):
            session.drop(self.address)
        self._hosts.payloads.lose(self.address, self._kernel.now)


def _windows(clock: NativeClock, settings: ScanSettings, stream: np.random.Generator) -> ScanWindows:
    """Return windows whose beginning, and first channel, are drawn from *stream*."""
    turn = int(stream.integers(len(ADVERTISING)))
    channels = ADVERTISING[turn:] + ADVERTISING[:turn]
    return ScanWindows(clock, int(stream.integers(settings.interval)), settings.interval, settings.window, channels)
