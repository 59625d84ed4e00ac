"""The packets of one piconet: put on the air, judged at their receivers; what they carry goes to the hosts."""

from cosim.channels.base import Arrival
from cosim.channels.bluetooth.clock import NativeClock
from cosim.channels.bluetooth.frames import FrameLog
from cosim.channels.bluetooth.links import Links
from cosim.channels.bluetooth.packets import PacketType
from cosim.channels.bluetooth.polling import USED
from cosim.channels.bluetooth.queues import Payload
from cosim.channels.bluetooth.radio import FAR, GOOD, UNTUNED, Air, Fate, Frame
from cosim.machine import Address, Reception
from cosim.units import Time


class Traffic:
    """What is on the air of the piconet of *links*, whose master counts slots on *clock*.

    Hosts get payloads through the transport of *links*; if there is none, from whoever asked for them here.
    """

    def __init__(self, air: Air, clock: NativeClock, links: Links, frames: FrameLog) -> None:
        self.frames = frames
        self._air = air
        self._clock = clock
        self._links = links
        self._transport = links.transport

    def send(
        self,
        tick: int,
        kind: PacketType,
        duration: Time,
        source: Address,
        destination: Address,
        lt_addr: int,
        payload: Payload | None,
        asked: int,
    ) -> Frame:
        """Put a packet, with *payload* or empty, on the air at *tick*, now or soon; it answers one of the tick *asked*.

        With an adapted hop set a slave answers on the channel of the packet that it answers.
        """
        length = 0
        if payload is not None:
            length = len(payload.outgoing.payload)
            payload.tries += 1
            self.frames.payloads[payload.kind.name] += 1
        channel = self._air.channel(self._links.master, asked if self._links.piconet[USED] else tick)
        start = self._clock.time_of(tick)
        self._air.send(source, start, duration, channel)
        return Frame(start, duration, kind.name, source, destination, channel, lt_addr, length)

    def fate(self, frame: Frame, receiver: Address, carrier_dbm: float, payload: Payload | None, tuned: bool) -> Fate:
        """Return what becomes at *receiver* of a frame that ends now."""
        if not self._air.reaches(carrier_dbm):
            return FAR
        if not tuned:
            return UNTUNED
        if self._air.spares(frame.start):
            return GOOD
        if payload is None:
            return self._air.fate(frame, receiver, carrier_dbm, 0, False)
        return self._air.fate(frame, receiver, carrier_dbm, payload.kind.payload_bits(frame.length), payload.kind.coded)

    def assess(self, frame: Frame, well: bool) -> None:
        """Count whether the pair that ends with *frame* went well on its channel, if the hop set is adapted."""
        if self._links.piconet[USED]:
            self._air.band.tallies[self._links.master, 0 if well else 1, frame.channel] += 1

    def received(
        self, receiver: Address, payload: Payload, source: Address, carrier_dbm: float, broadcast: bool = False
    ) -> list[Arrival]:
        """Return what reaches the host at *receiver* at once: nothing, if *payload* has to wait for the line to it."""
        reception = Reception(source, broadcast, carrier_dbm if self._air.fades else None)
        arrival = (receiver, payload.outgoing.payload, reception)
        if self._transport is None:
            return [arrival]
        self._transport.take(arrival)
        return []

    def full_until(self, device: Address, peer: Address) -> Time:
        """Return until when *device* says STOP (FLOW = 0) to *peer*: 0 if it has room now."""
        return 0 if self._transport is None else self._transport.full_until(device, peer)
