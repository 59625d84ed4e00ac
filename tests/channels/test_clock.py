"""A native clock is exact: its inverse is one, however far it has run and whatever its drift."""

from fractions import Fraction
from math import floor

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from cosim.channels.clock import NativeClock
from cosim.units import SLOT, TICK, S

DAY = 86_400 * S
WRAP = 1 << 28
"""Ticks after which the 28 bits of the specification's clock begin anew: 23.3 h."""

clocks = st.builds(NativeClock, st.integers(0, WRAP * TICK - 1), st.integers(-250, 250))
times = st.integers(0, 400 * DAY)


def drifted(clock: NativeClock, time: int) -> int:
    """The definition, by fractions: the phase, and the time at the clock's own rate, rounded down."""
    return clock.phase + floor(Fraction(time) * (1 + Fraction(clock.ppm, 1_000_000)))


@given(clocks, times)
@example(NativeClock(0, -1), 1)
@example(NativeClock(0, 20), 49_999)
@example(NativeClock(0, 20), 50_000)
def test_local_time_is_phase_and_drifted_time_rounded_down(clock: NativeClock, time: int):
    assert clock.local(time) == drifted(clock, time)
    assert clock.tick(time) == drifted(clock, time) // TICK


@given(clocks, st.integers(0, 800 * DAY))
def test_at_local_is_the_first_instant_of_that_local_time(clock: NativeClock, local: int):
    time = clock.at_local(local)
    assert clock.local(time) >= local
    assert clock.local(time - 1) < local


@given(clocks, times)
def test_a_tick_begins_where_the_clock_says_and_lasts_till_the_next(clock: NativeClock, time: int):
    tick = clock.tick(time)
    begin = clock.time_of(tick)
    assert begin <= time < clock.time_of(tick + 1)
    assert clock.tick(begin) == tick
    assert clock.tick(begin - 1) == tick - 1


@pytest.mark.parametrize("ppm", [-20, 0, 20])
def test_ticks_go_on_where_28_bits_wrap(ppm: int):
    clock = NativeClock((WRAP - 1) * TICK, ppm)
    assert clock.tick(0) == WRAP - 1
    edge = clock.time_of(WRAP)
    assert clock.tick(edge - 1) == WRAP - 1
    assert clock.tick(edge) == WRAP


def test_a_clock_without_drift_runs_at_two_ticks_a_slot():
    clock = NativeClock(5)
    assert clock.time_of(2) == SLOT - 5
    assert [clock.tick(time) for time in (0, TICK - 6, TICK - 5, SLOT - 5)] == [0, 0, 1, 2]


def test_a_fast_clock_gains_its_ppm():
    assert NativeClock(0, 20).local(1_000 * S) - NativeClock(0, 0).local(1_000 * S) == 20_000_000
    assert NativeClock(0, -20).time_of(3_200_000) > NativeClock(0, 0).time_of(3_200_000)
