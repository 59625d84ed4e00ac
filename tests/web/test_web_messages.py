"""Messages between page and server: what is well formed is taken, all else becomes one line."""

import json
import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.errors import UserError
from cosim.web.messages import Operate, Pause, Play, Seek, Speed, Step, parsed, written


@pytest.mark.parametrize(
    ("message", "wish"),
    [
        ({"say": "play"}, Play(say="play")),
        ({"say": "pause"}, Pause(say="pause")),
        ({"say": "step"}, Step(say="step", count=1)),
        ({"say": "step", "count": -3}, Step(say="step", count=-3)),
        ({"say": "speed", "speed": 2.5}, Speed(say="speed", speed=2.5)),
        ({"say": "seek", "time_s": 4}, Seek(say="seek", time_s=4.0)),
        (
            {"say": "operator", "robot": 2, "data": {"request": 1, "say": "plays", "x": [None, {"ä": 1.5}]}},
            Operate(say="operator", robot=2, data={"request": 1, "say": "plays", "x": [None, {"ä": 1.5}]}),
        ),
    ],
)
def test_what_is_well_formed_is_taken(message: dict[str, Any], wish: Any):
    assert parsed(json.dumps(message)) == wish
    assert parsed(json.dumps(message).encode()) == wish


@pytest.mark.parametrize(
    "text",
    [
        "",
        "play",
        "null",
        "[]",
        "{",
        "{}",
        '{"say": "dance"}',
        '{"say": "play", "loud": true}',
        '{"say": "speed"}',
        '{"say": "speed", "speed": 0}',
        '{"say": "speed", "speed": -1}',
        '{"say": "speed", "speed": 1e999}',
        '{"say": "speed", "speed": NaN}',
        '{"say": "seek", "time_s": -0.1}',
        '{"say": "seek", "time_s": 1e30}',
        '{"say": "step", "count": 1000000}',
        '{"say": "operator", "robot": -1, "data": {}}',
        '{"say": "operator", "robot": 0, "data": []}',
        '{"say": "operator", "robot": 0, "data": {"x": ' + "[" * 100_000 + "}}",
        "\ud800".encode("utf-8", "surrogatepass"),
        b"\xff\xfe",
    ],
)
def test_what_is_not_is_told_in_one_line(text: str | bytes):
    with pytest.raises(UserError) as told:
        parsed(text)
    assert str(told.value)
    assert "\n" not in str(told.value)


@given(st.text() | st.binary())
def test_nothing_else_is_raised_for_any_bytes(text: str | bytes):
    with pytest.raises(UserError):
        parsed(text)


plain = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=20,
)


def strict(text: str) -> Any:
    return json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))


@given(st.dictionaries(st.text(), plain, max_size=4))
def test_what_is_written_is_json_with_null_for_what_is_no_number(message: dict[str, Any]):
    assert strict(written(message)) == without_nan(message)


def without_nan(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: without_nan(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [without_nan(inner) for inner in value]
    return value if not isinstance(value, float) or math.isfinite(value) else None
