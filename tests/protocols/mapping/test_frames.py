"""Frames of explorers and the runs in them: golden bytes, there and back, and what is none."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.errors import LocalProtocolError, WireError
from protocols.mapping.frames import (
    ENTRY_BYTES,
    FAR_M,
    LEAST_OCTETS,
    LONGEST,
    MOST_CELLS,
    MOST_PIECES,
    PIECE_OVERHEAD,
    SUMMARY_OVERHEAD,
    Entry,
    Message,
    Piece,
    Stream,
    Summary,
    decode,
    encode,
    fits,
    from_runs,
    to_runs,
)


def crc_by_bits(data: bytes) -> int:
    """CRC-CCITT, polynomial 0x1021, initial value 0xFFFF, bit by bit."""
    value = 0xFFFF
    for byte in data:
        for bit in range(7, -1, -1):
            top = value >> 15 ^ byte >> bit & 1
            value = value << 1 & 0xFFFF ^ (0x1021 if top else 0)
    return value


def sealed(body: str) -> bytes:
    data = bytes.fromhex(body)
    return data + crc_by_bits(data).to_bytes(2, "big")


def piece(author: int, life: int, number: int, stamp: int, *runs: int) -> Piece:
    return Piece(Stream(author, life), number, stamp, np.array(runs, np.uint32))


def plain(message: Message) -> tuple[Any, ...]:
    """Return *message* as something that can be compared."""
    return tuple(field.tolist() if isinstance(field, np.ndarray) else field for field in message)


GOLDEN: list[tuple[Message, str]] = [
    (piece(3, 70_000, 258, 65_536, 0x00001402, 0xFFFFFE00), "45 01 06 03 00011170 0102 00010000 00001402 fffffe00"),
    (
        Summary(1.0, -2.0, (Entry(Stream(0, 0), 258, 6), Entry(Stream(3, 70_000), 65_535, 255))),
        "45 02 06 3f800000 c0000000 00 00000000 0102 06 03 00011170 ffff ff",
    ),
]


@pytest.mark.parametrize(("message", "golden"), GOLDEN, ids=["piece", "summary"])
def test_every_kind_has_its_golden_bytes(message: Message, golden: str) -> None:
    data = sealed(golden)
    assert encode(6, message) == data
    sender, found = decode(data)
    assert sender == 6
    assert type(found) is type(message)
    assert plain(found) == plain(message)


def test_the_lengths_that_frames_are_cut_by_are_right() -> None:
    assert len(encode(0, piece(0, 0, 0, 0))) == PIECE_OVERHEAD
    assert len(encode(0, Summary(0.0, 0.0, ()))) == SUMMARY_OVERHEAD
    one = encode(0, Summary(0.0, 0.0, (Entry(Stream(0, 0), 0, 0),)))
    assert len(one) == SUMMARY_OVERHEAD + ENTRY_BYTES
    assert max(len(one), len(encode(0, piece(0, 0, 0, 0, 1)))) == LEAST_OCTETS


singles = st.floats(-FAR_M, FAR_M, width=32)
octets = st.integers(0, 255)
words = st.integers(0, 2**32 - 1)
streams = st.builds(Stream, octets, words)
entries = st.lists(st.builds(Entry, streams, st.integers(0, 65_535), octets), max_size=5).map(tuple)
runs = st.lists(words, max_size=6).map(lambda found: np.array(found, np.uint32))
pieces = st.builds(Piece, streams, st.integers(0, MOST_PIECES - 1), words, runs)


@given(octets, pieces | st.builds(Summary, singles, singles, entries))
def test_messages_come_back(sender: int, message: Message) -> None:
    came_from, found = decode(encode(sender, message))
    assert came_from == sender
    assert type(found) is type(message)
    assert plain(found) == plain(message)


@given(st.binary(max_size=60), octets)
def test_what_is_no_frame_is_refused_and_what_is_one_is_written_in_one_way(junk: bytes, kind: int) -> None:
    for body in (junk, bytes([0x45, kind % 4]) + junk):
        data = body + crc_by_bits(body).to_bytes(2, "big")
        try:
            sender, message = decode(data)
        except WireError:
            continue
        assert encode(sender, message) == data


PIECE, SUMMARY = (golden for _, golden in GOLDEN)


@pytest.mark.parametrize(
    "body",
    [
        "",
        "45 01",
        "44" + PIECE[2:],
        PIECE.replace("45 01", "45 00"),
        PIECE.replace("45 01", "45 03"),
        PIECE[:-2],
        "45 01 06 03 00011170 0102 000100",
        PIECE.replace("0102", "ffff"),
        SUMMARY[:-2],
        SUMMARY + "00",
        "45 02 06 3f800000",
        SUMMARY.replace("3f800000", "7fc00000"),
        SUMMARY.replace("c0000000", "7f800000"),
        SUMMARY.replace("c0000000", "c9742401"),
    ],
)
def test_these_are_no_frames(body: str) -> None:
    with pytest.raises(WireError):
        decode(sealed(body))


def test_a_damaged_frame_is_refused() -> None:
    data = sealed(PIECE)
    for at in range(8 * len(data)):
        damaged = bytearray(data)
        damaged[at // 8] ^= 1 << at % 8
        with pytest.raises(WireError):
            decode(bytes(damaged))


@pytest.mark.parametrize(
    "message",
    [
        piece(256, 0, 0, 0),
        piece(0, 2**32, 0, 0),
        piece(0, 0, MOST_PIECES, 0),
        piece(0, 0, 0, -1),
        Summary(math.nan, 0.0, ()),
        Summary(0.0, 1.1 * FAR_M, ()),
        Summary(0.0, 1e300, ()),
        Summary(0.0, 0.0, (Entry(Stream(0, 0), 65_536, 0),)),
        Summary(0.0, 0.0, (Entry(Stream(0, 0), 0, 256),)),
    ],
)
def test_what_no_frame_can_say_is_refused(message: Message) -> None:
    with pytest.raises(LocalProtocolError):
        encode(0, message)


# ---------------------------------------------------------------- runs

maps = st.dictionaries(st.integers(0, 40) | st.integers(MOST_CELLS - 3, MOST_CELLS - 1), st.booleans(), max_size=30)
EMPTY, OCCUPIED = 0, 1 << 9


def there_and_back(cells: dict[int, bool]) -> dict[int, bool]:
    found, occupied = from_runs(to_runs(np.array(list(cells), np.int32), list(cells.values())))
    assert len(found) == len(cells)
    return dict(zip(found.tolist(), occupied.tolist(), strict=True))


@given(maps)
def test_cells_in_any_order_come_back(cells: dict[int, bool]) -> None:
    assert there_and_back(cells) == cells


@given(maps)
def test_there_are_no_more_runs_than_changes(cells: dict[int, bool]) -> None:
    """Counted one by one: a run begins where the cell before it is not told, or in the other state."""
    words = to_runs(np.array(list(cells), np.int32), list(cells.values()))
    assert len(words) == sum(cells.get(cell - 1) is not state for cell, state in cells.items())


def test_runs_are_words_of_first_cell_state_and_length() -> None:
    words = to_runs([7, 5, 6, 8, 100, MOST_CELLS - 1], [False, False, False, True, True, False])
    assert words.dtype == np.uint32
    assert words.tolist() == [5 << 10 | 2, 8 << 10 | OCCUPIED, 100 << 10 | OCCUPIED, (MOST_CELLS - 1) << 10]


@pytest.mark.parametrize(
    ("length", "lengths"), [(LONGEST, [512]), (LONGEST + 1, [512, 1]), (3 * LONGEST - 1, [512, 512, 511])]
)
def test_long_runs_are_cut(length: int, lengths: list[int]) -> None:
    cells = {9 + k: True for k in range(length)}
    words = to_runs(np.array(list(cells), np.int32), list(cells.values()))
    firsts = [9 + 512 * k for k in range(len(lengths))]
    assert words.tolist() == [first << 10 | OCCUPIED | size - 1 for first, size in zip(firsts, lengths, strict=True)]
    assert there_and_back(cells) == cells


def test_runs_fit_if_their_last_cell_does() -> None:
    words = to_runs([3, 4, 5, 9], [True] * 4)
    assert fits(words, 10)
    assert not fits(words, 9)
    assert not fits(np.array([9 << 10 | EMPTY | 1], np.uint32), 10)
    assert fits(np.empty(0, np.uint32), 0)


@given(st.lists(st.integers(0, 2**32 - 1), max_size=8), st.integers(1, MOST_CELLS))
def test_any_words_are_runs_and_those_that_fit_name_cells_of_the_map(words: list[int], cells: int) -> None:
    runs = np.array(words, np.uint32)
    found, occupied = from_runs(runs)
    assert len(found) == len(occupied) == sum(word % 512 + 1 for word in words)
    assert fits(runs, cells) == bool(np.all(found < cells))
