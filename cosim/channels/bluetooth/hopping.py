"""The 79-channel hop selection kernel of Bluetooth BR (Core v1.2, Vol 2 Part B, section 2.6): clock to channel.

    channel = BANK[(PERM5(((X + A) mod 32) xor B; P) + E + F + Y2) mod 79],   BANK[i] = 2i mod 79

PERM5 is a butterfly network of 14 exchanges, each switched by one bit of the control word P = (D, C xor Y1). The
parts A to E are cut out of the address; the substates differ in X (the hop phase) and Y1 (transmit or receive half),
and the connection state mixes the clock into A, C, D and F. Y2 = 32 * Y1.

Outside of a connection the parts are constants of the address and F = 0, so all channels of an address are one table
of 64 entries, indexed by 32 * Y1 + X. At Y1 = 0 the table is injective, so devices meet exactly when their X are
equal, and the entries of Y1 = 1 are other channels than those of Y1 = 0. ``scan_phase`` and ``train_phase`` give X.

The 23-channel system of v1.0B and v1.1, for countries with a narrower band, is asked for by the bit ``NARROW`` of an
address. No sample data of it is public, so only its statistical properties are claimed: a hop segment of 16 distinct
channels, the same in both trains, the scan phase CLKN15-12, and channels that a connection uses equally often.

An address is the 32-bit word UAP/LAP of the specification's sample data, of which the kernel reads 28 bits. Clocks
are in ticks of 312.5 us and may be unwrapped: 28 bits are read. Every public function takes an int, or a NumPy array
of integers and then returns an array.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, Final, Literal, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from cosim.jit import njit

Train: TypeAlias = Literal["A", "B"]
Clock = TypeVar("Clock", int, NDArray[Any])

GIAC: Final = 0x9E8B33
"""The word of the general inquiry access code: its LAP, with the default check initialisation 0 as UAP."""
NARROW: Final = 1 << 32
"""Bit added to an address, beyond its 32 bits, of a device that hops over 23 channels."""
CHANNELS: Final = 79
NARROW_CHANNELS: Final = 23
KOFFSET: Final[dict[str, int]] = {"A": 24, "B": 8}
"""Offset of X on each train."""

_EXCHANGED = np.array(  # the two bits of Z that P0, P1, ... P13 exchange
    [[0, 1], [2, 3], [1, 2], [3, 4], [0, 4], [1, 3], [0, 2], [3, 4], [1, 4], [0, 3], [2, 4], [1, 3], [0, 3], [1, 2]]
)


@njit(cache=True)
def _permuted(z: int, control: int, bits: int) -> int:
    """Return PERM5 of *z*, of 5 *bits*; with 4, without the exchanges with the fifth."""
    for i in range(13, -1, -1):
        first, second = _EXCHANGED[i, 0], _EXCHANGED[i, 1]
        if second < bits:
            differ = (control >> i) & ((z >> first) ^ (z >> second)) & 1
            z ^= (differ << first) | (differ << second)
    return z


@njit(cache=True)
def _select(address: int, x: int, y1: int, mix: int, bits: int) -> int:
    """Return PERM5 + E; *mix* is the clock where it mixes into A, C and D (connection), else 0.

    *bits* is 5; the 23-channel system has 4 bits where the other has 5.
    """
    mask = (1 << bits) - 1
    a = ((address >> 23) ^ (mix >> 21)) & mask
    b = (address >> 19) & 15
    # C = A8,6,4,2,0 and E = A13,11,9,7,5,3,1: every second bit, gathered
    c = e = 0
    for i in range(5):
        c |= ((address >> 2 * i) & 1) << i
    for i in range(7):
        e |= ((address >> (2 * i + 1)) & 1) << i
    c = (c ^ (mix >> 16)) & 31
    d = ((address >> 10) ^ (mix >> 7)) & 511
    control = d | ((c ^ (31 * y1)) << 9)
    return _permuted(((x + a) & mask) ^ b, control, bits) + e


@njit(cache=True)
def basic_hop(address: int, clk: int) -> int:
    """Return :func:`basic_channel` of one clock, for other compiled kernels."""
    clk &= 0xFFFFFFF
    y1 = (clk >> 1) & 1
    if address & NARROW:
        narrow = _select(address, (clk >> 2) & 15, y1, clk, 4) + 8 * (clk >> 6) + 16 * y1
        return 2 * (narrow % NARROW_CHANNELS) % NARROW_CHANNELS
    index = _select(address, (clk >> 2) & 31, y1, clk, 5) + 16 * (clk >> 7) + 32 * y1
    return 2 * (index % 79) % 79


@njit(cache=True)
def adapted_hop(address: int, clk: int, bank: NDArray[np.int64]) -> int:
    """Return :func:`adapted_channel` of one clock; *bank* holds the used channels ascending, even ones first."""
    clk &= 0xFFFFFFF
    index = _select(address, (clk >> 2) & 31, 0, clk, 5)
    channel = 2 * ((index + 16 * (clk >> 7)) % 79) % 79
    for used in bank:
        if used == channel:
            return channel
    replacement: int = bank[(index + 16 * (clk >> 7) % len(bank)) % len(bank)]
    return replacement


@njit(cache=True)
def _basic_hops(address: int, clks: NDArray[np.int64], out: NDArray[np.int64]) -> None:
    for i in range(len(clks)):
        out[i] = basic_hop(address, clks[i])


@njit(cache=True)
def _adapted_hops(address: int, clks: NDArray[np.int64], bank: NDArray[np.int64], out: NDArray[np.int64]) -> None:
    for i in range(len(clks)):
        out[i] = adapted_hop(address, clks[i], bank)


@lru_cache(maxsize=4096)
def _channels(address: int) -> tuple[int, ...]:
    """Return the channels of *address* outside of a connection, at 32 * Y1 + X."""
    halves = [(x, y1) for y1 in (0, 1) for x in range(32)]
    if address & NARROW:
        indices = [_select(address, x & 15, y1, 0, 4) + 16 * y1 for x, y1 in halves]
        return tuple(2 * (index % NARROW_CHANNELS) % NARROW_CHANNELS for index in indices)
    return tuple(2 * ((_select(address, x, y1, 0, 5) + 32 * y1) % CHANNELS) % CHANNELS for x, y1 in halves)


def _lookup(address: int, index: Clock) -> Clock:
    table = _channels(address)
    if isinstance(index, np.ndarray):
        channels: NDArray[Any] = np.array(table)[index]
        return channels
    return table[index]


def scan_channels(address: int) -> NDArray[np.int64]:
    """Return the channel of each X on which *address* scans, and on which IDs are sent to it: shape (32,)."""
    return np.array(_channels(address)[:32], dtype=np.int64)


def scan_phase(clkn: Clock, n: int = 0) -> Clock:
    """Return X of a scanner or responder: bits 16-12 of its clock plus *n*, mod 32."""
    return ((clkn >> 12) + n) & 31


@njit(cache=True)
def train_phase_of(clk: int, koffset: int) -> int:
    """Return :func:`train_phase` of one clock on the train of *koffset*, for other compiled kernels."""
    block = (clk >> 12) & 31
    step = ((clk >> 1) & 14) | (clk & 1)
    phase: int = (block + koffset + ((step - block) & 15)) & 31
    return phase


def train_phase(clk: Clock, train: Train) -> Clock:
    """Return X of a pager (*clk* is its estimate of the other's clock) or inquirer (its own clock): Xp, Xi."""
    block = (clk >> 12) & 31
    step = ((clk >> 1) & 14) | (clk & 1)  # bits 4, 3, 2 and 0
    return (block + KOFFSET[train] + ((step - block) & 15)) & 31


def page_scan_channel(address: int, clkn: Clock) -> Clock:
    """Return the channel on which the device *address* scans for pages."""
    return _lookup(address, scan_phase(clkn))


def page_channel(address: int, clke: Clock, train: Train) -> Clock:
    """Return the pager's channel: it sends the ID of the paged *address* where CLKE1 = 0 and listens where it is 1."""
    return _lookup(address, 32 * ((clke >> 1) & 1) + train_phase(clke, train))


def inquiry_scan_channel(clkn: Clock, n: int = 0, address: int = GIAC) -> Clock:
    """Return the channel of an inquiry scan after *n* replies."""
    return _lookup(address, scan_phase(clkn, n))


def inquiry_channel(clkn: Clock, train: Train, address: int = GIAC) -> Clock:
    """Return the inquirer's channel: it sends the inquiry ID where CLKN1 = 0 and listens where it is 1."""
    return _lookup(address, 32 * ((clkn >> 1) & 1) + train_phase(clkn, train))


def inquiry_response_channel(clkn: Clock, n: int = 0, address: int = GIAC) -> Clock:
    """Return the channel of the FHS with which a scanner answers an inquiry, after *n* replies."""
    return _lookup(address, 32 + scan_phase(clkn, n))


def slave_response_channel(address: int, frozen_clkn: int, clkn: Clock) -> Clock:
    """Return the paged device's channel; its clock was *frozen_clkn* when it heard the page.

    N counts the multiples of 4 that the clock has passed since: 0 in the slot of the response.
    """
    n = (clkn >> 2) - (frozen_clkn >> 2)
    return _lookup(address, 32 * ((clkn >> 1) & 1) + (((frozen_clkn >> 12) + n) & 31))


def master_response_channel(address: int, frozen_clke: int, clke: Clock, koffset: int) -> Clock:
    """Return the pager's channel; its estimate was *frozen_clke* when it heard the response, on the train of *koffset*.

    N counts the multiples of 4 that the estimate has passed since: 1 in the slot of the first FHS.
    """
    block = (frozen_clke >> 12) & 31
    step = ((frozen_clke >> 1) & 14) | (frozen_clke & 1)
    n = (clke >> 2) - (frozen_clke >> 2)
    return _lookup(address, 32 * ((clke >> 1) & 1) + ((block + koffset + ((step - block) & 15) + n) & 31))


def basic_channel(address: int, clk: Clock) -> Clock:
    """Return the channel of the basic hopping sequence of a piconet: the master's *address* and clock."""
    if isinstance(clk, np.ndarray):
        out = np.empty(clk.size, dtype=np.int64)
        _basic_hops(address, clk.astype(np.int64).ravel(), out)
        return out.reshape(clk.shape)
    return int(basic_hop(address, clk))


@lru_cache(maxsize=256)
def _bank(used: tuple[int, ...]) -> NDArray[np.int64]:
    channels = sorted(set(used), key=lambda channel: (channel % 2, channel))
    if not channels or not all(0 <= channel < CHANNELS for channel in channels):
        raise ValueError(f"used channels: {list(used)} is not a non-empty set of numbers from 0 to {CHANNELS - 1}")
    return np.array(channels, dtype=np.int64)


def adapted_channel(address: int, clk: Clock, used: Sequence[int]) -> Clock:
    """Return the channel of the adapted hopping sequence (v1.2) over the *used* channels, in any order.

    Master and slave share a channel within a slot pair. Raise :exc:`ValueError` if *used* is empty or leaves 0 to 78.
    """
    bank = _bank(tuple(used))
    if isinstance(clk, np.ndarray):
        out = np.empty(clk.size, dtype=np.int64)
        _adapted_hops(address, clk.astype(np.int64).ravel(), bank, out)
        return out.reshape(clk.shape)
    return int(adapted_hop(address, clk, bank))
