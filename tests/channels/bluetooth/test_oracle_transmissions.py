"""Transmissions, receptions and the IDs of trains equal those of the slot-by-slot oracle of the whole band."""

from collections import Counter
from collections.abc import Callable
from itertools import product
from math import isclose
from typing import Any

import pytest

from cosim.channels.bluetooth.scanning import sent_ids
from cosim.intervals import Interval
from cosim.trace import FRAMES, INTERVALS, RECEPTIONS, TRANSMISSIONS, Trace
from tests.channels.bluetooth import test_oracle_band, test_oracle_inquiry, test_oracle_page
from tests.channels.bluetooth.band_channel import payload_of, run_channel
from tests.oracles.band_cases import Case
from tests.oracles.band_scene import Arrived, Book, Send, Sent
from tests.tiers import soak_count


def trace_of(case: Case) -> Trace:
    """Return the trace of the channel on the *case*."""
    trace = Trace((FRAMES, INTERVALS, TRANSMISSIONS, RECEPTIONS))
    run_channel(case, trace=trace)
    return trace


def rows(trace: Trace, name: str) -> list[tuple[Any, ...]]:
    return list(zip(*trace.columns(name).values(), strict=True))


def close(one: float | None, other: float | None) -> bool:
    """Return whether two numbers, or what stands for none, are the same but for what rounding does."""
    return one is other or (one is not None and other is not None and isclose(one, other, rel_tol=0, abs_tol=1e-9))


def compare(case: Case) -> Counter[str]:
    """Compare one case, and return how often what has occurred in it."""
    trace, book = trace_of(case), case.book()
    compare_transmissions(case, trace, book)
    seen = compare_receptions(case, trace, book)
    compare_ids(case, trace, book)
    seen["again"] += sum(row.again for row in book.sent)
    seen["IDs"] += len(book.ids)
    return seen


def compare_transmissions(case: Case, trace: Trace, book: Book) -> None:
    payloads = {wish.token: payload_of(wish) for wish in case.scene.inputs if isinstance(wish, Send)}

    def told(row: Sent) -> tuple[Any, ...]:
        body = b"" if row.token is None else payloads[row.token]
        of_frame = row.air, row.channel, row.lt_addr, len(body)
        return row.start, row.source, row.kind, row.destination, 0, 0, row.again, False, True, body.hex(), *of_frame

    wanted = (row for row in book.sent if row.start + row.air < case.scene.end and (case.idle or not row.idle))
    fast = [row for row in rows(trace, "transmissions") if row[0] + row[10] < case.scene.end]
    assert sorted(fast) == sorted(map(told, wanted)), case


def compare_receptions(case: Case, trace: Trace, book: Book) -> Counter[str]:
    slow = sorted((row for row in book.arrived if case.idle or not row.idle), key=lambda row: row[:3])
    fast = sorted(rows(trace, "receptions"), key=lambda row: row[:3])
    ended = {(row.start, row.source) for row in book.sent if row.start + row.air < case.scene.end}
    slow, fast = ([row for row in each if row[:2] in ended] for each in (slow, fast))
    assert [(*row[:3], *row[5:]) for row in fast] == [(*row[:3], row.outcome, row.part or "") for row in slow], case
    seen: Counter[str] = Counter()
    for mine, theirs in zip(fast, slow, strict=True):
        _, _, _, power_dbm, sinr_db, *_ = mine
        assert close(power_dbm, theirs.power_dbm), (case, mine, theirs)
        assert close(sinr_db, theirs.sinr_db), (case, mine, theirs)
        seen.update(kinds_of(theirs))
    return seen


def kinds_of(row: Arrived) -> list[str]:
    """Return what there is to be seen in a reception."""
    power = "power" if row.power_dbm is not None else "no power"
    return [power, "ratio" if row.sinr_db is not None else "no ratio", f"{row.outcome}, {power}", f"idle: {row.idle}"]


def compare_ids(case: Case, trace: Trace, book: Book) -> None:
    answers = [row for row in rows(trace, "frames") if row[4] == "FHS" and (row[8] == "received" or row[9] in HEARD)]
    mine: list[tuple[int, int, int]] = []
    for row in map(Interval._make, rows(trace, "intervals")):
        if row.state not in ("inquiry", "page"):
            continue
        silences = [(start, start + air) for start, _, to, air, *_ in answers if to == row.robot]
        middle = (row.start + row.end) // 2
        for part in ((0, middle), (middle, case.scene.end)):
            starts, channels = sent_ids(row, *part, silences if row.state == "inquiry" else ())
            mine += zip(starts.tolist(), [row.robot] * len(starts), channels.tolist(), strict=True)
    assert sorted(mine) == sorted(book.ids), case


HEARD = ("header", "payload")
"""Parts of an answer that fail only if the inquirer is receiving it."""


@pytest.mark.slow
def test_transmissions_receptions_and_trains_equal_the_oracle() -> None:
    seen: Counter[str] = Counter()
    campaigns = (test_oracle_band, test_oracle_inquiry, test_oracle_page)
    for campaign, number in product(campaigns, range(150)):
        seen += compare(campaign.default_case(number))
    outcomes = ("received", "not_tuned", "collided", "bit_errors", "out_of_range")
    wanted = ("ratio", "no ratio", "no power", "again", "IDs", "idle: True", *(f"{each}, power" for each in outcomes))
    assert all(seen[what] >= 20 for what in wanted), seen


@pytest.mark.soak
@pytest.mark.parametrize("part", range(2))
def test_transmissions_receptions_and_trains_equal_the_oracle_over_a_thousand_cases(
    part: int, record_property: Callable[[str, object], None]
) -> None:
    count = soak_count(500)
    for campaign in (test_oracle_band, test_oracle_inquiry, test_oracle_page):
        for case in campaign.seeded_cases(count, 10_000_000 * (part + 1)):
            compare(case)
    record_property("equal cases of transmissions", 3 * count)
