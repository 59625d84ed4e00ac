"""Simulated time as the wall clock passes: what it is follows from what was asked for, in closed form."""

from hypothesis import given
from hypothesis import strategies as st

from cosim.units import MS, S
from cosim.web.pacing import FASTEST, SLOWEST, Pace

spans = st.floats(0, 1000)
speeds = st.floats(SLOWEST, FASTEST)


def test_time_passes_at_its_speed():
    pace = Pace(2.0, wall_s=100.0)
    assert [pace.due(100.0 + wall_s) for wall_s in (0, 0.5, 3)] == [0, S, 6 * S]


def test_a_pause_keeps_time_where_it_is():
    pace = Pace(wall_s=0.0)
    pace.pause(1.5)
    pace.pause(2.0)
    assert pace.due(50.0) == 1500 * MS
    pace.play(60.0)
    pace.play(61.0)  # it plays already
    assert pace.due(61.0) == 2500 * MS


def test_another_speed_begins_where_time_is():
    pace = Pace(wall_s=0.0)
    pace.change(10.0, 2.0)
    assert [pace.due(2.0), pace.due(2.5)] == [2 * S, 7 * S]


def test_a_speed_that_is_set_during_a_pause_is_that_of_the_time_after_it():
    pace = Pace(playing=False)
    pace.change(10.0, 5.0)
    assert pace.due(9.0) == 0
    pace.play(9.0)
    assert pace.due(9.1) == S


def test_what_was_not_reached_is_not_made_up_for():
    pace = Pace(wall_s=0.0)
    pace.jump(S, 10.0)
    assert pace.due(10.5) == 1500 * MS


@given(st.lists(st.tuples(spans, st.sampled_from(("play", "pause", "change")), speeds), max_size=12))
def test_time_is_the_sum_of_what_was_played(steps: list[tuple[float, str, float]]):
    pace, wall_s, played_s, speed, playing = Pace(wall_s=0.0), 0.0, 0.0, 1.0, True
    for span_s, act, asked in steps:
        wall_s += span_s
        played_s += span_s * speed * playing
        if act == "change":
            pace.change(asked, wall_s)
            speed = asked
        else:
            getattr(pace, act)(wall_s)
            playing = act == "play"
        assert abs(pace.due(wall_s) - played_s * S) <= 1e-6 * S * (1 + wall_s)
