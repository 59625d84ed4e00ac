"""A play that is being played, as one robot knows it: its ledger, and, where it is run, its executive."""

from collections.abc import Iterable

from cosim.machine import Address
from cosim.units import Time
from protocols.deployment.executing.executive import Executive
from protocols.deployment.messages.messages import Told
from protocols.deployment.parameters import Parameters
from protocols.deployment.setup import Setup
from protocols.deployment.tasks.facts import Fact
from protocols.deployment.tasks.orders import Order, Report, Whereabouts
from protocols.deployment.team.ledger import Ledger
from protocols.deployment.team.reunion import Past


class Play:
    """One robot's copy of it."""

    def __init__(self, told: Told, parameters: Parameters, setup: Setup) -> None:
        self.ledger = Ledger(told)
        self.executive: Executive | None = None
        """Runs the play; None with one who only keeps the ledger."""
        self._parameters = parameters
        self._setup = setup
        self._latest: dict[Address, Order] = {}
        """The last order to each robot."""

    @property
    def number(self) -> int:
        """The plan's number."""
        return self.ledger.number

    @property
    def over(self) -> bool:
        """Whether it has been played to its end, as far as is known here; never with one who does not run it.

        One replica of several does not know whether others have come back to their posts; each knows it of itself.
        """
        if self.executive is None:
            return False
        if self._parameters.executive == "distributed":
            return self.ledger.plan.root.name in self.executive.results
        return self.executive.finished

    @property
    def runs(self) -> bool:
        """Whether it is run here, and not over."""
        return self.executive is not None and not self.over

    def run(self, whereabouts: Iterable[Whereabouts], now: Time) -> None:
        """Run it from now on, by all that is known of it."""
        known, parameters, record = self._setup, self._parameters.executing, self.ledger.record()
        self._latest.clear()
        if record.facts or now != record.start:
            self.executive = Executive.restored(record, known.crew, known.floor, parameters, now)
        else:
            self.executive = Executive(record.plan, known.crew, known.floor, parameters, now, record.starts_m)
        for each in whereabouts:
            self.executive.whereabouts(each, now)

    def rest(self) -> None:
        """Run it no more: somebody else does."""
        self.executive = None

    def add(self, facts: Iterable[Fact], now: Time) -> list[Fact]:
        """Take facts; return those that are new."""
        new = self.ledger.add(facts)
        if self.executive is not None:
            for fact in new:
                self.executive.learn(fact, now)
        return new

    def whereabouts(self, whereabouts: Whereabouts, now: Time) -> None:
        """Take where a robot is."""
        if self.executive is not None:
            self.executive.whereabouts(whereabouts, now)

    def orders(self) -> list[Order]:
        """Drain the orders that the executive gives."""
        orders = [] if self.executive is None else self.executive.orders()
        self._latest |= {order.robot: order for order in orders}
        return orders

    def order_to(self, robot: Address) -> Order | None:
        """Return the last order to *robot*."""
        return self._latest.get(robot)

    def wake(self, now: Time) -> None:
        """Act on the executive's deadlines."""
        if self.executive is not None:
            self.executive.wake(now)

    def wake_at(self) -> Time | None:
        """Return the executive's next deadline."""
        return None if self.executive is None else self.executive.wake_at()

    def breaches(self, since: Time) -> list[str]:
        """Drain the constraints that were not kept, in words; without those that were certain *since* or before."""
        found = [] if self.executive is None else self.executive.breaches()
        return [breach.why for breach in found if breach.at > since]

    def past(self) -> Past:
        """Return what has happened to it, for who begins it again."""
        ledger, known = self.ledger, Past(self.ledger.done_tasks(), self.ledger.given_up())
        if self.executive is None:
            return known
        progress, casting = self.executive.progress, self.executive.progress.casting
        casts = {name: deploying.cast for name, deploying in progress.deployments.items()}
        return known._replace(casts=casts, roles={robot: casting.role(robot) for robot in ledger.plan.robots})

    def misses(self, robot: Address) -> bool:
        """Return whether a robot that is there again has lost a part that nobody else has taken."""
        return self.executive is not None and self.executive.progress.misses(robot)

    @property
    def end(self) -> str | None:
        """How the whole plan has ended; None if it has not."""
        if self.executive is None or not self.over:
            return None
        return self.executive.results[self.ledger.plan.root.name].value

    def ends(self) -> list[Report]:
        """Drain how tasks have ended."""
        return [] if self.executive is None else self.executive.ended()
