"""The values of ns-3's example wifi-bianchi come out of its model with the durations of our frames, to the last digit.

So each network of saturation_throughput says which frames ns-3 has in mind: above all at which rate its stations
answer, and for an ACK of which rate EIFS leaves room. The model is that of the reference's section 1.4, with EIFS after
collisions; like ns-3's own script it picks tau from a table of 10 000 values.
"""

import math
from typing import Any

import numpy as np
import pytest

from cosim.channels.adhoc.settings import AdhocSettings
from cosim.units import to_seconds
from experiments.saturation_throughput.figures import published

DELAY_S = 1e-7
PAYLOAD_OCTETS = 1500


def tau(stations: int, window: int, doublings: int) -> float:
    table = np.linspace(0.0, 1.0, 10_000)
    p = 1.0 - (1.0 - table) ** (stations - 1)
    wanted = 2.0 / (1.0 + window + p * window * sum((2.0 * p) ** k for k in range(doublings)))
    return float(wanted[np.argmin(np.abs(table - wanted))])


def ns3_mbps(radio: dict[str, Any], stations: int) -> float:
    """Return the throughput of ns-3's corrected model for our frames."""
    settings = AdhocSettings.model_validate({"kind": "adhoc", **radio})
    timing, access = settings.timing(), settings.access
    window = access.cw_min + 1
    data, ack = (to_seconds(each.duration) for each in (timing.unicast(PAYLOAD_OCTETS), timing.ack))
    sifs, slot, difs, eifs = (to_seconds(each) for each in (timing.sifs, timing.slot, timing.difs, timing.eifs))
    t = tau(stations, window, round(math.log2((access.cw_max + 1) / window)))
    again = 1.0 / window  # a station that has sent draws 0, and sends again
    success = (data + sifs + ack + difs + DELAY_S) / (1.0 - again) + slot
    collision = data + eifs + DELAY_S
    some, one = 1.0 - (1.0 - t) ** stations, stations * t * (1.0 - t) ** (stations - 1)
    mean_slot = (1.0 - some) * slot + one * success + (some - one) * collision
    return one * 8e-6 * PAYLOAD_OCTETS / (1.0 - again) / mean_slot


def worst(network: str, radio: dict[str, Any]) -> float:
    """Return the ratio to the printed value, less 1, that is farthest from 0."""
    printed = published(network, "basic")
    assert [stations for stations, _ in printed] == list(range(5, 51, 5))
    return max((ns3_mbps(radio, stations) / mbps - 1.0 for stations, mbps in printed), key=abs)


@pytest.mark.parametrize(
    ("network", "radio"),
    [
        ("dsss_1", {"phy": "dsss", "rate_mbps": 1, "basic_rates_mbps": (1,)}),
        ("dsss_2", {"phy": "dsss", "rate_mbps": 2, "basic_rates_mbps": (2,)}),
        ("dsss_11_ns3", {"phy": "dsss", "rate_mbps": 11, "basic_rates_mbps": (2,)}),
        ("ofdm_6", {"phy": "ofdm", "rate_mbps": 6}),
        ("ofdm_54_ns3", {"phy": "ofdm", "rate_mbps": 54, "basic_rates_mbps": (24,)}),
    ],
)
def test_ns3_s_values_are_those_of_answers_and_eifs_at_one_rate(network: str, radio: dict[str, Any]) -> None:
    assert abs(worst(network, radio)) < 1e-4


@pytest.mark.parametrize(
    ("network", "radio", "less"),
    [
        ("dsss_2", {"phy": "dsss", "rate_mbps": 2}, 0.003),
        ("dsss_11", {"phy": "dsss", "rate_mbps": 11}, 0.011),
        ("ofdm_54", {"phy": "ofdm", "rate_mbps": 54}, 0.017),
        ("dsss_2", {"phy": "dsss", "rate_mbps": 2, "basic_rates_mbps": (1,)}, 0.008),
        ("dsss_11", {"phy": "dsss", "rate_mbps": 11, "basic_rates_mbps": (1,)}, 0.033),
    ],
)
def test_an_eifs_or_answers_at_the_lowest_rate_cost_as_much_as_said(
    network: str, radio: dict[str, Any], less: float
) -> None:
    assert worst(network, radio) == pytest.approx(-less, abs=6e-4)
