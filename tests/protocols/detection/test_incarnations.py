"""A peer's incarnations are told apart by the number and the stamp of its heartbeats, whatever the period."""

from cosim.units import MS
from protocols.detection.incarnations import Incarnation


def test_a_gap_in_the_count_is_no_reboot_whatever_the_period() -> None:
    period = 33_350_000
    incarnation = Incarnation(period, 1 << 32)
    assert not incarnation.is_new(0, 0)
    assert not incarnation.is_new(1000, 1000 * period // MS)
    assert incarnation.is_new(0, 1001 * period // MS)
