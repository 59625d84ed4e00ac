"""A slow model of the IEEE 802.11 DCF that looks at every station at every step, for the comparison frame for frame.

Sources: IEEE 802.11-1999, clause 9.2 (EIFS 9.2.3.4, back-off 9.2.4 and 9.2.5.2, retry counters 9.2.5.3, RTS/CTS and NAV
9.2.5.4 and 9.2.5.6, ACK 9.2.8, duplicates 9.2.9); G. Bianchi, IEEE JSAC 18(3), 2000, for *bianchi_counting*. All times
are integer nanoseconds and multiples of the step, by default 1 us. At each instant, in this order: frames that end are
judged; frames that begin to arrive are noted; frames from above are queued; timers and counters of each station are
looked at, in order of their numbers; what is due is transmitted. There is no propagation law and no capture.

Readings, where the standard or the readings of the channel leave a choice:

1. A station that has heard and sent nothing takes the medium as idle from instant 0: nobody transmits before DIFS.
2. Sensed busy at t: it transmits, or some arrival has begun at or before t - cca and not ended, or t < NAV. DIFS and
   EIFS are counted from the last end of an arrival or own transmission, or from the NAV's end, if later.
3. A frame from above that finds the medium idle and no back-off pending goes out once DIFS or EIFS is over; if the
   medium is sensed busy at once or before that, also by an own ACK or CTS, a back-off is drawn.
4. A back-off that is pending, be it after a frame's success, is never drawn anew; it ends unused with an empty queue.
5. EIFS holds from an erroneous reception to the next correct one of any frame. Energy that was never locked onto is no
   reception, nor is a lock that an own transmission has broken.
6. A station that is locked when its wait for CTS or ACK runs out waits for the end of this lock. What it receives and
   did not wait for ends no wait, but is answered. No slot begins before DIFS after a time-out (802.11e and ns-3).
7. Two retry counters per frame: the short one of RTS and of DATA up to the threshold, put back by a CTS; the long one
   of DATA after RTS. At the limit CW goes back to its minimum before the one back-off of this failure is drawn.
8. Durations hold no propagation delay; a NAV is never taken back. An RTS is answered if the NAV is over when it ends.
9. Bianchi's counting: each busy period that begins after the IFS takes one off the counter; DIFS is used always; the
   wait for CTS or ACK is SIFS + 2 delta + 1 us (below DIFS), and no DIFS follows a time-out.

What a station is doing is looked at when all this is done; as long as that stays the same it is one interval.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

from tests.oracles.philox import philox

US = 1_000
BROADCAST, BACKOFF = -1, 1
DATA, ACK, RTS, CTS = "DATA", "ACK", "RTS", "CTS"
RECEIVED, SPOILT, NOT_HEARD = "received", "spoilt", "not heard"
BUSY, NAV = "busy", "nav"


class Timing(NamedTuple):
    """Times of a PHY in ns (*data*, *broadcast*: by octets of body), windows in slots; *slow_ack*: at lowest rate."""

    slot: int
    sifs: int
    difs: int
    cca: int
    preamble: int
    delta: int
    cw_min: int
    cw_max: int
    data: Callable[[int], int]
    broadcast: Callable[[int], int]
    ack: int
    rts: int
    cts: int
    slow_ack: int


class Options(NamedTuple):
    """What a run may vary; a limit of None: never give up; a threshold of None: no RTS."""

    bianchi_counting: bool = False
    rts_threshold: int | None = None
    short_limit: int | None = 7
    long_limit: int | None = 4


class Arrival(NamedTuple):
    """A frame that comes from above at *station*, with a body of *octets*, to *destination* or BROADCAST."""

    time_ns: int
    station: int
    destination: int
    octets: int


class Frame(NamedTuple):
    """A frame on the air at its sender; *number*: of the DATA that it belongs to, counted per sender from 0."""

    begin_ns: int
    end_ns: int
    source: int
    destination: int
    kind: str
    number: int


class Fate(NamedTuple):
    """What became of an arrival: first received by its addressee, sender done (ACK, or broadcast's end), dropped."""

    delivered_ns: int | None = None
    done_ns: int | None = None
    dropped_ns: int | None = None


class Interval(NamedTuple):
    """What a station was doing, and how long: *state* BUSY, NAV, or as in the table; of a back-off also the slots.

    Those left at its beginning, those drawn, and the window.
    """

    begin_ns: int
    station: int
    end_ns: int
    state: str
    slots: tuple[int, ...] = ()


class Result(NamedTuple):
    """Frames in order of begin and sender, what each station in range made of each ended one, fate of each arrival."""

    frames: list[Frame]
    outcomes: dict[tuple[Frame, int], str]
    fates: list[Fate]
    intervals: list[Interval]


class Rules(NamedTuple):
    """What all stations of a run share."""

    timing: Timing
    arrivals: Sequence[Arrival]
    options: Options
    key: tuple[int, int]
    fates: list[Fate]

    def has_rts(self, number: int) -> bool:
        threshold, arrival = self.options.rts_threshold, self.arrivals[number]
        return threshold is not None and arrival.destination != BROADCAST and arrival.octets > threshold

    def air_time(self, kind: str, number: int) -> int:
        """Return the time on the air of a frame of *kind* that belongs to arrival *number*."""
        if kind == DATA:
            _, _, destination, octets = self.arrivals[number]
            return (self.timing.broadcast if destination == BROADCAST else self.timing.data)(octets)
        return {ACK: self.timing.ack, RTS: self.timing.rts, CTS: self.timing.cts}[kind]

    def duration_field(self, frame: Frame) -> int:
        """Return for how long after its end *frame*, no broadcast, reserves the medium."""
        rest = {ACK: [], DATA: [ACK], CTS: [DATA, ACK], RTS: [CTS, DATA, ACK]}[frame.kind]
        return sum(self.timing.sifs + self.air_time(kind, frame.number) for kind in rest)


class Station:
    """One station with the variables of the standard; ``None`` stands for: not now."""

    def __init__(self, name: int, rules: Rules) -> None:
        self.name, self.rules = name, rules
        self.queue: list[int] = []
        self.cw = rules.timing.cw_min
        self.short_retries = self.long_retries = 0
        self.counter: int | None = None  # the pending back-off, in slots that are still to pass
        self.slot_begin: int | None = None  # of the present slot of it; None while the medium is busy, and in the IFS
        self.no_slot_before = 0  # DIFS after a time-out
        self.draws = self.nav = 0
        self.last_end = 0  # of an arrival or of an own transmission
        self.after_error = False  # whether the last reception was in error: EIFS instead of DIFS
        self.sending: Frame | None = None
        self.arriving: list[Frame] = []
        self.noise_from = 0  # when the first of these, or of those that they have overlapped, began to arrive
        self.lock: Frame | None = None
        self.lock_hit = self.lock_deafened = False  # whether another frame, or an own one, fell into the lock
        self.in_exchange = False  # from the transmission of RTS or DATA to its success or failure
        self.waits_for: str | None = None  # CTS or ACK, from the end of the own transmission on
        self.deadline: int | None = None
        self.last_lock: Frame | None = None  # held at the deadline: its end is waited for
        self.answer: tuple[int, int, str, int] | None = None  # what a reception calls for: when, to whom, kind, number
        self.access = False  # whether the first frame of the queue may be transmitted now
        self.drawn: tuple[int, int] | None = None  # the slots of the last back-off, and the window that they are from
        self.doing: dict[str, Interval] = {}  # the intervals that are not over

    def busy(self, now: int) -> bool:
        """Return whether the medium is sensed busy, physically or virtually."""
        if self.sending is not None or now < self.nav:
            return True
        late = self.rules.timing.delta + self.rules.timing.cca
        return bool(self.arriving) and min(frame.begin_ns for frame in self.arriving) + late <= now

    def ifs_is_over(self, now: int) -> bool:
        timing = self.rules.timing
        extended = self.after_error and not self.rules.options.bianchi_counting
        ifs = timing.difs + (timing.sifs + timing.slow_ack if extended else 0)
        return now >= max(self.last_end, self.nav) + ifs

    def draw(self) -> None:
        """Draw a back-off, uniform in 0..CW."""
        words = philox((self.draws, 0, self.name, BACKOFF), self.rules.key)
        self.counter = ((words[0] << 32 | words[1]) * (self.cw + 1)) >> 64
        self.drawn = self.counter, self.cw
        self.slot_begin = None
        self.draws += 1

    def own_end(self, now: int, frame: Frame) -> None:
        """Take in the end of an own transmission."""
        self.sending, self.last_end = None, now
        if frame.destination == BROADCAST:
            self.leave(done_ns=now)
        elif frame.kind in (RTS, DATA):
            timing = self.rules.timing
            self.waits_for = CTS if frame.kind == RTS else ACK
            self.deadline = now + timing.sifs + 2 * timing.delta
            self.deadline += US if self.rules.options.bianchi_counting else timing.slot + timing.preamble

    def arrival_end(self, now: int, frame: Frame) -> str:
        """Take in the end of an arrival and return what it was to the station."""
        self.arriving.remove(frame)
        self.last_end = now
        if frame != self.lock:
            return NOT_HEARD
        self.lock = None
        if not self.lock_deafened:
            self.after_error = self.lock_hit
        if self.lock_deafened or self.lock_hit:
            return SPOILT
        if frame.destination == self.name:
            self.receive(now, frame)
        elif frame.destination != BROADCAST:
            self.nav = max(self.nav, now + self.rules.duration_field(frame))
        return RECEIVED

    def receive(self, now: int, frame: Frame) -> None:
        """Take in a correct frame that is addressed to the station."""
        then = now + self.rules.timing.sifs
        if frame.kind == DATA:
            self.answer = (then, frame.source, ACK, frame.number)
            fate = self.rules.fates[frame.number]
            if fate.delivered_ns is None:  # else a duplicate
                self.rules.fates[frame.number] = fate._replace(delivered_ns=now)
        elif frame.kind == RTS and now >= self.nav:
            self.answer = (then, frame.source, CTS, frame.number)
        elif frame.kind == CTS and self.waits_for == CTS:
            self.short_retries = 0
            self.waits_for = self.deadline = self.last_lock = None
            self.answer = (then, frame.source, DATA, frame.number)
        elif frame.kind == ACK and self.waits_for == ACK:
            self.leave(done_ns=now)

    def leave(self, **fate: int) -> None:
        """End the exchange and draw a back-off; the frame is done with if it has a *fate*, else it will be retried."""
        if fate:
            number = self.queue.pop(0)
            self.rules.fates[number] = self.rules.fates[number]._replace(**fate)
            self.cw = self.rules.timing.cw_min
            self.short_retries = self.long_retries = 0
        self.waits_for = self.deadline = self.last_lock = None
        self.in_exchange = False
        self.draw()

    def arrival_begin(self, frame: Frame) -> None:
        """Note that *frame* begins to arrive; of several at one instant the lower sender's number comes first."""
        if self.lock is not None:
            self.lock_hit = True
        elif self.sending is None and not self.arriving:
            self.lock, self.lock_hit, self.lock_deafened = frame, False, False
        if not self.arriving:
            self.noise_from = frame.begin_ns + self.rules.timing.delta
        self.arriving.append(frame)

    def look(self, now: int) -> None:
        """Look at the wait for an answer, at the back-off, and at the queue."""
        if self.deadline is not None and now >= self.deadline:
            if now == self.deadline:
                self.last_lock = None if self.lock_deafened else self.lock
            if self.last_lock is None or self.lock != self.last_lock:
                self.fail(now)
        if self.counter is not None:
            self.count(now, self.busy(now))
        elif self.queue and not self.in_exchange:
            if self.busy(now):
                self.draw()
            elif self.ifs_is_over(now):
                self.access = True

    def count(self, now: int, busy: bool) -> None:
        """Count the back-off down."""
        assert self.counter is not None
        if busy:
            if self.rules.options.bianchi_counting and self.slot_begin is not None:
                self.counter = max(0, self.counter - 1)
            self.slot_begin = None
        elif self.slot_begin is None and self.ifs_is_over(now) and now >= self.no_slot_before:
            self.slot_begin = now
        elif self.slot_begin is not None and now == self.slot_begin + self.rules.timing.slot:
            self.counter -= 1
            self.slot_begin = now
        if self.counter == 0 and self.slot_begin is not None:
            self.counter = self.slot_begin = None
            self.access = bool(self.queue)

    def fail(self, now: int) -> None:
        """Count a failure of the first frame of the queue; retry or drop it."""
        options = self.rules.options
        if self.waits_for == ACK and self.rules.has_rts(self.queue[0]):
            self.long_retries += 1
        else:
            self.short_retries += 1
        if not options.bianchi_counting:
            self.no_slot_before = now + self.rules.timing.difs
        self.cw = min(2 * self.cw + 1, self.rules.timing.cw_max)
        dropped = self.short_retries == options.short_limit or self.long_retries == options.long_limit
        self.leave(**{"dropped_ns": now} if dropped else {})

    def quiet(self, now: int) -> bool:
        """Return whether an interframe space passes: nothing is sensed, nor has noise gone on for as long as that."""
        noisy = bool(self.arriving) and self.noise_from + self.rules.timing.cca <= now
        return not self.busy(now) and not noisy

    def states(self, now: int) -> set[str]:
        """Return what the station is doing from now on."""
        states = set()
        if self.sending is not None or self.arriving:
            states.add(BUSY)
        if now < self.nav:
            states.add(NAV)
        if self.waits_for is not None:
            states.add({CTS: "awaits_cts", ACK: "awaits_ack"}[self.waits_for])
        if self.counter is not None and self.slot_begin is not None:
            states.add("backoff")
        elif (self.counter is not None or (self.queue and not self.in_exchange)) and self.quiet(now):
            states.add("eifs" if self.after_error and not self.rules.options.bianchi_counting else "difs")
        return states

    def note(self, now: int, states: set[str]) -> list[Interval]:
        """Note in which *states* the station is from now on; return the intervals that are over."""
        if self.doing.keys() == states:
            return []
        over = [interval._replace(end_ns=now) for state, interval in self.doing.items() if state not in states]
        self.doing = {state: interval for state, interval in self.doing.items() if state in states}
        for state in states - self.doing.keys():
            slots = (self.counter, *self.drawn) if state == "backoff" else ()
            self.doing[state] = Interval(now, self.name, -1, state, slots)
        return over

    def due(self, now: int) -> Frame | None:
        """Return the frame that begins now, if any."""
        if self.answer is not None and self.answer[0] == now:
            (_, destination, kind, number), self.answer = self.answer, None
            assert not self.access, "an answer comes SIFS after an arrival, the queue's turn no earlier than DIFS"
            if self.sending is not None:
                return None
        elif self.access:
            number = self.queue[0]
            destination = self.rules.arrivals[number].destination
            kind = RTS if self.rules.has_rts(number) else DATA
            self.access, self.in_exchange = False, True
        else:
            return None
        self.lock_deafened = True
        self.sending = Frame(now, now + self.rules.air_time(kind, number), self.name, destination, kind, number)
        return self.sending


def run(
    timing: Timing,
    hears: Sequence[Sequence[bool]],
    arrivals: Sequence[Arrival],
    options: Options,
    key: tuple[int, int],
    until_ns: int,
    step_ns: int = US,
) -> Result:
    """Run from 0 up to but without *until_ns*; ``hears[a][b]``: b hears a; *key*: of the Philox draws of back-offs."""
    assert timing.delta >= step_ns, "what is sent at an instant must not arrive at it"
    assert all(time % step_ns == 0 for time in (*timing[:6], *timing[10:], *(arrival.time_ns for arrival in arrivals)))
    rules = Rules(timing, arrivals, options, key, [Fate() for _ in arrivals])
    stations = [Station(name, rules) for name in range(len(hears))]
    reached = [[b for b in stations if b is not a and hears[a.name][b.name]] for a in stations]
    coming: dict[int, list[int]] = {arrival.time_ns: [] for arrival in arrivals}
    for number, arrival in enumerate(arrivals):
        coming[arrival.time_ns].append(number)
    frames: list[Frame] = []
    on_air: list[Frame] = []
    outcomes: dict[tuple[Frame, int], str] = {}
    intervals: list[Interval] = []
    for now in range(0, until_ns, step_ns):
        for frame in list(on_air):
            if frame.end_ns == now:
                stations[frame.source].own_end(now, frame)
            if frame.end_ns + timing.delta == now:
                on_air.remove(frame)
                for station in reached[frame.source]:
                    outcomes[frame, station.name] = station.arrival_end(now, frame)
        for frame in on_air:
            if frame.begin_ns + timing.delta == now:
                for station in reached[frame.source]:
                    station.arrival_begin(frame)
        for number in coming.get(now, ()):
            stations[arrivals[number].station].queue.append(number)
        for station in stations:
            station.look(now)
        for station in stations:
            if (begun := station.due(now)) is not None:
                assert begun.end_ns % step_ns == 0
                frames.append(begun)
                on_air.append(begun)
        for station in stations:
            intervals += station.note(now, station.states(now))
    for station in stations:
        intervals += station.note(until_ns, set())
    order = sorted(range(len(arrivals)), key=lambda number: arrivals[number].time_ns)
    sent = [[number for number in order if arrivals[number].station == station.name] for station in stations]
    named = {frame: frame._replace(number=sent[arrivals[frame.number].station].index(frame.number)) for frame in frames}
    made = {(named[frame], b): what for (frame, b), what in outcomes.items()}
    return Result(list(named.values()), made, rules.fates, intervals)
