import math

import numpy as np
import pytest
from scipy.stats import qmc

from cosim.statistics.designs import SAMPLED, STEP, Span, is_balanced, points


@pytest.mark.parametrize("kind", SAMPLED)
def test_points_depend_on_the_seed_only(kind: str):
    drawn = points(kind, 16, 3, 5)
    assert np.array_equal(drawn, points(kind, 16, 3, 5))
    assert not np.array_equal(drawn, points(kind, 16, 3, 6))
    assert drawn.min() >= 0
    assert drawn.max() <= 1
    assert len(drawn) == {"saltelli": 16 * 5, "morris": 16 * 4}.get(kind, 16)


def test_a_latin_hypercube_has_one_point_in_each_part_of_every_axis():
    drawn = points("latin hypercube", 20, 4, 1)
    for axis in drawn.T:
        assert sorted((axis * 20).astype(int)) == list(range(20))


def test_sobols_points_fill_the_cube_more_evenly_than_chance():
    even = qmc.discrepancy(points("sobol", 64, 3, 1))
    assert even < 0.3 * qmc.discrepancy(np.random.Generator(np.random.PCG64(1)).random((64, 3)))
    halves = (points("sobol", 64, 3, 1) < 0.5).astype(int) @ [1, 2, 4]
    assert np.bincount(halves).tolist() == [8] * 8  # as many in each eighth


def test_saltellis_points_change_one_axis_at_a_time():
    groups = points("saltelli", 8, 3, 1).reshape(8, 5, 3)
    for group in groups:
        first, last = group[0], group[-1]
        for axis in range(3):
            assert (group[1 + axis] == np.where(np.arange(3) == axis, last, first)).all()
    assert len({tuple(group[0]) for group in groups}) == 8


def test_morriss_trajectories_go_two_thirds_along_each_axis_once():
    groups = points("morris", 30, 4, 1).reshape(30, 5, 4)
    steps = np.diff(groups, axis=1)
    assert np.allclose(np.abs(steps).sum(axis=2), STEP)
    assert np.allclose(np.abs(steps).sum(axis=1), STEP)  # each axis once in a trajectory
    assert np.allclose(groups * 3, np.round(groups * 3))
    assert {round(level, 3) for level in groups.ravel().tolist()} == {0.0, 0.333, 0.667, 1.0}


@pytest.mark.parametrize(
    ("span", "values"),
    [
        (Span(1.0, 3.0, False, False), [1.0, 1.5, 2.0, 2.5, 3.0]),
        (Span(1.0, 10_000.0, True, False), [1.0, 10.0, 100.0, 1000.0, 10_000.0]),
        (Span(1, 4, False, True), [1, 2, 3, 4, 4]),
        (Span(-2, 1, False, True), [-2, -1, 0, 1, 1]),
        (Span(1, 15, True, True), [1, 2, 4, 8, 15]),
    ],
)
def test_a_span_is_drawn_evenly_or_evenly_by_its_logarithm(span: Span, values: list[float]):
    found = [span.at(place) for place in (0.0, 0.25, 0.5, 0.75, 1.0)]
    assert found == pytest.approx(values, rel=1e-5)
    assert all(isinstance(value, int) for value in found) == span.whole


def test_what_is_drawn_has_few_digits_and_stays_inside():
    span = Span(1 / 3, 2 / 3, False, False)
    drawn = [span.at(float(place)) for place in points("sobol", 64, 1, 1)[:, 0]]
    assert max(len(repr(value)) for value in drawn) <= 8
    assert span.at(0.0) == 1 / 3
    assert span.at(1.0) <= 2 / 3
    assert len({*drawn}) == 64
    whole = [Span(0, 3, False, True).at(float(place)) for place in points("sobol", 64, 1, 1)[:, 0]]
    assert np.bincount(whole).tolist() == [16] * 4
    assert math.isfinite(Span(1e-9, 1e9, True, False).at(1.0))


def test_powers_of_two_are_known():
    assert [count for count in range(20) if is_balanced(count)] == [1, 2, 4, 8, 16]
