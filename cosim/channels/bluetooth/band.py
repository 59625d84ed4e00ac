"""All connected piconets of a run, advanced together through the slots in which no device has a payload.

A POLL is on the air from its slot's start, and whether the slave has heard it and answers is known only at its end, as
what other piconets send meanwhile may destroy it. So piconets that can disturb each other are advanced in the order of
time: slot starts, ends of POLLs, ends of NULLs. A piconet that is alone on the air has a shortcut (``polling``).

Slots with a payload are not decided here but by the kernel's events (``slots``); their frames are on the same air.
"""

from typing import Final, NamedTuple

import numpy as np

from cosim.arrays import Floats, Int64s
from cosim.channels.bluetooth.bits.errors import ACCESS_CODE, CLEAR_DB
from cosim.channels.bluetooth.hopping import adapted_hop, basic_hop
from cosim.channels.bluetooth.medium import (
    BIT_ERRORS,
    DETECTABLE_DB,
    MET,
    NOT_TUNED,
    OUT_OF_RANGE,
    RECEIVED,
    Foreign,
    Medium,
    Noise,
    broken,
    greatest_interference_mw,
    heard_of,
    is_full,
    judge,
    listens,
    note_begun,
    put,
)
from cosim.channels.bluetooth.packets import HEADER_AIR
from cosim.channels.bluetooth.polling import (
    ALL_SURE,
    DUE,
    FIELDS,
    HEARD_DOWN,
    HEARD_UP,
    HELD,
    HERE,
    IDLE,
    JOINED,
    MASTER,
    MOST_SLAVES,
    NEVER,
    NEXT,
    NULLS,
    PAIR_HERE,
    PAIR_LINK,
    PAIR_TICK,
    PICONET_FIELDS,
    POLLS,
    RUNNING,
    SLAVE,
    STAGE,
    T_POLL,
    USED,
    WORD,
    State,
    first_slot_at,
    next_poll,
    serve,
    skip,
    time_of,
)
from cosim.jit import njit

LOG_FIELDS: Final = 5
"""Columns of the log of idle frames: master, tick, LT_ADDR, whether it went up to the master, its fate."""
LOG_POWERS: Final = 2
"""Columns of powers beside it: that which arrived in dBm, and the greatest interference in mW."""


class Band(NamedTuple):
    """All piconets; row i is the piconet whose master is device i."""

    piconets: Int64s
    """(n, PICONET_FIELDS)."""
    links: Int64s
    """(n, FIELDS, 8)."""
    carriers_dbm: Floats
    """(n, 2): power of the two frames of the idle pair under way at their receivers, as it was at its start."""
    power_dbm: Floats
    """(n, n): that of the medium."""


class Adapted(NamedTuple):
    """The adapted hop sets; where nobody adapts, None as for ``medium.Noise``."""

    used: Int64s
    """(n, 79): the channels of the sets, ascending, even ones first."""
    tallies: Int64s
    """(n, 2, 79): slot pairs that went well, and badly, by channel."""


def new_band(medium: Medium) -> Band:
    """Return a band on *medium* without links."""
    size = len(medium.power_dbm)
    piconets = np.zeros((size, PICONET_FIELDS), dtype=np.int64)
    links = np.zeros((size, FIELDS, MOST_SLAVES + 1), dtype=np.int64)
    return Band(piconets, links, np.zeros((size, 2)), medium.power_dbm)


def new_adapted(size: int) -> Adapted:
    """Return hop sets without channels."""
    return Adapted(np.zeros((size, 79), dtype=np.int64), np.zeros((size, 2, 79), dtype=np.int64))


@njit(cache=True, borrows=True)
def _channel(band: Band, adapted: Adapted | None, p: int, tick: int) -> int:
    """Return the channel on which the piconet of device *p* is at *tick*."""
    piconet = band.piconets[p]
    if adapted is not None:  # noqa: SIM102  # numba leaves out what is behind a plain test for None only
        if piconet[USED]:
            channel: int = adapted_hop(piconet[WORD], tick, adapted.used[p, : piconet[USED]])
            return channel
    hop: int = basic_hop(piconet[WORD], tick)
    return hop


@njit(cache=True, borrows=True)
def _assess(band: Band, adapted: Adapted | None, p: int, well: bool) -> None:
    """Count whether the idle pair under way went well on its channel, if the hop set is adapted."""
    if adapted is None:
        return
    if band.piconets[p, USED]:
        adapted.tallies[p, 0 if well else 1, _channel(band, adapted, p, band.piconets[p, PAIR_TICK])] += 1


@njit(cache=True, borrows=True)
def senders(piconets: Int64s, links: Int64s) -> tuple[int, int]:
    """Return how many piconets send anything, and the master of the only one; -1 if there are others or none.

    An idle pair under way outlives the pause, and the last link, of its piconet: that has ended, but still sends.
    """
    count, master = 0, -1
    for p in range(len(piconets)):
        held = False
        for k in range(1, MOST_SLAVES + 1):
            held |= links[p, HELD, k] != 0
        if held and piconets[p, RUNNING]:
            count, master = count + 1, p
        elif piconets[p, STAGE]:
            count += 1
    return count, master if count == 1 else -1


@njit(cache=True, borrows=True)
def _next_event(piconet: State, links: State) -> int:
    """Return twice the time at which something happens next in a piconet without payloads; plus 1 if a slot begins."""
    if piconet[STAGE]:
        return 2 * (time_of(piconet, piconet[PAIR_TICK] + 2 * (piconet[STAGE] - 1)) + HEADER_AIR)
    if not piconet[RUNNING]:
        return NEVER
    tick, _ = next_poll(piconet, links, links[DUE], piconet[NEXT])
    return NEVER if tick == NEVER else 2 * time_of(piconet, tick) + 1


@njit(cache=True, borrows=True)
def _poll(
    band: Band, medium: Medium | None, noise: Noise | None, foreign: Foreign | None, adapted: Adapted | None, p: int
) -> int:
    """Start the next idle pair; return the fate of its POLL if it is known at once, else RECEIVED.

    Who is alone on the air need not put it there: *medium* is None.
    """
    piconet, links = band.piconets[p], band.links[p]
    tick, k = next_poll(piconet, links, links[DUE], piconet[NEXT])
    master, slave = piconet[MASTER], links[SLAVE, k]
    serve(piconet, links, tick, k)
    piconet[NEXT] = tick + 4
    piconet[IDLE] += 1
    piconet[POLLS] += 1
    here = links[HERE, k] if listens(foreign, slave, time_of(piconet, tick)) else 0
    piconet[PAIR_TICK], piconet[PAIR_LINK], piconet[PAIR_HERE] = tick, k, here
    if medium is not None:
        start = time_of(piconet, tick)
        channel = _channel(band, adapted, p, tick)
        put(medium, master, start, start + HEADER_AIR, channel)
        note_begun(foreign, master, start, channel)
    band.carriers_dbm[p, 0] = band.power_dbm[master, slave]
    band.carriers_dbm[p, 1] = band.power_dbm[slave, master]
    if not heard_of(noise, band.carriers_dbm[p, 0], DETECTABLE_DB):
        _assess(band, adapted, p, False)
        return OUT_OF_RANGE
    piconet[STAGE] = 1
    return RECEIVED


@njit(cache=True, borrows=True)
def _end(
    band: Band,
    medium: Medium | None,
    noise: Noise | None,
    foreign: Foreign | None,
    adapted: Adapted | None,
    p: int,
    assess: bool,
) -> int:
    """End the POLL, or the NULL that goes up, of the idle pair under way in a piconet, and return its fate.

    *medium* is None for who is alone on the air.
    """
    piconet, links = band.piconets[p], band.links[p]
    k, up = piconet[PAIR_LINK], piconet[STAGE] - 1
    tick = piconet[PAIR_TICK] + 2 * up
    start, carrier = time_of(piconet, tick), band.carriers_dbm[p, up]
    source, receiver = piconet[MASTER], links[SLAVE, k]
    if up:
        source, receiver = receiver, source
    if up and not heard_of(noise, carrier, DETECTABLE_DB):
        fate = OUT_OF_RANGE
    elif not (links[HELD, k] if up else links[JOINED, k] and piconet[PAIR_HERE]):
        fate = NOT_TUNED
    elif medium is None:
        lost = broken(noise, source, receiver, start, carrier, 0, False)
        fate = BIT_ERRORS + lost if lost else RECEIVED
    else:
        channel, end = _channel(band, adapted, p, tick), start + HEADER_AIR
        found = judge(medium, noise, foreign, source, receiver, channel, start, end, carrier, 0, False, ACCESS_CODE)
        fate = found & ~MET
    if assess and (up or fate != RECEIVED):
        _assess(band, adapted, p, fate == RECEIVED)
    piconet[STAGE] = 0
    if fate == RECEIVED:
        links[HEARD_UP if up else HEARD_DOWN, k] = start + HEADER_AIR
        if not up:
            piconet[NULLS] += 1
            piconet[STAGE] = 2
            if medium is not None:
                answer, channel = time_of(piconet, tick + 2), _channel(band, adapted, p, tick + 2)
                put(medium, links[SLAVE, k], answer, answer + HEADER_AIR, channel)
                note_begun(foreign, links[SLAVE, k], answer, channel)
    return fate


@njit(cache=True, borrows=True)
def _note(row: Int64s, p: int, piconet: State, up: bool, fate: int) -> None:
    """Note the idle frame of a piconet that has just ended, or has found nobody, in a *row* of the log."""
    row[0], row[1], row[2] = p, piconet[PAIR_TICK] + (2 if up else 0), piconet[PAIR_LINK]
    row[3], row[4] = up, fate


@njit(cache=True, borrows=True)
def _note_powers(
    band: Band, medium: Medium, foreign: Foreign | None, adapted: Adapted | None, row: Int64s, powers: Floats
) -> None:
    """Note what has arrived of the idle frame of a *row* of the log, which has just ended."""
    p, tick, up = row[0], row[1], row[3]
    source, receiver = p, band.links[p, SLAVE, row[2]]
    if up:
        source, receiver = receiver, source
    start = time_of(band.piconets[p], tick)
    powers[0] = band.carriers_dbm[p, up]
    powers[1] = greatest_interference_mw(
        medium, foreign, source, receiver, _channel(band, adapted, p, tick), start, start + HEADER_AIR
    )


@njit(cache=True)
def advance(
    band: Band,
    medium: Medium,
    noise: Noise | None,
    foreign: Foreign | None,
    adapted: Adapted | None,
    until: int,
    last_end: int,
    log: Int64s,
    powers: Floats,
) -> int:
    """Decide all slots that start before *until*, all idle, and end all frames of them that end by *last_end*.

    Rows of *log*, shape (m, LOG_FIELDS), take the idle frames in the order of their ends; with m = 0 none are wanted.
    Rows of *powers*, shape (m, LOG_POWERS) or none if those are not wanted, take what arrived of them.
    Return the number of idle frames; more than m if *log* is too short, in which case the rest is still to be done, as
    it is if *foreign* has no room left for what has begun.
    """
    size = band.piconets.shape[0]
    when = np.empty(size, dtype=np.int64)
    for p in range(size):
        when[p] = _next_event(band.piconets[p], band.links[p])
    count = 0
    while True:
        p = 0
        for other in range(1, size):
            if when[other] < when[p]:
                p = other
        if when[p] > (2 * until - 1 if when[p] & 1 else 2 * last_end):
            break
        if 0 < log.shape[0] <= count:
            return count + 1
        if is_full(foreign):
            return count
        piconet = band.piconets[p]
        up, over = piconet[STAGE] == 2, piconet[STAGE] > 0
        if over:
            fate = _end(band, medium, noise, foreign, adapted, p, True)
        else:
            fate = _poll(band, medium, noise, foreign, adapted, p)
        if log.shape[0] and (over or fate != RECEIVED):
            _note(log[count], p, piconet, up, fate)
            if powers.shape[0]:
                _note_powers(band, medium, foreign, adapted, log[count], powers[count])
            count += 1
        when[p] = _next_event(piconet, band.links[p])
    for p in range(size):
        piconet = band.piconets[p]
        if piconet[RUNNING] and piconet[T_POLL]:
            piconet[NEXT] = max(piconet[NEXT], first_slot_at(piconet, until))
    return count


# ---------------------------------------------------------------- a piconet that is alone on the air


@njit(cache=True, borrows=True)
def _sure(band: Band, noise: Noise | None, p: int) -> int:
    """Return the links whose frames are all received, as bits: up on both sides, and too strong for noise."""
    links, power_dbm = band.links[p], band.power_dbm
    sure = ALL_SURE
    for k in range(1, MOST_SLAVES + 1):
        slave = links[SLAVE, k]
        if links[HELD, k] and not (
            links[JOINED, k]
            and links[HERE, k]
            and heard_of(noise, power_dbm[p, slave], CLEAR_DB)
            and heard_of(noise, power_dbm[slave, p], CLEAR_DB)
        ):
            sure &= ~(1 << k)
    return sure


@njit(cache=True, borrows=True)
def run_alone(
    piconets: Int64s,
    links_of: Int64s,
    carriers_dbm: Floats,
    power_dbm: Floats,
    noise: Noise | None,
    adapted: Adapted | None,
    p: int,
    until: int,
    last_end: int,
    log: Int64s | None,
) -> int:
    """Do what :func:`advance` does for a piconet that alone is on the air: only noise can destroy a frame.

    Where there is no noise, and all links are sure, pairs are not assessed. The fields of the band come one by one: it
    takes Python longer to hand over a tuple than the kernel to do what is mostly due. Without a log it is None.
    """
    band = Band(piconets, links_of, carriers_dbm, power_dbm)
    piconet, links = piconets[p], links_of[p]
    sure, assess = _sure(band, noise, p), False
    if adapted is not None:  # noqa: SIM102
        if piconet[USED] and (sure != ALL_SURE or noise is not None):  # each pair counts
            sure, assess = 0, True
    if log is not None:
        sure = 0  # each pair is a row
    end, count = first_slot_at(piconet, until), 0
    while True:
        if not piconet[STAGE]:  # or else the pair under way has the powers of its start
            skip(piconet, links, end - 4, sure)
        when = _next_event(piconet, links)
        if when > (2 * until - 1 if when & 1 else 2 * last_end):
            break
        if log is not None:  # noqa: SIM102
            if log.shape[0] <= count:
                return count + 1
        up, over = piconet[STAGE] == 2, piconet[STAGE] > 0
        fate = _end(band, None, noise, None, adapted, p, assess) if over else _poll(band, None, noise, None, adapted, p)
        if log is not None:  # noqa: SIM102
            if over or fate != RECEIVED:
                _note(log[count], p, piconet, up, fate)
                count += 1
    piconet[NEXT] = max(piconet[NEXT], end)
    return count


@njit(cache=True)
def polls_at(piconets: Int64s, links_of: Int64s, time: int, found: Int64s) -> int:
    """Write (master, LT_ADDR) of the idle pairs that are to begin at *time* to *found*, (n, 2); return how many."""
    count = 0
    for p in range(len(piconets)):
        piconet = piconets[p]
        if piconet[RUNNING] and not piconet[STAGE]:
            tick, k = next_poll(piconet, links_of[p], links_of[p][DUE], piconet[NEXT])
            if tick != NEVER and time_of(piconet, tick) == time:
                found[count, 0], found[count, 1] = p, k
                count += 1
    return count


@njit(cache=True)
def next_start(piconets: Int64s, links_of: Int64s) -> int:
    """Return the instant before which no idle frame begins that has not been put on the air, or NEVER.

    What has not begun yet may come later than that, or not at all.
    """
    found = NEVER
    for p in range(len(piconets)):
        piconet = piconets[p]
        if piconet[STAGE] == 1:
            found = min(found, time_of(piconet, piconet[PAIR_TICK] + 2))
        elif piconet[STAGE] == 2:
            found = min(found, time_of(piconet, piconet[PAIR_TICK] + 2) + HEADER_AIR)
        elif piconet[RUNNING]:
            tick, _ = next_poll(piconet, links_of[p], links_of[p][DUE], piconet[NEXT])
            if tick != NEVER:
                found = min(found, time_of(piconet, tick))
    return found
