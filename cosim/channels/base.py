"""What every channel is: a mover of bytes between addresses that says when they arrive, or why they do not.

A channel knows endpoints by address and robots by position only. Everything that arrives at one instant is one kernel
event; each endpoint that has to act on it is drained once, in the order of addresses.
"""

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterable
from typing import Any, ClassVar, Final, NamedTuple, Protocol, TypeAlias

import numpy as np

from cosim.channels.energy import Accounts
from cosim.intervals import Interval, Intervals
from cosim.kernel import Kernel
from cosim.machine import Address, LinkCommand, LinkEvent, Outcome, Outgoing, Reception
from cosim.payloads import HeldRow, Payloads
from cosim.protocol import Metric
from cosim.trace import UNSENT, Trace
from cosim.units import Time

Positions: TypeAlias = np.ndarray[Any, np.dtype[np.float64]]
Arrival: TypeAlias = tuple[Address, bytes, Reception]
"""(receiver, payload, how it arrived)"""
WHY_UNSENT: Final = {
    Outcome.NO_LINK: "not in reach, or no link; over Bluetooth links are made by Inquire, Page and Scan, and a slave "
    'has one to its master only (docs/guides/protocol.md, "Over Bluetooth")',
    Outcome.NO_ROUTE: "no route to the receiver",
    Outcome.TOO_LONG: "longer than any packet in use: send less at once",
    Outcome.QUEUE_FULL: "no room in the sender's device: send less often, or wait for the Fate of a token",
}
"""Reasons why payloads were never on the air, and what to do about them."""


class Flying(NamedTuple):
    """A frame that is on the air."""

    start: Time
    source: Address
    end: Time
    kind: str
    destination: Address
    length: int
    """Of its payload, B."""
    channel: int = -1
    lt_addr: int = 0
    radio: int = 0
    told: bool = False
    """True if its row of the table ``transmissions`` is written when it begins."""


class Endpoint(Protocol):
    """The end that a channel delivers to: takes several inputs of one instant, then acts on them once.

    Who derives from it takes no notice of what it does not override.
    """

    def receive(self, data: bytes, reception: Reception, now: Time) -> bool | None:
        """Take a payload; return False if there is nothing to act on."""
        return False

    def link(self, event: LinkEvent, now: Time) -> bool | None:
        """Take a link event; return False if there is nothing to act on."""
        return False

    def drain(self, now: Time) -> None:
        """Act on what came in at this instant."""
        return


class Channel(ABC):
    """A shared medium with one device for each address, 0 to *size* - 1."""

    metrics: ClassVar[tuple[Metric, ...]] = ()
    """The metrics that ``summary`` may return: names that no protocol uses."""

    def __init__(self, kernel: Kernel, trace: Trace, size: int) -> None:
        self.kernel = kernel
        self.trace = trace
        self.size = size
        self.intervals = Intervals(trace)
        """What its radios are doing, if the trace wants that."""
        self.payloads = Payloads(trace)
        """What its radios hold, if the trace wants that."""
        self.accounts: Accounts | None = None
        """What its radios have used, if a scenario asks for that."""
        self.endpoints: dict[Address, Endpoint] = {}
        self._unsent: Counter[tuple[Address, Outcome]] = Counter()

    def attach(self, address: Address, endpoint: Endpoint) -> None:
        """Deliver what arrives at *address* to *endpoint*."""
        self.endpoints[address] = endpoint

    @property
    def columns(self) -> tuple[Metric, ...]:
        """The metrics that ``summary`` of this channel returns."""
        return self.metrics if self.accounts is None else (*self.metrics, *self.accounts.columns)

    @property
    def uses(self) -> frozenset[str]:
        """The names of those of them that say what radios have used: no outcome of a run."""
        return frozenset() if self.accounts is None else frozenset(metric.name for metric in self.accounts.columns)

    @property
    def parts(self) -> "tuple[Channel, ...]":
        """The channels that this one consists of, by radio number; they meet in a shared air only."""
        return (self,)

    def carried(self, address: Address) -> tuple[int, ...]:  # where there are several, it depends
        """Return which radios the robot *address* has."""
        return (0,)

    @abstractmethod
    def send(self, source: Address, outgoing: Outgoing) -> None:
        """Queue a payload at the device of *source*; its fate, if a token asks for it, comes as a link event."""

    @abstractmethod
    def command(self, source: Address, command: LinkCommand) -> None:
        """Carry out a link command of the host at *source*; answers come as link events, never inside this call."""

    @abstractmethod
    def in_reach(self, address: Address) -> tuple[Address, ...]:
        """Return the robots that would hear *address* now, in order."""

    def advance(self, now: Time) -> None:  # noqa: B027  # most channels have nothing that runs ahead
        """Bring models that run ahead lazily up to *now*; called before anything moves."""

    def moved(self, positions_m: Positions) -> None:  # noqa: B027  # not every channel has a reach
        """Take the robots' new positions, shape (size, 2); gains are computed when they are needed."""

    @abstractmethod
    def power(self, address: Address, on: bool) -> None:
        """Switch the radio at *address* on or off."""

    def under_way(self, now: Time) -> list[Interval]:
        """Return what its radios are doing *now*, for who watches a run."""
        return self.intervals.under_way(now)

    def flying(self, now: Time) -> list[Flying]:
        """Return the frames that are on the air *now* and are rows when they end, for who watches a run."""
        return []

    def held(self, now: Time) -> list[HeldRow]:
        """Return rows of the payloads that its radios hold *now*, for who watches a run."""
        self._note_begun()
        return self.payloads.under_way(now)

    def _note_begun(self) -> None:  # noqa: B027  # most channels do so as it happens
        """Note which payloads have been on the air and are not over."""

    def close(self, now: Time) -> None:
        """Write the intervals and payloads that are not over: the run is."""
        self.intervals.close(now)
        self._note_begun()
        self.payloads.close(now)

    def summary(self) -> dict[str, float]:
        """Return what the channel counted, by metric name."""
        return {}

    def _used(self) -> dict[str, float]:
        """Return what its radios have used, by metric name, if a scenario asks for that."""
        return {} if self.accounts is None else self.accounts.summary(self.kernel.now)

    @property
    def unsent(self) -> Counter[tuple[Address, Outcome]]:
        """Number of payloads that were never on the air, by sender and reason, also of senders that did not ask."""
        return self._unsent

    def note_unsent(self, source: Address, destination: Address, length: int, why: Outcome) -> None:
        """Count a payload of *source* that will never be on the air; the host is not informed here."""
        self._unsent[source, why] += 1
        self.trace.row(UNSENT, self.kernel.now, source, destination, length, why.value)

    def deliver(self, arrivals: Iterable[Arrival], events: Iterable[tuple[Address, LinkEvent]] = ()) -> None:
        """Hand payloads, then link events, to their endpoints, and drain those that have to act once, in order."""
        now, endpoints = self.kernel.now, self.endpoints
        touched: set[Address] = set()
        touch = touched.add
        for address, payload, reception in arrivals:
            if endpoints[address].receive(payload, reception, now) is not False:
                touch(address)
        for address, event in events:
            if endpoints[address].link(event, now) is not False:
                touch(address)
        for address in sorted(touched):
            endpoints[address].drain(now)
