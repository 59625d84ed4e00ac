"""What another robot seems not to know, by its news, and when it is told again.

Letters are reliable, but who boots again, or was out of reach for so long that its letters were given up, knows less
than the host. Everybody's news say which plan they know, a digest of what they know has happened to it, and the last
order that they have got: what differs for a while is told.
"""

from cosim.machine import Address
from cosim.units import Time
from protocols.deployment.messages.messages import Letter, Ordered
from protocols.deployment.messages.status import News
from protocols.deployment.tasks.orders import Order
from protocols.deployment.team.ledger import Ledger


class Gossip:
    """Since when each other robot has seemed to know something else, or when it was told the last time."""

    def __init__(self, patience: Time) -> None:
        self._patience = patience
        self._since: dict[Address, Time] = {}

    def clear(self) -> None:
        """Begin anew."""
        self._since.clear()

    def told(self, robot: Address, now: Time) -> None:
        """Note that a letter to *robot* is on its way."""
        self._since[robot] = now

    def overdue(self, robot: Address, differs: bool, now: Time) -> bool:
        """Return whether *robot* is to be told now, and take that it is; *differs*: its latest news say so."""
        if not differs:
            self._since.pop(robot, None)
            return False
        since = self._since.setdefault(robot, now)
        if 0 <= now - since < self._patience:
            return False
        self._since[robot] = now
        return True


def lacking(ledger: Ledger, news: News, host: Address, order: Order | None, term: int) -> list[Letter]:
    """Return what the author of *news* seems to lack of what is in *ledger*, and its last *order* if it has not got it.

    It is the *host*, or hears this from it; *term* is the host's. A host that has booted again has forgotten the plan.
    """
    if news.plan != ledger.number:
        return [ledger.told(host)] if news.plan < ledger.number else []
    if not ledger.began_alike(news.digest):
        return [ledger.told(host)]
    letters: list[Letter] = [ledger.facts()] if news.digest != ledger.digest else []
    if order is not None and (news.serial is None or news.serial < order.serial) and not ledger.ended(order):
        letters.append(Ordered(term=term, order=order))
    return letters
