import math

import pytest

from cosim.statistics.digits import digits


@pytest.mark.parametrize(
    ("value", "count", "told"),
    [
        (463_712.0, 4, "463700"),
        (-13_333.0, 4, "-13330"),
        (108.4, 2, "110"),
        (99.6, 2, "100"),
        (1269.4, 4, "1269"),
        (0.00123456, 3, "0.00123"),
        (1.0, 3, "1"),
        (0.0, 3, "0"),
        (5.4e-05, 2, "5.4e-05"),
        (2.5e9, 2, "2.5e+09"),
        (math.nan, 3, "nan"),
        (math.inf, 3, "inf"),
    ],
)
def test_numbers_have_no_exponent_where_nobody_writes_one(value: float, count: int, told: str):
    assert digits(value, count) == told
