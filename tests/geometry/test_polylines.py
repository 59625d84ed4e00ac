"""Lines through points against shapely's; the mean against numpy's."""

import math

import numpy as np
import pytest
import shapely
import shapely.ops
from hypothesis import example, given
from hypothesis import strategies as st

from cosim.geometry.planning import Point
from cosim.geometry.polylines import cut, length_m, middle, off_m

coordinates = st.integers(-20_000, 20_000).map(lambda cm: cm / 100)
points = st.tuples(coordinates, coordinates)
lines = st.lists(points, min_size=2, max_size=7)

CORNER = [(0.0, 0.0), (10.0, 0.0), (10.0, 0.0), (10.0, 5.0), (4.0, 5.0)]
"""10 m to the right, nothing, 5 m up, 6 m to the left."""


@given(st.lists(points, min_size=1, max_size=7))
def test_the_middle_is_the_mean(some: list[Point]) -> None:
    assert middle(some) == pytest.approx(np.mean(some, axis=0).tolist(), abs=1e-9)


def test_no_points_have_no_middle() -> None:
    with pytest.raises(ZeroDivisionError):
        middle([])


@given(lines)
def test_the_length_is_shapelys(line: list[Point]) -> None:
    assert length_m(line) == pytest.approx(shapely.LineString(line).length, abs=1e-9)


@pytest.mark.parametrize("line", [[], [(3.0, 4.0)]])
def test_less_than_two_points_have_no_length(line: list[Point]) -> None:
    assert length_m(line) == 0.0
    assert isinstance(length_m(line), float)


@given(lines, st.floats(0.0, 1.2))
@example(CORNER, 10.0 / 21.0)
def test_a_cut_ends_where_shapely_interpolates_and_is_as_long(line: list[Point], part: float) -> None:
    whole = shapely.LineString(line)
    most_m = part * whole.length
    begun = cut(line, most_m)
    end = whole.interpolate(most_m)
    assert begun[-1] == pytest.approx((end.x, end.y), abs=1e-7)
    assert length_m(begun) == pytest.approx(min(most_m, whole.length), abs=1e-9)
    assert list(begun[:-1]) == line[: len(begun) - 1], "and follows the line"


@pytest.mark.parametrize("most_m", [0.5, 10.0, 12.5, 15.0, 20.9])
def test_a_cut_covers_what_shapelys_substring_covers(most_m: float) -> None:
    substring = shapely.ops.substring(shapely.LineString(CORNER), 0.0, most_m)
    assert shapely.LineString(cut(CORNER, most_m)).hausdorff_distance(substring) == pytest.approx(0.0, abs=1e-12)


def test_a_cut_has_the_first_point_at_least_and_the_whole_line_at_most() -> None:
    assert cut(CORNER, 0.0) == cut(CORNER, -3.0) == ((0.0, 0.0),)
    assert cut(CORNER, 21.5) == cut(CORNER, math.inf) == tuple(CORNER)
    assert cut([(3.0, 4.0)], 1.0) == ((3.0, 4.0),)
    with pytest.raises(IndexError):
        cut([], 1.0)


@given(points, points, points)
@example((3.0, 4.0), (0.0, 0.0), (0.0, 0.0))
@example((1.0, 1.0), (0.0, 0.0), (2.0, 0.0))
def test_how_far_a_point_is_off_a_segment_is_shapelys_distance(point: Point, a: Point, b: Point) -> None:
    segment = shapely.LineString((a, b)) if a != b else shapely.Point(a)
    assert off_m(point, a, b) == pytest.approx(shapely.Point(point).distance(segment), abs=1e-9)
