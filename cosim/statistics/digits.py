"""Numbers for people: a few significant digits, and no exponent where nobody writes one."""

from typing import Final

LONG: Final = 1e9
"""From here on a number has an exponent."""


def digits(value: float, count: int) -> str:
    """Return *value* rounded to *count* significant digits, as 463700 and not as 4.637e+05."""
    text = f"{value:.{count}g}"
    return f"{float(text):.0f}" if "e+" in text and abs(value) < LONG else text
