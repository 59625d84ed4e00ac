"""coexistence_distance: what a station ruins from farther and farther away, and the claims on made-up runs."""

from typing import Any

import pandas as pd
import pytest

from experiments.coexistence.distance import figures
from experiments.coexistence.sharing import Parameters, ruined_by

NOTHING = pd.DataFrame()
CLAIMS = figures.over_distance_classic, figures.over_distance_le, figures.farther_less, figures.safe
SHORT, LONG = figures.CLASSIC


@pytest.mark.parametrize(("metres", "some"), [(62.5, True), (63.5, False)])
def test_from_63_m_on_no_channel_is_ruined(metres: float, some: bool) -> None:
    assert (ruined_by(Parameters(station_m=metres)) > 0) is some
    assert pytest.approx(10 ** ((11 + 15 - 10.0) / 20) * 10, rel=0.01) == figures.HARMLESS_M


def made(link: str, **values: dict[int, Any]) -> pd.DataFrame:
    """Return two runs for each distance that *values* name; what is not given is 0."""
    arms = sorted({metres for by_distance in values.values() for metres in by_distance})
    rows = [
        {"link": link, "station_m": metres, "replicate": number, **dict.fromkeys(figures.VALUES, 0.0)}
        | {name: by_distance[metres] for name, by_distance in values.items() if metres in by_distance}
        for metres in arms
        for number in (0, 1)
    ]
    return pd.DataFrame(rows)


def test_claims_hold_and_fail() -> None:
    lost = {5: 0.3, 20: 0.2, 80: 0.0}
    runs = made(SHORT, narrow_loss=lost, expected_narrow_loss=lost)
    assert figures.over_distance_classic(runs, NOTHING) == ("3 of 3 points", True)
    assert figures.over_distance_le(runs, NOTHING) == ("-", None)
    off = made(LONG, narrow_loss=lost, expected_narrow_loss={**lost, 20: 0.25})
    assert figures.over_distance_classic(off, NOTHING) == ("2 of 3 points", False)
    assert figures.over_distance_le(off.assign(link=figures.LE[0]), NOTHING) == ("2 of 3 points", False)
    assert figures.farther_less(runs, NOTHING) == ("0.0000 at most", True)
    assert figures.farther_less(made(SHORT, narrow_loss={5: 0.3, 20: 0.1, 40: 0.15}), NOTHING) == (
        "0.0500 at most",
        False,
    )
    assert figures.safe(runs, NOTHING) == ("0.0000 at most, 0.2000 at least", True)
    assert figures.safe(made(SHORT, narrow_loss={5: 0.3, 80: 0.001}), NOTHING)[1] is False
    assert figures.safe(made(SHORT, narrow_loss={5: 0.0, 80: 0.0}), NOTHING)[1] is False
    assert all(claim(NOTHING, NOTHING) == ("-", None) for claim in CLAIMS)
