"""The Bluetooth channel equals the slot-by-slot oracle of the whole band; planted faults are found.

Frames of all piconets, inquiries and pages with their outcomes and the sections that failed, deliveries, fates, lost
links and news, under interference, bit errors, jammers and powers that change.
"""

from collections import Counter
from collections.abc import Callable, Iterator
from functools import cache

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.channels.bluetooth.band_channel import Outcome, outcome_of, run_channel
from tests.oracles.band_cases import Case, draw_case
from tests.oracles.band_corners import corners
from tests.oracles.band_scene import KINDS
from tests.oracles.campaign import Drawn, Seeded
from tests.tiers import soak_count

DEFAULT = 314
FIRST_SEED = 20
"""Of the default cases that are not corners."""


def seeded_cases(count: int, first: int = 0) -> Iterator[Case]:
    return (draw_case(Seeded(9, number)) for number in range(first, first + count))


@cache
def default_case(number: int) -> Case:
    first = len(corners())
    return corners()[number] if number < first else next(seeded_cases(1, FIRST_SEED + number - first))


@cache
def _default_outcome(number: int) -> Outcome:
    return outcome_of(default_case(number))


def default_cases() -> Iterator[tuple[Case, Outcome]]:
    """Yield the cases of the default run and what the oracle says of them."""
    return ((default_case(number), _default_outcome(number)) for number in range(DEFAULT))


@settings(max_examples=30, derandomize=True, database=None)
@given(st.data())
@pytest.mark.slow
def test_the_band_equals_the_oracle_over_cases_that_shrink(data: st.DataObject) -> None:
    case = draw_case(Drawn(data))
    assert run_channel(case) == outcome_of(case)


@pytest.mark.slow
def test_the_band_equals_the_oracle_and_every_outcome_occurs() -> None:
    seen: Counter[object] = Counter()
    for case, slow in default_cases():
        assert run_channel(case) == slow, case
        seen.update((row.kind, row.outcome) for row in slow.frames)
        seen.update((row.outcome, row.part) for row in slow.frames)
        seen.update(row[3] for row in slow.fates)
        seen.update(row[2] for row in slow.news)
        seen["lost"] += len(slow.losses)
        seen["broadcast"] += sum(row[4] for row in slow.deliveries)
    kinds = ("POLL", "NULL", *KINDS)
    outcomes = ("received", "out_of_range", "not_tuned", "collided", "bit_errors")
    failures = [(how, part) for how in ("collided", "bit_errors") for part in ("access_code", "header", "payload")]
    fates = ("delivered", "sent", "flushed", "no_link", "too_long")
    news = ("master", "slave", "page failed", "discovered", "complete", "lost", "broadcast")
    failures.append(("refused", None))
    frequent = [*((kind, outcome) for kind in kinds for outcome in outcomes), *failures, *fates, *news]
    assert all(seen[what] >= 3 for what in frequent), [what for what in frequent if seen[what] < 3]
    rare = [
        ("FHS", "received"),
        ("FHS", "busy"),
        ("FHS", "collided"),
        ("FHS", "bit_errors"),
        ("ID", "received"),
        ("ID", "out_of_range"),
    ]
    assert all(seen[what] for what in rare), [what for what in rare if not seen[what]]


@pytest.mark.slow
def test_slow_hosts_stop_the_other_side_and_slaves_refuse() -> None:
    notes: Counter[str] = Counter()
    slow = [case for case in map(default_case, range(DEFAULT)) if case.scene.host_bps is not None]
    for case in slow:
        notes.update({note.what for note in case.book().flow})
    assert len(slow) > 60
    often = ("slave stops", "polled though stopped", "slave's payload waits", "stop unheard", "go by lost answer")
    assert all(notes[what] >= 10 for what in (*often, "refused")), notes
    assert all(notes[what] >= 3 for what in ("master stops", "go without answer")), notes


@pytest.mark.soak
@pytest.mark.parametrize("part", range(4))
def test_the_band_equals_the_oracle_over_ten_thousand_cases(
    part: int, record_property: Callable[[str, object], None]
) -> None:
    count = soak_count(2_500)
    for case in seeded_cases(count, 1_000_000 * (part + 1)):
        assert run_channel(case) == outcome_of(case), case
    record_property("equal band cases", count)
    print(f"{count} band cases equal")
