"""Letters from one robot to one other: numbered parts, sent again until they are acknowledged, put together in order.

After QUIC (RFC 9002) and TCP (RFC 6298): acknowledgements are selective; a part is lost if three that were sent after
it have arrived, or if its time is over; the time is learnt from the answers and doubles with each time in vain. Letters
are given up after so long without any answer, the oldest first; what comes after them is not held up by it.
"""

from collections import deque
from dataclasses import dataclass
from typing import Final, NamedTuple

from cosim.errors import LocalProtocolError, WireError
from cosim.units import Time
from protocols.transport.frames import MOST_PARTS, SEQUENCE, WINDOW, Ack, Part

OVERTAKEN: Final = 3
"""A part is lost if so many that were sent after it have arrived (RFC 9002, 6.1.1)."""
PROBES: Final = 2
"""Parts on the way at a time to who does not answer."""
DOUBLINGS: Final = 16
"""The wait doubles no more often: it is limited long before."""
EVERY: Final = 4
"""Parts in order after which an acknowledgement waits no longer."""


class Pace(NamedTuple):
    """How long a sender waits, in ns."""

    first: Time
    """For the answer to the first part."""
    least: Time
    most: Time
    give_up: Time
    """Without any answer, until a letter is given up."""


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
class _Letter:
    number: int
    first: int
    """Number of its first part."""
    end: int
    """Number of the part behind its last."""
    silence: Time = 0
    """How long nothing was answered while it waited."""


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
    """Sent, and neither acknowledged nor lost."""
    in_device: bool = False
    """The own radio has not said yet what has become of it."""
    arrived: bool = False


class Outbound:
    """All that goes to one other robot."""

    def __init__(self, window: int, octets: int, pace: Pace) -> None:
        """Have up to *window* parts on the way, which carry so many *octets* each."""
        self._window = window
        self._octets = octets
        self._pace = pace
        self._trip = RoundTrip(pace)
        self._letters: deque[_Letter] = deque()
        self._parts: dict[int, _Copy] = {}
        """Those of all letters that are not through."""
        self._lost: set[int] = set()
        self._base = 0
        """The first that has not arrived."""
        self._fresh = 0
        """The first that was never sent."""
        self._end = 0
        """The first that is no part of any letter."""
        self._sent = 0
        self._flying = 0
        self._vain = 0
        """Times that were over since the last answer."""
        self._since: Time = 0
        """Since when an answer is waited for."""
        self._until: Time = 0
        """How long."""
        self._life: int | None = None
        """Of who has answered last."""
        self._former: dict[int, Time] = {}
        """Lives before that one, and how long their answers, which may be late, are not taken for those of a new."""

    # ------------------------------------------------------------ sending

    def post(self, number: int, payload: bytes, now: Time) -> None:
        """Queue a letter; raise LocalProtocolError if it is too long."""
        pieces = [payload[at : at + self._octets] for at in range(0, len(payload), self._octets)] or [b""]
        if len(pieces) > MOST_PARTS or self._end + len(pieces) >= SEQUENCE:
            raise LocalProtocolError(f"a letter of {len(payload)} bytes is too long")
        if not self._letters:
            self._arm(now)
        self._letters.append(_Letter(number, self._end, self._end + len(pieces)))
        for place, piece in enumerate(pieces):
            self._parts[self._end] = _Copy(place, len(pieces), piece)
            self._end += 1

    def due(self) -> int | None:
        """Return the number of the part that is to be sent next, if any may be sent now."""
        if self._flying >= (min(PROBES, self._window) if self._vain else self._window):
            return None
        if self._lost:
            return min(self._lost)
        fresh = self._fresh < min(self._end, self._base + self._window)
        return self._fresh if fresh else None

    def take(self, number: int, now: Time) -> tuple[bool, Part]:
        """Return a part that was due, as it is sent now, after whether it was sent before."""
        copy = self._parts[number]
        self._lost.discard(number)
        self._fresh = max(self._fresh, number + 1)
        copy.times += 1
        copy.at, copy.order, copy.flying, copy.in_device = now, self._sent, True, True
        self._sent += 1
        self._flying += 1
        return copy.times > 1, Part(number, self._letters[0].first, copy.place, copy.parts, copy.payload)

    def left_device(self, number: int, now: Time | None) -> None:
        """Note that a part waits in the own radio no more: its time counts from *now*, if that has sent it."""
        copy = self._parts.get(number)
        if copy is not None:
            copy.in_device = False
            copy.at = copy.at if now is None else now

    # ------------------------------------------------------------ answers

    def acknowledged(self, ack: Ack, life: int, now: Time) -> None:
        """Take an answer that who is in its *life* has given; raise WireError for one to what was never sent."""
        if ack.next + ack.beyond.bit_length() + (ack.beyond > 0) > self._fresh:
            raise WireError("an acknowledgement of what was never sent")
        if life != self._life and not self._begins(life, now):
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

    def _begins(self, life: int, now: Time) -> bool:
        """Return whether an answer given in another *life* than the last is one of a new life, and begin that.

        A life that has passed may still be heard of, by frames that were long under way. One that goes on answering
        has not passed: robots' clocks may be set back, and what was late may come first.
        """
        self._former = {each: until for each, until in self._former.items() if now < until}
        if self._life is not None:
            if life in self._former and life < self._life:
                return False
            self._former[self._life] = now + self._pace.give_up // 2
            self._begin_again()
        self._life = life
        return True

    def _begin_again(self) -> None:
        """Forget what has arrived: the other has been booted, and has forgotten it as well."""
        self._base = self._letters[0].first if self._letters else self._end
        for number in range(self._base, self._fresh):
            copy = self._parts[number]
            if copy.arrived:
                copy.arrived = False
                self._lost.add(number)

    def _note(self, arrived: list[int], now: Time) -> None:
        """Note parts that have arrived, and which are lost since those have overtaken them."""
        latest = max((self._parts[number] for number in arrived), key=lambda copy: copy.order)
        if latest.times == 1:  # else nobody knows which copy is answered (Karn)
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
        while self._letters and self._letters[0].end <= self._base:
            self._remove(self._letters.popleft())
        for letter in self._letters:
            letter.silence = 0
        self._vain = 0
        self._arm(now)

    def _lose(self, number: int) -> None:
        self._lands(number)
        self._lost.add(number)

    def _lands(self, number: int) -> None:
        copy = self._parts[number]
        self._flying -= copy.flying
        copy.flying = False

    def _remove(self, letter: _Letter) -> None:
        for number in range(letter.first, letter.end):
            self._lands(number)
            self._lost.discard(number)
            del self._parts[number]
        self._base = max(self._base, letter.end)
        self._fresh = max(self._fresh, letter.end)

    # ------------------------------------------------------------ waiting in vain

    @property
    def _wait(self) -> Time:
        return min(self._trip.patience << min(self._vain, DOUBLINGS), self._pace.most)

    @property
    def deadline(self) -> Time | None:
        """When it has waited long enough for an answer; None if it waits for none."""
        return self._until if self._letters else None

    def _arm(self, now: Time) -> None:
        self._since = now
        self._until = now + self._wait

    def hasten(self, now: Time) -> None:
        """Try again soon: who has not answered was heard."""
        if self._letters and self._vain > 1:
            self._until = min(self._until, now + self._trip.patience)

    def time_out(self, now: Time) -> list[int]:
        """Act on the deadline: send again what is overdue; return the numbers of letters that are given up."""
        patience = self._trip.patience
        waited = min(max(now - self._since, 0), self._wait)
        for letter in self._letters:
            letter.silence += waited
        self._vain += 1
        self._arm(now)
        numbers = range(self._base, self._fresh)
        flying = [number for number in numbers if self._parts[number].flying and not self._parts[number].in_device]
        for number in flying:
            if number == flying[0] or now - self._parts[number].at >= patience:  # one at least asks again
                self._lose(number)
        gone = []
        while self._letters and self._letters[0].silence >= self._pace.give_up:
            gone.append(self._letters[0].number)
            self._remove(self._letters.popleft())
        return gone

    def give_up(self) -> list[int]:
        """Forget all letters and return their numbers."""
        gone = [letter.number for letter in self._letters]
        for letter in self._letters:
            self._remove(letter)
        self._letters.clear()
        self._vain = 0
        return gone


class Inbound:
    """All that comes from one other robot in one of its lives."""

    def __init__(self, life: int, patience: Time) -> None:
        """Acknowledge parts of that *life* after *patience* at the latest."""
        self.life = life
        self.due: Time | None = None
        """When an acknowledgement is to be sent."""
        self._patience = patience
        self._next = 0
        """The first part that is missing."""
        self._begun: list[bytes] = []
        """The parts of a letter before that."""
        self._beyond: dict[int, Part] = {}
        self._owed = 0
        """Parts that were not acknowledged."""

    def take(self, part: Part, now: Time) -> list[bytes]:
        """Return the letters that *part* completes, in order.

        Who has just been booted gets parts far ahead, whose author learns from the answer what it has to send again.
        """
        if part.oldest > self._next:
            self._skip(part.oldest)
        ahead = part.number - self._next
        known = ahead < 0 or part.number in self._beyond
        if not known and ahead <= WINDOW:
            self._beyond[part.number] = part
        letters = self._complete()
        self._owed += 1
        at_once = known or ahead > WINDOW or bool(letters) or bool(self._beyond) or self._owed >= EVERY
        due = now if at_once else now + self._patience
        self.due = due if self.due is None else min(self.due, due)
        return letters

    def _skip(self, oldest: int) -> None:
        """Wait no more for what comes before the part *oldest*."""
        self._next = oldest
        self._begun.clear()
        self._beyond = {number: part for number, part in self._beyond.items() if number >= oldest}

    def _complete(self) -> list[bytes]:
        letters = []
        while (part := self._beyond.pop(self._next, None)) is not None:
            self._next += 1
            if part.place != len(self._begun):  # of no letter that was begun
                self._begun.clear()
                continue
            self._begun.append(part.payload)
            if len(self._begun) == part.parts:
                letters.append(b"".join(self._begun))
                self._begun.clear()
        return letters

    def acknowledge(self) -> Ack:
        """Return the acknowledgement that is due, as it is sent now."""
        self.due = None
        self._owed = 0
        return Ack(self.life, self._next, sum(1 << number - self._next - 1 for number in self._beyond))
