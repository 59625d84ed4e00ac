"""coexistence_piconets: how often links meet, and its claims on made-up runs."""

from typing import Any

import pandas as pd
import pytest

from experiments.coexistence.piconets import figures
from experiments.coexistence.piconets.crowd import measure
from experiments.coexistence.sharing import Parameters, Sharing, Told, along_a_line

NOTHING = pd.DataFrame()
CLAIMS = figures.independent, figures.meetings, figures.spares_station, figures.spares_links, figures.gone


def test_links_are_expected_to_meet_as_often_as_their_packets_last() -> None:
    """A DH1 each 5 ms and its answer, which last 366 and 126 us, meet one of 366 us: 200 x (732 + 492) us of a second.

    A POLL and its answer each 25 ms beside them would add 200 x (2 x 492) / 5 us.
    """
    run = Sharing(Parameters(links=2, load=0.0, duration_s=2), 1, along_a_line(Parameters(links=2)))
    run.connect()
    assert 0.244 <= Told(run, *run.run()).met() <= 0.285


def test_more_links_lose_more_and_adapted_ones_expect_nothing() -> None:
    found = measure({"links": 4, "load": 0.0, "duration_s": 3}, 2)
    alone = measure({"links": 1, "load": 0.0, "duration_s": 1}, 2)
    assert alone["narrow_loss"] == alone["expected_narrow_loss"] == 0.0
    assert 0.0 < found["narrow_loss"] < 0.03
    assert found["expected_narrow_loss"] == pytest.approx(1 - (1 - 0.2448 / 79) ** 3, rel=0.2)
    adapted = measure({"links": 1, "load": 0.0, "duration_s": 1, "afh": True}, 2)
    assert adapted["expected_narrow_loss"] != adapted["expected_narrow_loss"]


def made(hops: str, load: float = 0.7, **values: dict[int, Any]) -> pd.DataFrame:
    """Return two runs for each number of links that *values* name; what is not given is 0.5."""
    arms = sorted({links for by_links in values.values() for links in by_links})
    rows = [
        {"hops": hops, "load": load, "links": links, "replicate": number, **dict.fromkeys(figures.VALUES, 0.5)}
        | {name: by_links[links] for name, by_links in values.items() if links in by_links}
        for links in arms
        for number in (0, 1)
    ]
    return pd.DataFrame(rows)


def test_claims_hold_and_fail() -> None:
    ruined = made(figures.ALL, wide_loss={1: 0.1, 2: 0.19, 5: 0.41})
    assert figures.independent(ruined, NOTHING) == ("1.00 to 1.00 times", True)
    assert figures.independent(made(figures.ALL, wide_loss={1: 0.1, 5: 0.25}), NOTHING)[1] is False
    lost = {1: 0.1, 2: 0.2}
    assert figures.meetings(made(figures.ALL, narrow_loss=lost, expected_narrow_loss=lost), NOTHING)[1] is True
    off = made(figures.ALL, narrow_loss=lost, expected_narrow_loss={1: 0.1, 2: 0.25})
    assert figures.meetings(off, NOTHING) == ("1 of 2 points", False)
    both = pd.concat([ruined, made(figures.AFH, wide_loss={1: 0.01, 2: 0.09, 5: 0.3}, narrow_loss={1: 0.1, 2: 0.6})])
    assert figures.spares_station(both, NOTHING) == ("3 of 3 numbers", True)
    assert figures.spares_links(both, NOTHING) == ("1 of 3 numbers", False)
    assert figures.gone(both, NOTHING) == ("0.73 at most", False)
    assert figures.gone(both[both["links"] <= 2], NOTHING) == ("0.47 at most", True)
    assert all(claim(NOTHING, NOTHING) == ("-", None) for claim in CLAIMS)
    silent = made(figures.ALL, load=0.0, narrow_loss=lost)
    assert figures.independent(silent, NOTHING) == ("-", None)
