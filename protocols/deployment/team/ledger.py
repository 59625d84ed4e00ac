"""What a robot knows of a plan: the plan, and the facts about it, which it can tell to whoever is to know them too.

Facts only become more, and two ledgers that have told each other all hold the same, in whatever order: that is what
makes a host replaceable. A digest in everybody's news tells whether anything is to be told.
"""

from binascii import crc32
from collections.abc import Iterable
from typing import Final

from cosim.machine import Address
from cosim.units import Time
from protocols.deployment.messages.messages import Facts, Ordered, Told
from protocols.deployment.messages.status import News
from protocols.deployment.tasks.facts import Ended, Fact, Heard, Record, Switched, Terminated
from protocols.deployment.tasks.facts import order as order_of
from protocols.deployment.tasks.orders import Halt, Order, Result
from protocols.deployment.tasks.plan import Plan

_HIGH: Final = 0xFFFF0000
"""The half of a digest that tells how the plan began; the other tells what has happened to it."""


def _checksum(text: str) -> int:
    return crc32(text.encode())


class Ledger:
    """A plan and its facts."""

    def __init__(self, told: Told) -> None:
        self.plan: Plan = told.record.plan
        self.number = self.plan.number
        """The plan's number."""
        self.calls = told.calls
        self._record = told.record
        self._facts: dict[tuple[Time, int, str], Fact] = {}
        self._lost: set[Address] = set()
        self._found: set[Address] = set()
        self._ended: dict[tuple[str, Address], Ended] = {}
        self._begin = _checksum(self._begun(told.record).model_dump_json()) & _HIGH
        self.digest = self._sum()
        """A number that is the same for those who know the same."""
        self.add(told.record.facts)

    @property
    def lost(self) -> frozenset[Address]:
        """The robots that are lost, by what was said last of each."""
        return frozenset(self._lost)

    @property
    def found(self) -> frozenset[Address]:
        """The robots that were lost, and are not any more."""
        return frozenset(self._found)

    def facts(self) -> Facts:
        """Return all facts, in their order."""
        return Facts(plan=self.number, facts=tuple(self._facts[key] for key in sorted(self._facts)))

    def told(self, host: Address) -> Told:
        """Return all that is known, for a robot that knows nothing; *host* leads."""
        return Told(host=host, record=self.record(), calls=self.calls)

    def lacking(self, news: News, host: Address, term: int, order: Order | None = None) -> list[Told | Facts | Ordered]:
        """Return what the author of *news* lacks of what is known here, and its last *order* if it has not got it.

        The *host*, of a *term* of that number, is the author, or leads it. A host that has booted again has forgotten
        the plan.
        """
        if news.plan != self.number:
            return [self.told(host)] if news.plan < self.number else []
        if not self.began_alike(news.digest):
            return [self.told(host)]
        lacks: list[Told | Facts | Ordered] = [self.facts()] if news.digest != self.digest else []
        if order is not None and (news.serial is None or news.serial < order.serial) and not self.ended(order):
            lacks.append(Ordered(term=term, order=order))
        return lacks

    def record(self) -> Record:
        """Return all that it takes to go on with the plan."""
        return self._record.model_copy(update={"facts": self.facts().facts})

    @staticmethod
    def _begun(record: Record) -> Record:
        """Return what of a record never changes: the plan, when it began, and where robots stood."""
        return record.model_copy(update={"facts": (), "serials": {}})

    def of(self, record: Record) -> bool:
        """Return whether a record is of the same plan, begun at the same time by the same host."""
        return self._begun(record) == self._begun(self._record)

    def _sum(self) -> int:
        return self._begin | _checksum(repr(sorted(self._facts))) & ~_HIGH

    def began_alike(self, digest: int) -> bool:
        """Return whether who has that digest means the same plan: two hosts may have begun one of the same number."""
        return digest & _HIGH == self._begin

    def ended(self, order: Order) -> bool:
        """Return whether *order* has been reported to have ended."""
        return (order.task, order.robot) in self._ended

    def done(self, order: Order) -> Ended | None:
        """Return the report that what is *order*-ed has been done, if there is one; nobody is halted beforehand."""
        end = self._ended.get((order.task, order.robot))
        alike = order.plan == self.number and not isinstance(order.errand, Halt)
        return end if alike and end is not None and end.result is Result.DONE else None

    def switched_since(self, at: Time) -> bool:
        """Return whether the plan began after *at*, or its strategy was changed at or after that."""
        switches = [fact.at for fact in self._facts.values() if isinstance(fact, Switched)]
        return max(switches, default=self._record.start - 1) >= at

    def given_up(self) -> set[str]:
        """Return the names of the tasks that an operator has ended."""
        return {fact.task for fact in self._facts.values() if isinstance(fact, Terminated)}

    def done_tasks(self) -> set[str]:
        """Return the names, in the plan, of what robots have reported to be done, be it at another attempt."""
        return {task.partition("~")[0] for (task, _), end in self._ended.items() if end.result is Result.DONE}

    def add(self, facts: Iterable[Fact]) -> list[Fact]:
        """Take *facts*, and return those that are new."""
        new = {order_of(fact): fact for fact in facts}
        new = {key: fact for key, fact in new.items() if key not in self._facts}
        if new:
            self._facts |= new
            self.digest = self._sum()
            for fact in new.values():
                if isinstance(fact, Ended):
                    known = self._ended.setdefault((fact.task, fact.robot), fact)
                    self._ended[fact.task, fact.robot] = min(known, fact, key=lambda end: end.surer)
            heard = [self._facts[key] for key in sorted(self._facts)]
            last = {fact.robot: fact.again for fact in heard if isinstance(fact, Heard)}
            self._lost = {robot for robot, again in last.items() if not again}
            self._found = last.keys() - self._lost
        return list(new.values())
