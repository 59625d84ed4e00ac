"""The order of events, half-open runs, exact integer time, and loud refusals."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.errors import CosimError, LocalProtocolError, UserError, WireError
from cosim.kernel import AIR, DELIVER, STOP, WAKE, WORLD, Callback, Kernel
from cosim.units import S


class Log:
    """A kernel and what it has called, in order, as (time, name)."""

    def __init__(self) -> None:
        self.kernel = Kernel()
        self.entries: list[tuple[int, Any]] = []

    def note(self, name: Any) -> Callable[[], None]:
        return lambda: self.entries.append((self.kernel.now, name))

    @property
    def names(self) -> list[Any]:
        return [name for _, name in self.entries]


@pytest.fixture
def log() -> Log:
    return Log()


# ---------------------------------------------------------------- order


def test_phases_of_one_instant_come_in_their_order_however_they_were_inserted(log: Log):
    phases = {"air": AIR, "wake": WAKE, "deliver": DELIVER, "world": WORLD}
    for name, priority in phases.items():
        log.kernel.at(10, log.note(name), priority)
    log.kernel.run(11)
    assert log.names == ["world", "deliver", "wake", "air"]
    assert STOP < WORLD < 0 < DELIVER < WAKE < AIR  # 0 is SimPy's urgent


def test_simpys_own_urgent_events_come_between_the_world_and_deliveries(log: Log):
    environment = log.kernel.environment

    def process() -> Any:
        log.note("process")()
        yield environment.event()

    def world() -> None:
        environment.process(process())
        log.note("world")()

    log.kernel.at(5, log.note("deliver"))
    log.kernel.at(5, world, WORLD)
    log.kernel.run(6)
    assert log.names == ["world", "process", "deliver"]


@given(st.lists(st.tuples(st.integers(0, 3), st.sampled_from([WORLD, DELIVER, WAKE, AIR])), max_size=30))
def test_events_come_by_time_then_priority_then_insertion(plan: list[tuple[int, int]]):
    log = Log()
    for number, (time, priority) in enumerate(plan):
        log.kernel.at(time, log.note((time, priority, number)), priority)
    log.kernel.run(4)
    assert log.names == sorted((time, priority, number) for number, (time, priority) in enumerate(plan))
    assert [time for time, _ in log.entries] == [time for time, *_ in log.names]


def test_what_is_scheduled_for_now_still_comes_now_after_what_waits(log: Log):
    def first() -> None:
        log.kernel.at(10, log.note("third"))
        log.note("first")()

    log.kernel.at(10, first)
    log.kernel.at(10, log.note("second"))
    log.kernel.run(11)
    assert log.entries == [(10, "first"), (10, "second"), (10, "third")]


# ---------------------------------------------------------------- runs


def test_a_run_is_half_open(log: Log):
    for time in (9, 10):
        for priority in (WORLD, DELIVER, WAKE):
            log.kernel.at(time, log.note(time), priority)
    log.kernel.run(10)
    assert log.names == [9, 9, 9]
    assert log.kernel.now == 10
    log.kernel.run(11)
    assert log.names[3:] == [10, 10, 10]


def chain(log: Log, delays: list[int]) -> Callable[[], None]:
    """Return a callback that notes itself and schedules the next after the first of *delays*, in turning phases."""

    def fire() -> None:
        log.note(len(delays))()
        if delays:
            log.kernel.after(delays[0], chain(log, delays[1:]), AIR)

    return fire


@given(st.lists(st.integers(0, 5), max_size=10), st.lists(st.integers(0, 40), max_size=5))
def test_a_run_in_pieces_is_the_run_in_one(delays: list[int], stops: list[int]):
    whole, pieces = Log(), Log()
    for log in (whole, pieces):
        log.kernel.at(0, chain(log, delays), AIR)
        log.kernel.at(3, chain(log, delays[::-1]), AIR)
    whole.kernel.run(60)
    for stop in [*sorted(stops), 60]:
        pieces.kernel.run(stop)
        assert pieces.kernel.now == stop
    assert pieces.entries == whole.entries
    assert pieces.kernel.executed == whole.kernel.executed


def test_a_run_without_events_moves_the_clock(log: Log):
    log.kernel.run(7)
    log.kernel.run(7)
    assert log.kernel.now == 7


def test_a_run_into_the_past_is_refused(log: Log):
    log.kernel.run(7)
    with pytest.raises(LocalProtocolError, match="until 6 ns: it is 7 ns"):
        log.kernel.run(6)


def test_a_run_inside_of_a_run_is_refused(log: Log):
    log.kernel.at(1, lambda: log.kernel.run(5))
    with pytest.raises(LocalProtocolError, match="inside of a run"):
        log.kernel.run(10)


def test_executed_events_are_counted_and_cancelled_ones_are_not(log: Log):
    for time in range(5):
        log.kernel.at(time, log.note(time))
    log.kernel.at(3, log.note("never")).cancel()
    log.kernel.run(4)
    assert log.kernel.executed == 4


# ---------------------------------------------------------------- cancel and stop


def test_a_cancelled_handle_is_not_called(log: Log):
    handle = log.kernel.at(5, log.note("no"))
    log.kernel.at(5, log.note("yes"))
    handle.cancel()
    handle.cancel()
    log.kernel.run(10)
    assert log.names == ["yes"]


def test_cancelling_too_late_or_from_within_is_harmless(log: Log):
    def fire() -> None:
        handle.cancel()
        log.note("fired")()

    handle = log.kernel.at(5, fire)
    log.kernel.run(10)
    handle.cancel()
    log.kernel.run(20)
    assert log.names == ["fired"]


def test_an_event_may_cancel_another_of_the_same_instant(log: Log):
    log.kernel.at(5, lambda: later.cancel())
    later = log.kernel.at(5, log.note("later"))
    log.kernel.run(6)
    assert log.names == []


def test_a_handle_knows_its_time(log: Log):
    assert log.kernel.after(5, log.note("x")).time == 5


def test_stop_ends_the_run_right_after_its_callback(log: Log):
    def stop() -> None:
        log.kernel.stop()
        log.note("stopping")()

    log.kernel.at(5, stop)
    log.kernel.at(5, log.note("same instant"))
    log.kernel.at(6, log.note("later"))
    log.kernel.run(10)
    assert log.entries == [(5, "stopping")]
    assert log.kernel.now == 5


def test_a_run_goes_on_after_a_stop_and_to_its_own_end(log: Log):
    log.kernel.at(5, log.kernel.stop)
    for time in (5, 8, 12, 20):
        log.kernel.at(time, log.note(time))
    log.kernel.run(10)
    assert log.names == []
    log.kernel.run(15)  # the end at 10 that was not reached is no end of this run
    assert log.names == [5, 8, 12]
    assert log.kernel.now == 15


def test_stopping_twice_ends_one_run(log: Log):
    def stop() -> None:
        log.kernel.stop()
        log.kernel.stop()

    log.kernel.at(5, stop)
    log.kernel.run(10)
    log.kernel.run(10)
    assert log.kernel.now == 10


def test_there_is_nothing_to_stop_outside_of_a_run(log: Log):
    with pytest.raises(LocalProtocolError, match="nothing runs"):
        log.kernel.stop()
    log.kernel.run(5)
    with pytest.raises(LocalProtocolError, match="nothing runs"):
        log.kernel.stop()


# ---------------------------------------------------------------- refusals


def test_the_past_is_refused(log: Log):
    log.kernel.run(10)
    with pytest.raises(LocalProtocolError, match="scheduled at 9 ns, priority 1, but it is 10 ns"):
        log.kernel.at(9, log.note("past"))
    with pytest.raises(LocalProtocolError):
        log.kernel.after(-1, log.note("past"))


@pytest.mark.parametrize(("running", "wanted"), [(DELIVER, WORLD), (WAKE, DELIVER), (AIR, WAKE)])
def test_a_phase_that_is_over_is_refused(log: Log, running: int, wanted: int):
    log.kernel.at(10, lambda: log.kernel.at(10, log.note("late"), wanted), running)
    with pytest.raises(LocalProtocolError, match=f"priority {wanted}, but it is 10 ns, phase {running}"):
        log.kernel.run(11)


@pytest.mark.parametrize("phase", [WORLD, DELIVER, WAKE, AIR])
def test_the_running_phase_and_a_later_instant_are_open(log: Log, phase: int):
    def fire() -> None:
        log.kernel.after(0, log.note("now"), phase)
        log.kernel.after(1, log.note("next"), WORLD)

    log.kernel.at(10, fire, phase)
    log.kernel.run(12)
    assert log.entries == [(10, "now"), (11, "next")]


def test_a_phase_of_an_earlier_instant_closes_nothing(log: Log):
    log.kernel.at(10, log.note("air"), AIR)
    log.kernel.run(11)
    log.kernel.at(11, log.note("world"), WORLD)
    log.kernel.run(12)
    assert log.names == ["air", "world"]


@pytest.mark.parametrize("phase", [WORLD, DELIVER, WAKE, AIR])
def test_soon_is_a_new_event_of_this_instant_in_whatever_phase(log: Log, phase: int):
    def fire() -> None:
        log.kernel.soon(log.note("soon"))
        log.note("fired")()

    log.kernel.at(10, fire, phase)
    log.kernel.run(11)
    assert log.entries == [(10, "fired"), (10, "soon")]
    assert log.kernel.phase == (10, max(phase, DELIVER))


def test_soon_outside_of_a_run_is_a_delivery_of_the_next(log: Log):
    log.kernel.at(4, log.note("air"), AIR)
    log.kernel.run(5)
    log.kernel.at(5, log.note("wake"), WAKE)
    log.kernel.soon(log.note("soon"))
    assert log.names == ["air"]
    log.kernel.run(6)
    assert log.entries[1:] == [(5, "soon"), (5, "wake")]


# ---------------------------------------------------------------- exact time


def test_numpy_integers_become_exact_ints(log: Log):
    log.kernel.at(np.int64(2**62 + 1), log.note("far"))
    log.kernel.after(np.int32(7), log.note("near"))
    log.kernel.run(np.int64(10))
    assert type(log.kernel.now) is int
    log.kernel.run(2**62 + 2)
    assert log.entries == [(7, "near"), (2**62 + 1, "far")]
    assert {type(time) for time, _ in log.entries} == {int}
    assert log.kernel.after(np.int32(7), log.note("narrow")).time == 2**62 + 9


@pytest.mark.parametrize("time", [1.0, 625e-6, "1", None, np.float64(3)])
def test_what_is_no_integer_is_refused(log: Log, time: Any):
    for call in (
        log.kernel.run,
        lambda t: log.kernel.at(t, log.note("x")),
        lambda t: log.kernel.after(t, log.note("x")),
        lambda t: log.kernel.alarm(log.note("x")).set(t, DELIVER),
    ):
        with pytest.raises(TypeError):
            call(time)


def test_simpys_clock_stays_an_exact_int(log: Log):
    slot, seen = 625_000, []

    def tick() -> None:
        seen.append(type(log.kernel.environment.now))
        log.kernel.after(np.int64(slot), tick)

    log.kernel.at(0, tick)
    log.kernel.run(S)
    assert len(seen) == 1600
    assert set(seen) == {int}
    assert log.kernel.now == S


# ---------------------------------------------------------------- exceptions


class OddError(Exception):
    """An error whose text is not its argument."""

    def __str__(self) -> str:
        return f"odd {self.args[0]}"


@pytest.mark.parametrize("kind", [UserError, LocalProtocolError, WireError, CosimError, KeyError, OddError])
def test_an_exception_leaves_the_run_with_its_own_type_and_text(log: Log, kind: type[Exception]):
    error = kind("robot 3")

    def fail() -> None:
        raise error

    log.kernel.at(5, fail)
    with pytest.raises(kind) as caught:
        log.kernel.run(10)
    assert caught.value is error
    assert log.kernel.now == 5


@pytest.mark.parametrize("kind", [UserError, LocalProtocolError, WireError, CosimError])
def test_an_exception_of_a_simpy_process_leaves_the_run_with_its_type_and_text(log: Log, kind: type[Exception]):
    def process() -> Any:
        yield log.kernel.environment.timeout(5)
        raise kind("robot 3")

    log.kernel.environment.process(process())
    with pytest.raises(kind, match=r"^robot 3$") as caught:
        log.kernel.run(10)
    assert type(caught.value) is kind


def test_after_an_exception_the_rest_can_still_be_run(log: Log):
    def fail() -> None:
        log.kernel.stop()
        raise UserError("once")

    log.kernel.at(5, fail)
    log.kernel.at(6, log.note("rest"))
    with pytest.raises(UserError):
        log.kernel.run(10)
    log.kernel.run(20)
    assert log.entries == [(6, "rest")]
    assert log.kernel.now == 20


# ---------------------------------------------------------------- again and again


def test_what_repeats_is_called_after_every_period_until_it_is_cancelled():
    kernel, seen = Kernel(), []
    handle = kernel.every(10, lambda: seen.append(kernel.now))
    kernel.run(35)
    assert seen == [10, 20, 30]
    handle.cancel()
    kernel.run(100)
    assert seen == [10, 20, 30]
    assert kernel.executed == 3


def test_what_repeats_can_be_cancelled_by_itself():
    kernel, seen = Kernel(), []

    def twice() -> None:
        seen.append(kernel.now)
        if len(seen) == 2:
            handle.cancel()

    handle = kernel.every(10, twice, WORLD)
    kernel.run(100)
    assert seen == [10, 20]


def test_what_repeats_is_scheduled_anew_when_its_callback_has_returned():
    def order(repeat: Callable[[Kernel, Callback], None]) -> list[tuple[int, str]]:
        kernel, seen = Kernel(), []

        def tick() -> None:
            seen.append((kernel.now, "tick"))
            kernel.at(kernel.now + 10, lambda: seen.append((kernel.now, "of the tick")))

        repeat(kernel, tick)
        kernel.at(10, lambda: seen.append((10, "other")))
        kernel.at(5, lambda: kernel.at(20, lambda: seen.append((20, "early"))))
        kernel.run(40)
        return seen

    def by_hand(kernel: Kernel, tick: Callback) -> None:
        def again() -> None:
            tick()
            kernel.after(10, again)

        kernel.after(10, again)

    found = order(lambda kernel, tick: kernel.every(10, tick))
    assert found == order(by_hand)
    assert found[3:5] == [(20, "of the tick"), (20, "tick")]


def test_a_run_that_is_stopped_by_what_repeats_goes_on_with_it():
    kernel, seen = Kernel(), []

    def tick() -> None:
        seen.append(kernel.now)
        if len(seen) == 1:
            kernel.stop()

    kernel.every(10, tick, WORLD)
    kernel.run(100)
    assert (kernel.now, seen) == (10, [10])
    kernel.run(25)
    assert seen == [10, 20]


@pytest.mark.parametrize("period", [0, -1])
def test_a_period_that_does_not_pass_is_our_own_misuse(period: int):
    with pytest.raises(LocalProtocolError, match="time would not go on"):
        Kernel().every(period, lambda: None)


def test_soon_keeps_its_place_among_what_is_due_at_this_instant(log: Log):
    def fire() -> None:
        log.kernel.soon(lambda: (log.note("soon")(), log.kernel.soon(log.note("from it"))))
        log.kernel.at(10, log.note("after it"))

    log.kernel.at(10, fire)
    log.kernel.at(10, log.note("before it"))
    log.kernel.at(10, log.note("wake"), WAKE)
    log.kernel.run(11)
    assert log.names == ["before it", "soon", "after it", "from it", "wake"]


def test_soon_is_seen_by_peek_and_waits_behind_a_stop(log: Log):
    def fire() -> None:
        log.kernel.soon(log.note("soon"))
        assert log.kernel.peek() == (10, WAKE)
        log.kernel.stop()

    log.kernel.at(10, fire, WAKE)
    log.kernel.run(11)
    assert log.names == []
    log.kernel.run(11)
    assert log.names == ["soon"]


# ---------------------------------------------------------------- alarms


def test_an_alarm_keeps_its_place_among_what_is_due_at_its_instant(log: Log):
    alarm = log.kernel.alarm(log.note("alarm"))
    log.kernel.at(10, log.note("before it"))
    alarm.set(10, DELIVER)
    log.kernel.at(10, log.note("after it"))
    log.kernel.at(10, log.note("world"), WORLD)
    assert log.kernel.peek() == (10, WORLD)
    log.kernel.run(11)
    assert log.names == ["world", "before it", "alarm", "after it"]
    assert log.kernel.phase == (10, DELIVER)
    assert log.kernel.executed == 4


@pytest.mark.parametrize("first", [5, 20])
def test_an_alarm_that_is_set_again_rings_once_and_then(log: Log, first: int):
    alarm = log.kernel.alarm(log.note("alarm"))
    alarm.set(first, AIR)
    alarm.set(10, WAKE)
    assert log.kernel.peek() == (10, WAKE)
    log.kernel.run(30)
    assert log.entries == [(10, "alarm")]
    alarm.set(40, WAKE)
    log.kernel.run(50)
    assert log.entries == [(10, "alarm"), (40, "alarm")]


def test_two_alarms_ring_in_their_order_and_may_be_set_from_within(log: Log):
    def ring() -> None:
        log.note("first")()
        if log.kernel.now < 20:
            one.set(log.kernel.now + 7, DELIVER)

    one, other = log.kernel.alarm(ring), log.kernel.alarm(log.note("second"))
    other.set(13, DELIVER)
    one.set(6, DELIVER)
    log.kernel.run(30)
    assert log.entries == [(6, "first"), (13, "second"), (13, "first"), (20, "first")]


def test_what_repeats_does_not_overtake_an_alarm(log: Log):
    alarm = log.kernel.alarm(log.note("alarm"))
    log.kernel.every(10, log.note("tick"), WORLD)
    alarm.set(20, DELIVER)
    log.kernel.run(31)
    assert log.entries == [(10, "tick"), (20, "tick"), (20, "alarm"), (30, "tick")]


@pytest.mark.parametrize("wanted", [(9, AIR), (10, WORLD)])
def test_an_alarm_is_not_set_to_what_is_over(log: Log, wanted: tuple[int, int]):
    alarm = log.kernel.alarm(log.note("alarm"))

    def fire() -> None:
        with pytest.raises(LocalProtocolError, match="but it is 10 ns"):
            alarm.set(*wanted)

    log.kernel.at(10, fire)
    log.kernel.run(11)
    with pytest.raises(LocalProtocolError, match="but it is 11 ns"):
        alarm.set(10, AIR)
    log.kernel.run(20)
    assert log.names == []


def test_an_alarm_waits_for_a_later_run_behind_an_end_or_a_stop(log: Log):
    alarm = log.kernel.alarm(log.note("alarm"))
    alarm.set(10, DELIVER)
    log.kernel.run(10)
    assert log.names == []
    log.kernel.at(10, log.kernel.stop, WORLD)
    log.kernel.run(20)
    assert (log.kernel.now, log.names) == (10, [])
    log.kernel.run(20)
    assert log.entries == [(10, "alarm")]
