"""A clock that stands still while the host's is set back."""

from protocols.transport.transport import SteadyClock


def test_a_clock_that_is_set_back_stands_still_and_goes_on_from_there() -> None:
    clock = SteadyClock(100)
    assert [clock.read(now) for now in (100, 110, 50, 57, 20, 20, 31)] == [100, 110, 110, 117, 117, 117, 128]
    assert (clock.now, clock.behind) == (128, 97)


def test_a_clock_that_is_behind_its_start_when_it_is_read_first_stands_still() -> None:
    clock = SteadyClock(100)
    assert (clock.read(90), clock.read(95)) == (100, 105)
