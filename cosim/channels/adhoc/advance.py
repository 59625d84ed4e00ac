"""One event of an 802.11 channel after another, up to what Python must see, and never past the kernel's next event."""

from typing import Final

from cosim.arrays import Floats
from cosim.channels.adhoc.agenda import (
    ANSWER,
    ARRIVE,
    CONTEND,
    GIVE_UP,
    LEAVE,
    MAY_SEND,
    ORDER_BITS,
    SEND_DATA,
    SENT,
    drop_first,
    push,
)
from cosim.channels.adhoc.air import forget, next_arrival, tell_frame, without_row
from cosim.channels.adhoc.dcf import (
    answer,
    contend,
    energy_begins,
    energy_ends,
    give_up,
    jam,
    may_send,
    send_data,
    sent,
)
from cosim.channels.adhoc.log import has_log_room, log_reception, log_transmission
from cosim.channels.adhoc.reception import is_calm
from cosim.channels.adhoc.state import HEARD, NEVER, NONE, OVER, UNASKED, Log, Network, Record
from cosim.jit import njit
from cosim.kernel import DELIVER
from cosim.machine import BROADCAST
from cosim.units import Time

IDLE: Final = 0
"""Nothing is due before the given instant and phase."""
TOLD: Final = 1
"""Something has come out for hosts."""
ROWLESS: Final = 2
"""A row of powers is needed."""
FULL: Final = 3
"""There is not enough room for what the next event may bring."""
ASK: Final = 4
"""The station of the next event is about to send, and must ask whether it may."""


@njit(cache=True, borrows=True)
def advance(network: Network, log: Log | None, until: Time, phase: int) -> tuple[int, Time, int]:
    """Carry out what is due before the instant *until* and its *phase*; return why that has ended, and what is next.

    That is the instant and phase of what has come out for hosts, or of the next event; the instant is NEVER if there is
    none. All events of one instant and phase are carried out before it ends because something has come out.
    """
    common = network.common[0]
    while common.events > 0:
        first = network.agenda[0]
        now, due = first.time, first.rank >> ORDER_BITS
        if common.urgent and (now > common.now or due > common.phase):
            break
        if now > until or (now == until and due >= phase):
            break
        if not _has_room(network, log):
            return FULL, now, due
        if first.kind == ARRIVE:
            common.rowless = without_row(network, now)
            if common.rowless != NONE:
                return ROWLESS, now, due
        if common.arbitrates and _asks(network, first):
            return ASK, now, due
        common.now, common.phase = now, due
        kind, who, life, order = first.kind, first.who, first.life, first.rank & (1 << ORDER_BITS) - 1
        drop_first(network)
        if kind == ARRIVE:
            _arrive(network, log, now)
        elif kind == LEAVE:
            _leave(network, log, who, now)
        else:
            _act(network, log, who, kind, order, life, now)
    if common.urgent:
        return TOLD, common.now, common.phase
    if common.events == 0:
        return IDLE, NEVER, 0
    return IDLE, network.agenda[0].time, network.agenda[0].rank >> ORDER_BITS


@njit(cache=True, borrows=True)
def _has_room(network: Network, log: Log | None) -> bool:
    """Return whether the next event cannot bring more events, reports and frames than there is room for."""
    common, size = network.common[0], len(network.stations)
    events = common.events + 2 * size + common.frames_under_way + 4 <= len(network.agenda)
    reports = common.told + 4 * size + 4 <= len(network.told)
    if log is not None and not has_log_room(network, log):
        return False
    begun = len(network.begun) == 0 or common.begun + size <= len(network.begun)
    return bool(events and reports and begun and common.free_frame != NONE)


@njit(cache=True, borrows=True)
def _asks(network: Network, event: Record) -> bool:
    """Return whether a station is about to send, another radio of its robot may have the air, and it has not asked."""
    kind = event.kind
    if kind not in (MAY_SEND, ANSWER):  # DATA after a CTS has begun with the RTS
        return False
    station = network.stations[event.who]
    if not station.arbitrated or station.permit != UNASKED:
        return False
    if kind == MAY_SEND:
        return bool(station.waiting > 0 and station.ends_event == event.rank & (1 << ORDER_BITS) - 1)
    return bool(station.life == event.life)


@njit(cache=True, borrows=True)
def _act(network: Network, log: Log | None, address: int, kind: int, order: int, life: int, now: Time) -> None:
    """Have a station do what it was to do *now*, unless that has been cancelled."""
    station = network.stations[address]
    if kind == MAY_SEND:
        if station.ends_event == order:
            may_send(network, log, address, now)
    elif kind == GIVE_UP:
        if station.timeout_event == order:
            give_up(network, log, address, now)
    elif kind == CONTEND:
        contend(network, log, address, now)
    elif station.life != life:
        return  # it has been switched off since
    elif kind == SENT:
        sent(network, log, address, now)
    elif kind == ANSWER:
        answer(network, log, address, now)
    elif kind == SEND_DATA:
        send_data(network, log, address, now)
    station.permit = UNASKED


@njit(cache=True, borrows=True)
def _arrive(network: Network, log: Log | None, now: Time) -> None:
    """Have all frames that begin to arrive now do so, in the order of their senders."""
    common, powers_mw = network.common[0], network.powers_mw
    number = next_arrival(network, now)
    while number != NONE:
        frame = network.frames[number]
        sender = network.stations[frame.source]
        frame.row, frame.row_end = sender.row, sender.row_end
        for at in range(frame.row, frame.row_end):
            address, mw = network.rows[at].address, network.rows[at].mw
            if mw < common.follows_mw and is_calm(network, address, mw):  # so it is with most frames at most stations
                powers_mw[number, address] = mw
                network.stations[address].arriving += 1
            else:
                energy_begins(network, log, address, number, mw, now)
        push(network, now + frame.form.duration, DELIVER, LEAVE, number)
        number = next_arrival(network, now)


@njit(cache=True, borrows=True)
def _leave(network: Network, log: Log | None, number: int, now: Time) -> None:
    """Have a frame end wherever it has arrived."""
    frame, missed = network.frames[number], True
    common, logged = network.common[0], False
    if log is not None:
        logged = len(log.receptions) > 0
    noted, weakest_mw = common.noted, min(common.follows_mw, common.noise_mw)
    for at in range(frame.row, frame.row_end):
        address, followed, received = network.rows[at].address, False, False
        if is_calm(network, address, 0.0):
            network.powers_mw[number, address] = 0.0
            network.stations[address].arriving -= 1
        else:
            followed = network.stations[address].followed == number
            received = energy_ends(network, log, address, number, now)
        missed &= frame.destination != BROADCAST and frame.destination != address
        if noted:
            tell_frame(network, HEARD, address, number, received, 0.0)
        if log is not None and logged:
            mw = network.rows[at].mw
            if mw >= weakest_mw or frame.destination == address:  # most are weaker
                log_reception(network, log, address, number, mw, followed, received, now)
    if log is not None:
        log_transmission(network, log, number, missed)
    if noted:
        tell_frame(network, OVER, NONE, number, frame.whole, 0.0).missed = missed
    forget(network, number)


@njit(cache=True, borrows=True)
def jam_all(network: Network, log: Log | None, powers_mw: Floats, at: Time, now: Time) -> None:
    """Have all stations receive *powers_mw*, shape (n,), of jammers from *at* on."""
    for address in range(len(powers_mw)):
        jam(network, log, address, powers_mw[address], at, now)
