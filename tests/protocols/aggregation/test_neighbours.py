"""Hosts watch each other rightly also if they begin in the midst of a count, whatever the period."""

import pytest

from cosim.units import MS, S, Time
from protocols.aggregation.messages import Heartbeat
from protocols.aggregation.neighbours import Neighbours
from protocols.detection.chen import NfdESettings, NfdSSettings
from protocols.detection.detectors import Detector, make_detector


def beat(number: int, at: Time) -> Heartbeat:
    return Heartbeat(number, at // MS, 1.0, 1.0, 0, 1, 0, 0, False, False, False, ())


@pytest.mark.parametrize("settings", [NfdSSettings(), NfdESettings()])
def test_who_boots_late_misses_another_as_soon_as_others_do(settings: NfdSSettings | NfdESettings) -> None:
    def make(now: Time, began: Time) -> Detector:
        return make_detector(settings, S, now, began)

    late = Neighbours([1], S, make, 300 * S)
    for number in range(300, 310):
        late.take_heartbeat(1, beat(number, number * S), number * S + 5 * MS)
    assert late.fall_silent(309 * S + 500 * MS) == []
    assert late.fall_silent(320 * S) == [1]
