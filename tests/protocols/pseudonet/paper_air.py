"""A piconet on paper: broadcast rooms joined by frames that take one unit of time each, in the order they were sent.

As on the air, a slave's link controller holds what its host has loaded, and answers a poll with the first of it, or
with nothing. What a robot's upper rooms would do is a script: state after state, each telling its robot's turn.
"""

from collections import deque
from dataclasses import replace

import numpy as np

from cosim.machine import BROADCAST, Address, Disconnect, Fate, Outcome, Outgoing, Reception
from cosim.units import Time
from protocols.pseudonet.algorithms.base import UNJUDGED
from protocols.pseudonet.broadcast import Broadcast
from protocols.pseudonet.messages import Action, Kind, Message, Packet, decode
from protocols.pseudonet.upcalls import Exchanged, MessageWanted, TeamChanged, Upcall

TIMEOUT: Time = 100
REPAIR: Time = 40
RETRIES = 3
HOP = (0x2A96EF25, 7)


class Robot:
    """One broadcast room and the script above it."""

    def __init__(self, me: Address, exchanges: int, acknowledge: bool) -> None:
        self.room = Broadcast(me, (TIMEOUT, REPAIR), RETRIES, acknowledge, self._hear)
        self.heard: list[Upcall] = []
        self.queue: deque[Outgoing] = deque()
        self.alive = True
        self._left = exchanges

    @property
    def exchanged(self) -> list[Exchanged]:
        return [upcall for upcall in self.heard if isinstance(upcall, Exchanged)]

    def state(self, exchange: int) -> Message:
        """Return a state that names the robot as its column and what was exchanged so far as its row."""
        row = len(self.exchanged)
        return Message(self.room.me, Kind.STATE, exchange, self.room.me, row, Action.STAY, UNJUDGED)

    def load(self, now: Time) -> None:
        message = self.state(self.room.exchange)
        self.room.load(message, now)

    def fill(self) -> None:
        """Hand what the room has for the air to the link controller."""
        self.queue.extend(out for out in self.room.out if isinstance(out, Outgoing))
        self.room.out.clear()

    def _hear(self, upcall: Upcall, now: Time) -> None:
        self.heard.append(upcall)
        if isinstance(upcall, MessageWanted):
            self.room.load(replace(self.state(self.room.exchange), busy=True), now)
        elif isinstance(upcall, TeamChanged) and self.room.me in upcall.members:
            self.load(now)
        elif isinstance(upcall, Exchanged):
            self._left -= 1
            if self._left > 0:
                self.load(now)


class PaperAir:
    """Robots 0 (the master) to *size* - 1, and what was on the air: (source, destination, packet or None for none)."""

    def __init__(self, size: int, exchanges: int = 1, acknowledge: bool = False) -> None:
        self.robots = [Robot(me, exchanges, acknowledge) for me in range(size)]
        self.exchanges = exchanges
        self.now: Time = 0
        self.air: list[tuple[Address, Address, Packet | None]] = []
        self.deaf: set[tuple[Address, int]] = set()
        """(receiver, number of the frame on the air) that is not heard."""
        self.empty: dict[Address, int] = {}
        """How many polls of a slave are answered with nothing, though it may have loaded a message."""
        self._loss = 0.0
        self._rng = np.random.default_rng(0)

    def run(self, frames: int | None = None) -> None:
        """Carry frames, and let time-outs come, until so many were carried or nobody has anything more to say."""
        master = self.robots[0].room
        while frames is None or len(self.air) < frames:
            if master.out:
                item = master.out.pop(0)
                if isinstance(item, Disconnect):
                    self.robots[item.peer].alive = False
                elif isinstance(item, Outgoing):
                    self._carry(item)
            elif master.deadline is not None:
                self.now = master.deadline
                master.wake(self.now)
            else:
                return

    def lose(self, chance: float, seed: int) -> None:
        """Let each slave miss each broadcast with this *chance*."""
        self._loss, self._rng = chance, np.random.default_rng(seed)

    def run_to_the_end(self) -> None:
        """Run, and let slaves wake, until nobody lacks anything."""
        self.run()
        while deadlines := [robot.room.deadline for robot in self.robots[1:] if robot.room.deadline is not None]:
            self.now = max(self.now, min(deadlines))
            for robot in self.robots[1:]:
                robot.room.wake(self.now)
                robot.fill()
            for robot in self.robots[1:]:
                self.answer_of(robot.room.me)
            self.run()

    def answer_of(self, slave: Address) -> None:
        """Poll *slave* as a link controller does, without its host, until it has nothing more to say."""
        while self.robots[slave].queue:
            self._answer(self.robots[slave], None)

    def assemble(self) -> None:
        self.robots[0].room.assemble(tuple(range(len(self.robots))), HOP, self.now)

    def count(self, kind: type) -> int:
        return sum(isinstance(packet, kind) for _, _, packet in self.air)

    def _carry(self, item: Outgoing) -> None:
        self.now += 1
        frame = len(self.air)
        self.air.append((0, item.destination, decode(item.payload)))
        meant = [robot for robot in self.robots[1:] if item.destination in (BROADCAST, robot.room.me)]
        hearing = [robot for robot in meant if robot.alive and (robot.room.me, frame) not in self.deaf]
        if item.destination == BROADCAST and self._loss:
            hearing = [robot for robot in hearing if self._rng.random() >= self._loss]
        for robot in hearing:
            robot.room.receive(item.payload, Reception(0, item.destination == BROADCAST), self.now)
            robot.fill()
        if item.destination != BROADCAST and hearing:
            self._answer(hearing[0], item.token)

    def _answer(self, slave: Robot, token: int | None) -> None:
        self.now += 1
        master = self.robots[0].room
        answer = None
        if self.empty.get(slave.room.me, 0):
            self.empty[slave.room.me] -= 1
        elif slave.queue:
            answer = slave.queue.popleft()
        self.air.append((slave.room.me, 0, None if answer is None else decode(answer.payload)))
        if answer is not None:
            master.receive(answer.payload, Reception(slave.room.me, False), self.now)
        if token is not None:
            master.fate(Fate(token, Outcome.DELIVERED), self.now)
