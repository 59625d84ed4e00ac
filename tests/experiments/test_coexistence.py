"""coexistence: a point of it, what a frame of the station ruins by hand, and its claims on made-up runs."""

from typing import Any

import pandas as pd
import pytest

from experiments.coexistence import figures
from experiments.coexistence.sharing import Parameters, measure, ruined_by

NOTHING = pd.DataFrame()
CLAIMS = (
    *(figures.renewal_classic, figures.renewal_le, figures.contrast, figures.short_less, figures.adapted),
    *(figures.distance_rule, figures.energy_detection, figures.robust_rate, figures.more_links),
)


def test_losses_are_what_the_pauses_and_the_channels_let_expect() -> None:
    found = measure({"load": 0.5, "duration_s": 8}, 1)
    assert found["narrow_loss"] == pytest.approx(found["expected_narrow_loss"], abs=0.03)  # 4 standard errors
    assert found["narrow_loss"] > 0.1
    assert found["pair_loss"] > found["narrow_loss"]
    assert found["wide_load"] == pytest.approx(0.5, abs=0.05)


def test_a_silent_station_costs_nothing() -> None:
    found = measure({"load": 0.0, "duration_s": 2}, 1)
    assert (found["narrow_loss"], found["pair_loss"], found["wide_load"]) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(("station_m", "channels"), [(500.0, 0), (14.0, 17), (9.0, 19)])
def test_a_strong_station_ruins_the_channels_in_its_band(station_m: float, channels: int) -> None:
    """802.11b: of sinc^2(f / 11 MHz) 1 MHz takes in -20 dB at 8 MHz, -23.8 at 9, -30.1 at 10.

    The link has -60.2 dBm and needs 11 dB; 15 dBm come with -48.1 dBm from 14 m, and with -44.3 dBm from 9 m.
    """
    assert ruined_by(Parameters(station_m=station_m)) == channels


def made(**losses: dict[tuple[str, float], Any]) -> pd.DataFrame:
    """Return two runs for each case and load that *losses* name, by value; what is not given is 0.5."""
    arms = {arm for values in losses.values() for arm in values}
    rows = [
        {"case": case, "load": load, "replicate": number, **dict.fromkeys(figures.VALUES, 0.5)}
        | {name: values[case, load] for name, values in losses.items() if (case, load) in values}
        for case, load in sorted(arms)
        for number in (0, 1)
    ]
    return pd.DataFrame(rows)


SHORT, LONG = figures.CLASSIC
LE_SHORT, LE_LONG = figures.LE


def test_claims_hold_and_fail() -> None:
    expected = {(SHORT, 0.3): 0.1, (LONG, 0.3): 0.2}
    assert figures.renewal_classic(made(narrow_loss=expected, expected_narrow_loss=expected), NOTHING)[1] is True
    off = {(SHORT, 0.3): 0.1, (LONG, 0.3): 0.25}
    assert figures.renewal_classic(made(narrow_loss=off, expected_narrow_loss=expected), NOTHING) == (
        "1 of 2 points",
        False,
    )
    pairs = {(SHORT, 1.0): 0.4, (LE_SHORT, 1.0): 0.26}
    runs = made(narrow_loss={(SHORT, 1.0): 0.25, (LE_SHORT, 1.0): 0.25}, pair_loss=pairs)
    assert figures.contrast(runs, NOTHING) == ("1.60 and 1.04", True)
    assert figures.contrast(made(narrow_loss=pairs, pair_loss=pairs), NOTHING) == ("1.00 and 1.00", False)
    less = {(SHORT, 0.3): 0.1, (LONG, 0.3): 0.2, (LE_SHORT, 0.3): 0.1, (LE_LONG, 0.3): 0.1}
    assert figures.short_less(made(narrow_loss=less), NOTHING) == ("1 of 2 loads", False)
    after = {(SHORT, 0.3): 0.2, (figures.AFH, 0.3): 0.02}
    assert figures.adapted(made(narrow_loss=after), NOTHING) == ("0.100 at most", True)
    rule = {("OFDM at 48 m", 0.3): 0.1, ("OFDM at 50 m", 0.3): 0.0}
    assert figures.distance_rule(made(narrow_loss=rule), NOTHING)[1] is True
    assert figures.distance_rule(made(narrow_loss=dict.fromkeys(rule, 0.1)), NOTHING)[1] is False
    heard = {("station at 12.3 m", 1.0): 6.0, ("station at 12.4 m", 1.0): 7.0}
    assert figures.energy_detection(made(wide_mbps=heard), NOTHING) == ("6.000 and 7.000 Mb/s", True)
    assert figures.energy_detection(made(wide_mbps=dict.fromkeys(heard, 7.0)), NOTHING)[1] is False
    rates = {("hearer at 11 Mb/s", 0.3): 0.1, ("hearer at 1 Mb/s", 0.3): 0.02}
    assert figures.robust_rate(made(wide_loss=rates), NOTHING)[1] is False
    links = {("hearer at 11 Mb/s", 0.3): 0.1, ("hearer at 11 Mb/s, 5 links", 0.3): 0.41}
    assert figures.more_links(made(wide_loss=links), NOTHING) == ("1.00 to 1.00 times", True)
    assert all(claim(NOTHING, NOTHING) == ("-", None) for claim in CLAIMS)
