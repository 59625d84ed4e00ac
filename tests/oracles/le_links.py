"""Links, packet by packet."""

from typing import TYPE_CHECKING

from cosim.channels.ble.bits.access import draw
from cosim.channels.ble.bits.control import PHY_1M, PHY_2M, PHY_CODED, ConnectionUpdateInd, Lengths
from cosim.channels.ble.bits.l2cap import (
    ATTRIBUTES,
    LEAST_OCTETS,
    MOST_TIME,
    MOST_TIME_CODED,
    Message,
    Reassembly,
    fragments,
)
from cosim.channels.ble.bits.pdu import CLOCK_ACCURACIES_PPM, LLData
from cosim.channels.ble.connections.arq import Fragment
from cosim.channels.ble.connections.channel_map import ALL_CHANNELS
from cosim.channels.ble.connections.exchange import Reception, Side, exchange_time
from cosim.channels.ble.connections.link import Link
from cosim.channels.ble.connections.parameters import ConnectionParameters, TransmitWindow
from cosim.channels.ble.phy import CODED_S8, LE_1M, LE_2M, T_IFS, Phy
from cosim.channels.ble.selection import HOP_INCREMENTS
from cosim.machine import Connected, Lost, Mode, ModeChanged, Outcome, Outgoing, Role
from cosim.units import MS, US, S
from tests.oracles.le_air import Packet
from tests.oracles.le_device import Device, Payload, Session

if TYPE_CHECKING:
    from tests.oracles.le_channel import LeChannel

DEADLINE, OVER, TIMER, START = range(-1, 3)
UNIT = 1_250 * US
PHYS: dict[str, tuple[int, Phy]] = {"1M": (PHY_1M, LE_1M), "2M": (PHY_2M, LE_2M), "coded": (PHY_CODED, CODED_S8)}
HANDLE = bytes(3)
"""What is before a payload: the code of a notification, and a handle."""
SPEED = {LE_2M: 2, LE_1M: 1, CODED_S8: 0}


class Links:
    """All links."""

    def __init__(self, channel: "LeChannel") -> None:
        self.channel = channel
        self.coming: dict[tuple[Session, Side], Reassembly] = {}
        self.all: list[Session] = []
        """All of which an end is left."""

    # ---------------------------------------------------------------- how they begin

    def free_part(self, device: Device) -> int | None:
        """Return the lowest part of the interval that no link of the central *device* has."""
        used = {session.part for session, side in device.links.values() if side is Side.CENTRAL}
        return next((part for part in range(self.channel.settings.connection.parts) if part not in used), None)

    def draw(self, device: Device) -> tuple[int, int, int]:
        """Draw access address, CRCInit and hop increment."""
        stream = device.stream
        address = draw(stream)
        return address, int(stream.integers(1 << 24)), int(stream.integers(HOP_INCREMENTS[0], HOP_INCREMENTS[-1] + 1))

    def make(self, central: Device, peripheral: Device, drawn: tuple[int, int, int], accepted: bool) -> None:
        """Make a link by a CONNECT_IND that ends now; *accepted*: whether the peripheral has it, too."""
        settings, now = self.channel.settings.connection, self.channel.now
        part = self.free_part(central)
        assert part is not None
        earliest = central.clock.local(now) + UNIT
        begins = part * (settings.interval // settings.parts)
        anchor = begins - (begins - earliest) // settings.interval * settings.interval
        offset = (anchor - earliest) // UNIT * UNIT
        address, crc_init, hop = drawn
        sca = self.channel.settings.sca
        rhythm = settings.parameters
        ll_data = LLData(
            *(address, crc_init, UNIT, offset, rhythm.interval, rhythm.latency, rhythm.timeout),
            *(ALL_CHANNELS, hop, sca),
        )
        clocks, ppm, start = (central.clock, peripheral.clock), CLOCK_ACCURACIES_PPM[sca], anchor - earliest - offset
        link = Link(ll_data, now, clocks, ppm, start=start)
        self.agree(link)
        session = Session(link, (central, peripheral), part, [True, accepted])
        self.all.append(session)
        central.links[peripheral.address] = session, Side.CENTRAL
        self.channel.report(central.address, Connected(peripheral.address, Role.MASTER, address))
        if accepted:
            peripheral.links[central.address] = session, Side.PERIPHERAL
            self.channel.report(peripheral.address, Connected(central.address, Role.SLAVE, address))
        self.go_on(session)
        self.reconsider()

    def agree(self, link: Link) -> None:
        """Let the central ask for what the settings say."""
        settings = self.channel.settings.connection
        time = MOST_TIME_CODED if settings.phy == "coded" else MOST_TIME
        lengths = Lengths(False, settings.octets, time, settings.octets, time)
        if settings.octets > LEAST_OCTETS:
            link.peripheral.lengths = lengths
            link.request_lengths(Side.CENTRAL, lengths)
        if settings.phy != "1M":
            link.request_phys(Side.CENTRAL, PHYS[settings.phy][0])

    # ---------------------------------------------------------------- events

    def anchor(self, session: Session) -> None:
        """Begin the event whose anchor is now, or leave it out."""
        link, now = session.link, self.channel.now
        link.advance(now)
        self.look(session)
        if not session.alive[0]:
            return
        central, peripheral = session.devices
        end = now + session.least()
        if not session.resting and central.taken(now, end, session):
            link.skip()
            self.go_on(session)
            return
        mine = [each for each, side in central.links.values() if side is Side.CENTRAL]
        until = min(each.anchor_after(now) for each in mine)
        free = session.resting or not peripheral.taken(now, end, session)
        link.begin(until, session.alive[1] and free)
        self.put(session)

    def put(self, session: Session) -> None:
        """Let the next packet of an event come, or end the event."""
        link = session.link
        assert link.on_air is not None
        if link.on_air.packet is None:
            link.finish()
            self.go_on(session)
            return
        packet = link.on_air.packet
        sender = session.devices[packet.sender]
        index = link.channel(Side.CENTRAL, link.event)
        sent = Packet(sender.address, packet.start, link.central.phys[packet.sender], len(packet.pdu.payload), index)
        session.on_air = sent
        if not session.resting:
            self.take(session, packet.sender)
        self.channel.at(sent.start, START, self.send, session, sent)

    def take(self, session: Session, side: Side) -> None:
        """Take the antennas for the packet on the air."""
        packet = session.on_air
        assert packet is not None
        session.devices[side].take(packet.start, packet.end, session)
        if session.alive[1 - side]:
            session.devices[1 - side].take(packet.start, packet.end + T_IFS, session)

    def send(self, session: Session, packet: Packet) -> None:
        """Put a packet on the air."""
        if self.channel.devices[packet.source].on:
            self.channel.air.put(packet)
        self.channel.at(packet.end, OVER, self.sent, session, packet)

    def sent(self, session: Session, packet: Packet) -> None:
        """Take what became of a packet that ends now."""
        link = session.link
        assert link.on_air is not None
        assert link.on_air.packet is not None
        side = link.on_air.packet.sender
        sender, receiver = session.devices[side], session.devices[1 - side]
        reception = Reception.MISSED
        whole = session.alive[1 - side] and sender.was_on(packet) and receiver.was_on(packet)
        if whole and session.resting:
            reception = Reception.HEARD
        elif whole and not receiver.taken(packet.start, packet.end, session):
            reception = self.channel.air.reception(packet, receiver.address)
        heard = link.ended(reception)
        if heard.acknowledged is not None:
            self.acknowledged(session, Side(1 - side), heard.acknowledged)
        if heard.new is not None and heard.new.payload and heard.new.llid != 3:
            reassembly = self.coming.setdefault((session, Side(1 - side)), Reassembly())
            message = reassembly.take(heard.new)
            if message is not None:
                self.channel.arrive(receiver.address, message.information[len(HANDLE) :], packet, broadcast=False)
        self.look(session)
        self.put(session)

    def go_on(self, session: Session) -> None:
        """Go on to the next event."""
        session.on_air = None
        session.resting = session.link.may_rest and self.may_rest(session)
        if session.alive[0]:
            self.channel.at(session.link.anchor, START, self.anchor, session)
        self.watch(session)

    # ---------------------------------------------------------------- rest

    def may_rest(self, session: Session) -> bool:
        """Return whether nothing around a link that is quiet keeps it from resting."""
        air, (central, peripheral) = self.channel.air, session.devices
        down, up = session.link.central.phys
        if not all(session.alive) or not (air.clear(central, peripheral, down) and air.clear(peripheral, central, up)):
            return False
        others = [device for each in self.all if each.devices[0] is not central for device in each.devices]
        if central in others or peripheral in others:
            return False
        near = any(air.notices(other, end) for other in others for end in session.devices)
        return self.channel.settings.interference == "none" or not near

    def reconsider(self) -> None:
        """Wake links that may not rest any more."""
        for session in self.all:
            if session.resting and not self.may_rest(session):
                self.wake(session)

    def wake(self, session: Session) -> None:
        """Have the events of a link take place as others do, from the packet on the air on."""
        if session.resting and session.on_air is not None and session.link.on_air is not None:
            assert session.link.on_air.packet is not None
            self.take(session, session.link.on_air.packet.sender)
        session.resting = False

    # ---------------------------------------------------------------- how they end

    def watch(self, session: Session) -> None:
        """Look again when an end would be lost."""
        for side in Side:
            deadline = session.link.deadline(side)
            if session.alive[side] and deadline != session.watched[side] and session.link.ends[side].loss is None:
                session.watched[side] = deadline
                self.channel.at(max(deadline, self.channel.now), DEADLINE, self.expire, session)

    def expire(self, session: Session) -> None:
        """Let ends be lost whose time is over."""
        session.link.advance(self.channel.now)
        self.look(session)
        self.watch(session)

    def look(self, session: Session) -> None:
        """Report which ends have changed, or have just been lost."""
        self.look_at_intervals(session)
        for side in Side:
            if session.alive[side] and session.link.ends[side].loss is not None:
                device, peer = session.devices[side], session.devices[1 - side]
                session.alive[side] = False
                self.forget(session)
                del device.links[peer.address]
                self.channel.report(device.address, Lost(peer.address))
                for payload in session.payloads[side]:
                    self.channel.over(device.address, payload.outgoing, Outcome.FLUSHED)
                session.payloads[side].clear()
                self.reconsider()

    def vanish(self, device: Device) -> None:
        """Forget the ends of a device that is switched off."""
        for session, side in device.links.values():
            session.alive[side] = False
            self.forget(session)
            for payload in session.payloads[side]:
                self.channel.over(device.address, payload.outgoing, Outcome.FLUSHED)
            session.payloads[side].clear()
        device.links.clear()
        self.reconsider()

    def forget(self, session: Session) -> None:
        """Forget a link without ends."""
        if not any(session.alive):
            self.all.remove(session)

    def close(self, device: Device, peer: int) -> None:
        """Flush what has not begun, and send LL_TERMINATE_IND behind what has."""
        if peer in device.links:
            session, side = device.links[peer]
            self.flush(device, peer)
            self.wake(session)
            session.link.terminate(side)

    # ---------------------------------------------------------------- how often they have events

    def sniff(self, device: Device, peer: int, slots: int) -> None:
        """Announce that a link has an event in one of several intervals only, or say that it stays as it is."""
        if peer not in device.links:
            self.channel.report(device.address, ModeChanged(peer, Mode.NONE))
            return
        session, side = device.links[peer]
        settings, end = self.channel.settings.connection, session.link.ends[side]
        first, timeout = settings.interval, settings.parameters.timeout
        every = first
        while every + first <= slots * 625 * US:
            every += first
        while every > first and timeout <= 2 * (1 + settings.latency) * every:
            timeout += 10 * MS
        busy = any(isinstance(change, ConnectionUpdateInd) for _, change in end.pending)
        allowed = every <= 4 * S and timeout <= 32 * S
        if side is Side.PERIPHERAL or busy or not allowed or every == end.parameters.interval:
            mode = Mode.SNIFF if end.parameters.interval > first else Mode.ACTIVE
            self.channel.report(device.address, ModeChanged(peer, mode))
            return
        self.wake(session)
        window, parameters = TransmitWindow(UNIT, 0), ConnectionParameters(every, settings.latency, timeout)
        session.link.announce(lambda instant: ConnectionUpdateInd(window, parameters, instant))

    def look_at_intervals(self, session: Session) -> None:
        """Report to hosts what has taken effect."""
        first = self.channel.settings.connection.interval
        for side in Side:
            interval = session.link.ends[side].parameters.interval
            if session.alive[side] and interval != (session.intervals[side] or first):
                session.intervals[side] = interval
                device, peer = session.devices[side], session.devices[1 - side].address
                self.channel.report(device.address, ModeChanged(peer, Mode.SNIFF if interval > first else Mode.ACTIVE))

    # ---------------------------------------------------------------- payloads

    def longest(self, session: Session, side: Side) -> int:
        """Return the longest payload of a packet that is agreed on and fits into a part of the interval."""
        settings = self.channel.settings.connection
        part = settings.interval // settings.parts
        end = session.link.ends[side]
        in_use = {*end.phys, PHYS[settings.phy][1]}
        phy = min(in_use, key=lambda each: SPEED[each])
        fitting = [n for n in range(LEAST_OCTETS, end.longest + 1) if exchange_time(phy, n, phy, n) <= part - 2_000]
        return max(fitting, default=LEAST_OCTETS)

    def queue(self, session: Session, side: Side, outgoing: Outgoing) -> None:
        payload = Payload(outgoing)
        message = Message(ATTRIBUTES, HANDLE + outgoing.payload)
        cut = fragments(message, self.longest(session, side), payload)
        payload.fragments = cut
        session.payloads[side].append(payload)
        self.wake(session)
        for fragment in cut:
            session.link.ends[side].arq.push(fragment)

    def hand_in(self, device: Device, outgoing: Outgoing) -> None:
        """Queue a payload for one."""
        session, side = device.links.get(outgoing.destination, (None, Side.CENTRAL))
        if session is None:
            self.channel.over(device.address, outgoing, Outcome.NO_LINK)
        else:
            self.queue(session, side, outgoing)

    def acknowledged(self, session: Session, side: Side, fragment: Fragment) -> None:
        """Note that a fragment has been acknowledged."""
        payload = fragment.token
        if isinstance(payload, Payload) and payload in session.payloads[side]:
            session.payloads[side].remove(payload)
            self.channel.over(session.devices[side].address, payload.outgoing, Outcome.DELIVERED)

    def flush(self, device: Device, peer: int) -> None:
        """Take out payloads of which no fragment has been on the air."""
        if peer not in device.links:
            return
        session, side = device.links[peer]
        arq = session.link.ends[side].arq
        for payload in list(session.payloads[side]):
            waiting = [each for each in arq.data if any(each is mine for mine in payload.fragments)]
            if len(waiting) == len(payload.fragments):
                for fragment in waiting:
                    place = next(k for k, each in enumerate(arq.data) if each is fragment)
                    del arq.data[place]
                session.payloads[side].remove(payload)
                self.channel.over(device.address, payload.outgoing, Outcome.FLUSHED)
