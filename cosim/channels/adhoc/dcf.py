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

from typing import Final

from cosim.channels.adhoc.agenda import ANSWER, CONTEND, GIVE_UP, MAY_SEND, SEND_DATA, SENT, push
from cosim.channels.adhoc.air import begin, leave_packet, new_frame, tell, tell_frame
from cosim.channels.adhoc.log import log_access, log_response, log_unsensed, note_waiting
from cosim.channels.adhoc.mac import ACK, CTS, DATA, RTS, Form
from cosim.channels.adhoc.reception import IGNORED, RIGHT, begins, disturb, ends, energy, stop_following
from cosim.channels.adhoc.state import (
    DONE,
    END,
    FAILURE,
    FINISHED,
    NEVER,
    NONE,
    RECEIVED,
    REFUSED,
    Log,
    Network,
    Record,
)
from cosim.jit import njit
from cosim.kernel import AIR, DELIVER
from cosim.machine import BROADCAST
from cosim.randomness import philox_words
from cosim.units import Time

BACKOFF: Final = 1
"""Purpose of the draws of back-offs."""


# ---------------------------------------------------------------- back-off


@njit(cache=True, borrows=True)
def _draw(common: Record, station: Record, address: int, not_before: Time) -> None:
    """Draw a new back-off, whose slots count from *not_before* at the earliest (9.2.4)."""
    words = philox_words(station.drawn, 0, address, BACKOFF, common.key_0, common.key_1)
    bound = station.window + 1  # the product of it and 64 bits, of which the upper 64 count
    station.slots = (words[0] * bound + (words[1] * bound >> 32)) >> 32
    station.drawn += 1
    station.drawn_slots, station.drawn_window = station.slots, station.window
    station.not_before = not_before
    station.pending = True


@njit(cache=True, borrows=True)
def _interrupt(common: Record, station: Record, sensed_at: Time) -> None:
    """Take off the slots that have ended before *sensed_at*, at which the medium is known to be busy."""
    over = sensed_at - station.counted_from
    if over > 0:
        station.slots -= -(-over // common.slot) - 1
        if common.bianchi_counting:
            station.slots = max(station.slots - 1, 0)


# ---------------------------------------------------------------- the queue


@njit(cache=True, borrows=True)
def queue(network: Network, address: int, destination: int, form: Form, asks: bool, awaited: int, now: Time) -> int:
    """Queue a packet, and send it as soon as what is before it is done and the medium allows; return its number.

    Return NONE, and do nothing, if there is no room for it. An RTS precedes it if it *asks*. What is *awaited* is
    NOTHING, FAILURE or END.
    """
    common, station = network.common[0], network.stations[address]
    number: int = common.free_packet
    if number == NONE or common.events == len(network.agenda):
        return NONE
    packet = network.packets[number]
    common.free_packet = packet.next
    packet.destination, packet.asks, packet.awaited = destination, asks, awaited
    packet.form.duration, packet.form.octets, packet.form.rate_kbps = form.duration, form.octets, form.rate_kbps
    packet.form.preamble, packet.form.header, packet.form.end = form.preamble, form.header, form.end
    packet.form.header_kbps, packet.form.header_bits = form.header_kbps, form.header_bits
    packet.number, packet.short, packet.long, packet.users, packet.next = station.numbers, 0, 0, 1, NONE
    packet.begun = NEVER
    station.numbers += 1
    station.waiting += 1
    if station.waiting == 1:  # frames that end or begin at this instant come first
        station.first = number
        push(network, now, AIR, CONTEND, address)
    else:
        network.packets[station.last].next = number
    station.last = number
    return number


@njit(cache=True, borrows=True)
def power(network: Network, log: Log | None, address: int, on: bool, now: Time) -> None:
    """Switch a station on or off; what it holds is lost, and what it is just sending is spoilt."""
    station = network.stations[address]
    if on:
        station.idle_from = now
        if station.off_from != NEVER:
            station.off_for += now - station.off_from
            station.off_from = NEVER
        return
    station.off_from = min(station.off_from, now)
    if log is not None:
        log_access(network, log, address, now)
        log_response(network, log, address, now)
    station.life += 1
    while station.waiting > 0:
        _take_first(network, station)
    station.ends, station.ends_event, station.timeout_event, station.awaits = NEVER, NONE, NONE, NONE
    station.exchanging = station.erred = station.pending = False
    station.window = network.common[0].cw_min
    stop_following(station, now)
    station.reserved_until = station.used_until = now
    if station.sending != NONE:
        station.sent_for += now - network.frames[station.sending].begin
        network.frames[station.sending].whole = False
        station.sending = NONE


@njit(cache=True, borrows=True)
def matters(network: Network, now: Time) -> bool:
    """Return whether a frame is on the air, or a station has something to send: payload, answer, or back-off."""
    common = network.common[0]
    if common.over != common.frames:
        return True
    for station in network.stations:  # noqa: SIM110  # kernels have no generators
        if station.waiting > 0 or station.pending or station.act >= now:
            return True
    return False


@njit(cache=True, borrows=True)
def _take_first(network: Network, station: Record) -> None:
    number = station.first
    station.first = network.packets[number].next
    station.waiting -= 1
    leave_packet(network, number)


@njit(cache=True, borrows=True)
def _finish(network: Network, log: Log | None, address: int, acknowledged: bool, after: Time, now: Time) -> None:
    common, station = network.common[0], network.stations[address]
    awaited = network.packets[station.first].awaited
    if awaited == END or (awaited == FAILURE and not acknowledged):
        tell(network, DONE, address, station.first, acknowledged)
    if common.packets_noted:
        report = tell(network, FINISHED, address, station.first, acknowledged)
        report.begin = network.packets[station.first].begun
        report.duration = now - report.begin
    if not acknowledged:
        common.dropped += 1
    _take_first(network, station)
    station.window = common.cw_min
    _end_exchange(network, log, address, after, now)


@njit(cache=True, borrows=True)
def _fail(network: Network, log: Log | None, address: int, now: Time) -> None:
    """Try the first of the queue again after a longer back-off, or drop it (9.2.5.3)."""
    common, station = network.common[0], network.stations[address]
    packet = network.packets[station.first]
    if log is not None:
        log_response(network, log, address, now)
    after = 0 if common.bianchi_counting else common.difs
    if station.awaits == ACK and packet.asks:
        packet.long += 1
    else:
        packet.short += 1
    station.awaits = NONE
    if packet.short >= common.short_retries or packet.long >= common.long_retries:
        _finish(network, log, address, False, after, now)
        return
    station.window = min(2 * station.window + 1, common.cw_max)
    _end_exchange(network, log, address, after, now)


@njit(cache=True, borrows=True)
def _end_exchange(network: Network, log: Log | None, address: int, after: Time, now: Time) -> None:
    station = network.stations[address]
    station.exchanging = False
    _draw(network.common[0], station, address, now + after)
    contend(network, log, address, now)


# ---------------------------------------------------------------- access to the medium


@njit(cache=True, borrows=True)
def contend(network: Network, log: Log | None, address: int, now: Time) -> None:
    """Schedule the instant at which to send, or at which the back-off ends, if the medium stays idle."""
    common, station = network.common[0], network.stations[address]
    if station.exchanging or station.ends != NEVER or not (station.pending or station.waiting > 0):
        return
    idle_for_good = max(station.idle_from, station.reserved_until, station.refused_until)
    idle_for_good += common.eifs if station.erred else common.difs
    busy = energy(network, address)
    if not station.pending:
        due = max(now, idle_for_good)
        sensed = busy and station.energy_from + common.cca <= due
        if station.sending == NONE and max(station.reserved_until, station.refused_until) <= now and not sensed:
            station.ends = due
            station.ends_event = push(network, due, AIR, MAY_SEND, address)
            if log is not None:
                note_waiting(network, log, address, now)
            return
        _draw(common, station, address, now)
    if station.sending != NONE:
        return
    if busy:
        if log is not None:
            log_unsensed(network, log, address, now)
    else:
        station.counted_from = max(idle_for_good, station.not_before)
        station.ends = station.counted_from + station.slots * common.slot
        station.ends_event = push(network, station.ends, AIR, MAY_SEND, address)
        if log is not None:
            note_waiting(network, log, address, now)


@njit(cache=True, borrows=True)
def may_send(network: Network, log: Log | None, address: int, now: Time) -> None:
    """Send what the station has waited to send, if anything."""
    common, station = network.common[0], network.stations[address]
    if log is not None:
        log_access(network, log, address, now)
    station.ends, station.ends_event = NEVER, NONE
    station.pending = False
    if station.waiting == 0:
        return
    if station.permit == REFUSED:  # the medium is busy for it
        _draw(common, station, address, now)
        contend(network, log, address, now)
        return
    station.exchanging = True
    packet = network.packets[station.first]
    if packet.asks:
        rest = 3 * common.sifs + common.cts.duration + packet.form.duration + common.ack.duration
        _transmit(network, log, address, RTS, packet.destination, common.rts, rest, packet.number, NONE, now)
    else:
        send_data(network, log, address, now)


@njit(cache=True, borrows=True)
def _defer(network: Network, log: Log | None, address: int, sensed_at: Time, now: Time) -> None:
    """Stop counting while the medium is busy, known from *sensed_at* on; a station that is due before sends."""
    common, station = network.common[0], network.stations[address]
    if station.ends == NEVER or station.ends < sensed_at:
        return
    if log is not None:
        answers_at = station.act if station.act >= now else NEVER
        log_access(network, log, address, min(sensed_at, answers_at))
    station.ends, station.ends_event = NEVER, NONE
    if station.pending:
        _interrupt(common, station, sensed_at)
    else:
        _draw(common, station, address, now)


# ---------------------------------------------------------------- sending


@njit(cache=True, borrows=True)
def send_data(network: Network, log: Log | None, address: int, now: Time) -> None:
    """Send the first of the queue."""
    common, number = network.common[0], network.stations[address].first
    packet = network.packets[number]
    rest = 0 if packet.destination == BROADCAST else common.sifs + common.ack.duration
    _transmit(network, log, address, DATA, packet.destination, packet.form, rest, packet.number, number, now)


@njit(cache=True, borrows=True)
def answer(network: Network, log: Log | None, address: int, now: Time) -> None:
    """Send the answer that is owed, an ACK or a CTS."""
    common, station = network.common[0], network.stations[address]
    if station.permit == REFUSED:  # nor may it send anything else
        _defer(network, log, address, now, now)
        contend(network, log, address, now)
        return
    form = common.ack if station.answer_kind == ACK else common.cts
    to, reserves, number = station.answer_to, station.answer_reserves, station.answer_number
    _transmit(network, log, address, station.answer_kind, to, form, reserves, number, NONE, now)


@njit(cache=True, borrows=True)
def _transmit(
    network: Network,
    log: Log | None,
    address: int,
    kind: int,
    destination: int,
    form: Record,
    reserves: Time,
    number: int,
    packet: int,
    now: Time,
) -> None:
    station = network.stations[address]
    if station.sending != NONE:
        return
    _defer(network, log, address, now, now)
    stop_following(station, now)
    sending = new_frame(network)
    frame = network.frames[sending]
    frame.kind, frame.source, frame.destination, frame.form = kind, address, destination, form
    frame.reserves, frame.number, frame.packet = reserves, number, packet
    station.sending = sending
    station.act = now + form.duration
    station.used_until = station.act + reserves
    push(network, station.act, DELIVER, SENT, address)
    begin(network, sending, now)


@njit(cache=True, borrows=True)
def sent(network: Network, log: Log | None, address: int, now: Time) -> None:
    """Go on after the end of what the station has sent: wait for an answer, or for the next turn."""
    common, station = network.common[0], network.stations[address]
    frame = network.frames[station.sending]
    station.sending = NONE
    station.sent_for += frame.form.duration
    if not energy(network, address):
        station.idle_from = now
    if frame.kind == RTS or (frame.kind == DATA and frame.destination != BROADCAST):
        station.awaits, station.awaits_from = CTS if frame.kind == RTS else ACK, now
        station.timeout_event = push(network, now + common.timeout, AIR, GIVE_UP, address)
    elif frame.kind == DATA:
        _finish(network, log, address, True, 0, now)
    else:
        contend(network, log, address, now)


@njit(cache=True, borrows=True)
def give_up(network: Network, log: Log | None, address: int, now: Time) -> None:
    """Fail as no response has come, unless a frame is being received, which may be one."""
    station = network.stations[address]
    station.timeout_event = NONE
    if station.followed == NONE:
        _fail(network, log, address, now)


# ---------------------------------------------------------------- receiving


@njit(cache=True, borrows=True)
def energy_begins(network: Network, log: Log | None, address: int, number: int, mw: float, now: Time) -> None:
    """Note that a frame begins to arrive with *mw*."""
    if begins(network, address, number, mw, now) and network.stations[address].sending == NONE:
        _defer(network, log, address, now + network.common[0].cca, now)


@njit(cache=True, borrows=True)
def energy_ends(network: Network, log: Log | None, address: int, number: int, now: Time) -> bool:
    """Note that a frame has arrived to its end; return whether it was received."""
    station = network.stations[address]
    was_busy, mw = energy(network, address), network.powers_mw[number, address]
    received = ends(network, address, number, now)
    idle = was_busy and station.sending == NONE and not energy(network, address)
    if idle:
        station.idle_from = now
    if received != IGNORED:
        station.erred = received != RIGHT
        answered = received == RIGHT and _take(network, log, address, number, mw, now)
        if station.awaits != NONE and station.timeout_event == NONE and not answered:
            _fail(network, log, address, now)
    if idle:
        contend(network, log, address, now)
    return received == RIGHT


@njit(cache=True, borrows=True)
def jam(network: Network, log: Log | None, address: int, mw: float, at: Time, now: Time) -> None:
    """Receive *mw* of jammers from *at* on, which is in the past only for a station at rest."""
    common, station = network.common[0], network.stations[address]
    if not disturb(network, address, mw, at) or station.sending != NONE:
        return
    if energy(network, address):
        _defer(network, log, address, at + common.cca, now)
    else:
        station.idle_from = max(station.idle_from, at)
        contend(network, log, address, now)


@njit(cache=True, borrows=True)
def _take(network: Network, log: Log | None, address: int, number: int, mw: float, now: Time) -> bool:
    """Act on a frame that has been received; return whether it is the response that was awaited."""
    common, station, frame = network.common[0], network.stations[address], network.frames[number]
    if frame.destination == BROADCAST:
        tell_frame(network, RECEIVED, address, number, True, mw)
    elif frame.destination != address:
        station.reserved_until = max(station.reserved_until, now + frame.reserves)
    elif frame.kind == DATA:
        _respond(network, address, ACK, frame, 0, now)
        tell_frame(network, RECEIVED, address, number, True, mw)
    elif frame.kind == RTS:
        if station.reserved_until <= now:
            rest = frame.reserves - common.sifs - common.cts.duration
            _respond(network, address, CTS, frame, rest, now)
    elif frame.kind == station.awaits and network.packets[station.first].destination == frame.source:
        _go_on(network, log, address, now)
        return True
    return False


@njit(cache=True, borrows=True)
def _respond(network: Network, address: int, kind: int, frame: Record, reserves: Time, now: Time) -> None:
    station = network.stations[address]
    station.answer_kind, station.answer_to = kind, frame.source
    station.answer_reserves, station.answer_number = reserves, frame.number
    station.act = now + network.common[0].sifs
    push(network, station.act, AIR, ANSWER, address)


@njit(cache=True, borrows=True)
def _go_on(network: Network, log: Log | None, address: int, now: Time) -> None:
    """Go on with the exchange: the awaited response has come."""
    common, station = network.common[0], network.stations[address]
    response = station.awaits
    if log is not None:
        log_response(network, log, address, now)
    station.timeout_event, station.awaits = NONE, NONE
    if response == ACK:
        _finish(network, log, address, True, 0, now)
    else:
        network.packets[station.first].short = 0
        station.act = now + common.sifs
        push(network, station.act, AIR, SEND_DATA, address)
