"""The tiers of a test with many cases: what CI runs is enough of them, and the soak has the rest."""

from collections.abc import Callable
from itertools import combinations, product
from typing import Any

import pytest

from tests import tiers
from tests.tiers import all_pairs, covering_array, each_value, two_tiers


@pytest.fixture(autouse=True)
def whole_soak(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tiers, "SOAK_SHARE", 1.0)


def divided(cases: list[Any]) -> tuple[list[Any], list[Any]]:
    """Return the values of the cases that CI runs, and of those that only the soak does."""
    both: tuple[list[Any], list[Any]] = [], []
    for case in cases:
        both[pytest.mark.soak in case.marks].append(case.values)
    return both


@pytest.mark.parametrize(
    ("sizes", "strength", "count"),
    [
        ((4,), 1, 4),
        ((3, 4), 1, 4),
        ((3, 2, 5), 1, 5),
        ((3, 4), 2, 12),
        ((2, 2, 2), 2, 4),
        ((3, 3, 4), 2, 12),
        ((4, 2, 8), 2, 32),
        ((3, 3, 3), 2, 10),
        ((2, 2, 2, 2), 2, 6),
        ((3, 3, 3, 2, 2), 2, 10),
        ((5, 5, 5), 2, 28),
    ],
)
def test_any_values_meet_in_few_rows(sizes: tuple[int, ...], strength: int, count: int) -> None:
    rows = covering_array(sizes, strength)
    assert len(rows) == count
    assert {*rows} <= {*product(*map(range, sizes))}
    for axes in combinations(range(len(sizes)), strength):
        assert {tuple(row[axis] for axis in axes) for row in rows} == {*product(*(range(sizes[axis]) for axis in axes))}


@pytest.mark.parametrize(("covered", "count"), [(all_pairs, 6), (each_value, 3)])
def test_the_two_tiers_of_a_product_are_all_of_it(covered: Callable[..., list[Any]], count: int) -> None:
    axes = ("ab", (1, 2, 3), (None, 0.5))
    quick, soak = divided(covered(*axes))
    assert len(quick) == count
    assert sorted(map(repr, quick + soak)) == sorted(map(repr, product(*axes)))
    for axis, values in enumerate(axes):
        assert {row[axis] for row in quick} == {*values}


def test_the_two_tiers_of_cases_are_all_of_them() -> None:
    quick, soak = divided(two_tiers(range(10), 4))
    assert quick == [(0,), (2,), (5,), (7,)]
    assert sorted(quick + soak) == [(number,) for number in range(10)]


@pytest.mark.parametrize("share", [0.02, 0.5, 1.0])
def test_the_soak_has_its_share_of_the_rest(share: float, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tiers, "SOAK_SHARE", share)
    quick, soak = divided(all_pairs(range(3), range(3), range(3)))
    assert (len(quick), len(soak)) == (10, int(17 * share))
