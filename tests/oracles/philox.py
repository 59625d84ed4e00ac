"""Philox 4x32 in plain integers, after Salmon et al. (SC'11), section 3: what the kernel is compared with."""

from functools import lru_cache

from cosim.randomness import Words

MULTIPLIERS = (0xD2511F53, 0xCD9E8D57)
WEYL = (0x9E3779B9, 0xBB67AE85)
MASK = 0xFFFFFFFF


@lru_cache
def philox(counter: Words, key: tuple[int, int], rounds: int = 10) -> Words:
    """Return the four 32-bit words for *counter* (four 32-bit words) under *key* (two)."""
    c0, c1, c2, c3 = counter
    k0, k1 = key
    for _ in range(rounds):
        p0 = MULTIPLIERS[0] * c0
        p1 = MULTIPLIERS[1] * c2
        c0, c1, c2, c3 = (p1 >> 32) ^ c1 ^ k0, p1 & MASK, (p0 >> 32) ^ c3 ^ k1, p0 & MASK
        k0 = (k0 + WEYL[0]) & MASK
        k1 = (k1 + WEYL[1]) & MASK
    return c0, c1, c2, c3
