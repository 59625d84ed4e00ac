"""Which cases of a test CI runs, and which only the soak runs.

``all_pairs`` and ``each_value`` are for whole runs over a product of parameters, ``two_tiers`` for a list of cases,
``tiers`` for a property of hypothesis, and ``soak_count`` for a campaign that loops itself. CI's cases and the soak's
together are all; SOAK_SHARE in the environment is the part of the soak's that is run. A test of which each case finds
something of its own (a comparison with an oracle, golden bytes, a law, a planted fault, a row of a table) keeps all of
its cases in CI.
"""

import os
from collections.abc import Callable, Collection, Iterable, Sequence
from itertools import combinations, product
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings

SOAK_SHARE = float(os.environ.get("SOAK_SHARE", "1"))


def soak_count(full: int) -> int:
    """Return how many of *full* cases SOAK_SHARE asks for, at least one."""
    return max(1, round(full * SOAK_SHARE))


def two_tiers(cases: Iterable[Any], few: int) -> list[Any]:
    """Return the parameters of a slow test: a *few* of *cases*, evenly spread, and of the others the soak's share."""
    every = [case if isinstance(case, tuple) else (case,) for case in cases]
    return _divided(every, {number * len(every) // few for number in range(few)})


def all_pairs(*axes: Iterable[Any]) -> list[Any]:
    """Return the parameters of a slow test over the product of *axes*, three or more.

    In CI any two values of different axes meet in a row at least; the soak has the rest of the product.
    """
    return _covered(axes, 2)


def each_value(*axes: Iterable[Any]) -> list[Any]:
    """Return the parameters of a slow test over the product of *axes*, two or more, for example strategies and seeds.

    In CI each value of each axis is in a row at least; the soak has the rest of the product.
    """
    return _covered(axes, 1)


def _covered(axes: Iterable[Iterable[Any]], strength: int) -> list[Any]:
    """Return the product of *axes* as parameters: rows of a covering array of that *strength*, and the soak's share."""
    values = [list(axis) for axis in axes]
    every = list(product(*(range(len(axis)) for axis in values)))
    cases = [tuple(axis[index] for axis, index in zip(values, row, strict=True)) for row in every]
    return _divided(cases, [every.index(row) for row in covering_array([len(axis) for axis in values], strength)])


def covering_array(sizes: Sequence[int], strength: int) -> list[tuple[int, ...]]:
    """Return few rows of the product of ranges of *sizes* in which any numbers of *strength* different ranges meet.

    Each row is the first of those in which most of them meet for the first time. That makes as many rows as the product
    of the *strength* greatest sizes, or a few more.
    """
    groups = list(combinations(range(len(sizes)), strength))
    meetings = {
        row: {(group, *(row[axis] for axis in group)) for group in groups} for row in product(*map(range, sizes))
    }
    missing = set[Any]().union(*meetings.values())
    rows: list[tuple[int, ...]] = []
    while missing:
        gains = {row: len(met & missing) for row, met in meetings.items()}
        rows.append(max(gains, key=gains.__getitem__))
        missing -= meetings[rows[-1]]
    return rows


def _divided(every: Sequence[tuple[Any, ...]], chosen: Collection[int]) -> list[Any]:
    """Return those of *every* whose numbers are *chosen* as parameters, and the soak's share of the others."""
    others = [case for number, case in enumerate(every) if number not in chosen]
    soak = others[: int(len(others) * SOAK_SHARE)]  # CI's share of so few is none
    share = [pytest.param(*case, marks=pytest.mark.soak) for case in soak]
    return [*(pytest.param(*every[number]) for number in sorted(chosen)), *share]


def tiers(few: int, many: int, *strategies: Any) -> Callable[[Callable[..., None]], Any]:
    """Return what makes two tests of a property: one of *few* examples, and one of the wished share of *many*."""

    def decorate(law: Callable[..., None]) -> Any:
        def test(examples: int) -> None:
            quiet = [HealthCheck.too_slow, HealthCheck.nested_given]
            settings(max_examples=examples, suppress_health_check=quiet)(given(*strategies)(law))()

        test.__name__, test.__doc__, test.__module__ = law.__name__, law.__doc__, law.__module__
        slow = pytest.param(few, marks=pytest.mark.slow, id="few")
        soak = pytest.param(soak_count(many), marks=pytest.mark.soak, id="soak")
        return pytest.mark.parametrize("examples", [slow, soak])(test)

    return decorate
