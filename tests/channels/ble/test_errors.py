"""Errors of LE packets: closed forms, sensitivities, and how often receivers make what of a packet."""

from math import exp, log10

import pytest

from cosim.channels.air.band import Section
from cosim.channels.ble.bits.errors import CLEAR_G, SENSITIVITY_G, bit_error_rate, least_dbm, noise_mw, ratio, received
from cosim.channels.ble.connections.exchange import Reception
from cosim.channels.ble.phy import CODED_S2, CODED_S8, LE_1M, LE_2M, PHYS, Phy
from cosim.channels.jamming import CONSTANT, Jammer
from cosim.machine import BROADCAST, Discovered, Inquire
from cosim.units import MS, US, S
from tests.channels.ble.ble_field import Field, found

LAW = {"model": "free_space"}
"""40.2 dB at a metre, 20 dB more for each ten times as far."""


@pytest.mark.parametrize(("g_db", "rate"), [(8, 2.13e-2), (10, 3.37e-3), (12, 1.81e-4)])
def test_bit_error_rates_are_those_of_the_reference(g_db: float, rate: float) -> None:
    assert bit_error_rate(10 ** (g_db / 10)) == pytest.approx(rate, rel=5e-3)
    assert round(10 * log10(SENSITIVITY_G), 2) == 10.94


@pytest.mark.parametrize(("phy", "dbm"), [(LE_1M, -99.0), (LE_2M, -96.0), (CODED_S2, -103.0), (CODED_S8, -108.5)])
def test_each_phy_has_one_wrong_bit_in_a_thousand_at_its_sensitivity(phy: Phy, dbm: float) -> None:
    g = ratio(phy, 10 ** (dbm / 10), noise_mw(phy, -99.0))
    assert bit_error_rate(g) == pytest.approx(1e-3, rel=1e-9)
    assert least_dbm(phy, -99.0, SENSITIVITY_G) == pytest.approx(dbm, abs=1e-9)


@pytest.mark.parametrize(("octets", "lost"), [(6, 0.113), (37, 0.308), (251, 0.875)])
def test_packets_at_sensitivity_are_lost_as_the_reference_says(octets: int, lost: float) -> None:
    whole = [Section(0, LE_1M.air_time(octets), 0.0)]
    header, payload = received(LE_1M, octets, 10**-9.9, noise_mw(LE_1M, -99.0), whole, 0)
    assert header == pytest.approx(0.999**48, rel=1e-9)
    assert payload == pytest.approx(0.999 ** (8 * (octets + 3)), rel=1e-9)
    assert 1 - header * payload == pytest.approx(lost, abs=5e-4)


def test_the_longest_packet_survives_where_it_is_clear() -> None:
    assert 1 - (1 - bit_error_rate(CLEAR_G)) ** (8 * 258) < 2.0**-39


def test_interference_breaks_the_bits_that_it_meets_and_no_others() -> None:
    """1M, payload of 10: preamble to 8 us, header from there to 56 us, payload to 160 us."""
    noise, power, level = noise_mw(LE_1M, -99.0), 1e-6, 1e-7
    wrong = 0.5 * exp(-0.5 * power / (noise + level))
    in_preamble = [Section(0, 8 * US, level), Section(8 * US, 160 * US, 0.0)]
    assert received(LE_1M, 10, power, noise, in_preamble, 0) == (pytest.approx(1.0), pytest.approx(1.0))
    in_header = [Section(0, 8 * US, 0.0), Section(8 * US, 32 * US, level), Section(32 * US, 160 * US, 0.0)]
    assert received(LE_1M, 10, power, noise, in_header, 0) == (pytest.approx((1 - wrong) ** 24), pytest.approx(1.0))
    across = [Section(0, 48 * US, 0.0), Section(48 * US, 108 * US, level), Section(108 * US, 160 * US, 0.0)]
    header, payload = received(LE_1M, 10, power, noise, across, 0)
    assert (header, payload) == (pytest.approx((1 - wrong) ** 8), pytest.approx((1 - wrong) ** 52))


@pytest.mark.parametrize("phy", PHYS.values(), ids=lambda phy: phy.name)
def test_receivers_lose_as_many_packets_as_the_law_says(phy: Phy) -> None:
    """A robot at the sensitivity of its PHY: of 4000 packets as many come through as in the closed form."""
    loss_db = -phy.sensitivity_dbm
    distance_m = 10 ** ((loss_db - 40.2) / 20)
    field = Field(2, propagation=LAW, interference="none")
    field.move([(0, 0), (distance_m, 0)])
    ether, count = field.channel._ether, 4_000
    packet = field.channel.devices[0].station.beacon.packet(37, 0)
    packet.phy, packet.octets = phy, 37
    made = []
    for turn in range(count):
        packet.start = turn * 10 * MS
        made.append(ether.judge(packet, 1).reception)
    header, payload = 0.999**48, 0.999 ** (8 * 40)
    for reception, share in (
        (Reception.HEARD, header * payload),
        (Reception.BAD_CRC, header * (1 - payload)),
        (Reception.MISSED, 1 - header),
    ):
        assert abs(made.count(reception) - count * share) < 4 * (count * share * (1 - share)) ** 0.5


def test_in_reach_is_who_receives_with_the_sensitivity() -> None:
    limit_m = 10 ** ((99 - 40.2) / 20)
    field = Field(3, propagation=LAW)
    field.move([(0, 0), (limit_m * 0.999, 0), (limit_m * 1.001, 0)])
    assert field.channel.in_reach(0) == (1,)
    assert field.channel.in_reach(1) == (0, 2)


# ---------------------------------------------------------------- what disturbs


def on_all(*channels_mhz: int, power_dbm: float = 30.0) -> Jammer:
    return Jammer(0.0, 0.0, power_dbm, channels_mhz, CONSTANT, 0, 0, 0, 0, 1000 * S)


def test_a_jammer_on_the_advertising_channels_hides_devices_and_leaves_links_alone() -> None:
    field = Field(3)
    field.link(0, 1)
    field.channel.jam(on_all(0, 24, 78)._replace(start=field.kernel.now))
    found(field, 2)
    assert field.of(2, Discovered) == []
    field.send(0, 1, bytes(200))
    field.until(field.kernel.now + 1 * S)
    assert field.arrived(1) == [bytes(200)]


def test_a_link_loses_events_on_the_channels_of_a_jammer_and_goes_on_with_the_others() -> None:
    """A third of the general-purpose channels jammed: a payload waits for one that is not."""
    field = Field(2)
    field.link(0, 1)
    field.channel.jam(on_all(*range(2, 24, 2))._replace(start=field.kernel.now))  # RF channels 1 to 11: indices 0 to 10
    waits = []
    for _ in range(300):
        began = field.kernel.now
        field.send(0, 1, b"x")
        field.until(began + 1_010 * MS)
        waits.append((field.of(1, tuple)[-1].time - began) // (30 * MS))
    share = 11 / 37
    assert len(field.arrived(1)) == 300
    late = sum(wait >= 1 for wait in waits)  # the first event was lost, or two
    assert abs(late - 300 * share) < 4 * (300 * share * (1 - share)) ** 0.5


def test_a_strong_neighbour_disturbs_a_weak_signal_more_the_nearer_in_frequency() -> None:
    """Robot 2 sends for everyone beside robot 1, which listens to robot 0 farther away."""
    field = Field(3, propagation=LAW, listen={"interval_s": 10.24, "window_s": 10.24})
    field.move([(50, 0), (0, 0), (1, 0)])
    power_db = 20 * log10(50)
    packet, other = (field.channel.devices[sender].station.beacon.packet(37, 1) for sender in (0, 2))
    shown = []
    for channel in (37, 0, 1, 2):  # 2402, 2404, 2406, 2408 MHz
        start = field.kernel.now + 1
        packet.start = other.start = start
        other.channel = channel
        for each in (packet, other):
            field.channel._ether.send(each)
        field.until(packet.end)
        sinr_db = field.channel._ether.judge(packet, 1).sinr_db
        assert sinr_db is not None
        shown.append(sinr_db)
        field.until(field.kernel.now + 50 * MS)
    assert shown[0] == pytest.approx(-power_db - 0.0, abs=0.3)
    assert shown == sorted(shown)
    assert shown[1] > shown[0] + 20


def test_two_that_speak_at_once_are_heard_by_none_unless_one_is_much_stronger() -> None:
    for near_m, heard in ((10, 0), (100, 1)):  # 0 or 20 dB weaker than the other
        field = Field(3, propagation=LAW)
        field.move([(0, 0), (10, 0), (10 - near_m if heard else 20, 0)])
        one, other = (field.channel.devices[sender].station.beacon.packet(37, 1_000) for sender in (0, 2))
        for each in (one, other):
            field.channel._ether.send(each)
        field.until(one.end)
        receptions = [field.channel._ether.judge(each, 1).reception for each in (one, other)]
        assert receptions.count(Reception.HEARD) == heard


def test_nothing_disturbs_where_interference_is_none() -> None:
    field = Field(7, interference="none", broadcast={"events": 1})
    for sender in range(6):
        field.send(sender, BROADCAST, bytes([sender]))
    field.do(6, Inquire(1 * S, 6))
    field.until(2 * S)
    assert len(field.of(6, Discovered)) == 6
