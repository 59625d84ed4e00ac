"""What one Pseudonet machine counts: the times of set-up, of exchanges, and of standing still for the radio's sake."""

from cosim.units import Time


class Counters:
    """Counts and sums; only the master knows when an exchange begins and fills exchange_time and radio_wait."""

    def __init__(self, start: Time) -> None:
        self.start = start
        self.setup: Time | None = None
        self.exchanges = 0
        self.led = 0
        """Number of exchanges that this robot has begun."""
        self.exchange_time: Time = 0
        self.radio_wait: Time = 0
        self.breaks = 0
        self.resumed = 0
        self.reform_time: Time = 0
        self._broken_at: Time | None = None
        self._began: Time | None = None
        self._step_began: Time | None = None

    def team(self, now: Time) -> None:
        """Count that a team was called up; the first time ends the set-up."""
        if self.setup is None:
            self.setup = now - self.start
        self._step_began = None

    def broken(self, now: Time) -> None:
        """Count the loss of the team; the time until the next team makes a step is lost as well."""
        self.breaks += 1
        self._began = None
        self._step_began = None
        if self._broken_at is None:
            self._broken_at = now

    def began(self, now: Time) -> None:
        """Count that the master begins an exchange; the first one of a step begins the wait."""
        self._began = now
        if self._step_began is None:
            self._step_began = now

    def exchanged(self, now: Time) -> None:
        """Count a complete exchange."""
        self.exchanges += 1
        if self._began is not None:
            self.led += 1
            self.exchange_time += now - self._began
            self._began = None

    def busy(self) -> None:
        """Restart the wait for the radio with the next exchange, as a robot was still driving in this one."""
        self._step_began = None

    def agreed(self, now: Time) -> None:
        """Count that the team has agreed and drives on."""
        if self._broken_at is not None:
            self.resumed += 1
            self.reform_time += now - self._broken_at
            self._broken_at = None
        if self._step_began is not None:
            self.radio_wait += now - self._step_began
            self._step_began = None
