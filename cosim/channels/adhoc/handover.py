"""What hosts take to hand payloads to their radios: at random, at most so long, and none overtakes another."""

from collections.abc import Callable
from functools import partial
from typing import Final

from cosim.kernel import Kernel
from cosim.machine import Address
from cosim.randomness import Draws
from cosim.units import Time

JITTER: Final = 3
"""The purpose of the draws."""


class Handover:
    """The ways from all hosts of a run to their radios."""

    def __init__(self, jitter: Time, size: int, kernel: Kernel, draws: Draws) -> None:
        self._jitter = jitter
        self._kernel = kernel
        self._draws = draws
        self._handed = [0] * size
        self._last: list[Time] = [0] * size
        """When the last payload of each was handed over, or will be."""
        self._lives = [0] * size
        """How often what was under way has been forgotten."""

    def hand(self, source: Address, take: Callable[[], None]) -> None:
        """Have a payload of *source* taken: at once if hosts take no time."""
        if self._jitter == 0:
            take()
            return
        late = self._draws.below(self._jitter + 1, self._handed[source], source, JITTER)
        self._handed[source] += 1
        self._last[source] = max(self._last[source], self._kernel.now + late)
        self._kernel.at(self._last[source], partial(self._arrive, source, self._lives[source], take))

    def forget(self, source: Address) -> None:
        """Lose what is under way from *source*."""
        self._lives[source] += 1

    def _arrive(self, source: Address, life: int, take: Callable[[], None]) -> None:
        if life == self._lives[source]:
            take()
