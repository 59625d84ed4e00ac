"""The truth about a search: who is dead. What counts else is what hosts know, which no body shows."""

from cosim.arrays import Floats
from cosim.machine import Address
from cosim.protocol import Death, Referee
from cosim.units import Time
from protocols.aggregation.setup import Setup


class SearchReferee(Referee):
    """Lets a run go on until all living robots have stopped, or its time is over."""

    def __init__(self, setup: Setup) -> None:
        self._hosts = setup.hosts
        self._dead: set[Address] = set()

    def look(self, x_m: Floats, y_m: Floats, now: Time) -> bool:
        """Return whether no host lives any more: then nobody can be told anything."""
        return all(host in self._dead for host in range(self._hosts))

    def died(self, death: Death) -> None:
        """Note who is dead."""
        self._dead.add(death.robot)

    def verdict(self, now: Time) -> dict[str, float]:
        """Return how many hosts live."""
        return {"hosts_alive": float(self._hosts - sum(host in self._dead for host in range(self._hosts)))}
