"""Inquiries and pages, one after the other."""

from typing import TYPE_CHECKING

from cosim.channels.ble.connections.exchange import Reception
from cosim.channels.ble.phy import LE_1M, T_IFS
from cosim.machine import Discovered, Inquire, InquiryComplete, Page, PageFailed
from cosim.units import from_seconds
from tests.oracles.le_advertising import name_octets
from tests.oracles.le_air import Packet
from tests.oracles.le_device import Device, Procedure

if TYPE_CHECKING:
    from tests.oracles.le_channel import LeChannel

OVER, TIMER, START = range(3)
CONNECT_OCTETS = 34


class Procedures:
    """What hosts have asked for."""

    def __init__(self, channel: "LeChannel") -> None:
        self.channel = channel

    def ask(self, device: Device, command: Inquire | Page) -> None:
        """Take *command*."""
        device.procedures.append(command)
        if device.procedure is None:
            self.next(device)

    def next(self, device: Device) -> None:
        """Begin what was asked for next."""
        channel, device.procedure = self.channel, None
        while device.procedures and device.procedure is None:
            command = device.procedures.popleft()
            if isinstance(command, Inquire):
                duration, possible = command.duration, command.enough > 0 and command.duration > 0
            else:
                duration, possible = from_seconds(channel.settings.page_s), self.possible(device, command.peer)
            procedure = Procedure(command, channel.now, number=device.inquiries)
            device.inquiries += possible and isinstance(command, Inquire)
            if possible:
                device.procedure = procedure
                channel.at(channel.now + duration, TIMER, self.give_up, device, procedure)
            else:
                self.fail(device, procedure)

    def possible(self, device: Device, peer: int) -> bool:
        """Return whether *device* may page *peer* at all."""
        there = 0 <= peer < len(self.channel.devices) and peer != device.address
        return there and peer not in device.links and self.channel.links.free_part(device) is not None

    def fail(self, device: Device, procedure: Procedure) -> None:
        """Report the end of a procedure that has come to no link."""
        command = procedure.command
        event = InquiryComplete(tuple(procedure.found)) if isinstance(command, Inquire) else PageFailed(command.peer)
        self.channel.report(device.address, event)

    def give_up(self, device: Device, procedure: Procedure) -> None:
        """End a procedure that is still under way."""
        if device.procedure is procedure and not procedure.connecting:
            self.fail(device, procedure)
            self.next(device)

    def heard(self, device: Device, advertiser: Device, packet: Packet) -> None:
        """Take an ADV_IND that *device* has heard."""
        procedure, peer = device.procedure, advertiser.address
        if procedure is None or procedure.begin > packet.start:
            return
        if isinstance(procedure.command, Page):
            if procedure.command.peer == peer and not procedure.connecting:
                self.connect(device, advertiser, procedure, packet)
        elif peer not in procedure.found:
            if self.channel.settings.scan.active:
                self.ask_name(device, advertiser, procedure, packet)
            else:
                self.found(device, peer, procedure)

    def found(self, device: Device, peer: int, procedure: Procedure) -> None:
        """Report somebody that an inquiry has found."""
        assert isinstance(procedure.command, Inquire)
        procedure.found.append(peer)
        self.channel.report(device.address, Discovered(peer))
        if len(procedure.found) >= procedure.command.enough:
            self.fail(device, procedure)
            self.next(device)

    # ---------------------------------------------------------------- names

    def ask_name(self, device: Device, advertiser: Device, procedure: Procedure, heard: Packet) -> None:
        """Ask who has advertised for its name, T_IFS later, unless that has to wait."""
        start = heard.end + T_IFS
        asked = start + LE_1M.air_time(6 + 6)
        end = asked + T_IFS + LE_1M.air_time(6 + name_octets(advertiser))
        if device.taken(start, end) or device.planned(start, end):
            return
        procedure.count -= 1
        if procedure.count:
            return
        device.take(heard.end, end, procedure)
        what = advertiser, procedure, heard.channel, end
        self.channel.at(start, START, self.send_request, device, what)

    def send_request(self, device: Device, what: tuple[Device, Procedure, int, int]) -> None:
        """Put a SCAN_REQ on the air."""
        if device.on:
            packet = Packet(device.address, self.channel.now, LE_1M, 6 + 6, what[2])
            self.channel.air.put(packet)
            self.channel.at(packet.end, OVER, self.asked, device, packet, what)

    def asked(self, device: Device, packet: Packet, what: tuple[Device, Procedure, int, int]) -> None:
        """Answer a SCAN_REQ that ends now, if it is heard."""
        advertiser, procedure, index, end = what
        hears = (
            device.was_on(packet)
            and advertiser.was_on(packet)
            and advertiser.run is not None
            and not advertiser.taken(packet.start, end)
            and self.channel.air.reception(packet, advertiser.address) is Reception.HEARD
        )
        if not hears:
            self.draw_count(device, procedure, answered=False)
            return
        advertiser.askers.append((device.address, device, procedure))
        if len(advertiser.askers) == 1:
            self.channel.at(packet.end, OVER, self.choose, advertiser, index, end)

    def choose(self, advertiser: Device, index: int, end: int) -> None:
        """Answer one of those who have asked at this instant, whose number is the lowest."""
        askers, advertiser.askers = sorted(advertiser.askers, key=lambda asker: asker[0]), []
        for _, device, procedure in askers[1:]:
            self.draw_count(device, procedure, answered=False)
        _, device, procedure = askers[0]
        advertiser.take(self.channel.now, end, procedure)
        self.channel.at(self.channel.now + T_IFS, START, self.send_response, device, advertiser, procedure, index)

    def send_response(self, device: Device, advertiser: Device, procedure: Procedure, index: int) -> None:
        """Put a SCAN_RSP on the air."""
        octets = 6 + name_octets(advertiser)
        packet = Packet(advertiser.address, self.channel.now, LE_1M, octets, index)
        if advertiser.on:
            self.channel.air.put(packet)
        self.channel.at(packet.end, OVER, self.answered, device, advertiser, procedure, packet)

    def answered(self, device: Device, advertiser: Device, procedure: Procedure, packet: Packet) -> None:
        """Take a SCAN_RSP that ends now."""
        heard = (
            advertiser.was_on(packet)
            and device.was_on(packet)
            and self.channel.air.reception(packet, device.address) is Reception.HEARD
        )
        self.draw_count(device, procedure, heard)
        if heard and device.procedure is procedure:
            self.found(device, advertiser.address, procedure)

    def draw_count(self, device: Device, procedure: Procedure, answered: bool) -> None:
        """Draw how many advertisements come up to the next that is asked."""
        same = answered == (procedure.row > 0)
        procedure.row = (procedure.row if same else 0) + (1 if answered else -1)
        if procedure.row == 2:
            procedure.limit, procedure.row = max(1, procedure.limit // 2), 0
        elif procedure.row == -2:
            procedure.limit, procedure.row = min(256, 2 * procedure.limit), 0
        draws = self.channel.streams.draws("ble", "backoff", device.address, procedure.number)
        procedure.count = 1 + draws.below(procedure.limit, procedure.asked)
        procedure.asked += 1

    # ---------------------------------------------------------------- links

    def connect(self, device: Device, advertiser: Device, procedure: Procedure, heard: Packet) -> None:
        """Answer an ADV_IND, if the antenna is free for it."""
        start = heard.end + T_IFS
        end = start + LE_1M.air_time(CONNECT_OCTETS)
        drawn = self.channel.links.draw(device)
        if device.taken(heard.end, end) or device.planned(heard.end, end):
            return
        procedure.connecting = True
        device.take(start, end, procedure)
        self.channel.at(start, START, self.send, device, advertiser, procedure, (heard.channel, drawn))

    def send(
        self, device: Device, advertiser: Device, procedure: Procedure, what: tuple[int, tuple[int, int, int]]
    ) -> None:
        """Put a CONNECT_IND on the air."""
        index, drawn = what
        if device.procedure is procedure:
            packet = Packet(device.address, self.channel.now, LE_1M, CONNECT_OCTETS, index)
            self.channel.air.put(packet)
            advertiser.requested = packet.start, packet.end
            self.channel.at(packet.end, OVER, self.sent, device, advertiser, procedure, packet, drawn)

    def sent(
        self, device: Device, advertiser: Device, procedure: Procedure, packet: Packet, drawn: tuple[int, int, int]
    ) -> None:
        """Make the link at the end of a CONNECT_IND."""
        if device.procedure is not procedure:
            return
        accepted = (
            advertiser.was_on(packet)
            and advertiser.run is not None
            and not advertiser.taken(packet.start, packet.end)
            and device.address not in advertiser.links
            and self.channel.air.reception(packet, advertiser.address) is Reception.HEARD
        )
        self.channel.links.make(device, advertiser, drawn, accepted)
        self.next(device)
        if not accepted:
            return
        self.channel.advertising.stop(advertiser)
        self.channel.advertising.begin(advertiser)
        paging = advertiser.procedure
        if paging is not None and paging.command == Page(device.address):
            self.fail(advertiser, paging)
            self.next(advertiser)
