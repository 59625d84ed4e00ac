"""Whom the master polls, how often, and how long it waits (paper 003, sections IV.A and V)."""

from cosim.machine import Address, Disconnect, Fate, LinkCommand, Outcome, Outgoing
from cosim.units import Time


class Polls:
    """The polls of one exchange; what is sent goes to *out*, which the broadcast room shares."""

    def __init__(self, timeout: Time, most_retries: int, out: list[Outgoing | LinkCommand]) -> None:
        self.pending: list[Address] = []
        """Slaves whose messages are wanted; the first is being polled."""
        self.deadline: Time | None = None
        self.retries = 0
        """How often the present slave was polled again since anything came from it."""
        self.token = 0
        """Of the last poll."""
        self._timeout = timeout
        self._most_retries = most_retries
        self._out = out
        self._answered = False

    def begin(self, poll: bytes, now: Time) -> None:
        """Poll the first of the pending slaves."""
        self.retries = 0
        self._poll(poll, now)

    def again(self, poll: bytes, now: Time) -> bool:
        """Poll the same slave once more, or return False if that was done too often."""
        if self.retries >= self._most_retries:
            return False
        self.retries += 1
        self._poll(poll, now)
        return True

    def fate(self, fate: Fate) -> bool | None:
        """Return whether the present poll was acknowledged; None if *fate* is that of something else."""
        if not self.pending or fate.token != self.token or self._answered:
            return None
        self._answered = fate.outcome == Outcome.DELIVERED
        return self._answered

    def dismiss(self, slave: Address) -> None:
        """Close the link to *slave*."""
        self._out.append(Disconnect(slave))

    def stop(self) -> None:
        """Poll nobody any more."""
        self.pending = []
        self.deadline = None

    def _poll(self, poll: bytes, now: Time) -> None:
        self.token += 1
        self._answered = False
        self.deadline = now + self._timeout
        self._out.append(Outgoing(self.pending[0], poll, self.token))
