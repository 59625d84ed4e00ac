"""What interference over the band does to frames of one technology under another, against the figures of coexistence.

The error laws are written here: exp(-s / 2) / 2 for bits of LE (h = 0.5), and those of ``adhoc.errors`` for 802.11b.
"""

import math
from itertools import pairwise

import numpy as np
import pytest

from cosim.channels.adhoc.errors import log_success, packet_success
from cosim.channels.adhoc.settings import AdhocSettings
from cosim.channels.air.band import Band, Emission, Section
from cosim.channels.air.emissions import NOBODY, Tuning, Wanted
from cosim.channels.air.spectra import CLASSIC, DSSS, LE_1M, OFDM
from cosim.channels.bluetooth.hopping import basic_channel
from cosim.channels.propagation import Propagation, PropagationSettings
from cosim.geometry.segments import segment_grid
from cosim.randomness import Draws
from cosim.units import MS, US, Time
from tests.channels.air.collisions import centre_of
from tests.channels.air.quiet import band_of

WIFI, OTHER = 0, 1
LINK, RECEIVER, INTERFERER, SECOND = range(4)
CENTRE = 2 * 2437


def free_space() -> Propagation:
    return Propagation(PropagationSettings(), segment_grid([]), [], Draws(1, "shadowing"))


def along(band: Band, *places_m: float) -> None:
    """Put radios on a line."""
    band.moved(free_space().gains_db([(x, 0.0) for x in places_m]), 0)


def mw(dbm: float) -> float:
    return 10 ** (dbm / 10)


def sinr_db(band: Band, start: Time, end: Time) -> float:
    """Return the ratio of carrier to all interference of an LE frame that all of it meets; there is no noise."""
    tuning = Tuning(LE_1M, CENTRE - 8, RECEIVER)
    (section,) = band.interference(tuning, start, end, Wanted(OTHER, LINK))
    gain = float(band.table.gains[band.table.state[1], LINK, RECEIVER])
    return 10 * math.log10(gain / section.mw)


def wifi_on(band: Band, sent_mw: float, sender: int = INTERFERER, kind: int = OFDM) -> None:
    band.tell(Emission(0, 10 * MS, kind, CENTRE, sender, WIFI, sent_mw))


@pytest.mark.parametrize("link_m", [1.0, 4.0])
def test_a_link_of_le_holds_if_the_station_is_5_75_times_as_far(link_m: float):
    """15 against 0 dBm, 11 dB wanted, a share of -10.8 dB that is printed to 0.1 dB: 5.75 within 0.6 %."""
    ratios = []
    for ratio in np.arange(5.0, 6.5, 0.005):
        band = band_of(3)
        along(band, 0.0, link_m, link_m + ratio * link_m)
        wifi_on(band, mw(15))
        if sinr_db(band, 0, 366 * US) > 11.0:
            ratios.append(ratio)
    assert ratios == pytest.approx(np.arange(ratios[0], 6.4999, 0.005).tolist())
    assert ratios[0] == pytest.approx(5.75, rel=0.006)


def gfsk_success(sections: list[Section], carrier_mw: float, bits_per_us: float = 1.0) -> float:
    """Return the probability that all bits of LE are right, section by section."""
    product = 1.0
    for section in sections:
        error = math.exp(-carrier_mw / section.mw / 2) / 2 if section.mw else 0.0
        product *= (1 - error) ** (bits_per_us * (section.end - section.start) / US)
    return product


def frame_success(length: Time, parts: int, *sent_mw: float) -> float:
    """Return the success of an LE frame of 0 dBm under 802.11 that sends *parts* frames, one right after the other."""
    band = band_of(4)
    band.moved(np.zeros((4, 4)), 0)
    cuts = [length * part // parts for part in range(parts + 1)]
    for number, power in enumerate(sent_mw):
        for start, end in pairwise(cuts):
            band.tell(Emission(start, end, OFDM, CENTRE, INTERFERER + number, WIFI, power))
    tuning = Tuning(LE_1M, CENTRE - 8, RECEIVER)
    return gfsk_success(band.interference(tuning, 0, length, Wanted(OTHER, LINK)), 1.0)


@pytest.mark.parametrize(
    ("bits", "lost", "printed_db"), [(366, 0.1, 11.74), (366, 0.5, 10.47), (2870, 0.1, 12.80), (2870, 0.5, 11.84)]
)
@pytest.mark.parametrize("parts", [1, 3])
def test_frames_of_le_are_lost_at_the_ratios_that_are_printed(bits: int, lost: float, printed_db: float, parts: int):
    band = band_of(3)
    band.moved(np.zeros((3, 3)), 0)
    wifi_on(band, 1.0)
    share_db = -sinr_db(band, 0, 366 * US)
    above, below = (
        1 - frame_success(bits * US, parts, mw(-(printed_db + hair_db) - share_db)) for hair_db in (0.005, -0.005)
    )
    assert above < lost < below


def test_a_station_received_0_3_db_stronger_than_the_wanted_signal_destroys_half_of_the_packets():
    assert 1 - frame_success(366 * US, 1, mw(0.3)) == pytest.approx(0.5, abs=0.03)


def test_a_second_equal_station_is_3_db_more():
    assert frame_success(366 * US, 1, 0.5, 0.5) == pytest.approx(frame_success(366 * US, 1, 1.0), rel=1e-12)
    ratios_db = []
    for senders in ((INTERFERER,), (INTERFERER, SECOND)):
        band = band_of(4)
        band.moved(np.zeros((4, 4)), 0)
        for sender in senders:
            wifi_on(band, 1.0, sender)
        ratios_db.append(sinr_db(band, 0, MS))
    assert ratios_db[0] - ratios_db[1] == pytest.approx(10 * math.log10(2), abs=1e-9)


# ---------------------------------------------------------------- energy that a station detects


def energy_mw(band: Band, start: Time, end: Time, centre: int = CENTRE) -> list[Section]:
    return band.interference(Tuning(OFDM, centre, RECEIVER), start, end, Wanted(WIFI, NOBODY))


@pytest.mark.parametrize(
    ("dbm", "distance_m", "busy"), [(0, 12.3, True), (0, 12.4, False), (4, 19.4, True), (4, 19.6, False)]
)
@pytest.mark.parametrize("offset_mhz", [-9, 0, 9])
def test_a_carrier_in_the_band_is_energy_up_to_the_printed_distance(
    dbm: float, distance_m: float, busy: bool, offset_mhz: int
):
    """-62 dBm in 20 MHz: 12.3 m at 0 dBm in free space, 19.5 m at 4 dBm."""
    band = band_of(2)
    along(band, distance_m, 0.0)
    band.tell(Emission(0, MS, CLASSIC, CENTRE + 2 * offset_mhz, LINK, OTHER, mw(dbm)))
    (section,) = energy_mw(band, 0, MS)
    assert (section.mw >= mw(AdhocSettings().energy_dbm)) == busy
    assert AdhocSettings().energy_dbm == -62


@pytest.mark.slow
def test_a_saturated_piconet_near_a_station_silences_it_for_the_printed_share_of_time():
    """366 us of each 625 on the hops that lie in 20 MHz, 20 of 79: .148."""
    random = np.random.default_rng(20)
    shares, slots, centre = [], 250, 2 * 2441 + 1
    for address in random.integers(1 << 28, size=200).tolist():
        band = band_of(2)
        along(band, 5.0, 0.0)
        clocks = (int(random.integers(1 << 20)) << 8) + 2 * np.arange(slots)
        for slot, channel in enumerate(np.asarray(basic_channel(address, clocks)).tolist()):
            start = slot * 625 * US
            band.tell(Emission(start, start + 366 * US, CLASSIC, centre_of(channel), LINK, OTHER, 1.0))
        busy = [s for s in energy_mw(band, 0, slots * 625 * US, centre) if s.mw >= mw(-62)]
        shares.append(sum(s.end - s.start for s in busy) / (slots * 625 * US))
    error = np.std(shares, ddof=1) / math.sqrt(len(shares))
    assert error < 0.002
    assert abs(np.mean(shares) - 0.148) < 4 * error + 0.0005


# ---------------------------------------------------------------- 802.11b under a narrow sender


def under_a_tone(rate_kbps: int, octets: int, hit: Time, ratio_db: float) -> float:
    """Return the loss of a frame of which the first part, *hit* long, meets a narrow sender near the centre."""
    length = 8 * octets * MS // rate_kbps
    band = band_of(3)
    band.moved(np.zeros((3, 3)), 0)
    band.tell(Emission(0, hit or length, CLASSIC, CENTRE + 4, INTERFERER, OTHER, mw(-ratio_db)))
    total = 0.0
    for section in band.interference(Tuning(DSSS, CENTRE, RECEIVER), 0, length, Wanted(WIFI, LINK)):
        if section.mw:
            bits = 8 * octets * (section.end - section.start) / length
            total += log_success(rate_kbps, 1.0 / section.mw, bits)
    return 1 - math.exp(total)


NARROW = [(1000, -3.0, -6.0), (2000, 1.6, -1.1), (5500, 4.2, 2.3), (11000, 7.2, 5.7)]


@pytest.mark.parametrize(("rate_kbps", "whole_db", "part_db"), NARROW)
def test_frames_of_80211b_are_lost_under_a_narrow_sender_at_the_ratios_that_are_printed(
    rate_kbps: int, whole_db: float, part_db: float
):
    """1536 octets: a tenth if all of it is hit, a half if 366 us are."""
    for hit, ratio_db, lost in ((0, whole_db, 0.1), (366 * US, part_db, 0.5)):
        above, below = (under_a_tone(rate_kbps, 1536, hit, ratio_db + hair_db) for hair_db in (0.05, -0.05))
        assert above < lost < below, hit
    assert 1 - packet_success(rate_kbps, mw(whole_db), 8 * 1536) == pytest.approx(
        under_a_tone(rate_kbps, 1536, 0, whole_db), rel=1e-9
    )


def test_11_mbps_needs_10_db_more_than_1_mbps():
    def needed_db(rate_kbps: int) -> float:
        return min(db for db in np.arange(-6, 10, 0.02).tolist() if under_a_tone(rate_kbps, 1536, 0, db) < 0.1)

    assert needed_db(11000) - needed_db(1000) == pytest.approx(10, abs=0.5)
