"""Transports in one air: frames are lost, doubled, late and out of order, as a seeded stream has it."""

from collections.abc import Callable
from heapq import heappop, heappush
from itertools import count
from typing import Any

import numpy as np

from cosim.machine import BROADCAST, Address, Fate, LinkCommand, Outcome, Outgoing, Reception
from cosim.units import MS, S, Time
from protocols.transport.parameters import TransportParameters
from protocols.transport.transport import Message, Published, Transport


class Air:
    """Transports of a team, each driven by its own deadlines and a tick each 100 ms."""

    def __init__(
        self,
        size: int,
        loss: float = 0.0,
        doubled: float = 0.0,
        delay: Time = 10 * MS,
        jitter: Time = 0,
        seed: int = 1,
        start: Time = 0,
        **parameters: Any,
    ) -> None:
        """Frames take *delay* and up to *jitter* more; each is *doubled*, and each copy lost, with a probability."""
        self.now = start
        self.loss = loss
        self.fates = True
        """Whether radios tell what has become of frames."""
        self.reach: Callable[[Address, Address], bool] = lambda teller, hearer: True
        self.parameters = TransportParameters.model_validate(parameters)
        self.transports = [Transport(me, size, self.parameters, start) for me in range(size)]
        self.alive = [True] * size
        self.frames: list[tuple[Address, bytes]] = []
        self.sent_at: list[Time] = []
        """When each of them was sent."""
        self.commands: list[tuple[Address, LinkCommand]] = []
        self.messages: list[list[Message]] = [[] for _ in range(size)]
        """What has arrived at whom."""
        self.published: list[list[Published]] = [[] for _ in range(size)]
        self.returned: list[list[tuple[Address, int]]] = [[] for _ in range(size)]
        self._flaws = doubled, delay, jitter
        self._luck = np.random.default_rng(seed)
        self._numbers = count()
        self._agenda: list[tuple[Time, int, Callable[[], None]]] = []
        self._tick_at = start

    def boot(self, me: Address) -> None:
        """Have a robot boot anew: it has forgotten all."""
        self.alive[me] = True
        self.transports[me] = Transport(me, len(self.transports), self.parameters, self.now)

    def send(self, source: Address, destination: Address, payload: bytes) -> int:
        number = self.transports[source].send(destination, payload, self.now)
        self._drain(source)
        return number

    def publish(self, source: Address, topic: int, payload: bytes) -> None:
        self.transports[source].publish(topic, payload, self.now)
        self._drain(source)

    def forget(self, source: Address, other: Address) -> None:
        self.transports[source].forget(other, self.now)
        self._drain(source)

    def at(self, time: Time, act: Callable[[], None]) -> None:
        heappush(self._agenda, (time, next(self._numbers), act))

    def run(self, duration: Time) -> None:
        """Let time pass."""
        end = self.now + duration
        while (time := self._next()) <= end:
            self.now = max(self.now, time)
            while self._agenda and self._agenda[0][0] <= self.now:
                heappop(self._agenda)[2]()
            if self._tick_at <= self.now:
                self._tick_at += 100 * MS
                for me in self._living():
                    self.transports[me].tick((), self.now)
                    self._drain(me)
            for me in self._living():
                deadline = self.transports[me].wake_at()
                if deadline is not None and deadline <= self.now:
                    self.transports[me].wake(self.now)
                    again = self.transports[me].wake_at()
                    assert again is None or again > self.now
                    self._drain(me)
        self.now = end

    def _living(self) -> list[Address]:
        return [me for me, alive in enumerate(self.alive) if alive]

    def _next(self) -> Time:
        deadlines = [self.transports[me].wake_at() for me in self._living()]
        times = [time for time in deadlines if time is not None] + [time for time, _, _ in self._agenda[:1]]
        return min(*times, self._tick_at) if times else self._tick_at

    def _drain(self, me: Address) -> None:
        transport = self.transports[me]
        for item in transport.drain():
            if isinstance(item, Outgoing):
                self._send(me, item)
            else:
                self.commands.append((me, item))
        self.messages[me] += transport.messages()
        self.published[me] += transport.published()
        self.returned[me] += transport.returned()

    def _send(self, teller: Address, item: Outgoing) -> None:
        doubled, delay, jitter = self._flaws
        self.frames.append((teller, item.payload))
        self.sent_at.append(self.now)
        wide = item.destination == BROADCAST
        hearers = [each for each in range(len(self.transports)) if each != teller] if wide else [item.destination]
        for hearer in hearers:
            for _ in range(1 + (self._luck.random() < doubled)):
                late = delay + int(self._luck.integers(jitter + 1))
                if self._luck.random() >= self.loss:
                    reception = Reception(teller, wide)
                    self.at(self.now + late, lambda h=hearer, r=reception: self._hear(h, item.payload, r))  # type: ignore[misc]
        if self.fates and item.token is not None:
            fate = Fate(item.token, Outcome.SENT if wide else Outcome.DELIVERED)
            self.at(self.now + delay // 4, lambda: self._tell_fate(teller, self.transports[teller], fate))

    def _tell_fate(self, me: Address, transport: Transport, fate: Fate) -> None:
        if self.alive[me] and self.transports[me] is transport:
            transport.link(fate, self.now)
            self._drain(me)

    def _hear(self, me: Address, data: bytes, reception: Reception) -> None:
        if self.alive[me] and self.reach(reception.source, me):
            self.transports[me].receive(data, reception, self.now)
            self._drain(me)

    def run_until(self, done: Callable[[], bool], limit: Time = 600 * S) -> Time:
        """Let time pass until *done*, and return how much has passed; fail after *limit*."""
        start = self.now
        while not done():
            assert self.now - start < limit, "it takes too long"
            self.run(100 * MS)
        return self.now - start
