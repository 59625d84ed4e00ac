"""What is on the air, as arrays: which frames overlap in time, how strong each is where, and what survives of a frame.

Interference is not drawn: two concrete frames overlap in time or they do not. A section of a frame (access
code, header, payload) is destroyed when the carrier is less than 11 dB above the sum of what overlaps it, frames on
neighbouring channels being weakened by the receiver's filter (carrier-to-interference ratios 11, 0, -30, -40 dB at 0,
1, 2 and 3 or more MHz: Core v1.2, Vol 2 Part A, section 4.2). Noise is drawn once a frame and receiver, by counters.

A device is half duplex: its frames follow each other, so that the last ``RING`` of each are all that can still overlap
a frame that is judged. The IDs of inquirers and pagers are not kept: a train is arithmetic, looked at when a frame that
it may have hit is judged.
"""

from collections.abc import Sequence
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np

import cosim.elementary as elementary
from cosim.arrays import Floats, Int64s
from cosim.channels.air.emissions import COLUMNS, Table, Tuning, others_mw, sends_otherwise
from cosim.channels.air.jammers import LOWEST_MHZ
from cosim.channels.air.spectra import CLASSIC, STEPS_PER_MHZ, shares
from cosim.channels.bluetooth.bits.errors import (
    ACCESS_CODE,
    CLEAR_DB,
    HEADER,
    PAYLOAD,
    failed_section,
    section_probabilities,
)
from cosim.channels.bluetooth.hopping import train_phase_of
from cosim.channels.bluetooth.packets import ACCESS_AIR, HEADER_AIR, ID_AIR
from cosim.channels.clock import start_of, tick_at
from cosim.channels.jamming import Jammer, jams
from cosim.jit import COMPILES, njit
from cosim.randomness import philox_words

Records: TypeAlias = np.ndarray[Any, np.dtype[np.void]]

RING: Final = 8
"""Number of frames kept for each device, which sends no more in the 5 ms in which they can matter."""

GAPS: Final = 8
"""Number of times kept at which a train is interrupted, for an answer that is received: not more than every 1.25 ms."""

BEGUN_FIELDS: Final = 3
"""Columns of idle frames that have begun: start, sender, channel."""

# modes of interference
NONE: Final = 0
CO_CHANNEL: Final = 1
NEIGHBOURING: Final = 2

# what becomes of a frame: RECEIVED, or COLLIDED or BIT_ERRORS plus the section (1 to 3) that failed first
RECEIVED: Final = 0
COLLIDED: Final = 0
BIT_ERRORS: Final = 4
OUT_OF_RANGE: Final = 8
NOT_TUNED: Final = 9
BUSY: Final = 10
MET: Final = 16
"""Bit added to a fate if anything overlapped the frame."""

DETECTABLE_DB: Final = 0.0
"""Es/N0 below which no receiver notices a frame, as its access code correlates less than once in 10,000 times."""
CARRIER_TO_INTERFERENCE: Final = 0.07943282347242814
WEIGHTS: Final = (1.0, 0.07943282347242814, 7.943282347242822e-05, 7.943282347242822e-06)
ERRORS_PURPOSE: Final = 2
"""Purpose of the draws of bit errors."""

FRAME: Final = np.dtype([("start", np.int64), ("end", np.int64), ("channel", np.int64)], align=True)
"""A frame on the air, or one that has been; ns."""

SENDER: Final = np.dtype([("next", np.int64), ("until", np.int64)], align=True)
"""The index of a device's next frame, and the instant at which the last of them is over."""

TRAIN: Final = np.dtype(
    [
        ("sender", np.int64),  # not "device", which NumPy takes for itself
        ("phase", np.int64),  # its clock
        ("ppm", np.int64),
        ("first", np.int64),  # as in ``scanning.IdTrain``
        ("switch", np.int64),  # ticks after which the train changes
        ("koffset", np.int64),
        ("estimate", np.int64),
        ("since", np.int64),  # IDs that start at or after this instant...
        ("until", np.int64),  # ...and before this one are sent
        ("channels", np.int64, (32,)),  # of each X
        ("silent_since", np.int64, (GAPS,)),  # the last times at which it is interrupted
        ("silent_until", np.int64, (GAPS,)),
    ],
    align=True,
)
"""IDs that a device sends."""

JAM: Final = np.dtype(
    [
        ("mode", np.int64),
        ("dwell", np.int64),
        ("on", np.int64),
        ("period", np.int64),
        ("start", np.int64),
        ("end", np.int64),
        ("count", np.int64),  # of its channels
        ("channels", np.int64, (79,)),  # in the order of its sweep
    ],
    align=True,
)
"""What a jammer sends."""


class Medium(NamedTuple):
    """The state of the air between *n* devices, for compiled functions."""

    mode: int
    """NONE, CO_CHANNEL or NEIGHBOURING."""
    power_dbm: Floats
    """(n, n): power with which the second receives the first; -inf for nothing."""
    frames: Records
    """(n, RING): the frames that each device sent last."""
    senders: Records
    """(n,)."""
    trains: Records
    """Trains of IDs that are on the air, or just have been."""


class Noise(NamedTuple):
    """The noise at all receivers. Where there is none kernels take None, and are compiled without all that it needs."""

    dbm: float
    key_0: int
    """The key of the draws of bit errors, two words."""
    key_1: int


class Foreign(NamedTuple):
    """What disturbs and is not Bluetooth's: jammers, other radios. Where nothing does, None as for :class:`Noise`."""

    sent: Records
    """(jammers,)."""
    power_mw: Floats
    """(jammers, n): what each device receives of each jammer."""
    table: Table
    """What is on the air that others share; nothing if none do."""
    tenant: int
    """The number of Bluetooth there."""
    begun: Int64s
    """(room, BEGUN_FIELDS): idle frames that have begun and are to be told there; without room if none are."""
    noted: Int64s
    """(1,): their number."""
    held: Int64s
    """(n,): instants before which devices do not listen to their masters, as another radio of the robot has the air."""
    arbitrated: bool
    """True if a device is deaf while another radio of its robot sends."""


def new_medium(size: int, mode: int) -> Medium:
    """Return the air between *size* devices, which all receive each other with 0 dBm."""
    power_dbm = np.zeros((size, size))
    np.fill_diagonal(power_dbm, -np.inf)
    frames = records((size, RING), FRAME)
    for name in ("start", "end", "channel"):
        frames[name] = -1
    return Medium(mode, power_dbm, frames, records(size, SENDER), records(0, TRAIN))


def jamming(jammers: Sequence[Jammer], size: int) -> Foreign:
    """Return *jammers* whom none of *size* devices receives yet, in an air of Bluetooth's own."""
    alone = Table(np.zeros((1, COLUMNS), np.int64), np.zeros(1), np.zeros(2, np.int64), np.zeros((1, 1, 1)), shares())
    begun = np.zeros((0, BEGUN_FIELDS), np.int64)
    noted, held = np.zeros(1, np.int64), np.zeros(size, np.int64)
    return Foreign(jam_records(jammers), np.zeros((len(jammers), size)), alone, 0, begun, noted, held, False)


def records(shape: int | tuple[int, ...], fields: "np.dtype[np.void]") -> Records:
    """Return records whose fields plain Python can name as kernels do, where these are plain Python."""
    zeros = np.zeros(shape, fields)
    return zeros if COMPILES else zeros.view(np.recarray)


@njit(cache=True, borrows=True)
def put(medium: Medium, source: int, start: int, end: int, channel: int) -> None:
    """Put a frame of *source* on the air."""
    sender = medium.senders[source]
    frame = medium.frames[source, sender.next]
    frame.start, frame.end, frame.channel = start, end, channel
    sender.next = (sender.next + 1) % RING
    sender.until = max(sender.until, end)


@njit(cache=True, borrows=True)
def note_begun(foreign: Foreign | None, source: int, start: int, channel: int) -> None:
    """Note an idle frame of *source* for other radios, if there are any."""
    if foreign is not None:  # noqa: SIM102  # numba leaves out what is behind a plain test for None only
        if len(foreign.begun) > 0:
            at = foreign.noted[0]
            foreign.begun[at, 0], foreign.begun[at, 1], foreign.begun[at, 2] = start, source, channel
            foreign.noted[0] = at + 1


@njit(cache=True, borrows=True)
def is_full(foreign: Foreign | None) -> bool:
    """Return whether there is no room for another idle frame that has begun."""
    if foreign is not None:  # noqa: SIM102
        if len(foreign.begun) > 0:
            return bool(foreign.noted[0] + 1 >= len(foreign.begun))
    return False


@njit(cache=True, borrows=True)
def listens(foreign: Foreign | None, device: int, start: int) -> bool:
    """Return whether *device* listens to its master at *start*, for all that its robot's other radios do."""
    if foreign is not None:
        return bool(foreign.held[device] <= start)
    return True


@njit(cache=True, borrows=True)
def _is_deaf(foreign: Foreign | None, receiver: int, start: int, end: int) -> bool:
    """Return whether another radio of the *receiver* has sent in [start, end), where an arbiter divides the air."""
    if foreign is not None:  # noqa: SIM102  # numba leaves out what is behind a plain test for None only
        if foreign.arbitrated:
            return sends_otherwise(foreign.table, receiver, foreign.tenant, start, end)
    return False


@njit(cache=True, borrows=True)
def heard_of(noise: Noise | None, carrier_dbm: float, least_db: float) -> bool:
    """Return whether a receiver notices a frame of this power at all: if it is *least_db*, at least, above noise."""
    if noise is None:
        return carrier_dbm > -np.inf
    return carrier_dbm - noise.dbm >= least_db


@njit(cache=True, borrows=True)
def _weight(mode: int, apart: int) -> float:
    if mode == CO_CHANNEL:
        return 1.0 if apart == 0 else 0.0
    return WEIGHTS[min(abs(apart), 3)]


@njit(cache=True, borrows=True)
def _ids(train: Any, mode: int, channel: int, start: int, end: int) -> float:
    """Return the weights of the IDs of one train that overlap [start, end)."""
    first_start = max(start - ID_AIR + 1, train.since)
    end = min(end, train.until)
    tick = max(tick_at(train.phase, train.ppm, first_start - 1) + 1, train.first)
    total = 0.0
    while True:
        begin = start_of(train.phase, train.ppm, tick)
        if begin >= end:
            return total
        if _sends_id(train, tick, begin):
            total += _weight(mode, _id_channel(train, tick) - channel)
        tick += 1


@njit(cache=True)
def list_ids(train: Any, since: int, until: int, found: Int64s) -> int:
    """Write (start, channel) of the IDs of one train that start in [since, until) to *found*, (m, 2); return how many.

    They are those from *since* on; more than m are not looked for.
    """
    tick = max(tick_at(train.phase, train.ppm, max(since, train.since) - 1) + 1, train.first)
    count, until = 0, min(until, train.until)
    while count < len(found):
        begin = start_of(train.phase, train.ppm, tick)
        if begin >= until:
            break
        if _sends_id(train, tick, begin):
            found[count, 0], found[count, 1] = begin, _id_channel(train, tick)
            count += 1
        tick += 1
    return count


@njit(cache=True, borrows=True)
def _sends_id(train: Any, tick: int, begin: int) -> bool:
    """Return whether a train sends an ID at *tick*, which begins at *begin*."""
    sent = tick & 2 == 0
    for gap in range(GAPS):
        sent &= not train.silent_since[gap] <= begin < train.silent_until[gap]
    return sent


@njit(cache=True, borrows=True)
def _id_channel(train: Any, tick: int) -> int:
    """Return the channel of the ID of a train at *tick*."""
    turn = (tick - train.first) // train.switch
    koffset = train.koffset if turn % 2 == 0 else 32 - train.koffset
    channel: int = train.channels[train_phase_of(tick + train.estimate, koffset)]
    return channel


@njit(cache=True, borrows=True)
def _jam(jam: Any, mode: int, channel: int, start: int, end: int) -> float:
    """Return the weights of the channels that one jammer fills at some time of [start, end)."""
    total = 0.0
    if start >= jam.end or end <= jam.start:
        return total
    for place in range(jam.count):
        weight = _weight(mode, jam.channels[place] - channel)
        if weight > 0.0 and jams(
            jam.mode, jam.dwell, jam.on, jam.period, jam.start, jam.end, place, jam.count, start, end
        ):
            total += weight
    return total


@njit(cache=True, borrows=True)
def _interference_mw(
    medium: Medium, foreign: Foreign | None, source: int, receiver: int, channel: int, start: int, end: int
) -> float:
    """Return the sum of all powers at *receiver* on or beside *channel* during [start, end), without *source*."""
    mode = medium.mode
    total = 0.0
    if mode == NONE or start >= end:
        return total
    frames = medium.frames
    for other in range(frames.shape[0]):
        dbm = medium.power_dbm[other, receiver]
        if dbm == -np.inf or other == source or other == receiver:  # noqa: SIM109  # compiled, a tuple costs
            continue
        if medium.senders[other].until <= start:
            continue
        for i in range(RING):
            frame = frames[other, i]
            if frame.start < end and frame.end > start:
                total += elementary.exp10(dbm / 10.0) * _weight(mode, frame.channel - channel)
    for row in range(len(medium.trains)):
        train = medium.trains[row]
        dbm = medium.power_dbm[train.sender, receiver]
        outside = train.since >= end or train.until <= start - ID_AIR
        if train.sender != source and train.sender != receiver and dbm > -np.inf and not outside:
            total += elementary.exp10(dbm / 10.0) * _ids(train, mode, channel, start, end)
    if foreign is not None:
        for row in range(len(foreign.sent)):
            if foreign.power_mw[row, receiver] > 0.0:
                total += foreign.power_mw[row, receiver] * _jam(foreign.sent[row], mode, channel, start, end)
        tuning = Tuning(CLASSIC, STEPS_PER_MHZ * (LOWEST_MHZ + channel), receiver)
        total += others_mw(foreign.table, tuning, foreign.tenant, start, end)
    return total


@njit(cache=True, borrows=True)
def broken(
    noise: Noise | None, source: int, receiver: int, start: int, carrier_dbm: float, bits: int, coded: bool
) -> int:
    """Return the first section that noise destroys of the frame of *source* that starts at *start*, or RECEIVED."""
    if noise is None:
        return RECEIVED
    es_n0_db = carrier_dbm - noise.dbm
    if es_n0_db >= CLEAR_DB:
        return RECEIVED
    access, header, payload = section_probabilities(es_n0_db, bits, coded)
    if access == 0.0 and header == 0.0 and payload == 0.0:
        return RECEIVED
    pair = source << 16 | receiver
    words = philox_words(start & 0xFFFFFFFF, start >> 32, pair, ERRORS_PURPOSE, noise.key_0, noise.key_1)
    return failed_section(words[0], words[1], words[2], words[3], access, header, payload)


@njit(cache=True, borrows=True)
def judge(
    medium: Medium,
    noise: Noise | None,
    foreign: Foreign | None,
    source: int,
    receiver: int,
    channel: int,
    start: int,
    end: int,
    carrier_dbm: float,
    bits: int,
    coded: bool,
    first: int,
) -> int:
    """Return the fate at *receiver* of the frame [start, end) of *source*, in its sections from *first* on, and MET.

    *carrier_dbm* is its power there, *bits* the length of its payload with header and CRC before coding. A frame no
    longer than an ID is access code only; noise breaks that as often as one with a trailer. Everything that starts
    before *end* must be on the air by now.
    """
    if _is_deaf(foreign, receiver, start, end):
        return BUSY + MET
    lost = broken(noise, source, receiver, start, carrier_dbm, bits, coded)
    met = _interference_mw(medium, foreign, source, receiver, channel, start, end) > 0.0
    carrier = elementary.exp10(carrier_dbm / 10.0) * CARRIER_TO_INTERFERENCE if met else 0.0
    alone = end - start <= ID_AIR
    for section in range(first, PAYLOAD + 1):
        if section == ACCESS_CODE:
            since, until = start, end if alone else start + ACCESS_AIR
        elif section == HEADER:
            since, until = start + ACCESS_AIR, start + HEADER_AIR
        else:
            since, until = start + HEADER_AIR, end
        if section > ACCESS_CODE and alone:
            break
        if met and carrier < _interference_mw(medium, foreign, source, receiver, channel, since, until):
            return COLLIDED + section + MET
        if lost == section:
            return BIT_ERRORS + section + (MET if met else 0)
    return RECEIVED + (MET if met else 0)


@njit(cache=True, borrows=True)
def greatest_interference_mw(
    medium: Medium, foreign: Foreign | None, source: int, receiver: int, channel: int, start: int, end: int
) -> float:
    """Return the greatest sum of powers that overlaps a section of the frame [start, end), as :func:`judge` has it."""
    if _interference_mw(medium, foreign, source, receiver, channel, start, end) == 0.0:
        return 0.0
    if end - start <= ID_AIR:
        access: float = _interference_mw(medium, foreign, source, receiver, channel, start, end)
        return access
    access = _interference_mw(medium, foreign, source, receiver, channel, start, start + ACCESS_AIR)
    header = _interference_mw(medium, foreign, source, receiver, channel, start + ACCESS_AIR, start + HEADER_AIR)
    payload = _interference_mw(medium, foreign, source, receiver, channel, start + HEADER_AIR, end)
    return max(access, header, payload)


def jam_records(jammers: Sequence[Jammer]) -> Records:
    """Return *jammers* as the field ``sent`` of :class:`Jammers`."""
    sent = records(len(jammers), JAM)
    for row, item in enumerate(jammers):
        for name in ("mode", "dwell", "on", "period", "start", "end"):
            sent[name][row] = getattr(item, name)
        sent["count"][row] = len(item.channels)
        sent["channels"][row, : len(item.channels)] = item.channels
    return sent
