"""The slots of a connected piconet as arithmetic: which link is polled when, and its sequence bits.

The state of one piconet is two int64 arrays: ``piconet`` (one row: ``NEXT``, ``T_POLL``...) and ``links``, shape
(FIELDS, 8), column k being the link with LT_ADDR k, and column 0 the master's own presence. Time is in the master's
ticks; a TX slot is a tick that 4 divides. ``NEXT`` is the first TX slot that is not decided yet.

As long as no device has a payload, the schedule is a pure recurrence, whatever is lost: of the held links the one of
the smallest (c, due, k) is polled, c being the first free TX slot at which it is due and both sides are present;
``due`` becomes c + T_POLL and the next TX slot is c + 4. So an idle hour is a loop over arrays, run when its result is
needed.

That is the scheduler "lazy". The others use every free TX slot: where nothing is due, they choose a link by what waits
on either side of it, and the smallest due, which is that of the link served the longest ago, breaks ties. With nothing
waiting they are all the same recurrence.

Presence: a device that divides its time among piconets is there in *count* slots of every *period*, counted on a clock
of reference that all of them know. Others are always there, or, during a procedure, never. A link in sniff mode is
there in a part of the time that is counted on the master's own clock, one in hold mode from a tick of it on.
"""

from typing import Any, Final, TypeAlias

import numpy as np

from cosim.channels.bluetooth.packets import HEADER_AIR
from cosim.channels.clock import start_of, tick_at
from cosim.jit import njit
from cosim.units import Time

State: TypeAlias = np.ndarray[Any, np.dtype[np.int64]]

# piconet[...]
NEXT: Final = 0  # first TX slot that is not decided yet
T_POLL: Final = 1  # ticks from a poll until the next is due
PHASE: Final = 2  # the master's native clock
PPM: Final = 3
IDLE: Final = 4  # polls of links on which neither side had a payload
NULLS: Final = 5  # NULL packets sent
POLLS: Final = 6  # POLL packets sent
MASTER: Final = 7  # the master's address
WORD: Final = 8  # the master's UAP/LAP, from which the hop sequence is drawn
RUNNING: Final = 9  # not suspended
LONGEST: Final = 10  # slots of the longest packet type in use
SHARED: Final = 11  # 1 if a device divides its time, or is away, or links may be stopped (FLOW)
STAGE: Final = 12  # of the idle pair under way: 0 none, 1 POLL, 2 NULL on the air
PAIR_TICK: Final = 13
PAIR_LINK: Final = 14
PAIR_HERE: Final = 15  # its slave was there at its start
USED: Final = 16  # number of channels in the adapted hop set; 0: the basic sequence
SCHEDULER: Final = 17  # LAZY, ROUND_ROBIN, EXHAUSTIVE or BACKLOG
CURRENT: Final = 18  # the link that had the last turn
BEACON: Final = 19  # first TX slot of the next beacon for parked slaves; NEVER without any
PICONET_FIELDS: Final = 20

LAZY: Final = 0
ROUND_ROBIN: Final = 1
EXHAUSTIVE: Final = 2
BACKLOG: Final = 3

# links[..., k]
HELD: Final = 0  # the master's side of the link is up
JOINED: Final = 1  # the slave's side is up
DUE: Final = 2  # tick by which the master must address the slave
SLAVE: Final = 3  # the slave's address
QUEUED: Final = 4  # payloads at the slave's controller
SEQ_DOWN: Final = 5  # SEQN of the master's current payload
SEEN_DOWN: Final = 6  # SEQN of the last payload that the slave took
SEQ_UP: Final = 7
SEEN_UP: Final = 8
ARQN: Final = 9  # acknowledgement of the slave's last answer in the master's next packet
HEARD_DOWN: Final = 10  # end (ns) of the last frame that the slave heard
HEARD_UP: Final = 11  # end (ns) of the last frame that the master heard
HERE: Final = 12  # the device is there, at least in its part
PERIOD: Final = 13  # ticks; 0: in all slots
FIRST: Final = 14  # first tick of its part
COUNT: Final = 15  # ticks of its part
CLOCK_PHASE: Final = 16  # the clock that these are counted on
CLOCK_PPM: Final = 17
WAITING: Final = 18  # payloads for it in the master's queue that no broadcast stands before; not counted by LAZY
SNIFF_PERIOD: Final = 19  # ticks of the master; 0: in all slots. In column 0: when broadcasts may be sent
SNIFF_FIRST: Final = 20
SNIFF_COUNT: Final = 21  # ticks in which a packet to it may begin
HELD_UNTIL: Final = 22  # tick before which a link on hold is silent
STOPPED: Final = 23  # the slave's last answer said STOP (FLOW = 0)
FULL_UNTIL: Final = 24  # instant (ns) until which the slave's answers say STOP
FIELDS: Final = 25

MOST_SLAVES: Final = 7
NOTHING: Final = -1
EVERYONE: Final = 0  # LT_ADDR of a broadcast
NEVER: Final = 1 << 62

ALL_SURE: Final = (2 << MOST_SLAVES) - 1
"""Bits of all links."""
_LOOK_AGAIN: Final = 16  # polls until the next check whether the schedule repeats itself
_LAPS: Final = 64  # tries to find a slot at which two devices are present, until they are taken never to meet


def reset(piconet: State, links: State, t_poll_slots: int, phase: Time, ppm: int, longest: int) -> None:
    """Make the arrays those of a piconet without links whose master is always there."""
    piconet[:], links[:] = 0, 0
    piconet[T_POLL], piconet[PHASE], piconet[PPM] = 2 * t_poll_slots, phase, ppm
    piconet[RUNNING], piconet[LONGEST], piconet[BEACON] = 1, longest, NEVER
    links[HERE, 0] = 1


@njit(cache=True, borrows=True)
def time_of(piconet: State, tick: int) -> int:
    """Return the instant at which *tick* of the master's clock begins."""
    time: int = start_of(piconet[PHASE], piconet[PPM], tick)
    return time


@njit(cache=True, borrows=True)
def first_slot_at(piconet: State, time: int) -> int:
    """Return the first TX slot that begins at or after *time*."""
    tick: int = tick_at(piconet[PHASE], piconet[PPM], time - 1)
    return (tick + 4) // 4 * 4


@njit(cache=True, borrows=True)
def _opening(links: State, k: int, time: int, need: int) -> int:
    """Return *time* if the device of column *k* is there for *need* ticks from then, else when it is next, or NEVER.

    A master knows the parts of the time of its slaves, but not whether one is away for another reason.
    """
    if k == EVERYONE and not links[HERE, k]:
        return NEVER
    period = links[PERIOD, k]
    if period == 0:
        return time
    if need > links[COUNT, k]:
        return NEVER
    phase, ppm = links[CLOCK_PHASE, k], links[CLOCK_PPM, k]
    tick = tick_at(phase, ppm, time)
    into = (tick - links[FIRST, k]) % period
    if into + need <= links[COUNT, k]:
        return time
    opening: int = start_of(phase, ppm, tick - into + period)
    return opening


@njit(cache=True, borrows=True)
def _anchor(links: State, k: int, tick: int) -> int:
    """Return the first tick from *tick* on at which the mode of link *k* lets a packet begin."""
    tick = max(tick, links[HELD_UNTIL, k])
    period = links[SNIFF_PERIOD, k]
    if period:
        into = (tick - links[SNIFF_FIRST, k]) % period
        if into >= links[SNIFF_COUNT, k]:
            tick += period - into
    first: int = -(-tick // 4) * 4
    return first


@njit(cache=True, borrows=True)
def open_slot(piconet: State, links: State, k: int, tick: int, slots: int) -> int:
    """Return the first TX slot from *tick* on for a packet of *slots* to link *k*, or to all (0), or NEVER.

    The master, and for a link its slave, must be there for that packet and the longest possible answer.
    """
    tick = -(-tick // 4) * 4
    if not piconet[SHARED]:
        return tick
    need = 2 * (slots + piconet[LONGEST])
    for _ in range(_LAPS):
        time = time_of(piconet, tick)
        later = _opening(links, 0, time, need)
        if k != EVERYONE and later != NEVER:
            later = max(later, _opening(links, k, time, need))
        if later == NEVER:
            return NEVER
        anchor = _anchor(links, k, tick)
        if later == time and anchor == tick:
            return tick
        tick = anchor if later == time else max(anchor, first_slot_at(piconet, later))
    return NEVER


@njit(cache=True, borrows=True)
def _next_due(piconet: State, links: State, due: State, tick: int) -> tuple[int, int]:
    """Return (TX slot, link) of the next poll from *tick* on that is due: (NEVER, 0) without links."""
    best, when = 0, NEVER
    if not piconet[SHARED]:  # all that are overdue can be polled at once
        for k in range(1, MOST_SLAVES + 1):
            if links[HELD, k] and (best == 0 or due[k] < due[best]):
                best = k
        return (max(tick, -(-due[best] // 4) * 4), best) if best else (NEVER, 0)
    for k in range(1, MOST_SLAVES + 1):
        if links[HELD, k]:
            slot = open_slot(piconet, links, k, max(tick, due[k]), 1)
            if slot < when or (slot == when and slot != NEVER and due[k] < due[best]):
                best, when = k, slot
    return when, best


@njit(cache=True, borrows=True)
def next_poll(piconet: State, links: State, due: State, tick: int) -> tuple[int, int]:
    """Return (TX slot, link) of the next pair from *tick* on, without LAZY's payloads; (NEVER, 0) without links.

    What is due goes first; other schedulers than LAZY use the slots before as well.
    """
    due_when, due_link = _next_due(piconet, links, due, tick)
    if piconet[SCHEDULER] == LAZY:
        return due_when, due_link
    best, when, most = 0, NEVER, 0
    for k in range(1, MOST_SLAVES + 1):
        if links[HELD, k]:
            slot = open_slot(piconet, links, k, tick, 1)
            # how much the scheduler prefers it, by the payloads that wait on either side
            weight = links[WAITING, k] + links[QUEUED, k]
            if piconet[SCHEDULER] != BACKLOG:
                weight = 1 if piconet[SCHEDULER] == EXHAUSTIVE and k == piconet[CURRENT] and weight else 0
            first = slot == when and (weight > most or (weight == most and due[k] < due[best]))
            if slot < when or (first and slot != NEVER):
                best, when, most = k, slot, weight
    return (due_when, due_link) if due_when <= when else (when, best)


@njit(cache=True, borrows=True)
def serve(piconet: State, links: State, tick: int, k: int) -> None:
    """Note that link *k* is addressed at *tick*."""
    if links[DUE, k] > tick:  # or else it has interrupted the turn of another
        piconet[CURRENT] = k
    links[DUE, k] = tick + piconet[T_POLL]


@njit(cache=True, borrows=True)
def _skip_periods(piconet: State, links: State, end: int) -> int:
    """Decide as many whole periods as end before *end*, and return the links polled, as bits.

    There are none unless the idle schedule repeats itself every T_POLL: each link is polled when it is due, and no two
    are due at once.
    """
    if piconet[SHARED] or piconet[SCHEDULER] != LAZY:
        return 0
    first, last, held, bits = NEVER, 0, 0, 0
    for k in range(1, MOST_SLAVES + 1):
        if links[HELD, k]:
            due = links[DUE, k]
            if due % 4 or due < piconet[NEXT]:
                return 0
            for other in range(1, k):
                if links[HELD, other] and links[DUE, other] == due:
                    return 0
            first, last, held, bits = min(first, due), max(last, due), held + 1, bits | 1 << k
    if not held or last - first >= piconet[T_POLL] or last >= end:
        return 0
    periods = (end - 1 - last) // piconet[T_POLL] + 1
    for k in range(1, MOST_SLAVES + 1):
        if links[HELD, k]:
            links[DUE, k] += periods * piconet[T_POLL]
    piconet[NEXT] = last + (periods - 1) * piconet[T_POLL] + 4
    piconet[IDLE] += periods * held
    piconet[POLLS] += periods * held
    piconet[NULLS] += periods * held
    return bits


@njit(cache=True, borrows=True)
def skip(piconet: State, links: State, end: int, sure: int) -> None:
    """Decide TX slots before *end* (a TX slot), all of them idle, up to the first poll of a link that is not *sure*.

    Bit k of *sure* is set if all frames of link k are received, and those of all links without one.
    """
    polled, count = 0, 0
    tick, k = next_poll(piconet, links, links[DUE], piconet[NEXT])
    while tick < end and sure >> k & 1:
        if count % _LOOK_AGAIN == 0 and sure == ALL_SURE:
            polled |= _skip_periods(piconet, links, end)
            tick, k = next_poll(piconet, links, links[DUE], piconet[NEXT])
            if tick >= end:
                break
        count += 1
        polled |= 1 << k
        serve(piconet, links, tick, k)
        piconet[NEXT] = tick + 4
        tick, k = next_poll(piconet, links, links[DUE], piconet[NEXT])
    for k in range(1, MOST_SLAVES + 1):
        if polled >> k & 1:
            last = links[DUE, k] - piconet[T_POLL]
            links[HEARD_DOWN, k] = time_of(piconet, last) + HEADER_AIR
            links[HEARD_UP, k] = time_of(piconet, last + 2) + HEADER_AIR
    piconet[IDLE] += count
    piconet[POLLS] += count
    piconet[NULLS] += count
    if tick >= end:
        piconet[NEXT] = max(piconet[NEXT], end)


@njit(cache=True)
def next_free(piconet: State, links: State, wanted: int) -> int:
    """Return the first TX slot that no link without payloads needs; *wanted* is the LT_ADDR of the master's payload."""
    tick: int = piconet[NEXT]
    due = links[DUE].copy()
    while True:
        slot, k = next_poll(piconet, links, due, tick)
        if slot > tick or k == wanted or links[QUEUED, k]:
            return tick
        due[k] = tick + piconet[T_POLL]
        tick += 4


@njit(cache=True)
def next_served(piconet: State, links: State) -> int:
    """Return the tick at which the idle schedule comes to a link with a payload or a change of FLOW, or NOTHING.

    Payloads of the master count with schedulers that send them at their link's turn only.
    """
    waiting, full_until = 0, 0
    for k in range(1, MOST_SLAVES + 1):
        waiting |= links[HELD, k] * (links[QUEUED, k] + links[WAITING, k] + links[STOPPED, k])
        full_until = max(full_until, links[HELD, k] * links[FULL_UNTIL, k])
    if not waiting and full_until <= time_of(piconet, piconet[NEXT]):
        return NOTHING
    due = links[DUE].copy()
    tick = piconet[NEXT]
    for _ in range(1 << 16):
        tick, k = next_poll(piconet, links, due, tick)
        if tick == NEVER:
            break
        time = time_of(piconet, tick)
        if links[QUEUED, k] or links[WAITING, k] or links[STOPPED, k] or time < links[FULL_UNTIL, k]:
            return tick
        if not waiting and time >= full_until:
            break
        due[k] = tick + piconet[T_POLL]
        tick += 4
    return NOTHING


@njit(cache=True)
def next_turn(piconet: State, links: State, wanted: int, until: int) -> int:
    """Return the tick at which the idle schedule comes to link *wanted* next, if that is before *until*, or NOTHING."""
    due = links[DUE].copy()
    tick = piconet[NEXT]
    for _ in range(1 << 16):
        tick, k = next_poll(piconet, links, due, tick)
        if tick == NEVER or time_of(piconet, tick) >= until:
            break
        if k == wanted:
            return tick
        due[k] = tick + piconet[T_POLL]
        tick += 4
    return NOTHING


@njit(cache=True, borrows=True)
def overdue(piconet: State, links: State, tick: int) -> int:
    """Return the link that must be addressed at *tick*, or NOTHING."""
    slot, k = _next_due(piconet, links, links[DUE], tick)
    return k if slot == tick else NOTHING


def turn(piconet: State, links: State, tick: int) -> int:
    """Return the link that is addressed at *tick* if nothing is broadcast then, or NOTHING; not for LAZY."""
    slot, k = next_poll(piconet, links, links[DUE], tick)
    return k if slot == tick else NOTHING


def last_heard(links: State) -> int:
    """Return the earliest of all "last heard" instants of sides that are up, or NOTHING."""
    sides = [
        int(links[heard, k])
        for k in range(1, MOST_SLAVES + 1)
        for up, heard in ((HELD, HEARD_UP), (JOINED, HEARD_DOWN))
        if links[up, k]
    ]
    return min(sides, default=NOTHING)


# ---------------------------------------------------------------- slots with a payload


@njit(cache=True, borrows=True)
def begin_pair(piconet: State, links: State, tick: int, k: int, first: bool, data: bool, slots: int) -> bool:
    """Send the master's packet of a pair with link *k*, whether with *data*, and *first* if that is new.

    Return whether it acknowledges the slave's last payload (ARQN = 1). The next slot follows a missing answer.
    """
    serve(piconet, links, tick, k)
    if not data:
        piconet[POLLS] += 1
        piconet[IDLE] += links[QUEUED, k] == 0
    if first:
        links[SEQ_DOWN, k] ^= 1
    acknowledged = bool(links[ARQN, k])
    links[ARQN, k] = 0
    piconet[NEXT] = tick + 2 * slots + 2
    return acknowledged


@njit(cache=True, borrows=True)
def answer_pair(piconet: State, links: State, tick: int, k: int, first: bool, data: bool, slots: int) -> None:
    """Send the slave's packet at *tick*."""
    if first:
        links[SEQ_UP, k] ^= 1
    piconet[NULLS] += not data
    piconet[NEXT] = tick + 2 * slots


@njit(cache=True, borrows=True)
def take_down_link(links: State, k: int) -> bool:
    """Let the slave take the master's payload; return whether it is new (its SEQN differs from the last one's)."""
    new = bool(links[SEEN_DOWN, k] != links[SEQ_DOWN, k])
    links[SEEN_DOWN, k] = links[SEQ_DOWN, k]
    return new


@njit(cache=True, borrows=True)
def take_up_link(links: State, k: int) -> bool:
    """Let the master take the slave's payload, which its next packet acknowledges; return whether it is new."""
    new = bool(links[SEEN_UP, k] != links[SEQ_UP, k])
    links[SEEN_UP, k] = links[SEQ_UP, k]
    links[ARQN, k] = 1
    return new
