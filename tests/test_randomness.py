"""Named streams and counter-based draws: known answers, independence, uniformity."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.randomness import Draws, Streams, Words, philox_words
from tests.oracles.philox import philox

PI_COUNTER, PI_KEY = (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344), (0xA4093822, 0x299F31D0)
ONES = 0xFFFFFFFF

# Random123 1.14, tests/kat_vectors, philox4x32 10
KNOWN_ANSWERS = [
    ((0, 0, 0, 0), (0, 0), (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
    ((ONES, ONES, ONES, ONES), (ONES, ONES), (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
    (PI_COUNTER, PI_KEY, (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1)),
]


@pytest.mark.parametrize(("counter", "key", "answer"), KNOWN_ANSWERS)
def test_the_oracle_gives_the_known_answers_of_random123(counter: Words, key: tuple[int, int], answer: Words):
    assert philox(counter, key) == answer


@pytest.mark.parametrize(("counter", "key", "answer"), KNOWN_ANSWERS)
def test_the_kernel_gives_the_known_answers_too(counter: Words, key: tuple[int, int], answer: Words):
    assert philox_words(*counter, *key) == answer


WORD = st.integers(0, ONES)


@given(st.tuples(WORD, WORD, WORD, WORD), st.tuples(WORD, WORD))
def test_the_kernel_gives_what_the_oracle_gives(counter: Words, key: tuple[int, int]):
    assert philox_words(*counter, *key) == philox(counter, key)


def test_of_the_kernel_s_arguments_the_low_32_bits_count():
    assert philox_words(-1, 2**40 + 7, 3, -(2**63), 2**33 + 5, -2) == philox((ONES, 7, 3, 0), (5, ONES - 1))


# ---------------------------------------------------------------- counter-based draws


def test_a_draw_does_not_depend_on_what_was_drawn_before():
    fresh = Draws(1, "loss").words(1000, 3, 2)
    used = Draws(1, "loss")
    for number in range(10):
        used.words(number)
    assert used.words(1000, 3, 2) == fresh


@pytest.mark.parametrize("where", [(8, 3, 2), (7 + 2**32, 3, 2), (7, 4, 2), (7, 3, 1)])
def test_number_link_and_purpose_all_count(where: tuple[int, int, int]):
    draws = Draws(1, "loss")
    assert draws.words(*where) != draws.words(7, 3, 2)


def test_draws_of_other_names_and_seeds_are_others():
    one = Draws(1, "loss").words(0)
    assert Draws(1, "loss").words(0) == one
    assert Draws(2, "loss").words(0) != one
    assert Draws(1, "backoff").words(0) != one
    assert Draws(1, "loss", 0).words(0) != one


def test_a_kernel_with_the_key_of_the_draws_draws_the_same():
    draws = Draws(1, "loss")
    assert philox_words(7, 5, 3, 2, *draws.key) == draws.words(7 + 5 * 2**32, 3, 2)


@given(st.integers(1, 2**40), st.integers(0, 2**63))
def test_a_bounded_draw_keeps_its_bound(bound: int, number: int):
    assert 0 <= Draws(3, "bound").below(bound, number) < bound


def test_a_bounded_draw_uses_64_bits():
    draws = Draws(3, "wide")
    high, low, *_ = draws.words(9)
    assert draws.below(2**64, 9) == high << 32 | low


def chi_square(counts: np.ndarray) -> float:
    expected = counts.sum() / len(counts)
    return float(((counts - expected) ** 2 / expected).sum())


def test_draws_are_uniform():
    draws = Draws(4, "uniform")
    whole = np.bincount([draws.below(10, number) for number in range(5000)], minlength=10)
    parts = np.bincount([int(10 * draws.uniform(number, 1)) for number in range(5000)], minlength=10)
    # 9 degrees of freedom: 27.9 is exceeded once in a thousand
    assert chi_square(whole) < 27.9
    assert chi_square(parts) < 27.9


def test_a_uniform_draw_has_53_bits_and_stays_below_one(monkeypatch: pytest.MonkeyPatch):
    draws = Draws(4, "edge")
    monkeypatch.setattr(Draws, "words", lambda *_: (ONES, ONES, 0, 0))
    assert draws.uniform(0) == 1 - 2.0**-53
    assert draws.below(10, 0) == 9
    monkeypatch.setattr(Draws, "words", lambda *_: (0, 1 << 11, 0, 0))
    assert draws.uniform(0) == 2.0**-53
    assert draws.below(10, 0) == 0


# ---------------------------------------------------------------- streams


def drawn(generator: np.random.Generator) -> list[int]:
    return generator.integers(2**63, size=4).tolist()


def test_a_stream_does_not_depend_on_the_others():
    alone = drawn(Streams(5)("machine", 1))
    streams = Streams(5)
    others = [streams("loss"), streams("machine", 0), streams("machine")]
    for other in others:
        drawn(other)
    assert drawn(streams("machine", 1)) == alone


def test_asking_twice_gives_the_same_stream_from_its_beginning():
    streams = Streams(5)
    first, second = streams("loss"), streams("loss")
    assert drawn(first) == drawn(second)
    assert drawn(first) != drawn(streams("loss"))


def test_streams_of_other_names_or_seeds_are_others():
    streams = Streams(5)
    names = [("ab", "c"), ("a", "bc"), ("abc",), ("abc", 1), ("abc", "1"), ("abc", 1, 1), ("abstr:c",)]
    assert len({tuple(drawn(streams(*parts))) for parts in names}) == len(names)
    assert drawn(Streams(6)("abc")) != drawn(streams("abc"))


def test_a_numpy_integer_names_the_same_stream_as_an_int():
    assert drawn(Streams(np.int64(5))("robot", np.int32(3))) == drawn(Streams(5)("robot", 3))


def test_streams_and_draws_of_one_run_share_its_seed():
    assert Streams(7).draws("backoff", 2).words(9) == Draws(7, "backoff", 2).words(9)
    assert Streams(7).draws("backoff", 2).words(9) != Streams(8).draws("backoff", 2).words(9)


def test_fractions_are_neither_names_nor_seeds():
    with pytest.raises(TypeError):
        Streams(1)(1.5)
    with pytest.raises(TypeError):
        Streams(1.0)("loss")
