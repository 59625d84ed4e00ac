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
from typing import Final, NamedTuple

import numpy as np

import cosim.elementary as elementary
from cosim.arrays import Floats, Int64s
from cosim.channels.bluetooth.bits.errors import ACCESS_CODE, HEADER, PAYLOAD, failed_section, section_probabilities
from cosim.channels.bluetooth.hopping import train_phase_of
from cosim.channels.bluetooth.packets import ACCESS_AIR, HEADER_AIR, ID_AIR
from cosim.channels.jamming import Jammer, jams
from cosim.jit import njit
from cosim.randomness import philox_words
from cosim.units import TICK

RING: Final = 8
"""Number of frames kept for each device, which sends no more in the 5 ms in which they can matter."""
TRAINS: Final = 16
"""Initial number of rows for trains of IDs that are on the air, or just have been."""

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

DETECTABLE_DB: Final = 0.0
"""Es/N0 below which no receiver notices a frame, as its access code correlates less than once in 10,000 times."""
CARRIER_TO_INTERFERENCE: Final = 0.07943282347242814
WEIGHTS: Final = (1.0, 0.07943282347242814, 7.943282347242822e-05, 7.943282347242822e-06)
ERRORS_PURPOSE: Final = 2
"""Purpose of the draws of bit errors."""

# trains[...]
T_DEVICE: Final = 0
T_PHASE: Final = 1
T_PPM: Final = 2
T_FIRST: Final = 3
T_SWITCH: Final = 4
T_KOFFSET: Final = 5
T_ESTIMATE: Final = 6
T_FROM: Final = 7  # IDs that start at or after this instant...
T_TO: Final = 8  # ...and before this one are sent
TRAIN_FIELDS: Final = 9

# jams[...]
J_MODE: Final = 0
J_DWELL: Final = 1
J_ON: Final = 2
J_PERIOD: Final = 3
J_START: Final = 4
J_END: Final = 5
J_COUNT: Final = 6
JAM_FIELDS: Final = 7

_MILLION = 1_000_000


class Medium(NamedTuple):
    """The state of the air between *n* devices, for compiled functions."""

    power_dbm: Floats
    """(n, n): power with which the second receives the first; -inf for nothing."""
    power_mw: Floats
    frames: Int64s
    """(n, RING, 3): start, end (ns) and channel of the frames that each device sent last."""
    cursor: Int64s
    """(n,): index of each device's next frame."""
    trains: Int64s
    """(TRAINS, TRAIN_FIELDS)."""
    train_channels: Int64s
    """(TRAINS, 32): the channel of each X."""
    jams: Int64s
    """(jammers, JAM_FIELDS)."""
    jam_channels: Int64s
    """(jammers, 79): the channels of each in the order of its sweep, J_COUNT of them."""
    jam_mw: Floats
    """(jammers, n): what each device receives of each jammer."""
    numbers: Int64s
    """Mode of interference, number of trains, the two words of the key of bit errors."""
    noise_dbm: Floats
    """(1,): -inf without noise."""


def new_medium(size: int, mode: int, noise_dbm: float, key: tuple[int, int]) -> Medium:
    """Return the air between *size* devices, which all receive each other with 0 dBm."""
    power_dbm = np.zeros((size, size))
    np.fill_diagonal(power_dbm, -np.inf)
    return Medium(
        power_dbm,
        np.where(np.isfinite(power_dbm), 1.0, 0.0),
        np.full((size, RING, 3), -1, dtype=np.int64),
        np.zeros(size, dtype=np.int64),
        np.zeros((TRAINS, TRAIN_FIELDS), dtype=np.int64),
        np.zeros((TRAINS, 32), dtype=np.int64),
        np.zeros((0, JAM_FIELDS), dtype=np.int64),
        np.zeros((0, 79), dtype=np.int64),
        np.zeros((0, size)),
        np.array([mode, 0, *key], dtype=np.int64),
        np.array([noise_dbm]),
    )


@njit(cache=True)
def put(frames: Int64s, cursor: Int64s, source: int, start: int, end: int, channel: int) -> None:
    """Put a frame of *source* on the air, into the arrays of :class:`Medium`."""
    at = cursor[source]
    frames[source, at, 0], frames[source, at, 1], frames[source, at, 2] = start, end, channel
    cursor[source] = (at + 1) % RING


@njit(cache=True)
def heard_of(medium: Medium, carrier_dbm: float) -> bool:
    """Return whether a receiver notices a frame of this power at all."""
    return carrier_dbm - medium.noise_dbm[0] >= DETECTABLE_DB if carrier_dbm > -np.inf else False


@njit(cache=True)
def _weight(mode: int, apart: int) -> float:
    if mode == CO_CHANNEL:
        return 1.0 if apart == 0 else 0.0
    return WEIGHTS[min(abs(apart), 3)]


@njit(cache=True)
def _tick_at_or_after(phase: int, ppm: int, time: int) -> int:
    """Return the first tick of a clock that begins at or after *time*."""
    before = time - 1
    return (phase + before + before * ppm // _MILLION) // TICK + 1


@njit(cache=True)
def start_of(phase: int, ppm: int, tick: int) -> int:
    """Return the instant at which *tick* begins, as ``NativeClock.time_of``, but safe in 64 bits for years."""
    rate = _MILLION + ppm
    elapsed = tick * TICK - phase
    turns = elapsed // rate
    return turns * _MILLION - (turns * rate - elapsed) * _MILLION // rate


@njit(cache=True)
def _ids(medium: Medium, row: int, mode: int, channel: int, start: int, end: int) -> float:
    """Return the weights of the IDs of one train that overlap [start, end)."""
    train = medium.trains[row]
    first_start = max(start - ID_AIR + 1, train[T_FROM])
    end = min(end, train[T_TO])
    tick = max(_tick_at_or_after(train[T_PHASE], train[T_PPM], first_start), train[T_FIRST])
    total = 0.0
    while start_of(train[T_PHASE], train[T_PPM], tick) < end:
        if tick & 2 == 0:
            turn = (tick - train[T_FIRST]) // train[T_SWITCH]
            koffset = train[T_KOFFSET] if turn % 2 == 0 else 32 - train[T_KOFFSET]
            x = train_phase_of(tick + train[T_ESTIMATE], koffset)
            total += _weight(mode, medium.train_channels[row, x] - channel)
        tick += 1
    return total


@njit(cache=True)
def _jam(medium: Medium, row: int, mode: int, channel: int, start: int, end: int) -> float:
    """Return the weights of the channels that one jammer fills at some time of [start, end)."""
    jam = medium.jams[row]
    count = jam[J_COUNT]
    total = 0.0
    if start >= jam[J_END] or end <= jam[J_START]:
        return total
    for place in range(count):
        weight = _weight(mode, medium.jam_channels[row, place] - channel)
        if weight > 0.0 and jams(
            jam[J_MODE], jam[J_DWELL], jam[J_ON], jam[J_PERIOD], jam[J_START], jam[J_END], place, count, start, end
        ):
            total += weight
    return total


@njit(cache=True)
def interference_mw(medium: Medium, source: int, receiver: int, channel: int, start: int, end: int) -> float:
    """Return the sum of all powers at *receiver* on or beside *channel* during [start, end), without *source*."""
    mode = medium.numbers[0]
    total = 0.0
    if mode == NONE or start >= end:
        return total
    frames = medium.frames
    for other in range(frames.shape[0]):
        power = medium.power_mw[other, receiver]
        if power == 0.0 or other == source or other == receiver:  # noqa: SIM109  # compiled, a tuple costs
            continue
        for i in range(RING):
            if frames[other, i, 0] < end and frames[other, i, 1] > start:
                total += power * _weight(mode, frames[other, i, 2] - channel)
    for row in range(medium.numbers[1]):
        train = medium.trains[row]
        power = medium.power_mw[train[T_DEVICE], receiver]
        outside = train[T_FROM] >= end or train[T_TO] <= start - ID_AIR
        if train[T_DEVICE] != source and train[T_DEVICE] != receiver and power > 0.0 and not outside:
            total += power * _ids(medium, row, mode, channel, start, end)
    for row in range(medium.jams.shape[0]):
        if medium.jam_mw[row, receiver] > 0.0:
            total += medium.jam_mw[row, receiver] * _jam(medium, row, mode, channel, start, end)
    return total


@njit(cache=True)
def _noise(medium: Medium, source: int, receiver: int, start: int, carrier_dbm: float, bits: int, coded: bool) -> int:
    """Return the first section that noise destroys, or RECEIVED."""
    if medium.noise_dbm[0] == -np.inf:
        return RECEIVED
    access, header, payload = section_probabilities(carrier_dbm - medium.noise_dbm[0], bits, coded)
    if access == 0.0 and header == 0.0 and payload == 0.0:
        return RECEIVED
    key = medium.numbers
    words = philox_words(start & 0xFFFFFFFF, start >> 32, source << 16 | receiver, ERRORS_PURPOSE, key[2], key[3])
    return failed_section(words[0], words[1], words[2], words[3], access, header, payload)


@njit(cache=True)
def judge(
    medium: Medium,
    source: int,
    receiver: int,
    channel: int,
    start: int,
    end: int,
    carrier_dbm: float,
    bits: int,
    coded: bool,
    first: int = ACCESS_CODE,
) -> int:
    """Return the fate at *receiver* of the frame [start, end) of *source*, in its sections from *first* on.

    *carrier_dbm* is its power there, *bits* the length of its payload with header and CRC before coding. A frame no
    longer than an ID is access code only; noise breaks that as often as one with a trailer. Everything that starts
    before *end* must be on the air by now.
    """
    carrier = elementary.exp10(carrier_dbm / 10.0) * CARRIER_TO_INTERFERENCE
    lost = _noise(medium, source, receiver, start, carrier_dbm, bits, coded)
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
        if carrier < interference_mw(medium, source, receiver, channel, since, until):
            return COLLIDED + section
        if lost == section:
            return BIT_ERRORS + section
    return RECEIVED


@njit(cache=True)
def set_powers(medium: Medium, power_dbm: Floats) -> None:
    """Let all devices receive each other with *power_dbm*, shape (n, n), from now on."""
    for one in range(power_dbm.shape[0]):
        for other in range(power_dbm.shape[0]):
            power = power_dbm[one, other]
            medium.power_dbm[one, other] = power
            medium.power_mw[one, other] = elementary.exp10(power / 10.0) if power > -np.inf else 0.0


def jam_arrays(jammers: Sequence[Jammer]) -> tuple[Int64s, Int64s]:
    """Return *jammers* as the arrays ``jams`` and ``jam_channels`` of :class:`Medium`."""
    rows = np.zeros((len(jammers), JAM_FIELDS), dtype=np.int64)
    channels = np.zeros((len(jammers), 79), dtype=np.int64)
    for row, item in enumerate(jammers):
        count = len(item.channels)
        rows[row] = (item.mode, item.dwell, item.on, item.period, item.start, item.end, count)
        channels[row, :count] = item.channels
    return rows, channels
