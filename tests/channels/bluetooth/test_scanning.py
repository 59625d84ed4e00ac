"""The computed meeting of an ID train and a scanner equals the one found by looking at every tick."""

import numpy as np
import pytest

from cosim.channels.bluetooth.hopping import page_channel, page_scan_channel
from cosim.channels.bluetooth.scanning import (
    WINDOW,
    IdTrain,
    Meeting,
    ScanSettings,
    ScanWindows,
    first_transmission,
    next_meeting,
    next_meeting_between,
)
from cosim.channels.clock import NativeClock
from cosim.units import MS, TICK, US

ADDRESS = 0x2A96EF25
ID = 68 * US
WRAP = 1 << 28


def meeting_by_looking(ids, windows, tick, since, until=None):
    """Visit tick after tick, compare channels, and count windows on the scanner's clock."""
    clock = windows.clock
    for c in range(max(tick, ids.first), ids.end):
        start = ids.clock.time_of(c)
        if c % 4 > 1 or start < since:
            continue
        if until is not None and start + ID > until:
            return None
        part = 0
        if until is None and not windows.continuous:
            window, ticks = divmod(clock.tick(start) - windows.offset, windows.interval)
            edge = windows.offset + window * windows.interval
            part = ticks // WINDOW
            if part > int(windows.interlaced):
                continue
            if start + ID > clock.time_of(edge + (part + 1) * WINDOW):
                continue
        scanned = page_scan_channel(ADDRESS, clock.tick(start) + (part << 16))
        if scanned == page_channel(ADDRESS, c + ids.estimate, ids.train(c)):
            return Meeting(c, bool(part))
    return None


def draw_clock(rng, near_edge):
    """A clock whose tick is near a block, or the 28-bit wrap, at time 0; or anywhere."""
    ppm = int(rng.choice([0, 250, -250, int(rng.integers(-250, 251))]))
    if near_edge:
        block = int(rng.choice([WRAP, int(rng.integers(1, 1 << 16)) << 12]))
        return NativeClock((block + int(rng.integers(-300, 40))) * TICK + int(rng.integers(-2, 3)), ppm)
    return NativeClock(int(rng.integers(WRAP)) * TICK + int(rng.integers(TICK)), ppm)


def draw_case(rng):
    near_edge = bool(rng.integers(2))
    mine, theirs = draw_clock(rng, near_edge), draw_clock(rng, near_edge)
    first = first_transmission(mine, 0)
    interval = int(rng.choice([WINDOW, 72, 73, 80, 144, 600]))
    interlaced = interval >= 2 * WINDOW and bool(rng.integers(2))
    repetitions = int(rng.choice([1, 2, 3, 16]))
    estimate = int(rng.choice([0, 4 * int(rng.integers(WRAP // 4))]))
    ids = IdTrain(mine, first, first + 4 * int(rng.integers(1, 400)), repetitions, "AB"[rng.integers(2)], estimate)
    return ids, ScanWindows(theirs, int(rng.integers(interval)), interval, interlaced)


@pytest.mark.slow
def test_the_next_meeting_is_the_first_tick_at_which_channels_agree_inside_a_window():
    found = second = 0
    for case in range(400):
        rng = np.random.default_rng([1, case])
        ids, windows = draw_case(rng)
        tick = ids.first + int(rng.integers(-5, 40))
        since = int(rng.integers(-5 * MS, 60 * MS))
        expected = meeting_by_looking(ids, windows, tick, since)
        assert next_meeting(ids, windows, tick, since) == expected, f"case {case}"
        found += expected is not None
        second += expected is not None and expected.second
    assert found > 150
    assert second > 20


def draw_aligned_case(rng):
    """Clocks of whole ticks without drift, so that every edge coincides with the start of an ID, in short trains."""
    block, other = (int(rng.integers(1, 32)) << 12 for _ in range(2))
    mine = NativeClock((block - int(rng.integers(48))) * TICK)
    theirs = NativeClock((other - int(rng.integers(-4, 60))) * TICK)
    first = first_transmission(mine, 0)
    interval = int(rng.choice([WINDOW, 72, 80]))
    ids = IdTrain(mine, first, first + 4 * int(rng.integers(1, 20)), int(rng.integers(1, 3)), "AB"[rng.integers(2)])
    return ids, ScanWindows(theirs, int(rng.integers(interval)), interval, interval > WINDOW and bool(rng.integers(2)))


@pytest.mark.slow
def test_edges_that_coincide_with_the_start_of_an_id_are_on_the_right_side_of_it():
    found = 0
    for case in range(3000):
        rng = np.random.default_rng([3, case])
        ids, windows = draw_aligned_case(rng)
        expected = meeting_by_looking(ids, windows, ids.first, 0)
        assert next_meeting(ids, windows, ids.first, 0) == expected, f"case {case}"
        found += expected is not None
    assert found > 800


def test_without_windows_an_id_counts_if_it_lies_between_two_instants():
    found = 0
    for case in range(200):
        rng = np.random.default_rng([2, case])
        ids, windows = draw_case(rng)
        since = int(rng.integers(30 * MS))
        until = since + int(rng.integers(80 * MS))
        expected = meeting_by_looking(ids, windows, ids.first, since, until)
        assert next_meeting_between(ids, windows.clock, ids.first, since, until) == expected, f"case {case}"
        found += expected is not None
    assert found > 50


def test_an_id_that_ends_with_the_interval_is_heard_and_one_nanosecond_later_is_not():
    ids = IdTrain(NativeClock(0), 0, 64, 1)
    clock = NativeClock(0)
    heard = next_meeting_between(ids, clock, 0, 0, 1000 * MS)
    assert heard is not None
    start = ids.clock.time_of(heard.tick)
    assert next_meeting_between(ids, clock, 0, start, start + ID) == heard
    assert next_meeting_between(ids, clock, 0, start, start + ID - 1) is None
    assert next_meeting_between(ids, clock, 0, start + 1, start + ID + 1) is None


def test_far_from_the_start_of_a_run_the_arithmetic_stays_inside_64_bits():
    clock = NativeClock(WRAP * TICK - 1, 250)
    now = 400 * 24 * 3600 * 10**9
    first = first_transmission(clock, now)
    ids = IdTrain(clock, first, first + 400, 1)
    windows = ScanWindows(NativeClock(12345, -250), 17, 144)
    assert next_meeting(ids, windows, first, now) == meeting_by_looking(ids, windows, first, now)


@pytest.mark.parametrize(("now", "tick"), [(0, 4), (TICK, 4), (TICK + 1, 8), (5 * TICK, 8)])
def test_transmission_begins_with_the_first_transmit_slot_at_or_after_now(now, tick):
    assert first_transmission(NativeClock(3 * TICK), now) == tick


@pytest.mark.parametrize("settings", [{"interval_s": 0.0115}, {"interval_s": 0.02, "interlaced": True}])
def test_scan_intervals_that_no_clock_can_keep_are_refused(settings):
    with pytest.raises(ValueError, match="interval_s"):
        ScanSettings(**settings)
