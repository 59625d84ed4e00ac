"""The null model: every payload reaches everyone after a fixed delay, nothing is lost, links are there at once.

What remains of an experiment's cost on this channel is the algorithm's own; the difference to a radio's column is the
radio's. Roles and link commands are answered as a radio would, by an event at the same instant, so that a machine that
manages links runs here unchanged.
"""

from typing import Literal

from pydantic import Field

from cosim.channels.base import Arrival, Channel
from cosim.kernel import Kernel
from cosim.machine import (
    BROADCAST,
    Address,
    Connected,
    Disconnect,
    Discovered,
    Fate,
    Flush,
    Inquire,
    InquiryComplete,
    LinkCommand,
    LinkEvent,
    Lost,
    Outcome,
    Outgoing,
    Page,
    PageFailed,
    Reception,
    Role,
    Scan,
)
from cosim.settings import Settings
from cosim.trace import FRAMES, Trace
from cosim.units import Time, from_seconds


class IdealSettings(Settings):
    """Parameters of the ideal channel."""

    kind: Literal["ideal"] = "ideal"
    delay_s: float = Field(default=1e-6, gt=0, description="from sending to arrival, for every payload")


class IdealChannel(Channel):
    """Instant links between all devices that are switched on, and a fixed delay without loss."""

    def __init__(self, settings: IdealSettings, kernel: Kernel, trace: Trace, size: int) -> None:
        super().__init__(kernel, trace, size)
        self.delay: Time = max(1, from_seconds(settings.delay_s))
        self.sent = 0
        self._on = [True] * size
        self._scanning = [True] * size
        self._arrivals: list[Arrival] = []
        self._arrive_at: Time | None = None
        self._late_news: list[tuple[Address, LinkEvent]] = []
        self._news: list[tuple[Address, LinkEvent]] = []

    def send(self, source: Address, outgoing: Outgoing) -> None:
        """Deliver after the delay; the fate is DELIVERED or SENT at that instant, or NO_LINK to a dead device, at once."""
        to_all = outgoing.destination == BROADCAST
        receivers = [a for a in self.in_reach(source) if to_all or a == outgoing.destination]
        if not to_all and not receivers:
            self._tell_fate(source, outgoing, Outcome.NO_LINK)
            return
        self.sent += 1
        self._record(source, outgoing)
        reception = Reception(source, to_all)
        fate = Outcome.SENT if to_all else Outcome.DELIVERED
        arrivals = [(address, outgoing.payload, reception) for address in receivers]
        self._schedule(arrivals, source, outgoing, fate)

    def command(self, source: Address, command: LinkCommand) -> None:
        """Answer like a radio that takes no time."""
        match command:
            case Inquire(enough=enough):
                found = tuple(a for a in self.in_reach(source) if self._scanning[a])[:enough]
                self._tell(*((source, Discovered(peer)) for peer in found), (source, InquiryComplete(found)))
            case Page(peer=peer) if peer in self.in_reach(source) and self._scanning[peer]:
                self._tell((source, Connected(peer, Role.MASTER)), (peer, Connected(source, Role.SLAVE)))
            case Page(peer=peer):
                self._tell((source, PageFailed(peer)))
            case Scan(enabled=enabled):
                self._scanning[source] = enabled
            case Disconnect(peer=peer):
                self._tell((source, Lost(peer)), (peer, Lost(source)))
            case Flush():
                pass  # nothing ever waits in a queue

    def in_reach(self, address: Address) -> tuple[Address, ...]:
        """Return all other devices that are switched on, if this one is."""
        if not self._on[address]:
            return ()
        return tuple(a for a in range(self.size) if a != address and self._on[a])

    def power(self, address: Address, on: bool) -> None:
        """Switch a device on or off; the others lose a dead one at once."""
        self._on[address] = on
        if not on:
            self._tell(*((a, Lost(address)) for a in range(self.size) if a != address and self._on[a]))

    def summary(self) -> dict[str, float]:
        """Return the number of payloads sent."""
        return {"frames_sent": float(self.sent)}

    def _schedule(self, arrivals: list[Arrival], source: Address, outgoing: Outgoing, fate: Outcome) -> None:
        news: list[tuple[Address, LinkEvent]] = []
        if outgoing.token is not None:
            news.append((source, Fate(outgoing.token, fate)))
        at = self.kernel.now + self.delay
        if self._arrive_at == at:  # sent at the same instant: one event for all
            self._arrivals.extend(arrivals)
            self._late_news.extend(news)
            return
        self._arrive_at, self._arrivals, self._late_news = at, arrivals, news
        batch, late = arrivals, news
        self.kernel.at(at, lambda: self._arrive(batch, late))

    def _arrive(self, arrivals: list[Arrival], news: list[tuple[Address, LinkEvent]]) -> None:
        self.deliver(
            [arrival for arrival in arrivals if self._on[arrival[0]]],
            [item for item in news if self._on[item[0]]],
        )

    def _tell(self, *news: tuple[Address, LinkEvent]) -> None:
        if not self._news:
            self.kernel.soon(self._pass_on)
        self._news.extend(news)

    def _tell_fate(self, source: Address, outgoing: Outgoing, outcome: Outcome) -> None:
        if outgoing.token is not None:
            self._tell((source, Fate(outgoing.token, outcome)))

    def _pass_on(self) -> None:
        news, self._news = self._news, []
        self.deliver((), [item for item in news if self._on[item[0]]])

    def _record(self, source: Address, outgoing: Outgoing) -> None:
        self.trace.row(
            FRAMES,
            self.kernel.now,
            source,
            outgoing.destination,
            self.delay,
            "IDEAL",
            -1,
            0,
            len(outgoing.payload),
            "received",
        )
