"""What searchers send beside their messages: how many bytes, to whom, and from when to when."""

import pytest

from protocols.aggregation.frames import encode, stamp
from protocols.aggregation.messages import Heartbeat, Piece, Stop
from tests.protocols.aggregation.team_scene import Alone, Said

STARTS_M = [(9.5, 9.0), (10.5, 9.0), (9.5, 10.4), (10.0, 10.4)]
"""Two hosts, two searchers; the first is of the first host."""
BYTES_PER_S = 5000.0


def streamed(said: list[Said]) -> int:
    """Return the bytes of the frames of pieces, each of which must be the own host's."""
    pieces = [each for each in said if isinstance(each.message, Piece)]
    assert {(each.destination, each.radio) for each in pieces} <= {(0, 0)}
    return sum(len(encode(2, each.message)) for each in pieces)


def beat(number: int, at: int) -> Heartbeat:
    return Heartbeat(number, stamp(at), 9.5, 9.0, 0, 1, 0, 0, False, False, False, ())


def hears_for(searcher: Alone, seconds: int, first: int) -> list[Said]:
    """Return what it says while its host is heard each second."""
    said = []
    for number in range(first, first + seconds):
        said += searcher.hears(0, beat(number, searcher.now), broadcast=True)
        said += searcher.passes(1.0)
    return said


def test_a_searcher_in_contact_sends_its_bytes_evenly_and_whole_frames_fit_a_packet() -> None:
    searcher = Alone(2, STARTS_M, stream_bytes_per_s=BYTES_PER_S)
    said = hears_for(searcher, 20, first=1)
    assert streamed(said) == pytest.approx(20 * BYTES_PER_S, abs=1400)
    assert {len(encode(2, each.message)) for each in said if isinstance(each.message, Piece)} == {1400}
    third = streamed(hears_for(searcher, 1, first=21))
    assert third == pytest.approx(BYTES_PER_S, abs=1400)


def test_out_of_contact_nothing_is_sent_and_nothing_is_saved_up_for_later() -> None:
    searcher = Alone(2, STARTS_M, stream_bytes_per_s=BYTES_PER_S, fresh_s=2.5)
    hears_for(searcher, 3, first=1)
    assert streamed(searcher.passes(2.0)) > 0
    assert streamed(searcher.passes(30.0)) == 0
    assert streamed(hears_for(searcher, 1, first=4)) <= BYTES_PER_S + 1400


def test_who_was_told_to_stop_streams_no_more() -> None:
    searcher = Alone(2, STARTS_M, stream_bytes_per_s=BYTES_PER_S)
    hears_for(searcher, 1, first=1)
    searcher.hears(0, Stop())
    assert streamed(hears_for(searcher, 3, first=2)) == 0


def test_by_default_nothing_is_streamed() -> None:
    assert streamed(hears_for(Alone(2, STARTS_M), 5, first=1)) == 0
