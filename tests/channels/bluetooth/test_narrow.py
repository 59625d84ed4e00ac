"""The 23-channel system, of which statistical properties are claimed: 16 distinct channels, uniform over 23."""

import numpy as np
import pytest

from cosim.channels.bluetooth.hopping import (
    GIAC,
    NARROW,
    basic_channel,
    inquiry_channel,
    inquiry_scan_channel,
    page_channel,
    page_scan_channel,
    scan_channels,
)
from cosim.channels.bluetooth.packets import ID_AIR
from cosim.channels.bluetooth.scanning import WINDOW, IdTrain, ScanWindows, next_meeting
from cosim.channels.clock import NativeClock
from cosim.units import TICK

RNG = np.random.default_rng(11)
WORDS = [int(word) | NARROW for word in (0, 0xFFFFFFFF, GIAC, *RNG.integers(1 << 32, size=60))]


@pytest.mark.parametrize("y1", [0, 2])
def test_a_hop_segment_is_16_distinct_channels_of_23(y1: int) -> None:
    for word in WORDS:
        ticks = [c + y1 for c in range(32) if c & 2 == 0]
        channels = {page_channel(word, tick, "A") for tick in ticks}
        assert len(channels) == 16
        assert channels <= set(range(23))
        assert channels == {page_channel(word, tick, "B") for tick in ticks}


def test_a_scanner_goes_through_the_16_channels_by_bits_15_to_12_of_its_clock() -> None:
    for word in WORDS:
        channels = [page_scan_channel(word, block << 12) for block in range(32)]
        assert len(set(channels[:16])) == 16
        assert channels[:16] == channels[16:]
        assert set(channels) == set(scan_channels(word).tolist())


def test_every_train_holds_every_channel_on_which_a_scanner_may_listen() -> None:
    for block in range(32):
        scanned = inquiry_scan_channel(block << 12, address=GIAC | NARROW)
        for train in ("A", "B"):
            sent = {inquiry_channel(tick, train, GIAC | NARROW) for tick in range(32) if tick & 2 == 0}
            assert scanned in sent


def test_a_connection_uses_all_23_channels_alike() -> None:
    """Within 5 % in 2**20 slots: a fair coin would stay within 2 % in all but one of ten thousand cases."""
    ticks = np.arange(0, 1 << 21, 2)
    for word in WORDS[:8]:
        counts = np.bincount(basic_channel(word, ticks), minlength=23)
        assert len(counts) == 23
        assert np.abs(counts / counts.mean() - 1).max() < 0.05


def test_different_piconets_meet_once_in_23_slots() -> None:
    ticks = np.arange(0, 1 << 18, 2)
    rates = [
        (basic_channel(one, ticks + int(RNG.integers(1 << 27))) == basic_channel(other, ticks)).mean()
        for one, other in zip(WORDS[3:33], WORDS[33:63], strict=True)
    ]
    assert abs(np.mean(rates) * 23 - 1) < 0.05


def test_the_79_channels_are_what_they_were_without_the_bit() -> None:
    assert page_channel(0x2A96EF25, 0, "A") != page_channel(0x2A96EF25 | NARROW, 0, "A")
    assert max(basic_channel(0x2A96EF25, np.arange(0, 1 << 12, 2))) == 78


def meeting_by_looking(ids: IdTrain, windows: ScanWindows) -> int | None:
    """The first ID, tick by tick, that lies in a window and has the scanner's X mod 16."""
    for c in range(ids.first, ids.end):
        start = ids.clock.time_of(c)
        local = windows.clock.tick(start)
        edge = (local - windows.offset) // windows.interval * windows.interval + windows.offset
        inside = start >= windows.clock.time_of(edge) and start + ID_AIR <= windows.clock.time_of(edge + WINDOW)
        if c & 2 == 0 and inside and ids.phase(c) % 16 == (local >> 12) % 16:
            return c
    return None


@pytest.mark.slow
def test_meetings_are_those_of_equal_phases_mod_16() -> None:
    found = 0
    for _ in range(60):
        clocks = [
            NativeClock(int(RNG.integers(1 << 28)) * TICK + int(RNG.integers(TICK)), int(RNG.integers(-250, 251)))
        ]
        clocks.append(NativeClock(int(RNG.integers(1 << 28)) * TICK, int(RNG.integers(-250, 251))))
        first = (clocks[0].tick(0) // 4 + 1) * 4
        ids = IdTrain(clocks[0], first, first + 6000, 8, "A", 4 * int(RNG.integers(1 << 20)), True)
        windows = ScanWindows(clocks[1], int(RNG.integers(2048)), 2048)
        meeting = next_meeting(ids, windows, first, 0)
        expected = meeting_by_looking(ids, windows)
        assert (meeting and meeting.tick) == expected
        found += expected is not None
    assert found == 60  # a window and a train: they always meet
