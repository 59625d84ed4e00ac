"""What reaches the hosts of LE devices, all of one instant at once, and what is written of packets and payloads."""

from collections.abc import Callable, Iterable
from typing import Final

from cosim.channels.base import Arrival
from cosim.channels.ble.bits.crc import crc24
from cosim.channels.ble.ether import Judgement
from cosim.channels.ble.packets import Sent
from cosim.intervals import Intervals
from cosim.kernel import WAKE, Kernel
from cosim.machine import BROADCAST, Address, Fate, LinkEvent, Outcome, Outgoing
from cosim.payloads import Payloads
from cosim.trace import FRAMES, RECEPTIONS, TRANSMISSIONS, Trace

_UNSENT: Final = {Outcome.NO_LINK, Outcome.TOO_LONG, Outcome.QUEUE_FULL}


class Hosts:
    """The hosts' side of a channel: *deliver* takes what arrives and what happens at one instant.

    *unsent* takes (source, destination, length, why) of a payload that will never be on the air.
    """

    def __init__(
        self,
        kernel: Kernel,
        deliver: Callable[[Iterable[Arrival], Iterable[tuple[Address, LinkEvent]]], None],
        unsent: Callable[[Address, Address, int, Outcome], None],
        payloads: Payloads,
        intervals: Intervals,
    ) -> None:
        self.payloads = payloads
        self.intervals = intervals
        self._kernel = kernel
        self._deliver = deliver
        self._unsent = unsent
        self._arrivals: list[Arrival] = []
        self._events: list[tuple[Address, LinkEvent]] = []

    def arrive(self, arrival: Arrival) -> None:
        """Deliver a payload at this instant, with all else that arrives then."""
        self._come()
        self._arrivals.append(arrival)

    def report(self, address: Address, event: LinkEvent) -> None:
        """Report *event* at this instant, with all else that happens then."""
        self._come()
        self._events.append((address, event))

    def over(self, source: Address, outgoing: Outgoing, outcome: Outcome) -> None:
        """Note what became of a payload of *source*, and report it if that was asked for."""
        if outcome in _UNSENT:
            self._unsent(source, outgoing.destination, len(outgoing.payload), outcome)
        else:
            self.payloads.end(outgoing, self._kernel.now, outcome.value)
        if outgoing.token is not None:
            self.report(source, Fate(outgoing.token, outcome))

    def _come(self) -> None:
        if not self._arrivals and not self._events:
            self._kernel.at(self._kernel.now, self._pass_on, WAKE)

    def _pass_on(self) -> None:
        arrivals, events = self._arrivals, self._events
        self._arrivals, self._events = [], []
        self._deliver(arrivals, events)


class Record:
    """Writes packets into the tables of frames, as far as *trace* wants them."""

    def __init__(self, trace: Trace) -> None:
        self._trace = trace
        self._wanted = {table: trace.wants(table) for table in (FRAMES, TRANSMISSIONS, RECEPTIONS)}
        self.wanted = any(self._wanted.values())
        """True if any of them is kept."""

    def sent(self, packet: Sent, whole: bool) -> None:
        """Write *packet*, which is over; *whole*: its sender was on to its end."""
        if self._wanted[TRANSMISSIONS]:
            head, check = packet.access_address.to_bytes(4, "little"), crc24(packet.pdu, packet.crc_init)
            body = (head + packet.pdu + check).hex()
            of_frame = packet.end - packet.start, packet.centre_mhz - 2402, 0, packet.length
            told = 0, 0, packet.again, False, whole, body
            self._trace.put(
                TRANSMISSIONS, packet.start, packet.source, packet.kind, packet.destination, *told, *of_frame
            )

    def judged(self, packet: Sent, receiver: Address, judgement: Judgement) -> None:
        """Write what became of *packet*, which is over, at a *receiver* that it was meant for."""
        _, outcome, part, power_dbm, sinr_db = judgement
        if self._wanted[FRAMES]:
            to = packet.destination if packet.destination == BROADCAST else receiver
            of_frame = packet.end - packet.start, packet.kind, packet.centre_mhz - 2402, 0, packet.length
            self._trace.row(FRAMES, packet.start, packet.source, to, *of_frame, outcome, part)
        if self._wanted[RECEPTIONS]:
            self._trace.put(RECEPTIONS, packet.start, packet.source, receiver, power_dbm, sinr_db, outcome, part)
