"""The distributed coordination function of one station: when it may send, and how it answers what it hears.

IEEE 802.11-1999, clause 9.2. Slots of a back-off are computed, never scheduled: a station that counts down knows the
instant at which it will send if the medium stays idle, and what a busy medium leaves of the counter is arithmetic.

Readings, where the standard leaves something open:

- energy is sensed only after the time of the clear channel assessment, a part of a slot: a station that is due in the
  slot in which another begins sends too, and the frames collide;
- a payload that comes while the medium is idle, but not yet for an interframe space, waits for that without a back-off;
- a back-off is drawn after every frame of the own queue, and runs down whether or not there is a next one;
- slots count from the end of the interframe space, or from when the back-off was drawn, whichever is later; if it was
  drawn because no response came, from DIFS after that (as 802.11e says of its slot boundaries, and ns-3 does);
- a response is waited for until a receiver would know of its preamble, and if it then receives, until the end of that;
- EIFS stands in for DIFS from a frame that was received with errors until one is received without.

With ``bianchi_counting`` a busy period takes a slot from every counter, and a failure is followed by no DIFS of its
own; with an EIFS that is DIFS, and a time-out that is shorter, these are the conventions of Bianchi's model (IEEE JSAC
18(3), 2000), not of the standard.
"""

from collections import deque
from functools import partial
from typing import Final, Protocol

from cosim.channels.adhoc.mac import ACK, CTS, DATA, RTS, Access, Form, Frame, Kind, Packet, Timing, data, request
from cosim.channels.adhoc.reception import Receiver
from cosim.kernel import AIR, Handle, Kernel
from cosim.machine import BROADCAST, Address
from cosim.randomness import Draws
from cosim.units import Time

BACKOFF: Final = 1
"""Purpose of the draws of back-offs."""


class Air(Protocol):
    """The medium that a station sends on."""

    def begin(self, frame: Frame) -> None:
        """Carry *frame*, which begins now."""

    def cut(self, frame: Frame) -> None:
        """Let no station receive *frame*, which is on the air: its sender is off."""


class Host(Protocol):
    """The host of a station."""

    def received(self, address: Address, frame: Frame) -> None:
        """Take a DATA frame for *address*, at its end; each only once."""

    def done(self, address: Address, packet: Packet, acknowledged: bool) -> None:
        """Note that *packet* is off the queue: acknowledged (or broadcast), or tried as often as allowed."""


class Backoff:
    """The back-off of one station: idle slots to wait for, from a window that failures double (9.2.4, 9.2.5.2)."""

    def __init__(self, address: Address, access: Access, slot: Time, draws: Draws) -> None:
        self.pending = False
        """True if there is a back-off to be done."""
        self._address = address
        self._access = access
        self._slot = slot
        self._draws = draws
        self._drawn = 0
        self._window = access.cw_min
        self._slots = 0
        self._not_before: Time = 0
        self._counted_from: Time = 0

    def draw(self, not_before: Time) -> None:
        """Draw a new back-off, whose slots count from *not_before* at the earliest."""
        self._slots = self._draws.below(self._window + 1, self._drawn, self._address, BACKOFF)
        self._drawn += 1
        self._not_before = not_before
        self.pending = True

    def ends_at(self, idle: Time) -> Time:
        """Go on counting from *idle*, the end of the interframe space; return when it ends if the medium stays idle."""
        self._counted_from = max(idle, self._not_before)
        return self._counted_from + self._slots * self._slot

    def interrupt(self, sensed_at: Time) -> None:
        """Take off the slots that have ended before *sensed_at*, at which the medium is known to be busy."""
        over = sensed_at - self._counted_from
        if over > 0:
            self._slots -= -(-over // self._slot) - 1
            if self._access.bianchi_counting:
                self._slots = max(self._slots - 1, 0)

    def widen(self) -> None:
        """Double the window, up to its greatest value."""
        self._window = min(2 * self._window + 1, self._access.cw_max)

    def narrow(self) -> None:
        """Reset the window to its smallest value."""
        self._window = self._access.cw_min


class Station:
    """One station: its queue, its back-off, its exchange, and what arrives at it."""

    def __init__(
        self,
        address: Address,
        timing: Timing,
        access: Access,
        receiver: Receiver,
        kernel: Kernel,
        air: Air,
        host: Host,
        draws: Draws,
    ) -> None:
        self.address = address
        self.queue: deque[Packet] = deque()
        self._timing = timing
        self._access = access
        self._kernel = kernel
        self._air = air
        self._host = host
        self._backoff = Backoff(address, access, timing.slot, draws)
        self._receiver = receiver
        self._ends: Handle | None = None
        """End of the back-off, or of the interframe space before a frame without one, if the medium stays idle."""
        self._idle_from: Time = kernel.now
        self._reserved_until: Time = 0
        """The network allocation vector."""
        self._erred = False
        """True if EIFS is due in place of DIFS."""
        self._sending: Frame | None = None
        self._acts: list[Handle] = []
        """Events that are certain: the end of what it sends, or an answer after SIFS."""
        self._exchanging = False
        """True while the first of the queue is on its way, from its first frame to its end or failure."""
        self._awaits: Kind | None = None
        self._timeout: Handle | None = None
        self._numbers = 0
        self._heard: dict[Address, int] = {}
        """Last sequence number of each sender."""

    # ------------------------------------------------------------ the queue

    def send(self, packet: Packet) -> None:
        """Queue *packet*, and send it as soon as what is before it is done and the medium allows."""
        packet.number = self._numbers
        self._numbers += 1
        self.queue.append(packet)
        if len(self.queue) == 1:  # frames that end or begin at this instant come first
            self._kernel.at(self._kernel.now, self._contend, AIR)

    def power(self, on: bool) -> None:
        """Switch the station on or off; what it holds is lost, and what it is just sending is spoilt."""
        if on:
            self._idle_from = self._kernel.now
            return
        for handle in (self._ends, self._timeout, *self._acts):
            if handle is not None:
                handle.cancel()
        self.queue.clear()
        self._heard.clear()
        self._ends = self._timeout = self._awaits = None
        self._exchanging = self._erred = self._backoff.pending = False
        self._backoff.narrow()
        self._receiver.drop()
        self._reserved_until = self._kernel.now
        if self._sending is not None:
            self._air.cut(self._sending)
            self._sending = None

    @property
    def at_rest(self) -> bool:
        """True if it has nothing to send: no payload, no answer, and no back-off to be done."""
        answers = any(act.time >= self._kernel.now for act in self._acts)
        return not (self.queue or self._backoff.pending or answers)

    def _finish(self, acknowledged: bool, after: Time = 0) -> None:
        packet = self.queue.popleft()
        self._backoff.narrow()
        self._end_exchange(after)
        self._host.done(self.address, packet, acknowledged)

    def _fail(self) -> None:
        """Try the first of the queue again after a longer back-off, or drop it."""
        packet, access = self.queue[0], self._access
        after = 0 if access.bianchi_counting else self._timing.difs
        if self._awaits == ACK and access.asks(packet):
            packet.long += 1
        else:
            packet.short += 1
        self._awaits = None
        if access.gives_up(packet):
            self._finish(False, after)
            return
        self._backoff.widen()
        self._end_exchange(after)

    def _end_exchange(self, after: Time = 0) -> None:
        self._exchanging = False
        self._backoff.draw(self._kernel.now + after)
        self._contend()

    # ------------------------------------------------------------ access to the medium

    def _contend(self) -> None:
        """Schedule the instant at which to send, or at which the back-off ends, if the medium stays idle."""
        backoff = self._backoff
        if self._exchanging or self._ends is not None or not (backoff.pending or self.queue):
            return
        now = self._kernel.now
        space = self._timing.eifs if self._erred else self._timing.difs
        idle_for_good = max(self._idle_from, self._reserved_until) + space
        if not backoff.pending:
            due = max(now, idle_for_good)
            sensed = self._receiver.energy and self._receiver.energy_from + self._timing.cca <= due
            if self._sending is None and self._reserved_until <= now and not sensed:
                self._ends = self._kernel.at(due, self._may_send, AIR)
                return
            backoff.draw(now)
        if self._sending is None and not self._receiver.energy:
            self._ends = self._kernel.at(backoff.ends_at(idle_for_good), self._may_send, AIR)

    def _may_send(self) -> None:
        self._ends = None
        self._backoff.pending = False
        if not self.queue:
            return
        packet = self.queue[0]
        self._exchanging = True
        if self._access.asks(packet):
            self._transmit(request(self.address, packet, self._timing))
        else:
            self._transmit_data()

    def _defer(self, sensed_at: Time) -> None:
        """Stop counting while the medium is busy, known from *sensed_at* on; a station that is due before sends."""
        ends = self._ends
        if ends is None or ends.time < sensed_at:
            return
        ends.cancel()
        self._ends = None
        if self._backoff.pending:
            self._backoff.interrupt(sensed_at)
        else:
            self._backoff.draw(self._kernel.now)

    # ------------------------------------------------------------ sending

    def _transmit_data(self) -> None:
        self._transmit(data(self.address, self.queue[0], self._timing))

    def _transmit(self, frame: Frame) -> None:
        now = self._kernel.now
        if self._sending is not None:
            return
        self._defer(now)
        self._receiver.drop()
        self._sending = frame._replace(begin=now)
        self._acts = [self._kernel.at(now + frame.form.duration, self._sent)]
        self._air.begin(self._sending)

    def _sent(self) -> None:
        frame, self._sending = self._sending, None
        assert frame is not None
        if not self._receiver.energy:
            self._idle_from = self._kernel.now
        if frame.kind == RTS or (frame.kind == DATA and frame.destination != BROADCAST):
            self._awaits = CTS if frame.kind == RTS else ACK
            self._timeout = self._kernel.after(self._timing.timeout, self._give_up, AIR)
        elif frame.kind == DATA:
            self._finish(True)
        else:
            self._contend()

    def _give_up(self) -> None:
        """Fail as no response has come, unless a frame is being received, which may be one."""
        self._timeout = None
        if not self._receiver.follows:
            self._fail()

    # ------------------------------------------------------------ receiving

    def energy_begins(self, frame: Frame, power_mw: float) -> None:
        """Note that a frame begins to arrive."""
        now, sending = self._kernel.now, self._sending is not None
        if self._receiver.begins(frame, power_mw, sending, now) and not sending:
            self._defer(now + self._timing.cca)

    def energy_ends(self, frame: Frame, whole: bool) -> bool:
        """Note that a frame has arrived to its end, *whole* unless cut off; return whether it was received."""
        was_busy = self._receiver.energy
        received = self._receiver.ends(frame, whole, self._kernel.now)
        idle = was_busy and not self._receiver.energy and self._sending is None
        if idle:
            self._idle_from = self._kernel.now
        if received is not None:
            self._erred = not received
            answered = received and self._take(frame)
            if self._awaits is not None and self._timeout is None and not answered:
                self._fail()
        if idle:
            self._contend()
        return bool(received)

    def jammed(self, power_mw: float, at: Time) -> None:
        """Receive *power_mw* of jammers from *at* on, which is in the past only for a station at rest."""
        if not self._receiver.disturb(power_mw, at) or self._sending is not None:
            return
        if self._receiver.energy:
            self._defer(at + self._timing.cca)
        else:
            self._idle_from = max(self._idle_from, at)
            self._contend()

    def _take(self, frame: Frame) -> bool:
        """Act on a frame that has been received; return whether it is the response that was awaited."""
        if frame.destination == BROADCAST:
            self._host.received(self.address, frame)
        elif frame.destination != self.address:
            self._reserved_until = max(self._reserved_until, self._kernel.now + frame.reserves)
        elif frame.kind == DATA:
            self._respond(ACK, frame, self._timing.ack, 0)
            if self._heard.get(frame.source) != frame.number:
                self._heard[frame.source] = frame.number
                self._host.received(self.address, frame)
        elif frame.kind == RTS:
            if self._reserved_until <= self._kernel.now:
                rest = frame.reserves - self._timing.sifs - self._timing.cts.duration
                self._respond(CTS, frame, self._timing.cts, rest)
        elif frame.kind == self._awaits and self.queue[0].destination == frame.source:
            self._go_on()
            return True
        return False

    def _respond(self, kind: Kind, frame: Frame, form: Form, reserves: Time) -> None:
        answer = Frame(kind, self.address, frame.source, form, reserves, frame.number)
        self._acts = [self._kernel.after(self._timing.sifs, partial(self._transmit, answer), AIR)]

    def _go_on(self) -> None:
        """Go on with the exchange: the awaited response has come."""
        if self._timeout is not None:
            self._timeout.cancel()
            self._timeout = None
        response, self._awaits = self._awaits, None
        if response == ACK:
            self._finish(True)
        else:
            self.queue[0].short = 0
            self._acts = [self._kernel.after(self._timing.sifs, self._transmit_data, AIR)]
