"""What is on the air of a band, as arrays, and what a receiver takes in of it: kernels for ``band`` and for tenants.

The table is kept in one order, by all that tells one emission from another. So neither what is told first nor who is
asked first decides anything, not even the last bit of a sum.

Nobody is told of what begins: who receives looks through what is there, which is no more than what can still be asked
for. An emission counts at a receiver if more than FAINT_MW of it passes the receiver's filter. That is 26 dB below the
thermal noise within 1 MHz (-114 dBm): each emission that is neglected would add 0.25 % to that, or 0.011 dB.
"""

from typing import Final, NamedTuple, TypeAlias

import numpy as np

from cosim.arrays import Floats, Int64s
from cosim.channels.air.spectra import JAMMER, OFFSETS
from cosim.jit import njit
from cosim.units import Time

FAINT_MW: Final = 1e-14
"""Power (-140 dBm) behind the receiver's filter up to which an emission is neglected."""
NOBODY: Final = -1
"""Number of no sender."""

# columns of a table
START: Final = 0
END: Final = 1
KIND: Final = 2
CENTRE: Final = 3
SENDER: Final = 4
TENANT: Final = 5
GENERATION: Final = 6
COLUMNS: Final = 7
_KEYS: Final = 6
"""Number of columns, the first ones, by which a table is sorted, before the power."""

Indices: TypeAlias = Int64s


class Table(NamedTuple):
    """What is on the air, and how it gets to receivers; n radios, which are numbered as robots are."""

    rows: Int64s
    """(room, COLUMNS), sorted: emissions of which the last one is row count - 1."""
    sent_mw: Floats
    """(room,): their powers at the senders."""
    state: Int64s
    """(2,): the count, and the generation of gains that new emissions keep to their end."""
    gains: Floats
    """(generations, n, n): the part of the power of a sender (row) that comes to a receiver (column)."""
    shares: Floats
    """As of ``spectra.shares``."""


class Tuning(NamedTuple):
    """What a receiver listens to."""

    kind: int
    """One of the receivers of ``spectra``."""
    centre: int
    """In steps of 0.5 MHz: 4804 is 2402 MHz."""
    address: int
    """Where it is: the number of the radio."""


class Listening(NamedTuple):
    """What all receivers of a channel listen to, and to nobody else's than that channel's."""

    kind: int
    """One of the receivers of ``spectra``."""
    centre: int
    """In steps of 0.5 MHz: 4804 is 2402 MHz."""
    tenant: int
    """The number of the channel."""


class Wanted(NamedTuple):
    """Whose emissions are no interference to a receiver, besides its own: those of *sender* in the same channel."""

    tenant: int
    sender: int
    """A radio, or NOBODY."""


@njit(cache=True, borrows=True)
def insert(
    table: Table, start: Time, end: Time, kind: int, centre: int, sender: int, tenant: int, sent_mw: float
) -> bool:
    """Put an emission in its place in the *table*; return False, and do nothing, if there is no room."""
    rows, count = table.rows, table.state[0]
    if count == len(rows):
        return False
    key = (start, end, kind, centre, sender, tenant)
    at = count
    while at > 0 and _precedes(key, sent_mw, rows[at - 1], table.sent_mw[at - 1]):
        _copy(table, at - 1, at)
        at -= 1
    for column in range(_KEYS):
        rows[at, column] = key[column]
    rows[at, GENERATION] = table.state[1]
    table.sent_mw[at] = sent_mw
    table.state[0] = count + 1
    return True


@njit(cache=True)
def insert_all(
    table: Table, starts: Int64s, ends: Int64s, kind: int, centre: int, senders: Int64s, tenant: int, powers_mw: Floats
) -> None:
    """Put emissions of one kind and centre in their places; there is room. *powers_mw* are by sender."""
    for at in range(len(starts)):
        insert(table, starts[at], ends[at], kind, centre, senders[at], tenant, powers_mw[senders[at]])


@njit(cache=True, borrows=True)
def _precedes(key: tuple[int, int, int, int, int, int], sent_mw: float, row: Int64s, row_mw: float) -> bool:
    for column in range(_KEYS):
        if key[column] != row[column]:
            return bool(key[column] < row[column])
    return sent_mw < row_mw


@njit(cache=True, borrows=True)
def _copy(table: Table, at: int, to: int) -> None:
    for column in range(COLUMNS):  # numba would make an array of a row
        table.rows[to, column] = table.rows[at, column]
    table.sent_mw[to] = table.sent_mw[at]


@njit(cache=True, borrows=True)
def forget(table: Table, before: Time) -> None:
    """Forget the emissions that are over *before*, or just then."""
    kept = 0
    for at in range(table.state[0]):
        if table.rows[at, END] > before:
            _copy(table, at, kept)
            kept += 1
    table.state[0] = kept


@njit(cache=True, borrows=True)
def share(table: Table, at: int, tuning: Tuning) -> float:
    """Return the share of emission *at* that passes the filter of a receiver."""
    offset = abs(table.rows[at, CENTRE] - tuning.centre)
    if offset >= OFFSETS:
        return 0.0
    found: float = table.shares[table.rows[at, KIND], tuning.kind, offset]
    return found


@njit(cache=True, borrows=True)
def taken_mw(table: Table, at: int, tuning: Tuning, wanted: Wanted) -> float:
    """Return the power of emission *at* that disturbs a receiver behind its filter; 0 if it is neglected.

    What a jammer sends each channel tells for its own receivers: some jammers disturb one channel only.
    """
    row = table.rows[at]
    sender = row[SENDER]
    if row[KIND] == JAMMER and row[TENANT] != wanted.tenant:
        return 0.0
    if row[TENANT] == wanted.tenant and (sender == wanted.sender or sender == tuning.address):
        return 0.0
    part = share(table, at, tuning)
    if part == 0.0:
        return 0.0
    mw: float = table.sent_mw[at] * table.gains[row[GENERATION], sender, tuning.address] * part
    return mw if mw > FAINT_MW else 0.0


@njit(cache=True)
def overlapping(table: Table, tuning: Tuning, start: Time, end: Time, wanted: Wanted, least_share: float) -> Indices:
    """Return which emissions disturb a receiver during [start, end) with *least_share* of their power or more."""
    found = np.empty(table.state[0], np.int64)
    count = 0
    for at in range(table.state[0]):
        row = table.rows[at]
        if row[START] >= end:
            break
        if row[END] > start and share(table, at, tuning) >= least_share and taken_mw(table, at, tuning, wanted) > 0.0:
            found[count] = at
            count += 1
    return found[:count]


@njit(cache=True)
def sections(table: Table, tuning: Tuning, start: Time, end: Time, wanted: Wanted) -> tuple[Int64s, Floats]:
    """Return the bounds of the sections of [start, end) of constant interference, (k + 1,), and its mW in each, (k,).

    No two sections that follow each other have the same.
    """
    found = overlapping(table, tuning, start, end, wanted, 0.0)
    bounds, levels = np.empty(2 * len(found) + 2, np.int64), np.zeros(2 * len(found) + 1)
    powers = np.empty(len(found))
    bounds[0], bounds[1] = start, end
    for k, at in enumerate(found):
        powers[k] = taken_mw(table, at, tuning, wanted)
        bounds[2 * k + 2] = max(start, table.rows[at, START])
        bounds[2 * k + 3] = min(end, table.rows[at, END])
    bounds.sort()
    count = 0
    for k in range(len(levels)):
        since, until = bounds[k], bounds[k + 1]
        if since == until:
            continue
        level = 0.0
        for i, at in enumerate(found):
            if table.rows[at, START] <= since and table.rows[at, END] >= until:
                level += powers[i]
        if count == 0 or level != levels[count - 1]:
            bounds[count], levels[count] = since, level
            count += 1
    bounds[count] = end
    return bounds[: count + 1], levels[:count]


# ---------------------------------------------------------------- for channels with kernels of their own


@njit(cache=True, borrows=True)
def others_mw(table: Table, tuning: Tuning, tenant: int, start: Time, end: Time) -> float:
    """Return the most that other channels than *tenant* have on the air at a receiver, at any instant of [start, end).

    More than before can only be there when something begins.
    """
    worst = _others_at(table, tuning, tenant, start)
    for at in range(table.state[0]):
        row = table.rows[at]
        if row[START] >= end:
            break
        if row[START] > start and row[TENANT] != tenant:
            worst = max(worst, _others_at(table, tuning, tenant, row[START]))
    return worst


@njit(cache=True, borrows=True)
def _others_at(table: Table, tuning: Tuning, tenant: int, time: Time) -> float:
    total = 0.0
    for at in range(table.state[0]):
        row = table.rows[at]
        if row[START] > time:
            break
        if row[END] > time and row[TENANT] != tenant:
            total += taken_mw(table, at, tuning, Wanted(tenant, NOBODY))
    return total


@njit(cache=True, borrows=True)
def sends_otherwise(table: Table, sender: int, tenant: int, start: Time, end: Time) -> bool:
    """Return whether *sender* has something on the air in [start, end) by another channel than *tenant*."""
    for at in range(table.state[0]):
        row = table.rows[at]
        if row[START] >= end:
            break
        if row[END] > start and row[SENDER] == sender and row[TENANT] != tenant:
            return True
    return False


@njit(cache=True, borrows=True)
def _is_heard(table: Table, at: int, listening: Listening) -> bool:
    """Return whether emission *at* is another channel's, and not a jammer, and falls into the filter."""
    if table.rows[at, TENANT] == listening.tenant or table.rows[at, KIND] == JAMMER:
        return False
    offset = abs(table.rows[at, CENTRE] - listening.centre)
    return bool(offset < OFFSETS and table.shares[table.rows[at, KIND], listening.kind, offset] > 0.0)


@njit(cache=True)
def write_levels(table: Table, listening: Listening, time: Time, levels: Floats) -> None:
    """Add to *levels*, (n,), what comes to each of the first n radios at *time* from other channels, mW."""
    for at in range(table.state[0]):
        row = table.rows[at]
        if row[START] > time:
            break
        if row[END] > time and _is_heard(table, at, listening):
            for address in range(len(levels)):
                tuning = Tuning(listening.kind, listening.centre, address)
                levels[address] += taken_mw(table, at, tuning, Wanted(listening.tenant, NOBODY))


@njit(cache=True)
def next_change(table: Table, listening: Listening, after: Time) -> Time:
    """Return the first instant later than *after* at which anything of another channel begins or ends, or 2^62."""
    found = 1 << 62
    for at in range(table.state[0]):
        row = table.rows[at]
        if row[START] >= found:
            break
        if not _is_heard(table, at, listening):
            continue
        if row[START] > after:
            found = min(found, row[START])
        elif row[END] > after:
            found = min(found, row[END])
    return found
