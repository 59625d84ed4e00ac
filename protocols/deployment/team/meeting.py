"""When a team that was parted, or left one behind, is to begin its play again together."""

from cosim.units import Time


class Meeting:
    """The appointment of one host: some time after it was found necessary, so that all who can be heard are."""

    def __init__(self, delay: Time) -> None:
        self._delay = delay
        self._at: Time | None = None
        self._in_vain = 0
        """The number of the plan that has turned out to be for nothing that could be done again."""

    @property
    def called(self) -> bool:
        """Whether there is to be one; until then nobody is ordered anything, and nobody taken for lost."""
        return self._at is not None

    def call(self, number: int, now: Time) -> None:
        """Have one for the plan of that number, unless there is one already, or was one in vain."""
        if self._at is None and number != self._in_vain:
            self._at = now + self._delay

    def due(self, now: Time) -> bool:
        """Return whether it is time for it."""
        return self._at is not None and now >= self._at

    def off(self) -> None:
        """Have none: it was held, or another leads, or another play is played."""
        self._at = None

    def held_in_vain(self, number: int) -> None:
        """Have none again for the plan of that number."""
        self._at, self._in_vain = None, number
