"""How what an executive wants leaves the machine that runs it: orders as letters, or to the own member; and ends.

The host says how a plan has ended, and which constraints were not kept. Its successor does not say so again, as far as
it can know: its news tell that the plan is over, and what was certain by then it has said itself.
"""

from collections.abc import Callable
from typing import Protocol

from cosim.machine import Address, Event
from cosim.units import Time
from protocols.deployment.counters import Counters
from protocols.deployment.messages.messages import Facts, Letter, Ordered
from protocols.deployment.messages.status import News
from protocols.deployment.tasks import events
from protocols.deployment.tasks.orders import Order
from protocols.deployment.team.gossip import Gossip, lacking
from protocols.deployment.team.play import Play
from protocols.deployment.team.succession import Succession


class Mail(Protocol):
    """What carries letters to other robots."""

    def post(self, destination: Address, letter: Letter, now: Time) -> None:
        """Send a letter reliably."""

    def forget(self, other: Address, now: Time) -> None:
        """Send nothing any more of what is on its way to a robot."""


class Dispatch:
    """Passes on what the executive of one robot wants: all of it if that is the central one, else what is its own."""

    def __init__(
        self,
        me: Address,
        central: bool,
        mail: Mail,
        gossip: Gossip,
        note: Callable[[Event], None],
        counters: Counters,
        start: Time,
    ) -> None:
        self.mine: list[Order] = []
        """Orders to this robot itself; drained by who gives them to the member."""
        self.breaches: list[str] = []
        """Constraints that were not kept, in words; drained by who reads them."""
        self.ends: list[tuple[int, str]] = []
        """Plans that have ended, and how; likewise."""
        self.gossip = gossip
        self.announced = 0
        """The number of the last plan that is known to have been said to have ended, by whoever was host."""
        self._since = start - 1
        """When a host was heard last before this robot was: what was certain by then has been said."""
        self._me = me
        self._central = central
        self._mail = mail
        self._note = note
        self._counters = counters

    def hear(self, source: Address, news: News, leads: bool, now: Time) -> None:
        """Take what another's *news* say of what hosts have said; *leads*: this robot is host."""
        if news.over:
            self.announced = max(self.announced, news.plan)
        if news.host == source and not leads:
            self._since = now

    def clear(self) -> None:
        """Begin anew, as there is another host."""
        self.gossip.clear()
        self.mine.clear()

    def compare(self, play: Play, source: Address, news: News, succession: Succession, now: Time) -> None:
        """Tell *source* what it seems not to know, once it has seemed so for a while."""
        order = play.order_to(source) if self._central and succession.leads else None
        lacks = lacking(play.ledger, news, succession.host, order, succession.term)
        if self.gossip.overdue(source, bool(lacks), now):
            for letter in lacks:
                self._mail.post(source, letter, now)

    def advance(self, play: Play, leads: bool, term: int, now: Time) -> None:
        """Pass on what *play* wants and tells; *leads*: this robot is host, with that *term*."""
        for order in play.orders():
            if order.robot == self._me or (self._central and leads):
                self._pass_on(order, term, now)
        if not leads:
            return
        breaches = play.breaches(self._since)
        for why in breaches:
            self._counters.breaches += 1
            self._note(events.Breached(play.number, why))
        self.breaches += breaches
        result = play.end
        if result is not None and self.announced < play.number:
            self.announced = play.number
            self._counters.ended.append((play.number, result, now))
            self._note(events.PlanEnded(play.number, result))
            self.ends.append((play.number, result))

    def take(self, order: Order, play: Play | None, host: Address, now: Time) -> None:
        """Take an order of the *host*; what has been done is not done again, but the host told: it has not heard so."""
        done = None if play is None else play.ledger.done(order)
        if play is None or done is None:
            self.mine.append(order)
        else:
            self._mail.post(host, Facts(plan=play.number, facts=(done,)), now)

    def _pass_on(self, order: Order, term: int, now: Time) -> None:
        self._counters.ordered += 1
        self._note(events.Ordered(order.robot, order.plan, order.serial, order.task, order.errand.act))
        if order.robot == self._me:
            self.mine.append(order)
        else:
            self.gossip.told(order.robot, now)
            self._mail.post(order.robot, Ordered(term=term, order=order), now)
