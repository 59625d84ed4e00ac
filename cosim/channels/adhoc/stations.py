"""All stations of one 802.11 channel as the channel sees them: packets go in, what is received and done comes out.

The stations have a queue of events of their own (``agenda``), of which the kernel knows the next one. When that is due
they run ahead (``advance``), but never past the kernel's next event, and only to the end of the instant and phase in
which something comes out for a host: hosts hear of it at that instant. Where an event of the kernel and one of the
stations have one instant and phase, that goes first which was in the kernel's queue first, and all of the stations go
together.
"""

from collections.abc import Callable, Iterator, Sequence
from struct import Struct
from typing import Final, NamedTuple, Protocol, TypeAlias

import numpy as np

from cosim.arrays import Int64s
from cosim.channels.adhoc.advance import ASK, FULL, ROWLESS, TOLD, advance, jam_all
from cosim.channels.adhoc.agenda import MAY_SEND, ORDER_BITS
from cosim.channels.adhoc.dcf import matters, power, queue
from cosim.channels.adhoc.errors import tables
from cosim.channels.adhoc.log import EACH, MORE, has_log_room, log_under_way
from cosim.channels.adhoc.mac import ACK, DATA, KINDS, RTS, Access, Form, Limits, Packet, Timing
from cosim.channels.adhoc.reach import FEW
from cosim.channels.adhoc.reception import deafen
from cosim.channels.adhoc.state import (
    BEGUN,
    DONE,
    END,
    FORM,
    GRANTED,
    INTERVAL,
    NEVER,
    NONE,
    RECEIVED,
    RECEPTION,
    REFUSED,
    REPORT,
    TRANSMISSION,
    Log,
    Network,
    Records,
    Report,
    doubled,
    new_network,
    new_records,
    with_frames,
    with_packets,
)
from cosim.channels.air.arbitration import Rank, Seat
from cosim.channels.base import Flying
from cosim.channels.energy import IDLE, OFF, RECEIVE, TRANSMIT, Use, Uses
from cosim.jit import njit
from cosim.kernel import Kernel
from cosim.machine import BROADCAST, Address
from cosim.randomness import Draws
from cosim.units import Time

ROWS: Final = 256
"""Number of rows after which those that no frame uses are forgotten: all rows would be stations times stations."""
BEGUN_ROWS: Final = 256
"""Number of frames that have begun and are kept for other radios before they are handed over."""
LOG_ROWS: Final = 4096
"""Number of intervals, and of receptions, that are kept for tables before they are handed over."""

_READ: Final = ("what", "station", "packet", "right", "mw", "source", "number")
"""Fields of reports of which hosts hear, in their order."""
_REPORT: Final = Struct(
    "".join(REPORT[name].char if name in _READ else f"{REPORT[name].itemsize}x" for name in REPORT.fields or ()) + "0q"
)
"""These fields of a report, and what is skipped."""
_WHOLE_REPORT: Final = Struct("".join(REPORT[name].char for name in REPORT.fields or ()) + "0q")
"""All its fields."""
_OFFERED: Final = ("address", "destination", "form", "asks", "awaited", "now")
_OFFER: Final = np.dtype([(name, np.int64) for name in _OFFERED], align=True)
"""What ``queue`` is to do; its form by number."""
_WRITE_OFFER: Final = Struct(f"{len(_OFFERED)}q").pack_into
"""How Python writes that fastest."""

_Outcome: TypeAlias = tuple[Packet | None, bool, list[Address], list[float], Address, int | None, Report | None]
"""A packet, whether it was acknowledged, the stations, with which powers they have received it, its source, the number
of the DATA that it is (None: the first station is done with it), and what is to be noted instead."""


class Rules(NamedTuple):
    """What all stations of a network have in common."""

    timing: Timing
    access: Access
    limits: Limits | None
    """Noise and thresholds; None if all frames in reach are alike."""


class Wanted(NamedTuple):
    """What the host wants to hear of, for tables."""

    frames: bool = False
    """Every frame, when it has arrived to its end, at each station that it reaches, and everywhere."""
    intervals: bool = False
    """What the stations were doing,"""
    transmissions: bool = False
    """every frame once more,"""
    receptions: bool = False
    """and what became of it at stations: these three in bulk, later."""
    packets: bool = False
    """Every packet that is off the queue."""
    begun: Callable[[Records], None] | None = None
    """Every frame as it begins, for other radios that hear it: called when no more are kept for ``take_begun``."""


NOTHING_WANTED: Final = Wanted()


class Kept(NamedTuple):
    """What has been kept for tables."""

    intervals: Records
    transmissions: Records
    receptions: Records
    carried: Sequence[bytes]
    """What each of the transmissions has carried."""


class Host(Protocol):
    """The other side of all stations."""

    def write_rows(self, first: Address, last: Address, rows: Records, begin: int) -> Int64s:
        """Write whom frames of *first* to *last* reach that begin to arrive now, to *rows* from *begin* on.

        Row after row, each rising. Return where the row of each station ends.
        """

    def received(self, receivers: Sequence[Address], source: Address, packet: Packet, mw: Sequence[float]) -> None:
        """Take the DATA of *source* for all *receivers*, and with which power it has arrived at each; only once."""

    def done(self, address: Address, packet: Packet, acknowledged: bool) -> None:
        """Note that a packet is off the queue: acknowledged (or broadcast), or tried as often as allowed."""

    def noted(self, report: Report, packet: Packet | None) -> None:
        """Note that a frame has arrived to its end, at a station (HEARD), or everywhere (OVER).

        Or that a packet is off the queue (FINISHED).
        """

    def logged(self, kept: Kept) -> None:
        """Write what has been kept, in arrays that are the stations' own."""


class Stations:
    """All stations of a channel."""

    def __init__(
        self, size: int, rules: Rules, kernel: Kernel, draws: Draws, host: Host, wanted: Wanted = NOTHING_WANTED
    ) -> None:
        self._timing, self._access, limits = rules
        self._kernel = kernel
        self._host = host
        cck = tables(() if limits is None else _rates(self._timing))
        network = new_network(size, *rules, draws.key, cck, kernel.now)
        self._begun = wanted.begun
        if wanted.begun is not None:
            network = network._replace(begun=new_records(BEGUN_ROWS + 2 * size, BEGUN))
        self._common = network.common[0]
        self._common["noted"], self._common["packets_noted"] = wanted.frames, wanted.packets
        self._log = _new_log(wanted, LOG_ROWS + EACH * size + MORE)
        self._transmissions_kept = _field(network.common, "transmissions")
        """Number of transmissions in the log, and the packets that they have carried."""
        self._packets_kept = memoryview(b"") if self._log is None else _field(self._log.transmissions, "packet")
        self._carried: list[bytes] = []
        """What the transmissions that are kept have carried, as far as it was looked for."""
        names = "events", "told", "urgent", "frames_under_way", "first_there", "rowless"
        self._events, self._told, self._urgent, self._under_way, self._first_there, self._rowless = (
            _field(network.common, name) for name in names
        )
        self._row_begins, self._row_ends = network.stations["row"], network.stations["row_end"]
        self._until = np.zeros(2, np.int64)
        """Instant and phase up to which the stations run ahead, for the kernel; and as Python writes them."""
        self._until_written = self._until.data
        self._offer = new_records(1, _OFFER)
        self._offered = self._offer.view(np.uint8).data
        self._forms = new_records(16, FORM)
        self._form_numbers: dict[tuple[bool, int], int] = {}
        self._use(network)
        self._packets: dict[int, Packet] = {}
        self._heard: list[dict[Address, int]] = [{} for _ in range(size)]
        """Last sequence number of each sender, by receiver."""
        self._rows_used = self._rows = 0
        """Room that is taken by rows, and number of them that have been written since they were forgotten."""
        self._alarm = kernel.alarm(self._pump)
        self._alarm_at: tuple[Time, int] | None = None
        """Instant and phase of the next event as the kernel knows it."""
        self._pumping = False
        self._stirred = False
        """Something has been put on the agenda since the pump has begun."""
        self._seats: dict[Address, Seat] = {}
        """Stations that ask before they send."""

    def _use(self, network: Network) -> None:
        """Take *network*, whose arrays are new."""
        self._network = network
        self._advancing = _advancing(network, self._log, self._until)
        self._queueing = _queueing(network, self._forms, self._offer)
        self._times, self._ranks = _field(network.agenda, "time"), _field(network.agenda, "rank")
        self._reports = network.told.view(np.uint8).data

    # ------------------------------------------------------------ what goes in

    def send(self, address: Address, packet: Packet, awaited: int = END) -> None:
        """Queue *packet* at a station; the host hears when it is off the queue if that is *awaited*.

        That is NOTHING, FAILURE, or its END.
        """
        destination, octets = packet.destination, len(packet.payload)
        form = self._form_numbers.get((destination == BROADCAST, octets))
        if form is None:
            form = self._new_form(destination == BROADCAST, octets)
        asks = self._access.asks(packet)
        _WRITE_OFFER(self._offered, 0, address, destination, form, asks, awaited, self._kernel.now)
        number = next(self._queueing)
        if number == NONE:
            self._make_room()
            number = next(self._queueing)
        if self._log is not None:
            self._note_carried()
        self._packets[number] = packet
        self._arm()

    def _new_form(self, to_all: bool, octets: int) -> int:
        number = self._form_numbers[to_all, octets] = len(self._form_numbers)
        if number == len(self._forms):
            self._forms = doubled(self._forms)
            self._use(self._network)
        self._forms[number] = (self._timing.broadcast if to_all else self._timing.unicast)(octets)
        return number

    def power(self, address: Address, on: bool) -> None:
        """Switch a station on or off; what it holds is lost, and what it is just sending is spoilt."""
        self._make_log_room()
        power(self._network, self._log, address, on, self._kernel.now)
        if not on:
            self._heard[address].clear()

    def jammed(self, powers_mw: Sequence[float], at: Time) -> None:
        """Have the stations receive *powers_mw* of jammers from *at* on, which may be in the past for those at rest."""
        self._make_room()
        jam_all(self._network, self._log, np.array(powers_mw, dtype=np.float64), at, self._kernel.now)
        self._arm()

    def moved(self) -> None:
        """Note that frames reach others, or with other powers, from now on."""
        network = self._network
        self._row_begins.fill(NONE)
        kept, used = [], 0
        number = self._first_there[0]
        while number != NONE:  # frames that have begun to arrive stay where they are
            frame = network.frames[number]
            kept.append(network.rows[frame["row"] : frame["row_end"]].copy())
            frame["row"], frame["row_end"] = used, used + len(kept[-1])
            used += len(kept[-1])
            number = int(frame["next"])
        if kept:
            network.rows[:used] = np.concatenate(kept)
        self._rows_used, self._rows = used, 0

    # ------------------------------------------------------------ other radios of the same robots

    def arbitrate(self, address: Address, seat: Seat) -> None:
        """Have a station ask at *seat* before it sends."""
        self._seats[address] = seat
        self._network.stations[address]["arbitrated"] = True
        self._common["arbitrates"] = True

    def deafen(self, address: Address, until: Time) -> None:
        """Note that another radio of the robot sends from now *until* then, if the station must ask that one."""
        if address in self._seats:
            deafen(self._network, address, until)

    def used_until(self, address: Address, start: Time, end: Time, rank: Rank) -> Time | None:
        """Return the end of what the station does in [start, end) and has begun, or goes before *rank*.

        That is what it sends, with the time for answers; and what is for it, or for all, as it arrives, and its answer.
        """
        station, sifs = self._network.stations[address], self._timing.sifs
        until = int(station["used_until"])
        if rank < Rank.RECEPTION:
            if station["followed"] != NONE:
                frame = self._network.frames[station["followed"]]
                over = int(frame["begin"] + frame["form"]["duration"]) + self._timing.delay
                if frame["destination"] == BROADCAST:
                    until = max(until, over)
                elif frame["destination"] == address and frame["kind"] in (DATA, RTS):
                    until = max(until, over + sifs + self._timing.ack.duration)
            elif station["sending"] == NONE and station["act"] >= self._kernel.now:  # it owes an answer
                until = max(until, int(station["act"]) + self._answer(address).duration)
        return until if until > start else None

    def _answer(self, address: Address) -> Form:
        return self._timing.ack if self._network.stations[address]["answer_kind"] == ACK else self._timing.cts

    def _ask(self, now: Time) -> None:
        """Ask for the station that is about to send *now*, and note what it is told."""
        event = self._network.agenda[0]
        address, kind = int(event["who"]), int(event["kind"])
        station = self._network.stations[address]
        if kind == MAY_SEND:
            rank, until = Rank.FRAME, now + self._exchange(int(station["first"]))
        else:
            reserves = int(station["answer_reserves"])
            rank, until = Rank.RECEPTION, now + self._answer(address).duration + reserves
        refused_until = self._seats[address].ask(now, now, until, rank)
        station["permit"] = GRANTED if refused_until is None else REFUSED
        if refused_until is not None:
            station["refused_until"] = refused_until

    def _exchange(self, number: int) -> Time:
        """Return how long it takes to send a packet and receive all answers."""
        packet, timing = self._network.packets[number], self._timing
        time = int(packet["form"]["duration"])
        if packet["destination"] != BROADCAST:
            time += timing.sifs + timing.ack.duration
        if packet["asks"]:
            time += timing.rts.duration + timing.cts.duration + 2 * timing.sifs
        return time

    # ------------------------------------------------------------ what can be asked

    @property
    def matter(self) -> bool:
        """True if a frame is on the air, or a station has something to send."""
        return bool(matters(self._network, self._kernel.now))

    @property
    def frames(self) -> int:
        """Number of frames that have been on the air."""
        return int(self._common["frames"])

    @property
    def dropped(self) -> int:
        """Number of packets that were sent as often as allowed, and not acknowledged."""
        return int(self._common["dropped"])

    def uses(self, address: Address, now: Time) -> Uses:
        """Return how long a station has sent, followed frames, listened without, and been off, up to *now*."""
        station = self._network.stations[address]
        sent, followed, off = (int(station[name]) for name in ("sent_for", "followed_for", "off_for"))
        if station["sending"] != NONE:
            sent += now - int(self._network.frames[station["sending"]]["begin"])
        if station["followed"] != NONE:
            followed += now - int(station["followed_from"])
        if station["off_from"] != NEVER:
            off += now - int(station["off_from"])
        times = {OFF: off, IDLE: now - sent - followed - off, RECEIVE: followed, TRANSMIT: sent}
        return {Use(state): time for state, time in times.items() if time}

    def flying(self) -> list[Flying]:
        """Return the frames that have begun and not yet arrived to their ends."""
        frames, found = self._network.frames, []
        for number in (int(self._common["first_there"]), int(self._common["first_begun"])):
            while number != NONE:
                frame = frames[number]
                kind, source, begin = (int(frame[name]) for name in ("kind", "source", "begin"))
                end = begin + int(frame["form"]["duration"])
                length = 0 if frame["packet"] == NONE else len(self._packets[int(frame["packet"])].payload)
                found.append(Flying(begin, source, end, KINDS[kind], int(frame["destination"]), length))
                number = int(frame["next"])
        return found

    def take_begun(self, until: Time) -> Records:
        """Return the frames that have begun before *until*, and only once: begin, end and source of each."""
        due = count = int(self._common["begun"])
        rows = self._network.begun
        if not count:
            return rows[:0]
        while due and rows["begin"][due - 1] >= until:
            due -= 1
        found: Records = rows[:due].copy()
        if due < count:
            rows[: count - due] = rows[due:count].copy()
        self._common["begun"] = count - due
        return found

    def begun(self) -> list[tuple[Packet, Time]]:
        """Return the packets that have been on the air and are still queued, and when their first frames have begun."""
        network = self._network
        firsts = network.stations["first"][network.stations["waiting"] > 0]
        times = network.packets["begun"][firsts].tolist()
        return [(self._packets[number], at) for number, at in zip(firsts.tolist(), times, strict=True) if at != NEVER]

    # ------------------------------------------------------------ what is kept for tables

    def flush(self) -> None:
        """Hand to the host what has been kept, but for what goes on beyond now."""
        if self._log is None:
            return
        self._note_carried()
        now = max(int(self._common["now"]), self._kernel.now)
        intervals, transmissions, receptions = self._kept(self._log)
        late = intervals["end"] > now  # energy is sensed some time after it has begun
        self._host.logged(Kept(intervals[~late], transmissions, receptions, self._carried))
        self._keep(self._log, intervals[late])

    def under_way(self, now: Time) -> Records:
        """Return what the stations are doing *now*, as intervals that end now; hand over what they have done before."""
        intervals = self._not_over(now)
        going_on: Records = intervals[intervals["end"] == now]
        return going_on

    def close(self, now: Time) -> None:
        """Hand over all that has been kept: the run is over."""
        intervals = self._not_over(now)
        if self._log is not None:
            self._keep(self._log, intervals[:0])
            self._host.logged(Kept(intervals, *self._kept(self._log)[1:], ()))

    def _not_over(self, now: Time) -> Records:
        """Hand over what has been kept, and return what has not been, as far as it has come *now*.

        If a station counts its back-off, the space before that is returned with it.
        """
        if self._log is None:
            return new_records(0, INTERVAL)
        self.flush()
        late = self._kept(self._log).intervals.copy()
        log_under_way(self._network, self._log, now)
        intervals = self._kept(self._log).intervals.copy()
        self._keep(self._log, late)
        intervals["end"] = np.minimum(intervals["end"], now)
        return intervals[intervals["begin"] < now]

    def _kept(self, log: Log) -> Log:
        """Return the rows of *log* that are in use."""
        counts = (int(self._common[name]) for name in Log._fields)
        return Log(*(rows[:count] for rows, count in zip(log, counts, strict=True)))

    def _keep(self, log: Log, intervals: Records) -> None:
        """Keep *intervals*, and nothing else."""
        log.intervals[: len(intervals)] = intervals
        self._common["intervals"], self._common["transmissions"], self._common["receptions"] = len(intervals), 0, 0
        self._carried = []

    def _note_carried(self) -> None:
        """Note what transmissions have carried, before a packet that is done with leaves its number to another."""
        carried, numbers = self._carried, self._packets_kept
        for at in range(len(carried), self._transmissions_kept[0]):
            number = numbers[at]
            carried.append(b"" if number == NONE else self._packets[number].payload)

    def _make_log_room(self) -> None:
        """Hand over what has been kept if that leaves no room for what the next event may bring."""
        if self._log is not None and not has_log_room(self._network, self._log):
            self.flush()

    # ------------------------------------------------------------ how time goes on

    def _arm(self) -> None:
        """Have the kernel call back at the next event."""
        if self._pumping:
            self._stirred = True
        elif self._events[0]:
            due = time, phase = self._times[0], self._ranks[0] >> ORDER_BITS
            if self._alarm_at is None or due < self._alarm_at:
                self._alarm_at = due
                self._alarm.set(time, phase)

    def _pump(self) -> None:
        """Tell hosts what has come out for this instant and phase; when they have acted on it, run ahead."""
        kernel = self._kernel
        now, phase = here = kernel.phase
        self._alarm_at = None
        self._pumping, self._stirred = True, False
        told, rest, others = self._tell(), (now, phase + 1), kernel.peek()
        if told and not self._stirred and others < rest:  # nothing else was due in this phase
            kernel.soon(self._run_ahead)
            return
        out, due = self._advance(max(others, rest))
        while out and due == here:
            told, others = self._tell(), kernel.peek()
            out, due = self._advance(max(others, rest))
        if told and others < rest:  # hosts are to act yet
            kernel.soon(self._run_ahead)
        else:
            self._wait(out, due)

    def _run_ahead(self) -> None:
        """Run ahead to the kernel's next event, or to what hosts must hear of."""
        self._wait(*self._advance(self._kernel.peek()))

    def _advance(self, until: tuple[Time, int]) -> tuple[bool, tuple[Time, int]]:
        """Run ahead; return whether something has come out for hosts, and when: or else when the next event is."""
        self._until_written[0], self._until_written[1] = until
        while True:
            why, time, phase = next(self._advancing)
            if why == ROWLESS:
                self._add_rows(self._rowless[0])
            elif why == FULL:
                self._make_room()
            elif why == ASK:
                self._ask(time)
            else:
                return why == TOLD, (time, phase)

    def _wait(self, out: bool, due: tuple[Time, int]) -> None:
        """Have the kernel call back at *due*, when something has come *out*, or the next event is."""
        self._pumping = False
        if not out:
            self._tell()
        time, phase = due
        if time != NEVER:
            self._alarm_at = due
            self._alarm.set(time, phase)

    def _add_rows(self, source: Address) -> None:
        """Have the row of *source* written; where stations are few all, which costs little more."""
        size = len(self._network.stations)
        if self._rows > ROWS and self._rows > self._under_way[0]:
            self.moved()
        first, last = (0, size - 1) if size <= FEW else (source, source)
        begin, count = self._rows_used, last + 1 - first
        while begin + count * size > len(self._network.rows):
            self._use(self._network._replace(rows=doubled(self._network.rows)))
        ends = self._host.write_rows(first, last, self._network.rows, begin)
        self._row_ends[first : last + 1] = ends[first : last + 1]
        self._row_begins[first], self._row_begins[first + 1 : last + 1] = begin, ends[first:last]
        self._rows_used = int(ends[last])
        self._rows += count

    def _make_room(self) -> None:
        """Make room for another packet, and for what the next event may bring."""
        if self._told[0] and not self._urgent[0]:
            self._tell()
        self._make_log_room()
        network, size = self._network, len(self._network.stations)
        if self._begun is not None and self._common["begun"] + size > len(network.begun):
            self._begun(self.take_begun(NEVER))
        if self._common["free_frame"] == NONE:
            network = with_frames(network, len(network.frames))
        if self._common["free_packet"] == NONE:
            network = with_packets(network, len(network.packets))
        while self._told[0] + 4 * size + 4 > len(network.told):
            network = network._replace(told=doubled(network.told))
        while self._events[0] + 2 * size + self._under_way[0] + 4 > len(network.agenda):
            network = network._replace(agenda=doubled(network.agenda))
        if network is not self._network:
            self._use(network)

    def _tell(self) -> bool:
        """Tell the host what has come out; return whether anything has."""
        count = self._told[0]
        if not count:
            return False
        host = self._host
        for packet, right, receivers, mw, source, number, note in self._outcomes(count):
            if note is not None:
                host.noted(note, packet)
                continue
            assert packet is not None
            station = receivers[0]
            if number is None:
                host.done(station, packet, right)
            elif packet.destination == BROADCAST or self._is_new(station, source, number):
                host.received(receivers, source, packet, mw)
        return True

    def _outcomes(self, count: int) -> list[_Outcome]:
        """Take what *count* reports say, all before hosts hear of any: they may send, and a packet's number is taken.

        A frame that several stations have received is one outcome.
        """
        outcomes: list[_Outcome] = []
        receivers: list[Address] = []
        mw: list[float] = []
        heard, packets = NONE, self._packets
        told = _REPORT.iter_unpack(self._reports[: count * _REPORT.size])
        for at, (what, station, number, right, power_mw, source, data_number) in enumerate(told):
            if what != RECEIVED:
                heard = NONE
                note = None if what == DONE else Report(*_WHOLE_REPORT.unpack_from(self._reports, at * _REPORT.size))
                outcomes.append((packets.get(number), right, [station], [power_mw], source, None, note))
            elif number == heard:
                receivers.append(station)
                mw.append(power_mw)
            else:
                heard, receivers, mw = number, [station], [power_mw]
                outcomes.append((packets[number], right, receivers, mw, source, data_number, None))
        self._told[0], self._urgent[0] = 0, False
        return outcomes

    def _is_new(self, address: Address, source: Address, number: int) -> bool:
        """Return whether DATA to one station is not the last that it has received of its sender (9.2.9)."""
        heard = self._heard[address]
        known = heard.get(source) == number
        heard[source] = number
        return not known


def _new_log(wanted: Wanted, room: int) -> Log | None:
    """Return a log with *room* for rows of what is *wanted*; None if nothing is."""
    fields = (wanted.intervals, INTERVAL), (wanted.transmissions, TRANSMISSION), (wanted.receptions, RECEPTION)
    if not any(each for each, _ in fields):
        return None
    return Log(*(new_records(room if each else 0, of_row) for each, of_row in fields))


def _rates(timing: Timing) -> set[int]:
    """Return the rates of all frames."""
    forms = (timing.ack, timing.rts, timing.cts, timing.unicast(0), timing.broadcast(0))
    return {rate for form in forms for rate in (form.rate_kbps, form.header_kbps)}


def _field(records: Records, name: str) -> memoryview:
    """Return a field of *records*, as Python reads and writes it fastest."""
    return records[name].data


# ---------------------------------------------------------------- kernels
#
# A network is nine arrays, and each call of a kernel takes them over from Python anew: that costs more than most
# events do. These two take them once, and then do their work whenever they are asked for the next result. They borrow
# what ``Stations`` holds: a generator of numba's that is not asked to its end never gives back what it has counted as
# held.


@njit(cache=True, borrows=True)
def _advancing(network: Network, log: Log | None, until: Int64s) -> Iterator[tuple[int, Time, int]]:
    """Yield what ``advance`` returns when it goes up to the instant and phase that *until*, (2,), holds."""
    while True:
        yield advance(network, log, until[0], until[1])


@njit(cache=True, borrows=True)
def _queueing(network: Network, forms: Records, offer: Records) -> Iterator[int]:
    """Yield what ``queue`` returns for the packet of which *offer*, (1,), tells, its form by number."""
    while True:
        packet = offer[0]  # not outside of the loop: what is kept from one result to the next is a copy
        form, asks, awaited = forms[packet.form], packet.asks != 0, packet.awaited
        yield queue(network, packet.address, packet.destination, form, asks, awaited, packet.now)
