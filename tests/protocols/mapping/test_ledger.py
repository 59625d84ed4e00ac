"""The ledger of pieces: counts go up to the first gap, whatever comes in what order."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from protocols.mapping.frames import Piece, Stream
from protocols.mapping.ledger import Ledger

OURS, REBORN = Stream(1, 0), Stream(1, 5000)


def piece(number: int, stream: Stream = OURS) -> Piece:
    return Piece(stream, number, 0, np.empty(0, np.uint32))


@given(st.lists(st.integers(0, 12), max_size=20))
def test_counts_go_up_to_the_first_gap(numbers: list[int]) -> None:
    ledger, seen = Ledger(), set[int]()
    for number in numbers:
        assert ledger.add(piece(number)) == (number not in seen)
        seen.add(number)
        assert ledger.count(OURS) == min(set(range(14)) - seen)


def test_what_lies_beyond_a_gap_is_not_told() -> None:
    """Who asks has said how much it has without a gap; what is known beyond a gap counts once that is filled."""
    ledger = Ledger()
    for number in (0, 1, 3):
        ledger.add(piece(number))
    assert [each.number for each in ledger.beyond(OURS, 0)] == [0, 1]
    ledger.add(piece(2))
    assert [each.number for each in ledger.beyond(OURS, 1)] == [1, 2, 3]


def test_nothing_is_beyond_what_is_not_known() -> None:
    ledger = Ledger()
    ledger.add(piece(0))
    assert ledger.beyond(OURS, 1) == ledger.beyond(OURS, 60_000) == ledger.beyond(REBORN, 0) == []
    assert ledger.count(REBORN) == 0


def test_lives_of_one_author_are_told_apart() -> None:
    ledger = Ledger()
    assert ledger.add(piece(0))
    assert ledger.add(piece(0, REBORN))
    assert ledger.counts == {OURS: 1, REBORN: 1}
    assert ledger.beyond(REBORN, 0)[0].stream == REBORN
