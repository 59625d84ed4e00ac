"""Randomness by name: streams that no other consumer can move, and per-slot draws that depend on nothing before them.

Two kinds of draws. A *stream* (``Streams``) is a NumPy generator seeded by the run's seed and the stream's names;
adding a consumer moves no one else. A *counter-based* draw (``Draws``, ``philox_words``) is a pure function of a key
and a counter, Philox 4x32-10 of Salmon et al., "Parallel random numbers: as easy as 1, 2, 3" (SC'11): a model that
skips idle slots draws the same numbers as one that visits them all.
"""

import hashlib
from operator import index
from typing import TypeAlias

import numpy as np

from cosim.jit import njit

Words: TypeAlias = tuple[int, int, int, int]

_MASK = 0xFFFFFFFF
_WORD = np.uint64(_MASK)
_HALF = np.uint64(32)
_MULTIPLIERS = (np.uint64(0xD2511F53), np.uint64(0xCD9E8D57))
_WEYL = (np.uint64(0x9E3779B9), np.uint64(0xBB67AE85))


@njit(cache=True)
def philox_words(c0: int, c1: int, c2: int, c3: int, k0: int, k1: int) -> Words:
    """Return the four words of Philox 4x32-10 for the counter (c0, c1, c2, c3) under the key (k0, k1).

    Of each argument the low 32 bits count; all must fit 64. The words are signed 64-bit integers in 0..2**32 - 1.
    """
    # unsigned throughout: a product needs all 64 bits, and numba makes a float of mixed signs
    a, b, c, d = np.uint64(c0) & _WORD, np.uint64(c1) & _WORD, np.uint64(c2) & _WORD, np.uint64(c3)
    d &= _WORD
    key_0, key_1 = np.uint64(k0) & _WORD, np.uint64(k1) & _WORD
    for _ in range(10):
        p0 = _MULTIPLIERS[0] * a
        p1 = _MULTIPLIERS[1] * c
        a, b, c, d = (p1 >> _HALF) ^ b ^ key_0, p1 & _WORD, (p0 >> _HALF) ^ d ^ key_1, p0 & _WORD
        key_0 = (key_0 + _WEYL[0]) & _WORD
        key_1 = (key_1 + _WEYL[1]) & _WORD
    return int(np.int64(a)), int(np.int64(b)), int(np.int64(c)), int(np.int64(d))


def _digest(seed: int, names: tuple[str | int, ...]) -> bytes:
    # a NumPy integer is the integer that it stands for, but 1 and "1" are two names
    parts = (f"str:{name}" if isinstance(name, str) else f"int:{index(name)}" for name in names)
    text = "\x1f".join([str(index(seed)), *parts])
    return hashlib.sha256(text.encode()).digest()


class Draws:
    """Counter-based draws of one stream: ``draws.below(n, slot, link, purpose)`` is the same whenever it is asked."""

    def __init__(self, seed: int, *names: str | int) -> None:
        digest = _digest(seed, names)
        self._key = (int.from_bytes(digest[:4], "little"), int.from_bytes(digest[4:8], "little"))

    @property
    def key(self) -> tuple[int, int]:
        """The Philox key of the stream: two 32-bit words, for a kernel that draws by itself."""
        return self._key

    def words(self, number: int, link: int = 0, purpose: int = 0) -> Words:
        """Return four 32-bit words for (*number*, *link*, *purpose*); *number* may need 64 bits, the others 32."""
        words: Words = philox_words(number & _MASK, (number >> 32) & _MASK, link & _MASK, purpose & _MASK, *self._key)
        return words

    def below(self, bound: int, number: int, link: int = 0, purpose: int = 0) -> int:
        """Return an integer in [0, *bound*), uniform but for a bias below bound / 2**64."""
        words = self.words(number, link, purpose)
        return ((words[0] << 32 | words[1]) * bound) >> 64

    def uniform(self, number: int, link: int = 0, purpose: int = 0) -> float:
        """Return a float in [0, 1) with 53 random bits."""
        words = self.words(number, link, purpose)
        return ((words[0] << 32 | words[1]) >> 11) * 2.0**-53


class Streams:
    """All the randomness of one run: ``streams("loss", "r1")`` depends on the seed and the names only."""

    def __init__(self, seed: int) -> None:
        self.seed = seed

    def __call__(self, *names: str | int) -> np.random.Generator:
        """Return a fresh generator of the stream *names*; asking twice gives two generators in the same state."""
        words = np.frombuffer(_digest(self.seed, names), dtype=np.uint32)
        return np.random.Generator(np.random.PCG64(np.random.SeedSequence(words.tolist())))

    def draws(self, *names: str | int) -> Draws:
        """Return the counter-based draws of the stream *names*."""
        return Draws(self.seed, *names)
