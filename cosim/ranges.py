"""Whole numbers as text, those that follow each other as ranges: 0-3,7,5. So cells and RF channels stand in tables."""

from collections.abc import Sequence

import numpy as np

from cosim.arrays import Int64s


def ranges_of(numbers: Sequence[int] | Int64s) -> str:
    """Return *numbers*, none of them below 0, in their order; nothing for none."""
    whole = np.asarray(numbers, dtype=np.int64)
    if not len(whole):
        return ""
    ends = np.flatnonzero(np.diff(whole) != 1)
    firsts, lasts = whole[np.concatenate([[0], ends + 1])], whole[np.concatenate([ends, [len(whole) - 1]])]
    both = zip(firsts.tolist(), lasts.tolist(), strict=True)
    return ",".join(f"{first}-{last}" if last > first else str(first) for first, last in both)


def pairs_of(ranges: str) -> list[list[int]]:
    """Return the first and the last number of each of *ranges*."""
    parts = (part.partition("-") for part in ranges.split(",") if part)
    return [[int(first), int(last or first)] for first, _, last in parts]


def numbers_of(ranges: str) -> Int64s:
    """Return the numbers that ``ranges_of`` has made *ranges* of."""
    numbers = [np.arange(first, last + 1) for first, last in pairs_of(ranges)]
    return np.concatenate(numbers) if numbers else np.empty(0, dtype=np.int64)
