"""Air times, capacities and best rates are those of the specification's packet table."""

import pytest

from cosim.channels.bluetooth.packets import ACL, DH1, DH3, DH5, DM1, DM3, DM5, PACKETS, smallest
from cosim.units import SLOT, US


@pytest.mark.parametrize(
    ("name", "air_us"),
    [
        ("ID", 68),
        ("POLL", 126),
        ("NULL", 126),
        ("FHS", 366),
        ("DM1", 366),
        ("DH1", 366),
        ("DM3", 1626),
        ("DH3", 1622),
        ("DM5", 2871),
        ("DH5", 2870),
    ],
)
def test_a_full_packet_lasts_as_long_as_the_specification_says(name: str, air_us: int) -> None:
    kind = PACKETS[name]
    assert kind.air_time(kind.capacity) == air_us * US


@pytest.mark.parametrize(
    ("name", "rate_kbps"),
    [("DM1", 108.8), ("DH1", 172.8), ("DM3", 387.2), ("DH3", 585.6), ("DM5", 477.8), ("DH5", 723.2)],
)
def test_best_one_way_rate(name: str, rate_kbps: float) -> None:
    kind = ACL[name]
    period_us = (kind.slots + 1) * SLOT // US
    assert kind.capacity * 8e3 / period_us == pytest.approx(rate_kbps, abs=0.1)


def test_an_empty_and_a_short_payload_take_a_whole_number_of_code_blocks() -> None:
    assert DH1.air_time(0) == (126 + 24) * US
    assert DM1.air_time(0) == (126 + 45) * US  # 24 bits are 3 blocks of 10, each sent as 15
    assert DM1.air_time(3) == (126 + 75) * US  # 48 bits: 5 blocks
    assert DM3.air_time(3) == (126 + 90) * US  # a header of 2 bytes: 56 bits, 6 blocks


def test_a_payload_that_does_not_fit_is_refused() -> None:
    with pytest.raises(ValueError, match="18 bytes do not fit into DM1"):
        DM1.air_time(18)


@pytest.mark.parametrize(
    ("length", "expected"),
    [(0, DM1), (17, DM1), (18, DH1), (27, DH1), (28, DM3), (122, DH3), (184, DM5), (225, DH5), (339, DH5), (340, None)],
)
def test_the_smallest_type_that_holds_the_payload(length: int, expected: object) -> None:
    assert smallest(tuple(ACL.values()), length) is expected


def test_only_the_types_in_use_are_chosen() -> None:
    assert smallest((DM5, DM3), 1) is DM3
    assert smallest((DM1,), 18) is None
    assert smallest((PACKETS["POLL"],), 0) is None
