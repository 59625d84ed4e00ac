"""The event-driven DCF against the model that looks at every station every microsecond: frame for frame.

So are the rows of its tables, and what follows from them of carrier sense.
"""

from collections import Counter
from collections.abc import Callable

import pytest

from cosim.channels.adhoc.log import OUTCOMES, STATES
from tests.channels.adhoc.dcf_cases import drawn, fast, slow
from tests.oracles.dcf import BUSY, NAV
from tests.tiers import soak_count


@pytest.mark.slow
def test_the_dcf_equals_the_oracle_and_everything_occurs() -> None:
    seen: Counter[str] = Counter()
    for seed in range(150):
        case = drawn(seed)
        told = slow(case)
        assert fast(case) == told, seed
        seen.update(kind for *_, kind in told.frames)
        seen.update("acknowledged" if done else "dropped" for _, done in told.done.values())
        seen["received"] += len(told.received)
        seen.update(state for *_, state, _ in told.doings)
        seen.update(outcome for *_, outcome in told.receptions)
        seen.update(what for *_, what in told.silences)
        begins = Counter(begin for begin, *_ in told.frames)
        seen["in one slot"] += sum(count > 1 for count in begins.values())
        seen["bianchi"] += case.options.bianchi_counting
    wanted = {"DATA", "ACK", "RTS", "CTS", "acknowledged", "dropped", "received", "in one slot", "bianchi"}
    wanted |= {*STATES, *OUTCOMES, BUSY, NAV}
    assert all(seen[what] >= 20 for what in wanted), seen


@pytest.mark.soak
@pytest.mark.parametrize("part", range(4))
def test_the_dcf_equals_the_oracle_over_ten_thousand_cases(
    part: int, record_property: Callable[[str, object], None]
) -> None:
    count = soak_count(2_500)
    for seed in range(1_000_000 * (part + 1), 1_000_000 * (part + 1) + count):
        case = drawn(seed)
        assert fast(case) == slow(case), seed
    record_property("equal DCF cases", count)
    print(f"{count} DCF cases equal")
