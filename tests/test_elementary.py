"""Elementary functions: near the exact ones of mpmath, and made of nothing but what is rounded alike everywhere."""

import math
import random
import re
from collections.abc import Callable
from typing import Any

import mpmath
import numba
import numpy as np
import pytest
from llvmlite.binding import get_host_cpu_features

import cosim.elementary as elementary
from cosim.jit import COMPILES
from tests.tiers import soak_count

mpmath.mp.prec = 200  # bits
Draw = Callable[[random.Random], tuple[float, ...]]


def magnitude(draw: random.Random, low: int, high: int) -> float:
    """Draw a number of either sign between two powers of ten."""
    return float(draw.choice((-1, 1)) * 10.0 ** draw.uniform(low, high))


def near_turns(draw: random.Random) -> float:
    """Draw a float next to a multiple of a quarter turn, where the sine or the cosine nearly vanishes."""
    most = draw.choice((4, 2000, 600_000))
    return draw.randrange(-most, most) * math.pi / 2


def a_vector(draw: random.Random) -> tuple[float, float]:
    y = draw.choice((draw.uniform(-5, 5), magnitude(draw, -5, 5), magnitude(draw, -150, 150)))
    return y, draw.choice((draw.uniform(-5, 5), magnitude(draw, -150, 150), y * draw.uniform(0.9, 1.1), -y))


def an_angle(draw: random.Random) -> tuple[float]:
    wide = draw.choice((4, 100, 2.0**20))
    return (draw.choice((draw.uniform(-wide, wide), near_turns(draw), magnitude(draw, -20, 0))),)


def a_positive(draw: random.Random) -> tuple[float]:
    near_1 = 1.0 + magnitude(draw, -16, -1)
    return (draw.choice((draw.uniform(0.0, 2.0), abs(magnitude(draw, -300, 300)), near_1, 10.0 ** draw.randrange(23))),)


def one_of(*ranges: tuple[float, float]) -> Draw:
    """Return what draws a number from one of *ranges*, or a small one."""

    def drawn(draw: random.Random) -> tuple[float]:
        return (draw.choice((draw.uniform(*draw.choice(ranges)), magnitude(draw, -20, -1))),)

    return drawn


FUNCTIONS: dict[str, tuple[int, Draw, Callable[..., Any]]] = {
    "exp": (1, one_of((-1, 1), (-40, 40), (-700, 709)), mpmath.exp),
    "exp10": (1, one_of((-1, 1), (-15, 15), (-306, 308)), lambda x: mpmath.mpf(10) ** x),
    "log": (1, a_positive, mpmath.log),
    "sin": (1, an_angle, mpmath.sin),
    "cos": (1, an_angle, mpmath.cos),
    "log10": (2, a_positive, mpmath.log10),
    "log1p": (2, one_of((-0.999, 1), (-0.3, 0.42), (0, 100), (0, 1e300)), mpmath.log1p),
    "expm1": (2, one_of((-1, 1), (-0.4, 0.4), (-40, 40)), mpmath.expm1),
    "atan2": (2, a_vector, mpmath.atan2),
    "asin": (2, one_of((-1, 1), (0.99, 1)), mpmath.asin),
    "hypot": (2, a_vector, mpmath.hypot),
    "erfc": (6, one_of((-6, 6), (0, 2), (0, 26)), mpmath.erfc),
}
"""For each function how many units in the last place its value may be off, what draws arguments, and the exact one."""


@pytest.mark.slow
@pytest.mark.parametrize("name", FUNCTIONS)
@pytest.mark.parametrize("count", [1000, pytest.param(soak_count(200_000), marks=pytest.mark.soak)])
def test_a_value_is_off_by_a_few_units_in_the_last_place(name: str, count: int) -> None:
    most, drawn, exact = FUNCTIONS[name]
    function, draw = getattr(elementary, name), random.Random(name)
    for _ in range(count):
        arguments = drawn(draw)
        wanted = exact(*map(mpmath.mpf, arguments))
        unit = math.ulp(float(wanted)) if abs(wanted) > 1e-307 else 5e-324
        assert abs(function(*arguments) - wanted) <= most * unit, arguments


INF, NAN = math.inf, math.nan


@pytest.mark.parametrize(
    ("name", "arguments", "value"),
    [
        *(("exp", (x,), y) for x, y in ((0.0, 1.0), (-INF, 0.0), (INF, INF), (710.0, INF), (-746.0, 0.0), (NAN, NAN))),
        *(("exp10", (float(x),), float(f"1e{x}")) for x in range(23)),
        *(("exp10", (x,), y) for x, y in ((-INF, 0.0), (INF, INF), (309.0, INF), (-325.0, 0.0), (NAN, NAN))),
        *(("log10", (float(f"1e{x}"),), float(x)) for x in range(-5, 23)),
        *((name, (x,), y) for name in ("log", "log10") for x, y in ((1.0, 0.0), (0.0, -INF), (INF, INF), (-1.0, NAN))),
        *((name, (5e-324,), y) for name, y in (("log", -744.4400719213812), ("log10", -323.3062153431158))),
        *((name, (x,), 5e-324) for name, x in (("exp", -745.1), ("exp10", -323.3))),
        *(("exp10", (float(x),), float(f"1e{x}")) for x in (-308, -310, -320, 308)),
        *(("log1p", (x,), y) for x, y in ((-0.0, -0.0), (-1.0, -INF), (-2.0, NAN), (INF, INF), (NAN, NAN))),
        *(("expm1", (x,), y) for x, y in ((-0.0, -0.0), (-INF, -1.0), (INF, INF), (NAN, NAN), (-50.0, -1.0))),
        *(("sin", (x,), y) for x, y in ((-0.0, -0.0), (INF, NAN), (-INF, NAN), (NAN, NAN), (5e-324, 5e-324))),
        *(("cos", (x,), y) for x, y in ((0.0, 1.0), (INF, NAN), (NAN, NAN))),
        *(("asin", (x,), y) for x, y in ((-0.0, -0.0), (1.0, math.pi / 2), (-1.0, -math.pi / 2), (1.1, NAN))),
        *(("erfc", (x,), y) for x, y in ((0.0, 1.0), (INF, 0.0), (-INF, 2.0), (28.0, 0.0), (NAN, NAN))),
        *(("atan2", (y, x), math.atan2(y, x)) for y in (0.0, -0.0, 1.0, -INF) for x in (0.0, -0.0, -2.0, INF, -INF)),
        *(("atan2", (y, x), NAN) for y, x in ((NAN, 1.0), (1.0, NAN))),
        *(("atan2", (y, x), math.atan2(y, x)) for y in (5e-324, 1e308) for x in (1e308, -1e308, 1e-300)),
        *(("hypot", (x, y), z) for x, y, z in ((3.0, -4.0, 5.0), (0.0, 0.0, 0.0), (-INF, 1.0, INF), (NAN, 1.0, NAN))),
        *(("hypot", (3.0 * x, 4.0 * x), 5.0 * x) for x in (1e-200, 1e200)),
    ],
)
def test_edges(name: str, arguments: tuple[float, ...], value: float) -> None:
    found = getattr(elementary, name)(*arguments)
    if name in ("hypot", "atan2") and math.isfinite(value):
        assert found == pytest.approx(value, rel=1e-15)
    else:
        assert math.isnan(found) if math.isnan(value) else found == value
    assert math.isnan(value) or math.copysign(1.0, found) == math.copysign(1.0, value)


def test_far_beyond_a_million_turns_the_error_is_that_of_the_float_for_a_turn() -> None:
    for x in (3e6, -7.7e9):
        assert elementary.sin(x) == pytest.approx(float(mpmath.sin(x)), abs=3e-17 * abs(x))


def test_arrays_are_taken_by_element() -> None:
    values = np.random.default_rng(1).uniform(0.1, 9.0, (3, 4))
    for each, one in (("exps", "exp"), ("logs", "log"), ("exp10s", "exp10")):
        found = getattr(elementary, each)(values)
        assert found.tolist() == [[getattr(elementary, one)(value) for value in row] for row in values.tolist()]
    x, y = values[0], values[1]
    wanted = [elementary.hypot(*pair) for pair in zip(x.tolist(), y.tolist(), strict=True)]
    assert elementary.hypots(x, y).tolist() == wanted


FUSED = re.compile(r"\bvfn?m(add|sub)")


def called_in(code: str) -> set[str]:
    """Return the names of functions of C whose addresses are in a kernel's code."""
    return set(re.findall(r"\$(\w+), %r\w+$", code, re.MULTILINE))


@pytest.mark.slow
@pytest.mark.skipif(not COMPILES, reason="kernels are not compiled here")
@pytest.mark.parametrize("name", FUNCTIONS)
def test_kernels_fuse_nothing_and_call_no_other_library(name: str) -> None:
    function = numba.njit(getattr(elementary, name).py_func)  # what a cache holds cannot be inspected
    function(*FUNCTIONS[name][1](random.Random(1)))
    (code,) = function.inspect_asm().values()
    assert "mulsd" in code or "mulpd" in code
    assert not FUSED.search(code)
    assert not called_in(code) & LIBRARY


LIBRARY = {*("exp", "exp2", "exp10", "expm1", "log", "log2", "log10", "log1p", "pow", "sin", "cos", "sincos", "tan")}
LIBRARY |= {*("atan", "atan2", "asin", "acos", "hypot", "erf", "erfc")}


@pytest.mark.skipif(not COMPILES, reason="kernels are not compiled here")
def test_a_kernel_that_calls_a_library_or_fuses_is_found() -> None:
    @numba.njit(fastmath=True)
    def other(x: float, y: float) -> float:
        return math.exp(x) * y + x

    other(1.0, 2.0)
    (code,) = other.inspect_asm().values()
    assert called_in(code) & LIBRARY == {"exp"}
    if "fma" in get_host_cpu_features():
        assert FUSED.search(code)
