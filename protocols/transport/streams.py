"""Messages from one robot to one other: numbered parts, sent again until acknowledged, put together in order.

After QUIC (RFC 9002) and TCP (RFC 6298): acknowledgements are selective; a part is lost if three that were sent after
it have arrived, or if its time is over; the time is learnt from the answers and doubles with each time in vain. After
a time without any answer messages are given up, the oldest first; this does not hold up those after them.
"""

from collections import deque
from dataclasses import dataclass
from typing import Final, NamedTuple

from cosim.errors import LocalProtocolError, WireError
from cosim.units import Time
from protocols.transport.frames import MOST_PARTS, SEQUENCE, WINDOW, Ack, Part

OVERTAKEN: Final = 3
"""Number of parts sent after a lost one that have arrived when it counts as lost (RFC 9002, 6.1.1)."""
PROBES: Final = 2
"""Number of parts on the way at a time to a robot that does not answer."""
DOUBLINGS: Final = 16
"""Greatest number of doublings of the wait, which is limited long before."""
EVERY: Final = 4
"""Number of parts in order after which an acknowledgement is sent at once."""


class Pace(NamedTuple):
    """How long a sender waits, in ns."""

    first: Time
    """Wait for the answer to the first part."""
    least: Time
    most: Time
    give_up: Time
    """Time without any answer until a message is given up."""


class RoundTrip:
    """The time that an answer may take, as RFC 6298 (2.1 to 2.3) learns it."""

    def __init__(self, pace: Pace) -> None:
        self._pace = pace
        self._mean: Time | None = None
        self._spread: Time = 0

    def note(self, taken: Time) -> None:
        """Take the time of one answer to what was sent once."""
        if self._mean is None:
            self._mean, self._spread = taken, taken // 2
        else:
            self._spread += (abs(self._mean - taken) - self._spread) // 4
            self._mean += (taken - self._mean) // 8

    @property
    def patience(self) -> Time:
        """How long to wait for an answer."""
        if self._mean is None:
            return self._pace.first
        return min(max(self._mean + 4 * self._spread, self._pace.least), self._pace.most)


@dataclass(slots=True)
class _Message:
    number: int
    first: int
    """Number of its first part."""
    end: int
    """Number of the part behind its last."""
    silence: Time = 0
    """How long no answer came while it waited."""


@dataclass(slots=True)
class _Copy:
    """What is known of a part."""

    place: int
    parts: int
    payload: bytes
    times: int = 0
    """How often it was sent."""
    at: Time = 0
    """When it was sent last."""
    order: int = 0
    """How many parts had been sent before it."""
    flying: bool = False
    """True if it was sent, and is neither acknowledged nor lost."""
    in_device: bool = False
    """True if the own radio has not reported yet what has become of it."""
    arrived: bool = False


class Outbound:
    """The messages to one other robot."""

    def __init__(self, window: int, octets: int, pace: Pace) -> None:
        """Have up to *window* parts on the way, which carry so many *octets* each."""
        self._window = window
        self._octets = octets
        self._pace = pace
        self._trip = RoundTrip(pace)
        self._messages: deque[_Message] = deque()
        self._parts: dict[int, _Copy] = {}
        """The parts of all messages that are not finished, by number."""
        self._lost: set[int] = set()
        self._base = 0
        """Number of the first part that has not arrived."""
        self._fresh = 0
        """Number of the first part that was never sent."""
        self._end = 0
        """Number of the next new part."""
        self._sent = 0
        self._flying = 0
        self.vain = 0
        """Number of times the wait was over since the last answer."""
        self._since: Time = 0
        """Begin of the wait for an answer."""
        self._until: Time = 0
        """End of that wait."""
        self._incarnation: int | None = None
        """Incarnation of the other that has answered last."""
        self._former: dict[int, Time] = {}
        """Incarnations before that one, and until when their late answers are not taken for those of a new one."""

    # ------------------------------------------------------------ sending

    def enqueue(self, number: int, payload: bytes, now: Time) -> None:
        """Queue a message; raise LocalProtocolError if it is too long."""
        pieces = [payload[at : at + self._octets] for at in range(0, len(payload), self._octets)] or [b""]
        if len(pieces) > MOST_PARTS or self._end + len(pieces) >= SEQUENCE:
            raise LocalProtocolError(f"a message of {len(payload)} bytes is too long")
        if not self._messages:
            self._arm(now)
        self._messages.append(_Message(number, self._end, self._end + len(pieces)))
        for place, piece in enumerate(pieces):
            self._parts[self._end] = _Copy(place, len(pieces), piece)
            self._end += 1

    def due(self) -> int | None:
        """Return the number of the part that is to be sent next, if any may be sent now."""
        if self._flying >= (min(PROBES, self._window) if self.vain else self._window):
            return None
        if self._lost:
            return min(self._lost)
        fresh = self._fresh < min(self._end, self._base + self._window)
        return self._fresh if fresh else None

    def take(self, number: int, now: Time) -> tuple[bool, Part]:
        """Return whether a part that is due was sent before, and the part as it is sent now."""
        copy = self._parts[number]
        self._lost.discard(number)
        self._fresh = max(self._fresh, number + 1)
        copy.times += 1
        copy.at, copy.order, copy.flying, copy.in_device = now, self._sent, True, True
        self._sent += 1
        self._flying += 1
        return copy.times > 1, Part(number, self._messages[0].first, copy.place, copy.parts, copy.payload)

    def left_device(self, number: int, now: Time | None) -> None:
        """Note that a part has left the own radio: its time counts from *now*, or None if it may not have been sent."""
        copy = self._parts.get(number)
        if copy is not None:
            copy.in_device = False
            copy.at = copy.at if now is None else now

    # ------------------------------------------------------------ answers

    def acknowledged(self, ack: Ack, incarnation: int, now: Time) -> None:
        """Take an answer of the other's *incarnation*; raise WireError for one to what was never sent."""
        if ack.next + ack.beyond.bit_length() + (ack.beyond > 0) > self._fresh:
            raise WireError("an acknowledgement of what was never sent")
        if incarnation != self._incarnation and not self._begins(incarnation, now):
            return
        numbers = range(self._base, min(self._fresh, ack.next + 1 + WINDOW))
        arrived = [
            number
            for number in numbers
            if (number < ack.next or (number > ack.next and ack.beyond >> (number - ack.next - 1) & 1))
            and not self._parts[number].arrived
        ]
        if arrived:
            self._note(arrived, now)

    def _begins(self, incarnation: int, now: Time) -> bool:
        """Return whether an answer given in another *incarnation* than the last is one of a new one, and begin that."""
        # Frames that were long under way may still come of an incarnation that is over. One that goes on answering is
        # not over: robots' clocks may be set back, and what was late may come first.
        self._former = {each: until for each, until in self._former.items() if now < until}
        if self._incarnation is not None:
            if incarnation in self._former and incarnation < self._incarnation:
                return False
            self._former[self._incarnation] = now + self._pace.give_up // 2
            self._begin_again()
        self._incarnation = incarnation
        return True

    def _begin_again(self) -> None:
        """Forget what has arrived, as the other has since it was booted again."""
        self._base = self._messages[0].first if self._messages else self._end
        for number in range(self._base, self._fresh):
            copy = self._parts[number]
            if copy.arrived:
                copy.arrived = False
                self._lost.add(number)

    def _note(self, arrived: list[int], now: Time) -> None:
        """Note parts that have arrived, and as lost those that they have overtaken."""
        latest = max((self._parts[number] for number in arrived), key=lambda copy: copy.order)
        if latest.times == 1:  # else it is unknown which copy is answered (Karn)
            self._trip.note(now - latest.at)
        for number in arrived:
            self._parts[number].arrived = True
            self._lands(number)
            self._lost.discard(number)
        for number in range(self._base, self._fresh):
            copy = self._parts[number]
            if copy.flying and not copy.in_device and copy.order <= latest.order - OVERTAKEN:
                self._lose(number)
        while self._base < self._fresh and self._parts[self._base].arrived:
            self._base += 1
        while self._messages and self._messages[0].end <= self._base:
            self._remove(self._messages.popleft())
        for message in self._messages:
            message.silence = 0
        self.vain = 0
        self._arm(now)

    def _lose(self, number: int) -> None:
        self._lands(number)
        self._lost.add(number)

    def _lands(self, number: int) -> None:
        copy = self._parts[number]
        self._flying -= copy.flying
        copy.flying = False

    def _remove(self, message: _Message) -> None:
        for number in range(message.first, message.end):
            self._lands(number)
            self._lost.discard(number)
            del self._parts[number]
        self._base = max(self._base, message.end)
        self._fresh = max(self._fresh, message.end)

    # ------------------------------------------------------------ waiting in vain

    @property
    def _wait(self) -> Time:
        return min(self._trip.patience << min(self.vain, DOUBLINGS), self._pace.most)

    @property
    def deadline(self) -> Time | None:
        """End of the wait for an answer; None if it waits for none."""
        return self._until if self._messages else None

    def _arm(self, now: Time) -> None:
        self._since = now
        self._until = now + self._wait

    def hasten(self, now: Time) -> None:
        """Try again soon, as the other was heard."""
        if self._messages and self.vain > 1:
            self._until = min(self._until, now + self._trip.patience)

    def time_out(self, now: Time) -> list[int]:
        """Act on the deadline: mark as lost what is overdue; return the numbers of messages that are given up."""
        patience = self._trip.patience
        waited = min(max(now - self._since, 0), self._wait)
        for message in self._messages:
            message.silence += waited
        self.vain += 1
        self._arm(now)
        numbers = range(self._base, self._fresh)
        flying = [number for number in numbers if self._parts[number].flying and not self._parts[number].in_device]
        for number in flying:
            if number == flying[0] or now - self._parts[number].at >= patience:  # at least one is sent again
                self._lose(number)
        gone = []
        while self._messages and self._messages[0].silence >= self._pace.give_up:
            gone.append(self._messages[0].number)
            self._remove(self._messages.popleft())
        return gone

    def give_up(self) -> list[int]:
        """Forget all messages and return their numbers."""
        gone = [message.number for message in self._messages]
        for message in self._messages:
            self._remove(message)
        self._messages.clear()
        self.vain = 0
        return gone


class Inbound:
    """The messages from one other robot in one of its incarnations."""

    def __init__(self, incarnation: int, patience: Time) -> None:
        """Acknowledge parts of that *incarnation* after *patience* at the latest."""
        self.incarnation = incarnation
        self.due: Time | None = None
        """When an acknowledgement is due; None if none is."""
        self._patience = patience
        self._next = 0
        """Number of the first part that is missing."""
        self._begun: list[bytes] = []
        """The parts before that of a message that is not complete."""
        self._beyond: dict[int, Part] = {}
        self._owed = 0
        """Number of parts that were not acknowledged."""

    def take(self, part: Part, now: Time) -> list[bytes]:
        """Return the messages that *part* completes, in order."""
        # A robot that was just booted gets parts far ahead; their author learns from the answer what to send again.
        if part.oldest > self._next:
            self._skip(part.oldest)
        ahead = part.number - self._next
        known = ahead < 0 or part.number in self._beyond
        if not known and ahead <= WINDOW:
            self._beyond[part.number] = part
        messages = self._complete()
        self._owed += 1
        at_once = known or ahead > WINDOW or bool(messages) or bool(self._beyond) or self._owed >= EVERY
        due = now if at_once else now + self._patience
        self.due = due if self.due is None else min(self.due, due)
        return messages

    def _skip(self, oldest: int) -> None:
        """Wait no longer for parts before *oldest*."""
        self._next = oldest
        self._begun.clear()
        self._beyond = {number: part for number, part in self._beyond.items() if number >= oldest}

    def _complete(self) -> list[bytes]:
        messages = []
        while (part := self._beyond.pop(self._next, None)) is not None:
            self._next += 1
            if part.place != len(self._begun):  # of no message that was begun
                self._begun.clear()
                continue
            self._begun.append(part.payload)
            if len(self._begun) == part.parts:
                messages.append(b"".join(self._begun))
                self._begun.clear()
        return messages

    def acknowledge(self) -> Ack:
        """Return the acknowledgement that is due, as it is sent now."""
        self.due = None
        self._owed = 0
        return Ack(self.incarnation, self._next, sum(1 << number - self._next - 1 for number in self._beyond))
