"""The routing table of AODV: sequence numbers, routes that end, and those that were merely heard."""

from collections.abc import Callable

from hypothesis import example, given, settings
from hypothesis import strategies as st

from cosim.channels.adhoc.routing.aodv_routes import ENOUGH, RouteTable, newer
from cosim.units import S, Time


@example(0xFFFFFFFF, 1)
@given(st.integers(0, 0xFFFFFFFF), st.integers(1, 0x7FFFFFFF))
def test_sequence_numbers_are_compared_across_the_wrap(number: int, step: int) -> None:
    later = number + step & 0xFFFFFFFF
    assert newer(later, number)
    assert not newer(number, later)
    assert not newer(number, number)


def test_a_route_that_ends_takes_the_next_number_across_the_wrap() -> None:
    table = RouteTable(0, 15 * S)
    table.offer(1, 2, 3, 0xFFFFFFFF, 10 * S)
    table.end(1, S)
    ended = table.get(1)
    assert ended is not None
    assert (ended.sequence, ended.active) == (0, False)
    assert not table.offer(1, 2, 1, 0xFFFFFFFF, 10 * S)
    assert table.offer(1, 2, 9, 0, 10 * S)


def test_a_table_takes_newer_routes_and_shorter_ones_as_new() -> None:
    table = RouteTable(0, 15 * S)
    assert table.offer(1, 2, 3, 5, 9 * S)
    assert not table.offer(1, 3, 3, 5, 9 * S)
    assert table.offer(1, 3, 2, 5, 9 * S)
    assert not table.offer(1, 2, 1, 4, 9 * S)
    assert table.offer(1, 2, 7, 6, 9 * S)
    assert not table.offer(0, 2, 7, 6, 9 * S)  # to itself


def test_an_unused_route_ends_and_is_forgotten_later() -> None:
    table = RouteTable(0, 15 * S)
    table.offer(1, 2, 3, 5, 3 * S)
    table.age(3 * S - 1)
    assert table.active(1) is not None
    table.age(3 * S)
    ended = table.get(1)
    assert ended is not None
    assert (ended.active, ended.sequence) == (False, 6)
    table.age(18 * S - 1)
    assert table.get(1) is not None
    table.age(18 * S)
    assert table.get(1) is None


def test_a_route_that_was_merely_heard_ends_without_another_number() -> None:
    table = RouteTable(0, 15 * S)
    table.offer(1, 1, 1, 5, 10 * S)
    for _ in range(3):
        table.end(1, S)
        table.hear(1, 10 * S)
    heard = table.get(1)
    assert heard is not None
    assert (heard.sequence, heard.known, heard.active) == (6, False, True)
    table.hear(1, 10 * S, 5)
    assert not heard.known
    table.hear(1, 10 * S, 6)
    assert heard.known


NEAR = st.integers(1, 4)
LASTS = st.integers(-2, 12)
CHANGES = st.one_of(
    st.tuples(st.just("offer"), NEAR, NEAR, st.integers(1, 3), st.integers(1, 9), LASTS),
    st.tuples(st.just("hear"), NEAR, LASTS, st.none() | st.integers(1, 9)),
    st.tuples(st.just("prolong"), NEAR, LASTS),
    st.tuples(st.just("keep"), NEAR, LASTS),
    st.tuples(st.just("end"), NEAR),
)


@settings(deadline=None)
@given(st.lists(st.tuples(st.integers(0, 8), st.lists(CHANGES, max_size=4)), max_size=25))
def test_a_table_that_is_asked_seldom_knows_what_one_knows_that_is_asked_always(instants: list[tuple]) -> None:
    seldom, always = RouteTable(0, 15), RouteTable(0, 15)
    now = 0
    for step, changes in instants:
        now += step
        for table in (seldom, always):
            table.age(now)
        for each in range(5):  # ends all whose time has come, and forgets those that ended long ago
            always.get(each)
        for change in changes:
            assert _change(seldom, change, now) == _change(always, change, now)
    for table in (seldom, always):
        table.age(now + 1)
    assert seldom.destinations() == always.destinations()
    assert [seldom.through(each) for each in range(5)] == [always.through(each) for each in range(5)]
    assert [seldom.get(each) for each in range(5)] == [always.get(each) for each in range(5)]


def _change(table: RouteTable, change: tuple, now: Time) -> object:
    what, destination, *rest = change
    method: Callable[..., object] = getattr(table, what)
    match what:
        case "hear":
            return method(destination, now + rest[0], rest[1])
        case "prolong":
            return method((destination,), now + rest[0])
        case "end":
            return method(destination, now) if table.active(destination) else None
        case _:
            return method(destination, *rest[:-1], now + rest[-1])


def test_a_route_that_is_over_when_it_comes_lasts_until_the_next_input() -> None:
    table = RouteTable(0, 15 * S)
    table.age(S)
    table.offer(1, 2, 3, 5, S)
    assert table.active(1) is not None
    table.age(S)
    assert table.active(1) is None


def test_a_table_does_not_keep_what_is_over_for_ever() -> None:
    table = RouteTable(0, S)
    for robot in range(1, 20 * ENOUGH):
        table.age(robot * S)
        table.hear(robot, (robot + 1) * S)
    assert len(table._routes) <= 2 * ENOUGH
