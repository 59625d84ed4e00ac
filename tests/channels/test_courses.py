"""Courses write what has come true, however often somebody looks, and nothing else."""

from collections.abc import Iterator

from hypothesis import given
from hypothesis import strategies as st

from cosim.channels.courses import Courses, Phase
from cosim.intervals import Intervals
from cosim.trace import INTERVALS, Trace

END = 60
PLANS = st.lists(
    st.tuples(
        st.integers(0, END),  # when it is planned
        st.lists(st.tuples(st.integers(0, 30), st.sampled_from(("", "scan", "backoff", "windows"))), max_size=4),
    ),
    max_size=5,
).map(lambda plans: sorted(plans, key=lambda plan: plan[0]))


def windows(start: int, end: int) -> Iterator[tuple[int, int, str]]:
    """Yield the parts of [start, end) in the first 3 of every 7."""
    for opening in range(start // 7 * 7, end, 7):
        if max(opening, start) < min(opening + 3, end):
            yield max(opening, start), min(opening + 3, end), ""


def phases(now: int, steps: list[tuple[int, str]]) -> list[Phase]:
    found = []
    for length, state in steps:
        found.append(Phase(now, state, parts=windows if state == "windows" else None))
        now += length
    return found


def instant_by_instant(plans: list[tuple[int, list[tuple[int, str]]]]) -> list[tuple[int, int, str]]:
    """Return (start, end, state) of the rows: what it does at every instant is that of the latest plan."""
    doing = [""] * END
    for now, steps in plans:
        doing[now:] = [""] * (END - now)
        for phase in phases(now, steps):
            for time in range(phase.since, END):
                doing[time] = "" if phase.state == "windows" and time % 7 >= 3 else phase.state
    rows, begin = [], 0
    for time in range(1, END + 1):
        if time == END or doing[time] != doing[begin]:
            if doing[begin]:
                rows.append((begin, time, doing[begin]))
            begin = time
    return rows


@given(PLANS, st.sets(st.integers(0, END), max_size=5))
def test_rows_are_those_of_looking_at_every_instant(
    plans: list[tuple[int, list[tuple[int, str]]]], looks: set[int]
) -> None:
    trace = Trace((INTERVALS,))
    courses = Courses(Intervals(trace))
    course = courses.begin(3)
    under_way = []
    for now in range(END):
        for time, steps in plans:
            if time == now:
                course.plan(now, *phases(now, steps))
        if now in looks:
            under_way += courses.under_way(now)
    courses.close(END)
    columns = trace.columns("intervals")
    rows = list(zip(columns["start_ns"], columns["end_ns"], columns["state"], strict=True))
    assert rows == instant_by_instant([plan for plan in plans if plan[0] < END])
    assert set(columns["robot"]) <= {3}
    for row in under_way:
        assert any(row.start == start and row.end <= end and row.state == state for start, end, state in rows), row


def test_a_course_that_has_ended_is_forgotten_and_one_that_nobody_wants_keeps_nothing() -> None:
    trace = Trace((INTERVALS,))
    courses = Courses(Intervals(trace))
    course = courses.begin(0)
    course.plan(0, Phase(0, "scan"))
    courses.end(course, 5)
    courses.end(course, 9)
    courses.close(10)
    assert trace.columns("intervals")["end_ns"] == [5]
    unwanted = Courses()
    unwanted.begin(0).plan(0, Phase(0, "scan"))
    assert not unwanted.wanted
    assert unwanted.under_way(5) == []
