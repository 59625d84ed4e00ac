"""Saturation throughput against Bianchi's model and the values of ns-3's validation."""

from typing import Any

import numpy as np
import pytest

from experiments.saturation_throughput.saturation import chances, measure
from tests.tiers import two_tiers

BIANCHI = {"phy": "fhss", "overhead_octets": 34, "cw_min": 31, "cw_max": 1023, "bianchi_counting": True}
DSSS = {"phy": "dsss", "rate_mbps": 1, "basic_rates_mbps": (1,)}
OFDM = {"phy": "ofdm", "rate_mbps": 6, "basic_rates_mbps": (6,)}


@pytest.mark.parametrize(
    ("stations", "window", "doublings", "tau", "p"),
    [  # reference algorithms 1.3
        (5, 32, 3, 0.048164, 0.179179),
        (20, 32, 5, 0.026423, 0.398775),
        (50, 128, 3, 0.008786, 0.351058),
        (50, 32, 3, 0.019004, 0.609427),
    ],
)
def test_the_model_s_equations_are_solved(stations: int, window: int, doublings: int, tau: float, p: float) -> None:
    assert chances(stations, window, doublings) == pytest.approx((tau, p), abs=1e-6)


def of_runs(network: dict[str, Any], stations: int, octets: int, access: str = "basic") -> Any:
    """Return means over six seeds and their standard errors, by column."""
    parameters = {
        "network": {"radio": network, "payload_octets": octets},
        "stations": stations,
        "access": access,
        "payloads": 5000,
    }
    rows = [measure(parameters, seed) for seed in range(1, 7)]
    columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    return {name: (column.mean(), column.std(ddof=1) / np.sqrt(len(rows))) for name, column in columns.items()}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("access", "stations", "published"),
    # reference algorithms 1.3, W = 32, m = 5
    two_tiers([("basic", 10, 0.757880), ("basic", 2, 0.847310), ("rts", 5, 0.834160)], 2),
)
def test_throughput_is_bianchi_s_within_one_and_a_half_per_cent(access: str, stations: int, published: float) -> None:
    found = of_runs(BIANCHI, stations, 1023, access)
    assert found["bianchi_mbps"][0] == pytest.approx(published, abs=1e-6)
    mean, error = found["throughput_mbps"]
    assert error < 0.004 * published
    assert abs(mean / published - 1) < 0.015


@pytest.mark.slow
def test_a_frame_fails_as_often_as_in_the_model() -> None:
    mean, error = of_runs(BIANCHI, 5, 1023)["failed"]
    assert abs(mean - chances(5, 32, 5).collides) < 4 * error < 0.02


@pytest.mark.slow
@pytest.mark.parametrize(("network", "stations", "ns3_mbps"), two_tiers([(OFDM, 10, 4.3197), (DSSS, 5, 0.8418)], 1))
def test_throughput_by_the_standard_s_counting_is_that_of_ns3_within_two_per_cent(
    network: dict[str, Any], stations: int, ns3_mbps: float
) -> None:
    found = of_runs(network, stations, 1500)
    mean, error = found["throughput_mbps"]
    assert error < 0.005 * ns3_mbps
    assert abs(mean / ns3_mbps - 1) < 0.02
    assert found["fairness"][0] > 0.95
