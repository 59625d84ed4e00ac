"""The random numbers of a particle filter: pure functions of a key, a step, a particle and a purpose.

All come from Philox (:mod:`cosim.randomness`), so they do not depend on what was drawn before, nor on how many.
"""

import math
from typing import Final, TypeAlias

from cosim.arrays import Floats
from cosim.jit import njit
from cosim.randomness import philox_words

Quad: TypeAlias = tuple[float, float, float, float]

SCATTER, MOVE, PICK, CHANCE, PLACE = range(1, 6)
"""Purposes of draws: a start, a motion, resampling, whether a pose is injected, and where."""

_TURN: Final = 2.0 * math.pi
_WORD: Final = 2.0**-32


@njit(cache=True)
def four_normals(step: int, particle: int, purpose: int, key_0: int, key_1: int) -> Quad:
    """Return four independent standard normal numbers (Box and Muller, of 32-bit words: none beyond 6.8)."""
    a, b, c, d = philox_words(step, step >> 32, particle, purpose, key_0, key_1)
    first = math.sqrt(-2.0 * math.log((a + 0.5) * _WORD))
    second = math.sqrt(-2.0 * math.log((c + 0.5) * _WORD))
    along, across = _TURN * _WORD * b, _TURN * _WORD * d
    return first * math.cos(along), first * math.sin(along), second * math.cos(across), second * math.sin(across)


@njit(cache=True)
def fill_uniform(numbers: Floats, step: int, purpose: int, key_0: int, key_1: int) -> None:
    """Set *numbers* (n,) to uniform ones in [0, 1) with 53 random bits each."""
    for i in range(numbers.shape[0]):
        a, b, _, _ = philox_words(step, step >> 32, i, purpose, key_0, key_1)
        numbers[i] = ((a << 21) | (b >> 11)) * 2.0**-53
