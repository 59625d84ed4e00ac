"""Where a host will be by its way points: against interpolation, small steps and shapely; interception; plans."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.optimize import brentq
from shapely.geometry import LineString

from cosim.errors import LocalProtocolError
from cosim.geometry.planning import Point
from cosim.units import MS, S, Time, from_seconds
from protocols.aggregation.course import Course, course_of, interception, plan_of
from protocols.aggregation.frames import CLOCK_MS, decode, encode
from protocols.aggregation.messages import Plan, Plans

CORNER = Course(100 * S, 1.0, ((0.0, 0.0), (10.0, 0.0), (10.0, 5.0), (4.0, 5.0)))
"""Legs of 10 s to the right, 5 s up, 6 s to the left."""

coordinates = st.integers(-20_000, 20_000).map(lambda cm: cm / 100)
ways = st.lists(st.tuples(coordinates, coordinates), min_size=1, max_size=7).map(tuple)
courses = st.builds(Course, st.integers(0, 10**13), st.integers(2, 200).map(lambda cm: cm / 100), ways)
longer = st.floats(-0.2, 1.3)
"""When to ask, in parts of the whole journey."""


def asked(course: Course, part: float) -> Time:
    return course.departed + from_seconds(part * (course.length_m / course.speed_mps + 1.0))


def interpolated(course: Course, at: Time) -> Point:
    """Where the host is, by numpy.interp over the cumulative lengths."""
    way = np.array(course.way_m)
    along = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1))))
    gone = course.speed_mps * ((at - course.departed) / S)
    return float(np.interp(gone, along, way[:, 0])), float(np.interp(gone, along, way[:, 1]))


# ---------------------------------------------------------------- the place


@given(courses, longer)
def test_the_place_is_that_of_interpolation_over_the_length(course: Course, part: float) -> None:
    at = asked(course, part)
    assert course.place(at) == pytest.approx(interpolated(course, at), abs=1e-7)


@given(courses, longer)
def test_the_place_is_that_of_shapely_on_the_line(course: Course, part: float) -> None:
    assume(len(course.way_m) > 1 and course.length_m > 0.0)
    at = asked(course, part)
    gone = max(course.speed_mps * ((at - course.departed) / S), 0.0)  # shapely takes negatives from the end
    point = LineString(course.way_m).interpolate(gone)
    assert course.place(at) == pytest.approx((point.x, point.y), abs=1e-7)


def test_the_place_is_that_of_a_point_that_walks_in_small_steps() -> None:
    course = Course(7 * S, 0.7, ((1.0, 2.0), (4.0, -1.5), (4.0, 3.0), (-2.5, 3.25), (-2.0, 2.0)))
    step = S // 1000
    x, y = course.way_m[0]
    ahead = list(course.way_m[1:])
    for tick in range(30_000):
        assert math.dist(course.place(course.departed + tick * step), (x, y)) < 1e-9 * (tick + 1)
        budget = 0.7 * step / S
        while ahead and budget > 0.0:
            to_x, to_y = ahead[0]
            left = math.hypot(to_x - x, to_y - y)
            if left <= budget:
                x, y = ahead.pop(0)
                budget -= left
            else:
                x, y = x + budget * (to_x - x) / left, y + budget * (to_y - y) / left
                budget = 0.0
    assert not ahead


@pytest.mark.parametrize(
    ("seconds", "place"),
    [
        (-50, (0.0, 0.0)),
        (0, (0.0, 0.0)),
        (4, (4.0, 0.0)),
        (10, (10.0, 0.0)),
        (12, (10.0, 2.0)),
        (15, (10.0, 5.0)),
        (18, (7.0, 5.0)),
        (21, (4.0, 5.0)),
        (1000, (4.0, 5.0)),
    ],
)
def test_a_host_goes_round_corners_and_holds_its_goal(seconds: int, place: Point) -> None:
    assert CORNER.place(CORNER.departed + seconds * S) == pytest.approx(place, abs=1e-9)


def test_equation_3_as_printed_leaves_the_way() -> None:
    way_m = ((0.0, 0.0), (4.0, 0.0), (4.0, 8.0), (24.0, 8.0))  # legs of 4, 8 and 20 s at 1 m/s: right, up, right
    course = Course(0, 1.0, way_m)

    def printed(t: float) -> Point | None:
        """The paper's lines to the letter, its i counted from 1; None where no line holds."""
        takes = [math.dist(way_m[i], way_m[i + 1]) for i in range(3)]
        angles = [math.atan2(way_m[i + 1][1] - way_m[i][1], way_m[i + 1][0] - way_m[i][0]) for i in range(3)]
        legs = [0] if t <= takes[0] else [i for i in (1,) if takes[i] <= t <= takes[i + 1]]
        for i in legs:
            return way_m[i][0] + t * math.cos(angles[i]), way_m[i][1] + t * math.sin(angles[i])
        return None

    assert course.place(3 * S) == pytest.approx(printed(3.0))  # the first leg is right
    assert printed(6.0) is None  # no line for 4 s < t < 8 s
    assert course.place(6 * S) == pytest.approx((4.0, 2.0))
    assert printed(10.0) == pytest.approx((4.0, 10.0))  # 2 m past the corner at (4, 8), which is reached at 12 s
    assert course.place(10 * S) == pytest.approx((4.0, 6.0))


@given(ways, st.integers(-(10**12), 10**12))
def test_a_host_without_speed_stands_at_its_start(way_m: tuple[Point, ...], after: Time) -> None:
    course = Course(0, 0.0, way_m)
    assert course.place(after) == way_m[0]
    assert course.heading(after) is None
    assert course.ends_at() == (0 if course.length_m == 0.0 else None)


@pytest.mark.parametrize("speed_mps", [1e-45, 5e-324, 1e-9])
def test_a_host_so_slow_that_its_clock_overflows_never_arrives(speed_mps: float) -> None:
    course = Course(0, speed_mps, ((1.0, 2.0), (1.0, 2.0), (6.0, 2.0)))
    assert course.ends_at() is None
    assert course.place(10**18) == pytest.approx((1.0, 2.0), abs=1.1)


# ---------------------------------------------------------------- heading, end, length


def test_the_heading_is_that_of_the_leg_in_all_quadrants() -> None:
    start = CORNER.departed
    headings = [CORNER.heading(start + seconds * S) for seconds in (-1, 0, 9, 10, 14, 15, 20, 21, 99)]
    right, up, left = 0.0, math.pi / 2, math.pi
    assert headings == [None, right, right, up, up, left, left, None, None]
    down = Course(0, 1.0, ((0.0, 0.0), (-1.0, -1.0)))
    assert down.heading(0) == pytest.approx(-3 * math.pi / 4)  # arctg of the quotient would say pi / 4


@given(courses, longer)
def test_the_heading_is_where_the_place_goes_next(course: Course, part: float) -> None:
    at = asked(course, part)
    heading = course.heading(at)
    after = at + MS
    assume(heading == course.heading(after))  # not round a corner
    (x, y), (next_x, next_y) = course.place(at), course.place(after)
    if heading is None:
        assert (x, y) == (next_x, next_y)
    else:
        gone = course.speed_mps / 1000
        assert (next_x - x, next_y - y) == pytest.approx(
            (gone * math.cos(heading), gone * math.sin(heading)), abs=1e-9 + gone * 1e-6
        )


@given(courses)
def test_the_way_ends_when_the_goal_is_reached_and_not_before(course: Course) -> None:
    end = course.ends_at()
    assert end is not None
    assert end - course.departed == pytest.approx(course.length_m / course.speed_mps * S, abs=len(course.way_m))
    assert course.place(end) == course.way_m[-1]
    assert course.heading(end) is None
    if end > course.departed:
        assert course.heading(end - 1) is not None


@given(ways)
def test_the_length_is_that_of_the_line(way_m: tuple[Point, ...]) -> None:
    line = LineString(way_m) if len(way_m) > 1 else None
    assert Course(0, 1.0, way_m).length_m == pytest.approx(line.length if line else 0.0)


# ---------------------------------------------------------------- interception


AWAY = Course(0, 0.5, ((0.0, 0.0), (100.0, 0.0)))
"""A host that leaves along the x axis at 0.5 m/s."""


def beeline(here_m: Point) -> Callable[[Point], float]:
    return lambda point: math.dist(here_m, point)


@pytest.mark.parametrize(("rounds", "x_m"), [(0, 10.0), (1, 15.0), (2, 17.5), (3, 18.75), (50, 20.0)])
def test_a_searcher_heads_for_where_the_host_will_be(rounds: int, x_m: float) -> None:
    here, now = (0.0, 0.0), 20 * S  # the host is at 10 m, and is caught at 20 m, 20 s later
    assert interception(AWAY, now, here, 1.0, beeline(here), rounds) == pytest.approx((x_m, 0.0), abs=1e-6)


def test_one_round_is_what_the_paper_says() -> None:
    here = (0.0, 0.0)
    assert interception(AWAY, 20 * S, here, 1.0, beeline(here)) == pytest.approx((15.0, 0.0))


@pytest.mark.parametrize(("length_m", "x_m"), [(30.0, 25.0), (None, 15.0)])
def test_the_planned_way_counts_and_the_straight_line_where_there_is_none(length_m: float | None, x_m: float) -> None:
    asked_for: list[Point] = []

    def way_m(point: Point) -> float | None:
        asked_for.append(point)
        return length_m

    assert interception(AWAY, 20 * S, (10.0, 10.0), 1.0, way_m) == pytest.approx((x_m, 0.0))
    assert asked_for == [pytest.approx((10.0, 0.0))]


def test_a_host_that_cannot_be_caught_is_met_at_its_goal() -> None:
    here = (-4.0, 0.0)
    assert interception(AWAY, 0, here, 0.02, beeline(here), rounds=9) == (100.0, 0.0)


@given(courses, st.floats(0.0, 1.0), st.tuples(coordinates, coordinates), st.floats(1.2, 3.0))
def test_many_rounds_find_where_both_arrive_at_once(course: Course, part: float, here: Point, faster: float) -> None:
    now, speed = asked(course, part), course.speed_mps * faster

    def early(seconds: float) -> float:
        """By how many metres the searcher could have been at the host's place before the host."""
        return speed * seconds - math.dist(here, interpolated(course, now + from_seconds(seconds)))

    horizon = 2000.0 / speed + course.length_m / course.speed_mps
    met = interpolated(course, now + from_seconds(brentq(early, 0.0, horizon, xtol=1e-9)))
    assert interception(course, now, here, speed, beeline(here), rounds=200) == pytest.approx(met, abs=1e-5)


def test_a_searcher_that_stands_meets_nobody() -> None:
    with pytest.raises(LocalProtocolError, match="met at 0"):
        interception(AWAY, 0, (0.0, 0.0), 0.0, beeline((0.0, 0.0)))


# ---------------------------------------------------------------- plans


def told(course: Course, now: Time) -> Course:
    """Return what a searcher makes of *course* when it hears of it."""
    _, message = decode(encode(2, Plans((plan_of(course, 2, 9),))))
    assert isinstance(message, Plans)
    return course_of(message.plans[0], now)


def test_a_plan_tells_the_course() -> None:
    assert plan_of(CORNER, host=3, version=7) == Plan(3, 7, 100_000, 1.0, CORNER.way_m)
    assert course_of(Plan(3, 7, 100_000, 1.0, CORNER.way_m), now=0) == CORNER


@pytest.mark.parametrize("turns", [0, 1, 5])
def test_a_stamp_is_unwrapped_to_the_instant_nearest_to_now(turns: int) -> None:
    wrap = CLOCK_MS * MS
    course = CORNER._replace(departed=turns * wrap + wrap - S)
    plan = plan_of(course, 0, 0)
    for now in (course.departed - 9 * S, course.departed, course.departed + 3 * S):  # before and after the wrap
        assert course_of(plan, now) == course


def test_the_wire_costs_less_than_a_tenth_of_a_millimetre_and_the_way_of_a_millisecond() -> None:
    draws = np.random.default_rng(5)
    rounding, stamping = 0.0, 0.0
    for _ in range(200):
        way_m = tuple((float(x), float(y)) for x, y in draws.uniform(0.0, 250.0, (12, 2)))
        whole = Course(int(draws.integers(10**6)) * MS, float(draws.uniform(0.1, 1.0)), way_m)
        between = whole._replace(departed=whole.departed + 999_999)
        for seconds in range(0, 1000, 50):
            at = between.departed + seconds * S
            rounding = max(rounding, math.dist(whole.place(at), told(whole, at).place(at)))
            stamping = max(stamping, math.dist(between.place(at), told(between, at).place(at)))
    assert 1e-5 < rounding < 1e-4
    assert 9e-4 < stamping < 1.1e-3
