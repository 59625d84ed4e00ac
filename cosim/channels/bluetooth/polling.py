"""The slots of a connected piconet as arithmetic: which link is polled when, and what its sequence bits say.

The state of one piconet is two int64 arrays: ``piconet`` (one row: ``NEXT``, ``T_POLL``...) and ``links``, shape
(FIELDS, 8), column k being the link with LT_ADDR k (column 0 is not used). Time is in the master's ticks; a TX slot
is a tick that 4 divides. ``NEXT`` is the first TX slot about which nothing has been decided yet.

As long as nobody has a payload, the schedule is a pure recurrence: at the first free TX slot c with a link due, the
link of the smallest (due, k) is polled, ``due`` becomes c + T_POLL and the next TX slot is c + 4, whether or not the
slave hears or is heard. So an idle hour is a loop over arrays, run when somebody wants to know.
"""

from typing import Any, Final, TypeAlias

import numpy as np

from cosim.channels.bluetooth.packets import HEADER_AIR
from cosim.jit import njit
from cosim.units import TICK, Time

State: TypeAlias = np.ndarray[Any, np.dtype[np.int64]]

# piconet[...]
NEXT: Final = 0  # first TX slot that is not decided yet
T_POLL: Final = 1  # ticks from a poll until the next is due
PHASE: Final = 2  # the master's native clock
PPM: Final = 3
IDLE: Final = 4  # polls of links on which neither side had a payload
NULLS: Final = 5  # NULL packets sent
POLLS: Final = 6  # POLL packets sent
PICONET_FIELDS: Final = 7

# links[..., k]
HELD: Final = 0  # the master's side of the link is up
JOINED: Final = 1  # the slave's side is up
DUE: Final = 2  # tick by which the master must address the slave
DOWN: Final = 3  # the slave is in reach of the master
UP: Final = 4  # the master is in reach of the slave
QUEUED: Final = 5  # payloads at the slave's controller
SEQ_DOWN: Final = 6  # SEQN of the master's current payload
SEEN_DOWN: Final = 7  # SEQN of the last payload that the slave took
SEQ_UP: Final = 8
SEEN_UP: Final = 9
ARQN: Final = 10  # what the master's next packet says of the slave's last answer
HEARD_DOWN: Final = 11  # end (ns) of the last frame that the slave received
HEARD_UP: Final = 12  # end (ns) of the last frame that the master received
FIELDS: Final = 13

MOST_SLAVES: Final = 7
NOTHING: Final = -1
EVERYONE: Final = 0  # LT_ADDR of a broadcast

# what became of one packet of a transaction
HEARD: Final = 1
FRESH: Final = 2  # it brought a payload that was not there yet
ACKED: Final = 4  # it acknowledged the receiver's own payload

MILLION: Final = 1_000_000
NO_LOG: Final[State] = np.empty((0, 2), dtype=np.int64)


def new_state(t_poll_slots: int, phase: Time, ppm: int) -> tuple[State, State]:
    """Return the arrays (piconet, links) of a piconet without links."""
    piconet = np.zeros(PICONET_FIELDS, dtype=np.int64)
    piconet[T_POLL], piconet[PHASE], piconet[PPM] = 2 * t_poll_slots, phase, ppm
    return piconet, np.zeros((FIELDS, MOST_SLAVES + 1), dtype=np.int64)


@njit(cache=True)
def time_of(piconet: State, tick: int) -> int:
    """Return the instant at which *tick* begins, as ``NativeClock.time_of``, but safe in 64 bits for years."""
    elapsed = tick * TICK - piconet[PHASE]
    rate = MILLION + piconet[PPM]
    whole = elapsed // rate
    time: int = whole * MILLION - (-(elapsed - whole * rate) * MILLION // rate)
    return time


@njit(cache=True)
def _soonest(links: State, due: State) -> int:
    """Return the held link with the smallest (due, k), or 0 without links."""
    best = 0
    for k in range(1, MOST_SLAVES + 1):
        if links[HELD, k] and (best == 0 or due[k] < due[best]):
            best = k
    return best


@njit(cache=True)
def _first_slot(next_slot: int, due: int) -> int:
    return max(next_slot, -(-due // 4) * 4)


@njit(cache=True)
def advance(piconet: State, links: State, end: int, log: State) -> int:
    """Decide all TX slots before *end* (a TX slot), all of them idle; return the number of polls.

    *log*, shape (n, 2), takes (tick, k) of the first n polls.
    """
    polled = 0
    count = 0
    while True:
        k = _soonest(links, links[DUE])
        tick = _first_slot(piconet[NEXT], links[DUE, k])
        if k == 0 or tick >= end:
            break
        if count < len(log):
            log[count, 0], log[count, 1] = tick, k
        count += 1
        polled |= 1 << k
        links[DUE, k] = tick + piconet[T_POLL]
        piconet[NULLS] += links[DOWN, k] & links[JOINED, k]
        piconet[NEXT] = tick + 4
    for k in range(1, MOST_SLAVES + 1):
        if polled >> k & 1 and links[DOWN, k] and links[JOINED, k]:  # reach does not change within one call
            tick = links[DUE, k] - piconet[T_POLL]
            links[HEARD_DOWN, k] = time_of(piconet, tick) + HEADER_AIR
            if links[UP, k]:
                links[HEARD_UP, k] = time_of(piconet, tick + 2) + HEADER_AIR
    piconet[IDLE] += count
    piconet[POLLS] += count
    piconet[NEXT] = max(piconet[NEXT], end)
    return count


@njit(cache=True)
def next_served(piconet: State, links: State) -> int:
    """Return the tick at which the idle schedule comes to a slave that has a payload, or NOTHING."""
    waiting = 0
    for k in range(1, MOST_SLAVES + 1):
        waiting |= links[HELD, k] * links[QUEUED, k]
    if not waiting:
        return NOTHING
    due = links[DUE].copy()
    tick = piconet[NEXT]
    while True:
        k = _soonest(links, due)
        tick = _first_slot(tick, due[k])
        if links[QUEUED, k]:
            return tick
        due[k] = tick + piconet[T_POLL]
        tick += 4


@njit(cache=True)
def overdue(links: State, tick: int) -> int:
    """Return the link that must be addressed at *tick*, or NOTHING."""
    k = _soonest(links, links[DUE])
    return k if k and links[DUE, k] <= tick else NOTHING


@njit(cache=True)
def decide(piconet: State, links: State, tick: int, head: int) -> int:
    """Advance to the TX slot *tick* and return what is sent in it: a link, EVERYONE, or NOTHING.

    *head* is the LT_ADDR of the head of the master's queue, EVERYONE, or NOTHING.
    """
    advance(piconet, links, tick, np.empty((0, 2), dtype=np.int64))
    if piconet[NEXT] > tick:
        return NOTHING
    k = overdue(links, tick)
    return head if k == NOTHING else k


@njit(cache=True)
def ask(piconet: State, links: State, tick: int, k: int, first: bool, data: bool, slots: int, air: int) -> int:
    """Send the master's packet of a transaction with *k*; return HEARD, FRESH and ACKED as the slave sees them.

    *data*: it carries a payload, *first* that it has not been on the air before. Without HEARD the pair is over.
    """
    links[DUE, k] = tick + piconet[T_POLL]
    if not data:
        piconet[POLLS] += 1
        piconet[IDLE] += links[QUEUED, k] == 0
    if first:
        links[SEQ_DOWN, k] ^= 1
    acknowledged = links[ARQN, k]
    links[ARQN, k] = 0
    piconet[NEXT] = tick + 2 * slots + 2
    if not (links[DOWN, k] and links[JOINED, k]):
        return 0
    links[HEARD_DOWN, k] = time_of(piconet, tick) + air
    result = HEARD
    if data and links[SEEN_DOWN, k] != links[SEQ_DOWN, k]:
        links[SEEN_DOWN, k] = links[SEQ_DOWN, k]
        result |= FRESH
    if acknowledged:
        result |= ACKED
    return result


@njit(cache=True)
def reply(piconet: State, links: State, tick: int, k: int, first: bool, data: bool, slots: int, air: int) -> int:
    """Send the slave's packet, at *tick*; return HEARD and FRESH as the master sees them (its ARQN is always right)."""
    if first:
        links[SEQ_UP, k] ^= 1
    piconet[NULLS] += not data
    piconet[NEXT] = tick + 2 * slots
    if not links[UP, k]:
        return 0
    links[HEARD_UP, k] = time_of(piconet, tick) + air
    if not data:
        return HEARD
    links[ARQN, k] = 1
    if links[SEEN_UP, k] == links[SEQ_UP, k]:
        return HEARD
    links[SEEN_UP, k] = links[SEQ_UP, k]
    return HEARD | FRESH


@njit(cache=True)
def broadcast(piconet: State, links: State, tick: int, slots: int, air: int) -> int:
    """Send a packet to everyone; return the set of LT_ADDR that hear it, as bits."""
    piconet[NEXT] = tick + 2 * slots + 2
    end = time_of(piconet, tick) + air
    heard = 0
    for k in range(1, MOST_SLAVES + 1):
        if links[DOWN, k] and links[JOINED, k]:
            links[HEARD_DOWN, k] = end
            heard |= 1 << k
    return heard


@njit(cache=True)
def last_heard(links: State) -> int:
    """Return the earliest of all "last heard" instants of sides that are up, or NOTHING."""
    earliest = NOTHING
    for k in range(1, MOST_SLAVES + 1):
        for up, heard in ((HELD, HEARD_UP), (JOINED, HEARD_DOWN)):
            if links[up, k] and (earliest == NOTHING or links[heard, k] < earliest):
                earliest = links[heard, k]
    return earliest
