"""What the stations of one 802.11 channel keep for tables: what each of them waits for, and what becomes of frames.

Rows go to three arrays, from which Python takes them by the thousand. Where one has no room, nothing is kept there. If
nothing is to be kept at all, there is no log, and kernels are compiled without all that. Nothing of it changes what a
station does.
"""

import math
from typing import Final

import cosim.elementary as elementary
from cosim.channels.adhoc.mac import CTS
from cosim.channels.adhoc.state import NEVER, NONE, Log, Network
from cosim.jit import njit
from cosim.machine import BROADCAST
from cosim.units import Time

DIFS: Final = 0
"""An interframe space before a frame, or before a back-off counts."""
EIFS: Final = 1
"""The longer one, after a frame with errors."""
BACKING_OFF: Final = 2
"""A back-off counts."""
AWAITS_CTS: Final = 3
AWAITS_ACK: Final = 4
STATES: Final = ("difs", "eifs", "backoff", "awaits_cts", "awaits_ack")
"""Names of the states, by number."""

RECEIVED: Final = 0
COLLIDED: Final = 1
OUT_OF_RANGE: Final = 2
OUTCOMES: Final = ("received", "collided", "out_of_range")
"""Names of what becomes of frames, by number."""

EACH: Final = 3
"""Number of intervals that end with one event for each station, at most; and so many"""
MORE: Final = 4
"""more for that whose event it is."""

SLOT_BITS: Final = 21
"""Number of bits for the slots of a back-off; greater numbers than they hold are kept as the greatest."""
MOST_SLOTS: Final = (1 << SLOT_BITS) - 1


@njit(cache=True, borrows=True)
def has_log_room(network: Network, log: Log) -> bool:
    """Return whether there is room for what the next event may bring, or none at all as nothing is to be kept."""
    common, size = network.common[0], len(network.stations)
    intervals, transmissions, receptions = (
        len(log.intervals),
        len(log.transmissions),
        len(log.receptions),
    )
    return bool(
        (intervals == 0 or common.intervals + EACH * size + MORE <= intervals)
        and (transmissions == 0 or common.transmissions < transmissions)
        and (receptions == 0 or common.receptions + size + 1 <= receptions)
    )


# ---------------------------------------------------------------- intervals


@njit(cache=True, borrows=True)
def packed_slots(left: int, drawn: int, window: int) -> int:
    """Return the slots of a back-off in one number: those *left*, those *drawn*, and the *window* they are from."""
    return (min(left, MOST_SLOTS) << 2 * SLOT_BITS) | (min(drawn, MOST_SLOTS) << SLOT_BITS) | min(window, MOST_SLOTS)


def unpacked_slots(packed: int) -> tuple[int, int, int]:
    """Return the three numbers that ``packed_slots`` has packed."""
    return packed >> 2 * SLOT_BITS, packed >> SLOT_BITS & MOST_SLOTS, packed & MOST_SLOTS


@njit(cache=True, borrows=True)
def _log(network: Network, log: Log, address: int, state: int, begin: Time, end: Time) -> None:
    """Keep an interval; one without length is none."""
    if end <= begin:
        return
    common, station = network.common[0], network.stations[address]
    row = log.intervals[common.intervals]
    common.intervals += 1
    row.begin, row.station, row.end, row.state = begin, address, end, state
    row.slots = 0
    if state == BACKING_OFF:
        row.slots = packed_slots(station.slots, station.drawn_slots, station.drawn_window)


@njit(cache=True, borrows=True)
def note_waiting(network: Network, log: Log, address: int, now: Time) -> None:
    """Note from when on a station waits for an interframe space, which it begins to do *now*, or when it may."""
    if len(log.intervals) > 0:
        station = network.stations[address]
        station.waits_from = max(
            now, station.idle_from, station.reserved_until, station.refused_until, station.logged_to
        )


@njit(cache=True, borrows=True)
def log_access(network: Network, log: Log, address: int, until: Time) -> None:
    """Keep the space and the back-off for which a station has waited *until* then, if it does."""
    station = network.stations[address]
    if len(log.intervals) > 0 and station.ends != NEVER:
        counts_from = station.counted_from if station.pending else station.ends
        _log_space(network, log, address, min(until, counts_from))
        if station.pending:
            _log(network, log, address, BACKING_OFF, counts_from, until)
        station.logged_to = until


@njit(cache=True, borrows=True)
def log_unsensed(network: Network, log: Log, address: int, now: Time) -> None:
    """Keep the space for which a station waits from *now* on, until it senses the energy that is there already."""
    if len(log.intervals) > 0:
        note_waiting(network, log, address, now)
        station = network.stations[address]
        until = station.energy_from + network.common[0].cca
        if station.act >= now:  # it answers first
            until = min(until, station.act)
        _log_space(network, log, address, until)
        station.logged_to = max(station.logged_to, until)


@njit(cache=True, borrows=True)
def _log_space(network: Network, log: Log, address: int, until: Time) -> None:
    common, station = network.common[0], network.stations[address]
    state = EIFS if station.erred and common.eifs != common.difs else DIFS
    _log(network, log, address, state, station.waits_from, until)


@njit(cache=True, borrows=True)
def log_response(network: Network, log: Log, address: int, now: Time) -> None:
    """Keep the wait for a response, if there is one, which is over *now*."""
    station = network.stations[address]
    if len(log.intervals) > 0 and station.awaits != NONE:
        _log(network, log, address, AWAITS_CTS if station.awaits == CTS else AWAITS_ACK, station.awaits_from, now)


@njit(cache=True, borrows=True)
def log_under_way(network: Network, log: Log, now: Time) -> None:
    """Keep what all stations are waiting for as if it were over *now*."""
    for address in range(len(network.stations)):
        log_access(network, log, address, now)
        log_response(network, log, address, now)


# ---------------------------------------------------------------- frames


@njit(cache=True, borrows=True)
def log_transmission(network: Network, log: Log, number: int, missed: bool) -> None:
    """Keep frame *number*, which has arrived to its end everywhere, and that it has *missed* whom it was for if so."""
    common, frame = network.common[0], network.frames[number]
    if missed and frame.destination != BROADCAST and len(log.receptions) > 0:
        _log_missed(network, log, number)
    if len(log.transmissions) == 0:
        return
    row = log.transmissions[common.transmissions]
    common.transmissions += 1
    row.begin, row.source, row.kind, row.destination = frame.begin, frame.source, frame.kind, frame.destination
    row.reserves, row.number, row.duration, row.whole = frame.reserves, frame.number, frame.form.duration, frame.whole
    row.packet, row.again = frame.packet, False
    if frame.packet != NONE:
        packet = network.packets[frame.packet]
        row.again = packet.short + packet.long > 0  # a CTS has put failures of RTS back to 0


@njit(cache=True, borrows=True)
def log_reception(
    network: Network, log: Log, address: int, number: int, mw: float, followed: bool, received: bool, now: Time
) -> None:
    """Keep what has become of frame *number*, which ends *now*, at a station, if it was for that one or has mattered.

    It has if it was strong enough to be noticed as a frame, which one for all must be; or more than noise while a frame
    for that station was there, and that one has been lost, or is not over.
    """
    common, station, frame = network.common[0], network.stations[address], network.frames[number]
    if mw < common.follows_mw and frame.destination != address:
        if mw < common.noise_mw or not _disturbs(network, address, number, now):
            return
    elif followed and not received and frame.destination in (BROADCAST, address):
        station.lost_at = now
    row = log.receptions[common.receptions]
    common.receptions += 1
    row.begin, row.source, row.receiver = frame.begin, frame.source, address
    row.outcome = RECEIVED if received else COLLIDED
    row.power_dbm = row.sinr_db = math.nan
    if common.fades:
        row.power_dbm = 10.0 * elementary.log10(mw)
        if followed:
            row.sinr_db = 10.0 * elementary.log10(station.least_level)


@njit(cache=True, borrows=True)
def _disturbs(network: Network, address: int, number: int, now: Time) -> bool:
    station = network.stations[address]
    if station.followed != NONE:
        destination = network.frames[station.followed].destination
        if destination in (BROADCAST, address):
            return True
    return bool(station.lost_at > now - network.frames[number].form.duration)


@njit(cache=True, borrows=True)
def _log_missed(network: Network, log: Log, number: int) -> None:
    """Keep that frame *number* has not reached the station that it was meant for."""
    common, frame = network.common[0], network.frames[number]
    row = log.receptions[common.receptions]
    common.receptions += 1
    row.begin, row.source, row.receiver, row.outcome = frame.begin, frame.source, frame.destination, OUT_OF_RANGE
    row.power_dbm = row.sinr_db = math.nan
