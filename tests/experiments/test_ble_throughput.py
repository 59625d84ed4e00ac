"""ble_throughput: its closed form against draws of whole events, a point of it, and its claims on made-up runs."""

import numpy as np
import pandas as pd
import pytest

from experiments.ble_throughput import figures
from experiments.ble_throughput.throughput import Parameters, acknowledged, exchanges, expected_kbps, measure


def drawn(count: int, down: tuple[float, float], up: tuple[float, float], events: int, seed: int) -> float:
    """Return how many packets an event acknowledges, in the mean of *events* that are gone through one by one."""
    stream, total, received = np.random.default_rng(seed), 0, False
    for _ in range(events):
        wrong_down = wrong_up = 0
        for _ in range(count):
            if stream.random() >= down[0]:
                break
            if stream.random() < down[1]:
                received, wrong_down = True, 0
            else:
                wrong_down += 1
                if wrong_down == 2:
                    break
            if stream.random() >= up[0]:
                break
            if stream.random() < up[1]:
                total, received, wrong_up = total + received, False, 0
            else:
                wrong_up += 1
                if wrong_up == 2:
                    break
    return total / events


@pytest.mark.parametrize(
    ("count", "down", "up"),
    [(1, (0.7, 0.5), (0.9, 0.8)), (5, (0.9, 0.6), (0.95, 0.7)), (40, (0.95, 0.3), (0.95, 0.98))],
)
def test_the_chain_is_what_comes_of_events_that_are_drawn(
    count: int, down: tuple[float, float], up: tuple[float, float]
) -> None:
    left = [acknowledged(count, down, up, received) for received in (False, True)]
    share = left[0][1] / (1 - left[1][1] + left[0][1])
    mean = (1 - share) * left[0][0] + share * left[1][0]
    assert drawn(count, down, up, 40_000, 7) == pytest.approx(mean, rel=0.03)


def test_without_losses_all_exchanges_are_acknowledged() -> None:
    assert acknowledged(17, (1.0, 1.0), (1.0, 1.0), False) == (17.0, 0.0)
    assert acknowledged(17, (0.0, 1.0), (1.0, 1.0), True) == (0.0, 1.0)
    assert exchanges(Parameters(octets=27, interval_s=0.0075)) == 11
    assert expected_kbps(Parameters(phy="2M", interval_s=0.4)) == pytest.approx(8 * 244 * 287 / 400)


@pytest.mark.parametrize(
    ("phy", "octets", "interval_s"), [("1M", 251, 0.0075), ("2M", 27, 0.03), ("coded", 251, 0.4), ("coded", 27, 0.4)]
)
def test_a_link_without_losses_carries_whole_exchanges(phy: str, octets: int, interval_s: float) -> None:
    found = measure({"phy": phy, "octets": octets, "interval_s": interval_s, "margin_db": 50, "duration_s": 0.8}, 1)
    assert found["difference_kbps"] == pytest.approx(0.0, abs=1e-9)
    assert found["throughput_kbps"] > 20
    assert found["lost"] == 0


def test_a_link_with_losses_carries_what_the_chain_says() -> None:
    found = [measure({"margin_db": 1, "interval_s": 0.03, "duration_s": 2}, seed) for seed in range(3)]
    mean = np.mean([each["throughput_kbps"] for each in found])
    assert mean == pytest.approx(found[0]["closed_form_kbps"], rel=0.08)
    assert found[0]["closed_form_kbps"] < 400


def made(margin_db: float, differences: list[float]) -> pd.DataFrame:
    rows = {"phy": "1M", "octets": 251, "interval_s": 0.03, "margin_db": margin_db, "closed_form_kbps": 500.0}
    return pd.DataFrame(
        [rows | {"replicate": n, "difference_kbps": d, "throughput_kbps": 500.0 + d} for n, d in enumerate(differences)]
    )


def test_claims_hold_and_fail() -> None:
    nothing = pd.DataFrame()
    assert figures.whole_exchanges(made(50, [0.0, 0.0]), nothing) == ("2 of 2 runs equal", True)
    assert figures.whole_exchanges(made(50, [0.0, 0.1]), nothing) == ("1 of 2 runs equal", False)
    assert figures.with_losses(made(2, [3.0, -2.0, 1.0]), nothing) == ("1 of 1 points", True)
    assert figures.with_losses(made(2, [6.0, 7.0, 8.0]), nothing) == ("0 of 1 points", False)
    for claim in (figures.whole_exchanges, figures.with_losses):
        assert claim(nothing, nothing) == ("-", None)
