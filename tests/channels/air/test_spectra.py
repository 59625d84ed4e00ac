"""The shares that receivers take in, against the figures of the reference, and integrated anew by scipy."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy import integrate

from cosim.channels.air.spectra import (
    CLASSIC,
    DSSS,
    JAMMER,
    LE_1M,
    LE_2M,
    LIMIT_MHZ,
    OFDM,
    OFFSETS,
    RECEIVERS,
    SENDERS,
    STEPS_PER_MHZ,
    shares,
    sinc_squared,
)

OFFSETS_MHZ = (0, 2, 4, 6, 8, 9, 10, 11, 12, 13)


def decibels(ratio: float) -> float:
    return 10 * math.log10(ratio)


def share_db(sender: int, receiver: int, offset_mhz: float) -> float:
    return decibels(shares()[sender, receiver, round(offset_mhz * STEPS_PER_MHZ)])


def chips(mhz: float) -> float:
    return float(np.sinc(mhz / 11) ** 2 / 11)


def area(density: Callable[[float], float], low: float, high: float) -> float:
    corners = [corner for corner in (-22, -11, 0, 11, 22) if low < corner < high]
    return float(integrate.quad(density, low, high, points=corners or None, limit=500, epsabs=1e-13)[0])


# ---------------------------------------------------------------- direct sequence


@pytest.mark.parametrize(
    ("width_mhz", "offset_mhz", "printed_db"),
    [
        *zip([1] * 8, OFFSETS_MHZ, (-10.4, -10.9, -12.4, -15.2, -20.0, -23.8, -30.1, -42.0), strict=False),
        *zip([2] * 8, OFFSETS_MHZ, (-7.4, -7.9, -9.4, -12.1, -16.8, -20.5, -26.0, -33.0), strict=False),
    ],
)
def test_boxes_take_in_of_random_chips_what_is_printed(width_mhz: int, offset_mhz: int, printed_db: float):
    box = offset_mhz - width_mhz / 2, offset_mhz + width_mhz / 2
    assert decibels(area(sinc_squared, *box)) == pytest.approx(printed_db, abs=0.051)


def test_the_main_lobe_holds_nine_tenths():
    assert area(sinc_squared, -11, 11) == pytest.approx(0.903, abs=5e-4)


def filtered(mhz: float) -> float:
    """The density of direct sequence, not normalised: the lower one of chips and mask."""
    mask_db = 0 if abs(mhz) < 11 else (-30 if abs(mhz) < 22 else -50)
    return min(chips(mhz), 10 ** (mask_db / 10) / 11)


def test_a_filtered_sender_has_as_much_more_in_its_main_lobe_as_its_filter_takes():
    whole = 2 * area(filtered, 0, LIMIT_MHZ)
    assert 1 - whole == pytest.approx(0.095, abs=5e-4)
    for offset in (*range(21), 22, 26, 32, 44, 60):
        middle = offset / 2
        expected = area(filtered, middle - 0.5, middle + 0.5) / whole
        assert shares()[DSSS, CLASSIC, offset] == pytest.approx(expected, rel=2e-3), offset
    for offset in (0, 2, 4, 6, 8, 9, 10):  # 0.43 dB more than without the filter
        expected_db = decibels(area(sinc_squared, offset - 0.5, offset + 0.5)) - decibels(whole)
        assert share_db(DSSS, CLASSIC, offset) == pytest.approx(expected_db, abs=0.01)


def test_no_sender_of_direct_sequence_exceeds_the_mask():
    table_db = [share_db(DSSS, CLASSIC, offset / 2) for offset in range(2 * LIMIT_MHZ)]
    assert all(db - table_db[0] <= -29.9 for db in table_db[23:])
    assert all(db - table_db[0] <= -49.9 for db in table_db[45:])


# ---------------------------------------------------------------- OFDM, Bluetooth

PRINTED = {
    (OFDM, LE_1M): (-11.4, -10.8, -10.8, -10.8, -12.1, -20.2, -26.6, -32.1, -41.7, -58.2),
    (OFDM, LE_2M): (-8.5, -8.2, -8.2, -8.2, -10.1, -14.0, -22.1, -27.8, -34.9, -44.7),
}
PRINTED_LE = {
    (LE_1M, LE_1M): (0, -7.4, -30.7, -53.5, -61.1),
    (LE_2M, LE_2M): (0, -1.7, -10.4, -23.8, -35.0),
    (LE_2M, LE_1M): (-0.8, -5.7, -22.0, -41.5, -59.7),
    (LE_1M, LE_2M): (0, -1.3, -12.6, -28.9, -35.8),
}


@pytest.mark.parametrize(("pair", "row"), PRINTED.items())
def test_le_takes_in_of_ofdm_what_is_printed(pair: tuple[int, int], row: tuple[float, ...]):
    assert [share_db(*pair, offset) for offset in OFFSETS_MHZ] == pytest.approx(list(row), abs=0.06)


@pytest.mark.parametrize(("pair", "row"), PRINTED_LE.items())
def test_le_takes_in_of_le_what_is_printed(pair: tuple[int, int], row: tuple[float, ...]):
    assert [share_db(*pair, offset) for offset in range(5)] == pytest.approx(list(row), abs=0.06)


def test_boxes_take_in_of_boxes_what_overlaps():
    assert decibels(1 / 22) == pytest.approx(-13.4, abs=0.05)
    assert share_db(OFDM, CLASSIC, 3) == pytest.approx(decibels(3.2 / 52), abs=0.15)  # 16.6 MHz hold 53 carriers
    wide = shares()[CLASSIC, DSSS]
    assert wide[: 2 * 10 + 2].tolist() == pytest.approx([1.0] * 22)
    assert wide[22] == pytest.approx(0.5)
    assert not wide[23:].any()
    assert shares()[CLASSIC, OFDM, 18:22].tolist() == pytest.approx([1.0, 1.0, 0.5, 0.0])
    assert shares()[CLASSIC, CLASSIC, :3].tolist() == pytest.approx([1.0, 0.5, 0.0])
    assert np.array_equal(shares()[JAMMER], shares()[CLASSIC])


def test_the_ofdm_sender_stays_below_the_mask_of_its_standard():
    middle_db = share_db(OFDM, CLASSIC, 4)
    mask = [(0, 0), (9, 0), (11, -20), (20, -28), (30, -40), (40, -40)]
    for offset in range(2 * LIMIT_MHZ):
        low = max(0, offset / 2 - 0.5)  # the mask is highest on the near side
        allowed_db = np.interp(low, [f for f, _ in mask], [db for _, db in mask])
        part = shares()[OFDM, CLASSIC, offset]
        assert part == 0 or decibels(part) - middle_db <= allowed_db + 0.05


# ---------------------------------------------------------------- all


def test_receivers_that_share_out_the_band_take_in_all_of_each_sender():
    for sender in range(SENDERS):
        row = shares()[sender, CLASSIC]
        for first in (0, 1):  # channels at whole MHz from the sender, or between
            parts = [row[abs(step)] for step in range(first - OFFSETS + 1, OFFSETS, 2)]
            assert math.fsum(parts) == pytest.approx(1, abs=1e-12), (sender, first)


def test_wide_receivers_that_share_out_the_band_take_in_all_of_each_sender():
    for sender in range(SENDERS):
        for receiver, steps in ((DSSS, 44), (OFDM, 40)):
            for first in (0, 7):
                parts = [
                    shares()[sender, receiver, abs(first + n * steps)]
                    for n in (-2, -1, 0, 1, 2)
                    if abs(first + n * steps) < OFFSETS
                ]
                assert math.fsum(parts) == pytest.approx(1, abs=1e-12), (sender, receiver)


def test_the_table_ends_where_nothing_is_taken_in():
    assert shares().shape == (SENDERS, RECEIVERS, OFFSETS)
    assert shares()[DSSS, DSSS, OFFSETS - 2] > 0
    assert not shares()[:, :, OFFSETS - 1].any()
    assert (shares() >= 0).all()
