"""Time is an exact count of nanoseconds; only its edges know seconds."""

from hypothesis import given
from hypothesis import strategies as st

from cosim.units import MS, NS, SLOT, TICK, US, S, from_seconds, to_seconds


def test_units_are_whole_multiples_of_each_other():
    assert (US, MS, S) == (1000 * NS, 1000 * US, 1000 * MS)
    assert SLOT == 625 * US
    assert 2 * TICK == SLOT
    assert 1600 * SLOT == S


def test_seconds_become_the_nearest_nanosecond_and_an_int():
    assert from_seconds(0.000625) == SLOT
    assert from_seconds(0.1) == 100 * MS
    assert from_seconds(1.4e-9) == 1
    assert from_seconds(1.6e-9) == 2
    assert from_seconds(-1.6e-9) == -2
    assert type(from_seconds(1.0)) is int


@given(st.integers(-(2**50), 2**50))
def test_a_time_of_days_survives_the_way_through_seconds(time: int):
    assert from_seconds(to_seconds(time)) == time
