"""Who is host: whom a robot takes orders from, and who takes over when that one falls silent.

A host that falls silent is succeeded by the lowest living address. Whoever is host says so in its news; of two hosts
that hear of each other (a partition that is over, a host that was only slow) the one with the later plan stays, of
equal ones the lowest address. A robot that has booted again without a plan therefore follows who has one.

A robot that hears nobody at all waits longer before it takes over: where radios need links, the death of one may take
all of them, and the others are only out of touch.
"""

from collections.abc import Callable
from typing import TypeAlias

from cosim.machine import Address
from cosim.units import Time

WhenHeard: TypeAlias = Callable[[Address], Time]
"""When anything of another robot was heard last; when the own machine began, if nothing ever was."""


class Succession:
    """One robot's view of it."""

    def __init__(self, me: Address, size: int, first: Address, silence: Time, alone: Time, start: Time = 0) -> None:
        """Follow *first*; take who was silent for *silence* for dead, and for *alone* if everybody was."""
        self.me = me
        self.host = first
        self.term = 0
        """How often the team's host has changed, as far as is known here: one counts once it has said so."""
        self.why = ""
        """Why the host has changed the last time."""
        self.since = start
        """Since when a host gives others time to be heard."""
        self._others = [other for other in range(size) if other != me]
        self._silence = silence
        self._alone = alone
        self._confirmed = first == me
        """Whether the host has said itself that it is."""
        self._fallen: dict[Address, Time] = {}
        """Hosts whose silence has made it follow another, and when that was."""

    @property
    def leads(self) -> bool:
        """Whether this robot is host."""
        return self.host == self.me

    def living(self, heard: WhenHeard, now: Time) -> list[Address]:
        """Return who is taken to live, in order: oneself, and who was heard lately."""
        return sorted([self.me, *(other for other in self._others if not self.silent(other, heard, now))])

    def silent(self, other: Address, heard: WhenHeard, now: Time) -> bool:
        """Return whether nothing was heard of *other* for too long."""
        return now - heard(other) > self._silence

    def alone(self, heard: WhenHeard, now: Time) -> bool:
        """Return whether nobody at all has been heard lately: so it may be oneself who is out of reach."""
        return all(2 * (now - heard(other)) > self._silence for other in self._others)

    def missed(self, other: Address, heard: Time, alone: bool, now: Time) -> bool:
        """Return whether *other*, which was *heard* last then, is to be taken for lost by a host.

        Who is *alone* waits longer: it may be the one that is out of reach. A new host gives all others time to be
        heard, as with a host that dies all links of its radio may; but not those hosts whose silence has made it one.
        """
        fell = heard <= self._fallen.get(other, heard - 1)
        since = heard if fell else max(heard, self.since)
        return now - since > (self._alone if alone else self._silence)

    def judge(self, heard: WhenHeard, now: Time) -> bool:
        """Follow the lowest living address if the host has fallen silent; return whether that is another."""
        if self.leads or not self.silent(self.host, heard, now):
            return False
        if self.alone(heard, now) and now - heard(self.host) <= self._alone:
            return False
        living = self.living(heard, now)
        self._fallen[self.host] = now
        own = living[0] == self.me  # else it may never lead: who follows it in vain has been led by nobody
        self._follow(living[0], self.term + own, f"nothing heard of robot {self.host}")
        return True

    def claimed(self, source: Address, term: int, plan: int, own_plan: int) -> bool:
        """Take that *source* says to be host, with a *plan* of that number; return whether the host is another now."""
        newer = plan > own_plan
        if source == self.host:
            self._confirmed = True
            self.term = max(self.term, term)
            return False
        if self._confirmed and not newer and (plan < own_plan or source > self.host):
            return False
        why = "it has a later plan" if newer else "it is host already" if not self._confirmed else "a lower address"
        self._follow(source, max(self.term, term), f"robot {source} says so: {why}")
        self._confirmed = True
        return True

    def rivalled(self, source: Address, host: Address, term: int) -> bool:
        """Return whether the news of *source* tell this host that another has led meanwhile, and count that."""
        if host != source and term <= self.term:
            return False
        self.term = max(self.term, term) + 1
        return True

    def _follow(self, host: Address, term: int, why: str) -> None:
        self.host, self.term, self.why = host, term, why
        self._confirmed = host == self.me
