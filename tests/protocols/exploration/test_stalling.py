"""When a robot takes itself to be caught: its box, over the whole period only, and the time without any gain."""

import math

from protocols.exploration.stalling import Stalling


def noted(stalling: Stalling, places: list[tuple[float, float]], gain: bool = True) -> list[bool]:
    result = []
    for place in places:
        stalling.note(place, gain)
        result.append(stalling.stalled)
    return result


def test_a_robot_that_stands_has_stalled_when_the_whole_period_is_over() -> None:
    assert noted(Stalling(4, 0.6, math.inf), [(1.0, 2.0)] * 5) == [False, False, False, True, True]


def test_the_longer_side_of_the_box_counts() -> None:
    for turned in (False, True):
        for length, stalled in ((0.59, True), (0.61, False)):
            ends = [(0.0, 0.0), (0.1, length), (0.0, 0.3)]
            places = [(y, x) for x, y in ends] if turned else ends
            assert noted(Stalling(3, 0.6, math.inf), places)[-1] == stalled


def test_a_circle_counts_as_its_box_not_as_its_way() -> None:
    circle = [(0.2 * math.cos(k), 0.2 * math.sin(k)) for k in range(40)]
    assert noted(Stalling(40, 0.6, math.inf), circle)[-1]
    assert not noted(Stalling(40, 0.3, math.inf), circle)[-1]


def test_only_the_last_period_counts() -> None:
    went = [(float(k), 0.0) for k in range(5)]
    assert noted(Stalling(3, 0.6, math.inf), [*went, went[-1], went[-1]]) == [False] * 6 + [True]


def test_all_is_forgotten_at_a_new_beginning() -> None:
    stalling = Stalling(3, 0.6, 4)
    noted(stalling, [(0.0, 0.0)] * 3, gain=False)
    assert stalling.stalled
    stalling.begin()
    assert noted(stalling, [(0.0, 0.0)] * 3, gain=False) == [False, False, True]
    far = Stalling(99, 0.6, 4)
    noted(far, [(0.0, 0.0)] * 4, gain=False)
    far.begin()
    assert noted(far, [(0.0, 0.0)] * 5, gain=False) == [False] * 4 + [True]


def test_who_gains_nothing_for_long_has_stalled_however_far_it_goes() -> None:
    went = [(float(k), 0.0) for k in range(9)]
    stalling = Stalling(3, 0.6, 4)
    assert noted(stalling, went[:4], gain=False) == [False] * 4
    assert noted(stalling, went[4:5], gain=True) == [False]
    assert noted(stalling, went[5:], gain=False) == [False] * 4
    assert noted(stalling, [(9.0, 0.0)], gain=False) == [True]
