"""The advertising sets of a device: each is a payload for everyone, and several are under way at once."""

from collections import deque
from collections.abc import Callable
from typing import Final, TypeAlias

from cosim.channels.ble.broadcasts.events import Events, Speaker
from cosim.channels.ble.ether import Judgement
from cosim.channels.ble.settings import BroadcastSettings
from cosim.machine import Address, Outcome, Outgoing, Reception

MOST_SETS: Final = 16
"""Advertising sets that a device has at once; further payloads for everyone wait."""


class PayloadSet(Events):
    """A payload that *speaker* sends to those that hear it; *finished* is called when all events are over."""

    def __init__(
        self,
        speaker: Speaker,
        outgoing: Outgoing,
        number: int,
        settings: BroadcastSettings,
        finished: "Callable[[PayloadSet], None]",
    ) -> None:
        """*number* counts the speaker's sets."""
        super().__init__(speaker, number, settings.events, settings.interval)
        self.outgoing = outgoing
        self._settings = settings
        self._finished = finished
        self._got: set[Address] = set()

    def begun(self) -> None:
        """Note when the payload is on the air first."""
        if not self.again:
            self._hosts.payloads.begin(self.outgoing, self._start)

    def over(self) -> None:
        """Report that the payload is sent."""
        self._hosts.over(self.speaker.station.address, self.outgoing, Outcome.SENT)
        self._finished(self)

    def arrive(self, receiver: Address, judgement: Judgement) -> None:
        """Have the host of *receiver* have the payload, unless it does."""
        if receiver not in self._got:
            self._got.add(receiver)
            reception = Reception(self.speaker.station.address, True, judgement.power_dbm)
            self._hosts.arrive((receiver, self.outgoing.payload, reception))


MakeSet: TypeAlias = Callable[[Speaker, Outgoing, int, BroadcastSettings, Callable[[PayloadSet], None]], PayloadSet]
"""(speaker, payload, its number, settings, what to call when it is over) -> the set."""


class Sets:
    """The sets of *speaker*, which *make* makes."""

    def __init__(self, speaker: Speaker, make: MakeSet, settings: BroadcastSettings) -> None:
        self._speaker = speaker
        self._make = make
        self._settings = settings
        self._sets: list[PayloadSet] = []
        self._waiting: deque[Outgoing] = deque()
        self._sent = 0

    @property
    def held(self) -> int:
        """The number of payloads that are not over."""
        return len(self._sets) + len(self._waiting)

    def send(self, outgoing: Outgoing) -> None:
        """Send a payload to everyone who listens, as soon as a set is free."""
        self._waiting.append(outgoing)
        self._next()

    def flush(self) -> list[Outgoing]:
        """Take out, and return, the payloads that no set has."""
        flushed, self._waiting = list(self._waiting), deque()
        return flushed

    def cancel(self) -> None:
        """Forget all of them: the device is off."""
        for each in self._sets:
            each.cancel()
        self._sets.clear()
        self._waiting.clear()

    def _next(self) -> None:
        while self._waiting and len(self._sets) < MOST_SETS:
            outgoing, number = self._waiting.popleft(), self._sent
            self._sent += 1
            self._sets.append(self._make(self._speaker, outgoing, number, self._settings, self._over))

    def _over(self, advertising: PayloadSet) -> None:
        self._sets.remove(advertising)
        self._next()
