"""coexistence_collocated: two radios on one robot with and without arbitration, and its claims on made-up runs."""

import math
from typing import Any

import pandas as pd
import pytest

from experiments.coexistence.collocated import figures
from experiments.coexistence.collocated.robots import measure

NOTHING = pd.DataFrame()
LINK = "Bluetooth"
CLAIMS: Any = (figures.deaf, figures.isolated, figures.undisturbed, figures.both_through)
PLACES = {"link_m": 3, "station_m": 3, "load": 1.0, "duration_s": 2}


@pytest.mark.parametrize("narrow", ["ble", "bluetooth"])
def test_a_robots_station_deafens_its_own_radio_unless_they_ask(narrow: str) -> None:
    heedless = measure({**PLACES, "narrow": narrow, "isolation_db": 10}, 1)
    assert heedless["deaf_least"] <= heedless["pair_loss"] <= heedless["deaf_most"]
    assert heedless["pair_loss"] > 1.5 * heedless["narrow_loss"] > 0.0
    assert heedless["narrow_refused"] == heedless["wide_refused"] == 0.0
    arbitrated = measure({**PLACES, "narrow": narrow, "isolation_db": 10, "arbitration": True}, 1)
    assert arbitrated["pair_loss"] == arbitrated["wide_loss"] == 0.0
    assert arbitrated["wide_refused"] > 10.0
    assert arbitrated["delay_ms"] < heedless["delay_ms"]
    assert 0.98 < arbitrated["arrived"] <= 1.01
    assert math.isnan(arbitrated["deaf_least"])


def test_a_silent_station_costs_a_robots_own_radio_nothing() -> None:
    found = measure({**PLACES, "narrow": "ble", "load": 0.0}, 1)
    assert (found["pair_loss"], found["deaf_least"], found["deaf_most"]) == (0.0, 0.0, 0.0)
    assert 0.0 < found["delay_ms"] < 7.5  # the interval of the link


def made(radios: str, **values: dict[tuple[int, float], Any]) -> pd.DataFrame:
    """Return two runs for each isolation and load that *values* name; what is not given is 0.5."""
    arms = sorted({arm for by_arm in values.values() for arm in by_arm})
    rows = [
        {
            "link": LINK,
            "radios": radios,
            "isolation_db": db,
            "load": load,
            "replicate": number,
            **dict.fromkeys(figures.VALUES, 0.5),
        }
        | {name: by_arm[db, load] for name, by_arm in values.items() if (db, load) in by_arm}
        for db, load in arms
        for number in (0, 1)
    ]
    return pd.DataFrame(rows)


def test_claims_hold_and_fail() -> None:
    bounds = {(10, 0.3): 0.2, (30, 0.3): 0.2, (40, 0.3): 0.2}
    fails = {(10, 0.3): 0.4, (30, 0.3): 0.1, (40, 0.3): 0.05}
    runs = made(figures.HEEDLESS, pair_loss=fails, deaf_least=bounds)
    assert figures.deaf(LINK, runs, NOTHING) == ("1 of 2 points", False)  # that of 40 dB is not asked for
    assert figures.deaf(LINK, runs[runs["isolation_db"] == 10], NOTHING) == ("1 of 1 points", True)
    packets = {(40, 0.3): 0.04}
    held = made(figures.HEEDLESS, pair_loss=fails, narrow_loss=packets)
    assert figures.isolated(LINK, held, NOTHING) == ("1 of 1 loads; 1.25 times at most", True)
    worse = made(figures.HEEDLESS, pair_loss=fails | {(30, 0.3): 0.5}, narrow_loss=packets)
    assert figures.isolated(LINK, worse, NOTHING)[1] is False
    assert (
        figures.isolated(LINK, made(figures.HEEDLESS, pair_loss=fails, narrow_loss={(40, 0.3): 0.02}), NOTHING)[1]
        is False
    )
    none = made(figures.ARBITRATED, pair_loss={(10, 0.3): 0.0}, wide_loss={(10, 0.3): 0.0})
    assert figures.undisturbed(LINK, none, NOTHING) == ("0.0000 and 0.0000 at most", True)
    assert figures.undisturbed(LINK, made(figures.ARBITRATED, pair_loss={(10, 0.3): 0.0}), NOTHING)[1] is False
    full = (10, 1.0)
    before = made(figures.HEEDLESS, delay_ms={full: 70.0}, wide_mbps={full: 7.0})
    after = made(figures.ARBITRATED, delay_ms={full: 3.0}, wide_mbps={full: 6.0}, arrived={full: 1.0})
    assert figures.both_through(LINK, pd.concat([before, after]), NOTHING) == (
        "70.0 and 3.0 ms, 7.00 and 6.00 Mb/s",
        True,
    )
    starved = made(figures.ARBITRATED, delay_ms={full: 3.0}, wide_mbps={full: 3.0}, arrived={full: 1.0})
    assert figures.both_through(LINK, pd.concat([before, starved]), NOTHING)[1] is False
    assert all(claim(LINK, NOTHING, NOTHING) == ("-", None) for claim in CLAIMS)
    assert figures.deaf("Low Energy", runs, NOTHING) == ("-", None)
